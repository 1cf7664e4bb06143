//! Studies on real files: fair turns, runs and stop rules, what goes together, and old data directories.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;

use packstone_engine::Limits;
use serde_json::{Value, json};

use super::super::db::{self, QueryBuilder};
use super::super::tests::{LIMITS, artifact, expire_all, fresh, fresh_file, open, plan_of, progress, submit};
use super::super::{Filter, ForecastWork, IdempotencyKey, Store, StoreError, StoreLimits};
use super::{NewStudy, StudyFilter, StudyRecord, StudyState, SubmittedStudy, query};
use crate::accounts::Submitter;
use crate::failure::{Failure, FailureCode};
use crate::jobs::{Lease, State};
use crate::studies::table::Cells;
use crate::studies::{Facts, Study};

/// Two points, each so many times.
pub(super) fn two_points(replicates: u32, extra: &Value) -> Value {
    let mut study = json!({
        "seed": 7,
        "template": {
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        },
        "grid": {"/mix/volume_fraction": [0.2, 0.25]},
        "replicates": replicates
    });
    study.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    study
}

fn new(request: &Value, key: Option<(&str, &str)>) -> NewStudy {
    let study = Study::read(request, 1, None, &Limits::default()).unwrap();
    let idempotency_key = key.map(|(key, body)| IdempotencyKey {
        scope: "lab".into(),
        key: key.into(),
        body_sha256: body.into(),
    });
    NewStudy { request: study.recorded(request), study, by: Submitter::default(), idempotency_key }
}

pub(super) async fn take_in(store: &Store, request: &Value) -> StudyRecord {
    match store.submit_study(new(request, None)).await.unwrap() {
        SubmittedStudy::Created(study) => study,
        SubmittedStudy::Existing(_) => panic!("a study without a key exists already"),
    }
}

async fn claim(store: &Store) -> Lease {
    store.claim().await.unwrap().expect("a job that waits").lease
}

async fn succeed(store: &Store, lease: Lease, time_s: f64) {
    let path = format!("{}.{}", lease.id, lease.attempt);
    let facts = Facts { time_s, grains: Some(10), ..Facts::default() };
    store.succeed(lease, artifact(&path), progress(1.0), facts, Vec::new()).await.unwrap();
}

async fn fail(store: &Store, lease: Lease, kind: FailureCode, time_s: f64) {
    let facts = Facts { time_s, ..Facts::default() };
    store.fail(lease, &Failure::new(kind, "it did"), facts).await.unwrap();
}

/// The study as it is.
pub(super) async fn again(store: &Store, study: &StudyRecord) -> StudyRecord {
    store.study(study.id).await.unwrap().unwrap()
}

async fn cells(store: &Store, study: &StudyRecord) -> Vec<Cells> {
    let study = again(store, study).await;
    store.study_table(&study).await.unwrap().rows.into_iter().map(|row| row.cells).collect()
}

#[tokio::test]
async fn a_study_comes_in_whole_and_its_points_run_in_turn() {
    let (_folder, store) = fresh().await;
    let request = two_points(3, &json!({"name": "phi", "labels": {"a": "b"}}));
    let study = take_in(&store, &request).await;
    assert_eq!((study.points, study.replicates, study.jobs()), (2, 3, 6));
    assert_eq!((study.counts.queued, study.state()), (6, StudyState::Open));
    assert_eq!(study.columns, ["/mix/volume_fraction"]);
    assert_eq!(store.study_request(study.seq).await.unwrap(), request);
    let expected = new(&request, None).study;
    for (point, replicate) in expected.order() {
        let claimed = store.claim().await.unwrap().unwrap();
        let place = claimed.job.study.unwrap();
        assert_eq!((place.id, place.point as usize, place.replicate as usize), (study.id, point, replicate));
        let stored: Value = serde_json::from_str(&claimed.request).unwrap();
        assert_eq!(stored, json!(expected.points[point].replicate(replicate)));
        assert_eq!(json!(claimed.job.seed), stored["seed"]);
    }
    assert_eq!(store.claim().await.unwrap(), None);
    assert_eq!(again(&store, &study).await.counts.running, 6);
    let page = store.list(&Filter { study: Some(study.id), ..Filter::default() }, None, 4).await.unwrap();
    assert_eq!((page.jobs.len(), page.next_after.is_some()), (4, true));
}

