//! Every table of the collection `tests/data/mixes` is read as `expected.json` says.

use std::fs;
use std::path::{Path, PathBuf};

use packstone_engine::importer::{MixReading, ReadOptions, Verdict, read};
use packstone_engine::request::{Grading, Standard, standard};
use serde_json::Value;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/mixes")
}

fn verdict(reading: &MixReading) -> &'static str {
    match reading.verdict {
        Verdict::Ok => "ok",
        Verdict::Warn => "warn",
        Verdict::Ask => "ask",
        Verdict::Refuse => "refuse",
    }
}

/// Whether a curve has the expected passing at each expected sieve.
fn has_points(points: &[[f64; 2]], expected: &Value, tolerance: f64) -> bool {
    expected.as_array().unwrap().iter().all(|point| {
        let (mm, passing) = (point[0].as_f64().unwrap(), point[1].as_f64().unwrap());
        points.iter().any(|[of, found]| (of / mm - 1.0).abs() < 0.02 && (found - passing).abs() <= tolerance)
    })
}

/// What differs from what is expected; `None` where nothing does.
fn difference(case: &Value) -> Option<String> {
    let file = case["file"].as_str().unwrap();
    let option = |name: &str| case["options"][name].as_str().map(str::to_owned);
    let options = ReadOptions {
        sheet: option("sheet"),
        curve: option("curve"),
        column: option("column"),
        unit: option("unit"),
    };
    let reading = read(&fs::read(folder().join(file)).unwrap(), &options);
    let of_curves = reading.curves.iter().flat_map(|curve| &curve.notes);
    let notes: Vec<String> = reading
        .notes
        .iter()
        .chain(of_curves)
        .map(|note| format!("{:?} {}", note.line.unwrap_or(0), note.text))
        .collect();
    let found = verdict(&reading);
    let also = case["also"].as_array().is_some_and(|also| also.iter().any(|of| of == found));
    if found != case["verdict"].as_str().unwrap() && !also {
        let candidates: Vec<_> = reading
            .candidates
            .iter()
            .filter_map(|of| of.curve.as_ref().map(|curve| (&of.label, curve.meaning.name(), &curve.points)))
            .collect();
        return Some(format!("{file}: {found}, not {}: {notes:?} {candidates:?}", case["verdict"]));
    }
    if found == "refuse" {
        let line = reading.notes.first().and_then(|note| note.line);
        let is_right = case["line"].is_null()
            || case["line"].as_str().is_some()
            // About the whole input, or an option.
            || line.is_none()
            || case["line"].as_u64() == line.map(u64::from)
            || case["lines"]
                .as_array()
                .is_some_and(|lines| lines.iter().any(|of| of.as_u64() == line.map(u64::from)));
        return (!is_right).then(|| format!("{file}: line {line:?}, not {}: {notes:?}", case["line"]));
    }
    let tolerance = case["tolerance"].as_f64().unwrap_or(5.0e-4) + 1.0e-9;
    for curve in case["curves"].as_array().into_iter().flatten() {
        if !reading.curves.iter().any(|of| has_points(&of.points, &curve["points"], tolerance)) {
            let points: Vec<_> = reading.curves.iter().map(|of| (&of.name, &of.points)).collect();
            return Some(format!("{file}: no curve {curve}: {points:?} {notes:?}"));
        }
    }
    for band in case["bands"].as_array().into_iter().flatten() {
        let is_found = reading.bands.iter().any(|of| {
            band["points"].as_array().unwrap().iter().all(|point| {
                let [mm, low, high] = [0, 1, 2].map(|at| point[at].as_f64().unwrap());
                of.points.iter().any(|[d, a, b]| {
                    (d / mm - 1.0).abs() < 0.02 && (a - low).abs() < 1.0e-3 && (b - high).abs() < 1.0e-3
                })
            })
        });
        if !is_found {
            return Some(format!("{file}: no band {band}: {:?}", reading.bands));
        }
    }
    for recipe in case["recipes"].as_array().into_iter().flatten() {
        if !reading.recipes.iter().any(|of| is_recipe(&serde_json::to_value(of).unwrap(), recipe, tolerance))
        {
            return Some(format!("{file}: no recipe {recipe}: {:?}", reading.recipes));
        }
    }
    None
}

