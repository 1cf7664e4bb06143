//! Results read by the readers that users have: numpy, and the VTK library behind `ParaView`.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::harness::{jobs, machine, packstone, run};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/read_results.py");

async fn check(python: &Path, job: &Value) -> String {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
    let made =
        packstone(directory.path(), &["run", "job.json", "--out", "out", "--format", "json,csv,vtk,vtp,npy"])
            .await;
    assert_eq!(made.code, Some(0), "{made:?}");
    let mut command = Command::new(python);
    command.arg(SCRIPT).arg(directory.path().join("out"));
    let read = run(command).await;
    assert_eq!(read.code, Some(0), "{}{}", read.stdout, read.stderr);
    read.stdout
}

#[tokio::test]
async fn vtk_and_numpy_read_what_the_json_says() {
    let Some(python) = machine::python("Nobody read the VTK and NPY files.") else { return };
    let said = check(&python, &jobs::quick(1)).await;
    assert!(said.contains("agree"), "{said}");
    check(&python, &jobs::equal_spheres(50_000, 1)).await;
    // One grain, and classes with a gap between them.
    let diameters = json!({"type": "diameters", "diameters_mm": [10]});
    check(&python, &json!({"seed": 1, "specimen": {"type": "box", "size_mm": [20, 20, 20]}, "mix": {"grading": diameters}})).await;
    let classes = json!({"type": "classes", "classes": [
        {"d_min_mm": 2, "d_max_mm": 4, "mass_fraction": 0.4},
        {"d_min_mm": 8, "d_max_mm": 11, "mass_fraction": 0.6}]});
    let job = json!({"seed": 1, "specimen": {"type": "cylinder", "diameter_mm": 40, "height_mm": 60},
                     "mix": {"grading": classes, "volume_fraction": 0.4}});
    check(&python, &job).await;
}
