//! A convex polyhedron as the intersection of half-spaces: cut by one plane at a time, and its narrow places.
//!
//! A place is a corner of a facet and an edge of the same facet that the corner does not lie on; its width is their
//! distance. Mesh generators call the least width around a vertex the local feature size (Ruppert 1995,
//! DOI 10.1006/jagm.1995.1021).

use std::collections::BTreeMap;
use std::rc::Rc;

use nalgebra::Vector3;

use crate::arrays::Each as _;
use crate::geometry::convex::directed_edges;

/// Distance from a plane below which a vertex lies on it.
const ON_PLANE: f64 = 1.0e-10;
/// Half of the edge of the cube to begin with: no body with an equivalent diameter of 1 that can be drawn is longer.
const HALF_CUBE: f64 = 100.0;

/// A convex polyhedron that planes are cut off from.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    /// Vertices; after cuts, some of them belong to no facet ([`Solid::compacted`]).
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Vertices of the facets, counter-clockwise as seen from outside. Copies share those that no cut has changed.
    pub(super) faces: Vec<Rc<[u32]>>,
    /// Outward unit normal of each facet and its height above the origin.
    pub(super) planes: Vec<(Vector3<f64>, f64)>,
    /// What is narrow of each facet for the width that was asked for last; none where the facet has changed since.
    narrow: Vec<Option<NarrowFacet>>,
}

/// What is narrow of a facet.
#[derive(Clone, Copy, Debug)]
struct NarrowFacet {
    /// Sum over its places of the share by which each falls short of the width asked for.
    short: f64,
    /// Width of the narrowest place, and its corner and the ends of its edge.
    narrowest: (f64, [u32; 3]),
}

/// What is narrow of a polyhedron.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct NarrowPlaces {
    /// Sum over all places of the share by which each falls short of the width asked for.
    pub(super) short: f64,
    /// The facets at the narrowest place.
    pub(super) facets: Vec<usize>,
    /// Of these, those that the place is on.
    pub(super) own: Vec<usize>,
}

impl Solid {
    /// The intersection of half-spaces below planes, moved outwards by a length.
    pub(super) fn of_planes(planes: &[(Vector3<f64>, f64)], outwards: f64) -> Self {
        let mut solid = Self::cube();
        for (normal, height) in planes {
            solid.cut(normal, height + outwards);
        }
        solid
    }

