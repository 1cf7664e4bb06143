//! The surface of one grain that is a convex polyhedron.
//!
//! A sharp grain is meshed by its faces, exactly. The edges of its faces are divided with them, so that the triangles
//! of
//! two faces fit; within a face the triangulation is Delaunay's, and vertices inside of a face are moved to the middle
//! of
//! their neighbours.
//!
//! A rounded grain has its faces, strips around its edges and caps around its vertices (`convex::Skin`), with arcs of
//! at
//! most 60 degrees. A vertex is kept as a point of the core and a unit normal: between two vertices lies the middle of
//! both points with the mean of both normals, which never leaves the body. The polyhedron is inscribed, and convex but
//! for dents of less than two hundredths of the diameter that no good triangles would close. It is
//! given its volume by a larger radius, as far as half of every gap is left. A rounding that is too fine for the edges
//! asked for (a diameter below the shortest of them) is not meshed: the grain is its core, enlarged.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_3, PI};

use super::size::{Facing, Other};
use super::surface::{Shape, Surface, cross, distance2, dot};
use crate::export::convex::{Convex, Skin, directed_edges};
use crate::gap::linear::{Vector, minus, norm, scaled, sum};
use crate::packing::Polyhedra;
use crate::shape::Pose;

/// Edges in multiples of those asked for, from step to step: what is coarse is put in order before it is divided.
const STEPS: [f64; 3] = [4.0, 2.0, 1.0];
/// Times that vertices within a face are moved to the middle of their neighbours, in each step.
const SMOOTHINGS: usize = 2;
/// Length of edges on rounded parts, in radii of the rounding.
const EDGE_PER_RADIUS: f64 = 2.0;
/// How high a vertex may lie above a plane that it counts as part of, over the size of the grain.
const FLATNESS: f64 = 1.0e-8;
/// Triangles that a dent is taken away by are no worse than that (see [`quality`]), or no worse than those before.
const LEAST_QUALITY: f64 = 0.04;
/// Relative error of a corrected volume.
const VOLUME_TOLERANCE: f64 = 1.0e-13;
/// Most steps of the search for it.
const MOST_STEPS: usize = 60;
/// Share by which inscribed surfaces are smaller, so that rounding brings no vertex out of the body.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// How the surface of a grain is to be meshed, and what is around it, seen from its centre.
pub(super) struct Angular<'a> {
    /// Length of edges where nothing is close.
    pub(super) edge_mm: f64,
    /// Shortest edges that are asked for.
    pub(super) floor_mm: f64,
    /// The volume to be met, where volumes are corrected.
    pub(super) target_mm3: Option<f64>,
    pub(super) facing: Vec<Facing<'a>>,
    /// What vertices must not come too close to: a direction, how far they may reach along it, and what is there.
    pub(super) obstacles: Vec<(Vector, f64, Other<'a>)>,
    /// No vertex moves farther, for what is farther away was not looked at.
    pub(super) most_mm: f64,
}

/// A grain about its centre.
pub(super) struct Placed {
    vertices: Vec<Vector>,
    rotation: nalgebra::Matrix3<f64>,
    radius: f64,
}

