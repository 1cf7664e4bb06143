//! Tables of polyhedra: the stored form and every format.

#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::stored::Layout;
use super::tests::{appended, result};
use super::*;
use crate::export::polyhedra_samples::{mixed, packed};
use crate::packing::{Grains, Solids};
use crate::request::{Boundary, Specimen};

fn grains(rounding: f64) -> Solids {
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };
    packed(&specimen, 12, [6.0, 2.0], 0.1, rounding)
}

fn stored_bytes(head: &Head, grains: &Solids) -> Vec<u8> {
    let mut bytes = Vec::new();
    stored::write(head, grains, &mut bytes).unwrap();
    bytes
}

/// What a stored result holds.
fn read_back(bytes: &[u8]) -> io::Result<Grains> {
    let layout = Layout::read(&mut &bytes[..])?;
    let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let column = |column: &Column| -> Vec<f64> {
        (0..layout.rows).map(|row| number(layout.offset(*column, row).unwrap() as usize)).collect()
    };
    let values = layout.columns.iter().map(column).collect();
    load(&Table::new(layout.columns, values)?.with_templates(layout.templates.clone()))
}

/// The stored form with another head.
fn with_head(bytes: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let end = 24 + u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
    let mut head: Value = serde_json::from_slice(&bytes[24..end]).unwrap();
    change(&mut head);
    let text = serde_json::to_vec(&head).unwrap();
    let mut changed = bytes[..8].to_vec();
    changed.extend((text.len() as u64).to_le_bytes());
    changed.extend(&bytes[16..24]);
    changed.extend(text);
    changed.extend(&bytes[end..]);
    changed
}

#[test]
fn polyhedra_are_stored_with_their_templates_and_read_back_exactly() {
    let (head, _) = result();
    for rounding in [0.0, 0.07] {
        let grains = grains(rounding);
        let bytes = stored_bytes(&head, &grains);
        assert!(bytes.starts_with(b"PACKSTN3"));
        let layout = Layout::read(&mut &bytes[..]).unwrap();
        assert_eq!((&layout.head, layout.rows, layout.columns), (&head, 12, Column::OF_POLYHEDRA));
        assert_eq!(layout.file_length(), bytes.len() as u64);
        let Grains::Solids(read) = read_back(&bytes).unwrap() else { panic!("other grains") };
        assert_eq!(read, grains);
        let bits = |grains: &Solids| -> Vec<u64> {
            let vertices = |row: usize| {
                let template = grains.shape(row).polyhedron().unwrap().template;
                template.world_vertices_mm(grains.shapes[row].d_mm(), &grains.poses[row]).collect::<Vec<_>>()
            };
            (0..grains.len())
                .flat_map(vertices)
                .flat_map(|v| [v.x.to_bits(), v.y.to_bits(), v.z.to_bits()])
                .collect()
        };
        assert_eq!(bits(&read), bits(&grains));
        assert_eq!(stored_bytes(&head, &read), bytes);
    }
}

#[test]
fn json_states_the_templates_once_beside_the_grains() {
    let (head, _) = result();
    let grains = grains(0.05);
    let mut bytes = Vec::new();
    write(Format::Json, &head, &grains, &mut bytes).unwrap();
    let value: Value = serde_json::from_slice(&bytes).unwrap();
    let columns = ["x_mm", "y_mm", "z_mm", "d_mm", "sieve_mm", "qw", "qx", "qy", "qz", "template"];
    assert_eq!(value["grains"]["columns"], json!(columns));
    let records: Vec<TemplateRecord> = serde_json::from_value(value["templates"].clone()).unwrap();
    assert!((records[0].volume - std::f64::consts::PI / 6.0).abs() < 1e-12);
    assert!(records[0].thickness < records[0].sieve_size && records[0].sieve_size < records[0].length);
    assert_eq!(read_templates(Column::OF_POLYHEDRA, Some(records)).unwrap(), grains.templates);
    let row: Vec<f64> = serde_json::from_value(value["grains"]["rows"][5].clone()).unwrap();
    let q = grains.poses[5].orientation.quaternion();
    assert_eq!(row[5..], [q.w, q.i, q.j, q.k, f64::from(grains.shapes[5].template().unwrap())]);
    assert_eq!(row[4], grains.shapes[5].d_mm() * grains.shape(5).polyhedron().unwrap().template.sieve_size());
    // Other grains have none.
    let (head, spheres) = result();
    let mut bytes = Vec::new();
    write(Format::Json, &head, &spheres, &mut bytes).unwrap();
    assert!(serde_json::from_slice::<Value>(&bytes).unwrap().get("templates").is_none());
}

