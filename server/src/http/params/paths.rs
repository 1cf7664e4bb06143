//! What paths name: jobs, studies, and kinds of plots. What does not exist is refused with 404.

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use utoipa::IntoParams;
use utoipa::openapi::Required;
use utoipa::openapi::path::{Parameter as Described, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::Object;

use crate::http::params::values::{Value as _, uuid_schema};
use crate::http::params::{Choice, names, shown};
use crate::ids::{JobId, StudyId};
use crate::plots::job::JobPlot;
use crate::plots::study::StudyPlot;
use crate::problem::{Kind, Problem};

/// One parameter of a path in the interface document.
pub(crate) fn described_path(name: &str, schema: Object, description: &str) -> Described {
    ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Path)
        .description(Some(description))
        .required(Required::True)
        .schema(Some(schema))
        .build()
}

/// The segments of a path that its template leaves open; `None` where they are no text.
async fn segments<T, S>(parts: &mut Parts, state: &S) -> Option<T>
where
    T: serde::de::DeserializeOwned + Send,
    S: Send + Sync,
{
    Path::<T>::from_request_parts(parts, state).await.ok().map(|Path(segments)| segments)
}

/// The job that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JobPath(pub(crate) JobId);

impl<S: Send + Sync> FromRequestParts<S> for JobPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let id: Option<String> = segments(parts, state).await;
        let id = id.ok_or_else(|| Problem::no_job(parts.uri.path()))?;
        JobId::parse(&id).map(Self).ok_or_else(|| Problem::no_job(&id))
    }
}

impl IntoParams for JobPath {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![described_path("id", uuid_schema(), "ID of the job")]
    }
}

/// The study that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StudyPath(pub(crate) StudyId);

impl<S: Send + Sync> FromRequestParts<S> for StudyPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let id: Option<String> = segments(parts, state).await;
        let id = id.ok_or_else(|| Problem::no_study(parts.uri.path()))?;
        StudyId::parse(&id).map(Self).ok_or_else(|| Problem::no_study(&id))
    }
}

impl IntoParams for StudyPath {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![described_path("id", uuid_schema(), "ID of the study")]
    }
}

/// A kind of plots, and what it is drawn of.
pub(crate) trait PlotKind: Choice + Send {
    /// ID of what it is drawn of.
    type Id: Send;
    /// What the document says of the ID.
    const DESCRIPTION: &'static str;

    /// The ID, or that there is none of it.
    ///
    /// # Errors
    /// `not-found`.
    fn id(text: &str) -> Result<Self::Id, Problem>;
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
    const DESCRIPTION: &'static str = "ID of the job";

    fn id(text: &str) -> Result<JobId, Problem> {
        JobId::parse(text).ok_or_else(|| Problem::no_job(text))
    }
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
    const DESCRIPTION: &'static str = "ID of the study";

    fn id(text: &str) -> Result<StudyId, Problem> {
        StudyId::parse(text).ok_or_else(|| Problem::no_study(text))
    }
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
        let id = K::id(&id)?;
        let kind = K::read(&kind).map_err(|_| {
            let detail = format!("there is no plot {}: must be one of {}", shown(&kind), names::<K>());
            Problem::new(Kind::NotFound, detail)
        })?;
        Ok(Self { id, kind })
    }
}

impl<K: PlotKind> IntoParams for PlotPath<K> {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![
            described_path("id", uuid_schema(), K::DESCRIPTION),
            described_path("kind", K::schema(), "What is shown"),
        ]
    }
}