impl Angular<'_> {
    pub(super) fn placed(grains: &Polyhedra, row: usize) -> Placed {
        let (shape, pose) = (grains.shape(row), &grains.poses[row]);
        // About the origin, where vertices are the same but for the centre that is added.
        let about = Pose { center_mm: nalgebra::Vector3::zeros(), ..*pose };
        Placed {
            vertices: shape.template.world_vertices_mm(shape.scale_mm, &about).map(Into::into).collect(),
            rotation: pose.rotation(),
            radius: shape.scale_mm * shape.template.rounding(),
        }
    }

    /// The surface, and whether it has the volume asked for; `None` when that would take more than `most_triangles`.
    pub(super) fn surface(
        &self,
        template: &Convex,
        placed: &Placed,
        most_triangles: usize,
    ) -> Option<(Surface, bool)> {
        let size = placed.vertices.iter().map(|vertex| norm(*vertex)).fold(0.0, f64::max) + placed.radius;
        let is_rounded = placed.radius > 0.0 && 2.0 * placed.radius >= self.floor_mm;
        let round_mm =
            (EDGE_PER_RADIUS * placed.radius).clamp(self.floor_mm, self.edge_mm.max(self.floor_mm));
        let sharp;
        let skin = if is_rounded {
            Skin::new(template, (round_mm / placed.radius).min(FRAC_PI_3))
        } else {
            sharp = Convex { rounding: 0.0, ..template.clone() };
            Skin::new(&sharp, PI)
        };
        let mut patches = Patches {
            angular: self,
            cores: skin.points.iter().map(|point| placed.vertices[point.vertex as usize]).collect(),
            normals: skin.points.iter().map(|point| (placed.rotation * point.normal).into()).collect(),
            parts: Vec::new(),
            radius: if is_rounded { placed.radius * (1.0 - ROUNDING) } else { 0.0 },
            faces: template.faces.len() as u32,
            round_mm,
            coarse: STEPS[0],
            is_last: false,
            flat: FLATNESS * size,
        };
        let straight_mm = if is_rounded { round_mm } else { self.edge_mm };
        let triangles = patches.divided(&skin.polygons, straight_mm, template.edges.len() as u32);
        let points = (0..patches.cores.len()).map(|p| patches.at(p)).collect();
        let mut surface = Surface::new(points, triangles);
        surface.flip(&patches);
        for coarse in STEPS {
            patches.coarse = coarse;
            if !surface.refine(&mut patches, most_triangles) {
                return None;
            }
            for _ in 0..SMOOTHINGS {
                patches.smooth(&mut surface);
                surface.flip(&patches);
            }
        }
        let full = if is_rounded {
            patches.is_last = true;
            surface.flip(&patches);
            patches.fill(&mut surface)
        } else if placed.radius > 0.0 {
            self.enlarge(&mut surface, placed)
        } else {
            true
        };
        Some((surface, full))
    }

    /// How far a point may move along a unit vector.
    fn room(&self, p: Vector, along: Vector) -> f64 {
        let room = |(toward, most, other): &(Vector, f64, Other<'_>)| {
            let slope = dot(along, *toward);
            match other {
                // Half of what is left at the point itself.
                Other::Lateral { .. } => other.gap_mm(p) / 2.0,
                _ if slope > 0.0 => (most - dot(p, *toward)) / slope,
                _ => f64::INFINITY,
            }
        };
        self.obstacles.iter().map(room).fold(self.most_mm, f64::min).max(0.0)
    }

    /// Enlarges a core whose rounding is not meshed about its centre: until its farthest vertex lies on the body, or
    /// until it has the volume asked for.
    fn enlarge(&self, surface: &mut Surface, placed: &Placed) -> bool {
        let farthest = placed.vertices.iter().map(|vertex| norm(*vertex)).fold(0.0, f64::max);
        let inscribed = 1.0 + placed.radius / farthest * (1.0 - ROUNDING);
        let mut factor = inscribed;
        let mut full = true;
        if let Some(target) = self.target_mm3 {
            let room = |vertex: &Vector| {
                let length = norm(*vertex);
                self.room(scaled(*vertex, inscribed), scaled(*vertex, 1.0 / length)) / length
            };
            let most = inscribed + placed.vertices.iter().map(room).fold(f64::INFINITY, f64::min);
            let wanted = (target / surface.volume_mm3()).cbrt();
            full = wanted <= most;
            factor = wanted.min(most);
        }
        surface.points.iter_mut().for_each(|p| *p = scaled(*p, factor));
        full
    }
}

/// The parts of a surface while it is divided.
struct Patches<'a> {
    angular: &'a Angular<'a>,
    /// For each vertex a point of the core, and the unit normal along which it is moved by the radius.
    cores: Vec<Vector>,
    normals: Vec<Vector>,
    /// The parts of the surface that each vertex lies on: faces, then edges, then vertices.
    parts: Vec<Vec<u32>>,
    radius: f64,
    /// Number of parts that are faces.
    faces: u32,
    /// Length of edges on the others.
    round_mm: f64,
    coarse: f64,
    /// Whether edges between parts and on rounded parts are flipped too, which ends the division.
    is_last: bool,
    /// How high a vertex may lie above a plane that it counts as part of.
    flat: f64,
}

