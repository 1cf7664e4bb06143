//! Taking a study in: all of its jobs or none, in one transaction.

use std::collections::BTreeMap;
use std::sync::Arc;

use packstone_engine::export::tables::EngineInfo;
use serde_json::Value;

use super::super::bodies::{Parts, StoredBody};
use super::super::db::{QueryBuilder, Transaction, either, query};
use super::super::submit::{IdempotencyKey, to_json};
use super::super::{Store, StoreError, forecasts, turns, webhooks};
use super::{StudyRecord, query};
use crate::accounts::Submitter;
use crate::ids::{JobId, StudyId};
use crate::jobs::{JobRequest, Overview};
use crate::studies::{Point, Study};
use crate::tasks;

/// Rows of one insert: a statement has at most 32 766 parameters.
const ROWS_AT_ONCE: usize = 1000;
/// Bytes of the requests of one insert, but for the last: they are in memory at the same time.
const BYTES_AT_ONCE: i64 = 4 << 20;

/// A study to accept.
#[derive(Clone, Debug)]
pub(crate) struct NewStudy {
    pub(crate) study: Study,
    /// The request as submitted, with its seed.
    pub(crate) request: Value,
    /// Who submits it.
    pub(crate) by: Submitter,
    pub(crate) idempotency_key: Option<IdempotencyKey>,
}

/// What became of a submission.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum SubmittedStudy {
    /// The study was accepted.
    Created(StudyRecord),
    /// The same key brought this study before.
    Existing(StudyRecord),
}

/// A job as it is written.
struct Row<'a> {
    seq: i64,
    point: usize,
    replicate: usize,
    turn: i64,
    job: &'a JobRequest,
    seed: u64,
    warnings: &'a [String],
    forecast_us: i64,
    least_time_us: i64,
    most_threads: i64,
}

impl Store {
    /// Takes a study in with all its jobs; they are safe on disk when this returns.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], [`StoreError::OwnerQueueFull`], [`StoreError::KeyReused`], or the database's; nothing
    /// is stored then.
    pub(crate) async fn submit_study(&self, new: NewStudy) -> Result<SubmittedStudy, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let submitted = store.insert_study(&Arc::new(new)).await?;
            if let SubmittedStudy::Created(study) = &submitted {
                store.notify_study(study.id);
                store.wake_worker();
            }
            Ok(submitted)
        })
        .await
    }

    /// Whether a study was submitted with this key before.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn knows_study_key(&self, key: &IdempotencyKey) -> Result<bool, StoreError> {
        let row = query("select 1 from study_keys where scope = ? and key = ?")
            .bind(&key.scope)
            .bind(&key.key)
            .fetch_optional(self.readers())
            .await?;
        Ok(row.is_some())
    }

    async fn insert_study(&self, new: &Arc<NewStudy>) -> Result<SubmittedStudy, StoreError> {
        let jobs = new.study.jobs() as u64;
        let of = Arc::clone(new);
        let splitting = tasks::blocking(move || {
            let mut parts = Parts::default();
            let request = parts.split(&to_json(&of.request)?);
            Ok::<_, StoreError>((request, parts))
        });
        let (request, parts) = splitting.await??;
        let mut writer = self.writer().await?;
        let mut tx = writer.begin().await?;
        if let Some(existing) = find_key(&mut tx, new.idempotency_key.as_ref()).await? {
            return Ok(SubmittedStudy::Existing(existing));
        }
        self.check_queue(&mut tx, &new.by.owner, jobs).await?;
        let now = self.now_us();
        let study = insert_head(&mut tx, new, &request, now).await?;
        insert_points(&mut tx, study, &new.study).await?;
        let rows = rows_of(&mut tx, study, new).await?;
        let bytes_of_parts = insert_jobs(&mut tx, study, &rows, new, now, parts).await?;
        count_parts(&mut tx, study, &new.by.owner, bytes_of_parts).await?;
        insert_labels(&mut tx, &rows).await?;
        let record = query::by_seq(&mut tx, study).await?;
        tx.commit().await?;
        Ok(SubmittedStudy::Created(record))
    }
}

