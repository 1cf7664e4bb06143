//! Jobs to send: named by what a test needs of them, not by their numbers.

use serde_json::{Value, json};

/// Some hundred grains of A16 in a 40 mm cube: done in a blink.
pub(crate) fn quick(seed: u64) -> Value {
    json!({
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [40, 40, 40], "boundary": "walls"},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.40},
        "distance": {"type": "constant", "gap_mm": 0.2}
    })
}

/// About `grains` equal spheres, of which a computer places some hundred thousand a second.
pub(crate) fn equal_spheres(grains: u32, seed: u64) -> Value {
    equal_spheres_at(0.25, grains, seed)
}

fn equal_spheres_at(volume_fraction: f64, grains: u32, seed: u64) -> Value {
    let volume_mm3 = f64::from(grains) * std::f64::consts::PI / 6.0;
    let edge_mm = libm::cbrt(volume_mm3 / volume_fraction);
    json!({
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": volume_fraction}
    })
}

/// Runs until it is stopped, as far as a test is concerned: equal spheres added at random jam near 0.384,
/// and to find every place that is left for the last of a million takes minutes. It holds one worker slot.
pub(crate) fn endless() -> Value {
    let job = with(equal_spheres_at(0.39, 1_000_000, 1), "/name", json!("endless"));
    let job = with(job, "/threads", json!(1));
    with(job, "/method", json!({"type": "rsa"}))
}

/// Ends soon as `target-not-reached`, for the reason that [`endless`] takes so long.
pub(crate) fn unreachable() -> Value {
    with(equal_spheres_at(0.5, 5000, 1), "/method", json!({"type": "rsa", "attempts_per_grain": 1000}))
}

/// Some hundred grains that random placing does not fit in, and growth does in a blink.
pub(crate) fn quick_growth(seed: u64) -> Value {
    json!({
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4.0, "volume_fraction": 0.50},
        "distance": {"type": "constant", "gap_mm": 0.5},
        "method": {"type": "edmd"}
    })
}

/// The job of the contract: 5000 grains of A16 in an 80 mm cube with a distance of 1 mm, some seconds of growth.
pub(crate) fn contract() -> Value {
    json!({
        "name": "A16 cube", "seed": 7,
        "specimen": {"type": "box", "size_mm": [80, 80, 80], "boundary": "walls"},
        "mix": {
            "grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0,
            "volume_fraction": 0.535, "volume_fraction_of": "all_aggregate"
        },
        "distance": {"type": "constant", "gap_mm": 1.0},
        "method": {"type": "edmd"}
    })
}

/// The same mix with 2600 grains in a cube of 64 mm: a second of growth, in which a test can interrupt it.
pub(crate) fn growth() -> Value {
    let job = with(contract(), "/specimen/size_mm", json!([64, 64, 64]));
    with(job, "/mix/volume_fraction", json!(0.53))
}

/// Grows until it is stopped, as far as a test is concerned: a distance that takes minutes to find out.
pub(crate) fn endless_growth() -> Value {
    let job = with(contract(), "/distance", json!({"type": "maximize"}));
    let job = with(job, "/specimen/size_mm", json!([150, 150, 150]));
    with(job, "/method/stop", json!({"stall_dt_s": 1e-300}))
}

/// The same job with another value, or a field more, at a JSON pointer.
pub(crate) fn with(mut job: Value, pointer: &str, value: Value) -> Value {
    let (parent, field) = pointer.rsplit_once('/').expect("a pointer to a field");
    let parent = job.pointer_mut(parent).expect("a parent to put the field into");
    match parent {
        Value::Array(items) => items[field.parse::<usize>().expect("an index")] = value,
        other => other[field] = value,
    }
    job
}
