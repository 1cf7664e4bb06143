//! What the service counts about itself, in the text form that Prometheus reads.
//!
//! Counters live here; what the store knows (jobs by state) is asked for at each scrape, so that it
//! is right after a restart too.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::exports::ExportState;
use crate::jobs::State;
use crate::jobs::store::{ForecastWork, UNKNOWN_FORECAST};
use crate::telemetry;

/// Upper bounds of the classes of a request's time, in s.
const REQUEST_BOUNDS_S: &[f64] = &[0.001, 0.005, 0.025, 0.1, 0.5, 2.5, 10.0, 60.0];
/// Upper bounds of the classes of a job's time, in s.
const JOB_BOUNDS_S: &[f64] = &[0.1, 0.5, 1.0, 5.0, 15.0, 60.0, 300.0, 1800.0, 7200.0, 43200.0];

/// What happens to the leases of workers in other processes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LeaseEvent {
    /// A job was given to a worker.
    Taken,
    Renewed,
    /// It ran out, and its job was taken back. Those of the workers of this server are counted too.
    Expired,
    /// A request about a lease that was lost was refused.
    Refused,
}

impl LeaseEvent {
    const ALL: [(Self, &'static str); 4] = [
        (Self::Taken, "taken"),
        (Self::Renewed, "renewed"),
        (Self::Expired, "expired"),
        (Self::Refused, "refused"),
    ];
}

/// What came of the check of what a worker process has sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CheckOutcome {
    /// It answers the request.
    Right,
    /// It does not.
    Wrong,
    /// A stop of the server, a cancellation or a fault of the machine ended the check.
    Broken,
}

