//! The plots of a study: a figure of its [`Table`] against one of its columns, with one series for each combination of
//! the other columns; and the distance of the first replicate of each point over time.

use std::collections::HashMap;

use serde_json::Value;

use super::axis::Axis;
use super::chart::{Chart, Layout, Point, Series};
use super::names::{column_label, value_label};
use super::representative::{NO_PROPERTIES, capitalized, disc, discs, property_label, representative_volume};
use crate::studies::properties::{Property, Sample};
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
        /// Distance against packing time, one line for the first replicate of each point.
        Curve "curve",
        /// Volume fraction reached, with each grain enlarged by half its distance.
        VolumeFraction "volume_fraction",
        /// Time of the growth per event.
        EventTime "event_time",
        /// Effective Young's modulus: mean, standard deviation and each packing.
        YoungsModulus "youngs_modulus",
        /// Effective thermal expansion, likewise.
        Expansion "expansion",
        /// Effective conductivity, likewise.
        Conductivity "conductivity",
        /// Effective diffusivity, likewise.
        Diffusivity "diffusivity",
        /// Scatter of a property against the volume of the specimen.
        RepresentativeVolume "representative_volume",
    }
}

impl StudyPlot {
    /// The property that it shows.
    fn property(self) -> Option<Property> {
        match self {
            Self::YoungsModulus => Some(Property::YoungsModulus),
            Self::Expansion => Some(Property::Expansion),
            Self::Conductivity => Some(Property::Conductivity),
            Self::Diffusivity => Some(Property::Diffusivity),
            _ => None,
        }
    }
}

/// An abscissa that is not a column of the request: the number of grains.
pub(crate) const GRAINS: &str = "grains";
/// An abscissa that is not a column of the request: the volume fraction of the grains, as counted in each run.
pub(crate) const VOLUME_FRACTION: &str = "volume_fraction_effective";
/// Properties are plotted against the volume fraction where it differs by this share.
const DIFFERENT_FRACTIONS: f64 = 0.01;
/// An abscissa is logarithmic by default where its largest value is at least this multiple of the smallest.
const LOG_FROM: f64 = 30.0;
const PERCENT: f64 = 100.0;

/// How a study is plotted.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StudyOptions {
    /// The abscissa: a column, [`GRAINS`] or [`VOLUME_FRACTION`].
    pub(crate) x: Option<String>,
    /// Whether the abscissa is logarithmic; determined by its values when absent.
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
    /// The curve of a stored report; empty where the report has none.
    pub(crate) fn of_report(point: usize, report: &Value) -> Self {
        let curve = report.get("growth_curve").and_then(Value::as_array);
        let of_point =
            |at: &Value| Some([at.get("packing_time_s")?.as_f64()?, at.get("distance_mm")?.as_f64()?]);
        Self { point, points: curve.into_iter().flatten().filter_map(of_point).collect() }
    }
}

/// A requested abscissa that the study does not have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{requested:?} is not an abscissa of this study: must be one of {known}")]
pub(crate) struct NoSuchAbscissa {
    pub(crate) requested: String,
    /// Names of the abscissas that it has.
    pub(crate) known: String,
}

/// The abscissas of a study: the columns that have numbers only, the number of grains and the volume fraction.
pub(crate) fn abscissas(table: &Table) -> Vec<&str> {
    let numeric = |column: &&String| {
        !table.rows.is_empty() && table.rows.iter().all(|row| number_in(row, column).is_some())
    };
    table.columns.iter().filter(numeric).map(String::as_str).chain([GRAINS, VOLUME_FRACTION]).collect()
}

