//! `packstone solve`: CalculiX on a deck, and what follows from its results.

use std::fs;
use std::io::{self, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use packstone_engine::export::deck::{Load, MODEL, Solver, unpack};
use packstone_engine::export::{ExportError, ExportRequest};
use packstone_engine::solution::{BALANCE, Results, ResultsError, Solution};

use super::bar::Bar;
use super::exit::{Exit, Failure, cannot_be};
use super::exports::{self, Watch};
use super::outputs::refuse_existing;
use super::signals::stop_on_signals;
use super::unfinished::Unfinished;
use super::{print, print_files};
use crate::atomic_file::write_buffered;
use crate::config::{cores, seconds_or_none};
use crate::local::calculix::{self, CalculixError};
use crate::programs::ProgramLimits;
use crate::telemetry::say;

/// What is computed, as JSON.
const SOLUTION: &str = "solution.json";
/// The fields.
const FIELDS: &str = "solution.vtu";

/// Options of `packstone solve`.
#[derive(Args)]
pub(super) struct Options {
    /// A deck for CalculiX: the zip that the export `deck` writes, or a folder with its files
    deck: PathBuf,
    /// Folder for the files of the deck and the results; made where it is missing [default: the name of the zip
    /// without its ending; the folder of the deck]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
    /// Overwrite files that exist
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    calculix: Calculix,
}

/// How CalculiX is run.
#[derive(Args)]
pub(super) struct Calculix {
    /// The program of CalculiX [default: ccx on PATH]
    #[arg(long, value_name = "PATH")]
    ccx: Option<PathBuf>,
    /// Threads of CalculiX [default: one for each core]
    #[arg(long, value_name = "NUMBER")]
    ccx_threads: Option<NonZeroUsize>,
    /// Seconds that CalculiX may take; 0 sets no limit
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = seconds_or_none)]
    ccx_timeout_s: f64,
    /// MiB of memory that CalculiX may take [default: no limit]
    #[arg(long, value_name = "MIB")]
    ccx_memory_mib: Option<u64>,
}

impl Calculix {
    /// Finds the program.
    ///
    /// # Errors
    /// It is not installed, with what to do.
    pub(super) fn find(&self) -> Result<PathBuf, Failure> {
        calculix::find(self.ccx.as_deref()).map_err(|error| failure(&error))
    }

    fn limits(&self) -> ProgramLimits {
        let time = (self.ccx_timeout_s > 0.0).then(|| Duration::from_secs_f64(self.ccx_timeout_s));
        ProgramLimits { time, memory_bytes: self.ccx_memory_mib.map(|mib| mib.saturating_mul(1 << 20)) }
    }
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let stop = stop_on_signals()?;
    let deck = Deck::at(&options.deck, options.out.as_deref());
    let solved = deck.solve(&options.calculix, options.force, &stop)?;
    if options.json {
        return print(&fs::read_to_string(&solved.files[0])?);
    }
    solved.print()
}

/// The options of a deck as `packstone run --solve` has them.
pub(super) fn parse(options: &str) -> Result<ExportRequest, String> {
    let request = exports::parse(&format!("deck:{options}"))?;
    match &request {
        ExportRequest::Deck(deck) if deck.case.solver == Solver::Calculix => Ok(request),
        _ => {
            Err("--solve runs CalculiX: leave solver out, and make a deck for Abaqus by --export deck".into())
        }
    }
}

/// A deck, and where its results go.
pub(super) struct Deck {
    deck: PathBuf,
    folder: PathBuf,
}

/// What was computed of a deck.
pub(super) struct Solved {
    solution: Solution,
    files: Vec<PathBuf>,
}

impl Deck {
    /// A zip, whose files go into a folder beside it, or a folder; or into another folder.
    pub(super) fn at(deck: &Path, out: Option<&Path>) -> Self {
        let beside = || if deck.is_dir() { deck.to_owned() } else { deck.with_extension("") };
        Self { deck: deck.to_owned(), folder: out.map_or_else(beside, Path::to_owned) }
    }

    /// Whether its results are there.
    pub(super) fn is_solved(&self) -> bool {
        self.folder.join(SOLUTION).exists()
    }

