//! What a plane cuts out of a convex polyhedron: a convex polygon of a sharp one, exactly; of a rounded one an
//! inscribed
//! polygon, whose corners lie on the boundary and whose edges keep within [`TOLERANCE`] of it.
//!
//! The boundary of the section of a rounded body consists of segments, arcs of ellipses and arcs of circles. Where one
//! ends, the plane crosses a segment between a face and an edge or an arc between an edge and a vertex. These points
//! are
//! found in closed form, then the arcs between them are halved until their rise is below the tolerance.

use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::Vector3;

use super::Span;
use crate::arrays::Each as _;
use crate::elementary::{acos, atan2, cos, hypot, sin, sin_cos};
use crate::geometry::convex::{Convex, Place, directed_edges};
use crate::sorting;

/// How far the boundary of a rounded grain may lie outside of the polygon, in equivalent diameters.
pub const TOLERANCE: f64 = 1.0e-4;
/// Corners closer than that, in equivalent diameters, are one.
const SAME: f64 = 1.0e-9;
/// Most halvings of an arc.
const MOST_HALVINGS: u32 = 10;

/// A convex polygon about the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    /// Corners, counter-clockwise from u to v.
    pub corners_mm: Vec<[f64; 2]>,
    /// Whether the boundary from a corner to the next is curved; empty of sharp grains.
    pub(crate) is_curved: Vec<bool>,
}

/// The plane across the last of three axes, as a template sees it.
struct Plane<'a> {
    template: &'a Convex,
    place: &'a Place,
    axes: [usize; 3],
    /// Above the centre of the grain.
    height: f64,
}

impl Polygon {
    /// The section by the plane across the last of the axes at a height above the centre, and the place of its centroid
    /// seen from the centre of the grain; `None` where the plane does not meet it.
    pub(crate) fn of_section(
        template: &Convex,
        place: &Place,
        axes: [usize; 3],
        height: f64,
    ) -> Option<([f64; 2], Self)> {
        let plane = Plane { template, place, axes, height };
        let corners = if template.rounding > 0.0 { plane.rounded()? } else { plane.sharp() };
        let mut corners = sorted(corners, SAME * place.scale)?;
        let mut is_curved = Vec::new();
        if template.rounding > 0.0 {
            (corners, is_curved) = plane.refined(&corners);
        }
        let centroid = centroid(&corners)?;
        let about = |p: &[f64; 2]| [p[0] - centroid[0], p[1] - centroid[1]];
        Some((centroid, Self { corners_mm: corners.iter().map(about).collect(), is_curved }))
    }

    pub(crate) fn area_mm2(&self) -> f64 {
        area(&self.corners_mm)
    }

    /// From and to along u and v.
    pub(crate) fn extents_mm(&self) -> [[f64; 2]; 2] {
        [0, 1].each(|axis| range(&self.corners_mm, axis))
    }

    fn at(&self, center: [f64; 2]) -> Vec<[f64; 2]> {
        self.corners_mm.iter().map(|p| [p[0] + center[0], p[1] + center[1]]).collect()
    }

    /// Area that it shares with a rectangle.
    pub(crate) fn area_in(&self, center: [f64; 2], u: [f64; 2], v: [f64; 2]) -> f64 {
        area(&within(&within(&self.at(center), 1, v), 0, u)).max(0.0)
    }

    /// See [`super::Figure::span`].
    pub(crate) fn span(&self, center: [f64; 2], v: [f64; 2]) -> Option<Span> {
        let corners = self.at(center);
        let part = within(&corners, 1, v);
        let [low, high] = range(&part, 1);
        if part.len() < 3 || low >= high {
            return None;
        }
        let [least, most] = range(&corners, 1);
        let inner = if least < v[0] && most > v[1] {
            let chord = |at: f64| range(&within(&corners, 1, [at, at]), 0);
            let [p, q] = v.each(chord);
            [p[0].max(q[0]), p[1].min(q[1])]
        } else {
            [f64::INFINITY, f64::NEG_INFINITY]
        };
        Some(Span { outer: range(&part, 0), inner })
    }
}

