//! The tests of the engine from outside, and of its source as text.
//!
//! One test binary for all topics: each further one links the engine once more, and waits for the last test of the one
//! before it. Cargo looks for no other, so `every_file_of_tests_is_in_the_suite` sees to it that no file is left out.
// Expected values may be those of the standard library.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod provenance;

use packstone_engine as engine;

mod edmd;
mod ellipsoid_fingerprints;
mod ellipsoids;
mod fingerprints;
mod gradient;
mod lattice;
mod layers;
mod literature;
mod meshes;
mod mixes;
mod moves_threads;
mod own_kinds;
mod packing;
mod polyhedra;
#[path = "support/polyhedra.rs"]
mod polyhedra_samples;
mod saturation;
mod slices_and_voxels;

#[test]
fn every_file_of_tests_is_in_the_suite() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let declared = |text: &str| -> std::collections::BTreeSet<String> {
        text.lines()
            .filter_map(|line| Some(line.strip_prefix("mod ")?.strip_suffix(';')?.to_owned()))
            .collect()
    };
    for root in ["suite", "edmd"] {
        let modules = declared(&std::fs::read_to_string(folder.join(format!("{root}.rs"))).unwrap());
        let beside = if root == "suite" { folder.clone() } else { folder.join(root) };
        let mut files = 0;
        for entry in std::fs::read_dir(beside).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap();
            if path.extension().is_some_and(|extension| extension == "rs") && name != "suite" {
                files += 1;
                assert!(modules.contains(name), "{} is in no module", path.display());
            }
        }
        assert!(files > 5, "{files} files beside {root}.rs");
    }
}
