//! Voxel models of a packing: label grids for voxel solvers and image tools, hexahedra for Abaqus.
//!
//! A voxel has the label of what its centre lies in. What that does to the volume fraction is reported beside
//! the exact one. Layers of voxels are made one after the other and written as they come, so that a grid of any
//! size takes the memory of a layer. The module knows spheres and their specimen; it must never know how they
//! were packed.

mod grid;
mod inp;
mod layers;
mod options;
mod share;
mod vti;

use std::cell::Cell;
use std::io::{BufWriter, Write};

use serde::{Deserialize, Serialize};

pub use grid::VoxelGrid;
pub use options::{
    DEFAULT_CELLS, DEFAULT_SAMPLES, Label, MAX_CELLS, MAX_HEXAHEDRA, MAX_SAMPLES, MAX_VOXELS, VoxelFormat,
    VoxelOptions,
};

use self::layers::Layers;
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::solids::Sectioned;
use crate::export::steps::Steps;
use crate::export::{ExportError, Model, go_on};
use crate::memory::filled;
use crate::plan::Limits;
use crate::request::Specimen;

/// What a user wants to know beside the file: where its numbers lie, and what became of the volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = VoxelReport))]
pub struct VoxelReport {
    /// Voxels along x, y, z; x runs fastest.
    pub shape: [u64; 3],
    /// Edges of a voxel, exactly.
    pub spacing_mm: [f64; 3],
    /// Corner of the first voxel.
    pub origin_mm: [f64; 3],
    /// Type of the labels in NumPy's notation: `|u1` or `<u4`; `null` for hexahedra, which have none.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub dtype: Option<String>,
    /// Label of the voxels outside of a cylinder; `null` where there are none or hexahedra, which leave them out.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub outside_label: Option<u32>,
    /// Voxels whose centre lies inside the specimen.
    pub inside_voxels: u64,
    /// Of these those whose centre lies in a grain.
    pub aggregate_voxels: u64,
    /// Grains in which no voxel has its centre: the grid is too coarse for them.
    pub grains_without_voxel: u64,
    /// Volume of the grains over that of the specimen; exact.
    pub volume_fraction: f64,
    /// The same by the labels.
    pub volume_fraction_labels: f64,
    /// The same with the voxels that a surface cuts counted by their share.
    pub volume_fraction_samples: f64,
    /// The aggregates of a mix of several, with `label=aggregate` and for hexahedra.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub aggregates: Vec<AggregateVoxels>,
}

/// The voxels of one of several aggregates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AggregateVoxels {
    /// Its number in the request, counted from 1, which is its label.
    pub label: u32,
    /// Name of its set of elements, as of its group in meshes.
    pub name: String,
    /// Its grains.
    pub grains: u64,
    /// Voxels whose centre lies in one of them.
    pub voxels: u64,
}

/// Judges options before there are grains.
///
/// # Errors
/// [`ExportError::TooLarge`] with what the grid would take.
pub fn check(specimen: &Specimen, options: &VoxelOptions, limits: &Limits) -> Result<(), ExportError> {
    options.check(&VoxelGrid::new(specimen, options), limits)
}

/// Length of the file of a grid.
pub(super) fn expected_bytes(specimen: &Specimen, options: &VoxelOptions) -> u64 {
    options.bytes(&VoxelGrid::new(specimen, options))
}

