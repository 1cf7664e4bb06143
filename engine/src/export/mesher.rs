//! What the engine asks of a program that meshes volumes and planes, and how what it leaves is read.
//!
//! The engine starts no program: its caller gives a [`Model`](crate::export::Model) one.

use std::fmt;
use std::io::{self, Read, Write};

use super::solid::SolidMesh;
use super::solid::msh::{self, Bodies, MshError};
use crate::control::{Control, Progress, Step};
use crate::export::{ExportError, Model};

/// An installed program that fills surfaces with tetrahedra and planes with triangles: Gmsh.
pub trait Mesher: fmt::Debug + Sync {
    /// Its name and version, as `Gmsh 4.15.2`.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where there is none: how to install it.
    fn version(&self) -> Result<String, ExportError>;

    /// Runs it in a folder of its own, which ends with what is returned.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`], [`ExportError::Mesher`] with the cause, [`ExportError::Stopped`],
    /// [`ExportError::Write`], and those of `input.surfaces`.
    fn fill(
        &self,
        input: MesherInput<'_>,
        control: &dyn Control,
    ) -> Result<Box<dyn MesherFiles>, ExportError>;
}

/// Writes the surfaces of a mesh.
pub type WriteSurfaces<'a> = dyn FnMut(&mut dyn Write) -> Result<(), ExportError> + 'a;

/// What the program is given.
pub struct MesherInput<'a> {
    /// What it makes.
    pub dimension: MeshDimension,
    /// Writes the file [`SURFACES`], where the script merges it.
    pub surfaces: Option<&'a mut WriteSurfaces<'a>>,
    /// Its script.
    pub script: &'a str,
    /// The file [`SIZES`] of lengths of edges, where there is one.
    pub sizes: Option<&'a [u8]>,
    /// Ending of a file in another format that is made of the mesh: `med`.
    pub also: Option<&'static str>,
}

/// What a mesh fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshDimension {
    /// Planes, with triangles.
    Plane,
    /// Volumes, with tetrahedra.
    Solid,
}

/// The files that the program has made.
pub trait MesherFiles {
    /// Opens the file with that ending: `msh` has the elements.
    ///
    /// # Errors
    /// Those of the file system.
    fn open(&self, ending: &str) -> io::Result<Box<dyn Read>>;
}

/// Name of the file of surfaces.
pub const SURFACES: &str = "surfaces.msh";
/// Name of the file of lengths of edges.
pub const SIZES: &str = "sizes.bin";

/// The mesher of a model.
///
/// # Errors
/// [`ExportError::Unavailable`] where it has none.
pub(super) fn of_model<'a>(model: &Model<'a>) -> Result<&'a dyn Mesher, ExportError> {
    model.mesher.ok_or_else(|| {
        ExportError::Unavailable(
            "tetrahedra and triangles are made by Gmsh, and this program was built without a way to it"
                .into(),
        )
    })
}

/// Reads what the mesher has made.
///
/// # Errors
/// [`ExportError::Mesher`] for what is no mesh of a packing, and those of reading.
pub(super) fn read(
    files: &dyn MesherFiles,
    bodies: Bodies,
    control: &dyn Control,
) -> Result<SolidMesh, ExportError> {
    control.report(&Progress::counted(Step::Export, 0, 0, "elements", "reading the elements"));
    let input: Box<dyn Read> = files.open("msh")?;
    msh::read(input, bodies, control).map_err(|error| match error {
        MshError::Io(error) => ExportError::Write(error),
        MshError::OutOfMemory(error) => error.into(),
        MshError::Stopped => ExportError::Stopped,
        damaged @ MshError::Damaged { .. } => {
            ExportError::Mesher(format!("Gmsh left no mesh of the packing: {damaged}"))
        }
    })
}

/// What a check of the mesher's mesh found, as a fault of the mesher.
pub(super) fn unusable(error: ExportError) -> ExportError {
    match error {
        ExportError::CheckFailed(what) => ExportError::Mesher(format!("Gmsh's mesh cannot be used: {what}")),
        other => other,
    }
}
