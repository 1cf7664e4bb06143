//! Taking jobs in.
//!
//! The idempotency key, the bound of the queue and the insert share one transaction: of two
//! submissions with one key that arrive together, one inserts and the other finds it.

use packstone_engine::export::tables::EngineInfo;

use super::bodies::StoredBody;
use super::db::{Durability, Transaction, query};
use super::{Store, StoreError, forecasts, rows, turns, webhooks};
use crate::accounts::Submitter;
use crate::jobs::{JobId, JobRecord, JobRequest, Overview};
use crate::tasks;

/// Diameters of a request that is written off the threads that answer.
const LONG_LIST: usize = 2000;

/// A key that makes a repeated submission harmless.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct IdempotencyKey {
    /// Whose key it is; clients of different owners do not meet.
    pub(crate) scope: String,
    /// The key as sent.
    pub(crate) key: String,
    /// SHA-256 of the body's content, in hexadecimal.
    pub(crate) body_sha256: String,
}

/// A job to accept.
#[derive(Clone, Debug)]
pub(crate) struct NewJob {
    pub(crate) request: JobRequest,
    /// What the plan of the request warns of.
    pub(crate) warnings: Vec<String>,
    /// Time that the plan expects the job to take on one core.
    pub(crate) forecast_s: f64,
    /// Whether its method keeps checkpoints, by its plan.
    pub(crate) keeps_checkpoints: bool,
    /// Most threads that it has work for, by its plan.
    pub(crate) most_threads: u32,
    /// Who submits it.
    pub(crate) by: Submitter,
    pub(crate) idempotency_key: Option<IdempotencyKey>,
}

/// What became of a submission.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Submitted {
    /// The job was accepted.
    Created(JobRecord),
    /// The same key brought this job before.
    Existing(JobRecord),
}

/// A job to accept, with the documents that its rows hold.
struct Documents {
    id: JobId,
    new: NewJob,
    body: StoredBody,
    labels: String,
    engine: String,
    warnings: String,
    overview: String,
}

impl Documents {
    fn of(new: NewJob) -> Result<Self, StoreError> {
        Ok(Self {
            id: JobId::new(),
            body: StoredBody::whole(&to_json(&new.request)?),
            labels: to_json(&new.request.labels)?,
            engine: to_json(&EngineInfo::current())?,
            warnings: to_json(&new.warnings)?,
            overview: to_json(&Overview::of(&new.request))?,
            new,
        })
    }
}

impl Store {
    /// Takes a job in; it is safe on disk when this returns.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`], [`StoreError::OwnerQueueFull`], [`StoreError::KeyReused`], or the database's.
    pub(crate) async fn submit(&self, new: NewJob) -> Result<Submitted, StoreError> {
        let store = self.clone();
        self.detached(async move {
            // A long list of diameters takes a while to write.
            let diameters = new.request.mix.listed_diameters_mm().map_or(0, <[f64]>::len);
            let job = if diameters > LONG_LIST {
                tasks::blocking(move || Documents::of(new)).await??
            } else {
                Documents::of(new)?
            };
            let submitted = store
                .write(Durability::PowerCut, job, |store, job, tx| Box::pin(store.insert(job, tx)))
                .await?;
            if let Submitted::Created(job) = &submitted {
                store.notify(job.id);
                store.wake_worker();
            }
            Ok(submitted)
        })
        .await
    }

