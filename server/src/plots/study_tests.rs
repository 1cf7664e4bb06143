use serde_json::json;

use super::*;
use crate::plots::axis::{Extent, Scale};
use crate::studies::properties::{PropertyFacts, PropertyValue};
use crate::studies::{Facts, Keys, Outcome, Run};

/// A table of rows with values and cells.
fn table(columns: &[&str], rows: Vec<(Vec<Value>, Cells)>) -> Table {
    let columns: Vec<String> = columns.iter().map(ToString::to_string).collect();
    let rows = rows
        .into_iter()
        .map(|(values, cells)| Row {
            values: columns.iter().cloned().zip(values).collect(),
            cells,
            ..Row::default()
        })
        .collect();
    Table { columns, rows, ..Table::default() }
}

fn rate(rate: f64) -> Cells {
    Cells {
        runs: 10,
        successes: (10.0 * rate) as u64,
        success_rate: Some(rate),
        success_rate_low: Some((rate - 0.2).max(0.0)),
        success_rate_high: Some((rate + 0.2).min(1.0)),
        time_s_per_success: (rate > 0.0).then(|| 1.0 / rate),
        ..Cells::default()
    }
}

fn by_method() -> Table {
    table(
        &["/mix/volume_fraction", "/method", "/mix/d_min_mm"],
        vec![
            (vec![json!(0.6), json!({"type": "rsa", "attempts_per_grain": 1000}), json!(2)], rate(0.9)),
            (vec![json!(0.6), json!({"type": "edmd"}), json!(2)], rate(1.0)),
            (vec![json!(0.55), json!({"type": "rsa", "attempts_per_grain": 1000}), json!(2)], rate(1.0)),
            (vec![json!(0.65), json!({"type": "rsa", "attempts_per_grain": 1000}), json!(2)], rate(0.0)),
            (vec![json!(0.65), json!({"type": "edmd"}), json!(2)], Cells::default()),
        ],
    )
}

fn drawn(kind: StudyPlot, table: &Table, options: &StudyOptions) -> Chart {
    chart(kind, Some("TB-7"), table, &[], options).unwrap()
}

fn labels(chart: &Chart) -> Vec<&str> {
    chart.series.iter().map(|series| series.label.as_deref().unwrap_or("-")).collect()
}

#[test]
fn series_are_named_by_what_varies_except_the_abscissa() {
    let chart = drawn(StudyPlot::Success, &by_method(), &StudyOptions::default());
    assert_eq!(chart.title, "Success rate: TB-7");
    assert_eq!(chart.x.label, "volume fraction");
    assert_eq!(labels(&chart), ["RSA, 1000 attempts per grain", "EDMD"]);
    let rsa: Vec<(f64, f64)> = chart.series[0].points.iter().map(|p| (p.x, p.y)).collect();
    assert_eq!(rsa, [(0.55, 100.0), (0.6, 90.0), (0.65, 0.0)], "in the order of the abscissa");
    let [low, high] = chart.series[0].points[1].interval.unwrap();
    assert!((low - 70.0).abs() < 1e-9 && (high - 100.0).abs() < 1e-9, "{low} to {high}");
    assert_eq!(chart.y.extent, Extent::Fixed(-3.0, 103.0));
    let edmd = &chart.series[1].points;
    assert!(edmd.len() == 2 && edmd[1].y.is_nan(), "what has not run has no rate: {edmd:?}");
}

#[test]
fn time_is_logarithmic_and_missing_where_nothing_succeeded() {
    let chart = drawn(StudyPlot::Time, &by_method(), &StudyOptions::default());
    assert_eq!(chart.y.scale, Scale::Log);
    assert!(chart.series[0].points[2].y.is_nan());
    assert!((chart.series[0].points[1].y - 1.0 / 0.9).abs() < 1e-12);
}

