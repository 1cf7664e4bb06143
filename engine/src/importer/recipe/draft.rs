//! A recipe as it is printed: amounts with their units.

use super::super::Note;
use super::labels::{Label, density_of};
use super::units::Unit;

/// Densities of parts, in kg/m³.
pub(super) const DENSITY_KG_M3: std::ops::RangeInclusive<f64> = 300.0..=9000.0;

/// An amount of a part, as it is printed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub(super) label: Label,
    pub(super) value: f64,
    pub(super) unit: Option<Unit>,
    pub(super) line: u32,
    pub(super) cell: Option<String>,
    pub(super) density_kg_m3: Option<f64>,
    /// Water that the dry aggregate takes up, over its mass.
    pub(super) absorption: Option<f64>,
    /// Water of the aggregate as it is weighed, over its dry mass.
    pub(super) moisture: Option<f64>,
}

impl Entry {
    /// An amount of a text.
    pub(super) fn new(label: Label, value: f64, unit: Option<Unit>, line: u32) -> Self {
        let density_kg_m3 = label.density_kg_m3;
        Self { label, value, unit, line, cell: None, density_kg_m3, absorption: None, moisture: None }
    }

    /// The number of a row of densities, in kg/m³.
    pub(super) fn density(&self) -> Option<f64> {
        let density = match self.unit {
            Some(Unit::Content(factor)) => self.value * factor,
            _ => density_of(self.value),
        };
        Some(density).filter(|density| DENSITY_KG_M3.contains(density))
    }
}

/// A recipe as it is printed.
#[derive(Clone, Debug, Default)]
pub(super) struct Draft {
    pub(super) name: Option<String>,
    pub(super) entries: Vec<Entry>,
    /// The volume of the batch in m³, where the text states it.
    pub(super) batch_m3: Option<f64>,
    /// Whether the title says that the parts are volumes.
    pub(super) by_volume: bool,
    pub(super) notes: Vec<Note>,
}
