//! What a client submits: a packing, and how the service should treat the job.
//!
//! The packing's own fields are the engine's to read; here are those of the job, with their bounds.
//! One pass over the document reports the faults of both.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use jiff::Timestamp;
use packstone_engine::export::ExportRequest;
use packstone_engine::request::decode::{At, Bound, Faults, Object, pointer_segment};
use packstone_engine::request::{Distance, Materials, Method, Mix, OnLimit, Segregation, Specimen};
use packstone_engine::{FieldError, Limits, PackingRequest};
use serde::Serialize;
use serde_json::Value;

use crate::exports::MAX_POSTPROCESS;
use crate::failure::Failure;
use crate::gmsh;
use crate::jobs::moments;
use crate::webhooks::WebhookUrl;

/// Longest name of a job, in characters.
pub(crate) const MAX_NAME_CHARS: usize = 200;
/// Most labels of a job.
pub(crate) const MAX_LABELS: usize = 32;
/// Longest key of a label, in characters.
pub(crate) const MAX_LABEL_KEY_CHARS: usize = 64;
/// Longest value of a label, in characters.
pub(crate) const MAX_LABEL_VALUE_CHARS: usize = 256;
/// Priorities lie between this and its negative.
pub(crate) const MAX_PRIORITY: i64 = 100;
/// Longest time a job may be given, in s: a month.
pub(crate) const MAX_TIMEOUT_S: f64 = 2_678_400.0;
/// Most attempts a job may be given.
pub(crate) const MAX_ATTEMPTS: i64 = 10;
const DEFAULT_ATTEMPTS: i64 = 3;
/// Most threads that a job may ask for.
pub(crate) const MAX_THREADS: i64 = 64;

/// A job to run: what to pack, and how to treat it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, schema(examples(crate::jobs::schema::example)))]
pub(crate) struct JobRequest {
    /// A name for people.
    #[cfg_attr(test, schema(required = false, schema_with = crate::jobs::schema::name))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    /// Keys and values to find the job by: at most 32; a key has 1 to 64 characters and no equals sign, a value at most
    /// 256 characters.
    #[cfg_attr(test, schema(required = false, schema_with = crate::jobs::schema::job_labels))]
    pub(crate) labels: BTreeMap<String, String>,
    /// Seed of the random generator; drawn at submission and recorded when absent.
    #[cfg_attr(test, schema(required = false, minimum = 0, maximum = 9_007_199_254_740_991_u64))]
    pub(crate) seed: u64,
    /// Of the jobs of one owner those of higher priority run first; among equals, studies and single jobs take turns,
    /// each in the order of its jobs. Owners take turns whatever the priorities of their jobs are.
    #[cfg_attr(test, schema(required = false, default = 0, minimum = -100, maximum = 100))]
    pub(crate) priority: i64,
    /// Most threads that compute the packing; the packing does not depend on their number. A job holds as many worker
    /// slots as threads, of those that are free when it starts; without `threads` those that the jobs that wait leave.
    /// No stored request and no result contains it.
    #[cfg_attr(test, schema(required = false, nullable, minimum = 1, maximum = 64))]
    #[serde(skip_serializing_if = "never_shown")]
    pub(crate) threads: Option<i64>,
    /// Longest time that one attempt may run; past it the job fails with `timed-out`, or ends with the packing that it
    /// reached where `on_limit` is `keep`.
    #[cfg_attr(test, schema(required = false, nullable, exclusive_minimum = 0, maximum = 2_678_400))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) timeout_s: Option<f64>,
    /// RFC 3339 time in the future past which the job and its result are removed, once it is finished.
    #[cfg_attr(test, schema(required = false, nullable, format = DateTime))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) expires_at: Option<String>,
    /// How often the job may be started if the server stops while it runs.
    #[cfg_attr(test, schema(required = false, default = 3, minimum = 1, maximum = 10))]
    pub(crate) max_attempts: i64,
    /// Whether other users of the server may read the job and its result.
    #[cfg_attr(test, schema(required = false, default = false))]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) shared: bool,
    /// URL to which a signed message is sent when the job ends. No request and no result contains it, because it may
    /// contain a token.
    #[cfg_attr(test, schema(required = false, schema_with = crate::jobs::schema::webhook_url))]
    #[serde(skip_serializing_if = "never_shown")]
    pub(crate) webhook_url: Option<WebhookUrl>,
    /// What is filled.
    pub(crate) specimen: Specimen,
    /// What it is filled with.
    pub(crate) mix: Mix,
    /// The clear distance that grains keep from one another and from the walls; none when absent.
    #[cfg_attr(test, schema(required = false))]
    pub(crate) distance: Distance,
    /// How the packing is computed; `auto` when absent.
    #[cfg_attr(test, schema(required = false))]
    pub(crate) method: Method,
    /// Where grains of which size are to lie; anywhere when absent.
    #[cfg_attr(test, schema(required = false))]
    #[serde(skip_serializing_if = "Segregation::is_none")]
    pub(crate) segregation: Segregation,
    /// What becomes of a run that `timeout_s`, a limit of its method or a jam ends before its target.
    #[cfg_attr(test, schema(default = "fail", required = false))]
    #[serde(skip_serializing_if = "OnLimit::is_fail")]
    pub(crate) on_limit: OnLimit,
    /// The materials of the phases, for models and properties of the packing; the packing does not depend on them.
    #[cfg_attr(test, schema(required = false, value_type = Materials))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) materials: Option<Materials>,
    /// What to make of the packing once it is there: one thing or a list of at most 8, each as in
    /// `POST /v1/jobs/{id}/exports`.
    #[cfg_attr(test, schema(required = false))]
    #[serde(skip_serializing_if = "Postprocess::is_empty")]
    pub(crate) postprocess: Postprocess,
}

