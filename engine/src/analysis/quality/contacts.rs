//! Gaps and contacts: how close grains are, and which sizes are neighbours.
//!
//! Gaps are counted from the smallest gap of the packing, so that a packing whose grains keep a constant distance has
//! contacts at that distance; their unit is the smallest diameter with that gap, `d_min + g_min`. Pairs are *near*
//! where their gap is at most [`NEAR`] units above the smallest, and in *contact* where it is at most [`CONTACT`] units
//! above.
//!
//! - Mark correlation: Pearson's correlation of `ln d` over the two grains of all near pairs, `r = cov(ln d_i, ln
//!   d_j) / var(ln d_i)`, means taken over the ends of the pairs (Stoyan and Stoyan, Fractals, Random Shapes and
//!   Point Fields, 1994, chapter 14; as the assortativity of a network Newman, Physical Review Letters 89, 2002,
//!   [10.1103/PhysRevLett.89.208701](https://doi.org/10.1103/PhysRevLett.89.208701)). 0: sizes of neighbours know
//!   nothing of one another; below 0: coarse grains have fine neighbours; above 0: like sizes gather.
//! - Shuffled partners: each grain keeps its number `k_i` of near pairs and gets partners at random (the configuration
//!   model of networks: Newman, `SIAM` Review 45, 2003,
//!   [10.1137/S003614450342480](https://doi.org/10.1137/S003614450342480)). A pair then joins grains `i` and `j` with a
//!   probability in proportion to `k_i k_j`; sums over all pairs are exact, by sorting.

use serde::{Deserialize, Serialize};

use super::classes::{QualityClass, class_of};
use super::near::Near;
use super::{Counter, Moments, QualityError, evenly};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::elementary::{exp, ln, powf};
use crate::sorting;

/// Gap of near pairs above the smallest gap, in units of `d_min + g_min`.
pub const NEAR: f64 = 0.05;
/// The same of contacts.
pub const CONTACT: f64 = 0.002;
/// Largest ratio of the diameters of grains of like size.
pub const LIKE_RATIO: f64 = 1.1;
/// Bins of the ratio of diameters.
const RATIO_BINS: usize = 8;
/// Grains whose nearest gap is measured at most: a relative error of the median below 1 %.
const MAX_GAP_REFERENCES: usize = 20_000;
/// Grains whose pairs are counted at most.
const MAX_REFERENCES: usize = 200_000;

/// Gaps to the nearest grain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GapFigures {
    /// Grains that were looked at.
    pub references: u64,
    /// Smallest gap.
    pub smallest_mm: f64,
    /// Median of the gap from a grain to its nearest grain.
    pub median_mm: f64,
    /// The median above the smallest gap, over the sum of the smallest diameter and the smallest gap.
    pub median_excess: f64,
}

/// Pairs of near grains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ContactFigures {
    /// Grains that were looked at, with their neighbours of all sizes.
    pub references: u64,
    /// Largest gap of a pair in contact.
    pub contact_gap_mm: f64,
    /// Mean number of contacts of a grain with grains.
    pub contacts_per_grain: f64,
    /// Share of the grains, by number, without a contact with a grain.
    pub without_contact_share: f64,
    /// Largest gap of a near pair.
    pub near_gap_mm: f64,
    /// Mean number of near grains of a grain.
    pub near_per_grain: f64,
    /// Correlation of the logarithms of the diameters of near pairs; `null` where all have one diameter.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub mark_correlation: Option<f64>,
    /// Largest ratio of the diameters of a pair of like size.
    pub like_ratio: f64,
    /// Share of the near pairs that are of like size.
    pub like_share: f64,
    /// The same for shuffled partners.
    pub like_share_shuffled: f64,
    /// Near pairs by size class of both grains, finer class first.
    pub by_class: Vec<ClassPairFigures>,
    /// Near pairs by ratio of their diameters, larger over smaller; empty where all have one diameter.
    pub by_ratio: Vec<RatioFigures>,
}

/// Near pairs of two size classes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ClassPairFigures {
    /// The finer class, counted from 0 in the order of `classes`.
    pub finer: u64,
    /// The coarser class.
    pub coarser: u64,
    /// Share of the near pairs.
    pub share: f64,
    /// The same for shuffled partners.
    pub share_shuffled: f64,
}

