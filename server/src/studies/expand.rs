//! From a request whose grammar is right to points and their jobs: all of them, or none.
//!
//! Every job is read and planned as if it had been submitted alone. What is wrong with it is told at the place
//! of the study's request where the user can mend it, once for all points that have the fault.

use std::collections::HashMap;

use jiff::Timestamp;
use packstone_engine::{FieldError, Limits, Plan, PlanError};
use serde_json::Value;

use super::request::{Asked, Axis, Points, Refusal, Values};
use super::seeds::Seeds;
use super::{Point, Study};
use crate::jobs::JobRequest;
use crate::problem::{self, Kind};

/// Most faults that a refusal tells of.
const MAX_FAULTS: usize = 100;

pub(super) fn expand(asked: &Asked<'_>, now: Option<Timestamp>, limits: &Limits) -> Result<Study, Refusal> {
    let (points, columns) = match &asked.points {
        Points::List(jobs) => (of_list(asked, jobs, now, limits)?, Vec::new()),
        Points::Template { job, grid, zip } => {
            let axes = Axes { grid, zip };
            let columns = axes.all().map(|axis| axis.pointer.text().to_owned()).collect();
            (of_template(asked, job, &axes, now, limits)?, columns)
        }
    };
    Ok(Study {
        name: asked.name.clone(),
        labels: asked.labels.clone(),
        seed: asked.seed,
        columns,
        points,
        replicates: asked.replicates,
        stop_when: asked.stop_when,
    })
}

fn of_list(
    asked: &Asked<'_>,
    jobs: &[Value],
    now: Option<Timestamp>,
    limits: &Limits,
) -> Result<Vec<Point>, Refusal> {
    let mut points = Vec::with_capacity(jobs.len());
    let mut refused = Refused::default();
    for (i, job) in jobs.iter().enumerate() {
        let seeds = Seeds::of_listed(asked.seed, i);
        match read_point(job, Vec::new(), &seeds, asked.replicates, now, limits) {
            Ok(point) => points.push(point),
            Err((kind, faults)) => {
                for fault in faults {
                    refused.add(kind, format!("/list/{i}{}", fault.pointer), fault.detail, i);
                }
            }
        }
    }
    refused.or(points, false)
}

fn of_template(
    asked: &Asked<'_>,
    template: &Value,
    axes: &Axes<'_>,
    now: Option<Timestamp>,
    limits: &Limits,
) -> Result<Vec<Point>, Refusal> {
    let count = asked.points.len() as usize;
    let mut points = Vec::with_capacity(count);
    let mut refused = Refused::default();
    // One copy for all points: every axis is written at every point.
    let mut job = template.clone();
    for i in 0..count {
        let places = axes.at(i);
        let values: Vec<Value> = axes.all().zip(&places).map(|(axis, at)| axis.values.get(*at)).collect();
        for (axis, value) in axes.all().zip(&values) {
            axis.pointer.put(&mut job, value.clone());
        }
        let seeds = Seeds::of_point(asked.seed, axes.all().map(|axis| &axis.pointer).zip(&values));
        match read_point(&job, values, &seeds, asked.replicates, now, limits) {
            Ok(point) => points.push(point),
            Err((kind, faults)) => {
                for fault in faults {
                    refused.add(kind, axes.place(&places, &fault.pointer), fault.detail, i);
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
    now: Option<Timestamp>,
    limits: &Limits,
) -> Result<Point, (Kind, Vec<FieldError>)> {
    let job =
        JobRequest::read(job, seeds.replicate(0), now).map_err(|faults| (Kind::ValidationError, faults))?;
    Plan::new(&job.packing(), limits).map_err(|error| match error {
        PlanError::Invalid(faults) => (Kind::ValidationError, faults),
        PlanError::TooLarge(fault) => (Kind::TooLarge, vec![fault]),
        PlanError::Infeasible(fault) => (Kind::InfeasibleMix, vec![fault]),
        PlanError::Coarse(fault) => (Kind::CoarseMix, vec![fault]),
    })?;
    job.check_postprocess(limits).map_err(|problem| {
        let at = |fault: problem::Fault| FieldError {
            pointer: fault.pointer.unwrap_or_default(),
            detail: fault.detail,
        };
        (problem.kind, problem.errors.into_iter().map(at).collect::<Vec<_>>())
    })?;
    // The first may be the job's own; where there are others, it names none.
    let seeds = std::iter::once(job.seed).chain((1..replicates).map(|r| seeds.replicate(r))).collect();
    Ok(Point { values, job, seeds })
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

    /// Which value each axis has at a point: the last of the grid varies faster than the others, and the
    /// zip faster than the grid.
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

    /// Where the study's request says what the job has at `pointer`.
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
    kind: Kind,
    pointer: String,
    detail: String,
    /// The first point that has it, and how many others do.
    point: usize,
    others: usize,
}

impl Refused {
    fn add(&mut self, kind: Kind, pointer: String, detail: String, point: usize) {
        // What does not fit, or is too much, says so with other numbers at every point.
        let wording = if kind == Kind::ValidationError { detail.clone() } else { String::new() };
        let key = (pointer.clone(), wording);
        if let Some(known) = self.known.get(&key) {
            self.faults[*known].others += 1;
        } else if self.faults.len() == MAX_FAULTS {
            self.more += 1;
        } else {
            self.known.insert(key, self.faults.len());
            self.faults.push(Fault { kind, pointer, detail, point, others: 0 });
        }
    }

    /// The points, unless one was refused.
    fn or(mut self, points: Vec<Point>, named: bool) -> Result<Vec<Point>, Refusal> {
        if self.more > 0 {
            self.faults.truncate(MAX_FAULTS - 1);
        }
        // What cannot be read at all comes before what could not be packed.
        let gravest = [Kind::ValidationError, Kind::TooLarge, Kind::InfeasibleMix, Kind::CoarseMix]
            .into_iter()
            .find(|kind| self.faults.iter().any(|fault| fault.kind == *kind));
        let Some(kind) = gravest else { return Ok(points) };
        let mut faults: Vec<FieldError> = self.faults.into_iter().map(|fault| fault.told(named)).collect();
        if self.more > 0 {
            let detail = format!("and {} faults more: mend these first", self.more + 1);
            faults.push(FieldError { pointer: String::new(), detail });
        }
        Err(Refusal { kind, faults })
    }
}

impl Fault {
    /// With the points that have it, where the pointer does not name them.
    fn told(self, named: bool) -> FieldError {
        let detail = match (named, self.others) {
            (false, _) => self.detail,
            (true, 0) => format!("point {}: {}", self.point, self.detail),
            (true, others) => format!("point {} and {others} more: {}", self.point, self.detail),
        };
        FieldError { pointer: self.pointer, detail }
    }
}
