//! Packings of ellipsoids of fixed seeds keep their bits from commit to commit.
//!
//! The sums of random addition are those of commit 14806ae, the others those of the commit that keeps swaps within
//! skins: CRC-32 of the little-endian bytes of centres, orientations and semi-axes. A change that alters one bit of a
//! packing alters what a published seed means, and fails here. The sums hold on every machine, as those of spheres do.

use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

fn fingerprint(request: &Value) -> String {
    let request = PackingRequest::from_json(request, 0).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    let grains = packing.grains.solids().expect("the grains are no ellipsoids");
    let mut sum = crc32fast::Hasher::new();
    for (shape, pose) in grains.iter() {
        let coordinates = pose.center_mm.iter().chain(pose.orientation.coords.iter());
        for value in coordinates.chain(shape.ellipsoid().unwrap().semi_axes_mm().iter()) {
            sum.update(&value.to_le_bytes());
        }
    }
    format!("{:08x}", sum.finalize())
}

#[test]
fn packings_of_fixed_seeds_keep_their_bits() {
    let cube = |boundary| json!({"type": "box", "size_mm": [34, 32, 30], "boundary": boundary});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 32, "height_mm": 34});
    let triangle = json!({"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.3}});
    let flat =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.9, "flatness": 0.4}});
    let none = json!({"type": "none"});
    let cases = [
        ("rsa", cube("walls"), 0.4, &triangle, none.clone(), "f367fed3"),
        ("rsa", cube("periodic"), 0.4, &flat, json!({"type": "proportional", "factor": 0.05}), "57abdbf0"),
        ("rsa", cylinder.clone(), 0.35, &triangle, json!({"type": "constant", "gap_mm": 0.3}), "6b51b9b5"),
        (
            "rsa",
            cube("walls"),
            0.35,
            &flat,
            json!({"type": "smaller_diameter", "factor": 0.1, "wall_gap_mm": 0.2}),
            "75e96e3a",
        ),
        ("monte_carlo", cube("walls"), 0.6, &triangle, none.clone(), "a67d8f03"),
        (
            "monte_carlo",
            cube("periodic"),
            0.58,
            &triangle,
            json!({"type": "constant", "gap_mm": 0.05}),
            "aa1cc5ad",
        ),
        (
            "monte_carlo",
            cylinder.clone(),
            0.55,
            &flat,
            json!({"type": "proportional", "factor": 0.02}),
            "38521180",
        ),
        (
            "monte_carlo",
            cylinder,
            0.5,
            &triangle,
            json!({"type": "smaller_diameter", "factor": 0.06, "wall_gap_mm": 0.1}),
            "00dcac2b",
        ),
        ("maximize", cube("walls"), 0.45, &triangle, json!({"type": "maximize"}), "a3176264"),
        ("maximize", cube("periodic"), 0.45, &flat, json!({"type": "maximize"}), "7324db48"),
    ];
    let mut changed = Vec::new();
    for (number, (method, specimen, fraction, shape, distance, expected)) in cases.iter().enumerate() {
        let method = match *method {
            "maximize" => json!({"type": "monte_carlo", "stop": {"sweeps": 600}}),
            other => json!({"type": other}),
        };
        let found = fingerprint(&json!({
            "specimen": specimen, "distance": distance, "method": method,
            "mix": {
                "grading": {"type": "fuller", "d_max_mm": 10, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": fraction, "volume_fraction_of": "placed_grains", "shape": shape,
            },
        }));
        if found != *expected {
            changed.push(format!("{number}: {found}"));
        }
    }
    assert!(changed.is_empty(), "{changed:#?}");
}
