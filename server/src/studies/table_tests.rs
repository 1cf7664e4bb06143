//! Tables of runs that were made up: every figure by hand, every form read back.
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use serde_json::{Value, json};
use utoipa::PartialSchema as _;

use super::super::properties::{Property, PropertyFacts, PropertyValue};
use super::*;

fn run(point: usize, replicate: usize, outcome: Outcome, facts: Facts) -> Run {
    Run { point, replicate, outcome, facts }
}

fn taking(time_s: f64) -> Facts {
    Facts { time_s, ..Facts::default() }
}

fn keys(values: Vec<Vec<Value>>) -> Keys {
    Keys { columns: vec!["/mix/volume_fraction".into(), "/method".into()], values }
}

fn two_points() -> Keys {
    keys(vec![vec![json!(0.55), json!({"type": "rsa"})], vec![json!(0.6), json!({"type": "edmd"})]])
}

#[test]
fn every_figure_is_what_its_definition_says() {
    let grown = |time_s, distance_mm, events, edmd_s| Facts {
        time_s,
        grains: Some(100),
        volume_fraction_effective: Some(0.5),
        volume_fraction_with_coating: Some(0.6),
        volume_fraction_reached: None,
        distance_mm: Some(distance_mm),
        events: Some(events),
        edmd_s: Some(edmd_s),
        end: None,
        properties: None,
    };
    let not_grown = Facts {
        time_s: 4.0,
        grains: Some(104),
        volume_fraction_effective: Some(0.51),
        distance_mm: Some(0.1),
        events: Some(8000),
        ..Facts::default()
    };
    let runs = [
        run(1, 2, Outcome::TargetNotReached, not_grown),
        run(1, 0, Outcome::Succeeded, grown(1.0, 0.3, 1000, 0.5)),
        run(1, 1, Outcome::Succeeded, grown(2.0, 0.2, 2000, 0.25)),
        run(1, 3, Outcome::Void, taking(100.0)),
    ];
    let rest = [Rest { waiting: 4, stopped_early: 0 }, Rest { waiting: 1, stopped_early: 2 }];
    let table = Table::new(&two_points(), &runs, &rest);
    let rows = serde_json::to_value(&table).unwrap();
    let row = |cells: Value| {
        let mut row = cells;
        for name in Cells::NAMES {
            row.as_object_mut().unwrap().entry(*name).or_insert(Value::Null);
        }
        row
    };
    assert_eq!(rows["columns"], json!(["/mix/volume_fraction", "/method"]));
    assert_eq!(
        rows["rows"][0],
        row(json!({
            "/mix/volume_fraction": 0.55, "/method": {"type": "rsa"},
            "runs": 0, "successes": 0, "partial": 0, "waiting": 4, "void": 0, "stopped_early": 0,
        }))
    );
    let found = rows["rows"][1].clone();
    let [low, high] = wilson(2, 3).unwrap();
    assert_eq!(
        found,
        json!({
            "/mix/volume_fraction": 0.6, "/method": {"type": "edmd"},
            "grains": 100.0, "volume_fraction_effective": 0.5, "volume_fraction_with_coating": 0.6,
            "runs": 3, "successes": 2, "success_rate": 2.0 / 3.0, "success_rate_low": low,
            "success_rate_high": high, "partial": 0, "volume_fraction_reached_median": null,
            "time_s_total": 7.0, "time_s_per_success": 3.5,
            "time_s_median": 1.5, "time_s_max": 2.0,
            "distance_mm_median": 0.2, "distance_mm_min": 0.1, "distance_mm_max": 0.3,
            "events_median": 2000.0, "event_us_median": 312.5, "waiting": 1, "void": 1, "stopped_early": 2,
        })
    );
}