impl Patches<'_> {
    fn at(&self, p: usize) -> Vector {
        if self.radius > 0.0 {
            sum(self.cores[p], scaled(self.normals[p], self.radius))
        } else {
            self.cores[p]
        }
    }

    /// The triangles to begin with: straight edges are divided evenly, and faces are triangulated as Delaunay's
    /// triangulation of their boundary.
    fn divided(&mut self, polygons: &[(u32, Vec<u32>)], straight_mm: f64, edges: u32) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        let mut parts: Vec<(u32, [u32; 3])> = Vec::new();
        let mut chains = HashMap::new();
        let is_strip = |part: u32| part >= self.faces && part < self.faces + edges;
        let divided: Vec<[u32; 2]> = polygons
            .iter()
            .flat_map(|(part, corners)| match corners[..] {
                _ if *part < self.faces => directed_edges(corners).collect(),
                [a, b, c, d] if is_strip(*part) => vec![[a, d], [b, c]],
                _ => Vec::new(),
            })
            .collect();
        for [from, to] in divided {
            self.divide(from, to, straight_mm, &mut chains);
        }
        let side = |[from, to]: [u32; 2]| -> Vec<u32> {
            match chains.get(&[from.min(to), from.max(to)]) {
                None => vec![from, to],
                Some(chain) if from < to => chain.clone(),
                Some(chain) => chain.iter().rev().copied().collect(),
            }
        };
        for (part, corners) in polygons {
            let first = triangles.len();
            let sides: Vec<Vec<u32>> = directed_edges(corners).map(side).collect();
            match &sides[..] {
                // A strip: from the first arc to the second.
                [low, right, high, left]
                    if *part >= self.faces && low.len() + high.len() == 4 && left.len() == right.len() =>
                {
                    for (a, b) in left.windows(2).rev().zip(right.windows(2)) {
                        triangles.extend([[a[1], b[0], b[1]], [a[1], b[1], a[0]]]);
                    }
                }
                sides => {
                    let boundary: Vec<u32> =
                        sides.iter().flat_map(|side| side[..side.len() - 1].iter().copied()).collect();
                    self.triangulate(&boundary, &mut triangles);
                }
            }
            parts.extend(triangles[first..].iter().map(|corners| (*part, *corners)));
        }
        self.parts = vec![Vec::new(); self.cores.len()];
        for (part, corners) in parts {
            for corner in corners {
                self.parts[corner as usize].push(part);
            }
        }
        self.parts.iter_mut().for_each(|parts| {
            parts.sort_unstable();
            parts.dedup();
        });
        triangles
    }

    /// Divides a straight edge evenly, once.
    fn divide(&mut self, from: u32, to: u32, length_mm: f64, chains: &mut HashMap<[u32; 2], Vec<u32>>) {
        let key = [from.min(to), from.max(to)];
        chains.entry(key).or_insert_with(|| {
            let [p, q] = key.map(|p| self.cores[p as usize]);
            let [m, n] = key.map(|p| self.normals[p as usize]);
            let count = (distance2(p, q).sqrt() / length_mm).round().max(1.0);
            let mut chain = vec![key[0]];
            for k in 1..count as u32 {
                let share = f64::from(k) / count;
                let between = |p: Vector, q: Vector| sum(p, scaled(minus(q, p), share));
                let normal = between(m, n);
                self.cores.push(between(p, q));
                self.normals.push(if self.radius > 0.0 {
                    scaled(normal, 1.0 / norm(normal))
                } else {
                    normal
                });
                chain.push(self.cores.len() as u32 - 1);
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
            let at = |k: usize| self.at(corners[k] as usize);
            let (p, q) = (at(0), at(n - 1));
            let angle = |k: usize| {
                let (u, v) = (minus(p, at(k)), minus(q, at(k)));
                let normal = cross(u, v);
                let area = dot(normal, normal).sqrt();
                // Corners on the line of the edge make no triangle.
                let height = area / norm(minus(q, p));
                if height > self.flat { area.atan2(dot(u, v)) } else { -1.0 }
            };
            let apex = (1..n - 1).max_by(|&i, &j| angle(i).total_cmp(&angle(j))).unwrap_or(1);
            triangles.push([corners[0], corners[apex], corners[n - 1]]);
            open.push(corners[..=apex].to_vec());
            open.push(corners[apex..].to_vec());
        }
    }

    /// A part that all these vertices lie on.
    fn common_part(&self, vertices: &[u32]) -> Option<u32> {
        let mut common = self.parts[vertices[0] as usize].iter().copied();
        common.find(|part| vertices[1..].iter().all(|&p| self.parts[p as usize].contains(part)))
    }

    /// Moves vertices inside of faces to the middle of their neighbours, where no triangle turns over by that.
    fn smooth(&mut self, surface: &mut Surface) {
        let mut around: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
        for &[a, b, c] in &surface.triangles {
            for [own, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
                if let [face] = self.parts[own as usize][..]
                    && face < self.faces
                {
                    around.entry(own).or_default().push([p, q]);
                }
            }
        }
        let mut inside: Vec<(u32, Vec<[u32; 2]>)> = around.into_iter().collect();
        inside.sort_unstable();
        for (own, edges) in inside {
            let at = |p: u32| surface.points[p as usize];
            let total = edges.iter().fold([0.0; 3], |total, [p, _]| sum(total, at(*p)));
            let (old, new) = (at(own), scaled(total, 1.0 / edges.len() as f64));
            let normal = |center: Vector, [p, q]: [u32; 2]| cross(minus(at(p), center), minus(at(q), center));
            let keeps = edges.iter().all(|&edge| {
                let (before, after) = (normal(old, edge), normal(new, edge));
                dot(before, after) > 0.05 * dot(before, before)
            });
            if keeps {
                let p = own as usize;
                // The face is plane but for rounding, so that the normal stays.
                self.cores[p] = sum(self.cores[p], minus(new, old));
                surface.points[p] = self.at(p);
            }
        }
    }

    /// Moves all vertices along their normals until the surface has the volume asked for, where there is room.
    fn fill(&self, surface: &mut Surface) -> bool {
        let Some(target) = self.angular.target_mm3 else { return true };
        let rooms =
            surface.points.iter().zip(&self.normals).map(|(p, normal)| self.angular.room(*p, *normal));
        let farthest = rooms.fold(f64::INFINITY, f64::min);
        let mut miss = |step: f64| {
            for ((p, core), normal) in surface.points.iter_mut().zip(&self.cores).zip(&self.normals) {
                *p = sum(*core, scaled(*normal, self.radius + step));
            }
            surface.volume_mm3() / target - 1.0
        };
        let (mut low, mut high) = ((0.0, miss(0.0)), (farthest, miss(farthest)));
        if high.1 <= VOLUME_TOLERANCE {
            return high.1 >= -VOLUME_TOLERANCE;
        }
        for turn in 0..MOST_STEPS {
            let share = if turn % 4 == 3 { 0.5 } else { low.1 / (low.1 - high.1) };
            let step = low.0 + share * (high.0 - low.0);
            let found = (step, miss(step));
            if found.1.abs() <= VOLUME_TOLERANCE {
                break;
            }
            if found.1 < 0.0 { low = found } else { high = found }
        }
        true
    }
}

impl Shape for Patches<'_> {
    fn between(&mut self, a: u32, b: u32, _: &[[f64; 3]]) -> [f64; 3] {
        let (p, q) = (a as usize, b as usize);
        self.cores.push(scaled(sum(self.cores[p], self.cores[q]), 0.5));
        let normal = sum(self.normals[p], self.normals[q]);
        self.normals.push(if self.radius > 0.0 { scaled(normal, 1.0 / norm(normal)) } else { [0.0; 3] });
        let common = self.parts[p].iter().copied().filter(|part| self.parts[q].contains(part)).collect();
        self.parts.push(common);
        self.at(self.cores.len() - 1)
    }

    fn length_mm(&self, centroid: [f64; 3], longest_mm: f64) -> f64 {
        let facing = &self.angular.facing;
        self.coarse
            * facing.iter().map(|facing| facing.length_mm(centroid, longest_mm)).fold(f64::INFINITY, f64::min)
    }

    fn most_mm(&self, corners: [u32; 3]) -> f64 {
        let edge_mm = self.angular.edge_mm;
        self.coarse
            * if self.common_part(&corners).is_some_and(|part| part < self.faces) {
                edge_mm
            } else {
                self.round_mm
            }
    }

    /// Within a plane part: whether the angles opposite to ab make more than half a turn. Elsewhere, at the end:
    /// whether
    /// the surface is dented along ab, and the triangles beside cd would turn outwards and be no worse.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[[f64; 3]]) -> bool {
        let [a_at, b_at, c_at, d_at] = [a, b, c, d].map(|p| points[p as usize]);
        let common = self.common_part(&[a, b, c, d]);
        let normal = cross(minus(b_at, a_at), minus(c_at, a_at));
        let length = norm(normal);
        let above = dot(normal, minus(d_at, a_at));
        let tolerance = self.flat * length;
        if common.is_some_and(|part| part < self.faces) || (common.is_some() && above.abs() <= tolerance) {
            let angle = |own: Vector| {
                let (p, q) = (minus(a_at, own), minus(b_at, own));
                norm(cross(p, q)).atan2(dot(p, q))
            };
            return angle(c_at) + angle(d_at) > PI + 1e-9;
        }
        if !self.is_last || above <= tolerance {
            return false;
        }
        let outward = sum(normal, cross(minus(a_at, b_at), minus(d_at, b_at)));
        let before = quality([a_at, b_at, c_at], outward).min(quality([b_at, a_at, d_at], outward));
        let after = quality([a_at, d_at, c_at], outward).min(quality([d_at, b_at, c_at], outward));
        after > before.min(LEAST_QUALITY)
    }
}

/// Area over the sum of the squares of the edges, 0.144 of an equilateral triangle; negative where it does not turn
/// outwards.
fn quality([a, b, c]: [Vector; 3], outward: Vector) -> f64 {
    let normal = cross(minus(b, a), minus(c, a));
    let area = norm(normal) / 2.0;
    let squares = distance2(a, b) + distance2(b, c) + distance2(c, a);
    if dot(normal, outward) > 0.0 { area / squares } else { -1.0 }
}
