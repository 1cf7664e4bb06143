//! Parts of concrete with their masses and densities, and all parts of a recipe.

use super::super::words::{fold, has};
use super::amounts::WATER_KG_M3;
use super::draft::{Draft, Entry};
use super::ingredients::{Kind, kind};
use super::labels::Label;
use super::sizes::size_mm;

/// Usual density of Portland cement, in kg/m³.
pub(super) const CEMENT_KG_M3: f64 = 3100.0;
/// Usual density of blast furnace cement (CEM III), in kg/m³.
const SLAG_CEMENT_KG_M3: f64 = 3000.0;
/// Density of aggregates that state none, in kg/m³: that of quartz.
pub(super) const AGGREGATE_KG_M3: f64 = 2650.0;

/// A part with its mass, in the unit of its recipe.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Part {
    pub(super) name: String,
    pub(super) mass: f64,
    pub(super) density_kg_m3: f64,
    /// Whether the recipe states the density.
    pub(super) is_stated: bool,
    pub(super) absorption: Option<f64>,
    pub(super) moisture: Option<f64>,
    pub(super) is_dry: bool,
    pub(super) line: u32,
}

/// The parts of a recipe, in its unit.
#[derive(Clone, Debug, Default)]
pub(super) struct Contents {
    pub(super) cement: Vec<Part>,
    pub(super) additions: Vec<Part>,
    pub(super) aggregates: Vec<Part>,
    /// Fibres, and admixtures whose density is stated.
    pub(super) others: Vec<Part>,
    pub(super) water: Option<f64>,
    /// The stated ratio.
    pub(super) water_cement: Option<f64>,
    pub(super) air: Option<f64>,
}

impl Contents {
    /// What the parts fill without air, in m³.
    pub(super) fn volume_m3(&self) -> f64 {
        let parts = [&self.cement, &self.additions, &self.aggregates, &self.others];
        parts.iter().map(|parts| volume_m3(parts)).sum::<f64>() + self.water.unwrap_or(0.0) / WATER_KG_M3
    }

    /// Multiplies all masses.
    pub(super) fn multiply(&mut self, factor: f64) {
        for parts in [&mut self.cement, &mut self.additions, &mut self.aggregates, &mut self.others] {
            for part in parts {
                part.mass *= factor;
            }
        }
        self.water = self.water.map(|water| water * factor);
    }
}

/// The mass of all parts; `None` where there is none.
pub(super) fn total_of(parts: &[Part]) -> Option<f64> {
    (!parts.is_empty()).then(|| parts.iter().map(|part| part.mass).sum())
}

/// What parts fill, in m³ where their masses are kilograms.
pub(super) fn volume_m3(parts: &[Part]) -> f64 {
    parts.iter().map(|part| part.mass / part.density_kg_m3).sum()
}

/// The usual density of a part, in kg/m³.
pub(super) fn density(label: &Label) -> f64 {
    let folded = fold(&label.name);
    match label.kind {
        Kind::Cement | Kind::Binder => {
            let is_slag = has(&folded, "cem iii|hochofen|blast furnace|haut fourneau|horno alto|alto-forno");
            if is_slag { SLAG_CEMENT_KG_M3 } else { CEMENT_KG_M3 }
        }
        Kind::Addition(addition) => addition.density_kg_m3(),
        Kind::Water(_) => WATER_KG_M3,
        Kind::Fibre => {
            if has(&folded, "steel|stahl|acier|acero|aco|acciaio|metal") {
                7850.0
            } else if has(&folded, "glas|glass|verre|vidrio|vidro|vetro|basalt") {
                2700.0
            } else if has(&folded, "polypropylen|polyprop|pp|kunststoff|polymer|synth") {
                910.0
            } else {
                // As fibres are not named otherwise.
                7850.0
            }
        }
        _ => AGGREGATE_KG_M3,
    }
}

/// The density that a recipe states for an entry: in its row, or in a row of its own, such as `Density of cement`.
pub(super) fn stated_density(entry: &Entry, draft: &Draft) -> Option<f64> {
    if entry.density_kg_m3.is_some() {
        return entry.density_kg_m3;
    }
    let own = fold(&entry.label.name);
    let rows = draft.entries.iter().filter(|row| row.label.kind == Kind::Density);
    let (mut of_kind, mut of_all) = (None, None);
    for row in rows {
        let name = subject(&row.label.name);
        let Some(value) = row.density() else { continue };
        if name.is_empty() {
            // The density of grains.
            if entry.label.kind == Kind::Aggregate || entry.label.kind == Kind::AllAggregate {
                of_all = of_all.or(Some(value));
            }
            continue;
        }
        let folded = fold(&name);
        if own.contains(folded.trim()) || folded.contains(own.trim()) {
            return Some(value);
        }
        let is_fine = super::amounts::is_fine;
        let is_alike = match (kind(&name), entry.label.kind) {
            (Kind::Aggregate, Kind::Aggregate) => {
                // Of all aggregates, or of the sand and the gravel.
                let is_general = size_mm(&name).is_none()
                    && has(&folded, "aggregat|gestein|granulat|arido|agregado|inert")
                    && !has(&folded, "fine|coarse|fino|grueso|graudo|miudo|fin");
                if is_general {
                    of_all = Some(value);
                }
                !is_general && is_fine(&name) == is_fine(&entry.label.name)
            }
            (Kind::Water(_), _) => false,
            (named, own) => named == own,
        };
        if is_alike {
            of_kind = Some(value);
        }
    }
    of_kind.or(of_all)
}

/// Of what a row states the density: its name without the words for densities.
pub(super) fn subject(name: &str) -> String {
    const WORDS: &str = "\
        specific|gravity|masse|volumique|peso|especifico|gravedad|especifica|massa|volumica|specifico|\
        relative|particle|of|de|des|der|von|di|du|del|da|do|the|dry|ssd|la|sp";
    let is_word = |word: &str| {
        let folded = fold(word);
        let word = folded.trim().trim_matches(['.', ',']);
        super::ingredients::has_density(word)
            || word.starts_with('ρ')
            || WORDS.split('|').any(|of| of == word)
    };
    name.split_whitespace().filter(|word| !is_word(word)).collect::<Vec<_>>().join(" ")
}
