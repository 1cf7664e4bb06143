//! The results of a study: the files of its table and plots, and the table for the terminal.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use packstone_engine::request::Distance;
use serde::Serialize;
use serde_json::Value;

use super::super::exit::Failure;
use super::run_log::{RunRecord, write_whole};
use crate::plots::draw;
use crate::plots::study::{RunCurve, StudyPlot, charts};
use crate::studies::properties::{Property, Sample};
use crate::studies::representative::RepresentativeVolume;
use crate::studies::table::{Cells, Row};
use crate::studies::{Keys, Study, Table};

/// Most rows at the terminal; the files have all rows.
const ROWS_SHOWN: usize = 200;

/// The curve of one point in `curves.json`.
#[derive(Serialize)]
struct OfPoint<'a> {
    point: usize,
    /// Names and values of the point's columns.
    values: serde_json::Map<String, Value>,
    /// Packing time in s and distance in mm of the first replicate.
    distance_curve: &'a [[f64; 2]],
}

/// Writes all files, and returns their paths.
pub(super) fn write(
    folder: &Path,
    study: &Study,
    table: &Table,
    records: &[RunRecord],
    plot_titles: bool,
) -> Result<Vec<PathBuf>, Failure> {
    let mut written = Vec::new();
    let mut put = |name: String, bytes: &[u8]| {
        let file = folder.join(name);
        write_whole(&file, bytes).map(|()| written.push(file))
    };
    let mut json = serde_json::to_vec_pretty(table)?;
    json.push(b'\n');
    put("table.json".into(), &json)?;
    put("table.csv".into(), table.to_csv().as_bytes())?;
    let curves = curves(&study.keys(), records);
    if !curves.is_empty() {
        put("curves.json".into(), &serde_json::to_vec(&curves)?)?;
    }
    let drawn: Vec<RunCurve> = curves
        .iter()
        .map(|curve| RunCurve { point: curve.point, points: curve.distance_curve.to_vec() })
        .collect();
    for (kind, chart) in charts(study.name.as_deref(), table, &drawn) {
        if tells(study, kind) {
            put(format!("plot-{}.svg", kind.name()), draw::svg(&chart, plot_titles)?.as_bytes())?;
        }
    }
    Ok(written)
}

/// Whether a plot shows what the request does not already state.
fn tells(study: &Study, kind: StudyPlot) -> bool {
    let maximizes = |maximize: bool| {
        study.points.iter().any(|point| matches!(point.job.distance, Distance::Maximize { .. }) == maximize)
    };
    match kind {
        // Every run that maximizes its distance succeeds.
        StudyPlot::Success => maximizes(false),
        StudyPlot::Distance | StudyPlot::Curve | StudyPlot::VolumeFraction => maximizes(true),
        StudyPlot::Time
        | StudyPlot::EventTime
        | StudyPlot::YoungsModulus
        | StudyPlot::Expansion
        | StudyPlot::Conductivity
        | StudyPlot::Diffusivity
        | StudyPlot::RepresentativeVolume => true,
    }
}

/// The curves of first replicates, in the order of the points.
fn curves<'a>(keys: &Keys, records: &'a [RunRecord]) -> Vec<OfPoint<'a>> {
    let mut curves: Vec<OfPoint<'a>> = records
        .iter()
        .filter(|record| !record.distance_curve.is_empty())
        .filter_map(|record| {
            let values = keys.values.get(record.point)?;
            Some(OfPoint {
                point: record.point,
                values: keys.columns.iter().cloned().zip(values.iter().cloned()).collect(),
                distance_curve: &record.distance_curve,
            })
        })
        .collect();
    curves.sort_by_key(|curve| curve.point);
    curves
}

/// A column at the terminal: its title and how it shows a row, or nothing where the row has none.
struct Column {
    title: &'static str,
    text: fn(&Cells) -> Option<String>,
}

