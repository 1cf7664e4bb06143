//! Thirds of the volume by size.

use serde::{Deserialize, Serialize};

use crate::mix::sphere_volume;

/// Size classes at most: fine, middle and coarse.
const CLASSES: usize = 3;

/// A size class: the grains of about a third of the volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QualityClass {
    /// Its smallest equivalent diameter.
    pub d_min_mm: f64,
    /// Its largest equivalent diameter.
    pub d_max_mm: f64,
    /// Number of its grains.
    pub grains: u64,
    /// Its share of the volume of all grains.
    pub volume_share: f64,
}

/// The classes of diameters that come in descending order, from fine to coarse. Grains of one diameter share a class:
/// that in which the middle of their volume lies.
pub(super) fn classes(descending_mm: &[f64]) -> Vec<QualityClass> {
    let all: f64 = descending_mm.iter().map(|&d| sphere_volume(d)).sum();
    let mut classes: [Option<QualityClass>; CLASSES] = [None; CLASSES];
    let mut finer = 0.0;
    for equal in descending_mm.chunk_by(|a, b| a == b).rev() {
        let d_mm = equal[0];
        let own = sphere_volume(d_mm) / all * equal.len() as f64;
        let middle = finer + own / 2.0;
        finer += own;
        let class = ((middle * CLASSES as f64) as usize).min(CLASSES - 1);
        let class = classes[class].get_or_insert(QualityClass {
            d_min_mm: d_mm,
            d_max_mm: d_mm,
            grains: 0,
            volume_share: 0.0,
        });
        class.d_max_mm = d_mm;
        class.grains += equal.len() as u64;
        class.volume_share += own;
    }
    classes.into_iter().flatten().collect()
}

/// The class of a diameter, counted from the finest.
pub(super) fn class_of(classes: &[QualityClass], d_mm: f64) -> usize {
    classes.iter().position(|class| d_mm <= class.d_max_mm).unwrap_or(classes.len().saturating_sub(1))
}
