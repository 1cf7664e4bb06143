//! What a client may do to a study as a whole, and its end by time.

use std::collections::BTreeMap;

use super::super::db::{Row, Transaction, query};
use super::super::submit::to_json;
use super::super::upkeep::{Removed, remove_jobs};
use super::super::{Store, StoreError, Target, rows, turns, webhooks};
use super::{StudyRecord, StudyState, query};
use crate::ids::{JobId, StudyId};
use crate::jobs::State;
use crate::jobs::request::Change;
use crate::webhooks::WebhookUrl;

/// Jobs of a study that are changed in one transaction. Others that wait for the right to write get it after so many at
/// the latest, because they get it in the order in which they ask.
const AT_ONCE: i64 = 500;

/// A study of which some jobs are changed, and the jobs beyond this number are still to be changed.
pub(super) type Progress = (StudyRecord, Option<i64>);

impl Store {
    /// Cancels what waits of a study, and asks the workers of what runs to stop. Some jobs are cancelled at a time.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::StudyForbidden`] where it is finished, or the database's.
    pub(crate) async fn cancel_study(
        &self,
        study: impl Into<Target<StudyId>>,
    ) -> Result<StudyRecord, StoreError> {
        let (store, mut target) = (self.clone(), study.into());
        let id = target.id;
        self.detached(async move {
            let mut after = None;
            loop {
                let cancel = |store: Self| store.cancel_some(target.clone(), after);
                let (study, more) = store.freeing(cancel).await?;
                if more.is_none() {
                    store.wake_worker();
                    store.wake_webhooks();
                    store.wake_checks();
                    return Ok(study);
                }
                (target, after) = (id.into(), more);
            }
        })
        .await
    }

    /// Cancels some jobs of a study beyond a number; from the first on where there is none.
    pub(super) async fn cancel_some(
        self,
        target: Target<StudyId>,
        after: Option<i64>,
    ) -> Result<Progress, StoreError> {
        let mut writer = self.writer().await?;
        let mut tx = writer.begin().await?;
        let before = query::by_id(&mut tx, target.id).await?;
        target.check(before.version)?;
        if before.state() == StudyState::Finished {
            return if after.is_none() {
                Err(StoreError::StudyForbidden(before.state()))
            } else {
                Ok((before, None))
            };
        }
        let requested = query(
            "update jobs set cancel_requested = true, version = version + 1, updated_at = ?2,
                 finished_at = case when state = 'queued' then ?2 else finished_at end,
                 state = case when state = 'queued' then 'cancelled' else state end
             where seq in (
                 select next.seq from jobs as next
                 where next.study = ?1 and next.seq > ?3
                     and (next.state = 'queued' or (next.state = 'running' and not next.cancel_requested))
                 order by next.seq limit ?4
             ) returning seq, id",
        )
        .bind(before.seq)
        .bind(self.now_us())
        .bind(after.unwrap_or(0))
        .bind(AT_ONCE)
        .fetch_all(&mut tx)
        .await?;
        let study = query::by_seq(&mut tx, before.seq).await?;
        tx.commit().await?;
        drop(writer);
        self.notify_all(&ids(&requested)?);
        self.notify_study(target.id);
        Ok((study, last_of_full(&requested)?))
    }