/// What to make of a packing once it is there, in the form in which it was asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub(crate) enum Postprocess {
    /// One thing.
    One(Box<ExportRequest>),
    /// A list of them.
    List(Vec<ExportRequest>),
}

impl Default for Postprocess {
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl Postprocess {
    fn is_empty(&self) -> bool {
        matches!(self, Self::List(list) if list.is_empty())
    }

    /// What is to be made, each with its place in the request.
    pub(crate) fn items(&self) -> Vec<(String, &ExportRequest)> {
        match self {
            Self::One(one) => vec![("/postprocess".into(), one)],
            Self::List(list) => {
                list.iter().enumerate().map(|(i, item)| (format!("/postprocess/{i}"), item)).collect()
            }
        }
    }
}

impl JobRequest {
    /// Reads a submission. `seed` is used where it names none; `now` is what `expires_at` must lie
    /// after, and `None` for a request that was accepted before.
    ///
    /// # Errors
    /// All faults of the document.
    pub(crate) fn read(value: &Value, seed: u64, now: Option<Timestamp>) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let request = At::root(value, &faults).object().and_then(|mut object| {
            let request = read_fields(&mut object, &faults, seed, now);
            object.finish();
            request
        });
        match request {
            Some(request) if faults.count() == 0 => Ok(request),
            _ => Err(faults.into_vec()),
        }
    }

    /// The engine's part.
    pub(crate) fn packing(&self) -> PackingRequest {
        PackingRequest {
            seed: self.seed,
            specimen: self.specimen,
            mix: self.mix.clone(),
            distance: self.distance,
            method: self.method,
            segregation: self.segregation,
            on_limit: self.on_limit,
            materials: self.materials.clone(),
        }
    }

    /// Most threads that may compute the packing, where it asks for a number.
    pub(crate) fn threads(&self) -> Option<NonZeroUsize> {
        self.threads.and_then(|threads| NonZeroUsize::new(usize::try_from(threads).ok()?))
    }

    /// Judges what is to be made of the packing, as far as that can be done before there is one.
    ///
    /// # Errors
    /// What is wrong with the first that cannot be made, at its place.
    pub(crate) fn check_postprocess(&self, limits: &Limits) -> Result<(), Failure> {
        let items = self.postprocess.items();
        if items.is_empty() {
            return Ok(());
        }
        let packing = self.packing();
        for (place, export) in items {
            let checked = export
                .check(&self.specimen, limits)
                .and_then(|()| export.check_materials(&packing))
                .and_then(|()| gmsh::check_of_job(export));
            checked.map_err(|error| Failure::from(error).below(&place))?;
        }
        Ok(())
    }

    /// The exports that `postprocess` names, in its order.
    pub(crate) fn exports(&self) -> impl Iterator<Item = &ExportRequest> {
        self.postprocess.items().into_iter().map(|(_, export)| export)
    }

