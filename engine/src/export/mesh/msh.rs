//! Gmsh's MSH 4.1: the surfaces of a packing as discrete entities, and the volumes that they bound.
//!
//! The file has the topology that Gmsh needs to fill it: points, curves and surfaces of the specimen, a
//! closed surface and a volume for each grain, and the matrix, bounded by all of them. MSH cannot request
//! meshing; the companion that [`script`] makes does. Volume 1 is the matrix, volume `2 + id` a grain. The file is
//! binary, because that is read several times faster, and to the last bit.

use std::io::Write;

use super::outline::Outline;
use super::{GRAINS_PER_LOOK, Mesh};
use super::{SurfaceOptions, SurfaceReport};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;

/// Tags of the physical groups; those of the faces of the specimen follow.
const MATRIX: i32 = 1;
const AGGREGATES: i32 = 2;
const ITZ: i32 = 3;
const FIRST_FACE: i32 = 4;
/// Element types of the format.
const LINE: i32 = 1;
const TRIANGLE: i32 = 2;

/// Writes the file.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    model: &Model<'_>,
    options: &SurfaceOptions,
    limits: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<SurfaceReport, ExportError> {
    let (mesh, report) = Mesh::new(model, options, limits, control)?;
    write_mesh(&mesh, &AggregateGroups::of(model), control, out)?;
    Ok(report)
}

/// Writes surfaces.
pub(super) fn write_mesh(
    mesh: &Mesh,
    groups: &AggregateGroups<'_>,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let outline = Outline::new(&mesh.shell);
    let out = std::io::BufWriter::with_capacity(1 << 16, out);
    let mut file = File { out, mesh, outline: &outline, groups };
    file.format()?;
    file.physical_names()?;
    file.entities()?;
    let node_of = file.nodes(control)?;
    file.elements(&node_of, control)?;
    file.out.flush()?;
    Ok(())
}

/// A Gmsh script of five lines beside a file of that name: opened in its stead, the volumes are ready to be
/// filled.
///
/// The third line chooses HXT, Gmsh's parallel Delaunay mesher (Marot, Pellerin and Remacle 2019, DOI
/// 10.1002/nme.5987), in place of the default: it leaves no flat tetrahedra in ellipsoids, and takes a third of the
/// time (`docs/meshes.md`).
///
/// The last two lines are for files for Abaqus (`-o model.inp`): elements of volumes alone with a set for each group,
/// and a set of nodes for each group of surfaces. Gmsh 4.15 knows them, 4.8 does not.
///
/// Gmsh leaves alone what it finds wholly discrete, volumes included, and nothing within an MSH file can tell
/// it otherwise.
pub fn script(file_name: &str) -> String {
    // Gmsh knows no escapes within either kind of quotes.
    let quote = if file_name.contains('"') { '\'' } else { '"' };
    format!(
        "Merge {quote}{file_name}{quote};\nCreateGeometry {{ Volume{{:}}; }}\nMesh.Algorithm3D = 10;\n\
         Mesh.SaveGroupsOfElements = -1000;\nMesh.SaveGroupsOfNodes = -100;\n"
    )
}

struct File<'a, W: Write> {
    out: W,
    mesh: &'a Mesh,
    outline: &'a Outline,
    groups: &'a AggregateGroups<'a>,
}