const COLUMNS: [Column; 10] = [
    Column { title: "grains", text: |cells| cells.grains.map(|x| format!("{x:.0}")) },
    Column { title: "phi_eff", text: |cells| cells.volume_fraction_effective.map(|x| format!("{x:.4}")) },
    Column {
        title: "with coating",
        text: |cells| cells.volume_fraction_with_coating.map(|x| format!("{x:.4}")),
    },
    Column { title: "succeeded", text: |cells| Some(format!("{}/{}", cells.successes, cells.runs)) },
    Column {
        title: "95 % of rate",
        text: |cells| {
            let (low, high) = (cells.success_rate_low?, cells.success_rate_high?);
            Some(format!("{:.0}..{:.0} %", low * 100.0, high * 100.0))
        },
    },
    Column {
        title: "partial, reached",
        text: |cells| Some(format!("{}, {:.4}", cells.partial, cells.volume_fraction_reached_median?)),
    },
    Column { title: "s per success", text: |cells| cells.time_s_per_success.map(three_digits) },
    Column { title: "distance mm", text: |cells| cells.distance_mm_median.map(|x| format!("{x:.4}")) },
    Column { title: "us per event", text: |cells| cells.event_us_median.map(three_digits) },
    Column {
        title: "not run",
        text: |cells| match cells.waiting + cells.void + cells.stopped_early {
            0 => None,
            n => Some(n.to_string()),
        },
    },
];

/// Properties at the terminal, with the titles of their columns.
const PROPERTIES: [(Property, &str); 4] = [
    (Property::YoungsModulus, "E GPa"),
    (Property::Expansion, "expansion 1/K"),
    (Property::Conductivity, "W/(m K)"),
    (Property::Diffusivity, "diffusivity m2/s"),
];

/// Mean and standard deviation of a property.
fn mean_and_std(sample: Sample) -> Option<String> {
    let mean = sample.mean?;
    Some(match sample.std {
        Some(std) => format!("{} \u{B1} {}", significant(mean, 4), significant(std, 2)),
        None => significant(mean, 4),
    })
}

/// A number with so many digits.
fn significant(x: f64, digits: i32) -> String {
    let exponent = if x == 0.0 { 0 } else { x.abs().log10().floor() as i32 };
    let decimals = (digits - 1 - exponent).max(0) as usize;
    let after_point = (digits - 1) as usize;
    if (-4..6).contains(&exponent) { format!("{x:.decimals$}") } else { format!("{x:.after_point$e}") }
}

/// The representative volumes, a line for each that could be determined.
fn representative_volumes(table: &Table) -> String {
    let line = |of: &RepresentativeVolume| {
        let values: Vec<String> =
            of.values.iter().map(|(column, value)| format!(" {column}={}", short(value))).collect();
        let (alpha, range, edge) = (of.alpha?, of.integral_range_mm3?, of.edge_mm?);
        // Below the smallest cube the fit was not tested, and grains may not fit in.
        let smallest = of.volumes.first().map_or(0.0, |volume| volume.edge_mm);
        let cube = if edge < smallest {
            format!("one cube of the smallest edge, {} mm,", significant(smallest, 3))
        } else {
            format!("one cube of {} mm", significant(edge, 3))
        };
        Some(format!(
            "{}{}: {cube} has it within 1 % (alpha {alpha:.2}, A3 {} mm3)\n",
            of.property.name(),
            values.concat(),
            significant(range, 3),
        ))
    };
    table.representative_volumes.iter().filter_map(line).collect()
}

/// Columns that are left out where grains may touch.
const OF_DISTANCES: [&str; 2] = ["with coating", "distance mm"];

fn three_digits(x: f64) -> String {
    let decimals = (2 - x.abs().max(1e-3).log10().floor() as i64).max(0) as usize;
    format!("{x:.decimals$}")
}

