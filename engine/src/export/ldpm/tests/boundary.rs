use std::sync::Arc;

use crate::properties::properties;
use proptest::prelude::*;
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::super::nodes::{Nodes, lay};
use super::super::surface::Surface;
use super::super::{BoundaryNodes, LatticeOptions};
use super::{in_box, in_cylinder, with_clearance};
use crate::Unattended;
use crate::grain::PlacedGrains;
use crate::packing::Spheres;
use crate::request::{Boundary, Specimen};
use crate::rng::uniform;

fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    (0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f64>().sqrt()
}

fn laid(specimen: &Specimen, spheres: &Spheres, options: &LatticeOptions) -> Nodes<'static> {
    let grains = Arc::new(PlacedGrains::new(spheres).unwrap());
    let nodes = lay(specimen, &grains, options, &Unattended).unwrap();
    Nodes { grains: None, ..nodes }
}

/// Smallest distance of two nodes on the surface.
fn smallest_spacing(nodes: &Nodes<'_>) -> f64 {
    let surface = &nodes.points_mm[..nodes.boundary];
    let pairs =
        surface.iter().enumerate().flat_map(|(i, &p)| surface[..i].iter().map(move |&q| distance(p, q)));
    pairs.fold(f64::INFINITY, f64::min)
}

/// Poisson disks that are full: no two nodes are too near, and wherever a node may lie there is one.
fn assert_full(specimen: &Specimen, spheres: &Spheres, options: &LatticeOptions) {
    let nodes = laid(specimen, spheres, options);
    let d_min = spheres.d_mm.iter().copied().fold(f64::INFINITY, f64::min);
    let (spacing, clear) = (options.spacing * d_min, options.fictitious_diameter * d_min / 2.0);
    let vertices = Surface::of(specimen).vertices.len();
    let between_vertices = nodes.points_mm[..vertices]
        .iter()
        .enumerate()
        .flat_map(|(i, &p)| nodes.points_mm[..i].iter().map(move |&q| distance(p, q)))
        .fold(f64::INFINITY, f64::min);
    let least = smallest_spacing(&nodes);
    assert!(least >= spacing.min(between_vertices) * (1.0 - 1e-12), "{least} < {spacing}");
    let surface = &nodes.points_mm[..nodes.boundary];
    let blocked = |p: [f64; 3]| {
        (0..spheres.len()).any(|i| distance(p, spheres.center(i)) < spheres.d_mm[i] / 2.0 + clear)
    };
    for &p in &surface[vertices..] {
        let nearest = (0..spheres.len())
            .map(|i| distance(p, spheres.center(i)) - spheres.d_mm[i] / 2.0)
            .fold(f64::INFINITY, f64::min);
        assert!(nearest >= clear * (1.0 - 1e-12), "{nearest} < {clear}");
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut asked = 0;
    let mut assert_near_a_node = |p: [f64; 3]| {
        if !blocked(p) {
            asked += 1;
            let nearest = surface.iter().map(|&q| distance(p, q)).fold(f64::INFINITY, f64::min);
            assert!(nearest <= spacing * (1.0 + 1e-9), "no node within {nearest} of {p:?}, not {spacing}");
        }
    };
    let shape = Surface::of(specimen);
    for face in shape.faces {
        for _ in 0..2000 {
            let uv = face.size().map(|side| side * uniform(&mut rng));
            if face.has(uv) {
                assert_near_a_node(face.at(uv));
            }
        }
    }
    // On a lateral surface, where a node may lie is a ruling.
    if let Some(lateral) = shape.lateral {
        let is_on_lateral = |p: &&[f64; 3]| {
            ((p[0] - lateral.radius).hypot(p[1] - lateral.radius) - lateral.radius).abs() < 1e-9
        };
        let on_lateral: Vec<_> = surface.iter().filter(is_on_lateral).collect();
        for _ in 0..2000 {
            let node = on_lateral[(uniform(&mut rng) * on_lateral.len() as f64) as usize];
            assert_near_a_node([node[0], node[1], lateral.height * uniform(&mut rng)]);
        }
    }
    assert!(asked > 1000, "the grains left {asked} places to look at");
}

#[test]
fn disks_fill_the_surface_around_grains() {
    for (specimen, spheres) in [in_box(), in_cylinder(), with_clearance()] {
        assert_full(&specimen, &spheres, &LatticeOptions::default());
        assert_full(
            &specimen,
            &spheres,
            &LatticeOptions { spacing: 1.1, seed: 5, ..LatticeOptions::default() },
        );
    }
}

#[test]
fn nodes_follow_from_the_seed() {
    let (specimen, spheres) = in_cylinder();
    let of_seed = |seed| laid(&specimen, &spheres, &LatticeOptions { seed, ..LatticeOptions::default() });
    assert_eq!(of_seed(1).points_mm, of_seed(1).points_mm);
    assert_ne!(of_seed(1).points_mm, of_seed(2).points_mm);
}

#[test]
fn nodes_lie_on_the_surface_to_the_last_bit_where_it_is_plane() {
    let (specimen, spheres) = in_box();
    let nodes = laid(&specimen, &spheres, &LatticeOptions::default());
    let size = specimen.bounds_mm();
    for p in &nodes.points_mm[..nodes.boundary] {
        assert!((0..3).any(|a| p[a] == 0.0 || p[a] == size[a]), "{p:?}");
    }
    let (specimen, spheres) = in_cylinder();
    let nodes = laid(&specimen, &spheres, &LatticeOptions::default());
    for p in &nodes.points_mm[..nodes.boundary] {
        let off_axis = (p[0] - 20.0).hypot(p[1] - 20.0);
        assert!(p[2] == 0.0 || p[2] == 30.0 || (off_axis - 20.0).abs() < 1e-13, "{p:?}");
    }
}

#[test]
fn random_nodes_are_as_many_as_asked_for() {
    let (specimen, spheres) = with_clearance();
    let options =
        LatticeOptions { boundary_nodes: BoundaryNodes::Random, spacing: 2.0, ..LatticeOptions::default() };
    let nodes = laid(&specimen, &spheres, &options);
    let spacing = 2.0 * nodes.d_min_mm;
    assert!(nodes.complete);
    assert_eq!(nodes.on_vertices, 8);
    assert_eq!(nodes.on_edges, 12 * (40.0 / spacing) as usize);
    let on_faces = nodes.boundary - nodes.on_edges - nodes.on_vertices;
    assert_eq!(on_faces, 6 * (1600.0 / (spacing * spacing)) as usize);
    assert!(smallest_spacing(&nodes) >= 1.1 * nodes.d_min_mm);
}

/// At a spacing of 1.1 the faces would have to be covered by 0.785: random disks never come beyond 0.547.
#[test]
fn random_nodes_end_where_no_place_is_left_and_say_so() {
    let (specimen, spheres) = with_clearance();
    let options =
        LatticeOptions { boundary_nodes: BoundaryNodes::Random, spacing: 1.1, ..LatticeOptions::default() };
    let nodes = laid(&specimen, &spheres, &options);
    assert!(!nodes.complete);
    let on_faces = nodes.boundary - nodes.on_edges - nodes.on_vertices;
    assert!(on_faces > 100, "{on_faces}");
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// Thin, long, tiny against their grain, and grains that touch walls or reach almost through.
    #[test]
    fn any_specimen_is_covered(
        size in [6.0..40.0_f64, 6.0..40.0_f64, 6.0..40.0_f64],
        cylinder in any::<bool>(),
        at in [0.0..1.0_f64, 0.0..1.0_f64, 0.0..1.0_f64],
        share in 0.2..1.0_f64,
        spacing in 1.1..3.0_f64,
    ) {
        let specimen = if cylinder {
            Specimen::Cylinder { diameter_mm: size[0], height_mm: size[2] }
        } else {
            Specimen::Box { size_mm: size, boundary: Boundary::Walls }
        };
        let d = share * size.into_iter().fold(f64::INFINITY, f64::min);
        let region = specimen.center_region(d / 2.0).unwrap();
        let p: [f64; 3] = std::array::from_fn(|a| region.low[a] + at[a] * (region.high[a] - region.low[a]));
        let mut spheres = Spheres::default();
        spheres.push(if region.contains(p) { p } else { specimen.bounds_mm().map(|x| x / 2.0) }, d);
        // Small beside the first, so that the spacing is, too.
        spheres.push([0.05 * d; 3].map(|x| x + size[0] / 2.0), d / 8.0);
        let nodes = laid(&specimen, &spheres, &LatticeOptions { spacing, ..LatticeOptions::default() });
        let spacing = spacing * d / 8.0;
        prop_assert!(smallest_spacing(&nodes) >= spacing * (1.0 - 1e-12));
        prop_assert!(nodes.boundary > 8);
    }
}
