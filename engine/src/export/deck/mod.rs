//! Decks: models of a packing that a finite element program runs as they are, with mesh, materials, supports, a load
//! and output.
//!
//! A deck is a zip: `model.inp` with the step, `mesh.inp`, `materials.inp`, `plates.inp` with the equations that keep
//! free faces plane, `deck.json` with the figures, and a README. `load` has the boundary conditions and why they are
//! chosen, `frame` the axes of the mesh, `support` the check that they hold it, `solid_part` what becomes of pores,
//! `text` the keywords. [`crate::solution`] reads what CalculiX computes of it.

mod frame;
mod load;
mod options;
mod report;
mod report_check;
mod sets;
mod solid_part;
mod support;
mod text;
mod unpack;

use std::io::Write;
use std::num::NonZeroUsize;

use serde_json::Value;

pub use load::Load;
pub use options::{
    CutElements, CutPlace, DEFAULT_CELLS, DEFAULT_STRAIN, DEFAULT_TEMPERATURE_CHANGE_K, DeckElements,
    DeckFormat, DeckMesh, DeckOptions, LoadCase, Solver, TetrahedronElements, VoxelElements,
};
pub use report::{DeckPhase, DeckPlane, DeckReport, LateralFaces};
pub use unpack::unpack;

use self::frame::Frame;
use self::load::Conditions;
use self::report_check::check_deck;
use self::sets::NodeSets;
use self::solid_part::LeftOut;
use super::archive::{Archive, Content, PIECE_BYTES};
use super::estimate::{Expected, ExportEstimate, MeshEstimate};
use super::kind::{Export, Made};
use super::materials::{PhaseMaterial, moduli_gpa, of_model, phases as phases_with_materials};
use super::mesh::TetrahedronReport;
use super::mesh::tetrahedra::fill;
use super::slice::{Cut, TriangleReport};
use super::solid::PlaneState;
use super::solid::{PhaseRole, PhaseSet, SolidMeasures, SolidMesh};
use super::{ExportError, Model, Provenance, slice, voxels};
use crate::control::{Control, Part};
use crate::memory::reserved;
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::request::{Axis, FieldError, GrainKind, Material, Materials, Specimen};

/// Name of the set of nodes of all faces, whose displacements and reactions a deck prints.
pub const PRINTED_SET: &str = load::ALL_FACES;
/// Name of the job that a solver runs: `model.inp`.
pub const MODEL: &str = text::MODEL;
/// Bytes that an element and its share of the nodes take in the zip, measured from 8000 elements to six million: the
/// same within a few percent.
const BYTES_PER_VOXEL: u64 = 38;
/// The same of tetrahedra with 4 and with 10 nodes.
const BYTES_PER_TETRAHEDRON: [u64; 2] = [24, 100];
/// Bytes of the text of triangles that the zip makes one of.
const DEFLATED_TRIANGLES: u64 = 2;
/// Bytes of the comments that begin a file at most.
const HEAD_BYTES: usize = 1000;
/// Thickness of a plane model.
const THICKNESS_MM: f64 = 1.0;
/// Bytes of an equation at most.
const EQUATION_BYTES: usize = 60;

impl Export for DeckOptions {
    type Report = DeckReport;