/// The table for the terminal: aligned, without columns that no row has.
pub(super) fn table(table: &Table) -> String {
    let rows = &table.rows[..table.rows.len().min(ROWS_SHOWN)];
    // Where grains may touch, the columns of distances are left out.
    let apart = rows.iter().any(|row| row.cells.distance_mm_max.is_some_and(|mm| mm > 0.0))
        || rows.iter().all(|row| row.cells.distance_mm_max.is_none());
    let keys = (0..table.columns.len()).map(|i| {
        let of = |row: &Row| row.values.get(i).map(|(_, value)| short(value)).unwrap_or_default();
        (table.columns[i].clone(), rows.iter().map(of).collect::<Vec<String>>())
    });
    let shown = COLUMNS.iter().filter(|column| apart || !OF_DISTANCES.contains(&column.title));
    let figures = shown.filter_map(|column| {
        let texts: Vec<Option<String>> = rows.iter().map(|row| (column.text)(&row.cells)).collect();
        let shown = texts.iter().any(Option::is_some);
        let texts = texts.into_iter().map(|text| text.unwrap_or_else(|| "-".into())).collect();
        shown.then(|| (column.title.to_owned(), texts))
    });
    let properties = PROPERTIES.iter().filter_map(|(property, title)| {
        let texts: Vec<Option<String>> =
            rows.iter().map(|row| mean_and_std(row.properties.sample(*property))).collect();
        let shown = texts.iter().any(Option::is_some);
        let texts = texts.into_iter().map(|text| text.unwrap_or_else(|| "-".into())).collect();
        shown.then(|| ((*title).to_owned(), texts))
    });
    let columns: Vec<(String, Vec<String>)> = keys.chain(figures).chain(properties).collect();
    let widths: Vec<usize> = columns
        .iter()
        .map(|(title, texts)| texts.iter().chain([title]).map(|text| text.chars().count()).max().unwrap_or(0))
        .collect();
    let mut out = String::new();
    let mut line = |cells: Vec<&str>| {
        let cells: Vec<String> =
            cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{}", cells.join("  "));
    };
    line(columns.iter().map(|(title, _)| title.as_str()).collect());
    for i in 0..rows.len() {
        line(columns.iter().map(|(_, texts)| texts[i].as_str()).collect());
    }
    if table.rows.len() > rows.len() {
        let _ = writeln!(out, "and {} rows more in table.csv", table.rows.len() - rows.len());
    }
    out + &representative_volumes(table)
}

/// A value of a column in short: `rsa attempts_per_grain=1000` for that method.
fn short(value: &Value) -> String {
    match value {
        Value::Object(members) => {
            let part = |(name, value): (&String, &Value)| match value {
                Value::String(text) if name == "type" => text.clone(),
                Value::Object(_) => format!("{name}=({})", short(value)),
                other => format!("{name}={}", short(other)),
            };
            members.iter().map(part).collect::<Vec<_>>().join(" ")
        }
        Value::Array(items) if items.len() > 3 => format!("{} items", items.len()),
        Value::Array(items) => items.iter().map(short).collect::<Vec<_>>().join("x"),
        Value::String(text) => text.chars().filter(|c| !c.is_control()).take(60).collect(),
        Value::Null => "-".into(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::studies::{Facts, Outcome, Run};

    #[test]
    fn values_are_short() {
        for (value, text) in [
            (json!({"type": "rsa", "attempts_per_grain": 1000}), "rsa attempts_per_grain=1000"),
            (json!({"type": "edmd", "stop": {"time_s": 60}}), "edmd stop=(time_s=60)"),
            (json!([80, 80, 80]), "80x80x80"),
            (json!([1, 2, 3, 4]), "4 items"),
            (json!(0.585), "0.585"),
            (json!(null), "-"),
        ] {
            assert_eq!(short(&value), text);
        }
    }

    #[test]
    fn the_table_is_aligned_and_leaves_out_what_no_row_has() {
        let keys = Keys {
            columns: vec!["/mix/volume_fraction".into(), "/method".into()],
            values: vec![
                vec![json!(0.6), json!({"type": "rsa"})],
                vec![json!(0.605), json!({"type": "edmd"})],
            ],
        };
        let facts = Facts { time_s: 0.0123, grains: Some(7965), ..Facts::default() };
        let run = Run { point: 1, replicate: 0, outcome: Outcome::Succeeded, facts };
        let shown = table(&Table::new(&keys, &[run], &[]));
        assert_eq!(
            shown,
            "/mix/volume_fraction  /method  grains  succeeded  95 % of rate  s per success\n\
             \x20                0.6      rsa       -        0/0             -              -\n\
             \x20              0.605     edmd    7965        1/1     21..100 %         0.0123\n"
        );
    }

    #[test]
    fn times_have_three_digits() {
        assert_eq!([0.012_34, 1.234, 123.4, 12_345.0].map(three_digits), ["0.0123", "1.23", "123", "12345"]);
    }
}
