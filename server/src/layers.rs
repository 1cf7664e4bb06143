//! Tests that the modules of this crate import only downwards.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The layers from the bottom up. A module may import from its own layer and from the layers below it.
const LAYERS: &[&[&str]] = &[
    &[
        "accounts",
        "atomic_file",
        "base_path",
        "blobs",
        "descriptors",
        "disk",
        "failure",
        "fair_places",
        "hex",
        "http_client",
        "ids",
        "memory",
        "memory_budget",
        "open_files",
        "planning",
        "processor",
        "programs",
        "remaining_time",
        "tasks",
        "telemetry",
        "watched_file",
        "web_files",
    ],
    &["advice", "gmsh", "strict_json"],
    &[
        "artifacts",
        "audit",
        "checkpoints",
        "exports",
        "jobs",
        "metrics",
        "storage",
        "studies",
        "webhooks",
        "workers",
    ],
    &["config", "page", "plots"],
    &["formats"],
    &["http", "problem"],
    &["http_server", "places", "service"],
    &["local"],
    &["cli"],
    &["allocator", "layers", "lib", "main"],
];

fn layer_of(module: &str) -> usize {
    let found = LAYERS.iter().position(|layer| layer.contains(&module));
    found.unwrap_or_else(|| panic!("the module {module} has no layer: add it to LAYERS"))
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
}

/// The modules of this crate that a source names: in paths, and in braces after `crate::`.
fn named_modules(text: &str) -> BTreeSet<String> {
    let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let mut modules = BTreeSet::new();
    for line in code {
        for rest in line.split("crate::").skip(1) {
            match rest.strip_prefix('{').and_then(|list| list.split('}').next()) {
                Some(list) => modules.extend(list.split(',').map(|name| word(name.trim()))),
                None => {
                    modules.insert(word(rest));
                }
            }
        }
    }
    modules
}

#[test]
fn modules_import_only_downwards() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut upward = Vec::new();
    for file in files {
        let inside = file.strip_prefix(&root).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_str().unwrap();
        let module = first.trim_end_matches(".rs").trim_end_matches("_tests");
        for imported in named_modules(&fs::read_to_string(&file).unwrap()) {
            if !imported.is_empty() && layer_of(&imported) > layer_of(module) {
                upward.push(format!("{} imports {imported}", inside.display()));
            }
        }
    }
    assert!(upward.is_empty(), "{upward:#?}");
}
