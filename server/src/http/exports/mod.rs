//! Exports: files that are made of a result.

pub(crate) mod formats;
pub(crate) mod routes;
pub(crate) mod view;
