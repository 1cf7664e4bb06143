//! Whether two processes compute the same bits: the digest of small packings, which take a tenth of a second.
//!
//! A job that goes on elsewhere from its checkpoint must end with the bits of one that was not moved. The engine
//! computes the same on every processor and with every C library (`docs/method.md`, "Determinism"). A worker shows it
//! before it gets its first job.

use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::{Limits, PackError, PackingRequest, Unattended};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::hex;

/// Why there is no digest.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ProbeError {
    /// A packing was not made.
    #[error("the packing that shows the bits of this machine was not made: {0}")]
    Pack(#[from] PackError),
    /// Its request was refused, or it was not written.
    #[error("the packing that shows the bits of this machine was not made: {0}")]
    Other(String),
}

/// Grown spheres and dense ellipsoids: the methods with the longest chains of rounding.
fn requests() -> [Value; 2] {
    let box_of = |edge: f64| json!({"type": "box", "size_mm": [edge, edge, edge]});
    [
        json!({
            "specimen": box_of(40.0), "method": {"type": "edmd"},
            "mix": {"grading": {"type": "fuller", "exponent": 0.5, "d_max_mm": 12}, "d_min_mm": 4, "volume_fraction": 0.55},
        }),
        json!({
            "specimen": box_of(30.0), "method": {"type": "monte_carlo"},
            "mix": {
                "grading": {"type": "fuller", "exponent": 0.5, "d_max_mm": 10}, "d_min_mm": 5, "volume_fraction": 0.45,
                "shape": {
                    "type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}
                },
            },
        }),
    ]
}

/// SHA-256 of the packings, in hexadecimal.
///
/// # Errors
/// See [`ProbeError`].
pub(crate) fn bits() -> Result<String, ProbeError> {
    let mut digest = Sha256::new();
    for request in requests() {
        let read = PackingRequest::from_json(&request, 1).map_err(|faults| {
            ProbeError::Other(faults.first().map_or_else(String::new, ToString::to_string))
        })?;
        let packed = packstone_engine::pack(&read, &Limits::default(), &Unattended)?;
        let head = Head { job_id: None, request, engine: EngineInfo::current(), report: packed.report };
        tables::write(Format::Npy, &head, &packed.grains, &mut digest)
            .map_err(|error| ProbeError::Other(error.to_string()))?;
    }
    Ok(hex::encode(&digest.finalize()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_bits_are_the_same_each_time() {
        assert_eq!(bits().unwrap(), bits().unwrap());
    }
}
