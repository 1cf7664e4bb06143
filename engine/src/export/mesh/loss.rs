//! What a mesh lacks of the volume of its grains: more than a little is told, too much is refused.

use crate::export::ExportError;

/// Share of the volume of the grains that a mesh may lack without a warning.
pub(super) const TOLD: f64 = 0.005;
/// Share of it that a mesh may lack, where the volume was asked for.
pub(super) const MOST_LACKING: f64 = 0.02;
/// Numbers of segments that are tried to find one that a mesh succeeds with, over those that it failed with.
const TRIED: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 8.0];

/// Warns of a mesh whose grains have that volume over their own, minus one.
pub(super) fn warnings(volume_error: f64, short: u64) -> Vec<String> {
    if volume_error >= -TOLD {
        return Vec::new();
    }
    let because = match short {
        0 => String::new(),
        _ => format!(": {}", no_room(short)),
    };
    vec![format!("the meshed grains lack {:.1} % of their volume{because}", -100.0 * volume_error)]
}

fn no_room(short: u64) -> String {
    format!("the gaps around {short} {} leave no room for it", if short == 1 { "grain" } else { "grains" })
}

/// The least of some larger numbers of segments that lacks no more than [`MOST_LACKING`], where `lacking` tells what a
/// mesh with a number of segments lacks, and `None` where it cannot be made.
pub(super) fn fitting_segments(
    segments: Option<u32>,
    mut lacking: impl FnMut(u32) -> Option<f64>,
) -> Option<u32> {
    let (_, most) = super::options::SEGMENTS;
    let failed = f64::from(segments?);
    for times in TRIED {
        let tried = (times * failed).ceil() as u32;
        if tried > most || lacking(tried)? <= MOST_LACKING {
            return (tried <= most).then_some(tried);
        }
    }
    None
}

/// Refuses a mesh that lacks too much, with the number of segments that would do.
pub(super) fn refused(lacking: f64, short: u64, segments: Option<u32>) -> ExportError {
    let finer = segments.map(|n| format!("ask for segments={n}, ")).unwrap_or_default();
    ExportError::Unavailable(format!(
        "the meshed grains would lack {:.1} % of their volume, more than {} %: {}; {finer}pack with a larger distance \
         between grains, or ask for volume_correction=none, which makes surfaces inside of the grains and reports what \
         they lack",
        100.0 * lacking,
        100.0 * MOST_LACKING,
        no_room(short),
    ))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_segments_that_is_named_is_the_least_tried_that_lacks_little() {
        let of_spheres = |n: u32| Some(14.4 / f64::from(n * n));
        assert_eq!(fitting_segments(Some(16), of_spheres), Some(32));
        assert_eq!(fitting_segments(Some(20), of_spheres), Some(30));
        assert_eq!(fitting_segments(Some(200), of_spheres), None);
        assert_eq!(fitting_segments(None, of_spheres), None);
        // Finer meshes cannot be made from some number on.
        assert_eq!(fitting_segments(Some(6), |n| (n < 20).then_some(0.1)), None);
    }

    #[test]
    fn little_is_not_told_and_more_is() {
        assert!(warnings(-0.005, 3).is_empty());
        assert_eq!(
            warnings(-0.0074, 3),
            ["the meshed grains lack 0.7 % of their volume: the gaps around 3 grains leave no room for it"]
        );
        assert_eq!(warnings(-0.05, 0), ["the meshed grains lack 5.0 % of their volume"]);
    }
}
