//! Gmsh, the program that fills the surfaces of grains with tetrahedra, and cuts with triangles.
//!
//! It is found as `--gmsh` or `PACKSTONE_GMSH` names it, on the `PATH`, or as the module `gmsh` of `python3`, and runs
//! in a process of its own with limits of time and memory. What asks for them (the command line, the export
//! workers, the Python package) gives the engine [`Installed`].

mod find;
mod folder;
mod run;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::io::{BufWriter, Write as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use clap::Args;
use packstone_engine::Control;
use packstone_engine::export::{
    ExportError, ExportRequest, MeshDimension, Mesher, MesherFiles, MesherInput, SIZES, SURFACES,
};

use crate::memory;
use crate::programs::ProgramLimits;
use find::Program;
use folder::Folder;

/// Seconds of a run of Gmsh.
const DEFAULT_TIMEOUT_S: f64 = 3600.0;
/// Share of the machine's memory that a run of Gmsh may take.
const MEMORY_SHARE: f64 = 0.8;
/// Memory of a run where that of the machine is unknown.
const DEFAULT_MEMORY_BYTES: u64 = 8 << 30;
/// Time between two looks for a Gmsh where there was none.
const LOOK_AGAIN_AFTER: Duration = Duration::from_mins(1);
/// Name of the file of elements without its ending.
const FILLED: &str = "filled";
/// Name of the script.
const SCRIPT: &str = "fill.geo";

/// Options of commands that make tetrahedra and triangles.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct GmshOptions {
    /// Gmsh, which makes tetrahedra and triangles: the program, or a Python that has the module gmsh [default: `gmsh`
    /// on the PATH, else the module gmsh of python3]
    #[arg(long, env = "PACKSTONE_GMSH", value_name = "FILE")]
    gmsh: Option<PathBuf>,
    /// Longest run of Gmsh, in seconds [default: 3600]
    #[arg(long, env = "PACKSTONE_GMSH_TIMEOUT_S", value_name = "SECONDS", value_parser = seconds)]
    gmsh_timeout_s: Option<f64>,
    /// Most memory of a run of Gmsh, in MiB [default: four fifths of the machine's]
    #[arg(long, env = "PACKSTONE_GMSH_MEMORY_MIB", value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..))]
    gmsh_memory_mib: Option<u64>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is no number"))?;
    if value > 0.0 && value <= 1e7 { Ok(value) } else { Err(format!("{text} is out of range: 0 < s <= 1e7")) }
}

static OPTIONS: OnceLock<GmshOptions> = OnceLock::new();

/// The Python that the process runs in, where it is one.
static INTERPRETER: OnceLock<PathBuf> = OnceLock::new();

/// The program that was found, with its version.
static FOUND: Mutex<Option<(Program, String)>> = Mutex::new(None);

/// When [`version`] has found none.
static MISSED: Mutex<Option<Instant>> = Mutex::new(None);

/// Whether a worker process of this server has stated that it has Gmsh.
static ELSEWHERE: AtomicBool = AtomicBool::new(false);

/// The folder for the files of runs, in place of that of the system.
static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// Sets the options of the process, once.
pub(crate) fn set(options: GmshOptions) {
    let _ = OPTIONS.set(options);
}

/// Sets the folder for the files of runs, once.
pub(crate) fn set_folder(folder: PathBuf) {
    let _ = FOLDER.set(folder);
}

/// Names the Python that the process runs in: its module `gmsh` comes first where nothing else is named.
pub(crate) fn set_interpreter(python: PathBuf) {
    let _ = INTERPRETER.set(python);
}

/// The options of the process; where no command line has set them, those of the environment.
fn options() -> &'static GmshOptions {
    OPTIONS.get_or_init(|| {
        let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        GmshOptions {
            gmsh: variable("PACKSTONE_GMSH").map(PathBuf::from),
            gmsh_timeout_s: variable("PACKSTONE_GMSH_TIMEOUT_S").and_then(|text| seconds(&text).ok()),
            gmsh_memory_mib: variable("PACKSTONE_GMSH_MEMORY_MIB").and_then(|text| text.parse().ok()),
        }
    })
}

