//! Voxels as a solid mesh: one hexahedron for each voxel inside the specimen, as keywords for Abaqus have them, with
//! nodes that are counted without gaps.

use nalgebra::Vector3;

use super::inp::{FACES, Lattice};
use super::layers::Bodies;
use super::pass::{LayerSteps, Work};
use super::{Label, VoxelGrid, VoxelOptions};
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::solid::{ElementKind, ElementSide, PhaseRole, PhaseSet, SolidMesh, SpecimenFace};
use crate::export::{ExportError, Model, go_on};
use crate::grain::PlacedGrains;
use crate::memory::{filled, reserved};
use crate::plan::Limits;
use crate::request::{FieldError, Specimen};

const NONE: u32 = u32::MAX;
/// Memory of a voxel: its label, its nodes and those of the lattice, its phase and grain.
const BYTES_PER_VOXEL: u64 = 4 + 8 * 4 + 24 + 4 + 2 + 4 + 4;
/// Nodes in two grains, or in a grain and the matrix.
const ON_INTERFACE: u32 = u32::MAX - 1;

/// Nodes and elements of the mesh, those outside of a cylinder included.
pub(in crate::export) fn hexahedra(specimen: &Specimen, options: &VoxelOptions) -> (u64, u64) {
    let grid = VoxelGrid::new(specimen, options);
    let nodes = grid.shape.iter().fold(1, |product: u64, n| product.saturating_mul(*n as u64 + 1));
    (nodes, grid.voxels())
}

/// The hexahedra of a packing. A phase has a set even where no voxel lies in it.
///
/// # Errors
/// Those of [`check`](super::check), [`ExportError::TooLarge`] for the memory, and [`ExportError::Stopped`].
pub(in crate::export) fn solid_mesh(
    model: &Model<'_>,
    options: &VoxelOptions,
    limits: &Limits,
    control: &dyn Control,
) -> Result<SolidMesh, ExportError> {
    let grid = VoxelGrid::new(model.specimen, options);
    options.check_grid(&grid, limits)?;
    let bytes = grid.voxels().saturating_mul(BYTES_PER_VOXEL);
    if bytes > limits.max_memory_bytes {
        let pointer = if options.voxel_mm.is_some() { "/voxel_mm" } else { "/cells" };
        let detail = format!(
            "{} hexahedra take {} MB of memory: at most {} MB may be used",
            grid.voxels(),
            bytes.div_ceil(1_000_000),
            limits.max_memory_bytes / 1_000_000
        );
        return Err(ExportError::TooLarge(FieldError::new(pointer, detail)));
    }
    let placed = PlacedGrains::new(model.grains)?;
    let groups = AggregateGroups::of(model);
    let work = Work {
        bodies: Bodies::new(model, &placed, &grid)?,
        groups: &groups,
        threads: limits.export_threads,
        control,
        layers_done: LayerSteps::new(control, grid.shape[2]),
    };
    let mut labels = reserved(grid.voxels() as usize * Label::Grain.bytes() as usize)?;
    work.labels(Label::Grain, &mut labels)?;
    let (labels, _) = labels.as_chunks::<4>();
    let mut mesh = of_labels(&grid, |voxel| u32::from_le_bytes(labels[voxel]), control)?;
    mesh.phases = phases(model, &groups);
    for (phase, grain) in mesh.phase_of.iter_mut().zip(&mesh.grain_of) {
        let aggregate =
            |grain: u32| groups.with_grains().position(|(at, _)| at == groups.of_grain(grain as usize));
        *phase = grain.checked_sub(1).map_or(0, |grain| 1 + aggregate(grain).unwrap_or_default() as u16);
    }
    Ok(mesh)
}

