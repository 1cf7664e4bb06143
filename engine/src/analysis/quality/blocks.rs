//! Composition in blocks: whether fine and coarse grains are spread over the specimen as chance spreads them.
//!
//! The specimen is divided into equal blocks about as long as the largest diameter or longer. With the volumes `F` of
//! the finest class and `C` of all coarser classes in a block of the volume `V`, `f = V - C` is what the coarser grains
//! leave. If fine grains were independent points that fill what the coarser leave, `F` would have the variance
//!
//! `rho^2 var(f) + mean over the blocks of sum v_i^2`,  `rho = sum F / sum f`,
//!
//! with the volume `v_i` of fine grain `i` in the block: the first term is that of the place left, the second that of
//! Poisson's law for the number of grains (Illian, Penttinen, Stoyan and Stoyan, Statistical Analysis and Modelling of
//! Spatial Point Patterns, 2008, [10.1002/9780470725160](https://doi.org/10.1002/9780470725160), chapter 2). Grains
//! that exclude one another vary less than points. More than that is a sorting of sizes.

use serde::{Deserialize, Serialize};

use super::classes::{QualityClass, class_of};
use super::prism::{Prism, Section};
use super::{Counter, Moments, QualityError, correlation};
use crate::arrays::{self, Each as _};
use crate::control::Control;
use crate::memory::filled;
use crate::packing::Spheres;
use crate::request::Specimen;

/// Blocks along an axis at most.
const MOST_ALONG: usize = 24;
/// Fewer blocks tell nothing.
const FEWEST: usize = 8;

/// Composition in blocks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BlockFigures {
    /// Number of blocks; of a cylinder those that lie wholly within it.
    pub blocks: u64,
    /// Edges of a block along x, y and z.
    pub edge_mm: [f64; 3],
    /// Volume of the finest class over that of the block: mean of the blocks.
    pub fine_fraction_mean: f64,
    /// Standard deviation over the mean of the volume of the finest class in a block.
    pub fine_variation: f64,
    /// The same if fine grains filled what the coarser leave, independently of one another.
    pub fine_variation_independent: f64,
    /// Correlation of the volumes of the finest class and of the coarsest over the blocks; `null` where one does not
    /// vary.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub fine_coarse_correlation: Option<f64>,
    /// The same if fine grains filled what the coarser leave, independently of one another.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub fine_coarse_correlation_independent: Option<f64>,
}

/// Measures the blocks; `None` with fewer than eight, or with one class.
pub(super) fn blocks(
    spheres: &Spheres,
    classes: &[QualityClass],
    specimen: &Specimen,
    control: &dyn Control,
) -> Result<Option<BlockFigures>, QualityError> {
    let (Some(&d_max), 2..) = (spheres.d_mm.first(), classes.len()) else { return Ok(None) };
    let grid = Grid::new(specimen, d_max);
    let chosen: Vec<usize> = (0..grid.count()).filter(|&block| grid.lies_within(block, specimen)).collect();
    if chosen.len() < FEWEST {
        return Ok(None);
    }
    let coarsest = classes.len() - 1;
    // Of each block the volumes by class, and the sum of the squares of the volumes of fine grains.
    let mut volumes = filled(grid.count(), [0.0_f64; 3])?;
    let mut squares = filled(grid.count(), 0.0_f64)?;
    let counter = Counter { control, total: spheres.len(), what: "measuring blocks" };
    for (row, &d_mm) in spheres.d_mm.iter().enumerate() {
        counter.look(row)?;
        let class = class_of(classes, d_mm);
        grid.for_each_part(spheres.center(row), d_mm / 2.0, |block, volume| {
            volumes[block][class] += volume;
            if class == 0 {
                squares[block] += volume * volume;
            }
        });
    }
    let block_mm3: f64 = grid.edge_mm.iter().product();
    let (mut fine, mut left, mut coarse, mut square) =
        (Moments::default(), Moments::default(), Moments::default(), 0.0);
    let left_of = |[_, middle, coarse]: [f64; 3]| block_mm3 - middle - coarse;
    for &block in &chosen {
        let of_block = volumes[block];
        fine.add(of_block[0], 1.0);
        left.add(left_of(of_block), 1.0);
        coarse.add(of_block[coarsest], 1.0);
        square += squares[block];
    }
    if fine.mean() <= 0.0 || left.mean() <= 0.0 {
        return Ok(None);
    }
    let filling = fine.mean() / left.mean();
    let independent = (filling.powi(2) * left.variance() + square / chosen.len() as f64).sqrt();
    let pairs = |f: fn([f64; 3], f64) -> f64| {
        let volumes = &volumes;
        chosen.iter().map(move |&block| [f(volumes[block], block_mm3), volumes[block][coarsest]])
    };
    let of_left = correlation(&pairs(|[_, middle, coarse], all| all - middle - coarse));
    Ok(Some(BlockFigures {
        blocks: chosen.len() as u64,
        edge_mm: grid.edge_mm,
        fine_fraction_mean: fine.mean() / block_mm3,
        fine_variation: fine.variance().sqrt() / fine.mean(),
        fine_variation_independent: independent / fine.mean(),
        fine_coarse_correlation: correlation(&pairs(|of_block, _| of_block[0])),
        fine_coarse_correlation_independent: of_left
            .filter(|_| independent > 0.0)
            .map(|of_left| of_left * filling * left.variance().sqrt() / independent),
    }))
}

