//! The shares of stockpiles whose blend comes nearest to a curve, or into a band.
//!
//! Let `P_ij` be what passes sieve `i` of stockpile `j`, and `x_j` its share of the volume of all aggregate. The blend
//! passes `p = P x`. The shares minimise the sum over the sieves of
//!
//! - `(p_i - t_i)^2` for a curve `t`;
//! - `e_i^2 + 1e-6 (p_i - m_i)^2` for a band, where `e_i` is the part of `p_i` outside of the limits and `m_i` their
//!   mean: the blend lies in the band where one can, to about 1e-6, and then as near to its middle as it can,
//!
//! with all shares at least 0 and a sum of 1 (`least_squares`). Where stockpiles are blends of others, several shares
//! meet the target alike, and one of them is the answer.

mod least_squares;

use serde::Serialize;
use serde_json::{Value, json};

use crate::elementary::ln;
use crate::mix::sieve::STANDARD_SIEVES_MM;
use crate::mix::{GradingFigures, Passing, curve, figures};
use crate::request::{Aggregate, BlendRequest, Form, Grading, Mix, Stockpile, Target};
use least_squares::{Limits, shares};

/// Residual above which a warning names the sieve.
const LARGE_RESIDUAL: f64 = 0.05;

/// The blend that comes nearest to a target.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Blend {
    /// The stockpiles with their shares, in the order of the request.
    pub aggregates: Vec<BlendedAggregate>,
    /// Each sieve at which the target is to be met, from fine to coarse.
    pub sieves: Vec<BlendedSieve>,
    /// Largest size of a residual.
    pub largest_residual: f64,
    /// Root of the mean square of the residuals.
    pub root_mean_square_residual: f64,
    /// The grading curve of the blend: `[diameter in mm, share passing]` from fine to coarse.
    pub curve: Vec<[f64; 2]>,
    /// Figures of the blend; absent where all of it passes 0.063 mm.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub figures: Option<GradingFigures>,
    /// What to look at before the shares are used, in words.
    pub warnings: Vec<String>,
    /// The part of a request that has this blend: `{"mix": {"aggregates": [...]}}`, without the stockpiles that have
    /// no share.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub request: Value,
}

/// The share of a stockpile.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BlendedAggregate {
    /// What it is called.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Share of the volume of all aggregate.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub share: f64,
    /// Share of its mass, where the stockpiles have densities.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_share: Option<f64>,
}

/// What passes a sieve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BlendedSieve {
    /// Openings of the sieve.
    pub sieve_mm: f64,
    /// The least that is to pass.
    pub target_low: f64,
    /// The most that is to pass: that of `target_low` for a curve.
    pub target_high: f64,
    /// What passes of the blend.
    pub passing: f64,
    /// What passes of the blend less the limit that it breaks; 0 in a band.
    pub residual: f64,
}

impl Blend {
    /// Finds the shares.
    #[must_use]
    pub fn of(request: &BlendRequest) -> Self {
        let limits = limits(request);
        let matrix: Vec<Vec<f64>> = request
            .aggregates
            .iter()
            .map(|aggregate| {
                let passing = Passing::of(&aggregate.grading);
                limits.iter().map(|limit| passing.share(limit.sieve_mm)).collect()
            })
            .collect();
        let shares = shares(&matrix, &limits);
        let sieves: Vec<BlendedSieve> = limits
            .iter()
            .enumerate()
            .map(|(row, limit)| {
                let passing: f64 =
                    matrix.iter().zip(&shares).map(|(column, share)| column[row] * share).sum();
                let residual = passing - passing.clamp(limit.low, limit.high);
                BlendedSieve {
                    sieve_mm: limit.sieve_mm,
                    target_low: limit.low,
                    target_high: limit.high,
                    passing,
                    residual,
                }
            })
            .collect();
        let largest_residual = sieves.iter().map(|sieve| sieve.residual.abs()).fold(0.0, f64::max);
        let squares: f64 = sieves.iter().map(|sieve| sieve.residual * sieve.residual).sum();
        let mix = mix(request, &shares);
        Self {
            aggregates: blended(&request.aggregates, &shares),
            largest_residual,
            root_mean_square_residual: (squares / sieves.len() as f64).sqrt(),
            curve: curve(&mix),
            figures: figures(&mix),
            warnings: warnings(request, &shares, &sieves),
            request: json!({"mix": {"aggregates": mix.aggregates}}),
            sieves,
        }
    }
}

/// What is to pass each sieve.
fn limits(request: &BlendRequest) -> Vec<Limits> {
    let curve = match &request.target {
        Target::Curve(grading) => Some(Passing::of(grading)),
        Target::Band(_) => None,
    };
    let at = |sieve_mm: f64| -> [f64; 2] {
        match (&request.target, &curve) {
            (Target::Band(points), _) => [1, 2].map(|limit| between(points, limit, sieve_mm)),
            (_, curve) => [curve.as_ref().map_or(0.0, |curve| curve.share(sieve_mm)); 2],
        }
    };
    let of_target: Vec<f64> = match &request.target {
        _ if !request.sieves_mm.is_empty() => request.sieves_mm.clone(),
        Target::Curve(grading) => sieves_of(grading),
        Target::Band(points) => points.iter().map(|point| point[0]).collect(),
    };
    let limits = of_target.into_iter().map(|sieve_mm| {
        let [low, high] = at(sieve_mm);
        Limits { sieve_mm, low, high }
    });
    limits.collect()
}