impl Plane<'_> {
    /// A point of the template, or a direction, in mm along the axes, from the centre of the grain.
    fn seen(&self, p: &Vector3<f64>) -> [f64; 3] {
        let u = p * self.place.scale;
        let rotation = &self.place.rotation;
        self.axes.each(|k| (rotation[(k, 0)] * u[0] + rotation[(k, 1)] * u[1]) + rotation[(k, 2)] * u[2])
    }

    /// Where the segment between two points crosses the plane.
    fn crossing(&self, p: &Vector3<f64>, q: &Vector3<f64>) -> Option<[f64; 2]> {
        let (p, q) = (self.seen(p), self.seen(q));
        if (p[2] < self.height) == (q[2] < self.height) {
            return None;
        }
        let share = (self.height - p[2]) / (q[2] - p[2]);
        Some([0, 1].each(|axis| p[axis] + share * (q[axis] - p[axis])))
    }

    fn sharp(&self) -> Vec<[f64; 2]> {
        let vertex = |vertex: u32| &self.template.vertices[vertex as usize];
        self.template
            .edges
            .iter()
            .filter_map(|edge| self.crossing(vertex(edge.ends[0]), vertex(edge.ends[1])))
            .collect()
    }

    /// Points of the boundary: where its parts end, and some more.
    fn rounded(&self) -> Option<Vec<[f64; 2]>> {
        let (template, r) = (self.template, self.template.rounding);
        let middle = self.inside()?;
        let mut points = Vec::new();
        for turn in 0..4 {
            let (sin, cos) = sin_cos(f64::from(turn) * FRAC_PI_4);
            if let Some(ends) = self.chord(middle, [cos, sin]) {
                points.extend(ends.each(|t| [middle[0] + t * cos, middle[1] + t * sin]));
            }
        }
        for (corners, (normal, _)) in template.faces.iter().zip(&template.planes) {
            let moved = |vertex: u32| template.vertices[vertex as usize] + normal * r;
            points.extend(
                directed_edges(corners).filter_map(|[from, to]| self.crossing(&moved(from), &moved(to))),
            );
        }
        for edge in &template.edges {
            let [m, n] = edge.faces.each(|face| template.planes[face as usize].0);
            let Some(side) = (n - m * m.dot(&n)).try_normalize(1e-12) else { continue };
            for vertex in edge.ends {
                let center = self.seen(&template.vertices[vertex as usize]);
                let (from, to) = (self.seen(&(m * r)), self.seen(&(side * r)));
                // center + from cos t + to sin t at the height of the plane
                let reach = hypot(from[2], to[2]);
                let cosine = (self.height - center[2]) / reach;
                if cosine.abs() < 1.0 {
                    let (first, half) = (atan2(to[2], from[2]), acos(cosine));
                    for t in [first - half, first + half].each(|t| t.rem_euclid(TAU)) {
                        if t < edge.angle {
                            points.push([0, 1].each(|a| center[a] + from[a] * cos(t) + to[a] * sin(t)));
                        }
                    }
                }
            }
        }
        Some(points)
    }

    /// A point of the section: on the segment from the lowest point of the body to its highest.
    fn inside(&self) -> Option<[f64; 2]> {
        let r = self.template.rounding * self.place.scale;
        let vertices: Vec<[f64; 3]> = self.template.vertices.iter().map(|vertex| self.seen(vertex)).collect();
        let low = vertices.iter().min_by(|p, q| p[2].total_cmp(&q[2]))?;
        let high = vertices.iter().max_by(|p, q| p[2].total_cmp(&q[2]))?;
        let share = (self.height - (low[2] - r)) / (high[2] - low[2] + 2.0 * r);
        (share > 0.0 && share < 1.0).then(|| [0, 1].each(|axis| low[axis] + share * (high[axis] - low[axis])))
    }

    /// Where the line through a point of the plane enters the body and leaves it, in mm.
    fn chord(&self, from: [f64; 2], direction: [f64; 2]) -> Option<[f64; 2]> {
        let row = |axis: usize| self.place.rotation.row(self.axes[axis]).transpose() / self.place.scale;
        let local = row(0) * from[0] + row(1) * from[1] + row(2) * self.height;
        self.template.chord(&local, &(row(0) * direction[0] + row(1) * direction[1]))
    }

    /// Corners with more between them, where the boundary rises above the edges, and whether it does so behind each.
    fn refined(&self, corners: &[[f64; 2]]) -> (Vec<[f64; 2]>, Vec<bool>) {
        let (mut all, mut is_curved) = (Vec::new(), Vec::new());
        for (i, &corner) in corners.iter().enumerate() {
            let first = all.len();
            all.push(corner);
            self.refine(corner, corners[(i + 1) % corners.len()], MOST_HALVINGS, &mut all);
            is_curved.resize(all.len(), all.len() - first > 1);
        }
        (all, is_curved)
    }

    fn refine(&self, p: [f64; 2], q: [f64; 2], halvings: u32, all: &mut Vec<[f64; 2]>) {
        let length = hypot(q[0] - p[0], q[1] - p[1]);
        let out = [(q[1] - p[1]) / length, (p[0] - q[0]) / length];
        let middle = [0, 1].each(|axis| f64::midpoint(p[axis], q[axis]));
        let rise = self.chord(middle, out).map_or(0.0, |[_, leave]| leave);
        if halvings > 0 && rise > TOLERANCE * self.place.scale {
            let top = [0, 1].each(|axis| middle[axis] + rise * out[axis]);
            self.refine(p, top, halvings - 1, all);
            all.push(top);
            self.refine(top, q, halvings - 1, all);
        }
    }
}

