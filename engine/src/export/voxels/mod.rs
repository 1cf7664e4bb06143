//! Voxel models of a packing: label grids for voxel solvers and image tools, hexahedra for Abaqus.
//!
//! A voxel has the label of what its centre lies in. What that does to the volume fraction is reported beside
//! the exact one. Rows of voxels are made in pieces on several threads and written in their order, so that the bytes do
//! not depend on the threads, and a grid of any size takes the memory of a few pieces; hexahedra keep a byte of each
//! voxel.

mod base64;
mod grid;
mod inp;
mod layers;
mod length;
mod numbers;
mod options;
mod pass;
mod readers;
mod report_check;
mod rows;
mod share;
mod solid;
mod vti;

use std::io::{BufWriter, Write};

use serde::{Deserialize, Serialize};

pub use grid::VoxelGrid;
pub use options::{
    DEFAULT_CELLS, DEFAULT_SAMPLES, Label, MAX_CELLS, MAX_HEXAHEDRA, MAX_SAMPLES, MAX_VOXELS, Reader,
    VoxelFormat, VoxelOptions,
};

pub(super) use self::inp::Interfaces;
#[cfg(test)]
pub(super) use solid::of_labels;
pub(super) use solid::{hexahedra, solid_mesh};

use self::layers::Bodies;
use self::numbers::Numbers;
use self::pass::{LayerSteps, Work};
use self::report_check::check_voxels;
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::estimate::{Expected, ExportEstimate};
use crate::export::groups::AggregateGroups;
use crate::export::kind::{Export, Made};
use crate::export::materials::{self, PhaseMaterial, moduli_gpa};
use crate::export::{ExportError, Model};
use crate::grain::PlacedGrains;
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::request::{Materials, Specimen};

/// Bytes from which on a voxel model is heavy.
const HEAVY_BYTES: u64 = 100_000_000;

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
    /// Type of the labels in NumPy's notation: `|u1`, `<u4` or `<i8`; `null` for hexahedra, which have none.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub dtype: Option<String>,
    /// Label of the matrix: 0, or 1 for programs that count from 1. That of all aggregate is the next one.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub matrix_label: u32,
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

impl Export for VoxelOptions {
    type Report = VoxelReport;

