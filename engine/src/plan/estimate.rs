//! Estimated time and probability of success of a request, and the largest request that is likely to succeed.
//!
//! The estimates are those of the fitted [`model`](super::model).

use serde::Serialize;

use super::grains;
use super::model::{self, Features, LIKELY, STALL_EVENTS, bisect};
use super::random::{self, Crowding};
use super::{UNLIKELY, shapes};
use crate::distance::DistanceRule;
use crate::elementary::log10;
use crate::methods::edmd::Expected;
use crate::methods::rsa_shapes::MOST_DRAWS;
use crate::mix::{GradedMix, MeanForm};
use crate::request::{
    Distance, GrowthBy, GrowthOptions, Method, PackingRequest, Segregation, Specimen, VolumeFraction,
    VolumeFractionOf,
};

/// Expected grains below which there is one.
pub(super) const ONE: f64 = 1.5;

/// What one method is likely to do with a mix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MethodEstimate {
    /// Probability that it reaches its target within the limits of the request.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub success_probability: f64,
    /// Work in operations, whether it succeeds or not: the same on every machine. An operation takes as long as an
    /// event of growth by events of few grains, 0.56 us on a core of 2 GHz.
    pub operations: f64,
    /// CPU time of this work, at most the limit of time of the request.
    pub time_s: f64,
    /// Volume fraction of the grains, coating included, that nine of ten runs are expected to reach. This forecast has
    /// an error of its own, which `success_probability` allows for and a proposal too.
    pub volume_fraction_with_coating_reach: f64,
}

/// The method that inserts grains at their size, and the method that grows them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MethodEstimates {
    /// Random sequential addition.
    pub rsa: MethodEstimate,
    /// Growth, in the way of the request: by events or by moves.
    pub growth: MethodEstimate,
}

impl MethodEstimate {
    /// Of work that takes this many seconds on a core of 2 GHz.
    fn new(success_probability: f64, seconds: f64, reach: f64) -> Self {
        Self {
            success_probability,
            operations: seconds / model::OPERATION_S,
            time_s: seconds,
            volume_fraction_with_coating_reach: reach,
        }
    }
}

impl MethodEstimates {
    /// Whether `auto` places at random first: that will do, and takes less work.
    pub(super) fn places_first(&self) -> bool {
        self.rsa.success_probability >= LIKELY && self.rsa.operations <= self.growth.operations
    }

    /// Whether a request with this method lets grains grow, and does not add all of them at random.
    pub(super) fn grows(&self, method: &Method) -> bool {
        match method {
            Method::Rsa { .. } => false,
            Method::Auto {} => !self.places_first(),
            _ => true,
        }
    }

    /// Sets the times on a processor of this speed over that of a core of 2 GHz, with a limit for growth.
    pub(super) fn set_times(&mut self, speed: f64, most_growth_s: f64) {
        let time_s = |of: &MethodEstimate| of.operations * model::OPERATION_S / speed;
        self.rsa.time_s = time_s(&self.rsa);
        self.growth.time_s = time_s(&self.growth).min(most_growth_s);
    }
}

/// The most that is likely to succeed (with a probability of 0.9), all else as requested.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Proposal {
    /// `mix.volume_fraction`, in the basis of the request; `null` for explicit diameters.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub volume_fraction: Option<f64>,
    /// A constant distance; `null` for other rules of distance, and where there is none.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub distance_mm: Option<f64>,
    /// The smallest specimen of the same proportions for the grains of a list or of a `mix.count`; `null` for other
    /// mixes, which fill any specimen.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub specimen: Option<Specimen>,
}

/// Most times that a proposal is made again for the number of grains of the one before.
const PROPOSED_AGAIN: usize = 4;

/// A request before the model.
pub(super) struct Case<'a> {
    pub(super) request: &'a PackingRequest,
    pub(super) mix: &'a GradedMix,
    pub(super) grains: f64,
    /// Volume of the grains with their coating,
    pub(super) coated_mm3: f64,
    /// and over the room for them.
    pub(super) filled: f64,
    pub(super) features: Features,
    form: MeanForm,
    /// Whether the grains grow until they jam, in place of to their size.
    to_jamming: bool,
    /// Whether the grains grow by moves, where they grow; else by events.
    by_moves: bool,
}

