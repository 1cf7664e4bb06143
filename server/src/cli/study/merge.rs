//! `packstone study --merge`: the table and the plots of a study from the logs of all shards.
//!
//! The runs of a point count in the order in which they ended: those without shards first, then those of each
//! generation of its log. The table does not depend on how the points were assigned. A run that two logs hold must be
//! the same in both, or the merge is refused.

use std::collections::HashMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::super::exit::{Exit, Failure};
use super::run_log::{Folder, RunRecord, StudyRecord};
use super::shards::claims::{self, PointLog};
use super::shards::files::{self, publish};
use super::{
    Done, Log, Options, discard_checkpoints, expand, limits_elsewhere, print_table, read_request, report,
    summed_lines,
};
use crate::atomic_file::write_buffered;
use crate::studies::{Outcome, Study, Table};

/// Most points of which it is said what is missing.
const POINTS_NAMED: usize = 10;

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let request = read_request(options)?;
    let folder = Folder(&options.out);
    let stored = folder.record()?.ok_or_else(|| {
        Exit::BadInput.because(format_args!(
            "there is no study in {} to merge: name the folder of its shards by --out",
            options.out.display()
        ))
    })?;
    if !options.out.join(files::FOLDER).exists() {
        return Err(Exit::BadInput.because(format_args!(
            "{} holds no runs of shards: a study that was run without shards has its table already",
            options.out.display()
        )));
    }
    let study = expand(options, &request, Some(&stored), &limits_elsewhere(options))?;
    stored.check(&StudyRecord::new(&study, &request)?, &options.out, &options.study)?;
    let logs = claims::logs(&options.out, &study)?;
    let records = merged(&folder.runs(), &folder.logged(&study)?, &logs)?;
    let done = Done::with_void(&study, Log::Merged, records);
    let table = done.table();
    let written = write(options, &study, &done, &table)?;
    let missing = missing(&done, &table, &logs);
    if missing.is_empty() {
        // What killed processes left is of no more use.
        files::tidy(&options.out)?;
        discard_checkpoints(&options.checkpoints())?;
    }
    print_table(&table, &written)?;
    if missing.is_empty() {
        return Ok(());
    }
    let waiting: u64 = table.rows.iter().map(|row| row.cells.waiting).sum();
    Err(Exit::Unfinished.because(format_args!(
        "the study is unfinished, {waiting} of {} jobs are missing:\n  {}\nRun its shards again, of any number, and \
         merge them again",
        study.jobs(),
        missing.join("\n  ")
    )))
}

/// A run, and the file that tells of it.
struct Told<'a> {
    record: &'a RunRecord,
    by: &'a Path,
}

/// All runs, each once: those of a point in the order in which they ended, the points in their order.
fn merged(path: &Path, unsharded: &[RunRecord], logs: &[PointLog]) -> Result<Vec<RunRecord>, Failure> {
    let of_shards = logs.iter().flat_map(|log| log.runs.iter().map(|record| Told { record, by: &log.path }));
    let mut known: HashMap<(usize, usize), usize> = HashMap::new();
    let mut runs: Vec<Told<'_>> = Vec::new();
    for told in unsharded.iter().map(|record| Told { record, by: path }).chain(of_shards) {
        let key = (told.record.point, told.record.replicate);
        match known.get(&key) {
            None => {
                known.insert(key, runs.len());
                runs.push(told);
            }
            Some(&place) if runs[place].record.outcome == Outcome::Void => runs[place] = told,
            Some(_) if told.record.outcome == Outcome::Void => {}
            Some(&place) => check_equal(&runs[place], &told)?,
        }
    }
    let mut records: Vec<RunRecord> = runs.into_iter().map(|told| told.record.clone()).collect();
    // Stable: the order within a point is kept.
    records.sort_by_key(|record| record.point);
    Ok(records)
}

/// Refuses a run of which two logs tell different things.
fn check_equal(first: &Told<'_>, second: &Told<'_>) -> Result<(), Failure> {
    let (a, b) = (first.record, second.record);
    let differ = match (&a.digest, &b.digest) {
        (Some(a), Some(b)) => a != b,
        // Written by a version that made no digests.
        _ => a.outcome != b.outcome,
    };
    if !differ {
        return Ok(());
    }
    let digest = |told: &Told<'_>| {
        let digest = told.record.digest.as_deref().unwrap_or("no digest");
        format!("{digest} in {}", told.by.display())
    };
    Err(Exit::BadInput.because(format_args!(
        "two logs tell different things of point {}, replicate {}, seed {}:\n  {}\n  {}\nRuns without a limit of time \
         are equal on all machines: a log was changed, or the versions of Packstone or the machines differ. Remove the \
         line that is wrong, or both, and run the shards again",
        a.point,
        a.replicate,
        a.seed,
        digest(first),
        digest(second)
    )))
}

/// Writes all files where no other merge writes, then moves them to their place. Returns their paths.
fn write(options: &Options, study: &Study, done: &Done<'_>, table: &Table) -> Result<Vec<PathBuf>, Failure> {
    let staging = files::merge_staging(&options.out)?;
    let written =
        report::write(&staging, study, table, &done.records, !options.no_plot_titles).and_then(|files| {
            let runs = staging.join(Folder(&options.out).runs().file_name().unwrap_or_default());
            write_buffered(&runs, |out| {
                done.records
                    .iter()
                    .try_for_each(|record| out.write_all(summed_lines::line(record)?.as_bytes()))
            })?;
            publish(&staging, &options.out)?;
            Ok(files.iter().filter_map(|file| Some(options.out.join(file.file_name()?))).collect())
        });
    if written.is_err() {
        let _ = std::fs::remove_dir_all(&staging);
    }
    written
}

/// What is missing, a line for each of the first points.
fn missing(done: &Done<'_>, table: &Table, logs: &[PointLog]) -> Vec<String> {
    let waits = |(point, row): (usize, &crate::studies::table::Row)| {
        let waiting = row.cells.waiting;
        (waiting > 0).then_some((point, waiting))
    };
    let points: Vec<(usize, u64)> = table.rows.iter().enumerate().filter_map(waits).collect();
    let replicates = done.study.replicates;
    let mut lines: Vec<String> = points
        .iter()
        .take(POINTS_NAMED)
        .map(|&(point, waiting)| {
            let holder = logs.iter().rfind(|log| log.point == point).and_then(PointLog::holder);
            let holder = holder.map(|by| format!(", claimed by {by}")).unwrap_or_default();
            format!("point {point}: {waiting} of {replicates}{holder}")
        })
        .collect();
    if points.len() > POINTS_NAMED {
        lines.push(format!("and {} points more", points.len() - POINTS_NAMED));
    }
    lines
}
