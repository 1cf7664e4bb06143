//! Grains as the lattice sees them: how far they reach along a line, and how far points and walls are from them.

use nalgebra::{Matrix3, Vector3};

use crate::arrays::Each as _;
use crate::export::{ExportError, Model};
use crate::gap::linear::Symmetric;
use crate::gap::solids::Body;
use crate::gap::{ellipsoids, polyhedra};
use crate::geometry::convex::{Convex, Place};
use crate::memory::{OutOfMemory, collected};
use crate::packing::{GrainsRef, Solids, Spheres};
use crate::request::Specimen;
use crate::shape::Solid;

/// The grains of a packing.
pub(super) enum Grains<'a> {
    Spheres(&'a Spheres),
    Solids { grains: &'a Solids, bodies: Vec<Placed<'a>>, templates: Vec<Convex> },
}

/// A grain with what its reach is computed from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Placed<'a> {
    Ellipsoid(ellipsoids::Body, Matrix3<f64>),
    Polyhedron(polyhedra::Body<'a>, u32, Place),
}

/// What the reach of grains along a line is computed from.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Reach {
    /// The radius, along every line.
    #[default]
    Radius,
    /// Templates, and what each grain is.
    Solids { templates: Vec<Convex>, grains: Vec<ReachOf> },
}

/// What the reach of a grain along a line is computed from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ReachOf {
    /// The inverse shape matrix `M` in 1/mm²: half of the chord along the unit vector `u` is `1 / sqrt(u · M u)`.
    Ellipsoid(Matrix3<f64>),
    /// Number of the template, and place.
    Polyhedron(u32, Place),
}

impl<'a> Placed<'a> {
    fn new(grains: &'a Solids, grain: usize) -> Self {
        let pose = &grains.poses[grain];
        match grains.shapes[grain] {
            Solid::Ellipsoid(shape) => {
                let rotation = pose.rotation();
                let inverse_squares = shape.semi_axes_mm().map(|axis| 1.0 / (axis * axis));
                let inverse = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
                Self::Ellipsoid(ellipsoids::Body::new(&shape, pose), inverse)
            }
            Solid::Polyhedron { template, d_mm } => {
                let body = polyhedra::Body::new(&grains.templates[template as usize], d_mm, pose);
                Self::Polyhedron(body, template, Place::new(d_mm, pose))
            }
        }
    }

    fn body(&self) -> Body<'a> {
        match *self {
            Self::Ellipsoid(body, _) => Body::Ellipsoid(body),
            Self::Polyhedron(body, ..) => Body::Polyhedron(body),
        }
    }

    fn outer_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(body, _) => body.outer_mm,
            Self::Polyhedron(body, ..) => body.outer_mm,
        }
    }

    fn reach(&self) -> ReachOf {
        match *self {
            Self::Ellipsoid(_, inverse) => ReachOf::Ellipsoid(inverse),
            Self::Polyhedron(_, template, place) => ReachOf::Polyhedron(template, place),
        }
    }
}

impl<'a> Grains<'a> {
    pub(super) fn new(model: &Model<'a>) -> Result<Self, ExportError> {
        let grains = match model.grains {
            GrainsRef::Spheres(spheres) => return Ok(Self::Spheres(spheres)),
            GrainsRef::Solids(solids) => solids,
        };
        let bodies = collected((0..grains.len()).map(|grain| Placed::new(grains, grain)))?;
        Ok(Self::Solids { grains, bodies, templates: Convex::all(&grains.templates) })
    }

    fn grains(&self) -> GrainsRef<'a> {
        match *self {
            Self::Spheres(spheres) => GrainsRef::Spheres(spheres),
            Self::Solids { grains, .. } => GrainsRef::Solids(grains),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.grains().len()
    }

    pub(super) fn center(&self, grain: usize) -> [f64; 3] {
        self.grains().center_mm(grain)
    }

    /// Equivalent diameter.
    pub(super) fn d_mm(&self, grain: usize) -> f64 {
        self.grains().d_mm(grain)
    }

    /// Smallest equivalent diameter.
    pub(super) fn d_min_mm(&self) -> f64 {
        (0..self.len()).map(|grain| self.d_mm(grain)).fold(f64::INFINITY, f64::min)
    }

