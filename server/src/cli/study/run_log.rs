//! The run log of a study: a folder with the request and a record of every run that ended, from which a study that was
//! stopped or killed is resumed.
//!
//! `study.json` is the request, with its seed. `runs.jsonl` has one line per run, appended when the run ends. A line
//! begins with its sum ([`summed_lines`]). An incomplete last line is dropped, and its run is repeated.

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use packstone_engine::export::tables::EngineInfo;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::differences::differences;
use super::super::exit::{Exit, Failure, cannot_be};
use super::summed_lines;
use crate::atomic_file;
use crate::studies::{Facts, Outcome, Run, Study};
use crate::telemetry::say;

const STUDY: &str = "study.json";
const RUNS: &str = "runs.jsonl";
/// Interval of synchronization: a power cut loses at most the runs of this time. A kill loses none, because the lines
/// are in the page cache.
pub(super) const SYNC_EVERY: Duration = Duration::from_secs(2);

/// The content of `study.json`.
#[derive(Serialize, Deserialize)]
pub(super) struct StudyRecord {
    /// The program that made it.
    engine: Value,
    /// The request, with its seed, which may have been drawn.
    request: Value,
}

impl StudyRecord {
    /// Of a study.
    pub(super) fn new(study: &Study, request: &Value) -> Result<Self, Failure> {
        Ok(Self { engine: serde_json::to_value(EngineInfo::current())?, request: study.recorded(request) })
    }

    /// The seed of the study.
    pub(super) fn seed(&self) -> Option<u64> {
        self.request.get("seed").and_then(Value::as_u64)
    }

    /// Warns where another version of the engine made the runs, and fails where they are of another study.
    pub(super) fn check(&self, ours: &Self, folder: &Path, study: &Path) -> Result<(), Failure> {
        // As text: the order of a grid's records is that of its points.
        let text = |record: &Self| record.request.to_string();
        if text(self) != text(ours) {
            let mut lines = differences(&ours.request, "the file", &self.request, "the folder");
            if lines.is_empty() {
                lines.push("the order of their fields".into());
            }
            return Err(Exit::BadInput.because(format_args!(
                "{} holds another study than {}:\n  {}\nChange the study back, or take another folder by --out, or \
                 discard what is there by --fresh instead of --resume",
                folder.display(),
                study.display(),
                lines.join("\n  ")
            )));
        }
        if self.engine != ours.engine {
            say(&format!(
                "warning: the runs in {} were made by another version of the engine",
                folder.display()
            ));
        }
        Ok(())
    }
}

/// The record of a run that ended: a line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct RunRecord {
    pub(super) point: usize,
    pub(super) replicate: usize,
    pub(super) seed: u64,
    pub(super) outcome: Outcome,
    pub(super) facts: Facts,
    /// SHA-256 of what the run came to, without times: equal for equal runs on any machine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) digest: Option<String>,
    /// Time in s and distance in mm, of a point's first replicate.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) distance_curve: Vec<[f64; 2]>,
}

impl RunRecord {
    /// The run as the table counts it.
    pub(super) fn run(&self) -> Run {
        Run { point: self.point, replicate: self.replicate, outcome: self.outcome, facts: self.facts.clone() }
    }

    /// Whether the study has such a run.
    pub(super) fn is_of(&self, study: &Study) -> bool {
        let seed = study.points.get(self.point).and_then(|point| point.seeds.get(self.replicate));
        seed == Some(&self.seed)
    }
}

/// The log, locked by this process.
pub(super) struct RunLog {
    runs: File,
    synced: Instant,
}

/// The files of a study in a folder.
pub(super) struct Folder<'a>(pub(super) &'a Path);