async fn find_key(
    tx: &mut Transaction<'_>,
    key: Option<&IdempotencyKey>,
) -> Result<Option<StudyRecord>, StoreError> {
    let Some(key) = key else { return Ok(None) };
    let row = query("select body_sha256, study from study_keys where scope = ? and key = ?")
        .bind(&key.scope)
        .bind(&key.key)
        .fetch_optional(&mut *tx)
        .await?;
    let Some(row) = row else { return Ok(None) };
    if row.try_get::<String>("body_sha256")? != key.body_sha256 {
        return Err(StoreError::KeyReused);
    }
    query::by_seq(tx, row.try_get("study")?).await.map(Some)
}

/// Writes all that there is of a study but its points and jobs, and returns its number.
async fn insert_head(
    tx: &mut Transaction<'_>,
    new: &NewStudy,
    request: &StoredBody,
    now: i64,
) -> Result<i64, StoreError> {
    let study = &new.study;
    let seq: i64 = query(
        "insert into studies (id, name, labels, seed, columns, key_columns, points, replicates, stop_when, queued,
             created_at, updated_at, expires_at, owner, submitted_by, shared, request_bytes)
         values (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) returning seq",
    )
    .bind(StudyId::new().to_string())
    .bind(&study.name)
    .bind(to_json(&study.labels)?)
    .bind(study.seed.cast_signed())
    .bind(to_json(&study.columns)?)
    .bind(to_json(&study.keys().columns)?)
    .bind(study.points.len() as i64)
    .bind(study.replicates as i64)
    .bind(to_json(&study.stop_when)?)
    .bind(study.jobs() as i64)
    .bind(now)
    .bind(now)
    .bind(expires_at_us(study))
    .bind(&new.by.owner)
    .bind(&new.by.key)
    .bind(study.shared)
    .bind(request.bytes())
    .fetch_one(&mut *tx)
    .await?
    .try_get("seq")?;
    query("insert into study_requests (study, body, part, part_at, digest) values (?, ?, ?, ?, ?)")
        .bind(seq)
        .bind(&request.text)
        .bind(request.part)
        .bind(request.part_at)
        .bind(request.digest)
        .execute(&mut *tx)
        .await?;
    webhooks::insert(tx, webhooks::Ending::Study(seq), study.webhook_url.as_ref()).await?;
    for (key, value) in &study.labels {
        query("insert into study_labels (key, value, study) values (?, ?, ?)")
            .bind(key)
            .bind(value)
            .bind(seq)
            .execute(&mut *tx)
            .await?;
    }
    if let Some(key) = &new.idempotency_key {
        query("insert into study_keys (scope, key, body_sha256, study) values (?, ?, ?, ?)")
            .bind(&key.scope)
            .bind(&key.key)
            .bind(&key.body_sha256)
            .bind(seq)
            .execute(&mut *tx)
            .await?;
    }
    Ok(seq)
}

/// A study goes when the last of its jobs may go; where one of them may stay, it stays.
fn expires_at_us(study: &Study) -> Option<i64> {
    let jobs = study.points.iter().map(|point| point.job.expires_at_us());
    jobs.collect::<Option<Vec<_>>>()?.into_iter().max()
}

async fn insert_points(tx: &mut Transaction<'_>, study: i64, of: &Study) -> Result<(), StoreError> {
    let keys = of.keys().values.iter().map(to_json).collect::<Result<Vec<_>, _>>()?;
    let points: Vec<_> = keys.into_iter().enumerate().collect();
    for chunk in points.chunks(ROWS_AT_ONCE) {
        let mut query = QueryBuilder::new("insert into study_points (study, point, key_values) ");
        query.push_values(chunk, |row, (point, keys)| {
            row.push_bind(study).push_bind(*point as i64).push_bind(keys.clone());
        });
        query.build().execute(&mut *tx).await?;
    }
    Ok(())
}

