//! Jobs to send: named by what a test needs of them, not by their numbers.

use serde_json::{Value, json};

/// Some hundred grains of A16 in a 40 mm cube: done in a blink.
pub(crate) fn quick(seed: u64) -> Value {
    json!({
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [40, 40, 40], "boundary": "walls"},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.40},
        "distance": {"type": "constant", "mm": 0.2}
    })
}

/// About `grains` equal spheres, of which a computer places some hundred thousand a second.
pub(crate) fn equal_spheres(grains: u32, seed: u64) -> Value {
    let volume_mm3 = f64::from(grains) * std::f64::consts::PI / 6.0;
    let edge_mm = (volume_mm3 / 0.25).cbrt();
    json!({
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": 0.25}
    })
}

/// Runs until it is stopped: random addition of equal spheres jams near 0.38, so that a fraction of 0.5
/// is not reached in 10^12 attempts, though spheres can be packed so densely.
pub(crate) fn endless() -> Value {
    json!({
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1.0}, "volume_fraction": 0.5},
        "method": {"type": "rsa", "attempts_per_grain": 1_000_000_000_000_u64}
    })
}

/// Ends soon as `packing-not-reached`, for the reason that [`endless`] does not end.
pub(crate) fn unreachable() -> Value {
    let mut job = endless();
    job["method"]["attempts_per_grain"] = json!(1000);
    job
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
