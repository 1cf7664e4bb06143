#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::*;
use crate::{Limits, Plan};

fn request(size_mm: [f64; 3], mix: &Value) -> PackingRequest {
    let value = json!({"specimen": {"type": "box", "size_mm": size_mm}, "mix": mix});
    PackingRequest::from_json(&value, 1).unwrap()
}

fn plan(request: &PackingRequest) -> Result<Plan, PlanError> {
    Plan::new(request, &Limits::default())
}

fn ellipsoids(axes: [f64; 3]) -> Value {
    json!({"type": "ellipsoid", "ratios": {"type": "measured", "axes": [axes]}})
}

fn fuller(fraction: f64, shape: &Value) -> Value {
    json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "volume_fraction": fraction,
        "volume_fraction_of": "placed_grains", "shape": shape})
}

const CUBE_80: [f64; 3] = [80.0; 3];

#[test]
fn the_number_of_grains_is_that_of_spheres_over_their_mean_volume() {
    let spheres = plan(&request(CUBE_80, &fuller(0.6, &json!({"type": "sphere"})))).unwrap();
    let by_sieve = plan(&request(CUBE_80, &fuller(0.6, &ellipsoids([1.5, 1.2, 1.0])))).unwrap();
    assert!((spheres.grains / by_sieve.grains - 1.336).abs() < 1e-3, "{}", by_sieve.grains);
    assert!((by_sieve.volume_fraction_effective - 0.6).abs() < 1e-12);
    assert!((by_sieve.volume_fraction_with_coating - 0.6).abs() < 1e-9);
    let grains: f64 = by_sieve.classes.iter().map(|class| class.grains).sum();
    assert!((grains / by_sieve.grains - 1.0).abs() < 1e-9);
    let mut by_volume = fuller(0.6, &ellipsoids([1.5, 1.2, 1.0]));
    by_volume["size"] = json!("equivalent");
    assert_eq!(plan(&request(CUBE_80, &by_volume)).unwrap().grains, spheres.grains);
    // The shape that is a sphere by law only.
    let round = plan(&request(CUBE_80, &fuller(0.6, &ellipsoids([1.0, 1.0, 1.0])))).unwrap();
    assert!((round.grains / spheres.grains - 1.0).abs() < 1e-12);
}