impl CheckOutcome {
    const ALL: [(Self, &'static str); 3] =
        [(Self::Right, "right"), (Self::Wrong, "wrong"), (Self::Broken, "broken_off")];
}

/// All counters.
#[derive(Debug, Default)]
pub(crate) struct Metrics {
    submitted: AtomicU64,
    studies_submitted: AtomicU64,
    sweeps: AtomicU64,
    over_rate: AtomicU64,
    audit_lines_lost: AtomicU64,
    failed_sweeps: AtomicU64,
    /// By [`LeaseEvent`].
    leases: [AtomicU64; LeaseEvent::ALL.len()],
    workers_refused: AtomicU64,
    /// By [`CheckOutcome`].
    checks: Mutex<[Histogram; CheckOutcome::ALL.len()]>,
    ended: Mutex<BTreeMap<&'static str, Histogram>>,
    /// By type and outcome.
    exports: Mutex<BTreeMap<(&'static str, &'static str), Histogram>>,
    requests: Mutex<BTreeMap<(String, String), Requests>>,
    /// Attempts to send webhooks by outcome.
    webhooks: Mutex<BTreeMap<&'static str, u64>>,
}

#[derive(Debug, Default)]
struct Requests {
    by_status: BTreeMap<u16, u64>,
    times: Histogram,
}

#[derive(Clone, Debug, Default)]
struct Histogram {
    counts: Vec<u64>,
    count: u64,
    sum_s: f64,
}

impl Histogram {
    fn record(&mut self, bounds: &[f64], took: Duration) {
        let s = took.as_secs_f64();
        self.counts.resize(bounds.len(), 0);
        for (count, bound) in self.counts.iter_mut().zip(bounds) {
            *count += u64::from(s <= *bound);
        }
        self.count += 1;
        self.sum_s += s;
    }

    fn render(&self, out: &mut Text, name: &str, labels: &str, bounds: &[f64]) {
        for (bound, count) in bounds.iter().zip(&self.counts) {
            out.line(&format!("{name}_bucket"), &format!("{labels},le=\"{bound}\""), count);
        }
        out.line(&format!("{name}_bucket"), &format!("{labels},le=\"+Inf\""), self.count);
        out.line(&format!("{name}_sum"), labels, self.sum_s);
        out.line(&format!("{name}_count"), labels, self.count);
    }
}

/// What is known of the moment of a scrape.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gauges {
    pub(crate) jobs: BTreeMap<State, u64>,
    pub(crate) work: ForecastWork,
    pub(crate) open_studies: u64,
    pub(crate) export: BTreeMap<ExportState, u64>,
    pub(crate) export_cache_bytes: u64,
    pub(crate) workers: usize,
    /// Slots of this server that jobs hold.
    pub(crate) busy_slots: usize,
    /// Jobs that run in other processes.
    pub(crate) running_elsewhere: u64,
    /// Workers in other processes that were heard within the time of a lease.
    pub(crate) worker_processes: usize,
    pub(crate) connections: usize,
    pub(crate) results_being_sent: usize,
    /// Bytes of stored files by kind.
    pub(crate) stored_bytes: BTreeMap<&'static str, u64>,
    /// Free bytes of the disk, and those that must stay free.
    pub(crate) disk: Option<(u64, u64)>,
    /// Faults after which the database was opened anew.
    pub(crate) store_faults: u64,
    /// Seconds that the oldest waiting job has waited.
    pub(crate) queue_age_s: f64,
    /// Seconds since the newest checkpoint was written, if there is one.
    pub(crate) checkpoint_age_s: Option<f64>,
    /// Webhooks that wait to be sent.
    pub(crate) webhooks_waiting: u64,
    /// Results of worker processes that wait for their check or are being checked.
    pub(crate) unchecked: u64,
    /// Worker processes that get no job because of their wrong results.
    pub(crate) blocked_workers: usize,
}

impl Metrics {
    /// A sweep ended, well or not.
    pub(crate) fn swept(&self, succeeded: bool) {
        let counter = if succeeded { &self.sweeps } else { &self.failed_sweeps };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    /// Something happened to so many leases.
    pub(crate) fn lease(&self, event: LeaseEvent, leases: u64) {
        self.leases[event as usize].fetch_add(leases, Ordering::Relaxed);
    }

    /// A worker of another build, or with other bits, was refused.
    pub(crate) fn worker_refused(&self) {
        self.workers_refused.fetch_add(1, Ordering::Relaxed);
    }

    /// The check of what a worker process has sent ended after some time.
    pub(crate) fn result_checked(&self, outcome: CheckOutcome, took: Duration) {
        let mut checks = self.checks.lock().unwrap_or_else(PoisonError::into_inner);
        checks[outcome as usize].record(JOB_BOUNDS_S, took);
    }

    /// A request was refused because its key sent too many.
    pub(crate) fn request_over_rate(&self) {
        self.over_rate.fetch_add(1, Ordering::Relaxed);
    }

    /// Lines of the audit log that could not be written.
    #[cfg(test)]
    pub(crate) fn audit_lines_lost(&self) -> u64 {
        self.audit_lines_lost.load(Ordering::Relaxed)
    }

    /// A line of the audit log could not be written.
    pub(crate) fn audit_line_lost(&self) {
        self.audit_lines_lost.fetch_add(1, Ordering::Relaxed);
    }

    /// A job was accepted.
    pub(crate) fn job_submitted(&self) {
        self.submitted.fetch_add(1, Ordering::Relaxed);
    }

    /// A study was accepted with so many jobs.
    pub(crate) fn study_submitted(&self, jobs: u64) {
        self.studies_submitted.fetch_add(1, Ordering::Relaxed);
        self.submitted.fetch_add(jobs, Ordering::Relaxed);
    }

    /// A run ended after some time.
    pub(crate) fn job_ended(&self, outcome: &'static str, took: Duration) {
        let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        ended.entry(outcome).or_default().record(JOB_BOUNDS_S, took);
    }

    /// Making something of a result ended after some time.
    pub(crate) fn export_ended(&self, kind: &'static str, outcome: &'static str, took: Duration) {
        let mut exports = self.exports.lock().unwrap_or_else(PoisonError::into_inner);
        exports.entry((kind, outcome)).or_default().record(JOB_BOUNDS_S, took);
    }

    /// A webhook was sent: `delivered`, `retried` (later) or `failed` (for good).
    pub(crate) fn webhook_sent(&self, outcome: &'static str) {
        let mut webhooks = self.webhooks.lock().unwrap_or_else(PoisonError::into_inner);
        *webhooks.entry(outcome).or_default() += 1;
    }

    /// A request was answered: its head was ready after some time. `route` is a pattern, never a
    /// path, of which there is no end.
    pub(crate) fn request_answered(&self, method: &str, route: &str, status: u16, took: Duration) {
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let of_route = requests.entry((route.to_owned(), method.to_owned())).or_default();
        *of_route.by_status.entry(status).or_default() += 1;
        of_route.times.record(REQUEST_BOUNDS_S, took);
    }

    /// The text form.
    pub(crate) fn render(&self, gauges: &Gauges) -> String {
        let mut out = Text::default();
        out.head("packstone_jobs", "gauge", "Jobs in the store by state.");
        for (state, jobs) in &gauges.jobs {
            out.line("packstone_jobs", &format!("state=\"{}\"", state.name()), jobs);
        }
        self.workers(&mut out, gauges);
        work(&mut out, gauges.work);
        out.head("packstone_studies_open", "gauge", "Studies with jobs left to run.");
        out.line("packstone_studies_open", "", gauges.open_studies);
        out.head("packstone_exports", "gauge", "Models of results in the store by state.");
        for (state, export) in &gauges.export {
            out.line("packstone_exports", &format!("state=\"{}\"", state.name()), export);
        }
        out.head(
            "packstone_export_cache_bytes",
            "gauge",
            "Bytes of exports that are not kept with their jobs.",
        );
        out.line("packstone_export_cache_bytes", "", gauges.export_cache_bytes);
        out.head("packstone_stored_bytes", "gauge", "Bytes of results, kept exports and cached exports.");
        for (kind, bytes) in &gauges.stored_bytes {
            out.line("packstone_stored_bytes", &format!("kind=\"{kind}\""), bytes);
        }
        if let Some((free, least)) = gauges.disk {
            out.head("packstone_disk_free_bytes", "gauge", "Free bytes of the data directory's file system.");
            out.line("packstone_disk_free_bytes", "", free);
            out.head("packstone_disk_min_free_bytes", "gauge", "Bytes of it that must stay free.");
            out.line("packstone_disk_min_free_bytes", "", least);
        }
        out.head("packstone_queue_age_seconds", "gauge", "Time that the oldest waiting job has waited.");
        out.line("packstone_queue_age_seconds", "", gauges.queue_age_s);
        if let Some(age_s) = gauges.checkpoint_age_s {
            out.head(
                "packstone_checkpoint_age_seconds",
                "gauge",
                "Time since the newest checkpoint was written.",
            );
            out.line("packstone_checkpoint_age_seconds", "", age_s);
        }
        out.head("packstone_sweeps_total", "counter", "Sweeps by outcome.");
        out.line("packstone_sweeps_total", "outcome=\"succeeded\"", self.sweeps.load(Ordering::Relaxed));
        out.line("packstone_sweeps_total", "outcome=\"failed\"", self.failed_sweeps.load(Ordering::Relaxed));
        out.head(
            "packstone_store_faults_total",
            "counter",
            "Faults after which the database was opened anew.",
        );
        out.line("packstone_store_faults_total", "", gauges.store_faults);
        let name = "packstone_audit_lines_lost_total";
        out.head(name, "counter", "Lines of the audit log that could not be written.");
        out.line(name, "", self.audit_lines_lost.load(Ordering::Relaxed));
        let name = "packstone_log_lines_lost_total";
        out.head(name, "counter", "Lines of the log that could not be written to standard error.");
        out.line(name, "", telemetry::lost_lines());
        process(&mut out);
        out.head("packstone_http_connections", "gauge", "Open connections.");
        out.line("packstone_http_connections", "", gauges.connections);
        out.head("packstone_results_being_sent", "gauge", "Results that are being converted and sent.");
        out.line("packstone_results_being_sent", "", gauges.results_being_sent);
        out.head("packstone_jobs_submitted_total", "counter", "Jobs accepted since the start.");
        out.line("packstone_jobs_submitted_total", "", self.submitted.load(Ordering::Relaxed));
        out.head("packstone_studies_submitted_total", "counter", "Studies accepted since the start.");
        out.line("packstone_studies_submitted_total", "", self.studies_submitted.load(Ordering::Relaxed));
        out.head("packstone_job_duration_seconds", "histogram", "Time of runs by outcome.");
        for (outcome, times) in self.ended.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            let labels = format!("outcome=\"{outcome}\"");
            times.render(&mut out, "packstone_job_duration_seconds", &labels, JOB_BOUNDS_S);
        }
        let name = "packstone_export_duration_seconds";
        out.head(name, "histogram", "Time of making exports of results, by type and outcome.");
        for ((kind, outcome), times) in self.exports.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            let labels = format!("type=\"{kind}\",outcome=\"{outcome}\"");
            times.render(&mut out, name, &labels, JOB_BOUNDS_S);
        }
        let name = "packstone_webhook_deliveries_total";
        out.head(name, "counter", "Attempts to send webhooks by outcome.");
        for (outcome, count) in self.webhooks.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            out.line(name, &format!("outcome=\"{outcome}\""), count);
        }
        let name = "packstone_webhook_deliveries_waiting";
        out.head(name, "gauge", "Webhooks that wait to be sent, or to be sent again.");
        out.line(name, "", gauges.webhooks_waiting);
        let requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        out.head("packstone_http_requests_total", "counter", "Requests answered.");
        for ((route, method), of_route) in requests.iter() {
            for (status, count) in &of_route.by_status {
                let labels = format!("method=\"{method}\",route=\"{route}\",status=\"{status}\"");
                out.line("packstone_http_requests_total", &labels, count);
            }
        }
        let name = "packstone_http_requests_over_rate_total";
        out.head(name, "counter", "Requests refused because their API key sent too many.");
        out.line(name, "", self.over_rate.load(Ordering::Relaxed));
        let name = "packstone_http_request_duration_seconds";
        out.head(name, "histogram", "Time until the head of the answer was ready.");
        for ((route, method), of_route) in requests.iter() {
            let labels = format!("method=\"{method}\",route=\"{route}\"");
            of_route.times.render(&mut out, name, &labels, REQUEST_BOUNDS_S);
        }
        out.0
    }

    /// Where jobs run, and the leases of other processes.
    fn workers(&self, out: &mut Text, gauges: &Gauges) {
        let running = gauges.jobs.get(&State::Running).copied().unwrap_or_default();
        let name = "packstone_jobs_running";
        out.head(name, "gauge", "Jobs that run, in this server and in other processes.");
        out.line(name, "place=\"server\"", running.saturating_sub(gauges.running_elsewhere));
        out.line(name, "place=\"worker\"", gauges.running_elsewhere);
        out.head("packstone_workers", "gauge", "Jobs that this server may run at once itself.");
        out.line("packstone_workers", "", gauges.workers);
        let name = "packstone_worker_slots_busy";
        out.head(name, "gauge", "Of these, those that a packing takes: one for each of its threads.");
        out.line(name, "", gauges.busy_slots);
        let name = "packstone_worker_processes";
        out.head(name, "gauge", "Workers in other processes that were heard within the time of a lease.");
        out.line(name, "", gauges.worker_processes);
        let name = "packstone_leases_total";
        out.head(name, "counter", "Leases of workers in other processes by what happened to them.");
        for (event, label) in LeaseEvent::ALL {
            let count = self.leases[event as usize].load(Ordering::Relaxed);
            out.line(name, &format!("event=\"{label}\""), count);
        }
        let name = "packstone_workers_refused_total";
        out.head(
            name,
            "counter",
            "Requests of workers of another build, or with other bits, that were refused.",
        );
        out.line(name, "", self.workers_refused.load(Ordering::Relaxed));
        let name = "packstone_workers_blocked";
        out.head(name, "gauge", "Worker processes that get no job because of their wrong results.");
        out.line(name, "", gauges.blocked_workers);
        let name = "packstone_results_unchecked";
        out.head(
            name,
            "gauge",
            "Results of worker processes that wait for their check or are being checked.",
        );
        out.line(name, "", gauges.unchecked);
        let checks = self.checks.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let name = "packstone_results_checked_total";
        out.head(name, "counter", "Checks of what worker processes have sent, by outcome.");
        for (outcome, label) in CheckOutcome::ALL {
            out.line(name, &format!("outcome=\"{label}\""), checks[outcome as usize].count);
        }
        let name = "packstone_result_check_duration_seconds";
        out.head(name, "histogram", "Time of these checks by outcome.");
        for (outcome, label) in CheckOutcome::ALL {
            checks[outcome as usize].render(out, name, &format!("outcome=\"{label}\""), JOB_BOUNDS_S);
        }
    }
}

