//! How far coarse and fine grains lie apart along a field, and whether chance would do the same.
//!
//! The coarsest and the finest third of the mass are compared by where they lie on average; that the sizes of all
//! grains are dealt out anew, at random, to the places there are, is the chance they are compared with. It knows
//! finished packings; it must never know how they were made.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::distance::DistanceRule;
use crate::mix::sphere_volume;
use crate::packing::{SegregationReport, Separation, SeparationAcross, Spheres};
use crate::request::{Axis, FieldDirection, GradientField, Specimen, SpecimenFace};
use crate::rng::{Stream, stream, uniform};
use crate::segregation::share_of_field;

/// Times that sizes are dealt out anew.
const PERMUTATIONS: u32 = 999;
/// Grains of most weight that are dealt out one by one. All others together have a sum that is normal, by the
/// central limit theorem, with known moments.
const DEALT: usize = 1024;
/// Sums of as many numbers of the order of 1 agree to this.
const ROUNDING: f64 = 1.0e-12;

/// Measures the separation along a field and across it. Grains come from the largest down; each counts where it
/// lies in the room that the rule leaves for its centre. The seed is that of the packing.
pub fn separation(
    spheres: &Spheres,
    specimen: &Specimen,
    rule: &DistanceRule,
    field: GradientField,
    seed: u64,
) -> SegregationReport {
    let fields = [Some(field), across(field, Axis::X), across(field, Axis::Y), across(field, Axis::Z)];
    let thirds = Thirds::of(&spheres.d_mm);
    let measured: Vec<Measured> = fields
        .into_iter()
        .flatten()
        .map(|field| Measured::new(spheres, specimen, rule, field, &thirds))
        .collect();
    let mut rng = stream(seed, Stream::Segregation);
    let beyond = deal(&thirds, &measured, &mut rng);
    let mut separations = measured.iter().zip(beyond).map(|(measured, beyond)| Separation {
        coarsest_third: measured.coarsest,
        finest_third: measured.finest,
        difference: measured.coarsest - measured.finest,
        p_value: f64::from(beyond + 1) / f64::from(PERMUTATIONS + 1),
    });
    let mut next = |field: Option<GradientField>| field.and_then(|_| separations.next());
    SegregationReport {
        along: next(fields[0]).unwrap_or_default(),
        across: SeparationAcross { x: next(fields[1]), y: next(fields[2]), z: next(fields[3]) },
        permutations: PERMUTATIONS,
    }
}

/// The field along an axis that a field does not lie along itself.
fn across(field: GradientField, axis: Axis) -> Option<GradientField> {
    let own = match field {
        GradientField::Linear { axis, .. } => Some(axis),
        GradientField::Face { face: SpecimenFace::XMin | SpecimenFace::XMax } => Some(Axis::X),
        GradientField::Face { face: SpecimenFace::YMin | SpecimenFace::YMax } => Some(Axis::Y),
        GradientField::Face { face: SpecimenFace::ZMin | SpecimenFace::ZMax } => Some(Axis::Z),
        GradientField::Face { face: SpecimenFace::Side } => None,
    };
    (own != Some(axis)).then_some(GradientField::Linear { axis, direction: FieldDirection::Up })
}

/// Each grain's weight in the mean over a third of the mass.
struct Thirds {
    coarsest: Vec<f64>,
    finest: Vec<f64>,
    /// Grains in the order in which they are dealt out: those of most weight first.
    order: Vec<u32>,
}

impl Thirds {
    /// Grains of one diameter share the third that their diameter is in, for nothing tells them apart.
    fn of(d_mm: &[f64]) -> Self {
        let all: f64 = d_mm.iter().map(|&d| sphere_volume(d)).sum();
        let (mut coarsest, mut finest) = (Vec::with_capacity(d_mm.len()), Vec::with_capacity(d_mm.len()));
        let mut coarser = 0.0;
        for equal in d_mm.chunk_by(|a, b| a == b) {
            let own = sphere_volume(equal[0]) / all;
            let to = coarser + own * equal.len() as f64;
            let inside = |from: f64, until: f64| {
                let common = (to.min(until) - coarser.max(from)).max(0.0);
                3.0 * own * common / (to - coarser)
            };
            coarsest.extend(equal.iter().map(|_| inside(0.0, 1.0 / 3.0)));
            finest.extend(equal.iter().map(|_| inside(2.0 / 3.0, 2.0)));
            coarser = to;
        }
        // What rounding leaves over or takes away.
        for weights in [&mut coarsest, &mut finest] {
            let sum: f64 = weights.iter().sum();
            for weight in weights.iter_mut() {
                *weight /= sum;
            }
        }
        let mut thirds = Self { order: (0..d_mm.len() as u32).collect(), coarsest, finest };
        let weight: Vec<f64> = (0..d_mm.len()).map(|i| thirds.weight(i).abs()).collect();
        thirds.order.sort_unstable_by(|&i, &j| {
            weight[j as usize].total_cmp(&weight[i as usize]).then_with(|| i.cmp(&j))
        });
        thirds
    }

