//! The forms and sizes of the grains of a packing that are no spheres.

use crate::packing::GrainsRef;
use crate::shape::{CaliperSizes, Form, Polyhedron, Solid, SolidRef};

/// Radius of a sphere about the centre within the grain.
pub(super) fn inner_radius_mm(shape: &SolidRef<'_>) -> f64 {
    match shape {
        SolidRef::Ellipsoid(shape) => shape.semi_axes_mm().z,
        SolidRef::Polyhedron(shape) => shape.scale_mm * shape.template.inner_radius(),
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
    let GrainsRef::Solids(grains) = grains.into() else { return None };
    let mut of_templates: Vec<Option<MeasuredGrain>> = vec![None; grains.templates.len()];
    let measured = |shape: &Solid| match *shape {
        Solid::Ellipsoid(ref shape) => MeasuredGrain { form: shape.form(), sizes: shape.into() },
        Solid::Polyhedron { template, d_mm } => {
            let template = template as usize;
            let of_template =
                of_templates[template].get_or_insert_with(|| measured_template(&grains.templates[template]));
            MeasuredGrain { form: of_template.form, sizes: of_template.sizes.scaled(d_mm) }
        }
    };
    Some(grains.shapes.iter().map(measured).collect())
}

fn measured_template(body: &Polyhedron) -> MeasuredGrain {
    MeasuredGrain { form: body.form(), sizes: body.into() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "solids_tests.rs"]
mod tests;
