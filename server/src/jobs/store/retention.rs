//! Jobs that end or leave by time or by a filter: waiting jobs that have expired, finished jobs that are old, and
//! finished jobs that a client deletes together.
//!
//! Each transaction handles a bounded number of jobs. What is to leave is selected among the readers, and its state is
//! checked again in the transaction that removes it.

use super::db::{QueryBuilder, Row, Transaction, query};
use super::exports::export_id;
use super::submit::to_json;
use super::upkeep::Removed;
use super::{Store, StoreError, rows};
use crate::ids::StudyId;
use crate::jobs::State;

/// Most jobs of one transaction, so that submissions do not wait long for the writer.
const AT_ONCE: i64 = 200;

/// Which finished jobs a client deletes. Jobs of studies are never among them: they leave with their study.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct FinishedJobs {
    /// Only jobs in this state.
    pub(crate) state: Option<State>,
    /// Keys and values that a job must all have.
    pub(crate) labels: Vec<(String, String)>,
    /// Only jobs that ended before this time, in microseconds since the Unix epoch.
    pub(crate) finished_before: Option<i64>,
    /// Only jobs of this owner.
    pub(crate) owner: Option<String>,
}

/// The place of a job among the finished ones: when it ended, and its number.
pub(crate) type Finished = (i64, i64);

