//! The table of the types of exports, and dispatch to the module of each.

use std::io::Write;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::estimate::{Expected, ExportEstimate};
use super::kind::{Export, Made};
use super::materials::{chosen, phases};
use super::{ExportError, Model};
use super::{certificates, deck, ldpm, mesh, properties, quality, shapes, slice, voxels};
use crate::analysis::quality::QualityReport;
use crate::checkpoint::Resume;
use crate::control::Control;
use crate::plan::{Limits, Plan};
use crate::request::decode::{At, Faults, Object, pointer_segment};
use crate::request::{FieldError, Materials, PackingRequest, Specimen};

/// Makes the types of a table of exports: for each its name in the code, the options that implement [`Export`], and the
/// report, which may be boxed.
macro_rules! exports {
    ($($(#[$doc:meta])* $kind:ident: $options:ty => $report:ty,)*) => {
        /// What can be made of a finished packing.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(rename_all = "snake_case")]
        pub enum ExportType {
            $($(#[$doc])* $kind,)*
        }

        /// An export: its type, its file format and the options of both.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum ExportRequest {
            $($(#[$doc])* $kind($options),)*
        }

        /// The figures of an export, beside its file.
        // There is one of them at a time.
        #[allow(clippy::large_enum_variant)]
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum ExportReport {
            $($(#[$doc])* $kind($report),)*
        }

        impl ExportType {
            /// All types, in the order of the documentation.
            pub const ALL: [Self; [$(<$options>::NAME),*].len()] = [$(Self::$kind),*];

            /// Its name in requests and addresses.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => <$options>::NAME,)*
                }
            }

            /// Names of its file formats, the default first.
            pub fn formats(self) -> &'static [&'static str] {
                match self {
                    $(Self::$kind => <$options>::FORMATS,)*
                }
            }

            /// The programs that the option `for` may name in that format; none where the format has no such option.
            pub fn programs(self, format: &str) -> Vec<&'static str> {
                match self {
                    $(Self::$kind => <$options>::programs(format),)*
                }
            }

            /// The program that `for` must name in that format, where it is written for one program alone.
            pub fn needed_program(self, format: &str) -> Option<&'static str> {
                match self {
                    $(Self::$kind => <$options>::needed_program(format),)*
                }
            }

            fn read_options(self, object: &mut Object<'_>) -> Option<ExportRequest> {
                match self {
                    $(Self::$kind => <$options>::from_object(object).map(ExportRequest::$kind),)*
                }
            }
        }

        impl ExportRequest {
            /// Its type.
            pub fn export_type(&self) -> ExportType {
                match self {
                    $(Self::$kind(_) => ExportType::$kind,)*
                }
            }

            /// Writes the file, going on from a checkpoint of the same export where there is one: its bytes are the
            /// same.
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
                    $(Self::$kind(export) => {
                        let report = export.write_or_resume(model, limits, resume, control, out)?;
                        Ok(ExportReport::$kind(report.into()))
                    })*
                }
            }

            /// Checks the report of a file of `bytes` bytes against the specimen, the volume fraction of the packing
            /// and the materials that its request states.
            ///
            /// # Errors
            /// What cannot be, in one sentence.
            pub fn check_report(
                &self,
                specimen: &Specimen,
                volume_fraction: f64,
                materials: Option<&Materials>,
                report: &ExportReport,
                bytes: u64,
            ) -> Result<(), String> {
                let made = Made { specimen, volume_fraction, materials, bytes };
                match (self, report) {
                    $((Self::$kind(export), ExportReport::$kind(report)) => export.check_report(&made, report),)*
                    _ => {
                        let (kind, found) = (self.export_type().name(), report.export_type().name());
                        Err(format!("the report is one of {found:?}: must be of {kind:?}"))
                    }
                }
            }
        }

        impl ExportReport {
            /// The type of export that it is of.
            pub fn export_type(&self) -> ExportType {
                match self {
                    $(Self::$kind(_) => ExportType::$kind,)*
                }
            }
        }

        /// Asks the export of a request.
        macro_rules! ask {
            ($request:expr, $export:ident => $answer:expr) => {
                match $request {
                    $(ExportRequest::$kind($export) => $answer,)*
                }
            };
        }
    };
}

exports! {
    /// Surfaces of grains and specimen.
    Mesh: mesh::MeshRequest => mesh::MeshReport,
    /// A voxel model: labels, or hexahedra.
    Voxels: voxels::VoxelOptions => voxels::VoxelReport,
    /// A plane cross-section.
    Slice: slice::SliceOptions => slice::SliceReport,
    /// A model that a finite element program runs: mesh, materials, supports, a load.
    Deck: deck::DeckOptions => deck::DeckReport,
    /// A lattice discrete particle model, checked.
    Ldpm: ldpm::LatticeOptions => ldpm::LatticeReport,
    /// Proofs that close pairs of grains do not overlap.
    Certificates: certificates::CertificateOptions => certificates::CertificateReport,
    /// Sizes, ratios, sphericity and roundness of each grain.
    Shapes: shapes::ShapeTableOptions => shapes::ShapeTableReport,
    /// Whether the packing is random: contacts, bond order, walls and blocks by size.
    Quality: quality::QualityOptions => QualityReport,
    /// Effective stiffness, thermal expansion and conductivity, with bounds.
    Properties: properties::PropertyOptions => Box<properties::PropertyReport>,
}

