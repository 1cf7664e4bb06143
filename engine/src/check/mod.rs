//! The independent check of a finished packing: all pairs, all walls, the grading.
//!
//! For grains `i` and `j` with centres `x` and diameters `d` it requires
//! `|x_i - x_j| >= (d_i + d_j) / 2 + g(d_i, d_j)`, in a periodic box for the nearest images, and for every wall at
//! distance `w` of a centre `w >= d / 2 + g_wall(d)`, without tolerance. The required gaps `g` (`required`), the walls,
//! the neighbour table (`table`) and the classes of the grading (`grading`) are the module's own, and it imports
//! nothing of the packing methods, their distance rule or their specimen geometry; `tests/layers.rs` holds that. A
//! packing that fails here is never returned. Costs O(N).
//!
//! Of bodies that are not spheres, [`check_solids`] requires that their surfaces keep the gap of the diameters of equal
//! volume. Every pair that passes is proven by a direction `n` with `s(n) >= g` (`separation`), which
//! [`certify_shapes`] returns for anyone to evaluate again.
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

mod body;
mod convex;
mod double_double;
mod grading;
mod packing;
mod required;
mod separation;
mod sieve;
mod solids;
mod spheres;
mod table;
mod walk;
mod walls;

use std::num::NonZeroUsize;

use crate::control::{Control, Phase, Progress};
use crate::memory::OutOfMemory;
use crate::packing::{AggregateReport, CheckReport, ClassReport, GrainsRef};
use crate::request::PackingRequest;

pub use solids::{certify, certify_shapes, check_shapes, check_solids};
pub use spheres::{check, check_with};

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

/// Checks a packing of any kind of grains against its request, on so many threads. What is found does not depend on the
/// threads. Gaps are checked at the sizes that the grains have; that these are those of the mix, by its extent.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_grains<'a>(
    grains: impl Into<GrainsRef<'a>>,
    request: &PackingRequest,
    extent: Extent,
    scope: Scope,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let walk = &walk::Walk { threads, control };
    match grains.into() {
        GrainsRef::Spheres(spheres) => spheres::judge(spheres, request, extent, scope, walk),
        GrainsRef::Solids(solids) => solids::judge(solids, request, extent, scope, walk),
    }
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
    /// Two grains are too close.
    #[error(
        "grains {first} and {second} are {:e} mm apart: their rule asks for {required_mm} mm",
        .clearance_mm + 0.0
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
    #[error("grain {grain} is {:e} mm from a wall: its rule asks for {required_mm} mm", .clearance_mm + 0.0)]
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

/// A direction that shows how far apart two grains lie.
///
/// With the centres `x`, the support functions `h` and `r = x_second + image * period - x_first`, the distance of the
/// grains is at least `s(n) = (r . n) / |n| - h_first(n / |n|) - h_second(-n / |n|)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeparationCertificate {
    /// Row of one grain.
    pub first: usize,
    /// Row of the other, or the same where it meets its own periodic image.
    pub second: usize,
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
    min_excess_gap_mm: Option<f64>,
    checked: u64,
}

impl Check {
    fn new(min_wall_gap_mm: Option<f64>, pairs: &Pairs, graded: grading::Graded) -> Self {
        Self {
            found: CheckReport {
                min_gap_mm: pairs.min_gap_mm,
                min_wall_gap_mm,
                min_excess_gap_mm: pairs.min_excess_gap_mm,
                max_class_mass_error: graded.max_class_mass_error,
                pairs_checked: pairs.checked,
            },
            classes: graded.classes,
            aggregates: graded.aggregates,
        }
    }
}

fn report(control: &dyn Control, done: usize, total: usize) {
    control.report(&Progress {
        phase: Phase::Check,
        fraction: done as f64 / total.max(1) as f64,
        done: done as u64,
        total: total as u64,
        unit: "grains",
        message: "checking every pair, the walls and the grading".into(),
        growth: None,
    });
}

#[cfg(test)]
mod tests;
