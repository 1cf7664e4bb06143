//! How far whole grains miss the volumes that a mix requests.
//!
//! Sampling draws whole grains until the volume of a class is reached (`docs/method.md`, section 1), so the total
//! volume is too large by less than one grain of the finest class that was drawn. A specimen that is small for its
//! grains, or a very small volume fraction, makes this a large share of the total. A total that is off by more than
//! [`MAX_DEVIATION`] is an error, unless the mix has `allow_coarse`; then it is a warning. A size class that is off by
//! more than the same share of its own volume is a warning.

use super::class::{Class, Law};
use super::{GradedMix, sphere_volume};
use crate::elementary::log10;
use crate::packing::{AggregateReport, ClassReport};
use crate::request::{FieldError, Mix};
use crate::sorting;

/// Largest deviation of the total volume, and of that of a size class, as a share of what is requested.
pub const MAX_DEVIATION: f64 = 0.05;
/// Size classes that a warning names.
const NAMED_CLASSES: usize = 3;
/// Share of a grain by which rounding may raise the number of equal grains.
const ROUNDING: f64 = 1.0e-9;

/// The smallest total volume of whole grains that sampling can draw, in mm³: at least one grain of the coarsest class
/// of every part; of equal grains the exact volume.
fn least_volume_mm3(mix: &GradedMix) -> f64 {
    (0..mix.parts)
        .filter_map(|part| mix.classes_of(part).next_back())
        .map(|class| least_of_mm3(mix, class))
        .sum()
}

/// The same of the part that has this coarsest class.
fn least_of_mm3(mix: &GradedMix, coarsest: &Class) -> f64 {
    let grain = sphere_volume(coarsest.low_mm);
    if let Some(shapes) = &mix.shapes {
        return grain * shapes.least_volume_ratio(coarsest.part, coarsest.high_mm);
    }
    match coarsest.law {
        Law::Single => {
            let grains = (mix.class_volume_mm3(coarsest) / grain - ROUNDING).ceil().max(1.0);
            grains * grain
        }
        _ => grain,
    }
}

fn requested_mm3(mix: &GradedMix) -> f64 {
    mix.volume_fraction_effective * mix.specimen_volume_mm3
}

/// Judges the total volume before any grain is drawn; `None` where it can be met.
///
/// # Errors
/// The fault of the field that sets the volume, where every sampling misses the volume and the mix does not allow it.
pub(crate) fn foresee(requested: &Mix, mix: &GradedMix) -> Result<Option<String>, FieldError> {
    if !mix.has_requested_volume() {
        return Ok(None);
    }
    judge(requested, mix, least_volume_mm3(mix), "at least ")
}

/// Judges the total volume of sampled grains in mm³; `None` where it is met.
///
/// # Errors
/// As [`foresee`].
pub(crate) fn judge_volume(
    requested: &Mix,
    mix: &GradedMix,
    volume_mm3: f64,
) -> Result<Option<String>, FieldError> {
    if !mix.has_requested_volume() {
        return Ok(None);
    }
    judge(requested, mix, volume_mm3, "")
}

fn judge(
    requested: &Mix,
    mix: &GradedMix,
    found_mm3: f64,
    bound: &str,
) -> Result<Option<String>, FieldError> {
    let requested_mm3 = requested_mm3(mix);
    if found_mm3 <= (1.0 + MAX_DEVIATION) * requested_mm3 {
        return Ok(None);
    }
    let deviation = format!(
        "whole grains have a volume fraction of {bound}{} where {} is requested",
        figures(found_mm3 / mix.specimen_volume_mm3),
        figures(mix.volume_fraction_effective)
    );
    if requested.allow_coarse {
        return Ok(Some(format!("{deviation} (allow_coarse)")));
    }
    Err(FieldError {
        pointer: requested.amount_pointer().into(),
        detail: format!(
            "{deviation}: must be at most {:.0} % more; take a larger specimen, a larger volume fraction or a smaller \
             largest grain, list the diameters, or set mix.allow_coarse to true",
            MAX_DEVIATION * 100.0
        ),
    })
}