/// The matrix, and each aggregate that has grains.
fn phases(model: &Model<'_>, groups: &AggregateGroups<'_>) -> Vec<PhaseSet> {
    let mut phases = vec![PhaseSet { name: "matrix".into(), role: PhaseRole::Matrix }];
    let given = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
    if groups.is_empty() && !model.grains.is_empty() {
        phases.push(PhaseSet { name: "aggregates".into(), role: PhaseRole::Aggregate { name: None } });
    }
    for (number, name) in groups.with_grains() {
        let role = PhaseRole::Aggregate { name: given.get(number).cloned().flatten() };
        phases.push(PhaseSet { name: name.to_owned(), role });
    }
    phases
}

/// A mesh of one phase, of voxels whose grain, counted from 1, or 0 for the matrix, a function gives by the number of
/// the voxel, x fastest.
pub(in crate::export) fn of_labels(
    grid: &VoxelGrid,
    grain: impl Fn(usize) -> u32,
    control: &dyn Control,
) -> Result<SolidMesh, ExportError> {
    let lattice = Lattice { grid };
    let [nx, ny, nz] = grid.shape;
    let kind = ElementKind::Hexahedron8;
    let inside = grid.inside_per_layer() as usize * nz;
    // What each node of the lattice lies in, then its number.
    let mut node_at = filled((nx + 1) * (ny + 1) * (nz + 1), NONE)?;
    let mut element_at = filled(nx * ny * nz, NONE)?;
    let mut elements: Vec<u32> = reserved(inside * kind.nodes())?;
    let mut grain_of = reserved(inside)?;
    for k in 0..nz {
        go_on(control)?;
        for j in 0..ny {
            for i in grid.inside(j) {
                let voxel = lattice.element([i, j, k]) - 1;
                let own = grain(voxel);
                element_at[voxel] = grain_of.len() as u32;
                grain_of.push(own);
                for node in lattice.nodes_of([i, j, k]) {
                    let at = &mut node_at[node - 1];
                    *at = if *at == NONE || *at == own { own } else { ON_INTERFACE };
                    elements.push(node as u32 - 1);
                }
            }
        }
    }
    let mut nodes_mm = reserved(node_at.iter().filter(|at| **at != NONE).count())?;
    let mut grain_surfaces = Vec::new();
    for k in 0..=nz {
        go_on(control)?;
        for j in 0..=ny {
            for i in 0..=nx {
                let at = &mut node_at[lattice.node([i, j, k]) - 1];
                if *at == NONE {
                    continue;
                }
                if *at == ON_INTERFACE {
                    grain_surfaces.push(nodes_mm.len() as u32);
                }
                *at = nodes_mm.len() as u32;
                nodes_mm.push(Vector3::new(grid.corner(0, i), grid.corner(1, j), grid.corner(2, k)));
            }
        }
    }
    for node in &mut elements {
        *node = node_at[*node as usize];
    }
    let mut faces = Vec::new();
    for name in lattice.face_names() {
        let mut sides = Vec::new();
        for (face, (_, side, _)) in
            FACES.iter().enumerate().filter(|(face, _)| lattice.face_name(*face) == *name)
        {
            let side = side.as_bytes()[1] - b'0';
            lattice.for_each_outer(face, &mut |place| {
                sides.push(ElementSide { element: element_at[lattice.element(place) - 1], side });
                Ok(())
            })?;
        }
        let of_side = |side: &ElementSide| {
            let nodes = &elements[8 * side.element as usize..][..8];
            let places = kind.sides().nth(usize::from(side.side) - 1).unwrap_or_default();
            places.iter().map(|place| nodes[*place])
        };
        let mut nodes: Vec<u32> = sides.iter().flat_map(of_side).collect();
        nodes.sort_unstable();
        nodes.dedup();
        faces.push(SpecimenFace { name: (*name).to_owned(), nodes, sides });
    }
    Ok(SolidMesh {
        nodes_mm,
        kind,
        elements,
        phases: vec![PhaseSet { name: "matrix".into(), role: PhaseRole::Matrix }],
        phase_of: filled(inside, 0)?,
        grain_of,
        faces,
        grain_surfaces,
    })
}
