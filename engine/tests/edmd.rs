//! Growth through the public interface: random mixes end valid or say why not, and every way for a
//! run to end says what it is.
//!
//! What is valid is judged here by a check of its own, all pairs and images one by one, that shares
//! nothing with the engine's.
#![allow(clippy::unwrap_used)]

use std::cell::Cell;

use packstone_engine::packing::EdmdEnd;
use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::{Control, Limits, NotReached, PackError, Packing, PackingRequest, Progress, pack};
use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestRunner};
use serde_json::{Value, json};

fn request(value: &Value, seed: u64) -> PackingRequest {
    PackingRequest::from_json(value, seed).unwrap()
}

/// Loses patience after so many questions whether to stop, so that a run which never ends fails its
/// test instead of hanging it.
struct Patience {
    questions: Cell<u64>,
    most: u64,
}

impl Patience {
    fn new(most: u64) -> Self {
        Self { questions: Cell::new(0), most }
    }
}

impl Control for Patience {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        self.questions.set(self.questions.get() + 1);
        self.questions.get() > self.most
    }
}

/// Clear distance that a rule of the request asks of two grains, and of one and a wall. `maximized` is
/// what was found to be the largest distance.
fn rule(distance: &Distance, maximized: f64, d_i: f64, d_j: f64) -> (f64, f64) {
    let (gap, wall) = match *distance {
        Distance::None { wall_mm } => (0.0, wall_mm),
        Distance::Constant { mm, wall_mm } => (mm, wall_mm),
        Distance::Proportional { factor, wall_mm } => (factor * (d_i + d_j) / 2.0, wall_mm),
        Distance::SmallerDiameter { factor, wall_mm } => (factor * d_i.min(d_j), wall_mm),
        Distance::Maximize { wall_mm } => (maximized, wall_mm),
    };
    (gap, wall.unwrap_or(gap / 2.0))
}

/// Says what is wrong with a packing: every grain against every other in all 125 images near by, against
/// its own images and against every wall.
fn fault(packing: &Packing, request: &PackingRequest) -> Option<String> {
    let spheres = &packing.spheres;
    let maximized = packing.report.summary.distance_mm.unwrap_or(0.0);
    let periodic = matches!(request.specimen, Specimen::Box { boundary: Boundary::Periodic, .. });
    let size = match request.specimen {
        Specimen::Box { size_mm, .. } => size_mm,
        Specimen::Cylinder { diameter_mm, height_mm } => [diameter_mm, diameter_mm, height_mm],
    };
    let images: Vec<[f64; 3]> = if periodic {
        let of = |code: usize, a: usize| (code as f64 - 2.0) * size[a];
        (0..125).map(|code| [of(code / 25, 0), of(code / 5 % 5, 1), of(code % 5, 2)]).collect()
    } else {
        vec![[0.0; 3]]
    };
    for i in 0..spheres.len() {
        let (p, d_i) = (spheres.center(i), spheres.d_mm[i]);
        for j in i..spheres.len() {
            let (q, d_j) = (spheres.center(j), spheres.d_mm[j]);
            let (gap, _) = rule(&request.distance, maximized, d_i, d_j);
            for shift in images.iter().filter(|shift| i != j || **shift != [0.0; 3]) {
                let way: [f64; 3] = std::array::from_fn(|a| q[a] + shift[a] - p[a]);
                let clear = way.iter().map(|x| x * x).sum::<f64>().sqrt() - (d_i + d_j) / 2.0;
                if clear.is_nan() || clear < gap {
                    return Some(format!(
                        "{i} and {j}, shifted by {shift:?}: {clear:e} instead of {gap:e} mm"
                    ));
                }
            }
        }
        // The wall asks of a grain half of what its own kind does.
        let (_, wall) = rule(&request.distance, maximized, d_i, d_i);
        let walls: Vec<f64> = match request.specimen {
            // No walls, but every grain is named by its image inside.
            _ if periodic => {
                (0..3).flat_map(|a| [p[a] + d_i / 2.0 + wall, size[a] - p[a] + d_i / 2.0 + wall]).collect()
            }
            Specimen::Box { .. } => (0..3).flat_map(|a| [p[a], size[a] - p[a]]).collect(),
            Specimen::Cylinder { diameter_mm: d, height_mm } => {
                vec![d / 2.0 - (p[0] - d / 2.0).hypot(p[1] - d / 2.0), p[2], height_mm - p[2]]
            }
        };
        for from_wall in walls {
            let clear = from_wall - d_i / 2.0;
            if clear.is_nan() || clear < wall {
                return Some(format!("{i} to a wall: {clear:e} instead of {wall:e} mm"));
            }
        }
    }
    None
}

