//! Random sequential addition (RSA), largest grain first.
//!
//! A grain is inserted at a uniform random point of the free space: where its sphere lies inside the specimen and
//! keeps its gap from all grains inserted before. Every distance rule is an exclusion radius `R = a r_j + b` of the
//! new grain around a grain of radius `r_j` ([`crate::distance::Exclusion`]), because the new grain is the smaller
//! one.
//!
//! `cells` answers whether a point is free; `free_space` knows the voxels that can still contain free points and proves
//! saturation when none is left and none was left undecided (Ebeida, Mitchell, Patney, Davidson and Owens 2012, DOI
//! 10.1111/j.1467-8659.2012.03059.x, for equal disks; here for spheres of any sizes); `voxels` keeps them. This module
//! drives both: it cuts the grains into segments of similar size, each with a grid of its own. In runs of many grains,
//! `ahead` has points drawn and tested by several threads.

// Forced inlining carries the instruction set of the search to what it calls ([`crate::cpu`]).
#![allow(clippy::inline_always)]

mod ahead;
mod cells;
mod free_space;
mod voxels;

use std::convert::Infallible;
use std::num::NonZeroUsize;

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::control::Control;
use crate::cpu::Cpu;
use crate::distance::DistanceRule;
use crate::domain::{Domain, Region};
use crate::elementary::cbrt;
use crate::memory::{collected, reserved};
use crate::methods::addition::{self, Attempts, End, Outcome};
use crate::packing::RsaStatistics;
use crate::segregation::Preference;
use ahead::Ahead;
pub(crate) use cells::MAX_PLACED;
use cells::{CellBuffers, Cells, Placed};
use free_space::{Draw, FreeSpace, Served, VoxelBuffers};

/// A segment ends when the exclusion diameter of a new grain has fallen to this share of the first.
const SEGMENT_RATIO: f64 = 0.75;
/// A segment ends when the grains have grown in number by this factor, so that the chains of
/// entries added to the grid stay short.
const SEGMENT_GROWTH: f64 = 2.0;
/// Edge of a cell in exclusion diameters of the smallest grain of the segment.
const CELL_EDGE: f64 = 1.5;
/// Failed draws for one grain before voxels are split.
const SPLIT_AFTER: u64 = 100;
/// Failed draws for one grain after which voxels activate for each grain exactly, to the end of the
/// segment.
const EXACT_AFTER: u64 = 1000;
/// Relative margin on exclusion radii, so that the check, which rounds differently, never sees a
/// violation in the last digit.
const ROUNDING_MARGIN: f64 = 1.0 + 8.0 * f64::EPSILON;
/// Draws between two looks at the control.
pub(crate) const DRAWS_PER_LOOK: u64 = 8192;
/// Fewest grains of a run whose work is worth to be shared by threads.
pub(crate) const LEAST_SHARED_GRAINS: usize = 100_000;

/// What random sequential addition is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Rsa<'a> {
    /// Diameters from the largest down, in mm.
    pub diameters_mm: &'a [f64],
    /// What is filled.
    pub domain: Domain,
    /// Distance between grains and to the walls.
    pub rule: DistanceRule,
    /// Attempts for one grain after which the run has failed; `None` searches exhaustively.
    pub attempts_per_grain: Option<u64>,
    /// Which of several free places a grain prefers; `None` takes the first.
    pub preference: Option<&'a Preference>,
    /// Most threads; the outcome does not depend on their number.
    pub threads: NonZeroUsize,
}

impl Rsa<'_> {
    /// Places the grains.
    ///
    /// `attempts_per_grain` counts attempts of the textbook algorithm: uniform points of the region
    /// where the sphere lies inside the specimen. Those that would fall where no place can be are
    /// not drawn but counted, by a geometric number with the same law, so that the outcome has the
    /// distribution of the textbook algorithm at a fraction of its time.
    pub fn run(&self, rng: &mut Xoshiro256PlusPlus, control: &dyn Control) -> Outcome<[f64; 3]> {
        // A grain that prefers places looks at several of them.
        let draws_ahead = self.diameters_mm.len() >= LEAST_SHARED_GRAINS && self.preference.is_none();
        self.run_as(draws_ahead, rng, control)
    }

    /// [`Self::run`] with points drawn ahead, or one by one.
    fn run_as(
        &self,
        draws_ahead: bool,
        rng: &mut Xoshiro256PlusPlus,
        control: &dyn Control,
    ) -> Outcome<[f64; 3]> {
        let placed = match reserved(self.diameters_mm.len()) {
            Ok(placed) => placed,
            Err(refused) => return Outcome::new(Err(refused), RsaStatistics::default(), End::Stopped),
        };
        let mut run = Run {
            rsa: self,
            placed,
            buffers: Default::default(),
            statistics: RsaStatistics::default(),
            looks: 0,
            draws_ahead,
            cpu: Cpu::detect(),
            control,
        };
        let end = run.place_all(rng);
        let centers_mm = collected(run.placed.iter().map(|&[x, y, z, _]| [x, y, z]));
        Outcome::new(centers_mm, run.statistics, end)
    }

    /// The new grain's part of exclusion radii.
    fn part(&self, grain: usize) -> f64 {
        self.rule.exclusion(self.diameters_mm[grain]).part_mm * ROUNDING_MARGIN
    }

    /// What the centre of a grain keeps from the walls.
    fn clearance(&self, grain: usize) -> f64 {
        let d = self.diameters_mm[grain];
        d / 2.0 + self.rule.wall_gap_mm(d)
    }
}

