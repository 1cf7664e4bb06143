//! The independent check of a finished packing: all pairs, all walls, the grading.
//!
//! For grains `i` and `j` with centres `x` and diameters `d` it requires
//! `|x_i - x_j| >= (d_i + d_j) / 2 + g(d_i, d_j)`, in a periodic box for the nearest images, and for every wall at
//! distance `w` of a centre `w >= d / 2 + g_wall(d)`, without tolerance. The required gaps `g` (`required`), the walls,
//! the neighbour table (`table`) and the classes of the grading (`grading`) are the module's own, and it imports
//! nothing of the packing methods, their distance rule or their specimen geometry; `tests/layers.rs` holds that. A
//! packing that fails here is never returned. Costs O(N).
//!
//! Of bodies that are not spheres, [`check_solids`] requires that their surfaces keep the gap of the diameters of
//! equal volume. Every pair that passes is proven by a direction `n` with `s(n) >= g` (`separation`,
//! `polyhedron_separation`, `mixed_separation`), which [`certify_shapes`] returns for anyone to evaluate again.
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

mod bodies;
mod double_double;
mod ellipsoid;
mod ellipsoid_walls;
mod ellipsoids;
mod grading;
mod mixed_separation;
mod polyhedra;
mod polyhedron;
mod polyhedron_separation;
mod required;
mod separation;
mod sieve;
mod solid;
mod table;

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::control::{Control, Phase, Progress, Unattended};
use crate::cpu::Cpu;
use crate::memory::{OutOfMemory, collected, reserved};
use crate::packing::{AggregateReport, CheckReport, ClassReport, GrainsRef, Solids, Spheres};
use crate::request::{Distance, PackingRequest, Specimen};
use crate::shape::{self, Ellipsoid, Pose, SizeMeasure, SolidRef};
use bodies::{Convex, Packing};
use grading::{Grains, SIEVE_ERROR, SIZE_ERROR};
use required::Required;
use solid::Body;
use table::{Grain, Table};

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
        "grains {first} and {second} are {clearance_mm:e} mm apart: their rule asks for {required_mm} mm"
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
    #[error("grain {grain} is {clearance_mm:e} mm from a wall: its rule asks for {required_mm} mm")]
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

/// Checks a packing of grains that are no spheres against its request, by the sizes of its mix.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_solids(
    solids: &Solids,
    request: &PackingRequest,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let shapes = shapes_of(solids)?;
    judge_shapes((&shapes, &solids.poses, &solids.aggregate), request, request.mix.size, control)
}

fn shapes_of(solids: &Solids) -> Result<Vec<SolidRef<'_>>, Fault> {
    let mut shapes = reserved(solids.len())?;
    for (grain, shape) in solids.shapes.iter().enumerate() {
        shapes.push(shape.of(&solids.templates).ok_or(Fault::NotABody { grain })?);
    }
    Ok(shapes)
}

/// Checks a packing of ellipsoids and convex polyhedra against its request. Shape and pose of a grain have the same
/// index.
///
/// `size` is what the grading measures. The sieve size of each template is measured once, by a search of the check's
/// own that finds it to 1e-5; grains share a template where they refer to the same one.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_shapes(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    request: &PackingRequest,
    size: SizeMeasure,
    control: &dyn Control,
) -> Result<Check, Fault> {
    judge_shapes((shapes, poses, &[]), request, size, control)
}

