//! Jobs: submitting, listing, following and changing them.

pub(crate) mod actions;
pub(crate) mod delete_many;
pub(crate) mod events;
pub(crate) mod get;
pub(crate) mod list;
pub(crate) mod patch;
pub(crate) mod plans;
pub(crate) mod plots;
pub(crate) mod polled;
mod reading;
pub(crate) mod submit;
pub(crate) mod view;
mod waits;
