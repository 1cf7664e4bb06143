//! The independent check of a finished packing: all pairs, all walls, the grading.
//!
//! Shares no code with the search that made the packing: its own neighbour table (`table`), its
//! own formulas for walls, its own count of the classes. A packing that fails here is never
//! reported as successful. Costs O(N).

mod grading;
pub(crate) mod table;

use nalgebra::Vector3;

use crate::control::{Control, Phase, Progress, Unattended};
use crate::distance::DistanceRule;
use crate::packing::{CheckReport, ClassReport, Spheres};
use crate::request::{PackingRequest, Specimen};
use table::{Grain, Table};

/// What a check found in a valid packing.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Extremes of distances and grading.
    pub found: CheckReport,
    /// Sieve classes, from fine to coarse.
    pub classes: Vec<ClassReport>,
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
    /// Two grains are too close.
    #[error(
        "grains {first} and {second} are {clearance_mm:e} mm apart: their rule asks for {required_mm} mm"
    )]
    Pair {
        /// Row of one grain.
        first: usize,
        /// Row of the other, or the same where it meets its own periodic image.
        second: usize,
        /// Clear distance found.
        clearance_mm: f64,
        /// Clear distance that the rule demands.
        required_mm: f64,
    },
    /// A grain is too close to a wall, or beyond it.
    #[error("grain {grain} is {clearance_mm:e} mm from a wall: its rule asks for {required_mm} mm")]
    Wall {
        /// Row of the grain.
        grain: usize,
        /// Clear distance found.
        clearance_mm: f64,
        /// Clear distance that the rule demands.
        required_mm: f64,
    },
    /// The control asked to stop; nothing is said of the packing.
    #[error("the check was stopped on request")]
    Stopped,
    /// The grains are not those of the mix.
    #[error("the grains are not those of the mix: {0}")]
    Grading(String),
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
    let rule = DistanceRule::new(&request.distance, &request.specimen);
    let min_wall_gap_mm = check_walls(spheres, &request.specimen, &rule)?;
    let pairs = check_pairs(spheres, &request.specimen, &rule, control)?;
    let (classes, max_class_mass_error) = grading::check(spheres, request).map_err(Fault::Grading)?;
    Ok(Check {
        found: CheckReport {
            min_gap_mm: pairs.min_gap_mm,
            min_wall_gap_mm,
            min_excess_gap_mm: pairs.min_excess_gap_mm,
            max_class_mass_error,
            pairs_checked: pairs.checked,
        },
        classes,
    })
}

/// Smallest clear distance to a wall; `None` where there are no walls or no grains.
fn check_walls(spheres: &Spheres, specimen: &Specimen, rule: &DistanceRule) -> Result<Option<f64>, Fault> {
    if specimen.is_periodic() {
        return check_inside_period(spheres, specimen.bounds_mm());
    }
    let mut least: Option<f64> = None;
    for grain in 0..spheres.len() {
        let d = spheres.d_mm[grain];
        let clearance_mm = wall_clearance(spheres.center(grain), d / 2.0, specimen);
        let required_mm = rule.wall_gap_mm(d);
        if clearance_mm < required_mm {
            return Err(Fault::Wall { grain, clearance_mm, required_mm });
        }
        least = Some(least.map_or(clearance_mm, |l| l.min(clearance_mm)));
    }
    Ok(least)
}

/// A periodic box has no walls, but its grains are named by their image inside.
fn check_inside_period(spheres: &Spheres, bounds: [f64; 3]) -> Result<Option<f64>, Fault> {
    for grain in 0..spheres.len() {
        for (p, length) in spheres.center(grain).into_iter().zip(bounds) {
            let clearance_mm = p.min(length - p);
            if clearance_mm < 0.0 {
                return Err(Fault::Wall { grain, clearance_mm, required_mm: 0.0 });
            }
        }
    }
    Ok(None)
}

fn wall_clearance([x, y, z]: [f64; 3], r: f64, specimen: &Specimen) -> f64 {
    let between = |p: f64, length: f64| (p - r).min(length - p - r);
    match *specimen {
        Specimen::Box { size_mm: [a, b, c], .. } => between(x, a).min(between(y, b)).min(between(z, c)),
        Specimen::Cylinder { diameter_mm, height_mm } => {
            let radius = diameter_mm / 2.0;
            let from_axis = (x - radius).hypot(y - radius);
            (radius - from_axis - r).min(between(z, height_mm))
        }
    }
}

