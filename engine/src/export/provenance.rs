//! Where a packing comes from, as files of exports state it.

use serde_json::Value;

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
    /// Names of the aggregates in the order of the mix, as far as they have one; none where it names no aggregates.
    /// Groups of files have them, field data do not.
    pub aggregates: Vec<Option<String>>,
    /// Digest of the stored result, in hexadecimal, where there is one.
    pub result_sha256: Option<String>,
}

impl Provenance {
    /// The names of the aggregates that a request in its stored form has.
    #[must_use]
    pub fn aggregates_of(request: &Value) -> Vec<Option<String>> {
        let aggregates = request["mix"]["aggregates"].as_array().map_or(&[][..], Vec::as_slice);
        aggregates.iter().map(|aggregate| aggregate["name"].as_str().map(str::to_owned)).collect()
    }
}
