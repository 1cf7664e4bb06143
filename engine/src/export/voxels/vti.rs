//! VTK XML image data with raw appended arrays: cell data `label`, and `fraction` where it is asked for.

use std::io::Write;

use super::layers::Layers;
use super::{Found, Grid, Label, VoxelOptions, Watch, labels};
use crate::export::{ExportError, Model};
use crate::memory::filled;

/// Bytes of all arrays per voxel.
pub(super) fn bytes_per_voxel(options: &VoxelOptions) -> u64 {
    options.label.bytes() + if options.fractions { size_of::<f32>() as u64 } else { 0 }
}

pub(super) fn write(
    model: &Model<'_>,
    grid: &Grid,
    options: &VoxelOptions,
    watch: &Watch<'_>,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let [nx, ny, nz] = grid.shape;
    let [dx, dy, dz] = grid.spacing_mm;
    let label_type = match options.label {
        Label::Phase => "UInt8",
        Label::Grain => "UInt32",
    };
    let label_bytes = grid.voxels() * options.label.bytes();
    write!(
        out,
        r#"<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <ImageData WholeExtent="0 {nx} 0 {ny} 0 {nz}" Origin="0 0 0" Spacing="{dx} {dy} {dz}">
    <Piece Extent="0 {nx} 0 {ny} 0 {nz}">
      <CellData Scalars="label">
        <DataArray type="{label_type}" Name="label" format="appended" offset="0"/>
"#
    )?;
    if options.fractions {
        let offset = 8 + label_bytes;
        writeln!(
            out,
            r#"        <DataArray type="Float32" Name="fraction" format="appended" offset="{offset}"/>"#
        )?;
    }
    write!(
        out,
        r#"      </CellData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _"#
    )?;
    out.write_all(&label_bytes.to_le_bytes())?;
    let mut found = labels(model, grid, options.label, watch, out)?;
    if options.fractions {
        let bytes = grid.voxels() * size_of::<f32>() as u64;
        out.write_all(&bytes.to_le_bytes())?;
        found.sampled_mm3 = fractions(model, grid, options.samples, watch, out)?;
    }
    out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
    Ok(found)
}

/// Writes the voxels' shares of aggregate, and returns their volume.
fn fractions(
    model: &Model<'_>,
    grid: &Grid,
    samples: u32,
    watch: &Watch<'_>,
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
        watch.layer()?;
    }
    Ok(sum * grid.voxel_mm3())
}
