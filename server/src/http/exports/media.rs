//! Media types of the files of exports.

use packstone_engine::export::{ExportRequest, ExportType};

/// The media type of a format with its default options.
pub(crate) fn media_type(kind: ExportType, format: &str) -> &'static str {
    let plain = ExportRequest::from_text(kind, kind.options_of_format(format));
    plain.map_or("application/octet-stream", |export| export.media_type())
}
