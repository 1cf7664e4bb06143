//! The module `packstone._native`: [`packstone_server::local`] and the command line for Python.
//!
//! It converts arguments, errors and arrays, hands progress on, and lets Python run other threads meanwhile. Requests,
//! reports and refusals pass as JSON texts.
#![deny(unsafe_code)]

use std::ffi::OsString;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use numpy::{PyArray1, PyArrayMethods as _};
use packstone_server::local::{self, Ended, Job, Packed, Run};
use pyo3::exceptions::{PyException, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// How often progress is handed on and signals are looked for, while work runs.
const ATTEND_EVERY: Duration = Duration::from_millis(100);

pyo3::create_exception!(packstone._native, Refused, PyException, "A refusal: a problem document as JSON.");
pyo3::create_exception!(packstone._native, Stopped, PyException, "The work was stopped.");

/// A packing in memory.
#[pyclass(frozen, module = "packstone._native")]
struct Packing {
    packed: Packed,
}

#[pymethods]
impl Packing {
    /// Makes a packing again from the bytes of `store`.
    #[staticmethod]
    fn restore(py: Python<'_>, stored: &[u8]) -> PyResult<Self> {
        let packed = py.detach(|| Packed::restore(stored)).map_err(raised)?;
        Ok(Self { packed })
    }

    /// Returns the packing as bytes.
    fn store<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let stored = py.detach(|| self.packed.store()).map_err(raised)?;
        Ok(PyBytes::new(py, &stored))
    }

    /// Returns everything but the grains, as JSON.
    fn summary(&self) -> PyResult<String> {
        self.packed.report().map_err(raised)
    }

    /// Returns the names of the columns of the grains.
    fn columns(&self) -> Vec<&'static str> {
        self.packed.column_names()
    }

    /// Returns the grains: one row a grain, in column-major order.
    fn grains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (values, columns) = py.detach(|| self.packed.columns()).map_err(raised)?;
        let columns = PyArray1::from_vec(py, values).reshape([columns, self.packed.len()])?;
        columns.call_method0("transpose")
    }

    /// Writes the grains as a file.
    fn table(&self, py: Python<'_>, format: &str, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.packed.save_table(format, &path)).map_err(raised)
    }

    /// Returns the grains as the content of a file.
    fn table_bytes<'py>(&self, py: Python<'py>, format: &str) -> PyResult<Bound<'py, PyBytes>> {
        let mut content = Vec::new();
        py.detach(|| self.packed.write_table(format, &mut content)).map_err(raised)?;
        Ok(PyBytes::new(py, &content))
    }

    /// Writes an export as a file; returns its report as JSON.
    fn export(&self, py: Python<'_>, r#type: &str, options: &str, path: PathBuf) -> PyResult<String> {
        let run = Run::default();
        attended(py, &run, None, || self.packed.save_export(r#type, options, &run, &path))
    }

    /// Returns a plot as SVG.
    fn plot(&self, py: Python<'_>, kind: &str, title: bool, theme: &str) -> PyResult<String> {
        py.detach(|| self.packed.plot(kind, title, theme)).map_err(raised)
    }

    /// Returns a picture with one octant removed, as PNG.
    fn picture<'py>(&self, py: Python<'py>, pixels: u32) -> PyResult<Bound<'py, PyBytes>> {
        let run = Run::default();
        let png = attended(py, &run, None, || self.packed.picture(pixels, &run))?;
        Ok(PyBytes::new(py, &png))
    }

    fn __len__(&self) -> usize {
        self.packed.len()
    }
}

/// Packs a job.
#[pyfunction]
#[pyo3(signature = (request, *, max_grains=None, checkpoint=None, checkpoint_every_s=30.0, on_progress=None))]
fn pack(
    py: Python<'_>,
    request: &str,
    max_grains: Option<u64>,
    checkpoint: Option<PathBuf>,
    checkpoint_every_s: f64,
    on_progress: Option<Py<PyAny>>,
) -> PyResult<Packing> {
    let every = Duration::try_from_secs_f64(checkpoint_every_s).map_err(|_| {
        PyValueError::new_err(format!(
            "checkpoint_every_s is {checkpoint_every_s}: must be a time in s, at least 0"
        ))
    })?;
    let job = py.detach(|| Job::read(request, max_grains, checkpoint.as_deref())).map_err(raised)?;
    let run = Run::with_checkpoint_every(every);
    let packed = attended(py, &run, on_progress.as_ref(), || job.pack(&run))?;
    Ok(Packing { packed })
}

/// Returns what a job amounts to, as JSON.
#[pyfunction]
#[pyo3(signature = (request, max_grains=None))]
fn plan(py: Python<'_>, request: &str, max_grains: Option<u64>) -> PyResult<String> {
    py.detach(|| Job::read(request, max_grains, None)?.plan()).map_err(raised)
}

/// Returns what was understood of a grading or a recipe, as JSON.
#[pyfunction]
#[pyo3(signature = (table, *, sheet=None, curve=None, column=None, unit=None))]
fn read_mix(
    py: Python<'_>,
    table: &[u8],
    sheet: Option<String>,
    curve: Option<String>,
    column: Option<String>,
    unit: Option<String>,
) -> PyResult<String> {
    py.detach(|| local::read_mix(table, sheet, curve, column, unit)).map_err(raised)
}

/// Returns a blend of stockpiles, as JSON.
#[pyfunction]
fn blend_mix(py: Python<'_>, request: &str) -> PyResult<String> {
    py.detach(|| local::blend_mix(request)).map_err(raised)
}

