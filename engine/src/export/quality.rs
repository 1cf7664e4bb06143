//! The quality of a packing as a document: whether it is random, by the measures of
//! [`quality`](crate::analysis::quality()).

use std::io::Write;

use serde::{Deserialize, Serialize};

use super::estimate::{Expected, ExportEstimate};
use super::kind::Export;
use super::{ExportError, Model};
use crate::analysis::quality::{QualityError, QualityReport, quality};
use crate::control::Control;
use crate::plan::Limits;
use crate::request::FieldError;
use crate::request::decode::Object;

/// Memory that the sorted copies of a grain take, in bytes.
const BYTES_PER_GRAIN: u64 = 200;
/// Length of a document of three size classes.
const DOCUMENT_BYTES: u64 = 6500;

/// File formats of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum QualityFormat {
    /// An object with the figures.
    Json,
}

impl QualityFormat {
    /// Name of the format, and file extension.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
        }
    }

    /// Media type without parameters.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
        }
    }
}

/// In which format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QualityOptions {
    /// The file format.
    #[cfg_attr(feature = "openapi", schema(default = "json", required = false))]
    pub format: QualityFormat,
}

impl QualityOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = match object.optional("format") {
            Some(at) => at.choice(&[("json", QualityFormat::Json)])?,
            None => QualityFormat::Json,
        };
        Some(Self { format })
    }
}

impl Export for QualityOptions {
    type Report = QualityReport;

    const NAME: &'static str = "quality";
    const FORMATS: &'static [&'static str] = &["json"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    fn estimate(&self, _: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        Ok(ExportEstimate::of_bytes(DOCUMENT_BYTES))
    }

    /// Measures the packing and writes the report.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], [`ExportError::Stopped`], [`ExportError::OutOfMemory`], [`ExportError::Write`].
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<QualityReport, ExportError> {
        let grains = model.grains.len() as u64;
        let bytes = grains.saturating_mul(BYTES_PER_GRAIN);
        if bytes > limits.max_memory_bytes {
            return Err(ExportError::TooLarge(FieldError::new(
                "",
                format!(
                    "the quality of {grains} grains takes about {bytes} bytes of memory: must be at most {}",
                    limits.max_memory_bytes
                ),
            )));
        }
        let report = quality(model.grains, model.specimen, control)?;
        serde_json::to_writer_pretty(&mut *out, &report).map_err(std::io::Error::from)?;
        writeln!(out)?;
        Ok(report)
    }
}

impl From<QualityError> for ExportError {
    fn from(error: QualityError) -> Self {
        match error {
            QualityError::Stopped => Self::Stopped,
            QualityError::OutOfMemory(error) => error.into(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::Unattended;
    use crate::export::{ExportReport, ExportRequest, ExportType};
    use crate::packing::Spheres;
    use crate::request::{Boundary, Specimen};

    const CUBE: Specimen = Specimen::cuboid([12.0; 3], Boundary::Walls);

    fn spheres() -> Spheres {
        let mut spheres = Spheres::default();
        for i in 0..64 {
            let at = [i % 4, i / 4 % 4, i / 16].map(|x| 3.0 * f64::from(x) + 1.5);
            spheres.push(at, 2.9 - 0.001 * f64::from(i));
        }
        spheres
    }

    #[test]
    fn the_file_is_the_report() {
        let (grains, export) = (spheres(), ExportRequest::from_text(ExportType::Quality, []).unwrap());
        let (model, mut out) = (Model::new(&CUBE, &grains), Vec::new());
        let report = export.write(&model, &Limits::default(), &Unattended, &mut out).unwrap();
        let ExportReport::Quality(report) = report else { panic!("{report:?}") };
        assert_eq!(serde_json::from_slice::<QualityReport>(&out).unwrap(), report);
        assert!(report.contacts.is_some() && report.blocks.is_some() && report.walls.is_some(), "{report:?}");
        assert_eq!((export.file_ending(), export.media_type()), ("quality.json".into(), "application/json"));
        let expected = DOCUMENT_BYTES as usize;
        assert!((expected / 2..2 * expected).contains(&out.len()), "{}", out.len());
    }

    #[test]
    fn memory_beyond_the_limit_is_refused() {
        let limits = Limits { max_model_bytes: 64 * BYTES_PER_GRAIN - 1, ..Limits::default() };
        let (grains, export) = (spheres(), ExportRequest::from_text(ExportType::Quality, []).unwrap());
        let refused = export.write(&Model::new(&CUBE, &grains), &limits, &Unattended, &mut Vec::new());
        assert!(matches!(refused, Err(ExportError::TooLarge(_))), "{refused:?}");
    }
}
