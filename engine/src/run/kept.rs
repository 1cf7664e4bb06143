//! The largest distance that spheres keep where a limit, or a request to finish, has ended its growth.
//!
//! Growth knows a distance that all grains keep; the gaps between the closest of them are larger where the end came
//! before growth had used them up.

use super::Placed;
use super::size_scale::NearPairs;
use crate::gap::linear::norm;
use crate::memory::OutOfMemory;
use crate::packing::{GrowthEnd, Spheres};
use crate::request::{Distance, Specimen};

/// Share of the lengths of a pair by which the distance is shorter than the smallest gap, for rounding.
const MARGIN: f64 = 1e-12;

/// Sets the distance of spheres that it was maximized for, and the last one of the growth curve, to what they keep.
///
/// # Errors
/// When the system refuses memory.
pub(super) fn set_distance(
    placed: &mut Placed,
    distance: &Distance,
    specimen: &Specimen,
) -> Result<(), OutOfMemory> {
    let (Distance::Maximize { wall_gap_mm }, Some(spheres)) = (distance, placed.grains.spheres()) else {
        return Ok(());
    };
    let ended = placed.statistics.edmd.map(|edmd| edmd.stop);
    let by_limit = matches!(ended, Some(GrowthEnd::TimeLimit | GrowthEnd::EventLimit | GrowthEnd::Finished));
    let Some(told_mm) = placed.distance_mm.filter(|_| by_limit && placed.scale == 1.0) else {
        return Ok(());
    };
    let mut least_mm = smallest_gap_mm(spheres, specimen, told_mm)?;
    let domain = specimen.domain();
    if wall_gap_mm.is_none() && domain.has_walls() {
        // Half of the distance is kept to the walls.
        for (row, d) in spheres.d_mm.iter().enumerate() {
            let clear = domain.clearance_reaching_all(spheres.center(row), [0.0; 3]);
            least_mm = least_mm.min(2.0 * (clear - d / 2.0));
        }
    }
    let longest_mm = specimen.bounds_mm().into_iter().fold(0.0, f64::max);
    let kept_mm = least_mm - MARGIN * (least_mm + longest_mm);
    if kept_mm > told_mm && kept_mm.is_finite() {
        placed.distance_mm = Some(kept_mm);
        if let Some(last) = placed.growth_curve.last_mut() {
            last.distance_mm = Some(kept_mm);
        }
    }
    Ok(())
}

/// The smallest gap of two spheres, with all periodic images; infinite where there is one sphere between walls.
fn smallest_gap_mm(spheres: &Spheres, specimen: &Specimen, least_mm: f64) -> Result<f64, OutOfMemory> {
    let farthest_mm: f64 = specimen.bounds_mm().iter().sum();
    let mut look_mm = 1.5 * least_mm + spheres.d_mm.last().copied().unwrap_or(0.0) / 64.0;
    loop {
        let mut smallest_mm = f64::INFINITY;
        NearPairs::new(spheres, specimen, |_| look_mm)?.for_each(|i, j, r| {
            smallest_mm = smallest_mm.min(norm(r) - (spheres.d_mm[i] + spheres.d_mm[j]) / 2.0);
        });
        if smallest_mm <= look_mm || look_mm > farthest_mm {
            return Ok(smallest_mm);
        }
        look_mm *= 2.0;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use crate::control::Unattended;
    use crate::{Limits, PackingRequest, pack};

    /// The distance of a run that a limit has ended is the smallest gap of the stored grains, by this test's own loop.
    #[test]
    fn a_limit_of_events_leaves_the_distance_that_the_grains_keep() {
        for (boundary, wall_gap_mm) in [("periodic", None), ("walls", None), ("walls", Some(0.5))] {
            let mut distance = json!({"type": "maximize"});
            if let Some(mm) = wall_gap_mm {
                distance["wall_gap_mm"] = json!(mm);
            }
            let value = json!({
                "specimen": {"type": "box", "size_mm": [30, 28, 26], "boundary": boundary},
                "mix": {"grading": {"type": "diameters", "diameters_mm": [5, 4, 3]}, "allow_coarse": true},
                "distance": distance,
                "method": {"type": "edmd", "stop": {"events": 30}},
            });
            let packing =
                pack(&PackingRequest::from_json(&value, 3).unwrap(), &Limits::default(), &Unattended);
            let packing = packing.unwrap();
            let (report, spheres) = (&packing.report, packing.grains.spheres().unwrap());
            let size = [30.0, 28.0, 26.0];
            let (mut least, mut least_wall) = (f64::INFINITY, f64::INFINITY);
            for i in 0..3 {
                let (p, d) = (spheres.center(i), spheres.d_mm[i]);
                for a in 0..3 {
                    least_wall = least_wall.min(p[a] - d / 2.0).min(size[a] - p[a] - d / 2.0);
                }
                for j in 0..3 {
                    for image in 0..27 {
                        let step = [image % 3, image / 3 % 3, image / 9].map(|k| f64::from(k) - 1.0);
                        if (boundary == "walls" && step != [0.0; 3]) || (i == j && step == [0.0; 3]) {
                            continue;
                        }
                        let q = spheres.center(j);
                        let distance2: f64 = (0..3).map(|a| (q[a] + step[a] * size[a] - p[a]).powi(2)).sum();
                        least = least.min(distance2.sqrt() - d / 2.0 - spheres.d_mm[j] / 2.0);
                    }
                }
            }
            if boundary == "walls" && wall_gap_mm.is_none() {
                least = least.min(2.0 * least_wall);
            }
            let kept_mm = report.summary.distance_mm.unwrap();
            assert!(kept_mm <= least && kept_mm > least - 1e-9, "{kept_mm} {least}");
            assert_eq!(report.growth_curve.last().unwrap().distance_mm, Some(kept_mm));
            assert!(report.check.min_excess_gap_mm.unwrap() < 1e-9 || boundary == "walls");
        }
    }
}
