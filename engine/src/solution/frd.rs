//! The results of CalculiX at nodes, `model.frd`, in its text form: blocks of a quantity with its components, and lines
//! of a node with numbers of twelve characters, six a line (Dhondt, *CalculiX CrunchiX user's manual*; Wittig,
//! *CalculiX GraphiX manual*, appendix "Result file format").

use super::SolutionError;
use super::dat::number;

/// Characters of a number.
const NUMBER: usize = 12;
/// Where the number of the node ends, and the first number begins.
const NODE: std::ops::Range<usize> = 3..13;

/// A quantity at the nodes, at the last time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    /// Its name in the file, such as `DISP`.
    pub(super) name: String,
    /// Numbers of a node.
    pub(super) components: usize,
    /// Numbers of the nodes, counted from 1, with their values.
    pub(super) rows: Vec<(u32, Vec<f64>)>,
}

/// Reads the quantities of the last step.
///
/// # Errors
/// [`SolutionError::Unreadable`] with the line.
pub(super) fn read(text: &str) -> Result<Vec<Field>, SolutionError> {
    let mut fields: Vec<Field> = Vec::new();
    let mut current: Option<Field> = None;
    for (at, line) in (1..).zip(text.lines()) {
        let unreadable = || SolutionError::Unreadable {
            file: "model.frd",
            line: at,
            text: line.trim().chars().take(80).collect(),
        };
        let (key, rest) = (line.get(..3).unwrap_or_default(), line.get(3..).unwrap_or_default());
        match (key, &mut current) {
            (" -4", _) => {
                let name = rest.split_whitespace().next().ok_or_else(unreadable)?.to_owned();
                current = Some(Field { name, components: 0, rows: Vec::new() });
            }
            // A component that the reader is to compute has a 1 behind its indices.
            (" -5", Some(field)) if rest.split_whitespace().nth(5).is_none_or(|exists| exists == "0") => {
                field.components += 1;
            }
            (" -1", Some(field)) => {
                let node = line.get(NODE).and_then(|node| node.trim().parse().ok()).ok_or_else(unreadable)?;
                let values = numbers(line).ok_or_else(unreadable)?;
                field.rows.push((node, values));
            }
            // More numbers of the same node.
            (" -2", Some(field)) => {
                let values = numbers(line).ok_or_else(unreadable)?;
                field.rows.last_mut().ok_or_else(unreadable)?.1.extend(values);
            }
            (" -3", Some(_)) => {
                if let Some(field) = current.take() {
                    if field.rows.iter().any(|(_, values)| values.len() != field.components) {
                        return Err(unreadable());
                    }
                    fields.retain(|earlier| earlier.name != field.name);
                    fields.push(field);
                }
            }
            _ => {}
        }
    }
    if current.is_some() {
        return Err(SolutionError::Missing(
            "model.frd ends within a block: CalculiX ended before its end".into(),
        ));
    }
    Ok(fields)
}

fn numbers(line: &str) -> Option<Vec<f64>> {
    let text = line.get(NODE.end..)?.trim_end();
    text.as_bytes().chunks(NUMBER).map(|digits| number(std::str::from_utf8(digits).ok()?.trim())).collect()
}
