//! Where the operator wants blobs to lie: in the data directory, a shared folder, or a bucket.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Blobs, Files, RESULTS};
use crate::disk::{Disk, Shortage};

/// Name of the folder in the data directory for files that are on their way to a bucket, and copies of its objects.
const SCRATCH: &str = "scratch";

/// The value of `--blobs`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// A folder, which other services may use too.
    Folder(PathBuf),
    /// Objects of a bucket of S3, whose names begin with a prefix.
    S3 {
        /// The bucket.
        bucket: String,
        /// The prefix; may be empty.
        prefix: String,
    },
}

/// Why blobs cannot be kept at a place.
#[derive(Debug, thiserror::Error)]
#[error("the blobs at {place} cannot be used: {why}")]
pub(crate) struct OpenError {
    place: String,
    why: String,
}

impl Place {
    /// Reads the value of the option.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        if text.is_empty() {
            return Err("must be a folder, or s3://BUCKET/PREFIX".into());
        }
        let Some((scheme, rest)) = text.split_once("://") else { return Ok(Self::Folder(text.into())) };
        if scheme != "s3" {
            return Err("must be a folder, or s3://BUCKET/PREFIX".into());
        }
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let prefix = prefix.trim_end_matches('/');
        let plain = |part: &str| {
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.=".contains(c);
            !part.is_empty() && part != "." && part != ".." && part.chars().all(is_plain)
        };
        if !plain(bucket) || !(prefix.is_empty() || prefix.split('/').all(plain)) {
            return Err(
                "must be s3://BUCKET/PREFIX, of letters, digits, `-`, `_`, `.` and `=`, and `/` between folders"
                    .into(),
            );
        }
        Ok(Self::S3 { bucket: bucket.to_owned(), prefix: prefix.to_owned() })
    }

    /// Opens the blobs there, for a service with that data directory, on whose file system so many bytes stay free.
    /// Blocks the thread.
    ///
    /// # Errors
    /// The place cannot be used, and why.
    pub(crate) fn open(
        &self,
        data_dir: &Path,
        min_free_bytes: Option<u64>,
    ) -> Result<Arc<dyn Blobs>, OpenError> {
        self.try_open(data_dir, min_free_bytes)
            .map_err(|error| OpenError { place: self.to_string(), why: error.to_string() })
    }

    fn try_open(&self, data_dir: &Path, min_free_bytes: Option<u64>) -> io::Result<Arc<dyn Blobs>> {
        match self {
            Self::Folder(folder) => Ok(Arc::new(Files::shared(folder.clone())?.keeping(RESULTS)?)),
            Self::S3 { bucket, prefix } => {
                let disk = Disk::new(data_dir.to_owned(), min_free_bytes, Shortage::default());
                Ok(Arc::new(super::Objects::s3(bucket, prefix, data_dir.join(SCRATCH), disk)?))
            }
        }
    }

    /// Removes what an earlier life of a service has left on the way to a bucket.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn empty_scratch(data_dir: &Path) -> io::Result<()> {
        match std::fs::remove_dir_all(data_dir.join(SCRATCH)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => write!(f, "{}", folder.display()),
            Self::S3 { bucket, prefix } => write!(f, "s3://{bucket}/{prefix}"),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_folder_or_a_bucket() {
        assert_eq!(Place::read("/srv/blobs"), Ok(Place::Folder("/srv/blobs".into())));
        for bad in [
            "",
            "http://host/bucket",
            "s3://",
            "s3:///prefix",
            "s3://bucket/a//b",
            "s3://bucket/../b",
            "s3://b?x=1",
        ] {
            let refused = Place::read(bad).unwrap_err();
            assert!(refused.contains("s3://BUCKET/PREFIX"), "{bad}: {refused}");
        }
        let bucket = Place::read("s3://bucket/a/b/");
        assert_eq!(bucket, Ok(Place::S3 { bucket: "bucket".into(), prefix: "a/b".into() }));
    }
}
