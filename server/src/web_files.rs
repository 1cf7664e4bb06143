//! The files of the web page that are compiled in: HTML, style sheets and scripts.

#[cfg(test)]
#[path = "../build/shorten.rs"]
mod shorten;

use std::io::Read as _;

use flate2::read::GzDecoder;

/// Files of the folder `web` of the repository by their paths in it, in order, without comments and indentation,
/// compressed with gzip (`build/web.rs`).
pub(crate) const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/web_files.rs"));

/// The documents as pages (`docs/PATH`), what they show and link to (`docs/files/PATH`), the examples (`gallery.json`,
/// `gallery/NAME.png`), the version (`version.json`) and the page `not-found`, by their paths, in order: pictures as
/// they are, all else compressed with gzip (`build/documents.rs`).
pub(crate) const DOCUMENTS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/document_files.rs"));

/// The bytes of a file of [`DOCUMENTS`].
pub(crate) fn document(name: &str) -> Option<&'static [u8]> {
    let found = DOCUMENTS.binary_search_by_key(&name, |(known, _)| *known).ok()?;
    DOCUMENTS.get(found).map(|(_, bytes)| *bytes)
}

/// The text of a file of [`FILES`].
pub(crate) fn text(name: &str) -> Option<String> {
    let (_, gzip) = FILES.iter().find(|(known, _)| *known == name)?;
    String::from_utf8(plain(gzip)).ok()
}

/// What the bytes of a file of [`FILES`] are without gzip.
pub(crate) fn plain(gzip: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    // The bytes are those of the build, and a vector takes them all.
    let _ = GzDecoder::new(gzip).read_to_end(&mut bytes);
    bytes
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;

    use super::shorten::shortened;
    use super::{DOCUMENTS, document, plain, text};

    /// The path of a link within the service, seen from a path.
    fn target(here: &str, link: &str) -> String {
        let mut parts: Vec<&str> = here.split('/').collect();
        parts.pop();
        for part in link.split('/') {
            match part {
                "." => {}
                ".." => assert!(parts.pop().is_some(), "{here}: {link} leads out of the service"),
                name => parts.push(name),
            }
        }
        if link.ends_with('.') || link.is_empty() {
            parts.push("");
        }
        parts.join("/")
    }

    #[test]
    fn links_and_pictures_of_documents_lead_to_what_is_handed_out() {
        let is_page = |name: &str| name.starts_with("docs/") && !name.starts_with("docs/files/");
        let pages: Vec<(&str, String)> = DOCUMENTS
            .iter()
            .filter(|(name, _)| is_page(name))
            .map(|(name, gzip)| (*name, String::from_utf8(plain(gzip)).unwrap()))
            .collect();
        assert!(pages.len() > 50, "{} pages", pages.len());
        let headings: BTreeSet<String> = pages
            .iter()
            .flat_map(|(name, page)| {
                page.split(" id=\"")
                    .skip(1)
                    .map(move |rest| format!("{name}#{}", rest.split('"').next().unwrap()))
            })
            .collect();
        let elsewhere = ["", "jobs", "studies", "service", "openapi.json"];
        let mut wrong = Vec::new();
        for (name, page) in &pages {
            assert!(!page.contains(" style=\"") && !page.contains("<script"), "{name} has nothing inline");
            for rest in page.split(" href=\"").skip(1).chain(page.split(" src=\"").skip(1)) {
                let link = rest.split('"').next().unwrap();
                if link.contains(':') {
                    continue;
                }
                let (path, heading) = link.split_once('#').unwrap_or((link, ""));
                let found = if path.is_empty() {
                    (*name).to_owned()
                } else {
                    target(name, path.split('?').next().unwrap())
                };
                let asset = found.strip_prefix("assets/");
                let is_there = elsewhere.contains(&&*found)
                    || asset.is_some_and(|asset| text(asset).is_some() || document(asset).is_some())
                    || document(&found).is_some();
                let has_heading =
                    ["", "main"].contains(&heading) || headings.contains(&format!("{found}#{heading}"));
                if !is_there || !has_heading {
                    wrong.push(format!("{name}: {link}"));
                }
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }

    #[test]
    fn documents_are_short_enough_to_be_carried() {
        let sum = |is_picture: bool| -> usize {
            let chosen = DOCUMENTS.iter().filter(|(name, _)| {
                name.starts_with("docs/")
                    && ["png", "svg"].contains(&name.rsplit('.').next().unwrap_or_default()) == is_picture
            });
            chosen.map(|(_, bytes)| bytes.len()).sum()
        };
        assert!(sum(true) < 1_000_000, "pictures: {} bytes", sum(true));
        assert!(sum(false) < 700_000, "texts: {} bytes", sum(false));
    }

    #[test]
    fn each_example_has_a_request_words_and_a_picture() {
        let gallery: Vec<serde_json::Value> =
            serde_json::from_slice(&plain(document("gallery.json").unwrap())).unwrap();
        assert!(gallery.len() >= 24, "{} examples", gallery.len());
        for example in gallery {
            let name = example["name"].as_str().unwrap();
            assert!(document(&format!("gallery/{name}.png")).is_some(), "{name}");
            for member in ["title", "topic", "about"] {
                assert!(example[member].as_str().is_some_and(|words| !words.is_empty()), "{name}: {member}");
            }
            packstone_engine::PackingRequest::from_json(&example["request"], 1)
                .map(drop)
                .or_else(|faults| {
                    // Exports are no part of what the engine packs.
                    let others = faults
                        .iter()
                        .all(|fault| fault.pointer.starts_with("/postprocess") || fault.pointer == "/name");
                    if others { Ok(()) } else { Err(faults) }
                })
                .unwrap();
        }
    }

    #[test]
    fn what_is_compiled_in_is_the_code_shortened() {
        let script = concat!(
            "// A head.\n// @ts-check\n/**\n * Of a function.\n * @param {string} a\n */\n",
            "export const f = (/** @type {any} */ a) => `\n  // of a shader\n\n  x = ${`2.`}; // of the line\n`;\n\n",
            "  /** A type. */\n  const all = \"*/*\";\n",
        );
        let code = "export const f = (a) => `\n\n  x = ${`2.`}; // of the line\n`;\nconst all = \"*/*\";\n";
        assert_eq!(shortened("a.js", script), code);
        assert_eq!(
            shortened("a.css", "/* A\n   head. */\n\na { /* b */ color: red; }\n  b {}\n"),
            "a { color: red; }\nb {}\n"
        );
        assert_eq!(shortened("a.html", "<!-- a -->\n"), "<!-- a -->\n");
        let read = concat!(env!("CARGO_MANIFEST_DIR"), "/../web/viewer/viewer.js");
        let source = std::fs::read_to_string(read).unwrap_or_default();
        assert_eq!(text("viewer/viewer.js"), Some(shortened("viewer.js", &source)));
    }
}
