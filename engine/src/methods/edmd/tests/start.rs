//! Growth that finds no start.

use std::num::NonZeroUsize;

use serde_json::json;

use crate::PackingRequest;
use crate::control::Unattended;
use crate::methods::edmd::{Edmd, Expected, Interrupted};
use crate::request::GrowthOptions;

/// A grain that fits at none of the sizes that are tried, which a plan refuses: the run says so, and not that it was
/// stopped on request.
#[test]
fn a_start_that_fails_has_a_reason_of_its_own() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [10, 10, 10]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [100]}, "allow_coarse": true},
        "method": {"type": "edmd"},
    });
    let request = PackingRequest::from_json(&value, 1).unwrap();
    let edmd = Edmd {
        request: &request,
        options: GrowthOptions { initial_scale: Some(1.0), ..GrowthOptions::default() },
        diameters_mm: &[100.0],
        expected: Expected { start_fraction: 0.3, start_work: 0.0, events_per_grain: 100.0 },
        threads: NonZeroUsize::MIN,
        to_jamming: None,
    };
    assert_eq!(edmd.run(None, &Unattended).err(), Some(Interrupted::NoStart));
}
