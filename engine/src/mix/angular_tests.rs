#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use crate::properties::properties;
use nalgebra::Vector3;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::PackError;
use crate::mix::sampling::{ShapedGrains, sample, sample_shaped};
use crate::mix::sieve::class_of;
use crate::mix::{GradedMix, sphere_volume};
use crate::request::{GrainKind, PackingRequest};
use crate::rng::{Stream, stream};
use crate::shape::Solid;

fn request(edge_mm: f64, mix: Value) -> PackingRequest {
    let value = json!({"specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm]}, "mix": mix});
    PackingRequest::from_json(&value, 1).unwrap()
}

fn graded(request: &PackingRequest) -> GradedMix {
    GradedMix::new(&request.mix, request.specimen.volume_mm3())
}

fn drawn(request: &PackingRequest, seed: u64) -> (GradedMix, ShapedGrains) {
    let mix = graded(request);
    let (mut sizes, mut forms) = (stream(seed, Stream::Sampling), stream(seed, Stream::Shape));
    let grains = sample_shaped(&mix, &mut sizes, &mut forms, &|| false).unwrap();
    (mix, grains)
}

fn a16(fraction: f64, shape: Value) -> Value {
    json!({"grading": {"type": "standard", "name": "A16"}, "volume_fraction": fraction, "shape": shape})
}

fn diameters(grains: &ShapedGrains) -> Vec<f64> {
    grains.grains.shapes.iter().map(Solid::d_mm).collect()
}

fn templates(grains: &ShapedGrains) -> Vec<u32> {
    grains.grains.shapes.iter().map(|shape| shape.template().unwrap()).collect()
}

fn volume(grains: &ShapedGrains, counts: impl Fn(usize) -> bool) -> f64 {
    let diameters = diameters(grains);
    (0..diameters.len()).filter(|i| counts(*i)).map(|i| sphere_volume(diameters[i])).sum()
}

#[test]
fn the_volumes_of_the_classes_are_met_by_the_bodies() {
    let triangle = json!({"type": "triangle", "k": 0.3});
    for shape in [
        json!({"type": "polyhedron", "template_count": 12}),
        json!({"type": "polyhedron", "template": "deformed_cuboid", "ratios": triangle, "rounding": 0.1}),
        json!({"type": "mixture", "of": [
            {"share": 0.3, "shape": {"type": "polyhedron", "template": "voronoi", "template_count": 5}},
            {"share": 0.7, "shape": {"type": "polyhedron", "faces": 8, "ratios": triangle, "template_count": 7}}]}),
    ] {
        for size in ["sieve", "equivalent"] {
            let mut fields = a16(0.6, shape.clone());
            fields["size"] = json!(size);
            let request = request(100.0, fields);
            for seed in 0..3 {
                let (mix, grains) = drawn(&request, seed);
                let (d_mm, template) = (diameters(&grains), templates(&grains));
                assert_eq!((mix.kind(), grains.grains.kind()), (GrainKind::Polyhedra, GrainKind::Polyhedra));
                assert_eq!((template.len(), grains.sizes_mm.len()), (d_mm.len(), d_mm.len()));
                assert!(d_mm.is_sorted_by(|p, q| p >= q));
                let total: f64 = volume(&grains, |_| true);
                let miss = total - mix.volume_fraction_effective * mix.specimen_volume_mm3;
                assert!(miss > -1e-6 && miss < 10.0 * sphere_volume(2.2), "{shape} {size}: {miss}");
                let of_templates: Vec<f64> = grains
                    .grains
                    .templates
                    .iter()
                    .map(|template| if size == "sieve" { template.sieve_size() } else { 1.0 })
                    .collect();
                for (i, &size_mm) in grains.sizes_mm.iter().enumerate() {
                    assert!((mix.d_min_mm..=mix.d_max_mm).contains(&size_mm));
                    let of_template = of_templates[template[i] as usize];
                    assert!((of_template * d_mm[i] / size_mm - 1.0).abs() < 1e-12);
                }
                let mut classes = vec![(0.0, 0.0); mix.sieve_classes.len()];
                for (d, size_mm) in d_mm.iter().zip(&grains.sizes_mm) {
                    let class = &mut classes[class_of(*size_mm, mix.sieve_classes.iter().map(|c| c.high_mm))];
                    *class = (class.0 + sphere_volume(*d), class.1 + 1.0);
                }
                let mut excess_of_coarser: f64 = 0.0;
                for (class, (volume, number)) in mix.sieve_classes.iter().zip(&classes).rev() {
                    let asked = mix.class_volume_mm3(class);
                    let excess = excess_of_coarser + volume - asked;
                    let largest = 10.0 * sphere_volume(class.low_mm * 1.06);
                    assert!(excess > -1e-6 && excess < largest, "{shape} {size} {}: {excess}", class.low_mm);
                    excess_of_coarser = excess;
                    let expected = asked * class.grains_per_volume();
                    let bound = 4.0 * expected.sqrt() + 0.02 * expected;
                    assert!((number - expected).abs() < bound, "{shape} {size} {}: {number}", class.low_mm);
                }
            }
        }
    }
}

#[test]
fn templates_are_normal_upright_rounded_and_the_same_for_all_seeds_of_a_job() {
    let shape = |seed: u64| {
        json!({"type": "polyhedron", "rounding": 0.05, "template_seed": seed, "template_count": 9,
            "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5}})
    };
    let of_seeds =
        |template_seed: u64, seed: u64| drawn(&request(60.0, a16(0.4, shape(template_seed))), seed).1;
    let (first, second, other) = (of_seeds(0, 1), of_seeds(0, 2), of_seeds(1, 1));
    assert_eq!(first.grains.templates, second.grains.templates);
    assert_eq!(first.grains.templates.len(), 9);
    assert!(templates(&first) != templates(&second) && first.grains.templates != other.grains.templates);
    assert_eq!(first, of_seeds(0, 1));
    for template in &first.grains.templates {
        assert!((template.equivalent_diameter() - 1.0).abs() < 1e-14);
        assert!((template.rounding() - 0.05).abs() < 1e-12);
        let axes = template.principal_axes();
        for i in 0..3 {
            assert!((axes[(i, i)].abs() - 1.0).abs() < 1e-9, "{axes}");
        }
        assert!(template.width(&Vector3::x()) > template.width(&Vector3::z()));
    }
    // Every template is as likely as any other.
    let many = drawn(&request(200.0, a16(0.6, shape(0))), 3).1;
    let many = templates(&many);
    let n = many.len() as f64 / 9.0;
    for template in 0..9 {
        let found = many.iter().filter(|of| **of == template).count() as f64;
        assert!((found - n).abs() < 5.0 * n.sqrt(), "{found} of {n}");
    }
}

#[test]
fn drawn_ratios_are_those_of_the_law() {
    let shape = json!({"type": "polyhedron", "template_count": 128, "faces": 30,
        "ratios": {"type": "independent", "elongation": {"type": "uniform", "min": 0.5, "max": 0.7}, "flatness": 0.6}});
    let mix = graded(&request(60.0, a16(0.4, shape)));
    let shapes = mix.shapes.as_ref().unwrap();
    let (mut elongation, mut flatness, mut n) = (0.0, 0.0, 0.0);
    for template in shapes.templates() {
        let form = template.form();
        elongation += form.elongation;
        flatness += form.flatness;
        n += 1.0;
    }
    assert!(
        (elongation / n - 0.6).abs() < 0.02 && (flatness / n - 0.6).abs() < 0.02,
        "{elongation} {flatness} {n}"
    );
}

#[test]
fn a_mixture_has_its_shares_of_the_volume() {
    let part = |share: f64, faces: u32| {
        json!({"share": share, "shape": {"type": "polyhedron", "faces": faces, "template_count": 4,
        "ratios": {"type": "constant", "elongation": if faces == 10 { 0.3 } else { 1.0 }, "flatness": 1.0}}})
    };
    let shape = json!({"type": "mixture", "of": [part(0.2, 10), part(0.8, 20)]});
    let (_, grains) = drawn(&request(120.0, a16(0.6, shape)), 1);
    let total: f64 = volume(&grains, |_| true);
    let of_grains = templates(&grains);
    let of_first = volume(&grains, |i| of_grains[i] < 4);
    assert!((of_first / total - 0.2).abs() < 0.02, "{}", of_first / total);
}

/// Spheres, ellipsoids and polyhedra have their shares of the volume, and every class its own.
#[test]
fn a_mixture_of_all_kinds_has_its_shares_of_the_volume() {
    let triangle = json!({"type": "triangle", "k": 0.4});
    let shape = json!({"type": "mixture", "of": [
        {"share": 0.2, "shape": {"type": "sphere"}},
        {"share": 0.3, "shape": {"type": "ellipsoid", "ratios": triangle}},
        {"share": 0.5, "shape": {"type": "polyhedron", "template_count": 6}}]});
    let (mix, drawn) = drawn(&request(120.0, a16(0.6, shape)), 1);
    let grains = &drawn.grains;
    assert_eq!((mix.kind(), grains.kind(), grains.templates.len()), (GrainKind::Mixed, GrainKind::Mixed, 6));
    let share = |counts: &dyn Fn(&Solid) -> bool| {
        let volume = |shape: &Solid| sphere_volume(shape.d_mm());
        let all: f64 = grains.shapes.iter().map(volume).sum();
        grains.shapes.iter().filter(|shape| counts(shape)).map(volume).sum::<f64>() / all
    };
    let is_sphere =
        |shape: &Solid| shape.ellipsoid().is_some_and(|of| of.elongation() * of.flatness() == 1.0);
    let polyhedra = share(&|shape| shape.template().is_some());
    assert!((polyhedra - 0.5).abs() < 0.02 && (share(&is_sphere) - 0.2).abs() < 0.02, "{polyhedra}");
    assert!(diameters(&drawn).is_sorted_by(|p, q| p >= q));
    // By size, and a largest grain of which one shape may fit.
    let by_size = json!({"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.3, "shapes": [
        {"above_mm": 4, "shape": {"type": "polyhedron", "template_count": 3}}, {"above_mm": 0, "shape": {"type": "sphere"}}]});
    let (_, drawn) = self::drawn(&request(60.0, by_size), 2);
    for (shape, size_mm) in drawn.grains.shapes.iter().zip(&drawn.sizes_mm) {
        assert_eq!(shape.template().is_some(), *size_mm > 4.0);
        assert!(shape.template().is_some() || (shape.d_mm() - size_mm).abs() < 1e-12 * size_mm);
    }
}

#[test]
fn an_explicit_list_has_a_grain_of_every_size() {
    let mix = json!({"grading": {"type": "diameters", "diameters_mm": [3, 12, 5, 8]},
        "shape": {"type": "polyhedron", "template_count": 3}});
    let (mix, grains) = drawn(&request(60.0, mix), 1);
    let mut sizes = grains.sizes_mm.clone();
    sizes.sort_by(f64::total_cmp);
    assert_eq!(sizes, [3.0, 5.0, 8.0, 12.0]);
    assert_eq!(mix.expected_grains(), 4.0);
}

#[test]
fn other_shapes_are_never_drawn_in_place_of_polyhedra() {
    let angular = graded(&request(60.0, a16(0.3, json!({"type": "polyhedron", "template_count": 2}))));
    let (mut sizes, mut forms) = (stream(1, Stream::Sampling), stream(1, Stream::Shape));
    assert!(matches!(sample(&angular, &mut sizes, &|| false), Err(PackError::Plan(_))));
    let drawn = sample_shaped(&angular, &mut sizes, &mut forms, &|| false).unwrap().grains;
    assert!(drawn.shapes.iter().all(|shape| shape.template().is_some()));
    let stopped = sample_shaped(
        &graded(&request(200.0, a16(0.6, json!({"type": "polyhedron", "template_count": 2})))),
        &mut sizes,
        &mut forms,
        &|| true,
    );
    assert!(matches!(stopped, Err(PackError::Stopped { .. })));
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn the_total_misses_by_less_than_one_grain(
        k in 0.1..1.0_f64, exponent in 0.05..1.0_f64, ratio in 1.2..8.0_f64, fraction in 0.05..0.6_f64,
        above in 1.0..20.0_f64, rounding in 0.0..0.4_f64, seed in 0_u64..1000,
    ) {
        let shape = json!({"type": "polyhedron", "template_count": 2, "rounding": rounding, "template_seed": seed,
            "ratios": {"type": "triangle", "k": k}});
        let fine = json!({"type": "polyhedron", "template": "deformed_cuboid", "template_count": 2});
        let mix = json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": exponent}, "d_min_mm": 16.0 / ratio,
            "volume_fraction": fraction, "volume_fraction_of": "placed_grains",
            "shapes": [{"above_mm": above, "shape": shape}, {"above_mm": 0, "shape": fine}]});
        let request = request(60.0, mix);
        let (mix, grains) = drawn(&request, seed);
        let total: f64 = volume(&grains, |_| true);
        let largest = grains.grains.shapes.first().map(Solid::d_mm).map_or(0.0, sphere_volume);
        let miss = total - fraction * request.specimen.volume_mm3();
        prop_assert!(miss > -1e-6 && miss < largest, "{}", miss);
        let expected = mix.expected_grains();
        let found = grains.sizes_mm.len() as f64;
        prop_assert!((found - expected).abs() < 5.0 * expected.sqrt() + 0.05 * expected + 3.0, "{} {}", found, expected);
    }
}
