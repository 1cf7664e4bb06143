//! Maintenance of the store that no client requests: recovery after a crash, leases that ran out, and files.

use std::collections::BTreeMap;

use super::db::{Row, Transaction, query};
use super::exports::export_id;
use super::leased::{Kind, take_back};
use super::submit::to_json;
use super::{Store, StoreError, rows};
use crate::failure::{Failure, FailureCode};
use crate::ids::ExportId;
use crate::jobs::JobId;

/// A checkpoint that an attempt wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Kept {
    /// ID of the job or the export.
    pub(crate) job: String,
    /// The attempt that wrote it.
    pub(crate) attempt: i64,
    /// When, in microseconds since the Unix epoch.
    pub(crate) at_us: i64,
}

/// What takes stored bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum StoredKind {
    /// The result of a job.
    Results,
    /// An export that stays with its job.
    Exports,
    /// An export that may be removed and made again.
    Cache,
    /// The request of a job or a study, in the database.
    Requests,
}

impl StoredKind {
    /// All kinds.
    pub(crate) const ALL: [Self; 4] = [Self::Results, Self::Exports, Self::Cache, Self::Requests];

    /// Name in the database and the metrics.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Results => "results",
            Self::Exports => "exports",
            Self::Cache => "cache",
            Self::Requests => "requests",
        }
    }
}

/// A job that was removed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Removed {
    pub(crate) id: JobId,
    /// Its files, the result and its exports, which no row refers to any more.
    pub(crate) files: Vec<String>,
}

impl Store {
    /// Requeues every running job of this server's own workers at start-up, when there is none that has it, with its
    /// next attempt, or ends it where it has none left. Returns how many were running. Where other servers may share
    /// the database, only those whose lease ran out are taken.
    pub(crate) async fn recover(&self, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        self.reclaim(if self.is_shared() { self.now_us() } else { i64::MAX }, checkpoints).await
    }

    /// Does the same for the jobs whose lease ran out, after a suspended machine for example.
    pub(crate) async fn reclaim_expired_leases(&self, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        self.reclaim(self.now_us(), checkpoints).await
    }

    /// Whether a job or an export runs whose lease ran out.
    pub(crate) async fn has_expired_leases(&self) -> Result<bool, StoreError> {
        let row = query(
            "select 1 from jobs where state = 'running' and received_at is null and lease_expires_at <= ?1
             union all select 1 from exports where state = 'running' and lease_expires_at <= ?1",
        )
        .bind(self.now_us())
        .fetch_optional(self.readers())
        .await?;
        Ok(row.is_some())
    }

