//! Amounts of the parts of one recipe in one unit: kilograms in a cubic metre, in a batch, or parts by mass.

use super::super::Refusal;
use super::super::words::{fold, has};
use super::draft::{Draft, Entry};
use super::ingredients::Kind;
use super::sizes::size_mm;
use super::units::{CUBIC_YARD_M3, Of, POUND_KG, Unit};

/// Density of water, in kg/m³.
pub(super) const WATER_KG_M3: f64 = 1000.0;
/// Density of liquid admixtures, in kg/m³, for those that are given in litres.
const ADMIXTURE_KG_M3: f64 = 1050.0;

/// Mass of a sack of cement in the United States: 94 lb.
pub(super) const US_BAG_KG: f64 = 94.0 * POUND_KG;

/// What a recipe leaves open, and one choice of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Assumed {
    /// Mass of a bag of cement, in kg.
    pub(super) bag_kg: Option<f64>,
    /// Bulk densities of cement, sand and gravel, in kg/m³.
    pub(super) bulk_kg_m3: Option<[f64; 3]>,
}

/// What a recipe must be told before it can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Open {
    Bag,
    Bulk,
}

/// What the masses of a recipe belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Basis {
    /// A cubic metre of concrete.
    CubicMetre,
    /// A batch, of this volume in m³ where it is stated.
    Batch(Option<f64>),
    /// Nothing: they have no unit.
    Bare,
}

/// What the amounts of a recipe belong to.
pub(super) fn basis(draft: &Draft) -> Basis {
    let units = || draft.entries.iter().filter(|entry| entry.label.kind.is_part()).map(|entry| entry.unit);
    let is_content = |unit: Option<Unit>| {
        matches!(unit, Some(Unit::Content(_) | Unit::Share(_) | Unit::Bags { in_m3: Some(_), .. }))
    };
    if units().any(is_content) {
        return Basis::CubicMetre;
    }
    let of_row = draft.entries.iter().filter(|entry| entry.label.kind == Kind::Batch).find_map(|entry| {
        match entry.unit {
            Some(Unit::Volume(factor)) => Some(factor * entry.value),
            _ => None,
        }
    });
    let batch = of_row.or(draft.batch_m3).filter(|&m3| m3 > 0.0);
    let is_batch =
        |unit: Option<Unit>| matches!(unit, Some(Unit::Mass(_) | Unit::Volume(_) | Unit::Bags { .. }));
    if units().any(is_batch) {
        return Basis::Batch(batch);
    }
    Basis::Bare
}

/// Whether an amount is in pounds in a cubic yard.
pub(super) fn is_of_yard(entry: &Entry) -> bool {
    match entry.unit {
        Some(Unit::Content(factor)) => (factor * CUBIC_YARD_M3 / POUND_KG - 1.0).abs() < 1.0e-9,
        _ => false,
    }
}

/// The volume that masses without one belong to, beside contents of a cubic metre or yard, in m³.
fn reference_m3(draft: &Draft) -> f64 {
    if draft.entries.iter().any(is_of_yard) { CUBIC_YARD_M3 } else { 1.0 }
}

/// Whether sacks are those of the United States: the other parts are in pounds and gallons.
pub(super) fn has_us_bags(draft: &Draft) -> bool {
    let is_metric = |entry: &Entry| matches!(entry.unit, Some(Unit::Content(1.0) | Unit::Mass(1.0)));
    reference_m3(draft) != 1.0 && !draft.entries.iter().any(is_metric)
}

/// Whether all parts are percentages of their sum.
pub(super) fn is_all_percent(draft: &Draft) -> bool {
    let mut cement = draft.entries.iter().filter(|entry| entry.label.kind == Kind::Cement);
    cement.any(|entry| matches!(entry.unit, Some(Unit::Percent(Of::Any | Of::Mass))))
}

/// What a recipe leaves open; the mass of a bag first.
pub(super) fn open(draft: &Draft, assumed: Assumed) -> Option<Open> {
    let mut parts = draft.entries.iter().filter(|entry| entry.label.kind.is_part());
    let is_bag = |entry: &Entry| matches!(entry.unit, Some(Unit::Bags { kg: None, .. }));
    if assumed.bag_kg.is_none() && !has_us_bags(draft) && draft.entries.iter().any(is_bag) {
        return Some(Open::Bag);
    }
    let is_bulk = parts.any(|entry| is_volume(entry, draft) && !matches!(entry.label.kind, Kind::Water(_)));
    (assumed.bulk_kg_m3.is_none() && is_bulk && !is_solid(draft)).then_some(Open::Bulk)
}

