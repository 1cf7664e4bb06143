//! Reading exports.

use std::collections::BTreeMap;

use packstone_engine::export::ExportType;
use serde_json::Value;

use super::super::db::{Transaction, query};
use super::super::rows::DamagedRow;
use super::super::{Store, StoreError, rows};
use super::{export, export_id, select_exports};
use crate::exports::{ExportRecord, ExportState, NewExport};
use crate::ids::{ExportId, JobId};

/// Number of exports in each state, and size of the cache.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ExportCounts {
    pub(crate) states: BTreeMap<ExportState, u64>,
    pub(crate) cache_bytes: u64,
}

/// One page of the exports of a job, newest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct ExportPage {
    pub(crate) exports: Vec<ExportRecord>,
    /// Exports of the page that cannot be read.
    pub(crate) damaged: Vec<DamagedRow>,
    /// Exports below this number follow; `None` on the last page.
    pub(crate) next_before: Option<i64>,
}

impl Store {
    /// The export of a job; `None` where the job does not have it.
    pub(crate) async fn export(&self, job: JobId, id: ExportId) -> Result<Option<ExportRecord>, StoreError> {
        let row = query(select_exports!("where exports.id = ? and jobs.id = ?"))
            .bind(id.to_string())
            .bind(job.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(export).transpose()
    }

    /// Whether a job has the export of a key, or had it before it was removed from the cache.
    pub(crate) async fn knows_export(&self, job: i64, key: &str) -> Result<bool, StoreError> {
        let row = query("select 1 from exports where job = ? and key = ?")
            .bind(job)
            .bind(key)
            .fetch_optional(self.readers())
            .await?;
        Ok(row.is_some())
    }

    /// The export of a job with that key, or the newest with the same options that an earlier version made.
    pub(crate) async fn export_of(
        &self,
        job: i64,
        new: &NewExport,
    ) -> Result<Option<ExportRecord>, StoreError> {
        let row = query(select_exports!(
            "where exports.job = ?1 and (exports.key = ?2 or exports.options = ?3)
             order by exports.key = ?2 desc, exports.seq desc limit 1"
        ))
        .bind(job)
        .bind(&new.key)
        .bind(&new.options)
        .fetch_optional(self.readers())
        .await?;
        row.as_ref().map(export).transpose()
    }

    /// A page of at most `limit` of the exports of a job, newest first, below number `before`.
    pub(crate) async fn list_exports(
        &self,
        job: i64,
        before: Option<i64>,
        limit: u32,
    ) -> Result<ExportPage, StoreError> {
        let rows = query(select_exports!(
            "where exports.job = ? and exports.seq < ? order by exports.seq desc limit ?"
        ))
        .bind(job)
        .bind(before.unwrap_or(i64::MAX))
        .bind(i64::from(limit) + 1)
        .fetch_all(self.readers())
        .await?;
        let mut page = ExportPage { next_before: rows::next_before(&rows, limit)?, ..ExportPage::default() };
        for row in rows.iter().take(limit as usize) {
            rows::or_damaged(row, export(row), &mut page.exports, &mut page.damaged)?;
        }
        Ok(page)
    }

    /// Types and options of the exports that are kept with a job, oldest first. The job's version changes with them.
    pub(crate) async fn kept_of(&self, job: i64) -> Result<Vec<(ExportType, Value)>, StoreError> {
        let rows = query("select type, options from exports where job = ? and kept order by seq")
            .bind(job)
            .fetch_all(self.readers())
            .await?;
        rows.iter()
            .map(|row| {
                let kind = rows::json(&format!("\"{}\"", row.try_get::<String>("type")?))?;
                Ok((kind, rows::json(row.text("options")?)?))
            })
            .collect()
    }

    /// Number of exports in each state, and size of the cache.
    pub(crate) async fn export_counts(&self) -> Result<ExportCounts, StoreError> {
        let rows =
            query("select state, exports, cache_bytes from export_counts").fetch_all(self.readers()).await?;
        let mut counts = ExportCounts::default();
        for row in rows {
            let name: String = row.try_get("state")?;
            let state = ExportState::from_name(&name)
                .ok_or_else(|| StoreError::Row(format!("unknown state {name:?}")))?;
            counts.states.insert(state, row.try_get::<i64>("exports")? as u64);
            counts.cache_bytes += row.try_get::<i64>("cache_bytes")? as u64;
        }
        Ok(counts)
    }
}

/// The files that a job has besides its result, and its exports that are not finished.
pub(in crate::jobs::store) async fn files_of_job(
    tx: &mut Transaction<'_>,
    job: i64,
) -> Result<(Vec<String>, Vec<ExportId>), StoreError> {
    let rows = query("select id, path, state from exports where job = ?").bind(job).fetch_all(tx).await?;
    let (mut files, mut open) = (Vec::new(), Vec::new());
    for row in rows {
        files.extend(row.try_get::<Option<String>>("path")?);
        if ["queued", "running"].contains(&row.text("state")?) {
            open.push(export_id(row.text("id")?)?);
        }
    }
    Ok((files, open))
}
