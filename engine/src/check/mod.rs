//! The independent check of a finished packing: all pairs, all walls, the grading.
//!
//! For grains `i` and `j` with centres `x` and diameters `d` it requires
//! `|x_i - x_j| >= (d_i + d_j) / 2 + g(d_i, d_j)`, in a periodic box for the nearest images, and for every wall at
//! distance `w` of a centre `w >= d / 2 + g_wall(d)`, without tolerance. The required gaps `g` (`required`), the walls,
//! the neighbour table (`table`) and the classes of the grading (`grading`) are the module's own, and it imports
//! nothing of the packing methods, their distance rule or their specimen geometry; `tests/layers.rs` holds that. A
//! packing that fails here is never returned. Costs O(N).
//!
//! Of bodies that are not spheres, the check requires that their surfaces keep the gap of the diameters of equal
//! volume. Every pair that passes is proven by a direction `n` with `s(n) >= g` (`separation`), which
//! [`certify_shapes`] returns for anyone to evaluate again. Sieve sizes of polyhedra are proven ([`SieveSizes`]).
//!
//! ```
//! use packstone_engine::{PackingRequest, Spheres, check::check};
//! use serde_json::json;
//!
//! let request = json!({
//!     "specimen": {"type": "box", "size_mm": [20, 20, 20]},
//!     "mix": {"grading": {"type": "diameters", "diameters_mm": [6, 4]}},
//!     "distance": {"type": "constant", "gap_mm": 1},
//! });
//! let request = PackingRequest::from_json(&request, 1).unwrap();
//! let mut spheres = Spheres::default();
//! spheres.push([5.0, 10.0, 10.0], 6.0);
//! spheres.push([12.5, 10.0, 10.0], 4.0);
//! assert_eq!(check(&spheres, &request).unwrap().found.min_gap_mm, Some(2.5));
//! spheres.x_mm[1] = 10.5;
//! assert!(check(&spheres, &request).is_err());
//! ```

// Forced inlining carries the instruction set of the loop over pairs to what it calls ([`crate::cpu`]).
#![allow(clippy::inline_always)]

mod asked;
mod body;
mod convex;
mod counted;
mod double_double;
mod grading;
mod law;
mod packing;
mod region;
mod required;
mod separation;
mod sieve;
mod solids;
mod spheres;
mod table;
mod walk;
mod walls;

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

use crate::control::{Control, Progress, Step};
use crate::memory::OutOfMemory;
use crate::packing::{AggregateReport, CheckReport, ClassReport, GrainsRef};
use crate::request::PackingRequest;
use crate::shape::Polyhedron;

pub use convex::Body;
pub use packing::check_bodies;
pub use region::Region;
pub use separation::{Direction, Image, Verdict};
pub use solids::{certify, certify_shapes, check_shapes};
pub use spheres::check;

/// Which conditions of a packing are checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All of them.
    All,
    /// All but the gaps between grains: numbers, walls and grading. The time is proportional to the grains and far
    /// below that of [`Scope::All`]; the smallest gaps of the report stay unknown.
    WithoutPairs,
}

/// What a packing has of the grains that its mix asks for: all of them at their sizes, unless its run was ended early
/// or its volume fraction was to be as large as possible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// The factor on the sizes of all grains.
    pub size_scale: f64,
    /// Whether all grains are placed; if not, the finest are missing.
    pub has_all_grains: bool,
}

impl Extent {
    /// All grains at their sizes.
    pub const WHOLE: Self = Self { size_scale: 1.0, has_all_grains: true };
}

/// Largest relative difference of two sieve sizes of a template: that which was found for it, and the proven one.
const SIEVE_ERROR: f64 = 1.0e-9;
/// Most sieve sizes that are kept; each takes some kilobytes.
const MOST_SIEVE_SIZES: usize = 4096;

/// The sieve sizes of templates that the check has proven by its own search, for further checks: a search takes about a
/// millisecond. Whoever checks several packings owns one and hands it in.
#[derive(Debug, Default)]
pub struct SieveSizes {
    /// By the numbers that describe a template.
    proven: Mutex<BTreeMap<Vec<u64>, f64>>,
}

