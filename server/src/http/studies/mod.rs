//! Studies: submitting, listing and changing them, and the table of their runs.

pub(crate) mod actions;
pub(crate) mod get;
pub(crate) mod list;
pub(crate) mod patch;
pub(crate) mod plots;
pub(crate) mod submit;
pub(crate) mod table;
pub(crate) mod view;
