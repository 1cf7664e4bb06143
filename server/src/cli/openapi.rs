//! `packstone openapi`.

use super::{Failure, print};

pub(super) fn run() -> Result<(), Failure> {
    print(&crate::http::yaml()?)
}
