//! What the engine asks of a program that fills surfaces with tetrahedra, and what it tells the program.
//!
//! The engine starts no program: its caller gives a [`Model`](crate::export::Model) one.

use std::fmt;
use std::io::{self, Read, Write};

use crate::control::Control;
use crate::export::ExportError;

/// An installed program that fills surfaces with tetrahedra: Gmsh.
pub trait TetrahedronMesher: fmt::Debug + Sync {
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
    ) -> Result<Box<dyn FilledSurfaces>, ExportError>;
}

/// What the program is given.
pub struct MesherInput<'a> {
    /// Writes the file [`SURFACES`].
    pub surfaces: &'a mut dyn FnMut(&mut dyn Write) -> Result<(), ExportError>,
    /// Its script, which merges the file of surfaces.
    pub script: &'a str,
    /// The file [`SIZES`] of lengths of edges, where there is one.
    pub sizes: Option<&'a [u8]>,
    /// Ending of a file in another format that is made of the tetrahedra: `med`.
    pub also: Option<&'static str>,
}

/// The files that the program has made.
pub trait FilledSurfaces {
    /// Opens the file with that ending: `msh` has the tetrahedra.
    ///
    /// # Errors
    /// Those of the file system.
    fn open(&self, ending: &str) -> io::Result<Box<dyn Read>>;
}

/// Name of the file of surfaces.
pub const SURFACES: &str = "surfaces.msh";
/// Name of the file of lengths of edges.
pub const SIZES: &str = "sizes.bin";

/// Options of Gmsh that do not depend on the mesh. HXT (Marot, Pellerin and Remacle 2019, DOI 10.1002/nme.5987) on one
/// thread gives the same tetrahedra in each run.
const OPTIONS: [&str; 4] = [
    "Mesh.Algorithm3D = 10",
    "General.NumThreads = 1",
    "Mesh.MshFileVersion = 4.1",
    "Mesh.SecondOrderLinear = 1",
];

/// The options of a run of Gmsh, each a command of its scripts.
pub(super) fn options(order: u32, has_sizes: bool) -> Vec<String> {
    let mut options: Vec<String> = OPTIONS.map(str::to_owned).into();
    options.push(format!("Mesh.ElementOrder = {order}"));
    if has_sizes {
        options.extend(
            [
                "Field[1] = Structured",
                &format!("Field[1].FileName = \"{SIZES}\""),
                "Background Field = 1",
                "Mesh.MeshSizeExtendFromBoundary = 0",
                "Mesh.MeshSizeFromPoints = 0",
            ]
            .map(str::to_owned),
        );
    }
    options
}

/// The script of a run with these options.
pub(super) fn script(options: &[String]) -> String {
    let mut text = format!("Merge \"{SURFACES}\";\nCreateGeometry {{ Volume{{:}}; }}\n");
    for option in options {
        text.push_str(option);
        text.push_str(";\n");
    }
    text
}
