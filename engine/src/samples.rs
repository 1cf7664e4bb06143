//! A few grains of a shape, to look at before anything is packed.
//!
//! Grains are drawn as a packing draws them: polyhedra are the first templates of the shape, ellipsoids follow its law
//! of ratios. Each has the volume of a sphere of diameter 1, lies about the origin in an orientation drawn uniformly,
//! and is given by polygons. The same shape gives the same grains.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Value, json};

use crate::analysis::shapes::Measured;
use crate::export::tables::surface_of;
use crate::mix::{GradedMix, uniform_orientation};
use crate::packing::Solids;
use crate::request::decode::FieldError;
use crate::request::{GrainShape, PackingRequest, PlainShape};
use crate::rng::{self, Stream};
use crate::shape::{Ellipsoid, Pose, Solid};
use crate::template_cache::TemplateCache;

/// How many grains are drawn.
pub const SAMPLES: usize = 8;
/// Draws of a polyhedron until its template is one that no other grain has.
const TRIES: usize = 64;
/// Diameter that the grains are drawn with, in mm. What they are scaled to does not depend on it.
const SIZE_MM: f64 = 8.0;
/// Coordinates are multiples of the inverse: a picture needs no more.
const STEPS: f64 = 1.0e4;

/// The shape of grains that are to be looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SampleRequest {
    /// The shape, as that of a mix; spheres when absent.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = Option<crate::request::schema::GrainShapeInput>)
    )]
    pub shape: Option<GrainShape>,
}

/// Grains of a shape.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShapeSamples {
    /// Eight grains.
    pub grains: Vec<SampleGrain>,
}

/// A grain with the volume of a sphere of diameter 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SampleGrain {
    /// Points of its surface, about its centre.
    pub vertices: Vec<[f64; 3]>,
    /// Polygons of its surface by their vertices, counted from 0, counter-clockwise as seen from outside.
    pub faces: Vec<Vec<u32>>,
    /// Ratio of the intermediate to the long axis.
    pub elongation: f64,
    /// Ratio of the short to the intermediate axis.
    pub flatness: f64,
    /// Surface of the sphere of equal volume over that of the grain.
    pub sphericity: f64,
}

impl ShapeSamples {
    /// Draws grains of the shape that is the member `shape` of an object. Templates that are drawn are kept in the
    /// cache.
    ///
    /// ```
    /// use packstone_engine::TemplateCache;
    /// use packstone_engine::samples::ShapeSamples;
    /// use serde_json::json;
    ///
    /// let shape = json!({"shape": {"type": "polyhedron", "faces": 12, "rounding": 0.1}});
    /// let samples = ShapeSamples::of_json(&shape, &TemplateCache::default());
    /// assert_eq!(samples.map(|samples| samples.grains.len()), Ok(8));
    /// ```
    ///
    /// # Errors
    /// All faults of the object, each with its pointer.
    pub fn of_json(value: &Value, cache: &TemplateCache) -> Result<Self, Vec<FieldError>> {
        let Some(members) = value.as_object() else {
            return Err(vec![FieldError::new("", "must be an object with the member shape")]);
        };
        let other = members.keys().filter(|name| *name != "shape");
        let unknown: Vec<FieldError> = other
            .map(|name| FieldError::new(format!("/{name}"), "is unknown: must be shape alone"))
            .collect();
        if !unknown.is_empty() {
            return Err(unknown);
        }
        // A request about nothing but the shape.
        let mut mix = json!({
            "grading": {"type": "monodisperse", "diameter_mm": SIZE_MM}, "count": SAMPLES, "allow_coarse": true,
        });
        if let Some(shape) = members.get("shape") {
            mix["shape"] = shape.clone();
        }
        let request = json!({"specimen": {"type": "box", "size_mm": [100, 100, 100]}, "mix": mix});
        let mut request = PackingRequest::from_json(&request, 0).map_err(|faults| {
            let shown = |fault: FieldError| {
                FieldError::new(fault.pointer.strip_prefix("/mix").unwrap_or_default(), fault.detail)
            };
            faults.into_iter().map(shown).collect::<Vec<_>>()
        })?;
        if let Some(GrainShape::Plain(PlainShape::Polyhedron { template_count, .. })) = &mut request.mix.shape
        {
            *template_count = (*template_count).min(SAMPLES as u32);
        }
        Ok(Self::of_request(&cache.attached(&request)))
    }

