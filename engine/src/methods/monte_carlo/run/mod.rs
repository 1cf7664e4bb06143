//! One run from the first compression cycle to the last: growth, limits, checkpoints.
//!
//! A cycle depends on the poses, the steps, the rate and a few numbers more, and on a random stream of its own. Lists
//! and planes carry over from cycle to cycle; where lists are due to be rebuilt they are forgotten, and there a
//! checkpoint may be written.

mod body;
mod end;
mod forecast;
mod report;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::io::Write;
use std::time::Instant;

use super::lists::Lists;
use super::push::{Pusher, Tighten};
use super::shake;
use super::swap;
use super::system::System;
use super::{BEYOND_TARGET, MonteCarlo, spread};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::gap::grain::{ConvexShape, Turned};
use crate::memory::{OutOfMemory, collected, filled, reserved};
use crate::methods::growth::{Curve, Expansions, Interrupted, Outcome, may_go_on};
use crate::methods::swap_pairs::{Families, SwapPairs};
use crate::packing::{GrowthEnd, MonteCarloStatistics, RsaStatistics, Statistics};
use crate::rng::cycle_stream;
use crate::shape::Pose;
use end::Pushes;
use forecast::Forecast;
pub(super) use forecast::start_share;
pub(crate) use forecast::time_to;

/// Sweeps of moves in a cycle, and moves in a cycle of few grains.
const SWEEPS_PER_CYCLE: u64 = 5;
const LEAST_MOVES: u64 = 2000;
/// Swaps tried per grain in a cycle.
const SWAPS_PER_GRAIN: f64 = 3.0;
/// In one of this number of cycles grains are swapped everywhere, where the specimen is cut into ranges.
const CYCLES_PER_SWAPS_EVERYWHERE: u64 = 16;
/// Relative difference of sizes that swaps start with.
const FIRST_SWAP_WINDOW: f64 = 0.05;
/// Growth of a cycle from which on the packing grows fast, relative.
const FAST_RATE: f64 = 2e-3;
/// Standard deviation of `ln d` by volume below which grains jam those of their size.
const NARROW: f64 = 0.3;
/// Largest and smallest growth of a cycle, relative: the smallest keeps the grains shaking.
const MOST_RATE: f64 = 0.005;
const LEAST_RATE: f64 = 1e-6;
/// Factors on the rate: where few sweeps of pushes sufficed, and where more did; where most, and where little of the
/// growth was kept; and where nothing was.
const EASY_SWEEPS: u32 = 6;
const EASY: f64 = 1.3;
const CLEAR: f64 = 1.1;
const MOST_KEPT: (f64, f64) = (0.6, 1.2);
const LITTLE_KEPT: (f64, f64) = (0.3, 0.7);
const NOTHING_KEPT: f64 = 0.5;
/// Most cycles that lists are kept, and the growth that they are built for, in rates and at most.
const CYCLES_PER_LIST: u64 = 10;
const RATES_PER_LIST: f64 = 20.0;
const MOST_LISTED_GROWTH: f64 = 0.01;
/// The skin in steps of moves, and its bounds over the radius; the lower one grows with the rate.
const SKIN_STEPS: f64 = 20.0;
const LEAST_SKIN: f64 = 0.05;
const SKIN_RATES: f64 = 4.0;
const MOST_SKIN: f64 = 0.8;
/// The factor on the skin of a grain that was held by it, its largest value, and how fast it falls.
const HELD_WIDER: f64 = 1.6;
const MOST_MARGIN: f64 = 4.0;
const MARGIN_FALL: f64 = 0.9;
/// Largest skin over the diameter of equal volume.
pub(super) const MOST_SKIN_OVER_D: f64 = MOST_MARGIN * MOST_SKIN / 2.0;
/// Lists are due when displacements were prevented as often as this share of the grains.
const MOST_HELD: f64 = 0.01;

/// What grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Everything by one scale, to the size and gap asked for.
    Scale,
    /// The gap, as far as it goes.
    Gap,
}

