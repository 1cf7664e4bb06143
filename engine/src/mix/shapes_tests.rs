#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::PackError;
use crate::mix::sampling::{ShapedGrains, sample, sample_shaped};
use crate::mix::sieve::class_of;
use crate::mix::{GradedMix, sphere_volume};
use crate::request::PackingRequest;
use crate::rng::{Stream, stream};
use crate::shape::{CaliperSizes, Ellipsoid, Zingg, flakiness_index, shape_index};

fn request(edge_mm: f64, mix: Value) -> PackingRequest {
    let value = json!({"specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm]}, "mix": mix});
    PackingRequest::from_json(&value, 1).unwrap()
}

fn drawn(request: &PackingRequest, seed: u64) -> (GradedMix, ShapedGrains) {
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let (mut sizes, mut forms) = (stream(seed, Stream::Sampling), stream(seed, Stream::Shape));
    let grains = sample_shaped(&mix, &mut sizes, &mut forms, &|| false).unwrap();
    (mix, grains)
}

/// The bodies of a mix without polyhedra.
fn bodies(grains: &ShapedGrains) -> Vec<Ellipsoid> {
    grains.grains.shapes.iter().map(|shape| *shape.ellipsoid().unwrap()).collect()
}

fn ellipsoids(ratios: Value) -> Value {
    json!({"type": "ellipsoid", "ratios": ratios})
}

fn a16(fraction: f64, shape: Value) -> Value {
    json!({"grading": {"type": "standard", "name": "A16"}, "volume_fraction": fraction, "shape": shape})
}

/// Volume and number of the grains by sieve class of the size they were drawn with.
fn classes(mix: &GradedMix, grains: &ShapedGrains) -> Vec<(f64, f64)> {
    let mut classes = vec![(0.0, 0.0); mix.sieve_classes.len()];
    for (ellipsoid, size) in bodies(grains).iter().zip(&grains.sizes_mm) {
        let class = &mut classes[class_of(*size, mix.sieve_classes.iter().map(|c| c.high_mm))];
        *class = (class.0 + ellipsoid.volume_mm3(), class.1 + 1.0);
    }
    classes
}

#[test]
fn the_volumes_of_the_classes_are_met_by_the_bodies() {
    for shape in [
        ellipsoids(json!({"type": "constant", "b_over_a": 0.8, "c_over_a": 0.667})),
        ellipsoids(json!({"type": "triangle", "k": 0.2})),
        json!({"type": "mixture", "of": [{"share": 0.5, "shape": {"type": "sphere"}},
            {"share": 0.5, "shape": ellipsoids(json!({"type": "flakiness", "index": 0.3}))}]}),
    ] {
        for size in ["sieve", "equivalent"] {
            let mut fields = a16(0.6, shape.clone());
            fields["size"] = json!(size);
            let request = request(120.0, fields);
            for seed in 0..3 {
                let (mix, grains) = drawn(&request, seed);
                assert_eq!(grains.grains.len(), grains.sizes_mm.len());
                let d = |i: usize| grains.grains.shapes[i].d_mm();
                assert!((1..grains.grains.len()).all(|i| d(i - 1) >= d(i)));
                let total: f64 = bodies(&grains).iter().map(Ellipsoid::volume_mm3).sum();
                let miss = total - mix.volume_fraction_effective * mix.specimen_volume_mm3;
                // A grain of the finest narrow class of the longest form that the laws give.
                assert!(miss > -1e-6 && miss < 10.0 * sphere_volume(2.2), "{shape} {size}: {miss}");
                let found = classes(&mix, &grains);
                let mut excess_of_coarser: f64 = 0.0;
                for (class, (volume, number)) in mix.sieve_classes.iter().zip(&found).rev() {
                    let asked = mix.class_volume_mm3(class);
                    let excess = excess_of_coarser + volume - asked;
                    let largest = 10.0 * sphere_volume(class.low_mm * 1.06);
                    assert!(excess > -1e-6 && excess < largest, "{shape} {size} {}: {excess}", class.low_mm);
                    excess_of_coarser = excess;
                    let expected = asked * class.grains_per_volume();
                    let bound = 4.0 * expected.sqrt() + 0.02 * expected;
                    assert!((number - expected).abs() < bound, "{shape} {size} {}: {number}", class.low_mm);
                }
                for (grain, size_mm) in bodies(&grains).iter().zip(&grains.sizes_mm) {
                    let found =
                        if size == "sieve" { grain.sieve_size_mm() } else { grain.equivalent_diameter_mm() };
                    assert!((found / size_mm - 1.0).abs() < 1e-14);
                    assert!((mix.d_min_mm..=mix.d_max_mm).contains(size_mm));
                }
            }
        }
    }
}

#[test]
fn spheres_by_sieve_size_are_the_spheres_of_the_same_seed() {
    let as_law = ellipsoids(json!({"type": "constant", "elongation": 1, "flatness": 1}));
    let (_, grains) = drawn(&request(60.0, a16(0.5, as_law)), 7);
    let spheres = request(60.0, a16(0.5, Value::Null));
    let mix = GradedMix::new(&spheres.mix, spheres.specimen.volume_mm3());
    assert_eq!(mix.shapes, None);
    let diameters = sample(&mix, &mut stream(7, Stream::Sampling), &|| false).unwrap().d_mm;
    assert_eq!(grains.sizes_mm, diameters);
    for (grain, d) in bodies(&grains).iter().zip(&diameters) {
        assert_eq!(grain.equivalent_diameter_mm(), *d);
    }
    assert_eq!(drawn(&spheres, 7).1, grains);
}

#[test]
fn a_mixture_has_its_shares_of_the_volume() {
    let part = |share: f64, axes: [f64; 3]| json!({"share": share, "shape": ellipsoids(json!({"type": "measured", "axes": [axes]}))});
    let shape = json!({"type": "mixture", "of": [
        part(0.2, [1.0, 0.9, 0.4]), part(0.5, [1.0, 0.5, 0.45]), part(0.3, [1.0, 0.9, 0.85])]});
    let (_, grains) = drawn(&request(150.0, a16(0.6, shape)), 1);
    let volume = |class: Zingg| -> f64 {
        bodies(&grains).iter().filter(|grain| grain.zingg() == class).map(Ellipsoid::volume_mm3).sum()
    };
    let total = volume(Zingg::Disc) + volume(Zingg::Rod) + volume(Zingg::Equant);
    for (class, share) in [(Zingg::Disc, 0.2), (Zingg::Rod, 0.5), (Zingg::Equant, 0.3)] {
        let found = volume(class) / total;
        assert!((found - share).abs() < 0.02, "{class:?}: {found}");
    }
}

#[test]
fn shapes_hold_above_their_size() {
    let flat = ellipsoids(json!({"type": "constant", "elongation": 0.9, "flatness": 0.3}));
    let mut mix = a16(0.5, Value::Null);
    mix["shapes"] = json!([{"above_mm": 0, "shape": {"type": "sphere"}}, {"above_mm": 5, "shape": flat}]);
    let (_, grains) = drawn(&request(100.0, mix), 1);
    for (grain, size) in bodies(&grains).iter().zip(&grains.sizes_mm) {
        assert_eq!(grain.zingg(), if *size > 5.0 { Zingg::Disc } else { Zingg::Equant }, "{size}");
    }
}

#[test]
fn a_grading_has_the_indices_asked_for() {
    let fuller = json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5});
    for grading in [json!({"type": "standard", "name": "A16"}), fuller] {
        for (law, index) in [("flakiness", 0.15), ("flakiness", 0.4), ("shape_index", 0.2)] {
            let shape = ellipsoids(json!({"type": law, "index": index}));
            let mix = json!({"grading": grading, "d_min_mm": 4, "volume_fraction": 0.6, "shape": shape});
            let (_, grains) = drawn(&request(300.0, mix), 1);
            assert!(grains.grains.len() > 30_000);
            let of = |grains: &[Ellipsoid]| {
                let sizes = grains.iter().map(CaliperSizes::from);
                if law == "flakiness" { flakiness_index(sizes) } else { shape_index(sizes) }
            };
            let found = of(&bodies(&grains)).unwrap();
            assert!((found - index).abs() < 0.01, "{grading} {law} {index}: {found}");
        }
    }
}

