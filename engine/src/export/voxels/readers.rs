//! The files that solvers and mesh generators read as they are, by the manuals of these programs.
//!
//! - DAMASK (`GeomGrid.load` of its Python package, and `DAMASK_grid`): VTK XML image data with the cell data
//!   `material`, numbers from 0, Int64 in `binary` encoding without compression, lengths in m.
//! - AMITEX (user guide, "Input files"): VTK legacy format with exactly ten lines of head, numbers from 1 without gaps.
//! - FANS (README, "Input file format"): JSON, and an HDF5 file that a script makes of an array of NumPy, so that
//!   nothing here links HDF5.
//! - automesh reads an array of NumPy as it is (`VoxelFormat::Npy`): bytes indexed `[x, y, z]`, 0 where nothing is
//!   meshed.

use std::io::Write;

use serde_json::json;

use super::base64::Base64;
use super::numbers::Numbers;
use super::pass::{Found, Work};
use crate::arrays::Each as _;
use crate::export::archive::{Archive, Content};
use crate::export::materials::{PhaseMaterial, moduli_gpa};
use crate::export::{ExportError, npy};

/// Millimetres of a metre.
const MM_PER_M: f64 = 1000.0;
/// Megapascals of a gigapascal.
const MPA_PER_GPA: f64 = 1000.0;
/// Tags after the values of DAMASK's file, and spaces of the lines.
const END_OF_DAMASK: &str =
    "\n        </DataArray>\n      </CellData>\n    </Piece>\n  </ImageData>\n</VTKFile>\n";

/// What the script of FANS makes, and the input names.
const HDF5_FILE: &str = "microstructure.h5";
const DATA_SET: &str = "/labels";

/// Makes the HDF5 file of the array beside it.
const SCRIPT: &str = r#"# Makes microstructure.h5, which FANS reads, of microstructure.npy; needs numpy and h5py.
# Then: mpiexec -n 1 FANS input.json results.h5
import h5py
import numpy

labels = numpy.load("microstructure.npy", mmap_mode="r")  # indexed [x, y, z], x runs fastest
with h5py.File("microstructure.h5", "w") as file:
    data = file.create_dataset("labels", labels.shape[::-1], "uint16", chunks=True, compression="gzip")
    data.attrs["permute_order"] = "zyx"
    for z in range(labels.shape[2]):
        data[z] = labels[:, :, z].T
"#;

/// Writes DAMASK's image data.
pub(super) fn write_damask(
    work: &Work<'_>,
    numbers: &Numbers,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let grid = work.bodies.grid;
    let [nx, ny, nz] = grid.shape;
    let [dx, dy, dz] = grid.spacing_mm.each(|mm| mm / MM_PER_M);
    let head = [
        "<?xml version=\"1.0\"?>\n",
        "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n",
        &format!(
            "  <ImageData WholeExtent=\"0 {nx} 0 {ny} 0 {nz}\" Origin=\"0 0 0\" Spacing=\"{dx} {dy} {dz}\""
        ),
        " Direction=\"1 0 0 0 1 0 0 0 1\">\n",
        &format!("    <Piece Extent=\"0 {nx} 0 {ny} 0 {nz}\">\n"),
        "      <CellData Scalars=\"material\">\n",
        "        <DataArray type=\"Int64\" Name=\"material\" format=\"binary\">\n          ",
    ];
    out.write_all(head.concat().as_bytes())?;
    let mut text = Base64::new(out);
    // The length and the values are one text.
    text.write_all(&(grid.voxels() * numbers.bytes as u64).to_le_bytes())?;
    let found = work.labels_by(numbers, &mut text)?;
    text.finish()?;
    out.write_all(END_OF_DAMASK.as_bytes())?;
    Ok(found)
}

