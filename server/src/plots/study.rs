//! The plots of a study: a figure of its table against one of its columns, one series for each combination
//! of the others; and the course of the distance of every run.
//!
//! They know the table ([`Table`]) and labelled curves; they must never know where these came from.

use std::collections::HashMap;

use serde_json::Value;

use super::axis::{Axis, plain};
use super::chart::{Chart, Point, Series};
use crate::studies::table::{Cells, Row, Table};

super::kinds! {
    /// What a plot of a study shows.
    StudyPlot {
        /// Success rate with its 95 % interval.
        Success "success",
        /// Time per success, all runs counted.
        Time "time",
        /// Distance reached: median, and from the smallest to the largest.
        Distance "distance",
        /// Distance against packing time, one line per run.
        Curve "curve",
        /// Volume fraction reached, with the coating.
        VolumeFraction "volume_fraction",
        /// Time of the growth per event.
        EventTime "event_time",
    }
}

/// The abscissa that is no column of the request: the number of grains.
pub(crate) const GRAINS: &str = "grains";
/// An abscissa with positive values is logarithmic by itself from this factor between them on.
const LOG_FROM: f64 = 30.0;
const PERCENT: f64 = 100.0;

/// How a study is plotted.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StudyOptions {
    /// The abscissa: a column, or [`GRAINS`].
    pub(crate) x: Option<String>,
    /// Whether the abscissa is logarithmic; decided by its values when absent.
    pub(crate) log_x: Option<bool>,
}

/// The distance curve of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RunCurve {
    /// Index of its point in the table.
    pub(crate) point: usize,
    /// Packing time in s and distance in mm.
    pub(crate) points: Vec<[f64; 2]>,
}

impl RunCurve {
    /// That of a stored report; empty where it has none.
    pub(crate) fn of_report(point: usize, report: &Value) -> Self {
        let curve = report.get("growth_curve").and_then(Value::as_array);
        let of_point =
            |at: &Value| Some([at.get("packing_time_s")?.as_f64()?, at.get("distance_mm")?.as_f64()?]);
        Self { point, points: curve.into_iter().flatten().filter_map(of_point).collect() }
    }
}

/// An abscissa that a study cannot have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{asked:?} is no abscissa of this study: must be one of {known}")]
pub(crate) struct NoSuchAbscissa {
    pub(crate) asked: String,
    /// Names of those there are.
    pub(crate) known: String,
}

/// The axes that the rows of a study can be plotted against: columns with numbers alone, and the grains.
pub(crate) fn abscissas(table: &Table) -> Vec<&str> {
    let numeric = |column: &&String| {
        !table.rows.is_empty() && table.rows.iter().all(|row| number_in(row, column).is_some())
    };
    table.columns.iter().filter(numeric).map(String::as_str).chain([GRAINS]).collect()
}

/// Makes a plot of a study. `curves` is looked at for [`StudyPlot::Curve`] only.
///
/// # Errors
/// An abscissa that there is not.
pub(crate) fn chart(
    kind: StudyPlot,
    name: Option<&str>,
    table: &Table,
    curves: &[RunCurve],
    options: &StudyOptions,
) -> Result<Chart, NoSuchAbscissa> {
    let known = abscissas(table);
    let x = match &options.x {
        Some(asked) if !known.contains(&asked.as_str()) => {
            return Err(NoSuchAbscissa { asked: asked.clone(), known: known.join(", ") });
        }
        Some(asked) => asked.as_str(),
        // What growth costs and how far it comes is asked of the number of grains.
        None if matches!(kind, StudyPlot::EventTime | StudyPlot::VolumeFraction) => GRAINS,
        // The number of a point in a list says nothing about it.
        None => known.iter().find(|column| column.starts_with('/')).copied().unwrap_or(GRAINS),
    };
    let title = |what: &str| name.map_or_else(|| what.to_owned(), |name| format!("{what}: {name}"));
    if kind == StudyPlot::Curve {
        return Ok(curve_chart(title("Distance reached over time"), table, curves, options));
    }
    let figure = Figure::of(kind);
    let series = series(table, x, &figure);
    let points = || series.iter().flat_map(|s| &s.points).map(|point| point.x);
    let log_x = options.log_x.unwrap_or_else(|| {
        let (low, high) = points().fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)));
        low > 0.0 && high / low >= LOG_FROM
    });
    let x_label = if x == GRAINS { "number of grains N".to_owned() } else { column_label(x) };
    let x = Axis::linear(x_label);
    Ok(Chart {
        title: title(figure.title),
        description: format!(
            "{} against {}, {} series of {} points in all.",
            figure.title,
            x.label,
            series.len(),
            points().count()
        ),
        x: if log_x { Axis::log(x.label) } else { x },
        y: figure.axis,
        series,
        when_empty: figure.when_empty.into(),
    })
}

