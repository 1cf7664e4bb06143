//! Convex hulls of few points, and the bodies that half-spaces enclose, which are hulls of dual points.
//!
//! Faces are found one from another by pivoting about their edges (gift wrapping: D. R. Chand and S. S. Kapur, J. ACM
//! 17, 78-86, 1970, DOI 10.1145/321556.321564). Where that fails, as it may where points nearly coincide, every plane
//! through three points is looked at, which takes milliseconds and finds the same faces.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use crate::elementary::atan2;
use crate::sorting;

/// Distance from a plane below which a point lies on it, over the largest distance from the origin.
const ON_PLANE: f64 = 1.0e-9;

/// A face of a hull: its outward plane `normal . x = offset` and the points on it, in counter-clockwise order as seen
/// from outside.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Facet {
    pub(super) normal: Vector3<f64>,
    pub(super) offset: f64,
    pub(super) points: Vec<u32>,
}

/// The faces of the hull of some points, in the order of their smallest points; none where the points lie in a plane.
pub(super) fn hull(points: &[Vector3<f64>]) -> Vec<Facet> {
    wrapped(points).unwrap_or_else(|| exhaustive(points))
}

/// The faces by gift wrapping; `None` where a face or an edge is in doubt.
fn wrapped(points: &[Vector3<f64>]) -> Option<Vec<Facet>> {
    let size = points.iter().map(Vector3::norm).fold(0.0, f64::max);
    let mut facets: BTreeMap<Vec<u32>, Facet> = BTreeMap::new();
    // The edges of the faces, each in the direction that its face has it.
    let mut edges: BTreeSet<[u32; 2]> = BTreeSet::new();
    let mut open = vec![first_edge(points)?];
    while let Some([from, to]) = open.pop() {
        if edges.contains(&[from, to]) {
            continue;
        }
        let (members, facet) = facet_at(points, [from, to], size)?;
        for edge in super::edges_of(&facet.points) {
            if !edges.insert(edge) {
                return None;
            }
            open.push([edge[1], edge[0]]);
        }
        if !edges.contains(&[from, to]) || facets.insert(members, facet).is_some() {
            return None;
        }
    }
    (facets.len() >= 4).then(|| facets.into_values().collect())
}

/// An edge of the hull: from the point that is farthest from the origin to the one that is least below the plane there.
fn first_edge(points: &[Vector3<f64>]) -> Option<[u32; 2]> {
    let farthest = |a: &usize, b: &usize| points[*a].norm_squared().total_cmp(&points[*b].norm_squared());
    let from = (0..points.len()).max_by(farthest)?;
    let up = points[from].try_normalize(0.0)?;
    let slope = |i: usize| {
        let way = points[i] - points[from];
        let height = way.dot(&up);
        height / (way - height * up).norm()
    };
    let others = (0..points.len()).filter(|&i| i != from && slope(i).is_finite());
    let to = others.max_by(|&i, &j| slope(i).total_cmp(&slope(j)))?;
    Some([from as u32, to as u32])
}

/// The face to the left of an edge of the hull, with its points in ascending order.
fn facet_at(points: &[Vector3<f64>], [from, to]: [u32; 2], size: f64) -> Option<(Vec<u32>, Facet)> {
    let least = ON_PLANE * size * size;
    let start = points[from as usize];
    let along = points[to as usize] - start;
    let mut normal: Option<Vector3<f64>> = None;
    for point in points {
        let way = point - start;
        if normal.is_none_or(|normal| normal.dot(&way) > 0.0) {
            let next = along.cross(&way);
            if next.norm() >= least {
                normal = Some(next);
            }
        }
    }
    let found = facet(points, normal?.try_normalize(0.0)?, &start, ON_PLANE * size)?;
    let mut members = found.points;
    members.sort_unstable();
    // The plane by the points that the exhaustive search finds it by.
    let at = |i: usize| points[members[i] as usize];
    for i in 0..members.len() {
        for j in i + 1..members.len() {
            for k in j + 1..members.len() {
                let normal = (at(j) - at(i)).cross(&(at(k) - at(i)));
                if normal.norm() >= least {
                    let facet = facet(points, normal / normal.norm(), &at(i), ON_PLANE * size)?;
                    let mut again = facet.points.clone();
                    again.sort_unstable();
                    return (again == members).then_some((members, facet));
                }
            }
        }
    }
    None
}

/// The faces by looking at every plane through three points.
fn exhaustive(points: &[Vector3<f64>]) -> Vec<Facet> {
    let size = points.iter().map(Vector3::norm).fold(0.0, f64::max);
    let mut known: BTreeSet<Vec<u32>> = BTreeSet::new();
    let mut facets = Vec::new();
    for i in 0..points.len() {
        for j in i + 1..points.len() {
            for k in j + 1..points.len() {
                let normal = (points[j] - points[i]).cross(&(points[k] - points[i]));
                let length = normal.norm();
                if length < ON_PLANE * size * size {
                    continue;
                }
                let Some(facet) = facet(points, normal / length, &points[i], ON_PLANE * size) else {
                    continue;
                };
                let mut members = facet.points.clone();
                members.sort_unstable();
                if known.insert(members) {
                    facets.push(facet);
                }
            }
        }
    }
    if facets.len() < 4 { Vec::new() } else { facets }
}

