//! Changes that a client makes to a job: name, labels, priority, expiry, webhook.

use std::collections::BTreeMap;

use super::db::{Transaction, query};
use super::studies::runs;
use super::submit::to_json;
use super::{Store, StoreError, Target, rows, turns, webhooks};
use crate::jobs::request::{JobPatch, MAX_LABELS};
use crate::jobs::{JobId, JobRecord, State};

impl Store {
    /// Changes a job. A new priority moves a waiting job to the end of the queue of that priority.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::VersionDiffers`], [`StoreError::Forbidden`] for the priority of a job that
    /// no longer waits, [`StoreError::TooManyLabels`], or the database's.
    pub(crate) async fn patch(
        &self,
        job: impl Into<Target<JobId>>,
        patch: JobPatch,
    ) -> Result<JobRecord, StoreError> {
        let (store, target) = (self.clone(), job.into());
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let before = rows::by_id(&mut tx, target.id).await?;
            target.check(before.version)?;
            let priority = patch.priority.filter(|priority| *priority != before.priority);
            if let Some(priority) = priority {
                set_priority(&mut tx, &before, priority).await?;
            }
            if !patch.labels.is_empty() || patch.clear_labels {
                let labels = if patch.clear_labels { BTreeMap::new() } else { before.labels.clone() };
                set_labels(&mut tx, &before, merged(labels, patch.labels)?).await?;
            }
            query(
                "update jobs set name = case when ?2 then ?3 else name end,
                     expires_at = case when ?4 then ?5 else expires_at end,
                     shared = coalesce(?7, shared), version = version + 1, updated_at = ?6
                 where seq = ?1",
            )
            .bind(before.seq)
            .bind(patch.name.is_some())
            .bind(patch.name.value())
            .bind(patch.expires_at.is_some())
            .bind(patch.expires_at.value())
            .bind(store.now_us())
            .bind(patch.shared)
            .execute(&mut tx)
            .await?;
            webhooks::change(&mut tx, webhooks::Ending::Job(before.seq), &patch.webhook_url).await?;
            let job = rows::by_seq(&mut tx, before.seq).await?;
            tx.commit().await?;
            drop(writer);
            store.notify(job.id);
            if priority.is_some() {
                // A worker whose time is limited looks at the first jobs of the queue only.
                store.wake_worker();
            }
            Ok(job)
        })
        .await
    }
}

/// The labels with those of a patch; `None` removes a label.
fn merged(
    mut labels: BTreeMap<String, String>,
    patch: BTreeMap<String, Option<String>>,
) -> Result<BTreeMap<String, String>, StoreError> {
    for (key, value) in patch {
        match value {
            Some(value) => drop(labels.insert(key, value)),
            None => drop(labels.remove(&key)),
        }
    }
    if labels.len() > MAX_LABELS {
        Err(StoreError::TooManyLabels { found: labels.len() })
    } else {
        Ok(labels)
    }
}

async fn set_priority(tx: &mut Transaction<'_>, job: &JobRecord, priority: i64) -> Result<(), StoreError> {
    if job.state != State::Queued {
        return Err(StoreError::Forbidden(job.state));
    }
    let flow = runs::flow_of(tx, job.seq).await?;
    let turn =
        turns::assign_start_times(tx, turns::Flow { owner: &job.owner, number: flow, priority }, 1).await?;
    query("update jobs set priority = ?, turn = ? where seq = ?")
        .bind(priority)
        .bind(turn)
        .bind(job.seq)
        .execute(tx)
        .await?;
    Ok(())
}

async fn set_labels(
    tx: &mut Transaction<'_>,
    job: &JobRecord,
    labels: BTreeMap<String, String>,
) -> Result<(), StoreError> {
    query("delete from job_labels where job = ?").bind(job.seq).execute(&mut *tx).await?;
    for (key, value) in &labels {
        query("insert into job_labels (key, value, job, state) values (?, ?, ?, ?)")
            .bind(key)
            .bind(value)
            .bind(job.seq)
            .bind(job.state.name())
            .execute(&mut *tx)
            .await?;
    }
    query("update jobs set labels = ? where seq = ?")
        .bind(to_json(&labels)?)
        .bind(job.seq)
        .execute(tx)
        .await?;
    Ok(())
}
