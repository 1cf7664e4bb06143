//! The table of a study: one row per point, with the figures of its runs.
//!
//! It is computed from the [`Facts`] of the runs at each request. `docs/studies.md` defines every column. The columns
//! of effective properties are there where a run has any ([`super::properties`]).

use std::io::{self, Write};

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::interval::wilson;
use super::properties::{RowProperties, sum_up};
use super::representative::{self, RepresentativeVolume};
use super::{Facts, Outcome, Run};

/// The columns that identify the points: their names, and their values per point.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Keys {
    /// JSON pointers into the job; `point` and `name` for a list.
    pub(crate) columns: Vec<String>,
    /// One row per point, as long as `columns`.
    pub(crate) values: Vec<Vec<Value>>,
}

/// Jobs of a point that have not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Rest {
    /// Queued and running jobs.
    pub(crate) waiting: u64,
    /// Jobs that a stop rule cancelled.
    pub(crate) stopped_early: u64,
}

/// What the runs of a study came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = StudyTable))]
pub(crate) struct Table {
    /// Names of the columns that tell the points apart: JSON pointers, or `point` and `name` for a list.
    pub(crate) columns: Vec<String>,
    /// One per point, in the order of the study: the values of these columns, and the figures.
    pub(crate) rows: Vec<Row>,
    /// How the properties scatter over packings of several volumes; absent unless runs have properties and the volume
    /// of the specimen varies.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(test, schema(required = false))]
    pub(crate) representative_volumes: Vec<RepresentativeVolume>,
}

/// A point and the figures of its runs. As JSON one flat object, the columns first.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Row {
    /// Name and value of each column.
    pub(crate) values: Vec<(String, Value)>,
    pub(crate) cells: Cells,
    pub(crate) properties: RowProperties,
}

/// A figure of a row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(crate) enum Cell {
    Count(u64),
    /// `None` where no run has it.
    Number(Option<f64>),
}

