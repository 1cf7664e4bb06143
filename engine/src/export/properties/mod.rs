//! Effective properties of a packing: stiffness, thermal expansion, conductivity, diffusivity, with their bounds.
//!
//! The packing becomes voxels (`voxelize`) whose phases have the materials of the request, and these a periodic cell
//! that the module `homogenization` solves. Half as many voxels along each edge are solved as well: the difference is
//! the error that the voxels make. `docs/properties.md` has the mathematics.

mod cut_ellipsoid;
mod cut_polyhedron;
mod fields;
mod options;
mod phases;
mod report;
mod report_check;
mod state;
mod voxelize;

use std::io::Write;

use nalgebra::{Matrix3, Vector6};

pub use options::{
    CELLS, CutVoxels, DEFAULT_CELLS, DEFAULT_TOLERANCE, LEAST_CELLS, PropertyFormat, PropertyKind,
    PropertyKinds, PropertyOptions, Walls,
};
pub use report::{
    CellKind, ConductionReport, ExpansionReport, PropertyCell, PropertyError, PropertyPhase, PropertyReport,
    StiffnessReport,
};

use self::phases::Phases;
use self::phases::check_materials;
use self::report_check::check_properties;
use self::state::State;
use self::voxelize::{Cuts, Voxelized, voxelize};
use super::estimate::{ComputationEstimate, Expected, ExportEstimate};
use super::kind::{Export, Made};
use super::voxels::VoxelGrid;
use super::{ExportError, Model, materials};
use crate::checkpoint::Resume;
use crate::control::{Control, Part};
use crate::grain::PlacedGrains;
use crate::homogenization::moduli::{
    conduction_bounds, elastic_bounds, expansion, isotropic_conductivity, isotropic_projection,
    universal_anisotropy, youngs_moduli,
};
use crate::homogenization::{
    self, Conduction, Elasticity, HomogenizationError, Settings, SolvedCases, Voxels, conduction, elasticity,
};
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::request::{FieldError, Material, Materials, Specimen};

/// Length of a document with all kinds, and of what a file of fields has beside its voxels.
const DOCUMENT_BYTES: u64 = 9000;
/// CPU time of an iteration of a load case with three components, for a voxel, in s.
const SECONDS_PER_VOXEL: f64 = 45e-9;
/// Iterations to a tolerance of 1e-4 over the root of the contrast of the phases.
const ITERATIONS_PER_ROOT: f64 = 2.3;
/// Iterations to a tolerance of 1e-4 with pores.
const ITERATIONS_WITH_PORES: f64 = 30.0;
/// Share of the time of a grid that its voxels take: about a third for phases of like stiffness, a tenth with pores.
const VOXELS_SHARE: f64 = 0.25;

impl Export for PropertyOptions {
    type Report = PropertyReport;

