//! Where the values of two reports differ.

use super::error::VerifyError;

/// Relative error of sums of volumes that are computed in another order, and of a scale that is computed again.
pub(super) const ROUNDING: f64 = 1.0e-9;

/// Whether a member of a report is what it must be, numbers within this share of it.
pub(super) fn equal<T: serde::Serialize>(
    name: &str,
    found: &T,
    expected: &T,
    tolerance: f64,
) -> Result<(), VerifyError> {
    let value = |member: &T| serde_json::to_value(member).map_err(|error| VerifyError::Read(error.into()));
    match difference(name, &value(found)?, &value(expected)?, tolerance) {
        None => Ok(()),
        Some(what) => VerifyError::wrong(format!("the report does not agree with the grains: {what}")),
    }
}

/// The first place where two values differ, numbers by more than this share of what they must be, and how.
fn difference(
    place: &str,
    found: &serde_json::Value,
    expected: &serde_json::Value,
    tolerance: f64,
) -> Option<String> {
    use serde_json::Value;
    match (found, expected) {
        (Value::Object(found), Value::Object(expected)) if found.len() == expected.len() => {
            expected.iter().find_map(|(name, expected)| {
                let found = found.get(name).unwrap_or(&Value::Null);
                difference(&format!("{place}/{name}"), found, expected, tolerance)
            })
        }
        (Value::Array(found), Value::Array(expected)) if found.len() == expected.len() => {
            let pairs = found.iter().zip(expected).enumerate();
            pairs.into_iter().find_map(|(i, (found, expected))| {
                difference(&format!("{place}/{i}"), found, expected, tolerance)
            })
        }
        (Value::Array(found), Value::Array(expected)) => {
            Some(format!("{place} has {} entries: must have {}", found.len(), expected.len()))
        }
        (found, expected) if found == expected => None,
        (Value::Number(found), Value::Number(expected)) if is_close(found, expected, tolerance) => None,
        (Value::Number(found), Value::Number(expected)) => {
            Some(format!("{place} is {found}: must be {expected}"))
        }
        _ => Some(format!("{place} is another than it must be")),
    }
}

/// Whether a number is the expected one but for this share of it.
fn is_close(found: &serde_json::Number, expected: &serde_json::Number, tolerance: f64) -> bool {
    match (found.as_f64(), expected.as_f64()) {
        (Some(found), Some(expected)) => (found - expected).abs() <= tolerance * expected.abs(),
        _ => false,
    }
}
