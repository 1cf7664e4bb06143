//! The migrations of the database, embedded at compile time.
//!
//! `sqlx::migrate!` would do the same, but its macro crate builds SQLite a second time for the build host.

use std::borrow::Cow;

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Version, description and text of each migration, oldest first. A published migration never changes.
const MIGRATIONS: &[(i64, &str, &str)] = &[
    (1, "jobs", include_str!("../../../../migrations/0001_jobs.sql")),
    (2, "studies", include_str!("../../../../migrations/0002_studies.sql")),
    (3, "derived", include_str!("../../../../migrations/0003_derived.sql")),
    (4, "exports", include_str!("../../../../migrations/0004_exports.sql")),
    (5, "storage", include_str!("../../../../migrations/0005_storage.sql")),
    (6, "failures", include_str!("../../../../migrations/0006_failures.sql")),
    (7, "methods", include_str!("../../../../migrations/0007_methods.sql")),
    (8, "warnings", include_str!("../../../../migrations/0008_warnings.sql")),
    (9, "orders", include_str!("../../../../migrations/0009_orders.sql")),
    (10, "owners", include_str!("../../../../migrations/0010_owners.sql")),
    (11, "queues", include_str!("../../../../migrations/0011_queues.sql")),
    (12, "starts", include_str!("../../../../migrations/0012_starts.sql")),
    (13, "leases", include_str!("../../../../migrations/0013_leases.sql")),
    (14, "webhooks", include_str!("../../../../migrations/0014_webhooks.sql")),
    (15, "forecasts", include_str!("../../../../migrations/0015_forecasts.sql")),
    (16, "export_leases", include_str!("../../../../migrations/0016_export_leases.sql")),
    (17, "least_time", include_str!("../../../../migrations/0017_least_time.sql")),
    (18, "webhook_urls", include_str!("../../../../migrations/0018_webhook_urls.sql")),
    (19, "start_turns", include_str!("../../../../migrations/0019_start_turns.sql")),
    (20, "threads", include_str!("../../../../migrations/0020_threads.sql")),
    (21, "export_attempts", include_str!("../../../../migrations/0021_export_attempts.sql")),
    (22, "fewer_triggers", include_str!("../../../../migrations/0022_fewer_triggers.sql")),
];

/// The migrations up to and including `last`; all of them for `i64::MAX`.
pub(super) fn migrations_to(last: i64) -> Migrator {
    migrator(MIGRATIONS.iter().filter(|(version, ..)| *version <= last))
}

fn migrator<'m>(migrations: impl Iterator<Item = &'m (i64, &'static str, &'static str)>) -> Migrator {
    Migrator::with_migrations(
        migrations
            .map(|&(version, description, sql)| {
                Migration::new(
                    version,
                    Cow::Borrowed(description),
                    MigrationType::Simple,
                    sql.into_sql_str(),
                    false,
                )
            })
            .collect(),
    )
}

/// The same for PostgreSQL: the tables as the migrations of SQLite have left them when it was added, and each change
/// since. A test holds both against each other.
#[cfg(feature = "postgres")]
const OF_POSTGRES: &[(i64, &str, &str)] = &[
    (18, "schema", include_str!("../../../../migrations/postgres/0018_schema.sql")),
    (19, "start_turns", include_str!("../../../../migrations/postgres/0019_start_turns.sql")),
    (20, "threads", include_str!("../../../../migrations/postgres/0020_threads.sql")),
    (21, "export_attempts", include_str!("../../../../migrations/postgres/0021_export_attempts.sql")),
    (22, "fewer_triggers", include_str!("../../../../migrations/postgres/0022_fewer_triggers.sql")),
];

/// All migrations of PostgreSQL. Servers that start together run them one after another, by a lock of sqlx.
#[cfg(feature = "postgres")]
pub(super) fn of_postgres() -> Migrator {
    migrator(OF_POSTGRES.iter())
}

#[cfg(all(test, feature = "postgres"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::db::query;
    use super::super::tests::{fresh, fresh_file};

    /// All that a query answers, as lines.
    async fn lines(store: &super::super::Store, text: &'static str) -> BTreeSet<String> {
        query(text).scalars(store.readers()).await.unwrap().into_iter().collect()
    }

    #[tokio::test]
    async fn both_databases_have_the_same_columns_indices_and_triggers() {
        if std::env::var_os("PACKSTONE_TEST_POSTGRES").is_none() {
            eprintln!("SKIPPED: PACKSTONE_TEST_POSTGRES names no PostgreSQL");
            return;
        }
        let ((_file, sqlite), (_folder, postgres)) = tokio::join!(fresh_file(), fresh());
        let columns = lines(
            &sqlite,
            "select t.name || '.' || c.name || case when c.\"notnull\" or c.pk then ' not null' else '' end
             from sqlite_schema as t join pragma_table_xinfo(t.name) as c
             where t.type = 'table' and t.name not like 'sqlite_%' and t.name not like '\\_sqlx%' escape '\\'",
        )
        .await;
        assert!(columns.len() > 160, "{}", columns.len());
        let theirs = lines(
            &postgres,
            "select (table_name || '.' || column_name || case when is_nullable = 'NO'
                 then ' not null' else '' end)::text
             from information_schema.columns
             where table_schema = 'public' and table_name not like '\\_sqlx%'",
        )
        .await;
        assert_eq!(theirs, columns);
        let named = "select name from sqlite_schema where type = 'index' and name not like 'sqlite_%'";
        let indices = lines(&sqlite, named).await;
        let theirs = lines(
            &postgres,
            "select indexname::text from pg_indexes where schemaname = 'public' and indexname not like '\\_sqlx%'
                 and not exists (select 1 from pg_constraint where conname = indexname)",
        )
        .await;
        assert_eq!(theirs, indices);
        let triggers = lines(&sqlite, "select name from sqlite_schema where type = 'trigger'").await;
        let theirs = lines(&postgres, "select tgname::text from pg_trigger where not tgisinternal").await;
        assert_eq!(theirs, triggers);
    }
}