/// A specimen with edges of 5 to 40 mm.
fn specimen() -> impl Strategy<Value = Value> {
    let edge = || 5.0..40.0_f64;
    prop_oneof![
        (edge(), edge(), edge(), any::<bool>()).prop_map(|(x, y, z, periodic)| {
            json!({"type": "box", "size_mm": [x, y, z], "boundary": if periodic { "periodic" } else { "walls" }})
        }),
        (edge(), edge()).prop_map(|(d, h)| json!({"type": "cylinder", "diameter_mm": d, "height_mm": h})),
    ]
}

/// Sizes of 1 to 60 grains, in any unit, with a ratio of up to 32.
fn sizes() -> impl Strategy<Value = Vec<f64>> {
    let spread = prop_oneof![Just(0.0), 0.0..5.0_f64];
    (prop::collection::vec(0.0..1.0_f64, 1..=60), spread)
        .prop_map(|(of_spread, octaves)| of_spread.into_iter().map(|u| (octaves * u).exp2()).collect())
}

/// A rule, its lengths in shares of the smallest diameter.
fn distance() -> impl Strategy<Value = Value> {
    let wall = || prop::option::of(0.0..1.0_f64);
    let with = |mut rule: Value, wall: Option<f64>| {
        if let Some(mm) = wall {
            rule["wall_mm"] = json!(mm);
        }
        rule
    };
    prop_oneof![
        wall().prop_map(move |w| with(json!({"type": "none"}), w)),
        (0.0..1.0_f64, wall()).prop_map(move |(mm, w)| with(json!({"type": "constant", "mm": mm}), w)),
        (0.0..0.4_f64, wall()).prop_map(move |(f, w)| with(json!({"type": "proportional", "factor": f}), w)),
        (0.0..0.6_f64, wall())
            .prop_map(move |(f, w)| with(json!({"type": "smaller_diameter", "factor": f}), w)),
        wall().prop_map(move |w| with(json!({"type": "maximize"}), w)),
    ]
}

fn method() -> impl Strategy<Value = Value> {
    let power = |from: f64, to: f64| (from..to).prop_map(|exponent| 10.0_f64.powf(exponent));
    let options = (
        prop::option::of(0.5..=1.0_f64),
        prop::option::of(power(-3.0, 3.0)),
        prop::option::of(power(-2.0, 2.0)),
        prop::option::of(any::<bool>()),
        prop::option::of(any::<bool>()),
        prop_oneof![1..200_u64, 200..20_000_u64, Just(20_000_u64)],
        prop::option::of(power(-12.0, -3.0)),
    );
    options.prop_map(
        |(initial_scale, growth_rate, initial_velocity, equal_mass, swap, events, stall_dt_s)| {
            json!({
                "type": "edmd", "initial_scale": initial_scale, "growth_rate": growth_rate,
                "initial_velocity": initial_velocity, "equal_mass": equal_mass, "swap": swap,
                "stop": {"events": events, "stall_dt_s": stall_dt_s},
            })
        },
    )
}

fn without_nulls(value: &mut Value) {
    if let Value::Object(map) = value {
        map.retain(|_, field| !field.is_null());
        map.values_mut().for_each(without_nulls);
    }
}

