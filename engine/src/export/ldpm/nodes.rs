//! The nodes of a lattice: those laid on the surface of the specimen, then the grains.

use std::sync::Arc;

use nalgebra::Vector3;
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::obstacles::{Obstacle, Obstacles};
use super::options::{BoundaryNodes, LatticeOptions};
use super::sample;
use super::surface::{Edge, Face, LateralSurface, Surface};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::{ExportError, go_on};
use crate::grain::{Grain as _, PlacedGrains};
use crate::memory::{make_room, reserved};
use crate::request::Specimen;
use crate::rng::uniform;

/// Tells the boundary's stream of random numbers from that of a packing with the same seed.
const STREAM: u64 = 0x6c64_706d;
/// Nodes on a face that is full of disks, times the square of their distance over the area: the covering by random
/// sequential addition, 0.547, over the area of a disk of half that distance.
const DISKS_PER_AREA: f64 = 0.70;

/// Nodes in columns: vertices, edges, faces, then grains in their order.
#[derive(Clone, Debug, Default)]
pub struct Nodes<'a> {
    /// Where they are.
    pub points_mm: Vec<[f64; 3]>,
    /// Their radius in the tessellation; of shaped grains that of the sphere of equal volume.
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
    /// The grains, whose surfaces the tessellation takes where they are; without them it takes spheres of the radii.
    pub(super) grains: Option<Arc<PlacedGrains<'a>>>,
}

impl Nodes<'_> {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.points_mm.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points_mm.is_empty()
    }

    /// How far the tessellation takes the body at a node to reach from it along a vector, which must not be zero: the
    /// radius of nodes on the surface and of spheres, else the distance of the grain's surface from its centre.
    pub(super) fn reach_mm(&self, node: usize, along: &Vector3<f64>) -> f64 {
        match (node.checked_sub(self.boundary), &self.grains) {
            (Some(grain), Some(grains)) => grains.grain(grain).reach_mm(along),
            _ => self.radii_mm[node],
        }
    }

    /// Equivalent diameter of the grain at a node; 0 on the surface.
    pub fn diameter_mm(&self, node: usize) -> f64 {
        if node < self.boundary { 0.0 } else { 2.0 * self.radii_mm[node] }
    }
}

/// About how many nodes the surface gets.
pub(super) fn expected_on_boundary(specimen: &Specimen, options: &LatticeOptions, d_min: f64) -> f64 {
    let surface = Surface::of(specimen);
    let distance = options.spacing * d_min;
    let length: f64 = surface.edges.iter().map(|edge| edge.length).sum();
    let lateral = surface.lateral.map_or(0.0, |lateral| lateral.area());
    let area: f64 = surface.faces.iter().map(Face::area).sum();
    let per_area = match options.boundary_nodes {
        BoundaryNodes::PoissonDisk => DISKS_PER_AREA,
        BoundaryNodes::Random => 1.0,
    };
    let on_faces = (per_area * area + lateral) / (distance * distance);
    surface.vertices.len() as f64 + length / distance + on_faces
}

/// Nodes on a surface as they come to lie there.
struct Layer<'a> {
    options: &'a LatticeOptions,
    control: &'a dyn Control,
    /// Distance that `random` nodes have on average.
    spacing: f64,
    /// Distance that all nodes keep.
    distance: f64,
    rng: Xoshiro256PlusPlus,
    grains: &'a PlacedGrains<'a>,
    /// Grains that keep nodes from the surface.
    near_surface: Vec<Obstacle>,
    /// These and the nodes so far.
    obstacles: Obstacles,
    points: Vec<[f64; 3]>,
    complete: bool,
}

