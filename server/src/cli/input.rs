//! Reading what a user wrote: a bounded file, or standard input.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use clap::Args;
use serde_json::Value;

use super::exit::{Exit, Failure, cannot_be};
use crate::config::DEFAULT_MAX_BODY_BYTES;
use crate::strict_json;

/// How much of a request is read.
#[derive(Args)]
pub(super) struct Input {
    /// Longest request that is read, in bytes
    #[arg(long, env = "PACKSTONE_MAX_BODY_BYTES", default_value_t = DEFAULT_MAX_BODY_BYTES)]
    max_body_bytes: u64,
}

impl Default for Input {
    fn default() -> Self {
        Self { max_body_bytes: DEFAULT_MAX_BODY_BYTES }
    }
}

impl Input {
    /// Reads a request as JSON; `-` is standard input.
    pub(super) fn json(&self, file: &Path) -> Result<Value, Failure> {
        let text = self.read(file)?;
        strict_json::parse(&text).map_err(|problem| {
            Exit::BadInput.because(format_args!("{} is refused: {}", file.display(), problem.detail))
        })
    }

    fn read(&self, file: &Path) -> Result<Vec<u8>, Failure> {
        let most = self.max_body_bytes;
        let text = read_at_most(file, most)?;
        if text.len() as u64 > most {
            return Err(Exit::BadInput.because(format_args!(
                "{} is refused: it has more than {most} bytes; --max-body-bytes reads more",
                file.display()
            )));
        }
        Ok(text)
    }
}

/// Reads a file, or standard input where it is `-`. Of one that has more than `most` bytes, one byte more is read.
///
/// # Errors
/// The file cannot be read.
pub(super) fn read_at_most(file: &Path, most: u64) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let mut read = |from: &mut dyn io::Read| from.take(most.saturating_add(1)).read_to_end(&mut bytes);
    let read = if file.as_os_str() == "-" {
        read(&mut io::stdin().lock())
    } else {
        File::open(file).and_then(|mut file| read(&mut file))
    };
    read.map_err(|error| cannot_be("read", file, &error))?;
    Ok(bytes)
}