impl<'a> Case<'a> {
    /// A mix before a rule of distance, in the specimen of the request.
    pub(super) fn of_mix(request: &'a PackingRequest, mix: &'a GradedMix, rule: &DistanceRule) -> Self {
        let (factor, offset) = rule.enlargement(mix.d_min_mm);
        let form = grains::form_of(mix);
        let coated_mm3 = mix.expected_coated_volume_mm3(factor, offset);
        Self {
            request,
            mix,
            grains: mix.expected_grains().max(1.0),
            coated_mm3,
            filled: coated_mm3 / room_mm3(request, rule, mix.d_max_mm),
            features: features(request, mix, form, factor, offset),
            form,
            to_jamming: false,
            by_moves: GrowthBy::of(&request.method, mix.shapes.is_some()) == GrowthBy::Moves,
        }
    }

    /// The same of grains that grow until they jam, if they do.
    pub(super) fn with_jamming(self, to_jamming: bool) -> Self {
        Self { to_jamming, ..self }
    }

    /// Whether growth has no target: it goes on until the grains jam.
    fn is_without_target(&self) -> bool {
        self.to_jamming || matches!(self.request.distance, Distance::Maximize { .. })
    }

    /// Of the grains that are at least half as large as the largest: their share of the volume, coating included, and
    /// the surface of the walls over the volume times their mean diameter (the third moment over the second).
    pub(super) fn largest(&self) -> (f64, f64) {
        let sizes = self.mix.expected_sizes();
        let most = sizes.iter().map(|(d, _)| *d).fold(0.0, f64::max);
        let moment = |least: f64, power: i32| -> f64 {
            sizes.iter().filter(|(d, _)| *d >= least).map(|(d, number)| number * d.powi(power)).sum()
        };
        let cube = moment(0.5 * most, 3);
        let mean = cube / moment(0.5 * most, 2);
        (cube / moment(0.0, 3), self.request.specimen.domain().walls_per_mm() * mean)
    }

    pub(super) fn methods(&self) -> MethodEstimates {
        let attempts = match self.request.method {
            Method::Rsa { attempts_per_grain } => attempts_per_grain,
            _ => None,
        };
        let options = self.options_of_events();
        let (features, filled, grains) = (&self.features, self.filled, self.grains);
        let maximize = self.is_without_target();
        // Random addition grows nothing, so it has no largest distance.
        let success_probability = if maximize { 0.0 } else { features.rsa_success(filled, attempts) };
        let seconds = if self.mix.shapes.is_none() {
            features.rsa_time_s(filled, grains, attempts)
        } else {
            let share = filled / features.rsa_limit(attempts);
            // Voxels seldom prove that a grain with a shape has no place.
            let last_draws = if success_probability < UNLIKELY {
                attempts.map_or(MOST_DRAWS, |attempts| attempts.min(MOST_DRAWS)) as f64
            } else {
                0.0
            };
            let numbers = (grains, features.ending_share());
            self.templates_s() + shapes::random_s(features.form(), share, numbers, last_draws)
        };
        let rsa = MethodEstimate::new(success_probability, seconds, features.rsa_limit(attempts));
        let growth = if self.by_moves {
            self.growth_by_moves()
        } else {
            // The largest distance is looked for until growth stalls, or as long as it may.
            let target = (!maximize).then_some(filled);
            MethodEstimate::new(
                features.growth_success(filled, grains, &options),
                features.growth_time_s(target, grains, options.stop.events),
                features.growth_reach(grains, &options),
            )
        };
        let mut methods = MethodEstimates { rsa, growth };
        if grains < ONE && self.mix.shapes.is_none() && !maximize {
            // A sphere that fits has a place.
            for of in [&mut methods.rsa, &mut methods.growth] {
                of.success_probability = 1.0;
                of.volume_fraction_with_coating_reach = of.volume_fraction_with_coating_reach.max(filled);
            }
        }
        if self.to_jamming {
            // Whatever they reach is the target.
            methods.growth.success_probability = 1.0;
        }
        methods.set_times(1.0, most_growth_s(self.request));
        methods
    }

    /// What growth by moves is likely to do.
    fn growth_by_moves(&self) -> MethodEstimate {
        let (features, grains) = (&self.features, self.grains);
        let limit = features.moves_limit(grains);
        let time_s =
            |share| self.templates_s() + shapes::moves_s(features.form(), self.form.angular, share, grains);
        // Grains that grow on until they jam succeed once they have their size, when a limit of time ends that.
        let within = model::likely_within(time_s(Some(self.filled / limit)), most_growth_s(self.request));
        MethodEstimate::new(
            within * features.moves_success(self.filled, grains),
            time_s(self.share_of_moves()),
            limit,
        )
    }