    /// `expires_at` in microseconds since the Unix epoch.
    pub(crate) fn expires_at_us(&self) -> Option<i64> {
        self.expires_at.as_deref().and_then(moments::read)
    }

    /// The method that it names, as the list of jobs knows it.
    pub(crate) fn method_name(&self) -> &'static str {
        match self.method {
            Method::Auto {} => "auto",
            Method::Rsa { .. } => "rsa",
            Method::Growth { .. } => "growth",
            Method::Edmd { .. } => "edmd",
            Method::MonteCarlo { .. } => "monte_carlo",
        }
    }
}

/// What a patch does to a field that may be absent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum Change<T> {
    /// The field stays as it is.
    #[default]
    Keep,
    /// The field is removed.
    Remove,
    /// The field gets this value.
    Set(T),
}

impl<T> Change<T> {
    /// Whether the field changes.
    pub(crate) fn is_some(&self) -> bool {
        !matches!(self, Self::Keep)
    }

    /// The new value, if there is one.
    pub(crate) fn value(self) -> Option<T> {
        match self {
            Self::Set(value) => Some(value),
            Self::Keep | Self::Remove => None,
        }
    }
}

/// Changes of a job, as a JSON merge patch (RFC 7396).
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = JobPatch))]
pub(crate) struct JobPatch {
    /// The new name; `null` removes it.
    #[cfg_attr(test, schema(required = false, nullable, value_type = Option<String>, min_length = 1, max_length = 200))]
    pub(crate) name: Change<String>,
    /// The new priority of a waiting job; `null` stands for 0.
    #[cfg_attr(test, schema(required = false, nullable, minimum = -100, maximum = 100))]
    pub(crate) priority: Option<i64>,
    /// Labels to set, or to remove where the value is `null`; the other labels stay.
    #[cfg_attr(test, schema(required = false, nullable, example = json!({"series": "TB-8", "draft": null})))]
    pub(crate) labels: BTreeMap<String, Option<String>>,
    /// Whether all present labels are removed first: `labels` was `null`.
    #[cfg_attr(test, schema(ignore))]
    pub(crate) clear_labels: bool,
    /// The new RFC 3339 time of expiry, in the future; `null` removes it. In microseconds since the Unix epoch here.
    #[cfg_attr(test, schema(required = false, nullable, value_type = Option<String>, format = DateTime))]
    pub(crate) expires_at: Change<i64>,
    /// Whether other users of the server may read the job and its result; `null` stands for `false`.
    #[cfg_attr(test, schema(required = false, nullable))]
    pub(crate) shared: Option<bool>,
    /// The new URL to which a signed message is sent when the job ends; `null` removes it. A message that is recorded
    /// already goes to the URL of before.
    #[cfg_attr(test, schema(required = false, schema_with = crate::jobs::schema::webhook_url))]
    pub(crate) webhook_url: Change<WebhookUrl>,
}

impl JobPatch {
    /// Reads a patch; a new expiry must be later than `now`.
    ///
    /// # Errors
    /// All faults of the document.
    pub(crate) fn read(value: &Value, now: Timestamp) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let mut patch = Self::default();
        if let Some(mut object) = At::root(value, &faults).object() {
            let is_null = |name: &str| value.get(name).is_some_and(Value::is_null);
            patch.name = match object.optional("name") {
                Some(at) => read_name(&at).map_or(Change::Keep, Change::Set),
                None if is_null("name") => Change::Remove,
                None => Change::Keep,
            };
            patch.priority = match object.optional("priority") {
                Some(at) => at.integer(-MAX_PRIORITY, MAX_PRIORITY),
                None => is_null("priority").then_some(0),
            };
            if let Some(at) = object.optional("labels") {
                patch.labels = read_label_patch(&at, &faults).unwrap_or_default();
            }
            patch.clear_labels = is_null("labels");
            patch.expires_at = match object.optional("expires_at") {
                Some(at) => read_expiry(&at, Some(now))
                    .and_then(|time| moments::read(&time))
                    .map_or(Change::Keep, Change::Set),
                None if is_null("expires_at") => Change::Remove,
                None => Change::Keep,
            };
            patch.shared = match object.optional("shared") {
                Some(at) => at.boolean(),
                None => is_null("shared").then_some(false),
            };
            patch.webhook_url = read_webhook_change(value, &mut object);
            object.finish();
        }
        if faults.count() == 0 { Ok(patch) } else { Err(faults.into_vec()) }
    }
}

