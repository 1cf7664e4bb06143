//! Blobs as files in a folder: of this service alone, or shared by several over a network file system.
//!
//! A staged file lies beside its name. In a folder of this service alone it has one name for each blob and is
//! renamed. In a shared folder its name is its own, and it is published by a hard link, which one of several
//! processes makes: NFS and Lustre do this as local file systems do. Used besides are exclusive creation, `fsync` and
//! `rename`; no locks, and the file server's dates only.

use std::fs::{self, File};
use std::io::{self, Read, Seek as _, SeekFrom};
use std::ops::Range;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, SystemTime};

use rustix::fs::OFlags;
use uuid::Uuid;

use super::{Blob, Blobs, Listed, PARTIAL, Staged};
use crate::atomic_file::sync_folder;
use crate::disk::Space;

/// How often a file is begun whose folder another process removes at that moment, because it is empty.
const BEGINNINGS: usize = 10;
/// A folder is removed after it was empty for so long: the next file may come at any moment.
const EMPTY_FOR: Duration = Duration::from_secs(10);
/// Pauses after which a file is looked for again that another machine may have written: the folder is read before, for
/// which a client of NFS asks the server anew.
const LOOKS: [Duration; 3] = [Duration::ZERO, Duration::from_millis(200), Duration::from_secs(1)];

/// A folder of blobs.
#[derive(Debug)]
pub(crate) struct Files {
    root: PathBuf,
    /// The device and the number of the folder at the start, where no other process uses it: another one may get its
    /// name.
    identity: Option<(u64, u64)>,
    /// A folder that stays as long as this is used, and the same of it. The device of a shared folder changes where its
    /// file system is mounted again.
    kept: Option<(&'static str, (u64, u64))>,
    shared: bool,
    /// Listings tell when files were written.
    dated: bool,
    /// Files are to outlast a power cut, and are synchronized with the disk.
    durable: bool,
}

impl Files {
    /// A folder of this process alone.
    pub(crate) fn alone(root: PathBuf) -> Self {
        Self { identity: identity(&root), root, kept: None, shared: false, dated: false, durable: true }
    }

    /// A folder that is looked at, whoever uses it.
    pub(crate) fn looked_at(root: PathBuf) -> Self {
        Self { dated: true, ..Self::alone(root) }
    }

    /// A folder of this process alone whose files nobody reads after it: they may be lost with the power.
    pub(crate) fn scratch(root: PathBuf) -> Self {
        Self { durable: false, ..Self::alone(root) }
    }

    /// A folder that other processes may use too.
    ///
    /// # Errors
    /// Those of the file system; it must make folders and take files, hard links among them.
    pub(crate) fn shared(root: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(&root)?;
        let files = Self { root, identity: None, kept: None, shared: true, dated: true, durable: true };
        let name = format!("trial.{}", Uuid::now_v7().simple());
        files.publish(files.stage(&name)?, &name, &|| false)?;
        files.remove(&[name])?;
        Ok(files)
    }

    /// Makes a folder that stays from now on: without it, or with another one in its place, what is in it is out of
    /// reach, and not missing.
    ///
    /// # Errors
    /// Those of the file system.
    pub(crate) fn keeping(self, folder: &'static str) -> io::Result<Self> {
        let path = self.locate(folder);
        fs::create_dir_all(&path)?;
        let kept = self.identity_of(&path).map(|identity| (folder, identity));
        Ok(Self { kept, ..self })
    }

    fn identity_of(&self, folder: &Path) -> Option<(u64, u64)> {
        identity(folder).map(|(device, number)| (if self.shared { 0 } else { device }, number))
    }

    fn locate(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Synchronizes a folder with the disk, where its files are to outlast a power cut.
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        if self.durable { sync_folder(folder) } else { Ok(()) }
    }

    /// Makes the folder of a file, durably where files are.
    fn make_folder(&self, file: &Path) -> io::Result<()> {
        let Some(folder) = file.parent().filter(|folder| !folder.is_dir()) else { return Ok(()) };
        if self.is_kept(file) {
            self.check_kept()?;
        }
        fs::create_dir_all(folder)?;
        let mut made = folder;
        while let Some(above) = made.parent().filter(|above| above.starts_with(&self.root)) {
            self.sync_folder(above)?;
            made = above;
        }
        Ok(())
    }