impl GmshOptions {
    fn limits(&self) -> ProgramLimits {
        let by_default = || {
            memory::total_bytes().map_or(DEFAULT_MEMORY_BYTES, |total| (total as f64 * MEMORY_SHARE) as u64)
        };
        let memory_bytes = self.gmsh_memory_mib.map_or_else(by_default, |mib| mib.saturating_mul(1 << 20));
        ProgramLimits {
            time: Some(Duration::from_secs_f64(self.gmsh_timeout_s.unwrap_or(DEFAULT_TIMEOUT_S))),
            memory_bytes: Some(memory_bytes),
        }
    }
}

/// Refuses an export that needs Gmsh where there is none.
///
/// # Errors
/// [`ExportError::Unavailable`]: how to install it.
pub(crate) fn check(export: &ExportRequest) -> Result<(), ExportError> {
    if export.needs_mesher() { Installed.version().map(|_| ()) } else { Ok(()) }
}

/// The same of an export that the request of a job names: a worker process that has Gmsh makes it as well.
///
/// # Errors
/// [`ExportError::Unavailable`]: how to install it.
pub(crate) fn check_of_job(export: &ExportRequest) -> Result<(), ExportError> {
    if ELSEWHERE.load(Ordering::Acquire) { Ok(()) } else { check(export) }
}

/// Says that a worker process of this server has Gmsh.
pub(crate) fn is_elsewhere() {
    ELSEWHERE.store(true, Ordering::Release);
}

/// The version of this machine's Gmsh, as reports have it; `None` where there is none. One that is installed later is
/// found a minute after a look at the latest. Starts a program: blocks the thread.
pub(crate) fn version() -> Option<String> {
    let missed = || MISSED.lock().unwrap_or_else(PoisonError::into_inner);
    if missed().is_some_and(|at| at.elapsed() < LOOK_AGAIN_AFTER) {
        return None;
    }
    let found = Installed.version().ok();
    *missed() = found.is_none().then(Instant::now);
    found
}

/// What decides the bytes of an export beside the packing, its options and this program: the version of Gmsh.
pub(crate) fn key_of(export: &ExportRequest) -> Option<String> {
    export.needs_mesher().then(|| Installed.version().unwrap_or_else(|_| "none".into()))
}

/// The Gmsh of this machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Installed;

impl Installed {
    fn found() -> Result<(Program, String), ExportError> {
        let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = &*found {
            return Ok(known.clone());
        }
        // One that was not found may be installed while the process runs.
        Ok(found
            .insert(find::find(options().gmsh.as_deref(), INTERPRETER.get().map(PathBuf::as_path))?)
            .clone())
    }
}

impl Mesher for Installed {
    fn version(&self) -> Result<String, ExportError> {
        Ok(format!("Gmsh {}", Self::found()?.1))
    }

    fn fill(
        &self,
        mut input: MesherInput<'_>,
        control: &dyn Control,
    ) -> Result<Box<dyn MesherFiles>, ExportError> {
        let (program, _) = Self::found()?;
        fill(&program, options().limits(), &mut input, control)
    }
}

/// Runs a program on a script and the surfaces.
fn fill(
    program: &Program,
    limits: ProgramLimits,
    input: &mut MesherInput<'_>,
    control: &dyn Control,
) -> Result<Box<dyn MesherFiles>, ExportError> {
    let folder = Folder::new()?;
    if let Some(write) = &mut input.surfaces {
        let mut surfaces = BufWriter::new(folder.create(SURFACES)?);
        write(&mut surfaces)?;
        surfaces.flush()?;
    }
    folder.create(SCRIPT)?.write_all(input.script.as_bytes())?;
    if let Some(sizes) = input.sizes {
        folder.create(SIZES)?.write_all(sizes)?;
    }
    let file = format!("{FILLED}.msh");
    let dimension = match input.dimension {
        MeshDimension::Plane => "-2",
        MeshDimension::Solid => "-3",
    };
    run::run(program, &[dimension, SCRIPT, "-o", &file, "-bin", "-nt", "1"], &folder, limits, control)?;
    folder.expect(&file)?;
    if let Some(ending) = input.also {
        let other = format!("{FILLED}.{ending}");
        run::run(program, &[&file, "-save", "-o", &other], &folder, limits, control)?;
        folder.expect(&other)?;
    }
    Ok(Box::new(folder))
}