    const NAME: &'static str = "properties";
    const FORMATS: &'static [&'static str] = &["json", "vti"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    /// Judges options before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] for a cylinder, [`ExportError::Invalid`] for an option that the specimen
    /// does not have, [`ExportError::TooLarge`].
    fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        if specimen.domain().lateral().is_some() {
            return Err(ExportError::Unavailable(
                "effective properties are those of a periodic cell, which a cylinder is not: pack the mix in a box, best \
                 with \"boundary\": \"periodic\""
                    .into(),
            ));
        }
        if specimen.is_periodic() && self.walls == Walls::Mirrored {
            return Err(invalid(
                "/walls",
                "mirrored is for boxes with walls: a periodic box is a cell as it is",
            ));
        }
        let grid = VoxelGrid::of_cells(specimen, self.cells);
        if let Some(axis) = (0..3).find(|axis| grid.shape[*axis] < LEAST_CELLS) {
            let (n, name) = (grid.shape[axis], ["x", "y", "z"][axis]);
            let detail = format!(
                "{} voxels along the longest edge are {n} along {name}: must be at least {LEAST_CELLS} along each",
                self.cells
            );
            return Err(invalid("/cells", detail));
        }
        let bytes = memory_bytes(specimen, None, self, limits.export_threads.get());
        if bytes > limits.max_memory_bytes {
            let [x, y, z] = shape(specimen, self);
            return Err(ExportError::TooLarge(FieldError::new(
                "/cells",
                format!(
                    "the properties of {x} x {y} x {z} voxels take about {} MB of memory: must be at most {} MB",
                    bytes / 1_000_000,
                    limits.max_memory_bytes / 1_000_000
                ),
            )));
        }
        Ok(())
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        let (specimen, materials) = (of.specimen(), of.materials());
        let computation = Some(ComputationEstimate {
            memory_bytes: memory_bytes(specimen, materials, self, 1),
            cpu_s: cpu_s(specimen, materials, self),
        });
        let bytes = expected_bytes(specimen, materials, self);
        Ok(ExportEstimate { computation, ..ExportEstimate::of_bytes(bytes) })
    }

    fn is_heavy(&self, _: &Specimen) -> bool {
        true
    }

    fn needs_materials(&self) -> bool {
        true
    }

    fn materials(&self) -> Option<&Materials> {
        self.materials.as_ref()
    }

    fn materials_mut(&mut self) -> Option<&mut Option<Materials>> {
        Some(&mut self.materials)
    }

    fn check_materials(&self, phases: &[materials::PhaseMaterial<'_>]) -> Result<(), ExportError> {
        check_materials(phases, self)
    }

    fn check_report(&self, made: &Made<'_>, report: &PropertyReport) -> Result<(), String> {
        check_properties(made.volume_fraction, self.materials.as_ref().or(made.materials), report)
    }

    fn checkpoint_identity(&self, model: &Model<'_>) -> Option<Vec<u8>> {
        checkpoint_identity(model, self)
    }

    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<PropertyReport, ExportError> {
        self.write_or_resume(model, limits, None, control, out)
    }

    /// Computes the properties and writes them, or the fields. Load cases that an earlier run has solved are not solved
    /// again, and change no byte.
    ///
    /// # Errors
    /// Those of [`Export::check`], [`ExportError::Invalid`] for materials; [`ExportError::Unavailable`] where the
    /// solver does not reach the tolerance; [`ExportError::Stopped`], [`ExportError::OutOfMemory`],
    /// [`ExportError::Write`].
    fn write_or_resume(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        resume: Option<Resume>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<PropertyReport, ExportError> {
        self.check(model.specimen, limits)?;
        let phases = Phases::of(model, self)?;
        let mut state = State::new(state::identity(self, phases.materials()), resume, control);
        let work = Work { model, options: self, phases: &phases, limits };
        let coarse = work.properties(self.cells / 2, &mut state, &Part::new(control, 0.0, 0.11))?;
        let fine = work.properties(self.cells, &mut state, &Part::new(control, 0.11, 1.0))?;
        let report = work.report(&coarse, &fine);
        if let Some(cases) = state.last().filter(|_| self.fields) {
            let (cell, threads) = ((&report.cell, self.scheme), limits.export_threads);
            fields::write(model, &phases, cell, (&fine, cases), threads, control, out)?;
        } else {
            serde_json::to_writer_pretty(&mut *out, &report).map_err(std::io::Error::from)?;
            writeln!(out)?;
        }
        Ok(report)
    }
}

fn invalid(pointer: &str, detail: impl Into<String>) -> ExportError {
    ExportError::Invalid(vec![FieldError::new(pointer, detail)])
}

/// Voxels of the cell along x, y, z.
fn shape(specimen: &Specimen, options: &PropertyOptions) -> [usize; 3] {
    let times = if options.walls == Walls::Mirrored { 2 } else { 1 };
    VoxelGrid::of_cells(specimen, options.cells).shape.map(|n| n * times)
}

/// Whether all materials have a property; where none are known they are taken to have it.
fn all_have(materials: Option<&Materials>, of: fn(&Material) -> Option<f64>) -> bool {
    materials.is_none_or(|materials| materials.entries().all(|(_, material)| of(material).is_some()))
}

/// Load cases of the stiffness and the temperature, as far as they are computed.
fn elastic_cases(materials: Option<&Materials>, options: &PropertyOptions) -> usize {
    let materials = options.materials.as_ref().or(materials);
    match &options.kinds {
        Some(kinds) if !kinds.is_elastic() => 0,
        Some(kinds) if !kinds.has(PropertyKind::Expansion) => 6,
        None if !all_have(materials, |material| material.youngs_modulus_gpa) => 0,
        // A pore needs no expansion.
        None if !all_have(materials, |material| {
            material.expansion_1_k.or(material.youngs_modulus_gpa.filter(|modulus| *modulus == 0.0))
        }) =>
        {
            6
        }
        _ => 7,
    }
}

/// Load cases of conductivity and diffusivity, as far as they are computed.
fn conduction_cases(materials: Option<&Materials>, options: &PropertyOptions) -> usize {
    let materials = options.materials.as_ref().or(materials);
    if options.kinds.as_ref().is_some_and(|kinds| !kinds.has(PropertyKind::Conductivity)) {
        return 0;
    }
    let both = [|of: &Material| of.conductivity_w_m_k, |of: &Material| of.diffusivity_m2_s];
    3 * both.into_iter().filter(|of| all_have(materials, *of)).count()
}

/// Memory that the properties take at most, in bytes.
fn memory_bytes(
    specimen: &Specimen,
    materials: Option<&Materials>,
    options: &PropertyOptions,
    threads: usize,
) -> u64 {
    let shape = shape(specimen, options);
    let conducting = conduction_cases(materials, options);
    let solver = match elastic_cases(materials, options) {
        0 => homogenization::bytes(shape, 1, 3, threads),
        cases => homogenization::bytes(shape, 3, cases, threads),
    };
    let voxels = shape.iter().fold(1_u64, |product, n| product.saturating_mul(*n as u64));
    // A byte for each, and what is known of those that are cut, twice while they are collected.
    let of_cuts = if options.cut_voxels == CutVoxels::Mixed { 16 } else { 0 };
    // Displacements of a scalar stay beside those of strains, and those of the coarse grid beside both.
    let elastic = 12 * elastic_cases(materials, options) as u64;
    let others = 4 * conducting as u64;
    let kept = if elastic > 0 { others } else { 0 } + (elastic + others) / 8;
    solver.saturating_add(voxels.saturating_mul(1 + of_cuts + kept))
}

/// CPU time that the properties take, in s, within a factor of three.
fn cpu_s(specimen: &Specimen, materials: Option<&Materials>, options: &PropertyOptions) -> f64 {
    let voxels: f64 = shape(specimen, options).iter().map(|n| *n as f64).product();
    let iterations = match phases::contrast(options.materials.as_ref().or(materials)) {
        Some(contrast) => ITERATIONS_PER_ROOT * contrast.sqrt(),
        None => ITERATIONS_WITH_PORES,
    };
    let digits = -crate::elementary::log10(options.tolerance) / 4.0;
    let conducts = options.kinds.as_ref().is_none_or(|kinds| kinds.has(PropertyKind::Conductivity));
    let cases = elastic_cases(materials, options) as f64 + f64::from(u8::from(conducts));
    // The start and the measurement of a case take the time of an iteration or two; the grid of half the voxels an
    // eighth.
    voxels * cases * (iterations * digits + 2.0) * SECONDS_PER_VOXEL * 1.125
}

/// Length of the file.
fn expected_bytes(specimen: &Specimen, materials: Option<&Materials>, options: &PropertyOptions) -> u64 {
    if !options.fields {
        return DOCUMENT_BYTES;
    }
    let per_voxel =
        fields::bytes_per_voxel(elastic_cases(materials, options), conduction_cases(materials, options));
    let voxels = shape(specimen, options).iter().fold(1_u64, |product, n| product.saturating_mul(*n as u64));
    voxels.saturating_mul(per_voxel).saturating_add(DOCUMENT_BYTES)
}

/// What a checkpoint of these properties belongs to; none where they cannot be computed.
fn checkpoint_identity(model: &Model<'_>, options: &PropertyOptions) -> Option<Vec<u8>> {
    state::identity(options, Phases::of(model, options).ok()?.materials())
}

/// The properties of a grid.
struct Properties {
    voxels: Voxels,
    of_three_bodies: u64,
    elasticity: Option<Elasticity>,
    conductivity: Option<Conduction>,
    diffusivity: Option<Conduction>,
}

struct Work<'a> {
    model: &'a Model<'a>,
    options: &'a PropertyOptions,
    phases: &'a Phases,
    limits: &'a Limits,
}

