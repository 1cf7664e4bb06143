//! Size sampling: from a grading to the diameters of one packing (`docs/method.md`, section 1).
//!
//! A grading becomes a list of classes, each with a distribution of diameters in closed form ([`class`]); the cut-off
//! splits the class it falls into; diameters are sampled class by class from the coarsest down ([`sampling`]). How far
//! whole grains miss the requested volumes is judged in `deviation`.

pub mod class;
pub(crate) mod deviation;
pub mod sampling;
pub mod sieve;

use crate::request::{Grading, Mix, VolumeFractionOf, standard};
use class::{Class, Law};
pub use deviation::MAX_DEVIATION;

/// Narrow classes per octave of diameter into which every curve is split, so that the few largest
/// grains follow it too and the total misses by less than one of the smallest.
const CLASSES_PER_OCTAVE: f64 = 12.0;

/// Diameters that stand for a narrow class where a whole law would be too much.
const QUANTILES: usize = 8;

/// Sizes that stand for an explicit list.
const LIST_SIZES: f64 = 1000.0;

/// A mix resolved against a specimen's volume.
#[derive(Clone, Debug, PartialEq)]
pub struct GradedMix {
    /// Sieve classes above the cut-off, from fine to coarse: the bins of reports and of the check.
    pub sieve_classes: Vec<Class>,
    /// The same, split into narrow classes as they are drawn; empty for an explicit list.
    pub classes: Vec<Class>,
    /// The explicit list of diameters, in mm, where the grading is one, cut off and sorted from
    /// the coarsest down.
    pub list: Option<Vec<f64>>,
    /// Volume of all aggregate over that of the specimen (`phi_M`).
    pub volume_fraction_mixture: f64,
    /// Volume of the grains to place over that of the specimen (`phi_eff`).
    pub volume_fraction_effective: f64,
    /// Smallest diameter that can occur.
    pub d_min_mm: f64,
    /// Largest diameter that can occur.
    pub d_max_mm: f64,
    /// Volume of the specimen.
    pub specimen_volume_mm3: f64,
}

/// Volume of a sphere of diameter `d`, in the cube of the unit of `d`.
pub fn sphere_volume(d: f64) -> f64 {
    std::f64::consts::FRAC_PI_6 * d * d * d
}

impl GradedMix {
    /// Resolves a mix whose fields were checked by [`crate::request`].
    pub fn new(mix: &Mix, specimen_volume_mm3: f64) -> Self {
        if let Grading::Diameters { diameters_mm: mm } = &mix.grading {
            return Self::from_list(mm, mix.d_min_mm, specimen_volume_mm3);
        }
        let d_min = mix.d_min_mm.unwrap_or(0.0);
        let sieve_classes = classes_above(&mix.grading, d_min);
        let classes: Vec<Class> = sieve_classes.iter().flat_map(Class::narrow).collect();
        let kept: f64 = classes.iter().map(|c| c.mass_fraction).sum();
        let requested = mix.requested_fraction().unwrap_or(0.0);
        let (mixture, effective) = match mix.volume_fraction_of {
            VolumeFractionOf::AllAggregate => (requested, requested * kept),
            VolumeFractionOf::PlacedGrains => (requested / kept, requested),
        };
        let d_min_mm = classes.first().map_or(0.0, |c| c.low_mm);
        let d_max_mm = classes.last().map_or(0.0, |c| c.high_mm);
        Self {
            sieve_classes,
            classes,
            list: None,
            volume_fraction_mixture: mixture,
            volume_fraction_effective: effective,
            d_min_mm,
            d_max_mm,
            specimen_volume_mm3,
        }
    }

    fn from_list(mm: &[f64], d_min: Option<f64>, specimen_volume_mm3: f64) -> Self {
        let all: f64 = mm.iter().map(|&d| sphere_volume(d)).sum();
        let mut list: Vec<f64> = mm.iter().copied().filter(|&d| d_min.is_none_or(|m| d >= m)).collect();
        list.sort_unstable_by(|a, b| b.total_cmp(a));
        let kept: f64 = list.iter().map(|&d| sphere_volume(d)).sum();
        let d_min_mm = list.last().copied().unwrap_or(0.0);
        let d_max_mm = list.first().copied().unwrap_or(0.0);
        Self {
            sieve_classes: sieve::between(d_min_mm, d_max_mm, Law::Single),
            classes: Vec::new(),
            volume_fraction_mixture: all / specimen_volume_mm3,
            volume_fraction_effective: kept / specimen_volume_mm3,
            d_min_mm,
            d_max_mm,
            list: Some(list),
            specimen_volume_mm3,
        }
    }

