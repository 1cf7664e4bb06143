//! One HTML file with a packing and a viewer in it, to look at without a service and to send by mail.
//!
//! The file holds the scripts and styles of the web page that it needs, the result without its grains as JSON, and the
//! grains in the format `view` as Base64. Modules import each other by bare names, which an import map gives the
//! scripts as `data:` URLs: relative names mean nothing in a file of its own. Its content security policy lets it ask
//! no server for anything.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use packstone_engine::export::tables::{self, Format, GrainSource, Head};
use serde::Serialize;
use serde_json::Value;

use crate::web_files;

/// Most grains in a file: 11 MB of spheres, 32 MB of others. A packing with more shows its largest grains, and says so.
const MOST_GRAINS: usize = 1_000_000;

/// Bytes of the head of a view.
const HEAD_BYTES: usize = 64;

/// The module that the file starts with.
const ENTRY: &str = "packing.js";
const STYLES: [&str; 2] = ["app.css", "job.css"];
/// Before the names of modules.
const SCHEME: &str = "packstone/";
const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; img-src blob: data:";

/// The element before the JSON that the script reads, and the end of the file.
const DATA: &str = "<script type=\"application/json\" id=\"result-data\">";
const END: &str = "</html>\n";

/// What the script of the file reads.
#[derive(Serialize)]
struct Data<'a, R> {
    /// How many grains the file holds.
    grains: usize,
    result: &'a R,
}

/// Writes the page of a result.
///
/// # Errors
/// Those of the writer and of the source.
pub(crate) fn write(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let shown = grains.len().min(MOST_GRAINS);
    write_document(head, shown, &mut |view| tables::write(Format::View, head, grains, view), out)
}

/// Writes the format `view`.
type WriteView<'a> = dyn FnMut(&mut dyn Write) -> io::Result<()> + 'a;

fn write_document(
    result: &impl Serialize,
    grains: usize,
    write_view: &mut WriteView<'_>,
    out: &mut dyn Write,
) -> io::Result<()> {
    // A name with `</script>` would end the element.
    let data = serde_json::to_string(&Data { grains, result })?.replace('<', "\\u003c");
    let styles: String = STYLES.iter().filter_map(|name| web_files::text(name)).collect();
    let imports: BTreeMap<String, String> = modules()
        .into_iter()
        .map(|(name, text)| {
            (format!("{SCHEME}{name}"), format!("data:text/javascript;base64,{}", STANDARD.encode(text)))
        })
        .collect();
    let imports = serde_json::to_string(&serde_json::json!({ "imports": imports }))?;
    write!(
        out,
        r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>Packing - Packstone</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<style>{styles}</style>
<script type="importmap">{imports}</script>
</head>
<body>
<main id="main">
<div class="head"><h1 id="title">Packing</h1></div>
<noscript><div class="notice" data-kind="warning"><p>This page needs JavaScript.</p></div></noscript>
<div id="result" class="stack"></div>
</main>
{DATA}{data}</script>
<script type="text/plain" id="grains-data">"#,
    )?;
    let mut base64 = EncoderWriter::new(Whole(&mut *out), &STANDARD);
    let mut largest = Largest { out: &mut base64, head: Vec::new(), written: 0, most: MOST_GRAINS };
    let written = write_view(&mut largest);
    match written {
        Err(error) if !(largest.is_full() && error.kind() == io::ErrorKind::WriteZero) => return Err(error),
        _ => {}
    }
    base64.finish()?;
    drop(base64);
    write!(out, "</script>\n<script type=\"module\">import \"{SCHEME}{ENTRY}\";</script>\n</body>\n{END}")
}

/// The result in a page, without its grains; `None` where the page is not complete.
pub(crate) fn result_in(page: &str) -> Option<Value> {
    let data = page.ends_with(END).then_some(page)?.split_once(DATA)?.1.split_once('<')?.0;
    serde_json::from_str::<Value>(data).ok()?.get_mut("result").map(Value::take)
}

/// A writer that takes all that it gets: the encoder takes nothing where the writer below it takes a part.
struct Whole<W>(W);

impl<W: Write> Write for Whole<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// A writer of the format `view` that takes its largest grains, and no byte after them.
struct Largest<W> {
    out: W,
    /// The head of the view, as far as it has come.
    head: Vec<u8>,
    /// Bytes that were passed on.
    written: usize,
    most: usize,
}

impl<W: Write> Largest<W> {
    /// A number of the head ([`view.md`](../../docs/view.md)).
    fn number(&self, at: usize) -> usize {
        let bytes = self.head.get(at..at + 4);
        bytes.map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
    }

    fn grains(&self) -> usize {
        self.number(8).min(self.most)
    }

    /// Where the last grain ends, or the head while it is not complete.
    fn end(&self) -> usize {
        if self.head.len() < HEAD_BYTES {
            HEAD_BYTES
        } else {
            HEAD_BYTES + self.number(48) + self.grains() * self.number(44)
        }
    }

    /// Whether nothing more is taken.
    fn is_full(&self) -> bool {
        self.written == self.end()
    }
}

