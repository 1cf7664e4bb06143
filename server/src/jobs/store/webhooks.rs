//! Webhooks in the store. Triggers record a delivery in the transaction that ends a job or finishes a study (migration
//! 14); here is what is due, and what became of each attempt.

use std::time::Duration;

use serde::Serialize;

use super::db::{Row, Transaction, query};
use super::{Store, StoreError, micros, rows};
use crate::jobs::request::Change;
use crate::webhooks::WebhookUrl;

/// Whether a message has arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum DeliveryState {
    /// The job or study has not ended, or the message has not arrived yet.
    Waiting,
    /// The receiver has accepted it.
    Delivered,
    /// It is not sent any more.
    Failed,
}

impl DeliveryState {
    const ALL: [Self; 3] = [Self::Waiting, Self::Delivered, Self::Failed];

    /// Name in the store.
    fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Delivered => "delivered",
            Self::Failed => "failed",
        }
    }
}

/// The webhook of a job or a study with its latest delivery. Times are microseconds since the Unix epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct WebhookRecord {
    pub(crate) url: String,
    pub(crate) state: DeliveryState,
    pub(crate) attempts: u32,
    pub(crate) last_error: Option<String>,
    pub(crate) last_status: Option<u16>,
    pub(crate) next_attempt_at: Option<i64>,
    pub(crate) delivered_at: Option<i64>,
}

impl WebhookRecord {
    /// The webhook of what has not ended.
    pub(crate) fn of_unfinished(self) -> Self {
        Self {
            url: self.url,
            state: DeliveryState::Waiting,
            attempts: 0,
            last_error: None,
            last_status: None,
            next_attempt_at: None,
            delivered_at: None,
        }
    }
}

/// A delivery that is due.
#[derive(Clone, PartialEq)]
#[cfg_attr(test, derive(Debug))]
pub(crate) struct Delivery {
    pub(crate) seq: i64,
    /// The header `webhook-id`.
    pub(crate) id: String,
    pub(crate) url: String,
    /// Host of the URL.
    pub(crate) host: String,
    pub(crate) body: String,
    /// Attempts so far.
    pub(crate) attempts: u32,
    /// Time since the end of the job or the study.
    pub(crate) age: Duration,
}

/// What became of an attempt.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Attempt {
    /// The receiver has accepted the message.
    Delivered { status: u16 },
    /// The message is sent again after a pause.
    Again { error: String, status: Option<u16>, pause: Duration },
    /// The message is not sent any more.
    Failed { error: String, status: Option<u16> },
}

/// A host to which messages of an owner are sent, one at a time.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Receiver {
    pub(crate) owner: String,
    pub(crate) host: String,
}

/// A delivery that waits, without its body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WaitingDelivery {
    pub(crate) seq: i64,
    pub(crate) receiver: Receiver,
    /// There was an attempt before.
    pub(crate) sent_before: bool,
    /// When it is due, in microseconds since the Unix epoch.
    pub(crate) next_at: i64,
    /// Time until then.
    pub(crate) due_in: Duration,
}

/// The receivers for which deliveries wait, by one step into the index for each: a backlog of one is not walked.
macro_rules! waiting_receivers {
    () => {
        "with recursive owners (owner) as (
             select min(owner) from webhook_deliveries where state = 'waiting'
             union all
             select (
                 select min(later.owner) from webhook_deliveries as later
                 where later.state = 'waiting' and later.owner > owners.owner
             ) from owners where owners.owner is not null
         ), receivers (owner, host) as (
             select owners.owner, (
                 select min(first.host) from webhook_deliveries as first
                 where first.state = 'waiting' and first.owner = owners.owner
             ) from owners where owners.owner is not null
             union all
             select receivers.owner, (
                 select min(later.host) from webhook_deliveries as later
                 where later.state = 'waiting' and later.owner = receivers.owner and later.host > receivers.host
             ) from receivers where receivers.host is not null
         ) "
    };
}

/// The first delivery of a receiver, of those that were sent before or of the others.
macro_rules! first_of_receiver {
    ($sent_before:literal) => {
        concat!(
            "(select seq from webhook_deliveries as of_receiver
              where of_receiver.state = 'waiting' and of_receiver.owner = receivers.owner
                  and of_receiver.host = receivers.host and of_receiver.sent_before = ",
            $sent_before,
            " order by of_receiver.next_at, of_receiver.seq limit 1)"
        )
    };
}

