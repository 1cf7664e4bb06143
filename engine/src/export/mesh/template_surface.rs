//! The facets of a template as triangles, made once for all grains of about the same edges over their diameters.
//!
//! Edges of facets are divided with them, so that the triangles of two facets fit. Triangles are small where facets are
//! narrow: with the local feature size `w` of a corner, edges there are at most `4 w` long, and they grow with the
//! distance from it (Ruppert 1995, DOI 10.1006/jagm.1995.1021). Within a facet the triangulation is Delaunay's, and
//! vertices inside of it are moved to the middle of their neighbours (Laplacian smoothing).

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::OnceLock;

use nalgebra::Vector3;

use super::facets::Facets;
use super::solid::for_each_place;
use super::surface::{Shape, Surface, make_more_than_half_a_turn};
use crate::arrays::Each as _;
use crate::elementary::atan2;
use crate::gap::linear::{Vector, cross, distance2, dot, minus, norm, scaled, sum};
use crate::geometry::convex::directed_edges;

/// Edges in multiples of those asked for, from step to step: what is coarse is put in order before it is divided.
pub(super) const STEPS: [f64; 3] = [4.0, 2.0, 1.0];
/// Times that vertices within a facet are moved to the middle of their neighbours, in each step.
pub(super) const SMOOTHINGS: usize = 2;
/// Longest edges at a corner over its local feature size, and on a facet over its width.
const EDGE_PER_WIDTH: f64 = 4.0;
/// How much longer edges become with the distance from a narrow place.
const GROWTH: f64 = 0.7;
/// Shortest edges that narrow places ask for, over the length of edges where nothing is narrow.
const SHORTEST: f64 = 1.0 / 64.0;
/// How high a vertex may lie above a plane that it counts as part of, over the size of the grain.
const FLATNESS: f64 = 1.0e-8;

/// The facets of a template at a level of precision, in its units, and the triangles that are made of them once.
#[derive(Debug)]
pub(super) struct TemplateFacets {
    pub(super) facets: Facets,
    sizes: Sizes,
    /// The triangles, or how many they were not to be more than.
    surface: OnceLock<Result<Surface, usize>>,
}

/// How long edges may be.
#[derive(Debug)]
struct Sizes {
    /// Where nothing is narrow.
    edge: f64,
    /// At each corner.
    at: Vec<f64>,
    /// On each facet.
    on: Vec<f64>,
}

impl TemplateFacets {
    /// The facets of a template, for edges of that length where nothing is close.
    pub(super) fn new(facets: Facets, edge: f64) -> Self {
        Self { sizes: Sizes::new(&facets, edge), facets, surface: OnceLock::new() }
    }

    /// Length of edges at a corner over that where nothing is narrow.
    pub(super) fn fineness_at(&self, vertex: usize) -> f64 {
        self.sizes.at[vertex] / self.sizes.edge
    }

    /// The triangles; `None` when they are more than `most_triangles`.
    pub(super) fn surface(&self, most_triangles: usize) -> Option<Cow<'_, Surface>> {
        let made = |most: usize| triangulated(&self.facets, &self.sizes, most);
        match self.surface.get_or_init(|| made(most_triangles).ok_or(most_triangles)) {
            Ok(surface) => Some(Cow::Borrowed(surface)),
            // Another mesh may have more.
            Err(tried) if *tried < most_triangles => made(most_triangles).map(Cow::Owned),
            Err(_) => None,
        }
    }
}

impl Sizes {
    fn new(facets: &Facets, edge: f64) -> Self {
        let length = |width: f64| (EDGE_PER_WIDTH * width).clamp(SHORTEST * edge, edge);
        let mut at = vec![f64::INFINITY; facets.vertices.len()];
        let mut on = Vec::with_capacity(facets.faces.len());
        for corners in &facets.faces {
            for_each_place(&facets.vertices, corners, |corner, ends, width| {
                for vertex in [corner, ends[0], ends[1]] {
                    // The ends of an edge are at a narrow place that is at one of them.
                    let away = (facets.vertices[vertex as usize] - facets.vertices[corner as usize]).norm();
                    let size = &mut at[vertex as usize];
                    *size = size.min(width.max(away));
                }
            });
            on.push(length(width_of(&facets.vertices, corners)));
        }
        Self { edge, at: at.into_iter().map(length).collect(), on }
    }
}