#[test]
fn the_abscissa_is_a_column_of_numbers_or_the_grains() {
    let table = by_method();
    assert_eq!(
        abscissas(&table),
        ["/mix/volume_fraction", "/mix/d_min_mm", "grains", "volume_fraction_effective"]
    );
    let options = |x: &str| StudyOptions { x: Some(x.into()), log_x: None };
    let refused = chart(StudyPlot::Time, None, &table, &[], &options("/method")).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "\"/method\" is not an abscissa of this study: must be one of /mix/volume_fraction, /mix/d_min_mm, grains, \
         volume_fraction_effective"
    );
    let chosen = drawn(StudyPlot::Success, &table, &options("/mix/d_min_mm"));
    assert_eq!(chosen.x.label, "cut-off diameter in mm");
    assert_eq!(
        labels(&chosen)[..2],
        ["volume fraction 0.6, RSA, 1000 attempts per grain", "volume fraction 0.6, EDMD"]
    );
}

#[test]
fn the_number_of_grains_replaces_the_column_that_it_depends_on() {
    let row = |size: f64, method: &str, grains: f64| {
        let cells = Cells { grains: Some(grains), event_us_median: Some(grains.log10()), ..Cells::default() };
        (vec![json!([size, size, size]), json!(method)], cells)
    };
    let table = table(
        &["/specimen/size_mm", "/method/type"],
        vec![
            row(10.0, "rsa", 100.0),
            row(10.0, "edmd", 100.0),
            row(40.0, "rsa", 6400.0),
            row(40.0, "edmd", 6400.0),
        ],
    );
    let chart = drawn(StudyPlot::EventTime, &table, &StudyOptions::default());
    assert_eq!(chart.x.label, "number of grains N");
    assert_eq!(chart.x.scale, Scale::Log, "by itself, from 100 to 6400");
    assert_eq!(labels(&chart), ["RSA", "EDMD"]);
    let linear = StudyOptions { log_x: Some(false), ..StudyOptions::default() };
    assert_eq!(drawn(StudyPlot::EventTime, &table, &linear).x.scale, Scale::Linear);
    let by_size = StudyOptions { x: None, log_x: None };
    assert_eq!(drawn(StudyPlot::Success, &table, &by_size).series.len(), 2);
}

#[test]
fn a_list_is_one_series() {
    let table = table(
        &["point", "name"],
        vec![(vec![json!(0), json!("A16")], rate(1.0)), (vec![json!(1), json!("B16")], rate(0.5))],
    );
    let numbered = drawn(StudyPlot::Success, &table, &StudyOptions { x: Some("point".into()), log_x: None });
    assert_eq!(labels(&numbered), ["-"]);
    assert_eq!(numbered.series[0].points.len(), 2);
    let by_grains = drawn(StudyPlot::Success, &table, &StudyOptions::default());
    assert!(by_grains.is_empty(), "no run said how many grains it had");
}

#[test]
fn plots_without_data_are_not_among_the_plots_of_a_study() {
    let kinds = |cells: Cells, curves: &[RunCurve]| -> Vec<&str> {
        let row =
            |phi: f64| (vec![json!(phi)], Cells { volume_fraction_effective: Some(phi), ..cells.clone() });
        let table = table(&["/mix/volume_fraction"], vec![row(0.4), row(0.5)]);
        charts(None, &table, curves).into_iter().map(|(kind, _)| kind.name()).collect()
    };
    assert!(kinds(Cells::default(), &[]).is_empty());
    let touching = Cells {
        grains: Some(100.0),
        volume_fraction_with_coating: Some(0.4),
        distance_mm_median: Some(0.0),
        ..rate(1.0)
    };
    assert_eq!(kinds(touching.clone(), &[]), ["success", "time"]);
    let apart = Cells {
        volume_fraction_with_coating: Some(0.6),
        distance_mm_median: Some(0.5),
        event_us_median: Some(2.0),
        ..touching
    };
    let curve = RunCurve { point: 0, points: vec![[0.1, 0.2], [1.0, 0.5]] };
    let without_properties = StudyPlot::ALL.iter().filter(|kind| kind.property().is_none());
    let all: Vec<&str> = without_properties.map(|kind| kind.name()).collect();
    assert_eq!(kinds(apart, &[curve]), all[..all.len() - 1], "no representative volume");
}

/// The values of a point, and its runs as volume fraction, edge and conductivity.
type Conducting = (Vec<Value>, Vec<(f64, f64, f64)>);

