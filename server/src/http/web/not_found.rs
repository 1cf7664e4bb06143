//! The page for addresses that do not exist. Programs get a problem document there.

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::Response;

use super::file::SAFETY;
use crate::http::app::App;
use crate::web_files::{document, plain};

/// What stands in the page for the way to the root of the service.
const ROOT: &str = "{root}";

/// Who would get the page: a browser that asked for an address of the pages, or for one that no route has.
#[derive(Debug)]
pub(crate) struct NotFound {
    /// From the address to the root of the service.
    to_root: String,
}

impl NotFound {
    /// Whether a request is that of a browser for a page: it takes HTML by name. `None` where it is not, or where the
    /// server has no pages.
    pub(crate) fn of(app: &App, method: &Method, uri: &Uri, headers: &HeaderMap) -> Option<Self> {
        let takes_html =
            headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).any(|value| {
                value.split([',', ';']).any(|range| range.trim().eq_ignore_ascii_case("text/html"))
            });
        let is_page = [Method::GET, Method::HEAD].contains(method) && app.shared.web.is_some();
        // A proxy may have removed a path before this one, so that the way to the root is relative.
        let depth = uri.path().matches('/').count().saturating_sub(1);
        let to_root = if depth == 0 { "./".to_owned() } else { "../".repeat(depth) };
        (is_page && takes_html).then_some(Self { to_root })
    }

    /// The page in place of the problem that the response says.
    pub(crate) fn in_place_of(&self, mut response: Response) -> Response {
        let refused = [StatusCode::NOT_FOUND, StatusCode::UNAUTHORIZED].contains(&response.status());
        let page = document("not-found").and_then(|gzip| String::from_utf8(plain(gzip)).ok());
        let Some(page) = page.filter(|_| refused) else { return response };
        let page = page.replace(ROOT, &self.to_root);
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
        headers.insert(header::CONTENT_LENGTH, HeaderValue::from(page.len()));
        headers.insert(header::VARY, HeaderValue::from_static("accept"));
        for (name, value) in SAFETY {
            headers.insert(name, HeaderValue::from_static(value));
        }
        *response.body_mut() = Body::from(page);
        response
    }
}