    /// Makes sure that the folder of that name is still the one of the start. A file that was published before is in it
    /// then, and moves with it from now on.
    fn check_identity(&self) -> io::Result<()> {
        if self.identity.is_some() && identity(&self.root) != self.identity {
            return Err(moved(&self.root));
        }
        self.check_kept()
    }

    /// The same of the folder that stays.
    fn check_kept(&self) -> io::Result<()> {
        let Some((folder, known)) = self.kept else { return Ok(()) };
        let path = self.locate(folder);
        if self.identity_of(&path) == Some(known) { Ok(()) } else { Err(moved(&path)) }
    }

    /// Whether it is the folder that stays, or in it.
    fn is_kept(&self, path: &Path) -> bool {
        self.kept.is_some_and(|(folder, _)| path.starts_with(self.locate(folder)))
    }

    /// Does something in the folder of a file, which is made where it is missing, and may be removed at any moment
    /// while it is empty.
    fn in_folder_of<T>(&self, file: &Path, work: impl Fn() -> io::Result<T>) -> io::Result<T> {
        let mut tried = 1;
        loop {
            self.make_folder(file)?;
            match work() {
                Err(error) if error.kind() == io::ErrorKind::NotFound && tried < BEGINNINGS => tried += 1,
                worked => return worked,
            }
        }
    }

    /// Opens a file, which in a shared folder may have appeared a moment ago.
    fn open_file(&self, name: &str) -> io::Result<File> {
        let path = self.locate(name);
        let mut looks = LOOKS.iter().filter(|_| self.shared);
        loop {
            match open_regular(&path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    let Some(pause) = looks.next() else {
                        if self.is_kept(&path) {
                            self.check_kept()?;
                        }
                        return Err(error);
                    };
                    sleep(*pause);
                    if let Some(folder) = path.parent()
                        && let Ok(entries) = fs::read_dir(folder)
                    {
                        entries.for_each(drop);
                    }
                }
                opened => return opened,
            }
        }
    }

    /// Whether the folder is empty then. What cannot be removed stays.
    fn remove_empty_below(folder: &Path) -> io::Result<bool> {
        let entries = match fs::read_dir(folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(true),
            entries => entries?,
        };
        let mut is_empty = true;
        for entry in entries {
            let entry = entry?;
            // Looked at before what is removed below changes it.
            let is_old =
                || entry.metadata()?.modified().map(|at| at.elapsed().is_ok_and(|age| age >= EMPTY_FOR));
            let is_gone = entry.file_type()?.is_dir()
                && is_old().unwrap_or(false)
                && Self::remove_empty_below(&entry.path())?
                && fs::remove_dir(entry.path()).is_ok();
            is_empty &= is_gone;
        }
        Ok(is_empty)
    }

