//! Draws the templates of angular grains and measures them.
//!
//! Templates come from a seed of their own, so that all jobs of a study share them. They are turned to their principal
//! axes and have an equivalent diameter of 1. Drawing and measuring takes milliseconds, and a mix is resolved several
//! times on the way from a plan to a report: the request keeps them.

use crate::request::{PlainShape, TemplateShape};
use crate::rng::{Stream, stream};
use crate::shape::polyhedron::{DrawnTemplates, PlatonicSolid, TemplateKind, draw_template};
use crate::shape::{AxisRatios, Polyhedron, RatioSampler, SizeMeasure};

/// Templates with their sizes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Templates {
    drawn: DrawnTemplates,
    /// Equivalent diameter over size, of each: `d_eq / D_s` where sizes are sieve sizes.
    pub(super) equivalent_over_size: Vec<f64>,
}

impl Templates {
    /// The templates of a shape; `None` unless it is a polyhedron.
    pub(super) fn of_shape(shape: &PlainShape, measure: SizeMeasure) -> Option<Self> {
        let PlainShape::Polyhedron {
            template,
            faces,
            displacement,
            ratios,
            rounding,
            template_count,
            template_seed,
            drawn,
        } = shape
        else {
            return None;
        };
        // Reading a request leaves no field out that the template has.
        let kind = match template {
            TemplateShape::Cuts => TemplateKind::Cuts(faces.unwrap_or_default()),
            TemplateShape::DeformedCuboid => TemplateKind::Cuboid(displacement.unwrap_or_default()),
            TemplateShape::Voronoi => TemplateKind::Voronoi,
            TemplateShape::Tetrahedron => TemplateKind::Platonic(PlatonicSolid::Tetrahedron),
            TemplateShape::Cube => TemplateKind::Platonic(PlatonicSolid::Cube),
            TemplateShape::Octahedron => TemplateKind::Platonic(PlatonicSolid::Octahedron),
            TemplateShape::Dodecahedron => TemplateKind::Platonic(PlatonicSolid::Dodecahedron),
            TemplateShape::Icosahedron => TemplateKind::Platonic(PlatonicSolid::Icosahedron),
        };
        let bodies = drawn.get_or_draw(|| draw(kind, ratios, *rounding, *template_count, *template_seed));
        let ratio = |body: &Polyhedron| match measure {
            SizeMeasure::Sieve => body.equivalent_diameter() / body.sieve_size(),
            SizeMeasure::Equivalent => 1.0,
        };
        let equivalent_over_size = bodies.iter().map(ratio).collect();
        Some(Self { drawn: drawn.clone(), equivalent_over_size })
    }

    /// Polyhedra with an equivalent diameter of 1.
    pub(super) fn bodies(&self) -> &[Polyhedron] {
        self.drawn.bodies()
    }

    pub(super) fn len(&self) -> usize {
        self.equivalent_over_size.len()
    }

    /// Mean of the volume of a grain over that of a sphere of its size: `E[(d_eq / D_s)³]`.
    pub(super) fn mean_volume_ratio(&self) -> f64 {
        self.equivalent_over_size.iter().map(|ratio| ratio.powi(3)).sum::<f64>() / self.len() as f64
    }

    /// The least value of the same ratio.
    pub(super) fn least_volume_ratio(&self) -> f64 {
        self.equivalent_over_size.iter().map(|ratio| ratio.powi(3)).fold(f64::INFINITY, f64::min)
    }
}

fn draw(kind: TemplateKind, ratios: &AxisRatios, rounding: f64, count: u32, seed: u64) -> Vec<Polyhedron> {
    let mut rng = stream(seed, Stream::Shape);
    // Laws with a target index, which look at the grading and at what sizes are, are refused for polyhedra.
    let ratios = RatioSampler::of_valid(ratios, SizeMeasure::Equivalent, &|_| 0.0);
    let templates = (0..count).filter_map(|_| {
        let form = ratios.draw(&mut rng);
        // A kind whose draws fail, which none was seen to do, becomes a cube of the same form.
        let body = draw_template(kind, form, &mut rng)
            .or_else(|| draw_template(TemplateKind::Cuboid(0.0), form, &mut rng))?;
        let body = body.on_principal_axes().normalized();
        Some(body.with_relative_rounding(rounding)?.normalized())
    });
    templates.collect()
}