impl Store {
    /// Cancels waiting jobs that have expired, a bounded number at a time; how many they were. No claim takes them.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn cancel_expired(&self) -> Result<usize, StoreError> {
        let found = query("select 1 from jobs where state = 'queued' and expires_at <= ? limit 1");
        if found.bind(self.now_us()).fetch_optional(self.readers()).await?.is_none() {
            return Ok(0);
        }
        self.freeing(move |store| async move {
            let mut writer = store.writer().await?;
            let cancelled = query(
                "update jobs set state = 'cancelled', cancel_requested = true, version = version + 1, finished_at = ?1,
                     updated_at = ?1
                 where seq in (
                     select expired.seq from jobs as expired
                     where expired.state = 'queued' and expired.expires_at <= ?1 order by expired.expires_at limit ?2
                 ) returning id, (select studies.id from studies where studies.seq = jobs.study) as study_id",
            )
            .bind(store.now_us())
            .bind(AT_ONCE)
            .fetch_all(&mut writer)
            .await?;
            drop(writer);
            for row in &cancelled {
                store.notify(rows::job_id(row.text("id")?)?);
                if let Some(study) = row.try_get::<Option<String>>("study_id")? {
                    store.notify_study(rows::study_id(&study)?);
                }
            }
            store.wake_webhooks();
            Ok(cancelled.len())
        })
        .await
    }

    /// Removes finished jobs past their `expires_at`, a bounded number at a time; an empty answer means that none is
    /// left. Those of a study stay until it is finished.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn remove_expired(&self) -> Result<Vec<Removed>, StoreError> {
        let found = query(
            "select jobs.seq from jobs
             where jobs.expires_at <= ? and jobs.state in ('succeeded', 'failed', 'cancelled')
                 and not exists (
                     select 1 from studies where studies.seq = jobs.study and studies.finished_at is null
                 )
             order by jobs.expires_at limit ?",
        );
        let numbers = found.bind(self.now_us()).bind(AT_ONCE).scalars(self.readers()).await?;
        self.remove_finished(numbers, Scope::All).await
    }

    /// Removes jobs without `expires_at` that ended before a time, a bounded number at a time, beyond the place
    /// `after`; also the place of the last. Those of studies are left to their study.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn remove_old(
        &self,
        finished_before: i64,
        after: Finished,
    ) -> Result<(Vec<Removed>, Option<Finished>), StoreError> {
        let found = query(
            "select coalesce(finished_at, 0) as finished, seq from jobs
             where coalesce(finished_at, 0) >= ?1 and (coalesce(finished_at, 0), seq) > (?1, ?2)
                 and coalesce(finished_at, 0) < ?3 and finished_at is not null and expires_at is null and study is null
             order by coalesce(finished_at, 0), seq limit ?4",
        )
        .bind(after.0)
        .bind(after.1)
        .bind(finished_before)
        .bind(AT_ONCE)
        .fetch_all(self.readers())
        .await?;
        let place = |row: &Row| Ok((row.try_get("finished")?, row.try_get("seq")?));
        let places = found.iter().map(place).collect::<Result<Vec<Finished>, StoreError>>()?;
        let numbers = places.iter().map(|(_, seq)| *seq).collect();
        Ok((self.remove_finished(numbers, Scope::WithoutExpiry).await?, places.last().copied()))
    }

    /// How many jobs [`Self::remove_matching`] would remove in all, and the bytes of their results and exports.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn count_matching(&self, which: &FinishedJobs) -> Result<(u64, u64), StoreError> {
        let columns = "select count(*) as jobs, cast(coalesce(sum(
                 coalesce((select artifacts.bytes from artifacts where artifacts.job = jobs.seq), 0)
                 + coalesce((select sum(exports.bytes) from exports
                             where exports.job = jobs.seq and exports.path is not null), 0)), 0) as bigint) as bytes";
        let row = matching(columns, which, 0).build().fetch_one(self.readers()).await?;
        let count = |column| Ok::<_, StoreError>(row.try_get::<i64>(column)?.cast_unsigned());
        Ok((count("jobs")?, count("bytes")?))
    }

    /// Removes finished jobs that a client deletes, a bounded number at a time, of those beyond the number `after`;
    /// also the number of the last, which is `None` where none is left.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn remove_matching(
        &self,
        which: &FinishedJobs,
        after: i64,
    ) -> Result<(Vec<Removed>, Option<i64>), StoreError> {
        let mut found = matching("select jobs.seq", which, after);
        found.push(" order by jobs.seq limit ").push_bind(AT_ONCE);
        let numbers: Vec<i64> = found.build().scalars(self.readers()).await?;
        let last = numbers.last().copied();
        Ok((self.remove_finished(numbers, Scope::WithoutStudy).await?, last))
    }

    /// Removes those of the jobs that are still finished, and tells all who wait for them.
    async fn remove_finished(&self, numbers: Vec<i64>, scope: Scope) -> Result<Vec<Removed>, StoreError> {
        if numbers.is_empty() {
            return Ok(Vec::new());
        }
        let numbers = to_json(&numbers)?;
        self.freeing(move |store| {
            let numbers = numbers.clone();
            async move {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                let jobs = remove(&mut tx, &numbers, scope).await?;
                tx.commit().await?;
                drop(writer);
                Ok(jobs
                    .into_iter()
                    .map(|job| {
                        store.notify(job.removed.id);
                        job.study.into_iter().for_each(|study| store.notify_study(study));
                        job.open_exports.into_iter().for_each(|export| store.notify_export(export));
                        job.removed
                    })
                    .collect())
            }
        })
        .await
    }
}

/// Which jobs may be removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scope {
    All,
    /// Those of no study.
    WithoutStudy,
    /// Those of no study that have no `expires_at`.
    WithoutExpiry,
}

/// A job that was removed, and whose clients are notified.
struct RemovedJob {
    removed: Removed,
    study: Option<StudyId>,
    open_exports: Vec<crate::ids::ExportId>,
}

/// Removes finished jobs by their numbers, a list in JSON.
async fn remove(
    tx: &mut Transaction<'_>,
    numbers: &str,
    scope: Scope,
) -> Result<Vec<RemovedJob>, StoreError> {
    let found = query(
        "select jobs.seq, jobs.id, artifacts.path, studies.id as study_id,
             (select string_agg(exports.path, '|') from exports
              where exports.job = jobs.seq and exports.path is not null) as export_paths,
             (select string_agg(exports.id, '|') from exports
              where exports.job = jobs.seq and exports.state in ('queued', 'running')) as open_exports
         from jobs left join artifacts on artifacts.job = jobs.seq left join studies on studies.seq = jobs.study
         where jobs.seq in (select cast(value as bigint) from json_each(?1))
             and jobs.state in ('succeeded', 'failed', 'cancelled')
             and (jobs.study is null or ?2) and (jobs.expires_at is null or ?3)",
    )
    .bind(numbers)
    .bind(scope == Scope::All)
    .bind(scope != Scope::WithoutExpiry)
    .fetch_all(&mut *tx)
    .await?;
    let mut gone = Vec::with_capacity(found.len());
    for row in &found {
        query("delete from jobs where seq = ?").bind(row.try_get::<i64>("seq")?).execute(&mut *tx).await?;
        let study = row.try_get::<Option<String>>("study_id")?;
        let open: Option<String> = row.try_get("open_exports")?;
        gone.push(RemovedJob {
            removed: Removed::read(row)?,
            study: study.as_deref().map(rows::study_id).transpose()?,
            open_exports: open
                .iter()
                .flat_map(|ids| ids.split('|'))
                .map(export_id)
                .collect::<Result<_, _>>()?,
        });
    }
    Ok(gone)
}