impl<W: Write> File<'_, W> {
    /// Tag of the physical group of the specimen's edges: every element has a group, or meshio refuses the file.
    fn edges_tag(&self) -> i32 {
        FIRST_FACE + self.mesh.shell.names.len() as i32
    }

    /// Tag of the physical group of a grain's volume. Several aggregates have a group each in place of the common one:
    /// every element has one material.
    fn grain_tag(&self, row: usize) -> i32 {
        if self.groups.is_empty() { AGGREGATES } else { self.aggregate_tag(self.groups.of_grain(row)) }
    }

    /// Tag of the physical group of one of several aggregates.
    fn aggregate_tag(&self, aggregate: usize) -> i32 {
        self.edges_tag() + 1 + aggregate as i32
    }

    fn format(&mut self) -> Result<(), ExportError> {
        self.out.write_all(b"$MeshFormat\n4.1 1 8\n")?;
        self.ints(&[1])?;
        self.out.write_all(b"\n$EndMeshFormat\n")?;
        Ok(())
    }

    fn physical_names(&mut self) -> Result<(), ExportError> {
        let names = self.mesh.shell.names;
        let aggregates: Vec<(i32, &str)> = if self.groups.is_empty() {
            vec![(AGGREGATES, "aggregates")]
        } else {
            self.groups.with_grains().map(|(number, name)| (self.aggregate_tag(number), name)).collect()
        };
        let count = 3 + names.len() + aggregates.len();
        write!(self.out, "$PhysicalNames\n{count}\n1 {} \"edges\"\n", self.edges_tag())?;
        for (tag, name) in (FIRST_FACE..).zip(names) {
            writeln!(self.out, "2 {tag} \"{name}\"")?;
        }
        write!(self.out, "2 {ITZ} \"itz\"\n3 {MATRIX} \"matrix\"\n")?;
        for (tag, name) in aggregates {
            writeln!(self.out, "3 {tag} \"{name}\"")?;
        }
        self.out.write_all(b"$EndPhysicalNames\n")?;
        Ok(())
    }

    fn entities(&mut self) -> Result<(), ExportError> {
        let (outline, mesh) = (self.outline, self.mesh);
        let faces = mesh.shell.names.len();
        let grains = mesh.grains();
        self.out.write_all(b"$Entities\n")?;
        self.sizes(&[outline.corners.len(), outline.curves.len(), faces + grains, 1 + grains])?;
        let point = |vertex: &u32| mesh.shell.surface.points[*vertex as usize];
        for (tag, vertex) in (1..).zip(&outline.corners) {
            self.ints(&[tag])?;
            self.doubles(&[point(vertex)])?;
            self.sizes(&[0])?;
        }
        for (tag, curve) in (1..).zip(&outline.curves) {
            let ends = [curve.chain[0], curve.chain[curve.chain.len() - 1]];
            let corner = ends.each(|end| 1 + outline.corners.partition_point(|c| *c < end) as i32);
            let bounds = bounds(curve.chain.iter().map(point));
            self.entity(tag, &bounds, &[self.edges_tag()], &[corner[0], -corner[1]])?;
        }
        for face in 0..faces {
            let boundary: Vec<i32> = (1..)
                .zip(&outline.curves)
                .flat_map(|(tag, curve)| {
                    curve
                        .forward
                        .iter()
                        .filter(|(of, _)| *of == face)
                        .map(move |(_, with)| if *with { tag } else { -tag })
                })
                .collect();
            let on = |bits: u8| bits >> face & 1 == 1;
            let vertices =
                mesh.shell.faces_of.iter().zip(&mesh.shell.surface.points).filter(|(bits, _)| on(**bits));
            self.entity(
                face as i32 + 1,
                &bounds(vertices.map(|(_, p)| *p)),
                &[FIRST_FACE + face as i32],
                &boundary,
            )?;
        }
        let first = faces as i32 + 1;
        for row in 0..grains {
            let (points, _) = mesh.grain(row);
            self.entity(first + row as i32, &bounds(points.iter().copied()), &[ITZ], &[])?;
        }
        let around = (1..=faces as i32).chain((first..).take(grains).map(|tag| -tag)).collect::<Vec<_>>();
        let corners = bounds(mesh.shell.surface.points.iter().copied());
        self.entity(1, &corners, &[MATRIX], &around)?;
        for row in 0..grains {
            let (points, _) = mesh.grain(row);
            let tag = row as i32;
            let physical = [self.grain_tag(row)];
            self.entity(2 + tag, &bounds(points.iter().copied()), &physical, &[first + tag])?;
        }
        self.out.write_all(b"\n$EndEntities\n")?;
        Ok(())
    }

    fn entity(
        &mut self,
        tag: i32,
        bounds: &[[f64; 3]; 2],
        physical: &[i32],
        boundary: &[i32],
    ) -> Result<(), ExportError> {
        self.ints(&[tag])?;
        self.doubles(bounds)?;
        self.sizes(&[physical.len()])?;
        self.ints(physical)?;
        self.sizes(&[boundary.len()])?;
        self.ints(boundary)
    }

    /// Writes the nodes; returns the tags of those of the shell.
    fn nodes(&mut self, control: &dyn Control) -> Result<Vec<u64>, ExportError> {
        let (outline, mesh) = (self.outline, self.mesh);
        let shell = &mesh.shell.surface.points;
        let mut node_of = vec![0; shell.len()];
        let total = shell.len() + mesh.grain_points().len();
        let blocks = outline.corners.len() + outline.curves.len() + outline.within.len() + mesh.grains();
        self.out.write_all(b"$Nodes\n")?;
        self.sizes(&[blocks, total, 1, total])?;
        let mut next = 1;
        let corners = outline.corners.iter().map(std::slice::from_ref);
        let inner = outline.curves.iter().map(|curve| &curve.chain[1..curve.chain.len() - 1]);
        let within = outline.within.iter().map(Vec::as_slice);
        let mut parts: Vec<(i32, i32, &[u32])> = Vec::new();
        parts.extend((1..).zip(corners).map(|(tag, vertices)| (0, tag, vertices)));
        parts.extend((1..).zip(inner).map(|(tag, vertices)| (1, tag, vertices)));
        parts.extend((1..).zip(within).map(|(tag, vertices)| (2, tag, vertices)));
        for (dimension, tag, vertices) in parts {
            let points: Vec<[f64; 3]> = vertices.iter().map(|&v| shell[v as usize]).collect();
            for (tag, &vertex) in (next..).zip(vertices) {
                node_of[vertex as usize] = tag;
            }
            self.node_block(dimension, tag, &mut next, &points)?;
        }
        for row in 0..mesh.grains() {
            if row % GRAINS_PER_LOOK == 0 {
                go_on(control)?;
            }
            let tag = (mesh.shell.names.len() + 1 + row) as i32;
            self.node_block(2, tag, &mut next, mesh.grain(row).0)?;
        }
        self.out.write_all(b"\n$EndNodes\n")?;
        Ok(node_of)
    }

    fn node_block(
        &mut self,
        dimension: i32,
        tag: i32,
        next: &mut u64,
        points: &[[f64; 3]],
    ) -> Result<(), ExportError> {
        self.ints(&[dimension, tag, 0])?;
        self.sizes(&[points.len()])?;
        for _ in points {
            self.out.write_all(&next.to_le_bytes())?;
            *next += 1;
        }
        self.doubles(points)
    }

    fn elements(&mut self, node_of: &[u64], control: &dyn Control) -> Result<(), ExportError> {
        let (outline, mesh) = (self.outline, self.mesh);
        let lines: usize = outline.curves.iter().map(|curve| curve.chain.len() - 1).sum();
        let total = lines + mesh.shell.surface.triangles.len() + mesh.grain_triangles();
        let faces = mesh.shell.names.len();
        self.out.write_all(b"$Elements\n")?;
        self.sizes(&[outline.curves.len() + faces + mesh.grains(), total, 1, total])?;
        let mut next = 1;
        for (tag, curve) in (1..).zip(&outline.curves) {
            let lines = curve.chain.windows(2).map(|ends| [0, 1].each(|i| node_of[ends[i] as usize]));
            self.element_block([1, tag, LINE], curve.chain.len() - 1, &mut next, lines)?;
        }
        let mut of_face = vec![Vec::new(); faces];
        for corners in &mesh.shell.surface.triangles {
            of_face[mesh.shell.face_of(*corners)].push(corners.each(|p| node_of[p as usize]));
        }
        for (tag, triangles) in (1..).zip(of_face) {
            self.element_block([2, tag, TRIANGLE], triangles.len(), &mut next, triangles.into_iter())?;
        }
        let mut first = mesh.shell.surface.points.len() as u64 + 1;
        for row in 0..mesh.grains() {
            if row % GRAINS_PER_LOOK == 0 {
                go_on(control)?;
            }
            let (points, triangles) = mesh.grain(row);
            let tag = (faces + 1 + row) as i32;
            let corners = triangles.iter().map(|corners| corners.each(|p| first + u64::from(p)));
            self.element_block([2, tag, TRIANGLE], triangles.len(), &mut next, corners)?;
            first += points.len() as u64;
        }
        self.out.write_all(b"\n$EndElements\n")?;
        super::report_progress(control, mesh.grains(), mesh.grains());
        Ok(())
    }

    fn element_block<const N: usize>(
        &mut self,
        head: [i32; 3],
        count: usize,
        next: &mut u64,
        elements: impl Iterator<Item = [u64; N]>,
    ) -> Result<(), ExportError> {
        self.ints(&head)?;
        self.sizes(&[count])?;
        for nodes in elements {
            self.out.write_all(&next.to_le_bytes())?;
            for node in nodes {
                self.out.write_all(&node.to_le_bytes())?;
            }
            *next += 1;
        }
        Ok(())
    }

    fn ints(&mut self, values: &[i32]) -> Result<(), ExportError> {
        values.iter().try_for_each(|x| self.out.write_all(&x.to_le_bytes())).map_err(ExportError::Write)
    }

    fn sizes(&mut self, values: &[usize]) -> Result<(), ExportError> {
        values
            .iter()
            .try_for_each(|x| self.out.write_all(&(*x as u64).to_le_bytes()))
            .map_err(ExportError::Write)
    }

    fn doubles(&mut self, points: &[[f64; 3]]) -> Result<(), ExportError> {
        for x in points.iter().flatten() {
            self.out.write_all(&x.to_le_bytes())?;
        }
        Ok(())
    }
}

/// Lowest and highest corner of a box around points.
fn bounds(points: impl Iterator<Item = [f64; 3]>) -> [[f64; 3]; 2] {
    points.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], p| {
        [[0, 1, 2].each(|a| p[a].min(low[a])), [0, 1, 2].each(|a| p[a].max(high[a]))]
    })
}