/// The classes of a packing that miss their volume by more than [`MAX_DEVIATION`], in one sentence.
pub(crate) fn class_warning(classes: &[ClassReport]) -> Option<String> {
    let deviation = |class: &ClassReport| class.volume_mm3 / class.target_volume_mm3 - 1.0;
    let mut off: Vec<&ClassReport> = classes
        .iter()
        .filter(|class| class.target_volume_mm3 > 0.0 && deviation(class).abs() > MAX_DEVIATION)
        .collect();
    if off.is_empty() {
        return None;
    }
    sorting::by_number(&mut off, |class| -deviation(class).abs());
    let named: Vec<String> = off
        .iter()
        .take(NAMED_CLASSES)
        .map(|class| {
            let percent = figures(100.0 * deviation(class));
            format!("{}..{} mm by {percent} %", figures(class.d_min_mm), figures(class.d_max_mm))
        })
        .collect();
    let more = match off.len().saturating_sub(NAMED_CLASSES) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    Some(format!(
        "the volume of these size classes differs from the grading curve by more than {:.0} %: {}{more}; a larger \
         specimen follows the curve more closely",
        MAX_DEVIATION * 100.0,
        named.join(", ")
    ))
}

/// The aggregates of a packing that miss their volume by more than [`MAX_DEVIATION`], in one sentence.
pub(crate) fn aggregate_warning(aggregates: &[AggregateReport]) -> Option<String> {
    let off: Vec<String> = aggregates
        .iter()
        .enumerate()
        .filter(|(_, aggregate)| aggregate.target_volume_mm3 > 0.0)
        .map(|(number, aggregate)| {
            (number, aggregate, aggregate.volume_mm3 / aggregate.target_volume_mm3 - 1.0)
        })
        .filter(|(.., deviation)| deviation.abs() > MAX_DEVIATION)
        .map(|(number, aggregate, deviation)| {
            let name = aggregate.name.clone().unwrap_or_else(|| number.to_string());
            format!("{name} by {} %", figures(100.0 * deviation))
        })
        .collect();
    (!off.is_empty()).then(|| {
        format!(
            "the volume of these aggregates differs from their share by more than {:.0} %: {}; a larger specimen \
             follows the shares more closely",
            MAX_DEVIATION * 100.0,
            off.join(", ")
        )
    })
}

/// A number with three significant figures.
fn figures(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        // Zero has no sign here.
        return (value + 0.0).to_string();
    }
    let magnitude = log10(value.abs()).floor() as i32;
    if magnitude < -4 {
        let text = format!("{value:.2e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", without_zeros(mantissa));
    }
    let decimals = (2 - magnitude).max(0) as usize;
    without_zeros(&format!("{value:.decimals$}")).to_owned()
}

