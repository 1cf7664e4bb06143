//! The least depth of two overlapping polyhedra, by the expanding polytope of van den Bergen 2001 (Proximity queries
//! and penetration depth computation on 3D game objects).
//!
//! The polytope lies within the difference of the bodies. The face whose plane has the least height above the origin,
//! negative while the polytope does not hold the origin, is replaced by faces to the point of the difference that lies
//! farthest along its normal, with the faces beside it that see that point, until there is none farther.

use nalgebra::Vector3;

use super::simplex::Difference;
use super::{Core, Pair};
use crate::arrays::Each as _;

/// Expansions after which the search ends.
const MOST_STEPS: usize = 200;

/// A face of the polytope.
#[derive(Clone, Copy, Debug)]
struct Face {
    corners: [usize; 3],
    /// Outward unit normal.
    normal: Vector3<f64>,
    /// Distance of its plane from the origin.
    plane: f64,
    /// The same, or infinity where the face is passed over.
    height: f64,
}

/// Direction of the least depth, from some points of the difference; `None` where rounding leaves no polytope.
///
/// The support function of the difference along any normal is a depth, so that the least one seen is kept. Points of
/// the difference often lie in a plane, as corners of parallel edges do; faces between them may be slivers without a
/// plane of their own. Such a face finds no point that is not known, and is passed over.
pub(super) fn least_depth<A: Core, B: Core>(
    pair: &Pair<'_, A, B>,
    known: &[Difference],
) -> Option<Vector3<f64>> {
    let mut points = first_points(pair, known)?;
    let mut faces: Vec<Face> = Vec::with_capacity(64);
    for corners in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
        faces.push(Face::new(corners, &points));
    }
    let rounding = 16.0 * f64::EPSILON * (pair.a.size_mm() + pair.b.size_mm());
    let mut best: Option<(f64, Vector3<f64>)> = None;
    for _ in 0..MOST_STEPS {
        let (index, nearest) = faces.iter().enumerate().min_by(|p, q| p.1.height.total_cmp(&q.1.height))?;
        let nearest = *nearest;
        // Every depth that is not known yet is at least this one.
        if best.is_some_and(|(depth, _)| depth - nearest.height <= rounding) {
            break;
        }
        let (s, difference) = pair.core_separation(&-nearest.normal);
        if best.is_none_or(|(depth, _)| -s < depth) {
            best = Some((-s, -nearest.normal));
        }
        if points.iter().any(|point| point.w == difference.w) {
            faces[index].height = f64::INFINITY;
            continue;
        }
        let sees = |face: &Face| face.normal.dot(&difference.w) > face.plane + rounding;
        // The next round would end the search.
        if !sees(&nearest) {
            break;
        }
        // The seen faces give way; the edges between them and the others are their horizon.
        let mut horizon: Vec<[usize; 2]> = Vec::new();
        let mut kept = Vec::with_capacity(faces.len() + 2);
        for (face, is_seen) in faces.iter().zip(seen_region(&faces, index, sees)) {
            if !is_seen {
                kept.push(*face);
                continue;
            }
            for [from, to] in face.edges() {
                match horizon.iter().position(|edge| *edge == [to, from]) {
                    Some(inner) => drop(horizon.swap_remove(inner)),
                    None => horizon.push([from, to]),
                }
            }
        }
        faces = kept;
        points.push(difference);
        for [from, to] in horizon {
            faces.push(Face::new([from, to, points.len() - 1], &points));
        }
        // By Euler's formula a closed polytope has no more. Those of a torn one would grow in number without a bound.
        if faces.len() > 2 * points.len() - 4 {
            debug_assert!(false, "a polytope of {} points is torn", points.len());
            break;
        }
    }
    best.map(|(_, normal)| normal)
}

/// Which faces join the first one through others that see the new point, and see it too.
///
/// Rounding lets faces elsewhere see it as well. They stay: without them the polytope would be torn. A region of `k`
/// faces, each of which joins one that was found before, has at most `k + 2` edges around it, so that a new point adds
/// two faces at most.
fn seen_region(faces: &[Face], first: usize, sees: impl Fn(&Face) -> bool) -> Vec<bool> {
    let mut found = vec![false; faces.len()];
    found[first] = true;
    let mut open = vec![first];
    while let Some(index) = open.pop() {
        for [from, to] in faces[index].edges() {
            let beyond = faces.iter().position(|face| face.edges().contains(&[to, from]));
            if let Some(beyond) = beyond.filter(|&beyond| !found[beyond] && sees(&faces[beyond])) {
                found[beyond] = true;
                open.push(beyond);
            }
        }
    }
    found
}

/// A tetrahedron of points of the difference, the fourth on the left of the others: of those known and the extreme
/// points along the axes, those that lie far from one another.
fn first_points<A: Core, B: Core>(pair: &Pair<'_, A, B>, known: &[Difference]) -> Option<Vec<Difference>> {
    let mut all = known.to_vec();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            all.push(pair.core_separation(&Vector3::ith(axis, sign)).1);
        }
    }
    let farthest = |height: &dyn Fn(&Vector3<f64>) -> f64| {
        all.iter().copied().max_by(|p, q| height(&p.w).total_cmp(&height(&q.w)))
    };
    let a = *all.first()?;
    let b = farthest(&|w| (w - a.w).norm_squared())?;
    let along = b.w - a.w;
    let c = farthest(&|w| (w - a.w).cross(&along).norm_squared())?;
    let normal = along.cross(&(c.w - a.w));
    let d = farthest(&|w| normal.dot(&(w - a.w)).abs())?;
    let height = normal.dot(&(d.w - a.w));
    if height == 0.0 {
        return None;
    }
    Some(if height > 0.0 { vec![a, b, c, d] } else { vec![a, c, b, d] })
}

impl Face {
    fn new(corners: [usize; 3], points: &[Difference]) -> Self {
        let [a, b, c] = corners.each(|corner| points[corner].w);
        match (b - a).cross(&(c - a)).try_normalize(f64::MIN_POSITIVE) {
            Some(normal) => {
                let plane = normal.dot(&a);
                Self { corners, normal, plane, height: plane }
            }
            // Three points of a line: seen by every point, and nearest to nothing.
            None => {
                Self { corners, normal: Vector3::zeros(), plane: f64::NEG_INFINITY, height: f64::INFINITY }
            }
        }
    }

    /// The edges, from corner to corner.
    fn edges(&self) -> [[usize; 2]; 3] {
        let [i, j, k] = self.corners;
        [[i, j], [j, k], [k, i]]
    }
}
