//! Listing jobs: all of them, or those of a study.

use axum::Extension;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::Response;
use serde::Serialize;

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::jobs::view::JobSummary;
use crate::http::pages::{self, DamagedItem, PageParameters};
use crate::http::params::values::{Flag, Labels, OrDefault, Text, Time};
use crate::http::params::{Choice as _, IdPath, ParameterSet, Query, StudyPath, choices, parameters};
use crate::http::problems::refused;
use crate::http::response::{SHORT_LIST, json, set};
use crate::ids::StudyId;
use crate::jobs;
use crate::jobs::request::MAX_NAME_CHARS;
use crate::jobs::store::{Filter, Order, SortKey, StoreError, Totals};
use crate::problem::Problem;

/// A page of jobs.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobPage {
    /// The jobs in the order of `sort`, without their requests.
    items: Vec<JobSummary>,
    /// Items of the page whose record in the database is damaged; they are left out of `items`. Absent where there are
    /// none.
    #[cfg_attr(test, schema(required = false))]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    damaged: Vec<DamagedItem>,
    /// All jobs that fit the filters, on whichever page; where `totals=true` asks for it.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    totals: Option<JobTotals>,
    /// Where the next page starts; `null` on the last.
    #[cfg_attr(test, schema(required))]
    next_cursor: Option<String>,
}

/// All jobs that fit the filters of a list.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobTotals {
    /// Their number; at most 10 000 are counted.
    jobs: u64,
    /// Whether there are more than were counted.
    more: bool,
    /// Bytes of the results of those that were counted, without exports.
    bytes: u64,
}

impl From<Totals> for JobTotals {
    fn from(Totals { jobs, is_all, bytes }: Totals) -> Self {
        Self { jobs, more: !is_all, bytes }
    }
}

choices! {
    jobs::State,
}

choices! {
    /// A method of packing, as requests name it.
    pub(crate) enum MethodName {
        /// The server chooses.
        Auto "auto",
        /// Random sequential addition.
        Rsa "rsa",
        /// Growth, by events or moves as the grains are.
        Growth "growth",
        /// Event-driven molecular dynamics.
        Edmd "edmd",
        /// Hard-particle Monte Carlo.
        MonteCarlo "monte_carlo",
    }

    /// The order of a list of jobs.
    #[derive(Default)]
    pub(crate) enum JobOrder {
        /// Newest first.
        #[default]
        Newest "-created",
        /// Oldest first.
        Oldest "created",
        /// Highest priority first.
        HighestPriority "-priority",
        /// Lowest priority first.
        LowestPriority "priority",
        /// Latest end first; jobs that have not ended come last.
        LatestEnd "-finished",
        /// Earliest end first; jobs that have not ended come before.
        EarliestEnd "finished",
    }
}

impl JobOrder {
    fn order(self) -> Order {
        let (key, descending) = match self {
            Self::Newest => (SortKey::Created, true),
            Self::Oldest => (SortKey::Created, false),
            Self::HighestPriority => (SortKey::Priority, true),
            Self::LowestPriority => (SortKey::Priority, false),
            Self::LatestEnd => (SortKey::Finished, true),
            Self::EarliestEnd => (SortKey::Finished, false),
        };
        Order { key, descending }
    }
}

parameters! {
    /// The jobs of a list, and their order.
    #[derive(Clone, Debug)]
    pub(crate) struct JobListParameters {
        /// Only jobs in this state.
        state: Option<jobs::State>,
        /// `key=value`; only jobs with this label; may be repeated, and then all must fit.
        label: Labels,
        /// Only jobs whose name contains this text, or the `title` of their `overview`, in upper or lower case.
        name: Option<Text<1, MAX_NAME_CHARS>>,
        /// Only jobs with this method in their request.
        method: Option<MethodName>,
        /// RFC 3339 time; only jobs submitted at this time or later.
        created_after: Option<Time>,
        /// RFC 3339 time; only jobs submitted before this time.
        created_before: Option<Time>,
        /// `created`: oldest first; `priority`: lowest first; `finished`: earliest end first, jobs that have not ended
        /// before all others. Equal jobs are in the order of submission. `-` reverses the whole order.
        sort: OrDefault<JobOrder>,
        /// Items have their `overview`: what the request packs, in a few words.
        overview: Flag<false>,
        /// The page has the `totals` of all jobs that fit.
        totals: Flag<false>,
        ..page: PageParameters,
    }
}