#[test]
fn shapes_by_size_change_the_number_of_their_grains_alone() {
    let mix = |shapes: Value| {
        let mut mix = fuller(0.5, &Value::Null);
        mix["shapes"] = shapes;
        plan(&request(CUBE_80, &mix)).unwrap()
    };
    let sphere = json!({"type": "sphere"});
    let spheres = plan(&request(CUBE_80, &fuller(0.5, &Value::Null))).unwrap();
    // 6.3 mm lies inside a sieve class and inside a narrow one.
    let coarse =
        mix(json!([{"above_mm": 8, "shape": ellipsoids([2.0, 1.0, 1.0])}, {"above_mm": 0, "shape": sphere}]));
    let ratio = |i: usize| spheres.classes[i].grains / coarse.classes[i].grains;
    assert!((ratio(0) - 1.0).abs() < 1e-9 && (ratio(1) - 1.0).abs() < 1e-9 && (ratio(2) - 2.0).abs() < 1e-9);
    let inside = mix(
        json!([{"above_mm": 6.3, "shape": ellipsoids([2.0, 1.0, 1.0])}, {"above_mm": 0, "shape": sphere}]),
    );
    let ratio = |i: usize| spheres.classes[i].grains / inside.classes[i].grains;
    assert!(
        (ratio(0) - 1.0).abs() < 1e-9 && ratio(1) > 1.05 && ratio(1) < 1.95 && (ratio(2) - 2.0).abs() < 1e-9
    );
    for other in [coarse, inside] {
        for (class, of_spheres) in other.classes.iter().zip(&spheres.classes) {
            assert!((class.volume_mm3 / of_spheres.volume_mm3 - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_mixture_has_the_harmonic_mean_of_the_volumes() {
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.25, "shape": {"type": "sphere"}}, {"share": 0.75, "shape": ellipsoids([2.0, 1.0, 1.0])}]});
    let grains = |shape: &Value| plan(&request(CUBE_80, &fuller(0.5, shape))).unwrap().grains;
    let (spheres, long) = (grains(&json!({"type": "sphere"})), grains(&ellipsoids([2.0, 1.0, 1.0])));
    assert!((grains(&mixture) / (0.25 * spheres + 0.75 * long) - 1.0).abs() < 1e-9);
}

#[test]
fn what_is_unlikely_is_a_warning_and_what_cannot_be_is_refused() {
    let shape = ellipsoids([1.5, 1.2, 1.0]);
    let at = |fraction: f64, method: &str| {
        let mut wanted = request(CUBE_80, &fuller(fraction, &shape));
        wanted.method = PackingRequest::from_json(
            &json!({"specimen": {"type": "box", "size_mm": CUBE_80}, "mix": fuller(0.5, &shape), "method": {"type": method}}),
            1,
        )
        .unwrap()
        .method;
        plan(&wanted)
    };
    let loose = at(0.55, "rsa").unwrap();
    assert!(loose.success_probability > 0.9 && loose.warnings.is_empty(), "{loose:?}");
    assert!(loose.estimated_time_s > 0.2 && loose.estimated_time_s < 1.0, "{}", loose.estimated_time_s);
    let dense = at(0.80, "rsa").unwrap();
    assert!(dense.success_probability < 0.01, "{dense:?}");
    assert!(dense.warnings[0].starts_with("random sequential addition is unlikely"), "{:?}", dense.warnings);
    assert!(at(0.70, "auto").unwrap().success_probability > 0.9);
    assert!(!at(0.70, "auto").unwrap().places_first && at(0.5, "auto").unwrap().places_first);
    let denser = at(0.80, "auto").unwrap();
    assert!(denser.warnings[0].starts_with("growth is unlikely"), "{denser:?}");
    let Err(PlanError::Infeasible(fault)) = at(0.95, "auto") else { panic!("accepted") };
    assert_eq!(fault.pointer, "/mix/volume_fraction");
    assert!(
        fault.detail.contains("ellipsoids of this range of diameters (1 : 8.00) fill at most 0.9"),
        "{fault}"
    );
}

/// Needles and single grains: `repairs.md` A2, A5.
#[test]
fn needles_and_single_grains_are_forecast_as_such() {
    let needle = ellipsoids([10.0, 1.0, 1.0]);
    let compact = ellipsoids([1.5, 1.2, 1.0]);
    let [needles, grains] = [needle, compact].map(|shape| {
        let mut mix = fuller(0.5, &shape);
        mix["size"] = json!("equivalent");
        plan(&request(CUBE_80, &mix)).unwrap().methods
    });
    let reach = |of: crate::plan::MethodEstimate| of.volume_fraction_with_coating_reach;
    assert!(
        reach(needles.growth) < 0.8 * reach(grains.growth) && reach(needles.rsa) < 0.85 * reach(grains.rsa)
    );
    assert!(needles.growth.time_s > 10.0 * grains.growth.time_s, "{needles:?} {grains:?}");
    let single = json!({"grading": {"type": "diameters", "diameters_mm": [5]}, "allow_coarse": true,
        "shape": {"type": "polyhedron"}});
    for edge_mm in [20.0, 9.0] {
        for word in plan(&request([edge_mm; 3], &single)).unwrap().warnings {
            assert!(!word.contains("it reaches about"), "{word}");
        }
    }
}

#[test]
fn memory_and_time_grow_with_the_grains() {
    let few = plan(&request(CUBE_80, &fuller(0.6, &ellipsoids([1.5, 1.2, 1.0])))).unwrap();
    let many = plan(&request([160.0; 3], &fuller(0.6, &ellipsoids([1.5, 1.2, 1.0])))).unwrap();
    assert!((many.grains / few.grains - 8.0).abs() < 1e-9);
    assert!(
        many.memory_bytes as f64 > 750.0 * many.grains && many.estimated_time_s > 7.0 * few.estimated_time_s
    );
    let limits = Limits { max_memory_bytes: 40_000_000, ..Limits::default() };
    let wanted = request([160.0; 3], &fuller(0.6, &ellipsoids([1.5, 1.2, 1.0])));
    assert!(matches!(Plan::new(&wanted, &limits), Err(PlanError::TooLarge(_))));
}

#[test]
fn a_box_holds_a_grain_if_some_turn_of_it_does() {
    let one = |size_mm: [f64; 3]| {
        let list = json!({"grading": {"type": "diameters", "diameters_mm": [10]}, "size": "equivalent", "shape": ellipsoids([4.0, 2.0, 1.0])});
        plan(&request(size_mm, &list))
    };
    // Semi-axes 10, 5, 2.5; the squares of the half edges must be at least 6.25, add to 31.25, and to 131.25.
    assert!(one([20.1, 10.1, 5.1]).is_ok());
    assert!(one([5.1, 20.1, 10.1]).is_ok());
    let refused = |size_mm: [f64; 3]| match one(size_mm) {
        Err(PlanError::Invalid(faults)) => faults[0].clone(),
        other => panic!("{other:?}"),
    };
    assert_eq!(refused([20.1, 10.1, 4.9]).pointer, "/specimen/size_mm/2");
    assert!(refused([19.9, 9.9, 5.0]).detail.contains("largest equivalent diameter, 10 mm, fits"));
    // Turned by 45 degrees it is shorter.
    assert!(one([16.0, 15.0, 7.0]).is_ok());
}

/// Refused is only what meets its own image in every orientation, with the least edge that is not refused.
#[test]
fn a_periodic_box_may_be_shorter_than_a_grain_but_not_than_its_thickness() {
    let one = |edge: f64, shape: Value, gap_mm: f64| {
        let mix = json!({"grading": {"type": "diameters", "diameters_mm": [10]}, "size": "equivalent",
            "shape": shape});
        let value = json!({"specimen": {"type": "box", "size_mm": [60, edge, 60], "boundary": "periodic"},
            "mix": mix, "distance": {"type": "constant", "gap_mm": gap_mm}});
        plan(&PackingRequest::from_json(&value, 1).unwrap())
    };
    let cube = json!({"type": "polyhedron", "template": "cube"});
    // Semi-axes 10, 5 and 2.5 mm. A cube of the volume of the sphere has this edge, which is its thickness.
    let edge = 10.0 * (std::f64::consts::PI / 6.0).cbrt();
    for (shape, thickness) in
        [(ellipsoids([4.0, 2.0, 1.0]), 5.0), (ellipsoids([1.0, 1.0, 1.0]), 10.0), (cube, edge)]
    {
        for gap_mm in [0.0, 0.75] {
            let needed = thickness + gap_mm;
            assert!(one(needed + 2e-4, shape.clone(), gap_mm).is_ok(), "{shape} {gap_mm}");
            let Err(PlanError::Invalid(faults)) = one(needed - 1e-3, shape.clone(), gap_mm) else {
                panic!("{shape} accepted")
            };
            assert_eq!(faults[0].pointer, "/specimen/size_mm/1");
            let (said, bound) = faults[0].detail.split_once("must be at least ").unwrap();
            assert!(said.contains("meets its own image, however it is turned"), "{said}");
            let bound: f64 = bound.trim_end_matches(" mm").parse().unwrap();
            assert!((needed - 1e-12..needed + 1.1e-4).contains(&bound), "{bound} {needed}");
            assert!(one(bound, shape.clone(), gap_mm).is_ok(), "{bound}");
        }
    }
}

#[test]
fn a_coarse_mix_is_judged_by_the_least_volume() {
    let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 10}, "volume_fraction": 1e-4, "shape": ellipsoids([2.0, 1.0, 1.0])});
    assert!(matches!(plan(&request([100.0; 3], &mix)), Err(PlanError::Coarse(_))));
}

