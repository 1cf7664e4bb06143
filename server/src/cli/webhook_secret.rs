//! `packstone webhook-secret`: a fresh secret by which webhooks are signed. Nothing keeps it but whoever reads this
//! output.

use super::exit::{Exit, Failure};
use super::{check_output, print};
use crate::webhooks::signature;

pub(super) fn run() -> Result<(), Failure> {
    check_output().map_err(|error| Exit::Machine.because(format_args!("no secret was made: {error}")))?;
    print(&format!("{}\n", signature::generate()))
}
