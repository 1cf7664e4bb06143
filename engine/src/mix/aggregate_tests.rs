//! Sampling of mixes of several aggregates.

#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use serde_json::{Value, json};

use super::sampling::{sample, sample_shaped};
use super::sieve::sieve_classes;
use super::*;
use crate::packing::Solids;
use crate::request::PackingRequest;
use crate::rng::{Stream, stream};
use crate::shape::{Ellipsoid, Solid};
use crate::{Limits, Unattended, check, pack};

fn request(mix: Value) -> PackingRequest {
    let value = json!({"specimen": {"type": "box", "size_mm": [60, 60, 60]}, "mix": mix});
    PackingRequest::from_json(&value, 3).unwrap()
}

/// Overlapping gradings, one of equal grains, one that is finer than the cut-off.
fn overlapping(of_first: &Value) -> Value {
    let mut first = json!({
        "name": "gravel", "share": 0.5, "density_kg_m3": 2600.0,
        "grading": {"type": "sieves", "points": [[2.0, 0.0], [6.0, 0.4], [12.0, 1.0]]},
    });
    first.as_object_mut().unwrap().extend(of_first.as_object().unwrap().clone());
    json!({
        "d_min_mm": 2.0, "volume_fraction": 0.5,
        "aggregates": [
            first,
            {"name": "chippings", "share": 0.2, "density_kg_m3": 3000.0,
             "grading": {"type": "fuller", "d_max_mm": 8.0, "exponent": 0.5}},
            {"name": "beads", "share": 0.1, "density_kg_m3": 2500.0,
             "grading": {"type": "monodisperse", "diameter_mm": 3.0}},
            {"name": "sand", "share": 0.2, "density_kg_m3": 2650.0,
             "grading": {"type": "sieves", "points": [[0.1, 0.0], [2.0, 1.0]]}},
        ],
    })
}

fn graded(request: &PackingRequest) -> GradedMix {
    GradedMix::new(&request.mix, request.specimen.volume_mm3())
}

#[test]
fn every_aggregate_gets_its_share_of_the_volume() {
    let request = request(overlapping(&json!({})));
    let mix = graded(&request);
    let all_mm3 = 0.5 * 60.0_f64.powi(3);
    let asked = [0.5, 0.2 * (1.0 - (2.0_f64 / 8.0).sqrt()), 0.1, 0.0].map(|share| share * all_mm3);
    assert!((mix.volume_fraction_effective - asked.iter().sum::<f64>() / 60.0_f64.powi(3)).abs() < 1e-12);
    for seed in 0..10 {
        let drawn = sample(&mix, &mut stream(seed, Stream::Sampling), &|| false).unwrap();
        assert!(drawn.d_mm.is_sorted_by(|p, q| p >= q));
        assert_eq!(drawn.parts.len(), drawn.d_mm.len());
        for (part, asked_mm3) in asked.into_iter().enumerate() {
            let own = drawn.d_mm.iter().zip(&drawn.parts).filter(|row| usize::from(*row.1) == part);
            let volume_mm3: f64 = own.clone().map(|row| sphere_volume(*row.0)).sum();
            // The overshoot is less than one of its finest class.
            let largest = own.map(|row| sphere_volume(*row.0)).reduce(f64::min).unwrap_or(0.0);
            assert!(
                (0.0..=1.5 * largest).contains(&(volume_mm3 - asked_mm3)),
                "{part}: {volume_mm3} {asked_mm3}"
            );
        }
    }
}

#[test]
fn reports_divide_the_sizes_at_the_sieves_of_all_aggregates() {
    let request = request(overlapping(&json!({})));
    let mix = graded(&request);
    let classes = sieve_classes(&mix);
    let edges: Vec<[f64; 2]> = classes.iter().map(|class| [class.low_mm, class.high_mm]).collect();
    assert_eq!(edges, [[2.0, 3.0], [3.0, 4.0], [4.0, 6.0], [6.0, 8.0], [8.0, 12.0]]);
    let all: f64 = classes.iter().map(|class| class.volume_mm3).sum();
    assert!((all / (mix.volume_fraction_effective * mix.specimen_volume_mm3) - 1.0).abs() < 1e-12);
    let grains: f64 = classes.iter().map(|class| class.grains).sum();
    assert!((grains / mix.expected_grains() - 1.0).abs() < 1e-9);

    let packed = pack(&request, &Limits::default(), &Unattended).unwrap();
    let summary = &packed.report.summary;
    let found: Vec<[f64; 2]> = summary.classes.iter().map(|class| [class.d_min_mm, class.d_max_mm]).collect();
    assert_eq!(found, edges);
    for (found, asked) in summary.classes.iter().zip(&classes) {
        assert!((found.target_volume_mm3 / asked.volume_mm3 - 1.0).abs() < 1e-12, "{found:?} {asked:?}");
    }
}