    /// Runs CalculiX, and writes what follows.
    ///
    /// # Errors
    /// The deck cannot be read or is for another solver; files exist; CalculiX is missing or fails.
    pub(super) fn solve(
        &self,
        calculix: &Calculix,
        force: bool,
        stop: &Arc<AtomicBool>,
    ) -> Result<Solved, Failure> {
        let files = [SOLUTION, FIELDS].map(|name| self.folder.join(name)).to_vec();
        let unfinished = Unfinished::beside(&files[0]);
        let record = unfinished.read()?;
        let of_record = |file: &&PathBuf| record.as_ref().is_some_and(|record| record.names(file));
        let ccx = calculix.find()?;
        let texts = self.texts()?;
        let unpacked: Vec<PathBuf> = if self.is_in_place() {
            Vec::new()
        } else {
            texts.iter().map(|(name, _)| self.folder.join(name)).collect()
        };
        let all: Vec<PathBuf> = files.iter().chain(&unpacked).cloned().collect();
        refuse_existing(all.iter().filter(|file| !of_record(file)), force)?;
        let text = |name: &str| {
            let found = texts.iter().find(|(file, _)| file == name);
            let found = found.and_then(|(_, bytes)| std::str::from_utf8(bytes).ok());
            found.ok_or_else(|| self.refused(format_args!("it has no {name}: it is no deck of Packstone")))
        };
        let results = Results::of_deck(text("deck.json")?, text("mesh.inp")?)
            .map_err(|error| self.refused(format_args!("{error}")))?;
        if results.deck().solver != Solver::Calculix {
            let solver = results.deck().solver.title();
            return Err(self.refused(format_args!(
                "it is for {solver}; its README says how to run it, and solver=calculix makes one for CalculiX"
            )));
        }
        fs::create_dir_all(&self.folder).map_err(|error| cannot_be("made", &self.folder, &error))?;
        unfinished.begin(&all, None)?;
        for (file, (_, bytes)) in unpacked.iter().zip(&texts) {
            write_buffered(file, |out| out.write_all(bytes))
                .map_err(|error: io::Error| cannot_be("written", file, &error))?;
        }
        drop(texts);
        self.run_calculix(&ccx, calculix, stop)?;
        let solution = self.read_back(&results, &files, stop)?;
        unfinished.end()?;
        Ok(Solved { solution, files })
    }

    fn is_in_place(&self) -> bool {
        self.deck.is_dir() && self.folder == self.deck
    }

    fn refused(&self, why: std::fmt::Arguments<'_>) -> Failure {
        Exit::BadInput.because(format_args!("{} is refused: {why}", self.deck.display()))
    }

    /// The files of the deck with their names.
    fn texts(&self) -> Result<Vec<(String, Vec<u8>)>, Failure> {
        let mut texts = Vec::new();
        let cannot = |error: io::Error| cannot_be("read", &self.deck, &error);
        if self.deck.is_dir() {
            for entry in fs::read_dir(&self.deck).map_err(cannot)? {
                let entry = entry.map_err(cannot)?;
                let Ok(name) = entry.file_name().into_string() else { continue };
                if name == "deck.json" || name == "README.txt" || name.rsplit('.').next() == Some("inp") {
                    texts.push((name, fs::read(entry.path()).map_err(cannot)?));
                }
            }
            return Ok(texts);
        }
        let zip = fs::read(&self.deck).map_err(cannot)?;
        unpack(&zip, |name, content| {
            let mut bytes = Vec::new();
            content.read_to_end(&mut bytes)?;
            texts.push((name.to_owned(), bytes));
            Ok(())
        })
        .map_err(|error| self.refused(format_args!("{error}")))?;
        Ok(texts)
    }

