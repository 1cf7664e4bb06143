//! Addresses of exports: the type in the path, the options in the query.

use std::sync::Arc;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use packstone_engine::export::{ExportRequest, ExportType};
use serde_json::{Map, Value as Json};
#[cfg(test)]
use utoipa::IntoParams;
#[cfg(test)]
use utoipa::openapi::Required;
#[cfg(test)]
use utoipa::openapi::path::{Parameter as Described, ParameterBuilder, ParameterIn, ParameterStyle};
#[cfg(test)]
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};

use crate::base_path;
use crate::exports::{NewExport, estimates};
use crate::failure::FailureCode;
use crate::gmsh;
use crate::http::app::App;
use crate::http::files::FileName;
#[cfg(test)]
use crate::http::params::described::{described_query, path_parameter, uuid_schema};
use crate::http::params::values::Value;
use crate::http::params::{ParameterSet, RawQuery, choices, names, shown};
use crate::http::problems::refused;
use crate::http::results::finished;
use crate::http::storage::check_room;
use crate::ids::JobId;
use crate::jobs::{JobRecord, JobRequest};
use crate::problem::{Kind, Problem};

/// The job and the type that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExportPath {
    pub(crate) job: JobId,
    pub(crate) kind: ExportType,
}

impl<S: Send + Sync> FromRequestParts<S> for ExportPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let Ok(Path((job, kind))) = Path::<(String, String)>::from_request_parts(parts, state).await else {
            return Err(Problem::no_job(parts.uri.path()));
        };
        let job = JobId::parse(&job).ok_or_else(|| Problem::no_job(&job))?;
        let kind = <ExportType as Value>::read(&kind).map_err(|_| {
            let known = names::<ExportType>();
            let detail = format!("there is no type of exports {}: must be one of {known}", shown(&kind));
            Problem::new(Kind::NotFound, detail)
        })?;
        Ok(Self { job, kind })
    }
}

#[cfg(test)]
impl IntoParams for ExportPath {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Described> {
        vec![
            path_parameter("id", uuid_schema(), "ID of the job, which must have succeeded"),
            path_parameter("type", <ExportType as Value>::schema(), "Type of the export"),
        ]
    }
}

choices! {
    ExportType,
}

/// The format and the options of an export, as texts: the engine reads them, by the type that the path names.
#[derive(Clone, Debug)]
pub(crate) struct ExportOptions(Vec<(String, String)>);

impl ParameterSet for ExportOptions {
    #[cfg(test)]
    fn describe(described: &mut Vec<Described>) {
        let text = || ObjectBuilder::new().schema_type(Type::String).build();
        let parameter = |name: &str, description: &str| {
            ParameterBuilder::new()
                .name(name)
                .parameter_in(ParameterIn::Query)
                .required(Required::False)
                .description(Some(description))
        };
        described.push(
            parameter(
                "format",
                "File format; the first of the type's formats in `/v1/capabilities` when absent.",
            )
            .schema(Some(text()))
            .build(),
        );
        let options =
            ObjectBuilder::new().schema_type(Type::Object).additional_properties(Some(Schema::from(text())));
        described.push(
            parameter(
                "options",
                "Options of an export by name, beside its `format`: those that the schema `ExportRequest` gives its \
                 type and format. A value that is an object or an array is written as JSON.",
            )
            .schema(Some(options.build()))
            .style(Some(ParameterStyle::Form))
            .explode(Some(true))
            .build(),
        );
    }

    fn read(query: &mut RawQuery) -> Option<Self> {
        Some(Self(query.rest()))
    }

    fn write(&self, pairs: &mut Vec<(String, String)>) {
        pairs.extend(self.0.iter().cloned());
    }
}
#[cfg(test)]
described_query!(ExportOptions);

/// The export that a request names, of a job that has a result.
#[derive(Debug)]
pub(crate) struct Target {
    pub(crate) job: JobRecord,
    pub(crate) export: ExportRequest,
    pub(crate) new: NewExport,
}

impl Target {
    /// Reads the options of an export, and finds the job.
    ///
    /// # Errors
    /// `validation-error`, `not-found`, `result-not-ready` or `job-failed`.
    pub(crate) async fn read(app: &App, path: ExportPath, options: &ExportOptions) -> Result<Self, Problem> {
        let pairs = options.0.iter().map(|(name, value)| (name.as_str(), value.as_str()));
        let export = ExportRequest::from_text(path.kind, pairs).map_err(|faults| {
            Problem::fields(FailureCode::ValidationError, faults).of_parameters(str::to_owned)
        })?;
        let (job, result) = finished(app, path.job).await?;
        let new = NewExport::new(&export, &result.sha256);
        Ok(Self { job, export, new })
    }

    /// Whether the export was requested before.
    ///
    /// # Errors
    /// The store's.
    pub(crate) async fn is_known(&self, app: &App) -> Result<bool, Problem> {
        Ok(app.shared.store.knows_export(self.job.seq, &self.new.key).await?)
    }

