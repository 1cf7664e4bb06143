//! Programs in Gmsh's place that fail, hang, and take memory.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use packstone_engine::{Progress, Unattended};

use super::*;

/// A shell script in Gmsh's place.
fn script(folder: &Path, text: &str) -> Program {
    let file = folder.join("gmsh");
    // Another process writes it: a file that this one has open while another thread starts a program is busy.
    let mut writer = std::process::Command::new("sh");
    writer.args(["-c", "printf '%s' \"$2\" >\"$1\" && chmod 755 \"$1\"", "sh"]);
    assert!(writer.arg(&file).arg(format!("#!/bin/sh\n{text}\n")).status().unwrap().success());
    Program::File(file)
}

const ROOMY: ProgramLimits =
    ProgramLimits { time: Some(Duration::from_secs(100)), memory_bytes: Some(1 << 34) };

fn filled(program: &Program, limits: ProgramLimits, control: &dyn Control) -> Result<String, ExportError> {
    let mut surfaces = |out: &mut dyn std::io::Write| Ok(out.write_all(b"of grains")?);
    let mut input = MesherInput {
        dimension: MeshDimension::Solid,
        surfaces: Some(&mut surfaces),
        script: "Merge;",
        sizes: Some(b"12"),
        also: None,
    };
    let made = fill(program, limits, &mut input, control)?;
    let mut text = String::new();
    made.open("msh")?.read_to_string(&mut text)?;
    Ok(text)
}

#[test]
fn a_program_finds_its_files_and_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let program = script(
        folder.path(),
        "pwd >where; cat surfaces.msh fill.geo sizes.bin where >filled.msh; echo \"$@\" >>filled.msh",
    );
    let text = filled(&program, ROOMY, &Unattended).unwrap();
    let (where_, arguments) = text.strip_prefix("of grainsMerge;12").unwrap().split_once('\n').unwrap();
    assert_eq!(arguments, "-3 fill.geo -o filled.msh -bin -nt 1\n");
    assert!(!Path::new(where_).exists(), "{where_}");
}

#[test]
fn the_cause_of_a_failure_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (text, says) in [
        (
            "echo 'Info    : Meshing 3D...'; echo 'Error   : HXT is tired' >&2",
            "Gmsh failed while filling volumes: HXT is tired",
        ),
        ("echo what; exit 3", "Gmsh failed (exit code 3) while starting Gmsh: what"),
        ("kill -11 $$", "Gmsh failed (signal 11) while starting Gmsh: it says nothing"),
        ("kill -9 $$", "it was killed (signal 9), as the system does where memory is short"),
        ("exit 0", "Gmsh ended without an error and without elements"),
        (
            "echo \"terminate called after throwing an instance of 'std::bad_alloc'\" >&2; exit 134",
            "Gmsh ran out of memory while starting Gmsh: it says",
        ),
    ] {
        let program = script(folder.path(), text);
        let error = filled(&program, ROOMY, &Unattended).unwrap_err();
        assert!(matches!(&error, ExportError::Mesher(what) if what.contains(says)), "{says}: {error}");
    }
    let missing = Program::File(folder.path().join("none"));
    let error = filled(&missing, ROOMY, &Unattended).unwrap_err().to_string();
    assert!(error.starts_with("Gmsh cannot be started: "), "{error}");
}

/// Whether a process that has written its number into a file still runs.
fn runs(file: &Path) -> bool {
    let Ok(pid) = fs::read_to_string(file) else { return false };
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim())).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z ")
}

#[test]
fn a_program_that_hangs_is_stopped_with_all_that_it_has_started() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pid");
    let program = script(folder.path(), &format!("sleep 1000 & echo $! >{}; wait", file.display()));
    let limits = ProgramLimits { time: Some(Duration::from_millis(300)), ..ROOMY };
    let error = filled(&program, limits, &Unattended).unwrap_err().to_string();
    assert!(error.starts_with("Gmsh did not end within 0.3 s (--gmsh-timeout-s)"), "{error}");
    let began = Instant::now();
    while runs(&file) && began.elapsed() < Duration::from_secs(10) {
        std::thread::yield_now();
    }
    assert!(!runs(&file), "a process of Gmsh's lives on");
}

#[test]
fn a_program_that_takes_too_much_memory_is_stopped() {
    if !Path::new("/proc/self/statm").exists() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let program = script(
        folder.path(),
        "echo 'Info    : Meshing 3D...'; tail -c 400000000 /dev/zero | tail -c 400000000; sleep 1000",
    );
    let limits = ProgramLimits { memory_bytes: Some(100 << 20), ..ROOMY };
    let error = filled(&program, limits, &Unattended).unwrap_err().to_string();
    assert!(error.starts_with("Gmsh ran out of memory while filling volumes: it held"), "{error}");
    assert!(error.contains("may have 104 MB (--gmsh-memory-mib)"), "{error}");
}

/// Stops at the first report of a step.
#[derive(Default)]
struct StopAt(AtomicBool);

impl Control for StopAt {
    fn report(&self, progress: &Progress) {
        if progress.message.contains("filling volumes") {
            assert!(progress.fraction > 0.0);
            self.0.store(true, Ordering::Relaxed);
        }
    }

    fn should_stop(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[test]
fn a_run_that_is_told_to_stop_ends_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let program = script(folder.path(), "echo 'Info    : Meshing 3D...'; sleep 1000");
    assert!(matches!(filled(&program, ROOMY, &StopAt::default()), Err(ExportError::Stopped)));
}

#[test]
fn a_named_program_that_is_no_gmsh_is_refused_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    for (text, says) in [("echo hello", "it states no version"), ("exit 2", "failed (exit code 2)")] {
        let Program::File(file) = script(folder.path(), text) else { panic!() };
        let error = find::find(Some(&file), None).unwrap_err();
        let ExportError::Unavailable(what) = error else { panic!("{error}") };
        assert!(
            what.contains(says) && what.contains("apt install gmsh") && what.contains("PACKSTONE_GMSH"),
            "{what}"
        );
    }
    let Program::File(file) = script(folder.path(), "echo 4.8.4 >&2") else { panic!() };
    assert_eq!(find::find(Some(&file), None).unwrap().1, "4.8.4");
}
