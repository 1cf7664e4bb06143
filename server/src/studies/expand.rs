//! Makes the points and jobs of a study from a request whose own fields are valid: all of them, or none.
//!
//! Every job is read and planned as if it had been submitted alone. A fault is reported at the place of the study's
//! request where the user can correct it, once for all points that have it.

use std::collections::HashMap;

use jiff::Timestamp;
use packstone_engine::request::decode::MAX_FAULTS;
use packstone_engine::{FieldError, Limits, Plan};
use serde_json::Value;

use super::request::{Axis, Points, StudyRequest, Values};
use super::seeds::Seeds;
use super::{Point, Study};
use crate::exports::estimates::{planned, stored_bytes};
use crate::failure::{Failure, FailureCode};
use crate::jobs::JobRequest;
use crate::planning::{Planner, Proposal};
use crate::webhooks::NONE_OF_JOBS;

/// Conditions on the jobs of a study.
pub(super) struct Conditions<'a> {
    /// The time that `expires_at` must lie after, if that is to be checked.
    pub(super) now: Option<Timestamp>,
    pub(super) limits: &'a Limits,
    pub(super) planner: &'a Planner,
    /// Whether a client still waits for the study.
    pub(super) go_on: &'a dyn Fn() -> bool,
}

impl Conditions<'_> {
    fn check_go_on(&self) -> Result<(), Failure> {
        if (self.go_on)() { Ok(()) } else { Err(Failure::internal()) }
    }
}

pub(super) fn expand(request: &StudyRequest<'_>, conditions: &Conditions<'_>) -> Result<Study, Failure> {
    let (points, columns) = match &request.points {
        Points::List(jobs) => (of_list(request, jobs, conditions)?, Vec::new()),
        Points::Template { job, grid, zip } => {
            let axes = Axes { grid, zip };
            let columns = axes.all().map(|axis| axis.pointer.text().to_owned()).collect();
            (of_template(request, job, &axes, conditions)?, columns)
        }
    };
    Ok(Study {
        name: request.name.clone(),
        labels: request.labels.clone(),
        seed: request.seed,
        columns,
        points,
        replicates: request.replicates,
        stop_when: request.stop_when,
        shared: request.shared,
        webhook_url: request.webhook_url.clone(),
    })
}

fn of_list(
    request: &StudyRequest<'_>,
    jobs: &[Value],
    conditions: &Conditions<'_>,
) -> Result<Vec<Point>, Failure> {
    let mut points = Vec::with_capacity(jobs.len());
    let mut refused = Refused::default();
    for (i, job) in jobs.iter().enumerate() {
        conditions.check_go_on()?;
        let seeds = Seeds::of_listed(request.seed, i);
        match read_point(job, Vec::new(), &seeds, request.replicates, conditions) {
            Ok(point) => points.push(point),
            Err(failure) => {
                for fault in failure.fields {
                    refused.add(failure.code, format!("/list/{i}{}", fault.pointer), fault.detail, i);
                }
            }
        }
    }
    refused.or(points, false)
}

fn of_template(
    request: &StudyRequest<'_>,
    template: &Value,
    axes: &Axes<'_>,
    conditions: &Conditions<'_>,
) -> Result<Vec<Point>, Failure> {
    let count = request.points.len() as usize;
    let mut points = Vec::with_capacity(count);
    let mut refused = Refused::default();
    // One copy for all points: every axis is written at every point.
    let mut job = template.clone();
    for i in 0..count {
        conditions.check_go_on()?;
        let places = axes.at(i);
        let values: Vec<Value> = axes.all().zip(&places).map(|(axis, at)| axis.values.get(*at)).collect();
        for (axis, value) in axes.all().zip(&values) {
            axis.pointer.put(&mut job, value.clone());
        }
        let seeds = Seeds::of_point(request.seed, axes.all().map(|axis| &axis.pointer).zip(&values));
        match read_point(&job, values, &seeds, request.replicates, conditions) {
            Ok(point) => points.push(point),
            Err(failure) => {
                for fault in failure.fields {
                    refused.add(failure.code, axes.place(&places, &fault.pointer), fault.detail, i);
                }
            }
        }
    }
    refused.or(points, true)
}