impl SieveSizes {
    /// The sieve size of a template, in its units, once it is proven that the template passes no smaller square, and
    /// that it passes a square of this size whose directions the template states
    /// ([`Polyhedron::sieve_passage`]). The latter is computed each time.
    ///
    /// # Errors
    /// [`Fault::SieveSize`] where the two differ by a share of more than 1e-9.
    pub fn proven(&self, template: &Polyhedron) -> Result<f64, Fault> {
        let key = key_of(template);
        let known = self.proven.lock().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        let proven = known.unwrap_or_else(|| {
            let size = sieve::sieve_size(template);
            let mut proven = self.proven.lock().unwrap_or_else(PoisonError::into_inner);
            if proven.len() >= MOST_SIEVE_SIZES {
                proven.clear();
            }
            proven.insert(key, size);
            size
        });
        let found = template.sieve_passage();
        let agrees = (found.size - proven).abs() <= SIEVE_ERROR * proven;
        if agrees && sieve::passes(template, found.size, &found.sides, SIEVE_ERROR) {
            Ok(proven)
        } else {
            Err(Fault::SieveSize { found: found.size, proven })
        }
    }

    /// Number of sizes that are kept.
    #[must_use]
    pub fn len(&self) -> usize {
        self.proven.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Whether none is kept.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The numbers that describe a template.
fn key_of(template: &Polyhedron) -> Vec<u64> {
    let vertices = template.vertices().iter().flat_map(|vertex| [vertex.x, vertex.y, vertex.z]);
    let faces = template.faces().iter().flat_map(|face| {
        std::iter::once(face.len() as u64).chain(face.iter().map(|&vertex| u64::from(vertex)))
    });
    let numbers = std::iter::once(template.rounding()).chain(vertices).map(f64::to_bits);
    numbers.chain(faces).collect()
}

/// The smallest gaps of a packing, with the grains that have them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gaps {
    /// Smallest clear distance between two grains; `None` where there is one grain only.
    pub min_gap_mm: Option<f64>,
    /// The rows of these grains; twice the same where a grain is nearest to its own periodic image.
    pub closest: Option<[usize; 2]>,
    /// Smallest excess of a pair's clear distance over what its rule demands.
    pub min_excess_gap_mm: Option<f64>,
    /// Smallest clear distance from a grain to a wall; `None` in a periodic box.
    pub min_wall_gap_mm: Option<f64>,
    /// The row of that grain.
    pub closest_to_wall: Option<usize>,
    /// Pairs whose distance was computed.
    pub pairs_checked: u64,
}

/// What was found in a packing whose grains are bodies, keep their gaps and lie in the specimen.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// The smallest gaps.
    pub gaps: Gaps,
    /// What a check says whose grains are those of the mix, or why they are not.
    pub grading: Result<Check, Fault>,
}

/// Checks a packing as [`check_grains`] does, and tells of its gaps whether or not the grains are those of the mix.
///
/// # Errors
/// The first fault found but for [`Fault::Grading`], or [`Fault::Stopped`].
pub fn inspect<'a>(
    grains: impl Into<GrainsRef<'a>>,
    request: &PackingRequest,
    extent: Extent,
    sieve_sizes: &SieveSizes,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Inspection, Fault> {
    let walk = &walk::Walk { threads, control };
    judge(grains.into(), (request, extent), Scope::All, sieve_sizes, walk)
}

fn judge(
    grains: GrainsRef<'_>,
    (request, extent): (&PackingRequest, Extent),
    scope: Scope,
    sieve_sizes: &SieveSizes,
    walk: &walk::Walk<'_>,
) -> Result<Inspection, Fault> {
    match grains {
        GrainsRef::Spheres(spheres) => spheres::judge(spheres, request, extent, scope, walk),
        GrainsRef::Solids(solids) => solids::judge(solids, (request, extent), scope, sieve_sizes, walk),
    }
}

/// Checks a packing of any kind of grains against its request, on several threads, with the sieve sizes of templates
/// that earlier checks have proven. What is found does not depend on these or the threads. Gaps are checked at the
/// sizes that the grains have; that these are those of the mix, by its extent.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_grains<'a>(
    grains: impl Into<GrainsRef<'a>>,
    request: &PackingRequest,
    extent: Extent,
    scope: Scope,
    sieve_sizes: &SieveSizes,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let walk = &walk::Walk { threads, control };
    judge(grains.into(), (request, extent), scope, sieve_sizes, walk)?.grading
}

/// What a check found in a valid packing.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Extremes of distances and grading.
    pub found: CheckReport,
    /// Sieve classes, from fine to coarse.
    pub classes: Vec<ClassReport>,
    /// The aggregates of the mix; none where it names none.
    pub aggregates: Vec<AggregateReport>,
}

/// A length in mm with all of its digits, the shorter of the two ways to write it.
fn length(mm: f64) -> String {
    if mm != 0.0 && mm.abs() < 1e-3 { format!("{mm:e}") } else { mm.to_string() }
}

