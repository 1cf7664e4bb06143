//! A rounded convex polyhedron as a sharp one of facets that are not too small for the edges asked for.
//!
//! Triangles with their corners on flat faces and on narrow curved parts leave dents or needles, and beyond a dent Gmsh
//! is left with a flat tetrahedron; flat facets have neither. It begins with the planes of the faces, moved outwards by
//! the radius of the rounding. Then it is cut where it is farthest outside of the body: by the plane that touches the
//! body there, or a deeper one, where all edges made by that are long enough and no facet becomes narrow. What has too
//! little volume then is cut anew, with shorter edges.
//!
//! Of a sharp body with faces or edges that are too narrow, planes are moved inwards, and faces left out, until no face
//! is narrower than the edges asked for allow. `polyhedron` meshes what is left, scaled.

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::arrays::Each as _;
use crate::geometry::convex::{Convex, directed_edges};

/// Shortest edges that a cut may make, in edges asked for where nothing is close.
const LEAST_EDGE: f64 = 0.15;
/// Those that are tried before, with facets that are nowhere narrow: flat tetrahedra stand on small triangles.
const LEAST_EDGES: [f64; 2] = [0.3, 0.22];
/// Share of the volume of the body that is enough, of the largest copy of the polyhedron that lies inside.
const LEAST_VOLUME: f64 = 0.88;
/// Depths of cuts below the touching plane, over the distance from the body that is cut away.
const DEPTHS: [f64; 9] = [0.0, 0.15, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0];
/// Distance from the body that is not cut away, in edges asked for.
const LEAST_DISTANCE: f64 = 0.01;
/// By how much more the middle of an edge counts than its ends do.
const MIDDLE_WEIGHT: f64 = 2.0;
/// Narrowest places of facets, in edges asked for where nothing is close: flat tetrahedra stand on flat triangles.
const LEAST_WIDTH: f64 = 0.15;
/// How far planes are moved inwards to widen a facet, in least widths.
const SHIFTS: [f64; 5] = [0.3, 0.6, 1.0, 1.6, 2.5];
/// How far corners may lie outside of the body where a facet is left out, in least widths.
const MOST_OUTSIDE: f64 = 1.0;
/// What a plane that is moved by the least width counts against facets that are too narrow.
const SHIFT_WEIGHT: f64 = 0.05;
/// Most planes that are moved.
const MOST_SHIFTS: usize = 60;
/// Most cuts.
const MOST_CUTS: usize = 300;
/// Normals this close, as scalar products, are not tried twice.
const SAME_NORMAL: f64 = 0.9999;
/// Distance from a plane below which a vertex lies on it.
const ON_PLANE: f64 = 1.0e-10;
/// Half of the edge of the cube to begin with: no body with an equivalent diameter of 1 that can be drawn is longer.
const HALF_CUBE: f64 = 100.0;

/// A convex polyhedron that planes are cut off from.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Vertices of the facets, counter-clockwise as seen from outside.
    pub(super) faces: Vec<Vec<u32>>,
}

impl Facets {
    /// Of a rounded body, in its units, for edges of that length where nothing is close.
    pub(super) fn new(body: &Convex, edge: f64) -> Self {
        for least in LEAST_EDGES {
            let solid = Self::with_edges(body, least * edge, Some(LEAST_WIDTH * edge), edge);
            // The body has an equivalent diameter of 1.
            if solid.inscribed(body).powi(3) * solid.volume() >= LEAST_VOLUME * PI / 6.0 {
                return solid;
            }
        }
        Self::with_edges(body, LEAST_EDGE * edge, None, edge)
    }

