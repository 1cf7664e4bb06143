//! Every derivation by its name: one type for whoever takes orders, keeps what was made, and hands it out.
//!
//! Dispatch only: what an option means, and what is written, is the business of the module behind each name.

use std::io::Write;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{DerivedError, Model};
use crate::control::Control;
use crate::plan::Limits;
use crate::request::decode::{At, Faults, Object};
use crate::request::{FieldError, Specimen};
use crate::{ldpm, mesh, slice, voxels};

macro_rules! derivations {
    ($($(#[doc = $doc:literal])* $variant:ident $name:literal $($module:ident)::+, $read:expr;)*) => {
        /// What can be made of a finished packing, by name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(rename_all = "snake_case")]
        pub enum DerivationKind { $($(#[doc = $doc])* $variant,)* }

        /// Something to make of a finished packing: its type, and the type's options.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum Derivation { $($(#[doc = $doc])* $variant($($module)::+::Options),)* }

        /// What is worth knowing about what was made, beside its file.
        // There is one of them at a time.
        #[allow(clippy::large_enum_variant)]
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(tag = "type", rename_all = "snake_case")]
        pub enum DerivedReport { $($(#[doc = $doc])* $variant($($module)::+::Report),)* }

        impl DerivationKind {
            /// All of them, in the order of the documentation.
            pub const ALL: &[Self] = &[$(Self::$variant,)*];

            /// Its name in requests, as `?format=` and as `type`.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }
        }

        impl Derivation {
            /// Its name.
            pub fn kind(&self) -> DerivationKind {
                match self { $(Self::$variant(_) => DerivationKind::$variant,)* }
            }

            fn read_options(kind: DerivationKind, object: &mut Object<'_>) -> Option<Self> {
                match kind {
                    $(DerivationKind::$variant => $read(object).map(Self::$variant),)*
                }
            }

            /// Judges what can be judged before there are grains.
            ///
            /// # Errors
            /// [`DerivedError::Invalid`], [`DerivedError::Unavailable`] or [`DerivedError::TooLarge`].
            pub fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), DerivedError> {
                let limits = &of_models(limits);
                match self { $(Self::$variant(options) => $($module)::+::check(specimen, options, limits),)* }
            }

            /// Makes it.
            ///
            /// # Errors
            /// See [`DerivedError`].
            pub fn write(
                &self,
                model: &Model<'_>,
                limits: &Limits,
                control: &dyn Control,
                out: &mut dyn Write,
            ) -> Result<DerivedReport, DerivedError> {
                let limits = &of_models(limits);
                match self {
                    $(Self::$variant(options) => {
                        $($module)::+::write(model, options, limits, control, out).map(DerivedReport::$variant)
                    })*
                }
            }
        }
    };
}

derivations! {
    /// Surfaces of grains and specimen as a Gmsh file, to be filled with tetrahedra.
    Msh "msh" mesh::msh, mesh::msh::Options::read;
    /// Spheres and specimen as a Gmsh script.
    Geo "geo" mesh::geo, mesh::geo::Options::read;
    /// Surfaces as STL, a file for each phase in a zip.
    Stl "stl" mesh::stl, mesh::stl::Options::read;
    /// Voxel labels as VTK image data.
    Vti "vti" voxels, |object| voxels::Options::read(voxels::Form::Vti, object);
    /// Voxel labels and nothing else.
    Raw "raw" voxels, |object| voxels::Options::read(voxels::Form::Raw, object);
    /// Voxels as hexahedra, Abaqus keywords to be included into a part.
    Inp "inp" voxels, |object| voxels::Options::read(voxels::Form::Inp, object);
    /// A plane cut as circles.
    Slice "slice" slice, slice::Options::read;
    /// A lattice discrete particle model, checked.
    Ldpm "ldpm" ldpm, ldpm::Options::read;
}

impl DerivationKind {
    /// The one of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.name() == name)
    }

    /// Whether it is made in a moment, whatever the packing: such need not wait behind what takes minutes.
    pub fn is_quick(self) -> bool {
        matches!(self, Self::Slice)
    }
}

impl Derivation {
    /// Reads an object with a `type` and that type's options.
    ///
    /// `None` means that faults were reported; the reverse does not hold, so ask the faults.
    pub fn read(at: &At<'_>) -> Option<Self> {
        let choices: Vec<(&str, DerivationKind)> =
            DerivationKind::ALL.iter().map(|kind| (kind.name(), *kind)).collect();
        let mut object = at.object()?;
        let kind = object.variant(&choices)?;
        let read = Self::read_options(kind, &mut object);
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
        kind: DerivationKind,
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
            let read = Self::read_options(kind, &mut object);
            object.finish_as("option", kind.name());
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
            Self::Msh(_) => "application/vnd.gmsh.msh",
            Self::Geo(_) => "text/plain",
            Self::Stl(_) => "application/zip",
            Self::Vti(options) | Self::Raw(options) | Self::Inp(options) => options.form.media_type(),
            Self::Slice(options) => options.form.media_type(),
            Self::Ldpm(options) => options.file.media_type(),
        }
    }

    /// Ending of the name of a file that holds it.
    pub fn file_extension(&self) -> &'static str {
        match self {
            Self::Msh(_) => "msh",
            Self::Geo(_) => "geo",
            Self::Stl(_) => "zip",
            Self::Vti(options) | Self::Raw(options) | Self::Inp(options) => options.form.name(),
            Self::Slice(options) => options.form.name(),
            Self::Ldpm(options) => options.file.extension(),
        }
    }

    /// What a file of that name needs beside it for its program to take it in one call, where it needs
    /// anything: the ending that its name gets, and the text.
    pub fn companion(&self, file_name: &str) -> Option<(&'static str, String)> {
        match self {
            Self::Msh(_) => Some(("geo", mesh::msh::script(file_name))),
            _ => None,
        }
    }
}

/// The limits as the modules read them, each of which makes but one thing.
fn of_models(limits: &Limits) -> Limits {
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
#[path = "kind_tests.rs"]
mod tests;