/// Near pairs in a range of ratios of diameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RatioFigures {
    /// Smallest ratio.
    pub ratio_min: f64,
    /// Largest ratio.
    pub ratio_max: f64,
    /// Share of the near pairs.
    pub share: f64,
    /// The same for shuffled partners.
    pub share_shuffled: f64,
}

/// Measures gaps to the nearest grain.
pub(super) fn gaps(near: &Near<'_>, control: &dyn Control) -> Result<Option<GapFigures>, QualityError> {
    let references = evenly(near.spheres.len(), MAX_GAP_REFERENCES);
    let counter = Counter { control, total: references.len(), what: "measuring gaps" };
    let mut gaps_mm: Vec<f64> = Vec::new();
    for (done, row) in references.enumerate() {
        counter.look(done)?;
        gaps_mm.extend(near.nearest_gap_mm(row));
    }
    sorting::ascending(&mut gaps_mm);
    let (Some(&smallest_mm), Some(&d_min_mm)) = (gaps_mm.first(), near.spheres.d_mm.last()) else {
        return Ok(None);
    };
    let median_mm = f64::midpoint(gaps_mm[(gaps_mm.len() - 1) / 2], gaps_mm[gaps_mm.len() / 2]);
    Ok(Some(GapFigures {
        references: gaps_mm.len() as u64,
        smallest_mm,
        median_mm,
        median_excess: (median_mm - smallest_mm) / (d_min_mm + smallest_mm),
    }))
}

/// Counts near pairs; `None` where there is none.
pub(super) fn contacts(
    near: &Near<'_>,
    classes: &[QualityClass],
    smallest_gap_mm: f64,
    control: &dyn Control,
) -> Result<Option<ContactFigures>, QualityError> {
    let d_mm = &near.spheres.d_mm;
    let (Some(&d_max_mm), Some(&d_min_mm)) = (d_mm.first(), d_mm.last()) else { return Ok(None) };
    let [near_gap_mm, contact_gap_mm] =
        [NEAR, CONTACT].each(|gap| smallest_gap_mm + gap * (d_min_mm + smallest_gap_mm));
    let bounds = ratio_bounds(d_max_mm / d_min_mm);
    let ln_d: Vec<f64> = crate::memory::collected(d_mm.iter().map(|d| ln(*d)))?;
    let class: Vec<u8> = crate::memory::collected(d_mm.iter().map(|&d| class_of(classes, d) as u8))?;
    let references = evenly(d_mm.len(), MAX_REFERENCES);
    let counted = references.len();
    let counter = Counter { control, total: counted, what: "counting contacts" };
    let (mut touching, mut without, mut like) = (0_u64, 0_u64, 0_u64);
    let mut by_class = vec![0_u64; classes.len() * classes.len()];
    let mut by_ratio = vec![0_u64; bounds.len().saturating_sub(1)];
    let (mut own, mut others, mut product) = (Moments::default(), Moments::default(), 0.0);
    // The grains looked at, each with the number of its near pairs, in descending order.
    let mut ends: Vec<End> = crate::memory::reserved(counted)?;
    // Logarithms are taken from the middle one, against cancellation.
    let middle = ln_d[ln_d.len() / 2];
    for (done, row) in references.enumerate() {
        counter.look(done)?;
        let (mut pairs, mut contacts) = (0_u32, 0_u32);
        near.for_each(row, near_gap_mm, |other| {
            pairs += 1;
            contacts += u32::from(other.gap_mm <= contact_gap_mm);
            let (x, y) = (ln_d[row] - middle, ln_d[other.row] - middle);
            own.add(x, 1.0);
            others.add(y, 1.0);
            product += x * y;
            let ratio = exp((x - y).abs());
            like += u64::from(ratio <= LIKE_RATIO);
            if let Some(last) = by_ratio.len().checked_sub(1) {
                let bin = bounds[1..].iter().position(|&bound| ratio <= bound).unwrap_or(last);
                by_ratio[bin] += 1;
            }
            let (one, two) = (class[row].min(class[other.row]), class[row].max(class[other.row]));
            by_class[usize::from(one) * classes.len() + usize::from(two)] += 1;
        });
        touching += u64::from(contacts);
        without += u64::from(contacts == 0);
        ends.push(End { d_mm: d_mm[row], class: class[row], pairs: f64::from(pairs) });
    }
    if own.weight == 0.0 {
        return Ok(None);
    }
    let all = own.weight;
    let shuffled = Shuffled::new(&ends);
    let spread = (own.variance() * others.variance()).sqrt();
    // What rounding leaves of a variance is none.
    let mark_correlation =
        (spread > 1.0e-12 * own.squares / all).then(|| (product / all - own.mean() * others.mean()) / spread);
    let share = |count: u64| count as f64 / all;
    let pairs_of_classes = (0..classes.len()).flat_map(|one| (one..classes.len()).map(move |two| (one, two)));
    Ok(Some(ContactFigures {
        references: counted as u64,
        contact_gap_mm,
        contacts_per_grain: touching as f64 / counted as f64,
        without_contact_share: without as f64 / counted as f64,
        near_gap_mm,
        near_per_grain: all / counted as f64,
        mark_correlation,
        like_ratio: LIKE_RATIO,
        like_share: share(like),
        like_share_shuffled: shuffled.share_of_ratios(0.0, LIKE_RATIO),
        by_class: pairs_of_classes
            .map(|(one, two)| ClassPairFigures {
                finer: one as u64,
                coarser: two as u64,
                share: share(by_class[one * classes.len() + two]),
                share_shuffled: shuffled.share_of_classes(one, two),
            })
            .collect(),
        by_ratio: by_ratio
            .iter()
            .zip(bounds.windows(2))
            .enumerate()
            .map(|(bin, (&count, ends))| RatioFigures {
                ratio_min: ends[0],
                ratio_max: ends[1],
                share: share(count),
                // The first bin has the ratio 1 too.
                share_shuffled: shuffled.share_of_ratios(if bin == 0 { 0.0 } else { ends[0] }, ends[1]),
            })
            .collect(),
    }))
}

