//! Start-time fair queueing of jobs of unit cost (Goyal, Vin and Cheng 1996, <https://doi.org/10.1145/248156.248171>),
//! first between owners, then between the flows of an owner.
//!
//! Owners: a worker takes a job of the owner with the smallest virtual start time max(V, F), where F is one more than
//! that of the owner's job that started last, and the virtual time V is the largest of all owners. So owners whose jobs
//! wait alternate, however many jobs and studies each has and whatever their priorities are; an owner who had no job
//! waiting, or whose jobs were held back by a quota, saves no turns up. Ties go to the oldest of the first jobs.
//!
//! Flows: jobs of one owner and one priority start in the order of their virtual start times, the column `turn`. A flow
//! is a study, or all single jobs together; its jobs have consecutive start times, S(k) = max(V, S(k-1) + 1). The
//! virtual time V is the start time of the job that started last. So waiting flows alternate: a job that is submitted
//! while ten thousand jobs of a study wait starts next, and the study still gets every other start. Each priority of
//! each owner has a virtual time of its own, so that jobs of a higher priority do not advance that of a lower one.

use super::StoreError;
use super::db::{Transaction, query};

/// Number of the flow of all jobs of an owner that belong to no study.
pub(super) const SINGLE_JOBS: i64 = 0;

/// Jobs of one owner and one priority that start one after another: those of a study, or all single ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flow<'a> {
    pub(super) owner: &'a str,
    /// Number of the study, or [`SINGLE_JOBS`].
    pub(super) number: i64,
    pub(super) priority: i64,
}

/// Assigns the next `jobs` virtual start times of a flow, and returns the first of them.
pub(super) async fn assign_start_times(
    tx: &mut Transaction<'_>,
    flow: Flow<'_>,
    jobs: i64,
) -> Result<i64, StoreError> {
    let last: i64 = query(
        "insert into queue_owner_flows (owner, flow, priority, last_turn)
         values (?4, ?1, ?2,
             coalesce((select turn from queue_starts where owner = ?4 and priority = ?2), 0) + ?3 - 1)
         on conflict (owner, flow, priority) do update set last_turn =
             ?3 + case
                 when queue_owner_flows.last_turn
                     < coalesce((select turn from queue_starts where owner = ?4 and priority = ?2), 0)
                 then (select turn from queue_starts where owner = ?4 and priority = ?2) - 1
                 else queue_owner_flows.last_turn
             end
         returning last_turn",
    )
    .bind(flow.number)
    .bind(flow.priority)
    .bind(jobs)
    .bind(flow.owner)
    .fetch_one(tx)
    .await?
    .try_get("last_turn")?;
    Ok(last - jobs + 1)
}