/// Webhooks with the latest delivery to the URL that each has now. One that was removed has an empty URL.
macro_rules! select_webhook {
    () => {
        "select webhooks.url, latest.state, latest.attempts, latest.last_error, latest.last_status, latest.next_at,
             latest.delivered_at
         from webhooks left join webhook_deliveries as latest on latest.seq = (
             select max(seq) from webhook_deliveries
             where webhook_deliveries.webhook = webhooks.seq and webhook_deliveries.url = webhooks.url
         ) where webhooks.url <> ''"
    };
}

impl Store {
    /// The webhook of a job.
    pub(crate) async fn webhook_of_job(&self, job: i64) -> Result<Option<WebhookRecord>, StoreError> {
        let row = query(concat!(select_webhook!(), " and webhooks.job = ?")).bind(job);
        row.fetch_optional(self.readers()).await?.as_ref().map(webhook).transpose()
    }

    /// The webhook of a study.
    pub(crate) async fn webhook_of_study(&self, study: i64) -> Result<Option<WebhookRecord>, StoreError> {
        let row = query(concat!(select_webhook!(), " and webhooks.study = ?")).bind(study);
        row.fetch_optional(self.readers()).await?.as_ref().map(webhook).transpose()
    }

    /// Of each receiver the delivery that is due first, of those that were sent before and of the others.
    pub(crate) async fn waiting_by_receiver(&self) -> Result<Vec<WaitingDelivery>, StoreError> {
        let now = self.now_us();
        let found = query(concat!(
            waiting_receivers!(),
            "select due.seq, due.owner, due.host, due.sent_before, due.next_at
             from receivers cross join webhook_deliveries as due
             where receivers.host is not null and due.seq in (",
            first_of_receiver!("false"),
            ", ",
            first_of_receiver!("true"),
            ")"
        ))
        .fetch_all(self.readers())
        .await?;
        let waiting = |row: &Row| {
            let next_at: i64 = row.try_get("next_at")?;
            Ok(WaitingDelivery {
                seq: row.try_get("seq")?,
                receiver: Receiver { owner: row.try_get("owner")?, host: row.try_get("host")? },
                sent_before: row.try_get("sent_before")?,
                next_at,
                due_in: Duration::from_micros(next_at.saturating_sub(now).max(0).cast_unsigned()),
            })
        };
        found.iter().map(waiting).collect()
    }

    /// A delivery that waits; `None` where it is gone.
    pub(crate) async fn delivery(&self, seq: i64) -> Result<Option<Delivery>, StoreError> {
        let row = query(
            "select id, host, body, attempts, created_at, url from webhook_deliveries
             where seq = ? and state = 'waiting'",
        )
        .bind(seq)
        .fetch_optional(self.readers())
        .await?;
        let read = |row: Row| {
            let age = self.now_us().saturating_sub(row.try_get("created_at")?).max(0);
            Ok(Delivery {
                seq,
                id: row.try_get("id")?,
                url: row.try_get("url")?,
                host: row.try_get("host")?,
                body: row.try_get("body")?,
                attempts: row.try_get("attempts")?,
                age: Duration::from_micros(age.cast_unsigned()),
            })
        };
        row.map(read).transpose()
    }

    /// How many deliveries wait.
    pub(crate) async fn waiting_deliveries(&self) -> Result<u64, StoreError> {
        let waiting: i64 = query("select count(*) from webhook_deliveries where state = 'waiting'")
            .scalar(self.readers())
            .await?;
        Ok(waiting.cast_unsigned())
    }

    /// Records an attempt, which clients see in the job or the study. Nothing happens where this was deleted meanwhile.
    ///
    /// A power cut can undo it: then the message is sent again.
    pub(crate) async fn record_attempt(&self, delivery: i64, attempt: Attempt) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let now = store.now_us();
            let (state, error, status, pause) = match attempt {
                Attempt::Delivered { status } => (DeliveryState::Delivered, None, Some(status), Duration::ZERO),
                Attempt::Again { error, status, pause } => {
                    (DeliveryState::Waiting, Some(error), status, pause)
                }
                Attempt::Failed { error, status } => {
                    (DeliveryState::Failed, Some(error), status, Duration::ZERO)
                }
            };
            let mut writer = store.quick_writer().await?;
            let mut tx = writer.begin().await?;
            let recorded: Option<i64> = query(
                "update webhook_deliveries set state = ?1, attempts = attempts + 1, last_error = ?2, last_status = ?3,
                     next_at = ?4, delivered_at = case when ?1 = 'delivered' then ?5 else null end
                 where seq = ?6 and state = 'waiting' returning webhook",
            )
            .bind(state.name())
            .bind(error)
            .bind(status)
            .bind(now.saturating_add(micros(pause)))
            .bind(now)
            .bind(delivery)
            .optional_scalar(&mut tx)
            .await?;
            let Some(webhook) = recorded else { return Ok(()) };
            let job: Option<String> = query(
                "update jobs set version = version + 1, updated_at = ?2
                 where seq = (select job from webhooks where seq = ?1) returning id",
            )
            .bind(webhook)
            .bind(now)
            .optional_scalar(&mut tx)
            .await?;
            let study: Option<String> = query(
                "update studies set version = version + 1, updated_at = ?2
                 where seq = (select study from webhooks where seq = ?1) returning id",
            )
            .bind(webhook)
            .bind(now)
            .optional_scalar(&mut tx)
            .await?;
            tx.commit().await?;
            drop(writer);
            if let Some(id) = job {
                store.notify(rows::job_id(&id)?);
            }
            if let Some(id) = study {
                store.notify_study(rows::study_id(&id)?);
            }
            Ok(())
        })
        .await
    }
}

