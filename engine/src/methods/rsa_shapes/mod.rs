//! Random sequential addition of ellipsoids and polyhedra: each, from the largest to the smallest, gets the first pose
//! drawn at random that keeps its gaps to all grains inserted before and to the walls.
//!
//! An attempt of the textbook algorithm draws a uniform centre from the specimen and an orientation. No centre is
//! possible that is nearer to a wall than the inner radius and the wall gap, and most others lie in or near a grain.
//! For an inserted grain that holds an ellipsoid with the semi-axes `a, b, c` and a new one of the inner radius `r_in`,
//! no centre in the ellipsoid with the semi-axes `a + t, b + t, c + t`, `t = r_in + g`, is possible for any
//! orientation: that ellipsoid lies inside the body parallel to the grain at the distance `t` ([`crate::gap`]). Voxels
//! that one such ellipsoid covers are therefore dropped, and centres are drawn from the voxels that are left. Attempts
//! that would have fallen elsewhere are counted by a geometric number of the same law, so that the outcome has the
//! distribution of the textbook algorithm. Where no voxel is left, saturation is proven.
//!
//! With a gradient ([`crate::segregation`]) a grain does not get the first pose but one of several that are possible,
//! by the weights of their centres.
//!
//! `grid` has the inserted grains by cell, `voxels` what is left for centres. A stage is a range of grains of similar
//! size, for which both are built.

#![allow(clippy::inline_always)]

mod grid;
mod search;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
mod voxels;

use std::num::NonZeroUsize;

use nalgebra::UnitQuaternion;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::arrays;
use crate::control::Control;
use crate::distance::DistanceRule;
use crate::domain::Domain;
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{dot, minus};
use crate::gap::walls::wall_gap_mm;
use crate::memory::{OutOfMemory, collected, reserved};
use crate::methods::addition::{self, Attempts, End, Outcome};
use crate::packing::RsaStatistics;
use crate::segregation::Preference;
use crate::shape::Pose;
use grid::{Grid, Inserted, Placed};
pub use search::AttemptsIn;
use search::Search;
use voxels::Voxels;

/// Draws between two looks at the control: less than a millisecond.
pub(crate) const DRAWS_PER_LOOK: u64 = 2000;
/// Grains of a stage differ by less than this factor in equivalent diameter, and by less than the other where the last
/// stage took few draws per grain.
const STAGE_RATIO: f64 = 1.1;
const LOOSE_RATIO: f64 = 1.4;
const LOOSE: u64 = 20;
/// A stage ends when it has inserted as many grains as there were, but not before this number.
const LEAST_STAGE: usize = 400;
/// Draws per grain of a stage beyond which the next one begins with smaller voxels, and the levels of subdivision.
const CROWDED: u64 = 50;
/// The same of polyhedra, most of whose draws fail in voxels of any size.
const CROWDED_ANGULAR: u64 = 1000;
const LOOSE_LEVEL: usize = 0;
const MIDDLE_LEVEL: usize = 1;
const CROWDED_LEVEL: usize = 2;
/// Failed draws after which voxels are split where a draw fails.
const SPLIT_AFTER: u64 = 200;
/// Most draws for one grain where the number of attempts is not limited: what voxels cannot prove must end somewhere.
pub(crate) const MOST_DRAWS: u64 = 20_000_000;
/// The same where a method follows that does not depend on chance. It is half a second; a grain that needs more is
/// near saturation, and the grains after it need more still.
pub(crate) const MOST_DRAWS_BEFORE_GROWTH: u64 = 100_000;
/// Voxels beyond which none is split any more: 128 MiB of them. So many prove nothing within all draws.
const MOST_VOXELS: usize = 1 << 23;
/// Share of the lengths of a pair, and of the specimen, by which gaps are longer than requested, so that the check,
/// which rounds differently, never sees a violation in the last digit.
const ROUNDING_MARGIN: f64 = 1e-13;

/// Draws an orientation.
pub type Orientation<'a> = dyn Fn(&mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> + 'a;

/// What random sequential addition is asked for.
pub struct ShapeRsa<'a, S> {
    /// Grains by equivalent diameter from the largest down.
    pub shapes: &'a [S],
    /// Where they go.
    pub domain: Domain,
    /// The gaps they keep.
    pub rule: DistanceRule,
    /// Attempts per grain; `None` goes on until saturation is proven, or to `MOST_DRAWS` draws.
    pub attempts_per_grain: Option<u64>,
    /// Where the centre of an attempt lies.
    pub attempts_in: AttemptsIn,
    /// Draws orientations; [`crate::mix::uniform_orientation`] where none is preferred.
    pub orientation: &'a Orientation<'a>,
    /// Most threads; the outcome does not depend on their number.
    pub threads: NonZeroUsize,
}

