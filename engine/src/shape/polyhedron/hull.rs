//! Convex hulls of few points, and the bodies that half-spaces enclose, which are hulls of dual points.
//!
//! Every plane through three points is looked at: with the 8 to 100 points of a template this takes milliseconds, needs
//! no order of insertion and no repair, and finds faces with more than three vertices as they are.

use std::collections::BTreeSet;

use nalgebra::Vector3;

/// Distance from a plane below which a point lies on it, over the largest distance from the origin.
const ON_PLANE: f64 = 1.0e-9;

/// A face of a hull: its outward plane `normal . x = offset` and the points on it, in counter-clockwise order as seen
/// from outside.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) normal: Vector3<f64>,
    pub(super) offset: f64,
    pub(super) points: Vec<u32>,
}

/// The faces of the hull of some points, in the order of their smallest points; none where the points lie in a plane.
pub(super) fn hull(points: &[Vector3<f64>]) -> Vec<Facet> {
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
    let angle = |i: u32| (at(i) - center).dot(&v).atan2((at(i) - center).dot(&u));
    members.sort_by(|&i, &j| angle(i).total_cmp(&angle(j)));
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
