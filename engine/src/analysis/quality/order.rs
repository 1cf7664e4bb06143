//! Bond order: whether the directions to neighbours repeat, as in a crystal.
//!
//! A *bond* joins grains of like size (ratio of the diameters at most [`LIKE_RATIO`])
//! whose centres are closer than [`REACH`] mean diameters, each with the smallest gap of the packing, which takes the
//! first shell of neighbours in fcc, hcp and simple cubic crystals. Steinhardt, Nelson and Ronchetti (Physical Review B
//! 28, 1983, [10.1103/PhysRevB.28.784](https://doi.org/10.1103/PhysRevB.28.784)):
//!
//! `Q6 = (4 pi / 13 sum_m |mean over all bonds of Y_6m|^2)^(1/2)`
//!
//! It is 0.575 for fcc, 0.485 for hcp, 0.511 for bcc and 0.354 for simple cubic; for `N` bonds of random directions it
//! is about `1 / sqrt(N)`. A packing of many small crystals has a small `Q6`; it is found by the vectors `q_6m(i)`, the
//! mean over the bonds of one grain: a bond is coherent where the normed product of the vectors of its two grains is
//! above [`COHERENT`], and a grain with at least [`SOLID_BONDS`] coherent bonds is solid-like (ten Wolde, Ruiz-Montero
//! and Frenkel, Journal of Chemical Physics 104, 1996, [10.1063/1.471721](https://doi.org/10.1063/1.471721); the bound
//! of the product as for hard spheres: Filion, Hermes, Ni and Dijkstra, Journal of Chemical Physics 133, 2010,
//! [10.1063/1.3506838](https://doi.org/10.1063/1.3506838)). At the bound 0.5 of the former, which is for soft
//! particles, a sixth of the grains of a jammed random packing of equal spheres would be solid-like.

use serde::{Deserialize, Serialize};

use super::contacts::LIKE_RATIO;
use super::near::{Near, Neighbor};
use super::{Counter, QualityError, evenly};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::request::Specimen;

/// Distance of the centres of a bond at most, in mean diameters with the smallest gap.
pub const REACH: f64 = 1.4;
/// Least normed product of the vectors of a coherent bond.
pub const COHERENT: f64 = 0.7;
/// Least number of coherent bonds of a solid-like grain.
pub const SOLID_BONDS: usize = 7;
/// Grains are away from the walls where their centre is as many diameters, with the smallest gap, from them.
const AWAY: f64 = 3.0;
/// Grains whose bonds are looked at, at most.
const MAX_REFERENCES: usize = 20_000;
/// Grains have as many coherent bonds at most in the list of the report.
const MOST_LISTED: usize = 12;

/// Bond order of neighbours of like size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BondOrder {
    /// Grains that were looked at.
    pub references: u64,
    /// Largest ratio of the diameters of two grains with a bond.
    pub like_ratio: f64,
    /// Largest distance of the centres of a bond, over the sum of the mean of the two diameters and the smallest gap.
    pub reach_over_d: f64,
    /// Mean number of bonds of a grain.
    pub bonds_per_grain: f64,
    /// Steinhardt's global Q6.
    pub q6: f64,
    /// Its size by chance: one over the root of the number of bonds.
    pub q6_by_chance: f64,
    /// Share of the grains, by number, with at least seven coherent bonds.
    pub solid_like_share: f64,
    /// The same among grains whose centre is at least three of their diameters from the walls; `null` where there are
    /// none.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub solid_like_share_away_from_walls: Option<f64>,
    /// Share of the grains, by number, with 0, 1, 2 coherent bonds and so on; the last entry counts all with more too.
    pub share_by_coherent_bonds: Vec<f64>,
}

/// Real harmonics of degree 6, of which the products of two directions add up to the Legendre polynomial `P_6` of the
/// cosine between them.
type Harmonics = [f64; 13];

