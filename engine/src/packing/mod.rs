//! The result of a run as plain data: the grains in columns, and the report about them.
//!
//! Every file format writes these types and the server stores them. Reports of results without a field that was added
//! later can be read: such fields have defaults.

mod grains;
mod partial;

use serde::{Deserialize, Serialize};

pub use grains::{Grains, GrainsRef, Solids, Spheres};
pub use partial::{Partial, PartialReason};

/// Name and version of the random generator, recorded in every result: the stream behind a seed
/// is part of what a seed means.
pub const RNG_NAME: &str = "xoshiro256++ (rand_xoshiro 0.8), streams by splitmix64";

/// A finished, checked packing.
#[derive(Clone, Debug, PartialEq)]
pub struct Packing {
    /// The grains.
    pub grains: Grains,
    /// All that is known about them.
    pub report: Report,
}

/// What is known about a packing, but for its grains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Report {
    /// The figures people ask for first.
    pub summary: Summary,
    /// Wall-clock time of each phase.
    pub timings_s: Timings,
    /// What the algorithms counted.
    pub statistics: Statistics,
    /// What the independent check found.
    pub check: CheckReport,
    /// What a user should know about this packing, one sentence each; empty where there is nothing. A total volume or
    /// a size class that misses what the mix requests is reported here.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// The growth of grains over the run; empty for methods that do not grow them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub growth_curve: Vec<GrowthPoint>,
    /// How far coarse and fine grains lie apart, where a gradient was requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segregation: Option<SegregationReport>,
    /// Shapes and orientation of the grains; absent where all are spheres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shapes: Option<ShapeReport>,
}

/// Shapes and orientation of grains that are not spheres. Means and shares are weighted by volume; the tensors are
/// means by number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShapeReport {
    /// Flakiness index of EN 933-3, 0 to 1: share of the mass from 4 to 100 mm that passes slots of half the upper
    /// sieve of its fraction; `null` without such grains.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub flakiness_index: Option<f64>,
    /// Shape index of EN 933-4, 0 to 1: share of the mass from 4 to 63 mm of grains that are more than three times as
    /// long as thick; `null` without such grains.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub shape_index: Option<f64>,
    /// Mean elongation `Ei = b/a`.
    pub elongation_mean: f64,
    /// Mean flatness `Fi = c/b`.
    pub flatness_mean: f64,
    /// Mean sphericity of Wadell: surface of the sphere of equal volume over that of the grain.
    pub sphericity_mean: f64,
    /// Mean roundness of Wadell: radius of the sphere that fits into the corners of a grain over that of its largest
    /// inscribed sphere; absent in older results.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roundness_mean: Option<f64>,
    /// Shares of Zingg's classes of form.
    pub zingg: ZinggShares,
    /// Surface of all grains in mm².
    pub surface_mm2: f64,
    /// Mean of `n nᵀ` by number, over the grains, `n` the direction of the longest axis: xx, yy, zz, xy, yz, xz. A
    /// third each on the diagonal without a preferred direction.
    pub long_axis_tensor: [f64; 6],
    /// The same for the shortest axis, by number too.
    pub short_axis_tensor: [f64; 6],
}

/// Shares of the classes of form by Zingg (1935), which are divided at `b/a` = 2/3 and `c/b` = 2/3.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ZinggShares {
    /// `b/a > 2/3`, `c/b <= 2/3`.
    pub disc: f64,
    /// `b/a > 2/3`, `c/b > 2/3`.
    pub equant: f64,
    /// `b/a <= 2/3`, `c/b <= 2/3`.
    pub blade: f64,
    /// `b/a <= 2/3`, `c/b > 2/3`.
    pub rod: f64,
}

impl Packing {
    /// The grains, where they are spheres.
    #[must_use]
    pub fn spheres(&self) -> Option<&Spheres> {
        self.grains.spheres()
    }

