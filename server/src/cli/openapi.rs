//! `packstone openapi`.

use super::{Failure, print};

pub(super) fn run() -> Result<(), Failure> {
    print(&crate::api::openapi::yaml()?)
}
