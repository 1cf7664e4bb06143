//! The types of exports, and dispatch to the module of each.

use std::io::Write;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{ExportError, Model};
use super::{certificates, deck, ldpm, mesh, properties, quality, shapes, slice, voxels};
use crate::analysis::quality::QualityReport;
use crate::checkpoint::Resume;
use crate::control::Control;
use crate::plan::{ClassPlan, Limits, Plan};
use crate::request::decode::{At, Faults, Object};
use crate::request::{FieldError, GrainKind, Materials, PackingRequest, Specimen};

/// What can be made of a finished packing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum ExportType {
    /// Surfaces of grains and specimen.
    Mesh,
    /// A voxel model: labels, or hexahedra.
    Voxels,
    /// A plane cross-section.
    Slice,
    /// A model that a finite element program runs: mesh, materials, supports, a load.
    Deck,
    /// A lattice discrete particle model, checked.
    Ldpm,
    /// Proofs that close pairs of grains do not overlap.
    Certificates,
    /// Sizes, ratios, sphericity and roundness of each grain.
    Shapes,
    /// Whether the packing is random: contacts, bond order, walls and blocks by size.
    Quality,
    /// Effective stiffness, thermal expansion and conductivity, with bounds.
    Properties,
}

impl ExportType {
    /// All types, in the order of the documentation.
    pub const ALL: [Self; 9] = [
        Self::Mesh,
        Self::Voxels,
        Self::Slice,
        Self::Deck,
        Self::Ldpm,
        Self::Certificates,
        Self::Shapes,
        Self::Quality,
        Self::Properties,
    ];

    /// Its name in requests and addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh",
            Self::Voxels => "voxels",
            Self::Slice => "slice",
            Self::Deck => "deck",
            Self::Ldpm => "ldpm",
            Self::Certificates => "certificates",
            Self::Shapes => "shapes",
            Self::Quality => "quality",
            Self::Properties => "properties",
        }
    }

    /// The type of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|export| export.name() == name)
    }

    /// Names of its file formats, the default first.
    pub fn formats(self) -> &'static [&'static str] {
        match self {
            Self::Mesh => &mesh::FORMATS,
            Self::Voxels => &["vti", "raw", "inp", "npy", "vtk", "zip"],
            Self::Slice => &["svg", "png", "json", "geo", "msh", "inp", "vtu"],
            Self::Deck => &["zip"],
            Self::Ldpm => &["chrono", "tets", "facets", "cells"],
            Self::Certificates | Self::Shapes => &["csv", "json"],
            Self::Quality => &["json"],
            Self::Properties => &["json", "vti"],
        }
    }

    /// The programs that the option `for` may name in that format; none where the format has no such option.
    pub fn programs(self, format: &str) -> Vec<&'static str> {
        let readers = voxels::Reader::ALL.into_iter().filter(|reader| reader.format().name() == format);
        readers.filter(|_| self == Self::Voxels).map(voxels::Reader::name).collect()
    }

    /// The program that `for` must name in that format, where it is written for one program alone.
    pub fn needed_program(self, format: &str) -> Option<&'static str> {
        let format = voxels::VoxelFormat::ALL.into_iter().find(|known| known.name() == format)?;
        format.program().filter(|_| self == Self::Voxels).map(voxels::Reader::name)
    }

    /// The fewest options that request that format.
    pub fn options_of_format(self, format: &str) -> Vec<(&'static str, &str)> {
        let program = self.needed_program(format).map(|program| ("for", program));
        [("format", format)].into_iter().chain(program).collect()
    }

    /// Names of the options that it has in that format, beside `format` itself.
    pub fn option_names(self, format: &str) -> Vec<&'static str> {
        let options = self.options_of_format(format).into_iter();
        let value = Value::Object(options.map(|(name, text)| (name.to_owned(), text.into())).collect());
        let faults = Faults::default();
        let mut names = At::root(&value, &faults).object().map_or_else(Vec::new, |mut object| {
            self.read_options(&mut object);
            object.known().to_vec()
        });
        names.retain(|name| *name != "format");
        names
    }

    fn read_options(self, object: &mut Object<'_>) -> Option<ExportRequest> {
        match self {
            Self::Mesh => mesh::MeshRequest::read(object).map(ExportRequest::Mesh),
            Self::Voxels => voxels::VoxelOptions::read(object).map(ExportRequest::Voxels),
            Self::Slice => slice::SliceOptions::read(object).map(ExportRequest::Slice),
            Self::Deck => deck::DeckOptions::read(object).map(ExportRequest::Deck),
            Self::Ldpm => ldpm::LatticeOptions::read(object).map(ExportRequest::Ldpm),
            Self::Certificates => {
                certificates::CertificateOptions::read(object).map(ExportRequest::Certificates)
            }
            Self::Shapes => shapes::ShapeTableOptions::read(object).map(ExportRequest::Shapes),
            Self::Quality => quality::QualityOptions::read(object).map(ExportRequest::Quality),
            Self::Properties => properties::PropertyOptions::read(object).map(ExportRequest::Properties),
        }
    }
}

