#![allow(clippy::unwrap_used)]

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::json;

use super::source::BLOCK_ROWS;
use super::stored::{Layout, StoredBytes};
use super::*;
use crate::packing::{EdmdStatistics, GrowthEnd};
use crate::packing::{Grains, Solids};
use crate::shape::{Ellipsoid, Pose};
use crate::{Limits, PackingRequest, Spheres, Unattended, pack};

pub(super) fn result() -> (Head, Spheres) {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [60, 60, 60]},
        "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 1.0, "volume_fraction": 0.5},
    });
    let packing =
        pack(&PackingRequest::from_json(&request, 1).unwrap(), &Limits::default(), &Unattended).unwrap();
    let spheres = packing.spheres().unwrap().clone();
    assert!(spheres.len() > BLOCK_ROWS, "the blocks must be crossed");
    let head =
        Head { job_id: Some("j".into()), request, engine: EngineInfo::current(), report: packing.report };
    (head, spheres)
}

fn bytes_of(format: Format, head: &Head, spheres: &Spheres) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(format, head, spheres, &mut bytes).unwrap();
    assert_eq!(length(format, head, spheres).unwrap(), bytes.len() as u64, "{format:?}");
    bytes
}

#[test]
fn json_holds_the_report_and_reads_back_exactly() {
    let (head, spheres) = result();
    let value: serde_json::Value = serde_json::from_slice(&bytes_of(Format::Json, &head, &spheres)).unwrap();
    assert_eq!(value["summary"]["grains"], spheres.len());
    assert_eq!(value["job_id"], "j");
    assert_eq!(value["grains"]["columns"], json!(["x_mm", "y_mm", "z_mm", "d_mm"]));
    let rows = value["grains"]["rows"].as_array().unwrap();
    assert_eq!(rows.len(), spheres.len());
    for (i, row) in rows.iter().enumerate() {
        let numbers: Vec<f64> = row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        assert_eq!(numbers, [spheres.x_mm[i], spheres.y_mm[i], spheres.z_mm[i], spheres.d_mm[i]]);
    }
}

#[test]
fn csv_reads_back_exactly() {
    let (head, spheres) = result();
    let text = String::from_utf8(bytes_of(Format::Csv, &head, &spheres)).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x_mm,y_mm,z_mm,d_mm"));
    for i in 0..spheres.len() {
        let numbers: Vec<f64> = lines.next().unwrap().split(',').map(|x| x.parse().unwrap()).collect();
        assert_eq!(numbers, [spheres.x_mm[i], spheres.y_mm[i], spheres.z_mm[i], spheres.d_mm[i]]);
    }
    assert_eq!(lines.next(), None);
}

#[test]
fn npy_is_a_header_of_64_bytes_multiples_and_the_columns() {
    let (head, spheres) = result();
    let bytes = bytes_of(Format::Npy, &head, &spheres);
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!(start % 64, 0);
    let header = std::str::from_utf8(&bytes[10..start]).unwrap();
    assert!(header.starts_with(&format!(
        "{{'descr': '<f8', 'fortran_order': True, 'shape': ({}, 4), }}",
        spheres.len()
    )));
    assert!(header.ends_with('\n'));
    let numbers: Vec<f64> =
        bytes[start..].chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(numbers, [&spheres.x_mm[..], &spheres.y_mm, &spheres.z_mm, &spheres.d_mm].concat());
}

/// The appended block at an offset, as the XML form lays it out.
pub(super) fn appended<'a>(bytes: &'a [u8], data: usize, name: &str) -> &'a [u8] {
    let text = String::from_utf8_lossy(&bytes[..data]);
    let tag = text.split("<DataArray").find(|tag| tag.contains(&format!("Name=\"{name}\""))).unwrap();
    let offset = tag.split("offset=\"").nth(1).unwrap().split('"').next().unwrap().parse::<usize>().unwrap();
    let at = data + offset;
    let size = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    &bytes[at + 8..at + 8 + size]
}

