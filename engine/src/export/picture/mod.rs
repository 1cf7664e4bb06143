//! A picture of a packing, ray cast on the processor: a quarter of the upper half is cut away.
//!
//! The projection is parallel (axonometric), so grains appear at their true diameter everywhere and one scale bar holds
//! for all of them. The eye is at large `x`, small `y` and large `z`. The octant of the specimen next to the eye is
//! removed: on the three planes of the cut the matrix is opaque and grains are flat sections. Behind the outer surface
//! the matrix is translucent: the light of a grain fades with its depth `s` as `exp(-s / L)`, with `L` a fixed share of
//! the mean free path `V / sum(pi r^2)` between grains. Rays step through a uniform grid (Amanatides, Woo 1987, "A fast
//! voxel traversal algorithm for ray tracing", Eurographics, doi:10.2312/egtp.19871000). A ray meets an ellipsoid where
//! the quadratic form of its inverse shape matrix is 1, and a polyhedron where it meets the first of its faces, edges
//! and vertices. Ambient occlusion is the sum of the solid angles of the grains nearby. Pixels that a contour crosses
//! get nine rays, others one.
//!
//! The same packing and options give the same bytes, whatever the number of threads.

mod lines;
mod raster;
mod scene;
mod shade;

use std::io::Write;
use std::num::NonZeroUsize;

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, PixelDimensions, Unit};

use crate::control::Control;
use crate::export::steps::Steps;
use crate::export::{ExportError, Model, go_on};
use crate::grain::PlacedGrains;
use scene::{Scene, View};

/// Pixels along the longer edge of a picture, where none are asked for.
pub const DEFAULT_PIXELS: u32 = 1500;

/// Size of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureOptions {
    /// Pixels along the longer edge, 64 to 8192; values outside are set to the bound.
    pub pixels: u32,
    /// Threads that render, at least 1. The bytes do not depend on it.
    pub threads: usize,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self { pixels: DEFAULT_PIXELS, threads: 1 }
    }
}

/// Renders a packing and writes it as PNG (RGB, 8 bit, with its scale in the chunk `pHYs`).
///
/// # Errors
/// [`ExportError::Stopped`] where `control` says so, and [`ExportError::Write`].
pub fn write(
    model: &Model<'_>,
    options: &PictureOptions,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    go_on(control)?;
    let grains = PlacedGrains::new(model.grains)?;
    let scene = Scene::new(model, &grains)?;
    let edges = lines::edges(model.specimen);
    let view = View::framing(model.specimen, options.pixels.clamp(64, 8192));
    let rows_per_step = 64;
    let total = u64::from(view.pixels[1]);
    let mut step = |done: u64| {
        Steps { control, total: total as usize, unit: "rows", message: "" }.report(done as usize);
        go_on(control)
    };
    let mut image = raster::render(
        &scene,
        &view,
        NonZeroUsize::new(options.threads).unwrap_or(NonZeroUsize::MIN),
        rows_per_step,
        &mut step,
    )?;
    for edge in &edges {
        lines::draw(&mut image, &view.projected(edge), lines::EDGE_PIXELS * view.stroke(), lines::EDGE_COLOR);
    }
    lines::scale_bar(&mut image, &view);

    let mut encoder = Encoder::new(out, view.pixels[0], view.pixels[1]);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Balanced);
    let per_metre = (1000.0 * view.pixels_per_mm).round() as u32;
    encoder.set_pixel_dims(Some(PixelDimensions { xppu: per_metre, yppu: per_metre, unit: Unit::Meter }));
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&image.to_srgb()).map_err(failed)?;
    writer.finish().map_err(failed)
}

fn failed(error: EncodingError) -> ExportError {
    match error {
        EncodingError::IoError(error) => ExportError::Write(error),
        other => ExportError::CheckFailed(other.to_string()),
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