impl ExportType {
    /// The type of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|export| export.name() == name)
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
}

impl ExportReport {
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

impl ExportRequest {
    /// Name of its file format.
    pub fn format(&self) -> &'static str {
        ask!(self, export => export.format())
    }

    /// Judges what can be judged before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`], [`ExportError::Unavailable`] or [`ExportError::TooLarge`].
    pub fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        ask!(self, export => export.check(specimen, &of_exports(limits)))
    }

    /// Says how long the file of a packing will be, before it is made: exactly for voxels (within some percent for
    /// hexahedra), within a factor of 1.5 for surface meshes.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where it cannot be made of such a specimen.
    pub fn estimate(&self, model: &Model<'_>) -> Result<ExportEstimate, ExportError> {
        ask!(self, export => export.estimate(&Expected::Packed(model)))
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
        ask!(self, export => export.estimate(&Expected::Planned(request, plan)))
    }

    /// Whether it takes less than a second for every packing, so that it need not wait behind exports that take
    /// minutes.
    pub fn is_quick(&self) -> bool {
        ask!(self, export => export.is_quick())
    }

    /// Whether it needs [`Model::mesher`].
    pub fn needs_mesher(&self) -> bool {
        ask!(self, export => export.needs_mesher())
    }

    /// Whether it may take as long as a packing: then a service makes it, where the request of a job asks for it, in
    /// the slots of packings instead of beside them. All that needs [`Model::mesher`] is.
    pub fn is_heavy(&self, specimen: &Specimen) -> bool {
        ask!(self, export => export.is_heavy(specimen))
    }

    /// The same export with these materials, where it computes with materials and its options name none.
    #[must_use]
    pub fn with_materials(mut self, materials: &Materials) -> Self {
        if ask!(&self, export => export.needs_materials())
            && let Some(own @ None) = ask!(&mut self, export => export.materials_mut())
        {
            *own = Some(materials.clone());
        }
        self
    }

    /// Judges the materials by the request of the packing, before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`] where the export needs materials and neither its options nor the request states any,
    /// where its options name a phase that the mix does not have, and where a phase or a property is missing.
    pub fn check_materials(&self, request: &PackingRequest) -> Result<(), ExportError> {
        if !ask!(self, export => export.needs_materials()) {
            return Ok(());
        }
        let names: Vec<_> = request.mix.aggregates.iter().map(|aggregate| aggregate.name.clone()).collect();
        let own = ask!(self, export => export.materials());
        let materials = chosen(own, request.materials.as_ref(), names.iter().map(Option::as_deref))?;
        ask!(self, export => export.check_materials(&phases(materials, &names)?))
    }

    /// What a checkpoint of the export of a packing belongs to; none where it keeps no checkpoints.
    pub fn checkpoint_identity(&self, model: &Model<'_>) -> Option<Vec<u8>> {
        ask!(self, export => export.checkpoint_identity(model))
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
                faults.add(
                    format!("/{}", pointer_segment(name)),
                    "is given more than once: must be given once",
                );
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
        ask!(self, export => export.media_type())
    }

    /// Ending of the name of a file that holds it.
    pub fn file_extension(&self) -> &'static str {
        ask!(self, export => export.file_extension())
    }

    /// Ending of the name of a file that holds it. It tells exports of one packing apart: after the type or format come
    /// the options that differ from the defaults, as in `msh`, `size_mm-0.5.msh`, `grain.vti`, `slice.x.at_mm-20.svg`,
    /// `ldpm.tets.vtu`, `tetrahedra.order-2.inp`, `deck.triangles.plane-strain.zip`.
    pub fn file_ending(&self) -> String {
        let parts = ask!(self, export => export.name_parts()).into_iter().map(str::to_owned);
        let parts = parts.chain(self.chosen_options()).chain([self.file_extension().to_owned()]);
        parts.collect::<Vec<_>>().join(".")
    }

    /// The options that differ from the defaults of the type and format, as parts of a name.
    fn chosen_options(&self) -> Vec<String> {
        let default = Self::from_text(self.export_type(), [ask!(self, export => export.deciding_option())]);
        let (Ok(Value::Object(own)), Ok(Ok(Value::Object(default)))) =
            (serde_json::to_value(self), default.map(serde_json::to_value))
        else {
            return Vec::new();
        };
        let is_told = |name: &str, value: &Value| {
            default.get(name) != Some(value) && !ask!(self, export => export.is_implied(name, value))
        };
        own.iter()
            .filter(|(name, value)| is_told(name, value))
            .map(|(name, value)| match (name.as_str(), value) {
                ("label" | "axis" | "load" | "solver", Value::String(text)) => text.clone(),
                ("materials", _) => format!(
                    "{name}-{}",
                    ask!(self, export => export.materials()).map_or_else(String::new, Materials::digits)
                ),
                (_, Value::String(text)) => format!("{name}-{}", text.replace(',', "-")),
                _ => format!("{name}-{value}"),
            })
            .collect()
    }

    /// A second file that the program which reads the export needs beside it, where it needs one: the ending that the
    /// name of the first file gets, and the text.
    pub fn companion(&self, file_name: &str) -> Option<(&'static str, String)> {
        ask!(self, export => export.companion(file_name))
    }
}

/// Limits with `max_model_bytes` in the field that exporters read.
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "report_check_tests.rs"]
mod report_check_tests;
#[cfg(test)]
#[path = "catalog_tests.rs"]
mod tests;
