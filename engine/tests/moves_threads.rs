//! Growth by moves does not depend on the number of threads, also where it is interrupted.

use packstone_engine::packing::MonteCarloStatistics;
use packstone_engine::{Limits, Packing, PackingRequest, TemplateCache, Unattended, pack_or_resume};
use serde_json::{Value, json};

use crate::edmd::{Killer, resume_from};

/// More grains than those from which on the specimen is halved.
fn request(specimen: &Value, mix: &Value, more: &Value) -> PackingRequest {
    let mut request = json!({
        "specimen": specimen,
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
            "volume_fraction": 0.51, "volume_fraction_of": "placed_grains",
        },
        "method": {"type": "monte_carlo"},
    });
    for (of, into) in [(mix, "mix"), (more, "")] {
        let target = if into.is_empty() { &mut request } else { &mut request[into] };
        for (key, value) in of.as_object().unwrap() {
            target[key] = value.clone();
        }
    }
    PackingRequest::from_json(&request, 1).unwrap()
}

fn limits(threads: usize) -> Limits {
    Limits { threads: threads.try_into().unwrap(), ..Limits::default() }
}

fn grown(request: &PackingRequest, threads: usize) -> Packing {
    let packing =
        pack_or_resume(request, &limits(threads), &TemplateCache::default(), None, &Unattended).unwrap();
    assert!(packing.report.summary.grains > 10_000, "{}", packing.report.summary.grains);
    packing
}

/// What was counted, but for how often the run went on.
fn counted(packing: &Packing) -> MonteCarloStatistics {
    MonteCarloStatistics { resumes: 0, ..packing.report.statistics.monte_carlo.unwrap() }
}

fn assert_same(one: &Packing, other: &Packing, what: &str) {
    assert!(one.grains == other.grains, "{what}");
    assert_eq!(counted(one), counted(other), "{what}");
    assert_eq!(one.report.check, other.report.check, "{what}");
}

#[test]
fn growth_by_moves_does_not_depend_on_the_threads() {
    // Four regions in the large one, two in the others.
    let large = json!({"type": "box", "size_mm": [100, 98, 96]});
    let cube = |boundary: &str| json!({"type": "box", "size_mm": [86, 84, 82], "boundary": boundary});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 90, "height_mm": 82});
    let ellipsoids = json!({"shape": {"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.3}}});
    let loose = json!({"shape": ellipsoids["shape"], "volume_fraction": 0.45});
    let angular = json!({
        "shape": {"type": "polyhedron", "template": "deformed_cuboid", "template_count": 8},
        "volume_fraction": 0.5,
    });
    let gradient = json!({
        "segregation": {"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": 3},
        "distance": {"type": "proportional", "factor": 0.02},
    });
    let cases = [
        (large, &ellipsoids, json!({}), &[2, 3, 8][..]),
        (cube("periodic"), &angular, json!({}), &[3]),
        (cylinder, &json!({}), gradient, &[2]),
        (
            cube("walls"),
            &loose,
            json!({"distance": {"type": "maximize"}, "method": {"type": "monte_carlo", "stop": {"sweeps": 80}}}),
            &[8],
        ),
    ];
    for (specimen, mix, more, threads) in &cases {
        let request = request(specimen, mix, more);
        let one = grown(&request, 1);
        for &threads in *threads {
            assert_same(&grown(&request, threads), &one, &format!("{threads} threads, {specimen} {more}"));
        }
    }
    // Interrupted with three threads, gone on with two.
    let request = request(&cases[3].0, &loose, &cases[3].2);
    let killer = Killer::at(2);
    assert!(pack_or_resume(&request, &limits(3), &TemplateCache::default(), None, &killer).is_err());
    let from = resume_from(&killer.kept(), &request);
    let ended =
        pack_or_resume(&request, &limits(2), &TemplateCache::default(), Some(from), &Unattended).unwrap();
    assert_eq!(ended.report.statistics.monte_carlo.unwrap().resumes, 1);
    assert_same(&ended, &grown(&request, 1), "interrupted");
}
