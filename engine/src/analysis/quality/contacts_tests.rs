use super::*;
use crate::Unattended;
use crate::analysis::quality::classes::classes;
use crate::packing::Spheres;
use crate::request::{Boundary, Specimen};
use crate::rng::{Stream, stream, uniform};

/// Spheres on a simple cubic lattice in a periodic box, in the order of the lattice.
fn lattice(along: usize, d_mm: impl Fn([usize; 3]) -> f64) -> (Vec<([f64; 3], f64)>, Specimen) {
    let grains = (0..along.pow(3))
        .map(|i| {
            let at = [i % along, i / along % along, i / (along * along)];
            (at.map(|x| x as f64 + 0.5), d_mm(at))
        })
        .collect();
    (grains, Specimen::Box { size_mm: [along as f64; 3], boundary: Boundary::Periodic })
}

fn measured(mut grains: Vec<([f64; 3], f64)>, specimen: &Specimen) -> ContactFigures {
    grains.sort_by(|p, q| q.1.total_cmp(&p.1));
    let mut spheres = Spheres::default();
    for (center, d) in grains {
        spheres.push(center, d);
    }
    let near = Near::new(&spheres, specimen).unwrap();
    let smallest = gaps(&near, &Unattended).unwrap().unwrap().smallest_mm;
    contacts(&near, &classes(&spheres.d_mm), smallest, &Unattended).unwrap().unwrap()
}

/// The six neighbours of each site are near, for sizes differ by less than the gap of near pairs.
#[test]
fn shuffled_sizes_are_not_correlated_and_alternating_ones_are_opposite() {
    let mut rng = stream(1, Stream::Sampling);
    let sizes: Vec<f64> = (0..4096).map(|_| 1.0 - 0.01 * uniform(&mut rng)).collect();
    let (grains, specimen) = lattice(16, |[x, y, z]| sizes[(z * 16 + y) * 16 + x]);
    let found = measured(grains, &specimen);
    assert_eq!((found.references, found.near_per_grain), (4096, 6.0));
    // 12288 pairs: the standard error is 0.009.
    assert!(found.mark_correlation.unwrap().abs() < 0.03, "{found:?}");
    for bin in &found.by_ratio {
        assert!((bin.share - bin.share_shuffled).abs() < 0.02, "{bin:?}");
    }
    for pair in &found.by_class {
        assert!((pair.share - pair.share_shuffled).abs() < 0.02, "{pair:?}");
    }
    let sum = |f: fn(&RatioFigures) -> f64| found.by_ratio.iter().map(f).sum::<f64>();
    assert!(
        (sum(|bin| bin.share) - 1.0).abs() < 1e-12 && (sum(|bin| bin.share_shuffled) - 1.0).abs() < 1e-12
    );
    let sum = |f: fn(&ClassPairFigures) -> f64| found.by_class.iter().map(f).sum::<f64>();
    assert!((sum(|pair| pair.share) - 1.0).abs() < 1e-12);
    assert!((sum(|pair| pair.share_shuffled) - 1.0).abs() < 1e-12);

    let (grains, specimen) = lattice(6, |[x, y, z]| if (x + y + z) % 2 == 0 { 1.0 } else { 0.98 });
    let found = measured(grains, &specimen);
    assert!((found.mark_correlation.unwrap() + 1.0).abs() < 1e-9, "{found:?}");
    // Every pair is of a fine and a coarse grain; shuffled, of half of them: 108 * 108 of 216 * 215 / 2 pairs.
    let mixed = found.by_class.iter().find(|pair| pair.finer != pair.coarser).unwrap();
    assert_eq!(mixed.share, 1.0);
    assert!((mixed.share_shuffled - 108.0 / 215.0).abs() < 1e-12, "{mixed:?}");

    // Slabs of four layers of one size: of 4 pairs along z one joins two sizes, across z none.
    let (grains, specimen) = lattice(8, |[_, _, z]| if z / 4 == 0 { 1.0 } else { 0.98 });
    let found = measured(grains, &specimen);
    assert!((found.mark_correlation.unwrap() - (1.0 - 2.0 / 12.0)).abs() < 1e-9, "{found:?}");
}

#[test]
fn pairs_made_by_hand_are_counted() {
    let specimen = Specimen::Box { size_mm: [100.0; 3], boundary: Boundary::Walls };
    // A row of 4, 2 and 1 mm with the gaps 0.001 and 0.04 mm, and a grain alone.
    let grains = vec![
        ([10.0, 50.0, 50.0], 4.0),
        ([13.001, 50.0, 50.0], 2.0),
        ([14.541, 50.0, 50.0], 1.0),
        ([80.0, 50.0, 50.0], 1.05),
    ];
    let found = measured(grains, &specimen);
    assert!(
        (found.near_gap_mm - 0.05105).abs() < 1e-9 && (found.contact_gap_mm - 0.003_002).abs() < 1e-9,
        "{found:?}"
    );
    assert_eq!((found.near_per_grain, found.contacts_per_grain), (1.0, 0.5));
    assert_eq!((found.without_contact_share, found.like_share), (0.5, 0.0));
    // Ends: 4-2, 2-4, 2-1, 1-2, in logarithms to base 2: products 2, 2, 0, 0, means 1, variance 1/2.
    assert!(found.mark_correlation.unwrap().abs() < 1e-9, "{found:?}");
    // Shuffled, the number of pairs per grain is 1, 2, 1: pairs 4-2, 2-1, 4-1 in proportion to 2, 2, 1.
    let shared = |ratio: f64| {
        let of_ratio = |bin: &&RatioFigures| ratio > bin.ratio_min && ratio <= bin.ratio_max;
        found.by_ratio.iter().find(of_ratio).unwrap()
    };
    assert!((shared(2.0 + 1e-9).share - 1.0).abs() < 1e-9 || (shared(2.0 - 1e-9).share - 1.0).abs() < 1e-9);
    let last = found.by_ratio.last().unwrap();
    assert!((last.share_shuffled - 0.2).abs() < 1e-12 && last.share == 0.0, "{found:?}");
}

#[test]
fn nearest_gaps_are_found_far_away_and_through_faces() {
    let mut spheres = Spheres::default();
    spheres.push([1.0, 5.0, 5.0], 1.0);
    spheres.push([9.0, 5.0, 5.0], 0.5);
    for (boundary, gap) in [(Boundary::Walls, 7.25), (Boundary::Periodic, 1.25)] {
        let near = Near::new(&spheres, &Specimen::Box { size_mm: [10.0; 3], boundary }).unwrap();
        for row in 0..2 {
            assert!((near.nearest_gap_mm(row).unwrap() - gap).abs() < 1e-12);
        }
        let figures = gaps(&near, &Unattended).unwrap().unwrap();
        assert_eq!((figures.smallest_mm, figures.median_excess), (figures.median_mm, 0.0));
    }
    let mut alone = Spheres::default();
    alone.push([5.0; 3], 1.0);
    let near =
        Near::new(&alone, &Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Periodic }).unwrap();
    assert_eq!(near.nearest_gap_mm(0), None);
}
