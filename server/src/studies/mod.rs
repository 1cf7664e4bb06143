//! Studies: many packings from one request, and the table of their results.
//!
//! A study is a list of points (a mix, a method), each packed once per replicate. The request is expanded into jobs
//! before anything is stored or run ([`request`]). The result is a table with one row per point ([`table`]). The
//! service and `packstone study` both use this module.

#[cfg(test)]
mod examples;
mod expand;
mod facts;
mod interval;
mod pointer;
pub(crate) mod properties;
pub(crate) mod representative;
mod request;
#[cfg(test)]
mod schema;
mod seeds;
pub(crate) mod shards;
pub(crate) mod stop;
pub(crate) mod table;

use std::collections::BTreeMap;

use packstone_engine::packing::GrowthEnd;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::jobs::JobRequest;
use crate::webhooks::WebhookUrl;

pub(crate) use properties::PropertyFacts;
pub(crate) use table::{Keys, Row, Table};

/// Most jobs of a study.
pub(crate) const MAX_JOBS: usize = 10_000;
/// Most bytes of JSON of the requests of all jobs of a study; a grid over long lists of diameters would fill the disk
/// otherwise.
pub(crate) const MAX_REQUEST_BYTES: usize = 64 << 20;

/// Most entries of `grid`, and of `zip`.
pub(crate) const MAX_AXES: usize = 32;
/// Most values (numbers, texts) that the requests of all points may hold together; each takes memory until the study is
/// stored.
pub(crate) const MAX_POINT_VALUES: usize = 4_000_000;

/// An expanded study. Made by [`Study::read`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Study {
    /// Display name.
    pub(crate) name: Option<String>,
    /// Keys and values to find the study by, bounded as those of a job.
    pub(crate) labels: BTreeMap<String, String>,
    /// Seed that the seeds of the jobs are computed from.
    pub(crate) seed: u64,
    /// JSON pointers into the job that distinguish the points, in the order of the request: the grid's,
    /// then those of `zip`. Empty for a list.
    pub(crate) columns: Vec<String>,
    /// The points in the order of the request; the last column varies fastest.
    pub(crate) points: Vec<Point>,
    /// Jobs of every point.
    pub(crate) replicates: usize,
    /// When a point needs no more runs.
    pub(crate) stop_when: StopWhen,
    /// Whether other users of a server may read the study with its jobs.
    pub(crate) shared: bool,
    /// Where a message is sent when the study is finished.
    pub(crate) webhook_url: Option<WebhookUrl>,
}

/// One mix and method.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Point {
    /// Values of the columns.
    pub(crate) values: Vec<Value>,
    /// Its first job. The others differ from it in their seed only.
    pub(crate) job: JobRequest,
    /// Seeds of its jobs, one per replicate.
    pub(crate) seeds: Vec<u64>,
    /// Warnings of the plan, which its jobs have in common.
    pub(crate) warnings: Vec<String>,
    /// Time that the plan expects of one of its jobs, on one core.
    pub(crate) forecast_s: f64,
    /// Whether their method keeps checkpoints.
    pub(crate) keeps_checkpoints: bool,
    /// Most threads that one of them has work for.
    pub(crate) most_threads: u32,
    /// Memory that the plan expects of one of its jobs.
    pub(crate) memory_bytes: u64,
    /// Bytes that one of them stores by the plan.
    pub(crate) stored_bytes: u64,
}

impl Point {
    /// The job of a replicate.
    pub(crate) fn replicate(&self, replicate: usize) -> JobRequest {
        let seed = self.seeds.get(replicate).copied().unwrap_or(self.job.seed);
        JobRequest { seed, ..self.job.clone() }
    }
}

impl Study {
    /// How many jobs there are.
    pub(crate) fn jobs(&self) -> usize {
        self.points.len() * self.replicates
    }

    /// Bytes that all jobs store by their plans.
    pub(crate) fn stored_bytes(&self) -> u64 {
        let of_a_replicate =
            self.points.iter().fold(0_u64, |sum, point| sum.saturating_add(point.stored_bytes));
        of_a_replicate.saturating_mul(self.replicates as u64)
    }

    /// Point and replicate of every job in the order in which they are to run: the first replicate of all
    /// points, then the second, so that the table fills evenly.
    pub(crate) fn order(&self) -> impl Iterator<Item = (usize, usize)> {
        let points = self.points.len();
        (0..self.replicates).flat_map(move |replicate| (0..points).map(move |point| (point, replicate)))
    }

    /// The first columns of the table: the study's own, or place and name in a list.
    pub(crate) fn keys(&self) -> Keys {
        if self.is_list() {
            let key = |(i, point): (usize, &Point)| vec![json!(i), json!(point.job.name)];
            return Keys {
                columns: vec!["point".into(), "name".into()],
                values: self.points.iter().enumerate().map(key).collect(),
            };
        }
        Keys {
            columns: self.columns.clone(),
            values: self.points.iter().map(|point| point.values.clone()).collect(),
        }
    }

    /// Whether the points are a list of jobs, or a template alone.
    fn is_list(&self) -> bool {
        self.columns.is_empty()
    }
}

/// When a point needs no more runs; its queued jobs are then cancelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StopWhen {
    /// Number of runs that fail in a row, in the order in which they end.
    #[cfg_attr(test, schema(required = false, minimum = 1, maximum = 10_000))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) failed_in_a_row: Option<u32>,
    /// The 95 % interval of its success rate (Wilson 1927) is narrower than this, after five runs at least.
    #[cfg_attr(test, schema(required = false, exclusive_minimum = 0, maximum = 1))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) interval_width: Option<f64>,
}

/// How a run ended, as a study counts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Outcome {
    /// The requested packing was reached.
    Succeeded,
    /// The run ended before the requested packing, and what it had reached was kept. It counts as one that did not
    /// reach it.
    Partial,
    /// The method ended before the requested packing, by its own limits or those of the job.
    TargetNotReached,
    /// The run does not count: it was cancelled, or ended by a fault of the program or the machine.
    Void,
}

/// The figures of a run that ended, from which the table of a study is computed without reading results.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Facts {
    /// Wall-clock time that the run took, in s: the engine's, or from lease to end where it failed.
    pub(crate) time_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) grains: Option<u64>,
    /// `phi_eff`, counted; where the run did not reach its target, that of the requested grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) volume_fraction_effective: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) volume_fraction_with_coating: Option<f64>,
    /// `phi_eff` of a packing that was kept although the run ended before its target; absent of every other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) volume_fraction_reached: Option<f64>,
    /// Constant distance kept, or reached before the run failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) distance_mm: Option<f64>,
    /// Events of the growth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) events: Option<u64>,
    /// Time of the growth alone, in s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) edmd_s: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) end: Option<GrowthEnd>,
    /// Effective properties, once the exports that compute them are made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) properties: Option<PropertyFacts>,
}

/// A run that ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    /// Index of the point.
    pub(crate) point: usize,
    /// Index within the point.
    pub(crate) replicate: usize,
    pub(crate) outcome: Outcome,
    pub(crate) facts: Facts,
}