    fn of_request(request: &PackingRequest) -> Self {
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        let mut rng = rng::stream(0, Stream::Shape);
        let mut used = BTreeSet::new();
        let (mut shapes, mut poses) = (Vec::new(), Vec::new());
        for _ in 0..SAMPLES {
            let drawn = match &mix.shapes {
                Some(sampler) => {
                    let is_new =
                        |solid: &Solid| solid.template().is_none_or(|template| !used.contains(&template));
                    let mut draws = (0..TRIES).map(|_| sampler.draw(0, SIZE_MM, &mut rng));
                    draws.find(is_new).or_else(|| Some(sampler.draw(0, SIZE_MM, &mut rng)))
                }
                None => Ellipsoid::new([SIZE_MM / 2.0; 3]).map(Solid::from),
            };
            let Some(solid) = drawn else { continue };
            used.extend(solid.template());
            shapes.push(solid);
            poses.push(Pose { center_mm: Vector3::zeros(), orientation: uniform_orientation(&mut rng) });
        }
        let templates = mix.shapes.iter().flat_map(|sampler| sampler.templates().cloned()).collect();
        let solids = Solids { templates, shapes, poses, aggregate: Vec::new() };
        let measured = Measured::new((&solids).into());
        let grain = |number: usize| {
            let (solid, pose) = (solids.shapes.get(number)?, solids.poses.get(number)?);
            let surface = surface_of(solid, &solids.templates, pose)?;
            let figures = measured.of(number);
            let in_steps = |x: f64| (x / solid.d_mm() * STEPS).round() / STEPS;
            Some(SampleGrain {
                vertices: surface.points.into_iter().map(|point| point.map(in_steps)).collect(),
                faces: surface.polygons,
                elongation: figures.form.elongation,
                flatness: figures.form.flatness,
                sphericity: figures.sphericity,
            })
        };
        Self { grains: (0..solids.shapes.len()).filter_map(grain).collect() }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn samples(shape: &Value) -> Vec<SampleGrain> {
        ShapeSamples::of_json(&json!({"shape": shape}), &TemplateCache::default()).unwrap().grains
    }

    /// Volume inside the polygons of a grain.
    fn volume(grain: &SampleGrain) -> f64 {
        let at = |p: u32| Vector3::from(grain.vertices[p as usize]);
        let fan = |face: &Vec<u32>| {
            let pairs = face[1..].windows(2);
            pairs.map(|pair| at(face[0]).dot(&at(pair[0]).cross(&at(pair[1])))).sum::<f64>() / 6.0
        };
        grain.faces.iter().map(fan).sum()
    }

    #[test]
    fn eight_grains_of_each_shape_have_the_volume_of_a_sphere_of_diameter_1() {
        for shape in [
            json!({"type": "sphere"}),
            json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.7, "flatness": 0.5}}),
            json!({"type": "polyhedron", "faces": 12}),
            json!({"type": "polyhedron", "template": "cube", "rounding": 0.1}),
            json!({"type": "preset", "name": "fi35"}),
            json!({"type": "mixture", "of": [
                {"share": 0.5, "shape": {"type": "sphere"}},
                {"share": 0.5, "shape": {"type": "polyhedron", "template_count": 2}},
            ]}),
        ] {
            let grains = samples(&shape);
            assert_eq!(grains.len(), SAMPLES, "{shape}");
            for grain in &grains {
                let ratio = volume(grain) / (std::f64::consts::PI / 6.0);
                assert!((ratio - 1.0).abs() < 0.002, "{shape}: {ratio}");
                assert!(grain.sphericity <= 1.0 + 1e-9 && grain.elongation <= 1.0 + 1e-9, "{grain:?}");
            }
            assert_eq!(grains, samples(&shape), "the same again");
        }
    }

    #[test]
    fn templates_are_those_of_the_first_eight_and_each_is_shown_once() {
        let grains = samples(&json!({"type": "polyhedron", "faces": 20}));
        let spheres: BTreeSet<u64> = grains.iter().map(|grain| grain.sphericity.to_bits()).collect();
        assert_eq!(spheres.len(), SAMPLES);
    }

    #[test]
    fn faults_name_the_member() {
        let faults = |value: Value| ShapeSamples::of_json(&value, &TemplateCache::default()).unwrap_err();
        assert_eq!(faults(json!({"shape": {"type": "polyhedron", "faces": 5}}))[0].pointer, "/shape/faces");
        assert_eq!(faults(json!({"shape": {"type": "stone"}}))[0].pointer, "/shape/type");
        assert_eq!(faults(json!({"form": 1}))[0].pointer, "/form");
        assert_eq!(faults(json!([]))[0].pointer, "");
    }
}