/// A table of runs with a conductivity: the pointers of its columns, and of each point its values and its runs, as
/// volume fraction, edge and conductivity.
fn conducting(columns: &[&str], points: &[Conducting]) -> Table {
    let keys = Keys {
        columns: columns.iter().map(ToString::to_string).collect(),
        values: points.iter().map(|(values, _)| values.clone()).collect(),
    };
    let mut runs = Vec::new();
    for (point, (_, of)) in points.iter().enumerate() {
        for (replicate, &(fraction, edge_mm, value)) in of.iter().enumerate() {
            let value = PropertyValue { value, phase_variance: Some(2.0) };
            let values = [(Property::Conductivity, value)].into();
            let facts = Facts {
                volume_fraction_effective: Some(fraction),
                properties: Some(PropertyFacts { volume_mm3: edge_mm.powi(3), values }),
                ..Facts::default()
            };
            runs.push(Run { point, replicate, outcome: Outcome::Succeeded, facts });
        }
    }
    Table::new(&keys, &runs, &[])
}

#[test]
fn properties_are_plotted_against_the_volume_fraction_with_each_packing() {
    let point = |phi: f64, d: f64| {
        (vec![json!(d), json!(phi)], vec![(phi - 0.01, 20.0, 2.0 + phi), (phi + 0.01, 20.0, 2.2 + phi)])
    };
    let columns = ["/mix/d_min_mm", "/mix/volume_fraction"];
    let table = conducting(&columns, &[point(0.3, 2.0), point(0.4, 2.0), point(0.3, 4.0), point(0.4, 4.0)]);
    let found = drawn(StudyPlot::Conductivity, &table, &StudyOptions::default());
    assert_eq!(
        (found.x.label.as_str(), found.y.label.as_str()),
        ("volume fraction", "conductivity in W/(m K)")
    );
    assert_eq!(labels(&found), ["-", "-", "cut-off diameter 2 mm", "cut-off diameter 4 mm"]);
    let discs: Vec<(f64, f64)> = found.series[0].points.iter().map(|point| (point.x, point.y)).collect();
    assert_eq!(discs, [(0.3, 2.3), (0.3, 2.5), (0.4, 2.4), (0.4, 2.6)]);
    let mean = &found.series[2].points[1];
    let [low, high] = mean.interval.unwrap();
    // The standard deviation of two values is their difference over the root of 2.
    assert!((mean.y - 2.5).abs() < 1e-12 && (high - low - 0.4 / 2.0_f64.sqrt()).abs() < 1e-12, "{mean:?}");
    // Against what was counted each packing has its own place.
    let options = StudyOptions { x: Some(VOLUME_FRACTION.into()), log_x: None };
    let counted = drawn(StudyPlot::Conductivity, &table, &options);
    assert_eq!(counted.x.label, "volume fraction of the grains");
    assert_eq!(
        labels(&counted)[2..],
        ["cut-off diameter 2 mm", "cut-off diameter 4 mm"],
        "for what it depends on"
    );
    let places: Vec<f64> = counted.series[0].points.iter().map(|point| point.x).collect();
    assert!((places[0] - 0.29).abs() < 1e-12 && (places[1] - 0.31).abs() < 1e-12, "{places:?}");
    let svg = crate::plots::draw::svg(&counted, true).unwrap();
    assert!(svg.contains("Conductivity: TB-7"), "{svg}");
    let none = drawn(StudyPlot::YoungsModulus, &table, &StudyOptions::default());
    assert!(none.is_empty() && none.when_empty.contains("`properties`"), "{none:?}");
    // Without a column of it, the fraction that was counted, where it differs.
    let by_mix = |a: f64, b: f64| {
        let mixes = [(json!("A16"), a), (json!("B16"), b)];
        let points = mixes.map(|(name, phi)| (vec![name], vec![(phi, 20.0, 2.0)]));
        drawn(StudyPlot::Conductivity, &conducting(&["/name"], &points), &StudyOptions::default()).x.label
    };
    assert_eq!(by_mix(0.3, 0.35), "volume fraction of the grains");
    assert_eq!(by_mix(0.3, 0.301), "number of grains N");
}

