//! Words of heads and rows, compared without case, accents and punctuation, so that one list serves six languages. A
//! list is one text with bars between its words: `sand|kies|gravel`.

/// A text in lower case without accents; `ß` is `ss`, and what is neither letter, digit nor one of `%#<>/.,+-` is a
/// space.
pub(super) fn fold(text: &str) -> String {
    let mut folded = String::with_capacity(text.len());
    for character in text.chars().flat_map(char::to_lowercase) {
        match character {
            'à' | 'á' | 'â' | 'ã' | 'ä' | 'å' => folded.push('a'),
            'è' | 'é' | 'ê' | 'ë' => folded.push('e'),
            'ì' | 'í' | 'î' | 'ï' => folded.push('i'),
            'ò' | 'ó' | 'ô' | 'õ' | 'ö' | 'ø' | 'º' | '°' => folded.push('o'),
            'ù' | 'ú' | 'û' | 'ü' => folded.push('u'),
            'ç' => folded.push('c'),
            'ñ' => folded.push('n'),
            'ß' => folded.push_str("ss"),
            'µ' | 'μ' => folded.push('µ'),
            'φ' | 'ϕ' => folded.push_str("phi"),
            'σ' | '∑' => folded.push_str(" sum "),
            '³' => folded.push('3'),
            '²' => folded.push('2'),
            '–' | '—' | '−' | '‐' | '‑' => folded.push('-'),
            '≤' => folded.push('<'),
            '≥' => folded.push('>'),
            c if c.is_alphanumeric() || "%#<>/.,+-\"".contains(c) => folded.push(c),
            // A combining mark belongs to the letter before it.
            '\u{300}'..='\u{36f}' => {}
            _ => folded.push(' '),
        }
    }
    folded
}

/// Whether a folded text has one of the words, by the rules of [`position`].
pub(super) fn has(folded: &str, list: &str) -> bool {
    let begins = beginnings(folded);
    list.split('|').any(|word| {
        let first = word.bytes().next().map_or(0, bit);
        begins & first != 0 && position(folded, word).is_some()
    })
}

/// The characters at which words begin, a bit each, so that most words of a list need not be looked for.
fn beginnings(folded: &str) -> u64 {
    let mut begins = 0;
    let mut is_inside = false;
    for character in folded.chars() {
        if !is_inside {
            begins |= u8::try_from(u32::from(character)).map_or(u64::MAX, bit);
        }
        is_inside = character.is_alphanumeric();
    }
    begins
}

fn bit(byte: u8) -> u64 {
    if byte.is_ascii() { 1 << (byte & 63) } else { u64::MAX }
}

/// Whether a word of the folded text ends as one of these, as compounds do.
pub(super) fn ends(folded: &str, list: &str) -> bool {
    folded
        .split(|c: char| !c.is_alphanumeric())
        .any(|word| list.split('|').any(|ending| word.ends_with(ending)))
}

/// Where a folded text has a word: at the beginning of one of its words. A word of at most three letters must be a
/// whole one.
pub(super) fn position(folded: &str, word: &str) -> Option<usize> {
    let is_letter = |c: Option<char>| c.is_some_and(char::is_alphanumeric);
    folded.match_indices(word).map(|(at, _)| at).find(|&at| {
        let starts = !is_letter(folded[..at].chars().next_back());
        let ends = word.chars().count() > 3 || !is_letter(folded[at + word.len()..].chars().next());
        starts && ends
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn case_accents_and_signs_do_not_count() {
        assert_eq!(fold("Größe (MM)"), "grosse  mm ");
        assert_eq!(fold("Refus cumulé"), "refus cumule");
        assert_eq!(fold("90 – 100 ≤"), "90 - 100 <");
        assert!(has(&fold("Siebdurchgang [M.-%]"), "durchgang|siebdurchgang"));
        assert!(!has(&fold("Spanner"), "pan"), "a short word must stand alone");
        assert!(has(&fold("Pan"), "schale|pan"));
        assert!(has(&fold("% Passing"), "pass"), "the beginning of a word");
    }
}
