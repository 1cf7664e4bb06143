//! A study whose runs the caller executes where it wants: its runs, its stop rules, its table and its plots.

use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

use packstone_engine::export::ExportError;
use packstone_engine::{Limits, PackError};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Ended, Job, Packed, Run, named, to_json};
use crate::advice::failure_of;
use crate::config::limits_of_one_packing;
use crate::failure::{Failure, FailureCode};
use crate::jobs::request;
use crate::plots::draw;
use crate::plots::study::{RunCurve, StudyOptions, StudyPlot, chart};
use crate::plots::theme::{Theme, themed};
use crate::problem::FailureDocument;
use crate::strict_json;
use crate::studies::stop::Tally;
use crate::studies::table::Rest;
use crate::studies::{self, Facts, Outcome, Table};

/// What a run of a study came to.
#[derive(Serialize)]
struct Record {
    outcome: Outcome,
    facts: Facts,
    /// Packing time in s and distance in mm over the growth.
    distance_curve: Vec<[f64; 2]>,
    /// Why there is no packing, or why its properties could not be computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<FailureDocument>,
}

/// The part of a record that the table and the plots need, with the place of the run.
#[derive(Deserialize)]
struct Counted {
    #[serde(flatten)]
    run: studies::Run,
    #[serde(default)]
    distance_curve: Vec<[f64; 2]>,
}

/// Packs the request of a run of a study, on this thread alone, and computes the properties that its `postprocess`
/// names; other exports are not made. What it came to as JSON (`outcome`, `facts`, `distance_curve`, and `error` where
/// there is no packing), and the packing. The outcome is `succeeded`, `partial` where the run ended before its target
/// and kept what it had reached, `target_not_reached` (also where the time limit of the job ended the run), or `void`
/// for a run that does not count.
///
/// # Errors
/// [`Ended::Refused`] for a request that does not hold; [`Ended::Stopped`].
pub fn run_of_study(request: &str, run: &Run) -> Result<(String, Option<Packed>), Ended> {
    let mut job = Job::read(request, None, None)?;
    // The runs of a study are made side by side.
    job.limits.threads = NonZeroUsize::MIN;
    let packed = job.packed(run)?;
    let time_s = run.time_s();
    let record = match &packed {
        Ok(packed) => {
            // The time limit of the job holds for the packing only.
            run.begin(None, false, None, job.request.on_limit);
            let (properties, error) = match packed.properties(&job.request, run) {
                Ok(properties) => (properties, None),
                Err(ExportError::Stopped) => return Err(Ended::Stopped),
                Err(error) => (None, Some(FailureDocument::from(&Failure::from(error)))),
            };
            let facts = Facts { properties, ..Facts::of_packing(packed.of_engine()) };
            let distance_curve = packed.of_engine().distance_curve();
            Record { outcome: facts.outcome_of_packing(), facts, distance_curve, error }
        }
        Err(PackError::Stopped { .. }) => {
            let failure = run.timed_out(job.request.timeout_s).ok_or(Ended::Stopped)?;
            let facts = Facts { time_s, ..Facts::default() };
            let error = Some(FailureDocument::from(&failure));
            Record { outcome: Outcome::TargetNotReached, facts, distance_curve: Vec::new(), error }
        }
        Err(error) => {
            let (outcome, facts) = (Outcome::of_failure(error), Facts::of_failure(error, time_s));
            let failure = failure_of(error.clone(), &job.request.packing(), &job.limits);
            let error = Some(FailureDocument::from(&failure));
            Record { outcome, facts, distance_curve: Vec::new(), error }
        }
    };
    Ok((to_json(&record)?, packed.ok()))
}

/// A study that was read.
#[derive(Debug)]
pub struct Study {
    study: studies::Study,
    tallies: Mutex<Vec<Tally>>,
}

impl Study {
    /// Reads a study in the form of `POST /v1/studies`; a study without a seed has one that is drawn.
    ///
    /// # Errors
    /// [`Ended::Refused`] with all faults of the study.
    pub fn read(text: &str) -> Result<Self, Ended> {
        let value = strict_json::parse(text.as_bytes())?;
        let limits = limits_of_one_packing(Limits::default().max_grains);
        let study = studies::Study::read(&value, request::draw_seed(), None, &limits)?;
        let tallies = Mutex::new(vec![Tally::default(); study.points.len()]);
        Ok(Self { study, tallies })
    }

