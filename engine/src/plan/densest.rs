//! What a request amounts to whose volume fraction is to be as large as possible.
//!
//! Numbers of grains are drawn for the volume fraction at which growth is expected to jam, coating included, which is
//! that of the fitted [`model`](super::model). The coated volume of a grading is proportional to its volume fraction,
//! so that a few steps find it. An explicit list has its numbers; for it the factor on all sizes is found, which the
//! distances do not share.

use super::estimate::Case;
use crate::distance::DistanceRule;
use crate::elementary::{cbrt, log10};
use crate::mix::GradedMix;
use crate::request::{Distance, PackingRequest, VolumeFraction};

/// Steps towards the volume fraction.
const STEPS: u32 = 6;
/// Decimal digits of a volume fraction that numbers are drawn for: no more are known.
const DIGITS: i32 = 4;

/// What the grains of a request without a volume fraction are drawn and grown for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Drawing {
    /// Numbers of grains for this `mix.volume_fraction`, at their sizes.
    Fraction(f64),
    /// The grains of a list at this factor on their sizes.
    List(f64),
}

impl Drawing {
    /// What is drawn first; `None` where the request has a volume fraction.
    pub(crate) fn expected(request: &PackingRequest) -> Option<Self> {
        if !request.mix.maximizes_volume_fraction() {
            return None;
        }
        let mut drawing =
            if request.mix.listed_diameters_mm().is_some() { Self::List(1.0) } else { Self::Fraction(0.5) };
        for _ in 0..STEPS {
            let drawn = drawing.of(request);
            let mix = GradedMix::new(&drawn.mix, drawn.specimen.volume_mm3());
            let rule = DistanceRule::new(&drawn.distance, &drawn.specimen);
            let case = Case::of_mix(&drawn, &mix, &rule);
            let at_jamming = case.at_jamming();
            drawing = drawing.at_scale(cbrt(at_jamming / case.filled));
        }
        Some(drawing)
    }

    /// The drawing with which grains jam about where they are expected to, by the scale of all sizes at which those of
    /// this one do.
    pub(crate) fn at_scale(self, scale: f64) -> Self {
        match self {
            Self::Fraction(fraction) => Self::Fraction(rounded(fraction * scale.powi(3))),
            Self::List(_) => Self::List(scale),
        }
    }

    /// The scale that growth is expected to reach.
    pub(crate) fn scale(self) -> f64 {
        match self {
            Self::Fraction(_) => 1.0,
            Self::List(scale) => scale,
        }
    }

    /// The request with the volume fraction that is drawn.
    pub(crate) fn numbers_of(self, request: &PackingRequest) -> PackingRequest {
        let mut drawn = request.clone();
        drawn.mix.volume_fraction = match self {
            Self::Fraction(fraction) => Some(VolumeFraction::Of(fraction)),
            Self::List(_) => None,
        };
        drawn
    }

    /// The same as grains grow by it: at the scale that is expected they have their distances.
    pub(crate) fn of(self, request: &PackingRequest) -> PackingRequest {
        let mut drawn = self.numbers_of(request);
        let scale = self.scale();
        let shorter = |mm: Option<f64>| mm.map(|mm| mm / scale);
        drawn.distance = match request.distance {
            Distance::None { wall_gap_mm } => Distance::None { wall_gap_mm: shorter(wall_gap_mm) },
            Distance::Constant { gap_mm, wall_gap_mm } => {
                Distance::Constant { gap_mm: gap_mm / scale, wall_gap_mm: shorter(wall_gap_mm) }
            }
            Distance::Proportional { factor, wall_gap_mm } => {
                Distance::Proportional { factor, wall_gap_mm: shorter(wall_gap_mm) }
            }
            Distance::SmallerDiameter { factor, wall_gap_mm } => {
                Distance::SmallerDiameter { factor, wall_gap_mm: shorter(wall_gap_mm) }
            }
            // Reading a request refuses it beside a volume fraction that is to be as large as possible.
            Distance::Maximize { wall_gap_mm } => Distance::Maximize { wall_gap_mm },
        };
        if let Some(options) = drawn.method.growth_mut() {
            options.initial_scale = options.initial_scale.map(|share| share * scale);
        }
        drawn
    }
}

/// A volume fraction with as many digits as are known.
fn rounded(fraction: f64) -> f64 {
    let per_unit = 10.0_f64.powi(DIGITS - 1 - log10(fraction.max(f64::MIN_POSITIVE)).floor() as i32);
    (fraction * per_unit).round() / per_unit
}
