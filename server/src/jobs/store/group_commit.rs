//! Writes that share a transaction (group commit; Gawlick and Kinkade 1985, IEEE Database Engineering Bulletin 8(2);
//! `DeWitt` et al. 1984, DOI 10.1145/602259.602261).
//!
//! A commit waits for the disk, and on PostgreSQL its begin and its end are two messages. Short writes that arrive
//! while another one is under way therefore wait in a line. Whoever gets the right to write next runs those that wait
//! one after another in one transaction, commits it, and tells each of them its result. Each sees the changes of those
//! before it, as if it had been alone.
//!
//! Where one of them fails, which is rare, the transaction is rolled back, and all run once more, each from a
//! savepoint, to which a write that fails is rolled back: the others are committed. Where SQLite has rolled the whole
//! transaction back by itself, as on a full disk, there is no savepoint any more: then each write runs in a transaction
//! of its own, so that none fails because of another. A write must therefore be repeatable: it changes nothing but the
//! database.

use std::collections::VecDeque;
use std::pin::Pin;
use std::slice;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::oneshot;

use super::db::{Durability, Transaction};
use super::writer::Writing;
use super::{Store, StoreError};

/// Most writes of one transaction: those that come later wait for so many at most.
const MOST: usize = 64;

/// The future of a write.
pub(super) type Running<'t, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 't>>;

/// What a write does, given its input, in a transaction.
pub(super) type Write<I, T> = for<'t, 'c> fn(&'t Store, &'t I, &'t mut Transaction<'c>) -> Running<'t, T>;

/// The writes that wait.
#[derive(Debug, Default)]
pub(super) struct Line(Mutex<VecDeque<Box<dyn SharedWrite>>>);

impl Line {
    fn join(&self, write: Box<dyn SharedWrite>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push_back(write);
    }

    fn next(&self) -> Vec<Box<dyn SharedWrite>> {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = waiting.len().min(MOST);
        waiting.drain(..count).collect()
    }
}

/// A write of any type.
trait SharedWrite: std::fmt::Debug + Send {
    /// What its commit must survive.
    fn durability(&self) -> Durability;
    /// Runs it and keeps its result; whether it succeeded.
    fn run<'t>(&'t mut self, tx: &'t mut Transaction<'_>) -> Pin<Box<dyn Future<Output = bool> + Send + 't>>;
    /// Tells who waits the result, or why the transaction failed.
    fn end(self: Box<Self>, failed: Option<Arc<sqlx::Error>>);
}

struct Waiting<I, T> {
    store: Store,
    durability: Durability,
    input: I,
    write: Write<I, T>,
    result: Option<Result<T, StoreError>>,
    answer: oneshot::Sender<Result<T, StoreError>>,
}

impl<I, T> std::fmt::Debug for Waiting<I, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Waiting").field("durability", &self.durability).finish_non_exhaustive()
    }
}

impl<I: Send + Sync, T: Send> SharedWrite for Waiting<I, T> {
    fn durability(&self) -> Durability {
        self.durability
    }

    fn run<'t>(&'t mut self, tx: &'t mut Transaction<'_>) -> Pin<Box<dyn Future<Output = bool> + Send + 't>> {
        Box::pin(async move {
            let result = (self.write)(&self.store, &self.input, tx).await;
            self.result.insert(result).is_ok()
        })
    }

    fn end(self: Box<Self>, failed: Option<Arc<sqlx::Error>>) {
        let result = match failed {
            Some(error) => Err(StoreError::Database(error)),
            None => self.result.unwrap_or_else(|| Err(abandoned())),
        };
        // Nobody waits any more only where the process ends.
        let _ = self.answer.send(result);
    }
}

/// The write was broken off by the end of the task that ran it.
fn abandoned() -> StoreError {
    sqlx::Error::WorkerCrashed.into()
}

impl Store {
    /// Runs a short write in a transaction that other writes may share, and returns when it is committed. The write
    /// may run up to three times.
    ///
    /// # Errors
    /// Those of the write, or the database's.
    pub(super) async fn write<I, T>(
        &self,
        durability: Durability,
        input: I,
        write: Write<I, T>,
    ) -> Result<T, StoreError>
    where
        I: Send + Sync + 'static,
        T: Send + 'static,
    {
        let writer = &self.shared.writer;
        let (answer, mut answered) = oneshot::channel();
        let store = self.clone();
        writer.line().join(Box::new(Waiting { store, durability, input, write, result: None, answer }));
        loop {
            let mut writing = tokio::select! {
                biased;
                answer = &mut answered => return answer.unwrap_or_else(|_| Err(abandoned())),
                writing = writer.wait() => writing,
            };
            run_all(&mut writing, writer.line().next()).await;
        }
    }
}

/// Runs writes in one transaction: with savepoints where one of them fails, and each in a transaction of its own where
/// a failure has lost those.
async fn run_all(writing: &mut Writing<'_>, mut writes: Vec<Box<dyn SharedWrite>>) {
    let are_several = writes.len() > 1;
    let mut ended = in_one_transaction(writing, &mut writes, false).await;
    if are_several && matches!(ended, Ok(false)) {
        ended = in_one_transaction(writing, &mut writes, true).await;
    }
    let is_refused = are_several && matches!(ended, Ok(false));
    let failed = ended.err().map(Arc::new);
    for mut write in writes {
        if is_refused {
            let ended = in_one_transaction(writing, slice::from_mut(&mut write), false).await;
            write.end(ended.err().map(Arc::new));
        } else {
            write.end(failed.clone());
        }
    }
}

