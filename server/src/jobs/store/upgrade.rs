//! Carries what data directories of revision 1 hold to the names of the present revision, once, at the start.
//!
//! Revision 1 is that of version 0.1 before the fields of requests were renamed. Numbers are moved as they are: JSON is
//! read and written with the shortest text that gives the same number, and integers stay integers. The database's
//! `user_version` says whether it has been done.

use packstone_engine::export::ExportRequest;
use packstone_engine::packing::Report;
use packstone_engine::request::{upgrade, upgrade_export};
use serde_json::{Map, Value};
use sqlx::{Connection as _, Row as _, SqliteConnection};

use super::{StoreError, rows};
use crate::exports::NewExport;
use crate::hex;

/// `user_version` of a database whose documents have the present names.
const PRESENT: i64 = 2;
/// Revision of the bytes of exports that revision 1 made.
const EXPORT_REVISION_1: u32 = 1;
/// Rows that are in memory together: a request may have a million diameters.
const ROWS_AT_ONCE: i64 = 100;

/// Renames what needs it, in one transaction.
///
/// # Errors
/// The database's; then nothing was changed.
pub(super) async fn run(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let version: i64 = sqlx::query_scalar("pragma user_version").fetch_one(&mut *connection).await?;
    if version >= PRESENT {
        return Ok(());
    }
    let mut tx = connection.begin_with("begin immediate").await?;
    let requests = upgrade_bodies(&mut tx, "job_requests", "job", upgrade).await?;
    upgrade_bodies(&mut tx, "study_requests", "study", upgrade_study).await?;
    upgrade_columns(&mut tx).await?;
    upgrade_reports(&mut tx).await?;
    let exports = upgrade_exports(&mut tx).await?;
    sqlx::query("pragma user_version = 2").execute(&mut *tx).await?;
    tx.commit().await?;
    if requests + exports > 0 {
        tracing::info!(requests, exports, "carried a data directory of revision 1 to the present names");
    }
    Ok(())
}

/// Rewrites the documents of a table whose form changes, and counts them.
async fn upgrade_bodies(
    connection: &mut SqliteConnection,
    table: &'static str,
    key: &'static str,
    change: impl Fn(&mut Value),
) -> Result<u64, StoreError> {
    let (select, update) = match (table, key) {
        ("job_requests", _) => (
            "select job as seq, body from job_requests where job > ? order by job limit ?",
            "update job_requests set body = ? where job = ?",
        ),
        _ => (
            "select study as seq, body from study_requests where study > ? order by study limit ?",
            "update study_requests set body = ? where study = ?",
        ),
    };
    let (mut after, mut changed) = (i64::MIN, 0);
    loop {
        let found = sqlx::query(select).bind(after).bind(ROWS_AT_ONCE).fetch_all(&mut *connection).await?;
        let Some(last) = found.last() else { return Ok(changed) };
        after = last.try_get("seq")?;
        for row in &found {
            let before: String = row.try_get("body")?;
            let mut document: Value = rows::json(&before)?;
            change(&mut document);
            let text = document.to_string();
            if text != before {
                sqlx::query(update)
                    .bind(text)
                    .bind(row.try_get::<i64, _>("seq")?)
                    .execute(&mut *connection)
                    .await?;
                changed += 1;
            }
        }
    }
}

/// A study's request: its template or list of jobs, and the pointers of its axes with their values.
fn upgrade_study(study: &mut Value) {
    if let Some(template) = study.get_mut("template") {
        upgrade(template);
    }
    for job in study.get_mut("list").and_then(Value::as_array_mut).into_iter().flatten() {
        upgrade(job);
    }
    for axes in ["grid", "zip"] {
        let Some(axes) = study.get_mut(axes).and_then(Value::as_object_mut) else { continue };
        let upgraded = std::mem::take(axes).into_iter().map(|(pointer, mut values)| {
            for value in values.as_array_mut().into_iter().flatten() {
                upgrade_at(&pointer, value);
            }
            (upgrade_pointer(&pointer), values)
        });
        *axes = upgraded.collect();
    }
}

/// A pointer into a job's request, by the present names.
fn upgrade_pointer(pointer: &str) -> String {
    upgrade_at(pointer, &mut Value::Null)
}

/// Renames what lies in a value at a pointer into a job's request, and returns the pointer by the present names.
fn upgrade_at(pointer: &str, value: &mut Value) -> String {
    let names: Vec<&str> = pointer.split('/').skip(1).collect();
    let mut request = names
        .iter()
        .rev()
        .fold(value.take(), |inner, name| Value::Object(Map::from_iter([((*name).to_owned(), inner)])));
    upgrade(&mut request);
    let mut upgraded = String::new();
    for _ in &names {
        // Each object on the way has one field, which may have another name now.
        let Value::Object(object) = request else { break };
        let Some((name, inner)) = object.into_iter().next() else { return pointer.to_owned() };
        upgraded.push('/');
        upgraded.push_str(&name);
        request = inner;
    }
    *value = request;
    upgraded
}

