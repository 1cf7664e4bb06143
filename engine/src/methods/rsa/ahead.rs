//! Points drawn and tested ahead by several threads, for runs of many grains.
//!
//! Nearly all of the time goes into looking whether points are free, and most points are not. A batch of points is
//! therefore drawn from the voxels and tested against the grains placed so far, in pieces that threads share; the
//! points are then taken one after the other. A point that was free is only tested against grains placed since the
//! batch was drawn, and a point that is covered for every grain that the batch may serve is not tested again.
//!
//! The points are uniform in the voxels active when the batch was drawn, all of them before the first is taken, and
//! each is accepted if it is free when it is taken: the law of the places is that of points drawn one by one. Each
//! piece has a random stream of its own, so that nothing depends on the number of threads.

use std::num::NonZeroUsize;
use std::ops::Range;

use rand::rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::cells::{Cells, Known};
use super::free_space::{DRAWS_AT_ONCE, Draw, FreeSpace, covered_above_of};
use super::{EXACT_AFTER, Found, Run, SPLIT_AFTER, Search};
use crate::cpu::Cpu;
use crate::memory::{OutOfMemory, collected, refill};
use crate::threads::share;

/// Points of a piece, a multiple of those drawn at once.
const PIECE: usize = 8 * DRAWS_AT_ONCE;
/// Most and fewest points of a batch. Smaller batches cost more to distribute than to compute.
const MOST_POINTS: usize = 64 * PIECE;
const LEAST_POINTS: usize = 4 * PIECE;
/// Active voxels for each point of a batch: few of them drop out while the batch is used up.
const VOXELS_PER_POINT: usize = 16;
/// Points between one that is taken and the one whose cells the memory is asked for.
const ASK_AHEAD: usize = 6;

/// What is known of a point, of the grains that were placed when it was drawn.
#[derive(Clone, Copy, Debug, Default)]
enum Verdict {
    /// It must be tested as if nothing were known.
    #[default]
    Unknown,
    /// None of them covers it.
    Free,
    /// One of them covers it for all grains that the batch may serve, and its voxel for those whose part is above this.
    Covered { voxel_above: f64 },
}

#[derive(Clone, Copy, Debug, Default)]
struct Point {
    draw: Draw,
    verdict: Verdict,
}

/// A batch of points.
#[derive(Debug, Default)]
pub(super) struct Ahead {
    points: Vec<Point>,
    next: usize,
    /// Volume that the points were drawn from, in units of a cell.
    volume_cells: f64,
    /// The first grain, as cells name it, that the verdicts do not know.
    unknown_from: u32,
}

impl Ahead {
    /// Draws `points` points for grains from the largest part to the least.
    ///
    /// # Errors
    /// When the system refuses memory.
    fn draw(
        &mut self,
        parts_mm: [f64; 2],
        points: usize,
        free: &FreeSpace<'_>,
        cells: &Cells,
        rng: &mut Xoshiro256PlusPlus,
        (threads, cpu): (NonZeroUsize, Cpu),
    ) -> Result<(), OutOfMemory> {
        refill(&mut self.points, points, Point::default())?;
        self.next = 0;
        self.volume_cells = free.volume_cells();
        self.unknown_from = cells.grains();
        let (key, volume_cells) = (rng.next_u64(), self.volume_cells);
        let mut pieces = collected(self.points.chunks_mut(PIECE))?;
        share(threads, &mut pieces, |number, piece| {
            let number = number as u64 + 1;
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(key ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            cpu.call(
                #[inline(always)]
                || {
                    for points in piece.chunks_mut(DRAWS_AT_ONCE) {
                        let Some(draws) = free.draw_points(volume_cells, cells, &mut rng) else { return };
                        for (point, draw) in points.iter_mut().zip(draws) {
                            *point = Point { draw, verdict: verdict(&draw, parts_mm, cells) };
                        }
                    }
                },
            );
        });
        Ok(())
    }
}

#[inline(always)]
fn verdict(draw: &Draw, [largest_mm, least_mm]: [f64; 2], cells: &Cells) -> Verdict {
    match cells.known(draw.cell(), draw.point, largest_mm, least_mm) {
        Known::Free => Verdict::Free,
        Known::Covered(sphere) => Verdict::Covered { voxel_above: covered_above_of(draw, &sphere, cells) },
        Known::Partly => Verdict::Unknown,
    }
}

impl Run<'_> {
    /// Takes points for the first of the grains until one is its place. [`Found::NotYet`] where points are no more to
    /// be drawn ahead in this segment: voxels are few, or a place is so rare that its voxels must be exact.
    #[inline(always)]
    pub(super) fn search_ahead(
        &mut self,
        ahead: &mut Ahead,
        search: &mut Search,
        free: &mut FreeSpace<'_>,
        cells: &Cells,
        grains: Range<usize>,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<Found, OutOfMemory> {
        while search.failed < EXACT_AFTER {
            if ahead.next == ahead.points.len() {
                let most = MOST_POINTS.min(grains.len().max(LEAST_POINTS));
                let points = most.min(free.voxels() / VOXELS_PER_POINT) / PIECE * PIECE;
                if points < LEAST_POINTS {
                    return Ok(Found::NotYet);
                }
                // Every point may be the place of a grain.
                let last = grains.end.min(grains.start + points) - 1;
                let least = self.rsa.part(last);
                free.activate(least, false);
                let on = (self.rsa.threads, self.cpu);
                ahead.draw([search.part, least], points, free, cells, rng, on)?;
            }
            if self.looks_and_stops(free) {
                return Ok(Found::Stopped);
            }
            let Point { draw, verdict } = ahead.points[ahead.next];
            ahead.next += 1;
            if let Some(Point { draw, verdict: Verdict::Free }) = ahead.points.get(ahead.next + ASK_AHEAD) {
                cells.prefetch_around(draw.cell());
            }
            let inside = search.region.contains(draw.point);
            if search.count(inside, ahead.volume_cells, rng) {
                return Ok(Found::Nothing { saturation_proven: false });
            }
            let split = search.failed >= SPLIT_AFTER;
            let dropped = match verdict {
                _ if !inside => false,
                Verdict::Covered { voxel_above } => free.drop_covered(&draw, voxel_above),
                Verdict::Free => {
                    if !cells.covered_since(ahead.unknown_from, draw.cell(), draw.point, search.part) {
                        return Ok(Found::Place(draw));
                    }
                    false
                }
                Verdict::Unknown => match cells.blocking(draw.cell(), draw.point, search.part) {
                    None => return Ok(Found::Place(draw)),
                    Some(sphere) => free.drop_if_covered(&draw, &sphere, cells),
                },
            };
            if split && !dropped {
                free.split(&draw, cells);
            }
            search.failed += 1;
        }
        Ok(Found::NotYet)
    }
}
