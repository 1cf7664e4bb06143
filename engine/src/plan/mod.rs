//! The plan of a run: expected numbers of grains, memory, time and success, before any grain is sampled.
//!
//! Numbers and volume fractions are closed forms of the grading; time and success are estimates of a fitted model
//! (`docs/estimates.md`). A plan draws no random numbers but the templates of angular grains, which have a seed of
//! their own: the same request has the same plan.

mod densest;
mod estimate;
mod grains;
mod model;
mod random;
mod rods;
mod shapes;
mod smallest;

use std::num::NonZeroUsize;

use serde::Serialize;

use crate::distance::DistanceRule;
use crate::elementary::powf;
use crate::error::PlanError;
use crate::methods::edmd::LEAST_GROWN_IN_BLOCKS;
use crate::methods::edmd::{Expected, MAX_GRAINS};
use crate::methods::monte_carlo;
use crate::methods::rsa::{LEAST_SHARED_GRAINS, MAX_PLACED};
use crate::mix::sieve::sieve_classes;
use crate::mix::{GradedMix, GradingFigures, curve, deviation, figures_in_specimen};
use crate::request::{
    Amount, Distance, FieldError, GrainKind, MIN_SHARE, Method, Mix, PackingRequest, Segregation,
};
pub(crate) use densest::Drawing;
use estimate::{Case, ONE};
pub use estimate::{MethodEstimate, MethodEstimates, Proposal};
use model::OPERATION_S;

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
    /// service or the command that made the plan.
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

/// Densest packing of equal spheres (Kepler; Hales 2005): pi / sqrt(18).
const EQUAL_SPHERES: f64 = 0.740_480_489_693_061;
/// Share of the voids that stays when the ratio of diameters grows: an exponent below which no
/// known packing lies. (Best of binary spheres at a ratio of 4.5: 0.8245, Hopkins et al. 2012;
/// the curve gives 0.858.)
const VOIDS_EXPONENT: f64 = -0.4;
/// Ratio of diameters up to which grains may order like equal ones.
const NEARLY_EQUAL: f64 = 1.2;
/// Most threads of one run: with more, the sequential share of the work is most of the time.
const MOST_THREADS: u32 = 64;
/// The same for a run that grows: collisions with growth are sequential, and so are the moves at the first cut.
const MOST_GROWING_THREADS: u32 = 4;
/// Over random close packing (`rods`), a share that no random packing of a curve was seen to come near: the
/// densest of the studies lie at 1.0, and where they jam without walls is estimated at 1.10 (`model`).
const BEYOND_RANDOM: f64 = 1.12;

/// Memory that a run of spheres takes, fitted to peaks of `packstone run` on one thread: Fuller's curve 2..16 mm, B16
/// above 0.5 mm with up to 2e6 grains, and equal spheres, each placed at random and grown
/// (`docs/development/measurements-spheres.md`).
mod cost {
    /// Bytes of the program: of its 44 MB on the disk, what `packstone run` uses is in memory.
    pub(super) const BYTES: f64 = 22.5e6;
    /// Bytes per grain in a loose specimen.
    pub(super) const BYTES_PER_GRAIN: f64 = 220.0;
    /// Bytes per grain for the voxels of a crowded one, of equal grains and per spread: 270 bytes in all for equal
    /// spheres near saturation, 610 to 1570 for Fuller's curve from 0.60 to 0.66.
    pub(super) const BYTES_PER_CROWDED_GRAIN: f64 = 60.0;
    pub(super) const BYTES_PER_CROWDED_SPREAD: f64 = 4000.0;
    /// Bytes per grain while grains grow from a loose start.
    pub(super) const BYTES_PER_GROWING_GRAIN: f64 = 345.0;
    /// Bytes per grain of the state of growth where the memory of its random start exceeds it: 500 to 910 bytes in all
    /// for Fuller's curve from 0.65 to 0.70.
    pub(super) const BYTES_BESIDE_START: f64 = 140.0;
}