#[test]
fn vtp_blocks_lie_at_their_offsets() {
    let (head, spheres) = result();
    let bytes = bytes_of(Format::Vtp, &head, &spheres);
    let data = bytes.windows(2).position(|pair| pair == b" _").unwrap() + 2;
    let points = appended(&bytes, data, "Points");
    assert_eq!(points.len(), 24 * spheres.len());
    let last = spheres.len() - 1;
    let y = f64::from_le_bytes(points[24 * last + 8..24 * last + 16].try_into().unwrap());
    assert_eq!(y, spheres.y_mm[last]);
    let radius = appended(&bytes, data, "radius");
    assert_eq!(f64::from_le_bytes(radius[..8].try_into().unwrap()), spheres.d_mm[0] / 2.0);
    let class = appended(&bytes, data, "sieve_class");
    assert_eq!(
        i32::from_le_bytes(class[..4].try_into().unwrap()),
        head.report.summary.classes.len() as i32 - 1
    );
    assert_eq!(i32::from_le_bytes(class[4 * last..].try_into().unwrap()), 0);
    assert_eq!(appended(&bytes, data, "offsets").len(), 8 * spheres.len());
    assert!(bytes.ends_with(b"\n  </AppendedData>\n</VTKFile>\n"));
}

#[test]
fn vtp_says_where_it_comes_from() {
    let (mut head, spheres) = result();
    head.request["name"] = json!("a < b");
    head.request["seed"] = json!(17);
    let bytes = bytes_of(Format::Vtp, &head, &spheres);
    let text = String::from_utf8_lossy(&bytes[..4000]);
    let field = |name: &str| {
        let (_, after) =
            text.split_once(&format!("Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">")).unwrap();
        after.split_once('<').unwrap().0.to_owned()
    };
    assert_eq!(field("name"), "97 32 60 32 98 0");
    assert_eq!(field("job_id"), "106 0");
    assert_eq!(field("seed"), "17");
    let fraction: f64 = field("volume_fraction_effective").parse().unwrap();
    assert_eq!(fraction, head.report.summary.volume_fraction_effective);
}

#[test]
fn the_title_of_the_legacy_form_is_one_clean_line() {
    let (mut head, spheres) = result();
    head.request["name"] = json!("line\nbreak é ".repeat(40));
    let bytes = bytes_of(Format::Vtk, &head, &spheres);
    let text = String::from_utf8_lossy(&bytes[..400]);
    let title = text.lines().nth(1).unwrap();
    assert!(title.is_ascii() && title.len() < 256);
    assert_eq!(text.lines().nth(2), Some("BINARY"));
}

#[test]
fn the_stored_form_reads_back() {
    let (head, spheres) = result();
    let mut bytes = Vec::new();
    stored::write(&head, &spheres, &mut bytes).unwrap();
    let layout = Layout::read(&mut bytes.as_slice()).unwrap();
    assert_eq!(layout.head, head);
    assert_eq!(layout.file_length(), bytes.len() as u64);
    assert_eq!(layout.columns_offset % 64, 0);
    let at = layout.offset(Column::Z, 17).unwrap() as usize;
    assert_eq!(f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()), spheres.z_mm[17]);
    assert!(Layout::read(&mut &bytes[..100]).is_err());
    bytes[0] = b'X';
    assert_eq!(Layout::read(&mut bytes.as_slice()).unwrap_err().kind(), io::ErrorKind::InvalidData);
    for earlier in [b'1', b'2'] {
        (bytes[0], bytes[7]) = (b'P', earlier);
        let refused = Layout::read(&mut bytes.as_slice()).unwrap_err();
        assert!(refused.to_string().contains("at commit 9f6917b reads"), "{refused}");
    }
}

#[test]
fn a_damaged_stored_result_is_refused_wherever_it_is_damaged() {
    let (head, spheres) = result();
    let mut bytes = Vec::new();
    stored::write(&head, &spheres, &mut bytes).unwrap();
    stored::verify(&mut bytes.as_slice()).unwrap();
    assert_eq!(load(&StoredBytes::read(&bytes).unwrap()).unwrap(), Grains::Spheres(spheres));
    for at in (0..bytes.len()).step_by(61).chain(bytes.len() - 5..bytes.len()) {
        bytes[at] ^= 4;
        assert_eq!(
            stored::verify(&mut bytes.as_slice()).unwrap_err().kind(),
            io::ErrorKind::InvalidData,
            "{at}"
        );
        assert!(StoredBytes::read(&bytes).is_err(), "{at}");
        bytes[at] ^= 4;
    }
    for length in [0, 3, 4, bytes.len() - 1] {
        assert!(
            stored::verify(&mut &bytes[..length]).is_err() && StoredBytes::read(&bytes[..length]).is_err()
        );
    }
}

#[test]
fn a_stored_result_of_an_older_version_is_refused_with_that_version() {
    let (head, spheres) = result();
    let mut bytes = Vec::new();
    stored::write(&head, &spheres, &mut bytes).unwrap();
    let end = 24 + u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
    let text = String::from_utf8(bytes[24..end].to_vec()).unwrap();
    let present = format!(r#""version":"{}""#, crate::VERSION);
    // Also where the form of the head itself is another one.
    for other in [text.clone(), text.replacen(r#""check":"#, r#""verification":"#, 1)] {
        let older = other.replacen(&present, r#""version":"0.1.0""#, 1);
        assert_ne!(older, text);
        let mut bytes = bytes.clone();
        bytes[8..16].copy_from_slice(&(older.len() as u64).to_le_bytes());
        bytes.splice(24..end, older.bytes());
        let refused = Layout::read(&mut bytes.as_slice()).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidData);
        assert!(refused.to_string().contains("Packstone 0.1.0, which reads it"), "{refused}");
    }
}

#[test]
fn what_growth_counted_is_stored_too() {
    let (mut head, spheres) = result();
    let edmd =
        EdmdStatistics { events: 3, stop: GrowthEnd::TimeLimit, energy: 1.5, ..EdmdStatistics::default() };
    head.report.statistics.edmd = Some(edmd);
    let mut bytes = Vec::new();
    stored::write(&head, &spheres, &mut bytes).unwrap();
    assert_eq!(Layout::read(&mut bytes.as_slice()).unwrap().head, head);
    let value: serde_json::Value = serde_json::from_slice(&bytes_of(Format::Json, &head, &spheres)).unwrap();
    assert_eq!(value["statistics"]["edmd"]["stop"], "time_limit");
}

#[test]
fn an_empty_result_is_well_formed_in_every_format() {
    let (head, _) = result();
    let empty = Spheres::default();
    for format in Format::ALL {
        assert!(!bytes_of(format, &head, &empty).is_empty());
        assert_eq!(Format::from_name(format.name()), Some(format));
    }
    let value: serde_json::Value = serde_json::from_slice(&bytes_of(Format::Json, &head, &empty)).unwrap();
    assert_eq!(value["grains"]["rows"], json!([]));
}

/// Two ellipsoids, one of them with a quaternion whose length is not exactly 1.
fn ellipsoids() -> Solids {
    let turned = UnitQuaternion::new_unchecked(Quaternion::new(0.8, 0.1, -0.3, 0.509_902));
    Solids::of_ellipsoids(
        vec![Ellipsoid::new([4.0, 3.0, 2.0]).unwrap(), Ellipsoid::new([2.0, 1.5, 1.0]).unwrap()],
        vec![
            Pose { center_mm: Vector3::new(5.0, 6.0, 7.0), orientation: turned },
            Pose::at(Vector3::new(15.0, 6.0, 7.0)),
        ],
    )
}

#[test]
fn ellipsoids_are_stored_with_named_columns_and_read_back_exactly() {
    let (head, _) = result();
    let grains = ellipsoids();
    let mut bytes = Vec::new();
    stored::write(&head, &grains, &mut bytes).unwrap();
    assert!(stored::is_stored(bytes[..8].try_into().unwrap()) && bytes.starts_with(b"PACKSTN3"));
    let layout = Layout::read(&mut &bytes[..]).unwrap();
    assert_eq!((&layout.head, layout.rows, layout.columns), (&head, 2, Column::OF_ELLIPSOIDS));
    assert_eq!(layout.file_length(), bytes.len() as u64);
    let value = |column, row| {
        let at = layout.offset(column, row).unwrap() as usize;
        f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
    };
    let values = Column::OF_ELLIPSOIDS.iter().map(|&column| vec![value(column, 0), value(column, 1)]);
    let table = Table::new(layout.columns, values.collect()).unwrap();
    assert_eq!(load(&table).unwrap(), Grains::Solids(grains));
    assert_eq!(value(Column::Sieve, 0), 26.0_f64.sqrt());
    assert!((value(Column::Diameter, 0) - 2.0 * libm::cbrt(24.0_f64)).abs() < 1e-15);
    // With unknown columns it is no result.
    let unknown = String::from_utf8_lossy(&bytes[24..]).find("sieve_mm").unwrap() + 24;
    bytes[unknown] = b'S';
    assert_eq!(Layout::read(&mut &bytes[..]).unwrap_err().kind(), io::ErrorKind::InvalidData);
}

#[test]
fn tables_of_ellipsoids_have_twelve_columns() {
    let (head, _) = result();
    let grains = ellipsoids();
    let mut bytes = Vec::new();
    write(Format::Csv, &head, &grains, &mut bytes).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "x_mm,y_mm,z_mm,d_mm,sieve_mm,qw,qx,qy,qz,a_mm,b_mm,c_mm");
    assert_eq!(lines.len(), 3);
    assert!(
        lines[1].ends_with(",0.8,0.1,-0.3,0.509902,4,3,2") || lines[1].ends_with(",4.0,3.0,2.0"),
        "{text}"
    );
    let mut npy = Vec::new();
    write(Format::Npy, &head, &grains, &mut npy).unwrap();
    assert!(String::from_utf8_lossy(&npy[..128]).contains("'shape': (2, 12)"));
    for format in Format::ALL {
        let mut bytes = Vec::new();
        write(format, &head, &grains, &mut bytes).unwrap();
        assert_eq!(length(format, &head, &grains).unwrap(), bytes.len() as u64, "{format:?}");
    }
}

/// Products of the numbers of a header must not overflow.
#[test]
fn a_header_with_numbers_that_no_file_can_have_is_refused() {
    let (head, grains) = result();
    let mut bytes = Vec::new();
    stored::write(&head, &grains, &mut bytes).unwrap();
    for rows in [u64::MAX, u64::MAX / 8, 1 << 61, (1 << 59) + 1, i64::MAX as u64 / 32] {
        bytes[16..24].copy_from_slice(&rows.to_le_bytes());
        let error = Layout::read(&mut &bytes[..]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{rows}: {error}");
        assert!(StoredBytes::read(&bytes).is_err());
    }
}

#[test]
fn numbers_that_describe_no_grain_are_refused_with_their_row() {
    let columns = |values: [f64; 4]| values.map(|value| vec![1.0, value]).to_vec();
    for values in [
        [f64::NAN, 1.0, 1.0, 1.0],
        [1.0, f64::INFINITY, 1.0, 1.0],
        [1.0, 1.0, -f64::INFINITY, 1.0],
        [1.0, 1.0, 1.0, 0.0],
        [1.0, 1.0, 1.0, -1.0],
        [1.0, 1.0, 1.0, f64::NAN],
        [1.0, 1.0, 1.0, f64::INFINITY],
    ] {
        let error = load(&Table::new(Column::OF_SPHERES, columns(values)).unwrap()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        assert!(error.to_string().starts_with("grain 1 has a coordinate that is no number"), "{error}");
    }
    let error =
        load(&Table::new(Column::OF_ELLIPSOIDS, vec![vec![1.0]; 12]).unwrap()).unwrap_err().to_string();
    assert!(error.contains("no unit quaternion: its length is 2"), "{error}");
}

#[test]
fn a_grain_without_positive_semi_axes_is_no_ellipsoid() {
    let columns = vec![vec![1.0]; 11].into_iter().chain([vec![0.0]]).collect();
    let table = Table::new(Column::OF_ELLIPSOIDS, columns).unwrap();
    let error = load(&table).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::InvalidData);
    assert!(error.to_string().contains("grain 0"), "{error}");
    assert!(Table::new(Column::OF_ELLIPSOIDS, vec![vec![1.0]; 4]).is_err());
}
