//! The aggregate of a mix by what concrete technology names: cement, water and air in a cubic metre.
//!
//! Every part is a share of the volume of fresh concrete, and what they leave is aggregate.

use serde::Serialize;

use super::MIN_SHARE;
use super::decode::{At, Bound, Items};

/// Density of Portland cement, in kg/m³.
pub const CEMENT_DENSITY_KG_M3: f64 = 3150.0;
/// Density of water, in kg/m³.
pub const WATER_DENSITY_KG_M3: f64 = 1000.0;
/// Density of quartz aggregate, in kg/m³.
pub const AGGREGATE_DENSITY_KG_M3: f64 = 2650.0;
/// Volume of the air that stays in compacted concrete over that of the concrete.
pub const AIR: f64 = 0.03;

/// Most additions of a mix.
const MAX_ADDITIONS: usize = 100;
/// Mass of a part in a cubic metre of concrete.
pub(super) const MASS: Bound = Bound::positive(10_000.0, "kg/m3");
/// Density of a material.
pub(super) const DENSITY: Bound = Bound::closed(100.0, 30_000.0, "kg/m3");
const WATER_RATIO: Bound = Bound::closed(0.0, 10.0, "");
const AGGREGATE_RATIO: Bound = Bound::positive(100.0, "");
const SHARE: Bound = Bound::closed(0.0, 1.0, "");
/// The shares of a mix typed by hand may miss 1 by this much.
const ROUNDING: f64 = 1.0e-9;

/// What a cubic metre of fresh concrete contains. The aggregate, that below the cut-off too, is what the other
/// parts leave, or `aggregate_cement` times the cement.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MixProportions {
    /// Mass of cement in a cubic metre of concrete.
    #[cfg_attr(feature = "openapi", schema(exclusive_minimum = 0, maximum = 10_000))]
    pub cement_kg_m3: f64,
    /// Mass of water over that of cement.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 10))]
    pub water_cement: f64,
    /// Mass of aggregate over that of cement. The air is then what all parts leave, so that `air` must be
    /// absent. When this is absent, the aggregate is what the others leave.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 100)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aggregate_cement: Option<f64>,
    /// Fly ash, silica fume, fillers.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = super::schema::OneOrMore<MixAddition>)
    )]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub additions: Vec<MixAddition>,
    /// Volume of air over that of the concrete; 0.03 when absent.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub air: Option<f64>,
    /// Density of the cement.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, default = 3150, minimum = 100, maximum = 30_000)
    )]
    pub cement_density_kg_m3: f64,
    /// Density of the water.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, default = 1000, minimum = 100, maximum = 30_000)
    )]
    pub water_density_kg_m3: f64,
    /// Density of the aggregate, 2650 when absent; needed with `aggregate_cement` only.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 100, maximum = 30_000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aggregate_density_kg_m3: Option<f64>,
}

/// A fine addition to the cement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MixAddition {
    /// Mass of it in a cubic metre of concrete.
    #[cfg_attr(feature = "openapi", schema(exclusive_minimum = 0, maximum = 10_000))]
    pub mass_kg_m3: f64,
    /// Its density.
    #[cfg_attr(feature = "openapi", schema(minimum = 100, maximum = 30_000))]
    pub density_kg_m3: f64,
}

impl MixProportions {
    /// Volume of all aggregate over that of the concrete.
    pub fn aggregate_fraction(&self) -> f64 {
        match self.aggregate_cement {
            Some(ratio) => {
                ratio * self.cement_kg_m3 / self.aggregate_density_kg_m3.unwrap_or(AGGREGATE_DENSITY_KG_M3)
            }
            None => 1.0 - self.others().iter().map(|(_, share)| share).sum::<f64>(),
        }
    }

    /// The parts beside the aggregate by name, as shares of the volume; without air where that follows.
    fn others(&self) -> Vec<(&'static str, f64)> {
        let water_kg_m3 = self.water_cement * self.cement_kg_m3;
        let mut parts = vec![
            ("cement", self.cement_kg_m3 / self.cement_density_kg_m3),
            ("water", water_kg_m3 / self.water_density_kg_m3),
        ];
        if !self.additions.is_empty() {
            parts.push(("additions", self.additions.iter().map(|a| a.mass_kg_m3 / a.density_kg_m3).sum()));
        }
        if self.aggregate_cement.is_none() {
            parts.push(("air", self.air.unwrap_or(AIR)));
        }
        parts
    }