    const NAME: &'static str = "voxels";
    const FORMATS: &'static [&'static str] = &["vti", "raw", "inp", "npy", "vtk", "zip"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    fn name_parts(&self) -> Vec<&'static str> {
        self.reader.iter().map(|reader| reader.name()).collect()
    }

    fn deciding_option(&self) -> (&'static str, &'static str) {
        self.reader.map_or(("format", self.format.name()), |reader| ("for", reader.name()))
    }

    fn programs(format: &str) -> Vec<&'static str> {
        Reader::ALL.into_iter().filter(|reader| reader.format().name() == format).map(Reader::name).collect()
    }

    fn needed_program(format: &str) -> Option<&'static str> {
        let format = VoxelFormat::ALL.into_iter().find(|known| known.name() == format)?;
        format.program().map(Reader::name)
    }

    /// Judges options before there are grains.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`] with what the grid would take, and [`ExportError::Unavailable`] where the
    /// program that the file is for cannot compute such a specimen.
    fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        self.check_specimen(specimen)?;
        self.check_grid(&VoxelGrid::new(specimen, self), limits)
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        let interfaces = Interfaces::of(of.specimen(), of.sizes(), of.has_aggregates());
        Ok(ExportEstimate::of_bytes(expected_bytes(of.specimen(), self, &interfaces)))
    }

    fn is_heavy(&self, specimen: &Specimen) -> bool {
        expected_bytes(specimen, self, &Interfaces::MOST) >= HEAVY_BYTES
    }

    fn needs_materials(&self) -> bool {
        self.reader == Some(Reader::Fans)
    }

    fn materials(&self) -> Option<&Materials> {
        self.materials.as_ref()
    }

    fn materials_mut(&mut self) -> Option<&mut Option<Materials>> {
        Some(&mut self.materials)
    }

    fn check_materials(&self, phases: &[PhaseMaterial<'_>]) -> Result<(), ExportError> {
        moduli_gpa(phases).map(|_| ())
    }

    fn check_report(&self, made: &Made<'_>, report: &VoxelReport) -> Result<(), String> {
        check_voxels(made.specimen, self, made.volume_fraction, report, made.bytes)
    }

    /// Makes the grid and writes it.
    ///
    /// # Errors
    /// Those of [`Export::check`], of the writer, and [`ExportError::Stopped`].
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<VoxelReport, ExportError> {
        let placed = PlacedGrains::new(model.grains)?;
        let grid = VoxelGrid::new(model.specimen, self);
        self.check_specimen(model.specimen)?;
        self.check_grid(&grid, limits)?;
        let mut out = BufWriter::with_capacity(1 << 18, out);
        let groups = AggregateGroups::of(model);
        let layers = match self.format {
            VoxelFormat::Inp => inp::layers(&grid, &groups),
            VoxelFormat::Vti if self.fractions => 2 * grid.shape[2],
            _ => grid.shape[2],
        };
        let work = Work {
            bodies: Bodies::new(model, &placed, &grid)?,
            groups: &groups,
            threads: limits.export_threads,
            control,
            layers_done: LayerSteps::new(control, layers),
        };
        // Where the shares are written they are added up there.
        let sampled_mm3 = if self.fractions { None } else { Some(share::volume_mm3(&work, self.samples)?) };
        let hexahedra = self.format == VoxelFormat::Inp;
        let numbers = if hexahedra {
            Numbers::plain(Label::Aggregate, &groups)
        } else {
            Numbers::new(self, &groups, model.grains.len())
        };
        let found = match (self.format, self.reader) {
            (VoxelFormat::Inp, _) => inp::write(&work, &mut out)?,
            (VoxelFormat::Vti, None) => vti::write(&work, model.provenance, self, &numbers, &mut out)?,
            (VoxelFormat::Vti, Some(_)) => readers::write_damask(&work, &numbers, &mut out)?,
            (VoxelFormat::Raw, _) => work.labels_by(&numbers, &mut out)?,
            (VoxelFormat::Npy, _) => readers::write_npy(&work, &numbers, &mut out)?,
            (VoxelFormat::Vtk, _) => readers::write_amitex(&work, &numbers, &mut out)?,
            (VoxelFormat::Zip, _) => {
                let materials = materials::of_model(self.materials.as_ref(), model)?;
                let names = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
                // Without names they are told apart by their numbers alone.
                let unnamed = vec![None; groups.all().count()];
                let names = if names.is_empty() { &unnamed } else { names };
                let phases = materials::phases(materials, names)?;
                readers::write_fans(&work, &numbers, &phases, &mut out)?
            }
        };
        out.flush().map_err(ExportError::Write)?;
        let volume_mm3 = model.specimen.volume_mm3();
        let sampled_mm3 = sampled_mm3.unwrap_or(found.sampled_mm3);
        let cylinder = model.specimen.domain().lateral().is_some();
        Ok(VoxelReport {
            shape: grid.shape.each(|n| n as u64),
            spacing_mm: grid.spacing_mm,
            origin_mm: [0.0; 3],
            dtype: (!hexahedra).then(|| numbers.dtype().into()),
            matrix_label: numbers.matrix,
            outside_label: (cylinder && !hexahedra).then_some(numbers.outside),
            inside_voxels: found.inside,
            aggregate_voxels: found.aggregate,
            grains_without_voxel: found.grains_without_voxel,
            volume_fraction: share::exact_mm3(&placed) / volume_mm3,
            volume_fraction_labels: found.aggregate as f64 / found.inside as f64,
            volume_fraction_samples: sampled_mm3 / volume_mm3,
            aggregates: found.by_aggregate(&groups, &numbers),
        })
    }
}

/// Length of the file of a grid.
pub(super) fn expected_bytes(specimen: &Specimen, options: &VoxelOptions, grains: &Interfaces) -> u64 {
    options.bytes(&VoxelGrid::new(specimen, options), grains)
}

#[cfg(test)]
mod polyhedron_tests;
#[cfg(test)]
mod readers_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod threads_tests;
