//! Reads the request of a study and reports all faults of its own fields at once.
//!
//! This module checks types, bounds, the places that values are written to, and the number of jobs. [`super::expand`]
//! makes the jobs and checks each of them. The cost of every check is bounded before it starts: at most [`MAX_AXES`]
//! entries are compared with one another, and no axis has more than [`MAX_JOBS`] values.

use std::collections::{BTreeMap, HashSet};

use jiff::Timestamp;
use packstone_engine::request::MAX_SEED;
use packstone_engine::request::decode::{At, Bound, Faults, Object};
use packstone_engine::{FieldError, Limits};
use serde_json::{Number, Value};
use sha2::Digest as _;

use super::expand::Conditions;
use super::pointer::Pointer;
use super::{MAX_AXES, MAX_JOBS, MAX_POINT_VALUES, MAX_REQUEST_BYTES, StopWhen, Study, expand};
use crate::failure::{Failure, FailureCode};
use crate::jobs::request::{read_labels, read_name};
use crate::planning::Planner;
use crate::webhooks::WebhookUrl;

/// Tolerance, in steps, within which the end of a range belongs to the range.
const RANGE_SLACK: f64 = 1e-9;
/// Bound of the numbers of a range.
const RANGE: Bound = Bound::closed(-1e300, 1e300, "");

fn too_large(detail: String) -> Failure {
    Failure::fields(FailureCode::TooLarge, vec![FieldError::new("", detail)])
}

impl Study {
    /// Reads and expands a request. `seed` is used where it names none; `now` is what the `expires_at` of
    /// its jobs must lie after; every point must be within `limits`, or there is no study.
    pub(crate) fn read(
        value: &Value,
        seed: u64,
        now: Option<Timestamp>,
        limits: &Limits,
    ) -> Result<Self, Failure> {
        Self::read_while(value, seed, now, limits, &Planner::default(), &|| true)
    }

    /// Does the same as [`read`](Self::read) with a planner that others use, but ends with an internal error as soon as
    /// `go_on` returns `false`, because the client has gone.
    pub(crate) fn read_while(
        value: &Value,
        seed: u64,
        now: Option<Timestamp>,
        limits: &Limits,
        planner: &Planner,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Self, Failure> {
        let faults = Faults::default();
        let request = At::root(value, &faults).object().and_then(|mut object| {
            let request = StudyRequest::read(&mut object, &faults, seed);
            object.finish();
            request
        });
        if let Some(request) = request.filter(|_| faults.count() == 0) {
            request.check_size()?;
            return expand::expand(&request, &Conditions { now, limits, planner, go_on });
        }
        Err(Failure::invalid(faults.into_vec()))
    }

    /// The request as it is stored: with its seed, which may have been drawn, and without the URL of its webhook, which
    /// may contain a token.
    pub(crate) fn recorded(&self, value: &Value) -> Value {
        let mut recorded = value.clone();
        if let Some(object) = recorded.as_object_mut() {
            object.insert("seed".into(), self.seed.into());
            object.shift_remove("webhook_url");
        }
        recorded
    }
}

/// A request whose own fields are valid.
pub(super) struct StudyRequest<'a> {
    pub(super) name: Option<String>,
    pub(super) labels: BTreeMap<String, String>,
    pub(super) seed: u64,
    pub(super) points: Points<'a>,
    pub(super) replicates: usize,
    pub(super) stop_when: StopWhen,
    pub(super) shared: bool,
    pub(super) webhook_url: Option<WebhookUrl>,
}

/// The source of the points.
pub(super) enum Points<'a> {
    List(&'a [Value]),
    Template {
        job: &'a Value,
        /// Every combination of their values is a point.
        grid: Vec<Axis<'a>>,
        /// Point `i` has value `i` of each of them.
        zip: Vec<Axis<'a>>,
    },
}

/// The values of one place of the template.
pub(super) struct Axis<'a> {
    /// In the template.
    pub(super) pointer: Pointer,
    /// In the request.
    pub(super) place: String,
    pub(super) values: Values<'a>,
}

/// Values one by one, or a range of numbers.
pub(super) enum Values<'a> {
    List(&'a [Value]),
    Range { from: f64, step: f64, length: u64 },
}

