//! Exports of a finished packing: surface meshes, voxels, slices, decks for finite elements, lattice models, tables of
//! its grains, and its quality.
//!
//! Every export is a pure function of a [`Model`] and its options, so that the same request gives the same bytes.

mod archive;
pub mod catalog;
pub mod certificates;
pub mod deck;
mod digits;
mod estimate;
mod groups;
mod kind;
pub mod ldpm;
mod materials;
pub mod mesh;
mod mesher;
mod npy;
pub mod picture;
mod pieces;
pub mod properties;
mod provenance;
pub mod quality;
mod rows;
#[cfg(feature = "openapi")]
mod schema;
pub mod shapes;
pub mod slice;
pub mod solid;
mod steps;
pub mod tables;
pub mod voxels;
mod vtk_xml;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "../../tests/support/polyhedra.rs"]
mod polyhedra_samples;

use std::io;

use thiserror::Error;

#[cfg(test)]
use crate as engine;
use crate::control::Control;
use crate::memory::OutOfMemory;
use crate::packing::GrainsRef;
use crate::request::{Distance, FieldError, Materials, Specimen};

pub use catalog::{ExportReport, ExportRequest, ExportType};
pub use estimate::{ComputationEstimate, Expected, ExportEstimate, MeshEstimate};
pub use kind::{Export, Made, Writes};
pub use materials::PhaseMaterial;
pub use mesh::SurfaceCache;
pub use mesher::{MeshDimension, Mesher, MesherFiles, MesherInput, SIZES, SURFACES, WriteSurfaces};
pub use provenance::Provenance;

/// Counts the changes of what any export writes for the same options; part of the name that a cache gives it.
pub const REVISION: u32 = 11;

/// A finished packing, in memory.
#[derive(Clone, Copy, Debug)]
pub struct Model<'a> {
    /// The region.
    pub specimen: &'a Specimen,
    /// The grains, largest first; none overlaps another or leaves the region.
    pub grains: GrainsRef<'a>,
    /// The gaps that they keep: the rule of the request with the distance that was reached, or none.
    pub distance: Distance,
    /// Where it comes from; VTK files state it.
    pub provenance: Option<&'a Provenance>,
    /// The materials that the request of the packing states.
    pub materials: Option<&'a Materials>,
    /// What makes tetrahedra and triangles, for the exports that have them.
    pub mesher: Option<&'a dyn Mesher>,
    /// Surfaces of templates that exports share.
    pub surfaces: Option<&'a SurfaceCache>,
}

impl<'a> Model<'a> {
    /// A packing of unknown provenance, whose grains do not overlap.
    pub fn new(specimen: &'a Specimen, grains: impl Into<GrainsRef<'a>>) -> Self {
        let distance = Distance::None { wall_gap_mm: None };
        Self {
            specimen,
            grains: grains.into(),
            distance,
            provenance: None,
            materials: None,
            mesher: None,
            surfaces: None,
        }
    }

    /// The same packing, with the rule of distance that it keeps.
    #[must_use]
    pub fn with_distance(self, distance: Distance) -> Self {
        Self { distance, ..self }
    }

    /// The same packing, with its provenance.
    #[must_use]
    pub fn with_provenance(self, provenance: &'a Provenance) -> Self {
        Self { provenance: Some(provenance), ..self }
    }

    /// The same packing, with the materials that its request states.
    #[must_use]
    pub fn with_materials(self, materials: Option<&'a Materials>) -> Self {
        Self { materials, ..self }
    }

    /// The same packing, with what makes its tetrahedra and triangles.
    #[must_use]
    pub fn with_mesher(self, mesher: &'a dyn Mesher) -> Self {
        Self { mesher: Some(mesher), ..self }
    }

    /// The same packing, with surfaces of templates that its exports share: the estimate of a mesh makes those that the
    /// mesh itself needs.
    #[must_use]
    pub fn with_surfaces(self, surfaces: &'a SurfaceCache) -> Self {
        Self { surfaces: Some(surfaces), ..self }
    }
}

/// Why something was not made of a packing.
#[derive(Debug, Error)]
pub enum ExportError {
    /// Options that do not hold.
    #[error("{}", listed(.0))]
    Invalid(Vec<FieldError>),
    /// It cannot be made of this specimen or packing; the text says what to do.
    #[error("{0}")]
    Unavailable(String),
    /// More than may be used: says how much it would take.
    #[error("{0}")]
    TooLarge(FieldError),
    /// Its own checks failed, which is a defect of this program.
    #[error("the model failed its check: {0}")]
    CheckFailed(String),
    /// The program that makes tetrahedra and triangles failed; the text is the cause.
    #[error("{0}")]
    Mesher(String),
    /// It was told to stop.
    #[error("stopped")]
    Stopped,
    /// The system refused memory that the export needs.
    #[error("out of memory: the export needs {} MB more", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// What was made could not be written.
    #[error("{0}")]
    Write(#[from] io::Error),
}

impl From<OutOfMemory> for ExportError {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

fn listed(faults: &[FieldError]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Ends the work where it should stop.
///
/// # Errors
/// [`ExportError::Stopped`].
pub fn go_on(control: &dyn Control) -> Result<(), ExportError> {
    if control.should_stop() { Err(ExportError::Stopped) } else { Ok(()) }
}