/// Bounds of the bins of ratios, at equal steps of the logarithm; none where all diameters are equal.
fn ratio_bounds(largest: f64) -> Vec<f64> {
    if largest <= 1.0 {
        return Vec::new();
    }
    (0..=RATIO_BINS).map(|bin| powf(largest, bin as f64 / RATIO_BINS as f64)).collect()
}

/// A grain with the number of its near pairs.
#[derive(Clone, Copy)]
struct End {
    d_mm: f64,
    class: u8,
    pairs: f64,
}

/// Pairs of shuffled partners: grains `i` and `j` in proportion to `k_i k_j`.
struct Shuffled<'a> {
    /// In descending order of the diameter.
    ends: &'a [End],
    /// Sums of `k` before each grain.
    before: Vec<f64>,
    /// Sum of `k_i k_j` over all pairs of two grains, each counted once.
    all: f64,
}

impl<'a> Shuffled<'a> {
    fn new(ends: &'a [End]) -> Self {
        let mut before = Vec::with_capacity(ends.len() + 1);
        let (mut sum, mut squares) = (0.0, 0.0);
        before.push(0.0);
        for end in ends {
            sum += end.pairs;
            squares += end.pairs * end.pairs;
            before.push(sum);
        }
        Self { ends, before, all: (sum * sum - squares) / 2.0 }
    }

    fn share(&self, sum: f64) -> f64 {
        if self.all > 0.0 { sum / self.all } else { 0.0 }
    }

    /// Share of the pairs whose ratio of diameters is above one bound and at most another.
    fn share_of_ratios(&self, above: f64, at_most: f64) -> f64 {
        // The partners that are smaller or equal come after each grain.
        let mut sum = 0.0;
        let (mut from, mut until) = (0, 0);
        for (i, end) in self.ends.iter().enumerate() {
            let ratio = |j: usize| end.d_mm / self.ends[j].d_mm;
            while until < self.ends.len() && ratio(until) <= at_most {
                until += 1;
            }
            while from < self.ends.len() && ratio(from) <= above {
                from += 1;
            }
            let first = from.max(i + 1);
            if until > first {
                sum += end.pairs * (self.before[until] - self.before[first]);
            }
        }
        self.share(sum)
    }

    /// Share of the pairs of two classes.
    fn share_of_classes(&self, one: usize, two: usize) -> f64 {
        let sums = |class: usize| {
            let of_class = self.ends.iter().filter(|end| usize::from(end.class) == class);
            of_class.fold([0.0; 2], |[sum, squares], end| [sum + end.pairs, squares + end.pairs.powi(2)])
        };
        let ([first, squares], [second, _]) = (sums(one), sums(two));
        self.share(if one == two { (first * first - squares) / 2.0 } else { first * second })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "contacts_tests.rs"]
mod tests;