    /// Of a rounded body, by cuts that make no edges shorter than `least`, and no facets narrower than `width`.
    fn with_edges(body: &Convex, least: f64, width: Option<f64>, edge: f64) -> Self {
        let short_of = |solid: &Self| width.map_or(0.0, |width| solid.narrow_places(width).0);
        let mut solid = Self::of_planes(&body.planes, body.rounding);
        let mut short = short_of(&solid);
        let mut tried: Vec<Vector3<f64>> = Vec::new();
        // Distance and normal of the places outside, by the bits of their coordinates: a place belongs to several
        // facets, and most are still there after a cut.
        let mut known: HashMap<[u64; 3], Option<(f64, Vector3<f64>)>> = HashMap::new();
        for _ in 0..MOST_CUTS {
            let is_new = |normal: &Vector3<f64>| tried.iter().all(|old| old.dot(normal) < SAME_NORMAL);
            let outside = solid.places().filter_map(|(p, weight)| {
                let outside = *known.entry(p.map(f64::to_bits).into()).or_insert_with(|| {
                    let away = body.distance(&p);
                    (away > LEAST_DISTANCE * edge).then(|| (away, body.normal(&p)))
                });
                let (away, normal) = outside.filter(|(_, normal)| is_new(normal))?;
                Some((away * weight, away, normal))
            });
            let Some((_, away, normal)) = outside.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            tried.push(normal);
            let highest = body.vertices.iter().map(|v| normal.dot(v)).fold(f64::NEG_INFINITY, f64::max);
            for depth in DEPTHS {
                let mut next = solid.clone();
                if next.cut(&normal, highest + body.rounding - depth * away) < least {
                    continue;
                }
                let next_short = short_of(&next);
                if next_short <= short {
                    (solid, short) = (next, next_short);
                    break;
                }
            }
        }
        let solid = solid.compacted();
        match width {
            Some(width) if short > 0.0 => solid.widened(body, width),
            _ => solid,
        }
    }

    /// Of a body whose rounding is too fine to be meshed, or that is sharp; `None` where its core has no place that is
    /// too narrow for edges of that length.
    pub(super) fn of_narrow(body: &Convex, edge: f64) -> Option<Self> {
        let solid = Self::of_planes(&body.planes, body.rounding).compacted();
        (solid.narrow_places(LEAST_WIDTH * edge).0 > 0.0).then(|| solid.widened(body, LEAST_WIDTH * edge))
    }

    fn of_planes(planes: &[(Vector3<f64>, f64)], rounding: f64) -> Self {
        let mut solid = Self::cube();
        for (normal, height) in planes {
            solid.cut(normal, height + rounding);
        }
        solid
    }

    /// Moves planes inwards, or leaves facets out, until no place of a facet is narrower than a width, as far as that
    /// succeeds: at the narrowest place the change that leaves the least to do, and so on.
    fn widened(self, body: &Convex, least: f64) -> Self {
        let (mut solid, mut planes) = (self.clone(), self.planes());
        let (mut left, mut at) = solid.narrow_places(least);
        for _ in 0..MOST_SHIFTS {
            if left == 0.0 {
                break;
            }
            let mut best: Option<(f64, Self)> = None;
            for &facet in &at {
                let shifted = SHIFTS.map(|shift| {
                    let mut planes = planes.clone();
                    planes[facet].1 -= shift * least;
                    (planes, shift)
                });
                let mut without = planes.clone();
                without.remove(facet);
                for (planes, shift) in shifted.into_iter().chain([(without, 0.0)]) {
                    let next = Self::of_planes(&planes, 0.0).compacted();
                    if !next.is_closed() {
                        continue;
                    }
                    let outside = next.vertices.iter().map(|v| body.distance(v)).fold(0.0, f64::max) / least;
                    if shift == 0.0 && outside > MOST_OUTSIDE {
                        continue;
                    }
                    let cost = next.narrow_places(least).0 + SHIFT_WEIGHT * shift.max(outside);
                    if best.as_ref().is_none_or(|(of_best, _)| cost < *of_best) {
                        best = Some((cost, next));
                    }
                }
            }
            let Some((_, next)) = best else { break };
            let (next_left, next_at) = next.narrow_places(least);
            if next_left >= left {
                break;
            }
            (solid, left, at) = (next, next_left, next_at);
            planes = solid.planes();
        }
        solid
    }

    fn volume(&self) -> f64 {
        let at = |v: u32| self.vertices[v as usize];
        let fan = |corners: &Vec<u32>| {
            let start = at(corners[0]);
            corners.windows(2).map(|pair| start.dot(&at(pair[0]).cross(&at(pair[1])))).sum::<f64>() / 6.0
        };
        self.faces.iter().map(fan).sum()
    }

