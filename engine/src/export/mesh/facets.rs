//! The polyhedron that is meshed in place of a convex body: its facets, at several levels of precision.
//!
//! Of a sharp body the facets are its own. Where a place is narrower than a width, planes of facets are moved inwards
//! or facets are left out until none is, as far as that succeeds ([`Solid::narrow_places`]).
//!
//! A rounded body is replaced by flat facets that touch it: the planes of its faces, moved outwards by the radius;
//! planes along each edge, which divide the angle of the edge evenly; and planes at the corner that is farthest outside
//! of the body, one after the other, until no corner is farther outside than a tolerance. Two planes with the angle `a`
//! between their normals meet `r (1 / cos(a/2) - 1)` outside of a rounding with the radius `r`.
//!
//! Widths and tolerances are shares of the length of edges; they become smaller from level to level. `polyhedron`
//! takes the coarsest level that has the volume of the grain within the room that the gaps leave.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::solid::{Solid, volume};
use crate::elementary::{acos, sin};
use crate::geometry::convex::Convex;

/// Widths below which places are narrow, over the length of edges, by level. The next level of a sharp body is the body
/// itself.
const WIDTHS: [f64; 3] = [0.1, 0.04, 0.015];
/// How far outside of a rounded body corners may lie, over the length of edges, by level.
const TOLERANCES: [f64; 5] = [0.06, 0.03, 0.015, 0.0075, 0.003_75];
/// Widths below which places of a rounded body are narrow, over the length of edges, by level.
const ROUNDED_WIDTHS: [f64; 5] = [0.1, 0.07, 0.04, 0.0, 0.0];
/// Depths of cuts of corners below the touching plane, in tolerances.
const DEPTHS: [f64; 4] = [0.0, 0.3, 0.6, 1.0];
/// Edges that are long enough for the first of the depths to be taken, over the length of edges.
const LONG_EDGE: f64 = 0.3;
/// How far planes are moved inwards to widen a facet, in widths.
const SHIFTS: [f64; 5] = [0.3, 0.6, 1.0, 1.6, 2.5];
/// How far corners may lie outside of the body where a facet is left out, in widths.
const MOST_OUTSIDE: f64 = 1.0;
/// What a plane that is moved by the width counts against places that are too narrow.
const SHIFT_WEIGHT: f64 = 0.05;
/// Most planes that are moved.
const MOST_SHIFTS: usize = 60;
/// The same of rounded bodies, which have many facets; short edges do the rest.
const MOST_ROUNDED_SHIFTS: usize = 15;
/// Most cuts of corners.
const MOST_CUTS: usize = 1500;

/// The facets that are meshed in place of a body, in the units of its template.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Vertices of the facets, counter-clockwise as seen from outside.
    pub(super) faces: Vec<Vec<u32>>,
    /// Volume inside.
    pub(super) volume: f64,
    /// Factor of the largest copy about the origin that lies inside of the body.
    pub(super) inscribed: f64,
    /// Whether they are the faces of a sharp body.
    pub(super) is_exact: bool,
}

impl Facets {
    /// Number of levels of a body.
    pub(super) fn levels(body: &Convex) -> usize {
        if body.rounding > 0.0 { TOLERANCES.len() } else { WIDTHS.len() + 1 }
    }

    /// The facets of a body at a level, for edges of that length where nothing is close; with all of its faces where
    /// that is asked for.
    pub(super) fn new(body: &Convex, edge: f64, level: usize, all_faces: bool) -> Self {
        if body.rounding > 0.0 {
            let solid = rounded(body, edge, TOLERANCES[level.min(TOLERANCES.len() - 1)] * edge).compacted();
            let width = ROUNDED_WIDTHS[level.min(ROUNDED_WIDTHS.len() - 1)] * edge;
            let solid = if all_faces || width == 0.0 {
                solid
            } else {
                widened(solid, body, width, MOST_ROUNDED_SHIFTS)
            };
            return Self::of_solid(solid, body);
        }
        let exact = Self {
            vertices: body.vertices.clone(),
            faces: body.faces.clone(),
            volume: volume(&body.vertices, &body.faces),
            inscribed: 1.0,
            is_exact: true,
        };
        let Some(width) = WIDTHS.get(level).filter(|_| !all_faces) else { return exact };
        let mut solid = Solid::of_planes(&body.planes, 0.0).compacted();
        if solid.narrow_places(width * edge).short == 0.0 || !solid.is_closed() {
            return exact;
        }
        Self::of_solid(widened(solid, body, width * edge, MOST_SHIFTS), body)
    }

    fn of_solid(solid: Solid, body: &Convex) -> Self {
        let leave = |v: &Vector3<f64>| body.chord(&Vector3::zeros(), v).map_or(0.0, |[_, leave]| leave);
        Self {
            volume: volume(&solid.vertices, &solid.faces),
            inscribed: solid.vertices.iter().map(leave).fold(f64::INFINITY, f64::min),
            vertices: solid.vertices,
            faces: solid.faces.iter().map(|corners| corners.to_vec()).collect(),
            is_exact: false,
        }
    }
}

