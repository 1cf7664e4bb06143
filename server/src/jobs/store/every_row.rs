//! Reads every row of a database, as the service reads it, for `packstone check`.

use serde_json::Value;

use super::bodies::{self, body_of_job, composed_body};
use super::db::{Readers, Row, query};
use super::exports::{export, select_exports};
use super::faults::Fault;
use super::presence::Damage;
use super::rows::{self, DamagedRow, select_jobs};
use super::studies::StudyRecord;
use super::{Database, StoreError, schema};

/// What was read of a database.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct RowsRead {
    /// How many rows.
    pub(crate) rows: u64,
    /// Those that are damaged, with their tables.
    pub(crate) damaged: Vec<(&'static str, DamagedRow)>,
}

/// Jobs with their results and requests.
const JOBS: &str =
    select_jobs!(concat!(", ", body_of_job!()), "where jobs.seq > ? order by jobs.seq limit 20");
/// Studies with their requests.
const STUDIES: &str = concat!(
    "select studies.*, ",
    composed_body!(),
    " as body, r.digest from studies join study_requests as r on r.study = studies.seq
         left join study_parts as p on p.study = r.study and p.part = r.part
     where studies.seq > ? order by studies.seq limit 20"
);
const EXPORTS: &str = select_exports!("where exports.seq > ? order by exports.seq limit 200");
const MESSAGES: &str = "select seq, id, body from webhook_deliveries where seq > ? order by seq limit 200";
const POINTS: &str = "select point, key_values, is_whole from study_points where study = ?";
const RUNS: &str = "select point, facts, outcome, is_whole from study_runs where study = ?";

/// Reads every row.
///
/// # Errors
/// The database's, but for damaged pages; or its tables are not those of this version.
pub(crate) async fn read_every_row(database: &Database) -> Result<RowsRead, StoreError> {
    let readers = database.options().readers(None, &Damage::default()).await?;
    let mut tx = readers.begin().await?;
    schema::read(&mut tx, database).await?;
    tx.rollback().await?;
    let mut found = RowsRead::default();
    let mut studies = Vec::new();
    found
        .read(&readers, "jobs", JOBS, |row| {
            rows::job(row)?;
            rows::json::<Value>(bodies::checked(row, "body", "body_digest")?).map(drop)
        })
        .await?;
    found
        .read(&readers, "studies", STUDIES, |row| {
            studies.push((row.try_get::<i64>("seq")?, row.text("id")?.to_owned()));
            StudyRecord::read(row)?;
            rows::json::<Value>(bodies::checked(row, "body", "digest")?).map(drop)
        })
        .await?;
    for (study, id) in studies {
        found
            .read_of_study(&readers, (study, &id), ("study_points", POINTS), |row| {
                rows::check_whole(row, "is_whole")?;
                rows::json::<Vec<Value>>(row.text("key_values")?).map(drop)
            })
            .await?;
        found
            .read_of_study(&readers, (study, &id), ("study_runs", RUNS), |row| {
                rows::check_whole(row, "is_whole")?;
                super::studies::runs::outcome(row.text("outcome")?)?;
                rows::json::<crate::studies::Facts>(row.text("facts")?).map(drop)
            })
            .await?;
    }
    found.read(&readers, "exports", EXPORTS, |row| export(row).map(drop)).await?;
    let message = |row: &Row| rows::json::<Value>(row.text("body")?).map(drop);
    found.read(&readers, "webhook_deliveries", MESSAGES, message).await?;
    readers.close().await;
    Ok(found)
}

impl RowsRead {
    /// Reads a table by pages of rising numbers.
    async fn read(
        &mut self,
        readers: &Readers,
        table: &'static str,
        text: &'static str,
        mut read: impl FnMut(&Row) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let mut last = i64::MIN;
        loop {
            let page = query(text).bind(last).fetch_all(readers).await.map_err(StoreError::from);
            let Some(page) = self.page(table, page)? else { return Ok(()) };
            let Some(row) = page.last() else { return Ok(()) };
            last = row.try_get("seq")?;
            for row in &page {
                let id = row.text("id").unwrap_or("");
                self.take(table, id, read(row))?;
            }
        }
    }

    /// Reads the rows of a study in a table.
    async fn read_of_study(
        &mut self,
        readers: &Readers,
        (study, id): (i64, &str),
        (table, text): (&'static str, &'static str),
        read: impl Fn(&Row) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let rows = query(text).bind(study).fetch_all(readers).await.map_err(StoreError::from);
        for row in self.page(table, rows)?.into_iter().flatten() {
            let point = row.try_get::<i64>("point").unwrap_or(-1);
            self.take(table, &format!("{id} point {point}"), read(&row))?;
        }
        Ok(())
    }

    /// Rows that were read; `None` where a page of the database is damaged, so that no more can be read.
    fn page(
        &mut self,
        table: &'static str,
        rows: Result<Vec<Row>, StoreError>,
    ) -> Result<Option<Vec<Row>>, StoreError> {
        match rows {
            Err(error) if error.fault() == Some(Fault::Damaged) => {
                self.damaged.push((table, DamagedRow { id: String::new(), fault: error.to_string() }));
                Ok(None)
            }
            rows => rows.map(Some),
        }
    }

    fn take(
        &mut self,
        table: &'static str,
        id: &str,
        read: Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        self.rows += 1;
        match read {
            Err(StoreError::Row(fault)) => {
                self.damaged.push((table, DamagedRow { id: id.to_owned(), fault }));
                Ok(())
            }
            read => read,
        }
    }
}