/// Checks shapes at their poses with the aggregate of each, none where the mix names none.
fn judge_shapes(
    (shapes, poses, aggregate): (&[SolidRef<'_>], &[Pose], &[u16]),
    request: &PackingRequest,
    size: SizeMeasure,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let region = (request.distance, request.specimen);
    // Pairs of ellipsoids are worth a loop of their own.
    if let Some(ellipsoids) = ellipsoids_of(shapes)? {
        let packing = ellipsoid_bodies(&ellipsoids, poses, region)?;
        let sizes = collected(ellipsoids.iter().map(|shape| ellipsoids::size(shape, size)))?;
        let grains = Grains::Bodies { sizes: &sizes, error: &|_| SIZE_ERROR };
        return check_bodies(&packing, grains, aggregate, request, control);
    }
    let packing = bodies(shapes, poses, region)?;
    let mut sieves: BTreeMap<*const shape::Polyhedron, f64> = BTreeMap::new();
    let sizes = packing.bodies().iter().zip(shapes).map(|(body, shape)| match (shape, size) {
        (SolidRef::Ellipsoid(ellipsoid), _) => ellipsoids::size(ellipsoid, size),
        (SolidRef::Polyhedron(_), SizeMeasure::Equivalent) => (body.equivalent_diameter(), body.own_volume()),
        (SolidRef::Polyhedron(shape), SizeMeasure::Sieve) => {
            let template: *const _ = shape.template;
            let of_template = *sieves.entry(template).or_insert_with(|| sieve::sieve_size(shape.template));
            (of_template * shape.scale_mm, body.own_volume())
        }
    });
    let sizes = collected(sizes)?;
    let error = |grain: usize| match (&shapes[grain], size) {
        (SolidRef::Polyhedron(_), SizeMeasure::Sieve) => SIEVE_ERROR,
        _ => SIZE_ERROR,
    };
    check_bodies(&packing, Grains::Bodies { sizes: &sizes, error: &error }, aggregate, request, control)
}

/// Checks all pairs of a packing of ellipsoids and convex polyhedra and returns a direction for each whose gap is less
/// than `closer_than_mm`, in the order of their rows.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`]. The grading is not looked at.
pub fn certify_shapes(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    request: &PackingRequest,
    closer_than_mm: f64,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    certificates(shapes, poses, (request.distance, request.specimen), closer_than_mm, control)
}

/// Checks that no two grains overlap, and returns a direction for each pair whose gap is less than `closer_than_mm`, in
/// the order of their rows. Spheres are checked as ellipsoids with equal axes.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn certify(
    grains: GrainsRef<'_>,
    specimen: &Specimen,
    closer_than_mm: f64,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    let region = (Distance::None { wall_gap_mm: None }, *specimen);
    match grains {
        GrainsRef::Spheres(spheres) => {
            let body = |i: usize| {
                let shape = Ellipsoid::new([spheres.d_mm[i] / 2.0; 3])?;
                ellipsoid::Body::new(&shape, &Pose::at(spheres.center(i).into()))
            };
            let packing = Packing::new(spheres.len(), body, region)?;
            packing.check_walls()?;
            packing.certificates(closer_than_mm, control)
        }
        GrainsRef::Solids(solids) => {
            certificates(&shapes_of(solids)?, &solids.poses, region, closer_than_mm, control)
        }
    }
}

fn certificates(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    region: (Distance, Specimen),
    closer_than_mm: f64,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    if let Some(ellipsoids) = ellipsoids_of(shapes)? {
        let packing = ellipsoid_bodies(&ellipsoids, poses, region)?;
        packing.check_walls()?;
        return packing.certificates(closer_than_mm, control);
    }
    let packing = bodies(shapes, poses, region)?;
    packing.check_walls()?;
    packing.certificates(closer_than_mm, control)
}

/// The ellipsoids, where all are.
fn ellipsoids_of(shapes: &[SolidRef<'_>]) -> Result<Option<Vec<Ellipsoid>>, OutOfMemory> {
    if shapes.iter().any(|shape| shape.ellipsoid().is_none()) {
        return Ok(None);
    }
    let mut ellipsoids = reserved(shapes.len())?;
    ellipsoids.extend(shapes.iter().filter_map(SolidRef::ellipsoid));
    Ok(Some(ellipsoids))
}

fn ellipsoid_bodies(
    shapes: &[Ellipsoid],
    poses: &[Pose],
    region: (Distance, Specimen),
) -> Result<Packing<ellipsoid::Body>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| ellipsoid::Body::new(&shapes[i], &poses[i]), region)
}

fn bodies(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    region: (Distance, Specimen),
) -> Result<Packing<Body>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| Body::new(&shapes[i], &poses[i]), region)
}