/// The face in the plane through `of` with this unit normal, turned outward; `None` where points lie on both sides, or
/// all in the plane.
fn facet(points: &[Vector3<f64>], normal: Vector3<f64>, of: &Vector3<f64>, tolerance: f64) -> Option<Facet> {
    let (mut above, mut below) = (false, false);
    let mut members = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let height = (point - of).dot(&normal);
        if height.abs() <= tolerance {
            members.push(i as u32);
        } else if height > 0.0 {
            above = true;
        } else {
            below = true;
        }
        if above && below {
            return None;
        }
    }
    if !above && !below {
        return None;
    }
    let normal = if above { -normal } else { normal };
    let points = in_order(points, members, &normal);
    Some(Facet { normal, offset: of.dot(&normal), points })
}

/// Points of a convex polygon in counter-clockwise order about the normal.
fn in_order(points: &[Vector3<f64>], mut members: Vec<u32>, normal: &Vector3<f64>) -> Vec<u32> {
    let at = |i: u32| points[i as usize];
    let center = members.iter().map(|&i| at(i)).sum::<Vector3<f64>>() / members.len() as f64;
    let [u, v] = across(normal);
    let angle = |i: u32| atan2((at(i) - center).dot(&v), (at(i) - center).dot(&u));
    sorting::by_number(&mut members, |&i| angle(i));
    members
}

/// Two unit vectors that make a right-handed frame with a unit vector in the third place.
pub(super) fn across(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let u = axis.cross(normal).normalize();
    [u, normal.cross(&u)]
}

/// Vertices and faces of the body `normal . x <= offset` for all planes, offsets above 0; empty where it is not
/// bounded.
///
/// The body is dual to the hull of the points `normal / offset`: a face of that hull is a vertex of the body, a point
/// of it a face.
pub(super) fn intersection(planes: &[(Vector3<f64>, f64)]) -> (Vec<Vector3<f64>>, Vec<Vec<u32>>) {
    let duals: Vec<Vector3<f64>> = planes.iter().map(|(normal, offset)| normal / *offset).collect();
    let facets = hull(&duals);
    if facets.iter().any(|facet| facet.offset <= 0.0) {
        return (Vec::new(), Vec::new());
    }
    let vertices: Vec<Vector3<f64>> = facets.iter().map(|facet| facet.normal / facet.offset).collect();
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); planes.len()];
    for (i, facet) in facets.iter().enumerate() {
        for &plane in &facet.points {
            members[plane as usize].push(i as u32);
        }
    }
    let faces = members
        .into_iter()
        .zip(planes)
        .filter(|(members, _)| members.len() > 2)
        .map(|(members, (normal, _))| in_order(&vertices, members, normal));
    let faces = faces.collect();
    (vertices, faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream, uniform};

    #[test]
    fn wrapping_finds_the_faces_of_the_exhaustive_search_to_the_last_bit() {
        let mut rng = stream(1, Stream::Shape);
        for round in 0..400 {
            let n = 4 + round % 30;
            let mut points: Vec<Vector3<f64>> =
                (0..n).map(|_| Vector3::from_fn(|_, _| 2.0 * uniform(&mut rng) - 1.0)).collect();
            if round % 3 == 0 {
                for point in &mut points {
                    *point /= point.norm();
                }
            }
            let known = exhaustive(&points);
            assert_eq!(wrapped(&points), Some(known), "{points:?}");
        }
    }

    #[test]
    fn faces_with_many_corners_are_found_whole() {
        let cube: Vec<Vector3<f64>> =
            (0..8).map(|i| Vector3::from_fn(|axis, _| f64::from((i >> axis & 1) * 2 - 1))).collect();
        assert_eq!(wrapped(&cube), Some(exhaustive(&cube)));
        let prism: Vec<Vector3<f64>> = (0..24)
            .map(|i| {
                let angle = std::f64::consts::TAU * f64::from(i / 2) / 12.0;
                Vector3::new(angle.cos(), angle.sin(), f64::from(i % 2) - 0.5)
            })
            .collect();
        let faces = wrapped(&prism);
        assert_eq!(faces.as_ref().map(Vec::len), Some(14));
        assert_eq!(faces, Some(exhaustive(&prism)));
        // A point within a face makes its loop unsound: the exhaustive search decides.
        let mut with_inner = cube.clone();
        with_inner.push(Vector3::new(0.1, 0.2, 1.0));
        assert_eq!(hull(&with_inner), exhaustive(&with_inner));
        assert_eq!(hull(&cube[..4]), Vec::new());
    }
}
