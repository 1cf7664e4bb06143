//! A packing in memory, and the files, figures and plots that are made of it.

use std::io::Write;
use std::path::Path;

use packstone_engine::export::picture::{self, PictureOptions};
use packstone_engine::export::tables::stored::StoredBytes;
use packstone_engine::export::tables::{self, EngineInfo, GrainSource as _, Head};
use packstone_engine::export::{ExportError, ExportReport, ExportRequest, ExportType, Model, Provenance};
use packstone_engine::{Grains, Limits, Packing, Report};
use serde_json::{Map, Value};

use super::{Ended, Run, named, refused, to_json, unknown};
use crate::atomic_file::write_buffered;
use crate::config::limits_of_one_packing;
use crate::exports::distance_kept;
use crate::failure::Failure;
use crate::formats::ResultFormat;
use crate::gmsh;
use crate::jobs::JobRequest;
use crate::plots::draw;
use crate::plots::job::{self, JobPlot, JobResult};
use crate::plots::theme::{Theme, themed};
use crate::strict_json;
use crate::studies::PropertyFacts;

/// What belongs beside the file of an export, if anything does, as the script that opens a mesh for Gmsh: what is
/// added to `file_name`, and the text. `options` are those of [`Packed::write_export`].
///
/// # Errors
/// [`Ended::Refused`] for options that do not hold.
pub fn companion(
    export: &str,
    options: &str,
    file_name: &str,
) -> Result<Option<(&'static str, String)>, Ended> {
    Ok(read_export(export, options)?.companion(file_name))
}

fn read_export(export: &str, options: &str) -> Result<ExportRequest, Ended> {
    let mut request = Map::from_iter([("type".to_owned(), Value::from(export))]);
    match strict_json::parse(options.as_bytes())? {
        Value::Object(options) => request.extend(options.into_iter().filter(|(name, _)| name != "type")),
        other => return Err(refused("", format!("{other} must be an object of options"))),
    }
    Ok(ExportRequest::from_json(&Value::Object(request)).map_err(Failure::invalid)?)
}

/// A packing with its report.
#[derive(Debug)]
pub struct Packed {
    head: Head,
    grains: Grains,
    limits: Limits,
}

impl Packed {
    pub(super) fn new(request: Value, packing: Packing, limits: Limits) -> Self {
        let head = Head { job_id: None, request, engine: EngineInfo::current(), report: packing.report };
        Self { head, grains: packing.grains, limits }
    }

    /// What is known about the packing.
    pub(super) fn of_engine(&self) -> &Report {
        &self.head.report
    }

    /// Number of grains.
    pub fn len(&self) -> usize {
        self.grains.len()
    }

    /// Whether there is no grain.
    pub fn is_empty(&self) -> bool {
        self.grains.is_empty()
    }

    /// Everything but the grains, as JSON: `request`, `engine` and the report.
    ///
    /// # Errors
    /// None that a packing causes.
    pub fn report(&self) -> Result<String, Ended> {
        to_json(&self.head)
    }