#[tokio::test]
async fn jobs_are_found_by_the_method_that_their_request_names() {
    let (_folder, store) = fresh().await;
    let shaped = json!({"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2, "shape": {
        "type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}
    }});
    let mut study = two_points(1, &json!({"grid": {"/method/type": ["auto", "rsa", "edmd"]}}));
    study["template"]["method"] = json!({"type": "auto"});
    take_in(&store, &study).await;
    for extra in
        [json!({"method": {"type": "rsa"}}), json!({"method": {"type": "monte_carlo"}, "mix": shaped})]
    {
        submit(&store, extra).await;
    }
    let requests: Vec<String> =
        db::query("select body from job_requests order by job").scalars(store.readers()).await.unwrap();
    let named: Vec<Value> = requests
        .iter()
        .map(|request| serde_json::from_str::<Value>(request).unwrap()["method"]["type"].take())
        .collect();
    let methods: Vec<String> =
        db::query("select method from jobs order by seq").scalars(store.readers()).await.unwrap();
    assert_eq!(json!(methods), json!(named));
    let filter = Filter { method: Some("rsa".into()), ..Filter::default() };
    assert_eq!(store.list(&filter, None, 9).await.unwrap().jobs.len(), 2);
}

#[tokio::test]
async fn the_jobs_of_a_study_bring_the_forecasts_of_their_points() {
    let (_folder, store) = fresh().await;
    let mut of_points = new(&two_points(3, &json!({})), None);
    (of_points.study.points[0].forecast_s, of_points.study.points[1].forecast_s) = (2.0, 50.0);
    of_points.study.points[1].job.timeout_s = Some(7.0);
    store.submit_study(of_points).await.unwrap();
    let work = |queued_s, running_s| ForecastWork { queued_s, running_s };
    assert_eq!(store.forecast_work().await.unwrap(), work(3.0 * 2.0 + 3.0 * 7.0, 0.0));
    claim(&store).await;
    let lease = claim(&store).await;
    assert_eq!(store.forecast_work().await.unwrap(), work(2.0 * 2.0 + 2.0 * 7.0, 2.0 + 7.0));
    succeed(&store, lease, 1.0).await;
    assert_eq!(store.forecast_work().await.unwrap(), work(2.0 * 2.0 + 2.0 * 7.0, 2.0));
}

#[tokio::test]
async fn all_or_nothing_comes_in() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { max_queued: 5, ..LIMITS }).await;
    let refused = store.submit_study(new(&two_points(3, &json!({})), None)).await;
    assert!(matches!(refused, Err(StoreError::QueueFull { queued: 0, more: 6, most: 5 })));
    assert_eq!(store.counts().await.unwrap()[&State::Queued], 0);
    assert_eq!(store.list_studies(&StudyFilter::default(), None, 10).await.unwrap().studies, []);
    take_in(&store, &two_points(2, &json!({}))).await;
    assert_eq!(store.counts().await.unwrap()[&State::Queued], 4);
}

#[tokio::test]
async fn what_waits_takes_turns() {
    let (_folder, store) = fresh().await;
    let study = take_in(&store, &two_points(50, &json!({}))).await;
    for _ in 0..7 {
        assert_eq!(claim(&store).await.study, Some(study.id));
    }
    // A single job starts before all that waits of the study, and does not hold it up for longer than its turn.
    let single = submit(&store, json!({})).await.id;
    assert_eq!(claim(&store).await.id, single);
    assert_eq!(claim(&store).await.study, Some(study.id));
    // Single jobs, this study and another alternate, and none takes more than its share for coming late.
    let other = take_in(&store, &two_points(50, &json!({}))).await;
    for _ in 0..10 {
        submit(&store, json!({})).await;
    }
    let mut starts: BTreeMap<String, u32> = BTreeMap::new();
    for _ in 0..30 {
        let lease = claim(&store).await;
        *starts.entry(lease.study.map(|id| id.to_string()).unwrap_or_default()).or_default() += 1;
    }
    assert_eq!(starts[""], 10);
    for study in [study.id, other.id] {
        assert!((9..=11).contains(&starts[&study.to_string()]), "{starts:?}");
    }
}

#[tokio::test]
async fn turns_are_taken_apart_for_each_priority() {
    let (_folder, store) = fresh().await;
    // Of a low priority, so that all of them wait while the others start.
    let mut low = two_points(5, &json!({}));
    low["template"]["priority"] = json!(-1);
    let low = take_in(&store, &low).await;
    let high = take_in(&store, &two_points(5, &json!({}))).await;
    for _ in 0..10 {
        assert_eq!(claim(&store).await.study, Some(high.id));
    }
    let single = submit(&store, json!({"priority": -1})).await.id;
    assert_eq!(claim(&store).await.study, Some(low.id));
    assert_eq!(claim(&store).await.id, single, "the turns of the others are not its own");
}