/// Checks the walls, all pairs, and the grading of grains.
fn check_bodies<B: Convex>(
    packing: &Packing<B>,
    grains: Grains<'_>,
    aggregate: &[u16],
    request: &PackingRequest,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let min_wall_gap_mm = packing.check_walls()?;
    let pairs = packing.check_pairs(control)?;
    let graded = grading::check(grains, aggregate, request).map_err(Fault::Grading)?;
    Ok(Check {
        found: CheckReport {
            min_gap_mm: pairs.min_gap_mm,
            min_wall_gap_mm,
            min_excess_gap_mm: pairs.min_excess_gap_mm,
            max_class_mass_error: graded.max_class_mass_error,
            pairs_checked: pairs.checked,
        },
        classes: graded.classes,
        aggregates: graded.aggregates,
    })
}

/// Checks a packing against its request.
///
/// # Errors
/// The first fault found.
pub fn check(spheres: &Spheres, request: &PackingRequest) -> Result<Check, Fault> {
    check_with(spheres, request, &Unattended)
}

/// [`check`] with progress, and with a way to stop it.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_with(
    spheres: &Spheres,
    request: &PackingRequest,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let n = spheres.len();
    if [&spheres.x_mm, &spheres.y_mm, &spheres.z_mm].iter().any(|column| column.len() != n) {
        return Err(Fault::Columns);
    }
    for grain in 0..n {
        let finite = spheres.center(grain).iter().all(|x| x.is_finite());
        let d = spheres.d_mm[grain];
        if !(finite && d.is_finite() && d > 0.0) {
            return Err(Fault::NotANumber { grain });
        }
    }
    let required = Required::new(request.distance, request.specimen);
    let min_wall_gap_mm = check_walls(spheres, &required)?;
    let pairs = check_pairs(spheres, &required, control)?;
    let graded = grading::check(Grains::Spheres(&spheres.d_mm), &spheres.aggregate, request)
        .map_err(Fault::Grading)?;
    Ok(Check {
        found: CheckReport {
            min_gap_mm: pairs.min_gap_mm,
            min_wall_gap_mm,
            min_excess_gap_mm: pairs.min_excess_gap_mm,
            max_class_mass_error: graded.max_class_mass_error,
            pairs_checked: pairs.checked,
        },
        classes: graded.classes,
        aggregates: graded.aggregates,
    })
}

/// Smallest gap to a wall; `None` where there are no walls or no grains. The centres in a periodic box must lie in it.
fn check_walls(spheres: &Spheres, required: &Required) -> Result<Option<f64>, Fault> {
    let mut least: Option<f64> = None;
    for (grain, &d) in spheres.d_mm.iter().enumerate() {
        let distance_mm = required.wall_distance_mm(spheres.center(grain));
        if required.period_mm().is_some() {
            if distance_mm < 0.0 {
                return Err(Fault::Wall { grain, clearance_mm: distance_mm, required_mm: 0.0 });
            }
            continue;
        }
        let (clearance_mm, required_mm) = (distance_mm - 0.5 * d, required.wall_gap_mm(d));
        // Compared as a distance of the centre: a grain that fits exactly is one that fits.
        if distance_mm < 0.5 * d + required_mm {
            return Err(Fault::Wall { grain, clearance_mm, required_mm });
        }
        least = Some(least.map_or(clearance_mm, |l| l.min(clearance_mm)));
    }
    Ok(least)
}

#[derive(Debug)]
struct Pairs {
    min_gap_mm: Option<f64>,
    min_excess_gap_mm: Option<f64>,
    checked: u64,
}