/// The columns of studies' tables, and the values of their points.
async fn upgrade_columns(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let studies =
        sqlx::query("select seq, columns, key_columns from studies").fetch_all(&mut *connection).await?;
    for row in studies {
        let study: i64 = row.try_get("seq")?;
        let columns: Vec<String> = rows::json(&row.try_get::<String, _>("columns")?)?;
        let keys: Vec<String> = rows::json(&row.try_get::<String, _>("key_columns")?)?;
        let renamed = |names: &[String]| -> Vec<String> {
            let name =
                |name: &String| if name.starts_with('/') { upgrade_pointer(name) } else { name.clone() };
            names.iter().map(name).collect()
        };
        sqlx::query("update studies set columns = ?, key_columns = ? where seq = ?")
            .bind(super::submit::to_json(&renamed(&columns))?)
            .bind(super::submit::to_json(&renamed(&keys))?)
            .bind(study)
            .execute(&mut *connection)
            .await?;
        let points = sqlx::query("select point, key_values from study_points where study = ?")
            .bind(study)
            .fetch_all(&mut *connection)
            .await?;
        for point in points {
            let before: String = point.try_get("key_values")?;
            let mut values: Vec<Value> = rows::json(&before)?;
            for (key, value) in keys.iter().zip(&mut values).filter(|(key, _)| key.starts_with('/')) {
                upgrade_at(key, value);
            }
            let after = super::submit::to_json(&values)?;
            if after != before {
                sqlx::query("update study_points set key_values = ? where study = ? and point = ?")
                    .bind(after)
                    .bind(study)
                    .bind(point.try_get::<i64, _>("point")?)
                    .execute(&mut *connection)
                    .await?;
            }
        }
    }
    Ok(())
}

/// The reports of results, whose fields the engine reads by their old names too. Lengths are counted anew at the next
/// request of a result: its head has other names, too.
async fn upgrade_reports(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let mut after = i64::MIN;
    loop {
        let found = sqlx::query("select job, report from artifacts where job > ? order by job limit ?")
            .bind(after)
            .bind(ROWS_AT_ONCE)
            .fetch_all(&mut *connection)
            .await?;
        let Some(last) = found.last() else { return Ok(()) };
        after = last.try_get("job")?;
        for row in &found {
            // One that this version does not know stays as it is: the result can still be fetched.
            let Ok(report) = rows::json::<Report>(&row.try_get::<String, _>("report")?) else { continue };
            sqlx::query("update artifacts set report = ?, format_revision = 0 where job = ?")
                .bind(super::submit::to_json(&report)?)
                .bind(row.try_get::<i64, _>("job")?)
                .execute(&mut *connection)
                .await?;
        }
    }
}

/// Options, types and reports of exports, and the keys by which they are found again; counts them.
async fn upgrade_exports(connection: &mut SqliteConnection) -> Result<u64, StoreError> {
    let found = sqlx::query(
        "select exports.seq, exports.options, exports.report, artifacts.sha256 from exports
         join artifacts on artifacts.job = exports.job",
    )
    .fetch_all(&mut *connection)
    .await?;
    for row in &found {
        let mut options: Value = rows::json(&row.try_get::<String, _>("options")?)?;
        upgrade_export(&mut options);
        let report = match row.try_get::<Option<String>, _>("report")? {
            Some(report) => {
                let mut report: Value = rows::json(&report)?;
                upgrade_export(&mut report);
                Some(report.to_string())
            }
            None => None,
        };
        let seq: i64 = row.try_get("seq")?;
        // Options that this version does not know stay as they are: their file can still be fetched.
        let Ok(request) = ExportRequest::from_json(&options) else { continue };
        let new = NewExport::new(&request, "");
        let result: String = row.try_get("sha256")?;
        let key = hex::sha256(format!("{result}\n{}\n{EXPORT_REVISION_1}", new.options).as_bytes());
        sqlx::query("update or replace exports set type = ?, options = ?, report = ?, key = ? where seq = ?")
            .bind(new.kind.name())
            .bind(&new.options)
            .bind(report)
            .bind(key)
            .bind(seq)
            .execute(&mut *connection)
            .await?;
    }
    Ok(found.len() as u64)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_axes_of_a_study_are_renamed_with_their_values() {
        let mut study = json!({
            "seed": 3,
            "template": {"distance": {"type": "constant", "mm": 1.0}},
            "grid": {
                "/distance/mm": [0.25, 1],
                "/mix/basis": ["mixture", "effective"],
                "/mix/grading": [{"type": "diameters", "mm": [4.0]}],
                "/mix/volume_fraction": [0.300_000_000_000_000_04]
            },
            "zip": {"/placement": [{"type": "random"}]}
        });
        upgrade_study(&mut study);
        let expected = json!({
            "seed": 3,
            "template": {"distance": {"type": "constant", "gap_mm": 1.0}},
            "grid": {
                "/distance/gap_mm": [0.25, 1],
                "/mix/volume_fraction_of": ["all_aggregate", "placed_grains"],
                "/mix/grading": [{"type": "diameters", "diameters_mm": [4.0]}],
                "/mix/volume_fraction": [0.300_000_000_000_000_04]
            },
            "zip": {"/segregation": [{"type": "none"}]}
        });
        assert_eq!(study.to_string(), expected.to_string());
        let again = study.to_string();
        upgrade_study(&mut study);
        assert_eq!(study.to_string(), again);
    }

    #[test]
    fn pointers_that_kept_their_names_stay() {
        for pointer in ["/method/growth_rate", "/specimen/size_mm/0", "/name", "/mix/grading/points/3/1"] {
            assert_eq!(upgrade_pointer(pointer), pointer);
        }
        assert_eq!(upgrade_pointer("/mix/content/air"), "/mix/proportions/air");
    }
}
