//! How far coarse and fine grains lie apart along a field, and how probable that is by chance.
//!
//! The statistic is `D = sum w_i u_i`: `u_i` in 0..1 is where grain `i` lies in the field, `w_i` its weight in the mean
//! over the coarsest third of the mass less its weight in the mean over the finest. Coarse grains keep one another
//! apart, so that `D^2` without a gradient is smaller than if sizes were dealt out at random to the same places: by the
//! factor `S(k)`, the structure factor of the weights at the wave number of the field (Hansen and `McDonald`, Theory of
//! Simple Liquids, 4th ed. 2013, chapter 4). `S` is measured in the same packing, by sums `sum w_i f(u_i, v_i, ..)`
//! with products `f` of cosines that have a mirror image across the field, in which a gradient cancels. `D^2` over the
//! mean square of these sums is a studentised statistic (Welch, Journal of the American Statistical Association 85,
//! 1990); its p value is that of random permutations of the sizes, for which the same statistic is computed, so that it
//! holds for few grains too. At wave numbers above the field's `S` is larger, by a factor `1 + c (k d)^2` that is taken
//! off; `d` is the mean diameter of the coarsest third and `c` is fitted (`RISE`).

use std::f64::consts::PI;

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::arrays::{self, Each as _};
use crate::distance::DistanceRule;
use crate::domain::Region;
use crate::elementary::{cos, ln_1p, sin};
use crate::mix::sphere_volume;
use crate::packing::{GrainsRef, SegregationReport, Separation, SeparationAcross, Spheres};
use crate::request::{Axis, FieldDirection, GradientField, Specimen, SpecimenFace};
use crate::rng::{Stream, stream, uniform};
use crate::segregation::share_of_field;
use crate::sorting;

/// Permutations of the sizes.
const PERMUTATIONS: u32 = 999;
/// `c / (1 - S)` in the rise of the structure factor with the wave number: chosen by the packings
/// without a gradient of `docs/gradient.md`; from 0.35 to 0.7 it makes little difference.
const RISE: f64 = 0.5;
/// Most of the sum of squares of the orders of cosines in a product.
const MOST_ORDERS: u32 = 5;
/// Points along each axis of the grid over which wave numbers of products are averaged.
const GRID: usize = 9;
/// Grains of most weight that are dealt out one by one. All others together have a sum that is normal, by the
/// central limit theorem, with known moments.
const DEALT: usize = 256;
/// Sums of as many numbers of the order of 1 agree to this.
const ROUNDING: f64 = 1.0e-12;

/// Measures the separation along a field and across it. Grains come from the largest down; each counts where it
/// lies in the room that the rule leaves for its centre, shaped grains as spheres of equal volume. The seed
/// is that of the packing.
pub fn separation<'a>(
    grains: impl Into<GrainsRef<'a>>,
    specimen: &Specimen,
    rule: &DistanceRule,
    field: GradientField,
    seed: u64,
) -> SegregationReport {
    let grains = grains.into();
    let spheres = &*grains.equivalent_spheres();
    let fields = [Some(field), across(field, Axis::X), across(field, Axis::Y), across(field, Axis::Z)];
    let thirds = Thirds::of(&spheres.d_mm);
    let present: Vec<GradientField> = fields.into_iter().flatten().collect();
    let measured: Vec<Measured> =
        present.iter().map(|&field| Measured::new(spheres, specimen, rule, field, &thirds)).collect();
    let products = Products::new(&present, specimen, thirds.mean_diameter_mm(&spheres.d_mm), rule);
    let mut rng = stream(seed, Stream::Segregation);
    let beyond = permute(&thirds, &measured, &products, &mut rng);
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
        let mut order: Vec<u32> = (0..d_mm.len() as u32).collect();
        sorting::by_number(&mut order, |&i| -(coarsest[i as usize] - finest[i as usize]).abs());
        Self { coarsest, finest, order }
    }

    /// Mean diameter over the coarsest third.
    fn mean_diameter_mm(&self, d_mm: &[f64]) -> f64 {
        self.coarsest.iter().zip(d_mm).map(|(weight, d)| weight * d).sum()
    }

    /// Weight of a grain in the difference.
    fn weight(&self, grain: usize) -> f64 {
        self.coarsest[grain] - self.finest[grain]
    }
}

/// One field: where the grains lie on it.
struct Measured {
    shares: Vec<f64>,
    /// Cosines of half a turn from one end of the field to the other.
    cosines: Vec<f64>,
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
        let (coarsest, finest) = (mean(&thirds.coarsest), mean(&thirds.finest));
        let cosines = shares.iter().map(|share| cos(PI * share)).collect();
        Self { shares, cosines, coarsest, finest }
    }
}

/// The orders of the cosines in a product, by field; 0 where the field is left out.
type Orders = [u32; 4];

/// Cosine and sine of `order * PI * share`, by the order, for one share of a field.
struct Turns {
    cosines: [f64; 3],
    sines: [f64; 3],
}

impl Turns {
    fn of(share: f64) -> Self {
        let angles = [0.0, 1.0, 2.0].each(|order| PI * order * share);
        Self { cosines: angles.each(cos), sines: angles.each(sin) }
    }
}