/// Width of a convex polygon: the least distance between two parallel lines that enclose it.
fn width_of(vertices: &[Vector3<f64>], corners: &[u32]) -> f64 {
    let at = |v: u32| vertices[v as usize];
    let across = directed_edges(corners).map(|[from, to]| {
        let along = (at(to) - at(from)).normalize();
        let heights = corners.iter().map(|&v| (at(v) - at(from)).cross(&along).norm());
        heights.fold(0.0, f64::max)
    });
    across.fold(f64::INFINITY, f64::min)
}

/// The triangles of facets; `None` when they are more than `most_triangles`.
fn triangulated(facets: &Facets, sizes: &Sizes, most_triangles: usize) -> Option<Surface> {
    let points: Vec<Vector> = facets.vertices.iter().map(|v| (*v).into()).collect();
    let size = points.iter().map(|p| norm(*p)).fold(0.0, f64::max);
    let narrow = sizes.at.iter().enumerate().filter(|(_, size)| **size < sizes.edge);
    let narrow = narrow.map(|(vertex, size)| (points[vertex], *size)).collect();
    let mut patches = Patches { points, sizes, narrow, coarse: STEPS[0], flat: FLATNESS * size };
    let (triangles, of) = patches.divided(&facets.faces);
    let mut surface = Surface::of_patches(patches.points.clone(), triangles, of);
    surface.flip(&patches);
    for coarse in STEPS {
        patches.coarse = coarse;
        if !surface.refine(&mut patches, most_triangles) {
            return None;
        }
        for _ in 0..SMOOTHINGS {
            smooth(&mut surface);
            surface.flip(&patches);
        }
    }
    Some(surface)
}

/// Facets while they are divided.
struct Patches<'a> {
    /// The vertices to begin with.
    points: Vec<Vector>,
    sizes: &'a Sizes,
    /// Corners with shorter edges, and these.
    narrow: Vec<(Vector, f64)>,
    coarse: f64,
    /// How high a vertex may lie above a plane that it counts as part of.
    flat: f64,
}

impl Patches<'_> {
    /// The triangles to begin with, and the facet of each: edges are divided evenly, and facets are triangulated as
    /// Delaunay's triangulation of their boundary.
    fn divided(&mut self, polygons: &[Vec<u32>]) -> (Vec<[u32; 3]>, Vec<u32>) {
        let (mut triangles, mut of) = (Vec::new(), Vec::new());
        let mut chains = HashMap::new();
        for [from, to] in polygons.iter().flat_map(|corners| directed_edges(corners)) {
            self.divide(from, to, &mut chains);
        }
        let side = |[from, to]: [u32; 2]| -> Vec<u32> {
            match chains.get(&[from.min(to), from.max(to)]) {
                None => vec![from, to],
                Some(chain) if from < to => chain.clone(),
                Some(chain) => chain.iter().rev().copied().collect(),
            }
        };
        for (facet, corners) in (0..).zip(polygons) {
            let sides = directed_edges(corners).map(side);
            let boundary: Vec<u32> = sides.flat_map(|side| side[..side.len() - 1].to_vec()).collect();
            self.triangulate(&boundary, &mut triangles);
            of.resize(triangles.len(), facet);
        }
        (triangles, of)
    }

    /// Divides an edge evenly, once.
    fn divide(&mut self, from: u32, to: u32, chains: &mut HashMap<[u32; 2], Vec<u32>>) {
        let key = [from.min(to), from.max(to)];
        chains.entry(key).or_insert_with(|| {
            let [p, q] = key.each(|p| self.points[p as usize]);
            let count = (distance2(p, q).sqrt() / self.sizes.edge).round().max(1.0);
            let mut chain = vec![key[0]];
            for k in 1..count as u32 {
                let share = f64::from(k) / count;
                self.points.push(sum(p, scaled(minus(q, p), share)));
                chain.push(self.points.len() as u32 - 1);
            }
            chain.push(key[1]);
            chain
        });
    }

    /// Triangulates a convex polygon, some of whose corners may lie on a line: on the edge from the first corner to the
    /// last stands the triangle with the largest angle, and so on at both sides of it.
    fn triangulate(&self, boundary: &[u32], triangles: &mut Vec<[u32; 3]>) {
        let mut open = vec![boundary.to_vec()];
        while let Some(corners) = open.pop() {
            let n = corners.len();
            if n < 3 {
                continue;
            }
            let at = |k: usize| self.points[corners[k] as usize];
            let (p, q) = (at(0), at(n - 1));
            let angle = |k: usize| {
                let (u, v) = (minus(p, at(k)), minus(q, at(k)));
                let normal = cross(u, v);
                let area = dot(normal, normal).sqrt();
                // Corners on the line of the edge make no triangle.
                let height = area / norm(minus(q, p));
                if height > self.flat { atan2(area, dot(u, v)) } else { -1.0 }
            };
            let apex = (1..n - 1).max_by(|&i, &j| angle(i).total_cmp(&angle(j))).unwrap_or(1);
            triangles.push([corners[0], corners[apex], corners[n - 1]]);
            open.push(corners[..=apex].to_vec());
            open.push(corners[apex..].to_vec());
        }
    }
}

