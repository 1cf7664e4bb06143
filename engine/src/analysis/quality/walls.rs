//! Volume by size class in layers by the distance from the nearest wall: the wall effect of each size.
//!
//! A layer holds the points of the specimen between two distances from the nearest wall; the core holds those beyond
//! the last. The volume of the grains in each is that of spheres cut by the inner boundary of the layer, so that the
//! fractions of all layers and the core add up to the volume of the grains.

use serde::{Deserialize, Serialize};

use super::classes::{QualityClass, class_of};
use super::prism::{Prism, Section};
use super::{Counter, QualityError};
use crate::control::Control;
use crate::mix::sphere_volume;
use crate::packing::Spheres;
use crate::request::Specimen;
use crate::sorting;

/// Bounds of the layers are left out beyond this share of the distance from the walls to the middle.
const DEEPEST: f64 = 0.8;
/// Bounds of the layers are at least as far apart, relatively.
const APART: f64 = 1.2;

/// Volume near the walls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct WallFigures {
    /// The layers from the walls inwards.
    pub layers: Vec<WallLayer>,
    /// What lies further from the walls.
    pub core: WallLayer,
}

/// A layer by the distance from the nearest wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct WallLayer {
    /// Smallest distance from the nearest wall.
    pub from_mm: f64,
    /// Largest distance from the nearest wall.
    pub to_mm: f64,
    /// Volume of the layer.
    pub volume_mm3: f64,
    /// Volume of the grains of each class in the layer over that of the layer.
    pub volume_fraction: Vec<f64>,
}

/// The layers of the report: bounds at 1/2 and 3/2 of the smallest diameter and at 1/2, 1 and 3/2 of the largest.
pub(super) fn walls(
    spheres: &Spheres,
    classes: &[QualityClass],
    specimen: &Specimen,
    control: &dyn Control,
) -> Result<Option<WallFigures>, QualityError> {
    let (Some(&d_max), Some(&d_min)) = (spheres.d_mm.first(), spheres.d_mm.last()) else { return Ok(None) };
    let mut bounds: Vec<f64> = vec![d_min / 2.0, 1.5 * d_min, d_max / 2.0, d_max, 1.5 * d_max];
    sorting::ascending(&mut bounds);
    bounds.dedup_by(|next, last| *next < APART * *last);
    layers(spheres, classes, specimen, &bounds, control)
}

/// Layers with these inner bounds, as far as the specimen has room for them; `None` without walls, or where it has room
/// for none.
pub(super) fn layers(
    spheres: &Spheres,
    classes: &[QualityClass],
    specimen: &Specimen,
    bounds_mm: &[f64],
    control: &dyn Control,
) -> Result<Option<WallFigures>, QualityError> {
    let middle_mm = specimen.bounds_mm().into_iter().fold(f64::INFINITY, f64::min) / 2.0;
    let inner: Vec<(f64, Prism)> = bounds_mm
        .iter()
        .filter(|&&depth| depth <= DEEPEST * middle_mm)
        .map_while(|&depth| Some((depth, within(specimen, depth)?)))
        .collect();
    let (Some(&(core_from_mm, core)), Some(whole)) = (inner.last(), within(specimen, 0.0)) else {
        return Ok(None);
    };
    // Volumes of the grains by class further from the walls than each bound, and of all.
    let mut beyond = vec![vec![0.0; classes.len()]; inner.len()];
    let mut all = vec![0.0; classes.len()];
    let counter = Counter { control, total: spheres.len(), what: "measuring layers along the walls" };
    for (row, &d_mm) in spheres.d_mm.iter().enumerate() {
        counter.look(row)?;
        let (center, r, class) = (spheres.center(row), d_mm / 2.0, class_of(classes, d_mm));
        let volume = sphere_volume(d_mm);
        let depth = specimen.clearance_reaching_all(center, [0.0; 3]);
        all[class] += volume;
        for ((bound, prism), beyond) in inner.iter().zip(&mut beyond) {
            if depth - r >= *bound {
                beyond[class] += volume;
            } else if depth + r > *bound {
                beyond[class] += prism.common_volume(center, r);
            }
        }
    }
    let mut layers = Vec::with_capacity(inner.len());
    let (mut from_mm, mut outer, mut outside) = (0.0, whole.volume(), &all);
    for ((to_mm, prism), beyond) in inner.iter().zip(&beyond) {
        let volume_mm3 = outer - prism.volume();
        layers.push(WallLayer {
            from_mm,
            to_mm: *to_mm,
            volume_mm3,
            volume_fraction: outside
                .iter()
                .zip(beyond)
                .map(|(a, b)| ((a - b) / volume_mm3).max(0.0))
                .collect(),
        });
        (from_mm, outer, outside) = (*to_mm, prism.volume(), beyond);
    }
    let volume_mm3 = core.volume();
    let core = WallLayer {
        from_mm: core_from_mm,
        to_mm: middle_mm,
        volume_mm3,
        volume_fraction: outside.iter().map(|volume| volume / volume_mm3).collect(),
    };
    Ok(Some(WallFigures { layers, core }))
}

/// The points that are at least as far from all walls; `None` without walls.
fn within(specimen: &Specimen, depth: f64) -> Option<Prism> {
    let domain = specimen.domain();
    if !domain.has_walls() {
        return None;
    }
    let [x, y, z] = domain.bounds_mm;
    let section = match domain.lateral() {
        None => Section::Rectangle { low: [depth; 2], high: [x - depth, y - depth] },
        Some(lateral) => Section::Disc { center: lateral.center_mm, radius: lateral.radius_mm - depth },
    };
    Some(Prism { section, low: depth, high: z - depth })
}