/// The products that the structure factor is measured with, and the squares of wave numbers times the mean diameter of
/// the coarsest third: of the products and of the fields.
struct Products {
    orders: Vec<Orders>,
    wave2: Vec<f64>,
    field_wave2: Vec<f64>,
}

impl Products {
    /// The products for these fields, the first of them that of a gradient.
    fn new(fields: &[GradientField], specimen: &Specimen, diameter_mm: f64, rule: &DistanceRule) -> Self {
        let orders = all_orders(fields.len());
        let clearance = diameter_mm / 2.0 + rule.wall_gap_mm(diameter_mm);
        let (mut of_products, mut of_fields) = (vec![[0.0; 2]; orders.len()], vec![0.0; fields.len()]);
        let mut points = 0.0;
        if let Some(region) = specimen.center_region(clearance) {
            let share = |field: usize, p: [f64; 3]| share_of_field(fields[field], &region, p);
            let step = 1e-4 * specimen.bounds_mm().into_iter().fold(f64::INFINITY, f64::min);
            for p in grid(&region).filter(|p| region.contains(*p)) {
                let slopes: Vec<[f64; 3]> = (0..fields.len())
                    .map(|field| {
                        [0, 1, 2].each(|axis| {
                            let moved = |by: f64| {
                                let mut q = p;
                                q[axis] += by;
                                share(field, q)
                            };
                            (moved(step) - moved(-step)) / (2.0 * step)
                        })
                    })
                    .collect();
                let shares: Vec<f64> = (0..fields.len()).map(|field| share(field, p)).collect();
                for (sum, slope) in of_fields.iter_mut().zip(&slopes) {
                    *sum += slope.iter().map(|x| x * x).sum::<f64>();
                }
                let turns: Vec<Turns> = shares.iter().map(|share| Turns::of(*share)).collect();
                for (orders, sums) in orders.iter().zip(&mut of_products) {
                    let order = |f: usize| orders[f] as usize;
                    let value: f64 = (0..fields.len()).map(|f| turns[f].cosines[order(f)]).product();
                    let slope = |axis: usize| -> f64 {
                        (0..fields.len())
                            .map(|f| {
                                let others: f64 = (0..fields.len())
                                    .filter(|&g| g != f)
                                    .map(|g| turns[g].cosines[order(g)])
                                    .product();
                                -PI * f64::from(orders[f])
                                    * turns[f].sines[order(f)]
                                    * slopes[f][axis]
                                    * others
                            })
                            .sum()
                    };
                    sums[0] += value * value;
                    sums[1] += (0..3).map(|axis| slope(axis).powi(2)).sum::<f64>();
                }
                points += 1.0;
            }
        }
        let d2 = diameter_mm * diameter_mm;
        let wave2 = of_products.iter().map(|[f2, slope2]| if *f2 > 0.0 { slope2 / f2 * d2 } else { 0.0 });
        // A share of a field has the variance 1/12.
        let field_wave2 =
            of_fields.iter().map(|sum| if points > 0.0 { 12.0 * sum / points * d2 } else { 0.0 });
        Self { wave2: wave2.collect(), field_wave2: field_wave2.collect(), orders }
    }

    /// The value of a product at a grain.
    fn at(orders: &Orders, measured: &[Measured], grain: usize) -> f64 {
        let factor = |(measured, order): (&Measured, &u32)| {
            let x = measured.cosines[grain];
            match order {
                0 => 1.0,
                1 => x,
                // Chebyshev's polynomial: the cosine of twice the angle.
                _ => 2.0 * x * x - 1.0,
            }
        };
        measured.iter().zip(orders).map(factor).product()
    }

    /// The squares of differences along the fields over the mean square of the products, all by their variance under
    /// permutation. The product that is the cosine of a field itself does not count for it.
    fn statistics(&self, fields: &[f64], products: &[f64]) -> Vec<f64> {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let rise = RISE * (1.0 - mean(products)).max(0.0);
        let at_rest = |(value, wave2): (&f64, &f64)| value / (1.0 + rise * wave2);
        let products: Vec<f64> = products.iter().zip(&self.wave2).map(at_rest).collect();
        let one = |(field, value): (usize, f64)| {
            let mut own = [0; 4];
            own[field] = 1;
            let others = || self.orders.iter().zip(&products).filter(|(orders, _)| **orders != own);
            let of_others = others().map(|(_, value)| value).sum::<f64>() / others().count().max(1) as f64;
            if value > 0.0 { value / of_others.max(f64::MIN_POSITIVE) } else { 0.0 }
        };
        fields.iter().zip(&self.field_wave2).map(at_rest).enumerate().map(one).collect()
    }
}

/// Products of cosines of low order in which some factor across the first field is odd: such a product changes its sign
/// with the mirror image across the field.
fn all_orders(fields: usize) -> Vec<Orders> {
    let mut found = Vec::new();
    for code in 1..3_u32.pow(fields as u32) {
        let orders: Orders = arrays::from_fn(|f| if f < fields { code / 3_u32.pow(f as u32) % 3 } else { 0 });
        let odd_across = orders[1..].iter().any(|order| order % 2 == 1);
        if odd_across && orders.iter().map(|order| order * order).sum::<u32>() <= MOST_ORDERS {
            found.push(orders);
        }
    }
    found
}