/// What one draw has found.
type Found<T> = addition::Found<(Pose, Placed<T>)>;

struct Run<'a, S: ConvexShape> {
    rsa: &'a ShapeRsa<'a, S>,
    scale: Option<f64>,
    preference: Option<&'a Preference>,
    most_draws: u64,
    control: &'a dyn Control,
    inserted: Vec<Inserted<S::Turned>>,
    /// Orientations of the grains that are inserted.
    orientations: Vec<UnitQuaternion<f64>>,
    statistics: RsaStatistics,
    draws: u64,
    /// Draws for further poses beside the first of a grain.
    further_draws: u64,
    /// Draws per grain of the last stage.
    draws_per_grain: u64,
}

/// What the grains of a stage have in common; lengths in mm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Equivalent diameters of the largest and the smallest grain.
    diameters: [f64; 2],
    /// Longest of the radii of the spheres around the grains, and shortest of those inside.
    outer: f64,
    inner: f64,
}

impl<S: ConvexShape> ShapeRsa<'_, S> {
    /// Inserts the grains.
    pub fn run(&self, rng: &mut Xoshiro256PlusPlus, control: &dyn Control) -> Outcome<Pose> {
        self.run_with(None, None, MOST_DRAWS, rng, control)
    }

    /// Inserts the grains, all scaled by a factor; of several poses that are possible each prefers one. At most so many
    /// draws are made for a grain where the number of attempts is not limited.
    pub(crate) fn run_with(
        &self,
        scale: Option<f64>,
        preference: Option<&Preference>,
        most_draws: u64,
        rng: &mut Xoshiro256PlusPlus,
        control: &dyn Control,
    ) -> Outcome<Pose> {
        let count = self.shapes.len();
        let room = reserved(count).and_then(|inserted| Ok((inserted, reserved(count)?)));
        let (inserted, orientations) = match room {
            Ok(both) => both,
            Err(refused) => return Outcome::new(Err(refused), RsaStatistics::default(), End::Stopped),
        };
        let mut run = Run {
            rsa: self,
            scale,
            preference,
            most_draws,
            control,
            inserted,
            orientations,
            statistics: RsaStatistics::default(),
            draws: 0,
            further_draws: 0,
            draws_per_grain: 0,
        };
        let end = run.insert_all(rng);
        run.report();
        Outcome::new(run.poses(), run.statistics, end)
    }
}