/// Why a packing is not valid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A column has a length of its own.
    #[error("columns differ in length")]
    Columns,
    /// A coordinate or a diameter is no number, or a diameter is not positive.
    #[error("grain {grain} has a coordinate that is no number, or no positive diameter")]
    NotANumber {
        /// Row of the grain.
        grain: usize,
    },
    /// The semi-axes, the position and the quaternion of a grain describe no body.
    #[error("the dimensions, the position or the orientation of grain {grain} describe no body")]
    NotABody {
        /// Row of the grain.
        grain: usize,
    },
    /// The sieve size of a template is not what was found for it.
    #[error(
        "its least square opening was found to be {found} times its diameter of equal volume, and proven to be {proven}"
    )]
    SieveSize {
        /// The size that was found, in units of the template.
        found: f64,
        /// The proven one.
        proven: f64,
    },
    /// Two grains are too close.
    #[error(
        "grains {first} and {second} are {} mm apart: their rule asks for {required_mm} mm",
        length(.clearance_mm + 0.0)
    )]
    Pair {
        /// Row of one grain.
        first: usize,
        /// Row of the other, or the same where it meets its own periodic image.
        second: usize,
        /// Gap found.
        clearance_mm: f64,
        /// Gap that the rule demands.
        required_mm: f64,
    },
    /// A grain is too close to a wall, or beyond it.
    #[error(
        "grain {grain} is {} mm from a wall: its rule asks for {required_mm} mm",
        length(.clearance_mm + 0.0)
    )]
    Wall {
        /// Row of the grain.
        grain: usize,
        /// Gap found.
        clearance_mm: f64,
        /// Gap that the rule demands.
        required_mm: f64,
    },
    /// The control asked to stop; nothing is said of the packing.
    #[error("the check was stopped on request")]
    Stopped,
    /// The system refused memory that the check needs; nothing is said of the packing.
    #[error("out of memory: the check needs {} MB more", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// The grains are not those of the mix.
    #[error("the grains are not those of the mix: {0}")]
    Grading(String),
}

impl From<OutOfMemory> for Fault {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// A direction that shows how far apart two grains lie, or a grain and a wall.
///
/// With the centres `x`, the support functions `h` and `r = x_second + image * period - x_first`, the distance of the
/// grains is at least `s(n) = (r . n) / |n| - h_first(n / |n|) - h_second(-n / |n|)`. Of a wall, `n` leads to where it
/// is nearest, and `s(n)` is the distance of the wall along `n`, `h_first(n)` off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeparationCertificate {
    /// Row of one grain.
    pub first: usize,
    /// Row of the other, or the same where it meets its own periodic image; `None` of a wall.
    pub second: Option<usize>,
    /// Periods by which the second grain is moved.
    pub image: [i32; 3],
    /// The direction `n` from the first grain to the second; its length is 1 within rounding.
    pub normal: [f64; 3],
    /// `s(n)` in mm, the gap of the pair within rounding.
    pub separation_mm: f64,
    /// Gap that the rule demands, in mm.
    pub required_mm: f64,
}

/// What all pairs together have shown.
#[derive(Debug, Default)]
struct Pairs {
    min_gap_mm: Option<f64>,
    closest: Option<[usize; 2]>,
    min_excess_gap_mm: Option<f64>,
    checked: u64,
}

impl Gaps {
    /// Of the smallest gap to a wall with its grain, and the pairs.
    fn new(wall: Option<(f64, usize)>, pairs: &Pairs) -> Self {
        Self {
            min_gap_mm: pairs.min_gap_mm,
            closest: pairs.closest,
            min_excess_gap_mm: pairs.min_excess_gap_mm,
            min_wall_gap_mm: wall.map(|(gap, _)| gap),
            closest_to_wall: wall.map(|(_, grain)| grain),
            pairs_checked: pairs.checked,
        }
    }
}

impl Inspection {
    /// Of the smallest gap to a wall with its grain, the pairs, and what was found of the grading.
    fn new(wall: Option<(f64, usize)>, pairs: &Pairs, graded: Result<grading::Graded, String>) -> Self {
        let gaps = Gaps::new(wall, pairs);
        let check = |graded: grading::Graded| Check {
            found: CheckReport {
                min_gap_mm: gaps.min_gap_mm,
                min_wall_gap_mm: gaps.min_wall_gap_mm,
                min_excess_gap_mm: gaps.min_excess_gap_mm,
                max_class_mass_error: graded.max_class_mass_error,
                pairs_checked: gaps.pairs_checked,
            },
            classes: graded.classes,
            aggregates: graded.aggregates,
        };
        Self { gaps, grading: graded.map(check).map_err(Fault::Grading) }
    }
}

fn report(control: &dyn Control, done: usize, total: usize) {
    let message = "checking every pair, the walls and the grading";
    control.report(&Progress::counted(Step::Check, done, total, "grains", message));
}

#[cfg(test)]
mod tests;