/// What has a webhook.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    Job(i64),
    Study(i64),
}

impl Ending {
    /// Numbers of job and study, of which one is there.
    fn columns(self) -> (Option<i64>, Option<i64>) {
        match self {
            Self::Job(seq) => (Some(seq), None),
            Self::Study(seq) => (None, Some(seq)),
        }
    }
}

/// Records the webhook of a submission.
pub(super) async fn insert(
    tx: &mut Transaction<'_>,
    of: Ending,
    url: Option<&WebhookUrl>,
) -> Result<(), StoreError> {
    let Some(url) = url else { return Ok(()) };
    let (job, study) = of.columns();
    query("insert into webhooks (job, study, url, host) values (?, ?, ?, ?)")
        .bind(job)
        .bind(study)
        .bind(url.as_str())
        .bind(url.host_text())
        .execute(tx)
        .await?;
    Ok(())
}

/// Changes the webhook of what may have one. Messages that are recorded already are sent to the URL of before.
pub(super) async fn change(
    tx: &mut Transaction<'_>,
    of: Ending,
    change: &Change<WebhookUrl>,
) -> Result<(), StoreError> {
    let (job, study) = of.columns();
    match change {
        Change::Keep => {}
        Change::Remove => {
            query("update webhooks set url = '', host = '' where job = ? or study = ?")
                .bind(job)
                .bind(study)
                .execute(tx)
                .await?;
        }
        Change::Set(url) => {
            let changed = query("update webhooks set url = ?, host = ? where job = ? or study = ?")
                .bind(url.as_str())
                .bind(url.host_text())
                .bind(job)
                .bind(study)
                .execute(&mut *tx)
                .await?;
            if changed.rows_affected() == 0 {
                insert(tx, of, Some(url)).await?;
            }
        }
    }
    Ok(())
}

fn webhook(row: &Row) -> Result<WebhookRecord, StoreError> {
    let name: Option<String> = row.try_get("state")?;
    let state = match &name {
        None => DeliveryState::Waiting,
        Some(name) => DeliveryState::ALL
            .into_iter()
            .find(|state| state.name() == name)
            .ok_or_else(|| StoreError::Row(format!("unknown state of a delivery {name:?}")))?,
    };
    let next_at: Option<i64> = row.try_get("next_at")?;
    Ok(WebhookRecord {
        url: row.try_get("url")?,
        state,
        attempts: row.try_get::<Option<u32>>("attempts")?.unwrap_or(0),
        last_error: row.try_get("last_error")?,
        last_status: row.try_get("last_status")?,
        next_attempt_at: next_at.filter(|_| state == DeliveryState::Waiting),
        delivered_at: row.try_get("delivered_at")?,
    })
}
