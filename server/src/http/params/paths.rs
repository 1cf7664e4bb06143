//! What paths name: jobs, studies, and kinds of plots. What does not exist is refused with 404.

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
#[cfg(test)]
use utoipa::IntoParams;
#[cfg(test)]
use utoipa::openapi::path::{Parameter as Described, ParameterIn};

#[cfg(test)]
use crate::http::params::described::{path_parameter, uuid_schema};
use crate::http::params::values::Value as _;
use crate::http::params::{Choice, names, shown};
use crate::ids::{JobId, StudyId};
use crate::plots::job::JobPlot;
use crate::plots::study::StudyPlot;
use crate::problem::{Kind, Problem};

/// The segments of a path that its template leaves open; `None` where they are no text.
pub(crate) async fn segments<T, S>(parts: &mut Parts, state: &S) -> Option<T>
where
    T: serde::de::DeserializeOwned + Send,
    S: Send + Sync,
{
    Path::<T>::from_request_parts(parts, state).await.ok().map(|Path(segments)| segments)
}

/// An ID that a path names.
pub(crate) trait PathId: Sized + Send {
    /// What the interface document says of it.
    #[cfg(test)]
    const DESCRIPTION: &'static str;

    /// The ID, or that nothing has it.
    ///
    /// # Errors
    /// `not-found`.
    fn of(text: &str) -> Result<Self, Problem>;
}

impl PathId for JobId {
    #[cfg(test)]
    const DESCRIPTION: &'static str = "ID of the job";

    fn of(text: &str) -> Result<Self, Problem> {
        Self::parse(text).ok_or_else(|| Problem::no_job(text))
    }
}

impl PathId for StudyId {
    #[cfg(test)]
    const DESCRIPTION: &'static str = "ID of the study";

    fn of(text: &str) -> Result<Self, Problem> {
        Self::parse(text).ok_or_else(|| Problem::no_study(text))
    }
}

/// The job or study that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct IdPath<I>(pub(crate) I);

/// The job that a path names.
pub(crate) type JobPath = IdPath<JobId>;

/// The study that a path names.
pub(crate) type StudyPath = IdPath<StudyId>;

impl<I: PathId, S: Send + Sync> FromRequestParts<S> for IdPath<I> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let id: Option<String> = segments(parts, state).await;
        // Where the path is no text, nothing has it as an ID.
        I::of(id.as_deref().unwrap_or(parts.uri.path())).map(Self)
    }
}

#[cfg(test)]
impl<I: PathId> IntoParams for IdPath<I> {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![path_parameter("id", uuid_schema(), I::DESCRIPTION)]
    }
}

/// A kind of plots, and what it is drawn of.
pub(crate) trait PlotKind: Choice + Send {
    /// ID of what it is drawn of.
    type Id: PathId;
}

impl Choice for JobPlot {
    fn all() -> &'static [Self] {
        Self::ALL
    }

    fn name(self) -> &'static str {
        self.name()
    }
}

impl PlotKind for JobPlot {
    type Id = JobId;
}

impl Choice for StudyPlot {
    fn all() -> &'static [Self] {
        Self::ALL
    }

    fn name(self) -> &'static str {
        self.name()
    }
}

impl PlotKind for StudyPlot {
    type Id = StudyId;
}

/// The job or study and the kind of plot that a path names.
pub(crate) struct PlotPath<K: PlotKind> {
    pub(crate) id: K::Id,
    pub(crate) kind: K,
}

impl<K: PlotKind, S: Send + Sync> FromRequestParts<S> for PlotPath<K> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let found: Option<(String, String)> = segments(parts, state).await;
        let (id, kind) = found.ok_or_else(|| Problem::new(Kind::NotFound, "there is no such plot"))?;
        let id = K::Id::of(&id)?;
        let kind = K::read(&kind).map_err(|_| {
            let detail = format!("there is no plot {}: must be one of {}", shown(&kind), names::<K>());
            Problem::new(Kind::NotFound, detail)
        })?;
        Ok(Self { id, kind })
    }
}

#[cfg(test)]
impl<K: PlotKind> IntoParams for PlotPath<K> {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![
            path_parameter("id", uuid_schema(), K::Id::DESCRIPTION),
            path_parameter("kind", K::schema(), "What is shown"),
        ]
    }
}
