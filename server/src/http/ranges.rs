//! `Range` of one part in bytes (RFC 9110, section 14).

use std::ops::Range;

/// What a `Range` field asks of a representation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Asked {
    /// All of it: no range, one that is malformed, another unit, or several parts, which a server
    /// may answer whole.
    Whole,
    /// A part that exists, at least in part.
    Part(Range<u64>),
    /// A part that begins at or beyond the end.
    Beyond,
}

impl Asked {
    /// Reads the field against the length of the representation.
    pub(crate) fn of(field: Option<&str>, length: u64) -> Self {
        let Some((first, last)) = field.and_then(parse) else { return Self::Whole };
        match (first, last) {
            (Some(first), Some(last)) if last < first => Self::Whole,
            (Some(first), _) if first >= length => Self::Beyond,
            (Some(first), last) => {
                let end = last.map_or(length, |last| last.saturating_add(1).min(length));
                Self::Part(first..end)
            }
            (None, Some(0)) => Self::Beyond,
            (None, Some(_)) if length == 0 => Self::Beyond,
            (None, Some(suffix)) => Self::Part(length.saturating_sub(suffix)..length),
            (None, None) => Self::Whole,
        }
    }
}

fn parse(field: &str) -> Option<(Option<u64>, Option<u64>)> {
    let (unit, part) = field.split_once('=')?;
    let (first, last) = part.trim().split_once('-')?;
    let number = |text: &str| -> Option<Option<u64>> {
        match text {
            "" => Some(None),
            digits if digits.bytes().all(|b| b.is_ascii_digit()) => {
                // More digits than fit mean a place beyond any end.
                Some(Some(digits.parse().unwrap_or(u64::MAX)))
            }
            _ => None,
        }
    };
    unit.trim().eq_ignore_ascii_case("bytes").then_some(())?;
    Some((number(first)?, number(last)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_the_standard_says() {
        for (field, asked) in [
            ("bytes=0-0", Asked::Part(0..1)),
            ("bytes=2-5", Asked::Part(2..6)),
            ("bytes=2-", Asked::Part(2..10)),
            ("bytes=2-99", Asked::Part(2..10)),
            ("bytes=-3", Asked::Part(7..10)),
            ("bytes=-99", Asked::Part(0..10)),
            ("BYTES=9-9", Asked::Part(9..10)),
            ("bytes=10-", Asked::Beyond),
            ("bytes=99999999999999999999999-", Asked::Beyond),
            ("bytes=-0", Asked::Beyond),
            ("bytes=5-2", Asked::Whole),
            ("bytes=0-1,3-4", Asked::Whole),
            ("bytes=a-b", Asked::Whole),
            ("bytes=-", Asked::Whole),
            ("bytes=+1-2", Asked::Whole),
            ("lines=1-2", Asked::Whole),
            ("nonsense", Asked::Whole),
        ] {
            assert_eq!(Asked::of(Some(field), 10), asked, "{field}");
        }
        assert_eq!(Asked::of(None, 10), Asked::Whole);
        assert_eq!(Asked::of(Some("bytes=0-"), 0), Asked::Beyond);
    }
}
