//! The nodes of a lattice: those laid on the surface of the specimen, then the grains.
//!
//! It knows the surface and the grains; it must never know how nodes are joined.

use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::balls::Balls;
use super::options::{BoundaryNodes, Options};
use super::sample;
use super::surface::Surface;
use crate::control::Control;
use crate::derived::{DerivedError, Model, go_on};
use crate::request::Specimen;
use crate::rng::uniform;

/// Tells the boundary's stream of random numbers from that of a packing with the same seed.
const STREAM: u64 = 0x6c64_706d;
/// Nodes on a face that is full of disks, times the square of their distance over the area: the covering by random
/// sequential addition, 0.547, over the area of a disk of half that distance.
const DISKS_PER_AREA: f64 = 0.70;

/// Nodes in columns: vertices, edges, faces, then grains in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Nodes {
    /// Where they are.
    pub points_mm: Vec<[f64; 3]>,
    /// Their radius in the tessellation.
    pub radii_mm: Vec<f64>,
    /// How many lie on the surface.
    pub boundary: usize,
    /// How many of those are vertices.
    pub on_vertices: usize,
    /// How many of those lie on edges.
    pub on_edges: usize,
    /// Whether every node asked for found a place.
    pub complete: bool,
    /// Diameter of the smallest grain.
    pub d_min_mm: f64,
}

impl Nodes {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.points_mm.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points_mm.is_empty()
    }

    /// Diameter of the grain at a node; 0 on the surface.
    pub fn diameter_mm(&self, node: usize) -> f64 {
        if node < self.boundary { 0.0 } else { 2.0 * self.radii_mm[node] }
    }
}

/// About how many nodes the surface gets.
pub(super) fn expected_on_boundary(specimen: &Specimen, options: &Options, d_min: f64) -> f64 {
    let surface = Surface::of(specimen);
    let distance = options.spacing * d_min;
    let length: f64 = surface.edges.iter().map(super::surface::Edge::length).sum();
    let area: f64 = surface.faces.iter().map(super::surface::Face::area).sum();
    let per_area = match options.boundary_nodes {
        BoundaryNodes::PoissonDisk => DISKS_PER_AREA,
        BoundaryNodes::Random => 1.0,
    };
    surface.vertices.len() as f64 + length / distance + per_area * area / (distance * distance)
}

/// Lays nodes on the surface of a model, and appends its grains.
pub(super) fn lay(
    model: &Model<'_>,
    options: &Options,
    control: &dyn Control,
) -> Result<Nodes, DerivedError> {
    let grains = model.spheres;
    let d_min = grains.d_mm.iter().copied().fold(f64::INFINITY, f64::min);
    let surface = Surface::of(model.specimen);
    let spacing = options.spacing * d_min;
    let clear = options.fictitious_diameter * d_min / 2.0;
    let distance = match options.boundary_nodes {
        BoundaryNodes::PoissonDisk => spacing,
        BoundaryNodes::Random => 2.0 * clear,
    };
    let mut balls = Balls::new(model.specimen.bounds_mm(), distance);
    let mut near_surface = Vec::new();
    for i in 0..grains.len() {
        let (center, radius) = (grains.center(i), grains.d_mm[i] / 2.0);
        // Others cannot keep a node from the surface.
        if model.specimen.clearance_reaching_all(center, [0.0; 3]) < radius + clear {
            near_surface.push((center, radius + clear));
            balls.push(center, radius + clear);
        }
    }
    let mut points = surface.vertices.clone();
    for &vertex in &points {
        balls.push(vertex, distance);
    }
    let on_vertices = points.len();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(options.seed ^ STREAM);
    let mut complete = true;
    for edge in &surface.edges {
        go_on(control)?;
        let before = points.len();
        match options.boundary_nodes {
            BoundaryNodes::PoissonDisk => {
                let earlier = points.iter().map(|&p| (p, distance));
                let start = uniform(&mut rng) * edge.length();
                let along =
                    sample::divide(edge, distance, start, near_surface.iter().copied().chain(earlier));
                points.extend(along.into_iter().map(|along| edge.at(along)));
                for &p in &points[before..] {
                    balls.push(p, distance);
                }
            }
            BoundaryNodes::Random => {
                let count = (edge.length() / spacing) as u64;
                let draw = || Some(edge.at(edge.length() * uniform(&mut rng)));
                complete &= sample::scatter(count, distance, &mut balls, control, &mut points, draw)?;
            }
        }
    }
    let on_edges = points.len() - on_vertices;
    for face in &surface.faces {
        match options.boundary_nodes {
            BoundaryNodes::PoissonDisk => {
                sample::fill(face, distance, &mut balls, &mut rng, control, &mut points)?;
            }
            BoundaryNodes::Random => {
                let count = (face.area() / (spacing * spacing)) as u64;
                let size = face.size();
                let draw = || {
                    let uv = size.map(|side| side * uniform(&mut rng));
                    face.has(uv).then(|| face.at(uv))
                };
                complete &= sample::scatter(count, distance, &mut balls, control, &mut points, draw)?;
            }
        }
    }
    let boundary = points.len();
    let mut radii_mm = vec![options.surface_radius * d_min; boundary];
    points.extend((0..grains.len()).map(|i| grains.center(i)));
    radii_mm.extend(grains.d_mm.iter().map(|d| d / 2.0));
    Ok(Nodes { points_mm: points, radii_mm, boundary, on_vertices, on_edges, complete, d_min_mm: d_min })
}
