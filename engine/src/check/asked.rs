//! What a mix asks for: its size classes with the volumes of their grains, computed from the gradings themselves.

use std::f64::consts::FRAC_PI_6;

use super::law;
use crate::elementary::{ln, powf};
use crate::packing::ClassReport;
use crate::request::{Form, Grading, Mix, MixPart, SizeClass, VolumeFractionOf};
use crate::sorting;

/// Principal sizes of ISO 565 that concrete laboratories use, in mm.
const SIEVES_MM: [f64; 13] = [0.063, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0, 250.0];

/// Size classes with the volumes that a part of a mix asks for, and its diameters from the coarsest down where it lists
/// them.
pub(super) type Asked = (Vec<ClassReport>, Option<Vec<f64>>);

/// The classes of a part of a mix with the volumes that it asks for, and its diameters from the coarsest down where it
/// lists them.
pub(super) fn asked(mix: &Mix, part: &MixPart<'_>, fraction: f64, specimen_volume_mm3: f64) -> Asked {
    let placed = |part: &MixPart<'_>| placed_mm(mix, part);
    if let Grading::Diameters { diameters_mm } = part.grading {
        let (least, most) = placed(part);
        let mut list: Vec<f64> = diameters_mm.iter().copied().filter(|&d| d >= least && d <= most).collect();
        sorting::descending(&mut list);
        let ends = (list.last().copied().unwrap_or(0.0), list.first().copied().unwrap_or(0.0));
        let mut classes: Vec<ClassReport> = between_sieves(ends).map(|ends| class(ends, 0.0)).collect();
        for &d in &list {
            if let Some(index) = class_of(&classes, d) {
                classes[index].target_volume_mm3 += volume_mm3(d);
            }
        }
        return (classes, Some(list));
    }
    let all_aggregate = match mix.volume_fraction_of {
        VolumeFractionOf::AllAggregate if mix.count.is_none() => fraction,
        _ => {
            let parts = mix.parts();
            let kept = parts.iter().flat_map(|part| {
                mass_shares(part.grading, placed(part)).into_iter().map(|c| part.share * c.target_volume_mm3)
            });
            fraction / kept.sum::<f64>()
        }
    };
    let mut classes = mass_shares(part.grading, placed(part));
    for class in &mut classes {
        class.target_volume_mm3 *= part.share * all_aggregate * specimen_volume_mm3;
    }
    (classes, None)
}

/// Between which diameters the grains of a part are placed.
pub(super) fn placed_mm(mix: &Mix, part: &MixPart<'_>) -> (f64, f64) {
    (part.d_min_mm.unwrap_or(0.0), mix.d_max_mm.unwrap_or(f64::INFINITY))
}

/// The classes between the cut-off and the largest diameter with their shares of the mass of all aggregate in place of
/// volumes.
pub(super) fn mass_shares(grading: &Grading, (d_min, d_max): (f64, f64)) -> Vec<ClassReport> {
    // The share of a class that is placed.
    let kept = |low: f64, high: f64, share: f64, power: Option<f64>| {
        let (from, to) = (low.max(d_min), high.min(d_max));
        let is_whole = from <= low && to >= high;
        let kept = if is_whole { 1.0 } else { straight_share(power, (low, high), (from, to)) };
        (share > 0.0 && from < to).then(|| class((from, to), share * kept))
    };
    match grading.form() {
        Form::Points { points, power } => {
            points.windows(2).filter_map(|p| kept(p[0][0], p[1][0], p[1][1] - p[0][1], power)).collect()
        }
        Form::Power { d_min_mm, d_max_mm, exponent, finer } => {
            let risen = |d: f64| powf(d, exponent) - powf(d_min_mm, exponent);
            let passing = |d: f64| finer + (1.0 - finer) * risen(d) / risen(d_max_mm);
            between_sieves((d_min.max(d_min_mm), d_max_mm.min(d_max)))
                .map(|(low, high)| class((low, high), passing(high) - passing(low)))
                .collect()
        }
        Form::Distribution(distribution) => {
            let ends = (d_min.max(distribution.d_min_mm), distribution.d_max_mm.min(d_max));
            let of_sieves = between_sieves(ends)
                .map(|(low, high)| class((low, high), law::share(&distribution, low, high)));
            of_sieves.filter(|class| class.target_volume_mm3 > 0.0).collect()
        }
        Form::Classes(classes) => {
            let of_class = |c: &SizeClass| kept(c.d_min_mm, c.d_max_mm, c.mass_fraction, None);
            classes.iter().filter_map(of_class).collect()
        }
        Form::Sizes(sizes) => {
            let placed = sizes.iter().filter(|[mm, _]| (d_min..=d_max).contains(mm));
            placed.map(|&[mm, share]| class((mm, mm), share)).collect()
        }
        Form::List(_) => Vec::new(),
    }
}

pub(super) fn class((d_min_mm, d_max_mm): (f64, f64), target_volume_mm3: f64) -> ClassReport {
    ClassReport { d_min_mm, d_max_mm, grains: 0, target_volume_mm3, volume_mm3: 0.0 }
}

/// Classes between two diameters and the sieves in between.
fn between_sieves((low, high): (f64, f64)) -> impl Iterator<Item = (f64, f64)> {
    let inner = SIEVES_MM.into_iter().filter(move |&sieve| sieve > low && sieve < high);
    let upper = inner.clone().chain([high]);
    std::iter::once(low).chain(inner).zip(upper)
}

/// Share of the mass of a class between two sizes in it.
pub(super) fn share_between(grading: &Grading, class: &ClassReport, low: f64, high: f64) -> f64 {
    let ends = (class.d_min_mm, class.d_max_mm);
    match grading.form() {
        Form::Power { exponent, .. } => straight_share(Some(exponent), ends, (low, high)),
        Form::Points { power, .. } => straight_share(power, ends, (low, high)),
        Form::Distribution(distribution) => {
            law::share(&distribution, low, high) / law::share(&distribution, ends.0, ends.1)
        }
        _ => straight_share(None, ends, (low, high)),
    }
}

/// Share of a class between two diameters in it, where the curve is straight in a power of the diameter, or in its
/// logarithm.
fn straight_share(power: Option<f64>, (low, high): (f64, f64), (from, to): (f64, f64)) -> f64 {
    match power {
        None => ln(to / from) / ln(high / low),
        Some(power) => (powf(to, power) - powf(from, power)) / (powf(high, power) - powf(low, power)),
    }
}

/// The class that holds a size: the finest whose upper sieve lets it pass.
pub(super) fn class_of(classes: &[ClassReport], d: f64) -> Option<usize> {
    classes.iter().position(|c| d <= c.d_max_mm).or(classes.len().checked_sub(1))
}

/// Volume of a sphere.
pub(super) fn volume_mm3(d: f64) -> f64 {
    FRAC_PI_6 * d * d * d
}