/// Declares the figures of a row once, for the structure, its names, and both its forms.
macro_rules! cells {
    ($($(#[$meta:meta])* $name:ident: [$($kind:tt)+],)*) => {
        /// The figures of the runs of a point. A figure is `null` where no run has it.
        #[derive(Clone, Debug, Default, PartialEq, Serialize)]
        #[cfg_attr(test, derive(utoipa::ToSchema))]
        pub(crate) struct Cells {
            $($(#[$meta])* pub(crate) $name: $($kind)+,)*
        }

        impl Cells {
            /// Names in the order of the columns.
            pub(crate) const NAMES: &[&'static str] = &[$(stringify!($name),)*];

            /// All figures in that order.
            pub(crate) fn all(&self) -> Vec<Cell> {
                vec![$(Cell::from(self.$name),)*]
            }
        }
    };
}

cells! {
    /// Grains of the mix; median of the runs.
    #[cfg_attr(test, schema(required))]
    grains: [Option<f64>],
    /// Volume fraction of the grains (`phi_eff`), counted in each run; median.
    #[cfg_attr(test, schema(required))]
    volume_fraction_effective: [Option<f64>],
    /// The same with each grain enlarged by half the distance it keeps; median of the successes.
    #[cfg_attr(test, schema(required))]
    volume_fraction_with_coating: [Option<f64>],
    /// Runs that succeeded or did not reach their target.
    runs: [u64],
    /// Runs that reached the requested packing.
    successes: [u64],
    /// `successes / runs`.
    #[cfg_attr(test, schema(required))]
    success_rate: [Option<f64>],
    /// Lower end of the 95 % interval of the success rate (Wilson 1927).
    #[cfg_attr(test, schema(required))]
    success_rate_low: [Option<f64>],
    /// Upper end of that interval.
    #[cfg_attr(test, schema(required))]
    success_rate_high: [Option<f64>],
    /// Of the runs those that ended before the requested packing and kept what they had reached.
    partial: [u64],
    /// Volume fraction of the grains of these packings; median.
    #[cfg_attr(test, schema(required))]
    volume_fraction_reached_median: [Option<f64>],
    /// Wall-clock time of all runs together.
    #[cfg_attr(test, schema(required))]
    time_s_total: [Option<f64>],
    /// `time_s_total / successes`: time per success, failed runs included.
    #[cfg_attr(test, schema(required))]
    time_s_per_success: [Option<f64>],
    /// Wall-clock time of a success; median.
    #[cfg_attr(test, schema(required))]
    time_s_median: [Option<f64>],
    /// Wall-clock time of the longest success.
    #[cfg_attr(test, schema(required))]
    time_s_max: [Option<f64>],
    /// Constant distance kept, or reached where the run did not succeed; median of the runs.
    #[cfg_attr(test, schema(required))]
    distance_mm_median: [Option<f64>],
    /// The smallest of these.
    #[cfg_attr(test, schema(required))]
    distance_mm_min: [Option<f64>],
    /// The largest of these.
    #[cfg_attr(test, schema(required))]
    distance_mm_max: [Option<f64>],
    /// Events of the growth; median of the runs that grew grains.
    #[cfg_attr(test, schema(required))]
    events_median: [Option<f64>],
    /// Time of the growth per event, in us; median of the successes that grew grains.
    #[cfg_attr(test, schema(required))]
    event_us_median: [Option<f64>],
    /// Queued and running jobs.
    waiting: [u64],
    /// Runs that do not count: cancelled by a client, or ended by a fault of the program or the machine.
    void: [u64],
    /// Jobs that were cancelled because a stop rule was met.
    stopped_early: [u64],
}

impl Table {
    /// The table of these runs. `rest` has one entry per point, or is empty where all jobs have ended. Runs of unknown
    /// points are left out.
    pub(crate) fn new(keys: &Keys, runs: &[Run], rest: &[Rest]) -> Self {
        let mut by_point: Vec<Vec<&Run>> = vec![Vec::new(); keys.values.len()];
        for run in runs {
            if let Some(runs) = by_point.get_mut(run.point) {
                runs.push(run);
            }
        }
        let rows = keys.values.iter().zip(by_point).enumerate().map(|(point, (values, mut runs))| {
            // Sums must not depend on the order in which the runs ended.
            runs.sort_by_key(|run| run.replicate);
            Row {
                values: keys.columns.iter().cloned().zip(values.iter().cloned()).collect(),
                cells: Cells::new(&runs, rest.get(point).copied().unwrap_or_default()),
                properties: properties_of(&runs),
            }
        });
        let mut rows: Vec<Row> = rows.collect();
        sum_up(&mut rows);
        let representative_volumes = representative::of_rows(&keys.columns, &rows);
        Self { columns: keys.columns.clone(), rows, representative_volumes }
    }

    /// The same with the number of runs of each point whose properties are still to be computed.
    pub(crate) fn with_waiting_properties(mut self, waiting: &[u64]) -> Self {
        if waiting.iter().any(|n| *n > 0) {
            for (row, n) in self.rows.iter_mut().zip(waiting) {
                row.properties.waiting = Some(*n);
            }
        }
        self
    }

    /// Writes the table as CSV (RFC 4180, with LF line ends): one header line; text is quoted where the RFC requires
    /// it, values that are lists or objects are JSON, `null` is an empty field.
    ///
    /// # Errors
    /// Those of the writer.
    pub(crate) fn write_csv(&self, out: &mut dyn Write) -> io::Result<()> {
        let names = self.columns.iter().map(String::as_str).chain(Cells::NAMES.iter().copied());
        let mut header: Vec<String> = names.map(quoted).collect();
        // All rows have the same columns of properties.
        header.extend(self.rows.iter().take(1).flat_map(|row| row.properties.cells()).map(|(name, _)| name));
        writeln!(out, "{}", header.join(","))?;
        for row in &self.rows {
            let mut fields: Vec<String> = row.values.iter().map(|(_, value)| field(value)).collect();
            fields.extend(row.cells.all().into_iter().map(Cell::text));
            fields.extend(row.properties.cells().into_iter().map(|(_, cell)| cell.text()));
            writeln!(out, "{}", fields.join(","))?;
        }
        Ok(())
    }

    /// The same as text.
    pub(crate) fn to_csv(&self) -> String {
        let mut text = Vec::new();
        // Writing to memory cannot fail.
        let _ = self.write_csv(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    }
}

impl Cells {
    fn new(runs: &[&Run], rest: Rest) -> Self {
        let counted: Vec<&Run> = runs.iter().copied().filter(|run| run.outcome != Outcome::Void).collect();
        let succeeded: Vec<&Run> =
            counted.iter().copied().filter(|run| run.outcome == Outcome::Succeeded).collect();
        let (runs_counted, successes) = (counted.len() as u64, succeeded.len() as u64);
        let interval = wilson(successes, runs_counted);
        let time_s_total =
            (runs_counted > 0).then(|| counted.iter().map(|run| run.facts.time_s).sum::<f64>());
        let times = sorted(&succeeded, |facts| Some(facts.time_s));
        let distances = sorted(&counted, |facts| facts.distance_mm);
        let median_of = |runs: &[&Run], figure: &dyn Fn(&Facts) -> Option<f64>| median(&sorted(runs, figure));
        Self {
            grains: median_of(&counted, &|facts| facts.grains.map(|n| n as f64)),
            volume_fraction_effective: median_of(&counted, &|facts| facts.volume_fraction_effective),
            volume_fraction_with_coating: median_of(&succeeded, &|facts| facts.volume_fraction_with_coating),
            runs: runs_counted,
            successes,
            success_rate: (runs_counted > 0).then(|| successes as f64 / runs_counted as f64),
            success_rate_low: interval.map(|[low, _]| low),
            success_rate_high: interval.map(|[_, high]| high),
            partial: counted.iter().filter(|run| run.outcome == Outcome::Partial).count() as u64,
            volume_fraction_reached_median: median_of(&counted, &|facts| facts.volume_fraction_reached),
            time_s_total,
            time_s_per_success: time_s_total.filter(|_| successes > 0).map(|total| total / successes as f64),
            time_s_median: median(&times),
            time_s_max: times.last().copied(),
            distance_mm_median: median(&distances),
            distance_mm_min: distances.first().copied(),
            distance_mm_max: distances.last().copied(),
            events_median: median_of(&counted, &|facts| facts.events.map(|n| n as f64)),
            event_us_median: median_of(&succeeded, &|facts| {
                let events = facts.events.filter(|n| *n > 0)?;
                Some(facts.edmd_s? * 1e6 / events as f64)
            }),
            waiting: rest.waiting,
            void: (runs.len() - counted.len()) as u64,
            stopped_early: rest.stopped_early,
        }
    }
}

/// The properties of the runs that reached their packing.
fn properties_of(runs: &[&Run]) -> RowProperties {
    let of = |run: &&Run| {
        let facts = run.facts.properties.clone().filter(|_| run.outcome == Outcome::Succeeded)?;
        Some((run.facts.volume_fraction_effective, facts))
    };
    RowProperties { runs: runs.iter().filter_map(of).collect(), ..RowProperties::default() }
}

/// A figure of the runs that have it, in rising order.
fn sorted(runs: &[&Run], figure: impl Fn(&Facts) -> Option<f64>) -> Vec<f64> {
    let mut values: Vec<f64> = runs.iter().filter_map(|run| figure(&run.facts)).collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The median of values in rising order.
fn median(sorted: &[f64]) -> Option<f64> {
    let middle = sorted.len() / 2;
    let high = *sorted.get(middle)?;
    Some(if sorted.len().is_multiple_of(2) { f64::midpoint(sorted[middle - 1], high) } else { high })
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let properties = self.properties.cells();
        let length = self.values.len() + Cells::NAMES.len() + properties.len();
        let mut object = serializer.serialize_map(Some(length))?;
        for (column, value) in &self.values {
            object.serialize_entry(column, value)?;
        }
        for (name, cell) in Cells::NAMES.iter().zip(self.cells.all()) {
            object.serialize_entry(name, &cell)?;
        }
        for (name, cell) in &properties {
            object.serialize_entry(name, cell)?;
        }
        object.end()
    }
}

/// The schema of a row: that of the figures, with the columns of properties, which may be absent.
#[cfg(test)]
impl utoipa::PartialSchema for Row {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        use utoipa::openapi::schema::{ObjectBuilder, SchemaType, Type};
        use utoipa::openapi::{RefOr, Schema};

        use super::properties::{Property, WAITING};

        let mut schema = <Cells as utoipa::PartialSchema>::schema();
        let RefOr::T(Schema::Object(object)) = &mut schema else { return schema };
        let count = |text: &str| {
            let count =
                ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(0)).description(Some(text));
            RefOr::T(Schema::from(count.build()))
        };
        for &property in Property::ALL {
            let words = property.words();
            let number = |text: String| {
                let types = SchemaType::from_iter([Type::Number, Type::Null]);
                RefOr::T(Schema::from(
                    ObjectBuilder::new().schema_type(types).description(Some(text)).build(),
                ))
            };
            let [mean, std, of] = property.columns();
            object
                .properties
                .insert(mean, number(format!("Mean of the {words} over the successes that have it.")));
            object
                .properties
                .insert(std, number(format!("Standard deviation of the {words}, of two and more.")));
            object.properties.insert(of, count("Number of these."));
        }
        object.properties.insert(WAITING.into(), count("Runs whose properties are still to be computed."));
        schema
    }
}

#[cfg(test)]
impl utoipa::ToSchema for Row {
    fn name() -> std::borrow::Cow<'static, str> {
        "StudyTableRow".into()
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        Self::Count(count)
    }
}

impl From<Option<f64>> for Cell {
    fn from(number: Option<f64>) -> Self {
        Self::Number(number)
    }
}

impl Cell {
    /// The shortest text that reads back as the same number.
    fn text(self) -> String {
        match self {
            Self::Count(count) => count.to_string(),
            Self::Number(number) => number.map(|x| Value::from(x).to_string()).unwrap_or_default(),
        }
    }
}

/// A value of a column as a field of CSV.
fn field(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => quoted(text),
        Value::Number(number) => number.to_string(),
        other => quoted(&other.to_string()),
    }
}

/// Text as a field of CSV. An empty one is quoted, so that it differs from none. Text that a
/// spreadsheet would read as a formula gets an apostrophe in front (OWASP, CSV injection).
fn quoted(text: &str) -> String {
    let guarded;
    let text = if text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        guarded = format!("'{text}");
        &guarded
    } else {
        text
    };
    if text.is_empty() || text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
