//! What is measured: problems, how often, and what they should come to.
//!
//! The bounds are read by people, beside what was measured; this module must never know how either
//! is found.

use std::num::NonZeroUsize;

use serde_json::{Value, json};

use super::ladder::Ladder;

/// One measured problem.
pub(super) struct Case {
    /// Starts with its group.
    pub(super) name: &'static str,
    pub(super) kind: Kind,
    pub(super) seeds: u64,
    /// What it should come to, and what would be a triumph.
    pub(super) at_least: &'static str,
    pub(super) moonshot: &'static str,
}

/// What is asked of a problem.
pub(super) enum Kind {
    /// Packings of a request.
    Pack { request: Value, shows: Shows },
    /// The highest amount that half of the seeds reach, with the request for an amount.
    Climb { ladder: Ladder, request: Box<dyn Fn(f64) -> Value> },
    /// Collisions of the hard-sphere fluid, of so many equal spheres, per second of CPU time or, on several threads, of
    /// wall-clock time.
    Fluid { spheres: usize, volume_fraction: f64, windows: u64, threads: NonZeroUsize },
}

/// Which figure of a packing is the measured one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shows {
    /// Time of the whole run, and how many succeed.
    Time,
    /// Time, and the highest resident memory of the process.
    TimeAndMemory,
    /// Distance reached, and the volume fraction with it.
    Distance,
    /// Highest volume fraction, coating included, of all seeds.
    BestFraction,
}

/// A run that misses its target is given up after this time, which is beyond every bound.
const MOST_TIME_S: f64 = 120.0;
/// The same where thousands of grains jam.
const MOST_JAMMING_S: f64 = 900.0;
/// Volume fraction that equal spheres start from until they jam.
const LOOSE_FRACTION: f64 = 0.1;
/// Edge of the cube that they jam in.
const CUBE_MM: f64 = 10.0;
/// Volume fraction of the fluid, just below freezing.
const FLUID_FRACTION: f64 = 0.49;

/// All cases.
pub(super) fn cases() -> Vec<Case> {
    let mut cases = rsa();
    cases.extend(growth_to_target());
    cases.extend(growth_to_distance());
    cases.extend(equal_spheres());
    cases.extend(shapes());
    cases
}

fn rsa() -> Vec<Case> {
    let case = |name, request: Value, seeds, at_least| Case {
        name,
        kind: Kind::Pack { request: with(request, "method", json!({"type": "rsa"})), shows: Shows::Time },
        seeds,
        at_least,
        moonshot: "",
    };
    let b16 = |size| standard("B16", size, 0.5, 0.7);
    vec![
        case("rsa fuller 2..16 a=80 phi_eff 0.60", fuller(80.0, 0.60), 5, "0.2 s"),
        case("rsa fuller 2..16 a=80 phi_eff 0.65", fuller(80.0, 0.65), 5, "1 s"),
        case("rsa fuller 2..16 a=80 phi_eff 0.665", fuller(80.0, 0.665), 20, "half succeed, 5 s each"),
        case("rsa fuller 2..16 a=80 phi_eff 0.70", fuller(80.0, 0.70), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=25.5", b16(25.5), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=54.9", b16(54.9), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=118", b16(118.0), 2, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=150", b16(150.0), 2, "40 s, 700 MB, < 2.5 x us/grain of a=25.5"),
    ]
}

fn growth_to_target() -> Vec<Case> {
    let fuller_case = |name, size, phi, at_least, moonshot| {
        time_case(name, growing(fuller(size, phi), Some(MOST_TIME_S)), at_least, moonshot)
    };
    let climb = |name, first, limit_s, size, at_least, moonshot| {
        let request = move |phi| growing(fuller(size, phi), Some(limit_s));
        climb_case(name, first, Box::new(request), at_least, moonshot)
    };
    vec![
        fuller_case("edmd fuller 2..16 a=80 phi_eff 0.65", 80.0, 0.65, "0.4 s", "0.12 s"),
        fuller_case("edmd fuller 2..16 a=80 phi_eff 0.68", 80.0, 0.68, "1.0 s", "0.4 s"),
        fuller_case("edmd fuller 2..16 a=80 phi_eff 0.69", 80.0, 0.69, "2.5 s", "1.2 s"),
        fuller_case(
            "edmd fuller 2..16 a=80 phi_eff 0.70",
            80.0,
            0.70,
            "8 of 10 within 120 s each",
            "median 10 s",
        ),
        climb("edmd fuller 2..16 a=80 highest phi_eff in 60 s", 700, 60.0, 80.0, "0.70", "0.707"),
        fuller_case("edmd fuller 2..16 a=150 phi_eff 0.70", 150.0, 0.70, "20 s", "7 s"),
        climb("edmd fuller 2..16 a=150 highest phi_eff in 300 s", 710, 300.0, 150.0, "0.71", "0.72"),
        fuller_case("edmd fuller 2..16 a=32 phi_eff 0.64", 32.0, 0.64, "9 of 10, 1 s", "0.3 s"),
        climb("edmd fuller 2..16 a=32 highest phi_eff in 10 s", 640, 10.0, 32.0, "0.645", "0.655"),
    ]
}

