//! Reads gradings by formulas and by laws out of JSON.

use super::law::{By, DistributionLaw, dreux_bend_mm, dreux_percent, faury_percent};
use super::{EXPONENT, Grading, number};
use crate::request::decode::{At, Bound, Object};
use crate::request::lengths::{LENGTH, MAX_LENGTH_MM, MIN_LENGTH_MM, length};

const SIGMA: Bound = Bound::closed(0.01, 3.0, "");
const DEVIATION: Bound = Bound::closed(1.0e-9, MAX_LENGTH_MM, "mm");
/// Least standard deviation of a normal law over its mean.
const LEAST_DEVIATION: f64 = 0.001;
const WEIBULL_EXPONENT: Bound = Bound::closed(0.2, 100.0, "");
const BOLOMEY_A: Bound = Bound::closed(0.0, 50.0, "%");
const FAURY_A: Bound = Bound::closed(0.0, 60.0, "%");
const FAURY_B: Bound = Bound::closed(0.0, 10.0, "%");
/// `B` of Faury's curve where a request names none.
const FAURY_USUAL_B: f64 = 1.5;
const FAURY_D_MAX: Bound = Bound::closed(0.1, MAX_LENGTH_MM, "mm");
const DREUX_K: Bound = Bound::closed(-30.0, 40.0, "%");
/// Where the curve of Dreux and Gorisse begins if a request does not say, in mm.
const DREUX_D_MIN_MM: f64 = 0.08;

/// A number that may be absent.
fn number_or(object: &mut Object<'_>, name: &'static str, bound: Bound, usual: f64) -> Option<f64> {
    object.optional(name).map_or(Some(usual), |at| at.number(bound))
}

/// Reports a smallest diameter that is not below the largest.
fn check_order(object: &Object<'_>, d_min_mm: f64, d_max_mm: f64) -> Option<()> {
    if d_min_mm >= d_max_mm {
        object.at().fault(format!("d_min_mm {d_min_mm} must be less than d_max_mm {d_max_mm}"));
        return None;
    }
    Some(())
}

pub(super) fn read_andreasen(object: &mut Object<'_>) -> Option<Grading> {
    let (d_min, d_max) = (length(object, "d_min_mm"), length(object, "d_max_mm"));
    let exponent = number(object, "exponent", EXPONENT);
    let (d_min_mm, d_max_mm, exponent) = (d_min?, d_max?, exponent?);
    check_order(object, d_min_mm, d_max_mm)?;
    Some(Grading::Andreasen { d_min_mm, d_max_mm, exponent })
}

pub(super) fn read_bolomey(object: &mut Object<'_>) -> Option<Grading> {
    let d_max = length(object, "d_max_mm");
    let a = number(object, "a_percent", BOLOMEY_A);
    Some(Grading::Bolomey { d_max_mm: d_max?, a_percent: a? })
}

pub(super) fn read_faury(object: &mut Object<'_>) -> Option<Grading> {
    let d_max = number(object, "d_max_mm", FAURY_D_MAX);
    let a = number(object, "a_percent", FAURY_A);
    let b = number_or(object, "b_percent", FAURY_B, FAURY_USUAL_B);
    let radius = match object.optional("mould_radius_mm") {
        Some(at) => at.number(LENGTH).map(Some),
        None => Some(None),
    };
    let (d_max_mm, a_percent, b_percent, mould_radius_mm) = (d_max?, a?, b?, radius?);
    if let Some(radius_mm) = mould_radius_mm.filter(|radius_mm| *radius_mm <= 0.75 * d_max_mm) {
        object.at().fault(format!(
            "mould_radius_mm {radius_mm} is out of range: must be more than 0.75 of the largest diameter {d_max_mm} mm"
        ));
        return None;
    }
    let middle = faury_percent(d_max_mm, a_percent, b_percent, mould_radius_mm);
    check_middle(object, middle, 0.5 * d_max_mm)?;
    Some(Grading::Faury { d_max_mm, a_percent, b_percent, mould_radius_mm })
}

pub(super) fn read_dreux_gorisse(object: &mut Object<'_>) -> Option<Grading> {
    let d_min = number_or(object, "d_min_mm", LENGTH, DREUX_D_MIN_MM);
    let d_max = length(object, "d_max_mm");
    let k = number(object, "k_percent", DREUX_K);
    let (d_min_mm, d_max_mm, k_percent) = (d_min?, d_max?, k?);
    let bend_mm = dreux_bend_mm(d_max_mm);
    if d_min_mm >= bend_mm {
        object
            .at()
            .fault(format!("d_min_mm {d_min_mm} must be less than {bend_mm} mm, where the curve bends"));
        return None;
    }
    check_middle(object, dreux_percent(d_max_mm, k_percent), bend_mm)?;
    Some(Grading::DreuxGorisse { d_min_mm, d_max_mm, k_percent })
}

/// The point between the ends of a curve must lie between 0 and 100 %.
fn check_middle(object: &Object<'_>, percent: f64, d_mm: f64) -> Option<()> {
    if percent <= 0.0 || percent >= 100.0 {
        object.at().fault(format!(
            "{percent:.4} % would pass {d_mm} mm: must be more than 0 and less than 100 %; change the largest diameter, \
             the percents or the radius of the mould"
        ));
        return None;
    }
    Some(())
}