/// Makes the grid and writes it.
///
/// # Errors
/// Those of [`check`], of the writer, and [`ExportError::Stopped`].
pub fn write(
    model: &Model<'_>,
    options: &VoxelOptions,
    limits: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<VoxelReport, ExportError> {
    let solids = Sectioned::new(model.grains)?;
    let grid = VoxelGrid::new(model.specimen, options);
    options.check(&grid, limits)?;
    let mut out = BufWriter::with_capacity(1 << 18, out);
    let groups = AggregateGroups::of(model);
    let passes = match options.format {
        VoxelFormat::Inp => inp::passes(&groups),
        VoxelFormat::Vti if options.fractions => 2,
        VoxelFormat::Vti | VoxelFormat::Raw => 1,
    };
    let layers_done = LayerSteps::new(control, passes * grid.shape[2]);
    // Where the shares are written they are added up there.
    let sampled_mm3 = if options.fractions {
        None
    } else {
        Some(share::volume_mm3(&solids, &grid, options.samples, control)?)
    };
    let found = match options.format {
        VoxelFormat::Inp => inp::write(model, &grid, &groups, &layers_done, &mut out)?,
        VoxelFormat::Vti => vti::write(model, &grid, options, &layers_done, &mut out)?,
        VoxelFormat::Raw => labels(model, &grid, options.label, &layers_done, &mut out)?,
    };
    out.flush().map_err(ExportError::Write)?;
    let volume_mm3 = model.specimen.volume_mm3();
    let sampled_mm3 = sampled_mm3.unwrap_or(found.sampled_mm3);
    let hexahedra = options.format == VoxelFormat::Inp;
    let cylinder = matches!(model.specimen, Specimen::Cylinder { .. });
    Ok(VoxelReport {
        shape: grid.shape.each(|n| n as u64),
        spacing_mm: grid.spacing_mm,
        origin_mm: [0.0; 3],
        dtype: (!hexahedra).then(|| options.label.dtype().into()),
        outside_label: (cylinder && !hexahedra).then(|| options.label.outside()),
        inside_voxels: found.inside,
        aggregate_voxels: found.aggregate,
        grains_without_voxel: found.grains_without_voxel,
        volume_fraction: share::exact_mm3(&solids) / volume_mm3,
        volume_fraction_labels: found.aggregate as f64 / found.inside as f64,
        volume_fraction_samples: sampled_mm3 / volume_mm3,
        aggregates: found.by_aggregate(&groups),
    })
}

/// What a pass over the grid counted.
#[derive(Clone, Debug, Default, PartialEq)]
struct Found {
    inside: u64,
    aggregate: u64,
    grains_without_voxel: u64,
    /// By the shares, where they were written.
    sampled_mm3: f64,
    /// Of each aggregate, where they were told apart.
    of_aggregates: Vec<u64>,
}

impl Found {
    /// The voxels of each of several aggregates, where they were told apart.
    fn by_aggregate(&self, groups: &AggregateGroups<'_>) -> Vec<AggregateVoxels> {
        let all = (1..).zip(groups.all()).zip(&self.of_aggregates);
        let of = |((label, (name, grains)), voxels): ((u32, (&str, u64)), &u64)| AggregateVoxels {
            label,
            name: name.to_owned(),
            grains,
            voxels: *voxels,
        };
        all.map(of).collect()
    }
}

/// Counts the layers that passes over the grid have done.
struct LayerSteps<'a> {
    steps: Steps<'a>,
    done: Cell<usize>,
}

impl<'a> LayerSteps<'a> {
    fn new(control: &'a dyn Control, layers: usize) -> Self {
        let steps = Steps { control, total: layers, unit: "layers", message: "" };
        Self { steps, done: Cell::new(0) }
    }

    /// Reports one layer more, and asks whether to go on.
    fn next(&self) -> Result<(), ExportError> {
        self.done.set(self.done.get() + 1);
        self.steps.report(self.done.get());
        go_on(self.steps.control)
    }
}

/// Writes the labels, x fastest, little-endian, and nothing else.
fn labels(
    model: &Model<'_>,
    grid: &VoxelGrid,
    label: Label,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    match label {
        // The label is known to fit: a packing has fewer grains than u32 can count.
        Label::Grain => {
            labels_as(model, grid, layers_done, out, |grain| (grain as u32 + 1).to_le_bytes(), [0xff; 4])
        }
        Label::Phase => labels_as(model, grid, layers_done, out, |_| [1], [label.outside() as u8]),
        Label::Aggregate => {
            let groups = AggregateGroups::of(model);
            let mut counted = Counted { out, of: [0; 256] };
            // A mix has at most 16 aggregates.
            let encode = |grain: usize| [groups.of_grain(grain) as u8 + 1];
            let found = labels_as(model, grid, layers_done, &mut counted, encode, [label.outside() as u8])?;
            let of_aggregates = counted.of[1..].iter().take(groups.all().count()).copied().collect();
            Ok(Found { of_aggregates, ..found })
        }
    }
}

/// Counts the bytes of each value that pass.
struct Counted<'a> {
    out: &'a mut dyn Write,
    of: [u64; 256],
}

impl Write for Counted<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.out.write(bytes)?;
        for byte in &bytes[..written] {
            self.of[usize::from(*byte)] += 1;
        }
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

fn labels_as<const BYTES: usize>(
    model: &Model<'_>,
    grid: &VoxelGrid,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
    encode: impl Fn(usize) -> [u8; BYTES],
    outside: [u8; BYTES],
) -> Result<Found, ExportError> {
    const MATRIX: u8 = 0;
    let mut layers = Layers::new(model, grid)?;
    let mut layer = filled(grid.shape[0] * grid.shape[1], [MATRIX; BYTES])?;
    let mut found = Found { inside: grid.inside_per_layer() * grid.shape[2] as u64, ..Found::default() };
    for k in 0..grid.shape[2] {
        layer.fill([MATRIX; BYTES]);
        layers.fill(k, &mut layer, &encode);
        grid.fill_outside(&mut layer, outside);
        let grain = |label: &&[u8; BYTES]| **label != [MATRIX; BYTES] && **label != outside;
        found.aggregate += layer.iter().filter(grain).count() as u64;
        out.write_all(layer.as_flattened())?;
        layers_done.next()?;
    }
    found.grains_without_voxel = layers.grains_without_voxel();
    Ok(found)
}

#[cfg(test)]
mod polyhedron_tests;
#[cfg(test)]
mod tests;