/// The finished jobs that a client deletes, beyond a number.
fn matching(columns: &str, which: &FinishedJobs, after: i64) -> QueryBuilder {
    let mut query = QueryBuilder::new(columns);
    match which.labels.first() {
        None => query.push(" from jobs where jobs.seq > ").push_bind(after),
        Some((key, value)) => query
            .push(" from job_labels cross join jobs where jobs.seq = job_labels.job and job_labels.key = ")
            .push_bind(key.clone())
            .push(" and job_labels.value = ")
            .push_bind(value.clone())
            .push(" and job_labels.job > ")
            .push_bind(after),
    };
    query.push(" and jobs.study is null");
    match which.state {
        Some(state) => query.push(" and jobs.state = ").push_bind(state.name()),
        None => query.push(" and jobs.state in ('succeeded', 'failed', 'cancelled')"),
    };
    if let Some(before) = which.finished_before {
        query.push(" and jobs.finished_at < ").push_bind(before);
    }
    if let Some(owner) = &which.owner {
        query.push(" and jobs.owner = ").push_bind(owner.clone());
    }
    for (key, value) in which.labels.iter().skip(1) {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = jobs.seq)");
    }
    query
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::super::tests::{fresh, submit, submit_as, succeed};
    use super::*;
    use crate::jobs::JobId;

    /// Sets a time of a job in the past of the database.
    async fn set(store: &Store, id: JobId, column: &str, us: i64) {
        let mut update = QueryBuilder::new(&format!("update jobs set {column} = "));
        update.push_bind(us).push(" where id = ").push_bind(id.to_string());
        update.build().execute(&mut store.writer().await.unwrap()).await.unwrap();
    }

    async fn cancelled(store: &Store, owner: &str, extra: serde_json::Value) -> JobId {
        let job = submit_as(store, owner, extra).await.unwrap();
        store.cancel(job.id).await.unwrap();
        job.id
    }

    #[tokio::test]
    async fn a_waiting_job_that_has_expired_is_cancelled_and_not_started() {
        let (_folder, store) = fresh().await;
        let expired = submit(&store, json!({"expires_at": "2999-01-01T00:00:00Z"})).await;
        let running = submit(&store, json!({"expires_at": "2999-01-01T00:00:00Z"})).await;
        assert_eq!(store.cancel_expired().await.unwrap(), 0);
        set(&store, expired.id, "expires_at", 1).await;
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(lease.id, running.id);
        assert_eq!(store.claim().await.unwrap(), None, "it has expired, whether or not it was cancelled yet");
        set(&store, running.id, "expires_at", 1).await;
        let mut changes = store.subscribe(expired.id);
        assert_eq!(store.cancel_expired().await.unwrap(), 1);
        changes.changed().await;
        assert_eq!(store.get(expired.id).await.unwrap().unwrap().state, State::Cancelled);
        succeed(&store, lease).await;
        let removed = store.remove_expired().await.unwrap();
        assert_eq!(removed.len(), 2, "one that runs ends first");
        assert_eq!(store.remove_expired().await.unwrap(), []);
    }

    #[tokio::test]
    async fn who_waits_for_what_has_expired_is_told() {
        let (_folder, store) = fresh().await;
        let job = submit(&store, json!({"expires_at": "2999-01-01T00:00:00Z"})).await;
        let lease = store.claim().await.unwrap().unwrap().lease;
        succeed(&store, lease).await;
        let export = packstone_engine::export::ExportRequest::from_json(&json!({"type": "slice"})).unwrap();
        let new = crate::exports::NewExport::new(&export, "ab");
        let (export, _) = store.request_export(job.id, new, super::super::Retention::Kept).await.unwrap();
        set(&store, job.id, "expires_at", 1).await;
        let (mut of_job, mut of_export) = (store.subscribe(job.id), store.subscribe_export(export.id));
        assert_eq!(store.remove_expired().await.unwrap().len(), 1);
        of_job.changed().await;
        of_export.changed().await;
    }

    #[tokio::test]
    async fn old_jobs_leave_but_those_that_expire_at_a_time_of_their_own() {
        let (_folder, store) = fresh().await;
        let old = cancelled(&store, "", json!({})).await;
        let late = cancelled(&store, "", json!({})).await;
        let own = cancelled(&store, "", json!({"expires_at": "2999-01-01T00:00:00Z"})).await;
        submit(&store, json!({})).await;
        for (id, us) in [(old, 10), (own, 10), (late, 30)] {
            set(&store, id, "finished_at", us).await;
        }
        let (removed, last) = store.remove_old(30, (0, 0)).await.unwrap();
        assert_eq!(removed.iter().map(|job| job.id).collect::<Vec<_>>(), [old]);
        let (removed, _) = store.remove_old(30, last.unwrap()).await.unwrap();
        assert_eq!(removed, []);
        assert_eq!(store.counts().await.unwrap().values().sum::<u64>(), 3);
    }

    #[tokio::test]
    async fn a_filter_removes_what_it_counts() {
        let (_folder, store) = fresh().await;
        let a = cancelled(&store, "a", json!({"labels": {"series": "x", "n": "1"}})).await;
        let b = cancelled(&store, "b", json!({"labels": {"series": "x"}})).await;
        let late = cancelled(&store, "a", json!({"labels": {"series": "y"}})).await;
        submit_as(&store, "a", json!({"labels": {"series": "x"}})).await.unwrap();
        for (id, us) in [(a, 10), (b, 10), (late, 30)] {
            set(&store, id, "finished_at", us).await;
        }
        let labels = |labels: &[(&str, &str)]| {
            labels.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect::<Vec<_>>()
        };
        let of_a = || FinishedJobs { owner: Some("a".into()), ..FinishedJobs::default() };
        for (which, expected) in [
            (FinishedJobs { labels: labels(&[("series", "x")]), ..FinishedJobs::default() }, vec![a, b]),
            (
                FinishedJobs { labels: labels(&[("series", "x"), ("n", "1")]), ..FinishedJobs::default() },
                vec![a],
            ),
            (FinishedJobs { labels: labels(&[("series", "x")]), ..of_a() }, vec![a]),
            (FinishedJobs { finished_before: Some(30), ..of_a() }, vec![a]),
            (FinishedJobs { state: Some(State::Failed), ..of_a() }, vec![]),
            (FinishedJobs { state: Some(State::Cancelled), ..of_a() }, vec![a, late]),
        ] {
            assert_eq!(store.count_matching(&which).await.unwrap().0, expected.len() as u64, "{which:?}");
            let found: Vec<String> =
                matching("select jobs.id", &which, 0).build().scalars(store.readers()).await.unwrap();
            let mut expected: Vec<String> = expected.iter().map(ToString::to_string).collect();
            expected.sort();
            let mut sorted = found.clone();
            sorted.sort();
            assert_eq!(sorted, expected, "{which:?}");
        }
        let all = FinishedJobs { finished_before: Some(100), ..FinishedJobs::default() };
        let (removed, last) = store.remove_matching(&all, 0).await.unwrap();
        assert_eq!(removed.len(), 3);
        assert_eq!(store.remove_matching(&all, last.unwrap()).await.unwrap(), (Vec::new(), None));
        assert_eq!(store.counts().await.unwrap()[&State::Queued], 1);
    }
}