impl<S: ConvexShape> Run<'_, S> {
    /// The shape of a grain. Where all are scaled, it is made again each time: kept, the shapes would be there twice.
    #[inline]
    fn shape(&self, grain: usize) -> S {
        let shape = self.rsa.shapes[grain];
        // Shapes that nothing is left of are none of a mix.
        self.scale.and_then(|scale| shape.scaled(scale)).unwrap_or(shape)
    }

    /// The poses of the grains that are inserted.
    fn poses(&self) -> Result<Vec<Pose>, OutOfMemory> {
        let both = self.inserted.iter().zip(&self.orientations);
        collected(
            both.map(|(inserted, &orientation)| Pose {
                center_mm: inserted.body.center_mm.into(),
                orientation,
            }),
        )
    }

    /// The stage that begins with a grain, and the first grain after it.
    fn stage(&self, first: usize) -> (Stage, usize) {
        let d = |grain: usize| self.shape(grain).equivalent_diameter_mm();
        let most = first + first.max(LEAST_STAGE);
        let ratio = if self.draws_per_grain < LOOSE { LOOSE_RATIO } else { STAGE_RATIO };
        let mut end = first + 1;
        while end < self.rsa.shapes.len().min(most) && d(end) * ratio > d(first) {
            end += 1;
        }
        let shapes = || (first..end).map(|grain| self.shape(grain));
        let stage = Stage {
            diameters: [d(first), d(end - 1)],
            outer: shapes().map(|shape| shape.outer_mm()).fold(0.0, f64::max),
            inner: shapes().map(|shape| shape.inner_mm()).fold(f64::INFINITY, f64::min),
        };
        (stage, end)
    }

    fn insert_all(&mut self, rng: &mut Xoshiro256PlusPlus) -> End {
        let mut first = 0;
        while first < self.rsa.shapes.len() {
            let (stage, end) = self.stage(first);
            match self.insert_stage(&stage, first..end, rng) {
                Ok(()) => first = end,
                Err(end) => return end,
            }
        }
        End::Complete
    }

    fn insert_stage(
        &mut self,
        stage: &Stage,
        grains: std::ops::Range<usize>,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<(), End> {
        let rsa = self.rsa;
        let least = stage.inner + rsa.rule.wall_gap_mm(stage.diameters[1]);
        let no_place = End::InsertionFailed { saturation_proven: true, attempts: 0 };
        let domain = rsa.domain;
        let Some(region) = domain.center_region(least) else { return Err(no_place) };
        let shortest_mm = domain.periods_mm.into_iter().flatten().fold(f64::INFINITY, f64::min);
        for grain in 0..self.inserted.len() {
            let (shape, orientation) = (self.shape(grain), self.orientations[grain]);
            self.inserted[grain].cover(stage, &rsa.rule, &shape, orientation);
        }
        let mut grid = Grid::new(&domain, stage, &rsa.rule, &self.inserted, grains.end)?;
        let factor = if S::Turned::IS_ELLIPSOID { 1 } else { CROWDED_ANGULAR / CROWDED };
        let level = match self.draws_per_grain / factor {
            ..LOOSE => LOOSE_LEVEL,
            LOOSE..CROWDED => MIDDLE_LEVEL,
            _ => CROWDED_LEVEL,
        };
        let tested = (rsa.threads, &mut self.statistics.voxels_tested);
        let mut voxels = Voxels::new(&region, level, &grid, &self.inserted, tested)?;
        let (count, draws_before) = (grains.len() as u64, self.draws - self.further_draws);
        for grain in grains {
            let shape = self.shape(grain);
            let d_mm = shape.equivalent_diameter_mm();
            let wall_gap_mm = rsa.rule.wall_gap_mm(d_mm);
            let own = domain.center_region(shape.inner_mm() + wall_gap_mm);
            let own = own.ok_or(no_place)?;
            // The spheres in a grain and in its nearest image come closer than their gap in every orientation.
            let own_gap_mm = rsa.rule.gap_mm(d_mm, d_mm);
            if (2.0 * shape.inner_mm() + own_gap_mm) * (1.0 - ROUNDING_MARGIN) > shortest_mm {
                return Err(no_place);
            }
            let mut search = Search {
                grain,
                shape,
                d_mm,
                wall_gap_mm: wall_gap_mm + ROUNDING_MARGIN * domain.bounds_mm.iter().sum::<f64>(),
                domain,
                region: own,
                attempts_mm3: match rsa.attempts_in {
                    AttemptsIn::Specimen => domain.volume_mm3,
                    AttemptsIn::Reach => own.volume_mm3(),
                },
                attempts: Attempts::new(rsa.attempts_per_grain, self.most_draws),
                failed: 0,
            };
            let found = loop {
                match (self.try_once(&mut search, &mut voxels, &grid, rng)?, self.preference) {
                    (Found::NotYet, _) => {}
                    (Found::Place(first), Some(preference)) => {
                        break self.choose(first, preference, &mut search, &mut voxels, &grid, rng)?;
                    }
                    (found, _) => break found,
                }
            };
            self.statistics.grains_by_subdivision += u64::from(search.failed > SPLIT_AFTER);
            self.statistics.attempts += search.attempts.number;
            match found {
                Found::Place((pose, body)) => {
                    let mut inserted = Inserted::new(body, d_mm);
                    inserted.cover(stage, &rsa.rule, &shape, pose.orientation);
                    grid.insert(self.inserted.len(), &inserted, stage, &rsa.rule)?;
                    self.inserted.push(inserted);
                    self.orientations.push(pose.orientation);
                }
                Found::Nothing { saturation_proven } => {
                    return Err(End::InsertionFailed { saturation_proven, attempts: search.attempts.number });
                }
                Found::Stopped | Found::NotYet => return Err(End::Stopped),
            }
        }
        self.draws_per_grain = (self.draws - self.further_draws - draws_before) / count;
        Ok(())
    }

    /// Chooses among several poses for a grain by the weights of their centres.
    fn choose(
        &mut self,
        first: (Pose, Placed<S::Turned>),
        preference: &Preference,
        search: &mut Search<S>,
        voxels: &mut Voxels,
        grid: &Grid,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<Found<S::Turned>, OutOfMemory> {
        // Only what was needed for the first pose says that poses are rare.
        let (grain, failed, draws_before) = (search.grain, search.failed, self.draws);
        let log_weight = |(pose, _): &(Pose, _)| preference.log_weight_at(grain, pose.center_mm.into());
        let found = addition::choose(first, log_weight, rng, |rng| self.try_once(search, voxels, grid, rng))?;
        search.failed = failed;
        self.further_draws += self.draws - draws_before;
        Ok(found)
    }

    #[inline(always)]
    fn try_once(
        &mut self,
        search: &mut Search<S>,
        voxels: &mut Voxels,
        grid: &Grid,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<Found<S::Turned>, OutOfMemory> {
        self.draws += 1;
        if self.draws.is_multiple_of(DRAWS_PER_LOOK) {
            self.report();
            if self.control.should_stop() {
                return Ok(Found::Stopped);
            }
        }
        let Some(draw) = voxels.draw(grid, rng) else {
            return Ok(Found::Nothing { saturation_proven: true });
        };
        let point = draw.point_in(&search.region);
        let inside = search.region.contains(point);
        if search.count(voxels.volume_mm3(), rng) {
            return Ok(Found::Nothing { saturation_proven: false });
        }
        let blocked_by = if inside {
            match self.pose(search, point, draw.cell, grid, rng) {
                Ok(place) => return Ok(Found::Place(place)),
                Err(blocked_by) => blocked_by,
            }
        } else {
            None
        };
        search.failed += 1;
        let dropped = blocked_by
            .is_some_and(|(grain, shift)| voxels.drop_if_covered(&draw, &self.inserted[grain], shift));
        if !dropped && search.failed > SPLIT_AFTER && voxels.len() < MOST_VOXELS {
            voxels.split(&draw, grid, &self.inserted, &mut self.statistics.voxels_tested)?;
        }
        Ok(Found::NotYet)
    }

    /// The pose at a point with an orientation drawn for it, if all gaps are kept; else the grain whose exclusion
    /// ellipsoid holds the point, with the offset of its image, if it was one.
    #[inline(always)]
    #[allow(clippy::type_complexity)]
    fn pose(
        &self,
        search: &Search<S>,
        point: [f64; 3],
        cell: usize,
        grid: &Grid,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<(Pose, Placed<S::Turned>), Option<(usize, [f64; 3])>> {
        let rsa = self.rsa;
        // What excludes the point for any orientation.
        if let Some(blocking) = grid.covering(cell, point, &self.inserted) {
            return Err(Some(blocking));
        }
        let orientation = (rsa.orientation)(rng);
        let pose = Pose { center_mm: point.into(), orientation };
        let body = Placed::new(&search.shape, &pose);
        // The region keeps a sphere from the walls, also where it has one place only.
        let is_sphere = search.shape.inner_mm() == search.shape.outer_mm();
        if !is_sphere && wall_gap_mm(body.center_mm, &body.turned, &search.domain) < search.wall_gap_mm {
            return Err(None);
        }
        let blocked = grid.any_near(cell, |grain, shift| {
            let other = &self.inserted[grain];
            let margin_mm = ROUNDING_MARGIN * (body.outer_mm + other.body.outer_mm);
            let gap_mm = rsa.rule.gap_mm(search.d_mm, other.d_mm) + margin_mm;
            let center: [f64; 3] = arrays::from_fn(|a| other.body.center_mm[a] + shift[a]);
            let r = minus(center, body.center_mm);
            let far = body.outer_mm + other.body.outer_mm + gap_mm;
            dot(r, r) < far * far && !body.keeps(&other.body, r, gap_mm)
        });
        let own_gap_mm =
            rsa.rule.gap_mm(search.d_mm, search.d_mm) + ROUNDING_MARGIN * 2.0 * search.shape.outer_mm();
        let blocked = blocked || grid.meets_own_image(&body, own_gap_mm);
        if blocked { Err(None) } else { Ok((pose, body)) }
    }

    fn report(&self) {
        addition::report(self.control, self.inserted.len(), self.rsa.shapes.len(), |rank| {
            self.shape(rank).equivalent_diameter_mm()
        });
    }
}