#[test]
fn more_grains_than_the_dense_method_can_number_are_refused() {
    let shape = ellipsoids([1.5, 1.2, 1.0]);
    let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 1}, "volume_fraction": 0.3, "shape": shape});
    let limits = Limits { max_grains: u64::MAX, max_memory_bytes: u64::MAX, ..Limits::default() };
    match Plan::new(&request([470.0; 3], &mix), &limits) {
        Err(PlanError::TooLarge(fault)) => assert!(fault.detail.contains("at most 33554430"), "{fault}"),
        other => panic!("{other:?}"),
    }
}

fn polyhedra(fields: &Value) -> Value {
    let mut shape = fields.clone();
    shape["type"] = json!("polyhedron");
    shape
}

#[test]
fn plans_of_polyhedra_have_their_own_numbers() {
    let shape = polyhedra(&json!({"template_count": 8}));
    let at = |fraction: f64| plan(&request(CUBE_80, &fuller(fraction, &shape)));
    let spheres = plan(&request(CUBE_80, &fuller(0.5, &json!({"type": "sphere"})))).unwrap();
    let loose = at(0.5).unwrap();
    let wanted = request(CUBE_80, &fuller(0.5, &shape));
    let mix = GradedMix::new(&wanted.mix, wanted.specimen.volume_mm3());
    let shapes = mix.shapes.as_ref().unwrap();
    let mean = shapes.templates().map(|body| body.sieve_size().powi(-3)).sum::<f64>() / 8.0;
    assert!((spheres.grains / loose.grains / mean - 1.0).abs() < 1e-9, "{mean}");
    assert!((loose.volume_fraction_effective - 0.5).abs() < 1e-12);
    assert!(loose.success_probability > 0.9 && loose.warnings.is_empty(), "{loose:?}");
    let corners = shapes.templates().map(|body| body.vertices().len()).sum::<usize>() as f64 / 8.0;
    assert!(loose.memory_bytes as f64 > loose.grains * (800.0 + 48.0 * corners));
    let ellipsoid = plan(&request(CUBE_80, &fuller(0.6, &ellipsoids([1.5, 1.2, 1.0])))).unwrap();
    let dense = at(0.6).unwrap();
    // CPU time in s, medians of three seeds.
    for (of, time_s) in [(&dense, 1.60), (&ellipsoid, 0.36)] {
        let ratio = of.methods.growth.time_s / time_s;
        assert!(ratio < 1.5 && ratio > 1.0 / 1.5, "{ratio}");
    }
    assert!(at(0.85).unwrap().warnings[0].starts_with("growth is unlikely"), "{:?}", at(0.85));
    // Some polyhedra fill space, so that only more than all of it is impossible.
    let Err(PlanError::Infeasible(fault)) = plan(&with_gap(1.0, &fuller(0.9, &shape))) else {
        panic!("accepted")
    };
    assert!(
        fault.detail.contains("polyhedra of this range of diameters (1 : 5.67) fill at most 1.0000"),
        "{fault}"
    );
}