    /// Names of the columns of the grains, in the order of [`columns`](Self::columns).
    pub fn column_names(&self) -> Vec<&'static str> {
        self.grains.columns().iter().map(|column| column.name()).collect()
    }

    /// The columns of the grains, one after the other, and their number: those of the format `npy`.
    ///
    /// # Errors
    /// None that a packing causes.
    pub fn columns(&self) -> Result<(Vec<f64>, usize), Ended> {
        let columns = self.grains.columns();
        let mut values = vec![0.0; columns.len() * self.grains.len()];
        for (column, block) in columns.iter().zip(values.chunks_mut(self.grains.len().max(1))) {
            self.grains.read(*column, 0, block)?;
        }
        Ok((values, columns.len()))
    }

    /// Writes the grains in a format of that name: `html` is a page with a viewer.
    ///
    /// # Errors
    /// [`Ended::Refused`] for another name; [`Ended::Io`].
    pub fn write_table(&self, format: &str, out: &mut dyn Write) -> Result<(), Ended> {
        let format = ResultFormat::from_name(format)
            .ok_or_else(|| unknown("format", format, &ResultFormat::ALL.map(ResultFormat::name)))?;
        Ok(format.write(&self.head, &self.grains, out)?)
    }

    /// Writes an export of a type, as `mesh`, with `options` as a JSON object, its `format` among them; its report as
    /// JSON.
    ///
    /// # Errors
    /// [`Ended::Refused`] for options that do not hold, an export that there is not of such a packing, or that would
    /// be too large; [`Ended::Stopped`]; [`Ended::Io`].
    pub fn write_export(
        &self,
        export: &str,
        options: &str,
        run: &Run,
        out: &mut dyn Write,
    ) -> Result<String, Ended> {
        let export = read_export(export, options)?;
        to_json(&self.write(&self.request()?, &export, run, out)?)
    }

    /// Effective properties, of the exports that the request names.
    ///
    /// # Errors
    /// Those of the export.
    pub(super) fn properties(
        &self,
        request: &JobRequest,
        run: &Run,
    ) -> Result<Option<PropertyFacts>, ExportError> {
        let of_properties = request.exports().filter(|export| export.export_type() == ExportType::Properties);
        let reports = of_properties.map(|export| self.write(request, export, run, &mut std::io::sink()));
        Ok(PropertyFacts::of_reports(reports.collect::<Result<Vec<_>, _>>()?))
    }

    fn write(
        &self,
        request: &JobRequest,
        export: &ExportRequest,
        run: &Run,
        out: &mut dyn Write,
    ) -> Result<ExportReport, ExportError> {
        let provenance = Provenance::from(&self.head);
        let model = Model::new(&request.specimen, &self.grains)
            .with_distance(distance_kept(&self.head))
            .with_provenance(&provenance)
            .with_materials(request.materials.as_ref())
            .with_mesher(&gmsh::Installed);
        export.write(&model, &self.limits, run, out)
    }

    /// Writes a file in a format of that name, as [`write_table`](Self::write_table) does. Its name only ever stands
    /// for a whole file.
    ///
    /// # Errors
    /// As those of [`write_table`](Self::write_table); of a failure nothing is left.
    pub fn save_table(&self, format: &str, file: &Path) -> Result<(), Ended> {
        write_buffered(file, |out| self.write_table(format, out))
    }

    /// Writes an export as a file, as [`write_export`](Self::write_export) does. Its name only ever stands for a whole
    /// file.
    ///
    /// # Errors
    /// As those of [`write_export`](Self::write_export); of a failure nothing is left.
    pub fn save_export(&self, export: &str, options: &str, run: &Run, file: &Path) -> Result<String, Ended> {
        write_buffered(file, |out| self.write_export(export, options, run, out))
    }

    /// A plot of a kind, as `grading`, as SVG; `theme` is `light` or `dark`.
    ///
    /// # Errors
    /// [`Ended::Refused`] for another name, and for a plot that the packing has no data for.
    pub fn plot(&self, kind: &str, title: bool, theme: &str) -> Result<String, Ended> {
        let kind = named(JobPlot::ALL, JobPlot::name, "kind", kind)?;
        let theme = named(Theme::ALL, Theme::name, "theme", theme)?;
        let chart = job::chart(kind, &JobResult { head: &self.head, grains: &self.grains })?;
        Ok(themed(draw::svg(&chart, title)?, theme))
    }

    /// A picture of the packing as PNG: one octant of the specimen is removed. The longer edge has `pixels`, 64 to
    /// 8192; values outside are set to the bound.
    ///
    /// # Errors
    /// [`Ended::Stopped`].
    pub fn picture(&self, pixels: u32, run: &Run) -> Result<Vec<u8>, Ended> {
        let request = self.request()?;
        let options = PictureOptions { pixels, threads: self.limits.export_threads.get() };
        let mut png = Vec::new();
        picture::write(&Model::new(&request.specimen, &self.grains), &options, run, &mut png)?;
        Ok(png)
    }

    /// The packing as bytes, from which [`restore`](Self::restore) makes it again: the stored form of the service.
    ///
    /// # Errors
    /// None that a packing causes.
    pub fn store(&self) -> Result<Vec<u8>, Ended> {
        let mut stored = Vec::new();
        tables::stored::write(&self.head, &self.grains, &mut stored)?;
        Ok(stored)
    }

    /// Reads what [`store`](Self::store) wrote.
    ///
    /// # Errors
    /// [`Ended::Io`] for bytes that are no stored packing.
    pub fn restore(stored: &[u8]) -> Result<Self, Ended> {
        let stored = StoredBytes::read(stored)?;
        let grains = tables::load(&stored)?;
        let limits = limits_of_one_packing(Limits::default().max_grains);
        Ok(Self { head: stored.into_head(), grains, limits })
    }

    fn request(&self) -> Result<JobRequest, Ended> {
        Ok(JobRequest::read(&self.head.request, 0, None).map_err(Failure::invalid)?)
    }
}