parameters! {
    /// The jobs of a list of all jobs.
    #[derive(Clone, Debug)]
    pub(crate) struct AllJobsParameters {
        /// Only jobs of this study.
        study: Option<StudyId>,
        ..jobs: JobListParameters,
    }
}

/// List jobs
///
/// Newest first, unless `sort` says otherwise. Items are jobs without their `request`. A key with the role `admin` sees
/// all jobs, any other key those of its owner and those that are shared.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs", tag = "jobs", operation_id = "list_jobs",
    params(AllJobsParameters),
    responses(
        (status = 200, description = "A page", body = JobPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        crate::http::problems::sets::ListProblems
    )
))]
pub(crate) async fn list(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Query(mut query): Query<AllJobsParameters>,
) -> Result<Response, Problem> {
    let filter = query.jobs.filter(&caller, query.study);
    let found = page(&app, &filter, &query.jobs).await?;
    let next = |cursor: &str| {
        query.jobs.page.turn_to(cursor);
        query
    };
    Ok(found.response(&app, "/v1/jobs", next).await)
}

/// List the jobs of a study
///
/// As `GET /v1/jobs?study=`. Newest first, unless `sort` says otherwise: the last replicates of all points come before
/// the first.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/studies/{id}/jobs", tag = "studies", operation_id = "list_study_jobs",
    params(StudyPath, JobListParameters),
    responses(
        (status = 200, description = "A page", body = JobPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        crate::http::problems::sets::StudyProblems
    )
))]
pub(crate) async fn list_of_study(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): StudyPath,
    Query(mut query): Query<JobListParameters>,
) -> Result<Response, Problem> {
    let filter = query.filter(&caller, Some(id));
    query.page.after(&filter)?;
    if app.shared.store.study(id).await?.is_none() {
        return Err(refused(StoreError::NoStudy, id));
    }
    let found = page(&app, &filter, &query).await?;
    let next = |cursor: &str| {
        query.page.turn_to(cursor);
        query
    };
    Ok(found.response(&app, &format!("/v1/studies/{id}/jobs"), next).await)
}

impl JobListParameters {
    fn filter(&self, caller: &Caller, study: Option<StudyId>) -> Filter {
        Filter {
            state: self.state,
            labels: self.label.0.clone(),
            study,
            name: self.name.as_ref().map(|name| name.0.clone()),
            method: self.method.map(|method| method.name().to_owned()),
            created_after: self.created_after.map(|time| time.0),
            created_before: self.created_before.map(|time| time.0),
            visible_to: caller.sees_only(),
            order: self.sort.0.order(),
        }
    }
}

/// The page of a listing that was asked for.
async fn page(app: &App, filter: &Filter, query: &JobListParameters) -> Result<JobPage, Problem> {
    let (store, page) = (&app.shared.store, &query.page);
    let found = store.list(filter, page.after(filter)?, page.limit.get()).await?;
    let mut items = JobSummary::of_all(app, &found.jobs).await?;
    if query.overview.get() {
        for (item, job) in items.iter_mut().zip(&found.jobs) {
            item.set_overview(job.overview.clone());
        }
    }
    let totals = if query.totals.get() { Some(store.totals(filter).await?.into()) } else { None };
    let next_cursor = found.next_after.map(|item| pages::cursor(item, filter));
    Ok(JobPage { items, totals, damaged: DamagedItem::all(found.damaged), next_cursor })
}

impl JobPage {
    /// The page as a response; `next` makes the parameters of the next page from its cursor.
    async fn response<P: ParameterSet>(
        self,
        app: &App,
        path: &str,
        next: impl FnOnce(&str) -> P,
    ) -> Response {
        let link = self.next_cursor.as_deref().map(|cursor| pages::link(path, &next(cursor)));
        let is_long = self.items.len() > SHORT_LIST;
        let mut response = json(app, StatusCode::OK, self, is_long).await;
        if let Some(link) = link {
            set(&mut response, header::LINK, &link);
        }
        response
    }
}
