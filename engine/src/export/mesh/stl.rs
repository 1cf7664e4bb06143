//! STL, a file for each phase in one zip: `aggregates.stl`, or one for each of several aggregates, and `matrix.stl`.
//!
//! The matrix is bounded by the specimen's faces and, turned inside out, by the grains; both files are closed
//! and their normals point outwards. Binary STL has single precision, about 1e-5 mm in a specimen of 150 mm.

use std::io::{BufWriter, Write};

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipWriter};

use super::surface::{cross, dot};
use super::{GRAINS_PER_LOOK, Mesh};
use super::{SurfaceOptions, SurfaceReport};
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::Specimen;

/// Most triangles of an STL file: their number has 32 bits.
const MAX_TRIANGLES: usize = u32::MAX as usize;

/// Judges what can be judged before there are grains.
///
/// # Errors
/// [`ExportError::Unavailable`] for a periodic box.
pub fn check(specimen: &Specimen, _: &SurfaceOptions, _: &Limits) -> Result<(), ExportError> {
    super::check(specimen)
}

/// Writes the zip.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    model: &Model<'_>,
    options: &SurfaceOptions,
    limits: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<SurfaceReport, ExportError> {
    let (mesh, report) = Mesh::new(model, options, limits, control)?;
    let shell = &mesh.shell.surface;
    if shell.triangles.len() + mesh.grain_triangles() > MAX_TRIANGLES {
        return Err(ExportError::Unavailable(
            "STL counts triangles with 32 bits: lower segments, or ask for msh".into(),
        ));
    }
    let mut zip = ZipWriter::new_stream(out);
    let groups = AggregateGroups::of(model);
    let parts: Vec<(Option<usize>, &str)> = if groups.is_empty() {
        vec![(None, "aggregates")]
    } else {
        groups.with_grains().map(|(number, name)| (Some(number), name)).collect()
    };
    for (aggregate, name) in parts {
        let is_in = |row: &usize| aggregate.is_none_or(|number| groups.of_grain(*row) == number);
        let rows = || (0..mesh.grains()).filter(is_in);
        start(&mut zip, &format!("{name}.stl"))?;
        let triangles = rows().map(|row| mesh.grain(row).1.len()).sum();
        let mut stl = Stl::new(&mut zip, name, triangles)?;
        stl.grains(&mesh, rows(), false, control)?;
        stl.out.flush()?;
    }
    start(&mut zip, "matrix.stl")?;
    let mut stl = Stl::new(&mut zip, "matrix", shell.triangles.len() + mesh.grain_triangles())?;
    for corners in &shell.triangles {
        stl.triangle(corners.map(|p| shell.points[p as usize]))?;
    }
    stl.grains(&mesh, 0..mesh.grains(), true, control)?;
    stl.out.flush()?;
    drop(stl);
    zip.finish().map_err(failed)?;
    super::report_progress(control, mesh.grains(), mesh.grains());
    Ok(report)
}

type Zip<'a> = ZipWriter<StreamWriter<&'a mut dyn Write>>;

fn start(zip: &mut Zip<'_>, name: &str) -> Result<(), ExportError> {
    let deflated = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .compression_level(Some(1))
        .large_file(true);
    zip.start_file(name, deflated).map_err(failed)
}

fn failed(error: zip::result::ZipError) -> ExportError {
    ExportError::Write(error.into())
}

struct Stl<W: Write> {
    out: BufWriter<W>,
}

impl<W: Write> Stl<W> {
    fn new(out: W, name: &str, triangles: usize) -> Result<Self, ExportError> {
        let mut out = BufWriter::with_capacity(1 << 16, out);
        // The header must not begin with "solid", which would announce text.
        out.write_all(format!("{:<80.80}", format!("packstone {name}, mm")).as_bytes())?;
        out.write_all(&(triangles as u32).to_le_bytes())?;
        Ok(Self { out })
    }

    fn grains(
        &mut self,
        mesh: &Mesh,
        rows: impl Iterator<Item = usize>,
        inside_out: bool,
        control: &dyn Control,
    ) -> Result<(), ExportError> {
        for row in rows {
            if row % GRAINS_PER_LOOK == 0 {
                go_on(control)?;
            }
            let (points, triangles) = mesh.grain(row);
            for corners in triangles {
                let [a, b, c] = corners.map(|p| points[p as usize]);
                self.triangle(if inside_out { [a, c, b] } else { [a, b, c] })?;
            }
        }
        Ok(())
    }

    fn triangle(&mut self, [a, b, c]: [[f64; 3]; 3]) -> Result<(), ExportError> {
        let from_a = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] - a[i]);
        let normal = cross(from_a(b), from_a(c));
        let length = dot(normal, normal).sqrt();
        let mut record = [0_u8; 50];
        let numbers = [normal.map(|x| x / length), a, b, c];
        for (bytes, x) in record.chunks_exact_mut(4).zip(numbers.iter().flatten()) {
            bytes.copy_from_slice(&(*x as f32).to_le_bytes());
        }
        Ok(self.out.write_all(&record)?)
    }
}