/// The forecasts of the jobs that wait and run. The first scales workers: see `docs/many-servers.md`.
fn work(out: &mut Text, work: ForecastWork) {
    let default = format!("A job without a forecast counts as {} s.", UNKNOWN_FORECAST.as_secs());
    let name = "packstone_queue_work_seconds";
    out.head(name, "gauge", &format!("Forecast time of the jobs that wait, on one core. {default}"));
    out.line(name, "", work.queued_s);
    let name = "packstone_running_work_seconds";
    out.head(
        name,
        "gauge",
        &format!("Forecast time of the jobs that run, as if none of it were done. {default}"),
    );
    out.line(name, "", work.running_s);
}

/// What Linux tells of this process, under the names that all exporters use.
fn process(out: &mut Text) {
    out.head("packstone_build_info", "gauge", "The version of this program; always 1.");
    out.line("packstone_build_info", concat!("version=\"", env!("CARGO_PKG_VERSION"), "\""), 1);
    let page_bytes = rustix::param::page_size() as u64;
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    if let Some(pages) = statm.split_whitespace().nth(1).and_then(|pages| pages.parse::<u64>().ok()) {
        out.head("process_resident_memory_bytes", "gauge", "Resident memory.");
        out.line("process_resident_memory_bytes", "", pages * page_bytes);
    }
    if let Ok(open) = std::fs::read_dir("/proc/self/fd") {
        out.head("process_open_fds", "gauge", "Open file descriptors.");
        out.line("process_open_fds", "", open.count());
    }
    if let Some(most) = rustix::process::getrlimit(rustix::process::Resource::Nofile).current {
        out.head("process_max_fds", "gauge", "File descriptors that may be open.");
        out.line("process_max_fds", "", most);
    }
    if let Some(cpu_s) = cpu_seconds(&std::fs::read_to_string("/proc/self/stat").unwrap_or_default()) {
        out.head("process_cpu_seconds_total", "counter", "Processor time of this process.");
        out.line("process_cpu_seconds_total", "", cpu_s);
    }
}