fn growth_to_distance() -> Vec<Case> {
    let a16 = |phi, limit_s| growing(apart(standard("A16", 80.0, 2.0, phi), 1.0), Some(limit_s));
    let maximize = |name, curve, at_least, moonshot| {
        let mix = with(standard(curve, 150.0, 2.0, 0.7), "distance", json!({"type": "maximize"}));
        let kind = Kind::Pack { request: growing(mix, Some(60.0)), shows: Shows::Distance };
        Case { name, kind, seeds: 2, at_least, moonshot }
    };
    vec![
        time_case(
            "edmd A16 d_min 2 phi_M 0.535 a=80 distance 1 mm",
            a16(0.535, MOST_TIME_S),
            "9 of 10, 5 s",
            "1.5 s",
        ),
        climb_case(
            "edmd A16 d_min 2 a=80 distance 1 mm highest phi_M in 60 s",
            535,
            Box::new(move |phi| a16(phi, 60.0)),
            "0.535",
            "0.545 (0.706 with the coating)",
        ),
        maximize(
            "edmd B16 d_min 2 phi_M 0.70 a=150 distance after 60 s",
            "B16",
            "1.00 mm (0.698 with the coating)",
            "1.05 mm (0.716)",
        ),
        maximize(
            "edmd A16 d_min 2 phi_M 0.70 a=150 distance after 60 s",
            "A16",
            "0.46 mm (0.697 with the coating)",
            "0.51 mm (0.714)",
        ),
        Case {
            name: "edmd B16 d_min 0.5 phi_M 0.70 a=150 distance 0.1 mm",
            kind: Kind::Pack {
                request: growing(apart(standard("B16", 150.0, 0.5, 0.7), 0.1), None),
                shows: Shows::TimeAndMemory,
            },
            seeds: 1,
            at_least: "600 s, 1000 MB",
            moonshot: "120 s, 700 MB",
        },
    ]
}

fn equal_spheres() -> Vec<Case> {
    const TWO: NonZeroUsize = NonZeroUsize::new(2).expect("not zero");
    let fluid = |name, spheres, threads, at_least, moonshot| Case {
        name,
        kind: Kind::Fluid { spheres, volume_fraction: FLUID_FRACTION, windows: 5, threads },
        seeds: 1,
        at_least,
        moonshot,
    };
    let jammed = |name, spheres, seeds, at_least, moonshot| Case {
        name,
        kind: Kind::Pack { request: jamming(spheres), shows: Shows::BestFraction },
        seeds,
        at_least,
        moonshot,
    };
    vec![
        fluid(
            "edmd fluid phi 0.49 N=1e4",
            10_000,
            NonZeroUsize::MIN,
            "1.2e6 collisions/s",
            "2.0e6 collisions/s",
        ),
        fluid(
            "edmd fluid phi 0.49 N=1e5",
            100_000,
            NonZeroUsize::MIN,
            "1.0e6 collisions/s",
            "1.4e6 collisions/s",
        ),
        fluid(
            "edmd fluid phi 0.49 N=1e6",
            1_000_000,
            NonZeroUsize::MIN,
            "1.0e6 collisions/s, 400 bytes/grain",
            "1.3e6 collisions/s, 300 bytes/grain",
        ),
        fluid(
            "edmd fluid phi 0.49 N=1e6 two threads",
            1_000_000,
            TWO,
            "1.8e6 collisions/s of wall-clock time",
            "2.5e6 collisions/s of wall-clock time",
        ),
        // The optima: spheres of diameter m / (1 + m) in the unit cube, for m the largest least distance
        // of as many points in it: sqrt(3) for two, sqrt(2) for three and four, 1 for eight, 1/2 for 27.
        jammed("edmd jammed N=1", 1, 20, "0.523599 to 1e-5", ""),
        jammed("edmd jammed N=2", 2, 20, "0.266836 to 1e-5", ""),
        jammed("edmd jammed N=3", 3, 20, "0.315746 to 1e-5", ""),
        jammed("edmd jammed N=4", 4, 20, "0.420995 to 1e-5", ""),
        jammed("edmd jammed N=8", 8, 20, "0.523599 to 1e-5", ""),
        jammed("edmd jammed N=27", 27, 20, "0.523599 to 1e-5", ""),
        jammed("edmd jammed N=1000", 1000, 2, "0.60", "0.61"),
        jammed("edmd jammed N=8000", 8000, 1, "0.62", "0.63"),
    ]
}