pub(super) fn read_lognormal(object: &mut Object<'_>) -> Option<Grading> {
    let median = length(object, "median_mm");
    let sigma = number(object, "sigma", SIGMA);
    let by = read_by(object);
    let law = median.zip(sigma).map(|(median_mm, sigma)| DistributionLaw::Lognormal { median_mm, sigma });
    let (d_min_mm, d_max_mm) = read_bounds(object, law)?;
    let (median_mm, sigma, by) = (median?, sigma?, by?);
    Some(Grading::Lognormal { median_mm, sigma, by, d_min_mm, d_max_mm })
}

pub(super) fn read_normal(object: &mut Object<'_>) -> Option<Grading> {
    let mean = length(object, "mean_mm");
    let deviation = number(object, "standard_deviation_mm", DEVIATION);
    let by = read_by(object);
    let law = mean
        .zip(deviation)
        .map(|(mean_mm, standard_deviation_mm)| DistributionLaw::Normal { mean_mm, standard_deviation_mm });
    let (d_min_mm, d_max_mm) = read_bounds(object, law)?;
    let (mean_mm, standard_deviation_mm, by) = (mean?, deviation?, by?);
    if standard_deviation_mm < LEAST_DEVIATION * mean_mm {
        let least = LEAST_DEVIATION * mean_mm;
        object.at().fault_below(
            "/standard_deviation_mm",
            format!(
                "{standard_deviation_mm} is out of range: must be at least {least} mm, {LEAST_DEVIATION} of the mean"
            ),
        );
        return None;
    }
    Some(Grading::Normal { mean_mm, standard_deviation_mm, by, d_min_mm, d_max_mm })
}

pub(super) fn read_weibull(object: &mut Object<'_>) -> Option<Grading> {
    let scale = length(object, "scale_mm");
    let shape = number(object, "shape", WEIBULL_EXPONENT);
    let by = read_by(object);
    let law = scale.zip(shape).map(|(scale_mm, shape)| DistributionLaw::Weibull { scale_mm, shape });
    let (d_min_mm, d_max_mm) = read_bounds(object, law)?;
    let (scale_mm, shape, by) = (scale?, shape?, by?);
    Some(Grading::Weibull { scale_mm, shape, by, d_min_mm, d_max_mm })
}

pub(super) fn read_rosin_rammler(object: &mut Object<'_>) -> Option<Grading> {
    let scale = length(object, "characteristic_mm");
    let exponent = number(object, "exponent", WEIBULL_EXPONENT);
    let law = scale.zip(exponent).map(|(scale_mm, shape)| DistributionLaw::Weibull { scale_mm, shape });
    let (d_min_mm, d_max_mm) = read_bounds(object, law)?;
    let (characteristic_mm, exponent) = (scale?, exponent?);
    Some(Grading::RosinRammler { characteristic_mm, exponent, d_min_mm, d_max_mm })
}

/// Reads the bounds of a law; those that are absent are its usual ones.
fn read_bounds(object: &mut Object<'_>, law: Option<DistributionLaw>) -> Option<(f64, f64)> {
    let low_at = object.optional("d_min_mm");
    let high_at = object.optional("d_max_mm");
    let given = |at: &Option<At<'_>>| match at {
        Some(at) => at.number(LENGTH).map(Some),
        None => Some(None),
    };
    let (low, high) = (given(&low_at), given(&high_at));
    let (low, high, law) = (low?, high?, law?);
    let usual = law.usual_bounds_mm();
    let (d_min_mm, d_max_mm) = (low.unwrap_or(usual.0), high.unwrap_or(usual.1));
    if d_min_mm <= 0.0 {
        object.at().fault(
            "the law has more than 0.1 % below a diameter of 0: must have a d_min_mm, at which it is cut off",
        );
        return None;
    }
    for (name, mm) in [("d_min_mm", d_min_mm), ("d_max_mm", d_max_mm)] {
        if !LENGTH.contains(mm) {
            object.at().fault(format!(
                "the law goes to {mm:.4e} mm, which is out of range: name a {name} of {MIN_LENGTH_MM:e} to \
                 {MAX_LENGTH_MM} mm, at which it is cut off"
            ));
            return None;
        }
    }
    let at = low_at.as_ref().or(high_at.as_ref()).unwrap_or(object.at());
    if d_min_mm >= d_max_mm {
        let unnamed = match (low, high) {
            (Some(_), None) => ", which 99.9 % of the law are finer than, for none is given",
            (None, Some(_)) => "; 0.1 % of the law are finer than d_min_mm, for none is given",
            _ => "",
        };
        at.fault(format!("d_min_mm {d_min_mm} must be less than d_max_mm {d_max_mm}{unnamed}"));
        return None;
    }
    if !law.reaches_mm(d_min_mm, d_max_mm) {
        at.fault(format!(
            "less than 1e-9 of the law lies between d_min_mm {d_min_mm} and d_max_mm {d_max_mm}: must hold more of it; \
             look at the units"
        ));
        return None;
    }
    Some((d_min_mm, d_max_mm))
}

/// Reads what the shares of a law or of sizes count.
pub(super) fn read_by(object: &mut Object<'_>) -> Option<By> {
    object
        .optional("by")
        .map_or(Some(By::default()), |at| at.choice(&[("mass", By::Mass), ("number", By::Number)]))
}

#[cfg(test)]
#[path = "read_law_tests.rs"]
mod tests;
