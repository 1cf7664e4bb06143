//! Work that threads share.

use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Scope};

use crate::memory::probe;

/// Address space that a thread may take to start: its stack of 2 MiB, and 128 MiB of which the allocator of glibc keeps
/// half. A thread that is refused what it allocates before its first line panics or, where it is to print a backtrace,
/// waits for ever.
const BYTES_TO_START: usize = 130 << 20;

/// Whether there is address space for one more thread.
fn may_start_one() -> bool {
    probe(BYTES_TO_START).is_ok()
}

/// Does the work of every piece on several threads, the caller's among them. What a piece becomes must depend on the
/// piece and its number alone; then nothing depends on the threads. Where the system refuses a thread, or has too
/// little memory for one, the others do its work.
pub(crate) fn share<T: Send>(threads: NonZeroUsize, pieces: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    let others = threads.get().min(pieces.len()).saturating_sub(1);
    if others == 0 {
        pieces.iter_mut().enumerate().for_each(|(number, piece)| work(number, piece));
        return;
    }
    let left = Mutex::new(pieces.iter_mut().enumerate());
    let next = || left.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work_on = || {
        while let Some((number, piece)) = next() {
            work(number, piece);
        }
    };
    thread::scope(|scope| {
        start(scope, others, &work_on);
        work_on();
    });
}

/// Starts threads for the same work, the number asked for or as many as the system has room for.
pub(crate) fn start<'scope>(
    scope: &'scope Scope<'scope, '_>,
    threads: usize,
    work: &'scope (dyn Fn() + Sync),
) {
    for _ in 0..threads {
        if !may_start_one() || thread::Builder::new().spawn_scoped(scope, work).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_done_once_whatever_the_number_of_threads() {
        for threads in [1, 2, 3, 8, 100].map(|n| NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN)) {
            for count in [0, 1, 7, 64] {
                let mut pieces = vec![0; count];
                share(threads, &mut pieces, |number, piece| *piece += 1 + number);
                assert_eq!(pieces, (1..=count).collect::<Vec<_>>());
            }
        }
    }
}