/// What a patch does to the URL of a webhook.
pub(crate) fn read_webhook_change(patch: &Value, object: &mut Object<'_>) -> Change<WebhookUrl> {
    match object.optional("webhook_url") {
        Some(at) => WebhookUrl::read(&at).map_or(Change::Keep, Change::Set),
        None if patch.get("webhook_url").is_some_and(Value::is_null) => Change::Remove,
        None => Change::Keep,
    }
}

/// Whether a document leaves a field out: always.
fn never_shown<T>(_: &T) -> bool {
    true
}

fn read_label_patch(at: &At<'_>, faults: &Faults) -> Option<BTreeMap<String, Option<String>>> {
    let members = at.members(2 * MAX_LABELS)?;
    let mut labels = BTreeMap::new();
    for (key, value) in members {
        if value.value().is_null() {
            labels.insert(key.to_owned(), None);
        } else if let Some(text) =
            read_label(key, value.value(), |detail| faults.add(value.pointer(), detail))
        {
            labels.insert(key.to_owned(), Some(text));
        }
    }
    Some(labels)
}

/// A seed for a submission that names none.
pub(crate) fn draw_seed() -> u64 {
    rand::random_range(0..=packstone_engine::request::MAX_SEED)
}

fn read_fields(
    object: &mut Object<'_>,
    faults: &Faults,
    seed: u64,
    now: Option<Timestamp>,
) -> Option<JobRequest> {
    let name = object.optional("name").and_then(|at| read_name(&at));
    let labels = object.optional("labels").and_then(|at| read_labels(&at, faults)).unwrap_or_default();
    let priority = match object.optional("priority") {
        Some(at) => at.integer(-MAX_PRIORITY, MAX_PRIORITY),
        None => Some(0),
    };
    let threads = object.optional("threads").and_then(|at| at.integer(1, MAX_THREADS));
    let timeout_s =
        object.optional("timeout_s").and_then(|at| at.number(Bound::positive(MAX_TIMEOUT_S, "s")));
    let expires_at = object.optional("expires_at").and_then(|at| read_expiry(&at, now));
    let max_attempts = match object.optional("max_attempts") {
        Some(at) => at.integer(1, MAX_ATTEMPTS),
        None => Some(DEFAULT_ATTEMPTS),
    };
    let shared = object.optional("shared").map_or(Some(false), |at| at.boolean());
    let webhook_url = object.optional("webhook_url").and_then(|at| WebhookUrl::read(&at));
    let postprocess =
        object.optional("postprocess").map_or(Some(Postprocess::default()), |at| read_postprocess(&at));
    let packing = PackingRequest::from_object(object, seed)?;
    Some(JobRequest {
        name,
        labels,
        seed: packing.seed,
        priority: priority?,
        threads,
        timeout_s,
        expires_at,
        max_attempts: max_attempts?,
        shared: shared?,
        webhook_url,
        specimen: packing.specimen,
        mix: packing.mix,
        distance: packing.distance,
        method: packing.method,
        segregation: packing.segregation,
        on_limit: packing.on_limit,
        materials: packing.materials,
        postprocess: postprocess?,
    })
}

fn read_postprocess(at: &At<'_>) -> Option<Postprocess> {
    if !at.value().is_array() {
        return ExportRequest::read(at).map(|one| Postprocess::One(Box::new(one)));
    }
    let items = at.array()?;
    if items.len() > MAX_POSTPROCESS {
        at.fault(format!("has {} items: must have at most {MAX_POSTPROCESS}", items.len()));
        return None;
    }
    // All of them, so that every fault is told.
    let read: Vec<Option<ExportRequest>> = items.iter().map(|item| ExportRequest::read(&item)).collect();
    read.into_iter().collect::<Option<Vec<_>>>().map(Postprocess::List)
}

/// Reads a name for people.
pub(crate) fn read_name(at: &At<'_>) -> Option<String> {
    let name = at.string()?;
    check_text(name, 1, MAX_NAME_CHARS, |fault| at.fault(fault)).then(|| name.to_owned())
}

