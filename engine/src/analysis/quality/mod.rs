//! Whether a packing is random: how sizes, contacts, walls and directions are distributed, each beside what chance
//! would give.
//!
//! No single figure proves that a packing is random (Torquato, Truskett and Debenedetti, Physical Review Letters 84,
//! 2000, [10.1103/PhysRevLett.84.2064](https://doi.org/10.1103/PhysRevLett.84.2064)). These are the figures by which
//! crystals, sorted sizes and sizes that gather at walls are found: [`contacts`] has those of pairs of grains,
//! [`order`] those of directions, [`walls`] and [`blocks`] those of volumes by size class. Lengths and classes follow
//! from the grains alone and are stated in the report, so that packings of one mix can be compared. Nothing is drawn at
//! random: where there are many grains, some are looked at, at equal steps of the grains by descending diameter.

pub mod blocks;
pub mod classes;
pub mod contacts;
mod near;
pub mod order;
mod prism;
pub mod walls;

use serde::{Deserialize, Serialize};

pub use blocks::BlockFigures;
pub use classes::QualityClass;
pub use contacts::{ContactFigures, GapFigures};
pub use order::BondOrder;
pub use walls::{WallFigures, WallLayer};

use crate::control::{Control, Part, Progress, Step};
use crate::memory::OutOfMemory;
use crate::packing::{GrainsRef, Spheres};
use crate::request::Specimen;

/// Grains between two looks at whether to stop: about a millisecond.
const GRAINS_PER_LOOK: usize = 512;
/// Looks between two reports of progress.
const LOOKS_PER_REPORT: usize = 16;

/// The quality of a packing. Lists by size class are in the order of `classes`, from fine to coarse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QualityReport {
    /// Number of grains.
    pub grains: u64,
    /// Smallest equivalent diameter.
    pub d_min_mm: f64,
    /// Largest equivalent diameter.
    pub d_max_mm: f64,
    /// Thirds of the volume of the grains by size, from fine to coarse; fewer where the grains have fewer diameters.
    pub classes: Vec<QualityClass>,
    /// Gaps to the nearest grain; `null` with fewer than two grains, and for shaped grains.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub gaps: Option<GapFigures>,
    /// Pairs of near grains; `null` where no pair is near, and for shaped grains.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub contacts: Option<ContactFigures>,
    /// Bond order of neighbours of like size; `null` where there are none, and for shaped grains.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub bond_order: Option<BondOrder>,
    /// Volume by size class near the walls; `null` for a periodic box, and where the specimen is too small.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub walls: Option<WallFigures>,
    /// Volume by size class in blocks of the specimen; `null` where it has fewer than eight blocks, or the grains have
    /// one diameter.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub blocks: Option<BlockFigures>,
}

/// Why there is no report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QualityError {
    /// It was told to stop.
    #[error("stopped")]
    Stopped,
    /// The system refused memory.
    #[error(transparent)]
    OutOfMemory(#[from] OutOfMemory),
}

impl From<QualityError> for std::io::Error {
    fn from(error: QualityError) -> Self {
        match error {
            QualityError::Stopped => std::io::ErrorKind::Interrupted.into(),
            QualityError::OutOfMemory(error) => error.into(),
        }
    }
}

/// Measures a packing. Shaped grains count as spheres of equal volume about their centres near walls and
/// in blocks, where a grain may thus reach a little beyond a wall; their pairs are not measured.
///
/// # Errors
/// [`QualityError`].
pub fn quality<'a>(
    grains: impl Into<GrainsRef<'a>>,
    specimen: &Specimen,
    control: &dyn Control,
) -> Result<QualityReport, QualityError> {
    let grains = grains.into();
    let spheres = descending(grains)?;
    let classes = classes::classes(&spheres.d_mm);
    let part = |from: f64, to: f64| Part::new(control, from, to);
    let mut report = QualityReport {
        grains: spheres.len() as u64,
        d_min_mm: spheres.d_mm.last().copied().unwrap_or(0.0),
        d_max_mm: spheres.d_mm.first().copied().unwrap_or(0.0),
        gaps: None,
        contacts: None,
        bond_order: None,
        walls: walls::walls(&spheres, &classes, specimen, &part(0.0, 0.1))?,
        blocks: blocks::blocks(&spheres, &classes, specimen, &part(0.1, 0.2))?,
        classes,
    };
    if grains.spheres().is_some() && spheres.len() > 1 {
        let near = near::Near::new(&spheres, specimen)?;
        report.gaps = contacts::gaps(&near, &part(0.25, 0.45))?;
        if let Some(gaps) = &report.gaps {
            let smallest_mm = gaps.smallest_mm;
            report.contacts = contacts::contacts(&near, &report.classes, smallest_mm, &part(0.45, 0.75))?;
            report.bond_order = order::bond_order(&near, specimen, smallest_mm, &part(0.75, 1.0))?;
        }
    }
    Counter { control, total: 1, what: "" }.report(1);
    Ok(report)
}

