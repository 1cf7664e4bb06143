use std::f64::consts::PI;

use nalgebra::UnitQuaternion;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::grain::{Grain as _, PlacedGrain, PlacedGrains};
use crate::mix::uniform_orientation;
use crate::packing::Solids;
use crate::rng::{Stream, stream, uniform};
use crate::shape::polyhedron::{TemplateKind, draw_template, samples};
use crate::shape::{Ellipsoid, Form, Polyhedron, Pose};

/// Points of the Monte Carlo integrals.
const POINTS: usize = 20_000;

fn templates(rng: &mut Xoshiro256PlusPlus) -> Vec<Polyhedron> {
    let kinds =
        [TemplateKind::Cuts(24), TemplateKind::Cuboid(0.2), TemplateKind::Voronoi, TemplateKind::Cuts(8)];
    let form = Form { elongation: 0.8, flatness: 0.6 };
    kinds.into_iter().map(|kind| draw_template(kind, form, rng).unwrap().normalized()).collect()
}

fn polyhedra(templates: Vec<Polyhedron>, rng: &mut Xoshiro256PlusPlus) -> Solids {
    let count = templates.len() as u32;
    let poses = (0..count).map(|i| pose([f64::from(i), 1.0, 2.0], rng)).collect();
    let d_mm: Vec<f64> = (0..count).map(|i| 3.0 + f64::from(i)).collect();
    let template: Vec<u32> = (0..count).collect();
    Solids::of_polyhedra(templates, &template, &d_mm, poses)
}

fn pose(center: [f64; 3], rng: &mut Xoshiro256PlusPlus) -> Pose {
    Pose { center_mm: center.into(), orientation: uniform_orientation(rng) }
}

/// Share of the volume of a body below heights along an axis, by points at random in a cube around it.
fn shares_below(
    holds: impl Fn(Vector3<f64>) -> bool,
    half: f64,
    axis: usize,
    heights: &[f64],
    rng: &mut Xoshiro256PlusPlus,
) -> Vec<f64> {
    let (mut all, mut below) = (0_u32, vec![0_u32; heights.len()]);
    for _ in 0..POINTS {
        let p = Vector3::from_fn(|_, _| half * (2.0 * uniform(rng) - 1.0));
        if holds(p) {
            all += 1;
            for (count, height) in below.iter_mut().zip(heights) {
                *count += u32::from(p[axis] < *height);
            }
        }
    }
    below.into_iter().map(|count| f64::from(count) / f64::from(all)).collect()
}

/// Length of the line along z at an x and y from the centre.
fn chord_along_z_mm(grain: PlacedGrain<'_>, x: f64, y: f64) -> f64 {
    let ends = grain.chord_mm(&Vector3::new(x, y, 0.0), &Vector3::z());
    ends.map_or(0.0, |[enter, leave]| leave - enter)
}

/// The volume below one plane.
fn at(below: &VolumeBelow<'_>, height: f64) -> f64 {
    let [one, two] = [below.at(height, 1.0, 1)[0], below.at(height - 0.5, 0.25, 4)[2]];
    assert!((one - two).abs() < 1e-9 * one.max(1.0), "{one} {two}");
    one
}

/// Four standard deviations of a share of the points that fall in a body of a third of its cube.
const NOISE: f64 = 4.0 * 0.5 * 0.0123;

