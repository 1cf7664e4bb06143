//! Growth does not depend on the number of threads, also where it is interrupted.

use packstone_engine::{Limits, Packing, PackingRequest, TemplateCache, Unattended, pack_or_resume};
use serde_json::{Value, json};

use super::resume::{Killer, resume};

/// Some 21 000 grains that threads share from, in a specimen and with a rule that growth reaches within two cycles.
fn request(specimen: &Value, distance: &Value, d_min_mm: f64) -> PackingRequest {
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": d_min_mm, "volume_fraction": 0.5},
        "distance": distance,
        "method": {"type": "edmd"},
    });
    PackingRequest::from_json(&request, 1).unwrap()
}

fn grown(request: &PackingRequest, threads: usize) -> Packing {
    let limits = Limits { threads: threads.try_into().unwrap(), ..Limits::default() };
    pack_or_resume(request, &limits, &TemplateCache::default(), None, &Unattended).unwrap()
}

#[test]
fn growth_does_not_depend_on_the_threads() {
    let cube = |boundary: &str| json!({"type": "box", "size_mm": [38, 38, 38], "boundary": boundary});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 42, "height_mm": 42});
    let constant = json!({"type": "constant", "gap_mm": 0.05});
    let cases = [
        (cube("walls"), json!({"type": "none"})),
        (cube("periodic"), json!({"type": "proportional", "factor": 0.05})),
        (cylinder, constant.clone()),
        (cube("walls"), json!({"type": "smaller_diameter", "factor": 0.1})),
    ];
    for (specimen, distance) in &cases {
        let request = request(specimen, distance, 0.5);
        let one = grown(&request, 1);
        assert!(one.report.summary.grains > 20_000, "{}", one.report.summary.grains);
        for threads in [2, 3, 8] {
            assert_eq!(
                grown(&request, threads).spheres(),
                one.spheres(),
                "{threads} threads, {specimen} {distance}"
            );
        }
    }
    // Interrupted with three threads, gone on with two.
    let request = request(&cases[2].0, &constant, 0.5);
    let killer = Killer::at(2);
    let limits = |threads: usize| Limits { threads: threads.try_into().unwrap(), ..Limits::default() };
    assert!(pack_or_resume(&request, &limits(3), &TemplateCache::default(), None, &killer).is_err());
    let checkpoint = killer.kept();
    let ended = pack_or_resume(
        &request,
        &limits(2),
        &TemplateCache::default(),
        Some(resume(&checkpoint, &request)),
        &Unattended,
    )
    .unwrap();
    assert_eq!(ended.spheres(), grown(&request, 1).spheres());
}

/// Some 42 000 grains whose growth goes on to the largest distance in blocks, with swaps in the last cycles.
fn in_blocks(specimen: &Value, segregation: &Value) -> PackingRequest {
    let request = json!({
        "specimen": specimen,
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 2, "exponent": 0.5},
            "d_min_mm": 1,
            "volume_fraction": 0.4,
            "volume_fraction_of": "placed_grains",
        },
        "segregation": segregation,
        "distance": {"type": "maximize"},
        "method": {"type": "edmd", "stop": {"events": 1_700_000}},
    });
    PackingRequest::from_json(&request, 1).unwrap()
}

fn swaps(packing: &Packing) -> u64 {
    packing.report.statistics.edmd.as_ref().unwrap().swaps_accepted
}

#[test]
fn growth_in_blocks_does_not_depend_on_the_threads() {
    let cube = |boundary: &str| json!({"type": "box", "size_mm": [52, 52, 52], "boundary": boundary});
    let gradient = json!({"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": 30});
    let none = json!({"type": "none"});
    let one_thread = |request: &PackingRequest| {
        let one = grown(request, 1);
        assert!(one.report.summary.grains > 40_000, "{}", one.report.summary.grains);
        assert!(swaps(&one) > 0, "{:?}", request.specimen);
        one
    };
    for (specimen, segregation, threads) in [(cube("walls"), &gradient, 3), (cube("periodic"), &none, 8)] {
        let request = in_blocks(&specimen, segregation);
        let (one, several) = (one_thread(&request), grown(&request, threads));
        assert_eq!(several.spheres(), one.spheres(), "{threads} threads, {specimen}");
        assert_eq!(swaps(&several), swaps(&one));
    }
    // Interrupted with two threads, gone on with three.
    let request = in_blocks(&json!({"type": "cylinder", "diameter_mm": 56, "height_mm": 56}), &none);
    let killer = Killer::at(6);
    let limits = |threads: usize| Limits { threads: threads.try_into().unwrap(), ..Limits::default() };
    assert!(pack_or_resume(&request, &limits(2), &TemplateCache::default(), None, &killer).is_err());
    let checkpoint = killer.kept();
    let resumed = pack_or_resume(
        &request,
        &limits(3),
        &TemplateCache::default(),
        Some(resume(&checkpoint, &request)),
        &Unattended,
    )
    .unwrap();
    assert_eq!(resumed.spheres(), one_thread(&request).spheres());
}