/// An export: its type, its file format and the options of both.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ExportRequest {
    /// Surfaces of grains and specimen.
    Mesh(mesh::MeshRequest),
    /// A voxel model.
    Voxels(voxels::VoxelOptions),
    /// A plane cross-section.
    Slice(slice::SliceOptions),
    /// A model that a finite element program runs.
    Deck(deck::DeckOptions),
    /// A lattice discrete particle model, checked.
    Ldpm(ldpm::LatticeOptions),
    /// Proofs that close pairs of grains do not overlap.
    Certificates(certificates::CertificateOptions),
    /// Sizes, ratios, sphericity and roundness of each grain.
    Shapes(shapes::ShapeTableOptions),
    /// Whether the packing is random.
    Quality(quality::QualityOptions),
    /// Effective stiffness, thermal expansion and conductivity, with bounds.
    Properties(properties::PropertyOptions),
}

/// The figures of an export, beside its file.
// There is one of them at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ExportReport {
    /// Surfaces of grains and specimen.
    Mesh(mesh::MeshReport),
    /// A voxel model.
    Voxels(voxels::VoxelReport),
    /// A plane cross-section.
    Slice(slice::SliceReport),
    /// A model that a finite element program runs.
    Deck(deck::DeckReport),
    /// A lattice discrete particle model.
    Ldpm(ldpm::LatticeReport),
    /// Proofs that close pairs of grains do not overlap.
    Certificates(certificates::CertificateReport),
    /// Sizes, ratios, sphericity and roundness of each grain.
    Shapes(shapes::ShapeTableReport),
    /// Whether the packing is random.
    Quality(QualityReport),
    /// Effective stiffness, thermal expansion and conductivity, with bounds.
    Properties(Box<properties::PropertyReport>),
}

impl ExportReport {
    /// The type of export that it is of.
    pub fn export_type(&self) -> ExportType {
        match self {
            Self::Mesh(_) => ExportType::Mesh,
            Self::Voxels(_) => ExportType::Voxels,
            Self::Slice(_) => ExportType::Slice,
            Self::Deck(_) => ExportType::Deck,
            Self::Ldpm(_) => ExportType::Ldpm,
            Self::Certificates(_) => ExportType::Certificates,
            Self::Shapes(_) => ExportType::Shapes,
            Self::Quality(_) => ExportType::Quality,
            Self::Properties(_) => ExportType::Properties,
        }
    }

    /// What is missing of the export, in words.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Mesh(report) => report.warnings(),
            Self::Deck(report) => &report.warnings,
            Self::Slice(slice::SliceReport { triangles: Some(triangles), .. }) => &triangles.warnings,
            _ => &[],
        }
    }
}

/// What an export is likely to come out as.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ExportEstimate {
    /// Length of the file.
    pub bytes: u64,
    /// The triangles of a surface mesh; absent for everything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub mesh: Option<mesh::MeshEstimate>,
    /// Memory and time that properties take; absent for everything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub computation: Option<ComputationEstimate>,
    /// What is likely to go wrong, in words.
    #[serde(default)]
    pub warnings: Vec<String>,
}

/// What a computation is likely to take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ComputationEstimate {
    /// Memory at most, in bytes.
    pub memory_bytes: u64,
    /// CPU time in s, within a factor of three.
    pub cpu_s: f64,
}

