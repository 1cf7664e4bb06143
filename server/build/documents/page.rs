//! What a page consists of.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use pulldown_cmark::{CowStr, Event, Tag, TagEnd, html};

use super::Site;
use super::links::{parser, relative, to_root};
use super::navigation::Entry;

/// In place of a frame.
const FRAME: &str = "<p class=\"left-out\">The viewer stands in the site of these documents, and on the page of each job \
                     of this service.</p>\n";

/// The header that all pages share, as the form has it.
pub(super) fn header(form: &str) -> String {
    let rest = form.split_once("<header").map_or("", |(_, rest)| rest);
    let header = rest.split_once("</header>").map_or("", |(header, _)| header);
    format!("<header{header}</header>")
}

/// A page; `root` leads to the root of the service.
fn html(root: &str, title: &str, header: &str, main: &str) -> String {
    let header = header
        .replace("href=\"./\"", &format!("href=\"{root}\""))
        .replace("href=\"", &format!("href=\"{root}"))
        .replace("src=\"", &format!("src=\"{root}"))
        .replace(&format!("{root}{root}"), root);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title} - Packstone</title>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <link rel=\"icon\" href=\"{root}assets/icon.svg\" type=\"image/svg+xml\">\n\
         <link rel=\"stylesheet\" href=\"{root}assets/app.css\">\n\
         <link rel=\"stylesheet\" href=\"{root}assets/docs.css\">\n</head>\n<body>\n\
         <a class=\"skip\" href=\"#main\">Skip to content</a>\n{header}\n{main}\n\
         <footer class=\"foot\">Packstone {}</footer>\n</body>\n</html>\n",
        env!("CARGO_PKG_VERSION")
    )
}

/// The page of a document.
pub(super) fn document(site: &Site, source: &str, text: &str, header: &str, navigation: &[Entry]) -> String {
    let here = &site.pages[source];
    let (title, body) = rendered(site, source, text);
    let header = header.replace("href=\"docs/\"", "href=\"docs/\" aria-current=\"page\"");
    let main = format!(
        "<div class=\"documents\">\n<main id=\"main\" tabindex=\"-1\" class=\"document\">\n\
         <p class=\"to-contents\"><a href=\"#contents\">All documents</a></p>\n{body}</main>\n\
         <nav id=\"contents\" class=\"contents\" aria-label=\"Documents\">\n{}</nav>\n</div>",
        listed(navigation, here)
    );
    html(&to_root(here), &title, &header, &main)
}

/// The page for addresses that do not exist. `{root}` stands for what leads to the root of the service.
pub(super) fn not_found(header: &str) -> String {
    let main = "<main id=\"main\" tabindex=\"-1\" class=\"document\">\n<h1>There is no such page</h1>\n\
                <p>The address leads nowhere on this server. It may have a typing error, or what was there was \
                removed: jobs and studies expire.</p>\n<ul>\n\
                <li><a href=\"{root}\">Describe a new packing</a></li>\n\
                <li><a href=\"{root}jobs\">Look for a job</a> or <a href=\"{root}studies\">for a study</a></li>\n\
                <li><a href=\"{root}docs/\">Read the documents</a></li>\n</ul>\n</main>";
    html("{root}", "No such page", header, main)
}

/// The list of documents as HTML, with the page `here` marked.
fn listed(navigation: &[Entry], here: &str) -> String {
    let mut out = String::new();
    let mut open = 0;
    for entry in navigation {
        while open > entry.depth + 1 {
            out.push_str("</ul>\n</li>\n");
            open -= 1;
        }
        if open == 0 {
            out.push_str("<ul>\n");
            open = 1;
        }
        if let Some(page) = &entry.page {
            let current = if page == here { " aria-current=\"page\"" } else { "" };
            let address = relative(here, page);
            let _ = writeln!(out, "<li><a href=\"{address}\"{current}>{}</a></li>", escaped(&entry.title));
        } else {
            let _ = writeln!(out, "<li><span>{}</span>\n<ul>", escaped(&entry.title));
            open += 1;
        }
    }
    while open > 1 {
        out.push_str("</ul>\n</li>\n");
        open -= 1;
    }
    out.push_str("</ul>\n");
    out
}