#[derive(Debug)]
struct Pairs {
    min_gap_mm: Option<f64>,
    min_excess_gap_mm: Option<f64>,
    checked: u64,
}

/// Checks all pairs that may be closer than their rule demands, and looks as far beyond as it
/// takes to know the smallest clear distance.
fn check_pairs(
    spheres: &Spheres,
    specimen: &Specimen,
    rule: &DistanceRule,
    control: &dyn Control,
) -> Result<Pairs, Fault> {
    let period = specimen.is_periodic().then(|| specimen.bounds_mm());
    let mut pairs = own_images(spheres, period, rule)?;
    let Some(d_least) = spheres.d_mm.iter().copied().reduce(f64::min) else { return Ok(pairs) };
    let bounds = specimen.bounds_mm();
    let farthest = bounds.iter().map(|l| l * l).sum::<f64>().sqrt();
    let surely_kept = rule.gap_mm(d_least, d_least);
    // A dense packing has many pairs closer than this; a loose one is looked at again, further out.
    let mut look = 0.05 * d_least;
    loop {
        let table = Table::build(spheres, bounds, period.is_some(), |d_i, d_j| rule.gap_mm(d_i, d_j) + look);
        let mut nearest = (f64::INFINITY, f64::INFINITY);
        let mut fault = None;
        let go_on = |done: usize| {
            report(control, done, spheres.len());
            !control.should_stop()
        };
        let visit = |i: usize, j: usize, a: &Grain, b: &Grain| {
            let mut way = Vector3::from(a.center) - Vector3::from(b.center);
            if let Some(period) = period {
                for axis in 0..3 {
                    way[axis] -= period[axis] * (way[axis] / period[axis]).round();
                }
            }
            // Far pairs are most pairs; the root is only taken of the others.
            let reach = (a.diameter + b.diameter) / 2.0 + rule.gap_mm(a.diameter, b.diameter) + look;
            let distance2 = way.norm_squared();
            if distance2 > reach * reach {
                return;
            }
            let clearance_mm = distance2.sqrt() - (a.diameter + b.diameter) / 2.0;
            let required_mm = rule.gap_mm(a.diameter, b.diameter);
            nearest = (nearest.0.min(clearance_mm), nearest.1.min(clearance_mm - required_mm));
            if clearance_mm < required_mm && fault.is_none() {
                fault = Some(Fault::Pair { first: i.min(j), second: i.max(j), clearance_mm, required_mm });
            }
        };
        pairs.checked += table.for_each_pair(visit, go_on).ok_or(Fault::Stopped)?;
        if let Some(fault) = fault {
            return Err(fault);
        }
        let closer = |old: Option<f64>, new: f64| {
            let least = old.map_or(new, |o| o.min(new));
            least.is_finite().then_some(least)
        };
        let clearance = closer(pairs.min_gap_mm, nearest.0);
        let slack = closer(pairs.min_excess_gap_mm, nearest.1);
        // Pairs not seen keep their rule's distance and `look` more.
        let known = clearance.is_some_and(|c| c <= surely_kept + look) && slack.is_some_and(|s| s <= look);
        if known || look > farthest || spheres.len() < 2 {
            pairs.min_gap_mm = clearance;
            pairs.min_excess_gap_mm = slack;
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
fn own_images(spheres: &Spheres, period: Option<[f64; 3]>, rule: &DistanceRule) -> Result<Pairs, Fault> {
    let mut pairs = Pairs { min_gap_mm: None, min_excess_gap_mm: None, checked: 0 };
    let Some(period) = period else { return Ok(pairs) };
    let shortest = period.iter().copied().fold(f64::INFINITY, f64::min);
    for (grain, &d) in spheres.d_mm.iter().enumerate() {
        let (clearance_mm, required_mm) = (shortest - d, rule.gap_mm(d, d));
        if clearance_mm < required_mm {
            return Err(Fault::Pair { first: grain, second: grain, clearance_mm, required_mm });
        }
        let slack = clearance_mm - required_mm;
        pairs.min_gap_mm = Some(pairs.min_gap_mm.map_or(clearance_mm, |c| c.min(clearance_mm)));
        pairs.min_excess_gap_mm = Some(pairs.min_excess_gap_mm.map_or(slack, |s| s.min(slack)));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests;