fn read_point(
    job: &Value,
    values: Vec<Value>,
    seeds: &Seeds,
    replicates: usize,
    conditions: &Conditions<'_>,
) -> Result<Point, Failure> {
    let job = JobRequest::read(job, seeds.replicate(0), conditions.now).map_err(Failure::invalid)?;
    if job.webhook_url.is_some() {
        return Err(Failure::invalid(vec![FieldError::new("/webhook_url", NONE_OF_JOBS)]));
    }
    let packing = job.packing();
    let plan = conditions.planner.plan(&packing, conditions.limits, Proposal::None)?;
    let exports = match job.exports().next() {
        Some(_) => planned(job.exports(), &conditions.planner.with_templates(&packing), &plan),
        None => Vec::new(),
    };
    let stored_bytes = stored_bytes(&job, &plan, &exports);
    job.check_postprocess(conditions.limits)?;
    // The first may be the job's own; where there are others, it names none.
    let seeds = std::iter::once(job.seed).chain((1..replicates).map(|r| seeds.replicate(r))).collect();
    let Plan {
        estimated_time_s: forecast_s, keeps_checkpoints, most_threads, memory_bytes, warnings, ..
    } = plan;
    Ok(Point {
        values,
        job,
        seeds,
        warnings,
        forecast_s,
        keeps_checkpoints,
        most_threads,
        memory_bytes,
        stored_bytes,
    })
}

/// The axes of a template.
struct Axes<'a> {
    grid: &'a [Axis<'a>],
    zip: &'a [Axis<'a>],
}

impl<'a> Axes<'a> {
    /// In the order of the columns.
    fn all(&self) -> impl Iterator<Item = &'a Axis<'a>> + use<'a> {
        self.grid.iter().chain(self.zip)
    }

    /// The index of the value that each axis has at a point: the last axis of the grid varies faster than the others,
    /// and the zip faster than the grid.
    fn at(&self, point: usize) -> Vec<usize> {
        let mut rest = point;
        let mut take = |length: u64| {
            let length = length as usize;
            let at = rest % length;
            rest /= length;
            at
        };
        let together = self.zip.first().map_or(0, |axis| take(axis.values.len()));
        let mut places: Vec<usize> = self.grid.iter().rev().map(|axis| take(axis.values.len())).collect();
        places.reverse();
        places.extend(self.zip.iter().map(|_| together));
        places
    }

    /// The place in the study's request that sets `pointer` of the job.
    fn place(&self, places: &[usize], pointer: &str) -> String {
        for (axis, at) in self.all().zip(places) {
            if let Some(rest) = axis.pointer.rest_of(pointer) {
                return match axis.values {
                    Values::List(_) => format!("{}/{at}{rest}", axis.place),
                    Values::Range { .. } => axis.place.clone(),
                };
            }
        }
        format!("/template{pointer}")
    }
}

/// Faults of points, each once.
#[derive(Default)]
struct Refused {
    faults: Vec<Fault>,
    known: HashMap<(String, String), usize>,
    more: usize,
}

struct Fault {
    code: FailureCode,
    pointer: String,
    detail: String,
    /// The first point that has it, and how many others do.
    point: usize,
    others: usize,
}

impl Refused {
    fn add(&mut self, code: FailureCode, pointer: String, detail: String, point: usize) {
        // Faults of these kinds have different numbers at every point.
        let wording = if code == FailureCode::ValidationError { detail.clone() } else { String::new() };
        let key = (pointer.clone(), wording);
        if let Some(known) = self.known.get(&key) {
            self.faults[*known].others += 1;
        } else if self.faults.len() == MAX_FAULTS {
            self.more += 1;
        } else {
            self.known.insert(key, self.faults.len());
            self.faults.push(Fault { code, pointer, detail, point, others: 0 });
        }
    }

    /// The points, unless one was refused.
    fn or(self, points: Vec<Point>, named: bool) -> Result<Vec<Point>, Failure> {
        // A request that cannot be read is reported before one that cannot be packed.
        let codes = [
            FailureCode::ValidationError,
            FailureCode::TooLarge,
            FailureCode::InfeasibleMix,
            FailureCode::CoarseMix,
            FailureCode::FormatNotAvailable,
        ];
        let gravest = codes.into_iter().find(|code| self.faults.iter().any(|fault| fault.code == *code));
        let Some(code) = gravest.or(self.faults.first().map(|fault| fault.code)) else { return Ok(points) };
        let mut faults: Vec<FieldError> =
            self.faults.into_iter().map(|fault| fault.described(named)).collect();
        if self.more > 0 {
            faults.push(FieldError::and_more(self.more));
        }
        Err(Failure::fields(code, faults))
    }
}

impl Fault {
    /// With the points that have it, where the pointer does not name them.
    fn described(self, named: bool) -> FieldError {
        let detail = match (named, self.others) {
            (false, _) => self.detail,
            (true, 0) => format!("point {}: {}", self.point, self.detail),
            (true, others) => format!("point {} and {others} more: {}", self.point, self.detail),
        };
        FieldError::new(self.pointer, detail)
    }
}