/// The title of a document, and its text as HTML.
fn rendered(site: &Site, source: &str, text: &str) -> (String, String) {
    let events: Vec<Event<'_>> = parser(text).collect();
    let mut title = String::new();
    let mut ids = BTreeMap::new();
    let mut made = Vec::with_capacity(events.len());
    // Whether the link that is open is handed out, and whether a picture is being replaced by its words.
    let (mut is_linked, mut is_left_out) = (true, false);
    for (number, event) in events.iter().enumerate() {
        let event = match event {
            Event::Start(Tag::Heading { level, classes, attrs, .. }) => {
                let words = words_of(&events[number + 1..]);
                if title.is_empty() {
                    title.clone_from(&words);
                }
                let id = Some(id_of(&words, &mut ids).into());
                Event::Start(Tag::Heading {
                    level: *level,
                    id,
                    classes: classes.clone(),
                    attrs: attrs.clone(),
                })
            }
            Event::Start(Tag::Link { link_type, dest_url, title, id }) => {
                let address = site.address(source, dest_url);
                is_linked = address.is_some();
                let Some(address) = address else { continue };
                let dest_url = CowStr::from(address);
                Event::Start(Tag::Link {
                    link_type: *link_type,
                    dest_url,
                    title: title.clone(),
                    id: id.clone(),
                })
            }
            Event::End(TagEnd::Link) if !std::mem::replace(&mut is_linked, true) => continue,
            Event::Start(Tag::Image { link_type, dest_url, title, id }) => {
                let address = site.picture(source, dest_url);
                is_left_out = address.is_none();
                let Some(address) = address else {
                    made.push(Event::InlineHtml("<span class=\"left-out\">Picture: ".into()));
                    continue;
                };
                let dest_url = CowStr::from(address);
                Event::Start(Tag::Image {
                    link_type: *link_type,
                    dest_url,
                    title: title.clone(),
                    id: id.clone(),
                })
            }
            Event::End(TagEnd::Image) if std::mem::take(&mut is_left_out) => {
                Event::InlineHtml("</span>".into())
            }
            Event::Html(text) if text.starts_with("<iframe") => Event::Html(FRAME.into()),
            // Other frames and comments of the site.
            Event::Html(_) | Event::InlineHtml(_) => continue,
            other => other.clone(),
        };
        made.push(event);
    }
    let mut body = String::with_capacity(2 * text.len());
    html::push_html(&mut body, made.into_iter());
    // Nothing inline, what scrolls can be scrolled by keyboard.
    let body = body
        .replace(" style=\"text-align: right\"", " class=\"number\"")
        .replace(" style=\"text-align: left\"", "")
        .replace(" style=\"text-align: center\"", "")
        .replace("<th></th>", "<td></td>")
        .replace("<pre>", "<pre tabindex=\"0\">")
        .replace("<table>", "<div class=\"table\" tabindex=\"0\" role=\"group\" aria-label=\"Table\"><table>")
        .replace("</table>", "</table></div>");
    (escaped(&title), body)
}

/// The words up to the end of a heading.
fn words_of(events: &[Event<'_>]) -> String {
    let mut words = String::new();
    for event in events {
        match event {
            Event::Text(text) | Event::Code(text) => words.push_str(text),
            Event::SoftBreak => words.push(' '),
            Event::End(TagEnd::Heading(_)) => break,
            _ => {}
        }
    }
    words
}

/// The id of a heading as the site has it, so that links between pages lead there; `known` counts those of the page.
fn id_of(words: &str, known: &mut BTreeMap<String, u32>) -> String {
    let mut id = String::new();
    for c in words.chars().flat_map(char::to_lowercase) {
        match c {
            'a'..='z' | '0'..='9' | '_' => id.push(c),
            ' ' | '-' if !id.ends_with('-') => id.push('-'),
            _ => {}
        }
    }
    let id = id.trim_matches('-').to_owned();
    let number = known.entry(id.clone()).or_default();
    *number += 1;
    if *number == 1 { id } else { format!("{id}_{}", *number - 1) }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// An example of the gallery as JSON: its name, title, topic and request, and what it shows, which is the first
/// paragraph of its text.
pub(super) fn example(name: &str, text: &str, request: &str) -> String {
    let title = text.lines().next().unwrap_or_default().trim_start_matches("# ");
    let paragraph = text.split("\n\n").nth(1).unwrap_or_default().replace('\n', " ");
    let about: String = parser(&paragraph).filter_map(words).collect();
    let topic = text.rsplit_once("Topic: ").map_or("", |(_, rest)| rest.trim().trim_end_matches('.'));
    format!(
        "{{\"name\":{name:?},\"title\":{title:?},\"topic\":{topic:?},\"about\":{about:?},\"request\":{request}}}"
    )
}

fn words(event: Event<'_>) -> Option<String> {
    match event {
        Event::Text(text) | Event::Code(text) => Some(text.into_string()),
        Event::SoftBreak => Some(" ".to_owned()),
        _ => None,
    }
}
