//! `packstone study --shard I/N`: the points of one shard of a study, in a folder that all shards share.
//!
//! The shards need not know of each other. Which points a shard runs follows from the study, from the forecast that the
//! first shard writes into the folder, and from `N` ([`crate::studies::shards`]). What was run before, by shards of any
//! `N` or without shards, is not repeated; a run that was cut goes on from its checkpoint. `claims` keeps two
//! processes from running the same point.

pub(super) mod claims;
pub(super) mod files;

use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::time::Instant;

use super::super::exit::{Exit, Failure, cannot_be};
use super::super::print;
use super::run_log::{Folder, StudyRecord};
use super::{Done, Log, Options, expand, limits, read_request};
use crate::studies::Study;
use crate::studies::shards::{Shard, assign, forecast_ms};
use claims::{COMPLETE_WITHIN, Claims, DEAD_AFTER, LOOK_AGAIN, settled};
use files::create;

/// File of the forecast, in the folder of the claims.
const FORECAST: &str = "forecast.json";

pub(super) fn run(options: &Options, shard: Shard) -> Result<(), Failure> {
    let limits = limits(options);
    let study = begin(options, &limits)?;
    let earlier = settled(&Folder(&options.out).logged(&study)?);
    let claims = Claims::open(&options.out, &study, &earlier, DEAD_AFTER)?;
    let points = &assign(&forecast(&options.out, &study)?, shard.count)[shard.index];
    // Point by point, so that few points are unfinished where the shard is stopped.
    let queue: VecDeque<(usize, usize)> =
        points.iter().flat_map(|&point| (0..study.replicates).map(move |run| (point, run))).collect();
    let mut done = Done::new(&study, Log::OfShard(&claims), Vec::new());
    let workers = options.workers().min(queue.len().max(1));
    let ended = done.run_rest(options, queue, workers, limits);
    claims.close()?;
    let stopped = ended?;
    let left: usize = points
        .iter()
        .filter(|&&point| {
            !done.tallies[point].stopped && !done.taken.iter().any(|(taken, _)| *taken == point)
        })
        .map(|&point| {
            let ended = done.records.iter().filter(|run| run.point == point).count();
            study.replicates.saturating_sub(ended)
        })
        .sum();
    print(&format!("{}\n", summary(shard, points.len(), &done, left)))?;
    if stopped && left > 0 {
        return Err(Exit::Interrupted.because(format_args!(
            "shard {shard} was stopped on request with {left} of its {} jobs not done; the next shards go on, of any \
             number",
            points.len() * study.replicates
        )));
    }
    Ok(())
}

fn summary(shard: Shard, points: usize, done: &Done<'_>, left: usize) -> String {
    if points == 0 {
        let all = done.study.points.len();
        return format!("shard {shard} has no points: the study has {all}");
    }
    let taken = match done.taken.len() {
        0 => String::new(),
        n => format!(", {n} of them left to other processes"),
    };
    let ended = done.records.len();
    format!("shard {shard}: {points} points{taken}, {ended} runs ended, {left} left")
}

/// Reads the study, and begins it in the folder if none is there.
fn begin(options: &Options, limits: &packstone_engine::Limits) -> Result<Study, Failure> {
    let request = read_request(options)?;
    std::fs::create_dir_all(&options.out).map_err(|error| cannot_be("made", &options.out, &error))?;
    let folder = Folder(&options.out);
    let begin = |stored: Option<&StudyRecord>| -> Result<(Study, StudyRecord), Failure> {
        let study = expand(options, &request, stored, limits)?;
        let record = StudyRecord::new(&study, &request)?;
        Ok((study, record))
    };
    if !folder.study().exists() {
        let (study, record) = begin(None)?;
        if create(&options.out, &folder.study(), &serde_json::to_vec_pretty(&record)?)? {
            return Ok(study);
        }
    }
    let stored = patiently(|| folder.record()?.ok_or_else(|| missing(&folder.study())))?;
    let (study, record) = begin(Some(&stored))?;
    stored.check(&record, &options.out, &options.study)?;
    Ok(study)
}

/// The forecast work of each point. It is computed once and read by all shards, because the last bits of it may depend
/// on the machine, and with them which shard has which point.
fn forecast(out: &Path, study: &Study) -> Result<Vec<u64>, Failure> {
    let path = out.join(files::FOLDER).join(FORECAST);
    let ours = forecast_ms(study);
    if !path.exists() && create(out, &path, &serde_json::to_vec(&ours)?)? {
        return Ok(ours);
    }
    patiently(|| {
        let text = std::fs::read(&path).map_err(|error| cannot_be("read", &path, &error))?;
        let read: Vec<u64> = serde_json::from_slice(&text).map_err(|error| damaged(&path, &error))?;
        let fits = read.len() == study.points.len();
        if fits { Ok(read) } else { Err(damaged(&path, &"it has another number of points")) }
    })
}

/// Reads what another process may be writing at this moment: a failure counts if it lasts.
fn patiently<T>(read: impl Fn() -> Result<T, Failure>) -> Result<T, Failure> {
    let begin = Instant::now();
    loop {
        match read() {
            Err(_) if begin.elapsed() < COMPLETE_WITHIN => std::thread::sleep(LOOK_AGAIN),
            read => return read,
        }
    }
}

fn missing(path: &Path) -> Failure {
    cannot_be("read", path, &io::Error::from(io::ErrorKind::NotFound))
}

fn damaged(path: &Path, what: &dyn std::fmt::Display) -> Failure {
    Exit::BadInput.because(format_args!("{} is damaged: {what}; remove it", path.display()))
}