/// A small mix whose grains fill a given share of its specimen.
fn small_mix() -> impl Strategy<Value = (Value, u64)> {
    (specimen(), sizes(), distance(), method(), 0.01..0.68_f64, 0_u64..1_000_000).prop_map(
        |(specimen, sizes, mut distance, mut method, fraction, seed)| {
            let volume = match (&specimen["size_mm"], &specimen["diameter_mm"], &specimen["height_mm"]) {
                (Value::Array(edges), ..) => edges.iter().map(|l| l.as_f64().unwrap()).product::<f64>(),
                (_, d, h) => std::f64::consts::FRAC_PI_4 * d.as_f64().unwrap().powi(2) * h.as_f64().unwrap(),
            };
            let filled: f64 = sizes.iter().map(|d| std::f64::consts::FRAC_PI_6 * d.powi(3)).sum();
            let unit = (fraction * volume / filled).cbrt();
            let mm: Vec<f64> = sizes.iter().map(|d| unit * d).collect();
            let least = mm.iter().copied().fold(f64::INFINITY, f64::min);
            for length in ["mm", "wall_mm"] {
                if let Some(share) = distance[length].as_f64() {
                    distance[length] = json!(share * least);
                }
            }
            without_nulls(&mut method);
            let mix = json!({"grading": {"type": "diameters", "mm": mm}});
            (json!({"specimen": specimen, "mix": mix, "distance": distance, "method": method}), seed)
        },
    )
}

/// The requests that a fresh generator finds wrong again and again, each with a test of its own below.
fn is_known_defect(value: &Value) -> bool {
    let distance = &value["distance"];
    distance["type"] == "maximize"
        && (!distance["wall_mm"].is_null() || value["specimen"]["boundary"] == "periodic")
}

/// Packs random small mixes, but for the discarded ones, and returns how many were valid, fell short
/// and did not fit.
fn pack_random_small_mixes(cases: u32, discard: fn(&Value) -> bool) -> [u32; 3] {
    let (valid, short, unfit) = (Cell::new(0), Cell::new(0), Cell::new(0));
    let count = |cell: &Cell<u32>| cell.set(cell.get() + 1);
    let config = ProptestConfig { source_file: Some(file!()), ..ProptestConfig::with_cases(cases) };
    let tried = TestRunner::new(config).run(&small_mix(), |(value, seed)| {
        prop_assume!(!discard(&value));
        let request = request(&value, seed);
        match pack(&request, &Limits::default(), &Patience::new(100_000)) {
            Ok(packing) => {
                count(&valid);
                prop_assert_eq!(fault(&packing, &request), None);
                let grown = packing.report.statistics.edmd.unwrap();
                prop_assert_eq!(grown.growth_scale, 1.0);
                prop_assert_eq!(grown.grain_collisions + grown.wall_collisions, grown.events);
                let swaps = value["method"]["swap"] != json!(false);
                prop_assert!(swaps || grown.swaps_tried == 0);
            }
            Err(PackError::NotReached(NotReached::NotGrown(not_grown))) => {
                count(&short);
                prop_assert!(not_grown.scale_reached < 1.0, "{}", not_grown);
                prop_assert!(
                    matches!(not_grown.end, EdmdEnd::Stalled | EdmdEnd::EventLimit),
                    "{}",
                    not_grown
                );
                prop_assert!(
                    not_grown.volume_fraction_reached < not_grown.volume_fraction_asked,
                    "{}",
                    not_grown
                );
            }
            Err(PackError::Plan(_)) => count(&unfit),
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        }
        Ok(())
    });
    let counts = [valid.get(), short.get(), unfit.get()];
    if let Err(error) = tried {
        panic!("{error}\nafter {counts:?}");
    }
    counts
}

#[test]
fn random_small_mixes_grow_valid_or_say_why_not() {
    let [valid, short, unfit] = pack_random_small_mixes(500, is_known_defect);
    // The mixes are worth trying: most are planned, and many of them reached.
    assert!(valid >= 100 && short >= 50 && unfit <= 300, "{valid} valid, {short} short, {unfit} unfit");
}

#[test]
#[ignore = "defect: maximize meets neither own images nor keeps a margin to walls at a distance of their own"]
fn random_small_mixes_grow_valid_whatever_they_are() {
    pack_random_small_mixes(500, |_| false);
}