    /// The study as JSON: `name`, `seed`, `columns` (the pointers of the values that vary), `points` (their values, and
    /// `warnings` of their plans), and `runs`, each with `point`, `replicate` and `request`, in the order in which a
    /// service starts them.
    ///
    /// # Errors
    /// None that a study causes.
    pub fn runs(&self) -> Result<String, Ended> {
        let study = &self.study;
        let keys = study.keys();
        let points: Vec<Value> = keys
            .values
            .iter()
            .zip(&study.points)
            .map(|(values, point)| json!({"values": values, "warnings": point.warnings}))
            .collect();
        let mut runs = Vec::with_capacity(study.jobs());
        for (point, replicate) in study.order() {
            let request = study.points[point].replicate(replicate);
            runs.push(json!({"point": point, "replicate": replicate, "request": request}));
        }
        to_json(&json!({
            "name": study.name, "seed": study.seed, "columns": keys.columns, "points": points, "runs": runs
        }))
    }

    /// Counts a run of a point that ended; whether the stop rule of the study is met, so that no further run of the
    /// point is to be started.
    ///
    /// # Errors
    /// [`Ended::Refused`] for a point or an outcome that there is not.
    pub fn count(&self, point: usize, outcome: &str) -> Result<bool, Ended> {
        let outcome = serde_json::from_value(outcome.into()).map_err(|_| {
            invalid(format!("{outcome:?} must be succeeded, partial, target_not_reached or void"))
        })?;
        let mut tallies = self.tallies.lock().unwrap_or_else(PoisonError::into_inner);
        let most = tallies.len();
        let tally =
            tallies.get_mut(point).ok_or_else(|| invalid(format!("point {point} is not below {most}")))?;
        Ok(tally.ended(outcome, &self.study.stop_when))
    }

    /// The table of the runs that have ended, in the form of `GET /v1/studies/{id}/table`, as JSON or as CSV; `records`
    /// is a JSON list of what [`run_of_study`] gave, each with its `point` and `replicate`.
    ///
    /// # Errors
    /// [`Ended::Refused`] for another form of the records or another format than `json` and `csv`.
    pub fn table(&self, records: &str, format: &str) -> Result<String, Ended> {
        let (table, _) = self.table_of(records)?;
        match format {
            "json" => to_json(&table),
            "csv" => Ok(table.to_csv()),
            other => Err(invalid(format!("{other:?} is no format of tables: must be json or csv"))),
        }
    }

    /// A plot of the table as SVG, against the column `x` or what suits the kind; `theme` is `light` or `dark`.
    ///
    /// # Errors
    /// [`Ended::Refused`] for another kind or column, and for a plot that no run has data for.
    pub fn plot(
        &self,
        kind: &str,
        records: &str,
        x: Option<&str>,
        log_x: Option<bool>,
        title: bool,
        theme: &str,
    ) -> Result<String, Ended> {
        let kind = named(StudyPlot::ALL, StudyPlot::name, "kind", kind)?;
        let theme = named(Theme::ALL, Theme::name, "theme", theme)?;
        let (table, curves) = self.table_of(records)?;
        let options = StudyOptions { x: x.map(str::to_owned), log_x };
        let chart = chart(kind, self.study.name.as_deref(), &table, &curves, &options)
            .map_err(|error| invalid(error.to_string()))?;
        Ok(themed(draw::svg(&chart, title)?, theme))
    }

    fn table_of(&self, records: &str) -> Result<(Table, Vec<RunCurve>), Ended> {
        let records: Vec<Counted> =
            serde_json::from_str(records).map_err(|error| invalid(error.to_string()))?;
        let tallies = self.tallies.lock().unwrap_or_else(PoisonError::into_inner);
        let mut ended = vec![0_usize; tallies.len()];
        for record in &records {
            // A point that there is not has no row either.
            if let Some(ended) = ended.get_mut(record.run.point) {
                *ended += 1;
            }
        }
        let rest: Vec<Rest> = tallies
            .iter()
            .zip(&self.study.points)
            .zip(ended)
            .map(|((tally, point), ended)| {
                let left = point.seeds.len().saturating_sub(ended) as u64;
                if tally.stopped {
                    Rest { waiting: 0, stopped_early: left }
                } else {
                    Rest { waiting: left, stopped_early: 0 }
                }
            })
            .collect();
        let mut curves: Vec<RunCurve> = records
            .iter()
            .filter(|record| record.run.replicate == 0 && !record.distance_curve.is_empty())
            .map(|record| RunCurve { point: record.run.point, points: record.distance_curve.clone() })
            .collect();
        curves.sort_by_key(|curve| curve.point);
        let runs: Vec<studies::Run> = records.into_iter().map(|record| record.run).collect();
        Ok((Table::new(&self.study.keys(), &runs, &rest), curves))
    }
}

fn invalid(detail: String) -> Ended {
    Failure::new(FailureCode::ValidationError, detail).into()
}
