//! Volume fraction of a random close packing of spheres, from the distribution of their diameters.
//!
//! Method of Farr and Groot (J. Chem. Phys. 131, 244104, 2009, arXiv:0912.0852): the chords that a random line
//! cuts from the spheres are laid out as rods on a line, longest first, each into the longest gap, with gaps of at
//! least a fixed share of the shorter neighbour. The share is that of the paper; with it equal spheres have 0.6435.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Least gap over the shorter of two neighbouring rods.
const GAP: f64 = 0.7654;
/// Rods that stand for all chords. The volume fraction is settled to 1e-4.
const RODS: usize = 1000;

/// Volume fraction of a random close packing of spheres with these diameters and numbers, from fine to
/// coarse; 0 where there is none.
pub(crate) fn random_close(sizes: &[(f64, f64)]) -> f64 {
    let rods = rods(sizes);
    let Some((&longest, rest)) = rods.split_first() else { return 0.0 };
    // On a ring: one rod has one gap.
    let mut gaps = BinaryHeap::from([Gap(GAP * longest)]);
    for &rod in rest {
        let least = GAP * rod;
        let widest = gaps.pop().map_or(0.0, |gap| gap.0);
        gaps.push(Gap(least));
        gaps.push(Gap(least.max(widest - rod - least)));
    }
    let solid: f64 = rods.iter().sum();
    solid / (solid + gaps.iter().map(|gap| gap.0).sum::<f64>())
}

/// Quantiles of the lengths of chords that a random line cuts, longest first.
///
/// A line meets a sphere in proportion to its cross-section, and the squared length of the chord is
/// uniform up to that of the diameter.
fn rods(sizes: &[(f64, f64)]) -> Vec<f64> {
    let total: f64 = sizes.iter().map(|(d, number)| number * d * d).sum();
    let mut larger: f64 = sizes.iter().map(|(_, number)| number).sum();
    let mut smaller = 0.0;
    let mut sizes = sizes.iter();
    let mut current = sizes.next();
    let mut rods = Vec::with_capacity(RODS);
    for rod in 0..RODS {
        let below = (rod as f64 + 0.5) / RODS as f64 * total;
        // Share of chords below a diameter: those of smaller spheres, and a part of the others'.
        while let Some((d, number)) = current
            && smaller + d * d * larger < below
        {
            smaller += number * d * d;
            larger -= number;
            current = sizes.next();
        }
        let Some((d, _)) = current else { break };
        rods.push(((below - smaller) / larger).max(0.0).sqrt().min(*d));
    }
    rods.reverse();
    rods
}

/// A gap, ordered by its width.
struct Gap(f64);

impl Ord for Gap {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Gap {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Gap {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Gap {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_spheres_pack_as_published() {
        assert!((random_close(&[(1.0, 1.0)]) - 0.6435).abs() < 2e-4, "{}", random_close(&[(1.0, 1.0)]));
        assert!((random_close(&[(7.0, 3.0)]) - random_close(&[(1.0, 1.0)])).abs() < 1e-12);
        assert_eq!(random_close(&[]), 0.0);
    }

    #[test]
    fn smaller_spheres_fill_the_voids_of_larger_ones() {
        let share = |ratio: f64, small: f64| random_close(&[(1.0, ratio.powi(3) * small), (ratio, 1.0)]);
        assert!(share(1.5, 0.3) > share(1.0, 0.3));
        assert!(share(5.0, 0.36) > share(1.5, 0.36));
        // As sizes part: 1 - (1 - 0.6435)^2, which no mix of two sizes exceeds.
        let far = share(1000.0, 0.3565);
        assert!(far > 0.85 && far < 0.8730, "{far}");
    }

    #[test]
    fn a_size_in_parts_is_the_same_size() {
        let whole = random_close(&[(1.0, 8.0), (2.0, 1.0)]);
        let parts = random_close(&[(1.0, 3.0), (1.0, 5.0), (2.0, 0.5), (2.0, 0.5)]);
        assert!((whole - parts).abs() < 1e-12);
    }
}
