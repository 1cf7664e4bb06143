//! Lines of the picture: the edges of the specimen and of the cut, and the scale bar with its label.

use super::raster::Image;
use super::scene::{Vector, View, arc, azimuth_of_eye};
use super::shade::Color;
use crate::arrays::Each as _;
use crate::elementary::{cos, hypot, log10, powf, sin};
use crate::request::Specimen;

/// Width of the edges in pixels of a picture of 1600.
pub(super) const EDGE_PIXELS: f64 = 2.6;
/// Colour of the edges.
pub(super) const EDGE_COLOR: Color = [0.012, 0.016, 0.02];

/// The edges that are seen, each a chain of points.
pub(super) fn edges(specimen: &Specimen) -> Vec<Vec<Vector>> {
    let domain = specimen.domain();
    let ([x1, y1, z1], is_round) = (domain.bounds_mm, domain.lateral().is_some());
    let (x, y, z) = (x1 / 2.0, y1 / 2.0, z1 / 2.0);
    let chain = |points: &[[f64; 3]]| points.iter().map(|&p| Vector::from(p)).collect::<Vec<_>>();
    // The three planes of the cut meet along these lines.
    let (front, side) = if is_round { (y - y1 / 2.0, x + x1 / 2.0) } else { (0.0, x1) };
    let mut edges = vec![
        chain(&[[x, y, z], [x, y, z1]]),
        chain(&[[side, y, z], [x, y, z], [x, front, z]]),
        chain(&[[side, y, z], [side, y, z1], [x, y, z1], [x, front, z1], [x, front, z]]),
    ];
    if is_round {
        let eye = azimuth_of_eye();
        edges.extend([
            arc(specimen, z, -2.0, 0.0),
            arc(specimen, z1, 0.0, 6.0),
            arc(specimen, 0.0, eye - 2.0, eye + 2.0),
        ]);
        // The contours of the lateral surface.
        for azimuth in [eye - 2.0, eye + 2.0] {
            edges.push([0.0, z1].iter().filter_map(|&z| arc(specimen, z, azimuth, azimuth).pop()).collect());
        }
    } else {
        edges.extend([
            chain(&[[x, 0.0, z], [x1, 0.0, z], [x1, y, z]]),
            chain(&[[x1, 0.0, z], [x1, 0.0, 0.0]]),
            chain(&[[x1, y, z1], [x1, y1, z1], [0.0, y1, z1], [0.0, 0.0, z1], [x, 0.0, z1]]),
            chain(&[[0.0, 0.0, z1], [0.0, 0.0, 0.0], [x1, 0.0, 0.0], [x1, y1, 0.0], [x1, y1, z1]]),
        ]);
    }
    edges
}

/// Draws a chain of points in pixels, with round ends and joints.
pub(super) fn draw(image: &mut Image, chain: &[[f64; 2]], width: f64, color: Color) {
    let half = width / 2.0;
    let low = |i: usize| chain.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min) - half - 1.0;
    let high = |i: usize| chain.iter().map(|p| p[i]).fold(f64::NEG_INFINITY, f64::max) + half + 1.0;
    let within = |at: f64, most: usize| at.clamp(0.0, most as f64) as usize;
    let columns = within(low(0), image.width)..within(high(0).ceil(), image.width);
    for y in within(low(1), image.height)..within(high(1).ceil(), image.height) {
        for x in columns.clone() {
            let p = [x as f64 + 0.5, y as f64 + 0.5];
            let nearest =
                chain.windows(2).map(|pair| distance(p, pair[0], pair[1])).fold(f64::INFINITY, f64::min);
            let share = (half + 0.5 - nearest).clamp(0.0, 1.0);
            if share > 0.0 {
                image.blend(x as isize, y as isize, color, share as f32);
            }
        }
    }
}

/// Distance from a point to a segment.
fn distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = along[0] * along[0] + along[1] * along[1];
    let t = if length2 > 0.0 { (to[0] * along[0] + to[1] * along[1]) / length2 } else { 0.0 }.clamp(0.0, 1.0);
    hypot(to[0] - t * along[0], to[1] - t * along[1])
}

/// Draws a bar of a round length and the length, in the lower left corner, which the specimen leaves free.
pub(super) fn scale_bar(image: &mut Image, view: &View) {
    let [width, height] = view.pixels.each(f64::from);
    let room_mm = 0.2 * width / view.pixels_per_mm;
    let magnitude = powf(10.0, log10(room_mm).floor());
    let factor = [5.0, 2.0, 1.0].into_iter().find(|factor| factor * magnitude <= room_mm).unwrap_or(1.0);
    let length_mm = factor * magnitude;
    let unit = view.stroke();
    let stroke = 3.2 * unit;
    let (left, bottom) = (8.0 * unit, height - 10.0 * unit);
    let right = left + length_mm * view.pixels_per_mm;
    let tick = 9.0 * unit;
    let bar = [[left, bottom - tick], [left, bottom], [right, bottom], [right, bottom - tick]];
    draw(image, &bar, stroke, EDGE_COLOR);
    let size = 30.0 * unit;
    let text = format!("{length_mm} mm");
    let mut x = left + 10.0 * unit;
    for character in text.chars() {
        let (strokes, advance) = glyph(character);
        for chain in strokes {
            let chain: Vec<[f64; 2]> =
                chain.iter().map(|&[u, v]| [x + u * size, bottom - tick - 6.0 * unit - v * size]).collect();
            draw(image, &chain, stroke, EDGE_COLOR);
        }
        x += advance * size;
    }
}

/// The strokes of a character of height 1, and its width.
fn glyph(character: char) -> (Vec<Vec<[f64; 2]>>, f64) {
    let ellipse = |cx: f64, cy: f64, rx: f64, ry: f64, from: f64, to: f64| -> Vec<[f64; 2]> {
        (0..=24)
            .map(|i| {
                let angle = (from + (to - from) * f64::from(i) / 24.0).to_radians();
                [cx + rx * cos(angle), cy + ry * sin(angle)]
            })
            .collect()
    };
    let strokes = match character {
        '0' => vec![ellipse(0.26, 0.5, 0.26, 0.5, 0.0, 360.0)],
        '1' => vec![vec![[0.08, 0.78], [0.3, 1.0], [0.3, 0.0]]],
        '2' => {
            let mut chain = ellipse(0.26, 0.74, 0.26, 0.26, 170.0, -35.0);
            chain.extend([[0.0, 0.0], [0.54, 0.0]]);
            vec![chain]
        }
        '5' => {
            let mut chain = vec![[0.48, 1.0], [0.08, 1.0], [0.04, 0.56]];
            chain.extend(ellipse(0.24, 0.32, 0.28, 0.32, 125.0, -150.0));
            vec![chain]
        }
        '.' => vec![vec![[0.08, 0.0], [0.08, 0.01]]],
        'm' => vec![
            vec![[0.0, 0.66], [0.0, 0.0]],
            [ellipse(0.18, 0.46, 0.18, 0.2, 180.0, 0.0), vec![[0.36, 0.0]]].concat(),
            [ellipse(0.54, 0.46, 0.18, 0.2, 180.0, 0.0), vec![[0.72, 0.0]]].concat(),
        ],
        _ => Vec::new(),
    };
    let advance = match character {
        'm' => 0.92,
        '.' => 0.28,
        ' ' => 0.4,
        _ => 0.74,
    };
    (strokes, advance)
}
