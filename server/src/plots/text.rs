//! Text in a chart: its width, cut to fit, and without characters that XML does not allow.
//!
//! A reader's machine chooses the font, so widths are those of Helvetica, which Arial and others share, with
//! a margin for fonts that are wider.

/// Fonts in the order of preference.
pub(super) const FAMILY: &str = "Helvetica, Arial, Liberation Sans, sans-serif";
/// Width of the widest of the common fonts (that of Verdana and its like) over that of Helvetica.
const WIDEST: f64 = 1.18;
/// The end of text that was cut.
const ELLIPSIS: char = '\u{2026}';

/// Width of a text over the size of its font, at most.
pub(super) fn width_em(text: &str) -> f64 {
    WIDEST * text.chars().map(char_em).sum::<f64>()
}

fn char_em(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | '\'' => 0.222,
        ' ' | '.' | ',' | ':' | ';' | '/' | '|' | '!' | 'I' | 'f' | 't' | '\u{A0}' | '\u{B7}' => 0.278,
        'r' | '(' | ')' | '[' | ']' | '-' | '"' | '`' | '{' | '}' => 0.333,
        '\u{B9}' | '\u{B2}' | '\u{B3}' | '\u{2070}'..='\u{207B}' => 0.36,
        'c' | 'k' | 's' | 'v' | 'x' | 'y' | 'z' | 'J' => 0.5,
        'w' | 'A' | 'B' | 'E' | 'K' | 'P' | 'S' | 'V' | 'X' | 'Y' | '&' => 0.7,
        'C' | 'D' | 'H' | 'N' | 'R' | 'U' => 0.722,
        'G' | 'O' | 'Q' => 0.778,
        'm' | 'M' => 0.833,
        'W' => 0.944,
        '%' => 0.889,
        '=' | '<' | '>' | '+' | '\u{2212}' | '~' => 0.584,
        '@' => 1.015,
        ELLIPSIS => 1.0,
        c if c.is_ascii() => 0.556,
        // Other alphabets are about as wide as this one, ideographs twice.
        '\u{1100}'.. => 1.05,
        _ => 0.6,
    }
}

/// The text, cut where it is wider than so many times the size of its font.
pub(super) fn cut(text: &str, most_em: f64) -> String {
    if width_em(text) <= most_em {
        return text.to_owned();
    }
    let mut kept = String::new();
    let mut width = WIDEST * char_em(ELLIPSIS);
    for c in text.chars() {
        width += WIDEST * char_em(c);
        if width > most_em {
            break;
        }
        kept.push(c);
    }
    kept.truncate(kept.trim_end().len());
    kept.push(ELLIPSIS);
    kept
}

/// The text on one line, with what XML 1.0 has no place for replaced.
pub(super) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            // Not of XML, and marks that would turn the direction of what follows.
            '\u{FFFE}' | '\u{FFFF}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}' => {
                char::REPLACEMENT_CHARACTER
            }
            c if c.is_control() || c == '\u{2028}' || c == '\u{2029}' => ' ',
            c => c,
        })
        .collect()
}

/// The text as content of an element.
pub(super) fn escaped(text: &str) -> String {
    printable(text).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_cut() {
        assert_eq!(cut("short", 10.0), "short");
        let long = "a rather long name of a job, longer than its line";
        let kept = cut(long, 10.0);
        assert!(kept.ends_with(ELLIPSIS) && width_em(&kept) <= 10.0, "{kept}");
        assert!(long.starts_with(kept.trim_end_matches(ELLIPSIS)), "{kept}");
    }

    #[test]
    fn nothing_that_xml_cannot_hold_is_left() {
        assert_eq!(escaped("<b>\u{1}\n\"A&B\"\u{FFFF}\u{202E}"), "&lt;b&gt;  \"A&amp;B\"\u{FFFD}\u{FFFD}");
    }
}
