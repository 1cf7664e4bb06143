//! Points on edges and faces that keep clear of obstacles: evenly, as Poisson disks until none fits, or at random.
//!
//! The faces' sampler is that of Ebeida and others (2012, doi:10.1111/j.1467-8659.2012.03059.x): points are drawn from
//! cells that can still take one, and cells are split and dropped until none is left. What is drawn is then a maximal
//! set: every point of the face lies in an obstacle. Every point that is taken becomes one, a ball.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::obstacles::{Obstacle, Obstacles};
use super::surface::{Edge, Face};
use crate::arrays::{self, Each as _};
use crate::control::Control;
use crate::elementary::hypot;
use crate::export::{ExportError, go_on};
use crate::grain::PlacedGrains;
use crate::rng::uniform;
use crate::sorting;

/// Halvings of a cell of the first grid, after which what is left of it counts as nothing: 1e-12 of its area.
const MAX_LEVELS: u32 = 20;
/// Draws for one random point, after which the face is full.
const MAX_DRAWS: usize = 10_000;
/// Draws between two looks at whether to go on.
const DRAWS_PER_LOOK: usize = 4096;

/// Points that divide an edge evenly at distances of at least `distance`, where obstacles leave it free.
///
/// Between two balls (two vertices, mostly) the points begin at one and end at the other.
pub(super) fn divide(
    edge: &Edge,
    distance: f64,
    grains: &PlacedGrains<'_>,
    obstacles: impl Iterator<Item = Obstacle>,
) -> Vec<[f64; 3]> {
    let mut taken: Vec<(f64, f64)> =
        obstacles.filter_map(|obstacle| obstacle.on_line(grains, edge)).collect();
    sorting::by_number(&mut taken, |part| part.0);
    let mut points: Vec<f64> = Vec::new();
    for (from, to) in free_parts(&taken, edge.length) {
        let from = points.last().map_or(from, |last| from.max(last + distance));
        if from > to {
            continue;
        }
        let steps = ((to - from) / distance) as usize;
        if steps == 0 {
            points.push((from + to) / 2.0);
        } else {
            points.extend((0..=steps).map(|i| from + (to - from) * i as f64 / steps as f64));
        }
    }
    points.into_iter().map(|along| edge.at(along)).collect()
}

/// What intervals in ascending order leave of `0..=length`.
fn free_parts(taken: &[(f64, f64)], length: f64) -> Vec<(f64, f64)> {
    let mut parts = Vec::new();
    let mut free_from = 0.0;
    for &(from, to) in taken {
        if from.min(length) > free_from {
            parts.push((free_from, from.min(length)));
        }
        free_from = to.max(free_from);
    }
    if free_from < length {
        parts.push((free_from, length));
    }
    parts
}

/// Fills a face with points that keep `distance` from one another, until no point has a place.
pub(super) fn fill(
    face: &Face,
    distance: f64,
    grains: &PlacedGrains<'_>,
    obstacles: &mut Obstacles,
    rng: &mut Xoshiro256PlusPlus,
    control: &dyn Control,
    points: &mut Vec<[f64; 3]>,
) -> Result<(), ExportError> {
    let size = face.size();
    // The diagonal is no longer than the distance, so that a point takes its cell whole.
    let counts = size.each(|side| (side * std::f64::consts::SQRT_2 / distance).ceil().max(1.0));
    let mut half = [size[0] / counts[0] / 2.0, size[1] / counts[1] / 2.0];
    let mut cells = Vec::new();
    for j in 0..counts[1] as usize {
        for i in 0..counts[0] as usize {
            let middle = [(2 * i + 1) as f64 * half[0], (2 * j + 1) as f64 * half[1]];
            if is_open(face, grains, obstacles, middle, half) {
                cells.push(middle);
            }
        }
    }
    for _ in 0..MAX_LEVELS {
        for draw in 0..cells.len() {
            if draw % DRAWS_PER_LOOK == 0 {
                go_on(control)?;
            }
            let middle = cells[(uniform(rng) * cells.len() as f64) as usize];
            let uv = arrays::from_fn(|a| middle[a] + half[a] * (2.0 * uniform(rng) - 1.0));
            let p = face.at(uv);
            if face.has(uv) && !obstacles.hold(grains, p) {
                points.push(p);
                obstacles.push(Obstacle::ball(p, distance));
            }
        }
        half = half.each(|h| h / 2.0);
        let split = |middle: &[f64; 2]| {
            [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
                .each(|side: [f64; 2]| arrays::from_fn(|a| middle[a] + side[a] * half[a]))
        };
        cells = cells
            .iter()
            .flat_map(split)
            .filter(|&middle| is_open(face, grains, obstacles, middle, half))
            .collect();
        if cells.is_empty() {
            break;
        }
    }
    Ok(())
}

/// Whether a cell may have a place, as far as one obstacle at a time can tell.
fn is_open(
    face: &Face,
    grains: &PlacedGrains<'_>,
    obstacles: &Obstacles,
    middle: [f64; 2],
    half: [f64; 2],
) -> bool {
    face.reaches(middle, half) && !obstacles.cover(grains, face.at(middle), hypot(half[0], half[1]))
}

/// Takes `count` points drawn by `draw`, or as many as have a place; `false` when not all had.
pub(super) fn scatter(
    count: u64,
    distance: f64,
    grains: &PlacedGrains<'_>,
    obstacles: &mut Obstacles,
    control: &dyn Control,
    points: &mut Vec<[f64; 3]>,
    mut draw: impl FnMut() -> Option<[f64; 3]>,
) -> Result<bool, ExportError> {
    for i in 0..count {
        if i % 256 == 0 {
            go_on(control)?;
        }
        let Some(p) = (0..MAX_DRAWS).filter_map(|_| draw()).find(|&p| !obstacles.hold(grains, p)) else {
            return Ok(false);
        };
        points.push(p);
        obstacles.push(Obstacle::ball(p, distance));
    }
    Ok(true)
}