#[test]
fn what_is_wrong_with_a_file_of_polyhedra_is_said() {
    let (head, _) = result();
    let bytes = stored_bytes(&head, &grains(0.0));
    let fault = |bytes: &[u8]| {
        let error = read_back(bytes).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{error}");
        error.to_string()
    };
    let head_fault = |change: &dyn Fn(&mut Value)| fault(&with_head(&bytes, |head| change(head)));
    let text = head_fault(&|head| head["templates"][2]["vertices"][0] = json!([0.01, 0.0, 0.0]));
    assert!(text.starts_with("template 2 is no grain: vertex "), "{text}");
    let text = head_fault(&|head| {
        for vertex in head["templates"][1]["vertices"].as_array_mut().unwrap() {
            for x in vertex.as_array_mut().unwrap() {
                *x = json!(x.as_f64().unwrap() * (1.0 + 2e-9));
            }
        }
    });
    assert!(text.starts_with("template 1 is no grain: its equivalent diameter is 1.000000002"), "{text}");
    let text = head_fault(&|head| head["templates"][0]["faces"][0][0] = json!(1000));
    assert!(text.starts_with("template 0 is no grain: face 0 names"), "{text}");
    let text = head_fault(&|head| head["templates"][0]["rounding"] = json!(-0.1));
    assert!(text.contains("the radius is negative"), "{text}");
    let text = head_fault(&|head| head["templates"] = Value::Null);
    assert_eq!(text, "polyhedra without their `templates`");
    let text = head_fault(&|head| {
        head["templates"].as_array_mut().unwrap().pop();
    });
    assert_eq!(text, "grain 3 has the template 3, and there are 3, counted from 0");
    // A reader that does not know the columns of polyhedra refuses them as unknown, as this one does others.
    let text = head_fault(&|head| head["columns"][9] = json!("model"));
    assert_eq!(text, "a stored result with unknown columns");

    let layout = Layout::read(&mut &bytes[..]).unwrap();
    let with_value = |column, row, value: f64| {
        let mut bytes = bytes.clone();
        let at = layout.offset(column, row).unwrap() as usize;
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        fault(&bytes)
    };
    for wrong in [-1.0, 0.5, 4.0, f64::NAN, 1e300] {
        assert!(with_value(Column::Template, 7, wrong).starts_with("grain 7 has the template "), "{wrong}");
    }
    assert!(
        with_value(Column::Qw, 2, 1.7).starts_with("grain 2 has an orientation that is no unit quaternion")
    );
    assert!(
        with_value(Column::Qy, 2, f64::NAN)
            .starts_with("grain 2 has an orientation that is no unit quaternion")
    );
    assert!(with_value(Column::Diameter, 1, 0.0).starts_with("grain 1 has a coordinate that is no number"));
    assert!(
        with_value(Column::X, 1, f64::INFINITY).starts_with("grain 1 has a coordinate that is no number")
    );
}

#[test]
fn every_format_has_the_length_that_is_told_before() {
    let (head, _) = result();
    for rounding in [0.0, 0.07] {
        let grains = grains(rounding);
        for format in Format::ALL {
            let mut bytes = Vec::new();
            write(format, &head, &grains, &mut bytes).unwrap();
            assert_eq!(length(format, &head, &grains).unwrap(), bytes.len() as u64, "{format:?}");
            match format {
                Format::Csv => {
                    let text = String::from_utf8(bytes).unwrap();
                    let lines: Vec<&str> = text.lines().collect();
                    assert_eq!(lines[0], "x_mm,y_mm,z_mm,d_mm,sieve_mm,qw,qx,qy,qz,template");
                    assert_eq!(lines.len(), 13);
                }
                Format::Npy => assert!(String::from_utf8_lossy(&bytes[..128]).contains("'shape': (12, 10)")),
                _ => {}
            }
        }
    }
}