/// Whether a text has the right length and no control characters, which would break the one line
/// that logs and tables give it.
fn check_text(text: &str, min: usize, max: usize, fault: impl FnOnce(String)) -> bool {
    let chars = text.chars().count();
    if chars < min || chars > max {
        fault(format!("has {chars} characters: must have at least {min} and at most {max}"));
        return false;
    }
    if let Some(c) = text.chars().find(|c| c.is_control()) {
        fault(format!("has the control character U+{:04X}: must be one line of text", c as u32));
        return false;
    }
    true
}

/// Reads labels, by whose keys and values things are found.
pub(crate) fn read_labels(at: &At<'_>, faults: &Faults) -> Option<BTreeMap<String, String>> {
    at.object()?;
    let map = at.value().as_object()?;
    if map.len() > MAX_LABELS {
        at.fault(format!("has {} labels: must have at most {MAX_LABELS}", map.len()));
        return None;
    }
    let mut labels = BTreeMap::new();
    for (key, value) in map {
        let pointer = format!("{}/{}", at.pointer(), pointer_segment(key));
        if let Some(text) = read_label(key, value, |detail| faults.add(pointer, detail)) {
            labels.insert(key.clone(), text);
        }
    }
    Some(labels)
}

/// Checks the key of a label and reads its value.
fn read_label(key: &str, value: &Value, fault: impl FnOnce(String)) -> Option<String> {
    let mut found = None;
    let whole = check_text(key, 1, MAX_LABEL_KEY_CHARS, |detail| found = Some(format!("the key {detail}")));
    if whole && key.contains('=') {
        found = Some("the key contains an equals sign, which ends it in a filter: must have none".into());
    }
    if found.is_none() {
        match value {
            Value::String(text) => {
                if check_text(text, 0, MAX_LABEL_VALUE_CHARS, |detail| found = Some(detail)) {
                    return Some(text.clone());
                }
            }
            _ => found = Some(format!("{} is not a string", kind_of(value))),
        }
    }
    if let Some(detail) = found {
        fault(detail);
    }
    None
}

fn kind_of(value: &Value) -> String {
    match value {
        Value::Object(_) => "an object".into(),
        Value::Array(_) => "an array".into(),
        other => other.to_string(),
    }
}

fn read_expiry(at: &At<'_>, now: Option<Timestamp>) -> Option<String> {
    let text = at.string()?;
    let Some(us) = moments::read(text) else {
        let detail = "is not an RFC 3339 time up to the year 9999, as 2030-01-31T12:00:00Z";
        at.fault(format!("{:?} {detail}", shortened(text)));
        return None;
    };
    let time = moments::text(us);
    if let Some(now) = now.filter(|now| us <= now.as_microsecond()) {
        at.fault(format!("{time} is out of range: must be later than now, {now}"));
        return None;
    }
    Some(time)
}

fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    fn with(extra: &Value) -> Value {
        let mut job = json!({
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        });
        job.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
        job
    }

    fn now() -> Timestamp {
        "2026-06-01T00:00:00Z".parse().unwrap()
    }

    fn faults_of(extra: &Value) -> Vec<String> {
        JobRequest::read(&with(extra), 7, Some(now())).unwrap_err().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn defaults_are_filled_in_and_read_back() {
        let request = JobRequest::read(&with(&json!({})), 7, Some(now())).unwrap();
        assert_eq!((request.seed, request.priority, request.max_attempts), (7, 0, 3));
        let stored = serde_json::to_value(&request).unwrap();
        assert_eq!(stored["method"], json!({"type": "auto"}));
        assert_eq!(JobRequest::read(&stored, 8, None).unwrap(), request);
    }

    #[test]
    fn threads_are_read_but_not_stored_with_the_request() {
        let read = |extra: &Value| JobRequest::read(&with(extra), 7, Some(now())).unwrap();
        let plain = read(&json!({}));
        for threads in [1, 64] {
            let request = read(&json!({"threads": threads}));
            assert_eq!(request.threads, Some(threads));
            assert_eq!(serde_json::to_string(&request).unwrap(), serde_json::to_string(&plain).unwrap());
        }
        assert_eq!(read(&json!({"threads": null})).threads, None);
    }

    #[test]
    fn every_job_field_is_bounded() {
        let cases = [
            (json!({"name": ""}), "/name: has 0 characters: must have at least 1 and at most 200"),
            (
                json!({"name": "x".repeat(201)}),
                "/name: has 201 characters: must have at least 1 and at most 200",
            ),
            (json!({"name": "a\nb"}), "/name: has the control character U+000A: must be one line of text"),
            (
                json!({"priority": 101}),
                "/priority: 101 is out of range: must be a whole number from -100 to 100",
            ),
            (json!({"threads": 0}), "/threads: 0 is out of range: must be a whole number from 1 to 64"),
            (json!({"threads": 65}), "/threads: 65 is out of range: must be a whole number from 1 to 64"),
            (json!({"threads": "2"}), "/threads: \"2\" is not a whole number"),
            (
                json!({"timeout_s": 0}),
                "/timeout_s: 0 is out of range: must be greater than 0 and at most 2678400 s",
            ),
            (
                json!({"max_attempts": 11}),
                "/max_attempts: 11 is out of range: must be a whole number from 1 to 10",
            ),
            (
                json!({"expires_at": "tomorrow"}),
                "/expires_at: \"tomorrow\" is not an RFC 3339 time up to the year 9999, as 2030-01-31T12:00:00Z",
            ),
            (
                json!({"expires_at": "2026-05-31T23:59:59Z"}),
                "/expires_at: 2026-05-31T23:59:59Z is out of range: must be later than now, 2026-06-01T00:00:00Z",
            ),
            (json!({"labels": {"a": 1}}), "/labels/a: 1 is not a string"),
            (
                json!({"labels": {"a=b": "c"}}),
                "/labels/a=b: the key contains an equals sign, which ends it in a filter: must have none",
            ),
            (
                json!({"labels": {"": "c"}}),
                "/labels/: the key has 0 characters: must have at least 1 and at most 64",
            ),
        ];
        for (extra, message) in cases {
            assert_eq!(faults_of(&extra), [message]);
        }
        let many: serde_json::Map<String, Value> = (0..33).map(|i| (i.to_string(), json!("x"))).collect();
        assert_eq!(faults_of(&json!({"labels": many})), ["/labels: has 33 labels: must have at most 32"]);
    }

    #[test]
    fn a_patch_tells_null_from_absent() {
        let read = |patch: Value| JobPatch::read(&patch, now());
        assert_eq!(read(json!({})).unwrap(), JobPatch::default());
        let patch =
            read(json!({"name": null, "priority": 3, "labels": {"a": "b", "c": null}, "expires_at": null}));
        let labels = [("a".to_owned(), Some("b".to_owned())), ("c".to_owned(), None)];
        assert_eq!(
            patch.unwrap(),
            JobPatch {
                name: Change::Remove,
                priority: Some(3),
                labels: labels.into(),
                clear_labels: false,
                expires_at: Change::Remove,
                shared: None,
                webhook_url: Change::Keep,
            }
        );
        assert_eq!(read(json!({"webhook_url": null})).unwrap().webhook_url, Change::Remove);
        let url = WebhookUrl::parse("https://example.org/hook?a=b").unwrap();
        assert_eq!(read(json!({"webhook_url": url.as_str()})).unwrap().webhook_url, Change::Set(url));
        for (given, expected) in [(json!(true), true), (json!(false), false), (json!(null), false)] {
            assert_eq!(read(json!({"shared": given})).unwrap().shared, Some(expected));
        }
        let faults = read(json!({"name": "", "priority": 101, "labels": {"a=b": "c"}, "expires_at": "x",
                "webhook_url": "ftp://a", "seed": 1}));
        let pointers: Vec<String> = faults.unwrap_err().into_iter().map(|fault| fault.pointer).collect();
        assert_eq!(pointers, ["/name", "/priority", "/labels/a=b", "/expires_at", "/webhook_url", "/seed"]);
    }

    #[test]
    fn faults_of_job_and_packing_come_together() {
        let job = json!({"priority": "high", "specimen": {"type": "box", "size_mm": [0, 1, 1]}, "colour": 1});
        let faults = JobRequest::read(&job, 7, Some(now())).unwrap_err();
        let pointers: Vec<&str> = faults.iter().map(|f| f.pointer.as_str()).collect();
        assert_eq!(pointers, ["/priority", "/specimen/size_mm/0", "/mix", "/colour"]);
    }
}