/// Makes a plot of a study. `curves` is read for [`StudyPlot::Curve`] only. A chart without points states why, and is
/// refused by [`super::draw::svg`].
///
/// # Errors
/// An abscissa that the study does not have.
pub(crate) fn chart(
    kind: StudyPlot,
    name: Option<&str>,
    table: &Table,
    curves: &[RunCurve],
    options: &StudyOptions,
) -> Result<Chart, NoSuchAbscissa> {
    let x = abscissa(kind, table, options)?;
    let title = |what: &str| name.map_or_else(|| what.to_owned(), |name| format!("{what}: {name}"));
    if kind == StudyPlot::Curve {
        return Ok(curve_chart(title("Distance reached over time"), table, curves, options));
    }
    if kind == StudyPlot::RepresentativeVolume {
        return Ok(representative_volume(&title, table));
    }
    let figure = Figure::of(kind);
    let series = series(table, x, &figure);
    let points = || series.iter().flat_map(|s| &s.points).map(|point| point.x);
    let log_x = options.log_x.unwrap_or_else(|| {
        let (low, high) = points().fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)));
        low > 0.0 && high / low >= LOG_FROM
    });
    let x = Axis::linear(match x {
        GRAINS => "number of grains N".to_owned(),
        VOLUME_FRACTION => "volume fraction of the grains".to_owned(),
        column => column_label(column),
    });
    Ok(Chart {
        title: title(&figure.title),
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
        layout: Layout::default(),
        when_empty: figure.when_empty.into(),
    })
}

/// The abscissa of a plot, as requested or by default.
fn abscissa<'a>(
    kind: StudyPlot,
    table: &'a Table,
    options: &'a StudyOptions,
) -> Result<&'a str, NoSuchAbscissa> {
    let known = abscissas(table);
    if let Some(requested) = &options.x {
        return if known.contains(&requested.as_str()) {
            Ok(requested)
        } else {
            Err(NoSuchAbscissa { requested: requested.clone(), known: known.join(", ") })
        };
    }
    // The number of a point in a list is not a quantity.
    let first = known.iter().find(|column| column.starts_with('/')).copied().unwrap_or(GRAINS);
    Ok(match kind {
        // These two depend on the number of grains first of all.
        StudyPlot::EventTime | StudyPlot::VolumeFraction => GRAINS,
        _ if kind.property().is_some() => {
            let requested = known.iter().find(|column| column.ends_with("/volume_fraction")).copied();
            let fractions = || table.rows.iter().filter_map(|row| row.cells.volume_fraction_effective);
            let (low, high) = fractions().fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)));
            let differ = high > low * (1.0 + DIFFERENT_FRACTIONS);
            requested.unwrap_or(if differ { VOLUME_FRACTION } else { first })
        }
        _ => first,
    })
}

/// All plots of a study that have data, against their default abscissas.
pub(crate) fn charts(name: Option<&str>, table: &Table, curves: &[RunCurve]) -> Vec<(StudyPlot, Chart)> {
    let options = StudyOptions::default();
    let made =
        StudyPlot::ALL.iter().map(|&kind| Some((kind, chart(kind, name, table, curves, &options).ok()?)));
    // Without a distance it would repeat the requested volume fraction.
    let coated = |cells: &Cells| cells.volume_fraction_with_coating > cells.volume_fraction_effective;
    let coating = table.rows.iter().any(|row| coated(&row.cells));
    made.flatten()
        .filter(|(kind, chart)| !chart.is_empty() && (coating || *kind != StudyPlot::VolumeFraction))
        .collect()
}

/// Reads a value and its error bar from a row.
type Read = fn(&Cells) -> Option<(f64, Option<[f64; 2]>)>;

/// A figure of a row, with its axis.
struct Figure {
    title: String,
    axis: Axis,
    read: Source,
    when_empty: &'static str,
}

/// Where a figure comes from.
enum Source {
    Cells(Read),
    Property(Property),
}