/// The corners of a convex polygon in their order; `None` of fewer than three.
fn sorted(mut corners: Vec<[f64; 2]>, same: f64) -> Option<Vec<[f64; 2]>> {
    let n = corners.len() as f64;
    let middle = [0, 1].each(|axis| corners.iter().map(|p| p[axis]).sum::<f64>() / n);
    let angle = |p: &[f64; 2]| atan2(p[1] - middle[1], p[0] - middle[0]);
    sorting::by_number(&mut corners, angle);
    let is_same = |p: &[f64; 2], q: &[f64; 2]| hypot(p[0] - q[0], p[1] - q[1]) <= same;
    corners.dedup_by(|p, q| is_same(p, q));
    while corners.len() > 1 && corners.first().zip(corners.last()).is_some_and(|(p, q)| is_same(p, q)) {
        corners.pop();
    }
    (corners.len() >= 3).then_some(corners)
}

/// Area of a polygon whose corners run counter-clockwise.
pub(crate) fn area(corners: &[[f64; 2]]) -> f64 {
    let Some(first) = corners.first() else { return 0.0 };
    let from = |p: &[f64; 2]| [p[0] - first[0], p[1] - first[1]];
    let twice = corners.windows(2).map(|pair| {
        let (p, q) = (from(&pair[0]), from(&pair[1]));
        p[0] * q[1] - p[1] * q[0]
    });
    twice.sum::<f64>() / 2.0
}

/// Centroid of a polygon; `None` where its area is not positive.
fn centroid(corners: &[[f64; 2]]) -> Option<[f64; 2]> {
    let first = corners.first()?;
    let (mut twice, mut moment) = (0.0, [0.0; 2]);
    for pair in corners.windows(2) {
        let [p, q] = [0, 1].each(|i| [pair[i][0] - first[0], pair[i][1] - first[1]]);
        let part = p[0] * q[1] - p[1] * q[0];
        twice += part;
        moment = [0, 1].each(|axis| moment[axis] + part * (p[axis] + q[axis]) / 3.0);
    }
    (twice > 0.0).then(|| [0, 1].each(|axis| first[axis] + moment[axis] / twice))
}

/// From and to along an axis; reversed of nothing.
fn range(corners: &[[f64; 2]], axis: usize) -> [f64; 2] {
    corners
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[axis]), high.max(p[axis])])
}

/// The part of a convex polygon between two coordinates of an axis.
fn within(corners: &[[f64; 2]], axis: usize, [low, high]: [f64; 2]) -> Vec<[f64; 2]> {
    let above = cut(corners, axis, low, 1.0);
    cut(&above, axis, high, -1.0)
}

/// The part of a convex polygon on one side of a coordinate (Sutherland and Hodgman 1974).
fn cut(corners: &[[f64; 2]], axis: usize, at: f64, side: f64) -> Vec<[f64; 2]> {
    let mut kept = Vec::with_capacity(corners.len() + 2);
    for (i, p) in corners.iter().enumerate() {
        let q = &corners[(i + 1) % corners.len()];
        let (from, to) = (side * (p[axis] - at), side * (q[axis] - at));
        if from >= 0.0 {
            kept.push(*p);
        }
        if (from < 0.0) != (to < 0.0) {
            let share = from / (from - to);
            let mut crossing = [0, 1].each(|a| p[a] + share * (q[a] - p[a]));
            crossing[axis] = at;
            kept.push(crossing);
        }
    }
    kept
}
