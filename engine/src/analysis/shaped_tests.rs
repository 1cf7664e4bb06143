//! Pair correlations and profiles of shaped grains, against closed forms and those of spheres.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::analysis::{DepthProfile, RadialOptions, Surface, depth_profiles, measured_grains, radial};
use crate::distance::DistanceRule;
use crate::mix::uniform_orientation;
use crate::packing::{GrainsRef, Solids, Spheres};
use crate::request::{Boundary, Distance, Specimen};
use crate::rng::{Stream, stream, uniform};
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{Ellipsoid, Form, Polyhedron, Pose};

fn specimens() -> [Specimen; 3] {
    [
        Specimen::Box { size_mm: [30.0; 3], boundary: Boundary::Periodic },
        Specimen::Box { size_mm: [24.0, 30.0, 40.0], boundary: Boundary::Walls },
        Specimen::Cylinder { diameter_mm: 30.0, height_mm: 40.0 },
    ]
}

/// Poses anywhere that keeps so much from the walls, by grain.
fn poses(specimen: &Specimen, clearances: impl Iterator<Item = f64>, seed: u64) -> Vec<Pose> {
    let mut rng = stream(seed, Stream::Rsa);
    let mut pose = |clearance| {
        let region = specimen.center_region(clearance).unwrap();
        loop {
            let p: [f64; 3] =
                std::array::from_fn(|a| region.low[a] + uniform(&mut rng) * (region.high[a] - region.low[a]));
            if region.contains(p) {
                return Pose { center_mm: Vector3::from(p), orientation: uniform_orientation(&mut rng) };
            }
        }
    };
    clearances.map(&mut pose).collect()
}

fn ellipsoids(sizes: &[[f64; 3]]) -> Vec<Ellipsoid> {
    let mut shapes: Vec<Ellipsoid> = sizes.iter().map(|&axes| Ellipsoid::new(axes).unwrap()).collect();
    shapes.sort_by(|p, q| q.equivalent_diameter_mm().total_cmp(&p.equivalent_diameter_mm()));
    shapes
}

#[test]
fn ellipsoids_at_random_are_not_correlated_at_any_distance_in_any_specimen() {
    let sizes: Vec<[f64; 3]> =
        (0..6000).map(|i| if i < 400 { [1.6, 1.0, 0.5] } else { [0.4, 0.3, 0.1] }).collect();
    let shapes = ellipsoids(&sizes);
    for specimen in specimens() {
        let inner = shapes.iter().map(|shape| shape.semi_axes_mm().z);
        let grains = Solids::of_ellipsoids(shapes.clone(), poses(&specimen, inner, 3));
        let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
        // Coarse grains are nearer than their equivalent radii; fine ones would be at negative distances there.
        let options = RadialOptions {
            upper_mm: &[1.0, 2.0],
            min_gap_mm: -1.2,
            max_gap_mm: 4.8,
            bins: 24,
            max_references: 20_000,
        };
        let found = radial(&grains, &specimen, &rule, &options).unwrap();
        assert_eq!(found.len(), 2);
        for class in &found {
            let (mut seen, mut chi2) = (0, 0.0);
            for (&pairs, &expected) in class.pairs.iter().zip(&class.expected) {
                assert!(expected >= 0.0 && (expected > 0.0 || pairs == 0));
                if expected < 50.0 {
                    continue;
                }
                seen += 1;
                let error = (pairs as f64 - expected) / (2.0 * expected).sqrt();
                assert!(error.abs() < 5.0, "{specimen:?} {:?}: {pairs} instead of {expected}", class.class);
                chi2 += error * error;
                // Bins share the fluctuation of the density, which is larger than the noise of those with many pairs.
                let is_uncorrelated = (pairs as f64 / expected - 1.0).abs() < 0.05;
                assert!(expected < 5000.0 || is_uncorrelated, "{specimen:?}: {pairs} instead of {expected}");
            }
            assert!(seen >= 18, "{specimen:?} {:?}: {seen} bins only", class.class);
            assert!(chi2 / f64::from(seen) < 4.0, "{specimen:?} {:?}: {chi2} in {seen} bins", class.class);
            assert!((class.gap_mm[0] + 1.2 - 0.125).abs() < 1e-12);
        }
    }
}