/// A run between two cycles, or in one.
pub(super) struct Run<S: ConvexShape> {
    system: System<S>,
    /// Equivalent diameters of the largest grain and of the one in the middle.
    largest_mm: f64,
    middle_mm: f64,
    /// Factors on the skins of the grains that were held by theirs lately, by site: for the others it is 1.
    margins: Vec<(u32, f64)>,
    stage: Stage,
    rate: f64,
    swaps: SwapPairs,
    families: Families,
    counted: MonteCarloStatistics,
    pub(super) rsa: RsaStatistics,
    pub(super) rsa_s: f64,
    /// Packing time before the last checkpoint.
    earlier_s: f64,
    started: Instant,
    /// Size, and the cycle at which it was noted, to tell a stall.
    mark: (f64, u64),
    pushes: Pushes,
    /// Whether hard pushes of polyhedra are wide ones.
    is_wide: bool,
    expansions: Expansions,
    curve: Curve,
    pub(super) fraction: f64,
    forecast: Forecast,
    /// Volume of the grains over that of the specimen.
    target_fraction: f64,
    /// Cycles since the lists were built, and the stretch and gap that they hold to.
    listed_cycles: u64,
    listed_stretch: f64,
    listed_extra_gap: f64,
    /// The constant gap that the grains keep, where it is what grows; at least that which they were made to keep.
    kept: f64,
}

impl<S: ConvexShape> Run<S> {
    /// A run from poses that are valid at a scale.
    pub(super) fn new(
        of: &MonteCarlo<'_, S>,
        poses: Vec<Pose>,
        scale: f64,
        started: Instant,
    ) -> Result<Self, OutOfMemory> {
        let mut system = System::new(&of.domain, of.rule, of.shapes, poses)?;
        system.threads = of.threads;
        system.frame.wall_share = if of.maximize == Some(None) { 0.5 } else { 0.0 };
        system.frame.stretch = 1.0 / scale;
        for hot in &mut system.hot {
            hot.center = hot.center.each(|x| x / scale);
        }
        let volume: f64 = of.shapes.iter().map(S::volume_mm3).sum();
        let spheres = system.hot.iter().filter(|hot| hot.turned.is_sphere()).count();
        let is_wide = 2 * spheres > system.len() || spread(of.shapes) < NARROW;
        Ok(Self {
            system,
            largest_mm: of.shapes.first().map_or(0.0, S::equivalent_diameter_mm),
            middle_mm: of.shapes.get(of.shapes.len() / 2).map_or(1.0, S::equivalent_diameter_mm),
            margins: Vec::new(),
            stage: Stage::Scale,
            rate: MOST_RATE,
            swaps: SwapPairs::new(FIRST_SWAP_WINDOW),
            families: Families::new(of.shapes, S::is_similar)?,
            counted: MonteCarloStatistics::default(),
            rsa: RsaStatistics::default(),
            rsa_s: 0.0,
            earlier_s: 0.0,
            started,
            mark: (0.0, 0),
            pushes: Pushes::first::<S>(),
            is_wide,
            expansions: Expansions::default(),
            curve: Curve::new(),
            fraction: 0.0,
            forecast: Forecast::new(of.target_share),
            target_fraction: volume / of.domain.volume_mm3,
            listed_cycles: CYCLES_PER_LIST,
            listed_stretch: 0.0,
            listed_extra_gap: 0.0,
            kept: 0.0,
        })
    }

    /// Grows until something ends it, and keeps a checkpoint there if one is wanted.
    pub(super) fn grow(
        &mut self,
        of: &MonteCarlo<'_, S>,
        control: &dyn Control,
    ) -> Result<GrowthEnd, Interrupted> {
        let end = self.grow_on(of, control)?;
        let is_scaling = self.stage == Stage::Scale && of.to_jamming.is_none();
        let is_short = may_go_on(end, is_scaling, of.keeps_partial);
        if let Some(keep) = of.keep_checkpoint.filter(|_| is_short && control.wants_last_checkpoint()) {
            keep(&|out: &mut dyn Write| self.write(out));
        }
        Ok(end)
    }