/// Number and sizes of grains, for estimates.
struct Sizes {
    number: f64,
    sum_mm: f64,
    least_mm: f64,
    kind: GrainKind,
    interfaces: voxels::Interfaces,
}

impl ExportRequest {
    /// Its type.
    pub fn export_type(&self) -> ExportType {
        match self {
            Self::Mesh(_) => ExportType::Mesh,
            Self::Voxels(_) => ExportType::Voxels,
            Self::Slice(_) => ExportType::Slice,
            Self::Deck(_) => ExportType::Deck,
            Self::Ldpm(_) => ExportType::Ldpm,
            Self::Certificates(_) => ExportType::Certificates,
            Self::Shapes(_) => ExportType::Shapes,
            Self::Quality(_) => ExportType::Quality,
            Self::Properties(_) => ExportType::Properties,
        }
    }

    /// Name of its file format.
    pub fn format(&self) -> &'static str {
        match self {
            Self::Mesh(mesh) => mesh.format(),
            Self::Voxels(options) => options.format.name(),
            Self::Slice(options) => options.cut.format.name(),
            Self::Deck(options) => options.case.format.name(),
            Self::Ldpm(options) => options.format.name(),
            Self::Certificates(options) => options.format.name(),
            Self::Shapes(options) => options.format.name(),
            Self::Quality(options) => options.format.name(),
            Self::Properties(options) => options.format.name(),
        }
    }

    /// Judges what can be judged before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`], [`ExportError::Unavailable`] or [`ExportError::TooLarge`].
    pub fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        let limits = &of_exports(limits);
        match self {
            Self::Mesh(mesh) => mesh.check(specimen),
            Self::Voxels(options) => voxels::check(specimen, options, limits),
            Self::Slice(options) => slice::check(specimen, options, limits),
            Self::Deck(options) => deck::check(specimen, options, limits),
            Self::Ldpm(options) => ldpm::check(specimen, options, limits),
            Self::Properties(options) => properties::check(specimen, options, limits),
            Self::Certificates(_) | Self::Shapes(_) | Self::Quality(_) => Ok(()),
        }
    }

    /// Says how long the file of a packing will be, before it is made: exactly for voxels (within some percent for
    /// hexahedra), within a factor of 1.5 for surface meshes.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where it cannot be made of such a specimen.
    pub fn estimate(&self, model: &Model<'_>) -> Result<ExportEstimate, ExportError> {
        let diameters_mm = || model.grains.diameters_mm();
        let grains = Sizes {
            number: model.grains.len() as f64,
            sum_mm: diameters_mm().sum(),
            least_mm: diameters_mm().fold(f64::INFINITY, f64::min),
            kind: model.grains.kind(),
            interfaces: voxels::Interfaces::of(
                model.specimen,
                diameters_mm().map(|d| (1.0, d)),
                !model.grains.aggregate().is_empty(),
            ),
        };
        match self {
            Self::Mesh(mesh) => mesh.estimate(model).map(|(bytes, mesh)| ExportEstimate {
                bytes,
                mesh,
                computation: None,
                warnings: Vec::new(),
            }),
            Self::Deck(deck::DeckOptions { mesh: deck::DeckMesh::Tetrahedra(own), .. }) => {
                let (bytes, mesh) = own.alone().estimate(model)?;
                let bytes = bytes / deck::DEFLATED;
                Ok(ExportEstimate { bytes, mesh, computation: None, warnings: Vec::new() })
            }
            other => Ok(other.estimate_of(model.specimen, model.materials, &grains)),
        }
    }

    /// Says how long the file will be by the plan of a packing, and what is likely to go wrong. Of surface meshes the
    /// figure is right within a factor of two, for the gaps between grains are known by their statistics alone.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where it cannot be made of such a specimen.
    pub fn estimate_from_plan(
        &self,
        request: &PackingRequest,
        plan: &Plan,
    ) -> Result<ExportEstimate, ExportError> {
        if let Self::Mesh(mesh) = self {
            let (bytes, mesh, warnings) = mesh.estimate_from_plan(request, plan)?;
            return Ok(ExportEstimate { bytes, mesh, computation: None, warnings });
        }
        if let Self::Deck(deck::DeckOptions { mesh: deck::DeckMesh::Tetrahedra(own), .. }) = self {
            let (bytes, mesh, warnings) = own.alone().estimate_from_plan(request, plan)?;
            let bytes = bytes / deck::DEFLATED;
            return Ok(ExportEstimate { bytes, mesh, computation: None, warnings });
        }
        let mean = |class: &ClassPlan| (class.d_min_mm * class.d_max_mm).sqrt();
        let grains = Sizes {
            number: plan.grains,
            sum_mm: plan.classes.iter().map(|class| class.grains * mean(class)).sum(),
            least_mm: plan.classes.first().map_or(1.0, |class| class.d_min_mm),
            kind: request.mix.grain_kind(),
            interfaces: voxels::Interfaces::of(
                &request.specimen,
                plan.classes.iter().map(|class| (class.grains, mean(class))),
                !request.mix.aggregates.is_empty(),
            ),
        };
        Ok(self.estimate_of(&request.specimen, request.materials.as_ref(), &grains))
    }

    /// What properties take.
    fn computation(&self, specimen: &Specimen, materials: Option<&Materials>) -> Option<ComputationEstimate> {
        let Self::Properties(options) = self else { return None };
        Some(ComputationEstimate {
            memory_bytes: properties::memory_bytes(specimen, materials, options, 1),
            cpu_s: properties::cpu_s(specimen, materials, options),
        })
    }

    fn estimate_of(
        &self,
        specimen: &Specimen,
        materials: Option<&Materials>,
        grains: &Sizes,
    ) -> ExportEstimate {
        let bytes = match self {
            Self::Mesh(_) => 0,
            Self::Voxels(options) => voxels::expected_bytes(specimen, options, &grains.interfaces),
            Self::Slice(options) => slice::expected_bytes(specimen, options, grains.sum_mm, grains.kind),
            Self::Deck(options) => deck::expected_bytes(specimen, options, grains.sum_mm, grains.kind),
            Self::Ldpm(options) => ldpm::expected_bytes(specimen, options, grains.number, grains.least_mm),
            Self::Certificates(_) => certificates::expected_bytes(grains.number),
            Self::Shapes(_) => shapes::expected_bytes(grains.number),
            Self::Quality(_) => quality::expected_bytes(),
            Self::Properties(options) => properties::expected_bytes(specimen, materials, options),
        };
        ExportEstimate {
            bytes,
            mesh: None,
            computation: self.computation(specimen, materials),
            warnings: Vec::new(),
        }
    }

    /// Whether it takes less than a second for every packing, so that it need not wait behind exports that take
    /// minutes.
    pub fn is_quick(&self) -> bool {
        matches!(self, Self::Slice(options) if options.triangles.is_none())
    }

    /// Whether it needs [`Model::mesher`].
    pub fn needs_mesher(&self) -> bool {
        match self {
            Self::Mesh(mesh) => mesh.tetrahedra().is_some(),
            Self::Slice(options) => options.triangles.is_some(),
            Self::Deck(options) => !matches!(options.mesh, deck::DeckMesh::Voxels(_)),
            _ => false,
        }
    }

    /// What a checkpoint of the export of a packing belongs to; none where it keeps no checkpoints.
    pub fn checkpoint_identity(&self, model: &Model<'_>) -> Option<Vec<u8>> {
        match self {
            Self::Properties(options) => properties::checkpoint_identity(model, options),
            _ => None,
        }
    }

    /// Writes the file.
    ///
    /// # Errors
    /// See [`ExportError`].
    pub fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<ExportReport, ExportError> {
        self.write_or_resume(model, limits, None, control, out)
    }

    /// Writes the file, going on from a checkpoint of the same export where there is one: its bytes are the same.
    ///
    /// # Errors
    /// See [`ExportError`].
    pub fn write_or_resume(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        resume: Option<Resume>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<ExportReport, ExportError> {
        let limits = &of_exports(limits);
        match self {
            Self::Mesh(mesh) => mesh.write(model, limits, control, out).map(ExportReport::Mesh),
            Self::Voxels(options) => {
                voxels::write(model, options, limits, control, out).map(ExportReport::Voxels)
            }
            Self::Slice(options) => {
                slice::write(model, options, limits, control, out).map(ExportReport::Slice)
            }
            Self::Deck(options) => deck::write(model, options, limits, control, out).map(ExportReport::Deck),
            Self::Ldpm(options) => ldpm::write(model, options, limits, control, out).map(ExportReport::Ldpm),
            Self::Certificates(options) => {
                certificates::write(model, options, limits, control, out).map(ExportReport::Certificates)
            }
            Self::Shapes(options) => shapes::write(model, options, control, out).map(ExportReport::Shapes),
            Self::Quality(_) => quality::write(model, limits, control, out).map(ExportReport::Quality),
            Self::Properties(options) => properties::write(model, options, limits, resume, control, out)
                .map(|report| ExportReport::Properties(Box::new(report))),
        }
    }

    /// Reads an object with a `type`, a `format` and options.
    ///
    /// `None` means that faults were reported; the reverse does not hold, so ask the faults.
    pub fn read(at: &At<'_>) -> Option<Self> {
        let choices = ExportType::ALL.map(|export| (export.name(), export));
        let mut object = at.object()?;
        let export = object.variant(&choices)?;
        let read = export.read_options(&mut object);
        object.finish();
        read
    }

    /// Reads a document.
    ///
    /// # Errors
    /// All its faults, each with its pointer.
    pub fn from_json(value: &Value) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let read = Self::read(&At::root(value, &faults));
        Self::without_faults(read, faults)
    }

    /// Reads options that came as text, as `segments=16` does in a query or on a command line: what looks like a
    /// number, `true`, `false`, an object or an array is one.
    ///
    /// # Errors
    /// All faults, the pointer of each beginning with the name of its option.
    pub fn from_text<'a>(
        export: ExportType,
        options: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, Vec<FieldError>> {
        let mut map = Map::new();
        let faults = Faults::default();
        for (name, text) in options {
            if map.insert(name.to_owned(), value_of(text)).is_some() {
                faults.add(pointer_to(name), "is given more than once: must be given once");
            }
        }
        let value = Value::Object(map);
        let read = At::root(&value, &faults).object().and_then(|mut object| {
            let read = export.read_options(&mut object);
            object.finish_as("option", export.name());
            read
        });
        Self::without_faults(read, faults)
    }

    fn without_faults(read: Option<Self>, faults: Faults) -> Result<Self, Vec<FieldError>> {
        match read {
            Some(read) if faults.count() == 0 => Ok(read),
            _ => Err(faults.into_vec()),
        }
    }

    /// Media type of what is written, without parameters.
    pub fn media_type(&self) -> &'static str {
        match self {
            Self::Mesh(mesh) => mesh.media_type(),
            Self::Voxels(options) => options.format.media_type(),
            Self::Slice(options) => options.cut.format.media_type(),
            Self::Deck(options) => options.case.format.media_type(),
            Self::Ldpm(options) => options.format.media_type(),
            Self::Certificates(options) => options.format.media_type(),
            Self::Shapes(options) => options.format.media_type(),
            Self::Quality(options) => options.format.media_type(),
            Self::Properties(options) => options.format.media_type(),
        }
    }

    /// Ending of the name of a file that holds it.
    pub fn file_extension(&self) -> &'static str {
        match self {
            Self::Mesh(mesh) => mesh.file_extension(),
            Self::Voxels(options) => options.format.name(),
            Self::Slice(options) => options.cut.format.name(),
            Self::Deck(options) => options.case.format.name(),
            Self::Ldpm(options) => options.format.extension(),
            Self::Certificates(options) => options.format.name(),
            Self::Shapes(options) => options.format.name(),
            Self::Quality(options) => options.format.name(),
            Self::Properties(options) => options.format.name(),
        }
    }

    /// Ending of the name of a file that holds it. It tells exports of one packing apart: after the type or format come
    /// the options that differ from the defaults, as in `msh`, `size_mm-0.5.msh`, `grain.vti`, `slice.x.at_mm-20.svg`,
    /// `ldpm.tets.vtu`, `tetrahedra.order-2.inp`, `deck.triangles.plane-strain.zip`.
    pub fn file_ending(&self) -> String {
        let extension = self.file_extension();
        let mut parts = match self {
            Self::Mesh(_) if extension == "zip" => vec![self.format().to_owned()],
            Self::Mesh(mesh) if mesh.tetrahedra().is_some() => vec!["tetrahedra".to_owned()],
            Self::Mesh(_) => Vec::new(),
            Self::Voxels(options) => options.reader.iter().map(|reader| reader.name().to_owned()).collect(),
            Self::Slice(_) => vec!["slice".to_owned()],
            Self::Deck(options) => match options.mesh.elements() {
                deck::DeckElements::Voxels => vec!["deck".to_owned()],
                elements => vec!["deck".to_owned(), elements.name().to_owned()],
            },
            Self::Ldpm(_) => vec!["ldpm".to_owned(), self.format().to_owned()],
            Self::Certificates(_) => vec!["certificates".to_owned()],
            Self::Shapes(_) => vec!["shapes".to_owned()],
            Self::Quality(_) => vec!["quality".to_owned()],
            Self::Properties(_) => vec!["properties".to_owned()],
        };
        parts.extend(self.chosen_options());
        parts.push(extension.to_owned());
        parts.join(".")
    }

    /// The options that differ from the defaults of the type and format, as parts of a name.
    fn chosen_options(&self) -> Vec<String> {
        let of_format = match self {
            Self::Voxels(options) => options.reader.map(|reader| ("for", reader.name())),
            Self::Deck(options) => Some(("elements", options.mesh.elements().name())),
            _ => None,
        };
        let default = Self::from_text(self.export_type(), [of_format.unwrap_or(("format", self.format()))]);
        let (Ok(Value::Object(own)), Ok(Ok(Value::Object(default)))) =
            (serde_json::to_value(self), default.map(serde_json::to_value))
        else {
            return Vec::new();
        };
        let follows = |name: &str, value: &Value| match (self, name) {
            // Four times the segments and half the fictitious diameter come with those.
            (Self::Mesh(mesh), "max_segments") => mesh.has_default_max_segments(),
            (Self::Deck(options), "max_segments") => options.mesh.has_default_max_segments(),
            // The name says that there are tetrahedra; they are of the first order where it does not say which.
            (Self::Mesh(_), "elements") => true,
            (Self::Mesh(_), "order") => value.as_u64() == Some(1),
            // Comes with the load.
            (Self::Deck(_), "temperature_change_k") => value == deck::DEFAULT_TEMPERATURE_CHANGE_K,
            (Self::Ldpm(options), "surface_radius") => {
                value.as_f64().is_some_and(|radius| radius * 2.0 == options.fictitious_diameter)
            }
            _ => false,
        };
        own.iter()
            .filter(|(name, value)| default.get(*name) != Some(*value) && !follows(name, value))
            .map(|(name, value)| match (name.as_str(), value) {
                ("label" | "axis" | "load" | "solver", Value::String(text)) => text.clone(),
                ("materials", _) => format!("{name}-{}", self.digits_of_materials()),
                (_, Value::String(text)) => format!("{name}-{}", text.replace(',', "-")),
                _ => format!("{name}-{value}"),
            })
            .collect()
    }

    /// A second file that the program which reads the export needs beside it, where it needs one: the ending that the
    /// name of the first file gets, and the text.
    pub fn companion(&self, file_name: &str) -> Option<(&'static str, String)> {
        match self {
            Self::Mesh(mesh @ mesh::MeshRequest::Msh(_)) if mesh.tetrahedra().is_none() => {
                Some(("geo", mesh::msh::script(file_name)))
            }
            _ => None,
        }
    }
}

/// The limits of exports in the place where the modules of the types read them.
fn of_exports(limits: &Limits) -> Limits {
    Limits { max_memory_bytes: limits.max_model_bytes, ..*limits }
}

/// What a text stands for in JSON.
fn value_of(text: &str) -> Value {
    let looks_like_json =
        text.starts_with(|c: char| "{[-0123456789".contains(c)) || text == "true" || text == "false";
    let parsed = looks_like_json.then(|| serde_json::from_str(text).ok()).flatten();
    parsed.unwrap_or_else(|| Value::String(text.to_owned()))
}

fn pointer_to(name: &str) -> String {
    format!("/{}", name.replace('~', "~0").replace('/', "~1"))
}

#[cfg(test)]
#[path = "catalog_tests.rs"]
mod tests;
