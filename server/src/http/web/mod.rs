//! The web page: HTML, style sheets and scripts under fixed names, compiled in without their comments and indentation
//! (`build/web.rs`) or, for development, from a folder as they are.
//!
//! Below `/docs/` lie the documents of the repository as pages, and beside the assets the examples with their pictures
//! (`build/documents.rs`), always those of the binary. A browser that asks for an address that does not exist gets a
//! page.
//!
//! Pages hold no data, so that they are open without an API key; their scripts ask the published interface, with a key
//! or a session. They are not part of the contract of the interface.

mod file;
mod not_found;
mod table;

use std::io::{self, Read as _};
use std::path::PathBuf;

use axum::Router;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::{Redirect, Response};
use axum::routing::get;

use crate::base_path;
use crate::blobs::open_regular;
use crate::http::app::App;
use crate::http::problems::of_fault;
use crate::jobs::store::Fault;
use crate::problem::{Kind, Problem};
use crate::tasks;
use crate::web_files::{FILES, document};
use file::WebFile;
pub(crate) use not_found::NotFound;
use table::PAGES;

/// The route of style sheets, scripts and pictures.
const ASSETS: &str = "/assets/{*name}";

/// The routes of documents.
const DOCUMENT_ROUTES: [&str; 3] = ["/docs", "/docs/", "/docs/{*path}"];

/// Longest file of a folder that is read.
const MOST_BYTES: u64 = 16 << 20;

/// Where the files come from.
#[derive(Debug)]
pub(crate) enum Web {
    /// Those of the binary, by their names, in order.
    Compiled(Vec<(&'static str, WebFile)>),
    /// Those of a folder, read at each request.
    Folder(PathBuf),
}

impl Web {
    /// The files of the binary.
    pub(crate) fn compiled() -> Self {
        Self::Compiled(FILES.iter().map(|(name, gzip)| (*name, WebFile::compiled(name, gzip))).collect())
    }

    /// The answer with a file of the table; any other name does not exist, whatever lies in the folder.
    ///
    /// # Errors
    /// `not-found`, or `machine-fault` where a file of the folder cannot be read.
    async fn answer(&self, name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
        let missing = || Problem::new(Kind::NotFound, "there is no such route");
        match self {
            Self::Compiled(files) => {
                let found = files.iter().find(|(known, _)| *known == name);
                found.map(|(_, file)| file.answer(headers)).ok_or_else(missing)
            }
            Self::Folder(folder) => {
                let (known, _) = FILES.iter().find(|(known, _)| *known == name).ok_or_else(missing)?;
                let path = folder.join(known);
                // Compressed there, too.
                let read = tasks::blocking(move || Ok(WebFile::new(known, read(&path)?))).await;
                match read.unwrap_or_else(|error| Err(io::Error::other(error))) {
                    Ok(file) => Ok(file.answer(headers)),
                    Err(error) if error.kind() == io::ErrorKind::NotFound => Err(missing()),
                    Err(error) => {
                        tracing::error!(%error, name, "a file of --web-dir cannot be read");
                        Err(of_fault(Fault::Io))
                    }
                }
            }
        }
    }
}

/// Reads a regular file of bounded length.
fn read(path: &std::path::Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_BYTES {
        let what = format!("{} has more than {MOST_BYTES} bytes", path.display());
        return Err(io::Error::new(io::ErrorKind::InvalidData, what));
    }
    Ok(bytes)
}

/// Whether a route is one of the pages or of what they use.
pub(crate) fn is_of_pages(route: &str) -> bool {
    route == ASSETS || DOCUMENT_ROUTES.contains(&route) || PAGES.iter().any(|(page, _)| *page == route)
}

/// Adds the pages and their files, if this server has any.
pub(crate) fn add_to(mut router: Router<App>, app: &App) -> Router<App> {
    if app.shared.web.is_none() {
        return router;
    }
    for (route, file) in PAGES {
        let page = move |State(app): State<App>, headers: HeaderMap| answer(app, file, headers);
        router = router.route(route, get(page));
    }
    let [bare, index, documents] = DOCUMENT_ROUTES;
    router
        .route(ASSETS, get(asset))
        // The addresses of its links are relative to a folder.
        .route(bare, get(|| async { Redirect::permanent(&base_path::absolute("/docs/")) }))
        .route(index, get(|headers: HeaderMap| async move { of_documents("docs/", &headers) }))
        .route(documents, get(one_document))
}

async fn one_document(Path(path): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    of_documents(&format!("docs/{path}"), &headers)
}

/// A file that was made of the documents and examples.
fn of_documents(name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    let bytes = document(name).ok_or_else(|| Problem::new(Kind::NotFound, "there is no such document"))?;
    Ok(WebFile::of_document(name, bytes).answer(headers))
}

async fn asset(
    State(app): State<App>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    if ["gallery.json", "version.json"].contains(&&*name) || name.starts_with("gallery/") {
        return of_documents(&name, &headers);
    }
    // Pages have addresses of their own.
    let is_page = PAGES.iter().any(|(_, file)| *file == name);
    answer(app, if is_page { "" } else { &name }, headers).await
}

async fn answer(app: App, name: &str, headers: HeaderMap) -> Result<Response, Problem> {
    match &app.shared.web {
        Some(web) => web.answer(name, &headers).await,
        None => Err(Problem::new(Kind::NotFound, "there is no such route")),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn only_regular_files_of_bounded_length_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("index.html");
        std::fs::write(&file, "page").unwrap();
        assert_eq!(read(&file).unwrap(), b"page");
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        for other in [&pipe, Path::new("/dev/zero"), folder.path()] {
            read(other).unwrap_err();
        }
        std::fs::File::options().write(true).open(&file).unwrap().set_len(MOST_BYTES + 1).unwrap();
        assert!(read(&file).unwrap_err().to_string().contains("more than"));
    }
}