/// Writes AMITEX' numbers of materials.
pub(super) fn write_amitex(
    work: &Work<'_>,
    numbers: &Numbers,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let grid = work.bodies.grid;
    let [nx, ny, nz] = grid.shape.each(|n| n + 1);
    let [dx, dy, dz] = grid.spacing_mm;
    let head = [
        "# vtk DataFile Version 4.5\nMaterials of a packing by Packstone, mm\nBINARY\nDATASET STRUCTURED_POINTS\n",
        &format!("DIMENSIONS    {nx}   {ny}   {nz}\nORIGIN    0.000   0.000   0.000\n"),
        &format!("SPACING    {dx}   {dy}   {dz}\nCELL_DATA   {}\n", grid.voxels()),
        "SCALARS MaterialId unsigned_char\nLOOKUP_TABLE default\n",
    ];
    out.write_all(head.concat().as_bytes())?;
    let found = work.labels_by(numbers, out)?;
    let with_grains = || work.groups.all().zip(&found.of_aggregates).filter(|((_, grains), _)| *grains > 0);
    let empty = with_grains().find(|(_, voxels)| **voxels == 0).map(|((name, _), _)| name.to_owned());
    let empty = empty.or((found.aggregate == 0).then(|| "the aggregate".to_owned()));
    if let Some(phase) = empty {
        return Err(ExportError::Unavailable(format!(
            "{phase} has no voxel, and AMITEX reads no numbers with gaps: take more cells"
        )));
    }
    Ok(found)
}

/// Writes the array of numbers as NumPy's file, x fastest.
pub(super) fn write_npy(
    work: &Work<'_>,
    numbers: &Numbers,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    out.write_all(&npy::header(numbers.dtype(), &work.bodies.grid.shape))?;
    work.labels_by(numbers, out)
}

/// Writes the archive of FANS: the input, the array, and the script.
pub(super) fn write_fans(
    work: &Work<'_>,
    numbers: &Numbers,
    phases: &[PhaseMaterial<'_>],
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let input = fans_input(&moduli_gpa(phases)?, work.bodies.grid.size_mm);
    let mut archive = Archive::new(out, work.threads)?;
    for (name, text) in [("input.json", input.as_str()), ("make_h5.py", SCRIPT)] {
        let write = |_: usize, content: &mut Vec<u8>| {
            content.extend_from_slice(text.as_bytes());
            Ok(())
        };
        archive.add(name, Content { pieces: 1, most_bytes: text.len(), write, taken: |_| {} })?;
    }
    let found = archive.stream("microstructure.npy", |file| write_npy(work, numbers, file))?;
    archive.finish()?;
    Ok(found)
}

/// A uniaxial strain, and the whole stiffness.
fn fans_input(moduli_gpa: &[[f64; 2]], size_mm: [f64; 3]) -> String {
    let mpa = |which: usize| moduli_gpa.iter().map(|gpa| gpa[which] * MPA_PER_GPA).collect::<Vec<f64>>();
    let input = json!({
        "microstructure": {"filepath": HDF5_FILE, "datasetname": DATA_SET, "L": size_mm},
        "problem_type": "mechanical",
        "strain_type": "small",
        "materials": [{
            "phases": (0..moduli_gpa.len()).collect::<Vec<_>>(),
            "matmodel": "LinearElasticIsotropic",
            "material_properties": {"bulk_modulus": mpa(0), "shear_modulus": mpa(1)},
        }],
        "FE_type": "HEX8",
        "method": "cg",
        "error_parameters": {"measure": "Linfinity", "type": "relative", "tolerance": 1e-6},
        "n_it": 1000,
        "macroscale_loading": [[[1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]]],
        "results": ["homogenized_tangent", "stress_average", "strain_average", "absolute_error"],
    });
    // Plain values always have a JSON form.
    serde_json::to_string_pretty(&input).unwrap_or_default() + "\n"
}

/// Bytes of DAMASK's file, but for its head.
pub(super) fn damask_bytes(voxels: u64) -> u64 {
    super::base64::length(voxels.saturating_mul(size_of::<i64>() as u64).saturating_add(8))
}