    fn grow_on(&mut self, of: &MonteCarlo<'_, S>, control: &dyn Control) -> Result<GrowthEnd, Interrupted> {
        loop {
            if self.stage == Stage::Scale && self.is_full_size() && of.to_jamming.is_none() {
                if of.maximize.is_none() {
                    return Ok(GrowthEnd::Target);
                }
                self.begin_gap();
            }
            if control.should_finish().is_some() {
                if self.stage == Stage::Gap {
                    self.measure_gap()?;
                }
                return Ok(GrowthEnd::Finished);
            }
            if let Some(end) = self.limit_reached(of) {
                if self.stage == Stage::Gap {
                    self.measure_gap()?;
                    self.report(of, control);
                }
                return Ok(end);
            }
            let by = self.tighten(of.to_jamming.is_some());
            if self.lists_are_due(by) {
                if let Some(keep) = of.keep_checkpoint.filter(|_| control.wants_checkpoint()) {
                    keep(&|out: &mut dyn Write| self.write(out));
                    if control.should_stop() {
                        return Err(Interrupted::Stopped);
                    }
                }
                self.build_lists()?;
            }
            if !self.cycle(of, by, control)? {
                return Err(Interrupted::Stopped);
            }
        }
    }

    fn is_full_size(&self) -> bool {
        self.system.frame.stretch <= 1.0 / BEYOND_TARGET
    }

    /// Goes over from growth by scale, done, to growth of the gap.
    fn begin_gap(&mut self) {
        self.stage = Stage::Gap;
        self.pushes = Pushes::Light;
        self.rate = MOST_RATE;
        self.listed_cycles = CYCLES_PER_LIST;
        self.mark = (0.0, self.counted.compression_cycles);
    }

    /// What the next cycle is to make tighter.
    fn tighten(&self, to_jamming: bool) -> Tighten {
        match self.stage {
            Stage::Scale if to_jamming => Tighten::Shrink(1.0 / (1.0 + self.rate)),
            Stage::Scale => {
                let target = 1.0 / BEYOND_TARGET / self.system.frame.stretch;
                // A trifle beyond, so that the last cycle reaches it.
                Tighten::Shrink((1.0 / (1.0 + self.rate)).max(target * (1.0 - 1e-14)).min(1.0 - 1e-14))
            }
            Stage::Gap => Tighten::Gap(self.rate * self.gap_unit()),
        }
    }

    /// The length whose share the gap grows by.
    fn gap_unit(&self) -> f64 {
        self.middle_mm
    }

    fn lists_are_due(&self, by: Tighten) -> bool {
        let (stretch, extra_gap) = match by {
            Tighten::Shrink(factor) => (self.system.frame.stretch * factor, self.system.frame.extra_gap),
            Tighten::Gap(by) => (self.system.frame.stretch, self.system.frame.extra_gap + by),
        };
        self.listed_cycles >= CYCLES_PER_LIST
            || stretch < self.listed_stretch
            || extra_gap > self.listed_extra_gap
            || self.system.skins_left > (MOST_HELD * self.system.len() as f64) as u64
    }

