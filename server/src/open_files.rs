//! Whether files and folders that this process has open are still those of their names.
//!
//! A file that is moved, deleted or replaced stays usable for the process that has it open, and what is written to it
//! is lost for all others. Device and inode of the name tell whether that has happened.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Files and folders with the device and the inode that they had when they were opened.
#[derive(Clone, Debug, Default)]
pub(crate) struct OpenFiles(Vec<(PathBuf, FileId)>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileId {
    device: u64,
    inode: u64,
}

impl FileId {
    fn of(path: &Path) -> io::Result<Self> {
        let found = fs::metadata(path)?;
        Ok(Self { device: found.dev(), inode: found.ino() })
    }
}

impl OpenFiles {
    /// These files and folders, which the caller has opened a moment ago; those that do not exist are left out.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn of(paths: impl IntoIterator<Item = PathBuf>) -> io::Result<Self> {
        let mut files = Vec::new();
        for path in paths {
            match FileId::of(&path) {
                Ok(id) => files.push((path, id)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Self(files))
    }

    /// The first whose name leads to another file or to none. An error of the system besides says nothing about that.
    pub(crate) fn replaced(&self) -> Option<&Path> {
        let is_replaced = |(path, id): &&(PathBuf, FileId)| match FileId::of(path) {
            Ok(found) => found != *id,
            Err(error) => matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory),
        };
        self.0.iter().find(is_replaced).map(|(path, _)| path.as_path())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_file_that_is_moved_removed_or_replaced_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for change in ["moved", "removed", "copied", "folder moved", "link changed"] {
            let inner = at("inner");
            fs::create_dir(&inner).unwrap();
            fs::write(inner.join("file"), "1").unwrap();
            fs::create_dir(at("other")).unwrap();
            fs::write(at("other/file"), "1").unwrap();
            symlink(&inner, at("link")).unwrap();
            let path = if change == "link changed" { at("link/file") } else { inner.join("file") };
            let open = OpenFiles::of([path.clone(), at("missing")]).unwrap();
            fs::write(&path, "2").unwrap();
            assert_eq!(open.replaced(), None, "{change}: what is written to it changes nothing");
            match change {
                "moved" => fs::rename(&path, at("other/moved")).unwrap(),
                "removed" => fs::remove_file(&path).unwrap(),
                "copied" => fs::rename(at("other/file"), &path).unwrap(),
                "folder moved" => fs::rename(&inner, at("away")).unwrap(),
                _ => {
                    fs::remove_file(at("link")).unwrap();
                    symlink(at("other"), at("link")).unwrap();
                }
            }
            assert_eq!(open.replaced(), Some(path.as_path()), "{change}");
            for made in ["inner", "other", "away"] {
                let _ = fs::remove_dir_all(at(made));
            }
            fs::remove_file(at("link")).unwrap();
        }
    }
}
