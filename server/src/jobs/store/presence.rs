//! Whether the open database is still the one of its name, answers and can be written.
//!
//! What is committed to a database that was moved, deleted or replaced is lost with the process. So the files of SQLite
//! are compared with their names before a commit is acknowledged and before a request is answered (three calls of
//! `stat`), and so is the page that names this run (see [`mark`](super::mark)). The row that identifies the database is
//! read each second: with PostgreSQL also where its table was made again, as by the restoration of a dump, and in
//! SQLite by a connection of its own, which sees another file in the same place. A store that was replaced is final:
//! only a restart helps. One that is silent or fails is not ready until it answers and can be written again.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use tokio::time::{sleep, timeout};

use super::db::{Connection, Durability, Options, either, query};
use super::faults::{Fault, fault_of};
use super::mark::{Mark, has_no_tables, is_other_database};
use super::{Store, StoreError};
use crate::open_files::OpenFiles;
use crate::tasks;

/// Time between two looks.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Time between two trials of a write, while they succeed.
const WRITE_EVERY: Duration = Duration::from_secs(5);
/// A database that does not answer a look within this is silent.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// A write that has not ended within this, with those before it, makes the store silent.
const WRITE_WITHIN: Duration = Duration::from_secs(20);
/// The same for the write of a request for the readiness.
const READY_WITHIN: Duration = Duration::from_secs(4);
/// A damaged database is checked again so long after a check, and ten times as long as that took.
const CHECK_AGAIN: Duration = Duration::from_secs(5);

/// Why the store cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Unusable {
    /// A file or a folder is no longer the one that is open.
    #[error(
        "{} was moved, removed or replaced while the service ran: nothing can be accepted or answered until the service \
         is started again", .0.display()
    )]
    FileReplaced(PathBuf),
    /// Another database answers.
    #[error(
        "the database is another one than at the start: it was removed, made again, overwritten or restored while the \
         service ran. Nothing can be accepted or answered until the service is started again"
    )]
    DatabaseReplaced,
    /// There is no answer.
    #[error("the database does not answer")]
    Silent,
    /// A write cannot begin.
    #[error("another program has the database locked: nothing can be written until it ends its transaction")]
    Locked,
    /// A page of the database is damaged.
    #[error("the database is damaged: {0}. Stop the service, run `packstone check`, and restore a backup")]
    Damaged(String),
    /// It cannot be read or written.
    #[error("the database cannot be read or written: {0}")]
    Failing(String),
}

impl Unusable {
    /// Whether only a restart helps.
    pub(crate) fn is_final(&self) -> bool {
        matches!(self, Self::FileReplaced(_) | Self::DatabaseReplaced)
    }

    /// Whether requests that need the store are refused at once.
    fn refuses_all(&self) -> bool {
        self.is_final() || *self == Self::Silent
    }
}

/// What is known of the open database.
#[derive(Debug)]
pub(super) struct Presence {
    files: OpenFiles,
    mark: Mark,
    replaced: OnceLock<Unusable>,
    failing: Mutex<Option<Failing>>,
    damage: Damage,
}

#[derive(Clone, Debug)]
struct Failing {
    why: Unusable,
    since: Instant,
}

/// Whether a read or a write met a damaged page. Clones share it.
#[derive(Clone, Debug, Default)]
pub(super) struct Damage(Arc<AtomicBool>);

impl Damage {
    /// Notes an error if it tells of damage.
    pub(super) fn note(&self, error: &sqlx::Error) {
        if fault_of(error) == Some(Fault::Damaged) {
            self.0.store(true, Ordering::Release);
        }
    }