/// Ellipsoids and polyhedra, whose diameters are those of the spheres of equal volume.
fn shapes() -> Vec<Case> {
    const TRIAXIAL: [f64; 2] = [1.2 / 1.5, 1.0 / 1.5];
    const FLAT: [f64; 2] = [std::f64::consts::FRAC_1_SQRT_2, 0.5];
    let shaped = |mut request: Value, [b, c]: [f64; 2]| {
        let ratios = json!({"type": "constant", "b_over_a": b, "c_over_a": c});
        request["mix"]["shape"] = json!({"type": "ellipsoid", "ratios": ratios});
        request["mix"]["size"] = json!("equivalent");
        request
    };
    let by = |request: Value, method: &str| {
        let method = match method {
            "rsa" => json!({"type": "rsa"}),
            other => json!({"type": other, "stop": {"time_s": MOST_TIME_S}}),
        };
        with(request, "method", method)
    };
    let grown = |name, size, phi, ratios, at_least, moonshot| {
        time_case(name, by(shaped(fuller(size, phi), ratios), "monte_carlo"), at_least, moonshot)
    };
    let a16 = |name, phi, at_least, moonshot| {
        let request = shaped(apart(standard("A16", 80.0, 2.0, phi), 1.0), TRIAXIAL);
        time_case(name, by(request, "monte_carlo"), at_least, moonshot)
    };
    let angular = |name, method, phi, at_least, moonshot| {
        let mut request = shaped(fuller(80.0, phi), TRIAXIAL);
        request["mix"]["shape"]["type"] = json!("polyhedron");
        request["mix"]["shape"]["faces"] = json!(21);
        time_case(name, by(request, method), at_least, moonshot)
    };
    let mixed = |name, phi| {
        let mut request = shaped(fuller(80.0, phi), TRIAXIAL);
        let ellipsoid = request["mix"]["shape"].clone();
        let mut polyhedron = ellipsoid.clone();
        polyhedron["type"] = json!("polyhedron");
        polyhedron["faces"] = json!(21);
        let of = [ellipsoid, polyhedron].map(|shape| json!({"share": 0.5, "shape": shape}));
        request["mix"]["shape"] = json!({"type": "mixture", "of": of});
        time_case(name, by(request, "monte_carlo"), "", "")
    };
    let added = |name, phi, at_least, moonshot| {
        time_case(name, by(shaped(fuller(80.0, phi), TRIAXIAL), "rsa"), at_least, moonshot)
    };
    let pycmg = |name, example: &str| {
        let job: Value = serde_json::from_str(example).expect("an example is JSON");
        let request = json!({"specimen": job["specimen"], "mix": job["mix"], "method": job["method"]});
        time_case(name, request, "", "")
    };
    vec![
        grown("shapes ellipsoids fuller 2..16 a=80 phi_eff 0.60", 80.0, 0.60, TRIAXIAL, "1.5 s", "0.4 s"),
        grown("shapes ellipsoids fuller 2..16 a=80 phi_eff 0.65", 80.0, 0.65, TRIAXIAL, "5 s", "1.2 s"),
        grown("shapes ellipsoids fuller 2..16 a=80 phi_eff 0.70", 80.0, 0.70, TRIAXIAL, "20 s", "4 s"),
        grown("shapes ellipsoids fuller 2..16 a=80 phi_eff 0.73", 80.0, 0.73, TRIAXIAL, "60 s", "12 s"),
        grown("shapes ellipsoids fuller 2..16 a=80 phi_eff 0.75", 80.0, 0.75, TRIAXIAL, "", "120 s"),
        grown("shapes flat ellipsoids fuller 2..16 a=80 phi_eff 0.70", 80.0, 0.70, FLAT, "25 s", "5 s"),
        Case {
            name: "shapes ellipsoids fuller 2..16 a=150 phi_eff 0.60",
            kind: Kind::Pack {
                request: by(shaped(fuller(150.0, 0.60), TRIAXIAL), "monte_carlo"),
                shows: Shows::TimeAndMemory,
            },
            seeds: 10,
            at_least: "12 s, 600 bytes/grain",
            moonshot: "4 s, 400 bytes/grain",
        },
        grown("shapes ellipsoids fuller 2..16 a=150 phi_eff 0.70", 150.0, 0.70, TRIAXIAL, "180 s", "40 s"),
        grown("shapes ellipsoids fuller 2..16 a=186 phi_eff 0.60", 186.0, 0.60, TRIAXIAL, "30 s", "10 s"),
        a16("shapes ellipsoids A16 phi_M 0.50 a=80 distance 1 mm", 0.50, "10 s", "2.5 s"),
        a16("shapes ellipsoids A16 phi_M 0.535 a=80 distance 1 mm", 0.535, "60 s", "10 s"),
        added("shapes ellipsoids random addition fuller 2..16 a=80 phi_eff 0.60", 0.60, "2 s", "0.5 s"),
        added("shapes ellipsoids random addition fuller 2..16 a=80 phi_eff 0.63", 0.63, "5 s", "1.2 s"),
        angular("shapes polyhedra fuller 2..16 a=80 phi_eff 0.60", "monte_carlo", 0.60, "24 s", "5 s"),
        angular("shapes polyhedra fuller 2..16 a=80 phi_eff 0.65", "monte_carlo", 0.65, "120 s", "25 s"),
        angular("shapes polyhedra fuller 2..16 a=80 phi_eff 0.68", "monte_carlo", 0.68, "", ""),
        mixed("shapes ellipsoids and polyhedra fuller 2..16 a=80 phi_eff 0.60", 0.60),
        mixed("shapes ellipsoids and polyhedra fuller 2..16 a=80 phi_eff 0.65", 0.65),
        angular("shapes polyhedra random addition fuller 2..16 a=80 phi_eff 0.50", "rsa", 0.50, "0.9 s", ""),
        angular("shapes polyhedra random addition fuller 2..16 a=80 phi_eff 0.55", "rsa", 0.55, "4.5 s", ""),
        pycmg(
            "shapes ellipsoids AB8 of PyCMG 20 x 20 x 50 mm phi 0.45",
            include_str!("../../../../examples/pycmg-ab8.json"),
        ),
        pycmg(
            "shapes ellipsoids AB16 of PyCMG 20 x 20 x 50 mm phi 0.45",
            include_str!("../../../../examples/pycmg-ab16.json"),
        ),
    ]
}