    /// Time in s of the templates of polyhedra.
    fn templates_s(&self) -> f64 {
        self.mix.shapes.as_ref().map_or(0.0, |shapes| shapes::templates_s(shapes.templates().count()))
    }

    /// Share of the volume fraction that nine of ten runs of growth by moves reach; `None` where the grains grow until
    /// they jam.
    pub(super) fn share_of_moves(&self) -> Option<f64> {
        (!self.is_without_target()).then(|| self.filled / self.features.moves_limit(self.grains))
    }

    /// How full the specimen is for each size, from coarse to fine, when its grains are added at random.
    pub(super) fn crowding(&self) -> Vec<Crowding> {
        let rule = DistanceRule::new(&self.request.distance, &self.request.specimen);
        let (factor, offset) = rule.enlargement(self.mix.d_min_mm);
        let sizes = grains::sizes(self.mix, self.form, factor, offset);
        let walls_per_mm = self.request.specimen.domain().walls_per_mm();
        random::crowding(&sizes, walls_per_mm, self.form.angular, self.filled)
    }

    /// Volume fraction, coating included, at which growing grains are expected to jam.
    pub(super) fn at_jamming(&self) -> f64 {
        if self.by_moves {
            self.features.moves_jamming(self.grains)
        } else {
            self.features.jamming(self.grains)
        }
    }

    /// The options of growth by events. What moves are expected to take is known without limits alone.
    fn options_of_events(&self) -> GrowthOptions {
        let options = self.request.method.growth().filter(|_| !self.by_moves);
        options.copied().unwrap_or_default()
    }

    /// Whether the grains grow by moves, where they grow.
    pub(super) fn grows_by_moves(&self) -> bool {
        self.by_moves
    }

    /// What growth of spheres to the target is expected to take, at most the events of a stall.
    pub(super) fn growth(&self) -> Expected {
        let (features, grains) = (&self.features, self.grains);
        let maximize = self.is_without_target();
        let start_fraction = features.growth_start(if maximize { f64::INFINITY } else { self.filled });
        Expected {
            start_fraction,
            start_work: features.rsa_time_s(start_fraction.min(self.filled), grains, None)
                / (grains * model::event_s(grains)),
            events_per_grain: if maximize {
                // It goes on until the grains jam.
                STALL_EVENTS
            } else {
                features.events_per_grain(self.filled, grains).min(STALL_EVENTS)
            },
        }
    }

    /// What the method of the request is likely to do.
    pub(super) fn of_request(&self, methods: &MethodEstimates) -> MethodEstimate {
        if methods.grows(&self.request.method) {
            return methods.growth;
        }
        match self.request.method {
            // What cannot be added at random grows then.
            Method::Auto {} => MethodEstimate {
                success_probability: methods.rsa.success_probability.max(methods.growth.success_probability),
                ..methods.rsa
            },
            _ => methods.rsa,
        }
    }

    pub(super) fn proposal(&self) -> Proposal {
        let volume_fraction = self.mix.has_requested_volume().then(|| {
            let mut likely = self.likely_volume_fraction();
            let mut request = self.request.clone();
            // What is reached depends on the number of grains, which is that of the proposal.
            for _ in 0..PROPOSED_AGAIN {
                if likely <= 0.0 {
                    break;
                }
                request.mix.volume_fraction = Some(VolumeFraction::Of(likely));
                let mix = GradedMix::new(&request.mix, self.mix.specimen_volume_mm3);
                let rule = DistanceRule::new(&request.distance, &request.specimen);
                let before = likely;
                let proposed = Case::of_mix(&request, &mix, &rule).with_jamming(self.to_jamming);
                likely = proposed.likely_volume_fraction();
                if (likely / before - 1.0).abs() < 0.01 {
                    break;
                }
            }
            round(likely).min(1.0)
        });
        let distance_mm = match self.request.distance {
            Distance::None { wall_gap_mm: None }
            | Distance::Constant { wall_gap_mm: None, .. }
            | Distance::Maximize { wall_gap_mm: None }
                if self.grains > ONE =>
            {
                let most = self.mix.d_max_mm;
                let reached = bisect(0.0, most, |mm| self.is_likely_at(mm));
                (reached > 0.0).then(|| round(reached))
            }
            _ => None,
        };
        Proposal { volume_fraction, distance_mm, specimen: None }
    }

