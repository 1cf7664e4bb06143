//! Listing jobs, newest first.
//!
//! Pages go by key, not by offset: a page costs the same however deep it is, and jobs that come in
//! meanwhile neither repeat nor hide others. A cursor holds the last job seen and a digest over it
//! and the filters, so that one from another listing, or from nowhere, is refused.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use super::App;
use super::job_view::{JobSummary, set};
use super::openapi::ListProblems;
use super::params::{Query, shown};
use crate::hex;
use crate::jobs::request::MAX_LABELS;
use crate::jobs::{self, store::Filter};
use crate::problem::Problem;

const DEFAULT_LIMIT: i64 = 50;
const MAX_LIMIT: i64 = 500;
const CHECK_BYTES: usize = 8;

/// A page of jobs.
#[derive(Serialize, ToSchema)]
pub(super) struct JobPage {
    /// The jobs, newest first, without their requests.
    items: Vec<JobSummary>,
    /// Where the next page starts; `null` on the last.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// List jobs
///
/// Newest first. Items are jobs without their `request`.
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", operation_id = "list_jobs",
    params(
        ("state" = Option<jobs::State>, Query, description = "Only jobs in this state"),
        ("label" = Option<Vec<String>>, Query, explode, description = "`key:value`; only jobs with this label; may be repeated, and then all must fit", example = json!(["series:TB-7"])),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Jobs on a page; 50 when absent"),
        ("cursor" = Option<String>, Query, pattern = "^[0-9a-f]{32}$", description = "`next_cursor` of the page before, with the same filters"),
    ),
    responses(
        (status = 200, description = "A page", body = JobPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        ListProblems
    )
)]
pub(super) async fn list(State(app): State<App>, mut query: Query) -> Result<Response, Problem> {
    let filter = read_filter(&mut query);
    let limit = query.integer("limit", 1, MAX_LIMIT).unwrap_or(DEFAULT_LIMIT);
    let before = query.one("cursor").and_then(|cursor| {
        let before = open_cursor(&cursor, &filter);
        if before.is_none() {
            let shown = shown(&cursor);
            query.fault("cursor", format!("{shown} is no cursor of this listing: must be the next_cursor of a page with the same filters"));
        }
        before
    });
    query.finish()?;
    let page = app.shared.store.list(&filter, before, limit as u32).await?;
    let next_cursor = page.next_before.map(|seq| cursor(seq, &filter));
    let link = next_cursor.as_ref().map(|cursor| next_link(&filter, limit, cursor));
    let items = page.jobs.iter().map(JobSummary::of).collect();
    let mut response = axum::Json(JobPage { items, next_cursor }).into_response();
    if let Some(link) = link {
        set(&mut response, header::LINK, &link);
    }
    Ok(response)
}

fn read_filter(query: &mut Query) -> Filter {
    let mut filter = Filter::default();
    if let Some(name) = query.one("state") {
        filter.state = jobs::State::from_name(&name);
        if filter.state.is_none() {
            let names = jobs::State::ALL.map(jobs::State::name).join(", ");
            query.fault("state", format!("{} is unknown: must be one of {names}", shown(&name)));
        }
    }
    for label in query.many("label") {
        match label.split_once(':') {
            Some((key, value)) if !key.is_empty() => filter.labels.push((key.into(), value.into())),
            _ => query.fault("label", format!("{} has no key: must be key:value", shown(&label))),
        }
    }
    if filter.labels.len() > MAX_LABELS {
        query.fault(
            "label",
            format!("is given {} times: must be given at most {MAX_LABELS} times", filter.labels.len()),
        );
    }
    filter
}

/// The next page's address, with every value encoded.
fn next_link(filter: &Filter, limit: i64, cursor: &str) -> String {
    let mut query = form_urlencoded::Serializer::new(String::new());
    if let Some(state) = filter.state {
        query.append_pair("state", state.name());
    }
    for (key, value) in &filter.labels {
        query.append_pair("label", &format!("{key}:{value}"));
    }
    query.append_pair("limit", &limit.to_string()).append_pair("cursor", cursor);
    format!("</v1/jobs?{}>; rel=\"next\"", query.finish())
}

fn cursor(seq: i64, filter: &Filter) -> String {
    let mut bytes = seq.to_be_bytes().to_vec();
    bytes.extend(check(seq, filter));
    hex::encode(&bytes)
}

fn open_cursor(text: &str, filter: &Filter) -> Option<i64> {
    // One form of every cursor, so that equal ones look equal.
    if text.bytes().any(|b| b.is_ascii_uppercase()) {
        return None;
    }
    let bytes = hex::decode(text)?;
    let (seq, found) = bytes.split_first_chunk::<8>()?;
    let seq = i64::from_be_bytes(*seq);
    (found == check(seq, filter)).then_some(seq)
}

fn check(seq: i64, filter: &Filter) -> Vec<u8> {
    let mut digest = Sha256::new_with_prefix(b"packstone cursor 1");
    digest.update(seq.to_be_bytes());
    digest.update(format!("{filter:?}"));
    digest.finalize()[..CHECK_BYTES].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_opens_only_its_own_listing() {
        let all = Filter::default();
        let queued = Filter { state: Some(jobs::State::Queued), labels: vec![("a".into(), "b".into())] };
        let mine = cursor(42, &queued);
        assert_eq!(open_cursor(&mine, &queued), Some(42));
        assert_eq!(open_cursor(&mine, &all), None);
        for bad in ["", "00", "nonsense", &mine[2..], &mine.to_uppercase(), &format!("{mine}00")] {
            assert_eq!(open_cursor(bad, &queued), None, "{bad}");
        }
        let mut forged = mine.clone().into_bytes();
        forged[15] = if forged[15] == b'0' { b'1' } else { b'0' };
        assert_eq!(open_cursor(&String::from_utf8_lossy(&forged), &queued), None);
    }

    #[test]
    fn links_are_encoded() {
        let filter = Filter { state: None, labels: vec![("a b".into(), "c&d>".into())] };
        assert_eq!(
            next_link(&filter, 5, "ff"),
            "</v1/jobs?label=a+b%3Ac%26d%3E&limit=5&cursor=ff>; rel=\"next\""
        );
    }
}
