//! VTK XML image data with raw appended arrays: cell data `label`, and `fraction` where it is asked for.

use std::io::Write;

use super::numbers::Numbers;
use super::pass::{Found, Work};
use super::{Label, VoxelOptions};
use crate::export::vtk_xml::{Sink, VtkXml};
use crate::export::{ExportError, Provenance};

/// Bytes of all arrays per voxel.
pub(super) fn bytes_per_voxel(options: &VoxelOptions) -> u64 {
    options.label.bytes() + if options.fractions { size_of::<f32>() as u64 } else { 0 }
}

pub(super) fn write(
    work: &Work<'_>,
    provenance: Option<&Provenance>,
    options: &VoxelOptions,
    numbers: &Numbers,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let grid = work.bodies.grid;
    let [nx, ny, nz] = grid.shape;
    let [dx, dy, dz] = grid.spacing_mm;
    let extent = format!("0 {nx} 0 {ny} 0 {nz}");
    let attributes = [
        ("WholeExtent", extent.clone()),
        ("Origin", "0 0 0".to_owned()),
        ("Spacing", format!("{dx} {dy} {dz}")),
    ];
    let voxels = grid.voxels() as usize;
    let (mut found, mut sampled_mm3) = (Found::default(), 0.0);
    let mut file = VtkXml::new("ImageData", &attributes, &[("Extent", extent)], provenance);
    file.section("CellData", Some("label"));
    let fill_labels = |sink: &mut Sink<'_>| {
        found = work.labels_by(numbers, sink)?;
        Ok(())
    };
    match options.label {
        Label::Phase | Label::Aggregate => file.fill::<u8>("label", voxels, fill_labels),
        Label::Grain => file.fill::<u32>("label", voxels, fill_labels),
    }
    if options.fractions {
        file.fill::<f32>("fraction", voxels, |sink| {
            sampled_mm3 = work.shares(options.samples, sink)?;
            Ok(())
        });
    }
    // The layers report progress, and say whether to go on.
    file.write(out, &mut |_| Ok(()))?;
    Ok(Found { sampled_mm3, ..found })
}