#[test]
fn an_explicit_list_has_a_grain_of_every_size() {
    let mix = json!({"grading": {"type": "diameters", "diameters_mm": [3, 12, 5, 8]},
        "shape": ellipsoids(json!({"type": "triangle", "k": 0.5}))});
    let (mix, grains) = drawn(&request(60.0, mix), 1);
    let mut sizes = grains.sizes_mm.clone();
    sizes.sort_by(f64::total_cmp);
    assert_eq!(sizes, [3.0, 5.0, 8.0, 12.0]);
    assert_eq!(mix.expected_grains(), 4.0);
    let ratio = mix.volume_fraction_effective * mix.specimen_volume_mm3
        / sizes.iter().map(|&d| sphere_volume(d)).sum::<f64>();
    assert!((ratio / mix.shapes.unwrap().mean_volume_ratio(0, 5.0) - 1.0).abs() < 1e-12);
}

#[test]
fn spheres_are_never_drawn_in_place_of_other_shapes() {
    let shaped = request(60.0, a16(0.3, ellipsoids(json!({"type": "triangle", "k": 0.5}))));
    let mix = GradedMix::new(&shaped.mix, shaped.specimen.volume_mm3());
    let sampled = sample(&mix, &mut stream(1, Stream::Sampling), &|| false);
    assert!(matches!(sampled, Err(PackError::Plan(_))));
}