impl Figure {
    fn of(kind: StudyPlot) -> Self {
        match kind {
            StudyPlot::YoungsModulus => Self::of_property(Property::YoungsModulus),
            StudyPlot::Expansion => Self::of_property(Property::Expansion),
            StudyPlot::Conductivity => Self::of_property(Property::Conductivity),
            StudyPlot::Diffusivity => Self::of_property(Property::Diffusivity),
            StudyPlot::Success => Self {
                title: "Success rate".into(),
                // Points at 0 and at 100 do not touch the frame.
                axis: Axis::linear("success rate in %").between(-3.0, PERCENT + 3.0),
                read: Source::Cells(|cells| {
                    let interval = cells.success_rate_low.zip(cells.success_rate_high);
                    let interval = interval.map(|(low, high)| [PERCENT * low, PERCENT * high]);
                    Some((PERCENT * cells.success_rate?, interval))
                }),
                when_empty: "no run has ended, so that there is no success rate: a study has one as soon as a run ends",
            },
            StudyPlot::Time => Self {
                title: "Time per success".into(),
                axis: Axis::log("time per success in s"),
                read: Source::Cells(|cells| Some((cells.time_s_per_success?, None))),
                when_empty: "no run has succeeded",
            },
            StudyPlot::Distance | StudyPlot::Curve | StudyPlot::RepresentativeVolume => Self {
                title: "Distance reached".into(),
                axis: Axis::linear("median distance between grains in mm").with_zero(),
                read: Source::Cells(|cells| {
                    let ends = cells.distance_mm_min.zip(cells.distance_mm_max);
                    let ends = ends.filter(|(low, high)| low < high).map(|(low, high)| [low, high]);
                    Some((cells.distance_mm_median.filter(|mm| *mm > 0.0)?, ends))
                }),
                when_empty: "no run has a distance that is the same for all pairs: runs with a constant or the largest \
                             distance have one",
            },
            StudyPlot::VolumeFraction => Self {
                title: "Volume fraction reached".into(),
                axis: Axis::linear("volume fraction with coating in %"),
                read: Source::Cells(|cells| Some((PERCENT * cells.volume_fraction_with_coating?, None))),
                when_empty: "no run has succeeded",
            },
            StudyPlot::EventTime => Self {
                title: "Time per event of the growth".into(),
                axis: Axis::linear("time per event in \u{3BC}s").with_zero(),
                read: Source::Cells(|cells| Some((cells.event_us_median?, None))),
                when_empty: "no run that grew spheres has succeeded: runs by `edmd` have events",
            },
        }
    }

    fn of_property(property: Property) -> Self {
        Self {
            title: capitalized(property.words()),
            axis: Axis::linear(property_label(property)),
            read: Source::Property(property),
            when_empty: NO_PROPERTIES,
        }
    }

    /// The value of a row with its error bar.
    fn value(&self, row: &Row) -> Option<(f64, Option<[f64; 2]>)> {
        match self.read {
            Source::Cells(read) => read(&row.cells),
            Source::Property(property) => {
                let Sample { mean, std, .. } = row.properties.sample(property);
                let mean = mean?;
                Some((mean, std.map(|std| [mean - std, mean + std])))
            }
        }
    }

    /// The single packings of a row: their volume fraction, and their value.
    fn scatter(&self, row: &Row) -> Vec<(Option<f64>, f64)> {
        match self.read {
            Source::Cells(_) => Vec::new(),
            Source::Property(property) => {
                row.properties.of(property).map(|(fraction, value)| (fraction, value.value)).collect()
            }
        }
    }
}

