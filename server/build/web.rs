//! The files of the folder `web` as they are compiled in: shortened, compressed with gzip, and a table of them.

use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::shorten::shortened;

/// The folder of the pages, beside that of this crate.
const FOLDER: &str = "../web";

/// Writes each file into the folder of the build, and `web_files.rs`, an expression with their names, in order, and
/// bytes.
///
/// # Errors
/// A file cannot be read or written.
pub(crate) fn compile() -> io::Result<()> {
    println!("cargo:rerun-if-changed={FOLDER}");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    let mut names = Vec::new();
    list(Path::new(FOLDER), "", &mut names)?;
    names.sort_unstable();
    let mut table = String::from("&[\n");
    for (number, name) in names.iter().enumerate() {
        let text = shortened(name, &fs::read_to_string(Path::new(FOLDER).join(name))?);
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(text.as_bytes())?;
        let file = format!("/web-{number}.gz");
        fs::write(out.join(&file[1..]), encoder.finish()?)?;
        let _ = writeln!(table, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), {file:?}))),");
    }
    table.push_str("]\n");
    fs::write(out.join("web_files.rs"), table)
}

/// Adds the files of a folder and of those in it, by their paths from the top.
fn list(folder: &Path, before: &str, names: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(&entry.path(), &format!("{name}/"), names)?;
        } else if !name.rsplit('/').next().is_some_and(|last| last.starts_with('.')) {
            names.push(name);
        }
    }
    Ok(())
}
