//! The form for viewers, against packings made by hand.

#![allow(clippy::unwrap_used)]

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::tests::result;
use super::*;
use crate::Spheres;
use crate::export::polyhedra_samples::mixed;
use crate::packing::{ClassReport, Solids};
use crate::request::{Boundary, Specimen};
use crate::shape::{Ellipsoid, Polyhedron, Pose, Solid};

/// The head of a result in another specimen.
fn head(specimen: Value) -> Head {
    let (mut head, _) = result();
    head.request["specimen"] = specimen;
    head
}

fn box_of(size_mm: f64) -> Value {
    json!({"type": "box", "size_mm": [size_mm, size_mm, size_mm], "boundary": "walls"})
}

/// The file in its parts, as the description says.
struct View(Vec<u8>);

impl View {
    fn of(head: &Head, grains: &dyn GrainSource) -> Self {
        let mut bytes = Vec::new();
        write(Format::View, head, grains, &mut bytes).unwrap();
        assert_eq!(length(Format::View, head, grains).unwrap(), bytes.len() as u64);
        assert_eq!((&bytes[..8], &bytes[56..64]), (&b"PKSTVIEW"[..], &[0; 8][..]));
        let view = Self(bytes);
        assert_eq!((view.u32(8) as usize, view.u32(12)), (grains.len(), 1));
        let expected = 64 + view.u32(48) as usize + grains.len() * view.u32(44) as usize;
        assert_eq!(view.0.len(), expected);
        view
    }

    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.0[at..at + 4].try_into().unwrap())
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_le_bytes(self.0[at..at + 4].try_into().unwrap())
    }

    fn record(&self, row: usize) -> Vec<u16> {
        let bytes = self.u32(44) as usize;
        let start = 64 + self.u32(48) as usize + row * bytes;
        self.0[start..start + bytes].chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
    }
}

fn spheres(rows: &[([f64; 3], f64)]) -> Spheres {
    let mut spheres = Spheres::with_capacity(rows.len());
    for (center, d) in rows {
        spheres.push(*center, *d);
    }
    spheres
}

#[test]
fn spheres_take_8_bytes_as_shares_of_the_box_and_of_the_largest() {
    let grains = spheres(&[([0.0, 50.0, 100.0], 16.0), ([25.0, 75.0, 10.0], 4.0), ([1.0, 2.0, 3.0], 1e-5)]);
    let view = View::of(&head(box_of(100.0)), &grains);
    assert_eq!([16, 20, 24, 28, 32].map(|at| view.f32(at)), [100.0, 100.0, 100.0, 1e-5, 16.0]);
    assert_eq!([36, 40, 44, 48, 52].map(|at| view.u32(at)), [0, 0, 8, 0, 1]);
    assert_eq!(view.record(0), [0, 32768, 65535, 65535]);
    assert_eq!(view.record(1), [16384, 49151, 6554, 16384]);
    assert_eq!(view.record(2)[3], 1, "a grain that is there has a size");
}

#[test]
fn grains_that_are_not_in_order_are_sorted_and_blocks_are_crossed() {
    let rows: Vec<([f64; 3], f64)> = (0..10_000_u32)
        .map(|i| ([f64::from(i % 100); 3], 1.0 + f64::from(i * 7919 % 10_000) / 1000.0))
        .collect();
    let shuffled = View::of(&head(box_of(100.0)), &spheres(&rows));
    let mut sorted = rows.clone();
    sorted.sort_by(|a, b| b.1.total_cmp(&a.1));
    let sorted = View::of(&head(box_of(100.0)), &spheres(&sorted));
    let sizes = |view: &View| (0..rows.len()).map(|row| view.record(row)[3]).collect::<Vec<_>>();
    assert!(sizes(&shuffled).is_sorted_by(|a, b| a >= b));
    assert_eq!(sizes(&shuffled), sizes(&sorted));
    assert_eq!(&shuffled.0[..64], &sorted.0[..64]);
    assert_eq!(shuffled.record(0), sorted.record(0));
}

#[test]
fn cylinders_and_periodic_boxes_are_told_apart_and_images_lie_in_the_box() {
    let grains = spheres(&[([-10.0, 50.0, 110.0], 2.0)]);
    let periodic = json!({"type": "box", "size_mm": [100, 100, 100], "boundary": "periodic"});
    let view = View::of(&head(periodic), &grains);
    assert_eq!((view.u32(36), view.u32(40)), (0, 0b111));
    assert_eq!(view.record(0)[..3], [58982, 32768, 6554]);
    let cylinder = json!({"type": "cylinder", "diameter_mm": 100.0, "height_mm": 200.0});
    let view = View::of(&head(cylinder), &grains);
    assert_eq!((view.u32(36), view.u32(40)), (1, 0));
    assert_eq!([16, 20, 24].map(|at| view.f32(at)), [100.0, 100.0, 200.0]);
    let empty = View::of(&head(box_of(10.0)), &Spheres::default());
    assert_eq!((empty.0.len(), empty.f32(28), empty.f32(32)), (64, 0.0, 0.0));
}

#[test]
fn a_result_without_the_size_of_its_specimen_is_refused() {
    let error = write(Format::View, &head(json!({"type": "box"})), &Spheres::default(), &mut Vec::new());
    assert_eq!(error.unwrap_err().kind(), io::ErrorKind::InvalidData);
}

