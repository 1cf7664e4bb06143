//! The shape of a grain that is no sphere: an ellipsoid, or a template of a polyhedron with a diameter.

use std::f64::consts::PI;

use super::{
    CaliperSizes, Ellipsoid, Form, ParallelBody, Polyhedron, ScaledPolyhedron, ShapeFigures, sphere_volume,
};

/// The shape of a grain, with its template by number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// An ellipsoid. A sphere has three equal semi-axes.
    Ellipsoid(Ellipsoid),
    /// A convex polyhedron: one of the templates of its packing, which have an equivalent diameter of 1.
    Polyhedron {
        /// Index of the template.
        template: u32,
        /// Equivalent diameter in mm, which is the scale of the template.
        d_mm: f64,
    },
}

impl Solid {
    /// A polyhedron by the index of its template.
    #[must_use]
    pub fn of_template(template: u32, d_mm: f64) -> Self {
        Self::Polyhedron { template, d_mm }
    }

    /// What it is called.
    #[must_use]
    pub fn noun(&self) -> &'static str {
        match self {
            Self::Ellipsoid(_) => "ellipsoid",
            Self::Polyhedron { .. } => "polyhedron",
        }
    }

    /// Diameter of the sphere of equal volume in mm.
    #[must_use]
    pub fn d_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.equivalent_diameter_mm(),
            Self::Polyhedron { d_mm, .. } => *d_mm,
        }
    }

    /// Volume in mm³; of a polyhedron by its diameter.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.volume_mm3(),
            Self::Polyhedron { d_mm, .. } => sphere_volume(*d_mm),
        }
    }

    /// Volume in mm³ of all points within a distance of the grain, which must not be negative. `templates` are the
    /// parallel bodies of the templates.
    #[must_use]
    pub fn coated_volume_mm3(&self, distance_mm: f64, templates: &[ParallelBody]) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) if distance_mm > 0.0 => {
                ParallelBody::from(ellipsoid).volume_at(distance_mm)
            }
            Self::Ellipsoid(ellipsoid) => ellipsoid.volume_mm3(),
            Self::Polyhedron { template, d_mm } => {
                templates[*template as usize].scaled(*d_mm).volume_at(distance_mm)
            }
        }
    }

    /// The shape with all lengths multiplied. A factor that leaves no shape, which no packing has, changes nothing.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        match *self {
            Self::Ellipsoid(ellipsoid) => Self::Ellipsoid(ellipsoid.scaled(factor).unwrap_or(ellipsoid)),
            Self::Polyhedron { template, d_mm } => Self::Polyhedron { template, d_mm: d_mm * factor },
        }
    }

    /// Whether all numbers are those of another shape, to the last bit.
    #[must_use]
    pub fn has_bits_of(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Ellipsoid(one), Self::Ellipsoid(other)) => {
                let bits = |of: &Ellipsoid| of.semi_axes_mm().map(f64::to_bits);
                bits(one) == bits(other)
            }
            (Self::Polyhedron { template: one, d_mm }, Self::Polyhedron { template, d_mm: other_mm }) => {
                one == template && d_mm.to_bits() == other_mm.to_bits()
            }
            _ => false,
        }
    }

    /// The ellipsoid, where it is one.
    #[must_use]
    pub fn ellipsoid(&self) -> Option<&Ellipsoid> {
        match self {
            Self::Ellipsoid(ellipsoid) => Some(ellipsoid),
            Self::Polyhedron { .. } => None,
        }
    }

    /// Index of the template, where it is a polyhedron.
    #[must_use]
    pub fn template(&self) -> Option<u32> {
        match self {
            Self::Ellipsoid(_) => None,
            Self::Polyhedron { template, .. } => Some(*template),
        }
    }

    /// The shape with its template; `None` where there is no template of that number.
    #[must_use]
    pub fn of(self, templates: &[Polyhedron]) -> Option<SolidRef<'_>> {
        Some(match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.into(),
            Self::Polyhedron { template, d_mm } => {
                let template = templates.get(template as usize)?;
                ScaledPolyhedron { template, scale_mm: d_mm }.into()
            }
        })
    }
}

