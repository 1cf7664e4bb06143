//! What a reading answers.

use serde::Serialize;
use serde_json::Value;

/// What became of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It has one reading.
    Ok,
    /// It has one reading, with a warning in its notes.
    Warn,
    /// Several readings fit: one of the candidates is to be chosen.
    Ask,
    /// It has none: the notes say where, why and what to do.
    Refuse,
}

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    /// What passes each sieve, of all.
    Passing,
    /// What stays on each sieve, of all.
    Retained,
    /// What stays on each sieve and on all coarser ones, of all.
    CumulativeRetained,
    /// The mass that stays on each sieve.
    Mass,
    /// The mass that stays on each sieve and on all coarser ones.
    CumulativeMass,
    /// The mass that passes each sieve.
    MassPassing,
}

impl Meaning {
    /// Its words in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passing => "passing",
            Self::Retained => "retained",
            Self::CumulativeRetained => "cumulative retained",
            Self::Mass => "mass retained",
            Self::CumulativeMass => "cumulative mass retained",
            Self::MassPassing => "mass passing",
        }
    }
}

/// How much a note weighs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// How something was read.
    Note,
    /// Something to look at before the numbers are used.
    Warning,
    /// Why nothing was read.
    Fault,
}

/// A sentence about the input.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Note {
    /// How much it weighs.
    pub level: Level,
    /// The line of the text, or the row of the sheet, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u32>,
    /// The cell of the sheet, such as `B7`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cell: Option<String>,
    /// The sentence.
    pub text: String,
}

/// A grading curve that was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = GradingCurve))]
pub struct Curve {
    /// The name of the aggregate, or of the sample, where the table gives one.
    pub name: Option<String>,
    /// The head of the column that it was read from, or its number.
    pub column: String,
    /// What the values of the column are.
    pub meaning: Meaning,
    /// The unit of the sieves as printed: `mm`, `um`, `in`, `us_sieve`, `bs_mesh`, `tyler_mesh` or `phi`.
    pub unit: String,
    /// Sieve and value of each row as they are printed.
    pub points_printed: Vec<[String; 2]>,
    /// Sieves in mm with the share of the mass that passes them, from the finest to the coarsest.
    pub points: Vec<[f64; 2]>,
    /// The sieves among them that were added, in mm.
    pub completed: Vec<f64>,
    /// What there is to say about it.
    pub notes: Vec<Note>,
}

/// Limits of a grading.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Band {
    /// What it is called, where the table says so.
    pub name: Option<String>,
    /// Sieves in mm with the least and the largest share of the mass that passes them, from the finest to the coarsest.
    pub points: Vec<[f64; 3]>,
}

/// An aggregate of a recipe.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RecipeAggregate {
    /// What the recipe calls it.
    pub name: String,
    /// Its mass in a cubic metre of concrete, dry or surface-dry as the recipe has it.
    pub mass_kg_m3: f64,
    /// Its particle density, where the recipe states it or it follows.
    pub density_kg_m3: Option<f64>,
}

/// A fine addition of a recipe, such as fly ash.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RecipeAddition {
    /// What the recipe calls it.
    pub name: String,
    /// Its mass in a cubic metre of concrete.
    pub mass_kg_m3: f64,
    /// Its density: that of the recipe, or the usual one, which a note names.
    pub density_kg_m3: f64,
}

/// The contents of a concrete that were read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Recipe {
    /// What it is called, where the table says so.
    pub name: Option<String>,
    /// Mass of cement, without additions.
    pub cement_kg_m3: Option<f64>,
    /// Density of the cement: that of the recipe, or the usual one, which a note names.
    pub cement_density_kg_m3: Option<f64>,
    /// Fly ash, slag, silica fume, fillers.
    pub additions: Vec<RecipeAddition>,
    /// Mass of water that counts for the ratio: the effective water where the recipe has it, else all water.
    pub water_kg_m3: Option<f64>,
    /// Water over cement by mass.
    pub water_cement: Option<f64>,
    /// Volume of air over that of the concrete, as stated.
    pub air_volume_fraction: Option<f64>,
    /// The aggregates, in their order.
    pub aggregates: Vec<RecipeAggregate>,
    /// Volume of all aggregate over that of the concrete, where all densities are known.
    pub aggregate_volume_fraction: Option<f64>,
    /// The volume that all parts fill without air, for a cubic metre as stated.
    pub volume_sum_m3: Option<f64>,
    /// The air that the volumes leave of a cubic metre.
    pub implied_air: Option<f64>,
    /// What there is to say about it.
    pub notes: Vec<Note>,
}

/// One of several readings that fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Candidate {
    /// What distinguishes it from the others, in a few words.
    pub label: String,
    /// Its grading, if it is about one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curve: Option<Curve>,
    /// Its recipe, if it is about one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recipe: Option<Recipe>,
    /// The part of a request that follows from it: `{"mix": {…}}`.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub request: Value,
}

/// What was understood of an input: gradings, limits, recipes, and the part of a request that follows.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MixReading {
    /// What became of the input.
    pub verdict: Verdict,
    /// The grading curves.
    pub curves: Vec<Curve>,
    /// Limits of gradings.
    pub bands: Vec<Band>,
    /// The contents of concretes.
    pub recipes: Vec<Recipe>,
    /// The readings of which one is to be chosen, where the verdict is `ask`.
    pub candidates: Vec<Candidate>,
    /// What there is to say about the whole input.
    pub notes: Vec<Note>,
    /// The part of a request that follows, `{"mix": {…}}`; absent where there is a choice to make or nothing was read.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub request: Option<Value>,
}

impl MixReading {
    /// A reading that found nothing.
    pub(super) fn refused(notes: Vec<Note>) -> Self {
        Self {
            verdict: Verdict::Refuse,
            curves: Vec::new(),
            bands: Vec::new(),
            recipes: Vec::new(),
            candidates: Vec::new(),
            notes,
            request: None,
        }
    }
}

impl Note {
    /// How something was read.
    pub(super) fn plain(line: Option<u32>, text: impl Into<String>) -> Self {
        Self { level: Level::Note, line, cell: None, text: text.into() }
    }

    /// Something to look at.
    pub(super) fn warning(line: Option<u32>, text: impl Into<String>) -> Self {
        Self { level: Level::Warning, ..Self::plain(line, text) }
    }
}

/// Why nothing was read, and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refusal {
    line: Option<u32>,
    cell: Option<String>,
    text: String,
}

impl Refusal {
    /// About the whole input.
    pub(super) fn new(text: impl Into<String>) -> Self {
        Self { line: None, cell: None, text: text.into() }
    }

    /// About a line.
    pub(super) fn at(line: u32, text: impl Into<String>) -> Self {
        Self { line: Some(line), ..Self::new(text) }
    }

    /// The same about a cell of a workbook.
    pub(super) fn in_cell(self, cell: Option<String>) -> Self {
        Self { cell, ..self }
    }

    /// As a note.
    pub(super) fn note(self) -> Note {
        Note { level: Level::Fault, line: self.line, cell: self.cell, text: self.text }
    }
}
