//! The files that a store refers to, read without a store: from the database of a service that may be running.

use std::collections::BTreeSet;

use super::db::query;
use super::presence::Damage;
use super::{Database, StoreError, schema};

/// A result or an export as the database has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ExpectedFile {
    /// Relative to the place of results.
    pub(crate) path: String,
    /// Its length.
    pub(crate) bytes: u64,
    /// Its SHA-256, in hexadecimal.
    pub(crate) sha256: String,
}

/// The identity of a database, and which of these jobs and exports it has. The database is only read.
///
/// # Errors
/// The database's, or its tables are not those of this version.
pub(crate) async fn known_of(
    database: &Database,
    ids: &BTreeSet<String>,
) -> Result<(String, BTreeSet<String>), StoreError> {
    let readers = database.options().readers(None, &Damage::default()).await?;
    let mut tx = readers.begin().await?;
    let identity = schema::read(&mut tx, database).await?;
    let mut known = BTreeSet::new();
    for id in ids {
        let row = query("select 1 from jobs where id = ? union all select 1 from exports where id = ?");
        if row.bind(id.as_str()).bind(id.as_str()).fetch_optional(&mut tx).await?.is_some() {
            known.insert(id.clone());
        }
    }
    tx.rollback().await?;
    readers.close().await;
    Ok((identity, known))
}

/// All files that a database refers to, by path. The database is only read.
///
/// # Errors
/// The database's, or its tables are not those of this version.
pub(crate) async fn files_of(database: &Database) -> Result<Vec<ExpectedFile>, StoreError> {
    let readers = database.options().readers(None, &Damage::default()).await?;
    let mut tx = readers.begin().await?;
    schema::read(&mut tx, database).await?;
    let rows = query(
        "select path, bytes, sha256 from artifacts
         union all select path, bytes, sha256 from exports where path is not null order by path",
    )
    .fetch_all(&mut tx)
    .await?;
    tx.rollback().await?;
    readers.close().await;
    rows.iter()
        .map(|row| {
            let bytes = row.try_get::<i64>("bytes")?.cast_unsigned();
            Ok(ExpectedFile { path: row.try_get("path")?, bytes, sha256: row.try_get("sha256")? })
        })
        .collect()
}
