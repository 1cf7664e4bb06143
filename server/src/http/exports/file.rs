//! The file of an export: sent as soon as it is made.

use std::io;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use crate::blobs::Shown;
use crate::exports::StoredFile;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target};
use crate::http::exports::making::{self, Made};
use crate::http::exports::view;
use crate::http::files::{self, Coding, Described};
use crate::http::params::Query;
use crate::http::problems::of_fault;
use crate::http::response::set;
use crate::http::session::Site;
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::Fault;
use crate::problem::{Kind, Problem};
use crate::tasks;

/// How long an answer is held back while its file is made, if the request does not say.
const WAIT: Wait = Wait { s: 60 };
/// How long a client that is sent to the storage may begin a download there.
const URL_VALID: Duration = Duration::from_mins(5);

/// Get an export
///
/// Answers with the file if it exists or can be made within the time that `Prefer: wait=N` gives, 60 s when absent.
/// Else the answer is 202 with the state of the export and `Retry-After`: it goes on being made, and the same request
/// gets it later. Supports `Range` with one part, `If-Range` and `If-None-Match`. What nobody asked to be kept is a
/// cache: it may be dropped, and is made again. A server that is told to (`--blobs-redirect`) answers with a URL of its
/// storage, valid for 5 minutes, in place of the file.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/exports/{type}", tag = "exports", operation_id = "get_export",
    params(
        ExportPath,
        ExportOptions,
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60: how long the answer may be held back"),
        ("Range" = Option<String>, Header, description = "`bytes=FIRST-LAST`, one part"),
        ("If-Range" = Option<String>, Header, description = "Send the range only if the tag is still this"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the file as known"),
    ),
    responses(
        crate::http::exports::responses::FileResponses,
        (status = 202, description = "The file is not made yet: its state", body = view::Export,
            headers(("Retry-After" = String, description = "Seconds after which to ask again"),
                ("Content-Location" = String, description = "Address of the export's document"))),
        crate::http::problems::sets::ExportFileProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    path: ExportPath,
    Query(options): Query<ExportOptions>,
    Extension(site): Extension<Site>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let target = Target::read(&app, path, &options).await?;
    if !target.is_known(&app).await? {
        site.check_start(&headers)?;
    }
    target.check(&app).await?;
    let described = described(&target);
    if let Some(response) = described.not_modified(&headers) {
        return Ok(response);
    }
    let preferred = Wait::of(&headers);
    let ready = match making::made(&app, &target, preferred.unwrap_or(WAIT)).await? {
        Made::File(ready) => ready,
        Made::Failed(record) => {
            let failure = record.error.unwrap_or_else(Failure::internal);
            let why = &failure.detail;
            return Err(Problem::new(Kind::ExportFailed, format!("the export failed: {why}"))
                .with(|members| members.export_error = Some((&failure).into())));
        }
        Made::NotYet(record) => {
            let mut response = view::not_yet(&record);
            if let Some(wait) = preferred {
                set(&mut response, PREFERENCE_APPLIED, &wait.applied());
            }
            return Ok(response);
        }
    };
    if app.shared.blobs_redirect
        && method == Method::GET
        && let Some(response) = redirect(&app, &described, &ready.stored).await?
    {
        return Ok(response);
    }
    let part = described.part(&method, &headers, ready.stored.bytes)?;
    described.respond(part, |range| files::send_file(&app, ready.file, range)).await
}

/// Sends the client to the storage, where there is one that it can be sent to.
async fn redirect(
    app: &App,
    described: &Described,
    stored: &StoredFile,
) -> Result<Option<Response>, Problem> {
    let artifacts = app.shared.artifacts.clone();
    let (stored, described) = (stored.clone(), described.clone());
    let url = tasks::blocking(move || {
        let shown = Shown {
            content_type: described.content_type.to_str().unwrap_or("application/octet-stream"),
            disposition: &described.disposition(),
        };
        artifacts.url_of_export(&stored, &shown, URL_VALID)
    });
    let url = url.await.unwrap_or_else(|error| Err(io::Error::other(error))).map_err(|error| {
        tracing::error!(%error, "a URL of the storage cannot be made at present");
        of_fault(Fault::Io)
    })?;
    let Some(url) = url else { return Ok(None) };
    let mut response = StatusCode::TEMPORARY_REDIRECT.into_response();
    set(&mut response, header::LOCATION, &url);
    // The URL is for this client, and for a short time.
    set(&mut response, header::CACHE_CONTROL, "no-store");
    Ok(Some(response))
}

/// How the file of an export is described. Its key names all that decides its bytes.
fn described(target: &Target) -> Described {
    let (media_type, key) = (target.export.media_type(), &target.new.key);
    Described {
        etag: Coding::Never.tag(&key[..32.min(key.len())]),
        content_type: HeaderValue::from_static(media_type),
        filename: target.file_name(),
        inline: media_type.starts_with("image/"),
        negotiated: false,
        coding: Coding::Never,
    }
}