    fn cube() -> Self {
        let corner = |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 1 { HALF_CUBE } else { -HALF_CUBE });
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let normals = [-Vector3::z(), Vector3::z(), -Vector3::y(), Vector3::y(), -Vector3::x(), Vector3::x()];
        Self {
            vertices: (0..8).map(corner).collect(),
            faces: faces.map(|corners| Rc::from(corners.as_slice())).to_vec(),
            planes: normals.map(|normal| (normal, HALF_CUBE)).to_vec(),
            narrow: vec![None; 6],
        }
    }

    /// How far it reaches along a direction.
    pub(super) fn support(&self, normal: &Vector3<f64>) -> f64 {
        let heights = self
            .faces
            .iter()
            .flat_map(|corners| corners.iter())
            .map(|&v| normal.dot(&self.vertices[v as usize]));
        heights.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether every edge has two facets, corners, edges and facets are those of one surface, and planes cut all of it.
    pub(super) fn is_closed(&self) -> bool {
        let mut edges: Vec<[u32; 2]> =
            self.faces.iter().flat_map(|corners| directed_edges(corners)).collect();
        edges.sort_unstable();
        let paired = edges.iter().all(|[from, to]| edges.binary_search(&[*to, *from]).is_ok());
        let is_cut = self.vertices.iter().all(|v| v.amax() < HALF_CUBE / 2.0);
        paired && is_cut && 2 * (self.vertices.len() + self.faces.len()) == edges.len() + 4
    }

    /// Cuts off what lies above a plane.
    pub(super) fn cut(&mut self, normal: &Vector3<f64>, height: f64) {
        let above: Vec<f64> = self.vertices.iter().map(|v| normal.dot(v) - height).collect();
        let is_out = |v: u32| above[v as usize] > ON_PLANE;
        let mut made: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut next: BTreeMap<u32, u32> = BTreeMap::new();
        let mut kept = 0;
        for facet in 0..self.faces.len() {
            if !self.faces[facet].iter().any(|&v| is_out(v)) {
                self.faces.swap(kept, facet);
                self.planes.swap(kept, facet);
                self.narrow.swap(kept, facet);
                kept += 1;
                continue;
            }
            let (corners, plane) = (self.faces[facet].clone(), self.planes[facet]);
            let (mut left, mut entered) = (None, None);
            let mut rest: Vec<u32> = Vec::new();
            for [from, to] in directed_edges(&corners) {
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
                (self.faces[kept], self.planes[kept], self.narrow[kept]) = (rest.into(), plane, None);
                kept += 1;
            }
        }
        self.faces.truncate(kept);
        self.planes.truncate(kept);
        self.narrow.truncate(kept);
        if let Some((&start, _)) = next.iter().next() {
            let mut corners = vec![start];
            while let Some(&following) = corners.last().and_then(|last| next.get(last)) {
                if following == start || corners.len() > next.len() {
                    break;
                }
                corners.push(following);
            }
            if corners.len() > 2 {
                self.faces.push(corners.into());
                self.planes.push((*normal, height));
                self.narrow.push(None);
            }
        }
    }

    /// How long the shortest of the edges would be that a cut makes or shortens; infinite where it cuts nothing off.
    pub(super) fn shortest_edge_of_cut(&self, normal: &Vector3<f64>, height: f64) -> f64 {
        let above: Vec<f64> = self.vertices.iter().map(|v| normal.dot(v) - height).collect();
        let is_out = |v: u32| above[v as usize] > ON_PLANE;
        let mut shortest2 = f64::INFINITY;
        for corners in &self.faces {
            let mut crossings: [Option<Vector3<f64>>; 2] = [None; 2];
            for [from, to] in directed_edges(corners) {
                if is_out(from) == is_out(to) {
                    continue;
                }
                let (inside, outside) = if is_out(from) { (to, from) } else { (from, to) };
                let (low, high) = (above[inside as usize], above[outside as usize]);
                let (p, q) = (self.vertices[inside as usize], self.vertices[outside as usize]);
                let crossing = p + (q - p) * (low / (low - high)).max(0.0);
                if low < -ON_PLANE {
                    shortest2 = shortest2.min((crossing - p).norm_squared());
                }
                crossings[usize::from(is_out(from))] = Some(crossing);
            }
            if let [Some(p), Some(q)] = crossings {
                shortest2 = shortest2.min((p - q).norm_squared());
            }
        }
        shortest2.sqrt()
    }

    /// The same without the vertices that no facet has.
    pub(super) fn compacted(&self) -> Self {
        let mut numbers = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        let mut number = |v: &u32| {
            let number = &mut numbers[*v as usize];
            if *number == u32::MAX {
                *number = vertices.len() as u32;
                vertices.push(self.vertices[*v as usize]);
            }
            *number
        };
        let faces = self.faces.iter().map(|corners| corners.iter().map(&mut number).collect()).collect();
        let renumbered = |facet: &NarrowFacet| {
            let (width, place) = facet.narrowest;
            // The place of a facet that is nowhere narrow is none.
            let place = if facet.short > 0.0 { place.each(|v| numbers[v as usize]) } else { place };
            NarrowFacet { narrowest: (width, place), ..*facet }
        };
        let narrow = self.narrow.iter().map(|facet| facet.as_ref().map(renumbered)).collect();
        Self { vertices, faces, planes: self.planes.clone(), narrow }
    }

    /// The places that are narrower than a width, which must be the same for all cuts of a polyhedron.
    pub(super) fn narrow_places(&mut self, least: f64) -> NarrowPlaces {
        let (mut short, mut narrowest) = (0.0, (f64::INFINITY, [0; 3]));
        for (corners, known) in self.faces.iter().zip(&mut self.narrow) {
            let vertices = &self.vertices;
            let facet = known.get_or_insert_with(|| NarrowFacet::new(vertices, corners, least));
            short += facet.short;
            if facet.narrowest.0 < narrowest.0 {
                narrowest = facet.narrowest;
            }
        }
        let (width, place) = narrowest;
        if width >= least {
            return NarrowPlaces::default();
        }
        let all = 0..self.faces.len();
        let count = |facet: usize| place.iter().filter(|v| self.faces[facet].contains(v)).count();
        NarrowPlaces {
            short,
            facets: all.clone().filter(|facet| count(*facet) > 0).collect(),
            own: all.filter(|facet| count(*facet) == 3).collect(),
        }
    }
}

impl NarrowFacet {
    fn new(vertices: &[Vector3<f64>], corners: &[u32], least: f64) -> Self {
        let mut facet = Self { short: 0.0, narrowest: (f64::INFINITY, [0; 3]) };
        for_each_place(vertices, corners, |corner, edge, width| {
            if width < least {
                facet.short += 1.0 - width / least;
                if width < facet.narrowest.0 {
                    facet.narrowest = (width, [corner, edge[0], edge[1]]);
                }
            }
        });
        facet
    }
}

/// Volume of a polyhedron.
pub(super) fn volume(vertices: &[Vector3<f64>], faces: &[impl AsRef<[u32]>]) -> f64 {
    let at = |v: u32| vertices[v as usize];
    let fan = |corners: &[u32]| {
        let start = at(corners[0]);
        corners.windows(2).map(|pair| start.dot(&at(pair[0]).cross(&at(pair[1])))).sum::<f64>() / 6.0
    };
    faces.iter().map(|corners| fan(corners.as_ref())).sum()
}

/// Calls `visit` with the places of a facet: a corner, an edge that it does not lie on, and their distance.
pub(super) fn for_each_place(
    vertices: &[Vector3<f64>],
    corners: &[u32],
    mut visit: impl FnMut(u32, [u32; 2], f64),
) {
    let at = |v: u32| vertices[v as usize];
    for [from, to] in directed_edges(corners) {
        let (q, along) = (at(from), at(to) - at(from));
        let per_length2 = 1.0 / along.norm_squared();
        for &corner in corners.iter().filter(|corner| ![from, to].contains(corner)) {
            let from_q = at(corner) - q;
            let share = (along.dot(&from_q) * per_length2).clamp(0.0, 1.0);
            visit(corner, [from, to], (from_q - along * share).norm());
        }
    }
}
