//! The check's own measure of the sieve size of a polyhedron.
//!
//! The shadow along `e3` fits a square whose sides have the directions `e1` and `e2`. For one side `e1` the other is
//! the least width of the outline across `e1`, which is that above an edge of the outline, so that
//!
//! ```text
//! D_s = min over e1 of max(width along e1, least width of the outline across e1)
//! ```
//!
//! The inner minimum is exact; the outer one is looked for over the half sphere, on rings of latitude and then by steps
//! from the best of them. Packing finds the same number by another search, over frames and by linear programmes.

use nalgebra::Vector3;

use crate::shape::Polyhedron;

/// Rings of latitude on the half sphere; as far apart as the directions on them.
const RINGS: usize = 26;
/// Most directions that the search goes on from.
const STARTS: usize = 60;
/// Openings after the coarse steps, over the least, that are followed to the end: more than these steps leave to gain.
const FINISHED: f64 = 1.01;
/// Angle by which these lie apart, in radians.
const APART: f64 = 0.12;
/// Steps in radians: the first, the last of the coarse ones, the last.
const STEPS: [f64; 3] = [0.04, 1.0e-3, 1.0e-7];
/// Directions of a step.
const WAYS: usize = 16;
/// Steps in vain in turned directions before steps get shorter.
const TRIES: usize = 4;
/// A direction whose own width is so much more than the best opening is not followed.
const HOPELESS: f64 = 1.15;

type V = Vector3<f64>;

/// Sieve size in units of the polyhedron.
pub(super) fn sieve_size(body: &Polyhedron) -> f64 {
    let corners = body.vertices();
    let mut best = f64::INFINITY;
    let mut widths: Vec<(f64, V)> = directions().map(|axis| (width(corners, &axis), axis)).collect();
    widths.sort_by(|p, q| p.0.total_cmp(&q.0));
    let mut outline = Vec::new();
    let mut found: Vec<(f64, V)> = Vec::new();
    for (width, axis) in widths {
        if width > HOPELESS * best {
            break;
        }
        let opening = width.max(across(corners, &axis, &mut outline));
        best = best.min(opening);
        found.push((opening, axis));
    }
    found.sort_by(|p, q| p.0.total_cmp(&q.0));
    let mut starts: Vec<(f64, V)> = Vec::new();
    for candidate in found {
        if starts.len() < STARTS && starts.iter().all(|start| start.1.dot(&candidate.1).abs() < APART.cos()) {
            starts.push(candidate);
        }
    }
    let mut search = |start: (f64, V), from: f64, to: f64| descend(corners, start, [from, to], &mut outline);
    let mut coarse: Vec<(f64, V)> =
        starts.into_iter().map(|start| search(start, STEPS[0], STEPS[1])).collect();
    coarse.sort_by(|p, q| p.0.total_cmp(&q.0));
    let bound = FINISHED * coarse.first().map_or(f64::INFINITY, |start| start.0);
    let close = coarse.into_iter().take_while(|start| start.0 <= bound);
    let fine = close.map(|start| search(start, STEPS[1], STEPS[2]).0);
    fine.fold(f64::INFINITY, f64::min) + 2.0 * body.rounding()
}

/// Steps from a direction to those of smaller openings.
fn descend(
    corners: &[V],
    (mut best, mut axis): (f64, V),
    [from, to]: [f64; 2],
    outline: &mut Vec<[f64; 2]>,
) -> (f64, V) {
    let (mut step, mut turn, mut in_vain) = (from, 0.0_f64, 0);
    while step > to {
        let [u, v] = frame(&axis);
        let before = best;
        for way in 0..WAYS {
            let angle = turn + std::f64::consts::TAU * way as f64 / WAYS as f64;
            let next = (axis + (u * angle.cos() + v * angle.sin()) * step).normalize();
            let width = width(corners, &next);
            if width < best {
                let opening = width.max(across(corners, &next, outline));
                if opening < best {
                    (best, axis) = (opening, next);
                }
            }
        }
        // Other ways each time, so that no narrow valley lies between them for ever.
        turn += 1.0;
        in_vain = if best < before { 0 } else { in_vain + 1 };
        if in_vain >= TRIES {
            step *= 0.5;
            in_vain = 0;
        }
    }
    (best, axis)
}

fn width(corners: &[V], axis: &V) -> f64 {
    let heights = corners.iter().map(|corner| corner.dot(axis));
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    high - low
}

