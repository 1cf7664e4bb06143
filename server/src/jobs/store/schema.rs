//! The tables of a database: made in an empty one, recognized in every other.
//!
//! Each kind of database has one text (`migrations/`), which is run at once. The row of the table `packstone` names
//! the database and counts the changes of the tables: a database of another number is refused with the version that
//! reads it. Nothing is released yet; from the first release on, a change of the tables is a migration besides.

use std::collections::BTreeMap;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};
use tokio::sync::OnceCell;

use super::clock::Clock;
use super::db::{Connection, Durability, Text, Transaction, either, query};
use super::{Database, StoreError};
use crate::hex;

/// Counts the changes of the tables. It rises with each change of the texts.
const SCHEMA: i64 = 8;
/// The tables in SQLite.
const SQLITE: &str = include_str!("../../../../migrations/sqlite.sql");
/// The tables in PostgreSQL.
const POSTGRES: &str = include_str!("../../../../migrations/postgres.sql");
/// The last build that reads tables without a number.
const READS_OLDER: &str = "Packstone 0.2.0 at commit 9f6917b";
/// The table that has the number.
const OWN: &str = "packstone";
/// A table that databases without a number have, too.
const SINCE_THE_BEGINNING: &str = "job_counts";

/// The names of all tables.
const TABLES: Text = either(
    "select name from sqlite_schema where type = 'table' and name not like 'sqlite\\_%' escape '\\' order by name",
    "select table_name::text from information_schema.tables where table_schema = current_schema() order by table_name",
);

/// The texts of all tables, indices and triggers of a file of SQLite, by their names.
const OBJECTS: &str = "select type || ' ' || name as name, coalesce(sql, '') as sql from sqlite_schema
    where name not like 'sqlite\\_%' escape '\\'";

/// Why a database is not used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SchemaError {
    /// Its tables have another number.
    #[error(
        "the database {database} has tables of {form}, which {reader} reads and this version, Packstone {} with schema \
         {SCHEMA}, does not: use that version, or start with an empty data directory or database",
        packstone_engine::VERSION
    )]
    Other {
        /// The database, without a password.
        database: String,
        /// The form of the tables.
        form: String,
        /// A version that reads them.
        reader: String,
    },
    /// Somebody has changed its tables, indices or triggers.
    #[error(
        "the database {database} is not as Packstone makes it: the {object} {change}. Undo the change, or restore a \
         backup"
    )]
    Changed {
        /// The database.
        database: String,
        /// What differs.
        object: String,
        /// How.
        change: &'static str,
    },
    /// It belongs to another program.
    #[error("the database {database} has tables of another program, as {table}: use another one")]
    Foreign {
        /// The database, without a password.
        database: String,
        /// A table.
        table: String,
    },
    /// It has no tables of Packstone.
    #[error("the database {database} has no tables: no service was started with it yet")]
    Empty {
        /// The database, without a password.
        database: String,
    },
}

/// Makes the tables where there are none, or makes sure that they are those of this version. Returns the identity of
/// the database. Servers that start together do it one after another.
///
/// # Errors
/// [`SchemaError`], or the database's; then nothing was changed.
pub(super) async fn prepare(connection: &mut Connection, database: &Database) -> Result<String, StoreError> {
    let clock = Clock::default();
    let mut tx = connection.begin_write(Durability::PowerCut, &clock).await?;
    let identity = match read(&mut tx, database).await {
        Err(StoreError::Schema(SchemaError::Empty { .. })) => create(&mut tx, &clock).await?,
        found => found?,
    };
    tx.commit().await?;
    Ok(identity)
}

