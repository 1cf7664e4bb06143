//! Reads the request of a study: its grammar, with the faults of all of it at once.
//!
//! What is judged here needs no look at a single job: types, bounds, the places that values go to, how many
//! jobs there would be. What the jobs come to is [`super::expand`]'s matter.

use std::collections::{BTreeMap, HashSet};

use jiff::Timestamp;
use packstone_engine::request::MAX_SEED;
use packstone_engine::request::decode::{At, Bound, Faults, Object};
use packstone_engine::{FieldError, Limits};
use serde_json::{Number, Value};

use super::pointer::Pointer;
use super::{MAX_JOBS, MAX_REQUEST_BYTES, StopWhen, Study, expand};
use crate::jobs::request::{read_labels, read_name};
use crate::problem::{Kind, Problem};

/// Both ends of a range belong to it if it meets them up to this share of a step.
const RANGE_SLACK: f64 = 1e-9;
/// What a number of a range may be.
const RANGE: Bound = Bound::closed(-1e300, 1e300, "");

/// Why there is no study: always something the user can change.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Refusal {
    pub(crate) kind: Kind,
    pub(crate) faults: Vec<FieldError>,
}

impl Refusal {
    fn invalid(faults: Vec<FieldError>) -> Self {
        Self { kind: Kind::ValidationError, faults }
    }

    fn too_large(detail: String) -> Self {
        Self { kind: Kind::TooLarge, faults: vec![FieldError { pointer: String::new(), detail }] }
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        Self::fields(refusal.kind, refusal.faults)
    }
}

impl Study {
    /// Reads and expands a request. `seed` is used where it names none; `now` is what the `expires_at` of
    /// its jobs must lie after; every point must be within `limits`, or there is no study.
    pub(crate) fn read(
        value: &Value,
        seed: u64,
        now: Option<Timestamp>,
        limits: &Limits,
    ) -> Result<Self, Refusal> {
        let faults = Faults::default();
        let asked = At::root(value, &faults).object().and_then(|mut object| {
            let asked = Asked::read(&mut object, &faults, seed);
            object.finish();
            asked
        });
        if let Some(asked) = asked.filter(|_| faults.count() == 0) {
            asked.check_size()?;
            return expand::expand(&asked, now, limits);
        }
        Err(Refusal::invalid(faults.into_vec()))
    }

    /// The request as it is kept: with the seed that may have been drawn for it.
    pub(crate) fn recorded(&self, value: &Value) -> Value {
        let mut recorded = value.clone();
        if let Some(object) = recorded.as_object_mut() {
            object.insert("seed".into(), self.seed.into());
        }
        recorded
    }
}

/// A request whose grammar is right.
pub(super) struct Asked<'a> {
    pub(super) name: Option<String>,
    pub(super) labels: BTreeMap<String, String>,
    pub(super) seed: u64,
    pub(super) points: Points<'a>,
    pub(super) replicates: usize,
    pub(super) stop_when: StopWhen,
}

/// Where the points come from.
pub(super) enum Points<'a> {
    List(&'a [Value]),
    Template {
        job: &'a Value,
        /// Every combination of their values is a point.
        grid: Vec<Axis<'a>>,
        /// Their values run together.
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
            Self::Range { from, step, .. } => sum_on_paper(*from, i as f64 * step),
        }
    }
}

/// A sum to 12 significant digits of its larger term, so that what is 0.585 or 0 on paper is 0.585 or 0; a whole one
/// without a point, as a person would write it.
fn sum_on_paper(from: f64, way: f64) -> Value {
    let sum = from + way;
    // Digits of the term, not of the sum: where the terms all but cancel, the sum's own are rounding errors.
    let decimals = 11.0 - from.abs().max(way.abs()).log10().floor();
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
    /// How many there are; as many as a number can tell where there are more.
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

impl<'a> Asked<'a> {
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
        // With a number of replicates that cannot be read, what depends on it is not judged.
        let points = read_points(object, faults, replicates.unwrap_or(1) > 1);
        Some(Self {
            name,
            labels,
            seed: seed?,
            points: points?,
            replicates: replicates?,
            stop_when: stop_when?,
        })
    }

    fn check_size(&self) -> Result<(), Refusal> {
        let points = self.points.len();
        let jobs = points.saturating_mul(self.replicates as u64);
        if jobs > MAX_JOBS as u64 {
            return Err(Refusal::too_large(format!(
                "the study has {jobs} jobs (points: {points}, replicates: {}): must have at most {MAX_JOBS}",
                self.replicates
            )));
        }
        let bytes = self.request_bytes();
        if bytes > MAX_REQUEST_BYTES {
            return Err(Refusal::too_large(format!(
                "the requests of the {jobs} jobs are {bytes} bytes of JSON together: must be at most \
                 {MAX_REQUEST_BYTES}"
            )));
        }
        Ok(())
    }

    /// Length of the requests of all jobs, about. There are few enough jobs for it to be a number.
    fn request_bytes(&self) -> usize {
        let per_point = match &self.points {
            Points::List(jobs) => jobs.iter().map(json_bytes).sum::<usize>(),
            Points::Template { job, grid, zip } => {
                let points = self.points.len() as usize;
                let of_axis = |axis: &Axis<'_>| match &axis.values {
                    // Each value stands in as many points as any other.
                    Values::List(values) => {
                        values.iter().map(json_bytes).sum::<usize>().saturating_mul(points / values.len())
                    }
                    Values::Range { .. } => 0,
                };
                let axes = grid.iter().chain(zip).map(of_axis).sum::<usize>();
                json_bytes(job).saturating_mul(points).saturating_add(axes)
            }
        };
        per_point.saturating_mul(self.replicates)
    }
}

fn json_bytes(value: &Value) -> usize {
    struct Count(usize);
    impl std::io::Write for Count {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0 += bytes.len();
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let mut count = Count(0);
    // Counting cannot fail.
    let _ = serde_json::to_writer(&mut count, value);
    count.0
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
        for seed in items.iter().filter_map(seed_of) {
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
    let axes = at.members()?.into_iter().map(|(key, values)| {
        let pointer = Pointer::parse(key).and_then(|pointer| pointer.check(template).map(|()| pointer));
        let pointer = pointer.map_err(|detail| values.fault(detail)).ok();
        let read = read_values(&values);
        Some(Axis { pointer: pointer?, place: values.pointer().to_owned(), values: read? })
    });
    // Collected before it is judged, so that the faults of all entries are found.
    axes.collect::<Vec<_>>().into_iter().collect()
}

fn read_values<'a>(at: &At<'a>) -> Option<Values<'a>> {
    match at.value() {
        Value::Array(values) if values.is_empty() => {
            at.fault("has no values: must have at least 1");
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

/// A value that stands twice on an axis of the grid would be the same packings twice.
fn check_distinct(axes: &[Axis<'_>], faults: &Faults) {
    for axis in axes {
        let Values::List(values) = &axis.values else { continue };
        let mut seen = HashSet::new();
        for (i, value) in values.iter().enumerate() {
            if !seen.insert(value.to_string()) {
                faults.add(format!("{}/{i}", axis.place), "the value comes twice: must stand here once");
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