    fn is_noted(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

impl Presence {
    /// Of a database that was opened a moment ago, with the files that are open of it.
    pub(super) fn new(files: OpenFiles, mark: Mark, damage: Damage) -> Self {
        Self { files, mark, replaced: OnceLock::new(), failing: Mutex::default(), damage }
    }

    /// Whether the files are still those of their names, with the mark of this run. Costs a few calls of the system.
    ///
    /// # Errors
    /// [`Unusable`], once and for all.
    pub(super) fn check(&self) -> Result<(), Unusable> {
        if let Some(why) = self.replaced.get() {
            return Err(why.clone());
        }
        match self.files.replaced() {
            Some(path) => Err(self.replace(Unusable::FileReplaced(path.to_owned()))),
            None if !self.mark.is_in_file() => Err(self.replace(Unusable::DatabaseReplaced)),
            None => Ok(()),
        }
    }

    /// Whether no damage of the database is known.
    ///
    /// # Errors
    /// [`Unusable::Damaged`].
    pub(super) fn check_damage(&self) -> Result<(), Unusable> {
        match self.failing() {
            Some(Failing { why: why @ Unusable::Damaged(_), .. }) => Err(why),
            _ if self.damage.is_noted() => {
                Err(Unusable::Damaged("a page cannot be read; the others are being checked".to_owned()))
            }
            _ => Ok(()),
        }
    }

    /// Whether an error tells of damage, or of another database.
    pub(super) fn note(&self, error: &StoreError) {
        if let StoreError::Database(error) = error {
            self.damage.note(error);
            if is_other_database(error) {
                self.replace(Unusable::DatabaseReplaced);
            }
        }
    }

    fn replace(&self, why: Unusable) -> Unusable {
        let mut is_new = false;
        let why = self.replaced.get_or_init(|| {
            is_new = true;
            why
        });
        if is_new {
            tracing::error!(%why, "the store is gone; the service ends");
        }
        why.clone()
    }

    fn failing(&self) -> Option<Failing> {
        self.failing.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Notes how the last look ended; says it in the log where that is news.
    fn set_failing(&self, why: Option<Unusable>) {
        let mut failing = self.failing.lock().unwrap_or_else(PoisonError::into_inner);
        match (&*failing, why) {
            (None, None) => {}
            (Some(_), None) => {
                tracing::info!("the store works again");
                *failing = None;
            }
            (Some(before), Some(why)) if before.why == why => {}
            (before, Some(why)) => {
                tracing::error!(%why, "the store fails; the service is not ready");
                let since = before.as_ref().map_or_else(Instant::now, |before| before.since);
                *failing = Some(Failing { why, since });
            }
        }
    }
}

/// Looks at the database, with a connection of its own where there is one to keep.
struct Look<'s> {
    store: &'s Store,
    options: Options,
    kept: Option<Connection>,
    written: Option<Instant>,
    checked: Option<(Instant, Duration)>,
}

impl Look<'_> {
    /// Why the store cannot be used; `None` where it can.
    async fn look(&mut self) -> Option<Unusable> {
        match timeout(ANSWER_WITHIN, self.read()).await {
            Err(_elapsed) => {
                self.kept = None;
                return Some(Unusable::Silent);
            }
            Ok(Err(error)) => {
                self.kept = None;
                return Some(self.meaning(&error));
            }
            Ok(Ok(())) => {}
        }
        if let Some(why) = self.check_damage().await {
            return Some(why);
        }
        if self.written.is_some_and(|written| written.elapsed() < WRITE_EVERY) {
            return None;
        }
        self.written = None;
        match timeout(WRITE_WITHIN, self.store.try_write()).await {
            Err(_elapsed) => Some(self.store.late_write()),
            Ok(Err(StoreError::Database(error))) => Some(self.meaning(&error)),
            Ok(Err(StoreError::Unusable(why))) => Some(why),
            Ok(Err(error)) => Some(Unusable::Failing(error.to_string())),
            Ok(Ok(())) => {
                self.written = Some(Instant::now());
                None
            }
        }
    }

    fn meaning(&self, error: &sqlx::Error) -> Unusable {
        self.store.shared.presence.damage.note(error);
        if is_other_database(error) || has_no_tables(error) {
            return Unusable::DatabaseReplaced;
        }
        match fault_of(error) {
            Some(Fault::Damaged) => Unusable::Damaged(error.to_string()),
            Some(Fault::Locked) => Unusable::Locked,
            _ => Unusable::Failing(error.to_string()),
        }
    }

    /// Compares the identity. A file is opened again each time: an open connection has its pages in memory.
    async fn read(&mut self) -> Result<(), sqlx::Error> {
        let mark = &self.store.shared.presence.mark;
        let mut connection = match self.kept.take() {
            Some(kept) => kept,
            None => self.options.connect_to_read().await?,
        };
        mark.check(&mut connection).await?;
        match connection {
            Connection::Sqlite(_) => connection.close().await?,
            kept @ Connection::Postgres(_) => self.kept = Some(kept),
        }
        Ok(())
    }

    /// Runs the check of SQLite where a damaged page was met, until it finds nothing.
    async fn check_damage(&mut self) -> Option<Unusable> {
        let damage = &self.store.shared.presence.damage;
        if !damage.is_noted() {
            return None;
        }
        if let Some((at, took)) = self.checked
            && at.elapsed() < CHECK_AGAIN.max(10 * took)
        {
            return self.store.shared.presence.failing().map(|failing| failing.why);
        }
        let started = Instant::now();
        let found = self.quick_check().await;
        self.checked = Some((Instant::now(), started.elapsed()));
        match found {
            Ok(found) if found == "ok" => {
                damage.0.store(false, Ordering::Release);
                self.checked = None;
                // The connection that writes may have damaged pages in memory; a commit of another one makes those that
                // read drop theirs.
                self.store.shared.writer.renew().await;
                self.written = None;
                None
            }
            Ok(found) => Some(Unusable::Damaged(found)),
            Err(error) => Some(Unusable::Damaged(error.to_string())),
        }
    }

    async fn quick_check(&self) -> Result<String, sqlx::Error> {
        let mut connection = self.options.connect_to_read().await?;
        let text = either("pragma quick_check(1)", "select 'ok'");
        let found = query(text).scalar(&mut connection).await;
        connection.close().await?;
        found
    }
}

impl Store {
    /// Whether requests can be answered: the store is still the one that was opened, and answers.
    ///
    /// # Errors
    /// Why not.
    pub(crate) fn usable(&self) -> Result<(), Unusable> {
        let presence = &self.shared.presence;
        presence.check()?;
        match presence.failing() {
            Some(failing) if failing.why.refuses_all() => Err(failing.why),
            _ => Ok(()),
        }
    }

