//! Faces, walls, periods and sections of the domains that requests name.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::request::Boundary;

const SIZE_MM: [f64; 3] = [10.0, 20.0, 30.0];
const CYLINDER: Specimen = Specimen::Cylinder { diameter_mm: 10.0, height_mm: 30.0 };

fn cuboid(boundary: Boundary) -> Domain {
    Specimen::Box { size_mm: SIZE_MM, boundary }.domain()
}

#[test]
fn a_box_has_six_walls_and_a_periodic_one_the_same_faces_but_no_wall() {
    let (walled, periodic) = (cuboid(Boundary::Walls), cuboid(Boundary::Periodic));
    assert_eq!(walled.faces().collect::<Vec<_>>(), periodic.faces().collect::<Vec<_>>());
    assert_eq!((walled.walls().count(), periodic.walls().count()), (6, 0));
    assert_eq!((walled.periods_mm, periodic.periods_mm), ([None; 3], SIZE_MM.map(Some)));
    assert!(!walled.is_periodic() && periodic.is_periodic());
    assert_eq!(periodic.clearance_reaching_all([1.0; 3], [0.0; 3]), f64::INFINITY);
}

#[test]
fn a_domain_may_repeat_along_one_axis_between_walls() {
    let domain = Domain { periods_mm: [None, Some(20.0), None], ..cuboid(Boundary::Walls) };
    assert!(domain.has_walls() && !domain.is_periodic());
    assert_eq!(domain.walled_axes().collect::<Vec<_>>(), [0, 2]);
    assert_eq!(domain.clearance_reaching_all([4.0, 0.5, 12.0], [1.0; 3]), 3.0);
    assert_eq!(domain.walls_per_mm(), 2.0 / 10.0 + 2.0 / 30.0);
    let region = domain.center_region(3.0).unwrap();
    assert!(region.contains([5.0, 0.0, 5.0]) && !region.contains([2.0, 10.0, 5.0]));
}

#[test]
fn faces_have_the_names_of_requests_in_their_order() {
    for domain in [cuboid(Boundary::Walls), CYLINDER.domain()] {
        assert_eq!(domain.faces().count(), domain.face_names.len());
        for (face, name) in domain.faces().zip(domain.face_names) {
            let expected = match face {
                Face::Lateral(_) => "side".to_owned(),
                Face::Plane(plane) => {
                    let (axis, at_mm) = plane.across().unwrap();
                    let end = if at_mm == 0.0 { "min" } else { "max" };
                    format!("{}_{end}", ["x", "y", "z"][axis])
                }
            };
            assert_eq!(*name, expected);
        }
    }
}

#[test]
fn the_walls_over_the_volume_are_their_area_over_it() {
    for domain in [cuboid(Boundary::Walls), CYLINDER.domain()] {
        let expected = domain.surface_mm2 / domain.volume_mm3;
        assert!((domain.walls_per_mm() - expected).abs() < 1e-12);
    }
    assert_eq!(cuboid(Boundary::Periodic).walls_per_mm(), 0.0);
}

#[test]
fn outlines_are_sections() {
    let rectangle = |u_mm, v_mm| Outline::Rectangle { u_mm, v_mm };
    assert_eq!(cuboid(Boundary::Walls).outline(1, 7.0), rectangle([0.0, 10.0], [0.0, 30.0]));
    let disc = Outline::Disc { center_mm: [5.0; 2], radius_mm: 5.0 };
    assert_eq!(CYLINDER.domain().outline(2, 7.0), disc);
    // 5 mm from the axis of a circle of 5 mm the chord has no length; 3 mm from it, half of it is 4 mm.
    assert_eq!(CYLINDER.domain().outline(0, 0.0), rectangle([5.0; 2], [0.0, 30.0]));
    assert_eq!(CYLINDER.domain().outline(1, 2.0), rectangle([1.0, 9.0], [0.0, 30.0]));
}

/// The prism between two walls across z and two oblique ones over y = 0: a triangle of 4 by 2 mm, 3 mm long.
fn roof() -> Domain {
    let across =
        |axis, at: f64, sign: f64| FacePlane::new(sign * Vector3::ith(axis, 1.0), Vector3::ith(axis, at));
    let slope = |sign: f64| FacePlane::new(Vector3::new(sign, -1.0, 0.0), Vector3::new(2.0, 2.0, 0.0));
    let planes = [across(1, 0.0, 1.0), slope(1.0), slope(-1.0), across(2, 0.0, 1.0), across(2, 3.0, -1.0)];
    Domain::polytope(&planes, &["floor", "west", "east", "front", "back"]).unwrap()
}

#[test]
fn oblique_walls_bound_volume_area_clearance_and_the_region_of_centres() {
    let roof = roof();
    assert!((roof.volume_mm3 - 12.0).abs() < 1e-12);
    assert!((roof.surface_mm2 - (8.0 + 12.0 + 12.0 * 2.0_f64.sqrt())).abs() < 1e-12);
    for (length, expected) in roof.bounds_mm.into_iter().zip([4.0, 2.0, 3.0]) {
        assert!((length - expected).abs() < 1e-12);
    }
    assert_eq!(roof.walls().count(), 5);
    let clearance = roof.clearance_reaching_all([2.0, 0.5, 1.5], [0.0; 3]);
    assert!((clearance - 0.5).abs() < 1e-12);
    // Of the corners of a cube the upper ones are nearest to the slopes.
    let nearest = roof.clearance_reaching_all([2.0, 1.0, 1.5], [0.25; 3]);
    assert!((nearest - 0.5 / 2.0_f64.sqrt()).abs() < 1e-12, "{nearest}");
    let region = roof.center_region(0.25).unwrap();
    // The triangle's legs recede by 0.25 mm from the floor and along the slopes' normals.
    let height = 2.0 - 0.25 - 0.25 * 2.0_f64.sqrt();
    assert!((region.volume_mm3() - height * height * 2.5).abs() < 1e-9, "{}", region.volume_mm3());
    assert!(region.contains([2.0, 1.5, 1.5]) && !region.contains([2.0, 1.7, 1.5]));
    assert!(
        region.misses_cuboid([0.3, 1.5, 1.5], [0.1; 3]) && !region.misses_cuboid([2.0, 1.5, 1.5], [0.1; 3])
    );
    assert_eq!(roof.center_region(0.9), None);
}
