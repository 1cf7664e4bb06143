//! What servers that share one database of PostgreSQL tell each other: which jobs, studies and exports have changed,
//! and that something waits to be done. And which one of them does what only one may do.
//!
//! Method: changes are collected for a moment and sent together by `NOTIFY`, from a connection of its own, so that no
//! transaction that changes a job waits for it (a commit with `NOTIFY` holds a lock of the whole database system). Each
//! server listens. A message can be lost with a connection, so each also wakes all who wait every few seconds, and
//! those read the database. The leader is the server whose connection holds an advisory lock: it ends with the
//! connection, however the server ends. The database ends a connection that has said nothing for [`SILENT_FOR`], so a
//! server that is suspended or cut off loses the lock; and a server leads for [`LEAD_FOR`] after it last asked, which
//! is less, so that no two lead at once.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgListener};
use sqlx::{Connection as _, PgConnection};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};

use super::Shared;
use super::changes::Change;
use crate::ids::{ExportId, JobId, StudyId};
use crate::tasks;

/// Name of the channel.
const CHANNEL: &str = "packstone";
/// Longest text of one message: PostgreSQL takes less than 8000 bytes.
const MOST_BYTES: usize = 7900;
/// Time for which changes are collected.
const COLLECT: Duration = Duration::from_millis(20);
/// Time between two looks of all who wait, whatever was told; and between two attempts to become the leader.
const LOOK_EVERY: Duration = Duration::from_secs(5);
/// Time between two attempts to connect.
const CONNECT_EVERY: Duration = Duration::from_secs(1);
/// Time for which a server leads after it last asked the database.
const LEAD_FOR: Duration = Duration::from_secs(10);
/// Time after which the database ends a connection that says nothing.
const SILENT_FOR: &str = "15s";
/// The leader's lock: the word "packlead" in ASCII.
const LEADER: &str = "select pg_try_advisory_lock(8097862918020096356)";

/// The way to the other servers.
#[derive(Debug)]
pub(super) struct Servers {
    changes: UnboundedSender<Change>,
    /// Until when this server is the leader, where it was when it last asked.
    leads_until: Mutex<Option<Instant>>,
}

/// The other end of the way.
#[derive(Debug)]
pub(super) struct Others {
    options: PgConnectOptions,
    changes: UnboundedReceiver<Change>,
}

impl Servers {
    /// The way to the other servers of a database.
    pub(super) fn to(options: &PgConnectOptions) -> (Self, Others) {
        let (sender, changes) = unbounded_channel();
        (
            Self { changes: sender, leads_until: Mutex::default() },
            Others { options: options.clone(), changes },
        )
    }

    /// Tells the other servers, soon.
    pub(super) fn tell(&self, change: Change) {
        // Nobody listens any more when the store closes.
        let _ = self.changes.send(change);
    }

    /// Whether this server is the leader.
    pub(super) fn is_leader(&self) -> bool {
        let until = *self.leads_until.lock().unwrap_or_else(PoisonError::into_inner);
        until.is_some_and(|until| Instant::now() < until)
    }

    fn set_leader(&self, leads_until: Option<Instant>) {
        let before = {
            let mut until = self.leads_until.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *until, leads_until)
        };
        if before.is_some() != leads_until.is_some() {
            let is_leader = leads_until.is_some();
            tracing::info!(is_leader, "the servers of this database have another leader");
        }
    }
}

impl Others {
    /// Tells and listens until the store is dropped.
    pub(super) fn talk(self, store: &Arc<Shared>) {
        let Self { options, changes } = self;
        let own = uuid::Uuid::now_v7().simple().to_string();
        let store = Arc::downgrade(store);
        tasks::spawn(tell(options.clone(), own.clone(), changes, Weak::clone(&store)));
        tasks::spawn(listen(options, own, store));
    }
}

/// Sends what has changed, and holds the leader's lock where it can be had.
async fn tell(
    options: PgConnectOptions,
    own: String,
    mut changes: UnboundedReceiver<Change>,
    store: Weak<Shared>,
) {
    let mut connection = None;
    let mut has_lost = false;
    let mut look = interval(LOOK_EVERY);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let mut told = BTreeSet::new();
        if has_lost {
            told.insert(Change::Lost);
        }
        tokio::select! {
            change = changes.recv() => match change {
                Some(change) => {
                    told.insert(change);
                    sleep(COLLECT).await;
                    while let Ok(change) = changes.try_recv() {
                        told.insert(change);
                    }
                }
                None => return,
            },
            _ = look.tick() => {}
        }
        let Some(store) = store.upgrade() else { return };
        let Some(servers) = &store.servers else { return };
        if let Err(error) = send(&mut connection, &options, &messages(&own, &told), servers).await {
            // The others look for themselves. The lock has gone with the connection.
            tracing::warn!(%error, "other servers were not told of changes");
            connection = None;
            has_lost |= !told.is_empty();
            servers.set_leader(None);
            drop(store);
            sleep(CONNECT_EVERY).await;
        } else {
            has_lost = false;
        }
    }
}

