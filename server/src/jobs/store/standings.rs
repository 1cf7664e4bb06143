//! Where jobs and studies stand now, for those who follow many of them.

use std::collections::HashMap;

use super::db::{QueryBuilder, Row};
use super::query::Holder;
use super::{Store, StoreError, StudyState, rows};
use crate::jobs::journal::{Changed, Journal};

/// Where a job or a study stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Standing {
    /// Name of its state.
    pub(crate) state: &'static str,
    pub(crate) version: i64,
    pub(crate) holder: Holder,
}

impl Store {
    /// What has changed lately in this process, and in others as far as they tell.
    pub(crate) fn journal(&self) -> &Journal {
        &self.shared.journal
    }

    /// Where these jobs and studies stand; those that are gone are left out.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn standings(&self, of: &[Changed]) -> Result<HashMap<Changed, Standing>, StoreError> {
        let mut found = HashMap::new();
        let (mut jobs, mut studies) = (Vec::new(), Vec::new());
        for changed in of {
            match changed {
                Changed::Job(id) => jobs.push(id.to_string()),
                Changed::Study(id) => studies.push(id.to_string()),
            }
        }
        for row in self.rows_of("select id, state, version, owner, shared from jobs", jobs).await? {
            let id = Changed::Job(rows::job_id(row.text("id")?)?);
            found.insert(id, standing(&row, rows::state(row.text("state")?)?.name())?);
        }
        let text = "select id, finished_at, version, owner, shared from studies";
        for row in self.rows_of(text, studies).await? {
            let is_open = row.try_get::<Option<i64>>("finished_at")?.is_none();
            let state = if is_open { StudyState::Open } else { StudyState::Finished };
            let id = Changed::Study(rows::study_id(row.text("id")?)?);
            found.insert(id, standing(&row, state.name())?);
        }
        Ok(found)
    }

    /// Rows of these ids.
    async fn rows_of(&self, text: &str, ids: Vec<String>) -> Result<Vec<Row>, StoreError> {
        if ids.is_empty() {
            return Ok(Vec::new());
        }
        let mut builder = QueryBuilder::new(text);
        builder.push(" where id in (");
        for (place, id) in ids.into_iter().enumerate() {
            if place > 0 {
                builder.push(", ");
            }
            builder.push_bind(id);
        }
        builder.push(")");
        Ok(builder.build().fetch_all(self.readers()).await?)
    }
}

fn standing(row: &Row, state: &'static str) -> Result<Standing, StoreError> {
    Ok(Standing { state, version: row.try_get("version")?, holder: Holder::read(row)? })
}