fn time_case(name: &'static str, request: Value, at_least: &'static str, moonshot: &'static str) -> Case {
    Case { name, kind: Kind::Pack { request, shows: Shows::Time }, seeds: 10, at_least, moonshot }
}

fn climb_case(
    name: &'static str,
    first: u32,
    request: Box<dyn Fn(f64) -> Value>,
    at_least: &'static str,
    moonshot: &'static str,
) -> Case {
    Case {
        name,
        kind: Kind::Climb { ladder: Ladder { first, step: 5 }, request },
        seeds: 5,
        at_least,
        moonshot,
    }
}

/// Fuller's curve from 2 to 16 mm in a cube.
fn fuller(size_mm: f64, phi_eff: f64) -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
                "d_min_mm": 2, "volume_fraction": phi_eff, "volume_fraction_of": "placed_grains"},
    })
}

/// A standard curve in a cube.
fn standard(curve: &str, size_mm: f64, d_min_mm: f64, phi_mixture: f64) -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm]},
        "mix": {"grading": {"type": "standard", "name": curve}, "d_min_mm": d_min_mm, "volume_fraction": phi_mixture},
    })
}

/// Equal spheres, loose in a cube, whose distance grows until they jam.
fn jamming(spheres: usize) -> Value {
    let volume_mm3 = LOOSE_FRACTION * CUBE_MM.powi(3) / spheres as f64;
    let diameter_mm = libm::cbrt(6.0 * volume_mm3 / std::f64::consts::PI);
    let request = json!({
        "specimen": {"type": "box", "size_mm": [CUBE_MM, CUBE_MM, CUBE_MM]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": vec![diameter_mm; spheres]}},
        "distance": {"type": "maximize"},
    });
    growing(request, Some(MOST_JAMMING_S))
}

fn apart(request: Value, distance_mm: f64) -> Value {
    with(request, "distance", json!({"type": "constant", "gap_mm": distance_mm}))
}

fn growing(request: Value, most_time_s: Option<f64>) -> Value {
    let method = match most_time_s {
        Some(time_s) => json!({"type": "edmd", "stop": {"time_s": time_s}}),
        None => json!({"type": "edmd"}),
    };
    with(request, "method", method)
}

fn with(mut request: Value, field: &str, value: Value) -> Value {
    request[field] = value;
    request
}

#[cfg(test)]
mod tests {
    use packstone_engine::PackingRequest;

    use super::*;

    #[test]
    fn every_case_has_a_name_of_its_own_in_a_group_and_a_request_that_is_valid() {
        let cases = cases();
        for (i, case) in cases.iter().enumerate() {
            let name = case.name;
            assert!(["rsa ", "edmd ", "shapes "].iter().any(|group| name.starts_with(group)), "{name}");
            assert!(cases[..i].iter().all(|other| other.name != name), "{name}");
            let request = match &case.kind {
                Kind::Pack { request, .. } => request.clone(),
                Kind::Climb { ladder, request } => request(f64::from(ladder.first) / 1000.0),
                Kind::Fluid { .. } => continue,
            };
            PackingRequest::from_json(&request, 1).unwrap_or_else(|faults| panic!("{name}: {faults:?}"));
        }
    }
}
