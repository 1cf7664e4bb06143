//! `packstone openapi`.

use super::exit::Failure;
use super::print;

pub(super) fn run() -> Result<(), Failure> {
    print(crate::http::OPENAPI_YAML)
}
