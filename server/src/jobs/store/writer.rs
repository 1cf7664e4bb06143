//! The one connection that writes to the database, replaced when a fault of the machine has made it unusable.
//!
//! SQLite rolls a transaction back by itself on `SQLITE_FULL`, `SQLITE_IOERR` and `SQLITE_NOMEM`
//! (<https://sqlite.org/lang_transaction.html>, section 3). The `ROLLBACK` that sqlx sends afterwards then fails, and
//! sqlx 0.9 lowers its count of open transactions on success only: from then on it refuses every `BEGIN`. So each write
//! first asks whether the connection is in no transaction, and opens another one where it is.

use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::{Mutex, MutexGuard};

use super::StoreError;
use super::clock::Clock;
use super::db::{
    Connection, Durability, Options, Source, Transaction, Via, WAIT_FOR_HELD_LOCK, WAIT_FOR_LOCK,
};
use super::faults::{Fault, fault_of};
use super::group_commit::Line;
use super::mark::Mark;

/// The connection, one writer at a time.
#[derive(Debug)]
pub(super) struct Writer {
    options: Options,
    /// What each successor of the connection must find.
    mark: Mark,
    clock: Clock,
    state: Mutex<State>,
    /// Short writes that wait to be run together.
    line: Line,
    /// Since when no connection could be opened in place of an unusable one.
    lost_since: std::sync::Mutex<Option<Instant>>,
    /// How often the connection was replaced.
    replaced: AtomicU64,
    /// The last write that wanted to begin found the database locked by another program.
    locked: AtomicBool,
}

#[derive(Debug)]
struct State {
    connection: Connection,
    durability: Durability,
    lock_wait: Duration,
    unusable: bool,
    /// When a writer last took it, unless a write has failed since then.
    used: Option<Instant>,
}

/// The right to write; dropped, it lets the next writer in.
#[derive(Debug)]
pub(super) struct Writing<'a> {
    writer: &'a Writer,
    state: MutexGuard<'a, State>,
}

impl Writer {
    /// Takes over an open connection; `options` open its successors.
    pub(super) fn new(connection: Connection, options: Options, mark: Mark) -> Self {
        let state = State::new(connection);
        Self {
            options,
            mark,
            clock: Clock::default(),
            state: Mutex::new(state),
            line: Line::default(),
            lost_since: std::sync::Mutex::default(),
            replaced: AtomicU64::default(),
            locked: AtomicBool::default(),
        }
    }

    /// The clock of the database, as the last write has found it.
    pub(super) fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Short writes that wait to be run together.
    pub(super) fn line(&self) -> &Line {
        &self.line
    }

    /// Waits for the writers before, and hands out a connection that is in no transaction.
    ///
    /// # Errors
    /// The database's, where the connection is unusable and no other one can be opened.
    pub(super) async fn lock(&self, durability: Durability) -> Result<Writing<'_>, StoreError> {
        let mut writing = self.wait().await;
        writing.prepare(durability).await?;
        Ok(writing)
    }

    /// Waits for the writers before. The connection is to be prepared before it is used.
    pub(super) async fn wait(&self) -> Writing<'_> {
        Writing { writer: self, state: self.state.lock().await }
    }

    /// How connections are opened.
    pub(super) fn options(&self) -> &Options {
        &self.options
    }

    /// Makes the next write open another connection.
    pub(super) async fn renew(&self) {
        self.state.lock().await.unusable = true;
    }

    /// Opens another connection to the same database.
    async fn connect(&self) -> Result<Connection, sqlx::Error> {
        let mut connection = self.options.connect().await?;
        self.mark.check(&mut connection).await?;
        Ok(connection)
    }

    async fn replace(&self, state: &mut State) -> Result<(), sqlx::Error> {
        let opened = self.connect().await;
        let mut lost_since = self.lost_since.lock().unwrap_or_else(PoisonError::into_inner);
        match opened {
            Ok(connection) => {
                // The old one closes when its thread sees that it was dropped.
                *state = State::new(connection);
                *lost_since = None;
                self.replaced.fetch_add(1, Ordering::Relaxed);
                tracing::warn!(
                    "the connection that writes to the database was unusable and has been replaced"
                );
                Ok(())
            }
            Err(error) => {
                state.unusable = true;
                // A full disk or a lock of another program goes away by itself: the store is not lost.
                if fault_of(&error).is_none_or(|fault| fault == Fault::Io) {
                    lost_since.get_or_insert_with(Instant::now);
                }
                Err(error)
            }
        }
    }

    /// Whether another program has the database locked, as the last write found it that wanted to begin.
    pub(super) fn is_locked(&self) -> bool {
        self.locked.load(Ordering::Acquire)
    }

    /// How often the connection was replaced.
    pub(super) fn replaced(&self) -> u64 {
        self.replaced.load(Ordering::Relaxed)
    }

    /// For how long no usable connection could be opened; `None` while there is one.
    pub(super) fn lost_for(&self) -> Option<Duration> {
        self.lost_since.lock().unwrap_or_else(PoisonError::into_inner).map(|since| since.elapsed())
    }

    /// Waits for the writers before and copies the write-ahead log into the database.
    pub(super) async fn fold_log(&self) -> Result<(), StoreError> {
        let mut state = self.state.lock().await;
        Ok(state.connection.fold_log().await?)
    }
}

