//! The plan of a run: expected numbers of grains, memory, time and success, before any grain is sampled.
//!
//! Numbers and volume fractions are closed forms of the grading; time and success are estimates of a fitted model
//! (`docs/estimates.md`). A plan draws no random numbers but the templates of angular grains, which have a seed of
//! their own: the same request has the same plan.

mod checks;
mod densest;
mod estimate;
mod grains;
mod memory;
mod model;
mod random;
mod rods;
mod shapes;
mod smallest;

use std::num::NonZeroUsize;

use serde::Serialize;

use crate::distance::DistanceRule;
use crate::error::PlanError;
use crate::methods::edmd::{Expected, LEAST_GROWN_IN_BLOCKS};
use crate::methods::monte_carlo;
use crate::methods::rsa::LEAST_SHARED_GRAINS;
use crate::mix::sieve::sieve_classes;
use crate::mix::{GradedMix, GradingFigures, curve, deviation, figures_in_specimen};
use crate::request::{Distance, FieldError, Method, PackingRequest, Segregation};
pub(crate) use densest::Drawing;
use estimate::{Case, ONE};
pub use estimate::{MethodEstimate, MethodEstimates, Proposal};
pub(crate) use random::Crowding;

/// What a run may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most grains of one packing.
    pub max_grains: u64,
    /// Most memory of one packing, in bytes.
    pub max_memory_bytes: u64,
    /// Most memory of one model of a packing, and longest file of one, in bytes.
    pub max_model_bytes: u64,
    /// Longest file of voxels, which takes little memory, in bytes.
    pub max_voxel_file_bytes: u64,
    /// Most threads that compute one packing; the packing does not depend on their number.
    pub threads: NonZeroUsize,
    /// Most threads that write one model of a packing; what they write does not depend on their number.
    pub export_threads: NonZeroUsize,
}

impl Default for Limits {
    /// 20 million grains, 8 GB, one thread for each.
    fn default() -> Self {
        Self {
            max_grains: 20_000_000,
            max_memory_bytes: 8_000_000_000,
            max_model_bytes: 8_000_000_000,
            max_voxel_file_bytes: 8_000_000_000,
            threads: NonZeroUsize::MIN,
            export_threads: NonZeroUsize::MIN,
        }
    }
}

/// What a request amounts to.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Plan {
    /// Expected number of grains.
    pub grains: f64,
    /// Volume of the specimen.
    pub specimen_volume_mm3: f64,
    /// Volume of all aggregate over that of the specimen (`phi_M`).
    pub volume_fraction_mixture: f64,
    /// Volume of the grains to place over that of the specimen (`phi_eff`).
    pub volume_fraction_effective: f64,
    /// The same with each grain enlarged by half the distance it keeps from its own kind.
    pub volume_fraction_with_coating: f64,
    /// Memory that the run will use at its peak.
    pub memory_bytes: u64,
    /// CPU time that the method of the request is likely to take: on a core of 2 GHz, or on the processor of the
    /// service, the command or the package that made the plan.
    pub estimated_time_s: f64,
    /// Most threads that the run has work for; one where all of its work is sequential.
    #[cfg_attr(feature = "openapi", schema(minimum = 1, maximum = 64))]
    pub most_threads: u32,
    /// Probability that it reaches its target.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub success_probability: f64,
    /// What each method is likely to do.
    pub methods: MethodEstimates,
    /// The most that is likely to succeed; told by a dry run, for it takes many looks at the model.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub proposal: Option<Proposal>,
    /// In what the request lies beyond the studies that the estimates were fitted to; empty where it does not.
    pub extrapolations: Vec<String>,
    /// Expected grains by size class, from fine to coarse.
    pub classes: Vec<ClassPlan>,
    /// The grading curve of all aggregate, told by a dry run: `[diameter in mm, mass fraction passing]` from fine to
    /// coarse. A single size has two points, before and after it. Empty for an explicit list.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub curve: Vec<[f64; 2]>,
    /// Figures of all aggregate, told by a dry run; absent where all of it passes 0.063 mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub figures: Option<GradingFigures>,
    /// What is likely to go wrong, in words.
    pub warnings: Vec<String>,
    /// Where growth of spheres starts, and what it is expected to take.
    #[serde(skip)]
    #[cfg_attr(feature = "openapi", schema(ignore))]
    pub(crate) growth: Expected,
    /// The target of growth by moves over what it is expected to reach.
    #[serde(skip)]
    #[cfg_attr(feature = "openapi", schema(ignore))]
    pub(crate) target_share_of_moves: f64,
    /// Whether a run that is cut can go on from a checkpoint: it grows, and random sequential addition of the full
    /// sizes is not tried before.
    #[serde(skip)]
    #[cfg_attr(feature = "openapi", schema(ignore))]
    pub keeps_checkpoints: bool,
    /// Whether `auto` tries random sequential addition before growth.
    #[serde(skip)]
    #[cfg_attr(feature = "openapi", schema(ignore))]
    pub(crate) places_first: bool,
}

