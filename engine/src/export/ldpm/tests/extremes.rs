//! Whatever the options, a lattice is made or refused with what to change; a check that fails is a defect.

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use super::super::{Lattice, LatticeOptions};
use crate::Limits;
use crate::control::Unattended;
use crate::export::{ExportError, Model};
use crate::request::PackingRequest;
use crate::request::decode::{At, Faults};
use crate::run::pack;

/// A multiple of the smallest diameter: usual ones, and all that may be asked for.
fn multiple() -> impl Strategy<Value = f64> {
    prop_oneof![4 => 0.0..3.0_f64, 2 => (-3.0..2.0_f64).prop_map(|e| 10.0_f64.powf(e)), 1 => Just(100.0), 1 => Just(0.0)]
}

fn options() -> impl Strategy<Value = serde_json::Value> {
    (multiple(), multiple(), prop::option::of(multiple()), any::<bool>(), 0..1000_u32).prop_map(
        |(a, b, surface_radius, random, seed)| {
            let mut options = json!({
                "spacing": a.max(b).max(0.05), "fictitious_diameter": a.min(b), "seed": seed,
                "boundary_nodes": if random { "random" } else { "poisson_disk" },
            });
            if let Some(radius) = surface_radius {
                options["surface_radius"] = json!(radius);
            }
            options
        },
    )
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn any_options_make_a_lattice_or_are_refused_with_what_to_change(
        value in options(),
        cylinder in any::<bool>(),
        size in [10.0..30.0_f64, 10.0..30.0_f64, 10.0..30.0_f64],
        fraction in 0.01..0.3_f64,
        seed in 0..1000_u64,
    ) {
        let faults = Faults::default();
        let mut object = At::root(&value, &faults).object().unwrap();
        let Some(options) = LatticeOptions::read(&mut object) else { return Ok(()) };
        let specimen = if cylinder {
            json!({"type": "cylinder", "diameter_mm": size[0], "height_mm": size[2]})
        } else {
            json!({"type": "box", "size_mm": size})
        };
        let grading = json!({"type": "fuller", "d_max_mm": 9, "exponent": 0.5});
        let mix = json!({"grading": grading, "d_min_mm": 3, "volume_fraction": fraction});
        let request = PackingRequest::from_json(&json!({"specimen": specimen, "mix": mix}), seed).unwrap();
        let Ok(packing) = pack(&request, &Limits::default(), &Unattended) else { return Ok(()) };
        let model = Model::new(&request.specimen, packing.spheres().unwrap());
        // Enough for some 10 000 nodes: finer ones take long, and are no less regular.
        let limits = Limits { max_memory_bytes: 6_000_000, ..Limits::default() };
        match Lattice::make(&model, &options, &limits, &Unattended) {
            Ok(_) | Err(ExportError::Unavailable(_) | ExportError::TooLarge(_)) => {}
            Err(other) => prop_assert!(false, "{value} in {specimen}: {other}"),
        }
    }
}
