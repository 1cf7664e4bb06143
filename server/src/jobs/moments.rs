//! Moments as RFC 3339 texts and as microseconds since the Unix epoch, up to the end of the year 9999.
//!
//! A [`Timestamp`] ends at 9999-12-30T22:00:00Z, because it must have a local time in every time zone. The day after it
//! is read and written as a civil time.

use jiff::civil::{DateTime, date};
use jiff::fmt::temporal::Pieces;
use jiff::{SignedDuration, Timestamp};

/// Reads a time; `None` where the text is none, or names a moment beyond the year 9999.
pub(crate) fn read(text: &str) -> Option<i64> {
    // Jiff reads a space for the T too; RFC 3339 as OpenAPI's date-time means it does not.
    if text.as_bytes().get(10) != Some(&b'T') {
        return None;
    }
    if let Ok(time) = text.parse::<Timestamp>() {
        return Some(time.as_microsecond());
    }
    let pieces = Pieces::parse(text).ok()?;
    let local = pieces.date().to_datetime(pieces.time()?);
    let offset = SignedDuration::from_secs(i64::from(pieces.to_numeric_offset()?.seconds()));
    let utc = local.checked_sub(offset).ok()?;
    i64::try_from(utc.duration_since(epoch()).as_micros()).ok()
}

/// The text of a moment in UTC.
pub(crate) fn text(us: i64) -> String {
    if let Ok(time) = Timestamp::from_microsecond(us) {
        return time.to_string();
    }
    let utc = epoch().saturating_add(SignedDuration::from_micros(us));
    format!("{utc}Z")
}

fn epoch() -> DateTime {
    date(1970, 1, 1).at(0, 0, 0, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_moment_up_to_the_end_of_the_year_9999_reads_back() {
        for (given, expected) in [
            ("2030-01-31T12:00:00Z", "2030-01-31T12:00:00Z"),
            ("2030-01-31T12:00:00.25+02:00", "2030-01-31T10:00:00.25Z"),
            ("9999-12-30T21:59:59Z", "9999-12-30T21:59:59Z"),
            ("9999-12-31T00:00:00Z", "9999-12-31T00:00:00Z"),
            ("9999-12-31T23:59:59Z", "9999-12-31T23:59:59Z"),
            ("9999-12-31T23:59:59.999999Z", "9999-12-31T23:59:59.999999Z"),
            ("9999-12-31T23:59:59+14:00", "9999-12-31T09:59:59Z"),
        ] {
            let us = read(given);
            assert_eq!(us.map(text).as_deref(), Some(expected), "{given}");
            assert_eq!(read(expected), us);
        }
        for bad in [
            "",
            "tomorrow",
            "2030-01-31",
            "2030-01-31 12:00:00Z",
            "2030-01-31T12:00:00",
            "10000-01-01T00:00:00Z",
            "9999-12-31T23:59:59-01:00",
            "9999-12-31T24:00:00Z",
            "9999-12-31T23:59:59",
            "9999-12-32T00:00:00Z",
        ] {
            assert_eq!(read(bad), None, "{bad}");
        }
    }
}