impl<W: Write> Write for Largest<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.end() - self.written);
        self.out.write_all(&bytes[..taken])?;
        if self.head.len() < HEAD_BYTES {
            self.head.extend_from_slice(&bytes[..taken]);
        }
        self.written += taken;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The first module and those that it imports, directly or not, by their names; they import each other by bare names.
fn modules() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut open = vec![ENTRY.to_owned()];
    while let Some(name) = open.pop() {
        if found.contains_key(&name) {
            continue;
        }
        let Some(text) = web_files::text(&name) else { continue };
        let (text, imported) = with_bare_names(&name, &text);
        open.extend(imported);
        found.insert(name, text);
    }
    found
}

/// The text of a module with bare names in place of relative ones, and the names of the modules that it names so.
fn with_bare_names(module: &str, text: &str) -> (String, Vec<String>) {
    let folder = module.rsplit_once('/').map_or("", |(folder, _)| folder);
    let (mut bare, mut names) = (String::with_capacity(text.len()), Vec::new());
    let mut rest = text;
    while let Some(start) = rest.find("\"./").into_iter().chain(rest.find("\"../")).min() {
        let (before, quoted) = rest.split_at(start + 1);
        bare.push_str(before);
        let end = quoted.find('"').unwrap_or(quoted.len());
        let (path, after) = quoted.split_at(end);
        if Path::new(path).extension().is_some_and(|ending| ending == "js") {
            let name = resolved(folder, path);
            bare.push_str(SCHEME);
            bare.push_str(&name);
            names.push(name);
        } else {
            bare.push_str(path);
        }
        rest = after;
    }
    bare.push_str(rest);
    (bare, names)
}

/// A relative path from a folder, as a path from the top.
fn resolved(folder: &str, path: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in path.split('/') {
        match part {
            "." => {}
            ".." => {
                parts.pop();
            }
            name => parts.push(name),
        }
    }
    parts.join("/")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn modules_name_each_other_by_bare_names_and_all_are_there() {
        assert_eq!(resolved("viewer", "./draw.js"), "viewer/draw.js");
        assert_eq!(resolved("viewer", "../dom.js"), "dom.js");
        let modules = modules();
        assert!(
            modules.contains_key(ENTRY) && modules.contains_key("viewer/bodies.js"),
            "{:?}",
            modules.keys()
        );
        assert!(!modules.contains_key("api.js"), "the file asks no server");
        for (name, text) in &modules {
            let imports = ["from \"", "import(\""].map(|start| text.split(start).skip(1));
            for rest in imports.into_iter().flatten() {
                let imported = rest.split('"').next().unwrap();
                let known =
                    imported.strip_prefix(SCHEME).is_some_and(|imported| modules.contains_key(imported));
                assert!(known, "{name} imports {imported}");
            }
        }
    }

    #[test]
    fn a_name_cannot_end_the_element_that_holds_it() {
        let result = json!({"request": {"name": "</script><script>alert(1)</script>"}});
        let mut page = Vec::new();
        write_document(&result, 0, &mut |_| Ok(()), &mut page).unwrap();
        let page = String::from_utf8(page).unwrap();
        assert!(!page.contains("<script>alert") && page.contains("\\u003c/script>"), "{page}");
    }

    /// A writer that takes a few bytes at once.
    struct Slow(Vec<u8>);

    impl Write for Slow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = bytes.len().min(7);
            self.0.extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_page_is_the_same_through_a_writer_that_takes_parts() {
        let mut view = vec![0; 64];
        view[8..12].copy_from_slice(&300_u32.to_le_bytes());
        view[44..48].copy_from_slice(&8_u32.to_le_bytes());
        view.extend((0..300 * 8).map(|i| i as u8));
        let (mut whole, mut slow) = (Vec::new(), Slow(Vec::new()));
        write_document(&json!({}), 300, &mut |out| out.write_all(&view), &mut whole).unwrap();
        write_document(&json!({}), 300, &mut |out| out.write_all(&view), &mut slow).unwrap();
        assert!(whole == slow.0 && whole.len() > 300 * 8);
    }

    #[test]
    fn the_largest_grains_are_kept() {
        let mut view = vec![0; 64];
        view[8..12].copy_from_slice(&3u32.to_le_bytes());
        view[44..48].copy_from_slice(&8u32.to_le_bytes());
        view[48..52].copy_from_slice(&4u32.to_le_bytes());
        view.extend([7; 4 + 3 * 8]);
        for (most, grains, end) in [(10, 3, view.len()), (2, 2, 64 + 4 + 16), (0, 0, 64 + 4)] {
            let mut largest = Largest { out: Vec::new(), head: Vec::new(), written: 0, most };
            // The head and the table come first, and any blocks then.
            let written =
                [&view[..64], &view[64..70], &view[70..]].map(|part| largest.write_all(part).is_ok());
            assert_eq!(written, [true, most > 0, most > 2]);
            assert_eq!((largest.grains(), &largest.out[..]), (grains, &view[..end]));
        }
    }
}