/// A job on its own specimen, with a limit of events.
fn job(specimen: &Value, mix: &Value, distance: &Value, method: &Value) -> Value {
    let mut method = method.clone();
    method["type"] = json!("edmd");
    if method["stop"].is_null() {
        method["stop"] = json!({"events": 20_000});
    }
    json!({"specimen": specimen, "mix": mix, "distance": distance, "method": method})
}

fn cube(edge: f64, boundary: &str) -> Value {
    json!({"type": "box", "size_mm": [edge, edge, edge], "boundary": boundary})
}

fn diameters(mm: &[f64]) -> Value {
    json!({"grading": {"type": "diameters", "mm": mm}})
}

/// Packs with the patience of a run that ends, and checks what comes out.
fn grown(value: &Value, seed: u64) -> Result<Packing, PackError> {
    let request = request(value, seed);
    let packing = pack(&request, &Limits::default(), &Patience::new(100_000))?;
    assert_eq!(fault(&packing, &request), None);
    Ok(packing)
}

#[test]
#[ignore = "defect: a grain does not meet its own images"]
fn the_largest_distance_in_a_periodic_box_is_kept_from_own_images() {
    let value = job(
        &cube(10.0, "periodic"),
        &diameters(&[9.0, 0.5, 0.5, 0.5]),
        &json!({"type": "maximize"}),
        &json!({}),
    );
    let packing = grown(&value, 0).unwrap();
    let distance = packing.report.summary.distance_mm.unwrap();
    assert!(distance <= 1.0 && distance > 0.99, "{distance}");
}

#[test]
#[ignore = "defect: panics in image_code"]
fn one_grain_in_a_periodic_box_keeps_the_largest_distance_from_itself() {
    let value = job(&cube(10.0, "periodic"), &diameters(&[2.0]), &json!({"type": "maximize"}), &json!({}));
    let packing = grown(&value, 0).unwrap();
    assert!((packing.report.summary.distance_mm.unwrap() - 8.0).abs() < 1e-4);
}

#[test]
#[ignore = "defect: never ends"]
fn one_grain_with_walls_at_a_distance_of_their_own_has_no_distance_to_maximize() {
    let maximize = json!({"type": "maximize", "wall_mm": 0.0});
    let value = job(&cube(10.0, "walls"), &diameters(&[2.0]), &maximize, &json!({"stop": {}}));
    match grown(&value, 0) {
        // Either is a clear answer; a distance larger than the specimen is none.
        Err(PackError::Plan(_)) => {}
        Ok(packing) => assert!(packing.report.summary.distance_mm.unwrap() <= 10.0),
        Err(other) => panic!("{other}"),
    }
}

#[test]
#[ignore = "defect: the stall criterion does not scale with the velocity"]
fn grains_do_not_stall_because_they_are_fast_or_small() {
    let mix =
        |mm: f64| json!({"grading": {"type": "monodisperse", "diameter_mm": mm}, "volume_fraction": 0.45});
    let none = json!({"type": "none"});
    let stop = json!({"stop": {"events": 200_000}});
    let slow = grown(&job(&cube(80.0, "walls"), &mix(8.0), &none, &stop), 0).unwrap();
    let mut fast = stop.clone();
    fast["initial_velocity"] = json!(1e6);
    let fast = grown(&job(&cube(80.0, "walls"), &mix(8.0), &none, &fast), 0).unwrap();
    let small = grown(&job(&cube(8e-5, "walls"), &mix(8e-6), &none, &stop), 0).unwrap();
    for packing in [slow, fast, small] {
        assert_eq!(packing.report.statistics.edmd.unwrap().stop, EdmdEnd::Target);
    }
}