/// Expected grains of one size class.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ClassPlan {
    /// Lower sieve.
    pub d_min_mm: f64,
    /// Upper sieve.
    pub d_max_mm: f64,
    /// Expected number of grains.
    pub grains: f64,
    /// Volume that the grading curve asks for.
    pub volume_mm3: f64,
}

/// How full the specimen is for each size, from coarse to fine, when the grains of a mix are added at random.
pub(crate) fn crowding(request: &PackingRequest, mix: &GradedMix) -> Vec<Crowding> {
    let rule = DistanceRule::new(&request.distance, &request.specimen);
    Case::of_mix(request, mix, &rule).crowding()
}

/// Most threads of one run: with more, the sequential share of the work is most of the time.
const MOST_THREADS: u32 = 64;
/// The same for a run that grows: collisions with growth are sequential, and so are the moves at the first cut.
const MOST_GROWING_THREADS: u32 = 4;
impl Plan {
    /// Plans a request.
    ///
    /// ```
    /// use packstone_engine::{Limits, PackingRequest, Plan};
    ///
    /// let request = PackingRequest::from_json(
    ///     &serde_json::json!({
    ///         "specimen": {"type": "box", "size_mm": [150, 150, 150]},
    ///         "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.70},
    ///     }),
    ///     1,
    /// )
    /// .expect("every field is within its bounds");
    /// let plan = Plan::new(&request, &Limits::default())?;
    /// assert!((plan.grains - 44_202.0).abs() < 50.0);
    /// assert!((plan.volume_fraction_effective - 0.553).abs() < 1e-9);
    /// assert!(plan.warnings.is_empty());
    /// # Ok::<(), packstone_engine::PlanError>(())
    /// ```
    ///
    /// # Errors
    /// When a grain does not fit into the specimen, when there are more grains than `limits`
    /// allow, when no arrangement of such grains reaches the volume fraction, or when whole grains miss the requested
    /// volume by more than [`crate::mix::MAX_DEVIATION`] and the mix does not allow it.
    pub fn new(request: &PackingRequest, limits: &Limits) -> Result<Self, PlanError> {
        let specimen_volume_mm3 = request.specimen.volume_mm3();
        let densest = Drawing::expected(request);
        let drawn = densest.map(|drawing| drawing.of(request));
        let request = drawn.as_ref().unwrap_or(request);
        let mix = GradedMix::new(&request.mix, specimen_volume_mm3);
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        // What is scaled until it jams has no volume to miss, and a list no size that must fit.
        if densest.is_none() {
            checks::volume(&mix)?;
        }
        checks::cut_off(&request.mix, &mix)?;
        if densest.is_none() || mix.list.is_none() {
            checks::largest(request, &mix, &rule)?;
        }
        checks::largest_distance(request, &mix)?;
        let grains = mix.expected_grains();
        let case = Case::of_mix(request, &mix, &rule).with_jamming(densest.is_some());
        let mut warnings: Vec<String> = Vec::new();
        if densest.is_none() {
            checks::feasible(&case)?;
            warnings.extend(deviation::foresee(&request.mix, &mix).map_err(PlanError::Coarse)?);
        }

        let methods = case.methods();
        let likely = case.of_request(&methods);
        let places_first = methods.places_first();
        let grows = methods.grows(&request.method);
        let is_maximized =
            matches!((&request.method, &request.distance), (Method::Auto {}, Distance::Maximize { .. }));
        let memory_bytes = memory::bytes(&case, &methods);
        checks::limits(&case, memory_bytes, limits)?;
        warnings.extend(unlikely(&case, &likely));
        warnings.extend(mix_warnings(request, &mix, densest.is_some()));
        let cube = densest.map_or(1.0, |drawing| drawing.scale().powi(3));
        let classes = sieve_classes(&mix)
            .iter()
            .map(|c| ClassPlan {
                d_min_mm: c.low_mm,
                d_max_mm: c.high_mm,
                grains: c.grains,
                volume_mm3: c.volume_mm3,
            })
            .collect();
        Ok(Self {
            grains,
            specimen_volume_mm3,
            volume_fraction_mixture: cube * mix.volume_fraction_mixture,
            volume_fraction_effective: cube * mix.volume_fraction_effective,
            volume_fraction_with_coating: cube * case.coated_mm3 / specimen_volume_mm3,
            memory_bytes,
            estimated_time_s: likely.time_s,
            most_threads: most_threads(&case, grows),
            success_probability: likely.success_probability,
            methods,
            proposal: None,
            extrapolations: case.extrapolations(),
            classes,
            curve: Vec::new(),
            figures: None,
            warnings,
            growth: case.growth(),
            target_share_of_moves: case.share_of_moves().unwrap_or(1.0),
            keeps_checkpoints: grows || is_maximized,
            places_first,
        })
    }

