//! Work that is made in pieces on several threads, and taken piece by piece in order on the caller's.

use std::iter;
use std::num::NonZeroUsize;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use crate::threads::start;

/// Slots for each thread: of one piece under way and of one that waits to be taken.
pub(super) const SLOTS_PER_THREAD: usize = 2;

/// Slots for that number of threads, and for no more than there are pieces.
pub(super) fn slots<S>(threads: NonZeroUsize, pieces: usize, slot: impl FnMut() -> S) -> Vec<S> {
    iter::repeat_with(slot).take(SLOTS_PER_THREAD * threads.get().min(pieces)).collect()
}

/// A place for one piece at a time, with what is used again from piece to piece.
enum Slot<'a, S, E> {
    Free(&'a mut S),
    UnderWay,
    Made(&'a mut S, Result<(), E>),
}

struct State<'a, S, E> {
    /// Piece `i` has slot `i % slots.len()`.
    slots: Vec<Slot<'a, S, E>>,
    pieces: usize,
    claimed: usize,
    taken: usize,
    /// Nothing more is to be made.
    ended: bool,
}

impl<'a, S, E> State<'a, S, E> {
    /// The next piece and its slot, where there is one and its slot is free.
    fn claim(&mut self) -> Option<(usize, &'a mut S)> {
        let piece = self.claimed;
        if self.ended || piece == self.pieces || piece >= self.taken + self.slots.len() {
            return None;
        }
        match self.replace(piece, Slot::UnderWay) {
            Slot::Free(slot) => {
                self.claimed += 1;
                Some((piece, slot))
            }
            other => {
                self.replace(piece, other);
                None
            }
        }
    }

    /// The next piece to take and its slot, where it is made.
    fn take(&mut self) -> Option<(&'a mut S, Result<(), E>)> {
        match self.replace(self.taken, Slot::UnderWay) {
            Slot::Made(slot, made) => Some((slot, made)),
            other => {
                self.replace(self.taken, other);
                None
            }
        }
    }

    fn replace(&mut self, piece: usize, slot: Slot<'a, S, E>) -> Slot<'a, S, E> {
        let at = piece % self.slots.len();
        std::mem::replace(&mut self.slots[at], slot)
    }
}

struct Shared<'a, S, E> {
    state: Mutex<State<'a, S, E>>,
    /// A piece was made, or all has ended.
    made: Condvar,
    /// A slot is free, or all has ended.
    free: Condvar,
}

impl<'a, S, E> Shared<'a, S, E> {
    fn lock(&self) -> MutexGuard<'_, State<'a, S, E>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes pieces for as long as there are any.
    fn work(&self, make: &Make<'_, S, E>) {
        let end = EndOnDrop(self);
        let mut state = self.lock();
        while !state.ended && state.claimed < state.pieces {
            state = match state.claim() {
                Some((piece, slot)) => {
                    drop(state);
                    let made = make(piece, slot);
                    let mut state = self.lock();
                    state.replace(piece, Slot::Made(slot, made));
                    self.made.notify_one();
                    state
                }
                None => self.free.wait(state).unwrap_or_else(PoisonError::into_inner),
            };
        }
        drop(state);
        std::mem::forget(end);
    }
}

/// Ends the work of all threads when one leaves early, by a panic too.
struct EndOnDrop<'s, 'a, S, E>(&'s Shared<'a, S, E>);

impl<S, E> Drop for EndOnDrop<'_, '_, S, E> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.made.notify_all();
        self.0.free.notify_all();
    }
}

/// Makes pieces on one thread for every [`SLOTS_PER_THREAD`] slots, the caller's among them, and takes them in
/// order on the caller's. What is made must depend on the number of the piece alone; then what is taken does not depend
/// on the threads. Where the system refuses a thread, or has too little memory for one, the others do its work.
///
/// # Errors
/// The first of `make` or `take` in the order of pieces; nothing is made or taken after it.
pub(super) fn in_order<S: Send, E: Send>(
    slots: &mut [S],
    pieces: usize,
    make: impl Fn(usize, &mut S) -> Result<(), E> + Sync,
    mut take: impl FnMut(usize, &mut S) -> Result<(), E>,
) -> Result<(), E> {
    run(slots, pieces, &make, &mut take)
}

type Make<'f, S, E> = dyn Fn(usize, &mut S) -> Result<(), E> + Sync + 'f;
type Take<'f, S, E> = dyn FnMut(usize, &mut S) -> Result<(), E> + 'f;

