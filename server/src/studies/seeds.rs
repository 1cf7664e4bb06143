//! The seeds of a study's jobs, by a rule that `docs/studies.md` documents.
//!
//! A seed consists of bits of a SHA-256 digest of the study's seed, the values of the point's columns, and the number
//! of the replicate. It does not depend on the other points, so that a study to which values are added packs its
//! earlier points again with the same seeds. Columns of the method are left out, so that points that differ only in the
//! method pack the same grains.

use std::fmt::Write as _;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::pointer::Pointer;

/// State of the digest from which the seeds of one point are computed.
pub(super) struct Seeds(Sha256);

impl Seeds {
    /// Of a point with these values of the columns.
    pub(super) fn of_point<'a>(study: u64, columns: impl Iterator<Item = (&'a Pointer, &'a Value)>) -> Self {
        let mut text = format!("{study}\n");
        for (pointer, value) in columns.filter(|(pointer, _)| !is_of_method(pointer)) {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{}={value}", pointer.text());
        }
        Self(Sha256::new().chain_update(text))
    }

    /// Of a job in a list.
    pub(super) fn of_listed(study: u64, index: usize) -> Self {
        Self(Sha256::new().chain_update(format!("{study}\n{index}\n")))
    }

    /// The seed of a replicate: the first 53 bits, which JSON's numbers hold exactly everywhere.
    pub(super) fn replicate(&self, replicate: usize) -> u64 {
        let digest = self.0.clone().chain_update(replicate.to_string()).finalize();
        let mut first = [0; 8];
        first.copy_from_slice(&digest[..8]);
        u64::from_be_bytes(first) >> 11
    }
}

fn is_of_method(pointer: &Pointer) -> bool {
    pointer.text() == "/method" || pointer.text().starts_with("/method/")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::request::MAX_SEED;
    use serde_json::json;

    use super::*;

    fn seeds(study: u64, columns: &[(&str, Value)]) -> Seeds {
        let columns: Vec<(Pointer, &Value)> =
            columns.iter().map(|(text, value)| (Pointer::parse(text).unwrap(), value)).collect();
        Seeds::of_point(study, columns.iter().map(|(pointer, value)| (pointer, *value)))
    }

    #[test]
    fn the_rule_is_the_documented_one() {
        // Computed by printf '7\n/mix/volume_fraction=0.585\n3' | sha256sum
        let columns = [("/mix/volume_fraction", json!(0.585)), ("/method", json!({"type": "rsa"}))];
        assert_eq!(seeds(7, &columns).replicate(3), 6_344_574_446_870_587);
        // printf '7\n12\n0' | sha256sum
        assert_eq!(Seeds::of_listed(7, 12).replicate(0), 7_236_355_544_667_979);
    }

    #[test]
    fn the_method_does_not_change_the_seed_and_all_else_does() {
        let phi = ("/mix/volume_fraction", json!(0.5));
        let of = |columns: &[(&str, Value)]| seeds(1, columns).replicate(0);
        let one = of(std::slice::from_ref(&phi));
        assert_eq!(of(&[phi.clone(), ("/method/type", json!("edmd"))]), one);
        assert_ne!(of(&[phi.clone(), ("/methods", json!("edmd"))]), one);
        assert_ne!(of(&[("/mix/volume_fraction", json!(0.505))]), one);
        assert_ne!(seeds(2, std::slice::from_ref(&phi)).replicate(0), one);
        assert_ne!(seeds(1, &[phi]).replicate(1), one);
    }

    #[test]
    fn seeds_are_valid_and_differ() {
        let point = seeds(1, &[]);
        let mut drawn: Vec<u64> = (0..10_000).map(|replicate| point.replicate(replicate)).collect();
        assert!(drawn.iter().all(|seed| *seed <= MAX_SEED));
        assert!(drawn.iter().any(|seed| *seed > MAX_SEED / 2));
        drawn.sort_unstable();
        drawn.dedup();
        assert_eq!(drawn.len(), 10_000);
    }
}