impl Values<'_> {
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::List(values) => values.len() as u64,
            Self::Range { length, .. } => *length,
        }
    }

    /// Value `i` of [`Values::len`].
    pub(super) fn get(&self, i: usize) -> Value {
        match self {
            Self::List(values) => values.get(i).cloned().unwrap_or_default(),
            Self::Range { from, step, .. } => rounded_sum(*from, i as f64 * step),
        }
    }
}

/// A sum rounded to 12 significant digits of its larger term, so that 0.585 or 0 in decimal arithmetic is 0.585 or 0
/// here; whole numbers have no decimal point.
fn rounded_sum(from: f64, offset: f64) -> Value {
    let sum = from + offset;
    // Digits of the term, not of the sum: where the terms all but cancel, the sum's own are rounding errors.
    let decimals = 11.0 - from.abs().max(offset.abs()).log10().floor();
    let text = if decimals > 0.0 && decimals.is_finite() {
        format!("{sum:.*}", decimals as usize)
    } else {
        format!("{sum:.11e}")
    };
    let x: f64 = text.parse().unwrap_or(sum);
    if x.fract() == 0.0 && x.abs() <= MAX_SEED as f64 {
        Value::from(x as i64)
    } else {
        Number::from_f64(x).map_or(Value::Null, Value::Number)
    }
}

impl Points<'_> {
    /// Number of points, at most `u64::MAX`.
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::List(jobs) => jobs.len() as u64,
            Self::Template { grid, zip, .. } => {
                let together = zip.first().map_or(1, |axis| axis.values.len());
                grid.iter().fold(together, |n, axis| n.saturating_mul(axis.values.len()))
            }
        }
    }
}

impl<'a> StudyRequest<'a> {
    fn read(object: &mut Object<'a>, faults: &Faults, seed: u64) -> Option<Self> {
        let name = object.optional("name").and_then(|at| read_name(&at));
        let labels = object.optional("labels").and_then(|at| read_labels(&at, faults)).unwrap_or_default();
        let seed = match object.optional("seed") {
            Some(at) => at.integer(0, MAX_SEED as i64).map(|seed| seed as u64),
            None => Some(seed),
        };
        let replicates = match object.optional("replicates") {
            Some(at) => at.integer(1, MAX_JOBS as i64).map(|n| n as usize),
            None => Some(1),
        };
        let stop_when = match object.optional("stop_when") {
            Some(at) => read_stop_when(&at),
            None => Some(StopWhen::default()),
        };
        let shared = object.optional("shared").map_or(Some(false), |at| at.boolean());
        let webhook_url = object.optional("webhook_url").and_then(|at| WebhookUrl::read(&at));
        // Without a readable number of replicates, the checks that depend on it are skipped.
        let points = read_points(object, faults, replicates.unwrap_or(1) > 1);
        Some(Self {
            name,
            labels,
            seed: seed?,
            points: points?,
            replicates: replicates?,
            stop_when: stop_when?,
            shared: shared?,
            webhook_url,
        })
    }

    fn check_size(&self) -> Result<(), Failure> {
        let points = self.points.len();
        let jobs = points.saturating_mul(self.replicates as u64);
        if jobs > MAX_JOBS as u64 {
            return Err(too_large(format!(
                "the study has {jobs} jobs (points: {points}, replicates: {}): must have at most {MAX_JOBS}",
                self.replicates
            )));
        }
        let Size { bytes, values } = self.request_size();
        if values > MAX_POINT_VALUES {
            return Err(too_large(format!(
                "the requests of the {points} points hold {values} values together: must hold at most \
                 {MAX_POINT_VALUES}"
            )));
        }
        if bytes > MAX_REQUEST_BYTES {
            return Err(too_large(format!(
                "the requests of the {jobs} jobs are {bytes} bytes of JSON together: must be at most \
                 {MAX_REQUEST_BYTES}"
            )));
        }
        Ok(())
    }