#[test]
fn the_representative_volume_has_means_and_scatter_against_the_edge() {
    let point = |phi: f64, edge: f64, half: f64| {
        let size = json!([edge, edge, edge]);
        (vec![json!(phi), size], vec![(phi, edge, 2.0 - half), (phi, edge, 2.0 + half)])
    };
    let points =
        [point(0.3, 10.0, 0.2), point(0.3, 20.0, 0.1), point(0.4, 10.0, 0.1), point(0.4, 20.0, 0.05)];
    let table = conducting(&["/mix/volume_fraction", "/specimen/size_mm"], &points);
    let found = drawn(StudyPlot::RepresentativeVolume, &table, &StudyOptions::default());
    assert_eq!(found.title, "Representative volume, conductivity: TB-7");
    assert_eq!(labels(&found), ["-", "-", "volume fraction 0.3", "volume fraction 0.4"]);
    let edges: Vec<f64> = found.series[2].points.iter().map(|point| point.x).collect();
    assert!((edges[0] - 10.0).abs() < 1e-12 && (edges[1] - 20.0).abs() < 1e-12, "{edges:?}");
    let [scatter] = &found.layout.below[..] else { panic!("one panel: {found:?}") };
    let measured = &scatter.series[0].points;
    assert!((measured[0].y - 100.0 * 0.2 * 2.0_f64.sqrt() / 2.0).abs() < 1e-9, "{measured:?}");
    // Of two volumes the line goes through both.
    let line = &scatter.series[1];
    assert!(line.label.as_deref().unwrap().starts_with("\u{3B1} = 0.67, A3 = "), "{line:?}");
    let (first, last) = (&line.points[0], line.points.last().unwrap());
    assert!((first.y - measured[0].y).abs() < 1e-9 && (last.y - measured[1].y).abs() < 1e-9, "{line:?}");
    assert!(crate::plots::draw::svg(&found, true).is_ok());
    let one = conducting(&["/mix/volume_fraction"], &[(vec![json!(0.3)], vec![(0.3, 10.0, 2.0)])]);
    let none = drawn(StudyPlot::RepresentativeVolume, &one, &StudyOptions::default());
    assert!(none.is_empty() && none.when_empty.contains("/specimen/size_mm"), "{none:?}");
}

#[test]
fn curves_of_a_point_share_a_style_and_a_name() {
    let table = table(
        &["/mix/d_min_mm"],
        vec![(vec![json!(2)], Cells::default()), (vec![json!(0.5)], Cells::default())],
    );
    let curve = |point, end| RunCurve { point, points: vec![[0.1, 0.2], [end, 0.9]] };
    let curves = [curve(0, 5.0), curve(1, 9.0), curve(0, 6.0), curve(7, 1.0), RunCurve::default()];
    let chart = chart(StudyPlot::Curve, None, &table, &curves, &StudyOptions::default()).unwrap();
    assert_eq!(labels(&chart), ["cut-off diameter 2 mm", "cut-off diameter 0.5 mm", "cut-off diameter 2 mm"]);
    assert_eq!(chart.series[0].style, chart.series[2].style);
    assert_ne!(chart.series[0].style, chart.series[1].style);
    let none = super::chart(StudyPlot::Curve, None, &table, &[], &StudyOptions::default()).unwrap();
    assert!(none.is_empty(), "{none:?}");
    let touching = RunCurve { point: 0, points: vec![[0.1, 0.0], [1.0, 0.0]] };
    let zero = super::chart(StudyPlot::Curve, None, &table, &[touching], &StudyOptions::default()).unwrap();
    assert!(zero.is_empty(), "a distance of 0 is no curve: {zero:?}");
    let refused = crate::plots::draw::svg(&none, true).unwrap_err().to_string();
    assert!(
        refused.contains("`growth`") && refused.contains("a constant or the largest distance"),
        "{refused}"
    );
}

/// A prescribed distance has a curve as well as the largest one, where the grains were grown.
#[test]
fn curves_are_read_from_the_growth_curve_of_a_report() {
    let point = |time_s: f64, mm: Value| json!({"packing_time_s": time_s, "distance_mm": mm, "events": 7});
    let curve = |report: Value| RunCurve::of_report(3, &report).points;
    assert_eq!(
        curve(json!({"growth_curve": [point(0.1, json!(0.0)), point(0.4, json!(0.5))]})),
        [[0.1, 0.0], [0.4, 0.5]]
    );
    assert!(
        curve(json!({"growth_curve": [point(0.1, Value::Null)]})).is_empty(),
        "the distance varies by pair"
    );
    assert!(curve(json!({})).is_empty(), "inserted, not grown");
}
