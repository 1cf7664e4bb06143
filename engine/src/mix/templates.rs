//! Draws the templates of angular grains and measures them.
//!
//! Templates come from a seed of their own, so that all jobs of a study share them. They are turned to their principal
//! axes and have an equivalent diameter of 1. Drawing and measuring takes milliseconds, and a mix is resolved several
//! times on the way from a plan to a report: the last sets are kept.

use std::sync::{Arc, Mutex, PoisonError};

use crate::request::{PlainShape, TemplateShape};
use crate::rng::{Stream, stream};
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{AxisRatios, Polyhedron, RatioSampler, SizeMeasure};

/// Sets of templates that are kept.
const KEPT: usize = 32;

/// Templates with their sizes.
#[derive(Debug, PartialEq)]
pub(super) struct Templates {
    /// Polyhedra with an equivalent diameter of 1.
    pub(super) bodies: Vec<Polyhedron>,
    /// Equivalent diameter over size, of each: `d_eq / D_s` where sizes are sieve sizes.
    pub(super) equivalent_over_size: Vec<f64>,
}

/// What templates are drawn by.
#[derive(Clone, Debug, PartialEq)]
struct Recipe {
    kind: TemplateKind,
    ratios: AxisRatios,
    rounding: f64,
    count: u32,
    seed: u64,
    measure: SizeMeasure,
}

static DRAWN: Mutex<Vec<(Recipe, Arc<Templates>)>> = Mutex::new(Vec::new());

impl Templates {
    /// The templates of a shape; `None` unless it is a polyhedron.
    pub(super) fn of_shape(shape: &PlainShape, measure: SizeMeasure) -> Option<Arc<Self>> {
        let PlainShape::Polyhedron {
            template,
            faces,
            displacement,
            ratios,
            rounding,
            template_count: count,
            template_seed: seed,
        } = shape
        else {
            return None;
        };
        // Reading a request leaves no field out that the template has.
        let kind = match template {
            TemplateShape::Cuts => TemplateKind::Cuts(faces.unwrap_or_default()),
            TemplateShape::DeformedCuboid => TemplateKind::Cuboid(displacement.unwrap_or_default()),
            TemplateShape::Voronoi => TemplateKind::Voronoi,
        };
        let (rounding, count, seed) = (*rounding, *count, *seed);
        let recipe = Recipe { kind, ratios: ratios.clone(), rounding, count, seed, measure };
        let drawn = || DRAWN.lock().unwrap_or_else(PoisonError::into_inner);
        let known =
            drawn().iter().find(|(known, _)| *known == recipe).map(|(_, templates)| templates.clone());
        Some(known.unwrap_or_else(|| {
            let templates = Arc::new(Self::draw(&recipe));
            let mut drawn = drawn();
            if drawn.len() >= KEPT {
                drawn.remove(0);
            }
            drawn.push((recipe, templates.clone()));
            templates
        }))
    }

    fn draw(recipe: &Recipe) -> Self {
        let mut rng = stream(recipe.seed, Stream::Shape);
        // Laws with a target index, which look at the grading, are refused for polyhedra.
        let ratios = RatioSampler::of_valid(&recipe.ratios, recipe.measure, &|_| 0.0);
        let bodies: Vec<Polyhedron> = (0..recipe.count)
            .filter_map(|_| {
                let form = ratios.draw(&mut rng);
                // A kind whose draws fail, which none was seen to do, becomes a cube of the same form.
                let body = draw_template(recipe.kind, form, &mut rng)
                    .or_else(|| draw_template(TemplateKind::Cuboid(0.0), form, &mut rng))?;
                let body = body.on_principal_axes().normalized();
                Some(body.with_relative_rounding(recipe.rounding)?.normalized())
            })
            .collect();
        let ratio = |body: &Polyhedron| match recipe.measure {
            SizeMeasure::Sieve => body.equivalent_diameter() / body.sieve_size(),
            SizeMeasure::Equivalent => 1.0,
        };
        Self { equivalent_over_size: bodies.iter().map(ratio).collect(), bodies }
    }

    pub(super) fn len(&self) -> usize {
        self.bodies.len()
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
