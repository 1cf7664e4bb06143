//! Why a job waits that no worker may start now.

use serde::{Deserialize, Serialize};

/// What a job waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum WaitsFor {
    /// Room for its result, on the disk or in a quota.
    Storage,
    /// Memory: its last attempt found none.
    Memory,
    /// The end of a fault of the machine that its last attempt met.
    Machine,
    /// The end of other jobs of its owner: as many run as may.
    RunningQuota,
}

/// Why a job waits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct WaitReason {
    #[serde(rename = "for")]
    pub(crate) waits_for: WaitsFor,
    /// One sentence for a person.
    pub(crate) detail: String,
}

impl WaitReason {
    /// The last attempt found no memory.
    pub(crate) fn memory() -> Self {
        let detail = "the last attempt found no memory: other programs or jobs had taken it".to_owned();
        Self { waits_for: WaitsFor::Memory, detail }
    }

    /// The last attempt met a fault of the machine.
    pub(crate) fn machine() -> Self {
        let detail =
            "a fault of the machine ended the last attempt; the log of the server or of the worker names it";
        Self { waits_for: WaitsFor::Machine, detail: detail.to_owned() }
    }

    /// As many jobs of the owner run as may.
    pub(crate) fn running_quota(running: u64, most: u64) -> Self {
        let detail = format!("as many jobs of its owner run as may: {running} of {most} (max_running)");
        Self { waits_for: WaitsFor::RunningQuota, detail }
    }
}