    fn list_below(&self, folder: &Path, name: &str, found: &mut Vec<Listed>) -> io::Result<()> {
        let entries = match fs::read_dir(folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            entries => entries?,
        };
        for entry in entries {
            let entry = entry?;
            let Ok(file_name) = entry.file_name().into_string() else { continue };
            let name = if name.is_empty() { file_name } else { format!("{name}/{file_name}") };
            if entry.file_type()?.is_dir() {
                self.list_below(&entry.path(), &name, found)?;
                continue;
            }
            if !self.dated {
                found.push(Listed { name, written: None });
                continue;
            }
            match entry.metadata().and_then(|found| found.modified()) {
                Ok(written) => found.push(Listed { name, written: Some(written) }),
                // It went meanwhile.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

impl Blobs for Files {
    fn stage(&self, name: &str) -> io::Result<Staged> {
        let file = self.locate(name);
        let mut staged = file.clone().into_os_string();
        if self.shared {
            staged.push(format!(".{}", Uuid::now_v7().simple()));
        }
        staged.push(PARTIAL);
        let staged = PathBuf::from(staged);
        if !self.shared {
            // Of an attempt that was killed: nobody else writes here.
            remove_file(&staged)?;
        }
        self.in_folder_of(&file, || Staged::create(staged.clone()))
    }

    fn publish(&self, mut staged: Staged, name: &str, is_stopped: &dyn Fn() -> bool) -> io::Result<()> {
        let Some(path) = staged.path.as_deref() else { return Err(io::ErrorKind::NotFound.into()) };
        if self.durable {
            staged.file.sync_all()?;
        }
        if is_stopped() {
            return Err(io::ErrorKind::ConnectionAborted.into());
        }
        let file = self.locate(name);
        if self.shared {
            // The answer of a server to a link that was made may be lost, and the repeated request refused.
            match fs::hard_link(path, &file) {
                Err(_) if staged.file.metadata()?.nlink() == 2 => {}
                linked => linked?,
            }
        } else {
            if file.try_exists()? {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            fs::rename(path, &file)?;
            staged.path = None;
        }
        drop(staged);
        file.parent().map_or(Ok(()), |folder| self.sync_folder(folder))?;
        self.check_identity()
    }

    fn fetch(&self, name: &str) -> io::Result<File> {
        self.open_file(name)
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Blob>> {
        Ok(Box::new(self.open_file(name)?))
    }

    fn remove(&self, names: &[String]) -> io::Result<()> {
        // A folder that was moved misses every file: their removal must not be forgotten, nor where it is put back in
        // between.
        self.check_identity()?;
        names.iter().try_for_each(|name| remove_file(&self.locate(name)))?;
        self.check_identity()
    }

    fn remove_folder(&self, folder: &str) -> io::Result<()> {
        match fs::remove_dir_all(self.locate(folder)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<bool> {
        let (from, to) = (self.locate(from), self.locate(to));
        if !from.try_exists()? {
            self.check_kept()?;
            return Ok(false);
        }
        match self.in_folder_of(&to, || fs::rename(&from, &to)) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn list(&self, folder: &str) -> io::Result<Vec<Listed>> {
        let mut found = Vec::new();
        if self.is_kept(&self.locate(folder)) {
            self.check_kept()?;
        }
        self.list_below(&self.locate(folder), folder, &mut found)?;
        Ok(found)
    }

    fn is_shared(&self) -> bool {
        self.shared
    }

    fn now(&self) -> io::Result<SystemTime> {
        if !self.shared {
            return Ok(SystemTime::now());
        }
        let staged = self.stage("clock")?;
        // A file server sets the time of a write.
        io::Write::write_all(&mut staged.file(), b"now")?;
        staged.file.sync_all()?;
        staged.file.metadata()?.modified()
    }

    fn remove_empty_folders(&self, folder: &str) -> io::Result<()> {
        Self::remove_empty_below(&self.locate(folder)).map(drop)
    }

    fn shown(&self, name: &str) -> String {
        self.locate(name).display().to_string()
    }

    fn check(&self) -> io::Result<()> {
        self.check_kept()
    }

    fn space(&self) -> io::Result<Option<Space>> {
        Space::of(&self.root).map(Some)
    }
}

/// The device and the number of a folder, by which it is told from another one of its name.
fn identity(folder: &Path) -> Option<(u64, u64)> {
    fs::metadata(folder).ok().map(|found| (found.dev(), found.ino()))
}

/// The error of a folder that is not the one that was opened; it may be put back.
fn moved(folder: &Path) -> io::Error {
    let what = format!("{} was moved, removed or replaced while it was in use", folder.display());
    io::Error::new(io::ErrorKind::TimedOut, what)
}

/// Opens a file that holds bytes: a pipe in its place would be waited for without end.
pub(crate) fn open_regular(path: &Path) -> io::Result<File> {
    let flags = i32::try_from(OFlags::NONBLOCK.bits()).unwrap_or_default();
    let file = File::options().read(true).custom_flags(flags).open(path)?;
    if !file.metadata()?.is_file() {
        let what = format!("{} is no regular file", path.display());
        return Err(io::Error::new(io::ErrorKind::InvalidData, what));
    }
    Ok(file)
}

fn remove_file(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

impl Blob for File {
    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read(mut self: Box<Self>, range: Range<u64>) -> io::Result<Box<dyn Read + Send>> {
        self.seek(SeekFrom::Start(range.start))?;
        Ok(Box::new(self.take(range.end - range.start)))
    }
}
