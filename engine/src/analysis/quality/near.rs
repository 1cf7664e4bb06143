//! The spheres near a sphere, also through the faces of a periodic box.

use crate::arrays;
use crate::geometry::cells::Octaves;
use crate::geometry::images::Images;
use crate::memory::OutOfMemory;
use crate::packing::Spheres;
use crate::request::Specimen;

/// A sphere near another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbor {
    /// Its row.
    pub(super) row: usize,
    /// From the centre of the other to its own.
    pub(super) step_mm: [f64; 3],
    /// Length of the step.
    pub(super) distance_mm: f64,
    /// Gap of the surfaces.
    pub(super) gap_mm: f64,
}

/// Spheres in descending order, sorted for searches.
pub(super) struct Near<'a> {
    pub(super) spheres: &'a Spheres,
    octaves: Octaves,
    bounds_mm: [f64; 3],
    images: Images,
}

impl<'a> Near<'a> {
    pub(super) fn new(spheres: &'a Spheres, specimen: &Specimen) -> Result<Self, OutOfMemory> {
        let bounds_mm = specimen.bounds_mm();
        Ok(Self {
            spheres,
            octaves: Octaves::new(spheres, bounds_mm, 0.0)?,
            bounds_mm,
            images: Images::new(specimen),
        })
    }

    /// Calls `visit` with every other sphere whose gap to this one is at most `reach_mm`. In a periodic box a sphere
    /// that is near through two faces is visited twice.
    pub(super) fn for_each(&self, row: usize, reach_mm: f64, mut visit: impl FnMut(Neighbor)) {
        let center = self.spheres.center(row);
        let radius_mm = self.spheres.d_mm[row] / 2.0;
        let far_mm = radius_mm + self.spheres.d_mm[0] / 2.0 + reach_mm;
        for image in self.images.meeting_box(center, [far_mm; 3]) {
            let image: [f64; 3] = arrays::from_fn(|a| center[a] + image.offset_mm[a]);
            self.octaves.for_each_near(image, radius_mm, reach_mm, |other| {
                let step_mm: [f64; 3] = arrays::from_fn(|a| other.center_mm[a] - image[a]);
                let distance_mm = step_mm.iter().map(|x| x * x).sum::<f64>().sqrt();
                let gap_mm = distance_mm - radius_mm - other.d_mm / 2.0;
                let other = other.row as usize;
                if gap_mm <= reach_mm && other != row {
                    visit(Neighbor { row: other, step_mm, distance_mm, gap_mm });
                }
            });
        }
    }

    /// Gap to the nearest other sphere; `None` where there is none.
    pub(super) fn nearest_gap_mm(&self, row: usize) -> Option<f64> {
        let diagonal_mm = self.bounds_mm.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mut reach_mm = self.spheres.d_mm.last()? / 64.0;
        loop {
            let mut nearest = f64::INFINITY;
            self.for_each(row, reach_mm, |other| nearest = nearest.min(other.gap_mm));
            if nearest.is_finite() {
                return Some(nearest);
            }
            if reach_mm > diagonal_mm {
                return None;
            }
            reach_mm *= 2.0;
        }
    }
}