    /// The planes of the facets, in their order.
    fn planes(&self) -> Vec<(Vector3<f64>, f64)> {
        let plane = |corners: &Vec<u32>| {
            let at = |v: u32| self.vertices[v as usize];
            let normal: Vector3<f64> = directed_edges(corners)
                .map(|[from, to]| (at(from) - at(corners[0])).cross(&(at(to) - at(corners[0]))))
                .sum();
            let normal = normal.normalize();
            let heights: f64 = corners.iter().map(|&v| normal.dot(&at(v))).sum();
            (normal, heights / corners.len() as f64)
        };
        self.faces.iter().map(plane).collect()
    }

    /// By how much the places that are narrower than a width fall short of it, and the facets at the narrowest of them.
    /// A place is a corner of a facet and an edge of the same that it does not lie on.
    fn narrow_places(&self, least: f64) -> (f64, Vec<usize>) {
        let at = |v: u32| self.vertices[v as usize];
        let (mut short, mut narrowest) = (0.0, None);
        for corners in &self.faces {
            for &corner in corners {
                for [from, to] in directed_edges(corners).filter(|edge| !edge.contains(&corner)) {
                    let (q, along) = (at(from), at(to) - at(from));
                    let share = (along.dot(&(at(corner) - q)) / along.norm_squared()).clamp(0.0, 1.0);
                    let width = (at(corner) - q - along * share).norm();
                    if width < least {
                        short += 1.0 - width / least;
                        if narrowest.is_none_or(|(narrowest, _)| width < narrowest) {
                            narrowest = Some((width, [corner, from, to]));
                        }
                    }
                }
            }
        }
        let has = |corners: &Vec<u32>| {
            narrowest.is_some_and(|(_, place)| place.iter().any(|v| corners.contains(v)))
        };
        (short, (0..self.faces.len()).filter(|&facet| has(&self.faces[facet])).collect())
    }

    /// Whether every edge has two facets, corners, edges and facets are those of one surface, and planes cut all of it.
    fn is_closed(&self) -> bool {
        let mut edges: Vec<[u32; 2]> =
            self.faces.iter().flat_map(|corners| directed_edges(corners)).collect();
        edges.sort_unstable();
        let paired = edges.iter().all(|[from, to]| edges.binary_search(&[*to, *from]).is_ok());
        let is_cut = self.vertices.iter().all(|v| v.amax() < HALF_CUBE / 2.0);
        paired && is_cut && 2 * (self.vertices.len() + self.faces.len()) == edges.len() + 4
    }