    /// Radius of the smallest sphere around the centre that holds the grain.
    pub(super) fn outer_mm(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain] / 2.0,
            Self::Solids { bodies, .. } => bodies[grain].outer_mm(),
        }
    }

    /// Distance of a point from the surface of a grain; inside, minus a distance that the surface is at least away.
    pub(super) fn beyond_mm(&self, grain: usize, p: [f64; 3]) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let from_center = Vector3::from(p) - Vector3::from(spheres.center(grain));
                from_center.norm() - spheres.d_mm[grain] / 2.0
            }
            Self::Solids { bodies, templates, .. } => match &bodies[grain] {
                Placed::Ellipsoid(body, inverse) => beyond_mm(body, inverse, p),
                Placed::Polyhedron(_, template, place) => {
                    place.scale * templates[*template as usize].distance(&place.local(&p.into()))
                }
            },
        }
    }

    /// Distance of a grain from the walls.
    pub(super) fn wall_gap_mm(&self, grain: usize, specimen: &Specimen) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let clearance = specimen.clearance_reaching_all(spheres.center(grain), [0.0; 3]);
                clearance - spheres.d_mm[grain] / 2.0
            }
            Self::Solids { bodies, .. } => bodies[grain].body().wall_gap_mm(specimen),
        }
    }

    /// Whether two grains overlap by more than a length.
    pub(super) fn overlap(&self, [one, other]: [usize; 2], slack_mm: f64) -> bool {
        match self {
            Self::Spheres(spheres) => {
                let [p, q] = [one, other].each(|grain| Vector3::from(spheres.center(grain)));
                (p - q).norm() < (spheres.d_mm[one] + spheres.d_mm[other]) / 2.0 - slack_mm
            }
            Self::Solids { bodies, .. } => {
                let [one, other] = [one, other].map(|grain| bodies[grain].body());
                !one.is_apart(&other, 0.0) && one.contact(&other).gap_mm < -slack_mm
            }
        }
    }

    /// What the reach along lines is computed from.
    pub(super) fn reach(&self) -> Result<Reach, OutOfMemory> {
        Ok(match self {
            Self::Spheres(_) => Reach::Radius,
            Self::Solids { bodies, templates, .. } => Reach::Solids {
                templates: templates.clone(),
                grains: collected(bodies.iter().map(Placed::reach))?,
            },
        })
    }
}

/// Distance of a point from the surface of an ellipsoid.
fn beyond_mm(body: &ellipsoids::Body, inverse: &Matrix3<f64>, p: [f64; 3]) -> f64 {
    let from_center = Vector3::from(p) - Vector3::from(body.center_mm);
    let scale = from_center.dot(&(inverse * from_center)).sqrt();
    if scale <= 1.0 {
        // The ellipsoid of this scale, widened by the difference of the shortest semi-axes, lies inside.
        return body.inner_mm * (scale - 1.0);
    }
    // A ball about the point whose radius is taken off again.
    let radius = body.inner_mm;
    let square = radius * radius;
    let ball = Symmetric([square, 0.0, 0.0, square, 0.0, square]);
    let at_point = ellipsoids::Body { center_mm: p, matrix_mm2: ball, outer_mm: radius, inner_mm: radius };
    let normal: [f64; 3] = (inverse * from_center).normalize().into();
    body.with(&at_point).gap_from(normal).gap_mm + radius
}

impl Reach {
    /// How far a grain of this radius reaches from its centre along a vector, which must not be zero.
    pub(super) fn along_mm(&self, grain: usize, radius_mm: f64, along: &Vector3<f64>) -> f64 {
        match self {
            Self::Radius => radius_mm,
            Self::Solids { templates, grains } => match &grains[grain] {
                ReachOf::Ellipsoid(inverse) => along.norm() / along.dot(&(inverse * along)).sqrt(),
                ReachOf::Polyhedron(template, place) => {
                    let direction = place.turned_back(along);
                    let chord = templates[*template as usize].chord(&Vector3::zeros(), &direction);
                    chord.map_or(0.0, |[_, leave]| leave * along.norm())
                }
            },
        }
    }
}
