//! A picture of a cut and nothing else, for image analysis: every pixel is as grey as its share of aggregate.
//!
//! Matrix is 255, aggregate 128, and a pixel's grey is between them by the exact area of the sections in it, so
//! that the mean grey gives the area fraction. Outside of a disc the picture is transparent. Its size in metres
//! is stated in it (chunk `pHYs`).

use std::io::Write;
use std::ops::Range;

use ::png::{BitDepth, ColorType, Encoder, EncodingError, PixelDimensions, Unit};

use super::{Cut, Figure, Image, Outline, Section};
use crate::arrays::Each as _;
use crate::export::ExportError;
use crate::sorting;

/// Grey of the matrix.
const MATRIX: u8 = 255;
/// Grey of aggregates, dark enough for contrast and light enough for ink.
const AGGREGATE: u8 = 128;
/// Rows between two reports of progress.
const ROWS_PER_REPORT: u32 = 64;

/// Pixels as near to squares as the outline allows, that fill it exactly.
pub(super) fn measures(outline: &Outline, pixels_long: u32) -> Image {
    let lengths = outline.bounds_mm().each(|[low, high]| high - low);
    let target = lengths[0].max(lengths[1]) / f64::from(pixels_long);
    let pixels = lengths.each(|length| (length / target).round().clamp(1.0, f64::from(pixels_long)) as u32);
    Image { pixels, pixel_mm: [0, 1].each(|i| lengths[i] / f64::from(pixels[i])) }
}

pub(super) fn write(
    cut: &Cut,
    image: &Image,
    out: &mut dyn Write,
    progress: &dyn Fn(u64, u64) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let [columns, rows] = image.pixels;
    let disc = match cut.outline {
        Outline::Rectangle { .. } => None,
        Outline::Disc { center_mm, radius_mm } => Some((center_mm, Figure::Circle { radius_mm })),
    };
    let mut encoder = Encoder::new(out, columns, rows);
    encoder.set_color(if disc.is_some() { ColorType::GrayscaleAlpha } else { ColorType::Grayscale });
    encoder.set_depth(BitDepth::Eight);
    let [xppu, yppu] = image.pixel_mm.each(|mm| (1000.0 / mm).round() as u32);
    encoder.set_pixel_dims(Some(PixelDimensions { xppu, yppu, unit: Unit::Meter }));
    let mut header = encoder.write_header().map_err(failed)?;
    let mut stream = header.stream_writer().map_err(failed)?;

    let mut raster = Raster::new(cut, image);
    let mut bytes = Vec::new();
    for row in 0..rows {
        if row % ROWS_PER_REPORT == 0 {
            progress(row.into(), rows.into())?;
        }
        let v = raster.band(row);
        raster.fill(v);
        bytes.clear();
        if let Some((center, figure)) = &disc {
            raster.inside.fill(0.0);
            cover(&mut raster.inside, &raster.grid, figure, *center, v);
            for (&aggregate, &inside) in raster.aggregate.iter().zip(&raster.inside) {
                let share = if inside > 0.0 { aggregate / inside } else { 0.0 };
                bytes.extend([grey(share), (255.0 * inside.min(1.0)).round() as u8]);
            }
        } else {
            bytes.extend(raster.aggregate.iter().map(|&share| grey(share)));
        }
        stream.write_all(&bytes)?;
    }
    stream.finish().map_err(failed)?;
    header.finish().map_err(failed)
}

fn grey(share: f64) -> u8 {
    (f64::from(MATRIX) - f64::from(MATRIX - AGGREGATE) * share.clamp(0.0, 1.0)).round() as u8
}

/// The columns of pixels.
struct PixelGrid {
    columns: usize,
    u0: f64,
    pixel_u: f64,
    pixel_area: f64,
}

impl PixelGrid {
    /// Lower edge of a column; the upper one of that before.
    fn edge(&self, column: usize) -> f64 {
        self.u0 + column as f64 * self.pixel_u
    }

    /// The columns that an interval touches.
    fn touched(&self, low: f64, high: f64) -> Range<usize> {
        let column = |u: f64| ((u - self.u0) / self.pixel_u).clamp(0.0, self.columns as f64);
        column(low).floor() as usize..column(high).ceil() as usize
    }
}

/// Shares of aggregate, row by row from the top.
struct Raster<'a> {
    grid: PixelGrid,
    v1: f64,
    pixel_v: f64,
    /// Sections that no row has reached, the uppermost last.
    waiting: Vec<&'a Section>,
    /// Sections that the last row touched.
    active: Vec<&'a Section>,
    aggregate: Vec<f64>,
    inside: Vec<f64>,
}

impl<'a> Raster<'a> {
    fn new(cut: &'a Cut, image: &Image) -> Self {
        let [[u0, _], [_, v1]] = cut.outline.bounds_mm();
        let columns = image.pixels[0] as usize;
        let mut waiting: Vec<&Section> = cut.sections.iter().collect();
        sorting::by_number(&mut waiting, |section| top(section));
        let [pixel_u, pixel_v] = image.pixel_mm;
        Self {
            grid: PixelGrid { columns, u0, pixel_u, pixel_area: pixel_u * pixel_v },
            v1,
            pixel_v,
            waiting,
            active: Vec::new(),
            aggregate: vec![0.0; columns],
            inside: vec![0.0; columns],
        }
    }

    /// From and to along v of a row.
    fn band(&self, row: u32) -> [f64; 2] {
        [f64::from(row + 1), f64::from(row)].each(|rows| self.v1 - rows * self.pixel_v)
    }

    /// Shares of the next row.
    fn fill(&mut self, v: [f64; 2]) {
        while let Some(section) = self.waiting.pop_if(|section| top(section) > v[0]) {
            self.active.push(section);
        }
        self.active.retain(|section| section.center_mm[1] + section.figure.extents_mm()[1][0] < v[1]);
        self.aggregate.fill(0.0);
        for section in &self.active {
            cover(&mut self.aggregate, &self.grid, &section.figure, section.center_mm, v);
        }
    }
}

/// The uppermost that a section reaches.
fn top(section: &Section) -> f64 {
    section.center_mm[1] + section.figure.extents_mm()[1][1]
}

/// Adds the shares of one row's pixels that a figure covers.
fn cover(shares: &mut [f64], grid: &PixelGrid, figure: &Figure, center: [f64; 2], v: [f64; 2]) {
    let Some(span) = figure.span(center, v) else { return };
    // Pixels whose both edges lie where the figure covers the row from edge to edge are covered wholly.
    for column in grid.touched(span.outer[0], span.outer[1]) {
        let u = [grid.edge(column), grid.edge(column + 1)];
        shares[column] += if u[0] >= span.inner[0] && u[1] <= span.inner[1] {
            1.0
        } else {
            figure.area_in(center, u, v) / grid.pixel_area
        };
    }
}

fn failed(error: EncodingError) -> ExportError {
    match error {
        EncodingError::IoError(error) => ExportError::Write(error),
        other => ExportError::CheckFailed(other.to_string()),
    }
}