#[tokio::test]
async fn what_is_given_back_keeps_its_turn_and_what_is_retried_takes_a_new_one() {
    let (_folder, store) = fresh().await;
    take_in(&store, &two_points(5, &json!({}))).await;
    let first = claim(&store).await;
    let second = claim(&store).await;
    store.give_back(first).await.unwrap();
    assert_eq!(claim(&store).await.id, first.id);
    fail(&store, second, FailureCode::TargetNotReached, 1.0).await;
    store.retry(second.id, None).await.unwrap();
    let mut last = claim(&store).await;
    for _ in 0..7 {
        assert_ne!(last.id, second.id, "others come first");
        last = claim(&store).await;
    }
    assert_eq!(claim(&store).await.id, second.id);
}

#[tokio::test]
async fn runs_come_to_a_table_and_void_ones_say_nothing() {
    let (folder, store) = fresh().await;
    let study = take_in(&store, &two_points(4, &json!({}))).await;
    let mut leases = Vec::new();
    for _ in 0..8 {
        leases.push(claim(&store).await);
    }
    // Points alternate: the even ones are of point 0.
    succeed(&store, leases[0], 2.0).await;
    fail(&store, leases[2], FailureCode::TargetNotReached, 3.0).await;
    fail(&store, leases[4], FailureCode::TimedOut, 5.0).await;
    fail(&store, leases[6], FailureCode::InternalError, 100.0).await;
    store.cancel(leases[1].id).await.unwrap();
    store.finish_cancelled(leases[1]).await.unwrap();
    let [zero, one] = &cells(&store, &study).await[..] else { panic!("two points") };
    assert_eq!((zero.runs, zero.successes, zero.void, zero.waiting), (3, 1, 1, 0));
    assert_eq!((zero.time_s_total, zero.time_s_per_success), (Some(10.0), Some(10.0)));
    assert_eq!(zero.grains, Some(10.0));
    assert_eq!((one.runs, one.void, one.waiting), (0, 1, 3));
    let record = again(&store, &study).await;
    assert_eq!((record.runs, record.runs_time_s), (3, 10.0));
    assert_eq!((record.counts.succeeded, record.counts.failed, record.counts.cancelled), (1, 3, 1));

    // A crash: the attempts that are left run again, and what ran is not forgotten.
    drop(store);
    let store = open(&folder, LIMITS).await;
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 3);
    assert_eq!(again(&store, &study).await.counts.queued, 3);
    for _ in 0..3 {
        let lease = claim(&store).await;
        assert_eq!(lease.attempt, 2);
        succeed(&store, lease, 1.0).await;
    }
    let done = again(&store, &study).await;
    assert_eq!((done.state(), done.counts.finished()), (StudyState::Finished, 8));
    assert_eq!(cells(&store, &study).await[1].successes, 3);
}

#[tokio::test]
async fn a_deleted_job_stays_in_the_table() {
    let (_folder, store) = fresh().await;
    let study = take_in(&store, &two_points(1, &json!({}))).await;
    let lease = claim(&store).await;
    succeed(&store, lease, 2.0).await;
    let before = cells(&store, &study).await;
    assert!(!store.delete(lease.id).await.unwrap().is_empty());
    assert_eq!(cells(&store, &study).await, before);
    assert_eq!(again(&store, &study).await.counts.succeeded, 1);
}

#[tokio::test]
async fn a_met_rule_calls_off_what_waits_of_its_point_only() {
    let (_folder, store) = fresh().await;
    let study = take_in(&store, &two_points(6, &json!({"stop_when": {"failed_in_a_row": 2}}))).await;
    let mut leases = Vec::new();
    for _ in 0..6 {
        leases.push(claim(&store).await);
    }
    fail(&store, leases[0], FailureCode::TargetNotReached, 1.0).await;
    fail(&store, leases[2], FailureCode::InternalError, 1.0).await;
    assert_eq!(again(&store, &study).await.counts.cancelled, 0, "a void run is no failure");
    // Whoever waits for the study is told of what its rule does.
    let mut changes = store.subscribe_study(study.id);
    fail(&store, leases[4], FailureCode::TargetNotReached, 1.0).await;
    changes.changed().await;
    let [zero, one] = &cells(&store, &study).await[..] else { panic!("two points") };
    assert_eq!((zero.runs, zero.void, zero.stopped_early, zero.waiting), (2, 1, 3, 0));
    assert_eq!((one.runs, one.void, one.stopped_early, one.waiting), (0, 0, 0, 6));
    let called_off = Filter { study: Some(study.id), state: Some(State::Cancelled), ..Filter::default() };
    let called_off = store.list(&called_off, None, 10).await.unwrap().jobs;
    assert!(called_off.iter().all(|job| job.study.unwrap().point == 0 && !job.cancel_requested));
    assert_eq!(called_off.len(), 3);

    // Whoever knows better sends them back; then they wait again.
    store.retry(called_off[0].id, None).await.unwrap();
    let zero = &cells(&store, &study).await[0];
    assert_eq!((zero.stopped_early, zero.waiting), (2, 1));
    let (record, retried) = store.retry_study(study.id, vec![State::Failed, State::Cancelled]).await.unwrap();
    assert_eq!((retried.len(), record.counts.cancelled, record.counts.failed), (5, 0, 0));
    let zero = &cells(&store, &study).await[0];
    assert_eq!((zero.runs, zero.void, zero.stopped_early, zero.waiting), (0, 0, 0, 6));
}

