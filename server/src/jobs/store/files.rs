//! The files that a store refers to, read without a store: from the database of a service that may be running.

use super::db::query;
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

/// All files that a database refers to, by path. The database is only read.
///
/// # Errors
/// The database's, or its tables are not those of this version.
pub(crate) async fn files_of(database: &Database) -> Result<Vec<ExpectedFile>, StoreError> {
    let readers = database.options().readers().await?;
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
