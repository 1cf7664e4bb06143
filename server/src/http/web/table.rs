//! Which files are pages, and what media types files have.

/// Routes of pages, each with its file.
pub(super) const PAGES: [(&str, &str); 7] = [
    ("/", "index.html"),
    ("/jobs", "jobs.html"),
    ("/jobs/{id}", "job.html"),
    ("/compare", "compare.html"),
    ("/studies", "studies.html"),
    ("/studies/{id}", "study.html"),
    ("/service", "service.html"),
];

/// Media types by the ends of names.
const MEDIA_TYPES: [(&str, &str); 13] = [
    ("html", "text/html; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("svg", "image/svg+xml"),
    ("png", "image/png"),
    ("json", "application/json"),
    ("ipynb", "application/json"),
    ("csv", "text/csv; charset=utf-8"),
    ("py", PLAIN),
    ("inp", PLAIN),
    ("m", PLAIN),
    ("cff", PLAIN),
    ("sh", PLAIN),
];

const PLAIN: &str = "text/plain; charset=utf-8";

/// The media type of a file of the table.
pub(super) fn media_type(name: &str) -> &'static str {
    // Pages made of documents have no ending.
    let Some((_, end)) = name.rsplit_once('.') else { return MEDIA_TYPES[0].1 };
    MEDIA_TYPES.iter().find(|(of, _)| *of == end).map_or("application/octet-stream", |(_, found)| found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::web_files::{DOCUMENTS, FILES};

    #[test]
    fn every_page_has_its_file_and_every_file_a_media_type() {
        for (route, file) in PAGES {
            assert!(
                FILES.iter().any(|(name, _)| *name == file),
                "{route} has the file {file}, which is not there"
            );
        }
        for (name, _) in FILES.iter().chain(DOCUMENTS) {
            assert_ne!(media_type(name), "application/octet-stream", "{name}");
        }
    }
}
