//! From a grading to diameters.
pub mod standard;
