//! Check T13: grains against one another, against the walls, and against the nodes of the surface, all pairs that are
//! near, from the final list.

use super::nodes::Nodes;
use super::obstacles::beyond_mm;
use super::report::{Checks, NodeReport};
use super::tessellation::point;
use crate::control::Control;
use crate::export::ExportError;
use crate::geometry::cells::{Octaves, Sphere};
use crate::grain::{Grain as _, PlacedGrains};
use crate::packing::Spheres;
use crate::request::Specimen;

/// Share of the smallest diameter below which an overlap is one of rounding.
const ROUNDING: f64 = 1.0e-9;

/// Looks at all pairs; `clear` is the clearance that surface nodes ought to have, `spacing` how far apart they
/// are at least.
pub(super) fn check(
    specimen: &Specimen,
    grains: &PlacedGrains<'_>,
    nodes: &Nodes<'_>,
    [clear, spacing]: [f64; 2],
    control: &dyn Control,
    checks: &mut Checks,
    report: &mut NodeReport,
) -> Result<(), ExportError> {
    let slack = ROUNDING * nodes.d_min_mm;
    let mut all = Spheres::with_capacity(nodes.len());
    for (i, &p) in nodes.points_mm.iter().enumerate() {
        // They are sorted by diameter, and a node of none would be lost.
        let grain = i.checked_sub(nodes.boundary);
        all.push(p, grain.map_or(nodes.d_min_mm / 2.0, |grain| 2.0 * grains.grain(grain).outer_radius_mm()));
    }
    // Far enough to see the next node on the surface, too.
    let beyond = (clear + spacing).max(nodes.d_min_mm);
    let sorted = Octaves::new(&all, specimen.bounds_mm(), beyond)?;
    let mut least_spacing = f64::INFINITY;
    let mut least_clearance = f64::INFINITY;
    let of_surface = |sphere: &Sphere| (sphere.row as usize) < nodes.boundary;
    let completed = sorted.for_each_pair(
        beyond,
        |a, b| {
            let grain = |sphere: &Sphere| sphere.row as usize - nodes.boundary;
            match (of_surface(a), of_surface(b)) {
                (true, true) => {
                    least_spacing = least_spacing.min((point(a.center_mm) - point(b.center_mm)).norm());
                }
                (false, false) => {
                    checks.overlapping_grains += u64::from(grains.overlap([grain(a), grain(b)], slack));
                }
                (is_first, _) => {
                    let (node, of) = if is_first { (a, b) } else { (b, a) };
                    let clearance = beyond_mm(grains, grain(of) as u32, node.center_mm);
                    least_clearance = least_clearance.min(clearance);
                    checks.crowded_nodes += u64::from(clearance < clear - slack);
                }
            }
        },
        || !control.should_stop(),
    );
    if !completed {
        return Err(ExportError::Stopped);
    }
    let found = |least: f64| least.is_finite().then_some(least);
    report.smallest_spacing_mm = found(least_spacing);
    checks.smallest_node_clearance_mm = found(least_clearance);
    for grain in 0..grains.len() {
        let gap = grains.wall_gap_mm(grain, specimen);
        checks.grains_outside += u64::from(gap < -slack || gap.is_nan());
    }
    if checks.overlapping_grains > 0 || checks.grains_outside > 0 {
        return Err(ExportError::CheckFailed(format!(
            "T13: {} pairs of grains overlap, {} grains reach beyond the specimen",
            checks.overlapping_grains, checks.grains_outside
        )));
    }
    Ok(())
}
