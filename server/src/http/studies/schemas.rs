//! What the document of the interface says of a study's request and table. Nothing here is run: requests are
//! read by [`crate::studies`], which also makes the tables.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::jobs::JobRequest;
use crate::studies::StopWhen;
use crate::studies::table::Cells;

/// Many jobs at once: a `list` of them, or a `template` with values for some of its fields.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct StudyRequest {
    /// A name for people.
    #[schema(required = false, min_length = 1, max_length = 200)]
    name: String,
    /// Keys and values to find the study by, bounded as those of a job.
    #[schema(required = false, example = json!({"series": "TB-7"}))]
    labels: BTreeMap<String, String>,
    /// What the seeds of the jobs derive from; drawn at submission and recorded when absent.
    #[schema(required = false, minimum = 0, maximum = 9_007_199_254_740_991_u64)]
    seed: u64,
    /// The points as jobs of their own.
    #[schema(required = false, min_items = 1, max_items = 10_000)]
    list: Vec<JobRequest>,
    /// A job, but for the fields that `grid` and `zip` set.
    #[schema(required = false)]
    template: JobTemplate,
    /// JSON pointers (RFC 6901) into the template, each with its values: every combination is a point, and the
    /// last pointer varies fastest.
    #[schema(required = false)]
    grid: BTreeMap<String, AxisValues>,
    /// JSON pointers into the template whose values run together: lists of the same length. They vary faster
    /// than the grid.
    #[schema(required = false)]
    zip: BTreeMap<String, AxisValues>,
    /// Jobs of every point, with seeds of their own.
    #[schema(required = false, minimum = 1, maximum = 10_000, default = 1)]
    replicates: u64,
    /// When a point needs no more runs; what of it still waits is cancelled then.
    #[schema(required = false)]
    stop_when: StopWhen,
}

/// A job, but for the fields that a study sets.
#[derive(Serialize, ToSchema)]
#[schema(value_type = Object)]
pub(crate) struct JobTemplate(Value);

/// The values of one field.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum AxisValues {
    /// Any values, one by one.
    Values(Vec<Value>),
    /// Numbers at equal steps.
    Range(AxisRange),
}

/// The numbers `from`, `from + step`, ... as far as `to`, both ends included, to 12 significant digits of the larger term.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct AxisRange {
    from: f64,
    to: f64,
    step: f64,
}

/// What the runs of a study came to.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct StudyTable {
    /// Names of the columns that tell the points apart: JSON pointers, or `point` and `name` for a list.
    columns: Vec<String>,
    /// One row per point: the values of these columns, and the figures.
    rows: Vec<Cells>,
}