/// Sends messages, and asks for the leader's lock where this server is not the leader. Where it is, an answer tells
/// that the connection, and so the lock, is still there.
async fn send(
    connection: &mut Option<PgConnection>,
    options: &PgConnectOptions,
    messages: &[String],
    servers: &Servers,
) -> Result<(), sqlx::Error> {
    let open = if let Some(open) = connection {
        open
    } else {
        // A crash that undoes a message ends the connections of those who would hear it.
        let settings = [("idle_session_timeout", SILENT_FOR), ("synchronous_commit", "off")];
        connection.insert(PgConnection::connect_with(&options.clone().options(settings)).await?)
    };
    let asked = Instant::now();
    for message in messages {
        sqlx::query("select pg_notify($1, $2)").bind(CHANNEL).bind(message).execute(&mut *open).await?;
    }
    let mut leads = true;
    if !servers.is_leader() {
        leads = sqlx::query_scalar(LEADER).fetch_one(open).await?;
    } else if messages.is_empty() {
        open.ping().await?;
    }
    servers.set_leader(leads.then(|| asked + LEAD_FOR));
    Ok(())
}

/// The changes as texts of bounded length, each with the name of its sender.
fn messages(own: &str, changes: &BTreeSet<Change>) -> Vec<String> {
    let mut messages: Vec<String> = Vec::new();
    for change in changes {
        let word = match change {
            Change::Queue => "q".to_owned(),
            Change::Exports => "x".to_owned(),
            Change::Webhooks => "w".to_owned(),
            Change::Checks => "c".to_owned(),
            Change::Job(id) => format!("j{id}"),
            Change::Study(id) => format!("s{id}"),
            Change::Export(id) => format!("e{id}"),
            Change::Lost => "l".to_owned(),
        };
        match messages.last_mut() {
            Some(message) if message.len() + 1 + word.len() <= MOST_BYTES => {
                // Writing to a string cannot fail.
                let _ = write!(message, " {word}");
            }
            _ => messages.push(format!("{own} {word}")),
        }
    }
    messages
}

/// The changes of a message of another server. Words that a later version may send are passed over.
fn changes_in<'m>(own: &str, message: &'m str) -> impl Iterator<Item = Change> + 'm {
    let mut words = message.split(' ');
    let is_own = words.next() == Some(own);
    words.filter(move |_| !is_own).filter_map(|word| match word {
        "q" => Some(Change::Queue),
        "x" => Some(Change::Exports),
        "w" => Some(Change::Webhooks),
        "c" => Some(Change::Checks),
        "l" => Some(Change::Lost),
        _ => match word.split_at_checked(1)? {
            ("j", id) => JobId::parse(id).map(Change::Job),
            ("s", id) => StudyId::parse(id).map(Change::Study),
            ("e", id) => ExportId::parse(id).map(Change::Export),
            _ => None,
        },
    })
}

/// Wakes those who wait here for what changes elsewhere.
async fn listen(options: PgConnectOptions, own: String, store: Weak<Shared>) {
    loop {
        let Some(wake) = store.upgrade() else { return };
        wake.wake(Change::Lost);
        wake.wake_all();
        drop(wake);
        if let Err(error) = listen_once(&options, &own, &store).await {
            tracing::warn!(%error, "changes of other servers are seen late");
        }
        sleep(CONNECT_EVERY).await;
    }
}

/// Listens until the connection breaks off or the store is dropped.
async fn listen_once(options: &PgConnectOptions, own: &str, store: &Weak<Shared>) -> Result<(), sqlx::Error> {
    let pool = sqlx::postgres::PgPoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
    let mut listener = PgListener::connect_with(&pool).await?;
    listener.listen(CHANNEL).await?;
    let mut look_at = Instant::now();
    loop {
        let heard = timeout(look_at.saturating_duration_since(Instant::now()), listener.try_recv()).await;
        let Some(store) = store.upgrade() else { return Ok(()) };
        match heard {
            Ok(Ok(Some(message))) => {
                changes_in(own, message.payload()).for_each(|change| store.wake(change));
            }
            // The connection was opened anew: what was told meanwhile is lost.
            Ok(Ok(None)) => {
                store.wake(Change::Lost);
                store.wake_all();
            }
            Ok(Err(error)) => return Err(error),
            Err(_elapsed) => {
                store.wake_all();
                look_at = Instant::now() + LOOK_EVERY;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_short_and_tell_all_but_their_sender() {
        let mut changes =
            BTreeSet::from([Change::Queue, Change::Webhooks, Change::Lost, Change::Study(StudyId::new())]);
        changes.extend((0..500).map(|_| Change::Job(JobId::new())));
        changes.extend((0..300).map(|_| Change::Export(ExportId::new())));
        let messages = messages("a", &changes);
        assert!(messages.len() > 1 && messages.iter().all(|message| message.len() <= MOST_BYTES));
        let heard: BTreeSet<Change> = messages.iter().flat_map(|message| changes_in("b", message)).collect();
        assert_eq!(heard, changes);
        assert_eq!(messages.iter().flat_map(|message| changes_in("a", message)).count(), 0);
        let strange = "b q z jnone é";
        assert_eq!(changes_in("a", strange).collect::<Vec<_>>(), [Change::Queue]);
    }
}
