//! `packstone check FILE`: what the check of the engine finds in a packing that lies in a file.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;
use packstone_engine::analysis::quality::{QualityError, QualityReport, quality};
use packstone_engine::check::{Fault, Gaps};
use packstone_engine::packing::{ClassReport, GrainsRef};
use packstone_engine::request::{Distance, Specimen};
use serde::Serialize;

use super::exit::{Exit, Failure};
use super::input::Input;
use super::packing_file::{self, PackingFile, UntilStopped};
use super::print;
use super::signals::stop_on_signals;
use crate::config::cores;

/// How a packing is checked.
#[derive(Args)]
pub(super) struct PackingOptions {
    /// Job by whose specimen, distance and mix a packing is checked; a table of grains needs it
    #[arg(long, value_name = "JOB.json")]
    specimen: Option<PathBuf>,
    /// Print the figures of the export `quality` too
    #[arg(long)]
    figures: bool,
    /// Print what was found in a packing as a JSON object
    #[arg(long)]
    json: bool,
    /// Threads that check a packing [default: one for each core]
    #[arg(long, value_name = "NUMBER")]
    threads: Option<NonZeroUsize>,
    #[command(flatten)]
    input: Input,
}

/// What was found in a packing.
#[derive(Serialize)]
struct Found<'a> {
    file: String,
    /// What its grains are.
    kind: &'static str,
    grains: usize,
    specimen: &'a Specimen,
    /// The rule that the gaps were checked by.
    distance: &'a Distance,
    volume_fraction: f64,
    d_min_mm: f64,
    d_max_mm: f64,
    /// Smallest gap between two grains; `null` where there is one grain only.
    min_gap_mm: Option<f64>,
    /// Rows of these grains, counted from 0.
    min_gap_grains: Option<[usize; 2]>,
    /// Smallest excess of a gap over the required one.
    min_excess_gap_mm: Option<f64>,
    /// Smallest gap to a wall; `null` in a periodic box.
    min_wall_gap_mm: Option<f64>,
    /// Row of that grain.
    min_wall_gap_grain: Option<usize>,
    pairs_checked: u64,
    /// `null` where no mix is known.
    grading: Option<Grading<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<QualityReport>,
}

/// Whether the grains are those of the mix.
#[derive(Serialize)]
struct Grading<'a> {
    agrees: bool,
    /// Where they are not.
    fault: Option<String>,
    max_class_mass_error: Option<f64>,
    classes: &'a [ClassReport],
}

impl PackingOptions {
    /// Whether any of them is given, which are for packings alone.
    pub(super) fn are_given(&self) -> bool {
        self.specimen.is_some() || self.figures || self.json || self.threads.is_some()
    }

    /// Checks the packing of a file and prints what was found.
    pub(super) fn check(&self, file: &Path) -> Result<(), Failure> {
        let stop = stop_on_signals()?;
        let threads = self.threads.unwrap_or_else(cores);
        let packing = packing_file::read(file, self.specimen.as_deref(), &self.input, threads, &stop)?;
        let quality = if self.figures {
            let report = quality(&packing.grains, packing.specimen(), &UntilStopped(&stop));
            Some(report.map_err(|error| match error {
                QualityError::Stopped => Exit::Interrupted.because(error),
                QualityError::OutOfMemory(_) => Exit::Machine.because(error),
            })?)
        } else {
            None
        };
        let found = found(file, &packing, quality);
        if self.json {
            return print(&format!("{}\n", serde_json::to_string_pretty(&found)?));
        }
        print(&text(&found)?)
    }
}

