//! The smallest specimen for grains whose number is given.

use super::estimate::Case;
use super::model::{LIKELY, bisect};
use crate::distance::DistanceRule;
use crate::elementary::{cbrt, log10};
use crate::mix::GradedMix;
use crate::request::{PackingRequest, Specimen};

/// Volume fraction, coating included, at which a specimen is large for its grains.
const LOOSE: f64 = 0.05;

/// The smallest specimen with the proportions of that of the request in which its grains, whose number does not depend
/// on it, are packed with a probability of 0.9; `None` where the mix prescribes a volume fraction, or where no such
/// specimen is found. `fits` tells whether the largest grain has room in the specimen of a request.
pub(super) fn specimen(
    request: &PackingRequest,
    mix: &GradedMix,
    filled: f64,
    fits: impl Fn(&PackingRequest, &GradedMix, &DistanceRule) -> bool,
) -> Option<Specimen> {
    if mix.has_requested_volume() {
        return None;
    }
    let (mut request, mut mix) = (request.clone(), mix.clone());
    let (whole, fractions) = (request.specimen, [mix.volume_fraction_mixture, mix.volume_fraction_effective]);
    let mut is_likely = |specimen: Specimen| {
        request.specimen = specimen;
        let volumes = whole.volume_mm3() / specimen.volume_mm3();
        mix.specimen_volume_mm3 = specimen.volume_mm3();
        [mix.volume_fraction_mixture, mix.volume_fraction_effective] = fractions.map(|phi| phi * volumes);
        let rule = DistanceRule::new(&request.distance, &specimen);
        if !fits(&request, &mix, &rule) {
            return false;
        }
        let case = Case::of_mix(&request, &mix, &rule);
        case.of_request(&case.methods()).success_probability >= LIKELY
    };
    let (least, most) = (cbrt(LOOSE / filled), cbrt(1.0 / filled));
    let shrunk = bisect(least, most, |factor| is_likely(scaled(whole, 1.0 / factor)));
    let smallest = scaled(whole, 1.0 / shrunk);
    is_likely(smallest).then_some(smallest)
}

/// The specimen with all lengths times a factor, each rounded up to three digits.
fn scaled(specimen: Specimen, factor: f64) -> Specimen {
    let length = |mm: f64| {
        let per_mm = 10.0_f64.powi(2 - log10(mm * factor).floor() as i32);
        (mm * factor * per_mm).ceil() / per_mm
    };
    match specimen {
        Specimen::Box { size_mm, boundary } => Specimen::Box { size_mm: size_mm.map(length), boundary },
        Specimen::Cylinder { diameter_mm, height_mm } => {
            Specimen::Cylinder { diameter_mm: length(diameter_mm), height_mm: length(height_mm) }
        }
    }
}
