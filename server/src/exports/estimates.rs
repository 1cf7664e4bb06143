//! Sizes of the exports of a job before the job has run.

use packstone_engine::export::{ExportEstimate, ExportRequest};
use packstone_engine::request::PackingRequest;
use packstone_engine::{Limits, Plan};
use serde::Serialize;

use crate::jobs::JobRequest;
use crate::planning::{Planner, Proposal};
use crate::storage::Storage;

/// What a job amounts to, with the exports that its `postprocess` names.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobPlan {
    #[serde(flatten)]
    pub(crate) plan: Plan,
    /// Estimates of the exports that `postprocess` names, in the same order.
    pub(crate) exports: Vec<PlannedExport>,
}

/// An export and its estimated size.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct PlannedExport {
    /// The export, with its type and with defaults filled in.
    pub(crate) export: ExportRequest,
    /// Its estimated size.
    pub(crate) estimate: ExportEstimate,
}

/// Estimates the sizes of exports from the plan of their job. An export that the specimen does not allow has no size
/// and is left out; [`ExportRequest::check`] gives the reason.
pub(crate) fn planned<'a>(
    exports: impl IntoIterator<Item = &'a ExportRequest>,
    request: &PackingRequest,
    plan: &Plan,
) -> Vec<PlannedExport> {
    let estimated = |export: &ExportRequest| {
        let estimate = export.estimate_from_plan(request, plan).ok()?;
        Some(PlannedExport { export: export.clone(), estimate })
    };
    exports.into_iter().filter_map(estimated).collect()
}

/// Estimates the size of an export of a stored job from the job's request; `None` where this version would refuse the
/// request, or the export cannot be made.
pub(crate) fn of_stored(
    export: &ExportRequest,
    request: &JobRequest,
    limits: &Limits,
    planner: &Planner,
) -> Option<ExportEstimate> {
    let request = request.packing();
    let plan = planner.plan(&request, limits, Proposal::None).ok()?;
    export.estimate_from_plan(&planner.with_templates(&request), &plan).ok()
}

/// Bytes that a job stores by its plan: its result, and the exports that its `postprocess` names.
pub(crate) fn stored_bytes(job: &JobRequest, plan: &Plan, exports: &[PlannedExport]) -> u64 {
    Storage::bytes_of_result(plan.grains, &job.mix).saturating_add(bytes(exports))
}

/// Sum of the estimated file lengths, in bytes.
fn bytes(planned: &[PlannedExport]) -> u64 {
    planned.iter().fold(0, |sum, export| sum.saturating_add(export.estimate.bytes))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_export_that_the_specimen_does_not_allow_has_no_size() {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [40, 40, 40], "boundary": "periodic"},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "volume_fraction": 0.3},
        });
        let request = PackingRequest::from_json(&request, 1).unwrap();
        let plan = Plan::new(&request, &Limits::default()).unwrap();
        let exports = [json!({"type": "mesh"}), json!({"type": "voxels", "format": "raw", "cells": 100})]
            .map(|export| ExportRequest::from_json(&export).unwrap());
        let planned = planned(&exports, &request, &plan);
        assert_eq!(planned.len(), 1, "{planned:?}");
        assert_eq!((planned[0].export.clone(), bytes(&planned)), (exports[1].clone(), 1_000_000));
    }
}