#[test]
fn ellipsoids_are_cut_as_balls_and_as_points_say() {
    let mut rng = stream(1, Stream::Shape);
    let shapes =
        [[4.0, 4.0, 4.0], [5.0, 3.0, 1.0], [9.0, 2.0, 2.0]].map(|axes| Ellipsoid::new(axes).unwrap());
    let poses = (0..3).map(|_| pose([0.0; 3], &mut rng)).collect();
    let grains = Solids::of_ellipsoids(shapes.into(), poses);
    let placed = PlacedGrains::new(&grains).unwrap();
    // A cap of the height h of a ball has the volume pi h² (r - h/3).
    let ball = placed.grain(0).volume_below(2);
    for height in [0.5, 1.0, 4.0, 6.5] {
        let cap = PI * height * height * (4.0 - height / 3.0);
        assert!((at(&ball, height - 4.0) - cap).abs() < 1e-12 * cap, "{height}");
    }
    for (grain, shape) in shapes.iter().enumerate() {
        for axis in 0..3 {
            let below = placed.grain(grain).volume_below(axis);
            let reach = below.reach_mm[1];
            let heights = [-0.8, -0.3, 0.1, 0.6].map(|u| u * reach);
            let half = shape.semi_axes_mm().x;
            let known = shares_below(|p| placed.grain(grain).contains(&p), half, axis, &heights, &mut rng);
            for (height, known) in heights.iter().zip(known) {
                let found = at(&below, *height) / shape.volume_mm3();
                // Slender ellipsoids fill little of their cube.
                assert!((found - known).abs() < 3.0 * NOISE, "{grain} {axis} {height}: {found} {known}");
            }
            assert_eq!((at(&below, -reach), at(&below, reach)), (0.0, shape.volume_mm3()));
        }
    }
}

#[test]
fn a_cuboid_is_cut_in_closed_form() {
    let edges = [2.0, 3.0, 6.0];
    let corner = |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 1 { edges[k] } else { 0.0 });
    let body = Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
    let scale = body.equivalent_diameter();
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI / 4.0);
    let turned = Pose { orientation: quarter, ..Pose::at(Vector3::zeros()) };
    let poses = vec![Pose::at(Vector3::zeros()), turned];
    let grains = Solids::of_polyhedra(vec![body.normalized()], &[0, 0], &[scale; 2], poses);
    let placed = PlacedGrains::new(&grains).unwrap();
    for (axis, edge) in edges.into_iter().enumerate() {
        let below = placed.grain(0).volume_below(axis);
        for u in [-0.49, -0.2, 0.0, 0.3, 0.5] {
            assert!((at(&below, u * edge) - 36.0 * (u + 0.5)).abs() < 1e-10, "{axis} {u}");
        }
    }
    // A rectangle of 2 x 3 on its corner, 6 thick: below the lowest other corner a triangle of the area h².
    let below = placed.grain(1).volume_below(0);
    let reach = 2.5 / 2.0_f64.sqrt();
    assert!((below.reach_mm[0] - reach).abs() < 1e-12);
    for h in [0.1, 0.7, 1.4] {
        assert!((at(&below, h - reach) - 6.0 * h * h).abs() < 1e-10, "{h}");
        assert!((at(&below, reach - h) - (36.0 - 6.0 * h * h)).abs() < 1e-10, "{h}");
    }
    let length_mm = |x, y| chord_along_z_mm(placed.grain(0), x, y);
    assert!((length_mm(0.99, 1.49) - 6.0).abs() < 1e-10 && length_mm(1.01, 0.0) == 0.0);
}

#[test]
fn the_mean_depth_of_a_triangle_is_that_of_its_points_whatever_heights_coincide() {
    let mut rng = stream(2, Stream::Shape);
    for heights in
        [[0.0, 1.0, 3.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, -1.0 + 1e-13, 4.0], [2.0, 2.0, 2.0]]
    {
        let points: Vec<f64> = (0..POINTS)
            .map(|_| {
                let (mut u, mut v) = (uniform(&mut rng), uniform(&mut rng));
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                (1.0 - u - v) * heights[0] + u * heights[1] + v * heights[2]
            })
            .collect();
        let extent = heights[2] - heights[0];
        for step in 0..=40 {
            let t = heights[0] + extent * f64::from(step) / 40.0;
            let found = mean_depth(heights, t);
            let known = points.iter().map(|height| (t - height).max(0.0)).sum::<f64>() / POINTS as f64;
            let noise = 4.0 * 0.3 * extent / (POINTS as f64).sqrt();
            assert!((found - known).abs() <= noise + 1e-12, "{heights:?} {t}: {found} {known}");
        }
    }
}

