//! What a client may do to a study as a whole, and its end by time.

use std::time::Duration;

use tokio::time::sleep;

use super::super::db::{Row, Transaction, query};
use super::super::upkeep::{Removed, remove_jobs};
use super::super::{Store, StoreError, Target, rows, turns, webhooks};
use super::{StudyRecord, StudyState, query};
use crate::ids::{JobId, StudyId};
use crate::jobs::State;
use crate::jobs::request::Change;
use crate::webhooks::WebhookUrl;

/// Jobs of a study that are changed in one transaction: others wait for the writer for so long at most.
const REMOVED_AT_ONCE: i64 = 200;
/// Time between two such transactions, in which others can write.
const REMOVAL_PAUSE: Duration = Duration::from_millis(5);

impl Store {
    /// Cancels what waits of a study, and asks the workers of what runs to stop.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::StudyForbidden`] where it is finished, or the database's.
    pub(crate) async fn cancel_study(
        &self,
        study: impl Into<Target<StudyId>>,
    ) -> Result<StudyRecord, StoreError> {
        let target = study.into();
        self.freeing(move |store| {
            let target = target.clone();
            let id = target.id;
            async move {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                let before = query::by_id(&mut tx, id).await?;
                target.check(before.version)?;
                if before.state() == StudyState::Finished {
                    return Err(StoreError::StudyForbidden(before.state()));
                }
                let asked = query(
                    "update jobs set cancel_requested = true, version = version + 1, updated_at = ?2,
                     finished_at = case when state = 'queued' then ?2 else finished_at end,
                     state = case when state = 'queued' then 'cancelled' else state end
                 where study = ?1 and (state = 'queued' or (state = 'running' and not cancel_requested))
                 returning id",
                )
                .bind(before.seq)
                .bind(store.now_us())
                .fetch_all(&mut tx)
                .await?;
                let study = query::by_seq(&mut tx, before.seq).await?;
                tx.commit().await?;
                drop(writer);
                store.notify_all(&ids(&asked)?);
                store.notify_study(id);
                store.wake_worker();
                store.wake_webhooks();
                store.wake_checks();
                Ok(study)
            }
        })
        .await
    }

