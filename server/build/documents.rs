//! The documents of the folder `docs` as pages of HTML, which the service hands out below `/docs/`, and the examples of
//! `examples/gallery` as a list with pictures, from which the form starts.
//!
//! A page has the path of its file without `.md`; `index.md` is the page of its folder. Links lead where they lead in
//! the repository: to other pages, to headings, to examples (which open in the form), to the description of the
//! interface. A text of the repository that a page links to is handed out as it is; a link to anything else becomes
//! its words. Pictures are taken from the shortest on, those of the first page before others, up to
//! [`MOST_PICTURE_BYTES`] in all; in place of another stands what it shows.

mod links;
mod navigation;
mod page;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

/// The root of the repository, beside this crate.
const ROOT: &str = "..";
/// Folders and files that are no documents.
const NO_DOCUMENTS: [&str; 1] = ["docs/site"];
/// Documents outside of `docs`, and their paths among the pages.
const OUTSIDE: [(&str, &str); 3] =
    [("python/README.md", "python/overview"), ("BENCHMARKS.md", "benchmarks"), ("SECURITY.md", "security")];
/// What all pictures have at most, in bytes; those of the examples come on top.
const MOST_PICTURE_BYTES: usize = 950_000;
/// The longest text that is handed out as it is.
const MOST_TEXT_BYTES: u64 = 60_000;
/// Endings of such texts.
const TEXTS: [&str; 8] = ["json", "py", "csv", "inp", "m", "cff", "sh", "ipynb"];

/// What the pages link to.
struct Site {
    /// The sources of the pages, by their paths in the repository.
    sources: BTreeMap<String, String>,
    /// Pages by the paths of their sources, relative to `/docs/`; that of a folder ends with a slash or is empty.
    pages: BTreeMap<String, String>,
    /// Names of the examples.
    examples: BTreeSet<String>,
    /// Pictures that are handed out, by their paths in the repository.
    pictures: BTreeSet<String>,
    /// Texts of the repository that pages link to.
    texts: BTreeSet<String>,
}

/// Writes the files into the folder of the build, and `document_files.rs`, an expression with their paths and bytes:
/// pictures as they are, all else with gzip.
///
/// # Errors
/// A file cannot be read or written.
pub(crate) fn compile() -> io::Result<()> {
    // A rebuild of the whole server after each change of a document is too much for a test: those of development have
    // the documents of the last change of this crate.
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        for read in
            ["docs", "examples/gallery", "mkdocs.yml"].into_iter().chain(OUTSIDE.map(|(path, _)| path))
        {
            println!("cargo:rerun-if-changed={ROOT}/{read}");
        }
    }
    let mut site = Site {
        sources: BTreeMap::new(),
        pages: BTreeMap::new(),
        examples: names(&Path::new(ROOT).join("examples/gallery"))?,
        pictures: BTreeSet::new(),
        texts: BTreeSet::new(),
    };
    site.read_folder("docs")?;
    for (path, page) in OUTSIDE {
        site.sources.insert(path.to_owned(), fs::read_to_string(Path::new(ROOT).join(path))?);
        site.pages.insert(path.to_owned(), page.to_owned());
    }
    site.choose_files()?;
    let navigation = navigation::read(&fs::read_to_string(Path::new(ROOT).join("mkdocs.yml"))?, &site.pages);
    let header = page::header(&fs::read_to_string(Path::new(ROOT).join("web/index.html"))?);

    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    for (source, text) in &site.sources {
        let here = &site.pages[source];
        files.push((
            format!("docs/{here}"),
            page::document(&site, source, text, &header, &navigation).into_bytes(),
        ));
    }
    files.push(("not-found".to_owned(), page::not_found(&header).into_bytes()));
    for picture in &site.pictures {
        files.push((format!("docs/files/{picture}"), fs::read(Path::new(ROOT).join(picture))?));
    }
    for text in &site.texts {
        files.push((format!("docs/files/{text}"), fs::read(Path::new(ROOT).join(text))?));
    }
    let mut gallery = Vec::new();
    for name in &site.examples {
        let folder = Path::new(ROOT).join("examples/gallery").join(name);
        let request = fs::read_to_string(folder.join("request.json"))?;
        gallery.push(page::example(name, &fs::read_to_string(folder.join("README.md"))?, &request));
        files.push((format!("gallery/{name}.png"), fs::read(folder.join("thumb.png"))?));
    }
    files.push(("gallery.json".to_owned(), format!("[{}]", gallery.join(",\n")).into_bytes()));
    files.push((
        "version.json".to_owned(),
        format!("{{\"version\":{:?}}}", env!("CARGO_PKG_VERSION")).into_bytes(),
    ));
    write(&mut files)
}

/// Writes the files and their table, in the order of their paths.
fn write(files: &mut [(String, Vec<u8>)]) -> io::Result<()> {
    let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    files.sort();
    let mut table = String::from("&[\n");
    for (number, (name, bytes)) in files.iter().enumerate() {
        let file = format!("/document-{number}");
        if name.rsplit('.').next() == Some("png") {
            fs::write(out.join(&file[1..]), bytes)?;
        } else {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            encoder.write_all(bytes)?;
            fs::write(out.join(&file[1..]), encoder.finish()?)?;
        }
        let _ = writeln!(table, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), {file:?}))),");
    }
    table.push_str("]\n");
    fs::write(out.join("document_files.rs"), table)
}

/// The names of what is in a folder.
fn names(folder: &Path) -> io::Result<BTreeSet<String>> {
    fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
}

impl Site {
    /// Adds the documents of a folder and of those in it.
    fn read_folder(&mut self, folder: &str) -> io::Result<()> {
        for name in names(&Path::new(ROOT).join(folder))? {
            let path = format!("{folder}/{name}");
            let file = Path::new(ROOT).join(&path);
            if NO_DOCUMENTS.contains(&&*path) {
                continue;
            }
            if file.is_dir() {
                self.read_folder(&path)?;
            } else if let Some(page) = path.strip_suffix(".md") {
                let page = page.trim_start_matches("docs/");
                let page = if page == "index" { "" } else { page.strip_suffix("index").unwrap_or(page) };
                self.pages.insert(path.clone(), page.to_owned());
                self.sources.insert(path, fs::read_to_string(&file)?);
            }
        }
        Ok(())
    }

    /// Chooses the pictures and texts that are handed out, among those that pages refer to.
    fn choose_files(&mut self) -> io::Result<()> {
        let mut pictures = BTreeSet::new();
        for (source, text) in &self.sources {
            for target in links::targets(text) {
                let (path, _) = links::resolved(source, &target);
                let file = Path::new(ROOT).join(&path);
                let ending = path.rsplit('.').next().unwrap_or_default();
                let is_of_gallery = path.starts_with("examples/gallery/");
                if self.pages.contains_key(&path) || is_of_gallery || !file.is_file() {
                    continue;
                }
                let length = fs::metadata(&file)?.len();
                if ["png", "svg"].contains(&ending) {
                    // A drawing is carried with gzip.
                    let carried = if ending == "svg" { length / 3 } else { length };
                    pictures.insert((source != "docs/index.md", carried as usize, path));
                } else if TEXTS.contains(&ending) && length <= MOST_TEXT_BYTES {
                    self.texts.insert(path);
                }
            }
        }
        let mut total = 0;
        for (_, length, path) in pictures {
            if self.pictures.contains(&path) {
                continue;
            }
            total += length;
            if total <= MOST_PICTURE_BYTES {
                self.pictures.insert(path);
            }
        }
        Ok(())
    }
}
