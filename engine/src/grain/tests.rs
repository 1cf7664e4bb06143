//! What every kind of grain keeps of [`Grain`], by the same properties for all; and closed forms.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::{Grain as _, PlacedGrain, PlacedGrains, RowLines, Surface};
use crate::packing::{Grains, Solids, Spheres};
use crate::properties::properties;
use crate::shape::polyhedron::samples::{cuboid, octahedron};
use crate::shape::{Ellipsoid, Pose};

/// One grain of each kind: a sphere, an ellipsoid, a sharp and a rounded polyhedron.
fn one_of_each(axes: [f64; 3], angles: [f64; 3]) -> [Grains; 4] {
    let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
    let pose = Pose { center_mm: Vector3::new(1.0, 2.0, 3.0), orientation };
    let mut spheres = Spheres::default();
    spheres.push([1.0, 2.0, 3.0], 2.0 * axes[0]);
    let ellipsoid = Solids::of_ellipsoids(vec![Ellipsoid::new(axes).unwrap()], vec![pose]);
    let polyhedron = |template| Solids::of_polyhedra(vec![template], &[0], &[2.0 * axes[0]], vec![pose]);
    let rounded = octahedron(1.0).with_relative_rounding(0.1).unwrap();
    [
        Grains::Spheres(spheres),
        Grains::Solids(ellipsoid),
        Grains::Solids(polyhedron(cuboid(axes, 0.0).normalized())),
        Grains::Solids(polyhedron(rounded.normalized())),
    ]
}

/// The chord along x at a point from the centre, as rows give it.
fn row(placed: &PlacedGrains<'_>, at: &Vector3<f64>) -> [f64; 2] {
    let center = placed.center_mm(0);
    let mut lines = RowLines::default();
    placed.rows(0, center, at.z, &mut lines).x_at(center[1] + at.y).map(|x| x - center[0])
}

/// Holds a grain against its own chord along a unit vector through a point.
fn agrees_with_itself(grain: PlacedGrain<'_>, from: &Vector3<f64>, along: &Vector3<f64>) {
    let size = grain.outer_radius_mm();
    let half = Vector3::from(grain.half_extents_mm());
    assert!(grain.inner_radius_mm() <= half.min() && half.max() <= size * (1.0 + 1e-12));
    let Some([enter, leave]) = grain.chord_mm(from, along) else {
        for step in -20..=20 {
            let at = from + along * (0.1 * size * f64::from(step));
            assert!(!grain.contains(&at) && grain.distance_mm(&at) > -1e-9 * size);
        }
        return;
    };
    for t in [enter, leave] {
        let at = from + along * t;
        assert!(grain.distance_mm(&at).abs() < 1e-9 * size, "{}", grain.distance_mm(&at));
        assert!((0..3).all(|axis| at[axis].abs() <= half[axis] * (1.0 + 1e-9)));
        let normal = grain.normal(&at);
        assert!((normal.norm() - 1.0).abs() < 1e-12);
        // Along the normal the distance grows as the path does, for the grain is convex.
        let outside = grain.distance_mm(&(at + normal * 0.1 * size));
        assert!((outside - 0.1 * size).abs() < 1e-6 * size, "{outside}");
        let reach = grain.reach_mm(&at);
        assert!((reach - at.norm()).abs() < 1e-9 * size, "{reach}");
    }
    for (t, is_inside) in [(0.01, true), (0.5, true), (0.99, true), (-0.01, false), (1.01, false)] {
        let at = from + along * (enter + t * (leave - enter));
        assert_eq!((grain.contains(&at), grain.distance_mm(&at) < 0.0), (is_inside, is_inside), "{t}");
    }
}

properties! {
    #[test]
    fn every_kind_agrees_with_itself(
        axes in prop::array::uniform3(0.4..2.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
        from in prop::array::uniform3(-2.0..2.0_f64), along in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let along = Vector3::from(along);
        prop_assume!(along.norm() > 0.1);
        let (from, along) = (Vector3::from(from), along.normalize());
        for grains in one_of_each(axes, angles) {
            let placed = PlacedGrains::new(&grains).unwrap();
            let grain = placed.grain(0);
            agrees_with_itself(grain, &from, &along);
            // Rows are chords along x.
            let ends = grain.chord_mm(&from, &Vector3::x());
            if let (Some(ends), true) = (ends, from.z.abs() < grain.half_extents_mm()[2]) {
                let found = row(&placed, &from);
                for (end, found) in ends.iter().zip(found) {
                    prop_assert!((from.x + end - found).abs() < 1e-6, "{end} {found}");
                }
            }
            // The area of a section is what the volume below grows by.
            let [middle, step] = [0.3 * grain.half_extents_mm()[2], 1e-4];
            let volumes = grain.volume_below(2).at(middle - step, 2.0 * step, 2);
            let area = grain.section([0, 1, 2], middle).map_or(0.0, |(_, figure)| figure.area_mm2());
            let grown = (volumes[1] - volumes[0]) / (2.0 * step);
            prop_assert!((grown - area).abs() < 0.02 * area.max(0.1), "{grown} {area}");
            if let Surface::Quadric(matrix) = grain.surface() {
                let on = along * grain.reach_mm(&along);
                prop_assert!((on.dot(&(matrix * on)) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn equal_semi_axes_make_a_sphere(radius in 0.3..3.0_f64, at in -0.9..0.9_f64) {
        let [sphere, ellipsoid, ..] = one_of_each([radius; 3], [0.3, 0.5, 0.7]);
        let placed = [&sphere, &ellipsoid].map(|grains| PlacedGrains::new(grains).unwrap());
        let from = Vector3::new(0.1 * radius, 0.5 * at * radius, at * radius);
        let [one, other] = placed.each_ref().map(|placed| row(placed, &from));
        for (a, b) in one.into_iter().zip(other) {
            prop_assert!((a - b).abs() < 1e-12 * radius.max(1.0), "{a} {b}");
        }
        let [one, other] = placed.each_ref().map(|placed| placed.grain(0));
        let volume = PI / 6.0 * (2.0 * radius).powi(3);
        prop_assert!((one.volume_mm3() - volume).abs() < 1e-12 * volume);
        prop_assert!((other.volume_mm3() - volume).abs() < 1e-12 * volume);
        prop_assert!((one.distance_mm(&from) - other.distance_mm(&from)).abs() < 1e-9 * radius);
        let normal = Vector3::new(0.6, 0.0, 0.8);
        let depth = one.to_outline_mm(&from, &normal);
        prop_assert!(depth >= 0.0 || !one.contains(&from));
    }
}