fn with_gap(gap_mm: f64, mix: &Value) -> PackingRequest {
    let value = json!({"specimen": {"type": "box", "size_mm": CUBE_80}, "mix": mix,
        "distance": {"type": "constant", "gap_mm": gap_mm}});
    PackingRequest::from_json(&value, 1).unwrap()
}

#[test]
fn a_box_that_no_polyhedron_of_the_largest_size_fits_is_refused() {
    let one = |size_mm: [f64; 3], size: &str| {
        let shape = polyhedra(&json!({"template": "deformed_cuboid", "displacement": 0, "template_count": 2,
            "ratios": {"type": "constant", "elongation": 0.5, "flatness": 1}}));
        let list =
            json!({"grading": {"type": "diameters", "diameters_mm": [10]}, "size": size, "shape": shape});
        plan(&request(size_mm, &list))
    };
    // Prisms 20 x 10 x 10.
    assert!(one([20.1, 10.1, 10.1], "sieve").is_ok() && one([10.1, 20.1, 10.1], "sieve").is_ok());
    for narrow in [[9.0, 30.0, 30.0], [30.0, 9.9, 9.9], [14.0, 14.0, 12.0]] {
        let Err(PlanError::Invalid(faults)) = one(narrow, "sieve") else { panic!("{narrow:?} accepted") };
        assert!(faults[0].detail.contains("no grain of the largest sieve size, 10 mm, fits"), "{faults:?}");
    }
    assert!(one([3.0; 3], "equivalent").is_err() && one([30.0; 3], "equivalent").is_ok());
}

