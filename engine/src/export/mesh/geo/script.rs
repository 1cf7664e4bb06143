//! The commands that make the solids: numbers of points, lines, surfaces and loops, and how far grains are enlarged.

use std::io::{self, BufWriter, Write};

use super::dilated::Dilated;
use crate::arrays::Each as _;
use crate::domain::Lateral;
use crate::export::mesh::bodies::{Bodies, MeshModel, PlacedPolyhedron};
use crate::export::mesh::grain::{Faced, Grains};
use crate::export::mesh::options::{self, SurfaceOptions, VolumeCorrection};
use crate::export::mesh::size::Other;
use crate::gap::linear::{Vector, scaled, sum};
use crate::geometry::convex::directed_edges;
use crate::memory::OutOfMemory;

/// Share of the gap to a neighbour or a wall that a sphere or an ellipsoid may be enlarged by.
const GAP_SHARE: f64 = options::GAP_SHARE / 2.0;
/// Numbers that the kernel gives to what belongs to a sphere or an ellipsoid, of each kind, at most.
const NUMBERS_OF_CURVED: usize = 8;
/// The same of a specimen.
const NUMBERS_OF_SPECIMEN: usize = 32;

/// Gmsh's number of the algorithm that leaves fewer flat tetrahedra than its default (`docs/meshes.md`).
const HXT: u32 = 10;
/// Gmsh's number of the algorithm that divides a surface by its lengths in space.
const MESH_ADAPT: u32 = 1;
/// Most surfaces that a line names.
const NUMBERS_PER_LINE: usize = 1000;

/// Least number of the points, lines and surfaces of polyhedra, with so many spheres and ellipsoids.
fn first_number(curved: usize) -> usize {
    NUMBERS_OF_SPECIMEN + NUMBERS_OF_CURVED * curved
}

/// A script while it is written: first the specimen, then spheres and ellipsoids, then polyhedra, then the matrix.
pub(super) struct Script<'a, W: Write> {
    pub(super) out: BufWriter<W>,
    model: &'a MeshModel<'a>,
    options: &'a SurfaceOptions,
    grains: Grains<'a>,
    /// Longest edges where grains are not asked to have shorter ones; in the end those of any grain.
    pub(super) longest_mm: f64,
    /// Faces and corners of the specimen, which the kernel has numbered.
    specimen: [usize; 2],
    /// Edges of the spheres and ellipsoids.
    edges_mm: Vec<f64>,
    /// Of these, the numbers from 1 of those that `MeshAdapt` divides.
    mesh_adapt: Vec<usize>,
    /// Least numbers that are free.
    point: usize,
    line: usize,
    surface: usize,
    /// Volume of the grains, and of their polyhedra.
    pub(super) exact_mm3: f64,
    pub(super) meshed_mm3: f64,
    /// Grains without room for their volume.
    pub(super) short: u64,
}

impl<'a, W: Write> Script<'a, W> {
    pub(super) fn new(
        model: &'a MeshModel<'a>,
        options: &'a SurfaceOptions,
        longest_mm: f64,
        out: W,
    ) -> Result<Self, OutOfMemory> {
        let is_curved = |row: &usize| model.bodies.polyhedron(*row).is_none();
        let curved = (0..model.bodies.len()).filter(is_curved).count();
        let first = first_number(curved);
        Ok(Self {
            out: BufWriter::with_capacity(1 << 16, out),
            model,
            options,
            grains: Grains::new(model, options)?,
            longest_mm,
            specimen: [0; 2],
            edges_mm: Vec::new(),
            mesh_adapt: Vec::new(),
            point: first,
            line: first,
            surface: first,
            exact_mm3: 0.0,
            meshed_mm3: 0.0,
            short: 0,
        })
    }