    /// Lets others read a study with its jobs, or no longer, and changes its webhook; without either, nothing changes
    /// but the version. The jobs follow some at a time: each time they get what the study has by then, so that of two
    /// changes that meet, all jobs have the later one.
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
            query(
                "update studies set shared = coalesce(?2, shared), version = version + 1, updated_at = ?3
                 where seq = ?1",
            )
            .bind(before.seq)
            .bind(shared)
            .bind(store.now_us())
            .execute(&mut tx)
            .await?;
            webhooks::change(&mut tx, webhooks::Ending::Study(before.seq), &webhook_url).await?;
            let mut jobs = store.share_some(&mut tx, before.seq).await?;
            let mut study = query::by_seq(&mut tx, before.seq).await?;
            tx.commit().await?;
            drop(writer);
            store.notify_all(&ids(&jobs)?);
            while last_of_full(&jobs)?.is_some() {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                jobs = store.share_some(&mut tx, before.seq).await?;
                study = query::by_seq(&mut tx, before.seq).await?;
                tx.commit().await?;
                drop(writer);
                store.notify_all(&ids(&jobs)?);
            }
            store.notify_study(target.id);
            Ok(study)
        })
        .await
    }

    /// Lets others read some jobs of a study, or no longer, as the study has it.
    pub(super) async fn share_some(
        &self,
        tx: &mut Transaction<'_>,
        study: i64,
    ) -> Result<Vec<Row>, StoreError> {
        let shared = query(
            "update jobs set shared = not shared, version = version + 1, updated_at = ?2
             where seq in (
                 select next.seq from jobs as next
                 where next.study = ?1 and next.shared <> (select studies.shared from studies where studies.seq = ?1)
                 order by next.seq limit ?3
             ) returning seq, id",
        );
        Ok(shared.bind(study).bind(self.now_us()).bind(AT_ONCE).fetch_all(tx).await?)
    }

    /// Sends the jobs of a study in these states, failed or cancelled ones, back to the queue, with their
    /// attempts renewed, some at a time. Returns the study, and the jobs with the attempts that come next.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], [`StoreError::QueueFull`] where the queue has no room for all of them, or the
    /// database's.
    pub(crate) async fn retry_study(
        &self,
        study: impl Into<Target<StudyId>>,
        states: Vec<State>,
    ) -> Result<(StudyRecord, Vec<(JobId, i64)>), StoreError> {
        let (store, mut target) = (self.clone(), study.into());
        let id = target.id;
        let states: Vec<_> = states.into_iter().filter(|state| state.may_retry()).map(State::name).collect();
        let states = to_json(&states)?;
        self.detached(async move {
            let (mut retried, mut after) = (Vec::new(), None);
            loop {
                let (study, more) = store.retry_some(&target, &states, after, &mut retried).await?;
                store.wake_worker();
                if more.is_none() {
                    store.notify_study(id);
                    return Ok((study, retried));
                }
                (target, after) = (id.into(), more);
            }
        })
        .await
    }

    /// Requeues some jobs of a study beyond a number, from the first on where there is none; `states` is a list in
    /// JSON. No job is met twice, whatever becomes of it meanwhile.
    async fn retry_some(
        &self,
        target: &Target<StudyId>,
        states: &str,
        after: Option<i64>,
        retried: &mut Vec<(JobId, i64)>,
    ) -> Result<Progress, StoreError> {
        let mut writer = self.writer().await?;
        let mut tx = writer.begin().await?;
        let before = query::by_id(&mut tx, target.id).await?;
        target.check(before.version)?;
        if after.is_none() {
            let jobs: i64 = query(
                "select count(*) from jobs where study = ? and state in (select value from json_each(?))",
            )
            .bind(before.seq)
            .bind(states)
            .scalar(&mut tx)
            .await?;
            self.check_queue(&mut tx, &before.owner, jobs as u64).await?;
        }
        let next = query(
            "select seq, priority from jobs
             where study = ? and state in (select value from json_each(?)) and seq > ? order by seq limit ?",
        )
        .bind(before.seq)
        .bind(states)
        .bind(after.unwrap_or(0))
        .bind(AT_ONCE)
        .fetch_all(&mut tx)
        .await?;
        let mut requeued = Vec::new();
        let mut by_priority: BTreeMap<i64, Vec<i64>> = BTreeMap::new();
        for row in &next {
            by_priority.entry(row.try_get("priority")?).or_default().push(row.try_get("seq")?);
        }
        for (priority, jobs) in by_priority {
            let flow = turns::Flow { owner: &before.owner, number: before.seq, priority };
            let turn = turns::assign_start_times(&mut tx, flow, jobs.len() as i64).await?;
            let rows = query(
                "update jobs set state = 'queued', version = version + 1, updated_at = ?1,
                     max_attempts = attempt + attempt_budget, attempt = attempt + 1, cancel_requested = false,
                     finish_requested = false,
                     started_at = null, finished_at = null, progress = null, error = null, faults = 0,
                     not_before = null, turn = ?2 + ranked.place
                 from (
                     select seq, row_number() over (order by seq) - 1 as place from jobs
                     where seq in (select cast(value as bigint) from json_each(?3))
                 ) as ranked
                 where jobs.seq = ranked.seq returning jobs.id, jobs.attempt",
            )
            .bind(self.now_us())
            .bind(turn)
            .bind(to_json(&jobs)?)
            .fetch_all(&mut tx)
            .await?;
            for row in &rows {
                requeued.push((rows::job_id(row.text("id")?)?, row.try_get("attempt")?));
            }
        }
        let study = query::by_seq(&mut tx, before.seq).await?;
        tx.commit().await?;
        drop(writer);
        for (job, _) in &requeued {
            self.notify(*job);
        }
        retried.extend(requeued);
        Ok((study, last_of_full(&next)?))
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
        .bind(AT_ONCE)
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

/// The number of the last of these jobs, where they are as many as are changed at once: there may be more.
fn last_of_full(jobs: &[Row]) -> Result<Option<i64>, StoreError> {
    if (jobs.len() as i64) < AT_ONCE {
        return Ok(None);
    }
    let mut last = None;
    for row in jobs {
        last = last.max(Some(row.try_get::<i64>("seq")?));
    }
    Ok(last)
}

fn ids(jobs: &[Row]) -> Result<Vec<JobId>, StoreError> {
    jobs.iter().map(|row| rows::job_id(row.text("id")?)).collect()
}