    const NAME: &'static str = "deck";
    const FORMATS: &'static [&'static str] = &["zip"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.case.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.case.format.media_type()
    }

    fn name_parts(&self) -> Vec<&'static str> {
        match self.mesh.elements() {
            DeckElements::Voxels => vec![Self::NAME],
            elements => vec![Self::NAME, elements.name()],
        }
    }

    fn deciding_option(&self) -> (&'static str, &'static str) {
        ("elements", self.mesh.elements().name())
    }

    /// Four times the segments come with those, and the change of temperature with the load.
    fn is_implied(&self, option: &str, value: &Value) -> bool {
        match option {
            "max_segments" => self.mesh.has_default_max_segments(),
            "temperature_change_k" => value == DEFAULT_TEMPERATURE_CHANGE_K,
            _ => false,
        }
    }

    /// Judges options before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`] for a load that the specimen or the cut does not have, and for a cut through a
    /// cylinder; [`ExportError::TooLarge`].
    fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        if let DeckMesh::Triangles(own) = &self.mesh {
            return check_cut(specimen, self.case.load, own, limits);
        }
        if !self.case.load.fits(specimen) {
            let detail = format!(
                "{} is no load of a cylinder: must be {} or {}; pack a box for the others",
                self.case.load.name(),
                Load::UniaxialZ.name(),
                Load::Temperature.name()
            );
            return Err(ExportError::Invalid(vec![FieldError::new("/load", detail)]));
        }
        match &self.mesh {
            DeckMesh::Voxels(own) => own.voxels().check(specimen, limits),
            DeckMesh::Tetrahedra(own) => own.alone().check(specimen, limits),
            DeckMesh::Triangles(_) => Ok(()),
        }
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        if let DeckMesh::Tetrahedra(own) = &self.mesh {
            let estimate = own.alone().estimate(of)?;
            let elements = estimate.mesh.and_then(|mesh| mesh.tetrahedra).unwrap_or(0);
            let bytes =
                elements.saturating_mul(BYTES_PER_TETRAHEDRON[usize::from(own.tetrahedra.order == 2)]);
            let mesh = estimate.mesh.map(|mesh| MeshEstimate { bytes, ..mesh });
            return Ok(ExportEstimate { bytes, mesh, ..estimate });
        }
        Ok(ExportEstimate::of_bytes(expected_bytes(of.specimen(), self, of.sum_mm(), of.kind())))
    }

    fn needs_mesher(&self) -> bool {
        !matches!(self.mesh, DeckMesh::Voxels(_))
    }

    fn is_heavy(&self, _: &Specimen) -> bool {
        true
    }

    fn needs_materials(&self) -> bool {
        true
    }

    fn materials(&self) -> Option<&Materials> {
        self.case.materials.as_ref()
    }

    fn materials_mut(&mut self) -> Option<&mut Option<Materials>> {
        Some(&mut self.case.materials)
    }

    fn check_materials(&self, phases: &[PhaseMaterial<'_>]) -> Result<(), ExportError> {
        check_materials(phases, self.case.load)
    }

    fn check_report(&self, made: &Made<'_>, report: &DeckReport) -> Result<(), String> {
        check_deck(made.specimen, self, made.volume_fraction, made.materials, report)
    }

    /// Makes the deck and writes it.
    ///
    /// # Errors
    /// Those of [`Export::check`]; [`ExportError::Invalid`] for a phase without the properties that the load needs;
    /// [`ExportError::Unavailable`] for an empty set, a load on no node, and too few constraints; and
    /// [`ExportError::Stopped`]. Nothing is written before all of this is known.
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<DeckReport, ExportError> {
        self.check(model.specimen, limits)?;
        let materials = of_model(self.case.materials.as_ref(), model)?;
        // By measured times: Gmsh takes most of those of tetrahedra and triangles.
        let [meshed, checked, listed] = match &self.mesh {
            DeckMesh::Voxels(_) => [0.12, 0.6, 0.85],
            DeckMesh::Tetrahedra(_) | DeckMesh::Triangles(_) => [0.9, 0.95, 0.98],
        };
        let mesh = Meshed::of(model, &self.mesh, limits, &Part::new(control, 0.0, meshed))?;
        let checking = Part::new(control, meshed, checked);
        let deck = Deck::new(mesh, model.specimen, &self.case, materials, &checking)?;
        let writing = Part::new(control, checked, listed);
        deck.write(model.provenance, limits.export_threads, &writing, out)?;
        Ok(deck.report)
    }
}

fn check_cut(specimen: &Specimen, load: Load, own: &CutElements, limits: &Limits) -> Result<(), ExportError> {
    let invalid =
        |pointer: &str, detail: String| Err(ExportError::Invalid(vec![FieldError::new(pointer, detail)]));
    if specimen.domain().lateral().is_some() {
        let detail = "triangles make a deck of a box alone, whose cuts have four straight edges: pack a box";
        return invalid("/elements", detail.into());
    }
    let axis = own.place.axis;
    if !load.fits_cut(axis) {
        let fit: Vec<&str> =
            Load::ALL.into_iter().filter(|load| load.fits_cut(axis)).map(Load::name).collect();
        let (load, axis) = (load.name(), axis.name());
        let detail = format!(
            "{load} does not act in the plane of a cut across {axis}: must be one of {}",
            fit.join(", ")
        );
        return invalid("/load", detail);
    }
    own.alone().check(specimen, limits)
}

