//! Proofs that grains keep their gaps: for each close pair, and for each grain near a wall, a direction that shows the
//! gap, found by the check, beside the gap that the rule of the packing asks for.
//!
//! A reader needs no search of its own to believe a packing. With the centres `x` of a pair, the second moved by whole
//! periods, the support functions `h` and a unit vector `n`, the distance of the grains is at least
//! `s(n) = (x_second - x_first) . n - h_first(n) - h_second(-n)` (Rockafellar 1970, Convex Analysis, theorem 11.1, of
//! separating planes). The certificate of a pair is `n` and `s(n)`; pairs without one are farther apart than
//! `closer_than_mm`.

use std::io::Write;

use serde::{Deserialize, Serialize};

use super::estimate::{Expected, ExportEstimate};
use super::kind::Export;
use super::rows::{Cell, Rows, TableFormat};
use super::{ExportError, Model, go_on};
use crate::check::{self, Fault, SeparationCertificate};
use crate::control::{Control, Progress, Step};
use crate::distance::DistanceRule;
use crate::plan::Limits;
use crate::request::decode::{Bound, Object};
use crate::request::{FieldError, MAX_LENGTH_MM};

/// Names of the columns, in their order.
pub const COLUMNS: [&str; 10] = [
    "first",
    "second",
    "image_x",
    "image_y",
    "image_z",
    "normal_x",
    "normal_y",
    "normal_z",
    "separation_mm",
    "required_mm",
];
/// What stands in the column of the second grain in the rows of walls.
const WALL: i64 = -1;
/// `closer_than_mm` where none is given, beyond the gap that the smallest grains keep, over their equivalent diameter.
pub const DEFAULT_SHARE: f64 = 0.1;
/// Bytes of a row of text, on average.
const ROW_BYTES: f64 = 95.0;
/// Pairs of a grain of a dense packing that are listed by default, on average.
const PAIRS_PER_GRAIN: f64 = 5.0;
/// Memory that the bodies and the certificates of a grain take, in bytes: those of the check.
const BYTES_PER_GRAIN: u64 = 1200;
/// Rows between two looks at whether to stop.
const ROWS_PER_LOOK: usize = 1 << 14;

/// Which pairs, and in which format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertificateOptions {
    /// The file format.
    #[cfg_attr(feature = "openapi", schema(default = "csv", required = false))]
    pub format: TableFormat,
    /// Pairs and walls with a smaller gap are listed. Default: a tenth of the smallest diameter beyond the gap that
    /// such grains keep; at most that diameter.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closer_than_mm: Option<f64>,
}

impl CertificateOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = TableFormat::read(object);
        let closer_than_mm = match object.optional("closer_than_mm") {
            Some(at) => at.number(Bound::closed(0.0, MAX_LENGTH_MM, "mm")).map(Some),
            None => Some(None),
        };
        Some(Self { format: format?, closer_than_mm: closer_than_mm? })
    }
}

/// The figures of the certificates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CertificateReport {
    /// Pairs and walls with a smaller gap are listed.
    pub closer_than_mm: f64,
    /// Number of pairs listed.
    pub pairs: u64,
    /// Number of rows about walls; absent in reports of older versions.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub walls: u64,
    /// Smallest separation of a pair; `null` without pairs.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub min_separation_mm: Option<f64>,
    /// Smallest separation of a grain from a wall; `null` without such rows.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub min_wall_separation_mm: Option<f64>,
}

impl Export for CertificateOptions {
    type Report = CertificateReport;

    const NAME: &'static str = "certificates";
    const FORMATS: &'static [&'static str] = &["csv", "json"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        Ok(ExportEstimate::of_bytes((of.grains() * PAIRS_PER_GRAIN * ROW_BYTES) as u64))
    }

    /// Writes the certificates of a packing, in the order of the rows of the grains.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`], [`ExportError::Stopped`], [`ExportError::OutOfMemory`], [`ExportError::Write`];
    /// [`ExportError::CheckFailed`] for grains that do not keep their gaps.
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<CertificateReport, ExportError> {
        let grains = model.grains.len() as u64;
        let bytes = grains.saturating_mul(BYTES_PER_GRAIN);
        if bytes > limits.max_memory_bytes {
            return Err(ExportError::TooLarge(FieldError::new(
                "",
                format!(
                    "the certificates of {grains} grains take about {bytes} bytes of memory: must be at most {}",
                    limits.max_memory_bytes
                ),
            )));
        }
        let least_mm = model.grains.diameters_mm().next_back().unwrap_or(0.0);
        let rule = DistanceRule::new(&model.distance, model.specimen);
        let by_default = || (DEFAULT_SHARE * least_mm + rule.gap_mm(least_mm, least_mm)).min(least_mm);
        let closer_than_mm = self.closer_than_mm.unwrap_or_else(by_default);
        if closer_than_mm > least_mm {
            return Err(ExportError::Invalid(vec![FieldError::new(
                "/closer_than_mm",
                format!(
                    "{closer_than_mm} is out of range: must be at most {least_mm} mm, the smallest diameter, beyond which \
                     the pairs are no neighbours"
                ),
            )]));
        }
        let threads = limits.export_threads;
        let region = (model.distance, *model.specimen);
        let found = check::certify(model.grains, region, closer_than_mm, threads, control);
        let found = found.map_err(|fault| match fault {
            Fault::Stopped => ExportError::Stopped,
            Fault::OutOfMemory { bytes } => ExportError::OutOfMemory { bytes },
            fault => ExportError::CheckFailed(fault.to_string()),
        })?;
        let mut rows = Rows::begin(out, self.format, &COLUMNS, &[("closer_than_mm", closer_than_mm)])?;
        for (number, certificate) in found.iter().enumerate() {
            if number.is_multiple_of(ROWS_PER_LOOK) {
                go_on(control)?;
                report(control, number, found.len());
            }
            rows.row(&cells(certificate))?;
        }
        rows.end()?;
        let least = |is_wall: bool| {
            let listed = found.iter().filter(|certificate| certificate.second.is_none() == is_wall);
            listed.map(|certificate| certificate.separation_mm).reduce(f64::min)
        };
        let walls = found.iter().filter(|certificate| certificate.second.is_none()).count();
        Ok(CertificateReport {
            closer_than_mm,
            pairs: (found.len() - walls) as u64,
            walls: walls as u64,
            min_separation_mm: least(false),
            min_wall_separation_mm: least(true),
        })
    }
}

fn cells(certificate: &SeparationCertificate) -> [Cell; 10] {
    let SeparationCertificate { first, second, image, normal, separation_mm, required_mm } = certificate;
    let [i, j, k] = image.map(|period| Cell::Whole(period.into()));
    let [x, y, z] = normal.map(Cell::Number);
    let first = Cell::Whole(*first as i64);
    let second = Cell::Whole(second.map_or(WALL, |row| row as i64));
    [first, second, i, j, k, x, y, z, Cell::Number(*separation_mm), Cell::Number(*required_mm)]
}

fn report(control: &dyn Control, done: usize, total: usize) {
    control.report(&Progress::counted(Step::Export, done, total, "pairs", "writing certificates"));
}

#[cfg(test)]
#[path = "certificates_tests.rs"]
mod tests;