/// The polygons enclose the volume of the grains, of rounded ones too.
#[test]
fn vtp_has_the_surfaces_of_the_grains() {
    let (head, _) = result();
    for rounding in [0.0, 0.07] {
        let grains = grains(rounding);
        let mut bytes = Vec::new();
        write(Format::Vtp, &head, &grains, &mut bytes).unwrap();
        let data = bytes.windows(2).position(|pair| pair == b" _").unwrap() + 2;
        let doubles = |name: &str| -> Vec<f64> {
            appended(&bytes, data, name)
                .chunks(8)
                .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
                .collect()
        };
        let longs = |name: &str| -> Vec<usize> {
            let numbers = appended(&bytes, data, name).chunks(8);
            numbers.map(|b| i64::from_le_bytes(b.try_into().unwrap()) as usize).collect()
        };
        let coordinates = doubles("Points");
        let point = |p: usize| nalgebra::Vector3::from_row_slice(&coordinates[3 * p..3 * p + 3]);
        let (corners, ends) = (longs("connectivity"), longs("offsets"));
        let (mut volume, mut start) = (0.0, 0);
        for &end in &ends {
            let polygon = &corners[start..end];
            for pair in polygon[1..].windows(2) {
                volume += point(polygon[0]).dot(&point(pair[0]).cross(&point(pair[1]))) / 6.0;
            }
            start = end;
        }
        assert_eq!(start, corners.len());
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        assert!((1.0 - volume / exact).abs() < 1e-9, "{volume} {exact}");
        assert_eq!(doubles("diameter").len(), ends.len());
        assert_eq!(appended(&bytes, data, "id").len(), 4 * ends.len());
        let last = appended(&bytes, data, "id").chunks(4).next_back().unwrap();
        assert_eq!(i32::from_le_bytes(last.try_into().unwrap()), 11);
        if rounding == 0.0 {
            let first = grains
                .shape(0)
                .polyhedron()
                .unwrap()
                .template
                .world_vertices_mm(grains.shapes[0].d_mm(), &grains.poses[0])
                .next()
                .unwrap();
            assert_eq!(point(0), first);
        }
    }
}

#[test]
fn ellipsoids_and_polyhedra_are_stored_with_the_columns_of_both() {
    let (head, _) = result();
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };
    let grains = mixed(&specimen, 12, [6.0, 2.0], 0.1, 0.05);
    let bytes = stored_bytes(&head, &grains);
    let layout = Layout::read(&mut &bytes[..]).unwrap();
    assert_eq!((layout.rows, layout.columns, layout.templates.len()), (12, Column::OF_BOTH, 4));
    assert_eq!(read_back(&bytes).unwrap(), Grains::Solids(grains.clone()));
    let mut csv = Vec::new();
    write(Format::Csv, &head, &grains, &mut csv).unwrap();
    let csv = String::from_utf8(csv).unwrap();
    let (names, rows) = csv.split_once('\n').unwrap();
    assert!(names.ends_with("qz,a_mm,b_mm,c_mm,template"), "{names}");
    for (row, shape) in rows.lines().zip(&grains.shapes) {
        let numbers: Vec<f64> = row.split(',').map(|x| x.parse().unwrap()).collect();
        let expected = match shape.ellipsoid() {
            Some(shape) => [shape.semi_axes_mm().x, shape.semi_axes_mm().y, shape.semi_axes_mm().z, -1.0],
            None => [0.0, 0.0, 0.0, shape.template().unwrap().into()],
        };
        assert_eq!((numbers[3], &numbers[9..]), (shape.d_mm(), &expected[..]));
    }
    let ellipsoids = grains.shapes.iter().filter(|shape| shape.ellipsoid().is_some()).count();
    assert_eq!(ellipsoids, 6);
    for format in [Format::Vtp, Format::Vtk] {
        let mut file = Vec::new();
        write(format, &head, &grains, &mut file).unwrap();
        assert_eq!(length(format, &head, &grains).unwrap(), file.len() as u64);
        assert!(file.len() > ellipsoids * (162 * 24 + 320 * 16), "{}", file.len());
        if format == Format::Vtp {
            assert_mixture(&file, &grains);
        }
    }
    // Neither an ellipsoid nor a polyhedron.
    for (column, value) in [(Column::A, -2.0), (Column::Template, 4.0), (Column::Template, -2.0)] {
        let mut broken = bytes.clone();
        let row = grains.shapes.iter().position(|shape| shape.ellipsoid().is_some()).unwrap();
        let at = layout.offset(column, row as u64).unwrap() as usize;
        broken[at..at + 8].copy_from_slice(&f64::to_le_bytes(value));
        let refused = read_back(&broken).unwrap_err().to_string();
        assert!(refused.contains(&format!("grain {row}")), "{refused}");
    }
}

