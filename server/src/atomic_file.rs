//! Writing a file so that under its name there is always a whole one, or none.
//!
//! The bytes go to a temporary name; then the file is synchronized with the disk, renamed, and its folder synchronized.
//! POSIX makes `rename` atomic, and after the folder's `fsync` the name survives a power cut.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek as _, Write as _};
use std::path::{Path, PathBuf};

/// What the name of a file that is being written ends with.
pub(crate) const PARTIAL: &str = ".tmp";

/// Writes a file by `write`; `before_rename` is the last that can keep it from its name.
///
/// # Errors
/// Those of `write`, `before_rename` and the disk; an earlier file of that name is still there then, and the partial
/// one is not.
pub(crate) fn write<T, E: From<io::Error>>(
    file: &Path,
    write: impl FnOnce(&File) -> Result<T, E>,
    before_rename: impl FnOnce() -> Result<(), E>,
) -> Result<T, E> {
    let partial = partial_of(file);
    let written = write_partial(&partial, write).and_then(|written| {
        before_rename()?;
        fs::rename(&partial, file)?;
        if let Some(folder) = file.parent() {
            sync_folder(folder)?;
        }
        Ok(written)
    });
    if written.is_err() {
        // The space of what a full disk cut off is given back; what cannot be removed is left to the sweeper.
        let _ = fs::remove_file(&partial);
    }
    written
}

/// Writes a file by `write`, through a buffer.
///
/// # Errors
/// As those of [`write()`]. Of a failure nothing is left.
pub(crate) fn write_buffered<T, E: From<io::Error>>(
    file: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<T, E>,
) -> Result<T, E> {
    let buffered = |inner: &File| -> Result<T, E> {
        // `&File` writes as `File` does.
        let mut out = BufWriter::with_capacity(1 << 18, inner);
        let written = write(&mut out)?;
        out.flush()?;
        Ok(written)
    };
    self::write(file, buffered, || Ok(()))
}

/// A file that comes piece by piece; dropped before it is finished, it leaves nothing.
#[derive(Debug)]
pub(crate) struct Pieces {
    file: PathBuf,
    /// Taken when it is renamed.
    partial: Option<File>,
}

impl Pieces {
    /// Begins a file.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn begin(file: PathBuf) -> io::Result<Self> {
        // It is read again before it gets its name.
        let mut options = File::options();
        let partial = options.read(true).write(true).create(true).truncate(true).open(partial_of(&file))?;
        Ok(Self { file, partial: Some(partial) })
    }

    /// Writes the next piece.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn write(&mut self, piece: &[u8]) -> io::Result<()> {
        match &mut self.partial {
            Some(partial) => partial.write_all(piece),
            None => Ok(()),
        }
    }

    /// Gives the file its name. An earlier file of that name is replaced.
    ///
    /// # Errors
    /// The system's; an earlier file is still there then.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.finish_checked(|_| Ok(()))
    }

    /// Gives the file its name, if `check`, which gets it at its start, has nothing against it.
    ///
    /// # Errors
    /// Those of `check` and the system; an earlier file is still there then.
    pub(crate) fn finish_checked(mut self, check: impl FnOnce(&File) -> io::Result<()>) -> io::Result<()> {
        if let Some(mut partial) = self.partial.as_ref() {
            partial.rewind()?;
            check(partial)?;
            partial.sync_all()?;
            fs::rename(partial_of(&self.file), &self.file)?;
            self.partial = None;
        }
        match self.file.parent() {
            Some(folder) => sync_folder(folder),
            None => Ok(()),
        }
    }
}

impl Drop for Pieces {
    fn drop(&mut self) {
        if self.partial.is_some() {
            // What cannot be removed is left to the sweeper.
            let _ = fs::remove_file(partial_of(&self.file));
        }
    }
}

fn write_partial<T, E: From<io::Error>>(
    partial: &Path,
    write: impl FnOnce(&File) -> Result<T, E>,
) -> Result<T, E> {
    let file = File::create(partial)?;
    let written = write(&file)?;
    file.sync_all()?;
    Ok(written)
}

/// The name under which a file is written.
pub(crate) fn partial_of(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(PARTIAL);
    PathBuf::from(name)
}

/// Makes the entries of a folder survive a power cut. The empty path, which a bare name has as its parent, is the
/// current folder.
///
/// # Errors
/// The system's.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    File::open(folder)?.sync_all()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_bare_name_is_the_current_one() {
        let bare = Path::new("name");
        sync_folder(bare.parent().unwrap()).unwrap();
    }

    #[test]
    fn a_failed_write_leaves_the_file_before() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        let text = |text: &'static str| move |mut file: &File| file.write_all(text.as_bytes());
        write::<_, io::Error>(&file, text("first"), || Ok(())).unwrap();
        let failed = write::<(), io::Error>(&file, text("second"), || Err(io::ErrorKind::Other.into()));
        assert!(failed.is_err());
        assert_eq!(fs::read(&file).unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no partial file is left");
        write::<_, io::Error>(&file, text("second"), || Ok(())).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"second");
    }

    #[test]
    fn a_write_that_fails_leaves_the_file_that_was_there() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("result.csv");
        fs::write(&file, "before").unwrap();
        let ended = write_buffered::<(), io::Error>(&file, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("no more"))
        });
        assert!(ended.is_err());
        assert_eq!(fs::read_to_string(&file).unwrap(), "before");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        write_buffered::<_, io::Error>(&file, |out| out.write_all(b"after")).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "after");
    }
}