    fn build_lists(&mut self) -> Result<(), OutOfMemory> {
        let mut growth = (RATES_PER_LIST * self.rate).min(MOST_LISTED_GROWTH).max(2.0 * self.rate);
        let rate = self.rate;
        let held = self.system.cold.iter().filter(|cold| cold.list.left_skin()).count();
        let margins = reserved(self.margins.len() + held)?;
        let earlier = std::mem::replace(&mut self.margins, margins);
        let mut earlier = earlier.into_iter().peekable();
        for (site, (cold, hot)) in self.system.cold.iter_mut().zip(&self.system.hot).enumerate() {
            let margin =
                earlier.next_if(|earlier| earlier.0 as usize == site).map_or(1.0, |earlier| earlier.1);
            let margin = if cold.list.left_skin() {
                (margin * HELD_WIDER).min(MOST_MARGIN)
            } else {
                (margin * MARGIN_FALL).max(1.0)
            };
            if margin > 1.0 {
                self.margins.push((site as u32, margin));
            }
            cold.list.mark_left_skin(false);
            let radius = hot.d / 2.0;
            let (least, most) = ((SKIN_RATES * rate + LEAST_SKIN) * radius, MOST_SKIN * radius);
            cold.skin = margin * (SKIN_STEPS * cold.step).clamp(least, most);
        }
        let mut is_loose = false;
        loop {
            let (shrink, reserve) = match self.stage {
                Stage::Scale => (1.0 + growth, 0.0),
                Stage::Gap => (1.0, growth * self.gap_unit()),
            };
            Lists::default().build(&mut self.system, shrink, reserve)?;
            self.listed_stretch = self.system.frame.stretch / shrink;
            self.listed_extra_gap = self.system.frame.extra_gap + reserve;
            self.listed_cycles = 0;
            self.system.skins_left = 0;
            self.counted.list_rebuilds += 1;
            if self.stage == Stage::Scale {
                return Ok(());
            }
            self.kept = self.system.part().kept_gap(self.listed_extra_gap);
            let is_known = self.kept < self.listed_extra_gap;
            is_loose |= !is_known;
            if is_loose {
                // Few grains in much space keep a gap that growth would take long to reach.
                self.system.widen_gaps(self.kept - self.system.frame.extra_gap);
            }
            if is_known {
                return Ok(());
            }
            growth *= 2.0;
        }
    }

    /// Measures the gap that the grains keep, and notes it as the last of the growth curve.
    fn measure_gap(&mut self) -> Result<(), OutOfMemory> {
        self.kept = self.system.part().kept_gap(self.listed_extra_gap);
        // The lists are those of growth to the size, or the grains are farther apart than they tell.
        if self.kept >= self.listed_extra_gap {
            self.build_lists()?;
        }
        if let Some(last) = self.curve.last_mut() {
            last.distance_mm = Some(self.kept);
        }
        Ok(())
    }

    /// One cycle; says whether to go on.
    fn cycle(
        &mut self,
        of: &MonteCarlo<'_, S>,
        by: Tighten,
        control: &dyn Control,
    ) -> Result<bool, OutOfMemory> {
        self.counted.compression_cycles += 1;
        self.listed_cycles += 1;
        let mut rng = cycle_stream(of.seed, self.counted.compression_cycles);
        if of.swap {
            // A gradient is one of the whole specimen.
            let everywhere = of.preference.is_some()
                || self.counted.compression_cycles.is_multiple_of(CYCLES_PER_SWAPS_EVERYWHERE);
            let Self { swaps, families, system, .. } = self;
            let grains = swap::SwapGrains { families, preference: of.preference };
            swap::sweep(swaps, &grains, system, (SWAPS_PER_GRAIN, everywhere), &mut rng)?;
        }
        if control.should_stop() {
            return Ok(false);
        }
        for _ in 0..SWEEPS_PER_CYCLE.max(LEAST_MOVES / self.system.len().max(1) as u64) {
            let moves = shake::sweep(&mut self.system, &mut rng);
            self.counted.moves_tried += moves.tried;
            self.counted.moves_accepted += moves.accepted;
            self.counted.sweeps += 1;
            if control.should_stop() {
                return Ok(false);
            }
            // What the grains have now is valid: the cycle need not go on to end.
            if control.should_finish().is_some() {
                return Ok(true);
            }
        }
        self.compress(by)?;
        if self.stage == Stage::Gap {
            self.kept = self.system.part().kept_gap(self.listed_extra_gap);
        }
        self.note_point(of);
        self.report(of, control);
        Ok(!control.should_stop())
    }

