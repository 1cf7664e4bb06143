//! VTK XML image data with raw appended arrays: cell data `label`, and `fraction` where it is asked for.

use std::io::Write;

use super::layers::Layers;
use super::{Found, Label, LayerSteps, VoxelGrid, VoxelOptions, labels};
use crate::export::vtk_xml::{Sink, VtkXml};
use crate::export::{ExportError, Model};
use crate::memory::filled;

/// Bytes of all arrays per voxel.
pub(super) fn bytes_per_voxel(options: &VoxelOptions) -> u64 {
    options.label.bytes() + if options.fractions { size_of::<f32>() as u64 } else { 0 }
}

pub(super) fn write(
    model: &Model<'_>,
    grid: &VoxelGrid,
    options: &VoxelOptions,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
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
    let mut file = VtkXml::new("ImageData", &attributes, &[("Extent", extent)], model.provenance);
    file.section("CellData", Some("label"));
    let fill_labels = |sink: &mut Sink<'_>| {
        found = labels(model, grid, options.label, layers_done, sink)?;
        Ok(())
    };
    match options.label {
        Label::Phase | Label::Aggregate => file.fill::<u8>("label", voxels, fill_labels),
        Label::Grain => file.fill::<u32>("label", voxels, fill_labels),
    }
    if options.fractions {
        file.fill::<f32>("fraction", voxels, |sink| {
            sampled_mm3 = fractions(model, grid, options.samples, layers_done, sink)?;
            Ok(())
        });
    }
    // The layers report progress, and say whether to go on.
    file.write(out, &mut |_| Ok(()))?;
    Ok(Found { sampled_mm3, ..found })
}

/// Writes the voxels' shares of aggregate, and returns their volume.
fn fractions(
    model: &Model<'_>,
    grid: &VoxelGrid,
    samples: u32,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<f64, ExportError> {
    let mut layers = Layers::new(model, grid)?;
    let mut layer = filled(grid.shape[0] * grid.shape[1], 0.0_f32)?;
    let mut bytes = filled(layer.len(), [0; 4])?;
    let mut sum = 0.0;
    for k in 0..grid.shape[2] {
        layer.fill(0.0);
        layers.fill_shares(k, samples, &mut layer);
        for (bytes, share) in bytes.iter_mut().zip(&mut layer) {
            // Grains that touch may overlap by a digit of rounding.
            *share = share.min(1.0);
            *bytes = share.to_le_bytes();
        }
        sum += layer.iter().map(|share| f64::from(*share)).sum::<f64>();
        out.write_all(bytes.as_flattened())?;
        layers_done.next()?;
    }
    Ok(sum * grid.voxel_mm3())
}
