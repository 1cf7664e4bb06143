//! Whether grains whose number the mix states follow its curve.

use super::asked::{mass_shares, placed_mm, volume_mm3};
use crate::packing::ClassReport;
use crate::request::{Mix, MixPart};
use crate::sorting;

/// Largest difference between the volume above a sieve and its share of a counted mix, in volumes of the largest grain
/// there. The number of grains above every diameter is rounded by at most half a grain, and the diameters within a
/// class are spread evenly.
const GRAINS: f64 = 3.0;
/// The same for bodies of random shapes, in standard deviations of the sum of their volumes, on top of [`GRAINS`].
const DEVIATIONS: f64 = 5.0;

/// Volume in mm³ of all grains of a mix that counts them, by their sizes and volumes. Where the finest are missing, it
/// is that of the coarser ones over the share that the curve gives them.
pub(super) fn all_mm3(grains: &[(f64, f64)], mix: &Mix, count: u64, has_all: bool) -> Result<f64, String> {
    let found = grains.len() as u64;
    if found > count || (has_all && found < count) {
        return Err(format!("{found} grains instead of {count}"));
    }
    let above = |sieve: f64| {
        let coarser = grains.iter().filter(|(size, _)| *size > sieve);
        coarser.map(|(_, volume_mm3)| volume_mm3).sum::<f64>()
    };
    let all = above(0.0);
    if has_all {
        return Ok(all);
    }
    let finest = grains.iter().map(|grain| grain.0).fold(f64::INFINITY, f64::min);
    let parts = mix.parts();
    let shares = |from: f64| -> f64 {
        let of_part = |part: &MixPart<'_>| {
            let (least, most) = placed_mm(mix, part);
            let classes = mass_shares(part.grading, (least.max(from), most));
            part.share * classes.iter().map(|class| class.target_volume_mm3).sum::<f64>()
        };
        parts.iter().map(of_part).sum()
    };
    let (placed, coarser) = (shares(0.0), shares(finest));
    Ok(if coarser > 0.0 { above(finest) * placed / coarser } else { all })
}

/// Compares the volume above each sieve with the share that the curve gives it of the volume of all grains, where the
/// mix counts them; without all grains, above the sieves that are coarser than the finest of them.
pub(super) fn check(
    mut grains: Vec<(f64, f64)>,
    are_bodies: bool,
    classes: &[ClassReport],
    largest: &[f64],
    has_all: bool,
) -> Result<(), String> {
    sorting::by_number(&mut grains, |(size, _)| -size);
    let finest = if has_all { 0.0 } else { grains.last().map_or(f64::INFINITY, |(size, _)| *size) };
    let (mut asked_mm3, mut found_mm3, mut most_mm3, mut squares, mut next) = (0.0, 0.0, 0.0_f64, 0.0, 0);
    for (class, &largest) in classes.iter().zip(largest).rev() {
        if class.d_min_mm < finest {
            break;
        }
        asked_mm3 += class.target_volume_mm3;
        found_mm3 += class.volume_mm3;
        most_mm3 = most_mm3.max(largest).max(volume_mm3(class.d_max_mm));
        while let Some((_, volume)) = grains.get(next).filter(|(size, _)| *size > class.d_min_mm) {
            squares += volume * volume;
            next += 1;
        }
        let random = if are_bodies { DEVIATIONS * squares.sqrt() } else { 0.0 };
        let allowed = GRAINS * most_mm3 + random;
        if (found_mm3 - asked_mm3).abs() > allowed {
            return Err(format!(
                "above {} mm the grains have {found_mm3} mm3, and the curve gives them {asked_mm3} mm3 of the volume \
                 of all grains: must differ by at most {allowed} mm3",
                class.d_min_mm
            ));
        }
    }
    Ok(())
}