impl Layer<'_> {
    fn push(&mut self, points: impl IntoIterator<Item = [f64; 3]>) {
        for p in points {
            self.points.push(p);
            self.obstacles.push(Obstacle::ball(p, self.distance));
        }
    }

    fn is_none(&self) -> bool {
        self.options.boundary_nodes == BoundaryNodes::Random
    }

    /// Takes as many random points as lie in a measure of length or area, `draw`n by the generator.
    fn scatter(
        &mut self,
        count: f64,
        draw: impl Fn(&mut Xoshiro256PlusPlus) -> Option<[f64; 3]>,
    ) -> Result<(), ExportError> {
        let Self { distance, rng, grains, obstacles, control, points, .. } = self;
        self.complete &=
            sample::scatter(count as u64, *distance, grains, obstacles, *control, points, || draw(rng))?;
        Ok(())
    }

    fn lay_edge(&mut self, edge: &Edge) -> Result<(), ExportError> {
        go_on(self.control)?;
        if self.is_none() {
            return self.scatter(edge.length / self.spacing, |rng| Some(edge.at(edge.length * uniform(rng))));
        }
        let earlier = self.points.iter().map(|&p| Obstacle::ball(p, self.distance));
        let taken = self.near_surface.iter().copied().chain(earlier);
        let points = sample::divide(edge, self.distance, self.grains, taken);
        self.push(points);
        Ok(())
    }

    /// End circles, where rulings begin and end.
    fn lay_end_circles(&mut self, rulings: &[Edge]) {
        for end in [0.0, 1.0] {
            let free = |p: &[f64; 3]| !self.near_surface.iter().any(|grain| grain.holds(self.grains, *p));
            let circle: Vec<_> = rulings.iter().map(|g| g.at(end * g.length)).filter(free).collect();
            self.push(circle);
        }
    }

    fn lay_lateral_surface(&mut self, lateral: &LateralSurface, rulings: &[Edge]) -> Result<(), ExportError> {
        if self.is_none() {
            return self.scatter(lateral.area() / (self.spacing * self.spacing), |rng| {
                let ruling = &rulings[(uniform(rng) * rulings.len() as f64) as usize];
                Some(ruling.at(ruling.length * uniform(rng)))
            });
        }
        for (i, ruling) in rulings.iter().enumerate() {
            go_on(self.control)?;
            let ends = [0.0, 1.0].each(|end| ruling.at(end * ruling.length));
            let mut own: Vec<_> = ends.into_iter().filter(|end| self.points.contains(end)).collect();
            // Every other one begins half a step later, which makes better triangles; where grains leave too little
            // for that, what is left is filled.
            for factor in if i % 2 == 0 { &[1.0][..] } else { &[1.5, 1.0] } {
                let earlier = own.iter().map(|&p| Obstacle::ball(p, factor * self.distance));
                let taken = self.near_surface.iter().copied().chain(earlier);
                let points = sample::divide(ruling, self.distance, self.grains, taken);
                own.extend_from_slice(&points);
                self.push(points);
            }
        }
        Ok(())
    }

    fn lay_face(&mut self, face: &Face) -> Result<(), ExportError> {
        if self.is_none() {
            let size = face.size();
            return self.scatter(face.area() / (self.spacing * self.spacing), |rng| {
                let uv = size.each(|side| side * uniform(rng));
                face.has(uv).then(|| face.at(uv))
            });
        }
        let Self { distance, grains, obstacles, rng, control, points, .. } = self;
        sample::fill(face, *distance, grains, obstacles, rng, *control, points)
    }
}

/// Lays nodes on the surface of a specimen, and appends its grains.
pub(super) fn lay<'a>(
    specimen: &Specimen,
    grains: &Arc<PlacedGrains<'a>>,
    options: &LatticeOptions,
    control: &dyn Control,
) -> Result<Nodes<'a>, ExportError> {
    let d_min = grains.d_min_mm();
    let surface = Surface::of(specimen);
    let spacing = options.spacing * d_min;
    let clear = options.fictitious_diameter * d_min / 2.0;
    let distance = match options.boundary_nodes {
        BoundaryNodes::PoissonDisk => spacing,
        BoundaryNodes::Random => 2.0 * clear,
    };
    let mut obstacles = Obstacles::new(specimen.bounds_mm(), distance);
    let mut near_surface = Vec::new();
    for i in 0..grains.len() {
        // Others cannot keep a node from the surface.
        if specimen.clearance_reaching_all(grains.center_mm(i), [0.0; 3])
            < grains.grain(i).outer_radius_mm() + clear
        {
            let obstacle = Obstacle::grain(grains, i, clear);
            near_surface.push(obstacle);
            obstacles.push(obstacle);
        }
    }
    let mut layer = Layer {
        options,
        control,
        spacing,
        distance,
        rng: Xoshiro256PlusPlus::seed_from_u64(options.seed ^ STREAM),
        grains,
        near_surface,
        obstacles,
        points: Vec::new(),
        complete: true,
    };
    layer.push(surface.vertices.iter().copied());
    let on_vertices = layer.points.len();
    for edge in &surface.edges {
        layer.lay_edge(edge)?;
    }
    let turn = uniform(&mut layer.rng);
    let rulings = surface.lateral.map(|lateral| lateral.rulings(spacing, turn)).unwrap_or_default();
    layer.lay_end_circles(&rulings);
    let on_edges = layer.points.len() - on_vertices;
    if let Some(lateral) = &surface.lateral {
        layer.lay_lateral_surface(lateral, &rulings)?;
    }
    for face in &surface.faces {
        layer.lay_face(face)?;
    }
    let Layer { mut points, complete, .. } = layer;
    let boundary = points.len();
    let mut radii_mm = reserved(boundary + grains.len())?;
    radii_mm.resize(boundary, options.surface_radius * d_min);
    make_room(&mut points, grains.len())?;
    points.extend((0..grains.len()).map(|i| grains.center_mm(i)));
    radii_mm.extend((0..grains.len()).map(|i| grains.d_mm(i) / 2.0));
    let (points_mm, grains) = (points, Some(Arc::clone(grains)));
    Ok(Nodes { points_mm, radii_mm, boundary, on_vertices, on_edges, complete, d_min_mm: d_min, grains })
}