/// Directions that fill the half sphere evenly.
fn directions() -> impl Iterator<Item = V> {
    (0..RINGS).flat_map(|ring| {
        let polar = std::f64::consts::FRAC_PI_2 * (ring as f64 + 0.5) / RINGS as f64;
        let n = (4.0 * RINGS as f64 * polar.sin()).ceil();
        (0..n as usize).map(move |i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.5 * (ring % 2) as f64) / n;
            V::new(polar.sin() * angle.cos(), polar.sin() * angle.sin(), polar.cos())
        })
    })
}

/// Two unit vectors at right angles to a unit vector and to each other.
fn frame(axis: &V) -> [V; 2] {
    let least = axis.iamin();
    let other = V::from_fn(|i, _| if i == least { 1.0 } else { 0.0 });
    let u = axis.cross(&other).normalize();
    [u, axis.cross(&u)]
}

/// The least width of the outline across an axis: the largest distance of a corner of the convex outline from the line
/// through one of its edges, of the edge where that is least.
fn across(corners: &[V], axis: &V, outline: &mut Vec<[f64; 2]>) -> f64 {
    let [u, v] = frame(axis);
    let mut points: Vec<[f64; 2]> = corners.iter().map(|corner| [corner.dot(&u), corner.dot(&v)]).collect();
    points.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])));
    outline.clear();
    // Andrew's monotone chain: the lower outline, then the upper.
    for side in 0..2 {
        let first = outline.len();
        let mut add = |point: [f64; 2]| {
            while outline.len() >= first + 2
                && area(outline[outline.len() - 2], outline[outline.len() - 1], point) <= 0.0
            {
                outline.pop();
            }
            outline.push(point);
        };
        if side == 0 {
            points.iter().copied().for_each(&mut add);
        } else {
            points.iter().rev().copied().for_each(&mut add);
        }
        outline.pop();
    }
    let n = outline.len();
    let mut far = 1;
    let mut least = f64::INFINITY;
    for i in 0..n {
        let (p, q) = (outline[i], outline[(i + 1) % n]);
        // The farthest corner goes round with the edge.
        let mut steps = 0;
        while steps < n && area(p, q, outline[(far + 1) % n]) >= area(p, q, outline[far % n]) {
            far += 1;
            steps += 1;
        }
        least = least.min(area(p, q, outline[far % n]) / (q[0] - p[0]).hypot(q[1] - p[1]));
    }
    least
}

/// Twice the area of a triangle, positive where its corners are counter-clockwise.
fn area(p: [f64; 2], q: [f64; 2], r: [f64; 2]) -> f64 {
    (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::shape::Form;
    use crate::shape::polyhedron::{TemplateKind, draw_template};

    fn cuboid(edges: [f64; 3]) -> Polyhedron {
        let corner = |i: usize| V::from_fn(|axis, _| if i >> axis & 1 == 1 { edges[axis] } else { 0.0 });
        Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_cuboid_passes_upright_or_turned() {
        for [b, c] in [[1.0, 1.0], [1.0, 0.8], [1.0, 0.5], [1.0, 0.3], [1.0, 0.1_f64]] {
            let known = f64::min(b, (b + c) / 2.0_f64.sqrt());
            let found = sieve_size(&cuboid([3.0, b, c]));
            assert!((found - known).abs() < 1e-6, "{found} {known}");
        }
    }

    /// The two searches find the same size: that of packing is neither too large nor too small.
    #[test]
    fn templates_of_all_kinds_have_the_sieve_size_that_packing_finds() {
        let mut rng = stream(1, Stream::Shape);
        let kinds = [
            TemplateKind::Cuts(6),
            TemplateKind::Cuts(12),
            TemplateKind::Cuts(24),
            TemplateKind::Cuts(60),
            TemplateKind::Cuboid(0.0),
            TemplateKind::Cuboid(0.2),
            TemplateKind::Cuboid(0.4),
            TemplateKind::Voronoi,
        ];
        let n: usize = std::env::var("TEMPLATES").map_or(3, |n| n.parse().unwrap());
        for kind in kinds {
            for axes in [[1.0, 1.0, 1.0], [1.5, 1.2, 1.0], [10.0, 9.0, 1.0], [10.0, 1.2, 1.0]] {
                let (mut larger, mut smaller): (f64, f64) = (0.0, 0.0);
                for _ in 0..n {
                    let body = draw_template(kind, Form::of_axes(axes), &mut rng).unwrap();
                    let (here, there) = (sieve_size(&body), body.sieve_size());
                    larger = larger.max(there / here - 1.0);
                    smaller = smaller.max(here / there - 1.0);
                }
                println!("{kind:?} {axes:?}: {larger:e} {smaller:e}");
                assert!(larger < 2e-6 && smaller < 5e-6, "{kind:?} {axes:?}: {larger:e} {smaller:e}");
            }
        }
    }
}