#[test]
fn balls_as_ellipsoids_have_the_correlation_and_the_profiles_of_spheres() {
    let specimen = specimens()[2];
    let d_mm: Vec<f64> = (0..300).map(|i| if i < 100 { 4.0 } else { 2.0 }).collect();
    let shapes: Vec<Ellipsoid> = d_mm.iter().map(|&d| Ellipsoid::sphere(d).unwrap()).collect();
    let grains = Solids::of_ellipsoids(shapes, poses(&specimen, d_mm.iter().map(|d| d / 2.0), 5));
    let mut spheres = Spheres::default();
    for (pose, &d) in grains.poses.iter().zip(&d_mm) {
        spheres.push(pose.center_mm.into(), d);
    }
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let options = RadialOptions {
        upper_mm: &[2.0, 4.0],
        min_gap_mm: 0.0,
        max_gap_mm: 5.0,
        bins: 10,
        max_references: 1000,
    };
    let [of_grains, of_spheres] = [
        radial(&grains, &specimen, &rule, &options).unwrap(),
        radial(&spheres, &specimen, &rule, &options).unwrap(),
    ];
    for (found, known) in of_grains.iter().zip(&of_spheres) {
        assert_eq!((&found.pairs, &found.gap_mm), (&known.pairs, &known.gap_mm));
        for (found, known) in found.expected.iter().zip(&known.expected) {
            assert!((found - known).abs() < 1e-9 * known, "{found} {known}");
        }
    }
    let [found, known] = [(&grains).into(), (&spheres).into()]
        .map(|grains: GrainsRef<'_>| depth_profiles(grains, &specimen, 8.0, 200).unwrap());
    for (found, known) in found.iter().zip(&known) {
        assert_eq!((found.surface, &found.depth_mm), (known.surface, &known.depth_mm));
        let most = known.volume_fraction.iter().copied().fold(0.0, f64::max);
        for (found, known) in found.volume_fraction.iter().zip(&known.volume_fraction) {
            assert!((found - known).abs() < 0.01 * most, "{found} {known}");
        }
    }
    assert_eq!(found.len(), 2);
}

/// Volume of the grains of a profile that reaches to the middle of the specimen, over that of the specimen.
fn mean(profile: &DepthProfile, radius: f64) -> f64 {
    let count = profile.depth_mm.len() as f64;
    let weight = |depth: f64| match profile.surface {
        Surface::Faces | Surface::Ends => 1.0,
        Surface::Lateral => 2.0 * (radius - depth) / radius,
    };
    let shares = profile.depth_mm.iter().zip(&profile.volume_fraction);
    shares.map(|(&depth, share)| weight(depth) * share).sum::<f64>() / count
}

#[test]
fn profiles_of_shapes_add_up_to_the_volume_of_the_grains() {
    let mut rng = stream(4, Stream::Shape);
    let form = Form { elongation: 0.7, flatness: 0.6 };
    let templates: Vec<Polyhedron> = [TemplateKind::Cuts(20), TemplateKind::Cuboid(0.2)]
        .into_iter()
        .flat_map(|kind| {
            let sharp = draw_template(kind, form, &mut rng).unwrap().normalized();
            [sharp.with_relative_rounding(0.1).unwrap(), sharp]
        })
        .collect();
    let d_mm: Vec<f64> = (0..200).map(|i| if i < 50 { 4.0 } else { 2.0 }).collect();
    for specimen in [
        Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls },
        Specimen::Cylinder { diameter_mm: 20.0, height_mm: 30.0 },
    ] {
        let template: Vec<u32> = (0..200).map(|i| i % 4).collect();
        let outer = d_mm.iter().zip(&template).map(|(d, &t)| d * templates[t as usize].outer_radius());
        let angular = Solids::of_polyhedra(templates.clone(), &template, &d_mm, poses(&specimen, outer, 6));
        let shapes: Vec<Ellipsoid> =
            d_mm.iter().map(|d| Ellipsoid::with_equivalent_diameter(*d, form).unwrap()).collect();
        let long = shapes.iter().map(|shape| shape.semi_axes_mm().x);
        let smooth = Solids::of_ellipsoids(shapes.clone(), poses(&specimen, long, 7));
        let volume: f64 = d_mm.iter().map(|d| PI / 6.0 * d * d * d).sum();
        let known = volume / specimen.volume_mm3();
        for grains in [GrainsRef::from(&angular), GrainsRef::from(&smooth)] {
            let profiles = depth_profiles(grains, &specimen, 100.0, 150).unwrap();
            assert!(!profiles.is_empty());
            for profile in profiles {
                let tolerance = if profile.surface == Surface::Lateral { 0.01 } else { 1e-9 };
                let found = mean(&profile, 10.0);
                assert!((found / known - 1.0).abs() < tolerance, "{:?}: {found} {known}", profile.surface);
            }
        }
    }
    let periodic = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Periodic };
    let none = Solids::default();
    assert_eq!(depth_profiles(&none, &periodic, 10.0, 10).unwrap(), []);
}

#[test]
fn forms_and_sizes_of_polyhedra_are_those_of_their_templates() {
    let cube = Polyhedron::hull_of(
        &(0..8).map(|i| Vector3::from_fn(|axis, _| f64::from(i >> axis & 1))).collect::<Vec<_>>(),
    );
    let cube = cube.unwrap();
    let d = cube.equivalent_diameter();
    let poses = vec![Pose::at(Vector3::zeros()); 2];
    let grains = Solids::of_polyhedra(vec![cube.normalized()], &[0, 0], &[10.0 * d, d], poses);
    let measured = measured_grains(&grains).unwrap();
    for (grain, edge) in measured.iter().zip([10.0, 1.0]) {
        for (found, known) in [
            (grain.sizes.volume_mm3, edge * edge * edge),
            (grain.sizes.thickness_mm, edge),
            (grain.sizes.sieve_mm, edge),
            (grain.sizes.length_mm, edge * 3.0_f64.sqrt()),
        ] {
            assert!((found / known - 1.0).abs() < 1e-9, "{found} {known}");
        }
        assert!((grain.form.elongation - 1.0).abs() < 1e-9);
    }
    assert_eq!(measured_grains(&Spheres::default()), None);
}