/// Returns what belongs beside the file of an export, as the script of a mesh: what its name adds, and its text.
#[pyfunction]
fn companion(r#type: &str, options: &str, file_name: &str) -> PyResult<Option<(&'static str, String)>> {
    local::companion(r#type, options, file_name).map_err(raised)
}

/// A study whose runs Python executes.
#[pyclass(frozen, module = "packstone._native")]
struct Study {
    study: local::Study,
}

#[pymethods]
impl Study {
    #[new]
    fn new(py: Python<'_>, study: &str) -> PyResult<Self> {
        let study = py.detach(|| local::Study::read(study)).map_err(raised)?;
        Ok(Self { study })
    }

    /// Returns the study with its points and its runs, as JSON.
    fn runs(&self, py: Python<'_>) -> PyResult<String> {
        py.detach(|| self.study.runs()).map_err(raised)
    }

    /// Counts a run that ended; whether no further run of its point is to be started.
    fn count(&self, point: usize, outcome: &str) -> PyResult<bool> {
        self.study.count(point, outcome).map_err(raised)
    }

    /// Returns the table of the runs that have ended, as JSON or CSV.
    fn table(&self, py: Python<'_>, records: &str, format: &str) -> PyResult<String> {
        py.detach(|| self.study.table(records, format)).map_err(raised)
    }

    /// Returns a plot of the table as SVG.
    #[pyo3(signature = (kind, records, *, x=None, log_x=None, title=true, theme="light"))]
    // As many as the plot has options.
    #[allow(clippy::too_many_arguments)]
    fn plot(
        &self,
        py: Python<'_>,
        kind: &str,
        records: &str,
        x: Option<&str>,
        log_x: Option<bool>,
        title: bool,
        theme: &str,
    ) -> PyResult<String> {
        py.detach(|| self.study.plot(kind, records, x, log_x, title, theme)).map_err(raised)
    }
}

/// Packs the request of a run of a study; its record as JSON, and the packing if there is one.
#[pyfunction]
#[pyo3(signature = (request, on_progress=None))]
fn run_of_study(
    py: Python<'_>,
    request: &str,
    on_progress: Option<Py<PyAny>>,
) -> PyResult<(String, Option<Packing>)> {
    let run = Run::default();
    let work = || local::run_of_study(request, &run);
    let (record, packed) = attended(py, &run, on_progress.as_ref(), work)?;
    Ok((record, packed.map(|packed| Packing { packed })))
}

/// Runs a command line, of which the first is the name of the program; returns the exit code.
#[pyfunction]
fn main(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| packstone_server::main(args))
}

/// Does work on a thread of its own, while this one hands on the progress and lets Python handle signals. What either
/// raises stops the work.
fn attended<T: Send>(
    py: Python<'_>,
    run: &Run,
    on_progress: Option<&Py<PyAny>>,
    work: impl FnOnce() -> Result<T, Ended> + Send,
) -> PyResult<T> {
    thread::scope(|scope| {
        let (at_end, mut until_end) = mpsc::channel::<()>();
        let working = scope.spawn(move || {
            // Nothing is ever sent: it goes when the work ends, however it ends.
            let _at_end = at_end;
            work()
        });
        let mut interrupted = None;
        loop {
            let until_end = &mut until_end;
            let has_ended =
                py.detach(move || until_end.recv_timeout(ATTEND_EVERY)) != Err(RecvTimeoutError::Timeout);
            if interrupted.is_none()
                && let Err(error) = attend(py, run, on_progress)
            {
                run.stop();
                interrupted = Some(error);
            }
            if has_ended {
                break;
            }
        }
        let ended = working.join().unwrap_or_else(|panic| resume_unwind(panic));
        match interrupted {
            Some(error) => Err(error),
            None => ended.map_err(raised),
        }
    })
}

fn attend(py: Python<'_>, run: &Run, on_progress: Option<&Py<PyAny>>) -> PyResult<()> {
    py.check_signals()?;
    if let Some(fault) = run.take_fault() {
        let message = std::ffi::CString::new(fault).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, 2)?;
    }
    if let (Some(on_progress), Some(progress)) = (on_progress, run.take_progress()) {
        on_progress.call1(py, (progress,))?;
    }
    Ok(())
}

fn raised(ended: Ended) -> PyErr {
    match ended {
        Ended::Refused(document) => Refused::new_err(document),
        Ended::Stopped => Stopped::new_err("the work was stopped"),
        Ended::Io(error) => error.into(),
    }
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Refused", py.get_type::<Refused>())?;
    module.add("Stopped", py.get_type::<Stopped>())?;
    // Tetrahedra are made by the module gmsh of this interpreter, where it has one.
    let python = py.import("sys").ok().and_then(|sys| sys.getattr("executable").ok());
    if let Some(python) = python.and_then(|python| python.extract::<PathBuf>().ok()) {
        local::set_interpreter(python);
    }
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<Packing>()?;
    module.add_function(wrap_pyfunction!(pack, module)?)?;
    module.add_function(wrap_pyfunction!(plan, module)?)?;
    module.add_function(wrap_pyfunction!(read_mix, module)?)?;
    module.add_function(wrap_pyfunction!(blend_mix, module)?)?;
    module.add_function(wrap_pyfunction!(companion, module)?)?;
    module.add_class::<Study>()?;
    module.add_function(wrap_pyfunction!(run_of_study, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