/// The identity of a database whose tables are those of this version. The database is only read.
///
/// # Errors
/// [`SchemaError`], or the database's.
pub(super) async fn read(tx: &mut Transaction<'_>, database: &Database) -> Result<String, StoreError> {
    let tables: Vec<String> = query(TABLES).scalars(&mut *tx).await?;
    let has = |name: &str| tables.iter().any(|table| table == name);
    let (has_own, is_older) = (has(OWN), has(SINCE_THE_BEGINNING));
    let shown = database.to_string();
    if has_own {
        let row = query("select id, schema, version from packstone").fetch_optional(&mut *tx).await?;
        let row = row.ok_or_else(|| StoreError::Row("the table packstone has no row".into()))?;
        let schema: i64 = row.try_get("schema")?;
        if schema == SCHEMA {
            if matches!(tx, Transaction::Sqlite(..))
                && let Some((object, change)) = difference(objects().await?, &objects_in(tx).await?)
            {
                return Err(SchemaError::Changed { database: shown, object, change }.into());
            }
            return Ok(row.try_get("id")?);
        }
        let reader = format!("Packstone {}", row.text("version")?);
        return Err(SchemaError::Other { database: shown, form: format!("schema {schema}"), reader }.into());
    }
    if is_older {
        let (form, reader) = ("an older form".to_owned(), READS_OLDER.to_owned());
        return Err(SchemaError::Other { database: shown, form, reader }.into());
    }
    // A database of PostgreSQL may be shared with other programs, a file is not.
    match tables.into_iter().next().filter(|_| database.file().is_some()) {
        Some(table) => Err(SchemaError::Foreign { database: shown, table }.into()),
        None => Err(SchemaError::Empty { database: shown }.into()),
    }
}

/// Tables, indices and triggers with their texts.
type Objects = BTreeMap<String, String>;

/// Those that this version makes in SQLite.
async fn objects() -> Result<&'static Objects, sqlx::Error> {
    static OBJECTS: OnceCell<Objects> = OnceCell::const_new();
    OBJECTS
        .get_or_try_init(|| async {
            // Without a name it lies in memory.
            let memory =
                SqliteConnection::connect_with(&SqliteConnectOptions::new().create_if_missing(true)).await?;
            let mut memory = Connection::Sqlite(memory);
            let clock = Clock::default();
            let mut tx = memory.begin_write(Durability::ProcessEnd, &clock).await?;
            tx.run_script(SQLITE).await?;
            objects_in(&mut tx).await
        })
        .await
}

/// Those of an open database.
async fn objects_in(tx: &mut Transaction<'_>) -> Result<Objects, sqlx::Error> {
    let mut objects = Objects::new();
    for row in query(OBJECTS).fetch_all(tx).await? {
        objects.insert(row.try_get("name")?, row.try_get("sql")?);
    }
    Ok(objects)
}

/// The first object that is not as it was made, and how it differs.
fn difference(made: &Objects, found: &Objects) -> Option<(String, &'static str)> {
    let lost = made.iter().find_map(|(name, text)| match found.get(name) {
        None => Some((name.clone(), "is missing")),
        Some(other) => (other != text).then(|| (name.clone(), "was changed")),
    });
    lost.or_else(|| {
        found.keys().find(|name| !made.contains_key(*name)).map(|name| (name.clone(), "was added"))
    })
}

