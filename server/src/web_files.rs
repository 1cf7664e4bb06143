//! The files of the web page that are compiled in: HTML, style sheets and scripts.

#[cfg(test)]
#[path = "../build/shorten.rs"]
mod shorten;

use std::io::Read as _;

use flate2::read::GzDecoder;

/// Files of the folder `web` of the repository by their paths in it, in order, without comments and indentation,
/// compressed with gzip (`build/web.rs`).
pub(crate) const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/web_files.rs"));

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
mod tests {
    use super::shorten::shortened;
    use super::text;

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