#[test]
fn the_largest_mixtures_of_laws_are_resolved_soon() {
    let law = ellipsoids(
        json!({"type": "flakiness", "index": 0.2, "elongation": {"type": "beta", "mean": 0.7, "standard_deviation": 0.1}}),
    );
    let parts: Vec<Value> = (0..16).map(|_| json!({"share": 0.0625, "shape": law})).collect();
    let shapes: Vec<Value> =
        (0..16).map(|i| json!({"above_mm": i, "shape": {"type": "mixture", "of": parts}})).collect();
    let mut mix = a16(0.5, Value::Null);
    mix["shapes"] = json!(shapes);
    let request = request(60.0, mix);
    let graded = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    assert!(graded.expected_grains() > 100.0);
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_total_misses_by_less_than_one_grain(
        k in 0.1..1.0_f64, exponent in 0.05..1.0_f64, ratio in 1.2..8.0_f64, fraction in 0.05..0.6_f64,
        above in 1.0..20.0_f64, seed in 0_u64..1000,
    ) {
        let shape = ellipsoids(json!({"type": "triangle", "k": k}));
        let mix = json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": exponent}, "d_min_mm": 16.0 / ratio,
            "volume_fraction": fraction, "volume_fraction_of": "placed_grains",
            "shapes": [{"above_mm": above, "shape": shape}, {"above_mm": 0, "shape": {"type": "sphere"}}]});
        let request = request(60.0, mix);
        let (mix, grains) = drawn(&request, seed);
        let total: f64 = bodies(&grains).iter().map(Ellipsoid::volume_mm3).sum();
        let largest = bodies(&grains).iter().map(Ellipsoid::volume_mm3).fold(0.0, f64::max);
        let miss = total - fraction * request.specimen.volume_mm3();
        prop_assert!(miss > -1e-6 && miss < largest, "{}", miss);
        let expected = mix.expected_grains();
        let found = grains.sizes_mm.len() as f64;
        prop_assert!((found - expected).abs() < 5.0 * expected.sqrt() + 0.05 * expected + 3.0, "{} {}", found, expected);
    }
}