/// The number that was given last. Jobs inserted with numbers of their own raise it.
const LAST_NUMBER: &str = "select seq from sqlite_sequence where name = 'jobs' and ?1 > 0";
/// The same, with so many numbers beyond it reserved: the sequence of PostgreSQL is not raised by inserts.
const RESERVE_NUMBERS: &str = "select setval(name::regclass, nextval(name::regclass) + ?1 - 1) - ?1
    from (select pg_get_serial_sequence('jobs', 'seq') as name) as sequence";

/// Gives every job its number and its turn.
async fn rows_of<'a>(
    tx: &mut Transaction<'_>,
    study: i64,
    new: &'a NewStudy,
) -> Result<Vec<Row<'a>>, StoreError> {
    let of = &new.study;
    let last: Option<i64> = query(either(LAST_NUMBER, RESERVE_NUMBERS))
        .bind(new.study.jobs() as i64)
        .optional_scalar(&mut *tx)
        .await?;
    let mut jobs_of: BTreeMap<i64, i64> = BTreeMap::new();
    for point in &of.points {
        *jobs_of.entry(point.job.priority).or_default() += of.replicates as i64;
    }
    let mut next_turn = BTreeMap::new();
    for (priority, jobs) in jobs_of {
        let flow = turns::Flow { owner: &new.by.owner, number: study, priority };
        next_turn.insert(priority, turns::assign_start_times(tx, flow, jobs).await?);
    }
    let rows = of.order().zip(last.unwrap_or(0) + 1..).map(|((point, replicate), seq)| {
        let Point { job, seeds, warnings, forecast_s, keeps_checkpoints, most_threads, .. } =
            &of.points[point];
        let most_threads = i64::from(*most_threads);
        let forecast_us = forecasts::micros_of(*forecast_s, job.timeout_s);
        let least_time_us = forecasts::least_time_us(forecast_us, *keeps_checkpoints);
        let next = next_turn.entry(job.priority).or_insert(0);
        let turn = *next;
        *next += 1;
        let seed = seeds[replicate];
        Row { seq, point, replicate, turn, job, seed, warnings, forecast_us, least_time_us, most_threads }
    });
    Ok(rows.collect())
}

/// Writes the jobs with their requests, and returns the bytes of the parts of these. Requests are written as text off
/// the threads that answer: there may be ten thousand, or each may have a million diameters.
async fn insert_jobs(
    tx: &mut Transaction<'_>,
    study: i64,
    rows: &[Row<'_>],
    new: &Arc<NewStudy>,
    now: i64,
    mut parts: Parts,
) -> Result<i64, StoreError> {
    let engine = to_json(&EngineInfo::current())?;
    let (owner, key) = (&new.by.owner, &new.by.key);
    let mut left = rows;
    while !left.is_empty() {
        let places: Vec<_> = left.iter().take(ROWS_AT_ONCE).map(|row| (row.point, row.replicate)).collect();
        let of = Arc::clone(new);
        let writing = tasks::blocking(move || {
            let bodies = bodies_of(&of.study, &places, &mut parts);
            (bodies, parts)
        });
        let bodies;
        (bodies, parts) = writing.await?;
        let bodies = bodies?;
        let chunk;
        (chunk, left) = left.split_at(bodies.len());
        let texts = |row: &Row<'_>| {
            Ok((to_json(&row.job.labels)?, to_json(&row.warnings)?, to_json(&Overview::of(row.job))?))
        };
        let texts = chunk.iter().map(texts).collect::<Result<Vec<_>, StoreError>>()?;
        parts.insert(tx, study).await?;
        // What all jobs have in common is bound once. Column 8 of the rows is `max_attempts`, which a retry adds again.
        let mut query = QueryBuilder::new(
            "insert into jobs (state, attempt_budget, created_at, updated_at, engine, study, owner, submitted_by,
                 seq, id, name, labels, priority, seed, timeout_s, max_attempts, expires_at, point, replicate, turn,
                 warnings, shared, forecast_us, least_time_us, threads, most_threads, method, request_bytes,
                 overview)
             select 'queued', rows.column8, now, now, engine, study, owner, submitted_by, rows.*
             from (select ",
        );
        query.push_bind(now).push(" as now, ").push_bind(&engine).push(" as engine, ");
        query.push_bind(study).push(" as study, ").push_bind(owner).push(" as owner, ");
        query.push_bind(key).push(" as submitted_by) as common cross join (");
        query.push_values(
            chunk.iter().zip(texts).zip(&bodies),
            |values, ((row, (labels, warnings, overview)), body)| {
                let job = row.job;
                values.push_bind(row.seq).push_bind(JobId::new().to_string()).push_bind(&job.name);
                values.push_bind(labels).push_bind(job.priority).push_bind(row.seed.cast_signed());
                values.push_bind(job.timeout_s).push_bind(job.max_attempts).push_bind(job.expires_at_us());
                values.push_bind(row.point as i64).push_bind(row.replicate as i64).push_bind(row.turn);
                values.push_bind(warnings).push_bind(new.study.shared || job.shared);
                values.push_bind(row.forecast_us).push_bind(row.least_time_us).push_bind(job.threads);
                values.push_bind(row.most_threads).push_bind(job.method_name()).push_bind(body.bytes());
                values.push_bind(overview);
            },
        );
        query.push(") as rows");
        query.build().execute(&mut *tx).await?;
        insert_bodies(tx, chunk, bodies).await?;
    }
    Ok(parts.bytes())
}