/// Checks all pairs that may be closer than their rule demands, and looks as far beyond as it
/// takes to know the smallest gap.
fn check_pairs(spheres: &Spheres, required: &Required, control: &dyn Control) -> Result<Pairs, Fault> {
    let period = required.period_mm();
    let mut pairs = own_images(spheres, required)?;
    let Some(d_least) = spheres.d_mm.iter().copied().reduce(f64::min) else { return Ok(pairs) };
    let bounds = required.bounds_mm();
    let farthest = bounds.iter().map(|l| l * l).sum::<f64>().sqrt();
    let surely_kept = required.gap_mm(d_least, d_least);
    // A dense packing has many pairs closer than this; a loose one is looked at again, further out.
    let mut look = 0.05 * d_least;
    loop {
        let table = Table::build(
            spheres,
            bounds,
            period.is_some(),
            #[inline(always)]
            |d_i, d_j| required.gap_mm(d_i, d_j) + look,
        )?;
        let mut nearest = (f64::INFINITY, f64::INFINITY);
        let mut fault = None;
        let go_on = |done: usize| {
            report(control, done, spheres.len());
            !control.should_stop()
        };
        let walked = Cpu::detect().call(
            #[inline(always)]
            || {
                table.for_each_pair(
                    #[inline(always)]
                    |i: usize, j: usize, a: &Grain, b: &Grain| {
                        let mut separation = Vector3::from(a.center) - Vector3::from(b.center);
                        if let Some(period) = period {
                            for axis in 0..3 {
                                separation[axis] -= period[axis] * (separation[axis] / period[axis]).round();
                            }
                        }
                        // Far pairs are most pairs; the root is only taken of the others.
                        let radii = 0.5 * (a.diameter + b.diameter);
                        let required_mm = required.gap_mm(a.diameter, b.diameter);
                        let reach = radii + required_mm + look;
                        let distance2 = separation.norm_squared();
                        if distance2 > reach * reach {
                            return;
                        }
                        let distance = distance2.sqrt();
                        let (clearance_mm, excess_mm) = (distance - radii, distance - (radii + required_mm));
                        nearest = (nearest.0.min(clearance_mm), nearest.1.min(excess_mm));
                        if excess_mm < 0.0 && fault.is_none() {
                            fault = Some(Fault::Pair {
                                first: i.min(j),
                                second: i.max(j),
                                clearance_mm,
                                required_mm,
                            });
                        }
                    },
                    go_on,
                )
            },
        );
        pairs.checked += walked.ok_or(Fault::Stopped)?;
        if let Some(fault) = fault {
            return Err(fault);
        }
        let closer = |old: Option<f64>, new: f64| {
            let least = old.map_or(new, |o| o.min(new));
            least.is_finite().then_some(least)
        };
        let gap = closer(pairs.min_gap_mm, nearest.0);
        let excess = closer(pairs.min_excess_gap_mm, nearest.1);
        // Pairs not seen keep their rule's distance and `look` more.
        let known = gap.is_some_and(|g| g <= surely_kept + look) && excess.is_some_and(|e| e <= look);
        if known || look > farthest || spheres.len() < 2 {
            pairs.min_gap_mm = gap;
            pairs.min_excess_gap_mm = excess;
            return Ok(pairs);
        }
        look *= 4.0;
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

/// In a periodic box a grain must also keep its distance from its own images.
fn own_images(spheres: &Spheres, required: &Required) -> Result<Pairs, Fault> {
    let mut pairs = Pairs { min_gap_mm: None, min_excess_gap_mm: None, checked: 0 };
    let Some(period) = required.period_mm() else { return Ok(pairs) };
    let shortest = period.iter().copied().fold(f64::INFINITY, f64::min);
    for (grain, &d) in spheres.d_mm.iter().enumerate() {
        let (clearance_mm, required_mm) = (shortest - d, required.gap_mm(d, d));
        let excess_mm = shortest - (d + required_mm);
        if excess_mm < 0.0 {
            return Err(Fault::Pair { first: grain, second: grain, clearance_mm, required_mm });
        }
        pairs.min_gap_mm = Some(pairs.min_gap_mm.map_or(clearance_mm, |c| c.min(clearance_mm)));
        pairs.min_excess_gap_mm = Some(pairs.min_excess_gap_mm.map_or(excess_mm, |e| e.min(excess_mm)));
    }
    Ok(pairs)
}

#[cfg(test)]
mod ellipsoid_tests;
#[cfg(test)]
mod mixed_tests;
#[cfg(test)]
mod polyhedron_tests;
#[cfg(test)]
mod tests;