#[test]
fn the_check_judges_every_aggregate_by_its_own_curve() {
    let request = request(overlapping(&json!({})));
    let packed = pack(&request, &Limits::default(), &Unattended).unwrap();
    let aggregates = &packed.report.summary.aggregates;
    let names: Vec<Option<&str>> = aggregates.iter().map(|aggregate| aggregate.name.as_deref()).collect();
    assert_eq!(names, [Some("gravel"), Some("chippings"), Some("beads"), Some("sand")]);
    for aggregate in aggregates {
        assert!(aggregate.volume_mm3 >= aggregate.target_volume_mm3);
        assert!(aggregate.volume_mm3 <= 1.02 * aggregate.target_volume_mm3, "{aggregate:?}");
        assert_eq!(aggregate.grains, aggregate.classes.iter().map(|class| class.grains).sum::<u64>());
    }
    let beads = &aggregates[2];
    assert!((beads.mass_kg.unwrap() - 2500.0 * beads.volume_mm3 * 1e-9).abs() < 1e-12);
    assert_eq!((aggregates[3].grains, aggregates[3].classes.len()), (0, 0));
    let total: u64 = aggregates.iter().map(|aggregate| aggregate.grains).sum();
    assert_eq!(total, packed.report.summary.grains);

    let spheres = packed.into_spheres().unwrap();
    check::check(&spheres, &request).unwrap();
    // Two grains of different size change their aggregates: each curve is missed, the sum of both is not.
    let bead = spheres.aggregate.iter().position(|&part| part == 2).unwrap();
    let gravel = spheres.aggregate.iter().position(|&part| part == 0).unwrap();
    let mut changed = spheres.clone();
    changed.aggregate.swap(bead, gravel);
    let fault = check::check(&changed, &request).unwrap_err();
    assert!(matches!(&fault, check::Fault::Grading(detail) if detail.contains("aggregate")), "{fault}");
    changed.aggregate[bead] = 9;
    assert!(check::check(&changed, &request).unwrap_err().to_string().contains("the aggregate 9 of 4"));
    changed.aggregate.clear();
    assert!(check::check(&changed, &request).unwrap_err().to_string().contains("belong to an aggregate"));
}

#[test]
fn shapes_are_those_of_the_aggregate() {
    let ratios = json!({"type": "constant", "b_over_a": 0.7, "c_over_a": 0.5});
    let request = request(overlapping(&json!({"shape": {"type": "ellipsoid", "ratios": ratios}})));
    let mix = graded(&request);
    let [mut sizes, mut forms] = [Stream::Sampling, Stream::Shape].map(|of| stream(1, of));
    let drawn = sample_shaped(&mix, &mut sizes, &mut forms, &|| false).unwrap();
    let Solids { shapes, aggregate, .. } = drawn.grains;
    assert!(aggregate.contains(&0) && aggregate.contains(&1) && aggregate.contains(&2));
    let ellipsoids: Vec<Ellipsoid> = shapes.iter().filter_map(Solid::ellipsoid).copied().collect();
    for (grain, part) in ellipsoids.iter().zip(&aggregate) {
        let [a, b, c]: [f64; 3] = grain.semi_axes_mm().into();
        if *part == 0 {
            assert!((b / a - 0.7).abs() < 1e-12 && (c / a - 0.5).abs() < 1e-12);
        } else {
            assert_eq!((a, b), (b, c));
        }
    }
    let gravel: f64 =
        ellipsoids.iter().zip(&aggregate).filter(|row| *row.1 == 0).map(|row| row.0.volume_mm3()).sum();
    assert!((gravel / (0.25 * 60.0_f64.powi(3)) - 1.0).abs() < 0.01, "{gravel}");
}

#[test]
fn one_aggregate_is_the_mix_itself() {
    let grading = json!({"type": "standard", "name": "A16"});
    let plain = request(json!({"grading": grading, "d_min_mm": 4.0, "volume_fraction": 0.4}));
    let one = request(json!({
        "volume_fraction": 0.4, "aggregates": [{"share": 1.0, "grading": grading, "d_min_mm": 4.0}],
    }));
    let of = |request: &PackingRequest| pack(request, &Limits::default(), &Unattended).unwrap();
    let [plain, one] = [of(&plain), of(&one)];
    assert_eq!(plain.report.summary.classes, one.report.summary.classes);
    let [plain, one] = [plain, one].map(|packing| packing.into_spheres().unwrap());
    assert_eq!((plain.x_mm, plain.d_mm), (one.x_mm, one.d_mm));
    assert!(plain.aggregate.is_empty() && one.aggregate.iter().all(|&part| part == 0));
}