/// Whether a part is counted by its volume.
fn is_volume(entry: &Entry, draft: &Draft) -> bool {
    match entry.unit {
        Some(Unit::Volume(_) | Unit::Share(_) | Unit::Parts { by_volume: true }) => true,
        None | Some(Unit::Parts { .. }) => draft.by_volume,
        _ => false,
    }
}

/// Whether the volumes of a recipe are those of the grains: they fill a cubic metre.
pub(super) fn is_solid(draft: &Draft) -> bool {
    let parts =
        draft.entries.iter().filter(|entry| entry.label.kind.is_part() || entry.label.kind == Kind::Air);
    let sum: f64 = parts
        .map(|entry| match (entry.unit, entry.label.kind) {
            (Some(Unit::Share(factor)), _) => entry.value * factor,
            (Some(Unit::Content(factor)), Kind::Cement) => entry.value * factor / 3100.0,
            (Some(Unit::Content(factor)), Kind::Water(_)) => entry.value * factor / WATER_KG_M3,
            (Some(Unit::Content(factor)), _) => entry.value * factor / entry.density_kg_m3.unwrap_or(2650.0),
            (Some(Unit::Percent(_)), Kind::Air) => entry.value / 100.0,
            _ => 0.0,
        })
        .sum();
    (0.93..1.03).contains(&sum)
}

/// The mass of an amount in the unit of its recipe; `None` for what has none, such as a dose or a percentage.
///
/// # Errors
/// [`Refusal`] where a unit is missing.
pub(super) fn mass(
    entry: &Entry,
    draft: &Draft,
    basis: Basis,
    assumed: Assumed,
    density_kg_m3: f64,
) -> Result<Option<f64>, Refusal> {
    let value = entry.value;
    let by_volume = |m3: f64| {
        let density =
            match (entry.label.kind, assumed.bulk_kg_m3) {
                (Kind::Water(_), _) => WATER_KG_M3,
                (Kind::Admixture, _) => ADMIXTURE_KG_M3,
                (Kind::Aggregate | Kind::AllAggregate, Some([_, sand, gravel])) => {
                    if is_fine(&entry.label.name) { sand } else { gravel }
                }
                (_, Some([cement, ..])) => cement,
                (_, None) => density_kg_m3,
            };
        m3 * density
    };
    let reference = if basis == Basis::CubicMetre { reference_m3(draft) } else { 1.0 };
    Ok(match entry.unit {
        Some(Unit::Content(factor)) => Some(value * factor),
        Some(Unit::Mass(factor)) => Some(value * factor / reference),
        Some(Unit::Share(factor)) => Some(by_volume(value * factor)),
        Some(Unit::Volume(factor)) => Some(by_volume(value * factor) / reference),
        Some(Unit::Bags { kg, in_m3 }) => {
            Some(value * kg.or(assumed.bag_kg).unwrap_or(US_BAG_KG) / in_m3.unwrap_or(reference))
        }
        Some(Unit::Percent(Of::Any | Of::Mass)) if basis == Basis::Bare && is_all_percent(draft) => {
            Some(value)
        }
        Some(Unit::Percent(_) | Unit::Dose) => None,
        None | Some(Unit::Parts { .. }) if basis == Basis::Bare => {
            let is_bulk = draft.by_volume || entry.unit == Some(Unit::Parts { by_volume: true });
            Some(if is_bulk { by_volume(value) } else { value })
        }
        None | Some(Unit::Parts { .. }) if !entry.label.kind.is_part() => None,
        None | Some(Unit::Parts { .. }) => {
            let (name, line) = (&entry.label.name, entry.line);
            return Err(Refusal::at(
                line,
                format!("the amount of \"{name}\" is {value} without a unit: must have one, as the other parts have \
                    (kg/m3, kg, lb/yd3)"),
            )
            .in_cell(entry.cell.clone()));
        }
    })
}

/// Whether an aggregate is sand, by its name.
pub(super) fn is_fine(name: &str) -> bool {
    let folded = fold(name).replace("f.a.", "fa");
    let is_sand = has(&folded, "sand|sable|arena|areia|sabbia|fine|fino|fin|fa|miudo")
        || folded.split_whitespace().any(|word| word.ends_with("sand"));
    match size_mm(name) {
        Some((_, high)) => high <= 5.0,
        None => is_sand,
    }
}
