//! Reads gradings and recipes as laboratories print them: texts, tables of pages and wikis, and workbooks.
//!
//! An input becomes tables of cells. Where a text can be split in several ways, or its numbers have two values, each
//! way is a reading. In each, gradings are looked for (a column of sieves, and columns whose values are those of a
//! curve under one of the meanings that values have) and recipes (rows of cement, water and aggregates). The one
//! reading that fits is the answer; several are candidates, among which the user chooses; where none fits, the answer
//! says in which row and what to do. No reading is taken where another one fits as well.

mod answer;
mod bands;
mod block;
mod curve;
mod grading;
mod head_rows;
mod heads;
mod markup;
mod number;
mod openings;
mod reading;
mod recipe;
mod sieve;
mod sieve_units;
mod source;
mod split;
mod table;
mod values;
mod words;
mod workbook;

pub use answer::{
    Band, Candidate, Curve, Level, Meaning, MixReading, Note, Recipe, RecipeAddition, RecipeAggregate,
    Verdict,
};
pub use openings::Unit;
pub use source::MAX_TEXT_BYTES;
pub use table::{MAX_COLUMNS, MAX_ROWS};
pub use workbook::{MAX_SHEETS, MAX_UNPACKED_BYTES, MAX_WORKBOOK_BYTES};

pub use reading::read;

use answer::Refusal;

/// What the user has chosen, where a first reading asked.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// The sheet of a workbook, by its name.
    pub sheet: Option<String>,
    /// The curve or the recipe, by its name.
    pub curve: Option<String>,
    /// The column of values, by its head, its letter in a workbook, or its number from 1.
    pub column: Option<String>,
    /// The unit of the sieves: the name of one of [`Unit::ALL`].
    pub unit: Option<String>,
}