    /// Makes the packing tighter, as far as it goes, and sets the rate of the next cycle.
    fn compress(&mut self, by: Tighten) -> Result<(), OutOfMemory> {
        let (stretch, extra_gap) = (self.system.frame.stretch, self.system.frame.extra_gap);
        // It has the poses to go back to, and is given back before the next cycle needs memory for other things.
        let mut pusher = Pusher::default();
        let is_fast = self.rate >= FAST_RATE;
        let pushed =
            pusher.push(&mut self.system, by, self.pushes.strength::<S>(is_fast, self.is_wide), is_fast)?;
        self.counted.pushes += pushed.pushes;
        if pushed.is_clear {
            self.rate *= if pushed.sweeps < EASY_SWEEPS { EASY } else { CLEAR };
        } else if pusher.keep_what_is_valid(&mut self.system, by) {
            let kept = match by {
                Tighten::Shrink(factor) => (stretch - self.system.frame.stretch) / (stretch * (1.0 - factor)),
                Tighten::Gap(by) => (self.system.frame.extra_gap - extra_gap) / by,
            };
            if kept > MOST_KEPT.0 {
                self.rate *= MOST_KEPT.1;
            } else if kept < LITTLE_KEPT.0 {
                self.rate *= LITTLE_KEPT.1;
            }
        } else {
            pusher.undo(&mut self.system);
            self.rate *= NOTHING_KEPT;
        }
        self.system.moved = Vec::new();
        self.rate = self.rate.clamp(LEAST_RATE, MOST_RATE);
        Ok(())
    }

    fn elapsed_s(&self) -> f64 {
        self.earlier_s + self.started.elapsed().as_secs_f64()
    }

    /// What grows, as a length or a factor.
    fn size(&self) -> f64 {
        match self.stage {
            Stage::Scale => 1.0 / self.system.frame.stretch,
            Stage::Gap => self.system.frame.extra_gap,
        }
    }

    /// Gives back what growth needs and the result, which takes memory of its own, does not.
    pub(super) fn forget_lists(&mut self) {
        self.system.groups = Vec::new();
        self.system.halves.forget();
    }

    /// The shapes by rank.
    pub(super) fn shapes(&self) -> Result<Vec<S>, OutOfMemory> {
        let mut shapes = collected(self.system.cold.iter().map(|cold| cold.shape))?;
        for (cold, &rank) in self.system.cold.iter().zip(&self.system.rank) {
            shapes[rank as usize] = cold.shape;
        }
        Ok(shapes)
    }

    /// The result.
    pub(super) fn outcome(
        mut self,
        of: &MonteCarlo<'_, S>,
        end: GrowthEnd,
    ) -> Result<Outcome<Vec<Pose>>, Interrupted> {
        self.system.wrap();
        let mut poses = filled(self.system.len(), Pose::at(nalgebra::Vector3::zeros()))?;
        let bounds = of.domain.bounds_mm;
        for ((hot, cold), &rank) in self.system.hot.iter().zip(&self.system.cold).zip(&self.system.rank) {
            let mut center = hot.center.each(|x| x / self.system.frame.stretch);
            if of.domain.is_periodic() {
                for (x, length) in center.iter_mut().zip(bounds) {
                    *x = if *x < length { *x } else { 0.0 };
                }
            }
            let [w, i, j, k] = cold.shape.of_principal(cold.orientation);
            let orientation = nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, i, j, k));
            poses[rank as usize] = Pose { center_mm: center.into(), orientation };
        }
        let scale = match of.to_jamming {
            Some(_) => self.size(),
            None if self.is_full_size() => 1.0,
            None => (1.0 / self.system.frame.stretch).min(1.0 - f64::EPSILON),
        };
        Ok(Outcome {
            placed: poses,
            end,
            scale,
            distance_mm: self.gap_mm(of),
            volume_fraction: self.volume_fraction(of),
            statistics: Statistics {
                rsa: Some(self.rsa),
                monte_carlo: Some(MonteCarloStatistics { growth_scale: scale, stop: end, ..self.counted() }),
                ..Statistics::default()
            },
            growth_s: self.elapsed_s() - self.rsa_s,
            rsa_s: self.rsa_s,
            growth_curve: self.curve.into_points(),
        })
    }
}