#[tokio::test]
async fn a_narrow_interval_ends_a_point_while_others_go_on() {
    let (_folder, store) = fresh().await;
    let study = take_in(&store, &two_points(30, &json!({"stop_when": {"interval_width": 0.3}}))).await;
    // Of n successes only, the interval's width is z^2 / (n + z^2): below 0.3 from 9 on.
    let mut ended = 0;
    while again(&store, &study).await.counts.cancelled == 0 {
        let lease = claim(&store).await;
        succeed(&store, lease, 1.0).await;
        ended += 1;
    }
    assert_eq!(ended, 17);
    let [zero, one] = &cells(&store, &study).await[..] else { panic!("two points") };
    assert_eq!((zero.runs, zero.stopped_early), (9, 21));
    assert_eq!((one.runs, one.stopped_early, one.waiting), (8, 0, 22));
}

#[tokio::test]
async fn a_study_is_cancelled_retried_and_deleted_as_a_whole() {
    let (_folder, store) = fresh().await;
    let other = submit(&store, json!({"priority": -5})).await.id;
    let study = take_in(&store, &two_points(3, &json!({}))).await;
    let lease = claim(&store).await;
    succeed(&store, lease, 1.0).await;
    let running = claim(&store).await;
    assert!(matches!(store.delete_study(study.id).await, Err(StoreError::StudyForbidden(StudyState::Open))));
    let asked = store.cancel_study(study.id).await.unwrap();
    assert_eq!((asked.counts.cancelled, asked.counts.running, asked.state()), (4, 1, StudyState::Open));
    assert!(store.heartbeat(running, None).await.unwrap().cancel);
    let version = again(&store, &study).await.version;
    store.cancel_study(study.id).await.unwrap();
    assert_eq!(again(&store, &study).await.version, version, "asking twice is no news");
    store.finish_cancelled(running).await.unwrap();
    let finished = again(&store, &study).await;
    assert!(finished.finished_at.is_some());
    let forbidden = store.cancel_study(study.id).await;
    assert!(matches!(forbidden, Err(StoreError::StudyForbidden(StudyState::Finished))));
    assert_eq!(store.counts().await.unwrap()[&State::Queued], 1, "the single job waits still");

    let (same, none) = store.retry_study(study.id, vec![State::Failed]).await.unwrap();
    assert_eq!((same, none.len()), (finished, 0));
    let (open_again, retried) = store.retry_study(study.id, vec![State::Cancelled]).await.unwrap();
    assert_eq!((open_again.state(), open_again.counts.queued, retried.len()), (StudyState::Open, 5, 5));
    assert!(retried.iter().all(|(_, attempt)| *attempt == 2));
    for _ in 0..5 {
        let lease = claim(&store).await;
        succeed(&store, lease, 1.0).await;
    }
    let removed = store.delete_study(study.id).await.unwrap();
    assert_eq!(removed.iter().filter(|job| !job.files.is_empty()).count(), 6);
    assert_eq!(store.study(study.id).await.unwrap(), None);
    assert_eq!(store.get(lease.id).await.unwrap(), None);
    assert!(matches!(store.delete_study(study.id).await, Err(StoreError::NoStudy)));
    assert!(store.get(other).await.unwrap().is_some());
    for table in ["study_runs", "study_points", "study_requests", "job_requests", "artifacts"] {
        let count = QueryBuilder::new(&format!("select count(*) from {table}")).build();
        let left: i64 = count.scalar(store.readers()).await.unwrap();
        assert_eq!(left, i64::from(table == "job_requests"), "{table}");
    }
}