    async fn reclaim(&self, leases_until: i64, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let at_start = leases_until == i64::MAX;
            let exhausted = Failure::new(
                FailureCode::AttemptsExhausted,
                "the server or the worker stopped during every attempt that max_attempts allows",
            );
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let which = (leases_until, at_start);
            let moved = take_back(&store, Kind::Job, &exhausted, which, &checkpoints, &mut tx).await?;
            if at_start {
                // A restart may end a fault of the machine.
                query("update jobs set not_before = null where not_before is not null")
                    .execute(&mut tx)
                    .await?;
            }
            tx.commit().await?;
            drop(writer);
            for row in &moved {
                store.notify(rows::job_id(row.text("id")?)?);
                if let Some(study) = row.try_get::<Option<String>>("study_id")? {
                    store.notify_study(rows::study_id(&study)?);
                }
                store.wake_worker();
            }
            store.wake_webhooks();
            Ok(moved.len())
        })
        .await
    }

    /// Whether the result of a job, or an export, is at this path.
    pub(crate) async fn refers_to(&self, path: &str) -> Result<bool, StoreError> {
        let row =
            query("select 1 from artifacts where path = ?1 union all select 1 from exports where path = ?1")
                .bind(path)
                .fetch_optional(self.readers())
                .await?;
        Ok(row.is_some())
    }

    /// Whether a job, or an export of this id, waits or runs.
    pub(crate) async fn is_open(&self, id: JobId) -> Result<bool, StoreError> {
        let row = query(
            "select 1 from jobs where id = ?1 and state in ('queued', 'running')
             union all select 1 from exports where id = ?1 and state in ('queued', 'running')",
        )
        .bind(id.to_string())
        .fetch_optional(self.readers())
        .await?;
        Ok(row.is_some())
    }

    /// Whether this attempt of a job or an export runs.
    pub(crate) async fn is_running(&self, id: &str, attempt: i64) -> Result<bool, StoreError> {
        let row = query(
            "select 1 from jobs where id = ?1 and attempt = ?2 and state = 'running'
             union all select 1 from exports where id = ?1 and attempt = ?2 and state = 'running'",
        )
        .bind(id)
        .bind(attempt)
        .fetch_optional(self.readers())
        .await?;
        Ok(row.is_some())
    }

    /// At most `limit` paths of files whose rows have been deleted and that have not been removed yet.
    pub(crate) async fn removals(&self, limit: u32) -> Result<Vec<String>, StoreError> {
        let paths = query("select path from removals limit ?");
        Ok(paths.bind(limit).scalars(self.readers()).await?)
    }

    /// Whether the row of the file at this path has been deleted and the file has not been removed yet.
    pub(crate) async fn is_removed(&self, path: &str) -> Result<bool, StoreError> {
        let row =
            query("select 1 from removals where path = ?").bind(path).fetch_optional(self.readers()).await?;
        Ok(row.is_some())
    }

    /// Deletes the records of files that have been removed.
    pub(crate) async fn forget_removals(&self, paths: Vec<String>) -> Result<(), StoreError> {
        self.freeing(move |store| {
            let paths = paths.clone();
            async move {
                let paths = to_json(&paths)?;
                let mut writer = store.quick_writer().await?;
                query("delete from removals where path in (select value from json_each(?))")
                    .bind(paths)
                    .execute(&mut writer)
                    .await?;
                Ok(())
            }
        })
        .await
    }

    /// Whether a job of this ID exists, in any state.
    pub(crate) async fn knows_job(&self, id: &str) -> Result<bool, StoreError> {
        let row = query("select 1 from jobs where id = ?").bind(id).fetch_optional(self.readers()).await?;
        Ok(row.is_some())
    }

    /// Bytes of files and requests by owner and kind.
    pub(crate) async fn stored_bytes(&self) -> Result<BTreeMap<(String, StoredKind), u64>, StoreError> {
        let text = "select owner, kind, bytes from stored_bytes
             union all select owner, 'requests', request_bytes from queue_owners where request_bytes > 0";
        let rows = query(text).fetch_all(self.readers()).await?;
        rows.iter()
            .map(|row| {
                let name: String = row.try_get("kind")?;
                let kind = StoredKind::ALL
                    .into_iter()
                    .find(|kind| kind.name() == name)
                    .ok_or_else(|| StoreError::Row(format!("unknown kind of file {name:?}")))?;
                Ok(((row.try_get("owner")?, kind), row.try_get::<i64>("bytes")?.max(0).cast_unsigned()))
            })
            .collect()
    }
}

/// Removes jobs, whose rows have their `seq`. Returns the exports of them that were not finished.
pub(super) async fn remove_jobs(tx: &mut Transaction<'_>, jobs: &[Row]) -> Result<Vec<ExportId>, StoreError> {
    let mut seqs = Vec::new();
    for job in jobs {
        seqs.push(job.try_get::<i64>("seq")?.to_string());
    }
    let seqs = to_json(&seqs)?;
    let open = query(
        "select id from exports where state in ('queued', 'running')
             and job in (select cast(value as bigint) from json_each(?))",
    )
    .bind(&seqs)
    .fetch_all(&mut *tx)
    .await?;
    query("delete from jobs where seq in (select cast(value as bigint) from json_each(?))")
        .bind(&seqs)
        .execute(tx)
        .await?;
    open.iter().map(|row| export_id(row.text("id")?)).collect()
}

impl Store {
    /// Wakes those who wait for jobs that were removed, or for their exports, and the workers that make these.
    pub(super) fn notify_removed(&self, jobs: &[Removed], exports: Vec<ExportId>) {
        for job in jobs {
            self.notify(job.id);
        }
        for export in exports {
            self.notify_export(export);
        }
    }
}

impl Removed {
    /// Reads a row with `id`, `path` of the result, and `export_paths` between bars.
    pub(super) fn read(row: &Row) -> Result<Self, StoreError> {
        let exports: Option<String> = row.try_get("export_paths")?;
        let mut files: Vec<String> =
            exports.iter().flat_map(|paths| paths.split('|')).map(str::to_owned).collect();
        files.extend(row.try_get::<Option<String>>("path")?);
        Ok(Self { id: rows::job_id(row.text("id")?)?, files })
    }
}
