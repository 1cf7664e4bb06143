//! Sieve classes: the bins in which a result is reported and its grading is checked.
//!
//! They are the user's own classes where the grading has some, else the standard sieves between
//! the cut-off and the largest grain.

use super::GradedMix;
use super::class::Law;

/// Standard sieves (ISO 565 principal sizes as concrete labs use them), in mm.
const STANDARD_SIEVES_MM: [f64; 13] =
    [0.063, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0, 250.0];

/// One bin of diameters with what the mix asks of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SieveClass {
    /// Lower sieve.
    pub low_mm: f64,
    /// Upper sieve.
    pub high_mm: f64,
    /// Volume asked for.
    pub volume_mm3: f64,
    /// Expected number of grains.
    pub grains: f64,
}

/// The sieve classes of a mix, from fine to coarse.
pub fn sieve_classes(mix: &GradedMix) -> Vec<SieveClass> {
    if let Some(list) = &mix.list {
        let mut classes = between_sieves(mix.d_min_mm, mix.d_max_mm);
        for &d in list {
            let i = class_of(d, classes.iter().map(|c| c.high_mm));
            classes[i].volume_mm3 += super::sphere_volume(d);
            classes[i].grains += 1.0;
        }
        return classes;
    }
    let fuller = mix.classes.iter().any(|c| matches!(c.law, Law::Fuller { .. }));
    let mut bins: Vec<SieveClass> = if fuller {
        between_sieves(mix.d_min_mm, mix.d_max_mm)
    } else {
        mix.classes
            .iter()
            .map(|c| SieveClass { low_mm: c.low_mm, high_mm: c.high_mm, volume_mm3: 0.0, grains: 0.0 })
            .collect()
    };
    for class in &mix.classes {
        for bin in &mut bins {
            let (from, to) = (class.low_mm.max(bin.low_mm), class.high_mm.min(bin.high_mm));
            let whole = from == class.low_mm && to == class.high_mm;
            if from < to || (whole && from == to) {
                let share = if whole { 1.0 } else { class.mass_share(from, to) };
                let volume = share * mix.class_volume_mm3(class);
                bin.volume_mm3 += volume;
                bin.grains +=
                    volume * super::Class { low_mm: from, high_mm: to, ..*class }.grains_per_volume();
            }
        }
    }
    bins
}

/// Index of the class that a diameter falls into, given the upper sieves from fine to coarse.
pub fn class_of(d: f64, upper_mm: impl Iterator<Item = f64>) -> usize {
    let mut last = 0;
    for (i, high) in upper_mm.enumerate() {
        last = i;
        if d <= high {
            break;
        }
    }
    last
}

/// The bounds and the standard sieves between them.
pub(super) fn edges(low: f64, high: f64) -> Vec<f64> {
    let mut edges = vec![low];
    edges.extend(STANDARD_SIEVES_MM.iter().copied().filter(|&s| s > low && s < high));
    edges.push(high);
    edges
}

fn between_sieves(low: f64, high: f64) -> Vec<SieveClass> {
    edges(low, high)
        .windows(2)
        .map(|e| SieveClass { low_mm: e[0], high_mm: e[1], volume_mm3: 0.0, grains: 0.0 })
        .collect()
}