/// The facets of a rounded body, none of whose corners lies farther outside than a tolerance.
fn rounded(body: &Convex, edge: f64, tolerance: f64) -> Solid {
    let r = body.rounding;
    let mut solid = Solid::of_planes(&body.planes, r);
    let height = |normal: &Vector3<f64>| {
        body.vertices.iter().map(|v| normal.dot(v)).fold(f64::NEG_INFINITY, f64::max) + r
    };
    // Half of the largest angle between the normals of two planes that meet within the tolerance.
    let most_half = acos(r / (r + tolerance));
    let mut edges: Vec<_> = body.edges.iter().collect();
    edges.sort_by(|p, q| q.angle.total_cmp(&p.angle));
    for one in edges {
        let parts = (one.angle / (2.0 * most_half)).ceil().max(1.0);
        let [m, n] = one.faces.map(|face| body.planes[face as usize].0);
        for k in 1..parts as u32 {
            let share = f64::from(k) / parts;
            let normal = m * sin((1.0 - share) * one.angle) + n * sin(share * one.angle);
            let normal = normal.normalize();
            let height = height(&normal);
            // A short edge may have been cut off with its neighbours.
            if solid.support(&normal) > height + tolerance {
                solid.cut(&normal, height);
            }
        }
    }
    // Distance from the body of each vertex, once it is known.
    let mut away: Vec<f64> = Vec::new();
    for _ in 0..MOST_CUTS {
        let known = away.len();
        away.extend(solid.vertices[known..].iter().map(|v| body.distance(v)));
        let corners = solid.faces.iter().flat_map(|corners| corners.iter().copied());
        let farthest = corners.max_by(|p, q| away[*p as usize].total_cmp(&away[*q as usize]));
        let Some(vertex) = farthest.filter(|v| away[*v as usize] > tolerance) else { break };
        let normal = body.normal(&solid.vertices[vertex as usize]);
        let height = height(&normal);
        let mut best = (0.0, height);
        for depth in DEPTHS {
            let height = height - depth * tolerance;
            let shortest = solid.shortest_edge_of_cut(&normal, height);
            if shortest > best.0 {
                best = (shortest, height);
            }
            if shortest > LONG_EDGE * edge {
                break;
            }
        }
        solid.cut(&normal, best.1);
        // A vertex that no cut takes off would be found again and again.
        away[vertex as usize] = 0.0;
    }
    solid
}

/// Moves planes inwards, or leaves facets out, until no place of a facet is narrower than a width, as far as that
/// succeeds: at the narrowest place the change that leaves the least to do, and so on.
fn widened(mut solid: Solid, body: &Convex, least: f64, most_shifts: usize) -> Solid {
    let mut distances = Distances { body, known: HashMap::new() };
    let mut left = solid.narrow_places(least);
    for _ in 0..most_shifts {
        if left.short == 0.0 {
            break;
        }
        let mut offers: Vec<(f64, Solid)> = Vec::new();
        let mut offer = |mut next: Solid, cost: f64| {
            let places = next.narrow_places(least);
            if places.short < left.short {
                offers.push((cost + places.short, next));
            }
        };
        for &facet in &left.facets {
            let (normal, height) = solid.planes[facet];
            for shift in SHIFTS {
                let mut next = solid.clone();
                next.cut(&normal, height - shift * least);
                offer(next, SHIFT_WEIGHT * shift);
            }
        }
        for &facet in &left.own {
            let mut planes = solid.planes.clone();
            planes.remove(facet);
            let next = Solid::of_planes(&planes, 0.0).compacted();
            let outside = distances.farthest(&next.vertices) / least;
            if outside <= MOST_OUTSIDE {
                offer(next, SHIFT_WEIGHT * outside);
            }
        }
        offers.sort_by(|p, q| p.0.total_cmp(&q.0));
        let closed = offers.into_iter().find_map(|(_, next)| {
            let mut next = next.compacted();
            // The places again, for vertices have other numbers.
            let places = next.narrow_places(least);
            next.is_closed().then_some((next, places))
        });
        let Some(next) = closed else { break };
        (solid, left) = next;
    }
    solid
}

/// Distances of points from a body. Most of the corners that are left when a facet is left out were there before.
struct Distances<'a> {
    body: &'a Convex,
    /// By the bits of the coordinates.
    known: HashMap<[u64; 3], f64>,
}

impl Distances<'_> {
    /// How far the farthest of some points lies outside of the body, 0 where none does.
    fn farthest(&mut self, points: &[Vector3<f64>]) -> f64 {
        let mut distance = |p: &Vector3<f64>| {
            let bits = [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()];
            *self.known.entry(bits).or_insert_with(|| self.body.distance(p))
        };
        points.iter().map(&mut distance).fold(0.0, f64::max)
    }
}
