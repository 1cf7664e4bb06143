//! The check of spheres.

use std::num::NonZeroUsize;

use nalgebra::Vector3;

use super::asked::volume_mm3;
use super::grading::{self, Sizes};
use super::region::{Region as _, SpecimenRegion};
use super::required::Required;
use super::table::{Grain, Table};
use super::walk::{Findings, Walk};
use super::{Check, Extent, Fault, Inspection, Pairs, Scope};
use crate::control::Unattended;
use crate::packing::Spheres;
use crate::request::PackingRequest;

/// Grains of a piece of the walk: a fraction of a millisecond.
const GRAINS_PER_PIECE: usize = 4096;

/// Checks a packing against its request.
///
/// # Errors
/// The first fault found.
pub fn check(spheres: &Spheres, request: &PackingRequest) -> Result<Check, Fault> {
    let walk = Walk { threads: NonZeroUsize::MIN, control: &Unattended };
    judge(spheres, request, Extent::WHOLE, Scope::All, &walk)?.grading
}

/// Checks what the scope names.
pub(super) fn judge(
    spheres: &Spheres,
    request: &PackingRequest,
    extent: Extent,
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Inspection, Fault> {
    judge_numbers(spheres)?;
    let required = Required::new(request.distance, SpecimenRegion::new(&request.specimen));
    let wall = check_walls(spheres, &required)?;
    let pairs = match scope {
        Scope::All => check_pairs(spheres, &required, walk)?,
        Scope::WithoutPairs => Pairs::default(),
    };
    let of = |row: usize| (spheres.d_mm[row], volume_mm3(spheres.d_mm[row]));
    let sizes = Sizes { grains: spheres.len(), of: &of, error: &|_| 0.0, give_volumes: true };
    Ok(Inspection::new(wall, &pairs, grading::check(sizes, &spheres.aggregate, request, extent)))
}

/// Checks all but the grading.
pub(super) fn judge_gaps(spheres: &Spheres, required: &Required, walk: &Walk<'_>) -> Result<(), Fault> {
    judge_numbers(spheres)?;
    check_walls(spheres, required)?;
    check_pairs(spheres, required, walk).map(drop)
}

fn judge_numbers(spheres: &Spheres) -> Result<(), Fault> {
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
    Ok(())
}

/// Smallest gap to a wall with its grain; `None` where there are no walls or no grains. The centres in a periodic box
/// must lie in it.
fn check_walls(spheres: &Spheres, required: &Required) -> Result<Option<(f64, usize)>, Fault> {
    let mut least: Option<(f64, usize)> = None;
    for (grain, &d) in spheres.d_mm.iter().enumerate() {
        let distance_mm = required.region().face_distance_mm(spheres.center(grain));
        if required.region().period_mm().is_some() {
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
        if least.is_none_or(|(gap, _)| clearance_mm < gap) {
            least = Some((clearance_mm, grain));
        }
    }
    Ok(least)
}

/// What the pairs of a piece have shown.
struct Nearest {
    gap_mm: f64,
    closest: [usize; 2],
    excess_mm: f64,
    fault: Option<Fault>,
}

impl Findings for Nearest {
    fn have_fault(&self) -> bool {
        self.fault.is_some()
    }
}

/// Checks all pairs that may be closer than their rule demands, and looks as far beyond as it
/// takes to know the smallest gap.
fn check_pairs(spheres: &Spheres, required: &Required, walk: &Walk<'_>) -> Result<Pairs, Fault> {
    let mut pairs = own_images(spheres, required)?;
    let Some(d_least) = spheres.d_mm.iter().copied().reduce(f64::min) else { return Ok(pairs) };
    let bounds = required.region().bounds_mm();
    let farthest = bounds.iter().map(|l| l * l).sum::<f64>().sqrt();
    let surely_kept = required.gap_mm(d_least, d_least);
    // A dense packing has many pairs closer than this; a loose one is looked at again, further out.
    let mut look = 0.05 * d_least;
    loop {
        let (nearest, walked) = nearest(spheres, required, look, walk)?;
        pairs.checked += walked;
        let closer = |old: Option<f64>, new: f64| {
            let least = old.map_or(new, |o| o.min(new));
            least.is_finite().then_some(least)
        };
        if pairs.min_gap_mm.is_none_or(|gap| nearest.gap_mm < gap) && nearest.gap_mm.is_finite() {
            pairs.closest = Some(nearest.closest);
        }
        let gap = closer(pairs.min_gap_mm, nearest.gap_mm);
        let excess = closer(pairs.min_excess_gap_mm, nearest.excess_mm);
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

/// Checks all pairs and finds the nearest of those that are no farther apart than their rule demands and `look` more;
/// returns the number of pairs as well.
fn nearest(
    spheres: &Spheres,
    required: &Required,
    look: f64,
    walk: &Walk<'_>,
) -> Result<(Nearest, u64), Fault> {
    let period = required.region().period_mm();
    let table = Table::build(
        spheres,
        required.region().bounds_mm,
        period.is_some(),
        #[inline(always)]
        |d_i, d_j| required.gap_mm(d_i, d_j) + look,
    )?;
    let empty = || Nearest { gap_mm: f64::INFINITY, closest: [0; 2], excess_mm: f64::INFINITY, fault: None };
    let walked = walk.over(
        &table,
        GRAINS_PER_PIECE,
        empty,
        #[inline(always)]
        |nearest: &mut Nearest, i: usize, j: usize, a: &Grain, b: &Grain| {
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
            if clearance_mm < nearest.gap_mm {
                (nearest.gap_mm, nearest.closest) = (clearance_mm, [i.min(j), i.max(j)]);
            }
            nearest.excess_mm = nearest.excess_mm.min(excess_mm);
            if excess_mm < 0.0 && nearest.fault.is_none() {
                let (first, second) = (i.min(j), i.max(j));
                nearest.fault = Some(Fault::Pair { first, second, clearance_mm, required_mm });
            }
        },
    )?;
    let mut nearest = empty();
    for found in walked.findings {
        if let Some(fault) = found.fault {
            return Err(fault);
        }
        if found.gap_mm < nearest.gap_mm {
            (nearest.gap_mm, nearest.closest) = (found.gap_mm, found.closest);
        }
        nearest.excess_mm = nearest.excess_mm.min(found.excess_mm);
    }
    Ok((nearest, walked.pairs))
}

/// In a periodic box a grain must also keep its distance from its own images.
fn own_images(spheres: &Spheres, required: &Required) -> Result<Pairs, Fault> {
    let mut pairs = Pairs::default();
    let Some(period) = required.region().period_mm() else { return Ok(pairs) };
    let shortest = period.iter().copied().fold(f64::INFINITY, f64::min);
    for (grain, &d) in spheres.d_mm.iter().enumerate() {
        let (clearance_mm, required_mm) = (shortest - d, required.gap_mm(d, d));
        let excess_mm = shortest - (d + required_mm);
        if excess_mm < 0.0 {
            return Err(Fault::Pair { first: grain, second: grain, clearance_mm, required_mm });
        }
        if pairs.min_gap_mm.is_none_or(|gap| clearance_mm < gap) {
            (pairs.min_gap_mm, pairs.closest) = (Some(clearance_mm), Some([grain; 2]));
        }
        pairs.min_excess_gap_mm = Some(pairs.min_excess_gap_mm.map_or(excess_mm, |e| e.min(excess_mm)));
    }
    Ok(pairs)
}
