//! Sieve classes: the bins in which a result is reported and its grading is checked.
//!
//! They are the user's own classes where the grading has some, else the standard sieves between
//! the cut-off and the largest grain.

use super::GradedMix;
use super::class::{Class, Law};
use super::distribution::mass;
use crate::request::Distribution;
use crate::shape::exceeds;
use crate::sorting;

/// Standard sieves (ISO 565 principal sizes as concrete labs use them), in mm.
pub(crate) const STANDARD_SIEVES_MM: [f64; 13] =
    [0.063, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0, 250.0];

/// One bin of diameters with what the mix asks of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SieveClass {
    /// Lower sieve.
    pub low_mm: f64,
    /// Upper sieve.
    pub high_mm: f64,
    /// Requested volume in mm³.
    pub volume_mm3: f64,
    /// Expected number of grains.
    pub grains: f64,
}

/// The sieve classes of a mix, from fine to coarse, with what it asks of them. Those of several aggregates are divided
/// at the sieves of all.
pub fn sieve_classes(mix: &GradedMix) -> Vec<SieveClass> {
    let asked = |c: &Class| {
        let volume_mm3 = mix.class_volume_mm3(c);
        let grains = volume_mm3 * c.grains_per_volume();
        SieveClass { low_mm: c.low_mm, high_mm: c.high_mm, volume_mm3, grains }
    };
    if mix.sieve_classes.iter().any(|class| class.part > 0) {
        return divided(mix, asked);
    }
    let mut classes: Vec<SieveClass> = mix.sieve_classes.iter().map(asked).collect();
    if let Some(list) = &mix.list {
        for class in &mut classes {
            (class.volume_mm3, class.grains) = (0.0, 0.0);
        }
        for &d in list {
            let i = class_of(d, classes.iter().map(|c| c.high_mm));
            classes[i].volume_mm3 += mix.expected_volume_mm3(d);
            classes[i].grains += 1.0;
        }
    }
    classes
}

/// The classes between the sieves of all aggregates that hold some of the mass.
fn divided(mix: &GradedMix, asked: impl Fn(&Class) -> SieveClass) -> Vec<SieveClass> {
    let mut edges: Vec<f64> =
        mix.sieve_classes.iter().flat_map(|class| [class.low_mm, class.high_mm]).collect();
    sorting::ascending(&mut edges);
    edges.dedup();
    let is_single = |class: &&Class| class.low_mm == class.high_mm;
    let singles = mix.sieve_classes.iter().filter(is_single).map(|class| class.low_mm);
    // Equal grains that are finer than all others have a class of their own.
    let finest = singles.fold(f64::INFINITY, f64::min);
    if edges.first().is_some_and(|&edge| edge == finest) {
        edges.insert(0, finest);
    }
    let between = |pair: &[f64]| {
        let (low_mm, high_mm) = (pair[0], pair[1]);
        let mut sum = SieveClass { low_mm, high_mm, volume_mm3: 0.0, grains: 0.0 };
        for class in &mix.sieve_classes {
            let part = if class.low_mm == class.high_mm {
                let is_inside = class.high_mm == high_mm && (class.high_mm > low_mm || low_mm == high_mm);
                is_inside.then_some(*class)
            } else if class.low_mm <= low_mm && high_mm <= class.high_mm && low_mm < high_mm {
                let mass_fraction = class.mass_fraction * class.mass_share(low_mm, high_mm);
                Some(Class { low_mm, high_mm, mass_fraction, ..*class })
            } else {
                None
            };
            if let Some(part) = part.as_ref().map(&asked) {
                sum.volume_mm3 += part.volume_mm3;
                sum.grains += part.grains;
            }
        }
        sum
    };
    edges.windows(2).map(between).filter(|class| class.volume_mm3 > 0.0).collect()
}

/// Index of the class that a diameter falls into, given the upper sieves from fine to coarse. A grain that passes a
/// sieve but for the rounding of its size passes it.
pub fn class_of(d: f64, upper_mm: impl Iterator<Item = f64>) -> usize {
    let mut last = 0;
    for (i, high) in upper_mm.enumerate() {
        last = i;
        if !exceeds(d, high) {
            break;
        }
    }
    last
}

/// Classes between two bounds and the standard sieves in between, without mass.
pub(super) fn between(low: f64, high: f64, law: Law) -> Vec<Class> {
    let mut edges = vec![low];
    edges.extend(STANDARD_SIEVES_MM.iter().copied().filter(|&s| s > low && s < high));
    edges.push(high);
    edges
        .windows(2)
        .map(|e| Class { law, low_mm: e[0], high_mm: e[1], mass_fraction: 0.0, volume_ratio: 1.0, part: 0 })
        .collect()
}

/// The sieve classes of a law of sizes above a cut-off, from fine to coarse.
pub(super) fn of_law(law: &Distribution, d_min: f64) -> Vec<Class> {
    let all = mass(law, law.d_min_mm, law.d_max_mm);
    let between = between(d_min.max(law.d_min_mm), law.d_max_mm, Law::Distribution(*law));
    let with_mass = between.into_iter().map(|class| {
        let mass_fraction = mass(law, class.low_mm, class.high_mm) / all;
        Class { mass_fraction, ..class }
    });
    with_mass.filter(|class| class.mass_fraction > 0.0).collect()
}