    /// Refuses what cannot be made of the job's specimen, and a file that would not fit on the disk or into a quota.
    /// What was accepted before is not checked again.
    ///
    /// # Errors
    /// `format-not-available`, `too-large`, `validation-error` or `insufficient-storage`.
    pub(crate) async fn check(&self, app: &App) -> Result<(), Problem> {
        if self.is_known(app).await? {
            return Ok(());
        }
        let request =
            app.shared.store.request(self.job.seq).await.map_err(|error| refused(error, self.job.id))?;
        let (export, id, shared) = (self.export.clone(), self.job.id, Arc::clone(&app.shared));
        let estimated = app.shared.compute.run(move |_| {
            let packed = JobRequest::read(&request, 0, None).map_err(|faults| {
                tracing::error!(job_id = %id, ?faults, "the stored request is unreadable");
                Problem::internal()
            })?;
            export
                .check(&packed.specimen, &shared.limits)
                .and_then(|()| gmsh::check(&export))
                .map_err(|error| Problem::from(error).of_parameters(str::to_owned))?;
            export
                .check_materials(&packed.packing())
                .map_err(|error| Problem::from(error).of_unfit_parameters(str::to_owned))?;
            Ok::<_, Problem>(estimates::of_stored(&export, &packed, &shared.limits, &shared.planner))
        });
        // Without an estimate the export worker decides, which has the packing.
        match estimated.await?? {
            Some(estimate) => check_room(app, &self.job.owner, estimate.bytes).await,
            None => Ok(()),
        }
    }

    /// Its options as JSON, with the `type` and the defaults.
    pub(crate) fn options(&self) -> Json {
        serde_json::to_value(&self.export).unwrap_or_default()
    }

    /// The name under which a client saves the file: it has mix, seed and settings. That of a file with a script beside
    /// it, which names the file, is the same for every client.
    pub(crate) fn file_name(&self) -> FileName {
        let name = FileName::of(&self.job, &self.export.file_ending());
        if self.export.companion("").is_some() { FileName::plain(name.into_ascii()) } else { name }
    }
}

/// The path of an export's file: `options` is its stored JSON.
pub(crate) fn file_path(job: JobId, kind: ExportType, options: &Json) -> String {
    base_path::absolute(&format!("/v1/jobs/{job}/exports/{}{}", kind.name(), query(kind, options)))
}

/// The path of the script beside the file; `None` where it needs none.
pub(crate) fn script_path(job: JobId, kind: ExportType, options: &Json) -> Option<String> {
    ExportRequest::from_json(options).ok()?.companion("")?;
    let path = format!("/v1/jobs/{job}/exports/{}/script{}", kind.name(), query(kind, options));
    Some(base_path::absolute(&path))
}

/// The path of an export's document.
pub(crate) fn status_path(job: JobId, kind: ExportType, options: &Json) -> String {
    base_path::absolute(&format!("/v1/jobs/{job}/exports/{}/status{}", kind.name(), query(kind, options)))
}

fn query(kind: ExportType, options: &Json) -> String {
    let mut query = form_urlencoded::Serializer::for_suffix("?".to_owned(), 1);
    for (name, value) in short_options(kind, options) {
        query.append_pair(&name, &text(&value));
    }
    query.finish()
}

/// The format and the options that are not the defaults of it, where these read back as the same export; else all.
fn short_options(kind: ExportType, options: &Json) -> Map<String, Json> {
    let mut all = options.as_object().cloned().unwrap_or_default();
    all.retain(|name, value| name != "type" && !value.is_null());
    let format = all.get("format").map(text).unwrap_or_default();
    let default = ExportRequest::from_text(kind, [("format", format.as_str())]);
    let default = default.and_then(|default| serde_json::to_value(default).map_err(|_| Vec::new()));
    let Ok(default) = default else { return all };
    let mut short = all.clone();
    short.retain(|name, value| name == "format" || default.get(name.as_str()) != Some(value));
    let mut with_type = short.clone();
    with_type.insert("type".into(), kind.name().into());
    let read_back = ExportRequest::from_json(&Json::Object(with_type)).ok();
    if read_back.and_then(|export| serde_json::to_value(export).ok()).as_ref() == Some(options) {
        short
    } else {
        all
    }
}

/// A value as a parameter: text as it is, numbers without a needless point, all else as JSON.
fn text(value: &Json) -> String {
    match value {
        Json::String(text) => text.clone(),
        Json::Number(number) => match number.as_f64() {
            Some(float) if number.is_f64() => format!("{float}"),
            _ => number.to_string(),
        },
        other => other.to_string(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn read(kind: ExportType, query: &str) -> ExportRequest {
        let pairs: Vec<(String, String)> = form_urlencoded::parse(query.as_bytes()).into_owned().collect();
        ExportRequest::from_text(kind, pairs.iter().map(|(n, v)| (n.as_str(), v.as_str()))).unwrap()
    }

    #[test]
    fn addresses_are_short_and_name_the_same_export() {
        for (kind, given, short) in [
            (ExportType::Slice, "", "?format=svg"),
            (ExportType::Slice, "format=png&axis=z&at_mm=75&pixels=1000", "?format=png&at_mm=75"),
            (ExportType::Slice, "axis=x&at_mm=0.1", "?format=svg&axis=x&at_mm=0.1"),
            (ExportType::Voxels, "cells=100&format=raw", "?format=raw"),
            (ExportType::Voxels, "voxel_mm=1e-1", "?format=vti&voxel_mm=0.1"),
            (ExportType::Ldpm, "format=cells", "?format=cells"),
        ] {
            let export = read(kind, given);
            let found = query(kind, &serde_json::to_value(&export).unwrap());
            assert_eq!(found, short, "{given}");
            assert_eq!(read(kind, &found[1..]), export, "{found}");
        }
        for kind in ExportType::ALL {
            for format in kind.formats() {
                let options = kind.options_of_format(format).into_iter();
                let given: Vec<String> = options.map(|(name, value)| format!("{name}={value}")).collect();
                let export = read(kind, &given.join("&"));
                let found = query(kind, &serde_json::to_value(&export).unwrap());
                assert_eq!(read(kind, &found[1..]), export, "{found}");
            }
        }
    }
}
