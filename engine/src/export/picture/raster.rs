//! The pixels: one ray for each, and nine where a contour crosses it.

use std::num::NonZeroUsize;

use super::scene::{Hit, Scene, View};
use super::shade::{self, Color};
use crate::arrays::{self, Each as _};
use crate::elementary::powf;
use crate::export::ExportError;
use crate::threads::share;

/// Rays along each edge of a pixel that a contour crosses.
const FINE: usize = 3;

/// A picture in linear colours, row by row from the top.
pub(super) struct Image {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<Color>,
}

impl Image {
    /// Mixes a colour into a pixel; positions outside are left out.
    pub(super) fn blend(&mut self, x: isize, y: isize, color: Color, share: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width && y < self.height {
            let pixel = &mut self.pixels[y * self.width + x];
            *pixel = arrays::from_fn(|i| pixel[i] + (color[i] - pixel[i]) * share);
        }
    }

    /// The bytes of the picture in sRGB (IEC 61966-2-1).
    pub(super) fn to_srgb(&self) -> Vec<u8> {
        const STEPS: usize = 4095;
        let table: Vec<u8> = (0..=STEPS)
            .map(|i| {
                let linear = i as f64 / STEPS as f64;
                let coded = if linear <= 0.003_130_8 {
                    12.92 * linear
                } else {
                    1.055 * powf(linear, 1.0 / 2.4) - 0.055
                };
                (255.0 * coded).round() as u8
            })
            .collect();
        self.pixels.iter().flatten().map(|&c| table[(c * STEPS as f32).round() as usize]).collect()
    }
}

/// Renders the scene. `step` hears of the rows done and may stop the work.
pub(super) fn render(
    scene: &Scene<'_>,
    view: &View,
    threads: NonZeroUsize,
    rows_per_step: usize,
    step: &mut dyn FnMut(u64) -> Result<(), ExportError>,
) -> Result<Image, ExportError> {
    let [width, height] = view.pixels.each(|n| n as usize);
    let mut coarse = vec![(0_u32, shade::BACKGROUND); width * height];
    let ray = |x: f64, y: f64| {
        let hit: Hit = scene.trace(view.unproject([x, y]));
        (hit.surface(), shade::color(scene, view, &hit))
    };
    // The first pass takes about a quarter of the time.
    let mut done = 0.0;
    in_bands(
        &mut coarse,
        width,
        threads,
        rows_per_step,
        |i, pixel| {
            *pixel = ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        },
        &mut |rows| {
            done += 0.25 * rows as f64;
            step(done as u64)
        },
    )?;
    let mut pixels = vec![shade::BACKGROUND; width * height];
    in_bands(
        &mut pixels,
        width,
        threads,
        rows_per_step,
        |i, pixel| {
            let (x, y) = (i % width, i / width);
            let (surface, color) = coarse[i];
            let differs = |i: usize| coarse[i].0 != surface;
            let is_contour = (x > 0 && differs(i - 1))
                || (x + 1 < width && differs(i + 1))
                || (y > 0 && differs(i - width))
                || (y + 1 < height && differs(i + width));
            *pixel = if is_contour { fine(x, y, color, &ray) } else { color };
        },
        &mut |rows| {
            done += 0.75 * rows as f64;
            step(done as u64)
        },
    )?;
    Ok(Image { width, height, pixels })
}

/// Mean colour of the rays of one pixel, whose middle one is known.
fn fine(x: usize, y: usize, middle: Color, ray: &impl Fn(f64, f64) -> (u32, Color)) -> Color {
    let mut sum = middle;
    for i in (0..FINE * FINE).filter(|&i| i != FINE * FINE / 2) {
        let offset = |i: usize| (i as f64 + 0.5) / FINE as f64;
        let (_, color) = ray(x as f64 + offset(i % FINE), y as f64 + offset(i / FINE));
        sum = arrays::from_fn(|c| sum[c] + color[c]);
    }
    sum.each(|c| c / (FINE * FINE) as f32)
}

/// Sets every pixel by its index, in bands of rows that the threads share.
fn in_bands<T: Send>(
    pixels: &mut [T],
    width: usize,
    threads: NonZeroUsize,
    rows_per_step: usize,
    set: impl Fn(usize, &mut T) + Sync,
    step: &mut dyn FnMut(usize) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let band = rows_per_step * width;
    for (number, pixels) in pixels.chunks_mut(band).enumerate() {
        let rows = pixels.len() / width;
        let of_thread = rows.div_ceil(threads.get()) * width;
        let mut parts: Vec<&mut [T]> = pixels.chunks_mut(of_thread).collect();
        share(threads, &mut parts, |part, pixels| {
            let first = number * band + part * of_thread;
            pixels.iter_mut().enumerate().for_each(|(i, pixel)| set(first + i, pixel));
        });
        step(rows)?;
    }
    Ok(())
}