    /// The plan of this request with the times of a processor of this speed over that of a core of 2 GHz. They are for
    /// people and for the order of a queue: nothing about a packing follows from them.
    #[must_use]
    pub fn at_speed(mut self, request: &PackingRequest, speed: f64) -> Self {
        self.methods.set_times(speed, estimate::most_growth_s(request));
        let methods = &self.methods;
        let used = if methods.grows(&request.method) { methods.growth } else { methods.rsa };
        self.estimated_time_s = used.time_s;
        self
    }

    /// Adds to the plan of this request what a dry run tells beside it: the proposal, the grading curve and the figures
    /// of the aggregate.
    #[must_use]
    pub fn with_proposal(mut self, request: &PackingRequest) -> Self {
        self.curve = curve(&request.mix);
        let densest = Drawing::expected(request);
        let drawn = densest.map(|drawing| drawing.of(request));
        let request = drawn.as_ref().unwrap_or(request);
        let mix = GradedMix::new(&request.mix, self.specimen_volume_mm3);
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let case = Case::of_mix(request, &mix, &rule).with_jamming(densest.is_some());
        let mut proposal = case.proposal();
        if densest.is_none() {
            let admits = |case: &Case<'_>, rule: &DistanceRule| {
                checks::largest(case.request, case.mix, rule).is_ok() && checks::feasible(case).is_ok()
            };
            proposal.specimen = smallest::specimen(request, &mix, admits);
        }
        self.proposal = Some(proposal);
        self.figures = figures_in_specimen(&request.mix, &mix, densest.is_none());
        self
    }
}

/// Threads that a run has work for: threads share the growth of many grains, and the random addition of many spheres
/// that prefer no places.
fn most_threads(case: &Case<'_>, grows: bool) -> u32 {
    let (request, mix, grains) = (case.request, case.mix, case.grains);
    if grows {
        let least = if case.grows_by_moves() { monte_carlo::LEAST_CUT } else { LEAST_GROWN_IN_BLOCKS };
        let is_shared = grains >= least as f64;
        return if is_shared { MOST_GROWING_THREADS } else { 1 };
    }
    let is_shared = mix.shapes.is_none()
        && matches!(request.segregation, Segregation::None {})
        && grains >= LEAST_SHARED_GRAINS as f64;
    if is_shared { MOST_THREADS } else { 1 }
}

fn invalid(pointer: &str, detail: String) -> PlanError {
    PlanError::Invalid(vec![FieldError { pointer: pointer.into(), detail }])
}

