//! Where a packing comes from, as files of exports state it.

use super::tables::Head;

/// Where a packing comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Provenance {
    /// The job, where a service made the packing.
    pub job_id: Option<String>,
    /// Name of the job, where it has one.
    pub name: Option<String>,
    /// Seed of the packing.
    pub seed: Option<u64>,
    /// Version of the engine that made the packing.
    pub engine_version: String,
    /// Volume of all aggregate of the mix over that of the specimen.
    pub volume_fraction_mixture: f64,
    /// Volume of the grains placed over that of the specimen.
    pub volume_fraction_effective: f64,
    /// Digest of the stored result, in hexadecimal, where there is one.
    pub result_sha256: Option<String>,
}

impl From<&Head> for Provenance {
    fn from(head: &Head) -> Self {
        let summary = &head.report.summary;
        Self {
            job_id: head.job_id.clone(),
            name: head.request["name"].as_str().map(str::to_owned),
            seed: head.request["seed"].as_u64(),
            engine_version: head.engine.version.clone(),
            volume_fraction_mixture: summary.volume_fraction_mixture,
            volume_fraction_effective: summary.volume_fraction_effective,
            result_sha256: None,
        }
    }
}
