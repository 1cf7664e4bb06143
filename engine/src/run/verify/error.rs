//! Why a packing or a failure is not accepted.

use std::io;

use crate::error::PackError;
use crate::memory::OutOfMemory;

/// Why a packing or a failure is not accepted.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// It does not answer the request.
    #[error("{0}")]
    Wrong(String),
    /// The control asked to stop; nothing is said of the packing.
    #[error("the check was stopped on request")]
    Stopped,
    /// The system refused memory that the check needs; nothing is said of the packing.
    #[error("out of memory: the check needs {} MB more", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// The grains could not be read; nothing is said of the packing.
    #[error("the packing cannot be read: {0}")]
    Read(io::Error),
}

impl VerifyError {
    pub(super) fn wrong<T>(what: impl Into<String>) -> Result<T, Self> {
        Err(Self::Wrong(what.into()))
    }
}

impl From<OutOfMemory> for VerifyError {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

impl From<PackError> for VerifyError {
    fn from(error: PackError) -> Self {
        match error {
            PackError::Stopped { .. } => Self::Stopped,
            PackError::OutOfMemory { bytes } => Self::OutOfMemory { bytes },
            other => Self::Wrong(format!("there is no packing of this request: {other}")),
        }
    }
}

impl From<io::Error> for VerifyError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::InvalidData => Self::Wrong(error.to_string()),
            _ => Self::Read(error),
        }
    }
}
