//! The grains of a packing that are no spheres, as the analysis reads them: each a [`Solid`] with its pose.

use crate::packing::GrainsRef;
use crate::shape::{CaliperSizes, Ellipsoid, Form, Polyhedron, Pose, ScaledPolyhedron};

/// The shape of a grain.
#[derive(Clone, Copy, Debug)]
pub(super) enum Solid<'a> {
    Ellipsoid(&'a Ellipsoid),
    /// With the index of its template.
    Polyhedron(ScaledPolyhedron<'a>, usize),
}

impl Solid<'_> {
    /// Radius of a sphere about the centre within the grain.
    pub(super) fn inner_radius_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(shape) => shape.semi_axes_mm().z,
            Self::Polyhedron(shape, _) => shape.scale_mm * shape.template.inner_radius(),
        }
    }

    /// Diameter of the sphere of equal volume.
    pub(super) fn equivalent_diameter_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(shape) => shape.equivalent_diameter_mm(),
            Self::Polyhedron(shape, _) => shape.equivalent_diameter_mm(),
        }
    }
}

/// The grains with their poses; `None` where all are spheres.
pub(super) fn solids(grains: GrainsRef<'_>) -> Option<Vec<(Solid<'_>, &Pose)>> {
    match grains {
        GrainsRef::Spheres(_) => None,
        GrainsRef::Ellipsoids(grains) => {
            Some(grains.iter().map(|(shape, pose)| (Solid::Ellipsoid(shape), pose)).collect())
        }
        GrainsRef::Polyhedra(grains) => Some(
            (0..grains.len())
                .map(|grain| {
                    let template = grains.template[grain] as usize;
                    (Solid::Polyhedron(grains.shape(grain), template), &grains.poses[grain])
                })
                .collect(),
        ),
    }
}

/// The templates that the grains refer to.
pub(super) fn templates(grains: GrainsRef<'_>) -> &[Polyhedron] {
    match grains {
        GrainsRef::Polyhedra(grains) => &grains.templates,
        GrainsRef::Spheres(_) | GrainsRef::Ellipsoids(_) => &[],
    }
}

/// The form of a grain and its sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredGrain {
    /// Elongation and flatness; of a polyhedron those of the ellipsoid of equal inertia ([`Polyhedron::form`]).
    pub form: Form,
    /// Volume, sieve size, length and thickness.
    pub sizes: CaliperSizes,
}

/// The forms and sizes of all grains, in their order; `None` where all are spheres. Templates are measured once.
#[must_use]
pub fn measured_grains<'a>(grains: impl Into<GrainsRef<'a>>) -> Option<Vec<MeasuredGrain>> {
    let grains = grains.into();
    let mut of_templates: Vec<Option<MeasuredGrain>> = vec![None; templates(grains).len()];
    let measured = |(solid, _): (Solid<'_>, &Pose)| match solid {
        Solid::Ellipsoid(shape) => MeasuredGrain { form: shape.form(), sizes: shape.into() },
        Solid::Polyhedron(shape, template) => {
            let of_template = of_templates[template].get_or_insert_with(|| measured_template(shape.template));
            MeasuredGrain { form: of_template.form, sizes: of_template.sizes.scaled(shape.scale_mm) }
        }
    };
    Some(solids(grains)?.into_iter().map(measured).collect())
}

fn measured_template(body: &Polyhedron) -> MeasuredGrain {
    let sizes = CaliperSizes {
        volume_mm3: body.volume(),
        sieve_mm: body.sieve_size(),
        length_mm: body.length(),
        thickness_mm: body.thickness(),
    };
    MeasuredGrain { form: body.form(), sizes }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "solids_tests.rs"]
mod tests;