fn infeasible(pointer: &str, detail: String) -> PlanError {
    PlanError::Infeasible(FieldError { pointer: pointer.into(), detail })
}

/// A probability of success below which a request deserves a warning.
const UNLIKELY: f64 = 0.5;

/// A warning where the method of the request is unlikely to reach its target.
fn unlikely(case: &Case<'_>, likely: &MethodEstimate) -> Option<String> {
    let method = match case.request.method {
        Method::Rsa { .. } => "random sequential addition",
        _ => "growth",
    };
    let (filled, reach) = (case.filled, likely.volume_fraction_with_coating_reach);
    (likely.success_probability < UNLIKELY).then(|| match () {
        () if case.grains < ONE => {
            format!("{method} is unlikely to place a single grain that fills {filled:.3} of the specimen")
        }
        () if reach >= filled => format!("{method} is unlikely to end within its limits"),
        () => format!(
            "{method} is unlikely to reach a volume fraction of {filled:.3} (with coating): for this mix and specimen \
             it reaches about {reach:.3}"
        ),
    })
}

/// Warnings about a mix in its specimen, whatever the method. The volume fraction of one that is to be as large as
/// possible (`is_densest`) was not asked for.
pub(crate) fn mix_warnings(request: &PackingRequest, mix: &GradedMix, is_densest: bool) -> Vec<String> {
    let grains = mix.expected_grains();
    let mut warnings = Vec::new();
    for part in request.mix.parts() {
        warnings.extend(
            part.grading
                .completions(part.d_min_mm.unwrap_or(0.0), request.mix.d_max_mm.unwrap_or(f64::INFINITY)),
        );
    }
    if let (true, Some(wall_gap_mm)) = (request.specimen.is_periodic(), request.distance.wall_gap_mm()) {
        warnings.push(format!(
            "distance.wall_gap_mm, {wall_gap_mm} mm, has no effect: a periodic box has no walls"
        ));
    }
    if mix.list.is_none() && grains < 10.0 {
        warnings.push(format!("about {grains:.1} grains: too few to follow the grading curve"));
    }
    if mix.list.is_none() && !is_densest && mix.volume_fraction_mixture > 1.0 {
        warnings.push(format!(
            "the whole mix, finer grains too, would fill {:.4} of the specimen: no concrete has this mix",
            mix.volume_fraction_mixture
        ));
    }
    let shortest = request.specimen.bounds_mm().into_iter().fold(f64::INFINITY, f64::min);
    if shortest < 3.0 * mix.d_max_mm && mix.list.is_none() {
        warnings.push(format!(
            "the smallest edge {shortest} mm is less than three of the largest grains ({} mm)",
            mix.d_max_mm
        ));
    }
    warnings
}

/// What the model of `docs/estimates.md` sees of a request, to be fitted to.
#[cfg(feature = "examples")]
#[derive(Clone, Debug, Serialize)]
pub struct ModelInputs {
    /// Of each size, coating included: the diameter in mm, the number, and the surface and mean width over those of a
    /// sphere.
    pub sizes: Vec<[f64; 4]>,
    /// Diameters that the sizes stand within, coating included, in mm.
    pub bounds: [f64; 2],
    /// Surface of the walls over the volume in 1/mm.
    pub walls: f64,
}

#[cfg(feature = "examples")]
impl ModelInputs {
    /// Of a request.
    #[must_use]
    pub fn of(request: &PackingRequest) -> Self {
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let (factor, offset) = rule.enlargement(mix.d_min_mm);
        let row = |of: &grains::Size| [of.diameter, of.number, of.surface, of.width];
        Self {
            sizes: grains::sizes(&mix, grains::form_of(&mix), factor, offset).iter().map(row).collect(),
            bounds: [mix.d_min_mm, mix.d_max_mm].map(|d| factor * d + offset),
            walls: request.specimen.domain().walls_per_mm(),
        }
    }
}

#[cfg(test)]
mod extremes_tests;
#[cfg(test)]
mod tests;

#[cfg(test)]
mod estimate_tests;
