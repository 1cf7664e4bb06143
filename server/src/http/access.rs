//! What a key may do: the one place that decides, before any handler runs.
//!
//! A route is known by its pattern. What names a job or a study, and all below it, needs a key of its owner; a route
//! that is not listed here needs an administrator, so that a new one is closed until it is listed. A job or study that
//! the key may not see is answered as one that does not exist, whatever else is wrong with the request.

use axum::RequestExt as _;
use axum::extract::{RawPathParams, Request};
use axum::http::Method;

use crate::accounts::{Caller, Role};
use crate::http::app::App;
use crate::ids::{JobId, StudyId};
use crate::jobs::store::Holder;
use crate::problem::{Kind, Problem};

/// What a request does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Right {
    /// What every key may ask.
    Ask,
    Read,
    Change,
    /// Leases jobs and ends them, whosever they are.
    Work,
    /// Reads the metrics of the service.
    Measure,
    /// It is about the service as a whole.
    Operate,
}

/// What a request names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Named {
    Job,
    Study,
    Nothing,
}

/// Route of a request that meets none.
pub(crate) const UNKNOWN_ROUTE: &str = "unknown";

/// Routes whose answer is computed from the body of a request, of which nothing is stored.
pub(crate) const COMPUTING_ROUTES: [&str; 4] =
    ["/v1/plans", "/v1/mixes/read", "/v1/mixes/blend", "/v1/shapes"];

fn needs(method: &Method, route: &str) -> (Right, Named) {
    let reads = [Method::GET, Method::HEAD].contains(method);
    let own = if reads { Right::Read } else { Right::Change };
    let below = |resource: &str| {
        route.strip_prefix(resource).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    match route {
        _ if below("/v1/jobs/{id}") => (own, Named::Job),
        _ if below("/v1/studies/{id}") => (own, Named::Study),
        "/v1/jobs" | "/v1/studies" | "/v1/events" => (own, Named::Nothing),
        _ if COMPUTING_ROUTES.contains(&route) => (Right::Read, Named::Nothing),
        _ if below("/v1/leases") => (Right::Work, Named::Nothing),
        "/metrics" if reads => (Right::Measure, Named::Nothing),
        "/v1/capabilities" | "/v1/key" | "/problems" | "/problems/{kind}" | "/openapi.json" | "/session"
        | "/healthz" | "/readyz" | UNKNOWN_ROUTE => (Right::Ask, Named::Nothing),
        _ => (Right::Operate, Named::Nothing),
    }
}

/// Refuses what the caller may not do.
///
/// # Errors
/// `forbidden` where the role does not allow it or what is named is only shared, `not-found` where what is named is
/// not the caller's to see, or the store's.
pub(crate) async fn check(
    app: &App,
    caller: &Caller,
    route: &str,
    request: &mut Request,
) -> Result<(), Problem> {
    if caller.role == Role::Admin {
        return Ok(());
    }
    let (right, named) = needs(request.method(), route);
    let needed = match right {
        Right::Ask | Right::Measure => Role::Metrics,
        Right::Work => Role::Worker,
        Right::Read => Role::Read,
        Right::Change => Role::Submit,
        Right::Operate => Role::Admin,
    };
    let is_enough = match right {
        // No others have these two rights, whatever else they may do; an administrator has all.
        Right::Measure | Right::Work => caller.role == needed,
        _ => caller.role >= needed,
    };
    if !is_enough {
        let detail = format!(
            "the API key {:?} has the role `{}`: this needs `{}`",
            caller.by.key,
            caller.role.name(),
            needed.name()
        );
        return Err(Problem::new(Kind::Forbidden, detail));
    }
    if named == Named::Nothing {
        return Ok(());
    }
    let path = request.uri().path().to_owned();
    let parameters = request.extract_parts::<RawPathParams>().await.ok();
    let id = parameters
        .as_ref()
        .and_then(|parameters| parameters.iter().find(|(name, _)| *name == "id"))
        .map_or(path, |(_, id)| id.to_owned());
    let store = &app.shared.store;
    let (holder, what) = match named {
        Named::Job => (holder(JobId::parse(&id), |id| store.holder_of_job(id)).await?, "job"),
        _ => (holder(StudyId::parse(&id), |id| store.holder_of_study(id)).await?, "study"),
    };
    match holder {
        Some(holder) if holder.owner == caller.by.owner => Ok(()),
        Some(holder) if holder.shared && right == Right::Read => Ok(()),
        Some(holder) if holder.shared => {
            let detail = format!(
                "the {what} is shared by its owner {:?} for reading: a key of that owner, or one with the role \
                 `admin`, can change it",
                holder.owner
            );
            Err(Problem::new(Kind::Forbidden, detail))
        }
        _ if named == Named::Job => Err(Problem::no_job(&id)),
        _ => Err(Problem::no_study(&id)),
    }
}

async fn holder<Id, Reading>(
    id: Option<Id>,
    read: impl FnOnce(Id) -> Reading,
) -> Result<Option<Holder>, Problem>
where
    Reading: Future<Output = Result<Option<Holder>, crate::jobs::store::StoreError>>,
{
    match id {
        Some(id) => Ok(read(id).await?),
        None => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_listed_needs_an_administrator() {
        for (method, route, expected) in [
            (Method::GET, "/v1/jobs/{id}", (Right::Read, Named::Job)),
            (Method::HEAD, "/v1/jobs/{id}/exports/{type}", (Right::Read, Named::Job)),
            (Method::POST, "/v1/jobs/{id}/exports/{type}", (Right::Change, Named::Job)),
            (Method::PATCH, "/v1/studies/{id}", (Right::Change, Named::Study)),
            (Method::GET, "/v1/studies/{id}/table", (Right::Read, Named::Study)),
            (Method::POST, "/v1/studies", (Right::Change, Named::Nothing)),
            (Method::POST, "/v1/plans", (Right::Read, Named::Nothing)),
            (Method::POST, "/v1/mixes/read", (Right::Read, Named::Nothing)),
            (Method::POST, "/v1/mixes/blend", (Right::Read, Named::Nothing)),
            (Method::GET, "/v1/key", (Right::Ask, Named::Nothing)),
            (Method::POST, "/v1/leases", (Right::Work, Named::Nothing)),
            (Method::PUT, "/v1/leases/{task}/{attempt}/result", (Right::Work, Named::Nothing)),
            (Method::GET, "/metrics", (Right::Measure, Named::Nothing)),
            (Method::POST, "/metrics", (Right::Operate, Named::Nothing)),
            (Method::GET, "/v1/jobs/{identity}", (Right::Operate, Named::Nothing)),
            (Method::GET, "/v1/new", (Right::Operate, Named::Nothing)),
        ] {
            assert_eq!(needs(&method, route), expected, "{method} {route}");
        }
    }
}
