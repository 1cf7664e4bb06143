//! The walk over all pairs of a table, which threads share.
//!
//! The walk falls into pieces: some grains of one octave, which look for partners in another. What a piece finds
//! depends on the piece alone, and findings come back in the order of the pieces, so that nothing depends on the
//! threads.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::table::{Grain, Piece, Table};
use super::{Fault, report};
use crate::control::Control;
use crate::cpu::Cpu;
use crate::memory::reserved;
use crate::threads::share;

/// How a walk is made.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    /// Most threads.
    pub(super) threads: NonZeroUsize,
    /// Is told how many grains are done, and may stop the walk.
    pub(super) control: &'a dyn Control,
}

/// What the pairs of a piece have shown.
pub(super) trait Findings: Send {
    /// Whether a pair is too close. Nothing is asked then of the pieces behind.
    fn have_fault(&self) -> bool;
}

/// What is left of a walk.
pub(super) struct Walked<F> {
    /// What the pieces have found, in their order. Those behind the first fault may not have been walked.
    pub(super) findings: Vec<F>,
    /// Number of pairs.
    pub(super) pairs: u64,
}

struct Part<F> {
    piece: Piece,
    findings: F,
    pairs: u64,
}

impl Walk<'_> {
    /// Calls `visit(findings, row_i, row_j, grain_i, grain_j)` once for every pair in reach of the table, and for some
    /// beyond. A piece has so many grains at most. The findings are those of the piece, and are `empty()` at its start.
    ///
    /// # Errors
    /// [`Fault::Stopped`] and [`Fault::OutOfMemory`].
    #[inline(always)]
    pub(super) fn over<G: Fn(f64, f64) -> f64 + Sync, F: Findings>(
        &self,
        table: &Table<G>,
        grains_per_piece: usize,
        empty: impl Fn() -> F,
        visit: impl Fn(&mut F, usize, usize, &Grain, &Grain) + Sync,
    ) -> Result<Walked<F>, Fault> {
        let pieces = table.pieces(grains_per_piece);
        let mut parts = reserved(pieces.clone().count())?;
        parts.extend(pieces.map(|piece| Part { piece, findings: empty(), pairs: 0 }));
        let walks: usize = parts.iter().map(|part| part.piece.grains.len()).sum();
        let grains = table.grains();
        let (walked, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
        let first_fault = AtomicUsize::new(usize::MAX);
        let cpu = Cpu::detect();
        share(self.threads, &mut parts, |number, Part { piece, findings, pairs }| {
            if stopped.load(Ordering::Relaxed) || number > first_fault.load(Ordering::Relaxed) {
                return;
            }
            *pairs = cpu.call(
                #[inline(always)]
                || {
                    table.for_each_pair(
                        piece,
                        #[inline(always)]
                        |i: usize, j: usize, a: &Grain, b: &Grain| visit(findings, i, j, a, b),
                    )
                },
            );
            if findings.have_fault() {
                first_fault.fetch_min(number, Ordering::Relaxed);
            }
            let of_piece = piece.grains.len();
            let walked = of_piece + walked.fetch_add(of_piece, Ordering::Relaxed);
            report(self.control, walked * grains / walks, grains);
            if self.control.should_stop() {
                stopped.store(true, Ordering::Relaxed);
            }
        });
        if stopped.into_inner() {
            return Err(Fault::Stopped);
        }
        let pairs = parts.iter().map(|part| part.pairs).sum();
        let mut findings = reserved(parts.len())?;
        findings.extend(parts.into_iter().map(|part| part.findings));
        Ok(Walked { findings, pairs })
    }
}
