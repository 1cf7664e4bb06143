//! Lists of words as one text each, with bars between: `sand|kies|gravel`.

use super::super::words;

/// Whether a folded text has one of the words, by the rules of [`words::position`].
pub(super) fn has(folded: &str, list: &str) -> bool {
    let begins = beginnings(folded);
    list.split('|').any(|word| {
        let first = word.bytes().next().map_or(0, bit);
        begins & first != 0 && words::position(folded, word).is_some()
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