impl Folder<'_> {
    /// The study of the folder, if there is one.
    pub(super) fn record(&self) -> Result<Option<StudyRecord>, Failure> {
        let path = self.study();
        match fs::read(&path) {
            Ok(text) => serde_json::from_slice(&text).map(Some).map_err(|error| {
                let text = format!("{} is damaged: {error}; discard it by --fresh", path.display());
                Exit::BadInput.because(text)
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(cannot_be("read", &path, &error)),
        }
    }

    /// Path of the study's request.
    pub(super) fn study(&self) -> PathBuf {
        self.0.join(STUDY)
    }

    /// Path of the log.
    pub(super) fn runs(&self) -> PathBuf {
        self.0.join(RUNS)
    }

    /// The runs of the log, which may be missing, without opening it for writing.
    pub(super) fn logged(&self, study: &Study) -> Result<Vec<RunRecord>, Failure> {
        let path = self.runs();
        match fs::read(&path) {
            Ok(text) => read(&text, study)
                .map(|(records, _)| records)
                .map_err(|what| Exit::BadInput.because(format_args!("{}: {what}", path.display()))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(cannot_be("read", &path, &error)),
        }
    }

    /// Opens the log for a study, empty where it is `fresh`, and returns what has ended so far, in that order.
    pub(super) fn open(
        &self,
        study: &Study,
        record: &StudyRecord,
        fresh: bool,
    ) -> Result<(RunLog, Vec<RunRecord>), Failure> {
        fs::create_dir_all(self.0).map_err(|error| cannot_be("made", self.0, &error))?;
        let path = self.runs();
        let unusable = |what: &str| format!("{}: {what}", path.display());
        let mut runs = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(&path)
            .map_err(|error| unusable(&error.to_string()))?;
        runs.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => unusable("another packstone works on this study"),
            TryLockError::Error(error) => unusable(&error.to_string()),
        })?;
        if fresh {
            runs.set_len(0)?;
        }
        write_whole(&self.study(), &serde_json::to_vec_pretty(record)?)?;
        let mut text = Vec::new();
        runs.read_to_end(&mut text)?;
        let (records, length) = read(&text, study).map_err(|what| unusable(&what))?;
        runs.set_len(length as u64)?;
        runs.seek(io::SeekFrom::End(0))?;
        Ok((RunLog { runs, synced: Instant::now() }, records))
    }
}

impl RunLog {
    /// Appends the record of a run that ended.
    pub(super) fn add(&mut self, record: &RunRecord) -> io::Result<()> {
        let line = summed_lines::line(record)?;
        // In one call, so that a kill rarely leaves an incomplete line.
        self.runs.write_all(line.as_bytes())?;
        if self.synced.elapsed() >= SYNC_EVERY {
            self.sync()?;
        }
        Ok(())
    }

    /// Synchronizes the log to the disk.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.synced = Instant::now();
        self.runs.sync_data()
    }
}

/// The records of a log, only the last one of each run, and the length of its complete lines.
fn read(text: &[u8], study: &Study) -> Result<(Vec<RunRecord>, usize), String> {
    let length = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let mut records: Vec<Option<RunRecord>> = Vec::new();
    let mut places: HashMap<(usize, usize), usize> = HashMap::new();
    for (i, line) in
        text[..length].split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty())
    {
        let damaged = |what: &str| {
            format!(
                "line {}: {what}; remove the line, or discard all runs by --fresh instead of --resume",
                i + 1
            )
        };
        let record: RunRecord = summed_lines::read(line).map_err(|what| damaged(&what))?;
        if !record.is_of(study) {
            return Err(damaged("the study has no such run"));
        }
        if let Some(earlier) = places.insert((record.point, record.replicate), records.len()) {
            records[earlier] = None;
        }
        records.push(Some(record));
    }
    Ok((records.into_iter().flatten().collect(), length))
}

