//! What was understood of a table, as text.

use std::fmt::Write as _;
use std::path::Path;

use packstone_engine::blend::{Blend, BlendedAggregate, BlendedSieve};
use packstone_engine::importer::{Band, Candidate, Curve, Level, MixReading, Note, Recipe, Verdict};

/// A reading as text; `choices` has the option that chooses each candidate.
pub(super) fn of_reading(file: &Path, reading: &MixReading, choices: &[String]) -> String {
    let file = file.display();
    let MixReading { verdict, curves, bands, recipes, candidates, notes, .. } = reading;
    let mut text = match verdict {
        Verdict::Ok => format!("{file} has one reading\n"),
        Verdict::Warn => format!("{file} has one reading; see its warnings\n"),
        Verdict::Ask => format!("{file} has {} readings: choose one\n", candidates.len()),
        Verdict::Refuse => format!("{file} has no reading\n"),
    };
    if !candidates.is_empty() {
        text.push('\n');
        let row = |(i, candidate): (usize, &Candidate)| {
            let choice = choices.get(i).cloned().unwrap_or_default();
            vec![(i + 1).to_string(), candidate.label.clone(), choice]
        };
        text += &table(&[], &candidates.iter().enumerate().map(row).collect::<Vec<_>>(), 1);
    }
    for (i, candidate) in candidates.iter().enumerate() {
        let _ = writeln!(text, "\n{}: {}", i + 1, candidate.label);
        text += &candidate.curve.as_ref().map(of_curve).unwrap_or_default();
        text += &candidate.recipe.as_ref().map(of_recipe).unwrap_or_default();
    }
    // Those of the candidates are shown.
    if candidates.is_empty() {
        for curve in curves {
            let _ = write!(text, "\n{}", of_curve(curve));
        }
        for recipe in recipes {
            let _ = write!(text, "\n{}", of_recipe(recipe));
        }
    }
    for band in bands {
        let _ = write!(text, "\n{}", of_band(band));
    }
    if !notes.is_empty() {
        let _ = write!(text, "\n{}", of_notes(notes));
    }
    text
}

/// A blend as text: the shares, what passes each sieve, and the figures.
pub(super) fn of_blend(blend: &Blend) -> String {
    let share = |(number, aggregate): (usize, &BlendedAggregate)| {
        let name = aggregate.name.clone().unwrap_or_else(|| format!("number {}", number + 1));
        let by_mass = aggregate.mass_share.map(percent).unwrap_or_default();
        vec![percent(aggregate.share), by_mass, name]
    };
    let has_masses = blend.aggregates.iter().any(|aggregate| aggregate.mass_share.is_some());
    let heads = ["volume %", if has_masses { "mass %" } else { "" }, "aggregate"];
    let mut text = table(&heads, &blend.aggregates.iter().enumerate().map(share).collect::<Vec<_>>(), 2);
    let is_band = blend.sieves.iter().any(|sieve| sieve.target_low < sieve.target_high);
    let row = |sieve: &BlendedSieve| {
        let most = if is_band { vec![percent(sieve.target_high)] } else { Vec::new() };
        let first = vec![sieve.sieve_mm.to_string(), percent(sieve.target_low)];
        [first, most, vec![percent(sieve.passing), percent(sieve.residual)]].concat()
    };
    let heads: &[&str] = if is_band {
        &["sieve mm", "least %", "most %", "passing %", "outside %"]
    } else {
        &["sieve mm", "target %", "passing %", "residual %"]
    };
    let _ = write!(text, "\n{}", table(heads, &blend.sieves.iter().map(row).collect::<Vec<_>>(), 5));
    let _ = writeln!(
        text,
        "\nresidual: at most {} %, {} % root mean square",
        percent(blend.largest_residual),
        percent(blend.root_mean_square_residual)
    );
    if let Some(figures) = &blend.figures {
        let _ = writeln!(
            text,
            "fineness modulus {} (ASTM C125), k-value {} (DIN 1045-2), {} m2/m3 as spheres, packing density {} \
             (compaction index {}, residual packing density {})",
            rounded(figures.fineness_modulus, 2),
            rounded(figures.k_value, 2),
            rounded(figures.specific_surface_m2_m3, 0),
            rounded(figures.packing_density, 3),
            figures.packing_model.compaction_index,
            figures.packing_model.residual_packing_density
        );
    }
    text
}

/// A note with its place and weight.
pub(super) fn of_note(note: &Note) -> String {
    let Note { level, line, cell, text } = note;
    let place = match (cell, line) {
        (Some(cell), _) => format!("cell {cell}: "),
        (None, Some(line)) => format!("line {line}: "),
        (None, None) => String::new(),
    };
    let weight = match level {
        Level::Note => "",
        Level::Warning => "warning: ",
        Level::Fault => "fault: ",
    };
    format!("{weight}{place}{text}")
}