/// Whether a recipe has the expected contents; what is null may be there.
fn is_recipe(found: &Value, expected: &Value, tolerance: f64) -> bool {
    let is_near = |found: &Value, expected: &Value, relative: bool| match (found.as_f64(), expected.as_f64())
    {
        (Some(a), Some(b)) => (a - b).abs() <= tolerance * if relative { b.abs().max(1.0) } else { 1.0 },
        (None, Some(_)) => false,
        _ => true,
    };
    let numbers = ["cement_kg_m3", "water_kg_m3", "water_cement"];
    let fractions = ["air_volume_fraction", "aggregate_volume_fraction"];
    let aggregates = |of: &Value| of["aggregates"].as_array().cloned().unwrap_or_default();
    let (has, wants) = (aggregates(found), aggregates(expected));
    numbers.iter().all(|name| is_near(&found[name], &expected[name], true))
        && fractions.iter().all(|name| is_near(&found[name], &expected[name], false))
        && has.len() == wants.len()
        && has.iter().zip(&wants).all(|(a, b)| {
            is_near(&a["mass_kg_m3"], &b["mass_kg_m3"], true)
                && is_near(&a["density_kg_m3"], &b["density_kg_m3"], true)
        })
}

fn cases() -> Vec<Value> {
    serde_json::from_slice(&fs::read(folder().join("expected.json")).unwrap()).unwrap()
}

#[test]
fn every_table_of_the_collection_is_read_as_expected() {
    let differences: Vec<String> = cases().iter().filter_map(difference).collect();
    assert!(differences.is_empty(), "{} tables:\n{}", differences.len(), differences.join("\n"));
}

/// The cells of a text that one sign parts; `None` where it has quotes.
fn cells(text: &str, separator: char) -> Option<Vec<Vec<String>>> {
    (!text.contains('"'))
        .then(|| text.lines().map(|line| line.split(separator).map(str::to_owned).collect()).collect())
}

fn joined(rows: &[Vec<String>], separator: char) -> String {
    rows.iter().map(|row| row.join(&separator.to_string()) + "\n").collect()
}

/// The other decimal sign in each number.
fn with_other_sign(cell: &str) -> String {
    let characters: Vec<char> = cell.chars().collect();
    let is_digit = |at: Option<usize>| at.and_then(|at| characters.get(at)).is_some_and(char::is_ascii_digit);
    let swapped = characters.iter().enumerate().map(|(at, &c)| {
        let is_inside = is_digit(at.checked_sub(1)) && is_digit(Some(at + 1));
        match c {
            '.' if is_inside => ',',
            ',' if is_inside => '.',
            other => other,
        }
    });
    swapped.collect()
}

/// A percentage as a fraction, where the cell is a number.
fn as_fraction(cell: &str) -> String {
    let plain = cell.trim().replace(',', ".");
    plain
        .trim_end_matches(['%', ' '])
        .parse::<f64>()
        .map_or_else(|_| cell.to_owned(), |value| format!("{:.6}", value / 100.0))
}

#[test]
fn a_grading_printed_otherwise_is_the_same_curve_or_asks() {
    let mut tried = [0; 3];
    for case in cases() {
        let file = case["file"].as_str().unwrap();
        let is_one = matches!(case["verdict"].as_str().unwrap(), "ok" | "warn") && case["kind"] == "grading";
        let [expected] = case["curves"].as_array().unwrap().as_slice() else { continue };
        let Ok(text) = String::from_utf8(fs::read(folder().join(file)).unwrap()) else { continue };
        let separator = match Path::new(file).extension().and_then(|of| of.to_str()) {
            Some("tsv") => '\t',
            Some("csv") if text.contains(';') => ';',
            Some("csv") => ',',
            _ => continue,
        };
        if !is_one || !case["options"].as_object().unwrap().is_empty() {
            continue;
        }
        let text = text.replace("\r\n", "\n").replace('\r', "\n");
        let Some(rows) = cells(&text, separator) else { continue };
        let width = rows.iter().map(Vec::len).max().unwrap();
        let reversed: Vec<Vec<String>> = rows
            .iter()
            .map(|row| (0..width).rev().map(|at| row.get(at).cloned().unwrap_or_default()).collect())
            .collect();
        let mut ways = vec![(0, joined(&reversed, separator))];
        if separator != ',' {
            let of = |row: &Vec<String>| row.iter().map(|cell| with_other_sign(cell)).collect();
            ways.push((1, joined(&rows.iter().map(of).collect::<Vec<_>>(), separator)));
        }
        let of_parts = ["g (", "(g", "[g", " g", "kg", "gramm", "Masse", "lb"];
        let is_percent = rows.iter().any(|row| {
            row.get(1)
                .and_then(|cell| cell.trim().trim_end_matches(['%', ' ']).replace(',', ".").parse().ok())
                > Some(1.0)
        });
        if width == 2 && is_percent && !of_parts.iter().any(|unit| text.contains(unit)) {
            let of = |row: &Vec<String>| {
                row.iter()
                    .enumerate()
                    .map(|(at, cell)| if at == 1 { as_fraction(cell) } else { cell.clone() })
                    .collect()
            };
            let fractions: Vec<Vec<String>> = rows.iter().map(of).collect();
            // With the decimal sign of the table.
            let is_comma = separator != ',' && text.contains(',');
            let sign = |cell: &String| if is_comma { with_other_sign(cell) } else { cell.clone() };
            let fractions: Vec<Vec<String>> = fractions
                .iter()
                .map(|row| vec![row[0].clone(), row.get(1).map(sign).unwrap_or_default()])
                .collect();
            ways.push((2, joined(&fractions, separator)));
        }
        for (way, text) in ways {
            let reading = read(text.as_bytes(), &ReadOptions::default());
            let tolerance = case["tolerance"].as_f64().unwrap_or(5.0e-4) + 1.0e-6;
            let is_found =
                reading.curves.iter().any(|curve| has_points(&curve.points, &expected["points"], tolerance));
            assert!(is_found, "{file} {way}: {:?} {:#?}\n{text}", reading.notes, reading.curves);
            tried[way] += 1;
        }
    }
    assert!(tried.iter().all(|&count| count >= 5), "{tried:?}");
}

