//! What stands close to a grain: other grains, looked up by cells of the octave of their diameters.
//!
//! It knows centres and radii; it must never know what is made of them.

use crate::geometry::cells::Octaves;
use crate::memory::OutOfMemory;
use crate::packing::Spheres;

/// The grains of a packing, by octave and cell.
#[derive(Debug)]
pub(super) struct Near {
    octaves: Octaves,
}

impl Near {
    /// Sorts the grains; they lie between 0 and `bounds`.
    pub(super) fn new(spheres: &Spheres, bounds: [f64; 3]) -> Result<Self, OutOfMemory> {
        Ok(Self { octaves: Octaves::new(spheres, bounds, 0.0)? })
    }

    /// Calls `visit(row, gap)` for every grain but `own` that stands within `reach_mm` of a sphere.
    pub(super) fn for_each(
        &self,
        own: Option<usize>,
        center: [f64; 3],
        radius: f64,
        reach_mm: f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        self.octaves.for_each_near(center, radius, reach_mm, |other| {
            let distance2 = super::surface::distance2(center, other.center_mm);
            let touch = radius + other.d_mm / 2.0;
            if distance2 < (touch + reach_mm).powi(2) && Some(other.row as usize) != own {
                visit(other.row as usize, distance2.sqrt() - touch);
            }
        });
    }
}