    /// The grains, where they are spheres.
    #[must_use]
    pub fn into_spheres(self) -> Option<Spheres> {
        self.grains.into_solids().err()
    }
}

impl Report {
    /// Packing time in s and constant distance in mm at the points of the growth curve that have a distance; empty
    /// where no constant distance was requested.
    pub fn distance_curve(&self) -> Vec<[f64; 2]> {
        self.growth_curve
            .iter()
            .filter_map(|point| Some([point.packing_time_s, point.distance_mm?]))
            .collect()
    }
}

/// How far coarse and fine grains lie apart: along the requested field, and across it as a control.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SegregationReport {
    /// Along the field, which rises to where the coarse grains were requested.
    pub along: Separation,
    /// Along the axes that the field does not lie along.
    pub across: SeparationAcross,
    /// Random permutations of the sizes that the p values come from.
    pub permutations: u32,
}

/// Separation along coordinate axes; that of the field itself is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeparationAcross {
    /// Along x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<Separation>,
    /// Along y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y: Option<Separation>,
    /// Along z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z: Option<Separation>,
}

/// Where the coarsest and the finest third of the mass lie on average: 0 is the lower end of the field, 1 the upper,
/// in shares of the volume that the walls leave for the centre of a grain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Separation {
    /// Mean of the coarsest third, by mass.
    pub coarsest_third: f64,
    /// Mean of the finest third, by mass.
    pub finest_third: f64,
    /// The one less the other: 0 without a gradient, 0.667 where sizes are sorted.
    pub difference: f64,
    /// How probable a difference at least as large, of either sign, is without a gradient: the share of random
    /// permutations of the sizes for which the difference, over the size of such sums across the field, is as large.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub p_value: f64,
}

/// A point of the growth of grains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GrowthPoint {
    /// Wall-clock time of packing so far, in s.
    pub packing_time_s: f64,
    /// Simulated time, in s; absent for hard-particle Monte Carlo, which simulates no motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false, nullable = false))]
    pub simulated_time_s: Option<f64>,
    /// Events so far; of hard-particle Monte Carlo the moves tried.
    pub events: u64,
    /// Volume of the grains at their present size, with their coating where the largest distance is
    /// requested, over that of the specimen.
    pub volume_fraction: f64,
    /// Constant distance that the grains keep so far, where one is requested.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub distance_mm: Option<f64>,
    /// Pressure over that of an ideal gas of the same density and energy; absent for hard-particle Monte Carlo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false, nullable = false))]
    pub reduced_pressure: Option<f64>,
}

/// The figures people ask for first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Summary {
    /// Number of grains placed.
    pub grains: u64,
    /// The method that computed the packing, for the method `auto` too; `null` in results that were written before it
    /// was recorded.
    #[cfg_attr(feature = "openapi", schema(required))]
    #[serde(default)]
    pub method_used: Option<MethodUsed>,
    /// Volume of the specimen.
    pub specimen_volume_mm3: f64,
    /// Volume of all aggregate of the mix over that of the specimen (`phi_M`).
    pub volume_fraction_mixture: f64,
    /// Volume of the grains placed over that of the specimen (`phi_eff`), counted.
    pub volume_fraction_effective: f64,
    /// The same with each grain enlarged by half the distance it keeps from its own kind.
    pub volume_fraction_with_coating: f64,
    /// The constant distance kept, or `null` where it varies from pair to pair.
    pub distance_mm: Option<f64>,
    /// Smallest diameter placed; of grains that are not spheres that of the sphere of equal volume.
    pub d_min_mm: f64,
    /// Largest diameter placed; the same.
    pub d_max_mm: f64,
    /// Size classes from fine to coarse; `sieve_class` in the VTK forms counts them from 0. Those of several aggregates
    /// are divided at the sieves of all.
    pub classes: Vec<ClassReport>,
    /// The aggregates, in the order of the request; the column `aggregate` of the tables counts them from 0. Absent
    /// where the mix names none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aggregates: Vec<AggregateReport>,
    /// The factor on the sizes of all grains, where the volume fraction was to be as large as possible: over those
    /// that were drawn, or over those of the list. Absent elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false, nullable = false))]
    pub size_scale: Option<f64>,
    /// The `mix.volume_fraction` that the numbers of these grains were drawn for; absent elsewhere and for an explicit
    /// list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false, nullable = false))]
    pub volume_fraction_drawn: Option<f64>,
    /// How far a run came that ended before its target and whose packing was kept; absent where all was reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false, nullable = false))]
    pub partial: Option<Partial>,
}