/// The requests of the first of these jobs, at least one, as many as have [`BYTES_AT_ONCE`].
fn bodies_of(
    study: &Study,
    places: &[(usize, usize)],
    parts: &mut Parts,
) -> Result<Vec<StoredBody>, StoreError> {
    let (mut bodies, mut bytes) = (Vec::with_capacity(places.len()), 0);
    for (point, replicate) in places {
        let body = parts.split(&to_json(&study.points[*point].replicate(*replicate))?);
        bytes += body.bytes();
        bodies.push(body);
        if bytes >= BYTES_AT_ONCE {
            break;
        }
    }
    Ok(bodies)
}

async fn insert_bodies(
    tx: &mut Transaction<'_>,
    rows: &[Row<'_>],
    bodies: Vec<StoredBody>,
) -> Result<(), StoreError> {
    let mut query = QueryBuilder::new("insert into job_requests (job, body, part, part_at, digest) ");
    query.push_values(rows.iter().zip(bodies), |values, (row, body)| {
        values.push_bind(row.seq).push_bind(body.text).push_bind(body.part).push_bind(body.part_at);
        values.push_bind(body.digest);
    });
    query.build().execute(tx).await?;
    Ok(())
}

/// Adds the bytes of the parts, which are known once all bodies are written, to those of the study and its owner.
async fn count_parts(
    tx: &mut Transaction<'_>,
    study: i64,
    owner: &str,
    bytes: i64,
) -> Result<(), StoreError> {
    if bytes == 0 {
        return Ok(());
    }
    query("update studies set request_bytes = request_bytes + ? where seq = ?")
        .bind(bytes)
        .bind(study)
        .execute(&mut *tx)
        .await?;
    query("update queue_owners set request_bytes = request_bytes + ? where owner = ?")
        .bind(bytes)
        .bind(owner)
        .execute(tx)
        .await?;
    Ok(())
}

async fn insert_labels(tx: &mut Transaction<'_>, rows: &[Row<'_>]) -> Result<(), StoreError> {
    let labels: Vec<_> =
        rows.iter().flat_map(|row| row.job.labels.iter().map(|(key, value)| (row.seq, key, value))).collect();
    for chunk in labels.chunks(ROWS_AT_ONCE) {
        let mut query = QueryBuilder::new("insert into job_labels (key, value, job, state) ");
        query.push_values(chunk, |values, (job, key, value)| {
            values.push_bind((*key).clone()).push_bind((*value).clone()).push_bind(*job).push_bind("queued");
        });
        query.build().execute(&mut *tx).await?;
    }
    Ok(())
}
