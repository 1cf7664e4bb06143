//! Check T13: grains against one another, against the walls, and against the nodes of the surface, all pairs that are
//! near, from the final list.

use super::nodes::Nodes;
use super::report::{Checks, NodeReport};
use super::tessellation::point;
use crate::control::Control;
use crate::export::{ExportError, SphereModel};
use crate::geometry::cells::{Octaves, Sphere};
use crate::packing::Spheres;

/// Share of the smallest diameter below which an overlap is one of rounding.
const ROUNDING: f64 = 1.0e-9;

/// Looks at all pairs; `clear` is the clearance that surface nodes ought to have, `spacing` how far apart they
/// are at least.
pub(super) fn check(
    model: &SphereModel<'_>,
    nodes: &Nodes,
    [clear, spacing]: [f64; 2],
    control: &dyn Control,
    checks: &mut Checks,
    report: &mut NodeReport,
) -> Result<(), ExportError> {
    let slack = ROUNDING * nodes.d_min_mm;
    let mut all = Spheres::with_capacity(nodes.len());
    for (i, &p) in nodes.points_mm.iter().enumerate() {
        // They are sorted by diameter, and a node of none would be lost.
        all.push(p, if i < nodes.boundary { nodes.d_min_mm / 2.0 } else { nodes.diameter_mm(i) });
    }
    // Far enough to see the next node on the surface, too.
    let beyond = (clear + spacing).max(nodes.d_min_mm);
    let sorted = Octaves::new(&all, model.specimen.bounds_mm(), beyond)?;
    let mut least_spacing = f64::INFINITY;
    let mut least_clearance = f64::INFINITY;
    let of_surface = |sphere: &Sphere| (sphere.row as usize) < nodes.boundary;
    let completed = sorted.for_each_pair(
        beyond,
        |a, b| {
            let distance = (point(a.center_mm) - point(b.center_mm)).norm();
            match (of_surface(a), of_surface(b)) {
                (true, true) => least_spacing = least_spacing.min(distance),
                (false, false) => {
                    checks.overlapping_grains += u64::from(distance < (a.d_mm + b.d_mm) / 2.0 - slack);
                }
                (is_first, _) => {
                    let clearance = distance - if is_first { b.d_mm } else { a.d_mm } / 2.0;
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
    for i in nodes.boundary..nodes.len() {
        let clearance = model.specimen.clearance_reaching_all(nodes.points_mm[i], [0.0; 3]);
        let beyond = clearance < nodes.radii_mm[i] - slack;
        checks.grains_outside += u64::from(beyond || clearance.is_nan());
    }
    if checks.overlapping_grains > 0 || checks.grains_outside > 0 {
        return Err(ExportError::CheckFailed(format!(
            "T13: {} pairs of grains overlap, {} grains reach beyond the specimen",
            checks.overlapping_grains, checks.grains_outside
        )));
    }
    Ok(())
}