/// All plots of a study that show something, against their own abscissas.
pub(crate) fn charts(name: Option<&str>, table: &Table, curves: &[RunCurve]) -> Vec<(StudyPlot, Chart)> {
    let options = StudyOptions::default();
    let made =
        StudyPlot::ALL.iter().map(|&kind| Some((kind, chart(kind, name, table, curves, &options).ok()?)));
    // Without a distance it would say again what was asked for.
    let coated = |cells: &Cells| cells.volume_fraction_with_coating > cells.volume_fraction_effective;
    let coating = table.rows.iter().any(|row| coated(&row.cells));
    made.flatten()
        .filter(|(kind, chart)| !chart.is_empty() && (coating || *kind != StudyPlot::VolumeFraction))
        .collect()
}

/// What is read from a row: value and error bar.
type Read = fn(&Cells) -> Option<(f64, Option<[f64; 2]>)>;

/// What is plotted of a row.
struct Figure {
    title: &'static str,
    axis: Axis,
    read: Read,
    when_empty: &'static str,
}

impl Figure {
    fn of(kind: StudyPlot) -> Self {
        match kind {
            StudyPlot::Success => Self {
                title: "Success rate",
                // Points at 0 and at 100 stand clear of the frame.
                axis: Axis::linear("success rate in %").between(-3.0, PERCENT + 3.0),
                read: |cells| {
                    let interval = cells.success_rate_low.zip(cells.success_rate_high);
                    let interval = interval.map(|(low, high)| [PERCENT * low, PERCENT * high]);
                    Some((PERCENT * cells.success_rate?, interval))
                },
                when_empty: "no run has ended yet",
            },
            StudyPlot::Time => Self {
                title: "Time per success",
                axis: Axis::log("time of all runs per success in s"),
                read: |cells| Some((cells.time_s_per_success?, None)),
                when_empty: "no run has succeeded",
            },
            StudyPlot::Distance | StudyPlot::Curve => Self {
                title: "Distance reached",
                axis: Axis::linear("distance in mm (median; smallest to largest)").with_zero(),
                read: |cells| {
                    let ends = cells.distance_mm_min.zip(cells.distance_mm_max);
                    let ends = ends.filter(|(low, high)| low < high).map(|(low, high)| [low, high]);
                    Some((cells.distance_mm_median.filter(|mm| *mm > 0.0)?, ends))
                },
                when_empty: "no run has kept a distance that is the same for all pairs",
            },
            StudyPlot::VolumeFraction => Self {
                title: "Volume fraction reached",
                axis: Axis::linear("volume fraction with the coating in %"),
                read: |cells| Some((PERCENT * cells.volume_fraction_with_coating?, None)),
                when_empty: "no run has succeeded",
            },
            StudyPlot::EventTime => Self {
                title: "Time per event of the growth",
                axis: Axis::linear("time per event in \u{3BC}s").with_zero(),
                read: |cells| Some((cells.event_us_median?, None)),
                when_empty: "no run that grew grains has succeeded",
            },
        }
    }
}

/// One series per combination of the columns that vary, but for that of the abscissa.
fn series(table: &Table, x: &str, figure: &Figure) -> Vec<Series> {
    let columns = varying(table, x);
    let mut numbers: HashMap<String, usize> = HashMap::new();
    let mut series: Vec<Series> = Vec::new();
    for row in &table.rows {
        let label = row_label(row, &columns);
        let next = series.len();
        let number = *numbers.entry(label.clone()).or_insert(next);
        if number == next {
            series.push(Series {
                label: (!columns.is_empty()).then_some(label),
                ..Series::marked("", number, vec![])
            });
        }
        let Some(at) = (if x == GRAINS { row.cells.grains } else { number_in(row, x) }) else { continue };
        // A row without the figure interrupts the line: it was run, and did not get there.
        let (y, interval) = (figure.read)(&row.cells).unwrap_or((f64::NAN, None));
        series[number].points.push(Point { x: at, y, interval });
    }
    for series in &mut series {
        series.points.sort_by(|a, b| a.x.total_cmp(&b.x));
    }
    series
}

fn curve_chart(title: String, table: &Table, curves: &[RunCurve], options: &StudyOptions) -> Chart {
    // Every column that varies tells curves apart: time is the abscissa.
    let columns = varying(table, "");
    let mut numbers: HashMap<String, usize> = HashMap::new();
    let mut series = Vec::new();
    for curve in curves.iter().filter(|curve| !curve.points.is_empty()) {
        let Some(row) = table.rows.get(curve.point) else { continue };
        let label = row_label(row, &columns);
        let next = numbers.len();
        let number = *numbers.entry(label.clone()).or_insert(next);
        let points = curve.points.iter().map(|&[time_s, mm]| Point::new(time_s, mm)).collect();
        series.push(Series {
            label: (!columns.is_empty()).then_some(label),
            ..Series::line("", number, points)
        });
    }
    let label = "packing time in s";
    Chart {
        title,
        description: format!(
            "Clear distance that all grains keep against packing time, {} runs.",
            series.len()
        ),
        x: if options.log_x.unwrap_or(true) { Axis::log(label) } else { Axis::linear(label).with_zero() },
        y: Axis::linear("distance in mm").with_zero(),
        series,
        when_empty: "no run has a distance curve: only those that maximize the distance do".into(),
    }
}

