//! The provenance that tests write into files, and that `tests/python/provenance.py` expects of them.

use packstone_engine::export::Provenance;

/// A provenance with all its fields, one of which needs to be escaped in XML.
pub(crate) fn complete() -> Provenance {
    Provenance {
        job_id: Some("a job".into()),
        name: Some("a < b".into()),
        seed: Some(17),
        engine_version: "test".into(),
        volume_fraction_mixture: 0.5,
        volume_fraction_effective: 0.25,
        aggregates: Vec::new(),
        result_sha256: Some("ab".into()),
    }
}