    /// The largest `mix.volume_fraction` that so many grains are likely to reach, in the basis of the request.
    fn likely_volume_fraction(&self) -> f64 {
        let requested = match self.request.mix.volume_fraction_of {
            VolumeFractionOf::AllAggregate => self.mix.volume_fraction_mixture,
            VolumeFractionOf::PlacedGrains => self.mix.volume_fraction_effective,
        };
        // A sphere that fits has a place.
        let is_certain = self.grains < ONE && self.mix.shapes.is_none();
        let least = if is_certain { self.filled } else { 0.0 };
        let likely = bisect(0.0, 1.0, |filled| self.is_likely(&self.features, filled)).max(least);
        requested * likely / self.filled
    }

    /// Whether a constant distance is likely to be reached.
    fn is_likely_at(&self, distance_mm: f64) -> bool {
        let features = features(self.request, self.mix, self.form, 1.0, distance_mm);
        let filled = self.mix.expected_coated_volume_mm3(1.0, distance_mm) / self.mix.specimen_volume_mm3;
        self.is_likely(&features, filled)
    }

    /// Whether the method of the request is likely to reach a volume fraction, coating included.
    fn is_likely(&self, features: &Features, filled: f64) -> bool {
        let by_random = |attempts_per_grain| features.rsa_success(filled, attempts_per_grain) >= LIKELY;
        let by_growth = || {
            let probability = if self.by_moves {
                features.moves_success(filled, self.grains)
            } else {
                features.growth_success(filled, self.grains, &self.options_of_events())
            };
            probability >= LIKELY
        };
        match self.request.method {
            Method::Rsa { attempts_per_grain } => by_random(attempts_per_grain),
            Method::Auto {} => by_growth() || by_random(None),
            _ => by_growth(),
        }
    }

    /// In what the request lies beyond the studies that the model was fitted to, in words.
    pub(super) fn extrapolations(&self) -> Vec<String> {
        let mut beyond = self.features.beyond(self.grains);
        if matches!(self.request.distance, Distance::SmallerDiameter { .. }) {
            beyond.push("a distance by the smaller diameter, taken as that of the smallest grains".into());
        }
        if self.by_moves {
            beyond.extend(shapes::extrapolation(self.mix.kind()).map(String::from));
        }
        if let Method::Rsa { attempts_per_grain: Some(_) } = self.request.method {
            beyond.push("a number of attempts per grain".into());
        }
        let options = self.request.method.growth().copied().unwrap_or_default();
        let unmoved = GrowthOptions { stop: options.stop, ..GrowthOptions::default() };
        if options != unmoved || options.stop.stall_dt_s.is_some() {
            beyond.push("options of growth other than the limits of time and work".into());
        }
        if matches!(self.request.segregation, Segregation::Gradient { strength, .. } if strength > 0.0) {
            beyond.push("a gradient in the placement, taken as if grains lay anywhere".into());
        }
        beyond
    }
}

/// The time that a request gives growth, in s.
pub(super) fn most_growth_s(request: &PackingRequest) -> f64 {
    request.method.growth().and_then(|options| options.stop.time_s).unwrap_or(f64::INFINITY)
}

fn features(request: &PackingRequest, mix: &GradedMix, form: MeanForm, factor: f64, offset: f64) -> Features {
    let enlarged = |d: f64| factor * d + offset;
    let mut sizes = mix.expected_sizes();
    for (d, _) in &mut sizes {
        *d = enlarged(*d);
    }
    Features::new(
        &sizes,
        &grains::sizes(mix, form, factor, offset),
        [mix.d_min_mm, mix.d_max_mm].map(enlarged),
        request.specimen.domain().walls_per_mm(),
        form,
    )
}

/// Volume that enlarged grains may fill: the specimen, widened at walls that let grains come
/// closer than half their distance.
fn room_mm3(request: &PackingRequest, rule: &DistanceRule, d_max: f64) -> f64 {
    if request.specimen.is_periodic() {
        return request.specimen.volume_mm3();
    }
    let wider = (rule.gap_mm(d_max, d_max) / 2.0 - rule.wall_gap_mm(d_max)).max(0.0);
    request.specimen.with_lengths(|length| length + 2.0 * wider).volume_mm3()
}

/// Three significant digits, rounded down: a proposal should keep what it promises.
fn round(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let step = 10.0_f64.powi(2 - log10(value).floor() as i32);
    (value * step).floor() / step
}