/// Volumes by the size classes of [`quality`] in layers along the walls with these inner bounds, in ascending order, as
/// far as the specimen has room for them; `None` without walls, or where it has room for none.
///
/// # Errors
/// [`QualityError`].
pub fn wall_layers<'a>(
    grains: impl Into<GrainsRef<'a>>,
    specimen: &Specimen,
    bounds_mm: &[f64],
    control: &dyn Control,
) -> Result<Option<WallFigures>, QualityError> {
    let spheres = descending(grains.into())?;
    walls::layers(&spheres, &classes::classes(&spheres.d_mm), specimen, bounds_mm, control)
}

/// The grains as spheres of equal volume, from the largest down. Equivalent diameters of a result may be out of order
/// by rounding.
fn descending(grains: GrainsRef<'_>) -> Result<Spheres, OutOfMemory> {
    let mut order: Vec<u32> = crate::memory::collected(0..grains.len() as u32)?;
    order.sort_by(|&i, &j| grains.d_mm(j as usize).total_cmp(&grains.d_mm(i as usize)));
    let mut spheres = Spheres::default();
    for column in [&mut spheres.x_mm, &mut spheres.y_mm, &mut spheres.z_mm, &mut spheres.d_mm] {
        *column = crate::memory::reserved(order.len())?;
    }
    for grain in order {
        spheres.push(grains.center_mm(grain as usize), grains.d_mm(grain as usize));
    }
    Ok(spheres)
}

/// At most `most` of so many grains, at equal steps.
fn evenly(grains: usize, most: usize) -> impl ExactSizeIterator<Item = usize> {
    let chosen = grains.min(most);
    (0..chosen).map(move |i| i * grains / chosen)
}

/// Progress of a piece of work that counts grains.
struct Counter<'a> {
    control: &'a dyn Control,
    total: usize,
    /// What is measured.
    what: &'static str,
}

impl Counter<'_> {
    /// Asks whether to go on where it is due, and reports now and then.
    fn look(&self, done: usize) -> Result<(), QualityError> {
        if !done.is_multiple_of(GRAINS_PER_LOOK) {
            return Ok(());
        }
        if done.is_multiple_of(GRAINS_PER_LOOK * LOOKS_PER_REPORT) {
            self.report(done);
        }
        if self.control.should_stop() { Err(QualityError::Stopped) } else { Ok(()) }
    }

    fn report(&self, done: usize) {
        self.control.report(&Progress::counted(Step::Export, done, self.total, "grains", self.what));
    }
}

/// A sum with its sum of squares, by weight.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64, weight: f64) {
        self.weight += weight;
        self.sum += weight * value;
        self.squares += weight * value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.weight
    }

    fn variance(&self) -> f64 {
        (self.squares / self.weight - self.mean().powi(2)).max(0.0)
    }
}

/// Pearson's correlation of pairs; `None` where one of the two does not vary.
fn correlation(pairs: &(impl Iterator<Item = [f64; 2]> + Clone)) -> Option<f64> {
    let (mut x, mut y) = (Moments::default(), Moments::default());
    for pair in pairs.clone() {
        x.add(pair[0], 1.0);
        y.add(pair[1], 1.0);
    }
    let (mean_x, mean_y) = (x.mean(), y.mean());
    let sum = |f: &dyn Fn([f64; 2]) -> f64| pairs.clone().map(f).sum::<f64>();
    let xx = sum(&|[x, _]| (x - mean_x).powi(2));
    let yy = sum(&|[_, y]| (y - mean_y).powi(2));
    let spread = (xx * yy).sqrt();
    let of_rounding = 1.0e-12 * x.weight * (mean_x * mean_y).abs();
    (spread > of_rounding).then(|| sum(&|[x, y]| (x - mean_x) * (y - mean_y)) / spread)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