    /// Begins with the specimen, and tells its faces in the order in which the kernel numbers them.
    pub(super) fn specimen(&mut self) -> io::Result<&'static [&'static str]> {
        let grains = self.model.bodies.len();
        writeln!(
            self.out,
            "// {grains} grains. Lengths in mm. Volume 1: matrix, volumes 2 to {}: grains, largest first.",
            grains + 1
        )?;
        writeln!(self.out, "SetFactory(\"OpenCASCADE\");\nholes() = {{}};")?;
        let domain = self.model.specimen.domain();
        let [x, y, z] = domain.bounds_mm;
        let (faces, corners) = match domain.lateral() {
            None => {
                writeln!(self.out, "Box(1) = {{0, 0, 0, {x}, {y}, {z}}};")?;
                (domain.face_names, 8)
            }
            Some(Lateral { center_mm: [x, y], radius_mm: radius }) => {
                writeln!(self.out, "Cylinder(1) = {{{x}, {y}, 0, 0, 0, {z}, {radius}}};")?;
                (["side", "z_max", "z_min"].as_slice(), 2)
            }
        };
        self.specimen = [faces.len(), corners];
        Ok(faces)
    }

    /// A sphere or an ellipsoid: the unit sphere, dilated along its axes to the semi-axes, then turned and moved to its
    /// place.
    pub(super) fn curved(&mut self, row: usize) -> io::Result<()> {
        let bodies: &'a Bodies<'a> = &self.model.bodies;
        let (diameter, [x, y, z]) = (bodies.diameter(row), bodies.center(row));
        let edge_mm = self.longest_mm_of(diameter);
        let tag = row + 2;
        let ellipsoid = bodies.ellipsoid(row);
        let dilated = match ellipsoid {
            Some((shape, ..)) => Dilated::ellipsoid(shape, edge_mm),
            None => Dilated::sphere(diameter / 2.0, edge_mm),
        };
        let factor = self.factor(row, &dilated);
        match ellipsoid.map(|(shape, pose, _)| (shape.semi_axes_mm(), pose)) {
            Some((axes, pose)) if axes.x > axes.z => {
                writeln!(self.out, "Sphere({tag}) = {{0, 0, 0, 1}};")?;
                let rotation = pose.rotation();
                let rows = [x, y, z].into_iter().enumerate().map(|(i, at)| {
                    let [p, q, r] = dilated.order.each(|k| factor * axes[k] * rotation[(i, k)]);
                    format!("{p}, {q}, {r}, {at}")
                });
                let map = rows.collect::<Vec<_>>().join(", ");
                writeln!(self.out, "Affine {{{map}}} {{ Volume{{{tag}}}; }}")?;
            }
            _ => writeln!(self.out, "Sphere({tag}) = {{{x}, {y}, {z}, {}}};", factor * diameter / 2.0)?,
        }
        self.edges_mm.push(dilated.edge_mm(factor));
        if dilated.needs_mesh_adapt {
            self.mesh_adapt.push(self.edges_mm.len());
        }
        self.add_volume(row, bodies.volume_mm3(row) * factor.powi(3) * (1.0 - dilated.lacking()));
        Ok(())
    }

    /// A polyhedron by its corners, edges and faces.
    pub(super) fn polyhedron(&mut self, row: usize, grain: &PlacedPolyhedron<'_>) -> io::Result<()> {
        let edge_mm = self.longest_mm_of(grain.shape.scale_mm);
        let center: Vector = grain.pose.center_mm.into();
        let (_, placed) = self.grains.placed(row, grain);
        let (template, faces) = (&placed.template, &placed.template.facets.faces);
        self.short += u64::from(!placed.is_full);
        let out = &mut self.out;
        for (vertex, point) in placed.vertices.iter().enumerate() {
            let [x, y, z] = sum(center, scaled(*point, placed.factor));
            let size_mm = edge_mm * template.fineness_at(vertex);
            writeln!(out, "Point({}) = {{{x}, {y}, {z}, {size_mm}}};", self.point + vertex)?;
        }
        let edges: Vec<[u32; 2]> =
            faces.iter().flat_map(|corners| directed_edges(corners)).filter(|[p, q]| p < q).collect();
        for (tag, ends) in (self.line..).zip(&edges) {
            let [from, to] = ends.each(|vertex| self.point + vertex as usize);
            writeln!(out, "Line({tag}) = {{{from}, {to}}};")?;
        }
        let mut lines: Vec<([u32; 2], usize)> = edges.iter().copied().zip(self.line..).collect();
        lines.sort_unstable();
        for (tag, corners) in (self.surface..).zip(faces) {
            write!(out, "c = newcl;\nCurve Loop(c) = {{")?;
            for (i, [from, to]) in directed_edges(corners).enumerate() {
                let line = lines.binary_search_by_key(&[from.min(to), from.max(to)], |(ends, _)| *ends);
                let line = line.map_or(0, |at| lines[at].1);
                let (comma, sign) = (if i > 0 { ", " } else { "" }, if from < to { "" } else { "-" });
                write!(out, "{comma}{sign}{line}")?;
            }
            writeln!(out, "}};\nPlane Surface({tag}) = {{c}};")?;
        }
        let next = self.surface + faces.len();
        writeln!(out, "s = newsl;\nSurface Loop(s) = {{{}:{}}};", self.surface, next - 1)?;
        writeln!(out, "Volume({}) = {{s}};\nholes() += {{s}};", row + 2)?;
        self.point += placed.vertices.len();
        self.line += edges.len();
        self.surface = next;
        self.add_volume(row, placed.meshed_mm3());
        Ok(())
    }

    /// The matrix, bounded by the faces of the specimen and of the grains, the lengths of edges, and the surfaces of
    /// the grains as a list.
    pub(super) fn matrix(&mut self) -> io::Result<Option<String>> {
        let ([faces, corners], curved) = (self.specimen, self.edges_mm.len());
        let out = &mut self.out;
        let mut surfaces = Vec::new();
        writeln!(out, "Delete {{ Volume{{1}}; }}")?;
        if curved > 0 {
            writeln!(out, "For i In {{1:{curved}}}")?;
            writeln!(out, "  s = newsl;\n  Surface Loop(s) = {{{faces} + i}};\n  holes() += {{s}};\nEndFor")?;
            surfaces.push(format!("{}:{}", faces + 1, faces + curved));
        }
        writeln!(out, "s = newsl;\nSurface Loop(s) = {{1:{faces}}};\nVolume(1) = {{s, holes()}};")?;
        let first = first_number(curved);
        if self.surface > first {
            surfaces.push(format!("{first}:{}", self.surface - 1));
        }
        for (i, edge_mm) in self.edges_mm.iter().enumerate() {
            let pole = corners + 1 + 2 * i;
            writeln!(out, "MeshSize {{{pole}, {}}} = {edge_mm};", pole + 1)?;
        }
        for numbers in self.mesh_adapt.chunks(NUMBERS_PER_LINE) {
            let tags: Vec<String> = numbers.iter().map(|i| (faces + i).to_string()).collect();
            writeln!(out, "MeshAlgorithm Surface {{{}}} = {MESH_ADAPT};", tags.join(", "))?;
        }
        self.longest_mm = self.edges_mm.iter().copied().fold(self.longest_mm, f64::max);
        writeln!(out, "Mesh.MeshSizeMax = {};\nMesh.Algorithm3D = {HXT};", self.longest_mm)?;
        Ok((!surfaces.is_empty()).then(|| surfaces.join(", ")))
    }

    /// Edges of a grain that are asked for.
    fn longest_mm_of(&self, diameter_mm: f64) -> f64 {
        self.options.edge_mm(diameter_mm).min(self.longest_mm)
    }

    fn add_volume(&mut self, row: usize, meshed_mm3: f64) {
        self.exact_mm3 += self.model.bodies.volume_mm3(row);
        self.meshed_mm3 += meshed_mm3;
    }

    /// By what a sphere or an ellipsoid is enlarged so that its polyhedron has its volume, as far as gaps leave room.
    fn factor(&mut self, row: usize, dilated: &Dilated) -> f64 {
        if self.options.volume_correction == VolumeCorrection::None {
            return 1.0;
        }
        let bodies = &self.model.bodies;
        let (image, radius, outer) = (bodies.image(row), bodies.diameter(row) / 2.0, bodies.outer(row));
        let wanted = dilated.factor() - 1.0;
        let mut room = f64::INFINITY;
        self.grains.for_each_facing(
            row,
            wanted * outer / GAP_SHARE,
            |Faced { other, gap, toward, .. }| {
                // No plane across the shortest way is crossed; the side of a cylinder bends toward the grain.
                let reach = if matches!(other, Other::Lateral { .. }) {
                    outer
                } else {
                    image.support(toward, radius)
                };
                room = room.min(GAP_SHARE * gap.max(0.0) / reach);
            },
        );
        self.short += u64::from(room < wanted * (1.0 - 1e-12));
        1.0 + wanted.min(room)
    }
}