/// Equal blocks of the box around the specimen.
struct Grid {
    counts: [usize; 3],
    edge_mm: [f64; 3],
    is_periodic: bool,
}

impl Grid {
    fn new(specimen: &Specimen, least_mm: f64) -> Self {
        let bounds = specimen.bounds_mm();
        // Edges that divide the specimen come out whole in spite of rounding.
        let counts =
            bounds.each(|length| ((length / least_mm * (1.0 + 1.0e-9)) as usize).clamp(1, MOST_ALONG));
        Self {
            counts,
            edge_mm: arrays::from_fn(|a| bounds[a] / counts[a] as f64),
            is_periodic: specimen.is_periodic(),
        }
    }

    fn count(&self) -> usize {
        self.counts.iter().product()
    }

    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    fn lies_within(&self, block: usize, specimen: &Specimen) -> bool {
        let at = [
            block % self.counts[0],
            block / self.counts[0] % self.counts[1],
            block / (self.counts[0] * self.counts[1]),
        ];
        let half = self.edge_mm.each(|edge| edge / 2.0);
        let center = arrays::from_fn(|a| (at[a] as f64 + 0.5) * self.edge_mm[a]);
        specimen.clearance_reaching_all(center, half) >= -1.0e-9 * self.edge_mm[0]
    }

    /// Calls `visit` with every block that a sphere lies in, and with the volume of it that lies there; what lies
    /// beyond walls is in no block.
    fn for_each_part(&self, center: [f64; 3], r: f64, mut visit: impl FnMut(usize, f64)) {
        let span = |a: usize| {
            let index = |x: f64| (x / self.edge_mm[a]).floor() as i64;
            let (low, high) = (index(center[a] - r), index(center[a] + r));
            if self.is_periodic { low..=high } else { low.max(0)..=high.min(self.counts[a] as i64 - 1) }
        };
        for k in span(2) {
            for j in span(1) {
                for i in span(0) {
                    let low: [f64; 3] = arrays::from_fn(|a| [i, j, k][a] as f64 * self.edge_mm[a]);
                    let high: [f64; 3] = arrays::from_fn(|a| low[a] + self.edge_mm[a]);
                    let prism = Prism {
                        section: Section::Rectangle { low: [low[0], low[1]], high: [high[0], high[1]] },
                        low: low[2],
                        high: high[2],
                    };
                    let volume = prism.common_volume(center, r);
                    if volume > 0.0 {
                        let block: [usize; 3] =
                            arrays::from_fn(|a| [i, j, k][a].rem_euclid(self.counts[a] as i64) as usize);
                        visit(self.number(block), volume);
                    }
                }
            }
        }
    }
}
