//! Reads every form of a result back, by parsers written from the formats' own descriptions.
//!
//! Shares nothing with the writers: a mistake made twice would cancel out.

use std::fs;
use std::path::Path;

use serde_json::Value;

/// A file of JSON.
pub(crate) fn json_in(file: &Path) -> Value {
    let text = fs::read(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()))
}

/// `x, y, z, d` of every sphere, in the order of the result.
pub(crate) type Rows = Vec<[f64; 4]>;

/// From `format=json`.
pub(crate) fn from_json(result: &Value) -> Rows {
    let spheres = &result["grains"];
    assert_eq!(spheres["columns"], serde_json::json!(["x_mm", "y_mm", "z_mm", "d_mm"]));
    let rows = spheres["rows"].as_array().expect("rows");
    rows.iter()
        .map(|row| {
            let row: Vec<f64> = row.as_array().expect("a row").iter().map(|x| x.as_f64().unwrap()).collect();
            row.try_into().expect("four columns")
        })
        .collect()
}

/// From `format=csv`.
pub(crate) fn from_csv(bytes: &[u8]) -> Rows {
    let text = std::str::from_utf8(bytes).expect("CSV is text");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x_mm,y_mm,z_mm,d_mm"));
    lines
        .map(|line| {
            let row: Vec<f64> = line.split(',').map(|x| x.parse().expect("a number")).collect();
            row.try_into().expect("four columns")
        })
        .collect()
}

/// From `format=npy`: version 1.0 or 2.0, little-endian float64 in either order.
pub(crate) fn from_npy(bytes: &[u8]) -> Rows {
    let rest = bytes.strip_prefix(b"\x93NUMPY").expect("the magic of NPY");
    let (length_bytes, start) = match rest[0] {
        1 => (2, 4),
        2 => (4, 6),
        version => panic!("NPY version {version}"),
    };
    let length = rest[2..2 + length_bytes].iter().rev().fold(0, |n, byte| n << 8 | usize::from(*byte));
    let header = std::str::from_utf8(&rest[start..start + length]).expect("an ASCII header");
    assert_eq!((bytes.len() - rest.len() + start + length) % 64, 0, "NPY data is aligned to 64 bytes");
    assert!(header.contains("'descr': '<f8'"), "{header}");
    let shape = header.split("'shape': (").nth(1).and_then(|rest| rest.split(')').next()).expect("a shape");
    let (n, columns) = shape.split_once(',').expect("two dimensions");
    assert_eq!(columns.trim().trim_end_matches(','), "4");
    let n: usize = n.trim().parse().unwrap();
    let values = doubles(&rest[start + length..], f64::from_le_bytes);
    assert_eq!(values.len(), 4 * n);
    if header.contains("'fortran_order': True") {
        (0..n).map(|i| [0, 1, 2, 3].map(|column| values[column * n + i])).collect()
    } else {
        assert!(header.contains("'fortran_order': False"), "{header}");
        values.chunks_exact(4).map(|row| row.try_into().unwrap()).collect()
    }
}

/// From `format=vtp`: points and `diameter` in the raw appended data.
pub(crate) fn from_vtp(bytes: &[u8]) -> Rows {
    const MARK: &[u8] = b"<AppendedData encoding=\"raw\">";
    let mark = bytes.windows(MARK.len()).position(|window| window == MARK).expect("appended data");
    let header = std::str::from_utf8(&bytes[..mark]).expect("XML before the data");
    assert!(header.contains("byte_order=\"LittleEndian\"") && header.contains("header_type=\"UInt64\""));
    let underscore = mark + MARK.len() + bytes[mark + MARK.len()..].iter().position(|b| *b == b'_').unwrap();
    let array = |name: &str| {
        let tag = header
            .split("<DataArray")
            .map(|rest| rest.split('>').next().unwrap_or_default())
            .find(|tag| tag.contains(&format!("Name=\"{name}\"")))
            .unwrap_or_else(|| panic!("no array {name} in {header}"));
        assert!(tag.contains("type=\"Float64\""), "{tag}");
        let offset =
            tag.split("offset=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("an offset");
        let at = underscore + 1 + offset.parse::<usize>().unwrap();
        let length = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        doubles(&bytes[at + 8..at + 8 + length], f64::from_le_bytes)
    };
    joined(&array("Points"), &array("diameter"))
}

/// From `format=vtk`: the legacy form, binary and so big-endian.
pub(crate) fn from_vtk(bytes: &[u8]) -> Rows {
    assert!(bytes.starts_with(b"# vtk DataFile Version "));
    let after = |words: &[&str]| {
        let words = words.join(" ");
        let at = bytes.windows(words.len()).position(|window| window == words.as_bytes());
        let at = at.unwrap_or_else(|| panic!("no {words:?}")) + words.len();
        // The rest of the line, and the lookup table of a SCALARS section, stand before the data.
        let line_end = |from: usize| from + bytes[from..].iter().position(|b| *b == b'\n').unwrap() + 1;
        let end = line_end(at);
        let start = if bytes[end..].starts_with(b"LOOKUP_TABLE") { line_end(end) } else { end };
        (std::str::from_utf8(&bytes[at..end]).unwrap().trim().to_owned(), start)
    };
    let (described, points_at) = after(&["POINTS"]);
    let n: usize = described.strip_suffix(" double").expect("double points").parse().unwrap();
    let points = doubles(&bytes[points_at..points_at + 24 * n], f64::from_be_bytes);
    let (described, at) = after(&["\nSCALARS", "diameter"]);
    assert_eq!(described, "double 1");
    let diameters = doubles(&bytes[at..at + 8 * n], f64::from_be_bytes);
    joined(&points, &diameters)
}

fn doubles(bytes: &[u8], read: fn([u8; 8]) -> f64) -> Vec<f64> {
    assert_eq!(bytes.len() % 8, 0, "whole numbers of 8 bytes");
    bytes.chunks_exact(8).map(|chunk| read(chunk.try_into().unwrap())).collect()
}

fn joined(points: &[f64], diameters: &[f64]) -> Rows {
    assert_eq!(points.len(), 3 * diameters.len());
    points.chunks_exact(3).zip(diameters).map(|(p, d)| [p[0], p[1], p[2], *d]).collect()
}