#[test]
fn the_most_templates_are_planned_alike_each_time() {
    let shape = polyhedra(&json!({"template_count": 128, "faces": 60, "rounding": 0.1, "template_seed": 99}));
    let wanted = request(CUBE_80, &fuller(0.5, &shape));
    let planned = plan(&wanted).unwrap().with_proposal(&wanted);
    assert!(planned.grains > 0.0 && plan(&wanted).unwrap().grains == planned.grains);
}

/// `repairs.md` A4: random addition that fails makes all draws for its last grain.
#[test]
fn random_addition_that_fails_is_forecast_to_its_end() {
    // Axes, grains, CPU time in s and peak in MB (docs/estimates.md, "Memory").
    let measured = [
        ([10.0, 1.0, 1.0], 40, 68.0, 70.0),
        ([1.0, 0.95, 0.9], 40, 12.3, 126.0),
        ([1.0, 0.8, 0.67], 60, 14.0, 118.0),
    ];
    for (axes, count, took_s, peak_mb) in measured {
        let value = json!({
            "specimen": {"type": "box", "size_mm": [15, 15, 15], "boundary": "periodic"},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "count": count, "size": "equivalent",
                "allow_coarse": true, "shape": ellipsoids(axes)},
            "method": {"type": "rsa"},
        });
        let plan = plan(&PackingRequest::from_json(&value, 1).unwrap()).unwrap();
        assert!(
            (0.6..1.7).contains(&(plan.estimated_time_s / took_s)),
            "{axes:?}: {}",
            plan.estimated_time_s
        );
        let over = plan.memory_bytes as f64 * 1e-6 / peak_mb;
        assert!((1.0..1.3).contains(&over), "{axes:?}: {over}");
    }
}

/// The largest distance is what growth has come to when its time is over: the time to jam is far longer.
#[test]
fn a_limit_of_time_does_not_make_the_largest_distance_unlikely() {
    let at = |fraction: f64, time_s: f64| {
        let value = json!({
            "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": fuller(fraction, &ellipsoids([1.5, 1.2, 1.0])),
            "distance": {"type": "maximize"},
            "method": {"type": "monte_carlo", "stop": {"time_s": time_s}},
        });
        let request = PackingRequest::from_json(&value, 1).unwrap();
        Plan::new(&request, &Limits::default()).unwrap()
    };
    let plan = at(0.5, 6.0);
    assert!(plan.success_probability > 0.9 && plan.warnings.is_empty(), "{plan:?}");
    assert_eq!(plan.estimated_time_s, 6.0);
    // In a millisecond the grains do not come to their size.
    assert!(at(0.5, 1e-3).success_probability < 0.1);
    assert!(at(0.85, 6.0).success_probability < 0.1);
}

#[test]
fn times_of_mixtures_are_those_measured() {
    let sphere = json!({"type": "sphere"});
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6667}});
    let polyhedron = json!({"type": "polyhedron", "faces": 21,
        "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6667}});
    // Volume fraction and CPU time in s (docs/estimates.md, "Grains of other shapes").
    let cases = [
        ([&sphere, &ellipsoid], 0.5, [(0.60, 0.41), (0.65, 0.66)]),
        ([&ellipsoid, &polyhedron], 0.5, [(0.60, 1.57), (0.65, 3.58)]),
        // At 0.65 nine seeds take 3.7 to 35 s.
        ([&sphere, &polyhedron], 0.5, [(0.55, 0.99), (0.60, 1.69)]),
        ([&ellipsoid, &polyhedron], 0.9, [(0.60, 0.80), (0.65, 1.32)]),
    ];
    for ([first, second], share, measured) in cases {
        for (fraction, time_s) in measured {
            let shape = json!({"type": "mixture", "of": [
                {"share": share, "shape": first}, {"share": 1.0 - share, "shape": second}]});
            let mut mix = fuller(fraction, &shape);
            mix["size"] = json!("equivalent");
            let estimated = plan(&request(CUBE_80, &mix)).unwrap().methods.growth.time_s;
            let ratio = estimated / time_s;
            assert!(ratio < 1.6 && ratio > 1.0 / 1.6, "{mix}: {estimated} s for {time_s} s");
        }
    }
}