/// A number without the zeros at the end of its decimals.
fn without_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::{Limits, PackError, Packing, PackingRequest, Plan, PlanError, Unattended, pack};

    fn request(
        size_mm: f64,
        grading: &Value,
        d_min_mm: Option<f64>,
        fraction: f64,
        coarse: bool,
    ) -> PackingRequest {
        let mut value = json!({
            "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm]},
            "mix": {"grading": grading, "volume_fraction": fraction, "allow_coarse": coarse},
        });
        if let Some(d) = d_min_mm {
            value["mix"]["d_min_mm"] = json!(d);
        }
        PackingRequest::from_json(&value, 1).unwrap()
    }

    fn packed(request: &PackingRequest) -> Result<Packing, PackError> {
        pack(request, &Limits::default(), &Unattended)
    }

    fn standard(name: &str) -> Value {
        json!({"type": "standard", "name": name})
    }

    #[test]
    fn a_volume_below_that_of_one_grain_is_refused_by_the_plan() {
        let refused =
            Plan::new(&request(100.0, &standard("A16"), Some(2.0), 1e-6, false), &Limits::default());
        let Err(PlanError::Coarse(fault)) = refused else { panic!("{refused:?}") };
        assert_eq!(fault.pointer, "/mix/volume_fraction");
        assert!(fault.detail.contains("where 7.9e-7 is requested"), "{fault}");
        assert!(fault.detail.contains("allow_coarse"), "{fault}");

        let allowed = request(100.0, &standard("A16"), Some(2.0), 1e-6, true);
        let plan = Plan::new(&allowed, &Limits::default()).unwrap();
        assert!(plan.warnings.iter().any(|w| w.contains("where 7.9e-7 is requested")), "{:?}", plan.warnings);
        let report = packed(&allowed).unwrap().report;
        assert_eq!(report.summary.grains, 1);
        assert!(
            report.warnings.iter().any(|w| w.contains("where 7.9e-7 is requested")),
            "{:?}",
            report.warnings
        );
        assert!(report.warnings.iter().any(|w| w.contains("size classes")), "{:?}", report.warnings);
    }

    #[test]
    fn one_grain_of_six_times_the_volume_is_refused() {
        let missed = request(50.0, &standard("A8"), Some(7.99), 0.5, false);
        let ended = packed(&missed);
        let Err(PackError::Plan(PlanError::Coarse(fault))) = ended else { panic!("{ended:?}") };
        assert!(fault.detail.contains("volume fraction of at least 0.00214 where 0.0003"), "{fault}");
    }

    #[test]
    fn sampled_totals_are_judged_where_the_plan_cannot_tell() {
        // From one to seven grains: the last of them may be too much or not.
        let sieves = json!({"type": "sieves", "points": [[4.0, 0.0], [8.0, 1.0]]});
        let (mut met, mut missed) = (0, 0);
        for seed in 0..40 {
            let mut wanted = request(40.0, &sieves, None, 0.005, false);
            wanted.seed = seed;
            Plan::new(&wanted, &Limits::default()).unwrap();
            match packed(&wanted) {
                Ok(packing) => {
                    met += 1;
                    assert!(packing.report.summary.volume_fraction_effective <= 1.05 * 0.005);
                }
                Err(PackError::Plan(PlanError::Coarse(_))) => missed += 1,
                Err(other) => panic!("{other:?}"),
            }
        }
        assert!(met > 0 && missed > 0, "{met} met, {missed} missed");
    }

    #[test]
    fn equal_grains_are_counted_exactly() {
        let grain = json!({"type": "monodisperse", "diameter_mm": 10.0});
        let fraction = |grains: f64| grains * sphere_volume(10.0) / 1e6;
        let plan = |grains: f64| {
            Plan::new(&request(100.0, &grain, None, fraction(grains), false), &Limits::default())
        };
        assert!(plan(10.0).is_ok());
        assert!(matches!(plan(10.2), Err(PlanError::Coarse(_))));
        assert!(plan(30.2).is_ok());
    }

    #[test]
    fn a_class_of_one_grain_too_many_is_a_warning() {
        let classes = json!({"type": "classes", "classes": [
            {"d_min_mm": 1.0, "d_max_mm": 31.5, "mass_fraction": 0.99},
            {"d_min_mm": 31.5, "d_max_mm": 32.0, "mass_fraction": 0.01}]});
        let report = packed(&request(70.0, &classes, Some(1.0), 0.4, false)).unwrap().report;
        let said = report.warnings.iter().find(|w| w.contains("size classes")).unwrap();
        assert!(said.contains("31.5..32 mm by "), "{said}");
    }

    #[test]
    fn an_ample_mix_has_no_warnings() {
        let report = packed(&request(100.0, &standard("A16"), Some(2.0), 0.4, false)).unwrap().report;
        assert_eq!(report.warnings, Vec::<String>::new());
    }

    #[test]
    fn figures_are_short() {
        let shown = [0.0, 7.9e-7, 0.002_136, 0.5, 31.5, 1100.0, -84.04].map(figures);
        assert_eq!(shown, ["0", "7.9e-7", "0.00214", "0.5", "31.5", "1100", "-84"]);
    }
}