/// User and system time, fields 14 and 15 of `/proc/self/stat` (proc(5)); the name in field 2 may hold spaces.
fn cpu_seconds(stat: &str) -> Option<f64> {
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / rustix::param::clock_ticks_per_second() as f64)
}

/// Writing to a string cannot fail, so results are dropped here.
#[derive(Default)]
struct Text(String);

impl Text {
    fn head(&mut self, name: &str, kind: &str, help: &str) {
        let _ = write!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    fn line(&mut self, name: &str, labels: &str, value: impl std::fmt::Display) {
        let _ = if labels.is_empty() {
            writeln!(self.0, "{name} {value}")
        } else {
            writeln!(self.0, "{name}{{{labels}}} {value}")
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_rendered_cumulatively() {
        let metrics = Metrics::default();
        metrics.job_submitted();
        metrics.study_submitted(100);
        metrics.job_ended("succeeded", Duration::from_millis(300));
        metrics.job_ended("succeeded", Duration::from_secs(3));
        metrics.webhook_sent("retried");
        metrics.webhook_sent("retried");
        metrics.export_ended("slice", "succeeded", Duration::from_millis(300));
        metrics.request_answered("GET", "/v1/jobs/{id}", 200, Duration::from_millis(2));
        metrics.lease(LeaseEvent::Expired, 3);
        metrics.worker_refused();
        let gauges = Gauges {
            workers: 2,
            busy_slots: 1,
            jobs: [(State::Running, 5)].into(),
            running_elsewhere: 4,
            worker_processes: 3,
            ..Gauges::default()
        };
        let text = metrics.render(&gauges);
        for line in [
            "packstone_jobs_running{place=\"server\"} 1",
            "packstone_jobs_running{place=\"worker\"} 4",
            "packstone_worker_processes 3",
            "packstone_leases_total{event=\"taken\"} 0",
            "packstone_leases_total{event=\"expired\"} 3",
            "packstone_workers_refused_total 1",
            "packstone_workers 2",
            "packstone_worker_slots_busy 1",
            "packstone_webhook_deliveries_total{outcome=\"retried\"} 2",
            "packstone_webhook_deliveries_waiting 0",
            "packstone_jobs_submitted_total 101",
            "packstone_studies_submitted_total 1",
            "packstone_studies_open 0",
            "packstone_job_duration_seconds_bucket{outcome=\"succeeded\",le=\"0.1\"} 0",
            "packstone_job_duration_seconds_bucket{outcome=\"succeeded\",le=\"0.5\"} 1",
            "packstone_job_duration_seconds_bucket{outcome=\"succeeded\",le=\"5\"} 2",
            "packstone_job_duration_seconds_bucket{outcome=\"succeeded\",le=\"+Inf\"} 2",
            "packstone_job_duration_seconds_count{outcome=\"succeeded\"} 2",
            "packstone_export_duration_seconds_bucket{type=\"slice\",outcome=\"succeeded\",le=\"0.5\"} 1",
            "packstone_http_requests_total{method=\"GET\",route=\"/v1/jobs/{id}\",status=\"200\"} 1",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} is missing in:\n{text}");
        }
    }
}