    /// Volume that a class is to fill (`V_i` of `docs/method.md`, section 1).
    pub fn class_volume_mm3(&self, class: &Class) -> f64 {
        class.mass_fraction * self.volume_fraction_mixture * self.specimen_volume_mm3
    }

    /// Expected number of grains, in closed form; of an explicit list, its length.
    pub fn expected_grains(&self) -> f64 {
        self.expected_sum(Class::grains_per_volume, |_| 1.0)
    }

    /// Expected sum over all grains of the volume of a sphere of diameter `factor d + offset`.
    pub fn expected_enlarged_volume_mm3(&self, factor: f64, offset: f64) -> f64 {
        let enlarged = |d: f64| sphere_volume(factor * d + offset);
        self.expected_sum(|c| c.mean_of(&enlarged) * c.grains_per_volume(), enlarged)
    }

    /// Diameters with the expected number of grains of each, from fine to coarse: quantiles of every
    /// class, or those of an explicit list, many of which are taken together.
    pub fn expected_sizes(&self) -> Vec<(f64, f64)> {
        if let Some(list) = &self.list {
            return sizes_of_list(list);
        }
        let mut sizes = Vec::with_capacity(self.classes.len() * QUANTILES);
        for class in &self.classes {
            let number = self.class_volume_mm3(class) * class.grains_per_volume() / QUANTILES as f64;
            let quantile = |k: usize| class.diameter((k as f64 + 0.5) / QUANTILES as f64);
            sizes.extend((0..QUANTILES).map(|k| (quantile(k), number)));
        }
        sizes
    }

    fn expected_sum(&self, per_volume: impl Fn(&Class) -> f64, of_grain: impl Fn(f64) -> f64) -> f64 {
        match &self.list {
            Some(list) => list.iter().map(|&d| of_grain(d)).sum(),
            None => self.classes.iter().map(|c| self.class_volume_mm3(c) * per_volume(c)).sum(),
        }
    }
}

/// A list from the coarsest down as diameters with numbers from fine to coarse: grains within a
/// [`LIST_SIZES`]th of the range, on a logarithmic scale, as so many of their mean volume.
fn sizes_of_list(list: &[f64]) -> Vec<(f64, f64)> {
    let (Some(&largest), Some(&least)) = (list.first(), list.last()) else { return Vec::new() };
    let step = ((largest / least).ln() / LIST_SIZES).max(f64::MIN_POSITIVE);
    let mut sizes: Vec<(f64, f64)> = Vec::new();
    let mut bin = -1.0;
    for &d in list.iter().rev() {
        let of = ((d / least).ln() / step).floor();
        match sizes.last_mut() {
            Some((cubes, number)) if of == bin => (*cubes, *number) = (*cubes + d.powi(3), *number + 1.0),
            _ => sizes.push((d.powi(3), 1.0)),
        }
        bin = of;
    }
    for (size, number) in &mut sizes {
        *size = (*size / *number).cbrt();
    }
    sizes
}

/// The classes of a grading above the cut-off, from fine to coarse.
fn classes_above(grading: &Grading, d_min: f64) -> Vec<Class> {
    match grading {
        Grading::Standard { name } => piecewise(standard::points(*name), d_min),
        Grading::Sieves { points } => piecewise(points, d_min),
        Grading::Fuller { d_max_mm, exponent } => fuller(*d_max_mm, *exponent, d_min),
        Grading::Classes { classes } => classes
            .iter()
            .filter_map(|c| {
                Class {
                    law: Law::LogUniform,
                    low_mm: c.d_min_mm,
                    high_mm: c.d_max_mm,
                    mass_fraction: c.mass_fraction,
                }
                .above(d_min)
            })
            .collect(),
        Grading::Monodisperse { diameter_mm } => {
            vec![Class { law: Law::Single, low_mm: *diameter_mm, high_mm: *diameter_mm, mass_fraction: 1.0 }]
        }
        Grading::Diameters { .. } => Vec::new(),
    }
}

fn piecewise(points: &[[f64; 2]], d_min: f64) -> Vec<Class> {
    points
        .windows(2)
        .filter_map(|pair| {
            let [[low_mm, below], [high_mm, above]] = [pair[0], pair[1]];
            let class = Class { law: Law::LogUniform, low_mm, high_mm, mass_fraction: above - below };
            if class.mass_fraction > 0.0 { class.above(d_min) } else { None }
        })
        .collect()
}

/// Fuller's curve between the standard sieves.
fn fuller(d_max: f64, exponent: f64, d_min: f64) -> Vec<Class> {
    let passing = |d: f64| (d / d_max).powf(exponent);
    let mut classes = sieve::between(d_min, d_max, Law::Fuller { exponent });
    for class in &mut classes {
        class.mass_fraction = passing(class.high_mm) - passing(class.low_mm);
    }
    classes
}

#[cfg(test)]
mod tests;
