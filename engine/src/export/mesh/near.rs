//! What stands close to a grain: other grains, looked up by cells of the octave of their diameters.
//! Gaps are those of the spheres around the grains.

use crate::geometry::cells::Octaves;
use crate::memory::OutOfMemory;
use crate::packing::Spheres;

use super::bodies::Bodies;

/// The grains of a packing, by octave and cell.
#[derive(Debug)]
pub(super) struct Near {
    octaves: Octaves,
}

impl Near {
    /// Sorts the grains; they lie between 0 and `bounds`.
    pub(super) fn new(bodies: &Bodies<'_>, bounds: [f64; 3]) -> Result<Self, OutOfMemory> {
        let mut around = Spheres::default();
        let spheres = if let Some(spheres) = bodies.spheres() {
            spheres
        } else {
            (0..bodies.len()).for_each(|row| around.push(bodies.center(row), 2.0 * bodies.outer(row)));
            &around
        };
        Ok(Self { octaves: Octaves::new(spheres, bounds, 0.0)? })
    }

    /// Calls `visit(row, gap)` for every grain but `own` whose sphere around stands within `reach_mm` of a
    /// sphere, with the gap between these two.
    pub(super) fn for_each(
        &self,
        own: Option<usize>,
        center: [f64; 3],
        radius: f64,
        reach_mm: f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        self.octaves.for_each_near(center, radius, reach_mm, |other| {
            let distance2 = crate::gap::linear::distance2(center, other.center_mm);
            let touch = radius + other.d_mm / 2.0;
            if distance2 < (touch + reach_mm).powi(2) && Some(other.row as usize) != own {
                visit(other.row as usize, distance2.sqrt() - touch);
            }
        });
    }
}
