//! Links of documents: where they lead in the repository, and what they become on a page.

use std::collections::BTreeSet;

use pulldown_cmark::{Event, Options, Parser, Tag};

use super::Site;

/// What documents use of Markdown beyond its core.
pub(super) fn parser(text: &str) -> Parser<'_> {
    Parser::new_ext(text, Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH)
}

/// The targets of all links and pictures of a document.
pub(super) fn targets(text: &str) -> BTreeSet<String> {
    let target = |event| match event {
        Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
            Some(dest_url.into_string())
        }
        _ => None,
    };
    parser(text).filter_map(target).collect()
}

/// Whether a link leads out of the repository.
fn is_outside(target: &str) -> bool {
    ["https:", "http:", "mailto:"].iter().any(|scheme| target.starts_with(scheme))
}

/// The path in the repository that a link of a document leads to, and the heading there.
pub(super) fn resolved(source: &str, target: &str) -> (String, Option<String>) {
    let (path, heading) = match target.split_once('#') {
        Some((path, heading)) => (path, Some(heading.to_owned())),
        None => (target, None),
    };
    if path.is_empty() {
        return (source.to_owned(), heading);
    }
    let mut parts: Vec<&str> = source.split('/').collect();
    parts.pop();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()),
            name => parts.push(name),
        }
    }
    (parts.join("/"), heading)
}

/// The example whose folder, or whose request or text, this is.
pub(super) fn example_of(path: &str) -> Option<&str> {
    let name = path.strip_prefix("examples/gallery/")?;
    let name = name.strip_suffix("/request.json").or(name.strip_suffix("/README.md")).unwrap_or(name);
    (!name.is_empty() && !name.contains('/')).then_some(name)
}

impl Site {
    /// The address, from the page of `source`, of what a link of it leads to; `None` where it is not handed out.
    pub(super) fn address(&self, source: &str, target: &str) -> Option<String> {
        if is_outside(target) {
            return Some(target.to_owned());
        }
        let here = &self.pages[source];
        let (path, heading) = resolved(source, target);
        if let Some(page) = self.pages.get(&path).or_else(|| self.pages.get(&format!("{path}/index.md"))) {
            let heading = heading.map(|heading| format!("#{heading}")).unwrap_or_default();
            let is_here = page == here && !heading.is_empty();
            return Some(if is_here { heading } else { format!("{}{heading}", relative(here, page)) });
        }
        if let Some(name) = example_of(&path).filter(|name| self.examples.contains(*name)) {
            return Some(format!("{}?example={name}", to_root(here)));
        }
        match &*path {
            "openapi.yaml" => return Some(format!("{}openapi.json", to_root(here))),
            "examples/gallery" => return Some(relative(here, "gallery")),
            _ => {}
        }
        self.texts.contains(&path).then(|| relative(here, &format!("files/{path}")))
    }

    /// The address of a picture, if it is handed out.
    pub(super) fn picture(&self, source: &str, target: &str) -> Option<String> {
        let here = &self.pages[source];
        let (path, _) = resolved(source, target);
        let thumb = path.strip_prefix("examples/gallery/").and_then(|rest| rest.strip_suffix("/thumb.png"));
        if let Some(name) = thumb.filter(|name| self.examples.contains(*name)) {
            return Some(format!("{}assets/gallery/{name}.png", to_root(here)));
        }
        self.pictures.contains(&path).then(|| relative(here, &format!("files/{path}")))
    }
}

/// From a page, relative to `/docs/`, to the root of the service.
pub(super) fn to_root(here: &str) -> String {
    "../".repeat(1 + here.matches('/').count())
}

/// From a page to another, both relative to `/docs/`.
pub(super) fn relative(here: &str, there: &str) -> String {
    let up = "../".repeat(here.matches('/').count());
    let address = format!("{up}{there}");
    if address.is_empty() { "./".to_owned() } else { address }
}