    /// Weight of a grain in the difference.
    fn weight(&self, grain: usize) -> f64 {
        self.coarsest[grain] - self.finest[grain]
    }
}

/// One field: where the grains lie on it.
struct Measured {
    shares: Vec<f64>,
    coarsest: f64,
    finest: f64,
}

impl Measured {
    fn new(
        spheres: &Spheres,
        specimen: &Specimen,
        rule: &DistanceRule,
        field: GradientField,
        thirds: &Thirds,
    ) -> Self {
        let share = |i: usize| {
            let d = spheres.d_mm[i];
            let region = specimen.center_region(d / 2.0 + rule.wall_gap_mm(d));
            // A grain with one place only lies in the middle of its room.
            region.map_or(0.5, |region| share_of_field(field, &region, spheres.center(i)))
        };
        let shares: Vec<f64> = (0..spheres.len()).map(share).collect();
        let mean = |weights: &[f64]| weights.iter().zip(&shares).map(|(weight, share)| weight * share).sum();
        Self { coarsest: mean(&thirds.coarsest), finest: mean(&thirds.finest), shares }
    }
}

/// Deals sizes out to the places; says how often each difference was at least as large as the one measured.
fn deal(thirds: &Thirds, measured: &[Measured], rng: &mut Xoshiro256PlusPlus) -> Vec<u32> {
    let n = thirds.order.len();
    let dealt = n.min(DEALT);
    let weights: Vec<f64> = thirds.order.iter().map(|&grain| thirds.weight(grain as usize)).collect();
    let rest = Moments::of(weights[dealt..].iter().copied());
    let all: Vec<Moments> = measured.iter().map(|m| Moments::of(m.shares.iter().copied())).collect();
    let mut places: Vec<u32> = (0..n as u32).collect();
    let mut beyond = vec![0; measured.len()];
    for _ in 0..PERMUTATIONS {
        // The first places of a random order; that of the last time is as good to start from as any.
        for k in 0..dealt {
            let other = k + (uniform(rng) * (n - k) as f64) as usize;
            places.swap(k, other);
        }
        for ((field, all), beyond) in measured.iter().zip(&all).zip(&mut beyond) {
            let taken = || places[..dealt].iter().map(|&place| field.shares[place as usize]);
            let mut difference: f64 = taken().zip(&weights).map(|(share, weight)| share * weight).sum();
            if dealt < n {
                difference += rest.normal_sum(&all.without(&Moments::of(taken())), rng);
            }
            let asked = (field.coarsest - field.finest).abs();
            *beyond += u32::from(difference.abs() >= asked - ROUNDING);
        }
    }
    beyond
}

/// Number, sum and sum of squares.
#[derive(Clone, Copy)]
struct Moments {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let zero = Self { n: 0.0, sum: 0.0, squares: 0.0 };
        values.fold(zero, |m, x| Self { n: m.n + 1.0, sum: m.sum + x, squares: m.squares + x * x })
    }

    fn without(&self, part: &Self) -> Self {
        Self { n: self.n - part.n, sum: self.sum - part.sum, squares: self.squares - part.squares }
    }

    /// Sum of squares about the mean.
    fn spread(&self) -> f64 {
        (self.squares - self.sum * self.sum / self.n).max(0.0)
    }

    /// A sum of products of weights and as many values in random order, taken as normal.
    fn normal_sum(&self, values: &Self, rng: &mut Xoshiro256PlusPlus) -> f64 {
        let mean = self.sum * values.sum / self.n;
        let variance = self.spread() * values.spread() / (self.n - 1.0).max(1.0);
        // Box and Muller (1958).
        let radius = (-2.0 * (-uniform(rng)).ln_1p()).sqrt();
        mean + variance.sqrt() * radius * (2.0 * std::f64::consts::PI * uniform(rng)).cos()
    }
}

#[cfg(test)]
#[path = "separation_tests.rs"]
mod tests;
