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
    (16, "least time", include_str!("../../../../migrations/0016_least_time.sql")),
    (17, "webhook urls", include_str!("../../../../migrations/0017_webhook_urls.sql")),
];

/// The migrations up to and including `last`; all of them for `i64::MAX`.
pub(super) fn migrations_to(last: i64) -> Migrator {
    let migrations = MIGRATIONS.iter().filter(|(version, ..)| *version <= last);
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