/// [`in_order`], compiled once for each type of slots and errors.
fn run<S: Send, E: Send>(
    slots: &mut [S],
    pieces: usize,
    make: &Make<'_, S, E>,
    take: &mut Take<'_, S, E>,
) -> Result<(), E> {
    let others = (slots.len() / SLOTS_PER_THREAD).min(pieces).saturating_sub(1);
    let slots = slots.iter_mut().map(Slot::Free).collect();
    let shared = Shared {
        state: Mutex::new(State { slots, pieces, claimed: 0, taken: 0, ended: false }),
        made: Condvar::new(),
        free: Condvar::new(),
    };
    let work = || shared.work(make);
    thread::scope(|scope| {
        let _end = EndOnDrop(&shared);
        start(scope, others, &work);
        let mut state = shared.lock();
        while state.taken < pieces {
            let piece = state.taken;
            state = if let Some((slot, made)) = state.take() {
                drop(state);
                made?;
                take(piece, slot)?;
                let mut state = shared.lock();
                state.replace(piece, Slot::Free(slot));
                state.taken += 1;
                shared.free.notify_one();
                state
            } else if let Some((piece, slot)) = state.claim() {
                drop(state);
                let made = make(piece, slot);
                let mut state = shared.lock();
                state.replace(piece, Slot::Made(slot, made));
                state
            } else if state.ended {
                // A thread panicked, and the scope passes it on.
                return Ok(());
            } else {
                shared.made.wait(state).unwrap_or_else(PoisonError::into_inner)
            };
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn pieces_are_taken_in_order_whatever_the_threads() {
        for threads in [1, 2, 3, 8] {
            for pieces in [0, 1, 2, 100] {
                let mut slots = vec![0; SLOTS_PER_THREAD * threads];
                let mut taken = Vec::new();
                let ended = in_order(
                    &mut slots,
                    pieces,
                    |i, slot| {
                        *slot = i * i;
                        Ok::<(), ()>(())
                    },
                    |i, slot| {
                        taken.push((i, *slot));
                        Ok(())
                    },
                );
                assert_eq!(ended, Ok(()));
                assert_eq!(taken, (0..pieces).map(|i| (i, i * i)).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn pieces_wait_for_their_slots() {
        let (made, taken) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let mut slots = [(); 3 * SLOTS_PER_THREAD];
        let ended = in_order(
            &mut slots,
            200,
            |_, ()| {
                let ahead = made.fetch_add(1, Ordering::SeqCst) + 1 - taken.load(Ordering::SeqCst);
                if ahead <= 3 * SLOTS_PER_THREAD + 1 { Ok(()) } else { Err(ahead) }
            },
            |_, ()| {
                taken.fetch_add(1, Ordering::SeqCst);
                Ok(())
            },
        );
        assert_eq!(ended, Ok(()));
    }

    #[test]
    fn the_first_error_ends_all() {
        for threads in [1, 2, 8] {
            let mut slots = vec![(); SLOTS_PER_THREAD * threads];
            let made = AtomicUsize::new(0);
            let make = |i, (): &mut ()| {
                made.fetch_add(1, Ordering::SeqCst);
                if i == 7 || i == 9 { Err(i) } else { Ok(()) }
            };
            let mut taken = 0;
            let count = |_, (): &mut ()| {
                taken += 1;
                Ok(())
            };
            assert_eq!(in_order(&mut slots, 1000, make, count), Err(7));
            assert_eq!(taken, 7);
            assert!(made.load(Ordering::SeqCst) <= 8 + slots.len());
            let refuse = |i, (): &mut ()| if i == 3 { Err(i) } else { Ok(()) };
            assert_eq!(in_order(&mut slots, 1000, |_, ()| Ok(()), refuse), Err(3));
        }
    }

    #[test]
    fn a_panic_is_passed_on() {
        for threads in [1, 2, 8] {
            let mut slots = vec![(); SLOTS_PER_THREAD * threads];
            let run = || {
                in_order(
                    &mut slots,
                    1000,
                    |i, ()| if i < 50 { Ok(()) } else { panic!("{i}") },
                    |_, ()| Ok::<(), ()>(()),
                )
            };
            assert!(catch_unwind(AssertUnwindSafe(run)).is_err());
        }
    }
}
