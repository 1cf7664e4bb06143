//! Grains as a table of text: a header with the names of the columns, then a row for each grain.
//!
//! The columns are those of the tables of a result, in any order, separated by commas, semicolons or tabs; beside the
//! latter two, commas are decimal signs. Columns that follow from others may be missing: `sieve_mm`, and `d_mm` of
//! ellipsoids.

use std::io;

use packstone_engine::export::tables::{Column, Table};
use packstone_engine::request::GrainKind;
use packstone_engine::shape::Ellipsoid;

/// Bytes of a text that a message repeats.
const SHOWN: usize = 40;

/// Reads a table. Its columns are in the order of a result; those that the file has are told as well.
///
/// # Errors
/// [`io::ErrorKind::InvalidData`] with the row, counted from 0 below the header, or the column.
pub(super) fn read(text: &str) -> io::Result<(Table, Vec<Column>)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.split(['\n', '\r']).filter(|line| !line.trim().is_empty());
    let header = lines
        .next()
        .ok_or_else(|| invalid("it is empty: a header with names of columns is missing".into()))?;
    let separator = [';', '\t'].into_iter().find(|&mark| header.contains(mark)).unwrap_or(',');
    let names: Vec<&str> = header.split(separator).map(|name| name.trim().trim_matches('"')).collect();
    let columns = columns_of(&names)?;
    // Where each column of the result stands in a row of the file.
    let places: Vec<Option<usize>> =
        columns.iter().map(|column| names.iter().position(|name| *name == column.name())).collect();
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    let mut fields: Vec<&str> = Vec::with_capacity(names.len());
    for (row, line) in lines.enumerate() {
        fields.clear();
        fields.extend(line.split(separator));
        if fields.len() != names.len() {
            let (found, wanted) = (fields.len(), names.len());
            return Err(invalid(format!("row {row} has {found} values: the header names {wanted}")));
        }
        for (place, values) in places.iter().zip(&mut values) {
            let Some(place) = *place else { continue };
            let field = fields[place].trim().trim_matches('"');
            // Where commas separate nothing, they may be decimal signs.
            let number = if separator == ',' { field.parse() } else { field.replacen(',', ".", 1).parse() };
            let Ok(value): Result<f64, _> = number else {
                let (shown, name) = (field.chars().take(SHOWN).collect::<String>(), names[place]);
                return Err(invalid(format!(
                    "row {row} has {shown:?} in the column {name}: must be a number"
                )));
            };
            values.push(value);
        }
    }
    fill(columns, &places, &mut values)?;
    let stated = columns.iter().zip(&places).filter(|(_, place)| place.is_some());
    let stated = stated.map(|(column, _)| *column).collect();
    Ok((Table::new(columns, values)?, stated))
}

/// The columns of the kind of grains that these names are those of.
fn columns_of(names: &[&str]) -> io::Result<&'static [Column]> {
    let has = |column: Column| names.contains(&column.name());
    if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        return Err(invalid(format!("the column {} stands there twice", twice.1)));
    }
    let kind = GrainKind::of(has(Column::A), has(Column::Template));
    let columns = Column::of(kind, has(Column::Aggregate));
    let listed = || columns.iter().map(|column| column.name()).collect::<Vec<_>>().join(",");
    let unknown = names.iter().find(|name| !columns.iter().any(|column| column.name() == **name));
    if let Some(name) = unknown {
        let shown: String = name.chars().take(SHOWN).collect();
        let (noun, columns) = (kind.noun(), listed());
        return Err(invalid(format!("the column {shown:?} is unknown: those of {noun} are {columns}")));
    }
    let may_miss = |column: Column| {
        column == Column::Sieve || (column == Column::Diameter && kind == GrainKind::Ellipsoids)
    };
    match columns.iter().find(|&&column| !has(column) && !may_miss(column)) {
        None => Ok(columns),
        Some(column) => {
            let (name, noun, columns) = (column.name(), kind.noun(), listed());
            Err(invalid(format!("the column {name} is missing: those of {noun} are {columns}")))
        }
    }
}