/// The polygons of each grain enclose its volume, and the tensors are those of the ellipsoids.
fn assert_mixture(file: &[u8], grains: &Solids) {
    let start = file.windows(2).position(|pair| pair == b" _").unwrap() + 2;
    let numbers = |name: &str| -> Vec<f64> {
        let bytes = appended(file, start, name).chunks(8);
        bytes.map(|eight| f64::from_le_bytes(eight.try_into().unwrap())).collect()
    };
    let integers = |name: &str| -> Vec<usize> {
        let bytes = appended(file, start, name).chunks(8);
        bytes.map(|eight| i64::from_le_bytes(eight.try_into().unwrap()) as usize).collect()
    };
    let (points, corners, ends) = (numbers("Points"), integers("connectivity"), integers("offsets"));
    let ids: Vec<usize> = appended(file, start, "id")
        .chunks(4)
        .map(|four| i32::from_le_bytes(four.try_into().unwrap()) as usize)
        .collect();
    let tensors = numbers("tensor");
    let mut volumes = vec![0.0; grains.len()];
    let mut first = 0;
    for (polygon, (&end, &id)) in ends.iter().zip(&ids).enumerate() {
        let center = grains.poses[id].center_mm;
        let at = |p: usize| nalgebra::Vector3::from_column_slice(&points[3 * p..3 * p + 3]) - center;
        let corners = &corners[first..end];
        for pair in corners[1..].windows(2) {
            volumes[id] += at(corners[0]).dot(&at(pair[0]).cross(&at(pair[1]))) / 6.0;
        }
        first = end;
        let tensor = &tensors[6 * polygon..6 * polygon + 6];
        let trace = grains.shapes[id].ellipsoid().map_or(0.0, |shape| 2.0 * shape.semi_axes_mm().sum());
        assert!((tensor[0] + tensor[1] + tensor[2] - trace).abs() < 1e-12, "{id}: {tensor:?}");
    }
    for (row, volume) in volumes.iter().enumerate() {
        let exact = grains.shape(row).volume_mm3();
        assert!((volume / exact - 1.0).abs() < 1e-9, "{row}: {volume}, {exact}");
    }
}

/// The surface of an ellipsoid among polyhedra is closed, turned outwards, and inscribed before it is scaled.
#[test]
fn surfaces_of_ellipsoids_are_closed() {
    let ball = surfaces::ball();
    let mut edges = std::collections::BTreeSet::new();
    for corners in &ball.1 {
        assert_eq!(corners.len(), 3);
        for i in 0..3 {
            assert!(edges.insert([corners[i], corners[(i + 1) % 3]]));
        }
    }
    assert!(edges.iter().all(|[a, b]| edges.contains(&[*b, *a])));
    let volume: f64 = ball
        .1
        .iter()
        .map(|c| {
            let [a, b, c] = [c[0], c[1], c[2]].map(|i| ball.0[i as usize]);
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum();
    let of_ball = 4.0 / 3.0 * std::f64::consts::PI;
    assert!(volume < of_ball && volume > 0.96 * of_ball, "{volume}");
    assert_eq!((ball.0.len(), ball.1.len()), (162, 320));
}
