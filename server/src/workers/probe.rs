//! Whether two processes compute the same bits: the digest of small packings, which take a tenth of a second, and of
//! the elementary functions.
//!
//! A job that goes on elsewhere from its checkpoint must end with the bits of one that was not moved. A worker shows it
//! before it gets its first job. The engine's own code computes the same on every processor, which its tests hold; the
//! elementary functions are those of the C library, and their last digits differ between libraries and between
//! processors with and without fused multiply-add (`docs/method.md`, "Determinism"). A small packing need not meet an
//! argument for which they do.

use std::hint::black_box;

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

/// For how many arguments each elementary function is compared.
const ARGUMENTS: u32 = 10_000;

/// Adds values of the elementary functions that the engine takes from the C library to a digest, for arguments between
/// -7 and 100.
fn elementary_functions(digest: &mut Sha256) {
    for i in 0..ARGUMENTS {
        // Hidden from the compiler, which computes constants by functions of its own.
        let x = black_box((f64::from(i) + 0.5) / f64::from(ARGUMENTS));
        let (large, signed) = (100.0 * x, 2.0 * x - 1.0);
        let values = [
            large.powf(3.0 * signed),
            x.powf(large),
            large.hypot(x),
            (7.0 * signed).exp(),
            (7.0 * signed).exp2(),
            signed.exp_m1(),
            large.ln(),
            x.ln_1p(),
            large.log2(),
            large.log10(),
            large.sin(),
            large.cos(),
            signed.tan(),
            signed.asin(),
            signed.acos(),
            signed.atan2(x),
        ];
        for value in values {
            digest.update(value.to_le_bytes());
        }
    }
}

/// SHA-256 of the packings and of the values of elementary functions, in hexadecimal.
///
/// # Errors
/// See [`ProbeError`].
pub(crate) fn bits() -> Result<String, ProbeError> {
    let mut digest = Sha256::new();
    elementary_functions(&mut digest);
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
