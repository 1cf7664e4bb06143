//! `packstone webhook-secret`: a fresh secret by which webhooks are signed. Nothing keeps it but whoever reads this
//! output.

use super::exit::Failure;
use super::print;
use crate::webhooks::signature;

pub(super) fn run() -> Result<(), Failure> {
    print(&format!("{}\n", signature::generate()))
}