#[test]
fn partial_packings_are_counted_apart_and_never_as_successes() {
    let kept = |reached| Facts {
        volume_fraction_effective: Some(0.6),
        volume_fraction_reached: Some(reached),
        volume_fraction_with_coating: Some(0.65),
        ..taking(5.0)
    };
    let whole = Facts { volume_fraction_effective: Some(0.6), ..taking(1.0) };
    let runs = [
        run(0, 0, Outcome::Partial, kept(0.55)),
        run(0, 1, Outcome::Succeeded, whole),
        run(0, 2, Outcome::Partial, kept(0.59)),
        run(0, 3, Outcome::TargetNotReached, taking(2.0)),
    ];
    let table = Table::new(&two_points(), &runs, &[]);
    let cells = &table.rows[0].cells;
    assert_eq!((cells.runs, cells.successes, cells.partial), (4, 1, 2));
    assert_eq!((cells.success_rate, cells.volume_fraction_effective), (Some(0.25), Some(0.6)));
    assert!((cells.volume_fraction_reached_median.unwrap() - 0.57).abs() < 1e-12);
    assert_eq!((cells.time_s_median, cells.volume_fraction_with_coating), (Some(1.0), None));
}

#[test]
fn a_point_without_success_has_no_time_per_success() {
    let runs =
        [run(0, 0, Outcome::TargetNotReached, taking(3.0)), run(7, 0, Outcome::Succeeded, taking(1.0))];
    let table = Table::new(&two_points(), &runs, &[]);
    let cells = &table.rows[0].cells;
    assert_eq!((cells.time_s_total, cells.time_s_per_success, cells.time_s_median), (Some(3.0), None, None));
    assert_eq!((cells.success_rate, cells.success_rate_low), (Some(0.0), Some(0.0)));
    assert_eq!(table.rows.len(), 2, "the run of an eighth point adds none");
}

#[test]
fn columns_of_properties_are_there_where_a_run_has_them_and_count_successes() {
    let of = |value, properties: &[Property]| {
        let value = PropertyValue { value, phase_variance: None };
        let values = properties.iter().map(|property| (*property, value)).collect();
        Facts { properties: Some(PropertyFacts { volume_mm3: 1000.0, values }), ..taking(1.0) }
    };
    let stiff = [Property::YoungsModulus];
    let runs = [
        run(0, 1, Outcome::Succeeded, of(32.0, &stiff)),
        run(0, 0, Outcome::Succeeded, of(30.0, &stiff)),
        // Another volume fraction than the one of the point.
        run(0, 2, Outcome::Partial, of(99.0, &stiff)),
        run(0, 3, Outcome::Succeeded, taking(1.0)),
        run(1, 0, Outcome::Succeeded, of(2.5, &[Property::YoungsModulus, Property::Conductivity])),
    ];
    let table = Table::new(&two_points(), &runs, &[]).with_waiting_properties(&[1, 0]);
    let names = ["youngs_modulus_gpa", "conductivity_w_m_k"];
    let columns: Vec<String> = names
        .iter()
        .flat_map(|name| ["mean", "std", "count"].map(|figure| format!("{name}_{figure}")))
        .chain(["properties_waiting".into()])
        .collect();
    let rows = serde_json::to_value(&table).unwrap()["rows"].take();
    let cells = |row: &Value| columns.iter().map(|column| row[column].clone()).collect::<Vec<_>>();
    let std = 2.0_f64.sqrt();
    assert_eq!(
        cells(&rows[0]),
        [json!(31.0), json!(std), json!(2), json!(null), json!(null), json!(0), json!(1)]
    );
    assert_eq!(
        cells(&rows[1]),
        [json!(2.5), json!(null), json!(1), json!(2.5), json!(null), json!(1), json!(0)]
    );
    let csv = parsed(&table.to_csv());
    let first = 2 + Cells::NAMES.len();
    assert_eq!(csv[0][first..], columns);
    assert_eq!(csv[1][first..], ["31.0", &std.to_string(), "2", "", "", "0", "1"]);
    // All packings have one volume.
    assert!(table.representative_volumes.is_empty());
    // Without properties there are no such columns, unless some are awaited.
    let none = Table::new(&two_points(), &runs[3..4], &[]);
    assert!(!none.to_csv().contains("properties") && !none.to_csv().contains("gpa"));
    let awaited = none.with_waiting_properties(&[2, 0]);
    assert!(awaited.to_csv().lines().next().unwrap().ends_with(",stopped_early,properties_waiting"));
    let schema = serde_json::to_value(Row::schema()).unwrap();
    assert!(columns.iter().all(|column| schema["properties"][column].is_object()), "{schema:#}");
}