/// Writes a file atomically: under its name there is always a complete file.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let written = atomic_file::write(path, |mut file| file.write_all(bytes), || Ok(()));
    written.map_err(|error| cannot_be("written", path, &error))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::Limits;
    use serde_json::json;

    use super::*;

    fn study(request: &Value) -> Study {
        Study::read(request, 1, None, &Limits::default()).unwrap()
    }

    fn request() -> Value {
        json!({
            "seed": 1, "replicates": 3,
            "template": {
                "specimen": {"type": "box", "size_mm": [50, 50, 50]},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
            },
            "grid": {"/mix/volume_fraction": [0.1, 0.2], "/priority": [1, 2]}
        })
    }

    fn run_record(study: &Study, point: usize, replicate: usize, time_s: f64) -> RunRecord {
        RunRecord {
            point,
            replicate,
            seed: study.points[point].seeds[replicate],
            outcome: Outcome::Succeeded,
            facts: Facts { time_s, grains: Some(7), ..Facts::default() },
            digest: Some("00".into()),
            distance_curve: if replicate == 0 { vec![[0.1, 0.2]] } else { Vec::new() },
        }
    }

    #[test]
    fn what_was_written_is_read_back_but_for_a_line_cut_short() {
        let directory = tempfile::tempdir().unwrap();
        let folder = Folder(directory.path());
        let study = study(&request());
        let record = StudyRecord::new(&study, &request()).unwrap();
        assert!(folder.record().unwrap().is_none());
        let (mut log, found) = folder.open(&study, &record, false).unwrap();
        assert!(found.is_empty());
        let records = [
            run_record(&study, 1, 2, 0.1),
            run_record(&study, 0, 0, 1.0 / 3.0),
            run_record(&study, 1, 2, 0.3),
        ];
        for record in &records {
            log.add(record).unwrap();
        }
        let blocked = folder.open(&study, &record, false).map(|_| ()).unwrap_err().to_string();
        assert!(blocked.contains("another packstone"), "{blocked}");
        log.sync().unwrap();
        drop(log);

        let path = directory.path().join(RUNS);
        let mut text = fs::read(&path).unwrap();
        text.extend_from_slice(b"{\"point\": 0, \"repl");
        fs::write(&path, &text).unwrap();
        let (mut log, found) = folder.open(&study, &record, false).unwrap();
        // The last line of a run counts.
        assert_eq!(found, records[1..]);
        let more = run_record(&study, 3, 1, 2.0);
        log.add(&more).unwrap();
        drop(log);
        let (_, found) = folder.open(&study, &record, false).unwrap();
        assert_eq!(found, [records[1].clone(), records[2].clone(), more]);
        let (_, found) = folder.open(&study, &record, true).unwrap();
        assert!(found.is_empty());
    }

    #[test]
    fn lines_of_another_study_are_told_of() {
        let study = study(&request());
        let mut foreign = run_record(&study, 0, 0, 1.0);
        foreign.seed += 1;
        for line in [summed_lines::line(&foreign).unwrap(), "{}\n".into(), "\0\0\n".into()] {
            let refused = read(format!("\n{line}").as_bytes(), &study).unwrap_err();
            assert!(refused.starts_with("line 2: ") && refused.contains("--fresh"), "{refused}");
        }
    }

    /// Any bit of any line but the last, whose end may have been cut with its line.
    #[test]
    fn a_flipped_bit_is_found() {
        let study = study(&request());
        let line = summed_lines::line(&run_record(&study, 1, 0, 0.5)).unwrap();
        let text = format!("{line}{}", summed_lines::line(&run_record(&study, 1, 1, 0.5)).unwrap());
        assert_eq!(read(text.as_bytes(), &study).unwrap().0.len(), 2);
        for bit in 0..8 * line.len() {
            let mut flipped = text.clone().into_bytes();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let refused = read(&flipped, &study).expect_err("a flipped bit");
            assert!(refused.starts_with("line "), "{refused}");
        }
    }

    #[test]
    fn another_study_is_told_by_what_differs() {
        let recorded = |request: &Value| StudyRecord::new(&study(request), request).unwrap();
        let check = |ours: &Value| {
            recorded(&request()).check(&recorded(ours), Path::new("out"), Path::new("study.json"))
        };
        assert!(check(&request()).is_ok());
        let mut other = request();
        other["replicates"] = json!(4);
        let refused = check(&other).unwrap_err().to_string();
        assert!(refused.contains("/replicates is 4 in the file and 3 in the folder"), "{refused}");
        let mut other = request();
        other["grid"] = json!({"/priority": [1, 2], "/mix/volume_fraction": [0.1, 0.2]});
        let refused = check(&other).unwrap_err().to_string();
        assert!(refused.contains("the order of their fields"), "{refused}");
    }
}