impl Work<'_> {
    /// Computes the properties with so many voxels along the longest edge.
    fn properties(
        &self,
        cells: u32,
        state: &mut State<'_>,
        control: &dyn Control,
    ) -> Result<Properties, ExportError> {
        let threads = self.limits.export_threads;
        let settings = Settings { scheme: self.options.scheme, tolerance: self.options.tolerance, threads };
        let Voxelized { mut voxels, mut of_three_bodies } =
            self.voxels(cells, &Part::new(control, 0.0, VOXELS_SHARE))?;
        if self.options.walls == Walls::Mirrored {
            voxels = voxels.mirrored()?;
            of_three_bodies *= 8;
        }
        let Phases { kinds, elastic, conductivity, diffusivity, .. } = self.phases;
        // Times of the parts, about.
        let thermal = kinds.has(PropertyKind::Expansion);
        let times = [
            if kinds.is_elastic() { 3.0 * if thermal { 7.0 } else { 6.0 } } else { 0.0 },
            if conductivity.is_some() { 3.0 } else { 0.0 },
            if diffusivity.is_some() { 3.0 } else { 0.0 },
        ];
        let total: f64 = times.iter().sum();
        let part = |number: usize| {
            let end = |n: usize| VOXELS_SHARE + (1.0 - VOXELS_SHARE) * times[..n].iter().sum::<f64>() / total;
            let ends = [number, number + 1].map(end);
            Part::new(control, ends[0], ends[1])
        };
        let sum = voxels.checksum();
        let mut cases = state.earlier(&voxels)?;
        let conduct =
            |values: &Option<Vec<f64>>, number: usize, cases: &mut _, on_case: &mut dyn FnMut(&_)| {
                let conduct = |values| conduction(&voxels, values, &settings, cases, on_case, &part(number));
                values.as_deref().map(conduct).transpose().map_err(|error| self.error(error))
            };
        let (heat, diffusion) = (&mut cases.conductivity, &mut cases.diffusivity);
        let strains = &mut cases.elastic;
        let elasticity = kinds
            .is_elastic()
            .then(|| {
                let mut on_case = |solved: &SolvedCases<3>| state.keep(sum, solved, [&*heat, &*diffusion]);
                elasticity(&voxels, elastic, thermal, &settings, strains, &mut on_case, &part(0))
            })
            .transpose()
            .map_err(|error| self.error(error))?;
        let conductivity = conduct(conductivity, 1, heat, &mut |solved| {
            state.keep(sum, strains, [solved, &*diffusion]);
        })?;
        let diffusivity =
            conduct(diffusivity, 2, diffusion, &mut |solved| state.keep(sum, strains, [&*heat, solved]))?;
        state.end_grid(sum, cases);
        Ok(Properties { voxels, of_three_bodies, elasticity, conductivity, diffusivity })
    }

    fn voxels(&self, cells: u32, control: &dyn Control) -> Result<Voxelized, ExportError> {
        let grid = VoxelGrid::of_cells(self.model.specimen, cells);
        let cuts = match self.options.cut_voxels {
            CutVoxels::Mixed => Cuts::Mixed,
            CutVoxels::Labels => Cuts::Labels,
        };
        let grains = PlacedGrains::new(self.model.grains)?;
        let of_grain = self.model.grains.aggregate();
        let phase = |grain: usize| 1 + of_grain.get(grain).copied().unwrap_or(0) as u8;
        voxelize(self.model, &grains, &grid, cuts, phase, self.limits.export_threads, control)
    }

    fn error(&self, error: HomogenizationError) -> ExportError {
        match error {
            HomogenizationError::Stopped => ExportError::Stopped,
            HomogenizationError::OutOfMemory(error) => error.into(),
            HomogenizationError::NotConverged { iterations, error } => ExportError::Unavailable(format!(
                "the solver has a relative error of {error:.1e} after {iterations} iterations, and is to reach {:.1e}: \
                 request a larger tolerance, or cut_voxels=labels, or materials that differ less",
                self.options.tolerance
            )),
        }
    }

    fn report(&self, coarse: &Properties, fine: &Properties) -> PropertyReport {
        let phases = self.phases;
        let shares = fine.voxels.shares(phases.names.len());
        let elastic = fine.elasticity.as_ref().zip(coarse.elasticity.as_ref());
        let kinds = &phases.kinds;
        let stiffness = elastic.filter(|_| kinds.has(PropertyKind::Stiffness)).map(|(fine, coarse)| {
            let c = &fine.stiffness_gpa;
            StiffnessReport {
                stiffness_gpa: rows(c),
                youngs_moduli_gpa: youngs_moduli(c),
                isotropic: isotropic_projection(c),
                universal_anisotropy: universal_anisotropy(c),
                bounds: elastic_bounds(&shares, &phases.elastic),
                error: PropertyError::new(&fine.effort, difference(c, &coarse.stiffness_gpa)),
            }
        });
        let expansion = elastic.and_then(|(fine, coarse)| {
            let of = |elasticity: &Elasticity| {
                expansion(&elasticity.stiffness_gpa, elasticity.thermal_gpa_k.as_ref()?).map(|a| tensor(&a))
            };
            let (own, half) = (of(fine)?, of(coarse)?);
            Some(ExpansionReport {
                expansion_1_k: rows(&own),
                isotropic_1_k: own.trace() / 3.0,
                error: PropertyError::new(&fine.effort, difference(&own, &half)),
            })
        });
        let conduction = |fine: &Option<Conduction>, coarse: &Option<Conduction>, of: &Option<Vec<f64>>| {
            let (fine, coarse, values) = (fine.as_ref()?, coarse.as_ref()?, of.as_ref()?);
            let matrix = &fine.conductivity;
            Some(ConductionReport {
                matrix: rows(matrix),
                isotropic: isotropic_conductivity(matrix),
                bounds: conduction_bounds(&shares, values),
                error: PropertyError::new(&fine.effort, difference(matrix, &coarse.conductivity)),
            })
        };
        PropertyReport {
            cell: self.cell(fine),
            scheme: self.options.scheme,
            cut_voxels: self.options.cut_voxels,
            tolerance: self.options.tolerance,
            phases: phases.reported(self.model, &shares),
            stiffness,
            expansion,
            conductivity: conduction(&fine.conductivity, &coarse.conductivity, &phases.conductivity),
            diffusivity: conduction(&fine.diffusivity, &coarse.diffusivity, &phases.diffusivity),
        }
    }

    fn cell(&self, fine: &Properties) -> PropertyCell {
        let is_periodic = self.model.specimen.is_periodic();
        let kind = match (is_periodic, self.options.walls) {
            (true, _) => CellKind::PeriodicBox,
            (false, Walls::Periodic) => CellKind::RepeatedBox,
            (false, Walls::Mirrored) => CellKind::MirroredBox,
        };
        let times = if kind == CellKind::MirroredBox { 2.0 } else { 1.0 };
        let size_mm = self.model.specimen.bounds_mm().map(|length| times * length);
        let voxels = fine.voxels.shape();
        PropertyCell {
            kind,
            size_mm,
            voxels: voxels.map(|n| n as u64),
            voxel_mm: [0, 1, 2].map(|axis| size_mm[axis] / voxels[axis] as f64),
            cut_share: fine.voxels.cuts().len() as f64 / fine.voxels.len() as f64,
            voxels_of_three_bodies: fine.of_three_bodies,
        }
    }
}

/// The rows of a symmetric matrix.
fn rows<const N: usize>(matrix: &nalgebra::SMatrix<f64, N, N>) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

/// The largest difference of two matrices over the largest component of the first.
fn difference<const N: usize>(
    own: &nalgebra::SMatrix<f64, N, N>,
    other: &nalgebra::SMatrix<f64, N, N>,
) -> f64 {
    let most = own.amax();
    if most > 0.0 { (own - other).amax() / most } else { 0.0 }
}

/// The matrix of a strain with the order xx, yy, zz, and twice yz, xz, xy.
fn tensor(strain: &Vector6<f64>) -> Matrix3<f64> {
    let [xx, yy, zz, yz, xz, xy] = (*strain).into();
    let (yz, xz, xy) = (yz / 2.0, xz / 2.0, xy / 2.0);
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