#[test]
#[ignore = "defect: numbers underflow to NaN"]
fn the_smallest_numbers_a_request_may_have_are_refused_or_served() {
    for method in [json!({"initial_velocity": 1e-200}), json!({"growth_rate": 5e-324})] {
        let value =
            job(&cube(20.0, "walls"), &diameters(&[8.0, 6.0, 5.0]), &json!({"type": "none"}), &method);
        let Ok(request) = PackingRequest::from_json(&value, 0) else { continue };
        let ended = pack(&request, &Limits::default(), &Patience::new(100_000));
        assert!(matches!(ended, Ok(_) | Err(PackError::NotReached(_))), "{method}: {ended:?}");
    }
}

/// Small grains of 0.5 mm, thousands of them, among few that are 32 times as wide.
#[test]
fn grains_of_very_different_sizes_grow_valid() {
    let fuller = json!({"type": "fuller", "d_max_mm": 16.0, "exponent": 0.5});
    let mix = json!({"grading": fuller, "d_min_mm": 0.5, "volume_fraction": 0.6, "basis": "effective"});
    let method = json!({"initial_scale": 0.97, "stop": {"events": 2_000_000}});
    for specimen in [cube(22.0, "walls"), cube(22.0, "periodic")] {
        let packing =
            grown(&job(&specimen, &mix, &json!({"type": "smaller_diameter", "factor": 0.05}), &method), 1)
                .unwrap();
        let summary = packing.report.summary;
        assert!(summary.grains > 3000 && summary.d_max_mm > 20.0 * summary.d_min_mm, "{summary:?}");
        assert_eq!(packing.report.statistics.edmd.unwrap().stop, EdmdEnd::Target);
    }
}

/// The usual mixture that does not crystallise, 1 to 1.4; jams at 0.64 to 0.65 where there are no walls.
#[test]
fn a_bidisperse_mixture_jams_at_random_close_packing() {
    let mm: Vec<f64> = (0..80).map(|i| if i < 40 { 1.4 } else { 1.0 }).collect();
    let method = json!({"stop": {"stall_dt_s": 1e-7}});
    let value = job(&cube(10.0, "periodic"), &diameters(&mm), &json!({"type": "maximize"}), &method);
    let packing = grown(&value, 2).unwrap();
    let end = packing.report.statistics.edmd.unwrap();
    assert_eq!(end.stop, EdmdEnd::Stalled);
    assert!(end.reduced_pressure > 1e6, "{}", end.reduced_pressure);
    // The same length is added to all, so that the ratio of sizes shrinks.
    let fraction = packing.report.summary.volume_fraction_with_coating;
    assert!(fraction > 0.61 && fraction < 0.67, "{fraction}");
}

/// The grains of a crowded cube of 20 mm.
const CROWDED_MM: [f64; 13] = [10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0];

#[test]
#[ignore = "defect: no margin for rounding where growth got nowhere"]
fn growth_that_gets_nowhere_is_valid_all_the_same() {
    let method = json!({"initial_scale": 1.0, "growth_rate": 1e-18, "stop": {"events": 200}});
    let value = job(&cube(20.0, "walls"), &diameters(&CROWDED_MM), &json!({"type": "maximize"}), &method);
    for seed in 0..6 {
        grown(&value, seed).unwrap();
    }
}

#[test]
#[ignore = "defect: a size just short of its margin passes for the target"]
fn a_target_is_reached_with_its_margin_or_not_at_all() {
    let method = json!({"initial_scale": 1.0, "growth_rate": 1e-12, "stop": {"events": 200}});
    let value = job(&cube(20.0, "walls"), &diameters(&CROWDED_MM), &json!({"type": "none"}), &method);
    for seed in 0..6 {
        if let Ok(packing) = grown(&value, seed) {
            assert_eq!(packing.report.statistics.edmd.unwrap().stop, EdmdEnd::Target);
        }
    }
}

#[test]
#[ignore = "defect: no margin to walls at a distance of their own"]
fn the_largest_distance_leaves_the_walls_theirs() {
    let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 3.0}, "volume_fraction": 0.3});
    let value = job(&cube(20.0, "walls"), &mix, &json!({"type": "maximize", "wall_mm": 0.3}), &json!({}));
    for seed in 0..10 {
        grown(&value, seed).unwrap();
    }
}
