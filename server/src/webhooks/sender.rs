//! The task that sends webhooks: what is due, many at once, one at a time of each owner to each host.
//!
//! A message is delivered at least once: an attempt is recorded after it was made. A receiver that is slow or dead
//! holds up its own messages only: every message has a connection of its own, every attempt a limit of time, and
//! [`OnTheWay`] chooses fairly which go next.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use hyper::{Request, StatusCode, header};
use jiff::Timestamp;
use tokio::task::{Id, JoinError};
use tokio::time::{Instant, sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;

use super::on_the_way::{ATTEMPT, LEAST_ATTEMPT, OnTheWay};
use super::signature::SecretsFile;
use super::{WebhookRules, WebhookUrl};
use crate::base_path::{self, BasePath};
use crate::http_client::ClientError;
use crate::jobs::store::{Attempt, Delivery, Store, StoreError};
use crate::metrics::Metrics;
use crate::tasks::{self, Task};

/// Longest time that messages wait for the file of secrets.
const READ_SECRETS: Duration = Duration::from_secs(1);
/// Addresses of a host that are tried in one attempt.
const ADDRESSES: usize = 3;
/// Longest pause between two attempts.
const LONGEST_PAUSE: Duration = Duration::from_hours(1);
/// No attempt is made later than this after the end of the job or the study.
const GIVE_UP_AFTER: Duration = Duration::from_hours(24);
/// Pauses differ by up to this share, so that receivers do not get all messages at one moment.
const JITTER: f64 = 0.2;
/// A pause after a fault of the store.
const STORE_PAUSE: Duration = Duration::from_secs(5);
/// The store is asked this often at least: the clock of the machine may be set.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Time between two questions to the store: at least the first, so many times as long as the last question took, and at
/// most the last.
const QUESTION_PAUSE: (Duration, u32, Duration) = (Duration::from_millis(20), 10, Duration::from_millis(500));
/// Where another server of the same database sends: time between two looks whether it still does.
const LOOK_FOR_LEAD: Duration = Duration::from_secs(1);

/// Sends the webhooks of a store.
#[derive(Debug)]
pub(crate) struct WebhookSender {
    pub(crate) store: Store,
    pub(crate) secrets: Arc<SecretsFile>,
    pub(crate) rules: WebhookRules,
    /// Pause after the first attempt; it doubles with each.
    pub(crate) first_pause: Duration,
    pub(crate) metrics: Arc<Metrics>,
    pub(crate) shutdown: CancellationToken,
}

/// Why a message has not been accepted.
#[derive(Debug, Default, PartialEq)]
struct NotAccepted {
    error: String,
    status: Option<u16>,
    /// Another attempt could not succeed.
    for_good: bool,
    /// The receiver asks for a pause.
    retry_after: Option<Duration>,
}

impl WebhookSender {
    /// Sends what is due until the server stops. What is on its way then is sent again at the next start.
    pub(crate) async fn run(self) {
        let sender = Arc::new(self);
        let mut on_the_way = OnTheWay::default();
        let mut looking = None;
        loop {
            if !sender.store.is_leader() {
                // Another server sends them, or this one is about to.
                tokio::select! {
                    () = sleep(LOOK_FOR_LEAD) => continue,
                    () = sender.shutdown.cancelled() => return,
                }
            }
            let mut ask_again = Instant::now() + QUESTION_PAUSE.0;
            let sent = sender.send_due(&mut on_the_way, &mut looking, &mut ask_again).await;
            let pause = sent.unwrap_or_else(|error| {
                tracing::error!(%error, "the webhooks that are due could not be read");
                STORE_PAUSE
            });
            let pause = sleep_until(ask_again.max(Instant::now() + pause));
            tokio::select! {
                Some(ended) = on_the_way.tasks.join_next_with_id() => on_the_way.ended(attempt_of(ended)),
                () = pause => {}
                () = sender.store.webhooks_notified() => {}
                () = sender.shutdown.cancelled() => return,
            }
            tokio::select! {
                () = sleep_until(ask_again) => {}
                () = sender.shutdown.cancelled() => return,
            }
            while let Some(ended) = on_the_way.tasks.try_join_next_with_id() {
                on_the_way.ended(attempt_of(ended));
            }
        }
    }

    /// Looks at the file of secrets, one look at a time: a disk that does not answer takes one thread.
    async fn look_at_secrets(&self, looking: &mut Option<Task<()>>) {
        let look = looking.get_or_insert_with(|| {
            let secrets = Arc::clone(&self.secrets);
            tasks::blocking(move || secrets.look())
        });
        if timeout(READ_SECRETS, look).await.is_ok() {
            *looking = None;
        }
    }

    /// Starts what is due, and tells the time until there may be more, and the earliest moment of the next question to
    /// the store: one with many receivers is not asked once for each attempt that ends.
    async fn send_due(
        self: &Arc<Self>,
        on_the_way: &mut OnTheWay,
        looking: &mut Option<Task<()>>,
        ask_again: &mut Instant,
    ) -> Result<Duration, StoreError> {
        let began = Instant::now();
        let waiting = self.store.waiting_by_receiver().await?;
        let (shortest, times, longest) = QUESTION_PAUSE;
        *ask_again = Instant::now() + (began.elapsed() * times).clamp(shortest, longest);
        let choice = on_the_way.choose(waiting, Instant::now());
        if !choice.go.is_empty() {
            // A changed secret counts for the next message, unless the disk of its file does not answer.
            self.look_at_secrets(looking).await;
        }
        for chosen in choice.go {
            // It may have been deleted meanwhile.
            let Some(delivery) = self.store.delivery(chosen.seq).await? else { continue };
            let sender = Arc::clone(self);
            on_the_way.begin(&chosen, |cut| Box::pin(async move { sender.deliver(&delivery, &cut).await }));
        }
        Ok([choice.next_due_in, choice.room_in].into_iter().flatten().fold(LOOK_EVERY, Duration::min))
    }

    /// Makes an attempt and records it.
    async fn deliver(&self, delivery: &Delivery, cut: &CancellationToken) {
        let attempt = self.attempt(delivery, cut).await;
        let (id, host) = (&delivery.id, &delivery.host);
        let number = delivery.attempts.saturating_add(1);
        match &attempt {
            Attempt::Delivered { status } => {
                self.metrics.webhook_sent("delivered");
                tracing::info!(webhook_id = id, host, status, attempt = number, "webhook delivered");
            }
            Attempt::Again { error, pause, .. } => {
                self.metrics.webhook_sent("retried");
                let pause_s = pause.as_secs();
                tracing::info!(
                    webhook_id = id,
                    host,
                    error,
                    attempt = number,
                    pause_s,
                    "webhook not accepted"
                );
            }
            Attempt::Failed { error, .. } => {
                self.metrics.webhook_sent("failed");
                tracing::warn!(webhook_id = id, host, error, attempt = number, "webhook given up");
            }
        }
        // Until it is recorded, the host stays busy: what has arrived is not sent over and over while the disk is full.
        while let Err(error) = self.store.record_attempt(delivery.seq, attempt.clone()).await {
            tracing::error!(%error, webhook_id = id, "an attempt to send a webhook was not recorded yet");
            sleep(STORE_PAUSE).await;
        }
    }

    async fn attempt(&self, delivery: &Delivery, cut: &CancellationToken) -> Attempt {
        let no_answer = |text: String| Err(NotAccepted { error: text, ..NotAccepted::default() });
        let began = Instant::now();
        let sent = tokio::select! {
            sent = timeout(ATTEMPT, self.send(delivery)) => {
                sent.unwrap_or_else(|_| no_answer(format!("no answer within {} s", ATTEMPT.as_secs())))
            }
            () = cut.cancelled() => {
                let waited_s = began.elapsed().max(LEAST_ATTEMPT).as_secs_f64();
                no_answer(format!("no answer within {waited_s:.1} s, while messages to other hosts waited"))
            }
        };
        match sent {
            Ok(status) => Attempt::Delivered { status },
            Err(not_accepted) => {
                let spread = rand::random_range(-JITTER..=JITTER);
                not_accepted.attempt(pause(delivery.attempts, self.first_pause, spread), delivery.age)
            }
        }
    }

    /// Sends the message to the first address of the host that can be connected to and is not refused. The name is
    /// resolved once, so that the address that was checked is the one that is connected to.
    async fn send(&self, delivery: &Delivery) -> Result<u16, NotAccepted> {
        let url = WebhookUrl::parse(&delivery.url).map_err(NotAccepted::for_good)?;
        let unknown = |error| NotAccepted::once(format!("the host has no known address: {error}"));
        let found = url.origin().addresses().await.map_err(unknown)?;
        let mut allowed = Vec::new();
        let mut refused = None;
        for address in found {
            match self.rules.check_address(&url, address.ip()) {
                Ok(()) => allowed.push(address),
                Err(fault) => refused = Some(fault),
            }
        }
        if let (true, Some(fault)) = (allowed.is_empty(), refused) {
            return Err(NotAccepted::for_good(fault));
        }
        // An address that lets each connection time out does not keep the others from being tried.
        let first = delivery.attempts as usize % allowed.len().max(1);
        allowed.rotate_left(first);
        let mut failed = NotAccepted::default();
        for address in allowed.into_iter().take(ADDRESSES) {
            let request =
                self.request(&url, delivery).map_err(|error| NotAccepted::for_good(error.to_string()))?;
            match url.origin().send_to(address, request).await {
                Ok(response) => {
                    let after = response.headers().get(header::RETRY_AFTER);
                    let after = after.and_then(|after| after.to_str().ok()?.parse().ok());
                    return accepted(response.status(), after.map(Duration::from_secs));
                }
                Err(ClientError::Connection(error)) => {
                    failed = NotAccepted::once(format!("no connection to {address}: {error}"));
                }
                Err(error) => return Err(NotAccepted::once(error.to_string())),
            }
        }
        Err(failed)
    }

    fn request(&self, url: &WebhookUrl, delivery: &Delivery) -> Result<Request<Body>, axum::http::Error> {
        let timestamp = Timestamp::now().as_second();
        let body = below(base_path::get(), &delivery.body);
        let signature = self.secrets.current().sign(&delivery.id, timestamp, &body);
        Request::post(url.target())
            .header(header::USER_AGENT, concat!("packstone/", env!("CARGO_PKG_VERSION")))
            .header(header::CONTENT_TYPE, "application/json")
            .header("webhook-id", &delivery.id)
            .header("webhook-timestamp", timestamp)
            .header("webhook-signature", signature)
            .body(Body::from(body))
    }
}

/// A message with the links that clients find: the store records them without the base path of a server.
fn below(base: &BasePath, message: &str) -> String {
    const LINK: &str = "/data/links/self";
    if base.as_str().is_empty() {
        return message.to_owned();
    }
    let Ok(mut document) = serde_json::from_str::<serde_json::Value>(message) else {
        return message.to_owned();
    };
    if let Some(serde_json::Value::String(link)) = document.pointer_mut(LINK) {
        link.insert_str(0, base.as_str());
    }
    document.to_string()
}

/// The attempt whose task has ended.
fn attempt_of(ended: Result<(Id, ()), JoinError>) -> Id {
    ended.map_or_else(
        |error| {
            tracing::error!(%error, "an attempt to send a webhook ended by a defect of this program");
            error.id()
        },
        |(id, ())| id,
    )
}

/// What an answer stands for.
fn accepted(status: StatusCode, retry_after: Option<Duration>) -> Result<u16, NotAccepted> {
    let number = status.as_u16();
    if status.is_success() {
        return Ok(number);
    }
    let error = if status.is_redirection() {
        format!("the receiver answered {number}: redirects are not followed")
    } else {
        format!("the receiver answered {number}")
    };
    Err(NotAccepted { error, status: Some(number), for_good: status == StatusCode::GONE, retry_after })
}

impl NotAccepted {
    /// Another attempt may succeed.
    fn once(error: String) -> Self {
        Self { error, ..Self::default() }
    }

    fn for_good(error: String) -> Self {
        Self { error, for_good: true, ..Self::default() }
    }

    /// Whether there is another attempt after the pause, for a message of this age.
    fn attempt(self, pause: Duration, age: Duration) -> Attempt {
        let Self { error, status, for_good, retry_after } = self;
        let pause = retry_after.map_or(pause, |asked| pause.max(asked.min(LONGEST_PAUSE)));
        if for_good {
            Attempt::Failed { error, status }
        } else if age + pause > GIVE_UP_AFTER {
            let hours = GIVE_UP_AFTER.as_secs() / 3600;
            Attempt::Failed { error: format!("{error}; given up after {hours} h"), status }
        } else {
            Attempt::Again { error, status, pause }
        }
    }
}

/// The pause after an attempt that `before` others preceded, longer or shorter by the share `spread`.
fn pause(before: u32, first: Duration, spread: f64) -> Duration {
    let doubled = 2_u32.saturating_pow(before);
    first.saturating_mul(doubled).min(LONGEST_PAUSE).mul_f64(1.0 + spread)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn links_begin_with_the_base_path() {
        let message = r#"{"type":"job.succeeded","data":{"id":"a","links":{"self":"/v1/jobs/a"}}}"#;
        assert_eq!(below(&BasePath::default(), message), message);
        let base: BasePath = "/packstone".parse().unwrap();
        assert_eq!(below(&base, message), message.replace("/v1/", "/packstone/v1/"));
    }

    #[test]
    fn pauses_double_up_to_an_hour() {
        let first = Duration::from_secs(5);
        for (before, s) in [(0, 5), (1, 10), (2, 20), (9, 2560), (10, 3600), (31, 3600), (u32::MAX, 3600)] {
            assert_eq!(pause(before, first, 0.0), Duration::from_secs(s), "{before}");
        }
        assert_eq!(pause(1, first, -JITTER), Duration::from_secs(8));
        assert_eq!(pause(1, first, JITTER), Duration::from_secs(12));
    }

    #[test]
    fn answers_other_than_2xx_are_retried_but_gone() {
        for status in [200, 201, 202, 204] {
            let status = StatusCode::from_u16(status).unwrap_or_default();
            assert_eq!(accepted(status, None), Ok(status.as_u16()));
        }
        for (status, for_good) in
            [(301, false), (400, false), (404, false), (410, true), (429, false), (503, false)]
        {
            let status = StatusCode::from_u16(status).unwrap_or_default();
            let refused = accepted(status, None);
            assert!(
                matches!(&refused, Err(found) if found.for_good == for_good && found.status == Some(status.as_u16())),
                "{refused:?}"
            );
        }
    }

    #[test]
    fn a_message_is_given_up_after_a_day_and_at_once_where_nothing_helps() {
        let (pause, minute) = (Duration::from_secs(10), Duration::from_mins(1));
        let failed = || NotAccepted::once("no".into());
        let again = |pause| Attempt::Again { error: "no".into(), status: None, pause };
        assert_eq!(failed().attempt(pause, minute), again(pause));
        let asked = |asked| NotAccepted { retry_after: Some(asked), ..failed() };
        assert_eq!(asked(minute).attempt(pause, minute), again(minute));
        assert_eq!(asked(Duration::from_secs(1)).attempt(pause, minute), again(pause));
        assert_eq!(asked(Duration::from_hours(9)).attempt(pause, minute), again(LONGEST_PAUSE));
        let late = failed().attempt(pause, GIVE_UP_AFTER.saturating_sub(Duration::from_secs(5)));
        assert_eq!(late, Attempt::Failed { error: "no; given up after 24 h".into(), status: None });
        let gone = NotAccepted::for_good("no".into()).attempt(pause, minute);
        assert_eq!(gone, Attempt::Failed { error: "no".into(), status: None });
    }
}