/// The harmonics of a direction of length 1.
fn harmonics([x, y, z]: [f64; 3]) -> Harmonics {
    let zz = z * z;
    // Derivatives of P_6 of order m, times sqrt(2 (6 - m)! / (6 + m)!), but for m = 0.
    let along = [
        (((231.0 * zz - 315.0) * zz + 105.0) * zz - 5.0) / 16.0,
        z * ((1386.0 * zz - 1260.0) * zz + 210.0) / 16.0 * (2.0 / 42.0_f64).sqrt(),
        ((6930.0 * zz - 3780.0) * zz + 210.0) / 16.0 * (2.0 / 1680.0_f64).sqrt(),
        z * (27720.0 * zz - 7560.0) / 16.0 * (2.0 / 60480.0_f64).sqrt(),
        (83160.0 * zz - 7560.0) / 16.0 * (2.0 / 1_814_400.0_f64).sqrt(),
        z * 10395.0 * (2.0 / 39_916_800.0_f64).sqrt(),
        10395.0 * (2.0 / 479_001_600.0_f64).sqrt(),
    ];
    let mut found = [0.0; 13];
    found[0] = along[0];
    // (x + i y)^m
    let (mut re, mut im) = (1.0, 0.0);
    for m in 1..=6 {
        (re, im) = (re * x - im * y, re * y + im * x);
        found[2 * m - 1] = along[m] * re;
        found[2 * m] = along[m] * im;
    }
    found
}

fn product(a: &Harmonics, b: &Harmonics) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Sum of the harmonics over the bonds of a grain, and their number.
fn of_grain(near: &Near<'_>, gap_mm: f64, row: usize, mut bond: impl FnMut(&Neighbor)) -> (Harmonics, usize) {
    let (mut sum, mut bonds) = ([0.0; 13], 0);
    let d_mm = near.spheres.d_mm[row];
    // The largest partner has the longest reach.
    let reach_mm = REACH * gap_mm + (REACH - 1.0) * d_mm * f64::midpoint(1.0, LIKE_RATIO);
    near.for_each(row, reach_mm, |other| {
        let of_other = near.spheres.d_mm[other.row];
        let is_like = d_mm.max(of_other) <= LIKE_RATIO * d_mm.min(of_other);
        if is_like
            && other.distance_mm <= REACH * (f64::midpoint(d_mm, of_other) + gap_mm)
            && other.distance_mm > 0.0
        {
            let own = harmonics(other.step_mm.each(|x| x / other.distance_mm));
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            bonds += 1;
            bond(&other);
        }
    });
    (sum, bonds)
}

/// Measures the bonds; `None` where there are none.
pub(super) fn bond_order(
    near: &Near<'_>,
    specimen: &Specimen,
    smallest_gap_mm: f64,
    control: &dyn Control,
) -> Result<Option<BondOrder>, QualityError> {
    let references = evenly(near.spheres.len(), MAX_REFERENCES);
    let counted = references.len();
    let counter = Counter { control, total: counted, what: "measuring bond order" };
    let (mut all, mut ends) = ([0.0; 13], 0_usize);
    let mut by_coherent = [0_u64; MOST_LISTED + 1];
    let (mut away, mut solid, mut solid_away) = (0_u64, 0_u64, 0_u64);
    let mut partners: Vec<usize> = Vec::new();
    for (done, row) in references.enumerate() {
        counter.look(done)?;
        partners.clear();
        let (own, bonds) = of_grain(near, smallest_gap_mm, row, |other| partners.push(other.row));
        all.iter_mut().zip(own).for_each(|(all, own)| *all += own);
        ends += bonds;
        // Where there are fewer bonds none can make the grain solid-like, but the list counts them too.
        let norm = product(&own, &own).sqrt();
        let coherent = partners
            .iter()
            .filter(|&&partner| {
                let (other, _) = of_grain(near, smallest_gap_mm, partner, |_| ());
                product(&own, &other) > COHERENT * norm * product(&other, &other).sqrt()
            })
            .count();
        by_coherent[coherent.min(MOST_LISTED)] += 1;
        let is_solid = coherent >= SOLID_BONDS;
        let is_away = specimen.clearance_reaching_all(near.spheres.center(row), [0.0; 3])
            >= AWAY * (near.spheres.d_mm[row] + smallest_gap_mm);
        solid += u64::from(is_solid);
        away += u64::from(is_away);
        solid_away += u64::from(is_solid && is_away);
    }
    if ends == 0 {
        return Ok(None);
    }
    // Each bond has two ends, which have the same harmonics.
    let distinct = if counted == near.spheres.len() { ends as f64 / 2.0 } else { ends as f64 };
    let share = |count: u64| count as f64 / counted as f64;
    Ok(Some(BondOrder {
        references: counted as u64,
        like_ratio: LIKE_RATIO,
        reach_over_d: REACH,
        bonds_per_grain: ends as f64 / counted as f64,
        q6: product(&all, &all).sqrt() / ends as f64,
        q6_by_chance: 1.0 / distinct.sqrt(),
        solid_like_share: share(solid),
        solid_like_share_away_from_walls: (away > 0).then(|| solid_away as f64 / away as f64),
        share_by_coherent_bonds: by_coherent.each(share).into(),
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "order_tests.rs"]
mod tests;