    fn run_calculix(&self, ccx: &Path, options: &Calculix, stop: &Arc<AtomicBool>) -> Result<(), Failure> {
        // What an earlier run wrote must not be read as the results of this one.
        for name in [&format!("{MODEL}.dat"), &format!("{MODEL}.frd"), "spooles.out"] {
            let file = self.folder.join(name);
            match fs::remove_file(&file) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(cannot_be("removed", &file, &error));
                }
                _ => {}
            }
        }
        let bar = Bar::new();
        let ran = calculix::run(
            ccx,
            &self.folder,
            options.ccx_threads.unwrap_or_else(cores),
            options.limits(),
            || stop.load(Ordering::Acquire),
            |fraction, step| bar.show(fraction, || format!("CalculiX: {step}")),
        );
        bar.finish();
        ran.map_err(|error| failure(&error))
    }

    /// Reads the results of CalculiX, and writes the properties and the fields.
    fn read_back(
        &self,
        results: &Results,
        files: &[PathBuf],
        stop: &Arc<AtomicBool>,
    ) -> Result<Solution, Failure> {
        let text = |ending: &str| {
            let file = self.folder.join(format!("{MODEL}.{ending}"));
            fs::read_to_string(&file).map_err(|error| cannot_be("read", &file, &error))
        };
        let unusable =
            |error: &dyn std::fmt::Display| Exit::Program.because(format_args!("CalculiX: {error}"));
        let solution = results.solution(&text("dat")?).map_err(|error| unusable(&error))?;
        let json = serde_json::to_string_pretty(&solution)? + "\n";
        let frd = text("frd")?;
        let watch = Watch { bar: Bar::new(), what: "fields", stop };
        let written = write_buffered(&files[1], |out| results.write_vtu(&frd, None, &watch, out));
        watch.bar.finish();
        written.map_err(|error| match error {
            ResultsError::Solution(error) => unusable(&error),
            ResultsError::Export(error @ ExportError::Stopped) => Exit::Interrupted.because(error),
            ResultsError::Export(ExportError::Write(error)) => cannot_be("written", &files[1], &error),
            ResultsError::Export(error) => Exit::of_export(&error).because(error),
        })?;
        write_buffered(&files[0], |out| out.write_all(json.as_bytes()))
            .map_err(|error: io::Error| cannot_be("written", &files[0], &error))?;
        if solution.imbalance > BALANCE {
            say(&format!(
                "warning: the reactions are out of balance by {:.1e} of their sum, {BALANCE:e} are allowed: an iterative \
                 solver is not exact, the deck names SPOOLES",
                solution.imbalance
            ));
        }
        Ok(solution)
    }
}

impl Solved {
    /// Prints the properties and the names of the files.
    pub(super) fn print(&self) -> Result<(), Failure> {
        let solution = &self.solution;
        let mut lines: Vec<(String, String)> = Vec::new();
        if let (Some(e), Some(axis)) = (solution.youngs_modulus_gpa, solution.load.axis()) {
            lines.push((format!("Young's modulus along {}", ["x", "y", "z"][axis]), format!("{e:.5} GPa")));
        }
        if let Some(ratios) = &solution.poissons_ratios {
            let ratios: Vec<String> = ratios.iter().map(|ratio| format!("{ratio:.5}")).collect();
            lines.push(("Poisson's ratio".into(), ratios.join(", ")));
        }
        if let Some(g) = solution.shear_modulus_gpa {
            lines.push(("Shear modulus".into(), format!("{g:.5} GPa")));
        }
        if let Some(expansion) = &solution.expansion_1_k {
            let expansion: Vec<String> = expansion.iter().map(|alpha| format!("{alpha:.5e}")).collect();
            lines.push(("Coefficient of expansion".into(), format!("{} 1/K", expansion.join(", "))));
        }
        if solution.load != Load::Temperature {
            for reaction in &solution.reactions_n {
                let [x, y, z] = reaction.force_n;
                lines
                    .push((format!("Reaction on {}", reaction.face), format!("{x:.6e}, {y:.6e}, {z:.6e} N")));
            }
            lines.push(("Imbalance of the reactions".into(), format!("{:.1e}", solution.imbalance)));
        }
        let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or_default();
        let lines: Vec<String> =
            lines.iter().map(|(name, value)| format!("{name:width$}  {value}\n")).collect();
        let text = lines.concat();
        print(&text)?;
        print_files(&self.files)
    }
}

fn failure(error: &CalculixError) -> Failure {
    let exit = match error {
        CalculixError::Missing(_) | CalculixError::Failed { .. } => Exit::Program,
        CalculixError::NotStarted(error) => Exit::of_io(error),
        CalculixError::Stopped => Exit::Interrupted,
        CalculixError::TimedOut(_) => Exit::TargetNotReached,
        CalculixError::OutOfMemory(_) => Exit::Machine,
    };
    exit.because(error)
}