/// One aggregate of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AggregateReport {
    /// Its name in the request; `null` where it has none.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub name: Option<String>,
    /// Its share of the volume of all aggregate of the mix, that below the cut-off too.
    pub share: f64,
    /// Grains placed.
    pub grains: u64,
    /// Volume that its share and its grading request above the cut-off.
    pub target_volume_mm3: f64,
    /// Volume of the grains placed.
    pub volume_mm3: f64,
    /// Mass of the grains placed; `null` where the request gives no density.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub mass_kg: Option<f64>,
    /// Its own size classes, from fine to coarse; none where all of it is finer than the cut-off.
    pub classes: Vec<ClassReport>,
}

/// The method that computed a packing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MethodUsed {
    /// Random sequential addition.
    Rsa,
    /// Event-driven molecular dynamics, from smaller grains that random sequential addition inserted.
    Edmd,
    /// Event-driven molecular dynamics, after random sequential addition of the full sizes had found no insertion
    /// for a grain.
    RsaThenEdmd,
    /// Hard-particle Monte Carlo with growth, from smaller grains that random sequential addition inserted.
    MonteCarlo,
    /// Hard-particle Monte Carlo with growth, after random sequential addition of the full sizes had found no insertion
    /// for a grain.
    RsaThenMonteCarlo,
}

/// One size class of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ClassReport {
    /// Lower sieve.
    pub d_min_mm: f64,
    /// Upper sieve.
    pub d_max_mm: f64,
    /// Grains in the class.
    pub grains: u64,
    /// Volume that the grading curve requests.
    pub target_volume_mm3: f64,
    /// Volume of the grains placed.
    pub volume_mm3: f64,
}

/// Wall-clock time of each phase, in s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Timings {
    /// Drawing the diameters.
    pub sampling: f64,
    /// Random sequential addition.
    pub rsa: f64,
    /// Event-driven molecular dynamics; absent where nothing was grown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edmd: Option<f64>,
    /// Hard-particle Monte Carlo; absent where nothing was grown by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monte_carlo: Option<f64>,
    /// The independent check.
    pub check: f64,
    /// All of it.
    pub total: f64,
}

/// What the algorithms counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Statistics {
    /// Random sequential addition, where it inserted grains; that of the start for grains that were grown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rsa: Option<RsaStatistics>,
    /// Event-driven molecular dynamics, where spheres grew by events.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edmd: Option<EdmdStatistics>,
    /// Hard-particle Monte Carlo, where grains grew by moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monte_carlo: Option<MonteCarloStatistics>,
}

/// What random sequential addition counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RsaStatistics {
    /// Points drawn, in the whole specimen or in what was left of the free space.
    pub attempts: u64,
    /// Grains whose place was found by subdividing the free space.
    pub grains_by_subdivision: u64,
    /// Voxels tested against the exclusion spheres.
    pub voxels_tested: u64,
}

/// What ended the growth of grains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum GrowthEnd {
    /// The requested size and distance.
    #[default]
    Target,
    /// Simulated time hardly went on: the grains are jammed.
    Stalled,
    /// The time that packing may take.
    TimeLimit,
    /// The number of events that there may be.
    EventLimit,
    /// The number of sweeps of moves that there may be.
    SweepLimit,
    /// A request to finish with what was reached, or the time limit of the job.
    Finished,
    /// Random addition found no start: none of 60 tries, each with smaller grains, had a place for all.
    NoStart,
}