    async fn insert(&self, documents: &Documents, tx: &mut Transaction<'_>) -> Result<Submitted, StoreError> {
        let Documents { id, new, body, labels, engine, warnings, overview } = documents;
        let request = &new.request;
        if let Some(existing) = find_key(&mut *tx, new.idempotency_key.as_ref()).await? {
            return Ok(Submitted::Existing(existing));
        }
        self.check_queue(&mut *tx, &new.by.owner, 1).await?;
        let flow =
            turns::Flow { owner: &new.by.owner, number: turns::SINGLE_JOBS, priority: request.priority };
        let turn = turns::assign_start_times(&mut *tx, flow, 1).await?;
        let now = self.now_us();
        let forecast_us = forecasts::micros_of(new.forecast_s, request.timeout_s);
        let row = query(
            "insert into jobs (id, state, name, labels, priority, seed, timeout_s, max_attempts,
                 attempt_budget, created_at, updated_at, expires_at, engine, turn, warnings, owner, submitted_by,
                 shared, forecast_us, least_time_us, threads, most_threads, method, request_bytes,
                 overview)
             values (?, 'queued', ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
             returning *, cast(null as text) as path, cast(null as text) as study_id",
        )
        .bind(id.to_string())
        .bind(&request.name)
        .bind(labels)
        .bind(request.priority)
        .bind(request.seed.cast_signed())
        .bind(request.timeout_s)
        .bind(request.max_attempts)
        .bind(request.max_attempts)
        .bind(now)
        .bind(now)
        .bind(request.expires_at_us())
        .bind(engine)
        .bind(turn)
        .bind(warnings)
        .bind(&new.by.owner)
        .bind(&new.by.key)
        .bind(request.shared)
        .bind(forecast_us)
        .bind(forecasts::least_time_us(forecast_us, new.keeps_checkpoints))
        .bind(request.threads)
        .bind(i64::from(new.most_threads))
        .bind(request.method_name())
        .bind(body.bytes())
        .bind(overview)
        .fetch_one(&mut *tx)
        .await?;
        let job = rows::job(&row)?;
        query("insert into job_requests (job, body, digest) values (?, ?, ?)")
            .bind(job.seq)
            .bind(&body.text)
            .bind(body.digest)
            .execute(&mut *tx)
            .await?;
        webhooks::insert(&mut *tx, webhooks::Ending::Job(job.seq), request.webhook_url.as_ref()).await?;
        for (key, value) in &request.labels {
            query("insert into job_labels (key, value, job, state) values (?, ?, ?, 'queued')")
                .bind(key)
                .bind(value)
                .bind(job.seq)
                .execute(&mut *tx)
                .await?;
        }
        if let Some(key) = &new.idempotency_key {
            query("insert into idempotency_keys (scope, key, body_sha256, job) values (?, ?, ?, ?)")
                .bind(&key.scope)
                .bind(&key.key)
                .bind(&key.body_sha256)
                .bind(job.seq)
                .execute(&mut *tx)
                .await?;
        }
        Ok(Submitted::Created(job))
    }

    /// Whether a job was submitted with this key before.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn knows_job_key(&self, key: &IdempotencyKey) -> Result<bool, StoreError> {
        let row = query("select 1 from idempotency_keys where scope = ? and key = ?")
            .bind(&key.scope)
            .bind(&key.key)
            .fetch_optional(self.readers())
            .await?;
        Ok(row.is_some())
    }

    /// Refuses where the queue, or the share of the owner in it, has no room for so many jobs more.
    pub(super) async fn check_queue(
        &self,
        tx: &mut Transaction<'_>,
        owner: &str,
        more: u64,
    ) -> Result<(), StoreError> {
        let queued: i64 = query("select jobs from job_counts where state = 'queued'")
            .fetch_one(&mut *tx)
            .await?
            .try_get("jobs")?;
        let (queued, most) = (queued as u64, self.limits().max_queued);
        if queued + more > most {
            return Err(StoreError::QueueFull { queued, more, most });
        }
        let Some(most) = self.accounts().quotas(owner).queued else { return Ok(()) };
        let queued: Option<i64> =
            query("select queued from queue_owners where owner = ?").bind(owner).optional_scalar(tx).await?;
        let queued = queued.unwrap_or(0) as u64;
        if queued + more > most {
            return Err(StoreError::OwnerQueueFull { owner: owner.to_owned(), queued, more, most });
        }
        Ok(())
    }
}

async fn find_key(
    tx: &mut Transaction<'_>,
    key: Option<&IdempotencyKey>,
) -> Result<Option<JobRecord>, StoreError> {
    let Some(key) = key else { return Ok(None) };
    let row = query("select body_sha256, job from idempotency_keys where scope = ? and key = ?")
        .bind(&key.scope)
        .bind(&key.key)
        .fetch_optional(&mut *tx)
        .await?;
    let Some(row) = row else { return Ok(None) };
    if row.try_get::<String>("body_sha256")? != key.body_sha256 {
        return Err(StoreError::KeyReused);
    }
    rows::by_seq(tx, row.try_get("job")?).await.map(Some)
}

pub(super) fn to_json(value: &impl serde::Serialize) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|error| StoreError::Row(error.to_string()))
}