    /// What is wrong with the parts together, if anything is.
    fn fault(&self) -> Option<String> {
        let aggregate = self.aggregate_fraction();
        let mut parts = self.others();
        if self.aggregate_cement.is_some() {
            parts.push(("aggregate", aggregate));
        }
        let sum: f64 = parts.iter().map(|(_, share)| share).sum();
        let terms: Vec<String> = parts.iter().map(|(name, share)| format!("{name} {share:.4}")).collect();
        let terms = terms.join(" + ");
        if self.aggregate_cement.is_some() {
            if aggregate < MIN_SHARE {
                return Some(format!(
                    "{terms}: the aggregate is {aggregate:e} of the volume: must be at least {MIN_SHARE:e}"
                ));
            }
            return (sum > 1.0 + ROUNDING).then(|| {
                format!(
                    "{terms}: the terms sum to {sum:.4} of the volume, which implies {:.4} of air: must sum to at \
                     most 1",
                    1.0 - sum
                )
            });
        }
        (aggregate < MIN_SHARE).then(|| {
            format!(
                "{terms}: the terms sum to {sum:.4} of the volume, which leaves no aggregate: must sum to less than 1"
            )
        })
    }
}

/// Reads a content with its defaults; `of_aggregates` is the mean density of the aggregates in kg/m³, where they have
/// densities of their own, and `mass_kg_m3` their mass in a cubic metre, where they are given by it.
///
/// `None` means that faults were reported.
pub(super) fn read_proportions(
    at: &At<'_>,
    of_aggregates: Option<f64>,
    mass_kg_m3: Option<f64>,
) -> Option<MixProportions> {
    let mut object = at.object()?;
    let cement = object.required("cement_kg_m3").and_then(|at| at.number(MASS));
    let water_cement = object.required("water_cement").and_then(|at| at.number(WATER_RATIO));
    let ratio_at = object.optional("aggregate_cement");
    if let (Some(at), Some(_)) = (&ratio_at, mass_kg_m3) {
        at.fault("follows from the mass_kg_m3 of the aggregates: leave this field out");
    }
    let of_masses = mass_kg_m3.zip(cement).map(|(mass, cement)| {
        let ratio = Some(mass / cement).filter(|&ratio| AGGREGATE_RATIO.contains(ratio));
        if ratio.is_none() {
            at.fault(format!(
                "{mass} kg of aggregate and {cement} kg of cement: the aggregate must have at most 100 times the \
                 mass of the cement"
            ));
        }
        ratio
    });
    let aggregate_cement = ratio_at.as_ref().map(|at| at.number(AGGREGATE_RATIO)).or(of_masses);
    let has_mass = aggregate_cement.is_some();
    let additions = match object.optional("additions") {
        Some(at) => at.list().and_then(|items| read_additions(&at, &items)),
        None => Some(Vec::new()),
    };
    let air = match object.optional("air") {
        Some(at) if has_mass => {
            at.fault(
                "with aggregate_cement, or the mass_kg_m3 of the aggregates, the air is what all parts leave: leave one \
                 of the two out",
            );
            None
        }
        Some(at) => at.number(SHARE).map(Some),
        None => Some((!has_mass).then_some(AIR)),
    };
    let mut density = |name, default| match object.optional(name) {
        Some(at) => at.number(DENSITY),
        None => Some(default),
    };
    let cement_density = density("cement_density_kg_m3", CEMENT_DENSITY_KG_M3);
    let water_density = density("water_density_kg_m3", WATER_DENSITY_KG_M3);
    let aggregate_density = match object.optional("aggregate_density_kg_m3") {
        Some(at) if !has_mass => {
            at.fault(
                "the aggregate is what the other parts leave, whatever its density: needs aggregate_cement",
            );
            None
        }
        Some(at) => at.number(DENSITY).and_then(|given| match of_aggregates {
            Some(mean) if (given / mean - 1.0).abs() > ROUNDING => {
                at.fault(format!(
                    "the aggregates have a mean density of {mean} kg/m3 by their own: leave this field out"
                ));
                None
            }
            _ => Some(Some(given)),
        }),
        None => Some(has_mass.then_some(of_aggregates.unwrap_or(AGGREGATE_DENSITY_KG_M3))),
    };
    object.finish();
    let proportions = MixProportions {
        cement_kg_m3: cement?,
        water_cement: water_cement?,
        aggregate_cement: match aggregate_cement {
            None => None,
            Some(read) => Some(read?),
        },
        additions: additions?,
        air: air?,
        cement_density_kg_m3: cement_density?,
        water_density_kg_m3: water_density?,
        aggregate_density_kg_m3: aggregate_density?,
    };
    match proportions.fault() {
        Some(fault) => {
            at.fault(fault);
            None
        }
        None => Some(proportions),
    }
}

fn read_additions(at: &At<'_>, items: &Items<'_>) -> Option<Vec<MixAddition>> {
    if items.len() > MAX_ADDITIONS {
        at.fault(format!("has {} additions: must have at most {MAX_ADDITIONS}", items.len()));
        return None;
    }
    items.iter().map(|item| read_addition(&item)).collect()
}

fn read_addition(at: &At<'_>) -> Option<MixAddition> {
    let mut object = at.object()?;
    let mass = object.required("mass_kg_m3").and_then(|at| at.number(MASS));
    let density = object.required("density_kg_m3").and_then(|at| at.number(DENSITY));
    object.finish();
    Some(MixAddition { mass_kg_m3: mass?, density_kg_m3: density? })
}

#[cfg(test)]
#[path = "proportions_tests.rs"]
mod tests;