/// Fills columns that are missing and follow from others. The sieve size is of use to nobody who reads a table, and
/// stays 0 where it is missing.
fn fill(columns: &[Column], places: &[Option<usize>], values: &mut [Vec<f64>]) -> io::Result<()> {
    let at = |wanted: Column| columns.iter().position(|column| *column == wanted);
    let rows = values.iter().map(Vec::len).max().unwrap_or(0);
    for (i, place) in places.iter().enumerate() {
        if place.is_some() {
            continue;
        }
        values[i] = match (columns[i], at(Column::A), at(Column::B), at(Column::C)) {
            (Column::Diameter, Some(a), Some(b), Some(c)) => (0..rows)
                .map(|row| {
                    let axes = [values[a][row], values[b][row], values[c][row]];
                    let grain = Ellipsoid::new(axes).ok_or_else(|| {
                        invalid(format!("the semi-axes of grain {row} are not positive numbers"))
                    })?;
                    Ok(grain.equivalent_diameter_mm())
                })
                .collect::<io::Result<_>>()?,
            _ => vec![0.0; rows],
        };
    }
    Ok(())
}

fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::export::tables::GrainSource as _;

    use super::*;

    fn values(text: &str) -> Vec<Vec<f64>> {
        let (table, _) = read(text).unwrap();
        let column = |column: &Column| {
            let mut values = vec![0.0; table.len()];
            table.read(*column, 0, &mut values).unwrap();
            values
        };
        table.columns().iter().map(column).collect()
    }

    #[test]
    fn tables_are_read_in_any_order_and_with_any_separator() {
        let expected = vec![vec![1.0, 4.0], vec![2.0, 5.5], vec![3.0, 6.0], vec![0.5, 0.25]];
        for text in [
            "x_mm,y_mm,z_mm,d_mm\n1,2,3,0.5\n4,5.5,6,0.25\n",
            "\u{feff}d_mm;x_mm;z_mm;y_mm\r\n0.5;1;3;2\r\n0.25;4;6;5.5\r\n\r\n",
            "\"d_mm\"\t\"x_mm\"\tz_mm\ty_mm\n5e-1\t 1\t3\t2\n0.25\t4\t6\t5.5",
            "\"x_mm\",\"y_mm\",\"z_mm\",\"d_mm\"\n\"1\",\"2\",\"3\",\"0.5\"\n\"4\",\"5.5\",\"6\",\"0.25\"\n",
            "x_mm;y_mm;z_mm;d_mm\r1;2;3;0,5\r4;5,5;6;0,25\r",
        ] {
            assert_eq!(values(text), expected, "{text}");
        }
        let ellipsoid = values("x_mm,y_mm,z_mm,qw,qx,qy,qz,a_mm,b_mm,c_mm\n1,2,3,1,0,0,0,4,2,1\n");
        assert_eq!((ellipsoid[3][0], ellipsoid[4][0]), (4.0, 0.0));
    }

    #[test]
    fn faults_name_the_row_and_the_column() {
        for (text, expected) in [
            ("", "it is empty"),
            ("x_mm,y_mm,z_mm\n1,2,3\n", "the column d_mm is missing"),
            ("x_mm,y_mm,z_mm,d_mm,colour\n1,2,3,4,5\n", "the column \"colour\" is unknown"),
            ("x_mm,y_mm,z_mm,d_mm,x_mm\n1,2,3,4,5\n", "the column x_mm stands there twice"),
            ("x_mm,y_mm,z_mm,d_mm\n1,2,3,4\n1,2,3\n", "row 1 has 3 values: the header names 4"),
            ("x_mm,y_mm,z_mm,d_mm\n1,2,3,four\n", "row 0 has \"four\" in the column d_mm"),
            ("x_mm,y_mm,z_mm,d_mm\n1,2,3,\n", "row 0 has \"\" in the column d_mm"),
            ("x_mm,y_mm,z_mm,d_mm,aggregate\n1,2,3,4,gravel\n", "\"gravel\" in the column aggregate"),
            ("x_mm,y_mm,z_mm,qw,qx,qy,qz,a_mm,b_mm,c_mm\n1,2,3,1,0,0,0,4,2,0\n", "semi-axes of grain 0"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
    }
}