    /// Lets others read a study with its jobs, or no longer, and changes its webhook; without either, nothing changes
    /// but the version.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::VersionDiffers`], or the database's.
    pub(crate) async fn patch_study(
        &self,
        study: impl Into<Target<StudyId>>,
        shared: Option<bool>,
        webhook_url: Change<WebhookUrl>,
    ) -> Result<StudyRecord, StoreError> {
        let (store, target) = (self.clone(), study.into());
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let before = query::by_id(&mut tx, target.id).await?;
            target.check(before.version)?;
            let now = store.now_us();
            query(
                "update studies set shared = coalesce(?2, shared), version = version + 1, updated_at = ?3
                 where seq = ?1",
            )
            .bind(before.seq)
            .bind(shared)
            .bind(now)
            .execute(&mut tx)
            .await?;
            let jobs = query(
                "update jobs set shared = ?2, version = version + 1, updated_at = ?3
                 where study = ?1 and shared <> ?2 returning id",
            )
            .bind(before.seq)
            .bind(shared)
            .bind(now)
            .fetch_all(&mut tx)
            .await?;
            webhooks::change(&mut tx, webhooks::Ending::Study(before.seq), &webhook_url).await?;
            let study = query::by_seq(&mut tx, before.seq).await?;
            tx.commit().await?;
            drop(writer);
            store.notify_all(&ids(&jobs)?);
            store.notify_study(target.id);
            Ok(study)
        })
        .await
    }

    /// Sends the jobs of a study in these states, failed or cancelled ones, back to the queue, with their
    /// attempts renewed. Returns the study, and the jobs with the attempts that come next.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::QueueFull`], or the database's.
    pub(crate) async fn retry_study(
        &self,
        study: impl Into<Target<StudyId>>,
        states: Vec<State>,
    ) -> Result<(StudyRecord, Vec<(JobId, i64)>), StoreError> {
        let (store, target) = (self.clone(), study.into());
        let id = target.id;
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let before = query::by_id(&mut tx, id).await?;
            target.check(before.version)?;
            let seq = before.seq;
            let mut retried = Vec::new();
            for state in states.into_iter().filter(|state| state.may_retry()) {
                retried.extend(store.retry_all(&mut tx, &before, state).await?);
            }
            let study = query::by_seq(&mut tx, seq).await?;
            tx.commit().await?;
            drop(writer);
            for (job, _) in &retried {
                store.notify(*job);
            }
            store.notify_study(id);
            store.wake_worker();
            Ok((study, retried))
        })
        .await
    }

    async fn retry_all(
        &self,
        tx: &mut Transaction<'_>,
        study: &StudyRecord,
        state: State,
    ) -> Result<Vec<(JobId, i64)>, StoreError> {
        let (study, owner) = (study.seq, &study.owner);
        let waiting = query(
            "select priority, count(*) as jobs from jobs where study = ? and state = ? group by priority",
        )
        .bind(study)
        .bind(state.name())
        .fetch_all(&mut *tx)
        .await?;
        let mut retried = Vec::new();
        for row in waiting {
            let (priority, jobs): (i64, i64) = (row.try_get("priority")?, row.try_get("jobs")?);
            self.check_queue(tx, owner, jobs as u64).await?;
            let turn =
                turns::assign_start_times(tx, turns::Flow { owner, number: study, priority }, jobs).await?;
            let rows = query(
                "update jobs set state = 'queued', version = version + 1, updated_at = ?1,
                     max_attempts = attempt + attempt_budget, attempt = attempt + 1, cancel_requested = false,
                     started_at = null, finished_at = null, progress = null, error = null, faults = 0,
                     not_before = null, turn = ?2 + ranked.place
                 from (
                     select seq, row_number() over (order by seq) - 1 as place from jobs
                     where study = ?3 and state = ?4 and priority = ?5
                 ) as ranked
                 where jobs.seq = ranked.seq returning jobs.id, jobs.attempt",
            )
            .bind(self.now_us())
            .bind(turn)
            .bind(study)
            .bind(state.name())
            .bind(priority)
            .fetch_all(&mut *tx)
            .await?;
            for row in &rows {
                retried.push((rows::job_id(row.text("id")?)?, row.try_get("attempt")?));
            }
        }
        Ok(retried)
    }

    /// Removes a finished study with its jobs, and tells what jobs and artifacts those were.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::StudyForbidden`] where it is not finished, or the database's.
    pub(crate) async fn delete_study(
        &self,
        study: impl Into<Target<StudyId>>,
    ) -> Result<Vec<Removed>, StoreError> {
        let target = study.into();
        let id = target.id;
        self.freeing(move |store| {
            let target = target.clone();
            async move {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                let study = query::by_id(&mut tx, id).await?;
                target.check(study.version)?;
                if study.state() != StudyState::Finished {
                    return Err(StoreError::StudyForbidden(study.state()));
                }
                Ok(tx.rollback().await?)
            }
        })
        .await?;
        self.remove_in_batches(id).await
    }

    /// Removes one finished study past its time with its jobs; `None` when no such study is left. The time is its
    /// `expires_at`; of one that has none, the studies that ended before `finished_before` are removed, unless one of
    /// their jobs is to stay longer.
    pub(crate) async fn remove_expired_study(
        &self,
        finished_before: Option<i64>,
    ) -> Result<Option<Vec<Removed>>, StoreError> {
        let expired = query(
            "select id from studies
             where finished_at is not null and (
                 expires_at <= ?1
                 or (expires_at is null and finished_at < ?2 and not exists (
                     select 1 from jobs where jobs.study = studies.seq and jobs.expires_at > ?1
                 ))
             )
             order by coalesce(expires_at, finished_at) limit 1",
        )
        .bind(self.now_us())
        .bind(finished_before)
        .fetch_optional(self.readers())
        .await?;
        let Some(expired) = expired else { return Ok(None) };
        match self.remove_in_batches(rows::study_id(expired.text("id")?)?).await {
            // A client has deleted it meanwhile, or retries it.
            Err(StoreError::NoStudy | StoreError::StudyForbidden(_)) => Ok(Some(Vec::new())),
            removed => removed.map(Some),
        }
    }

    /// Removes the jobs of a finished study, some at a time, and then the study: others can write in between. Where it
    /// breaks off the study is still there, with the jobs that are left.
    async fn remove_in_batches(&self, id: StudyId) -> Result<Vec<Removed>, StoreError> {
        let mut all = Vec::new();
        loop {
            let removed = self.freeing(move |store| async move { store.remove_some(id).await }).await?;
            let is_last = removed.is_empty();
            all.extend(removed);
            if is_last {
                return Ok(all);
            }
            sleep(REMOVAL_PAUSE).await;
        }
    }

    /// Removes some jobs of a finished study; where none are left, the study.
    async fn remove_some(self, id: StudyId) -> Result<Vec<Removed>, StoreError> {
        let mut writer = self.writer().await?;
        let mut tx = writer.begin().await?;
        let study = query::by_id(&mut tx, id).await?;
        if study.state() != StudyState::Finished {
            return Err(StoreError::StudyForbidden(study.state()));
        }
        let jobs = query(
            "select jobs.seq, jobs.id, artifacts.path,
                 (select string_agg(exports.path, '|') from exports
                  where exports.job = jobs.seq and exports.path is not null) as export_paths
             from jobs left join artifacts on artifacts.job = jobs.seq
             where jobs.study = ? order by jobs.seq limit ?",
        )
        .bind(study.seq)
        .bind(REMOVED_AT_ONCE)
        .fetch_all(&mut tx)
        .await?;
        let removed: Vec<Removed> = jobs.iter().map(Removed::read).collect::<Result<_, _>>()?;
        let mut exports = Vec::new();
        if removed.is_empty() {
            query("delete from studies where seq = ?").bind(study.seq).execute(&mut tx).await?;
        } else {
            exports = remove_jobs(&mut tx, &jobs).await?;
        }
        tx.commit().await?;
        drop(writer);
        self.notify_removed(&removed, exports);
        self.notify_study(id);
        Ok(removed)
    }
}

fn ids(jobs: &[Row]) -> Result<Vec<JobId>, StoreError> {
    jobs.iter().map(|row| rows::job_id(row.text("id")?)).collect()
}
