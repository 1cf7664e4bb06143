//! Finds Gmsh on this machine, and asks it for its version.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use packstone_engine::Unattended;
use packstone_engine::export::ExportError;

use super::folder::Folder;
use super::run;
use crate::programs::{ProgramLimits, on_path};

/// What starts the library of the Python package `gmsh` as the program.
const OF_MODULE: &str =
    "import sys, gmsh\ngmsh.initialize(['gmsh'] + sys.argv[1:], run=True)\ngmsh.finalize()";
/// Interpreters whose module is looked for.
const INTERPRETERS: [&str; 2] = ["python3", "python"];
/// Limits of the question for the version.
const OF_VERSION: ProgramLimits =
    ProgramLimits { time: Some(Duration::from_mins(1)), memory_bytes: Some(2 << 30) };
/// How to get Gmsh.
const ADVICE: &str = "install it (Debian and Ubuntu: apt install gmsh; Python: pip install gmsh; else https://gmsh.info), \
     or name it by --gmsh FILE or the variable PACKSTONE_GMSH; without it, format=geo and format=msh have the surfaces";

/// A way to start Gmsh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Program {
    /// A program.
    File(PathBuf),
    /// A Python with the module `gmsh`.
    Module(PathBuf),
}

impl Program {
    /// A command without arguments of Gmsh's.
    pub(super) fn command(&self) -> Command {
        match self {
            Self::File(file) => Command::new(file),
            Self::Module(python) => {
                let mut command = Command::new(python);
                command.args(["-c", OF_MODULE]);
                command
            }
        }
    }

    /// Its version, as `4.15.2`.
    fn version(&self) -> Result<String, ExportError> {
        let folder = Folder::new()?;
        let lines = run::run(self, &["--version"], &folder, OF_VERSION, &Unattended)?;
        let is_version = |word: &&str| {
            let starts = word.starts_with(|c: char| c.is_ascii_digit());
            starts
                && word.contains('.')
                && word.chars().all(|c| c.is_ascii_alphanumeric() || "._-+".contains(c))
        };
        let found = lines.iter().flat_map(|line| line.split_whitespace()).find(is_version);
        found.map(str::to_owned).ok_or_else(|| ExportError::Mesher("it states no version".into()))
    }
}

/// The Gmsh that is named (a program, or a Python with the module), or the first of this machine, with its version;
/// `own` is the Python that this process runs in.
///
/// # Errors
/// [`ExportError::Unavailable`].
pub(super) fn find(named: Option<&Path>, own: Option<&Path>) -> Result<(Program, String), ExportError> {
    if let Some(file) = named {
        // Gmsh runs in a folder of its own; a name without a folder is looked for on the PATH.
        let file = &if file.components().count() > 1 { std::path::absolute(file)? } else { file.to_owned() };
        let is_python = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("python"));
        let program =
            if is_python { Program::Module(file.to_owned()) } else { Program::File(file.to_owned()) };
        return match program.version() {
            Ok(version) => Ok((program, version)),
            Err(error) => Err(ExportError::Unavailable(format!(
                "tetrahedra and triangles are made by Gmsh, and {} cannot be used: {error}; {ADVICE}",
                file.display()
            ))),
        };
    }
    let mut faults = Vec::new();
    let files = on_path("gmsh".as_ref()).into_iter().map(Program::File);
    let modules =
        INTERPRETERS.iter().flat_map(|name| on_path(name.as_ref()).into_iter().take(1)).map(Program::Module);
    let own = own.map(|python| Program::Module(python.to_owned()));
    for program in own.into_iter().chain(files).chain(modules) {
        match (program.version(), &program) {
            (Ok(version), _) => return Ok((program, version)),
            (Err(error), Program::File(file)) => faults.push(format!("{}: {error}", file.display())),
            // A Python without the module is no fault.
            (Err(_), Program::Module(_)) => {}
        }
    }
    let faults = if faults.is_empty() { String::new() } else { format!(" ({})", faults.join("; ")) };
    Err(ExportError::Unavailable(format!(
        "tetrahedra and triangles are made by Gmsh, and none was found on this machine{faults}: {ADVICE}"
    )))
}
