//! The service about itself: capabilities, health, counters, kinds of problems.

pub(crate) mod key;
pub(crate) mod meta;
pub(crate) mod problem_pages;
