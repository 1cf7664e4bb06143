//! The script of a run of Gmsh that fills surfaces.

use crate::export::mesher::{SIZES, SURFACES};

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
