//! The documents against the interface: every address is in `openapi.yaml` with its method and its parameters, every
//! command and option is known to the binary, every option of an export in a table exists with the default that it has
//! there, and every link within the repository leads to a file. No line of the documents, and of the comments in the
//! code, is longer than 120 characters.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::harness::{Contract, packstone};

const METHODS: [&str; 6] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"];
const LONGEST_LINE: usize = 120;
/// Options of other programs that the documents name by themselves.
const OF_OTHER_PROGRAMS: [&str; 6] = ["--release", "--example", "--edge", "--size", "--features", "--signal"];

fn root() -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).to_owned()
}

/// The documents, by their path from the root.
fn documents() -> BTreeMap<PathBuf, String> {
    let root = root();
    let singles =
        ["README.md", "BENCHMARKS.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "python/README.md"];
    let mut paths: Vec<PathBuf> = singles.into_iter().map(PathBuf::from).collect();
    let mut folders = vec![root.join("docs"), root.join("examples")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                paths.push(path.strip_prefix(&root).unwrap().to_owned());
            }
        }
    }
    assert!(paths.len() > 15, "{paths:?}");
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(root.join(path)).unwrap())).collect()
}

/// The code of a document: spans within the text, and lines of blocks.
#[derive(Default)]
struct Code {
    spans: Vec<String>,
    lines: Vec<String>,
}

impl Code {
    fn of(text: &str) -> Self {
        let mut code = Self::default();
        let mut paragraph = String::new();
        let mut fenced = false;
        for line in text.lines().chain([""]) {
            let fence = line.trim_start().starts_with("```");
            let indented = line.starts_with("    ") && paragraph.is_empty();
            if fence || line.trim().is_empty() || line.starts_with('|') || fenced || indented {
                // Spans are the odd pieces; a span may be broken into two lines.
                code.spans.extend(paragraph.split('`').skip(1).step_by(2).map(|span| span.trim().to_owned()));
                paragraph.clear();
            }
            if fence {
                fenced = !fenced;
            } else if fenced || indented {
                code.lines.push(line.trim().to_owned());
            } else {
                paragraph.push_str(line.trim());
                paragraph.push(' ');
                if line.starts_with('|') {
                    code.spans.extend(line.split('`').skip(1).step_by(2).map(str::to_owned));
                    paragraph.clear();
                }
            }
        }
        code
    }

    fn all(&self) -> impl Iterator<Item = &String> {
        self.spans.iter().chain(&self.lines)
    }
}

/// An address that a document names.
#[derive(Debug, PartialEq)]
struct Address {
    method: Option<String>,
    path: String,
    parameters: Vec<String>,
}

/// The addresses in a piece of code.
fn addresses(code: &str) -> Vec<Address> {
    let words: Vec<&str> = code.split_whitespace().collect();
    let mut found = Vec::new();
    for (i, word) in words.iter().enumerate() {
        let word = word.trim_matches(|c: char| "\"'(),;".contains(c));
        let path = match word.find("/v1/") {
            Some(at) => &word[at..],
            None if i > 0 && METHODS.contains(&words[i - 1]) && word.starts_with('/') => word,
            None => continue,
        };
        let (path, query) = path.split_once('?').unwrap_or((path, ""));
        let parameters = query.split('&').filter_map(|pair| Some(pair.split_once('=')?.0.to_owned()));
        found.push(Address {
            method: i.checked_sub(1).map(|at| words[at].to_owned()).filter(|m| METHODS.contains(&m.as_str())),
            path: path.trim_end_matches(['"', '\'', ')']).to_owned(),
            parameters: parameters.collect(),
        });
    }
    found
}