/// One series for each combination of the columns that vary, except the abscissa.
fn series(table: &Table, x: &str, figure: &Figure) -> Vec<Series> {
    let columns = varying(table, x);
    let mut numbers: HashMap<String, usize> = HashMap::new();
    let mut series: Vec<Series> = Vec::new();
    let mut packings: Vec<Series> = Vec::new();
    for row in &table.rows {
        let label = row_label(row, &columns);
        let next = series.len();
        let number = *numbers.entry(label.clone()).or_insert(next);
        if number == next {
            series.push(Series {
                label: (!columns.is_empty()).then_some(label),
                ..Series::marked("", number, vec![])
            });
            packings.push(discs(number, Vec::new()));
        }
        let at = match x {
            GRAINS => row.cells.grains,
            VOLUME_FRACTION => row.cells.volume_fraction_effective,
            column => number_in(row, column),
        };
        let Some(at) = at else { continue };
        // A row without the figure interrupts the line.
        let (y, interval) = figure.value(row).unwrap_or((f64::NAN, None));
        series[number].points.push(Point { interval, ..Point::new(at, y) });
        for (fraction, value) in figure.scatter(row) {
            let at = fraction.filter(|_| x == VOLUME_FRACTION).unwrap_or(at);
            packings[number].points.push(disc(at, value));
        }
    }
    for series in &mut series {
        series.points.sort_by(|a, b| a.x.total_cmp(&b.x));
    }
    packings.retain(|packings| !packings.points.is_empty());
    // Below the means.
    packings.into_iter().chain(series).collect()
}

fn curve_chart(title: String, table: &Table, curves: &[RunCurve], options: &StudyOptions) -> Chart {
    // Time is the abscissa, so that every column that varies is part of the name.
    let columns = varying(table, "");
    let mut numbers: HashMap<String, usize> = HashMap::new();
    let mut series = Vec::new();
    for curve in curves.iter().filter(|curve| curve.points.iter().any(|&[_, mm]| mm > 0.0)) {
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
        description: format!("Smallest gap between grains against packing time, {} runs.", series.len()),
        x: if options.log_x.unwrap_or(true) { Axis::log(label) } else { Axis::linear(label).with_zero() },
        y: Axis::linear("distance between grains in mm").with_zero(),
        series,
        layout: Layout::default(),
        when_empty: "no first replicate of a point has a distance over time: runs that grow (method \
                     `growth`) with a constant or the largest distance have one"
            .into(),
    }
}

/// The columns that name a series: pointers that vary, except the abscissa. The number and the name of a point in a
/// list are not among them, because each point would be a series.
fn varying<'a>(table: &'a Table, x: &str) -> Vec<&'a str> {
    let varies = |column: &&String| {
        let mut values = table.rows.iter().map(|row| value(row, column));
        let first = values.next();
        values.any(|value| Some(value) != first)
    };
    let candidates = table.columns.iter().filter(|column| column.starts_with('/') && column.as_str() != x);
    let mut columns: Vec<&str> = candidates.filter(varies).map(String::as_str).collect();
    let figure: Option<fn(&Cells) -> Option<f64>> = match x {
        GRAINS => Some(|cells| cells.grains),
        VOLUME_FRACTION => Some(|cells| cells.volume_fraction_effective),
        _ => None,
    };
    if let Some(figure) = figure
        && let Some(meant) = columns.iter().position(|column| runs_with(figure, table, column))
    {
        // The figure replaces the column that it depends on.
        columns.remove(meant);
    }
    columns
}

/// Whether a figure of a row rises with this column, or falls, for all rows with different values.
fn runs_with(figure: fn(&Cells) -> Option<f64>, table: &Table, column: &str) -> bool {
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    for row in &table.rows {
        let Some(value) = leading_number(value(row, column)) else { return false };
        if let Some(figure) = figure(&row.cells) {
            pairs.push((value, figure));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The least and the largest figure of each value.
    let groups: Vec<(f64, f64)> = pairs
        .chunk_by(|a, b| a.0 == b.0)
        .map(|of| of.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x.1), h.max(x.1))))
        .collect();
    let rising = groups.windows(2).all(|w| w[0].1 < w[1].0);
    let falling = groups.windows(2).all(|w| w[0].0 > w[1].1);
    groups.len() > 1 && (rising || falling)
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

/// Name of the series of a row: `RSA, cut-off diameter 2 mm`.
fn row_label(row: &Row, columns: &[&str]) -> String {
    let part = |column: &&str| value(row, column).map(|value| value_label(column, value));
    columns.iter().filter_map(part).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "study_tests.rs"]
mod tests;