    fn cube() -> Self {
        let corner = |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 1 { HALF_CUBE } else { -HALF_CUBE });
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self { vertices: (0..8).map(corner).collect(), faces: faces.map(Vec::from).to_vec() }
    }

    /// Corners and middles of edges, and what they count.
    fn places(&self) -> impl Iterator<Item = (Vector3<f64>, f64)> {
        self.faces.iter().flat_map(|corners| directed_edges(corners)).flat_map(|[from, to]| {
            let [p, q] = [from, to].each(|v| self.vertices[v as usize]);
            [(p, 1.0), ((p + q) / 2.0, MIDDLE_WEIGHT)]
        })
    }

    /// Cuts off what lies above a plane, and says how long the shortest of the edges at new vertices is.
    fn cut(&mut self, normal: &Vector3<f64>, height: f64) -> f64 {
        let old = self.vertices.len() as u32;
        let above: Vec<f64> = self.vertices.iter().map(|v| normal.dot(v) - height).collect();
        let is_out = |v: u32| above[v as usize] > ON_PLANE;
        let mut made: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut next: BTreeMap<u32, u32> = BTreeMap::new();
        let mut kept = Vec::with_capacity(self.faces.len() + 1);
        for corners in &self.faces {
            if !corners.iter().any(|&v| is_out(v)) {
                kept.push(corners.clone());
                continue;
            }
            let (mut left, mut entered) = (None, None);
            let mut rest: Vec<u32> = Vec::new();
            for [from, to] in directed_edges(corners) {
                if !is_out(from) {
                    rest.push(from);
                }
                if is_out(from) == is_out(to) {
                    continue;
                }
                let (inside, outside) = if is_out(from) { (to, from) } else { (from, to) };
                let (low, high) = (above[inside as usize], above[outside as usize]);
                let crossing = if low > -ON_PLANE {
                    inside
                } else {
                    *made.entry([inside, outside]).or_insert_with(|| {
                        let (p, q) = (self.vertices[inside as usize], self.vertices[outside as usize]);
                        self.vertices.push(p + (q - p) * (low / (low - high)));
                        self.vertices.len() as u32 - 1
                    })
                };
                rest.push(crossing);
                *(if is_out(to) { &mut left } else { &mut entered }) = Some(crossing);
            }
            if let (Some(left), Some(entered)) = (left, entered)
                && left != entered
            {
                next.insert(entered, left);
            }
            rest.dedup();
            if rest.len() > 1 && rest.first() == rest.last() {
                rest.pop();
            }
            if rest.len() > 2 {
                kept.push(rest);
            }
        }
        if let Some((&start, _)) = next.iter().next() {
            let mut corners = vec![start];
            while let Some(&following) = corners.last().and_then(|last| next.get(last)) {
                if following == start || corners.len() > next.len() {
                    break;
                }
                corners.push(following);
            }
            if corners.len() > 2 {
                kept.push(corners);
            }
        }
        self.faces = kept;
        let edges = self.faces.iter().flat_map(|corners| directed_edges(corners));
        let lengths = edges
            .filter(|[from, to]| *from >= old || *to >= old)
            .map(|edge| edge.each(|v| self.vertices[v as usize]))
            .map(|[p, q]| (p - q).norm());
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// The same without the vertices that no facet has.
    fn compacted(&self) -> Self {
        let mut numbers = BTreeMap::new();
        let mut vertices = Vec::new();
        let mut number = |v: &u32| {
            *numbers.entry(*v).or_insert_with(|| {
                vertices.push(self.vertices[*v as usize]);
                vertices.len() as u32 - 1
            })
        };
        let faces = self.faces.iter().map(|corners| corners.iter().map(&mut number).collect()).collect();
        Self { vertices, faces }
    }

    /// Factor of the largest copy about the origin that lies inside of the body.
    pub(super) fn inscribed(&self, body: &Convex) -> f64 {
        let leave = |v: &Vector3<f64>| body.chord(&Vector3::zeros(), v).map_or(0.0, |[_, leave]| leave);
        self.vertices.iter().map(leave).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::shape::Polyhedron;

    /// A cube of equivalent diameter 1 with a corner and an edge cut off by that much.
    fn cut_cube(by: f64) -> Convex {
        let mut solid = Facets::cube();
        for k in 0..3 {
            let axis = Vector3::from_fn(|i, _| if i == k { 1.0 } else { 0.0 });
            solid.cut(&axis, 0.5);
            solid.cut(&-axis, 0.5);
        }
        if by > 0.0 {
            solid.cut(&Vector3::new(1.0, 1.0, 1.0).normalize(), (1.5 - by) / 3_f64.sqrt());
            solid.cut(&Vector3::new(-1.0, -1.0, 0.0).normalize(), (1.0 - by) / 2_f64.sqrt());
        }
        let body = Polyhedron::hull_of(&solid.compacted().vertices).unwrap().normalized();
        Convex::all(&[body]).remove(0)
    }

    #[test]
    fn narrow_faces_are_left_out_and_wide_ones_stay() {
        let edge = 0.2;
        let least = LEAST_WIDTH * edge;
        // Of cuts that are wide enough, and of none, the core is meshed as it is.
        assert!(Facets::of_narrow(&cut_cube(0.0), edge).is_none());
        assert!(Facets::of_narrow(&cut_cube(0.2), edge).is_none());
        for by in [1e-6, 1e-3, 0.01] {
            let body = cut_cube(by);
            let facets = Facets::of_narrow(&body, edge).unwrap();
            assert_eq!(facets.narrow_places(least), (0.0, Vec::new()), "{by}");
            assert!(facets.is_closed());
            let away = facets.vertices.iter().map(|v| body.distance(v)).fold(0.0, f64::max);
            assert!(away <= MOST_OUTSIDE * least, "{by}: {away}");
            let inscribed = facets.inscribed(&body);
            assert!(inscribed > 0.95 && inscribed <= 1.0 + least * 4.0, "{by}: {inscribed}");
            assert!((6..=8).contains(&facets.faces.len()), "{by}: {}", facets.faces.len());
        }
    }
}