/// A value as a shell takes it.
pub(super) fn quoted(value: &str) -> String {
    if value.contains(['"', '$', '`', '\\', '!']) {
        format!("'{}'", value.replace('\'', r"'\''"))
    } else {
        format!("\"{value}\"")
    }
}

fn of_notes(notes: &[Note]) -> String {
    let lines: Vec<String> = notes.iter().map(|note| format!("  {}\n", of_note(note))).collect();
    lines.concat()
}

fn of_curve(curve: &Curve) -> String {
    let Curve { name, column, meaning, unit, points, completed, notes, .. } = curve;
    let name = name.as_ref().map(|name| format!(" {name}")).unwrap_or_default();
    let mut text = format!("curve{name}: column {column}, {}, sieves in {unit}\n", meaning.name());
    let row = |[mm, passing]: &[f64; 2]| {
        let added = if completed.contains(mm) { "added" } else { "" };
        vec![mm.to_string(), percent(*passing), added.to_owned()]
    };
    text += &table(&["sieve mm", "passing %", ""], &points.iter().map(row).collect::<Vec<_>>(), 2);
    text + &of_notes(notes)
}

fn of_band(band: &Band) -> String {
    let name = band.name.as_ref().map(|name| format!(" {name}")).unwrap_or_default();
    let row = |[mm, low, high]: &[f64; 3]| vec![mm.to_string(), percent(*low), percent(*high)];
    let rows: Vec<_> = band.points.iter().map(row).collect();
    format!("limits{name}\n{}", table(&["sieve mm", "least %", "most %"], &rows, 3))
}

fn of_recipe(recipe: &Recipe) -> String {
    let Recipe { name, cement_kg_m3, water_kg_m3, water_cement, air_volume_fraction, .. } = recipe;
    let name = name.as_ref().map(|name| format!(" {name}")).unwrap_or_default();
    let mut rows = Vec::new();
    let mut add = |what: &str, value: String, unit: &str, density: String| {
        rows.push(vec![what.to_owned(), value, unit.to_owned(), density]);
    };
    let mass = |kg: f64| rounded(kg, 1);
    let density = |density: Option<f64>| match density {
        Some(density) => format!("density {} kg/m3", rounded(density, 0)),
        None => "density unknown".to_owned(),
    };
    if let Some(kg) = cement_kg_m3 {
        add("cement", mass(*kg), "kg/m3", density(recipe.cement_density_kg_m3));
    }
    for addition in &recipe.additions {
        add(&addition.name, mass(addition.mass_kg_m3), "kg/m3", density(Some(addition.density_kg_m3)));
    }
    if let Some(kg) = water_kg_m3 {
        add("water", mass(*kg), "kg/m3", String::new());
    }
    if let Some(ratio) = water_cement {
        add("water/cement", rounded(*ratio, 3), "", String::new());
    }
    for aggregate in &recipe.aggregates {
        add(&aggregate.name, mass(aggregate.mass_kg_m3), "kg/m3", density(aggregate.density_kg_m3));
    }
    let of_volume = |part: &Option<f64>| part.map(percent);
    if let Some(air) = of_volume(air_volume_fraction) {
        add("air", air, "% of the volume", String::new());
    }
    if let Some(aggregate) = of_volume(&recipe.aggregate_volume_fraction) {
        add("all aggregate", aggregate, "% of the volume", String::new());
    }
    if let Some(sum) = recipe.volume_sum_m3 {
        add("sum of volumes", rounded(sum, 4), "m3 without air", String::new());
    }
    if let Some(air) = of_volume(&recipe.implied_air) {
        add("implied air", air, "% of the volume", String::new());
    }
    format!("recipe{name}\n{}{}", table(&[], &rows, 1), of_notes(&recipe.notes))
}

/// Columns below their heads: the first `right` of them end alike, the others begin alike. Of rows without a head the
/// first column is text.
fn table(heads: &[&str], rows: &[Vec<String>], right: usize) -> String {
    let heads: Vec<String> = heads.iter().map(|head| (*head).to_owned()).collect();
    let has_heads = !heads.is_empty();
    let lines: Vec<&Vec<String>> = has_heads.then_some(&heads).into_iter().chain(rows).collect();
    let columns = lines.iter().map(|line| line.len()).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = lines.iter().filter_map(|line| line.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let is_right = |column: usize| if has_heads { column < right } else { column == right };
    let line = |cells: &&Vec<String>| {
        let cells = cells.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
            if is_right(column) { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
        });
        format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    lines.iter().map(line).collect()
}

fn percent(share: f64) -> String {
    rounded(100.0 * share, 2)
}

/// A number with at most so many decimals.
fn rounded(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    if decimals == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').to_owned() }
}
