//! Removes comments and indentation from scripts and style sheets before they are compiled in.
//!
//! Works on lines and marks, not on a grammar. Comments of a script are what stands between `/**` and `*/`, and lines
//! that are a comment (`//`), in shaders within template literals too; those of a style sheet stand between `/*` and
//! `*/`. A `//` after code stays, and so does `/*` in a script, which strings contain (`*/*`). Spaces before a line and
//! empty lines go, but not where an odd number of backticks is before: those of a template literal have a meaning.
//! `tests/web` compares the syntax trees of all scripts before and after.

/// The text of a file of that name without its comments and its indentation.
pub(crate) fn shortened(name: &str, text: &str) -> String {
    match name.rsplit('.').next() {
        Some("js") => {
            let code = without_blocks(text, "/**");
            let is_code = |line: &&str| !line.trim_start().starts_with("//");
            without_indentation(code.split_inclusive('\n').filter(is_code))
        }
        Some("css") => without_indentation(without_blocks(text, "/*").split_inclusive('\n')),
        _ => text.to_owned(),
    }
}

/// The lines without the white space before them, and without those of white space alone, except in template literals.
fn without_indentation<'a>(lines: impl Iterator<Item = &'a str>) -> String {
    let mut is_template = false;
    let mut kept = String::new();
    for line in lines {
        kept.push_str(if is_template { line } else { line.trim_start() });
        is_template ^= line.matches('`').count() % 2 == 1;
    }
    kept
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