#[tokio::test]
async fn a_key_brings_the_same_study() {
    let (_folder, store) = fresh().await;
    let request = two_points(2, &json!({}));
    let SubmittedStudy::Created(study) = store.submit_study(new(&request, Some(("k", "1")))).await.unwrap()
    else {
        panic!("the key is new")
    };
    let again = store.submit_study(new(&request, Some(("k", "1")))).await.unwrap();
    assert_eq!(again, SubmittedStudy::Existing(study.clone()));
    let reused = store.submit_study(new(&request, Some(("k", "2")))).await;
    assert!(matches!(reused, Err(StoreError::KeyReused)));
    assert_eq!(store.counts().await.unwrap()[&State::Queued], 4);
    store.cancel_study(study.id).await.unwrap();
    store.delete_study(study.id).await.unwrap();
    let anew = store.submit_study(new(&request, Some(("k", "2")))).await.unwrap();
    assert!(matches!(anew, SubmittedStudy::Created(_)));
}

#[tokio::test]
async fn a_study_expires_with_its_jobs_and_they_with_it() {
    let (_folder, store) = fresh().await;
    let mut request = two_points(2, &json!({}));
    request["template"]["expires_at"] = json!("2030-01-01T00:00:00Z");
    let expiring = take_in(&store, &request).await;
    let lasting = take_in(&store, &two_points(1, &json!({}))).await;
    let lease = claim(&store).await;
    succeed(&store, lease, 1.0).await;
    expire_all(&store).await;
    assert_eq!(store.remove_expired().await.unwrap(), []);
    assert_eq!(store.remove_expired_study(None).await.unwrap(), None, "its other jobs wait");
    store.cancel_study(expiring.id).await.unwrap();
    store.cancel_study(lasting.id).await.unwrap();
    let removed = store.remove_expired_study(None).await.unwrap().unwrap();
    assert_eq!(removed.len(), 4);
    assert_eq!(store.remove_expired_study(None).await.unwrap(), None);
    // Those without a time of their own leave when they are old.
    assert!(store.study(lasting.id).await.unwrap().is_some());
    let ended = again(&store, &lasting).await.finished_at.unwrap();
    assert_eq!(store.remove_expired_study(Some(ended)).await.unwrap(), None);
    assert_eq!(store.remove_expired_study(Some(ended + 1)).await.unwrap().unwrap().len(), 2);
}

#[tokio::test]
async fn listings_are_filtered_and_use_their_indexes() {
    let (_folder, store) = fresh().await;
    let label = |value: &str| vec![("series".to_owned(), value.to_owned())];
    let mut ids = Vec::new();
    for series in ["a", "b", "a"] {
        let request = two_points(1, &json!({"labels": {"series": series}}));
        ids.insert(0, take_in(&store, &request).await.id);
    }
    store.cancel_study(ids[0]).await.unwrap();
    let list = async |state, labels| {
        let page =
            store.list_studies(&StudyFilter { state, labels, visible_to: None }, None, 10).await.unwrap();
        page.studies.iter().map(|study| study.id).collect::<Vec<_>>()
    };
    assert_eq!(list(None, vec![]).await, ids);
    assert_eq!(list(None, label("a")).await, [ids[0], ids[2]]);
    assert_eq!(list(Some(StudyState::Open), label("a")).await, [ids[2]]);
    assert_eq!(list(Some(StudyState::Finished), vec![]).await, [ids[0]]);
    assert_eq!(store.open_studies().await.unwrap(), 2);
    let first = store.list_studies(&StudyFilter::default(), None, 2).await.unwrap();
    let rest = store.list_studies(&StudyFilter::default(), first.next_before, 2).await.unwrap();
    assert_eq!((rest.studies[0].id, rest.next_before), (ids[2], None));

    let (_folder, file) = fresh_file().await;
    for (state, labels) in
        [(None, vec![]), (Some(StudyState::Open), vec![]), (Some(StudyState::Finished), label("a"))]
    {
        assert_indexed(
            &plan_of(&file, &query::list_sql(&StudyFilter { state, labels, visible_to: None })).await,
        );
    }
    for (state, labels) in [(None, vec![]), (Some(State::Queued), vec![]), (Some(State::Failed), label("a"))]
    {
        let filter = Filter { state, labels, study: Some(ids[0]), ..Filter::default() };
        let plan = plan_of(&file, &super::super::query::list_sql(&filter)).await;
        assert_indexed(&plan);
        assert!(plan.iter().any(|step| step.contains("jobs_by_study")), "{plan:?}");
    }
}

fn assert_indexed(plan: &[String]) {
    let indexed = |step: &String| !step.starts_with("SCAN") && !step.contains("TEMP B-TREE");
    assert!(plan.iter().all(indexed), "{plan:?}");
}
