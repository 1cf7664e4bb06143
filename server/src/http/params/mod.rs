//! Parameters of paths and queries, each declared once: the handler reads what the document describes.
//!
//! A set of query parameters is a struct that [`parameters!`] declares: the names of its fields are those of the
//! parameters, their comments the descriptions, and their types ([`values`]) give both the schema and the reading.
//! [`Query`] reads a set strictly: it refuses what the set does not have, and reports every fault at once.

mod choices;
#[cfg(test)]
pub(crate) mod described;
pub(crate) mod paths;
mod query;
pub(crate) mod values;

pub(crate) use choices::{Choice, choices, names};
pub(crate) use paths::{IdPath, JobPath, PlotPath, StudyPath};
pub(crate) use query::{NoParameters, ParameterSet, Query, RawQuery, pairs, parameters};

/// A value as messages show it.
pub(crate) fn shown(text: &str) -> String {
    let mut short: String = text.chars().take(40).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    format!("{short:?}")
}