/// Makes the tables, and the identity of the database.
async fn create(tx: &mut Transaction<'_>, clock: &Clock) -> Result<String, StoreError> {
    let text = match tx {
        Transaction::Sqlite(..) => SQLITE,
        Transaction::Postgres(_) => POSTGRES,
    };
    tx.run_script(text).await?;
    let identity = hex::encode(&rand::random::<[u8; 16]>());
    query("insert into packstone (id, schema, version, created_at) values (?, ?, ?, ?)")
        .bind(&identity)
        .bind(SCHEMA)
        .bind(packstone_engine::VERSION)
        .bind(clock.now_us())
        .execute(tx)
        .await?;
    Ok(identity)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use tempfile::TempDir;

    use super::super::tests::{LIMITS, database, fresh_file, open};
    use super::super::{Store, files_of};
    use super::*;

    /// Runs statements on a file, as another program does.
    async fn change(folder: &TempDir, statements: &'static str) {
        let options = SqliteConnectOptions::new()
            .filename(folder.path().join("packstone.sqlite"))
            .create_if_missing(true);
        let mut file = SqliteConnection::connect_with(&options).await.unwrap();
        sqlx::raw_sql(statements).execute(&mut file).await.unwrap();
        file.close().await.unwrap();
    }

    /// What the opening of that file is refused with, by a service and by a command that only reads.
    async fn refused(folder: &TempDir) -> String {
        let file: Database = folder.path().join("packstone.sqlite").as_path().into();
        let opened = Store::open(&file, folder.path(), LIMITS, std::sync::Arc::default()).await;
        let (refused, read) =
            (opened.unwrap_err().to_string(), files_of(&file).await.unwrap_err().to_string());
        assert_eq!(refused, read);
        assert!(refused.contains(&file.to_string()), "{refused}");
        refused
    }

    #[tokio::test]
    async fn a_database_of_before_the_tables_had_a_number_is_refused_with_the_version_that_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        change(
            &folder,
            "create table _sqlx_migrations (version bigint); create table job_counts (jobs integer)",
        )
        .await;
        let refused = refused(&folder).await;
        assert!(
            refused.contains("an older form") && refused.contains("0.2.0 at commit 9f6917b reads"),
            "{refused}"
        );
    }

    #[tokio::test]
    async fn a_database_of_another_number_is_refused_with_the_version_that_made_it() {
        let (folder, store) = fresh_file().await;
        store.close().await;
        drop(store);
        change(&folder, "update packstone set schema = 99, version = '9.1.0'").await;
        let refused = refused(&folder).await;
        assert!(refused.contains("schema 99, which Packstone 9.1.0 reads"), "{refused}");
    }

    #[tokio::test]
    async fn a_file_whose_tables_somebody_has_changed_is_refused_with_the_object() {
        for (statements, told) in [
            ("drop index jobs_by_study", "the index jobs_by_study is missing"),
            ("drop trigger job_counts_insert", "the trigger job_counts_insert is missing"),
            ("alter table removals add column note text", "the table removals was changed"),
            ("create trigger added after insert on jobs begin select 1; end", "the trigger added was added"),
        ] {
            let (folder, store) = fresh_file().await;
            store.close().await;
            drop(store);
            change(&folder, statements).await;
            let refused = refused(&folder).await;
            assert!(refused.contains(told), "{refused}");
        }
        // What ANALYZE keeps is not the program's.
        let (folder, store) = fresh_file().await;
        store.close().await;
        drop(store);
        change(&folder, "analyze").await;
        open(&folder, LIMITS).await;
    }

    #[tokio::test]
    async fn a_file_of_another_program_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        change(&folder, "create table recipes (name text)").await;
        let content = || std::fs::read(folder.path().join("packstone.sqlite")).unwrap();
        let before = content();
        let refused = refused(&folder).await;
        assert!(content() == before, "the file was changed");
        assert!(refused.contains("another program, as recipes"), "{refused}");
    }

    #[tokio::test]
    async fn a_database_without_tables_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let database = database(&folder).await;
        if let Some(file) = database.file() {
            std::fs::write(file, "").unwrap();
        }
        let refused = files_of(&database).await.unwrap_err().to_string();
        assert!(refused.contains("has no tables"), "{refused}");
    }

    #[tokio::test]
    async fn the_identity_is_made_once_and_is_another_in_each_database() {
        let ((folder, other), (own, store)) = tokio::join!(fresh_file(), super::super::tests::fresh());
        let identity = store.identity().to_owned();
        assert_eq!(identity.len(), 32);
        assert_ne!(identity, other.identity());
        drop(store);
        assert_eq!(open(&own, LIMITS).await.identity(), identity);
        drop(folder);
    }

    #[tokio::test]
    async fn a_file_gives_back_its_free_pages() {
        let (_folder, store) = fresh_file().await;
        let mode: i64 =
            query("select auto_vacuum from pragma_auto_vacuum").scalar(store.readers()).await.unwrap();
        assert_eq!(mode, 2, "incremental");
    }

    #[tokio::test]
    async fn the_copy_of_a_row_has_every_column() {
        let (_folder, store) = fresh_file().await;
        let rows = query(
            "select t.name, c.name as column, t.sql from sqlite_schema as t join pragma_table_info(t.name) as c
             where t.type = 'table' and t.sql like '%is_whole integer%'",
        )
        .fetch_all(store.readers())
        .await
        .unwrap();
        let mut tables = std::collections::BTreeSet::new();
        for row in &rows {
            let (table, column) = (row.text("name").unwrap(), row.text("column").unwrap());
            tables.insert(table);
            // The number of the row, by which it is found, and the report, which has a digest.
            let is_apart = matches!((table, column), (_, "seq") | ("artifacts", "job" | "report"));
            let (_, arguments) = row.text("sql").unwrap().split_once("%Q'").unwrap();
            let (arguments, _) = arguments.split_once("virtual").unwrap();
            let words = arguments.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            let copies = words.filter(|word| *word == column).count();
            assert_eq!(copies, usize::from(!is_apart), "{table}.{column}");
        }
        assert!(tables.len() == 6 && rows.len() > 110, "{tables:?} {}", rows.len());
    }

    #[tokio::test]
    async fn triggers_of_jobs_name_the_first_32_columns_alone() {
        let (_folder, store) = fresh_file().await;
        let named = query(
            "select c.name || ' in ' || t.name from pragma_table_xinfo('jobs') as c
             join sqlite_schema as t on t.type = 'trigger' and t.tbl_name = 'jobs'
             where c.cid >= 32 and (instr(t.sql, 'old.' || c.name) or instr(t.sql, 'new.' || c.name))",
        );
        assert_eq!(named.scalars::<String>(store.readers()).await.unwrap(), Vec::<String>::new());
    }

    #[tokio::test]
    async fn both_databases_have_the_same_columns_indices_and_triggers() {
        use std::collections::BTreeSet;

        /// All that a query answers, as lines.
        async fn lines(store: &Store, text: &'static str) -> BTreeSet<String> {
            query(text).scalars(store.readers()).await.unwrap().into_iter().collect()
        }

        if std::env::var_os("PACKSTONE_TEST_POSTGRES").is_none() {
            eprintln!("SKIPPED: PACKSTONE_TEST_POSTGRES names no PostgreSQL");
            return;
        }
        let ((_file, sqlite), (_folder, postgres)) = tokio::join!(fresh_file(), super::super::tests::fresh());
        let columns = lines(
            &sqlite,
            "select t.name || '.' || c.name || case when c.\"notnull\" or c.pk then ' not null' else '' end
             from sqlite_schema as t join pragma_table_xinfo(t.name) as c
             where t.type = 'table' and t.name not like 'sqlite_%'",
        )
        .await;
        assert!(columns.len() > 160, "{}", columns.len());
        let theirs = lines(
            &postgres,
            "select (table_name || '.' || column_name || case when is_nullable = 'NO'
                 then ' not null' else '' end)::text
             from information_schema.columns where table_schema = 'public'",
        )
        .await;
        assert_eq!(theirs, columns);
        let named = "select name from sqlite_schema where type = 'index' and name not like 'sqlite_%'";
        let indices = lines(&sqlite, named).await;
        let theirs = lines(
            &postgres,
            "select indexname::text from pg_indexes where schemaname = 'public'
                 and not exists (select 1 from pg_constraint where conname = indexname)",
        )
        .await;
        assert_eq!(theirs, indices);
        let triggers = lines(&sqlite, "select name from sqlite_schema where type = 'trigger'").await;
        let theirs = lines(&postgres, "select tgname::text from pg_trigger where not tgisinternal").await;
        assert_eq!(theirs, triggers);
    }
}