/// Pointers that tell series apart: they vary, and are not the abscissa. The number and name of a point
/// in a list would make a series of each.
fn varying<'a>(table: &'a Table, x: &str) -> Vec<&'a str> {
    let varies = |column: &&String| {
        let mut values = table.rows.iter().map(|row| value(row, column));
        let first = values.next();
        values.any(|value| Some(value) != first)
    };
    let candidates = table.columns.iter().filter(|column| column.starts_with('/') && column.as_str() != x);
    let mut columns: Vec<&str> = candidates.filter(varies).map(String::as_str).collect();
    if x == GRAINS
        && let Some(meant) = columns.iter().position(|column| runs_with_grains(table, column))
    {
        // The abscissa stands for the column that the number of grains follows.
        columns.remove(meant);
    }
    columns
}

/// Whether the number of grains of a row follows from this column, all others the same: it has numbers that
/// differ wherever the grains do.
fn runs_with_grains(table: &Table, column: &str) -> bool {
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    for row in &table.rows {
        let Some(value) = leading_number(value(row, column)) else { return false };
        if let Some(grains) = row.cells.grains {
            pairs.push((value, grains));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let steps = || pairs.windows(2).filter(|w| w[0].0 < w[1].0);
    let rising = steps().all(|w| w[0].1 < w[1].1);
    let falling = steps().all(|w| w[0].1 > w[1].1);
    steps().count() > 0 && (rising || falling)
}

fn value<'a>(row: &'a Row, column: &str) -> Option<&'a Value> {
    row.values.iter().find(|(name, _)| name == column).map(|(_, value)| value)
}

fn number_in(row: &Row, column: &str) -> Option<f64> {
    value(row, column).and_then(Value::as_f64)
}

/// A number, or the first of a list of numbers, as the edges of a box.
fn leading_number(value: Option<&Value>) -> Option<f64> {
    match value? {
        Value::Array(items) => items.first().and_then(Value::as_f64),
        other => other.as_f64(),
    }
}

/// What tells a row's series apart: `rsa, d min 2 mm`.
fn row_label(row: &Row, columns: &[&str]) -> String {
    let part = |column: &&str| value(row, column).map(|value| value_label(column, value));
    columns.iter().filter_map(part).collect::<Vec<_>>().join(", ")
}

/// The name of a column for people, with its unit.
fn column_label(pointer: &str) -> String {
    let (name, unit) = name_and_unit(pointer);
    if unit.is_empty() { name } else { format!("{name} in {unit}") }
}

fn name_and_unit(pointer: &str) -> (String, &'static str) {
    let last = |skip: usize| pointer.rsplit('/').nth(skip).unwrap_or_default();
    // An index says nothing without the list.
    let index = last(0).parse::<usize>().is_ok();
    let mut name = if index { last(1) } else { last(0) }.replace("~1", "/").replace("~0", "~");
    // Such a name is that of many fields: its parent says which.
    if ["mm", "factor", "type", "name"].contains(&name.as_str()) {
        let parent = if index { last(2) } else { last(1) };
        name = if name == "type" { parent.to_owned() } else { format!("{parent}_{name}") };
    }
    let units = [("_mm", "mm"), ("_s", "s")];
    let (name, unit) = units
        .into_iter()
        .find_map(|(suffix, unit)| Some((name.strip_suffix(suffix)?.to_owned(), unit)))
        .unwrap_or((name, ""));
    // These two are read as symbols.
    let name = if ["d_min", "d_max"].contains(&name.as_str()) { name } else { name.replace('_', " ") };
    (name, unit)
}

/// A column's value with as much of its name as it needs.
fn value_label(pointer: &str, value: &Value) -> String {
    let (name, unit) = name_and_unit(pointer);
    let text = value_text(value);
    match value {
        // A name, or a variant with its type, speaks for itself.
        Value::String(_) | Value::Object(_) => text,
        _ if unit.is_empty() => format!("{name} {text}"),
        _ => format!("{name} {text} {unit}"),
    }
}

fn value_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), |n| plain(n, None)),
        Value::Array(items) if items.iter().all(|item| !item.is_array() && !item.is_object()) => {
            items.iter().map(value_text).collect::<Vec<_>>().join(" \u{D7} ")
        }
        Value::Object(members) => {
            let part = |(name, value): (&String, &Value)| match value {
                Value::String(text) if name == "type" || name == "name" => text.clone(),
                value => value_label(&format!("/{name}"), value),
            };
            members.iter().map(part).collect::<Vec<_>>().join(" ")
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "study_tests.rs"]
mod tests;