/// Inputs made of those of the collection: cut, doubled, mixed and with other characters.
fn mutated(bytes: &[u8], other: &[u8], random: &mut impl FnMut(usize) -> usize) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..=random(4) {
        let at = random(out.len() + 1);
        let end = (at + random(40)).min(out.len());
        match random(6) {
            0 => drop(out.drain(at..end)),
            1 => out
                .splice(at..at, other.iter().copied().skip(random(other.len() + 1)).take(60))
                .for_each(drop),
            2 => {
                let sign = b",;|\t\n\"'.<>&-%/0912 \xff\xe9\0"[random(20)];
                out.splice(at..at, [sign]).for_each(drop);
            }
            3 => {
                let part = out[at..end].to_vec();
                out.splice(at..at, part.repeat(1 + random(20))).for_each(drop);
            }
            4 => out.truncate(at),
            _ => out[at..end].reverse(),
        }
    }
    out
}

fn fuzz(count: usize) {
    let inputs: Vec<Vec<u8>> =
        cases().iter().map(|case| fs::read(folder().join(case["file"].as_str().unwrap())).unwrap()).collect();
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        if below == 0 { 0 } else { (state % below as u64) as usize }
    };
    let mut longest = std::time::Duration::ZERO;
    for _ in 0..count {
        let (first, second) = (random(inputs.len()), random(inputs.len()));
        let input = mutated(&inputs[first], &inputs[second], &mut random);
        let began = std::time::Instant::now();
        let reading = read(&input, &ReadOptions::default());
        longest = longest.max(began.elapsed());
        assert_eq!(reading.verdict == Verdict::Ask, !reading.candidates.is_empty());
        for curve in &reading.curves {
            assert!(curve.points.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[0][1] <= pair[1][1]));
            assert!(
                curve.points.last().unwrap()[1] == 1.0
                    && curve.points[0][1] >= 0.0
                    && curve.points[0][0] > 0.0
            );
        }
    }
    println!("{count} inputs, the longest took {longest:?}");
}

#[test]
fn damaged_inputs_have_an_answer() {
    fuzz(3000);
}

#[test]
#[ignore = "long: cargo test --release -p packstone-engine --test suite mixes -- --ignored --nocapture"]
fn a_hundred_thousand_damaged_inputs_have_an_answer() {
    fuzz(100_000);
}

#[test]
fn the_document_lists_every_grading() {
    let document =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/mixes.md")).unwrap();
    for name in Grading::types() {
        let is_listed =
            document.lines().any(|line| line.starts_with("| `") && line.contains(&format!("`{name}`")));
        assert!(is_listed, "{name}");
    }
    for (name, of) in Standard::NAMES {
        let names: Vec<String> =
            standard::of_standard(of).map(|grading| format!("`{}`", grading.name)).collect();
        assert!(document.contains(&format!("\n| `{name}` | {} |\n", names.join(", "))), "{name}: {names:?}");
    }
}
