//! The pages and the files that they use, compiled in: one line per file and one per page.

/// Files of the folder `web` of the repository, by their paths in it.
macro_rules! files {
    ($($name:literal)*) => {
        pub(super) const FILES: &[(&str, &[u8])] = &[
            $(($name, include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../web/", $name)))),*
        ];
    };
}

files! {
    "api.js"
    "app.css"
    "code.js"
    "dom.js"
    "export-options.js"
    "form-address.js"
    "form-code.js"
    "form-curve.js"
    "form-drawing.js"
    "form-fields.js"
    "form-plan.js"
    "form-pointer.js"
    "form-sieves.js"
    "form-study.js"
    "form.css"
    "form.js"
    "growth.js"
    "icon.svg"
    "index.html"
    "job-exports.js"
    "job-facts.js"
    "job-legend.js"
    "job-picture.js"
    "job-run.js"
    "job-slices.js"
    "job-view.js"
    "job.css"
    "job.html"
    "job.js"
    "jobs.html"
    "jobs.js"
    "key.js"
    "lists.css"
    "live.js"
    "packing.js"
    "rows.js"
    "service.html"
    "service.js"
    "shell.js"
    "studies.html"
    "studies.js"
    "study-parts.js"
    "study-table.js"
    "study.html"
    "study.js"
    "viewer/camera.js"
    "viewer/colours.js"
    "viewer/controls.js"
    "viewer/draw.js"
    "viewer/picture.js"
    "viewer/png.js"
    "viewer/read.js"
    "viewer/shaders.js"
    "viewer/viewer.js"
}

/// Routes of pages, each with its file.
pub(super) const PAGES: [(&str, &str); 6] = [
    ("/", "index.html"),
    ("/jobs", "jobs.html"),
    ("/jobs/{id}", "job.html"),
    ("/studies", "studies.html"),
    ("/studies/{id}", "study.html"),
    ("/service", "service.html"),
];

/// Media types by the ends of names.
const MEDIA_TYPES: [(&str, &str); 4] = [
    ("html", "text/html; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("svg", "image/svg+xml"),
];

/// The media type of a file of the table.
pub(super) fn media_type(name: &str) -> &'static str {
    let end = name.rsplit('.').next().unwrap_or_default();
    MEDIA_TYPES.iter().find(|(of, _)| *of == end).map_or("application/octet-stream", |(_, found)| found)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    /// Files below a folder whose names end as those of the table do, by their paths in it.
    fn walk(folder: &Path, before: &str, found: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let name = format!("{before}{}", entry.file_name().to_str().unwrap());
            if entry.file_type().unwrap().is_dir() {
                walk(&entry.path(), &format!("{name}/"), found);
            } else if media_type(&name) != "application/octet-stream" {
                found.insert(name);
            }
        }
    }

    #[test]
    fn the_table_has_each_file_of_the_folder_once() {
        let mut found = BTreeSet::new();
        walk(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../web"), "", &mut found);
        let named: Vec<&str> = FILES.iter().map(|(name, _)| *name).collect();
        assert_eq!(named, found.iter().map(String::as_str).collect::<Vec<_>>(), "in the order of the names");
        for (route, file) in PAGES {
            assert!(named.contains(&file), "{route} has the file {file}, which is not in the table");
        }
    }
}
