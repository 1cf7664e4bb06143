//! What no run can do and a plan refuses: grains that do not fit, more volume than any arrangement has, more grains or
//! memory than a run may use.

use super::estimate::Case;
use super::shapes;
use super::{Limits, infeasible, invalid};
use crate::distance::DistanceRule;
use crate::elementary::powf;
use crate::error::PlanError;
use crate::methods::edmd::MAX_GRAINS;
use crate::methods::monte_carlo;
use crate::methods::rsa::MAX_PLACED;
use crate::mix::GradedMix;
use crate::request::{Amount, Distance, FieldError, GrainKind, MIN_SHARE, Mix, PackingRequest};

/// Densest packing of equal spheres (Kepler; Hales 2005): pi / sqrt(18).
const EQUAL_SPHERES: f64 = 0.740_480_489_693_061;
/// Share of the voids that stays when the ratio of diameters grows: an exponent below which no
/// known packing lies. (Best of binary spheres at a ratio of 4.5: 0.8245, Hopkins et al. 2012;
/// the curve gives 0.858.)
const VOIDS_EXPONENT: f64 = -0.4;
/// Ratio of diameters up to which grains may order like equal ones.
const NEARLY_EQUAL: f64 = 1.2;
/// Over random close packing (`rods`), a share that no random packing of a curve was seen to come near: the
/// densest of the studies lie at 1.0, and where they jam without walls is estimated at 1.10 (`model`).
const BEYOND_RANDOM: f64 = 1.12;

/// A list of diameters, and a number of grains, may have more volume than the specimen.
pub(super) fn volume(mix: &GradedMix) -> Result<(), PlanError> {
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
pub(super) fn cut_off(requested: &Mix, mix: &GradedMix) -> Result<(), PlanError> {
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
pub(super) fn largest(
    request: &PackingRequest,
    mix: &GradedMix,
    rule: &DistanceRule,
) -> Result<(), PlanError> {
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
pub(super) fn largest_distance(request: &PackingRequest, mix: &GradedMix) -> Result<(), PlanError> {
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

pub(super) fn limits(case: &Case<'_>, memory_bytes: u64, limits: &Limits) -> Result<(), PlanError> {
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
            "the mix has about {grains:.0} grains above {} mm, which take about {memory_bytes} bytes of memory: must be \
             at most {}",
            mix.d_min_mm, limits.max_memory_bytes
        ));
    }
    Ok(())
}

/// Refuses what no arrangement reaches: more than the densest packing known of spheres of such a range,
/// or, where sizes follow a curve, more than random packings come near.
pub(super) fn feasible(case: &Case<'_>) -> Result<(), PlanError> {
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