#[test]
fn csv_quotes_what_must_be_and_tells_none_from_empty() {
    let keys = Keys {
        columns: vec!["point".into(), "a,\"b\"".into()],
        values: vec![
            vec![json!(0), json!("x, \"y\"\nz")],
            vec![json!(1), json!("")],
            vec![json!(2), Value::Null],
        ],
    };
    let csv = Table::new(&keys, &[], &[]).to_csv();
    let header = format!("point,\"a,\"\"b\"\"\",{}\n", Cells::NAMES.join(","));
    assert!(csv.starts_with(&header), "{csv}");
    let empty = ",,,0,0,,,,0,,,,,,,,,,,0,0,0";
    assert_eq!(csv[header.len()..], format!("0,\"x, \"\"y\"\"\nz\",{empty}\n1,\"\",{empty}\n2,,{empty}\n"));
}

#[test]
fn the_schema_has_the_columns_of_the_rows() {
    let schema = serde_json::to_value(Cells::schema()).unwrap();
    let names: Vec<&String> = schema["properties"].as_object().unwrap().keys().collect();
    assert_eq!(names, Cells::NAMES);
}

/// Reads CSV by the grammar of RFC 4180.
fn parsed(csv: &str) -> Vec<Vec<String>> {
    let (mut rows, mut row, mut field) = (Vec::new(), Vec::new(), String::new());
    let mut quoted = false;
    let mut chars = csv.chars().peekable();
    while let Some(c) = chars.next() {
        match (quoted, c) {
            (true, '"') if chars.peek() == Some(&'"') => field.extend(chars.next()),
            (_, '"') => quoted = !quoted,
            (false, ',') => row.push(std::mem::take(&mut field)),
            (false, '\n') => {
                row.push(std::mem::take(&mut field));
                rows.push(std::mem::take(&mut row));
            }
            _ => field.push(c),
        }
    }
    assert!(!quoted && field.is_empty() && row.is_empty(), "{csv:?} does not end with a line");
    rows
}

proptest! {
    #[test]
    fn numbers_and_texts_of_csv_read_back(
        phi in -1e300..1e300_f64,
        text in any::<String>(),
        times in prop::collection::vec((0.0..1e6_f64, any::<bool>()), 1..20),
    ) {
        let keys = keys(vec![vec![json!(phi), json!(text)]]);
        let outcome = |ok| if ok { Outcome::Succeeded } else { Outcome::TargetNotReached };
        let runs: Vec<Run> = (times.iter().enumerate())
            .map(|(i, (time_s, ok))| run(0, i, outcome(*ok), taking(*time_s)))
            .collect();
        let table = Table::new(&keys, &runs, &[]);
        let rows = parsed(&table.to_csv());
        prop_assert_eq!(rows.len(), 2);
        prop_assert_eq!(rows[1][0].parse::<f64>().unwrap(), phi);
        let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
        prop_assert_eq!(&rows[1][1], &format!("{}{text}", if formula { "'" } else { "" }));
        for ((name, cell), field) in Cells::NAMES.iter().zip(table.rows[0].cells.all()).zip(&rows[1][2..]) {
            let read = match cell {
                Cell::Count(_) => Cell::Count(field.parse().unwrap()),
                Cell::Number(_) if field.is_empty() => Cell::Number(None),
                Cell::Number(_) => Cell::Number(Some(field.parse().unwrap())),
            };
            prop_assert_eq!(read, cell, "{}", name);
        }
    }

    #[test]
    fn the_order_in_which_runs_end_changes_nothing(
        times in prop::collection::vec((0.0..1e3_f64, any::<bool>()), 1..20),
        turn in any::<prop::sample::Index>(),
    ) {
        let outcome = |ok| if ok { Outcome::Succeeded } else { Outcome::TargetNotReached };
        let mut runs: Vec<Run> = (times.iter().enumerate())
            .map(|(i, (time_s, ok))| run(i % 2, i, outcome(*ok), taking(*time_s)))
            .collect();
        let table = Table::new(&two_points(), &runs, &[]);
        let turn = turn.index(runs.len());
        runs.rotate_left(turn);
        prop_assert_eq!(Table::new(&two_points(), &runs, &[]), table);
    }
}
