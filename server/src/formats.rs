//! The formats of a result: those of the engine, and the page with a viewer.

use std::io::{self, Write};

use packstone_engine::export::tables::{self, Format, GrainSource, Head};
use serde::{Serialize, Serializer};
#[cfg(test)]
use utoipa::openapi::RefOr;
#[cfg(test)]
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
#[cfg(test)]
use utoipa::{PartialSchema, ToSchema};

use crate::page;

/// A format of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ResultFormat {
    /// The grains in a format of the engine.
    Table(Format),
    /// One HTML file with a viewer and the grains.
    Page,
}

impl ResultFormat {
    /// All formats.
    pub(crate) const ALL: [Self; Format::ALL.len() + 1] = {
        let mut all = [Self::Page; Format::ALL.len() + 1];
        let mut i = 0;
        while i < Format::ALL.len() {
            all[i] = Self::Table(Format::ALL[i]);
            i += 1;
        }
        all
    };

    /// Name in `?format=`, and file extension.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Table(format) => format.name(),
            Self::Page => "html",
        }
    }

    /// Media type without parameters.
    pub(crate) fn media_type(self) -> &'static str {
        match self {
            Self::Table(format) => format.media_type(),
            Self::Page => "text/html",
        }
    }

    /// The format of that name.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Writes a result.
    ///
    /// # Errors
    /// Those of the writer and of the source.
    pub(crate) fn write(self, head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
        match self {
            Self::Table(format) => tables::write(format, head, grains, out),
            Self::Page => page::write(head, grains, out),
        }
    }
}

impl Serialize for ResultFormat {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

#[cfg(test)]
impl PartialSchema for ResultFormat {
    fn schema() -> RefOr<Schema> {
        let names =
            ObjectBuilder::new().schema_type(Type::String).enum_values(Some(Self::ALL.map(Self::name)));
        Schema::from(names.description(Some("A result format.")).build()).into()
    }
}

#[cfg(test)]
impl ToSchema for ResultFormat {
    fn name() -> std::borrow::Cow<'static, str> {
        "Format".into()
    }
}
