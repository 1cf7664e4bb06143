use super::*;
use crate::Unattended;
use crate::packing::Spheres;
use crate::request::Boundary;
use crate::rng::draws::direction;
use crate::rng::{Stream, stream, uniform};

fn of(centers: &[[f64; 3]], d_mm: f64, size_mm: f64, boundary: Boundary) -> BondOrder {
    let mut spheres = Spheres::default();
    for &center in centers {
        spheres.push(center, d_mm);
    }
    let specimen = Specimen::Box { size_mm: [size_mm; 3], boundary };
    let near = Near::new(&spheres, &specimen).unwrap();
    bond_order(&near, &specimen, 0.0, &Unattended).unwrap().unwrap()
}

/// Sites of a crystal with cubic cells of edge 1.
fn crystal(along: usize, basis: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let cell = |i: usize| [i % along, i / along % along, i / (along * along)].map(|x| x as f64);
    (0..along.pow(3))
        .flat_map(|i| basis.iter().map(move |site| std::array::from_fn(|a| cell(i)[a] + site[a] + 0.1)))
        .collect()
}

const FCC: [[f64; 3]; 4] = [[0.0; 3], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]];

/// Steinhardt 1983, table of perfect clusters.
#[test]
fn crystals_have_their_known_order() {
    let root = 0.5_f64.sqrt();
    for (basis, d_mm, bonds, q6, solid) in
        [(&FCC[..], root, 12.0, 0.57452, 1.0), (&[[0.0; 3]][..], 1.0, 6.0, 0.35355, 0.0)]
    {
        let found = of(&crystal(4, basis), d_mm, 4.0, Boundary::Periodic);
        assert_eq!(found.bonds_per_grain, bonds);
        assert!((found.q6 - q6).abs() < 1e-5, "{found:?}");
        // In a simple cubic crystal every bond is coherent, but there are six only.
        assert_eq!((found.solid_like_share, found.share_by_coherent_bonds[bonds as usize]), (solid, 1.0));
        assert!(found.q6_by_chance < 0.08, "{found:?}");
    }
}

/// Grains that keep a constant gap are ordered as touching ones are.
#[test]
fn a_constant_gap_is_a_part_of_the_diameter() {
    let mut spheres = Spheres::default();
    for center in crystal(4, &FCC) {
        spheres.push(center, 0.2);
    }
    let specimen = Specimen::Box { size_mm: [4.0; 3], boundary: Boundary::Periodic };
    let found = crate::analysis::quality(&spheres, &specimen, &Unattended).unwrap();
    let bonds = found.bond_order.unwrap();
    assert!((bonds.q6 - 0.57452).abs() < 1e-5 && bonds.solid_like_share == 1.0, "{bonds:?}");
    let (gaps, contacts) = (found.gaps.unwrap(), found.contacts.unwrap());
    assert!((gaps.smallest_mm - (0.5_f64.sqrt() - 0.2)).abs() < 1e-12 && gaps.median_excess < 1e-12);
    assert_eq!((contacts.contacts_per_grain, contacts.mark_correlation), (12.0, None));
}

#[test]
fn order_away_from_the_walls_is_told_apart() {
    let found = of(&crystal(8, &FCC), 0.5_f64.sqrt(), 8.0, Boundary::Walls);
    let away = found.solid_like_share_away_from_walls.unwrap();
    assert!(away == 1.0 && found.solid_like_share < 1.0, "{found:?}");
    let small = of(&crystal(3, &FCC), 0.5_f64.sqrt(), 3.0, Boundary::Walls);
    assert_eq!(small.solid_like_share_away_from_walls, None);
}

/// Pairs at random directions, each far from the others.
#[test]
fn random_directions_have_the_order_of_chance() {
    let mut rng = stream(3, Stream::Sampling);
    let mut centers = Vec::new();
    for site in crystal(12, &[[0.4; 3]]) {
        let step = direction(&mut rng);
        let half = 0.1 + 0.02 * uniform(&mut rng);
        centers.push(std::array::from_fn(|a| site[a] + half * step[a]));
        centers.push(std::array::from_fn(|a| site[a] - half * step[a]));
    }
    let found = of(&centers, 0.2, 12.0, Boundary::Periodic);
    assert_eq!(found.bonds_per_grain, 1.0);
    assert!((found.q6_by_chance - 1.0 / 1728.0_f64.sqrt()).abs() < 1e-12);
    // The square of the quotient is a mean of 13 normal squares: 1 with a standard deviation of 0.39.
    assert!((0.3..1.7).contains(&(found.q6 / found.q6_by_chance)), "{found:?}");
}

#[test]
fn harmonics_add_up_to_the_legendre_polynomial() {
    let mut rng = stream(5, Stream::Sampling);
    for _ in 0..100 {
        let (u, v) = (direction(&mut rng), direction(&mut rng));
        let c = u.dot(&v);
        let cc = c * c;
        let legendre = (((231.0 * cc - 315.0) * cc + 105.0) * cc - 5.0) / 16.0;
        let found = product(&harmonics(u.into()), &harmonics(v.into()));
        assert!((found - legendre).abs() < 1e-12, "{found} {legendre}");
    }
}
