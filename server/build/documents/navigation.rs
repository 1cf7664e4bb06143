//! The list of documents beside each page, in the order of `mkdocs.yml`.

use std::collections::BTreeMap;

/// An entry of the list.
pub(super) struct Entry {
    /// How deep it lies: 0 for a section of the site.
    pub(super) depth: usize,
    pub(super) title: String,
    /// The page, relative to `/docs/`; none of a section.
    pub(super) page: Option<String>,
}

/// Reads the member `nav`, a list of `- path`, `- Title: path` and `- Title:` with a list below it. Pages that are not
/// handed out are left out, and so are sections that are then empty.
pub(super) fn read(yaml: &str, pages: &BTreeMap<String, String>) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for line in yaml.lines().skip_while(|line| *line != "nav:").skip(1) {
        let Some((indent, words)) = line.split_once("- ") else { break };
        let depth = (indent.len() / 2).saturating_sub(1) / 2;
        let (title, path) = words.split_once(':').unwrap_or(("", words));
        let path = path.trim();
        if path.is_empty() {
            while entries.last().is_some_and(|last| last.page.is_none() && last.depth >= depth) {
                entries.pop();
            }
            entries.push(Entry { depth, title: title.to_owned(), page: None });
        } else if let Some(page) = page_of(path, pages) {
            let title = if title.is_empty() { "Overview" } else { title };
            entries.push(Entry { depth, title: title.to_owned(), page: Some(page) });
        }
    }
    entries
}

/// The page of a path of the list, where it is handed out: that of a document, or of one that lies elsewhere.
fn page_of(path: &str, pages: &BTreeMap<String, String>) -> Option<String> {
    let of_file = pages.get(&format!("docs/{path}"));
    let elsewhere = path.strip_suffix(".md").and_then(|page| pages.values().find(|known| *known == page));
    of_file.or(elsewhere).cloned()
}
