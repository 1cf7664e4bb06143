//! The sieve size of a polyhedron: the least square, over all directions, that holds its shadow.
//!
//! `max(width along e1, width along e2)` is minimised over all pairs of directions at right angles. The search starts
//! from the frames of a grid over all rotations whose opening is less than that of their neighbours, and, once it knows
//! a small opening, from its frame turned about each of its axes: the cross-section of a rod has many openings that
//! are nearly as small. A width is the largest of the distances of two corners along a direction, each of which is
//! nearly linear in a small turn of the frame, so that the best turn is that of a linear programme
//! ([`minimax`](super::minimax)); pairs of corners join it as they are found (sequential linear programming with a
//! trust region). All starts take some turns, those with the smallest openings are followed further. The result is the
//! width of a square that the shadow fits into, with the directions of its sides, and the least that was found. The
//! check of a packing proves by another method that there is no smaller one (`crate::check`).

use std::sync::OnceLock;

use nalgebra::Vector3;

use super::Polyhedron;
use super::minimax::{Plane, least_maximum};
use crate::arrays;
use crate::elementary::{cos, sin};
use crate::sorting;

/// Frames of the grid along each coordinate of a rotation; they lie about 0.2 rad apart.
const GRID: [usize; 3] = [14, 14, 6];
/// Largest coordinates of a rotation, up to the symmetry of a square: `tan(90°/2)` and `tan(45°/2)`.
const FARTHEST: [f64; 3] = [1.0, 1.0, std::f64::consts::SQRT_2 - 1.0];
/// Openings over the least of the grid below which all frames are starts: nearly round bodies have many minima that
/// lie closer together than the grid.
const SMALL: f64 = 1.12;
/// Turns of all searches, and by how much the openings that are followed on may exceed the least one then.
const HEATS: [(usize, f64); 3] = [(3, 0.06), (4, 0.015), (8, 1.0e-3)];
/// Angles by which the best frame is turned about its axes for further starts: this many to each side, this far apart.
const ANGLES: i32 = 8;
const BETWEEN_ANGLES: f64 = 0.1;
/// Most turns of a frame.
const TURNS: usize = 100;
/// First trust in a linear step, and the last, in radians.
const FIRST_TRUST: f64 = 0.08;
const LAST_TRUST: f64 = 1.0e-9;
/// Gain of a turn, over the size of the body, below which the search ends.
const LEAST_GAIN: f64 = 1.0e-13;

/// Cosine of the angle within which the axes of two frames are the same: a hundredth of a radian.
const SAME: f64 = 1.0 - 5.0e-5;

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

/// The least square opening that a body passes by moving straight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SievePassage {
    /// Edge of the square, in units of the polyhedron.
    pub size: f64,
    /// Unit directions of the sides, at right angles. The body is no wider along them than the square.
    pub sides: [Vector3<f64>; 2],
}

/// The passage, once it is known. It follows from the rest of a polyhedron, so that any two are equal.
#[derive(Clone, Debug, Default)]
pub(super) struct Passage(OnceLock<SievePassage>);

impl PartialEq for Passage {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Polyhedron {
    /// Sieve size: the edge of the least square opening that the body passes by moving straight. It is computed when it
    /// is first asked for.
    #[must_use]
    pub fn sieve_size(&self) -> f64 {
        self.sieve_passage().size
    }

    /// The opening of [`Self::sieve_size`] with its directions, by which anybody can see that the body passes.
    #[must_use]
    pub fn sieve_passage(&self) -> SievePassage {
        *self.passage.0.get_or_init(|| {
            let least = least_opening(self.vertices(), self.outer_radius() - self.rounding());
            SievePassage { size: least.opening + 2.0 * self.rounding(), sides: least.axes }
        })
    }
}

#[cfg(test)]
impl Polyhedron {
    /// The body as if a search had found this opening.
    pub(crate) fn with_passage(&self, passage: SievePassage) -> Self {
        Self { passage: Passage(OnceLock::from(passage)), ..self.clone() }
    }
}

/// The frame with the least opening of a body of such a size.
fn least_opening(corners: &[Vector3<f64>], size: f64) -> Frame {
    let search = |axes| Search::new(corners, size, axes);
    let mut leaders: Vec<Search<'_>> = starts(corners).into_iter().map(search).collect();
    race(&mut leaders);
    let turned = leaders.iter().flat_map(|leader| turned(leader.best.axes)).map(search);
    let mut others: Vec<Search<'_>> = turned.collect();
    race(&mut others);
    leaders.extend(others);
    for leader in &mut leaders {
        leader.turn(TURNS);
    }
    sorting::by_number(&mut leaders, |search| search.best.opening);
    leaders.first().map_or(Frame { axes: [Vector3::x(), Vector3::y()], opening: 0.0 }, |search| search.best)
}

/// Lets all searches take some turns, and keeps those that may become the best one.
fn race(searches: &mut Vec<Search<'_>>) {
    for (turns, margin) in HEATS {
        for search in &mut *searches {
            search.turn(turns);
        }
        sorting::by_number(searches, |search| search.best.opening);
        let bound = (1.0 + margin) * searches.first().map_or(0.0, |search| search.best.opening);
        let mut kept: Vec<Frame> = Vec::new();
        searches.retain(|search| {
            let is_kept = search.best.opening <= bound && !kept.iter().any(|frame| frame.is(&search.best));
            if is_kept {
                kept.push(search.best);
            }
            is_kept
        });
    }
}

impl Frame {
    /// Whether two frames are the same place, up to the order and the signs of the axes.
    fn is(&self, other: &Self) -> bool {
        let along = |a: usize, b: usize| self.axes[a].dot(&other.axes[b]).abs() > SAME;
        along(0, 0) && along(1, 1) || along(0, 1) && along(1, 0)
    }
}

/// A search from one frame to others of smaller openings.
struct Search<'a> {
    corners: &'a [Vector3<f64>],
    size: f64,
    best: Frame,
    /// Pairs of corners that were at the ends of a width.
    known: Vec<Ends>,
    trust: f64,
    is_over: bool,
}