    /// Whether submissions can be accepted: see [`Self::usable`], no damage is known, and a write succeeds.
    ///
    /// # Errors
    /// Why not.
    pub(crate) async fn works(&self) -> Result<(), Unusable> {
        self.usable()?;
        self.shared.presence.check_damage()?;
        let store = self.clone();
        let written = self.detached(async move { store.try_write().await });
        match timeout(READY_WITHIN, written).await {
            Err(_elapsed) => Err(self.late_write()),
            Ok(Err(StoreError::Unusable(why))) => Err(why),
            Ok(Err(error)) if error.fault() == Some(Fault::Locked) => Err(Unusable::Locked),
            Ok(Err(error)) => Err(Unusable::Failing(error.to_string())),
            Ok(Ok(())) => Ok(()),
        }
    }

    /// Why a write has not ended in time. Where another program has the database locked, what is read is answered.
    fn late_write(&self) -> Unusable {
        if self.shared.writer.is_locked() { Unusable::Locked } else { Unusable::Silent }
    }

    /// For how long the database has not answered.
    pub(super) fn silent_for(&self) -> Option<Duration> {
        let failing = self.shared.presence.failing()?;
        (failing.why == Unusable::Silent).then(|| failing.since.elapsed())
    }

    /// Looks each second whether the store and these files are still those that were opened, and whether the store
    /// works. Returns when it is replaced, with the words for the log.
    pub(crate) async fn watch(&self, others: OpenFiles) -> Unusable {
        let presence = &self.shared.presence;
        let options = self.shared.writer.options().clone();
        let mut look = Look { store: self, options, kept: None, written: None, checked: None };
        loop {
            sleep(LOOK_EVERY).await;
            if let Err(why) = presence.check() {
                return why;
            }
            let others = others.clone();
            // A file system that hangs says nothing about the files.
            let replaced =
                timeout(ANSWER_WITHIN, tasks::blocking(move || others.replaced().map(PathBuf::from))).await;
            if let Ok(Ok(Some(path))) = replaced {
                return presence.replace(Unusable::FileReplaced(path));
            }
            let found = look.look().await;
            match found {
                Some(why) if why.is_final() => return presence.replace(why),
                found => presence.set_failing(found),
            }
        }
    }

    /// Writes a row without changing it.
    async fn try_write(&self) -> Result<(), StoreError> {
        let mut writer = self.shared.writer.lock(Durability::ProcessEnd).await?;
        let mut tx = writer.begin().await?;
        query("update packstone set created_at = created_at").execute(&mut tx).await?;
        Ok(tx.commit().await?)
    }
}