/// Points of an even grid in the box around a region.
fn grid(region: &Region) -> impl Iterator<Item = [f64; 3]> {
    let (low, high) = (region.low, region.high);
    (0..GRID.pow(3)).map(move |i| {
        let place = [i % GRID, i / GRID % GRID, i / GRID / GRID];
        arrays::from_fn(|a| low[a] + (high[a] - low[a]) * (place[a] as f64 + 0.5) / GRID as f64)
    })
}

/// Permutes the sizes; says how often each statistic was at least as large as the one measured.
fn permute(
    thirds: &Thirds,
    measured: &[Measured],
    products: &Products,
    rng: &mut Xoshiro256PlusPlus,
) -> Vec<u32> {
    let n = thirds.order.len();
    let dealt = n.min(DEALT);
    let weights: Vec<f64> = thirds.order.iter().map(|&grain| thirds.weight(grain as usize)).collect();
    let weight_moments = Moments::of(&weights);
    let rest = Moments::of(&weights[dealt..]);
    // All functions of the place, shares of fields and then products, row by row of one place each: sums of all
    // functions are made side by side. Single precision is enough for sums that are compared with one another, and
    // halves the memory.
    let fields = measured.len();
    let functions = fields + products.orders.len();
    let mut values = Vec::with_capacity(n * functions);
    for grain in 0..n {
        values.extend(measured.iter().map(|field| field.shares[grain] as f32));
        values.extend(products.orders.iter().map(|orders| Products::at(orders, measured, grain) as f32));
    }
    let row = |grain: u32| &values[grain as usize * functions..][..functions];
    let mut all = vec![Moments::default(); functions];
    for grain in 0..n as u32 {
        for (all, value) in all.iter_mut().zip(row(grain)) {
            all.add(f64::from(*value));
        }
    }
    // A function that is constant but for rounding, as a cosine across the field of grains on a line along it, has a
    // sum of rounding errors, which must not be compared with the difference.
    let spread_of = |all: &Moments| if all.spread() > ROUNDING * n as f64 { all.spread() } else { 0.0 };
    let spread: Vec<f64> =
        all.iter().map(|all| weight_moments.spread() * spread_of(all) / (n as f64 - 1.0).max(1.0)).collect();
    let statistics = |sums: &[f64]| {
        let squares: Vec<f64> =
            sums.iter().zip(&spread).map(|(x, v)| if *v > 0.0 { x * x / v } else { 0.0 }).collect();
        products.statistics(&squares[..fields], &squares[fields..])
    };
    let mut sums = vec![0.0; functions];
    for (&grain, weight) in thirds.order.iter().zip(&weights) {
        add_weighted(&mut sums, row(grain), *weight);
    }
    for sum in &mut sums {
        *sum = if sum.abs() > ROUNDING { *sum } else { 0.0 };
    }
    let found = statistics(&sums);
    let mut places: Vec<u32> = (0..n as u32).collect();
    let mut beyond = vec![0; fields];
    for _ in 0..PERMUTATIONS {
        // The first places of a random order; that of the last time is as good to start from as any.
        for k in 0..dealt {
            let other = k + (uniform(rng) * (n - k) as f64) as usize;
            places.swap(k, other);
        }
        let mut sums = vec![0.0; functions];
        let mut taken = vec![Moments::default(); functions];
        for (&place, weight) in places.iter().zip(&weights[..dealt]) {
            add_weighted(&mut sums, row(place), *weight);
            for (taken, value) in taken.iter_mut().zip(row(place)) {
                taken.add(f64::from(*value));
            }
        }
        if dealt < n {
            for ((sum, all), taken) in sums.iter_mut().zip(&all).zip(&taken) {
                *sum += rest.normal_sum(&all.without(taken), rng);
            }
        }
        for ((beyond, found), value) in beyond.iter_mut().zip(&found).zip(statistics(&sums)) {
            *beyond += u32::from(value >= found * (1.0 - ROUNDING));
        }
    }
    beyond
}

/// Adds the values of functions times a weight to their sums.
fn add_weighted(sums: &mut [f64], values: &[f32], weight: f64) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += f64::from(*value) * weight;
    }
}

/// Number, sum and sum of squares.
#[derive(Clone, Copy, Default)]
struct Moments {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn of(values: &[f64]) -> Self {
        let mut moments = Self::default();
        for value in values {
            moments.add(*value);
        }
        moments
    }

    fn add(&mut self, x: f64) {
        self.n += 1.0;
        self.sum += x;
        self.squares += x * x;
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
        let radius = (-2.0 * ln_1p(-uniform(rng))).sqrt();
        mean + variance.sqrt() * radius * cos(2.0 * PI * uniform(rng))
    }
}

#[cfg(test)]
#[path = "separation_tests.rs"]
mod tests;