#[test]
fn polyhedra_are_cut_as_points_say_and_rounded_ones_within_their_bound() {
    let mut rng = stream(3, Stream::Shape);
    let sharp = templates(&mut rng);
    for rounding in [0.0, 0.05, 0.2] {
        let rounded: Vec<Polyhedron> =
            sharp.iter().map(|body| body.with_relative_rounding(rounding).unwrap()).collect();
        let grains = polyhedra(rounded, &mut rng);
        let placed = PlacedGrains::new(&grains).unwrap();
        for (grain, template) in grains.templates.iter().enumerate() {
            let (scale, rotation) = (grains.shapes[grain].d_mm(), grains.poses[grain].rotation());
            // A point is in the rounded body where no direction parts it from there: those of the planes of a body
            // that is hardly larger, and the distance from the core.
            let holds = |p: Vector3<f64>| {
                distance_from_core(template, &(rotation.transpose() * p / scale)) <= rounding
            };
            let volume = grains.shape(grain).volume_mm3();
            let bound = left_out(template).max(1e-12);
            assert!(bound < 0.02, "{rounding}: {bound}");
            let below = placed.grain(grain).volume_below(grain % 3);
            let reach = below.reach_mm[0].min(below.reach_mm[1]);
            let heights = [-0.7, -0.3, 0.0, 0.4, 0.8].map(|u| u * reach);
            let half = template.outer_radius() * scale;
            let known = shares_below(holds, half, grain % 3, &heights, &mut rng);
            for (height, known) in heights.iter().zip(known) {
                let found = at(&below, *height) / volume;
                assert!(
                    (found - known).abs() < 2.0 * NOISE + bound,
                    "{rounding} {grain} {height}: {found} {known}"
                );
            }
            // Chords add up to the volume, too.
            let (grain_of, steps) = (placed.grain(grain), 200);
            let reach = grain_of.outer_radius_mm();
            let step = 2.0 * reach / f64::from(steps);
            let at = |i: i32| (f64::from(i) + 0.5) * step - reach;
            let lengths = (0..steps).flat_map(|i| (0..steps).map(move |j| (at(i), at(j))));
            let sum = lengths.map(|(x, y)| chord_along_z_mm(grain_of, x, y)).sum::<f64>() * step * step;
            assert!((sum / volume - 1.0).abs() < 0.005, "{rounding} {grain}: {sum} {volume}");
        }
    }
}

/// Share of the volume of a template that its triangles leave out.
fn left_out(template: &Polyhedron) -> f64 {
    1.0 - 1.0 / TriangleSkin::new(&Convex::new(template), template.volume()).volume_ratio
}

#[test]
fn triangles_leave_out_little_of_rounded_bodies() {
    let mut rng = stream(1, Stream::Shape);
    let mut bodies = templates(&mut rng);
    bodies.extend(
        [samples::cuboid([1.0, 1.0, 1.0], 0.0), samples::octahedron(1.0)].map(|body| body.normalized()),
    );
    for (rounding, most) in [(0.0, 1e-12), (0.01, 0.001), (0.05, 0.005), (0.2, 0.015), (0.4, 0.05)] {
        for body in &bodies {
            let missing = left_out(&body.with_relative_rounding(rounding).unwrap());
            assert!((-1e-12..most).contains(&missing), "{rounding}: {missing}");
        }
    }
}

/// Distance of a point from the core of a body, by projections onto its half-spaces in turn (Dykstra 1983).
fn distance_from_core(body: &Polyhedron, point: &Vector3<f64>) -> f64 {
    let planes: Vec<_> = (0..body.faces().len()).map(|face| body.plane(face)).collect();
    if planes.iter().all(|(normal, height)| normal.dot(point) <= *height) {
        return 0.0;
    }
    if planes.iter().any(|(normal, height)| normal.dot(point) > height + body.rounding()) {
        return f64::INFINITY;
    }
    let mut corrections = vec![Vector3::zeros(); planes.len()];
    let mut at = *point;
    for _ in 0..40 {
        for ((normal, height), correction) in planes.iter().zip(&mut corrections) {
            let from = at + *correction;
            let above = (normal.dot(&from) - height).max(0.0);
            at = from - normal * above;
            *correction = from - at;
        }
    }
    (at - point).norm()
}
