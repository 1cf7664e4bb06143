//! The files of the zip of a deck.

use std::io::{self, Read};

use rawzip::{CompressionMethod, ErrorKind, ZipArchive};

/// Files that a deck has at most, with those that a user adds.
const MAX_FILES: usize = 100;

/// Calls `take` with the name and the content of each file of a zip.
///
/// # Errors
/// [`io::ErrorKind::InvalidData`] for what is no zip, for a damaged file, for more than 100 files, and for a name that
/// leads into another folder; those of `take`.
pub fn unpack(zip: &[u8], mut take: impl FnMut(&str, &mut dyn Read) -> io::Result<()>) -> io::Result<()> {
    let archive = ZipArchive::from_slice(zip).map_err(failed)?;
    let mut entries = archive.entries();
    let mut files = 0;
    while let Some(entry) = entries.next_entry().map_err(failed)? {
        files += 1;
        if files > MAX_FILES {
            return Err(invalid(format!("more than {MAX_FILES} files: this is no zip of a deck")));
        }
        let path = entry.file_path().try_normalize().map_err(failed)?;
        let name = path.as_ref().to_owned();
        if name.is_empty() || name.contains(['/', '\\']) || name.starts_with('.') {
            return Err(invalid(format!("{name:?} is no name of a file of a deck")));
        }
        let method = entry.compression_method();
        let local = archive.get_entry(entry.wayfinder()).map_err(failed)?;
        if method == CompressionMethod::DEFLATE {
            let inflated = flate2::bufread::DeflateDecoder::new(local.data());
            take(&name, &mut local.verifying_reader(inflated))?;
        } else if method == CompressionMethod::STORE {
            take(&name, &mut local.verifying_reader(local.data()))?;
        } else {
            return Err(invalid(format!("{name} is compressed by another method than deflate")));
        }
    }
    Ok(())
}

fn invalid(text: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, text)
}

fn failed(error: rawzip::Error) -> io::Error {
    match error.into_kind() {
        ErrorKind::IO(error) => error,
        other => invalid(other.to_string()),
    }
}
