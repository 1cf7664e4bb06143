//! The layers of the engine, read from its source: imports point down, and the check shares nothing with what it
//! judges.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The modules of the engine from the lowest to the highest: each may use itself and those before it.
const LAYERS: [&str; 34] = [
    "arrays",
    "cpu",
    "elementary",
    "bayes",
    "memory",
    "threads",
    "rng",
    "sorting",
    "summed",
    "shape",
    "request",
    "importer",
    "packing",
    "error",
    "checkpoint",
    "control",
    "domain",
    "geometry",
    "distance",
    "gap",
    "grain",
    "mix",
    "blend",
    "segregation",
    "methods",
    "plan",
    "check",
    "analysis",
    "homogenization",
    "export",
    "solution",
    "template_cache",
    "samples",
    "run",
];

/// What names stand for that the crate's root exports.
fn module_of(name: &str) -> &str {
    match name {
        "Checkpoint" | "CheckpointError" | "Resume" => "checkpoint",
        "Control" | "Finish" | "Growth" | "Progress" | "Step" | "Unattended" => "control",
        "PackError" | "PlanError" => "error",
        "Grains" | "Packing" | "Report" | "Solids" | "Spheres" => "packing",
        "Plan" | "Limits" => "plan",
        "PackingRequest" | "FieldError" => "request",
        "TemplateCache" => "template_cache",
        other => other,
    }
}