/// What hard-particle Monte Carlo counted, over all parts of a run that was interrupted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MonteCarloStatistics {
    /// Compression cycles: the moments at which the run may be interrupted.
    pub compression_cycles: u64,
    /// Sweeps, in each of which every grain tried a move.
    pub sweeps: u64,
    /// Random moves of grains tried.
    pub moves_tried: u64,
    /// Random moves of grains made.
    pub moves_accepted: u64,
    /// Pairs of overlapping grains pushed apart.
    pub pushes: u64,
    /// Exchanges of two grains tried.
    pub swaps_tried: u64,
    /// Exchanges of two grains made.
    pub swaps_accepted: u64,
    /// Lists of near neighbours that were built.
    pub list_rebuilds: u64,
    /// Times that a packing which jammed just below its target was expanded, to grow again.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub expansions: u64,
    /// Times that the run went on from a checkpoint.
    pub resumes: u64,
    /// Size reached over requested size.
    pub growth_scale: f64,
    /// What ended the growth.
    pub stop: GrowthEnd,
}

/// What event-driven molecular dynamics counted, over all parts of a run that was interrupted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EdmdStatistics {
    /// Events that were carried out.
    pub events: u64,
    /// Collisions of two grains.
    pub grain_collisions: u64,
    /// Collisions with a wall.
    pub wall_collisions: u64,
    /// Lists of near neighbours that were built.
    pub list_rebuilds: u64,
    /// Pairs of grains whose next collision was computed.
    pub predictions: u64,
    /// Events dropped because a partner had changed its course.
    pub stale_events: u64,
    /// Exchanges of two grains tried.
    pub swaps_tried: u64,
    /// Exchanges of two grains made.
    pub swaps_accepted: u64,
    /// Times that all velocities were scaled back.
    pub velocity_rescalings: u64,
    /// Epochs: the moments at which the run may be interrupted.
    pub compression_cycles: u64,
    /// Grains that kept colliding on the spot and were moved.
    pub pinned_grains: u64,
    /// Times that a packing which jammed just below its target was expanded, to grow again.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub expansions: u64,
    /// Times that the run went on from a checkpoint.
    pub resumes: u64,
    /// Predictions over events.
    pub predictions_per_event: f64,
    /// Events per second of wall-clock time.
    pub events_per_s: f64,
    /// Simulated time.
    pub simulated_time_s: f64,
    /// Size reached over requested size.
    pub growth_scale: f64,
    /// Kinetic energy per grain at the end over that at the start.
    pub energy: f64,
    /// Pressure at the end over that of an ideal gas of the same density and energy.
    pub reduced_pressure: f64,
    /// What ended the growth.
    pub stop: GrowthEnd,
}

/// What the independent check found. A packing that fails is never returned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CheckReport {
    /// Smallest clear distance between two grains; `null` where there is one grain only.
    pub min_gap_mm: Option<f64>,
    /// Smallest clear distance from a grain to a wall; `null` in a periodic box.
    pub min_wall_gap_mm: Option<f64>,
    /// Smallest excess of a pair's clear distance over what its rule demands; never negative.
    pub min_excess_gap_mm: Option<f64>,
    /// Largest miss of a size class, as a share of the mass of all grains.
    pub max_class_mass_error: f64,
    /// Pairs whose distance was computed.
    pub pairs_checked: u64,
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A length that is stated before a text is sent is that of the text: nothing may change between the two.
    #[test]
    fn times_are_read_as_they_are_written() {
        for edmd in [None, Some(0.0), Some(1.5)] {
            let times = Timings { edmd, monte_carlo: edmd, ..Timings::default() };
            let text = serde_json::to_string(&times).unwrap();
            assert_eq!(serde_json::from_str::<Timings>(&text).unwrap(), times);
        }
    }
}