    /// Size of the requests, approximately: bytes of all jobs, values of all points. The number of jobs is bounded
    /// already.
    fn request_size(&self) -> Size {
        let mut size = Size::default();
        match &self.points {
            Points::List(jobs) => jobs.iter().for_each(|job| size.add(job, 1)),
            Points::Template { job, grid, zip } => {
                let points = self.points.len() as usize;
                size.add(job, points);
                for axis in grid.iter().chain(zip) {
                    if let Values::List(values) = &axis.values {
                        // Each value occurs in as many points as any other.
                        values.iter().for_each(|value| size.add(value, points / values.len()));
                    }
                }
            }
        }
        size.bytes = size.bytes.saturating_mul(self.replicates);
        size
    }
}

/// Bytes of JSON, and values that take memory once they are read.
#[derive(Default)]
struct Size {
    bytes: usize,
    values: usize,
}

impl Size {
    /// Counts a document that occurs `times` times.
    fn add(&mut self, value: &Value, times: usize) {
        let mut count = Count { bytes: 0, commas: 0 };
        // Counting cannot fail.
        let _ = serde_json::to_writer(&mut count, value);
        self.bytes = self.bytes.saturating_add(count.bytes.saturating_mul(times));
        // Commas separate all values of a document but one for each array or object.
        self.values = self.values.saturating_add((count.commas + 1).saturating_mul(times));
    }
}

/// A writer that counts.
struct Count {
    bytes: usize,
    commas: usize,
}

impl std::io::Write for Count {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.bytes += bytes.len();
        for byte in bytes {
            self.commas += usize::from(*byte == b',');
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn read_stop_when(at: &At<'_>) -> Option<StopWhen> {
    let mut object = at.object()?;
    let failed = object.optional("failed_in_a_row").map(|at| at.integer(1, MAX_JOBS as i64));
    let width = object.optional("interval_width").map(|at| at.number(Bound::positive(1.0, "")));
    object.finish();
    let failed_in_a_row = match failed {
        Some(n) => Some(n? as u32),
        None => None,
    };
    let interval_width = match width {
        Some(width) => Some(width?),
        None => None,
    };
    Some(StopWhen { failed_in_a_row, interval_width })
}

fn read_points<'a>(object: &mut Object<'a>, faults: &Faults, replicated: bool) -> Option<Points<'a>> {
    let list = object.optional("list");
    let template = object.optional("template");
    let grid = object.optional("grid");
    let zip = object.optional("zip");
    match (list, template) {
        (Some(_), Some(template)) => {
            template.fault("a study has a list of jobs or a template, not both");
            None
        }
        (None, None) => {
            object.at().fault("there are no jobs: a study must have a list of them, or a template");
            None
        }
        (Some(list), None) => {
            for at in [grid, zip].into_iter().flatten() {
                at.fault("a list of jobs has no places to vary: give a template instead of the list");
            }
            read_list(&list, replicated)
        }
        (None, Some(template)) => {
            template.object()?;
            let job = template.value();
            let grid = grid.map_or(Some(Vec::new()), |at| read_axes(&at, job));
            if let Some(axes) = &grid {
                check_distinct(axes, faults);
            }
            let zip = zip.map_or(Some(Vec::new()), |at| read_axes(&at, job));
            if let Some(axes) = &zip {
                check_together(axes, faults);
            }
            let (grid, zip) = (grid?, zip?);
            let axes: Vec<&Axis<'_>> = grid.iter().chain(&zip).collect();
            check_places(&axes, faults);
            check_seed(&template, &axes, faults, replicated);
            Some(Points::Template { job, grid, zip })
        }
    }
}

fn read_list<'a>(at: &At<'a>, replicated: bool) -> Option<Points<'a>> {
    let items = at.array()?;
    if items.is_empty() {
        at.fault("has no jobs: must have at least 1");
        return None;
    }
    if replicated {
        for seed in items.iter().filter_map(|job| seed_of(&job)) {
            seed.fault(
                "with replicates the seeds derive from the study's: leave this field out, or the replicates",
            );
        }
    }
    at.value().as_array().map(|jobs| Points::List(jobs))
}

/// The seed that a job names.
fn seed_of<'a>(job: &At<'a>) -> Option<At<'a>> {
    job.value().is_object().then(|| job.object()?.optional("seed")).flatten()
}