impl<'a> Search<'a> {
    fn new(corners: &'a [Vector3<f64>], size: f64, axes: [Vector3<f64>; 2]) -> Self {
        let best = Frame { axes, opening: f64::INFINITY };
        let mut search = Self { corners, size, best, known: Vec::new(), trust: FIRST_TRUST, is_over: false };
        search.best = search.look(axes).0;
        search
    }

    /// The opening of a frame; whether its ends were known.
    fn look(&mut self, axes: [Vector3<f64>; 2]) -> (Frame, bool) {
        let before = self.known.len();
        let mut opening = 0.0_f64;
        for (axis, direction) in axes.iter().enumerate() {
            let ([from, to], width) = ends(self.corners, direction);
            opening = opening.max(width);
            let ends = Ends { axis, from, to };
            if !self.known.contains(&ends) {
                self.known.push(ends);
            }
        }
        (Frame { axes, opening }, self.known.len() == before)
    }

    /// Takes a number of turns, or as many as it takes to the end.
    fn turn(&mut self, turns: usize) {
        let mut planes = Vec::new();
        for _ in 0..turns {
            if self.is_over {
                break;
            }
            planes.clear();
            planes.extend(self.known.iter().map(|ends| {
                let axis = self.best.axes[ends.axis];
                let way = self.corners[ends.to as usize] - self.corners[ends.from as usize];
                // Turned by w, the axis e becomes e + w x e.
                Plane { value: way.dot(&axis), slope: axis.cross(&way) }
            }));
            let (turn, promised) = least_maximum(&planes, self.trust);
            let promised = self.best.opening - promised;
            if promised < LEAST_GAIN * self.size {
                self.is_over = true;
                break;
            }
            let [x, y] = self.best.axes;
            let x = (x + turn.cross(&x)).normalize();
            let y = y + turn.cross(&y);
            let (next, were_known) = self.look([x, (y - x * y.dot(&x)).normalize()]);
            let gain = self.best.opening - next.opening;
            if gain > 0.0 {
                self.best = next;
            }
            if were_known && gain < 0.5 * promised {
                self.trust /= 4.0;
                self.is_over = self.trust < LAST_TRUST;
            }
        }
    }
}

/// The frames of the grid whose openings are less than those of their neighbours.
fn starts(corners: &[Vector3<f64>]) -> Vec<[Vector3<f64>; 2]> {
    let [nx, ny, nz] = GRID;
    let place =
        |axis: usize, index: usize| FARTHEST[axis] * ((2 * index + 1) as f64 / GRID[axis] as f64 - 1.0);
    let mut openings = Vec::with_capacity(nx * ny * nz);
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let [first, second] = frame([place(0, i), place(1, j), place(2, k)]);
                openings.push(ends(corners, &first).1.max(ends(corners, &second).1));
            }
        }
    }
    let small = SMALL * openings.iter().copied().fold(f64::INFINITY, f64::min);
    let mut starts = Vec::new();
    for (at, &opening) in openings.iter().enumerate() {
        let index = [at % nx, at / nx % ny, at / (nx * ny)];
        let is_least = [1, nx, nx * ny].into_iter().enumerate().all(|(axis, step)| {
            (index[axis] == 0 || openings[at - step] > opening)
                && (index[axis] + 1 == GRID[axis] || openings[at + step] >= opening)
        });
        if is_least || opening < small {
            starts.push(frame(arrays::from_fn(|axis| place(axis, index[axis]))));
        }
    }
    starts
}

/// The first two axes after a rotation that has the quaternion `(1, x, y, z)`, up to its length.
///
/// Every frame is one of these with coordinates up to [`FARTHEST`], up to the order and the signs of its axes: of the
/// eight rotations that differ by that, one has a largest real part.
fn frame([x, y, z]: [f64; 3]) -> [Vector3<f64>; 2] {
    let norm2 = 1.0 + x * x + y * y + z * z;
    let first = Vector3::new(1.0 + x * x - y * y - z * z, 2.0 * (x * y + z), 2.0 * (x * z - y));
    let second = Vector3::new(2.0 * (x * y - z), 1.0 - x * x + y * y - z * z, 2.0 * (y * z + x));
    [first / norm2, second / norm2]
}

/// A frame turned about each of its three axes.
fn turned([x, y]: [Vector3<f64>; 2]) -> impl Iterator<Item = [Vector3<f64>; 2]> {
    let z = x.cross(&y);
    (-ANGLES..=ANGLES).filter(|&step| step != 0).flat_map(move |step| {
        let angle = BETWEEN_ANGLES * f64::from(step);
        let (sin, cos) = (sin(angle), cos(angle));
        [[x * cos + z * sin, y], [x, y * cos + z * sin], [x * cos + y * sin, y * cos - x * sin]]
    })
}