/// The sieves of a curve: its own, or the standard ones up to the first that all mass passes.
fn sieves_of(grading: &Grading) -> Vec<f64> {
    let form = grading.form();
    if let Form::Points { points, .. } = &form {
        return points.iter().map(|point| point[0]).collect();
    }
    let (low, high) = form.range_mm();
    let upto = STANDARD_SIEVES_MM
        .iter()
        .position(|&mm| mm >= high)
        .map_or(STANDARD_SIEVES_MM.len(), |last| last + 1);
    let from = STANDARD_SIEVES_MM[..upto].iter().rposition(|&mm| mm < low).unwrap_or(0);
    let mut sieves = STANDARD_SIEVES_MM[from..upto].to_vec();
    if sieves.last().is_none_or(|&last| last < high) {
        sieves.push(high);
    }
    sieves
}

/// A limit of a band at a sieve between its points: linear in the logarithm of the diameter.
fn between(points: &[[f64; 3]], limit: usize, sieve_mm: f64) -> f64 {
    let next = points.partition_point(|point| point[0] < sieve_mm);
    let (Some(above), Some(below)) = (points.get(next), next.checked_sub(1).map(|below| &points[below]))
    else {
        let end = if next == 0 { points.first() } else { points.last() };
        return end.map_or(0.0, |end| end[limit]);
    };
    let part = ln(sieve_mm / below[0]) / ln(above[0] / below[0]);
    below[limit] + part * (above[limit] - below[limit])
}

/// The mix of the stockpiles that have a share.
fn mix(request: &BlendRequest, shares: &[f64]) -> Mix {
    let used = request.aggregates.iter().zip(shares).filter(|(_, share)| **share > 0.0);
    let aggregate = |(stockpile, &share): (&Stockpile, &f64)| Aggregate {
        name: stockpile.name.clone(),
        share,
        density_kg_m3: stockpile.density_kg_m3,
        grading: stockpile.grading.clone(),
        d_min_mm: None,
        shape: None,
        shapes: Vec::new(),
    };
    Mix { packing_model: request.packing_model, ..Mix::of_aggregates(used.map(aggregate).collect()) }
}

fn blended(aggregates: &[Stockpile], shares: &[f64]) -> Vec<BlendedAggregate> {
    let mass =
        |(aggregate, share): (&Stockpile, &f64)| aggregate.density_kg_m3.map(|density| density * share);
    let all: Option<f64> = aggregates.iter().zip(shares).map(mass).sum();
    aggregates
        .iter()
        .zip(shares)
        .map(|(aggregate, share)| BlendedAggregate {
            name: aggregate.name.clone(),
            share: *share,
            mass_share: mass((aggregate, share)).zip(all).map(|(mass, all)| mass / all),
        })
        .collect()
}

fn warnings(request: &BlendRequest, shares: &[f64], sieves: &[BlendedSieve]) -> Vec<String> {
    let percent = |share: f64| (1000.0 * share).round() / 10.0;
    let mut warnings = Vec::new();
    for (number, (aggregate, share)) in request.aggregates.iter().zip(shares).enumerate() {
        let name = aggregate.name.clone().unwrap_or_else(|| format!("number {}", number + 1));
        warnings.extend(
            aggregate
                .grading
                .completions(0.0, f64::INFINITY)
                .iter()
                .map(|words| format!("aggregate {name}: {words}")),
        );
        if let Form::Points { points, .. } = aggregate.grading.form()
            && let [finest, passing] = points[0]
            && passing > 0.0
        {
            warnings.push(format!(
                "aggregate {name}: {} % of it passes its finest sieve, {finest} mm, of which the curve says no more: it \
                 is taken as finer than all sieves",
                percent(passing)
            ));
        }
        if *share == 0.0 {
            warnings.push(format!("aggregate {name} has no share: the target is met as well without it"));
        }
    }
    let worst = sieves.iter().max_by(|a, b| a.residual.abs().total_cmp(&b.residual.abs()));
    if let Some(worst) = worst.filter(|sieve| sieve.residual.abs() > LARGE_RESIDUAL) {
        let missing = if worst.residual > 0.0 { "coarser" } else { "finer" };
        warnings.push(format!(
            "at {} mm {} % pass and {} % are asked for: no shares of these aggregates come nearer in all; a {missing} \
             one would",
            worst.sieve_mm,
            percent(worst.passing),
            percent(worst.passing - worst.residual),
        ));
    }
    warnings
}

#[cfg(test)]
mod tests;
