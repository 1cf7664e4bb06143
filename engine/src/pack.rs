//! One run from request to checked packing: take, place, verify.

use crate::control::Control;
use crate::error::PackError;
use crate::packing::Packing;
use crate::plan::Limits;
use crate::request::PackingRequest;

/// Computes a packing.
///
/// # Errors
/// See [`PackError`]; a packing that fails its own check is never returned.
pub fn pack(request: &PackingRequest, limits: &Limits, control: &dyn Control) -> Result<Packing, PackError> {
    let _ = (request, limits, control);
    unimplemented!()
}