/// Why an address is not in the contract.
fn fault(address: &Address) -> Option<String> {
    let paths = Contract::get().document()["paths"].as_object().unwrap();
    let is_variable = |segment: &str| segment.starts_with(['{', '$']);
    let fits = |known: &str| {
        let (known, named): (Vec<&str>, Vec<&str>) =
            (known.split('/').collect(), address.path.split('/').collect());
        // A concrete segment may stand for a variable of the contract, but not the other way round.
        known.len() == named.len() && known.iter().zip(&named).all(|(k, n)| k == n || is_variable(k))
    };
    let known: Vec<_> = paths.iter().filter(|(path, _)| fits(path)).collect();
    if known.is_empty() {
        return Some("no such path".into());
    }
    let of_method = |method: &str| known.iter().any(|(_, item)| item.get(method.to_lowercase()).is_some());
    // A GET has a HEAD.
    let method = address.method.as_deref().map(|method| if method == "HEAD" { "GET" } else { method });
    if method.is_some_and(|method| !of_method(method)) {
        return Some("no such method".into());
    }
    let operations = known.iter().flat_map(|(_, item)| item.as_object().unwrap());
    let of_this = operations.filter(|(name, _)| method.is_none_or(|m| m.eq_ignore_ascii_case(name)));
    let parameters: BTreeSet<&str> = of_this
        .filter_map(|(_, operation)| operation["parameters"].as_array())
        .flatten()
        .filter_map(|parameter| parameter["name"].as_str())
        .collect();
    let unknown = address.parameters.iter().find(|name| !parameters.contains(name.as_str()));
    unknown.map(|name| format!("no parameter {name}"))
}

