//! Whether the report of a cut that a worker process sends with its file can be right.

use super::SliceReport;

/// Largest relative error of an area.
const AREA_ERROR: f64 = 1e-6;

/// The areas of a cut agree.
pub(super) fn check_slice(report: &SliceReport) -> Result<(), String> {
    let share = report.aggregate_area_mm2 / report.area_mm2;
    if !(0.0..=1.0 + AREA_ERROR).contains(&share) || (report.area_fraction - share).abs() > AREA_ERROR {
        return Err(format!(
            "the aggregates have {} of {} mm2, a share of {}",
            report.aggregate_area_mm2, report.area_mm2, report.area_fraction
        ));
    }
    Ok(())
}