/// Modules that may match the kind of a specimen. All others ask its domain.
const KNOW_KINDS_OF_SPECIMENS: [&str; 3] = ["check", "domain", "request"];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The files of a module that are no tests, with their paths below `src`.
fn files(of: &Path) -> Vec<PathBuf> {
    let is_test = |path: &Path| {
        let name = path.file_stem().unwrap().to_str().unwrap();
        name == "tests" || name.ends_with("_tests")
    };
    if of.is_file() {
        return vec![of.to_owned()];
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(of).unwrap() {
        let path = entry.unwrap().path();
        if !is_test(&path) {
            found.extend(files(&path));
        }
    }
    found
}

/// The code of a file without comments and without the unit tests at its end.
fn code(file: &Path) -> String {
    let text = std::fs::read_to_string(file).unwrap();
    let tests = text
        .find("#[cfg(test)]\nmod tests {")
        .or(text.find("#[cfg(test)]\n#[allow(clippy::unwrap_used)]\nmod"));
    let without_tests = &text[..tests.unwrap_or(text.len())];
    without_tests.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// The names that follow a prefix as in `crate::name`, `crate::{a, b::c}`, with the path behind each.
fn named_after(code: &str, prefix: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        let before = code[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        let path =
            |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || matches!(c, '_' | ':')).collect();
        match rest.strip_prefix('{') {
            None => found.push(path(rest)),
            Some(list) => {
                let list = &list[..list.find('}').unwrap()];
                found.extend(list.split(',').map(|item| path(item.trim())));
            }
        }
    }
    found.retain(|name: &String| !name.is_empty());
    found
}

fn first(path: &str) -> &str {
    path.split("::").next().unwrap()
}

fn module_path(name: &str) -> PathBuf {
    let folder = source().join(name);
    if folder.is_dir() { folder } else { source().join(format!("{name}.rs")) }
}

#[test]
fn imports_point_down() {
    let mut wrong = Vec::new();
    for (height, module) in LAYERS.iter().enumerate() {
        for file in files(&module_path(module)) {
            for path in named_after(&code(&file), "crate::") {
                let used = module_of(first(&path));
                match LAYERS.iter().position(|layer| *layer == used) {
                    Some(of) if of > height => wrong.push(format!("{}: crate::{path}", file.display())),
                    Some(_) => {}
                    None if used == "VERSION" => {}
                    None => wrong.push(format!("{}: crate::{path} is in no layer", file.display())),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn what_needs_the_kind_of_a_specimen_asks_its_domain() {
    let mut found = Vec::new();
    for file in files(&source()) {
        let code = code(&file);
        if ["Specimen::Box", "Specimen::Cylinder"].iter().any(|kind| code.contains(kind)) {
            found.push(file.strip_prefix(source()).unwrap().to_str().unwrap().to_owned());
        }
    }
    found.retain(|file| !KNOW_KINDS_OF_SPECIMENS.contains(&file.split('/').next().unwrap()));
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn every_module_has_a_layer() {
    let lib = code(&source().join("lib.rs"));
    for line in lib.lines().filter_map(|line| line.trim().strip_suffix(';')) {
        if let Some((_, module)) = line.split_once("mod ") {
            // `properties` is a module of the unit tests.
            assert!(LAYERS.contains(&module) || module == "properties", "{module}");
        }
    }
}

#[test]
fn the_check_uses_nothing_of_what_makes_packings() {
    for file in files(&module_path("check")) {
        for path in named_after(&code(&file), "crate::") {
            let is_allowed = matches!(
                module_of(first(&path)),
                "arrays"
                    | "check"
                    | "cpu"
                    | "control"
                    | "elementary"
                    | "packing"
                    | "request"
                    | "memory"
                    | "shape"
                    | "sorting"
                    | "threads"
            ) || path.starts_with("request::standard");
            assert!(is_allowed, "{}: crate::{path}", file.display());
        }
        // Of a shape and its pose the check reads the stored numbers alone.
        for method in [
            "rotation()",
            "matrix_mm2(",
            "equivalent_diameter_mm(",
            "volume_mm3()",
            "sieve_size_mm(",
            "support_mm(",
            "world_vertices_mm(",
            "volume()",
        ] {
            assert!(!code(&file).contains(&format!(".{method}")), "{}: {method}", file.display());
        }
    }
}

#[test]
fn the_check_shares_its_internals_with_nothing() {
    let check = module_path("check");
    let head = code(&check.join("mod.rs"));
    let modules: Vec<&str> = head
        .lines()
        .filter_map(|line| line.strip_suffix(';')?.split_once("mod "))
        .map(|(visibility, module)| {
            assert_eq!(visibility, "", "the module {module} of the check is not private");
            module
        })
        .collect();
    assert!(modules.contains(&"table"), "{modules:?}");
    // Beside the types of its head, what the head names is all that others see.
    let used = |line: &str| Some(line.strip_prefix("pub use ")?.split_once("::")?.1.to_owned());
    let named: Vec<String> = head
        .lines()
        .filter_map(used)
        .flat_map(|names| {
            let names = names.trim_matches(['{', '}', ';']).to_owned();
            names.split(", ").map(str::to_owned).collect::<Vec<_>>()
        })
        .collect();
    assert!(named.iter().any(|name| name == "check_shapes"), "{named:?}");
    for file in files(&check).iter().filter(|file| !file.ends_with("check/mod.rs")) {
        let code = code(file);
        assert!(!code.contains("pub(crate)"), "{}", file.display());
        for line in code.lines() {
            for item in ["fn", "struct", "enum", "trait", "const"] {
                let Some(rest) = line.strip_prefix(&format!("pub {item} ")) else { continue };
                let name = rest.split(['(', '<', ' ', ':', ';']).next().unwrap();
                assert!(named.iter().any(|known| known == name), "{}: {line}", file.display());
            }
        }
    }
    for file in files(&source()).iter().filter(|file| !file.starts_with(&check)) {
        for path in named_after(&code(file), "crate::check::") {
            assert!(!modules.contains(&first(&path)), "{}: crate::check::{path}", file.display());
        }
    }
}

#[test]
fn modules_of_a_folder_form_no_circle() {
    let mut folders = vec![source()];
    let mut with_circles = Vec::new();
    while let Some(folder) = folders.pop() {
        let entries: Vec<PathBuf> =
            std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        folders.extend(entries.iter().filter(|path| path.is_dir() && !path.ends_with("tests")).cloned());
        // The modules of the crate have layers of their own.
        if folder != source() && has_circle(&folder, entries) {
            with_circles.push(folder.strip_prefix(source()).unwrap().to_str().unwrap().replace('\\', "/"));
        }
    }
    assert!(with_circles.is_empty(), "{with_circles:?}");
}

/// Whether modules of a folder use each other in a circle.
fn has_circle(folder: &Path, entries: Vec<PathBuf>) -> bool {
    let modules: BTreeMap<String, PathBuf> = entries
        .into_iter()
        .map(|path| (path.file_stem().unwrap().to_str().unwrap().to_owned(), path))
        .filter(|(name, _)| name != "mod" && name != "tests")
        .collect();
    let below_source = folder.strip_prefix(source()).unwrap().to_str().unwrap().replace(['/', '\\'], "::");
    let absolute = format!("crate::{below_source}::");
    let mut uses: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (name, path) in &modules {
        let used = uses.entry(name).or_default();
        for file in files(path) {
            let code = code(&file);
            let depth = file.strip_prefix(path).unwrap().components().count();
            let is_head = file.file_name().unwrap() == "mod.rs";
            let supers = if is_head { depth } else { depth + 1 };
            let relative = "super::".repeat(supers);
            used.extend(named_after(&code, &absolute).into_iter().chain(named_after(&code, &relative)));
        }
        *used = used.iter().map(|path| first(path).to_owned()).collect();
        used.retain(|other| other != name && modules.contains_key(other));
    }
    // Takes away modules that use none of those left; what remains has a circle.
    while let Some(free) = uses.iter().find(|(_, used)| used.is_empty()).map(|(name, _)| *name) {
        uses.remove(free);
        for used in uses.values_mut() {
            used.remove(free);
        }
    }
    !uses.is_empty()
}

/// Files that match the kind of a grain outside of the folders that define and check kinds: the gaps of pairs of
/// kinds, and the measured constants of plans. All others ask grains what they have: templates, semi-axes, figures,
/// sections. The list only becomes shorter.
const MATCHING_KINDS: [&str; 3] = ["gap/solids.rs", "plan/checks.rs", "plan/shapes.rs"];

#[test]
fn kinds_of_grains_are_matched_in_no_further_file() {
    let kinds = ["Solid", "SolidRef", "TurnedSolid", "Grains", "GrainsRef", "GrainKind"];
    let variants = ["Spheres", "Solids", "Ellipsoid", "Ellipsoids", "Polyhedron", "Polyhedra", "Mixed"];
    let names: Vec<String> = kinds
        .iter()
        .flat_map(|kind| variants.iter().map(move |variant| format!("{kind}::{variant}")))
        .collect();
    let is_identifier = |c: char| c.is_alphanumeric() || c == '_';
    let matches = |code: &str| {
        names.iter().any(|name| {
            code.match_indices(name).any(|(at, _)| {
                !code[..at].ends_with(is_identifier) && !code[at + name.len()..].starts_with(is_identifier)
            })
        })
    };
    let defining = ["grain", "request", "check", "shape", "packing"];
    let found: BTreeSet<String> = files(&source())
        .iter()
        .filter(|file| matches(&code(file)))
        .map(|file| file.strip_prefix(source()).unwrap().to_str().unwrap().replace('\\', "/"))
        .filter(|path| !defining.iter().any(|folder| path.starts_with(&format!("{folder}/"))))
        .collect();
    assert_eq!(found, MATCHING_KINDS.iter().map(ToString::to_string).collect());
}