struct Run<'a> {
    rsa: &'a Rsa<'a>,
    placed: Vec<Placed>,
    /// Memory that the grid of the last segment had.
    buffers: (CellBuffers, VoxelBuffers),
    statistics: RsaStatistics,
    looks: u64,
    /// Whether points are drawn ahead, for threads to share.
    draws_ahead: bool,
    /// What the search is compiled for.
    cpu: Cpu,
    control: &'a dyn Control,
}

/// The search for one grain's place.
struct Search {
    part: f64,
    region: Region,
    /// Failed draws so far.
    failed: u64,
    attempts: Attempts,
    /// Volume of the region in units of a cell.
    region_cells: f64,
}

/// What one draw has found.
type Found = addition::Found<Draw>;

impl Run<'_> {
    fn place_all(&mut self, rng: &mut Xoshiro256PlusPlus) -> End {
        let grains = self.rsa.diameters_mm.len();
        while self.placed.len() < grains {
            let end = self.segment_end();
            match self.place_segment(end, rng) {
                End::Complete => {}
                other => return other,
            }
        }
        End::Complete
    }

    /// One past the last grain of the segment that starts with the next grain.
    fn segment_end(&self) -> usize {
        let first = self.placed.len();
        let exclusion = |i: usize| {
            let d = self.rsa.diameters_mm[i];
            let exclusion = self.rsa.rule.exclusion(d);
            exclusion.placed_factor * d / 2.0 + exclusion.part_mm
        };
        let least = exclusion(first) * SEGMENT_RATIO;
        let most = (first as f64 * SEGMENT_GROWTH) as usize + 64;
        let grains = self.rsa.diameters_mm.len();
        let by_size = first
            + self.rsa.diameters_mm[first..].partition_point(|&d| {
                let e = self.rsa.rule.exclusion(d);
                e.placed_factor * d / 2.0 + e.part_mm >= least
            });
        by_size.clamp(first + 1, most.max(first + 1)).min(grains)
    }

    /// Places the grains up to `end` with one grid.
    fn place_segment(&mut self, end: usize, rng: &mut Xoshiro256PlusPlus) -> End {
        let first = self.placed.len();
        let rsa = self.rsa;
        let no_place = End::InsertionFailed { saturation_proven: true, attempts: 0 };
        let domain = rsa.domain;
        let Some(region) = domain.center_region(rsa.clearance(end - 1)) else { return no_place };
        let part_least = rsa.part(end - 1);
        let d_least = rsa.diameters_mm[end - 1];
        let reach = rsa.rule.exclusion(d_least).placed_factor * d_least / 2.0 + part_least;
        // Few grains in much space need no fine grid.
        let spacing = cbrt(region.volume_mm3() / (2.0 * rsa.diameters_mm.len() as f64 + 64.0));
        let edge = (CELL_EDGE * reach).max(spacing);
        let should_stop = || self.control.should_stop();
        let periodic = domain.is_periodic();
        let (buffers, voxel_buffers) = std::mem::take(&mut self.buffers);
        let built = self.cpu.call(
            #[inline(always)]
            || Cells::build(buffers, &region, periodic, edge, &self.placed, rsa.part(first), &should_stop),
        );
        let mut cells = match built {
            Ok(cells) => cells,
            Err(end) => return end,
        };
        let served = Served {
            domain: &domain,
            largest_part: rsa.part(first),
            least_part: part_least,
            largest_clearance: rsa.clearance(first),
            least_clearance: rsa.clearance(end - 1),
        };
        let mut free = match FreeSpace::whole(voxel_buffers, &cells, served) {
            Ok(free) => free,
            Err(refused) => return refused.into(),
        };
        let mut exactly = false;
        let mut ahead = self.draws_ahead.then(Ahead::default);
        for grain in first..end {
            let Some(region) = domain.center_region(rsa.clearance(grain)) else { return no_place };
            let mut search = Search {
                part: rsa.part(grain),
                region,
                failed: 0,
                attempts: Attempts::new(rsa.attempts_per_grain, u64::MAX),
                region_cells: region.volume_mm3() / cells.edge.iter().product::<f64>(),
            };
            let cpu = self.cpu;
            let mut found = Found::NotYet;
            if let Some(points) = &mut ahead {
                let searched = cpu.call(
                    #[inline(always)]
                    || self.search_ahead(points, &mut search, &mut free, &cells, grain..end, rng),
                );
                match searched {
                    Ok(decided) => found = decided,
                    Err(refused) => return refused.into(),
                }
            }
            if matches!(found, Found::NotYet) {
                ahead = None;
                free.activate(search.part, exactly);
                found = cpu.call(
                    #[inline(always)]
                    || self.search(&mut search, &mut free, &cells, rng),
                );
            }
            if let Some(refused) = free.refused() {
                return refused.into();
            }
            exactly |= search.failed > EXACT_AFTER;
            self.statistics.grains_by_subdivision += u64::from(search.failed > SPLIT_AFTER);
            self.statistics.attempts += search.attempts.number;
            match found {
                Found::Place(draw) => {
                    let d = rsa.diameters_mm[grain];
                    let own = rsa.rule.exclusion(d).placed_factor * d / 2.0 * ROUNDING_MARGIN;
                    let [x, y, z] = draw.point;
                    let placed = [x, y, z, own];
                    if let Err(refused) = cells.insert(&placed, search.part) {
                        return refused.into();
                    }
                    self.placed.push(placed);
                }
                Found::Stopped => return End::Stopped,
                Found::Nothing { saturation_proven } => {
                    return End::InsertionFailed { saturation_proven, attempts: search.attempts.number };
                }
                Found::NotYet => unreachable!("a search goes on until it is decided"),
            }
        }
        self.statistics.voxels_tested += free.tested;
        self.buffers = (cells.into_buffers(), free.into_buffers());
        End::Complete
    }

    /// Draws from `free` until a place is found or nothing is left.
    #[inline(always)]
    fn search(
        &mut self,
        search: &mut Search,
        free: &mut FreeSpace<'_>,
        cells: &Cells,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Found {
        loop {
            if search.failed == EXACT_AFTER {
                free.activate(search.part, true);
            }
            match self.try_once(search, free, cells, search.failed >= SPLIT_AFTER, rng) {
                Found::NotYet => {}
                Found::Place(draw) => match self.rsa.preference {
                    None => return Found::Place(draw),
                    Some(preference) => return self.choose(draw, preference, search, free, cells, rng),
                },
                found => return found,
            }
        }
    }

    /// Chooses among several places for a grain by their weights.
    fn choose(
        &mut self,
        first: Draw,
        preference: &Preference,
        search: &mut Search,
        free: &mut FreeSpace<'_>,
        cells: &Cells,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Found {
        let (grain, region) = (self.placed.len(), search.region);
        let log_weight = |draw: &Draw| preference.log_weight(grain, &region, draw.point);
        // Only what was needed for the first place says that places are rare.
        let failed = search.failed;
        let Ok(found) = addition::choose(first, log_weight, rng, |rng| {
            Ok::<_, Infallible>(self.try_once(search, free, cells, search.failed >= SPLIT_AFTER, rng))
        });
        search.failed = failed;
        found
    }

    #[inline(always)]
    fn try_once(
        &mut self,
        search: &mut Search,
        free: &mut FreeSpace<'_>,
        cells: &Cells,
        split: bool,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Found {
        if self.looks_and_stops(free) {
            return Found::Stopped;
        }
        let Some(draw) = free.draw(cells, rng) else {
            return Found::Nothing { saturation_proven: free.proves_saturation() };
        };
        let inside = search.region.contains(draw.point);
        if search.count(inside, free.drawn_from_cells(), rng) {
            return Found::Nothing { saturation_proven: false };
        }
        if inside {
            match cells.blocking(draw.cell(), draw.point, search.part) {
                None => return Found::Place(draw),
                Some(sphere) if free.drop_if_covered(&draw, &sphere, cells) => {}
                Some(_) if split => free.split(&draw, cells),
                Some(_) => {}
            }
        } else if split {
            free.split(&draw, cells);
        }
        search.failed += 1;
        Found::NotYet
    }

    /// Looks at the control now and then; says whether the run has to stop.
    #[inline(always)]
    fn looks_and_stops(&mut self, free: &FreeSpace<'_>) -> bool {
        self.looks += 1;
        if !self.looks.is_multiple_of(DRAWS_PER_LOOK) {
            return false;
        }
        self.report();
        self.control.should_stop() || free.refused().is_some()
    }

    fn report(&self) {
        addition::report(self.control, self.placed.len(), self.rsa.diameters_mm.len(), |rank| {
            self.rsa.diameters_mm[rank]
        });
    }
}

impl Search {
    /// Counts the textbook attempts that one draw stands for; says whether the limit is passed.
    #[inline(always)]
    fn count(&mut self, inside: bool, drawn_from_cells: f64, rng: &mut Xoshiro256PlusPlus) -> bool {
        self.attempts.count(drawn_from_cells / self.region_cells, rng, |_| inside)
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod undecided_tests;
