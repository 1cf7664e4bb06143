//! A folder of its own for each run of Gmsh, which is removed when it is no longer needed.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Read};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use packstone_engine::export::{ExportError, MesherFiles};
use uuid::Uuid;

use super::{FILLED, FOLDER};

/// A folder in that of the process for such files, else in the system's folder for temporary files (`TMPDIR`).
pub(super) struct Folder(PathBuf);

impl Folder {
    pub(super) fn new() -> io::Result<Self> {
        let parent = FOLDER.get().cloned().unwrap_or_else(std::env::temp_dir);
        let path = parent.join(format!("packstone-gmsh-{}", Uuid::now_v7().simple()));
        DirBuilder::new().mode(0o700).create(&path)?;
        Ok(Self(path))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }

    pub(super) fn create(&self, name: &str) -> io::Result<File> {
        File::create_new(self.0.join(name))
    }

    /// Refuses a run that has left no file of that name.
    pub(super) fn expect(&self, name: &str) -> Result<(), ExportError> {
        match fs::metadata(self.0.join(name)) {
            Ok(found) if found.len() > 0 => Ok(()),
            _ => Err(ExportError::Mesher("Gmsh ended without an error and without elements".into())),
        }
    }
}

impl MesherFiles for Folder {
    fn open(&self, ending: &str) -> io::Result<Box<dyn Read>> {
        Ok(Box::new(File::open(self.0.join(format!("{FILLED}.{ending}")))?))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if let Err(error) = fs::remove_dir_all(&self.0) {
            tracing::warn!(folder = %self.0.display(), %error, "a temporary folder was not removed");
        }
    }
}