impl State {
    fn new(connection: Connection) -> Self {
        Self {
            connection,
            durability: Durability::PowerCut,
            lock_wait: WAIT_FOR_LOCK,
            unusable: false,
            used: Some(Instant::now()),
        }
    }
}

impl Writing<'_> {
    /// The clock of the database, in microseconds since the Unix epoch.
    pub(super) fn now_us(&self) -> i64 {
        self.writer.clock.now_us()
    }

    /// Makes the connection ready for a write: it is in no transaction, and a commit survives this much. An unusable
    /// one is replaced.
    ///
    /// # Errors
    /// The database's, where no other connection can be opened.
    pub(super) async fn prepare(&mut self, durability: Durability) -> Result<(), sqlx::Error> {
        let state = &mut *self.state;
        let used = state.used;
        if state.unusable || !state.connection.is_idle(used).await {
            self.writer.replace(state).await?;
        }
        if state.durability != durability {
            state.connection.set_durability(durability).await?;
            state.durability = durability;
        }
        let lock_wait = if self.writer.is_locked() { WAIT_FOR_HELD_LOCK } else { WAIT_FOR_LOCK };
        if state.lock_wait != lock_wait {
            state.connection.set_lock_wait(lock_wait).await?;
            state.lock_wait = lock_wait;
        }
        state.used = Some(Instant::now());
        Ok(())
    }

    /// Lets the next write ask whether the connection still answers.
    pub(super) fn doubt(&mut self) {
        self.state.used = None;
    }

    /// Begins a transaction that may write from its start on.
    ///
    /// # Errors
    /// The database's. Unless another program holds the lock, the connection is replaced before the next write.
    pub(super) async fn begin(&mut self) -> Result<Transaction<'_>, sqlx::Error> {
        let Writer { clock, mark, locked, .. } = self.writer;
        let State { connection, unusable, durability, .. } = &mut *self.state;
        let durability = *durability;
        let begun = async move {
            let mut transaction = connection.begin_write(durability, clock).await?;
            mark.count(&mut transaction).await?;
            Ok(transaction)
        };
        match begun.await {
            Ok(transaction) => {
                locked.store(false, Ordering::Release);
                Ok(transaction)
            }
            Err(error) => {
                let is_locked = fault_of(&error) == Some(Fault::Locked);
                locked.store(is_locked, Ordering::Release);
                *unusable = !is_locked;
                Err(error)
            }
        }
    }
}

/// A single statement is a transaction of its own.
impl<'s> Source<'s> for &'s mut Writing<'_> {
    fn via(self) -> Via<'s> {
        let State { connection, unusable, durability, .. } = &mut *self.state;
        connection.via_write(*durability, &self.writer.clock, unusable)
    }
}
