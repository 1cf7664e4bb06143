//! Listing jobs, newest first: all of them, or those of a study.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use jiff::Timestamp;
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::app::App;
use crate::http::jobs::view::JobSummary;
use crate::http::pages::{self, Page};
use crate::http::params::{Query, StudyPath, shown};
use crate::http::problems::refused;
use crate::http::problems::sets::{ListProblems, StudyProblems};
use crate::http::response::set;
use crate::ids::StudyId;
use crate::jobs;
use crate::jobs::request::MAX_NAME_CHARS;
use crate::jobs::store::{Filter, StoreError};
use crate::problem::Problem;

/// A page of jobs.
#[derive(Serialize, ToSchema)]
pub(crate) struct JobPage {
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
        ("label" = Option<Vec<String>>, Query, explode, description = "`key=value`; only jobs with this label; may be repeated, and then all must fit", example = json!(["series=TB-7"])),
        ("study" = Option<String>, Query, format = "uuid", description = "Only jobs of this study"),
        ("name" = Option<String>, Query, min_length = 1, max_length = 200, description = "Only jobs whose name contains this text"),
        ("method" = Option<String>, Query, pattern = "^(auto|rsa|edmd)$", description = "Only jobs with this method in their request"),
        ("created_after" = Option<String>, Query, format = DateTime, description = "RFC 3339 time; only jobs submitted at this time or later"),
        ("created_before" = Option<String>, Query, format = DateTime, description = "RFC 3339 time; only jobs submitted before this time"),
        ("sort" = Option<String>, Query, pattern = "^-?created$", description = "`-created`: newest first (when absent); `created`: oldest first"),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Jobs on a page; 50 when absent"),
        ("cursor" = Option<String>, Query, pattern = "^[0-9a-f]{32}$", description = "`next_cursor` of the page before, with the same filters"),
    ),
    responses(
        (status = 200, description = "A page", body = JobPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        ListProblems
    )
)]
pub(crate) async fn list(State(app): State<App>, mut query: Query) -> Result<Response, Problem> {
    let mut filter = read_filter(&mut query);
    if let Some(id) = query.one("study") {
        filter.study = StudyId::parse(&id);
        if filter.study.is_none() {
            query.fault("study", format!("{} is no id of a study: must be a hyphenated UUID", shown(&id)));
        }
    }
    let page = Page::read(&mut query, &filter);
    query.finish()?;
    let study = filter.study.map(|study| ("study", study.to_string()));
    answer(&app, "/v1/jobs", study.into_iter().collect(), &filter, page).await
}

/// List the jobs of a study
///
/// As `GET /v1/jobs?study=`, newest first: the last replicates of all points come before the first.
#[utoipa::path(
    get, path = "/v1/studies/{id}/jobs", tag = "studies", operation_id = "list_study_jobs",
    params(
        ("id" = String, Path, format = "uuid", description = "ID of the study"),
        ("state" = Option<jobs::State>, Query, description = "Only jobs in this state"),
        ("label" = Option<Vec<String>>, Query, explode, description = "`key=value`; only jobs with this label; may be repeated, and then all must fit", example = json!(["series=TB-7"])),
        ("name" = Option<String>, Query, min_length = 1, max_length = 200, description = "Only jobs whose name contains this text"),
        ("method" = Option<String>, Query, pattern = "^(auto|rsa|edmd)$", description = "Only jobs with this method in their request"),
        ("created_after" = Option<String>, Query, format = DateTime, description = "RFC 3339 time; only jobs submitted at this time or later"),
        ("created_before" = Option<String>, Query, format = DateTime, description = "RFC 3339 time; only jobs submitted before this time"),
        ("sort" = Option<String>, Query, pattern = "^-?created$", description = "`-created`: newest first (when absent); `created`: oldest first"),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Jobs on a page; 50 when absent"),
        ("cursor" = Option<String>, Query, pattern = "^[0-9a-f]{32}$", description = "`next_cursor` of the page before, with the same filters"),
    ),
    responses(
        (status = 200, description = "A page", body = JobPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        StudyProblems
    )
)]
pub(crate) async fn list_of_study(
    State(app): State<App>,
    StudyPath(id): StudyPath,
    mut query: Query,
) -> Result<Response, Problem> {
    let filter = Filter { study: Some(id), ..read_filter(&mut query) };
    let page = Page::read(&mut query, &filter);
    query.finish()?;
    if app.shared.store.study(id).await?.is_none() {
        return Err(refused(StoreError::NoStudy, id));
    }
    answer(&app, &format!("/v1/studies/{id}/jobs"), Vec::new(), &filter, page).await
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
    filter.labels = pages::labels(query);
    filter.name = query.one("name");
    let chars = filter.name.as_ref().map_or(1, |name| name.chars().count());
    if !(1..=MAX_NAME_CHARS).contains(&chars) {
        query.fault(
            "name",
            format!("has {chars} characters: must have at least 1 and at most {MAX_NAME_CHARS}"),
        );
    }
    filter.method = read_choice(query, "method", &["auto", "rsa", "edmd"]);
    filter.created_after = read_time(query, "created_after");
    filter.created_before = read_time(query, "created_before");
    filter.oldest_first = read_choice(query, "sort", &["-created", "created"]).as_deref() == Some("created");
    filter
}

fn read_choice(query: &mut Query, name: &'static str, choices: &[&str]) -> Option<String> {
    let value = query.one(name)?;
    if choices.contains(&value.as_str()) {
        return Some(value);
    }
    query.fault(name, format!("{} is unknown: must be one of {}", shown(&value), choices.join(", ")));
    None
}

/// A time in microseconds since the Unix epoch.
fn read_time(query: &mut Query, name: &'static str) -> Option<i64> {
    let text = query.one(name)?;
    let time = text.parse::<Timestamp>().ok().map(Timestamp::as_microsecond);
    if time.is_none() {
        query.fault(name, format!("{} is not an RFC 3339 time, as 2030-01-31T12:00:00Z", shown(&text)));
    }
    time
}

/// The filters as parameters of the next page.
fn parameters(filter: &Filter) -> Vec<(&'static str, String)> {
    let time = |micros: i64| Timestamp::from_microsecond(micros).map(|time| time.to_string()).ok();
    let optional = [
        ("state", filter.state.map(|state| state.name().to_owned())),
        ("name", filter.name.clone()),
        ("method", filter.method.clone()),
        ("created_after", filter.created_after.and_then(time)),
        ("created_before", filter.created_before.and_then(time)),
        ("sort", filter.oldest_first.then(|| "created".to_owned())),
    ];
    let set = optional.into_iter().filter_map(|(name, value)| Some((name, value?)));
    set.chain(pages::label_filters(&filter.labels)).collect()
}

/// The page as a response; `parameters` are those of the path that the link to the next page needs besides.
async fn answer(
    app: &App,
    path: &str,
    mut parameters: Vec<(&'static str, String)>,
    filter: &Filter,
    page: Page,
) -> Result<Response, Problem> {
    let found = app.shared.store.list(filter, page.before, page.limit).await?;
    let next_cursor = found.next_before.map(|seq| pages::cursor(seq, filter));
    let link = next_cursor.as_ref().map(|cursor| {
        parameters.extend(self::parameters(filter));
        page.link(path, &parameters, cursor)
    });
    let items = found.jobs.iter().map(JobSummary::of).collect();
    let mut response = axum::Json(JobPage { items, next_cursor }).into_response();
    if let Some(link) = link {
        set(&mut response, header::LINK, &link);
    }
    Ok(response)
}
