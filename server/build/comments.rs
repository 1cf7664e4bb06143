//! Removes comments from scripts and style sheets before they are compiled in.
//!
//! Works on lines and marks, not on a grammar: in a script it removes what stands between `/**` and `*/`, and lines
//! that are a comment (`//`), in shaders within template literals too; in a style sheet what stands between `/*` and
//! `*/`. A `//` after code stays, and so does `/*` in a script, which strings contain (`*/*`). Empty lines stay: those
//! of a template literal have a meaning. `tests/web` compares the syntax trees of all scripts before and after.

/// The text of a file of that name without its comments.
pub(crate) fn without_comments(name: &str, text: &str) -> String {
    match name.rsplit('.').next() {
        Some("js") => {
            let code = without_blocks(text, "/**");
            code.split_inclusive('\n').filter(|line| !line.trim_start().starts_with("//")).collect()
        }
        Some("css") => without_blocks(text, "/*"),
        _ => text.to_owned(),
    }
}

/// The text without what stands between `open` and `*/`: with its lines where nothing else is on them, else with the
/// space after it.
fn without_blocks(mut text: &str, open: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    while let Some((before, block)) = text.split_once(open) {
        kept.push_str(before);
        let after = block.split_once("*/").map_or("", |(_, after)| after);
        let line = kept.rfind('\n').map_or(0, |end| end + 1);
        let (rest_of_line, next) = after.split_once('\n').unwrap_or((after, ""));
        if kept[line..].trim().is_empty() && rest_of_line.trim().is_empty() {
            kept.truncate(line);
            text = next;
        } else {
            text = after.strip_prefix(' ').unwrap_or(after);
        }
    }
    kept.push_str(text);
    kept
}
