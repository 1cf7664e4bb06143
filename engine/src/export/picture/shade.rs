//! Colours and light. All colours here are linear; the picture is written in sRGB.

use super::scene::{Hit, Scene, Vector, View};
use crate::arrays::{self, Each as _};
use crate::elementary::{exp, ln};

/// A linear colour.
pub(super) type Color = [f32; 3];

/// Behind the specimen.
pub(super) const BACKGROUND: Color = [1.0; 3];
/// The matrix on the planes of the cut.
const MATRIX: [f64; 3] = [0.60, 0.615, 0.61];
/// The matrix in the depth, where no light returns.
const DEPTH: [f64; 3] = [0.045, 0.055, 0.065];
/// Colours of grains from the smallest diameter to the largest, even on a logarithmic scale.
const GRAINS: [[f64; 3]; 5] =
    [[0.80, 0.67, 0.46], [0.67, 0.44, 0.235], [0.47, 0.225, 0.13], [0.25, 0.25, 0.28], [0.115, 0.165, 0.23]];
/// Brightness of cut grains over that of whole ones, and their line: width in pixels and brightness.
const CUT: f64 = 1.12;
const LINE_PIXELS: f64 = 1.5;
const LINE: f64 = 0.45;
/// From a surface towards the main light; not normalised.
const TOWARDS_LIGHT: [f64; 3] = [0.22, -0.74, 1.0];

/// The light of one ray.
pub(super) fn color(scene: &Scene<'_>, view: &View, hit: &Hit) -> Color {
    let linear = match *hit {
        Hit::Background => return BACKGROUND,
        Hit::Deep { at } => scaled(DEPTH, light(&scene.normal(&at))),
        Hit::Grain { grain, at, depth } => {
            let body = scene.grain(grain);
            let normal = body.normal(&at);
            let open = 1.0 - 0.85 * scene.occlusion(&at, &normal, body.number);
            let halfway = (Vector::from(TOWARDS_LIGHT).normalize() + view.eye).normalize();
            let shine = 0.10 * normal.dot(&halfway).max(0.0).powi(40);
            let lit = scaled(tone(scene, grain), light(&normal) * open).each(|c| c + shine * open);
            let deep = scaled(DEPTH, light(&scene.normal(&(at + view.eye * depth))));
            mixed(deep, lit, exp(-depth / scene.fade))
        }
        Hit::Cut { axis, at, grain } => {
            let normal = if axis == 1 { -Vector::y() } else { unit(axis) };
            let flat = flat(scene, view, &at, &normal, grain);
            // The other planes of the cut stand before a part of the sky.
            let reach = scene.fade * 2.0;
            scaled(flat, light(&normal) * (1.0 - 0.38 * exp(-scene.to_corner(axis, &at) / reach)))
        }
        Hit::Face { axis, at, grain } => {
            let normal = if axis == 1 { -Vector::y() } else { unit(axis) };
            scaled(flat(scene, view, &at, &normal, Some(grain)), light(&normal))
        }
    };
    linear.each(|c| c.clamp(0.0, 1.0) as f32)
}

/// Colour of a plane that cuts grains: matrix, or a section with a line around it.
fn flat(scene: &Scene<'_>, view: &View, at: &Vector, normal: &Vector, grain: Option<u32>) -> [f64; 3] {
    let Some(grain) = grain else { return MATRIX };
    let line = LINE_PIXELS * view.stroke() / view.pixels_per_mm;
    let is_line = scene.grain(grain).edge_distance(at, normal) < line;
    scaled(tone(scene, grain), if is_line { LINE } else { CUT })
}

/// Colour of a grain: by its diameter, a little lighter or darker by its number.
fn tone(scene: &Scene<'_>, grain: u32) -> [f64; 3] {
    let sphere = scene.grain(grain);
    let [low, high] = scene.diameters;
    let along =
        if high > low { ln(2.0 * sphere.radius / low) / ln(high / low) } else { 0.25 }.clamp(0.0, 1.0);
    let at = along * (GRAINS.len() - 1) as f64;
    let below = (at as usize).min(GRAINS.len() - 2);
    let base = mixed(GRAINS[below], GRAINS[below + 1], at - below as f64);
    // The finaliser of SplitMix64 spreads consecutive numbers evenly.
    let mut bits = u64::from(sphere.number).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits ^= bits >> 27;
    let share = (bits >> 11) as f64 / (1_u64 << 53) as f64;
    scaled(base, 0.80 + 0.40 * share)
}

/// Light on a surface with that normal: one main light, and a sky that is brighter above.
fn light(normal: &Vector) -> f64 {
    let main = normal.dot(&Vector::from(TOWARDS_LIGHT).normalize()).max(0.0);
    let sky = 0.5 + 0.5 * normal.z;
    0.16 + 0.26 * sky + 0.74 * main
}

fn unit(axis: usize) -> Vector {
    Vector::from_fn(|a, _| f64::from(u8::from(a == axis)))
}

fn scaled(color: [f64; 3], factor: f64) -> [f64; 3] {
    color.each(|c| c * factor)
}

fn mixed(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    arrays::from_fn(|i| a[i] + (b[i] - a[i]) * share)
}
