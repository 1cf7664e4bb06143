//! Size sampling: from a grading to the diameters of one packing (`docs/method.md`, section 1).
//!
//! A grading becomes a list of classes, each with a distribution of diameters in closed form ([`class`]); the cut-off
//! splits the class it falls into; diameters are sampled class by class from the coarsest down ([`sampling`]). How far
//! whole grains miss the requested volumes is judged in `deviation`. Of shaped grains, the shape of each is
//! drawn independently of its size ([`shapes`]), its volume counts toward the class, and its orientation is drawn when
//! it is inserted ([`draw_orientation`]).

pub mod class;
mod curve;
pub(crate) mod deviation;
mod distribution;
mod figures;
pub mod orientation;
mod packing_model;
pub mod sampling;
pub mod shapes;
pub mod sieve;
mod templates;

use crate::elementary::{cbrt, ln, powf};
use crate::request::{Form, GrainKind, Mix, VolumeFractionOf};
use crate::sorting;
use class::{Class, Law};
pub use curve::curve;
pub use deviation::MAX_DEVIATION;
pub use figures::{FINES_MM, GradingFigures, PasteFigures, figures};
pub(crate) use figures::{Passing, figures_in_specimen};
pub use orientation::{draw_orientation, uniform_orientation};
pub(crate) use shapes::MeanForm;
pub use shapes::ShapeSampler;

pub use crate::shape::sphere_volume;

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
    /// Sieve classes above the cut-off, part by part, in each from fine to coarse.
    pub sieve_classes: Vec<Class>,
    /// The same, split into narrow classes as they are drawn; empty for an explicit list.
    pub classes: Vec<Class>,
    /// Number of parts: aggregates, or 1.
    pub parts: u16,
    /// Whether the parts are aggregates, so that grains are told apart by them.
    pub has_aggregates: bool,
    /// Number of grains of each class, where the mix counts its grains; else empty.
    pub numbers: Vec<u64>,
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
    /// The shapes of the grains; none where all are spheres. Diameters are then sieve sizes or equivalent diameters.
    pub shapes: Option<ShapeSampler>,
}

