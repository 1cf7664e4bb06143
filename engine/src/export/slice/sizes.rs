//! How long the edges of the mesh of a cut are.

use super::Outline;

/// Elements along the circumference of a circle; the user of the script may say otherwise.
const SEGMENTS: u32 = 20;
/// Elements along the longer edge where nothing asks for smaller ones.
const ELEMENTS_PER_EDGE: f64 = 25.0;

/// How long the edges of a mesh are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    /// Elements along the circumference of a section.
    pub(super) segments: u32,
    /// Edge of the largest element.
    pub(super) longest_mm: f64,
}

impl Sizes {
    /// Those where nothing else is requested.
    pub(super) fn of(outline: &Outline) -> Self {
        let [[u0, u1], [v0, v1]] = outline.bounds_mm();
        Self { segments: SEGMENTS, longest_mm: (u1 - u0).max(v1 - v0) / ELEMENTS_PER_EDGE }
    }
}