/// The entries of the grid or the zip.
fn read_axes<'a>(at: &At<'a>, template: &Value) -> Option<Vec<Axis<'a>>> {
    let axes = at.members(MAX_AXES)?.into_iter().map(|(key, values)| {
        let pointer = Pointer::parse(key).and_then(|pointer| pointer.check(template).map(|()| pointer));
        let pointer = pointer.map_err(|detail| values.fault(detail)).ok();
        let read = read_values(&values);
        Some(Axis { pointer: pointer?, place: values.pointer().to_owned(), values: read? })
    });
    // Collected first, so that the faults of all entries are found.
    axes.collect::<Vec<_>>().into_iter().collect()
}

fn read_values<'a>(at: &At<'a>) -> Option<Values<'a>> {
    match at.value() {
        Value::Array(values) if values.is_empty() => {
            at.fault("has no values: must have at least 1");
            None
        }
        Value::Array(values) if values.len() > MAX_JOBS => {
            at.fault(format!("has {} values: must have at most {MAX_JOBS}", values.len()));
            None
        }
        Value::Array(values) => Some(Values::List(values)),
        Value::Object(_) => read_range(at),
        _ => {
            at.fault(
                "must be a list of values, or a range as {\"from\": 0.55, \"to\": 0.7, \"step\": 0.005}",
            );
            None
        }
    }
}

fn read_range<'a>(at: &At<'a>) -> Option<Values<'a>> {
    let mut object = at.object()?;
    let mut number = |name| object.required(name).and_then(|at: At<'_>| Some((at.number(RANGE)?, at)));
    let (from, to, step) = (number("from"), number("to"), number("step"));
    object.finish();
    let ((from, _), (to, _), (step, step_at)) = (from?, to?, step?);
    let steps = (to - from) / step;
    if step == 0.0 || steps < 0.0 || !steps.is_finite() {
        step_at.fault(format!("{step} is out of range: must lead from {from} to {to}"));
        return None;
    }
    Some(Values::Range { from, step, length: ((steps + RANGE_SLACK).floor() as u64).saturating_add(1) })
}

/// A value that occurs twice on an axis of the grid would give the same packings twice.
fn check_distinct(axes: &[Axis<'_>], faults: &Faults) {
    for axis in axes {
        let Values::List(values) = &axis.values else { continue };
        let mut seen = HashSet::new();
        for (i, value) in values.iter().enumerate() {
            // Digests, because a value can be as long as the body.
            if !seen.insert(sha2::Sha256::digest(value.to_string())) {
                faults.add(format!("{}/{i}", axis.place), "the value occurs twice: must occur once");
            }
        }
    }
}

fn check_together(axes: &[Axis<'_>], faults: &Faults) {
    let Some((first, others)) = axes.split_first() else { return };
    for axis in others {
        let (found, expected) = (axis.values.len(), first.values.len());
        if found != expected {
            let of = first.pointer.text();
            faults.add(
                &axis.place,
                format!("has {found} values: must have {expected} as {of}, which it runs together with"),
            );
        }
    }
}

fn check_places(axes: &[&Axis<'_>], faults: &Faults) {
    for (i, axis) in axes.iter().enumerate() {
        let before = axes[..i].iter().map(|other| &other.pointer);
        for other in before.filter(|other| axis.pointer.holds(other) || other.holds(&axis.pointer)) {
            let other = other.text();
            faults.add(
                &axis.place,
                format!("the place overlaps with that of {other}: put whole objects on one of the two"),
            );
        }
    }
}

fn check_seed(template: &At<'_>, axes: &[&Axis<'_>], faults: &Faults, replicated: bool) {
    match axes.iter().find(|axis| axis.pointer.text() == "/seed") {
        Some(axis) if replicated => faults.add(
            &axis.place,
            "with replicates the seeds derive from the study's: leave this entry out, or the replicates",
        ),
        Some(_) => {}
        None => {
            if let Some(seed) = seed_of(template) {
                seed.fault(
                    "the seeds of the jobs derive from the study's: leave this field out, and give the study \
                     itself a seed",
                );
            }
        }
    }
}

#[cfg(test)]
#[path = "request_tests.rs"]
mod tests;