impl From<Ellipsoid> for Solid {
    fn from(ellipsoid: Ellipsoid) -> Self {
        Self::Ellipsoid(ellipsoid)
    }
}

/// The shape of a grain, with its template.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SolidRef<'a> {
    /// An ellipsoid.
    Ellipsoid(Ellipsoid),
    /// A template with its scale.
    Polyhedron(ScaledPolyhedron<'a>),
}

impl<'a> SolidRef<'a> {
    /// The ellipsoid, where it is one.
    #[must_use]
    pub fn ellipsoid(&self) -> Option<Ellipsoid> {
        match *self {
            Self::Ellipsoid(ellipsoid) => Some(ellipsoid),
            Self::Polyhedron(_) => None,
        }
    }

    /// The polyhedron, where it is one.
    #[must_use]
    pub fn polyhedron(&self) -> Option<ScaledPolyhedron<'a>> {
        match *self {
            Self::Ellipsoid(_) => None,
            Self::Polyhedron(polyhedron) => Some(polyhedron),
        }
    }

    /// Volume in mm³.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.volume_mm3(),
            Self::Polyhedron(polyhedron) => polyhedron.volume_mm3(),
        }
    }

    /// Diameter of the sphere of equal volume in mm.
    #[must_use]
    pub fn equivalent_diameter_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.equivalent_diameter_mm(),
            Self::Polyhedron(polyhedron) => polyhedron.equivalent_diameter_mm(),
        }
    }

    /// Edge of the smallest square opening that the grain passes, in mm.
    #[must_use]
    pub fn sieve_size_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.sieve_size_mm(),
            Self::Polyhedron(polyhedron) => polyhedron.scale_mm * polyhedron.template.sieve_size(),
        }
    }

    /// Surface in mm².
    #[must_use]
    pub fn surface_mm2(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.surface_mm2(),
            Self::Polyhedron(polyhedron) => {
                polyhedron.template.surface() * polyhedron.scale_mm * polyhedron.scale_mm
            }
        }
    }

    /// Sphericity of Wadell: surface of the sphere of equal volume over that of the grain.
    #[must_use]
    pub fn sphericity(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.sphericity(),
            Self::Polyhedron(ScaledPolyhedron { template, .. }) => {
                PI * template.equivalent_diameter().powi(2) / template.surface()
            }
        }
    }

    /// Radius of the smallest sphere around the centre that holds the grain, in mm.
    #[must_use]
    pub fn outer_radius_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.semi_axes_mm().x,
            Self::Polyhedron(polyhedron) => polyhedron.template.outer_radius() * polyhedron.scale_mm,
        }
    }

    /// Elongation and flatness; of a polyhedron those of the ellipsoid of equal inertia ([`Polyhedron::form`]).
    #[must_use]
    pub fn form(&self) -> Form {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.form(),
            Self::Polyhedron(polyhedron) => polyhedron.template.form(),
        }
    }

    /// All figures of the shape. Those of a polyhedron are the template's times the scale.
    #[must_use]
    pub fn figures(&self) -> ShapeFigures {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.into(),
            Self::Polyhedron(polyhedron) => {
                ShapeFigures::from(polyhedron.template).scaled(polyhedron.scale_mm)
            }
        }
    }

    /// Volume, sieve size and caliper widths. Those of a polyhedron are searched for; they are the template's times the
    /// scale.
    #[must_use]
    pub fn calipers(&self) -> CaliperSizes {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.into(),
            Self::Polyhedron(polyhedron) => {
                CaliperSizes::from(polyhedron.template).scaled(polyhedron.scale_mm)
            }
        }
    }
}

impl From<Ellipsoid> for SolidRef<'_> {
    fn from(ellipsoid: Ellipsoid) -> Self {
        Self::Ellipsoid(ellipsoid)
    }
}

impl<'a> From<ScaledPolyhedron<'a>> for SolidRef<'a> {
    fn from(polyhedron: ScaledPolyhedron<'a>) -> Self {
        Self::Polyhedron(polyhedron)
    }
}