/// Runs writes in one transaction and commits it. With savepoints, what a write that fails has changed is taken back;
/// without them, all of the transaction is. Where it is taken back or lost by a failure, nothing is changed and the
/// answer is `false`.
async fn in_one_transaction(
    writing: &mut Writing<'_>,
    writes: &mut [Box<dyn SharedWrite>],
    with_savepoints: bool,
) -> Result<bool, sqlx::Error> {
    let is_quick = writes.iter().all(|write| write.durability() == Durability::ProcessEnd);
    writing.prepare(if is_quick { Durability::ProcessEnd } else { Durability::PowerCut }).await?;
    let mut tx = writing.begin().await?;
    for (place, write) in writes.iter_mut().enumerate() {
        if with_savepoints {
            tx.set_savepoint(place == 0).await?;
        }
        if write.run(&mut tx).await || (with_savepoints && tx.roll_back_to_savepoint().await.is_ok()) {
            continue;
        }
        // Where this fails the connection is replaced before the next write.
        let _ = tx.rollback().await;
        writing.doubt();
        return Ok(false);
    }
    tx.commit().await?;
    Ok(true)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::db::query;
    use super::super::tests::fresh;
    use super::*;

    /// What a write of these tests adds to the table of removals, and what the writes have seen.
    struct Addition {
        path: &'static str,
        is_refused: bool,
        seen: Arc<Mutex<Vec<String>>>,
    }

    impl Addition {
        async fn run(&self, store: &Store, tx: &mut Transaction<'_>) -> Result<i64, StoreError> {
            let before: i64 = query("select count(*) from removals").scalar(&mut *tx).await?;
            let committed: i64 = query("select count(*) from removals").scalar(store.readers()).await?;
            self.seen.lock().unwrap().push(format!("{}: {before} {committed}", self.path));
            query("insert into removals (path) values (?)").bind(self.path).execute(tx).await?;
            if self.is_refused { Err(StoreError::LeaseLost) } else { Ok(before) }
        }
    }

    struct Ended {
        answers: Vec<Result<i64, StoreError>>,
        seen: Vec<String>,
        /// What is committed in the end.
        paths: Vec<String>,
    }

    /// Runs writes that all wait while another one is under way; what they answer, and what they have seen.
    async fn together(writes: &[(&'static str, bool)]) -> Ended {
        let (_folder, store) = fresh().await;
        let seen = Arc::default();
        let other = store.writer().await.unwrap();
        let mut answers = Vec::new();
        for (place, &(path, is_refused)) in writes.iter().enumerate() {
            let (addition, of) = (Addition { path, is_refused, seen: Arc::clone(&seen) }, store.clone());
            answers.push(tokio::spawn(async move {
                let write: Write<Addition, i64> = |store, addition, tx| Box::pin(addition.run(store, tx));
                of.write(Durability::PowerCut, addition, write).await
            }));
            while store.shared.writer.line().0.lock().unwrap().len() == place {
                tokio::task::yield_now().await;
            }
        }
        drop(other);
        let mut ended = Vec::new();
        for answer in answers {
            ended.push(answer.await.unwrap());
        }
        let seen = seen.lock().unwrap().clone();
        let paths = query("select path from removals order by path").scalars(store.readers()).await.unwrap();
        Ended { answers: ended, seen, paths }
    }

    #[tokio::test]
    async fn writes_that_wait_share_a_transaction_and_see_those_before_them() {
        let Ended { answers, seen, paths } = together(&[("a", false), ("b", false), ("c", false)]).await;
        let answers: Vec<i64> = answers.into_iter().map(Result::unwrap).collect();
        assert_eq!(answers, [0, 1, 2]);
        assert_eq!(seen, ["a: 0 0", "b: 1 0", "c: 2 0"], "nothing was committed before the last one");
        assert_eq!(paths, ["a", "b", "c"]);
    }

    #[tokio::test]
    async fn a_write_that_fails_takes_back_itself_and_no_other() {
        let Ended { answers, seen, paths } = together(&[("a", false), ("b", true), ("c", false)]).await;
        assert!(matches!(answers[..], [Ok(0), Err(StoreError::LeaseLost), Ok(1)]), "{answers:?}");
        assert_eq!(seen, ["a: 0 0", "b: 1 0", "a: 0 0", "b: 1 0", "c: 1 0"], "nothing was committed before");
        assert_eq!(paths, ["a", "c"]);
    }

    #[tokio::test]
    async fn an_error_of_the_database_is_that_of_its_write_only() {
        let Ended { answers, paths, seen } = together(&[("a", false), ("a", false), ("b", false)]).await;
        assert!(matches!(answers[..], [Ok(0), Err(StoreError::Database(_)), Ok(1)]), "{answers:?}");
        assert_eq!(
            seen,
            ["a: 0 0", "a: 1 0", "a: 0 0", "a: 1 0", "b: 1 0"],
            "the second time from savepoints"
        );
        assert_eq!(paths, ["a", "b"]);
    }

    #[tokio::test]
    async fn a_long_line_is_written_in_several_transactions() {
        let names: Vec<&'static str> =
            (0..=MOST).map(|i| &*Box::leak(format!("{i:03}").into_boxed_str())).collect();
        let writes: Vec<_> = names.iter().map(|name| (*name, false)).collect();
        let Ended { answers, seen, paths } = together(&writes).await;
        assert!(answers.iter().all(Result::is_ok));
        assert_eq!(seen[MOST - 1], format!("{:03}: {} 0", MOST - 1, MOST - 1));
        assert_eq!(seen[MOST], format!("{MOST:03}: {MOST} {MOST}"));
        assert_eq!(paths, names);
    }
}