#[test]
fn every_address_in_the_documents_is_in_the_contract() {
    let (mut found, mut faults) = (0, Vec::new());
    for (path, text) in documents() {
        let code = Code::of(&text);
        for address in code.all().flat_map(|code| addresses(code)) {
            found += 1;
            faults.extend(fault(&address).map(|why| format!("{}: {address:?}: {why}", path.display())));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(found > 25, "only {found} addresses were found");
    // What the test is for.
    for (code, why) in [
        ("POST /v1/jobs/{id}/derived", "no such path"),
        ("curl localhost:8080/v1/jobs/$ID/slice.svg?axis=z", "no such path"),
        ("PUT /v1/jobs/{id}", "no such method"),
        ("GET /v1/jobs/{id}/exports/slice?at=40", "no parameter at"),
    ] {
        let address = addresses(code);
        assert_eq!(fault(&address[0]).as_deref(), Some(why), "{code}");
    }
}

/// The commands of `packstone` in a piece of code, each with its arguments.
fn commands(code: &str) -> Vec<Vec<&str>> {
    let code = code.split(" #").next().unwrap_or_default();
    code.split(['|', ';', '&', '>'])
        .filter_map(|command| {
            let mut words = command.split_whitespace().skip_while(|word| word.contains('='));
            (words.next()? == "packstone").then(|| words.collect())
        })
        .collect()
}

/// The names in the list of commands of a help text, but for `help`.
fn commands_in(list: &str) -> Vec<&str> {
    let lines = list.split("\n\n").next().unwrap_or_default().lines();
    lines.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help").collect()
}

#[tokio::test]
async fn every_command_and_option_in_the_documents_is_known_to_the_binary() {
    let directory = tempfile::tempdir().unwrap();
    let help = async |args: &[&str]| {
        let ended = packstone(directory.path(), args).await;
        assert_eq!(ended.code, Some(0), "{args:?}: {ended:?}");
        ended.stdout
    };
    let overview = help(&["--help"]).await;
    let names = overview.split("Commands:").nth(1).map(commands_in).unwrap();
    assert!(names.contains(&"serve") && names.contains(&"backup"), "{names:?}");
    let options_of = |help: &str| -> BTreeSet<String> {
        let words = help.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-'));
        words.filter(|word| word.starts_with("--") && word.len() > 2).map(str::to_owned).collect()
    };
    let mut options = BTreeMap::new();
    for name in &names {
        let text = help(&[name, "--help"]).await;
        let mut all = options_of(&text);
        for below in text.split("Commands:").nth(1).map(commands_in).unwrap_or_default() {
            all.append(&mut options_of(&help(&[name, below, "--help"]).await));
        }
        options.insert(*name, all);
    }
    let known_somewhere: BTreeSet<&String> = options.values().flatten().collect();
    let option = |word: &str| word.split('=').next().unwrap_or_default().to_owned();
    let (mut found, mut faults) = (BTreeSet::new(), Vec::new());
    for (path, text) in documents() {
        let code = Code::of(&text);
        for command in code.all().flat_map(|code| commands(code)) {
            let Some(name) = command.first().filter(|name| !name.starts_with('-') && **name != "COMMAND")
            else {
                continue;
            };
            let Some(options) = options.get(name) else {
                faults.push(format!("{}: no command packstone {name}", path.display()));
                continue;
            };
            found.insert((*name).to_owned());
            let unknown =
                command.iter().filter(|word| word.starts_with("--") && !options.contains(&option(word)));
            faults.extend(unknown.map(|word| format!("{}: packstone {name} has no {word}", path.display())));
        }
        for span in code.spans.iter().filter(|span| span.starts_with("--")) {
            let named = option(span.split([' ', ',']).next().unwrap_or_default());
            let known = known_somewhere.contains(&named) || named == "--version" || named == "--help";
            if !known && !OF_OTHER_PROGRAMS.contains(&named.as_str()) {
                faults.push(format!("{}: no command has {named}", path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    // `docs/commands.md` has a row for each command.
    let table = fs::read_to_string(root().join("docs/commands.md")).unwrap();
    for name in options.keys() {
        assert!(table.contains(&format!("\n| `{name}")), "docs/commands.md has no row for {name}");
        assert!(
            found.contains(*name) || ["openapi", "completions", "man"].contains(name),
            "{name} in no document"
        );
    }
    assert_eq!(commands("A=1 packstone run x --out y | packstone plan z # packstone pie").len(), 2);
}

/// The cells of the rows of a table, for each table of a document whose first head is that.
fn tables(text: &str, head: &str) -> Vec<Vec<Vec<String>>> {
    let cells = |row: &str| row.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect();
    let mut found = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line.starts_with(&format!("| {head} |")) {
            let rows = lines.by_ref().skip(1).take_while(|row| row.starts_with('|'));
            found.push(rows.map(cells).collect());
        }
    }
    found
}

/// The names between backticks.
fn names(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// The forms of the requests for exports of a type, one or several for its formats.
fn export_forms(kind: &str) -> Vec<&'static Value> {
    let forms =
        Contract::get().document()["components"]["schemas"]["ExportRequest"]["oneOf"].as_array().unwrap();
    forms.iter().filter(|form| form["properties"]["type"]["enum"][0] == kind).collect()
}

/// The documents with tables of options of exports, and the types of the exports in the order of the tables.
const OPTION_TABLES: [(&str, &[&str]); 5] = [
    ("docs/decks.md", &["deck"]),
    ("docs/ldpm.md", &["ldpm"]),
    ("docs/meshes.md", &["mesh", "mesh"]),
    ("docs/properties.md", &["properties"]),
    ("docs/voxels.md", &["voxels", "slice", "slice"]),
];

/// What is wrong with a table of the options of exports of a type.
fn option_faults(kind: &str, rows: &[Vec<String>]) -> Vec<String> {
    let forms = export_forms(kind);
    let (mut faults, mut told) = (Vec::new(), BTreeSet::new());
    for row in rows {
        for name in names(&row[0]) {
            told.insert(name);
            let schemas: Vec<&Value> = forms.iter().filter_map(|form| form["properties"].get(name)).collect();
            let defaults: Vec<String> = schemas
                .iter()
                .filter_map(|schema| schema.get("default"))
                .map(|default| default.as_str().map_or_else(|| default.to_string(), str::to_owned))
                .collect();
            let given = row[1].replace(['`', ' '], "");
            if schemas.is_empty() {
                faults.push(format!("{kind} has no option {name}"));
            } else if !defaults.is_empty() && !defaults.contains(&given) {
                faults.push(format!("{kind}: the default of {name} is {defaults:?}, not {given:?}"));
            }
        }
    }
    for name in forms.iter().flat_map(|form| form["properties"].as_object().unwrap().keys()) {
        if !["type", "format"].contains(&name.as_str()) && !told.contains(name.as_str()) {
            faults.push(format!("{kind}: no row for {name}"));
        }
    }
    faults
}

#[test]
fn every_option_in_a_table_of_the_documents_exists_with_its_default() {
    let mut faults = Vec::new();
    for (path, text) in documents() {
        let mut tables = tables(&text, "option");
        // Options of commands: see the test of these.
        tables.retain(|rows| !rows.iter().all(|row| row[0].starts_with("`--")));
        let path = path.to_str().unwrap();
        let kinds =
            OPTION_TABLES.iter().find(|(known, _)| *known == path).map_or(&[][..], |(_, kinds)| kinds);
        assert_eq!(tables.len(), kinds.len(), "{path}: name its tables of options in OPTION_TABLES");
        // Some types have their options in two tables.
        let mut rows_of: BTreeMap<&str, Vec<Vec<String>>> = BTreeMap::new();
        for (kind, rows) in kinds.iter().zip(tables) {
            rows_of.entry(kind).or_default().extend(rows);
        }
        for (kind, rows) in &rows_of {
            assert!(rows.len() > 3, "{path}: {rows:?}");
            faults.extend(option_faults(kind, rows).into_iter().map(|fault| format!("{path}: {fault}")));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    // What the test is for.
    let row = |name: &str, default: &str| vec![format!("`{name}`"), default.to_owned(), String::new()];
    let of_triangles =
        [("elements", ""), ("order", "1"), ("plane", "`stress`"), ("segments", ""), ("max_size_mm", "")];
    let mut rows = vec![row("form", "`svg`"), row("pixels", "1000"), row("axis", "`x`")];
    rows.extend(of_triangles.map(|(name, default)| row(name, default)));
    let faults = option_faults("slice", &rows);
    let known = ["no option form", "the default of axis", "no row for at_mm"];
    assert!(
        faults.len() == 3 && known.iter().zip(&faults).all(|(known, fault)| fault.contains(known)),
        "{faults:?}"
    );
}

#[test]
fn the_table_of_exports_has_every_type_and_format() {
    let text = fs::read_to_string(root().join("docs/models.md")).unwrap();
    let rows = tables(&text, "`type`").concat();
    let mut told: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut kind = String::new();
    for row in &rows {
        if let Some(name) = names(&row[0]).first() {
            kind = (*name).to_owned();
        }
        told.entry(kind.clone()).or_default().extend(names(&row[1]).into_iter().map(str::to_owned));
    }
    let document = Contract::get().document();
    let mut known: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for form in document["components"]["schemas"]["ExportRequest"]["oneOf"].as_array().unwrap() {
        let (kind, format) =
            (form["properties"]["type"]["enum"][0].as_str().unwrap(), &form["properties"]["format"]);
        let name = format["anyOf"][0]["$ref"].as_str().and_then(|name| name.rsplit('/').next());
        let values = name.map_or(&format["enum"], |name| &document["components"]["schemas"][name]["enum"]);
        let values = values.as_array().unwrap().iter().map(|value| value.as_str().unwrap().to_owned());
        known.entry(kind.to_owned()).or_default().extend(values);
    }
    assert_eq!(told, known);
}

#[test]
fn every_link_in_the_documents_leads_to_a_file() {
    for (path, text) in documents() {
        let folder = root().join(path.parent().unwrap());
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let file = link.split('#').next().unwrap_or_default();
            let outside = link.starts_with("https://") || link.starts_with("http://");
            assert!(outside || file.is_empty() || folder.join(file).exists(), "{}: {link}", path.display());
        }
    }
}

/// Except rows of tables and lines with a link.
#[test]
fn no_line_of_the_documents_is_too_long() {
    let mut texts = documents();
    let containers = ["docker/compose.yaml", "docker/Dockerfile", "docker/Dockerfile.fem", "docker/test.sh"];
    let mut paths: Vec<PathBuf> = [".ci/run"].into_iter().chain(containers).map(PathBuf::from).collect();
    for folder in ["docker/kubernetes/base", "docker/kubernetes/keda", "packaging"] {
        paths.extend(fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().path()));
    }
    for path in paths {
        texts.insert(path.clone(), fs::read_to_string(root().join(path)).unwrap());
    }
    let mut long = Vec::new();
    for (path, text) in texts {
        for (i, line) in text.lines().enumerate() {
            let excepted = line.starts_with('|') || line.contains("](");
            if !excepted && line.chars().count() > LONGEST_LINE {
                long.push(format!("{}:{}: {} characters", path.display(), i + 1, line.chars().count()));
            }
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn no_comment_of_the_code_is_too_long() {
    let mut folders: Vec<PathBuf> =
        ["engine", "server", "tests"].into_iter().map(|folder| root().join(folder)).collect();
    let (mut long, mut files) = (Vec::new(), 0);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files += 1;
                for (i, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
                    if line.trim_start().starts_with("//") && line.chars().count() > LONGEST_LINE {
                        long.push(format!(
                            "{}:{}: {} characters",
                            path.display(),
                            i + 1,
                            line.chars().count()
                        ));
                    }
                }
            }
        }
    }
    assert!(files > 200, "only {files} files of code were found");
    assert!(long.is_empty(), "{}", long.join("\n"));
}
