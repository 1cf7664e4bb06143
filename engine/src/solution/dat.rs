//! The printed results of CalculiX, `model.dat`: blocks of a line that names the quantity, its set and the time, and
//! lines of a node and three numbers of seven digits.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SolutionError;

/// What was printed of the nodes of a set, at the last time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Printed {
    /// Displacements in mm by the number of the node.
    pub(super) displacements_mm: BTreeMap<u32, Vector3<f64>>,
    /// Forces on the nodes from outside in N: reactions.
    pub(super) forces_n: BTreeMap<u32, Vector3<f64>>,
    /// The time of the last block.
    pub(super) time: f64,
}

impl Printed {
    /// Reads the blocks of a set. Where a step has several increments, those of the last one stay.
    ///
    /// # Errors
    /// [`SolutionError::Unreadable`] with the line, and [`SolutionError::Missing`] where a quantity is not there.
    pub(super) fn read(text: &str, set: &str) -> Result<Self, SolutionError> {
        let mut printed = Self::default();
        let mut lines = (1..).zip(text.lines()).peekable();
        while let Some((at, line)) = lines.next() {
            let Some((quantity, of_set, time)) = heading(line) else { continue };
            if !of_set.eq_ignore_ascii_case(set) || quantity.starts_with("total") {
                continue;
            }
            let time = number(time).ok_or_else(|| unreadable(at, line))?;
            let values = match quantity {
                "displacements" => &mut printed.displacements_mm,
                "forces" => &mut printed.forces_n,
                _ => continue,
            };
            values.clear();
            printed.time = time;
            lines.next_if(|(_, line)| line.trim().is_empty());
            while let Some((at, line)) = lines.next_if(|(_, line)| !line.trim().is_empty()) {
                let (node, value) = row(line).ok_or_else(|| unreadable(at, line))?;
                values.insert(node, value);
            }
        }
        for (what, values) in [("displacements", &printed.displacements_mm), ("forces", &printed.forces_n)] {
            if values.is_empty() {
                return Err(SolutionError::Missing(format!(
                    "model.dat has no {what} of the set {set}: CalculiX ended before its end, or the deck prints none"
                )));
            }
        }
        Ok(printed)
    }
}

/// Quantity, set and time of a line such as ` forces (fx,fy,fz) for set FACES and time  0.1000000E+01`.
fn heading(line: &str) -> Option<(&str, &str, &str)> {
    let (quantity, rest) = line.split_once('(')?;
    let (_, rest) = rest.split_once(") for set ")?;
    let (set, time) = rest.split_once(" and time ")?;
    Some((quantity.trim(), set.trim(), time.trim()))
}

fn row(line: &str) -> Option<(u32, Vector3<f64>)> {
    let mut fields = line.split_whitespace();
    let node = fields.next()?.parse().ok()?;
    let value = Vector3::new(number(fields.next()?)?, number(fields.next()?)?, number(fields.next()?)?);
    fields.next().is_none().then_some((node, value))
}

/// A number as Fortran prints it: one of three digits in the exponent has no letter, as `0.1-100`.
pub(super) fn number(text: &str) -> Option<f64> {
    let value = text.parse().ok().or_else(|| {
        let at = text.rfind(['+', '-']).filter(|at| *at > 0)?;
        format!("{}e{}", &text[..at], &text[at..]).parse().ok()
    });
    value.filter(|value: &f64| value.is_finite())
}

fn unreadable(at: usize, line: &str) -> SolutionError {
    SolutionError::Unreadable { file: "model.dat", line: at, text: line.trim().chars().take(80).collect() }
}
