//! How fast this processor is, for the times that plans tell.
//!
//! A plan has the work of a run in operations. The time of an operation is measured once in a process, where times are
//! shown: by a small packing, made a few times, of which the fastest counts. The speed is rounded to steps, so that
//! measurements that differ a little give one speed.

use std::sync::LazyLock;

use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;

/// CPU time of the small packing on the core of 2 GHz that the times of plans are of, in s.
const REFERENCE_S: f64 = 0.0093;
/// How often it is made.
const REPEATS: usize = 3;
/// Speeds differ by a power of this factor.
const STEP: f64 = 1.5;
/// Slowest and fastest that is believed.
const BOUNDS: [f64; 2] = [0.05, 20.0];

/// Speed of this processor over that of a core of 2 GHz.
pub(crate) fn speed() -> f64 {
    static SPEED: LazyLock<f64> = LazyLock::new(|| stepped(measured()));
    *SPEED
}

fn measured() -> f64 {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 3}, "volume_fraction": 0.55},
        "method": {"type": "edmd"},
    });
    let Ok(request) = PackingRequest::from_json(&request, 1) else { return 1.0 };
    let seconds = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    };
    let taken = (0..REPEATS).filter_map(|_| {
        let start = seconds();
        pack(&request, &Limits::default(), &Unattended).ok().map(|_| seconds() - start)
    });
    taken.reduce(f64::min).map_or(1.0, |fastest| REFERENCE_S / fastest.max(1e-9))
}

fn stepped(speed: f64) -> f64 {
    let [slowest, fastest] = BOUNDS;
    STEP.powf((speed.clamp(slowest, fastest).ln() / STEP.ln()).round())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_is_measured_once_and_has_steps() {
        assert_eq!(speed(), speed());
        assert!((0.02..50.0).contains(&speed()));
        for same in [0.85, 1.0, 1.2] {
            assert_eq!(stepped(same), 1.0);
        }
        assert_eq!(stepped(1.4), 1.5);
        assert_eq!(stepped(0.7), 1.0 / 1.5);
        assert!(stepped(0.0) > 0.03 && stepped(f64::INFINITY) < 30.0);
    }
}