#[test]
fn ellipsoids_have_an_orientation_and_the_ratios_of_their_axes() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let turned = UnitQuaternion::new_unchecked(Quaternion::new(half, 0.0, 0.0, -half));
    let pose = |x: f64, orientation| Pose { center_mm: Vector3::new(x, 1.0, 1.0), orientation };
    // The first is larger by volume, the second longer.
    let shapes = vec![Ellipsoid::new([2.0, 2.0, 2.0]).unwrap(), Ellipsoid::new([4.0, 1.0, 0.5]).unwrap()];
    let mut grains =
        Solids::of_ellipsoids(shapes, vec![pose(2.0, UnitQuaternion::identity()), pose(5.0, turned)]);
    grains.aggregate = vec![0, 1];
    let mut head = head(box_of(10.0));
    head.request["mix"]["aggregates"] = json!([{}, {}]);
    // The sieve sizes are 4 and about 2 mm: of the third class and of the first.
    let class = head.report.summary.classes[0].clone();
    head.report.summary.classes =
        [3.0, 3.5, 8.0].map(|d_max_mm| ClassReport { d_max_mm, ..class.clone() }).to_vec();
    let view = View::of(&head, &grains);
    assert_eq!([44, 48, 52].map(|at| view.u32(at)), [24, 0, 2]);
    assert_eq!([28, 32].map(|at| view.f32(at)), [4.0, 8.0]);
    let minus = |part: f64| (-(part * 32_767.0).round()) as i16 as u16;
    let plus = (half * 32_767.0).round() as u16;
    assert_eq!(view.record(0), [32768, 6554, 6554, 65535, 0, 0, minus(half), plus, 16384, 8192, 0, 1]);
    assert_eq!(view.record(1), [13107, 6554, 6554, 32768, 0, 0, 0, 32767, 65535, 65535, 0, 2 << 8]);
}

#[test]
fn polyhedra_refer_to_templates_that_fill_the_unit_sphere() {
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };
    let grains: Solids = mixed(&specimen, 12, [6.0, 2.0], 0.1, 0.0);
    let view = View::of(&head(box_of(20.0)), &grains);
    assert_eq!(view.u32(44), 24);
    assert_eq!(view.u32(64) as usize, grains.templates.len());
    let mut at = 68;
    for template in &grains.templates {
        let (vertices, triangles) = (view.u32(at) as usize, view.u32(at + 4) as usize);
        assert_eq!(vertices, template.vertices().len());
        // A closed surface of triangles (Euler).
        assert_eq!(triangles, 2 * vertices - 4);
        at += 8;
        let vertex = |i: usize| Vector3::from_fn(|k, _| f64::from(view.f32(at + 12 * i + 4 * k)));
        let longest = (0..vertices).map(|i| vertex(i).norm()).fold(0.0, f64::max);
        assert!((longest - 1.0).abs() < 1e-6, "{longest}");
        let corners = at + 12 * vertices;
        let corner = |i: usize| {
            usize::from(u16::from_le_bytes([view.0[corners + 2 * i], view.0[corners + 2 * i + 1]]))
        };
        let volume: f64 = (0..triangles)
            .map(|t| [0, 1, 2].map(|k| vertex(corner(3 * t + k))))
            .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
            .sum();
        let exact = template.volume() / template.outer_radius().powi(3);
        assert!(volume > 0.5 * exact && volume < 1.5 * exact, "faces outwards: {volume}, {exact}");
        at = (corners + 6 * triangles).next_multiple_of(4);
    }
    assert_eq!(at, 64 + view.u32(48) as usize);
    let outer = |shape: &Solid| match *shape {
        Solid::Ellipsoid(ellipsoid) => 2.0 * ellipsoid.semi_axes_mm()[0],
        Solid::Polyhedron { template, d_mm } => {
            2.0 * d_mm * grains.templates[template as usize].outer_radius()
        }
    };
    let sizes: Vec<f64> = grains.shapes.iter().map(outer).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    assert!((f64::from(view.f32(32)) - largest).abs() < 1e-5);
    let of_grains: Vec<Option<u32>> = grains.shapes.iter().map(Solid::template).collect();
    assert!(of_grains.iter().any(Option::is_some) && of_grains.iter().any(Option::is_none));
    for row in 0..grains.len() {
        let record = view.record(row);
        let template = u32::from(record[10]).checked_sub(1);
        // The grain of the nearest centre is that of the record.
        let center = [0, 1, 2].map(|k| f64::from(record[k]) / 65_535.0 * 20.0);
        let is_there = |pose: &Pose| (pose.center_mm - Vector3::from(center)).norm() < 1e-3;
        let grain = grains.poses.iter().position(is_there).unwrap();
        assert_eq!(template, of_grains[grain]);
        assert!((f64::from(record[3]) / 65_535.0 * largest - sizes[grain]).abs() < 1e-3);
    }
    assert!((1..grains.len()).all(|row| view.record(row)[3] <= view.record(row - 1)[3]));
}

/// A rounded body is drawn as one whose vertices lie further out.
#[test]
fn rounded_templates_keep_their_outer_radius() {
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };
    let grains = crate::export::polyhedra_samples::packed(&specimen, 3, [6.0, 2.0], 0.1, 0.07);
    let template: &Polyhedron = &grains.templates[0];
    assert!(template.rounding() > 0.0);
    let view = View::of(&head(box_of(20.0)), &grains);
    let vertices = view.u32(68) as usize;
    let norm = |i: usize| (0..3).map(|k| view.f32(76 + 12 * i + 4 * k).powi(2)).sum::<f32>().sqrt();
    let longest = (0..vertices).map(norm).fold(0.0, f32::max);
    assert!((longest - 1.0).abs() < 1e-6, "{longest}");
}