/// Memory of a run in bytes. `crowding` is the volume fraction that is placed at random, which growth starts from, over
/// that which random sequential addition reaches, `spread` the standard deviation of ln(d) by volume.
fn memory_bytes(grains: f64, crowding: f64, spread: f64, grows: bool) -> u64 {
    let crowded = (crowding.min(1.0) - 0.75).max(0.0);
    let of_voxels = cost::BYTES_PER_CROWDED_GRAIN + cost::BYTES_PER_CROWDED_SPREAD * spread;
    let placed = cost::BYTES_PER_GRAIN + of_voxels * (crowded / 0.25).powi(2);
    let per_grain =
        if grows { cost::BYTES_PER_GROWING_GRAIN.max(placed + cost::BYTES_BESIDE_START) } else { placed };
    (cost::BYTES + grains * per_grain) as u64
}

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
            check_volume(&mix)?;
        }
        check_cut_off(&request.mix, &mix)?;
        if densest.is_none() || mix.list.is_none() {
            check_largest(request, &mix, &rule)?;
        }
        check_maximize(request, &mix)?;
        let grains = mix.expected_grains();
        let case = Case::of_mix(request, &mix, &rule).with_jamming(densest.is_some());
        let mut warnings: Vec<String> = Vec::new();
        if densest.is_none() {
            check_feasible(&case)?;
            warnings.extend(deviation::foresee(&request.mix, &mix).map_err(PlanError::Coarse)?);
        }

        let methods = case.methods();
        let likely = case.of_request(&methods);
        let places_first = methods.places_first();
        let grows = match request.method {
            Method::Rsa { .. } => false,
            Method::Auto {} => !places_first,
            _ => true,
        };
        let is_maximized =
            matches!((&request.method, &request.distance), (Method::Auto {}, Distance::Maximize { .. }));
        let by_moves = case.grows_by_moves();
        let memory_bytes = match &mix.shapes {
            None if !by_moves => {
                let features = &case.features;
                let placed = if grows { case.growth().start_fraction.min(case.filled) } else { case.filled };
                memory_bytes(grains, placed / features.rsa_limit(None), features.spread(), grows)
            }
            shapes => {
                let share = case.filled / case.features.moves_limit(grains);
                let grown_to = grows.then_some(if densest.is_some() { 1.0 } else { share });
                let random =
                    (methods.rsa.operations * OPERATION_S, methods.rsa.success_probability < UNLIKELY);
                let of_grains =
                    shapes::bytes(shapes.as_ref(), grains, case.features.form(), grown_to, random);
                (cost::BYTES + of_grains) as u64
            }
        };
        check_limits(&case, memory_bytes, limits)?;
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
            keeps_checkpoints: grows || is_maximized,
            places_first,
        })
    }

    /// The plan of this request with the times of a processor of this speed over that of a core of 2 GHz. They are for
    /// people and for the order of a queue: nothing about a packing follows from them.
    #[must_use]
    pub fn at_speed(mut self, request: &PackingRequest, speed: f64) -> Self {
        self.methods.set_times(speed, estimate::most_growth_s(request));
        self.estimated_time_s = match request.method {
            Method::Rsa { .. } => self.methods.rsa.time_s,
            Method::Auto {} if self.places_first => self.methods.rsa.time_s,
            _ => self.methods.growth.time_s,
        };
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
                check_largest(case.request, case.mix, rule).is_ok() && check_feasible(case).is_ok()
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

/// A list of diameters, and a number of grains, may have more volume than the specimen.
fn check_volume(mix: &GradedMix) -> Result<(), PlanError> {
    let phi = mix.volume_fraction_effective;
    if phi <= 1.0 || mix.has_requested_volume() {
        return Ok(());
    }
    if let Some(count) = mix.numbers.iter().copied().reduce(|a, b| a + b) {
        let most = (count as f64 / phi).floor();
        return Err(infeasible(
            "/mix/count",
            format!("{count} grains have {phi:.4} times the specimen's volume: must be at most {most}"),
        ));
    }
    Err(infeasible(
        "/mix/grading/diameters_mm",
        format!(
            "the grains have {phi:.4} times the specimen's volume: must be at most 1; mix.volume_fraction \"maximize\" \
             scales the diameters to the densest packing"
        ),
    ))
}

/// The cut-off must leave a share of the mass that is more than rounding.
fn check_cut_off(requested: &Mix, mix: &GradedMix) -> Result<(), PlanError> {
    // With the basis `effective` it is the mixture that has no bounds where nothing is left.
    let (mixture, effective) = (mix.volume_fraction_mixture, mix.volume_fraction_effective);
    if mixture.is_finite() && effective >= MIN_SHARE * mixture {
        return Ok(());
    }
    Err(PlanError::Invalid(vec![FieldError {
        pointer: "/mix/d_min_mm".into(),
        detail: format!(
            "{} mm leaves less than {MIN_SHARE:e} of the mass: must lie below a sieve that holds some back",
            requested.d_min_mm.unwrap_or(mix.d_min_mm)
        ),
    }]))
}

/// The largest grain must fit, with its distance to the walls or to its own image.
fn check_largest(request: &PackingRequest, mix: &GradedMix, rule: &DistanceRule) -> Result<(), PlanError> {
    if let Some(of_grains) = &mix.shapes {
        return shapes::check_largest(request, mix, of_grains, rule);
    }
    let d = mix.d_max_mm;
    let wall = rule.wall_gap_mm(d);
    let needed = if request.specimen.is_periodic() { d + rule.gap_mm(d, d) } else { d + 2.0 * wall };
    let Some((pointer, length)) = request.specimen.lengths().into_iter().find(|&(_, length)| needed > length)
    else {
        return Ok(());
    };
    let with = if needed > d { format!(" ({needed} mm with its distance)") } else { String::new() };
    let detail = format!("{length} mm is too small: the largest grain is {d} mm{with}, and must fit");
    Err(invalid(&pointer, detail))
}

/// A single grain has a largest distance only where that to the walls grows with it.
fn check_maximize(request: &PackingRequest, mix: &GradedMix) -> Result<(), PlanError> {
    let fixed_wall = matches!(request.distance, Distance::Maximize { wall_gap_mm: Some(_) });
    let single = mix.list.as_ref().is_some_and(|list| list.len() < 2);
    if fixed_wall && single && !request.specimen.is_periodic() {
        return Err(PlanError::Invalid(vec![FieldError {
            pointer: "/distance/wall_gap_mm".into(),
            detail: "a single grain has no distance to maximize but that to the walls: leave wall_gap_mm out"
                .into(),
        }]));
    }
    Ok(())
}

fn check_limits(case: &Case<'_>, memory_bytes: u64, limits: &Limits) -> Result<(), PlanError> {
    let mix = case.mix;
    let grains = mix.expected_grains();
    let field = if mix.list.is_some() { "/mix/grading/diameters_mm" } else { "/mix/d_min_mm" };
    let advice = if mix.list.is_some() { "name fewer" } else { "raise d_min_mm or take a smaller specimen" };
    let too_large = |detail: String| {
        Err(PlanError::TooLarge(FieldError { pointer: field.into(), detail: format!("{detail}: {advice}") }))
    };
    let of_method = if case.grows_by_moves() { monte_carlo::MAX_GRAINS } else { MAX_GRAINS };
    let max_grains = limits.max_grains.min(MAX_PLACED).min(of_method as u64);
    if grains > max_grains as f64 {
        return too_large(format!(
            "the mix has about {grains:.0} grains above {} mm: must be at most {max_grains}",
            mix.d_min_mm
        ));
    }
    if memory_bytes > limits.max_memory_bytes {
        return too_large(format!(
            "the mix has about {grains:.0} grains above {} mm, which take about {memory_bytes} bytes of memory: must be at most {}",
            mix.d_min_mm, limits.max_memory_bytes
        ));
    }
    Ok(())
}

/// Refuses what no arrangement reaches: more than the densest packing known of spheres of such a range,
/// or, where sizes follow a curve, more than random packings come near.
fn check_feasible(case: &Case<'_>) -> Result<(), PlanError> {
    let (request, filled, effective) = (case.request, case.filled, case.mix.volume_fraction_effective);
    let ratio = case.features.ratio();
    let are_spheres = case.mix.shapes.is_none();
    let (equal, bodies) = match case.mix.kind() {
        GrainKind::Spheres => (EQUAL_SPHERES, "spheres"),
        GrainKind::Ellipsoids => (shapes::EQUAL_ELLIPSOIDS, "ellipsoids"),
        GrainKind::Polyhedra => (shapes::EQUAL_POLYHEDRA, "polyhedra"),
        GrainKind::Mixed => (shapes::EQUAL_POLYHEDRA, "ellipsoids and polyhedra"),
    };
    let mut densest = 1.0 - (1.0 - equal) * powf(ratio, VOIDS_EXPONENT);
    if are_spheres && case.mix.list.is_none() && ratio > NEARLY_EQUAL {
        densest = densest.min(BEYOND_RANDOM * case.features.random_close());
    }
    if filled <= densest {
        return Ok(());
    }
    let coating = if filled > effective * 1.000_001 {
        format!(" (with the distance as a coating {filled:.4})")
    } else {
        String::new()
    };
    let advice = match request.mix.amount() {
        Amount::List => {
            "take a larger specimen, list fewer or smaller diameters, or lower the distance; mix.volume_fraction \
             \"maximize\" scales the diameters to the densest packing"
        }
        Amount::Count => "take a larger specimen, or lower the count or the distance",
        Amount::Volume => "lower the volume fraction or the distance",
    };
    Err(infeasible(
        request.mix.amount_pointer(),
        format!(
            "the grains to place have a volume fraction of {effective:.4}{coating}: {bodies} of this range of \
             diameters (1 : {ratio:.2}) fill at most {densest:.4}; {advice}"
        ),
    ))
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