impl Shape for Patches<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[Vector]) -> Vector {
        middle(a, b, points)
    }

    fn wants_shorter(&self, centroid: Vector, longest: f64) -> bool {
        let longest = longest / self.coarse;
        longest > self.sizes.edge
            || self.narrow.iter().any(|(p, size)| {
                let beyond = (longest - size) / GROWTH;
                beyond > 0.0 && distance2(*p, centroid) < beyond * beyond
            })
    }

    fn most_mm(&self, facet: u32) -> f64 {
        self.coarse * self.sizes.on[facet as usize]
    }

    fn is_wrong(&self, edge: [u32; 2], beside: [u32; 2], points: &[Vector]) -> bool {
        is_no_delaunay(edge, beside, points)
    }
}

/// The middle between two points.
pub(super) fn middle(a: u32, b: u32, points: &[Vector]) -> Vector {
    scaled(sum(points[a as usize], points[b as usize]), 0.5)
}

/// Within a facet: whether the angles opposite to ab make more than half a turn.
pub(super) fn is_no_delaunay([a, b]: [u32; 2], [c, d]: [u32; 2], points: &[Vector]) -> bool {
    let [a, b, c, d] = [a, b, c, d].each(|p| points[p as usize]);
    make_more_than_half_a_turn([minus(a, c), minus(b, c)], [minus(a, d), minus(b, d)])
}

/// Moves vertices inside of facets to the middle of their neighbours, where no triangle turns over by that.
pub(super) fn smooth(surface: &mut Surface) {
    const MANY: u32 = u32::MAX;
    const NONE: u32 = u32::MAX - 1;
    // The facet that each vertex is inside of, and the number of its triangles.
    let mut inside = vec![(NONE, 0_u32); surface.points.len()];
    for (t, corners) in surface.triangles.iter().enumerate() {
        let facet = surface.patch(t);
        for &p in corners {
            let (of, triangles) = &mut inside[p as usize];
            *of = if *of == NONE || *of == facet { facet } else { MANY };
            *triangles += 1;
        }
    }
    let mut ends = Vec::with_capacity(inside.len());
    let mut end = 0;
    for (of, triangles) in &inside {
        ends.push(end);
        end += if *of < NONE { *triangles as usize } else { 0 };
    }
    // The edges opposite to each vertex, one vertex after the other.
    let mut around = vec![[0_u32; 2]; end];
    for &[a, b, c] in &surface.triangles {
        for [own, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
            if inside[own as usize].0 < NONE {
                around[ends[own as usize]] = [p, q];
                ends[own as usize] += 1;
            }
        }
    }
    let mut first = 0;
    for (own, last) in ends.into_iter().enumerate() {
        let edges = &around[first..last.max(first)];
        if inside[own].0 >= NONE || edges.is_empty() {
            continue;
        }
        first = last;
        let at = |p: u32| surface.points[p as usize];
        let total = edges.iter().fold([0.0; 3], |total, [p, _]| sum(total, at(*p)));
        let (old, new) = (surface.points[own], scaled(total, 1.0 / edges.len() as f64));
        let normal = |center: Vector, [p, q]: [u32; 2]| cross(minus(at(p), center), minus(at(q), center));
        let keeps = edges.iter().all(|&edge| {
            let (before, after) = (normal(old, edge), normal(new, edge));
            dot(before, after) > 0.05 * dot(before, before)
        });
        if keeps {
            surface.points[own] = new;
        }
    }
}