/// Length of the file of voxels, or of the triangles of a cut through grains of that sum of diameters, within a factor
/// of two; that of tetrahedra follows from their surfaces.
fn expected_bytes(specimen: &Specimen, options: &DeckOptions, sum_mm: f64, kind: GrainKind) -> u64 {
    match &options.mesh {
        DeckMesh::Voxels(own) => {
            let (_, voxels) = voxels::hexahedra(specimen, &own.voxels());
            let inside = specimen.volume_mm3() / specimen.bounds_mm().iter().product::<f64>();
            (voxels as f64 * inside) as u64 * BYTES_PER_VOXEL
        }
        DeckMesh::Triangles(own) => {
            slice::expected_bytes(specimen, &own.alone(), sum_mm, kind) / DEFLATED_TRIANGLES
        }
        DeckMesh::Tetrahedra(_) => 0,
    }
}

/// Judges the materials of a packing's phases before there are grains.
///
/// # Errors
/// [`ExportError::Invalid`] with every property that is missing.
fn check_materials(phases: &[PhaseMaterial<'_>], load: Load) -> Result<(), ExportError> {
    moduli_gpa(phases)?;
    let heats = load == Load::Temperature;
    let needs = |phase: &&PhaseMaterial<'_>| heats && modulus(phase.material) > 0.0;
    let missing: Vec<FieldError> = phases
        .iter()
        .filter(needs)
        .filter_map(|phase| phase.needed("expansion_1_k", phase.material.expansion_1_k).err())
        .collect();
    if missing.is_empty() { Ok(()) } else { Err(ExportError::Invalid(missing)) }
}

/// The mesh of a deck, and what is known of it.
pub(super) struct Meshed {
    mesh: SolidMesh,
    elements: DeckElements,
    tetrahedra: Option<TetrahedronReport>,
    triangles: Option<TriangleReport>,
    plane: Option<DeckPlane>,
    warnings: Vec<String>,
}

impl Meshed {
    /// Meshes a packing.
    fn of(
        model: &Model<'_>,
        options: &DeckMesh,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<Self, ExportError> {
        match options {
            DeckMesh::Voxels(own) => {
                voxels::solid_mesh(model, &own.voxels(), limits, control).map(Self::of_voxels)
            }
            DeckMesh::Tetrahedra(own) => {
                let filled = fill(model, &own.surfaces, &own.tetrahedra, None, limits, control)?;
                let report = filled.report;
                Ok(Self {
                    elements: DeckElements::Tetrahedra,
                    tetrahedra: report.tetrahedra,
                    warnings: report.warnings,
                    ..Self::of_voxels(filled.mesh)
                })
            }
            DeckMesh::Triangles(own) => {
                let at_mm = own.alone().cut.at_mm(model.specimen);
                let cut = Cut::new(model, own.place.axis, at_mm)?;
                let meshed = slice::mesh_of(model, &cut, &own.triangles, limits, control)?;
                let warnings = meshed.report.warnings.clone();
                Ok(Self {
                    warnings,
                    triangles: Some(meshed.report),
                    ..Self::of_cut(meshed.mesh, own.place.axis, at_mm, own.triangles.plane)
                })
            }
        }
    }

    /// Voxels that were made.
    pub(super) fn of_voxels(mesh: SolidMesh) -> Self {
        Self {
            mesh,
            elements: DeckElements::Voxels,
            tetrahedra: None,
            triangles: None,
            plane: None,
            warnings: Vec::new(),
        }
    }

    /// Triangles that were made.
    pub(super) fn of_cut(mesh: SolidMesh, axis: Axis, at_mm: f64, state: PlaneState) -> Self {
        let plane = Some(DeckPlane { axis, at_mm, state, thickness_mm: THICKNESS_MM });
        Self { elements: DeckElements::Triangles, plane, ..Self::of_voxels(mesh) }
    }
}

/// A deck that is complete and checked.
pub(super) struct Deck {
    mesh: SolidMesh,
    frame: Frame,
    conditions: Conditions,
    report: DeckReport,
}

impl Deck {
    /// Judges a mesh with its load and materials.
    ///
    /// # Errors
    /// See [`write`].
    pub(super) fn new(
        meshed: Meshed,
        specimen: &Specimen,
        case: &LoadCase,
        materials: &Materials,
        control: &dyn Control,
    ) -> Result<Self, ExportError> {
        let Meshed { mesh, elements, tetrahedra, triangles, plane, mut warnings } = meshed;
        let frame = Frame::of(specimen, plane.map(|plane| plane.axis), THICKNESS_MM);
        refuse_empty(&mesh)?;
        let of_phases = materials_of(&mesh.phases, materials, case.load)?;
        let conditions = Conditions::of(case.load, &frame, case.strain.unwrap_or_default());
        support::check(&conditions, &NodeSets::new(&mesh, &frame), &mesh.nodes_mm, frame.dimension())?;
        let whole = mesh.check(control)?;
        let volume_mm3 = whole.volume_mm3;
        let is_solid: Vec<bool> = of_phases.iter().map(|material| modulus(material) > 0.0).collect();
        let (mesh, left_out) = solid_part::solid_part(mesh, &is_solid)?;
        let sets = NodeSets::new(&mesh, &frame);
        let measures = if left_out == LeftOut::default() {
            whole
        } else {
            refuse_empty(&mesh)?;
            support::check(&conditions, &sets, &mesh.nodes_mm, frame.dimension())?;
            mesh.check(control)?
        };
        let solid_materials = of_phases.into_iter().filter(|material| modulus(material) > 0.0);
        if specimen.is_periodic() {
            warnings.push(
                "The box is periodic, but the deck puts it between plates: its stiffness is that of the cell that is \
                 mirrored at its faces."
                    .to_owned(),
            );
        }
        if left_out.loose > 0 {
            warnings.push(format!(
                "{} elements are left out that share no side with the rest of the solid.",
                left_out.loose
            ));
        }
        let report = DeckReport {
            solver: case.solver,
            load: case.load,
            strain: case.strain,
            temperature_change_k: case.temperature_change_k,
            elements,
            element_type: mesh.kind.abaqus_name().to_owned(),
            lateral_faces: if frame.has_free_sides { LateralFaces::Free } else { LateralFaces::Plane },
            plane,
            size_mm: frame.size_mm,
            volume_mm3,
            nodes: measures.nodes,
            number_of_elements: measures.elements,
            degrees_of_freedom: degrees_of_freedom(
                &conditions,
                &sets,
                mesh.nodes_mm.len(),
                frame.dimension(),
            )?,
            phases: phases(&measures, solid_materials),
            pore_elements: left_out.pores,
            loose_elements: left_out.loose,
            tetrahedra,
            triangles,
            warnings,
        };
        Ok(Self { mesh, frame, conditions, report })
    }

    /// Writes the zip. Its bytes do not depend on the threads.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::OutOfMemory`], [`ExportError::Stopped`].
    pub(super) fn write(
        &self,
        provenance: Option<&Provenance>,
        threads: NonZeroUsize,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        let report = &self.report;
        let head = text::head(report, provenance);
        let sets = NodeSets::new(&self.mesh, &self.frame);
        let bytes = SolidMesh::inp_bytes(self.mesh.kind, report.nodes, report.number_of_elements);
        let mut mesh = reserved(bytes as usize)?;
        self.mesh.write_inp(&head, control, &mut mesh)?;
        let mut archive = Archive::new(out, threads)?;
        add(&mut archive, "README.txt", text::readme(&head, report, &self.frame).as_bytes())?;
        add(&mut archive, "model.inp", text::model(&head, report, &self.conditions, &sets).as_bytes())?;
        add(&mut archive, "materials.inp", text::materials(&head, report).as_bytes())?;
        if !self.conditions.tied.is_empty() {
            let equations =
                self.conditions.tied.iter().map(|(face, _)| sets.nodes(face).len()).sum::<usize>();
            let mut plates = reserved(HEAD_BYTES + EQUATION_BYTES * equations)?;
            plates.extend_from_slice(text::comments(&head).as_bytes());
            for (face, axis) in &self.conditions.tied {
                if let Some((first, others)) = sets.nodes(face).split_first() {
                    for node in others {
                        text::push_equation(&mut plates, *node, *first, *axis);
                    }
                }
            }
            add(&mut archive, "plates.inp", &plates)?;
        }
        let figures = serde_json::to_string_pretty(report).map_err(std::io::Error::from)? + "\n";
        add(&mut archive, "deck.json", figures.as_bytes())?;
        add(&mut archive, "mesh.inp", &mesh)?;
        archive.finish()
    }
}

fn add(archive: &mut Archive<'_>, name: &str, text: &[u8]) -> Result<(), ExportError> {
    let content = Content {
        pieces: text.len().div_ceil(PIECE_BYTES),
        most_bytes: PIECE_BYTES,
        write: |piece, content: &mut Vec<u8>| {
            content.extend_from_slice(&text[piece * PIECE_BYTES..text.len().min((piece + 1) * PIECE_BYTES)]);
            Ok(())
        },
        taken: |_| {},
    };
    archive.add(name, content)
}

/// Refuses a phase without elements.
fn refuse_empty(mesh: &SolidMesh) -> Result<(), ExportError> {
    let mut has_elements = vec![false; mesh.phases.len()];
    for phase in &mesh.phase_of {
        has_elements[usize::from(*phase)] = true;
    }
    match mesh.phases.iter().zip(&has_elements).find(|(_, has)| !**has) {
        Some((phase, _)) => Err(ExportError::Unavailable(format!(
            "the set of elements {} of the deck is empty: no element lies in this phase; choose finer elements",
            phase.name
        ))),
        None => Ok(()),
    }
}

fn modulus(material: &Material) -> f64 {
    material.youngs_modulus_gpa.unwrap_or_default()
}

/// The material of each phase, with what the load needs of it.
fn materials_of(
    phases: &[PhaseSet],
    materials: &Materials,
    load: Load,
) -> Result<Vec<Material>, ExportError> {
    let aggregates = phases.iter().filter_map(|phase| match &phase.role {
        PhaseRole::Matrix => None,
        PhaseRole::Aggregate { name } => Some(name.clone()),
    });
    let names: Vec<Option<String>> = aggregates.collect();
    let mut found = phases_with_materials(materials, &names)?;
    // Without an aggregate there is a phase too many.
    found.truncate(phases.len());
    check_materials(&found, load)?;
    Ok(found.into_iter().map(|phase| *phase.material).collect())
}

fn phases(measures: &SolidMeasures, materials: impl Iterator<Item = Material>) -> Vec<DeckPhase> {
    let of = |(phase, material): (&super::solid::PhaseMeasures, Material)| DeckPhase {
        name: phase.name.clone(),
        elements: phase.elements,
        volume_mm3: phase.volume_mm3,
        youngs_modulus_gpa: modulus(&material),
        poissons_ratio: material.poissons_ratio.unwrap_or_default(),
        density_kg_m3: material.density_kg_m3,
        conductivity_w_m_k: material.conductivity_w_m_k,
        expansion_1_k: material.expansion_1_k,
    };
    measures.phases.iter().zip(materials).map(of).collect()
}

/// Displacements that neither a condition gives nor a tie.
fn degrees_of_freedom(
    conditions: &Conditions,
    sets: &NodeSets<'_>,
    nodes: usize,
    dimension: usize,
) -> Result<u64, ExportError> {
    let mut is_given = crate::memory::filled(nodes, [false; 3])?;
    for prescribed in &conditions.prescribed {
        for node in sets.nodes(prescribed.set) {
            is_given[*node as usize][prescribed.axis] = true;
        }
    }
    for (face, axis) in &conditions.tied {
        for node in sets.nodes(face).iter().skip(1) {
            is_given[*node as usize][*axis] = true;
        }
    }
    let free = |given: &[bool; 3]| given[..dimension].iter().filter(|given| !**given).count() as u64;
    Ok(is_given.iter().map(free).sum())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod plane_tests;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod same_voxels_tests;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tetrahedra_tests;
