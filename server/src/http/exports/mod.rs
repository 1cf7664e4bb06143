//! Exports: files that are made of a job's result, one resource for all types.
//!
//! `/v1/jobs/{id}/exports/{type}` with the options as query parameters names an export. Requests with the same options
//! name the same export, so that it is made once, whichever of the routes or `postprocess` asked for it first.

mod address;
pub(crate) mod delete;
pub(crate) mod file;
pub(crate) mod list;
mod making;
pub(crate) mod media;
#[cfg(test)]
mod responses;
pub(crate) mod script;
pub(crate) mod start;
pub(crate) mod status;
pub(crate) mod view;

pub(crate) use address::ExportOptions;
