//! The sieve size of a polyhedron: the least square, over all directions, that holds its shadow.
//!
//! `max(width along e1, width along e2)` is minimised over all pairs of directions at right angles. The widths along
//! [`DIRECTIONS`] directions that fill the half sphere evenly give the frames to start from: the best pairs that are
//! nearly at right angles and lie apart from one another. A width is the largest of the distances of two corners along
//! a direction, each of which is nearly linear in a small turn of the frame, so that the best turn is that of a linear
//! programme ([`minimax`](super::minimax)); pairs of corners join it as they are found (sequential linear programming
//! with a trust region). The result is the width of a square that the shadow fits into; the least of all starts is
//! taken for the minimum.

use std::sync::OnceLock;

use nalgebra::Vector3;

use super::Polyhedron;
use super::minimax::{Plane, least_maximum};
use crate::elementary::{cos, sin};
use crate::sorting;

/// Directions whose widths are looked at; they lie about 0.1 rad apart.
const DIRECTIONS: usize = 600;
/// Cosine up to which two of them are taken to be at right angles.
const RIGHT_ANGLE: f64 = 0.1;
/// Most frames that the search starts from: nearly round bodies and rods have many that are nearly as good.
const STARTS: usize = 90;
/// Cosine of the angle by which these lie apart.
const APART: f64 = 0.98;
/// Most turns of a frame.
const TURNS: usize = 100;
/// First trust in a linear step, and the last, in radians.
const FIRST_TRUST: f64 = 0.08;
const LAST_TRUST: f64 = 1.0e-7;
/// Gain of a turn, over the size of the body, below which the search ends.
const LEAST_GAIN: f64 = 1.0e-10;

/// Two directions at right angles, and the larger width along them.
#[derive(Clone, Copy)]
struct Frame {
    axes: [Vector3<f64>; 2],
    opening: f64,
}

/// Two corners at the ends of the width along an axis of the frame.
#[derive(Clone, Copy, PartialEq)]
struct Ends {
    axis: usize,
    from: u32,
    to: u32,
}

/// The least and the largest coordinate along a direction.
fn extent(corners: &[Vector3<f64>], axis: &Vector3<f64>) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for corner in corners {
        let height = corner.dot(axis);
        low = if height < low { height } else { low };
        high = if height > high { height } else { high };
    }
    [low, high]
}

/// The corners with the least and the largest coordinate, and their distance along the direction.
fn ends(corners: &[Vector3<f64>], axis: &Vector3<f64>) -> ([u32; 2], f64) {
    let (mut low, mut high) = ((f64::INFINITY, 0), (f64::NEG_INFINITY, 0));
    for (i, corner) in corners.iter().enumerate() {
        let height = corner.dot(axis);
        if height < low.0 {
            low = (height, i as u32);
        }
        if height > high.0 {
            high = (height, i as u32);
        }
    }
    ([low.1, high.1], high.0 - low.0)
}

/// The sieve size, once it is known. It follows from the rest of a polyhedron, so that any two are equal.
#[derive(Clone, Debug, Default)]
pub(super) struct SieveSize(OnceLock<f64>);

impl PartialEq for SieveSize {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Polyhedron {
    /// Sieve size: the edge of the least square opening that the body passes by moving straight. It is computed when it
    /// is first asked for.
    #[must_use]
    pub fn sieve_size(&self) -> f64 {
        *self.sieve_size.0.get_or_init(|| {
            let size = self.outer_radius() - self.rounding();
            let of_start = |axes| narrowed(self.vertices(), size, axes);
            let least = starts(self.vertices()).into_iter().map(of_start).fold(f64::INFINITY, f64::min);
            least + 2.0 * self.rounding()
        })
    }
}

/// The least opening near a frame.
fn narrowed(corners: &[Vector3<f64>], size: f64, start: [Vector3<f64>; 2]) -> f64 {
    let mut known: Vec<Ends> = Vec::new();
    // The opening of a frame; whether its ends were known.
    let look = |axes: [Vector3<f64>; 2], known: &mut Vec<Ends>| {
        let before = known.len();
        let mut opening = 0.0_f64;
        for (axis, direction) in axes.iter().enumerate() {
            let ([from, to], width) = ends(corners, direction);
            opening = opening.max(width);
            let ends = Ends { axis, from, to };
            if !known.contains(&ends) {
                known.push(ends);
            }
        }
        (Frame { axes, opening }, known.len() == before)
    };
    let (mut best, _) = look(start, &mut known);
    let mut trust = FIRST_TRUST;
    let mut planes = Vec::new();
    for _ in 0..TURNS {
        planes.clear();
        planes.extend(known.iter().map(|ends| {
            let axis = best.axes[ends.axis];
            let way = corners[ends.to as usize] - corners[ends.from as usize];
            // Turned by w, the axis e becomes e + w x e.
            Plane { value: way.dot(&axis), slope: axis.cross(&way) }
        }));
        let (turn, promised) = least_maximum(&planes, trust);
        let promised = best.opening - promised;
        if promised < LEAST_GAIN * size {
            break;
        }
        let [x, y] = best.axes;
        let x = (x + turn.cross(&x)).normalize();
        let y = y + turn.cross(&y);
        let (next, were_known) = look([x, (y - x * y.dot(&x)).normalize()], &mut known);
        let gain = best.opening - next.opening;
        if gain > 0.0 {
            best = next;
        }
        if were_known && gain < 0.5 * promised {
            trust /= 4.0;
            if trust < LAST_TRUST {
                break;
            }
        }
    }
    best.opening
}

/// The frames to start from.
fn starts(corners: &[Vector3<f64>]) -> Vec<[Vector3<f64>; 2]> {
    let mut widths: Vec<(f64, Vector3<f64>)> = (0..DIRECTIONS)
        .map(|i| {
            let axis = direction(i);
            let [low, high] = extent(corners, &axis);
            (high - low, axis)
        })
        .collect();
    sorting::by_number(&mut widths, |width| width.0);
    let mut starts: Vec<[Vector3<f64>; 2]> = Vec::with_capacity(STARTS);
    for (j, (_, second)) in widths.iter().enumerate() {
        for (_, first) in &widths[..j] {
            let cosine = first.dot(second);
            if cosine.abs() > RIGHT_ANGLE {
                continue;
            }
            let second = (second - first * cosine).normalize();
            let near = |start: &[Vector3<f64>; 2]| {
                let along = |p: usize, axis: &Vector3<f64>| start[p].dot(axis).abs() > APART;
                along(0, first) && along(1, &second) || along(1, first) && along(0, &second)
            };
            if !starts.iter().any(near) {
                starts.push([*first, second]);
                if starts.len() == STARTS {
                    return starts;
                }
            }
        }
    }
    starts
}

/// One of [`DIRECTIONS`] that fill the half sphere evenly, along a Fibonacci spiral (Á. González, Math. Geosci. 42,
/// 49-64, 2010, DOI 10.1007/s11004-009-9257-x).
fn direction(i: usize) -> Vector3<f64> {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let z = (i as f64 + 0.5) / DIRECTIONS as f64;
    let (radius, angle) = ((1.0 - z * z).sqrt(), GOLDEN_ANGLE * i as f64);
    Vector3::new(radius * cos(angle), radius * sin(angle), z)
}