impl GradedMix {
    /// Resolves a mix whose fields were checked by [`crate::request`].
    pub fn new(mix: &Mix, specimen_volume_mm3: f64) -> Self {
        if let Some(mm) = mix.listed_diameters_mm() {
            return Self::from_list(mm, mix, specimen_volume_mm3);
        }
        let parts = mix.parts();
        let mut sieve_classes = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            let above = classes_above(&part.grading.form(), part.d_min_mm.unwrap_or(0.0));
            let placed =
                above.into_iter().filter_map(|class| class.below(mix.d_max_mm.unwrap_or(f64::INFINITY)));
            sieve_classes.extend(placed.map(|class| Class {
                mass_fraction: part.share * class.mass_fraction,
                part: number as u16,
                ..class
            }));
        }
        let shapes = ShapeSampler::new(mix, &sieve_classes, None);
        let classes: Vec<Class> = match &shapes {
            None => sieve_classes.iter().flat_map(Class::narrow).collect(),
            Some(shapes) => sieve_classes.iter_mut().flat_map(|class| shaped(class, shapes)).collect(),
        };
        let kept: f64 = classes.iter().map(|c| c.mass_fraction).sum();
        let requested = mix.requested_fraction().unwrap_or(0.0);
        let (mut mixture, mut effective) = match mix.volume_fraction_of {
            VolumeFractionOf::AllAggregate => (requested, requested * kept),
            VolumeFractionOf::PlacedGrains => (requested / kept, requested),
        };
        let mut numbers = Vec::new();
        if let Some(count) = mix.count {
            let grains = |class: &Class| class.mass_fraction * class.grains_per_volume();
            let per_volume: f64 = classes.iter().map(grains).sum();
            mixture = count as f64 / per_volume / specimen_volume_mm3;
            effective = mixture * kept;
            numbers = rounded(classes.iter().map(|class| grains(class) / per_volume), count);
        }
        let d_min_mm = classes.iter().map(|c| c.low_mm).reduce(f64::min).unwrap_or(0.0);
        let d_max_mm = classes.iter().map(|c| c.high_mm).reduce(f64::max).unwrap_or(0.0);
        Self {
            sieve_classes,
            classes,
            parts: parts.len() as u16,
            has_aggregates: !mix.aggregates.is_empty(),
            numbers,
            list: None,
            volume_fraction_mixture: mixture,
            volume_fraction_effective: effective,
            d_min_mm,
            d_max_mm,
            specimen_volume_mm3,
            shapes,
        }
    }

    fn from_list(mm: &[f64], mix: &Mix, specimen_volume_mm3: f64) -> Self {
        let mut list: Vec<f64> = mm.iter().copied().filter(|&d| mix.places_mm(d)).collect();
        sorting::descending(&mut list);
        let shapes = ShapeSampler::new(mix, &[], Some(&list));
        let all: f64 = mm.iter().map(|&d| expected_volume_mm3(d, shapes.as_ref())).sum();
        let kept: f64 = list.iter().map(|&d| expected_volume_mm3(d, shapes.as_ref())).sum();
        let d_min_mm = list.last().copied().unwrap_or(0.0);
        let d_max_mm = list.first().copied().unwrap_or(0.0);
        Self {
            sieve_classes: sieve::between(d_min_mm, d_max_mm, Law::Single),
            classes: Vec::new(),
            parts: 1,
            has_aggregates: false,
            numbers: Vec::new(),
            volume_fraction_mixture: all / specimen_volume_mm3,
            volume_fraction_effective: kept / specimen_volume_mm3,
            d_min_mm,
            d_max_mm,
            list: Some(list),
            specimen_volume_mm3,
            shapes,
        }
    }

    /// Whether the request says how much volume the grains have: neither a list nor a number prescribes it.
    pub fn has_requested_volume(&self) -> bool {
        self.list.is_none() && self.numbers.is_empty()
    }

    /// What the grains are.
    pub fn kind(&self) -> GrainKind {
        self.shapes.as_ref().map(ShapeSampler::kind).unwrap_or_default()
    }

    /// Volume that a class is to fill (`V_i` of `docs/method.md`, section 1).
    pub fn class_volume_mm3(&self, class: &Class) -> f64 {
        class.mass_fraction * self.volume_fraction_mixture * self.specimen_volume_mm3
    }

    /// Expected number of grains, in closed form; of an explicit list, its length.
    pub fn expected_grains(&self) -> f64 {
        self.expected_sum(Class::grains_per_volume, |_| 1.0)
    }

    /// Expected volume of the grains with their coatings: of a sphere that of a sphere of diameter `factor d + offset`;
    /// of another grain that of the parallel body at the distance by which a sphere of its volume is enlarged so.
    pub fn expected_coated_volume_mm3(&self, factor: f64, offset: f64) -> f64 {
        let Some(shapes) = &self.shapes else {
            let enlarged = |d: f64| sphere_volume(factor * d + offset);
            return self.expected_sum(|c| c.mean_of(&enlarged) * c.grains_per_volume(), enlarged);
        };
        let coated = shapes.coated(0.5 * (factor - 1.0), 0.5 * offset);
        let of_class = |c: &Class| c.mean_of(&|d| coated.mean_mm3(c.part, d)) * c.grains_per_volume();
        self.expected_sum(of_class, |d| coated.mean_mm3(0, d))
    }

    /// The classes of a part, from fine to coarse.
    pub fn classes_of(&self, part: u16) -> impl DoubleEndedIterator<Item = &Class> {
        self.numbered_classes_of(part).map(|(class, _)| class)
    }

    /// The same, each with the number of its grains where the mix counts them.
    pub(crate) fn numbered_classes_of(
        &self,
        part: u16,
    ) -> impl DoubleEndedIterator<Item = (&Class, Option<u64>)> {
        let numbered =
            self.classes.iter().enumerate().map(|(row, class)| (class, self.numbers.get(row).copied()));
        numbered.filter(move |(class, _)| class.part == part)
    }

    /// The classes that hold the largest size, one of each part that has it.
    pub fn coarsest_classes(&self) -> impl Iterator<Item = &Class> {
        self.classes.iter().filter(|class| class.high_mm == self.d_max_mm)
    }

    /// Expected volume of a grain of this size of an explicit list, in mm³.
    pub fn expected_volume_mm3(&self, size_mm: f64) -> f64 {
        expected_volume_mm3(size_mm, self.shapes.as_ref())
    }

    /// Diameter of the sphere that has the mean volume of the grains of this size of an explicit list, in mm.
    pub fn equivalent_mm(&self, size_mm: f64) -> f64 {
        match &self.shapes {
            None => size_mm,
            Some(shapes) => size_mm * cbrt(shapes.mean_volume_ratio(0, size_mm)),
        }
    }

    /// Diameters with the expected number of grains of each, from fine to coarse: quantiles of every
    /// class, or those of an explicit list, many of which are taken together. For shaped grains they are
    /// those of the mean volume of a size.
    pub fn expected_sizes(&self) -> Vec<(f64, f64)> {
        if let Some(list) = &self.list {
            let equivalent: Vec<f64> = list.iter().map(|&d| self.equivalent_mm(d)).collect();
            return sizes_of_list(&equivalent);
        }
        let mut sizes = Vec::with_capacity(self.classes.len() * QUANTILES);
        for class in &self.classes {
            let number = self.class_volume_mm3(class) * class.grains_per_volume() / QUANTILES as f64;
            let equivalent = cbrt(class.volume_ratio);
            let quantile = |k: usize| class.diameter((k as f64 + 0.5) / QUANTILES as f64) * equivalent;
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

/// Whole numbers of a sum in these shares: from the last share down, each sum is the nearest whole number.
fn rounded(shares: impl DoubleEndedIterator<Item = f64> + ExactSizeIterator, sum: u64) -> Vec<u64> {
    let (mut share, mut before) = (0.0, 0);
    let mut numbers = Vec::with_capacity(shares.len());
    for one in shares.rev() {
        share += one;
        let upto = ((share * sum as f64).round() as u64).clamp(before, sum);
        numbers.push(upto - before);
        before = upto;
    }
    // The shares sum to 1 but for rounding.
    if let Some(last) = numbers.last_mut() {
        *last += sum - before;
    }
    numbers.reverse();
    numbers
}

/// The narrow classes of a sieve class of shaped grains; its own volume ratio becomes that of its numbers.
fn shaped(sieve_class: &mut Class, shapes: &ShapeSampler) -> Vec<Class> {
    let spheres = sieve_class.mass_fraction * sieve_class.grains_per_volume();
    let parts = shapes.split(*sieve_class);
    let grains: f64 = parts.iter().map(|part| part.mass_fraction * part.grains_per_volume()).sum();
    let ratio = spheres / grains;
    // Shares of a mass near the least float vanish; then any of the ratios will do for no grains.
    let is_known = ratio.is_finite() && ratio > 0.0;
    sieve_class.volume_ratio =
        if is_known { ratio } else { parts.first().map_or(1.0, |part| part.volume_ratio) };
    parts.iter().flat_map(Class::narrow).collect()
}

/// Expected volume of a grain of this size of an explicit list, in mm³.
fn expected_volume_mm3(size_mm: f64, shapes: Option<&ShapeSampler>) -> f64 {
    let sphere = sphere_volume(size_mm);
    shapes.map_or(sphere, |shapes| sphere * shapes.mean_volume_ratio(0, size_mm))
}

/// A list from the coarsest down as diameters with numbers from fine to coarse: grains within a
/// [`LIST_SIZES`]th of the range, on a logarithmic scale, each as one grain of their mean volume.
fn sizes_of_list(list: &[f64]) -> Vec<(f64, f64)> {
    let (Some(&largest), Some(&least)) = (list.first(), list.last()) else { return Vec::new() };
    let step = (ln(largest / least) / LIST_SIZES).max(f64::MIN_POSITIVE);
    let mut sizes: Vec<(f64, f64)> = Vec::new();
    let mut bin = -1.0;
    for &d in list.iter().rev() {
        let of = (ln(d / least) / step).floor();
        match sizes.last_mut() {
            Some((cubes, number)) if of == bin => (*cubes, *number) = (*cubes + d.powi(3), *number + 1.0),
            _ => sizes.push((d.powi(3), 1.0)),
        }
        bin = of;
    }
    for (size, number) in &mut sizes {
        *size = cbrt(*size / *number);
    }
    sizes
}

/// The classes of a grading above the cut-off, from fine to coarse.
fn classes_above(form: &Form<'_>, d_min: f64) -> Vec<Class> {
    match form {
        Form::Points { points, power } => {
            // A curve that is linear in a power of d has the density of Fuller's with this exponent.
            let law = power.map_or(Law::LogUniform, |exponent| Law::Fuller { exponent });
            piecewise(points, law, d_min)
        }
        Form::Power { d_min_mm, d_max_mm, exponent, finer } => {
            let least = powf(d_min_mm / d_max_mm, *exponent);
            let passing =
                |d: f64| finer + (1.0 - finer) * (powf(d / d_max_mm, *exponent) - least) / (1.0 - least);
            let law = Law::Fuller { exponent: *exponent };
            let mut classes = sieve::between(d_min.max(*d_min_mm), *d_max_mm, law);
            for class in &mut classes {
                class.mass_fraction = passing(class.high_mm) - passing(class.low_mm);
            }
            classes
        }
        Form::Distribution(law) => sieve::of_law(law, d_min),
        Form::Classes(classes) => classes
            .iter()
            .filter_map(|c| {
                Class {
                    law: Law::LogUniform,
                    low_mm: c.d_min_mm,
                    high_mm: c.d_max_mm,
                    mass_fraction: c.mass_fraction,
                    volume_ratio: 1.0,
                    part: 0,
                }
                .above(d_min)
            })
            .collect(),
        Form::Sizes(sizes) => sizes
            .iter()
            .filter_map(|&[mm, mass_fraction]| {
                Class { law: Law::Single, low_mm: mm, high_mm: mm, mass_fraction, volume_ratio: 1.0, part: 0 }
                    .above(d_min)
            })
            .collect(),
        Form::List(_) => Vec::new(),
    }
}

fn piecewise(points: &[[f64; 2]], law: Law, d_min: f64) -> Vec<Class> {
    points
        .windows(2)
        .filter_map(|pair| {
            let [[low_mm, below], [high_mm, above]] = [pair[0], pair[1]];
            let mass_fraction = above - below;
            let class = Class { law, low_mm, high_mm, mass_fraction, volume_ratio: 1.0, part: 0 };
            if class.mass_fraction > 0.0 { class.above(d_min) } else { None }
        })
        .collect()
}

#[cfg(test)]
mod aggregate_tests;
#[cfg(test)]
mod angular_tests;
#[cfg(test)]
mod count_tests;
#[cfg(test)]
mod tests;