fn found<'a>(file: &Path, packing: &'a PackingFile, quality: Option<QualityReport>) -> Found<'a> {
    let grains = GrainsRef::from(&packing.grains);
    let Gaps { min_gap_mm, closest, min_excess_gap_mm, min_wall_gap_mm, closest_to_wall, pairs_checked } =
        packing.found.gaps;
    // The sum of no numbers is minus zero.
    let volumes_mm3 = grains.diameters_mm().map(|d| std::f64::consts::FRAC_PI_6 * d * d * d);
    let volume_mm3 = volumes_mm3.sum::<f64>() + 0.0;
    let grading = packing.has_mix.then(|| match &packing.found.grading {
        Ok(check) => Grading {
            agrees: true,
            fault: None,
            max_class_mass_error: Some(check.found.max_class_mass_error),
            classes: &check.classes,
        },
        Err(fault) => {
            let fault = Some(match fault {
                Fault::Grading(detail) => detail.clone(),
                other => other.to_string(),
            });
            Grading { agrees: false, fault, max_class_mass_error: None, classes: &[] }
        }
    });
    Found {
        file: file.display().to_string(),
        kind: grains.kind().noun(),
        grains: grains.len(),
        specimen: packing.specimen(),
        distance: &packing.request.distance,
        volume_fraction: volume_mm3 / packing.specimen().volume_mm3(),
        d_min_mm: grains.diameters_mm().next_back().unwrap_or(0.0),
        d_max_mm: grains.diameters_mm().next().unwrap_or(0.0),
        min_gap_mm,
        min_gap_grains: closest.map(|pair| {
            let [a, b] = pair.map(|grain| packing.row(grain));
            [a.min(b), a.max(b)]
        }),
        min_excess_gap_mm,
        min_wall_gap_mm,
        min_wall_gap_grain: closest_to_wall.map(|grain| packing.row(grain)),
        pairs_checked,
        grading,
        quality,
    }
}

/// The same as text.
fn text(found: &Found<'_>) -> Result<String, Failure> {
    let mut text = String::new();
    let Found { file, kind, grains, volume_fraction, d_min_mm, d_max_mm, pairs_checked, .. } = found;
    writeln!(
        text,
        "{file}: {grains} {kind} of {d_min_mm:.4} to {d_max_mm:.4} mm, volume fraction {volume_fraction:.4}"
    )?;
    match (found.min_gap_mm, found.min_gap_grains) {
        (Some(gap), Some([first, second])) if first == second => {
            writeln!(text, "smallest gap: {gap} mm, of grain {first} and its own periodic image")?;
        }
        (Some(gap), Some([first, second])) => {
            writeln!(text, "smallest gap: {gap} mm, of grains {first} and {second}")?;
        }
        _ => writeln!(text, "smallest gap: none, for there are no two grains")?,
    }
    if let Some(excess) = found.min_excess_gap_mm {
        writeln!(text, "smallest excess over the required gap: {excess} mm")?;
    }
    match (found.min_wall_gap_mm, found.min_wall_gap_grain) {
        (Some(gap), Some(grain)) => writeln!(text, "smallest gap to a wall: {gap} mm, of grain {grain}")?,
        _ => writeln!(text, "smallest gap to a wall: none, for there is no grain or no wall")?,
    }
    match &found.grading {
        None => writeln!(text, "grading: not judged, for no mix is known")?,
        Some(Grading { fault: Some(fault), .. }) => {
            writeln!(text, "grading: the grains are not those of the mix: {fault}")?;
        }
        Some(Grading { max_class_mass_error, classes, .. }) => {
            let error = 100.0 * max_class_mass_error.unwrap_or_default();
            writeln!(
                text,
                "grading: that of the mix, each class within {error:.2} % of the mass of all grains"
            )?;
            for class in *classes {
                let ClassReport { d_min_mm, d_max_mm, grains, volume_mm3, target_volume_mm3 } = class;
                writeln!(
                    text,
                    "  {d_min_mm} to {d_max_mm} mm: {grains} grains, {volume_mm3:.2} mm3 of {target_volume_mm3:.2}"
                )?;
            }
        }
    }
    if let Some(quality) = &found.quality {
        writeln!(text, "quality: {}", serde_json::to_string_pretty(quality)?)?;
    }
    writeln!(text, "{pairs_checked} pairs checked: no fault was found")?;
    Ok(text)
}
