#![allow(clippy::unwrap_used)]

use super::scene::Hit;
use super::*;

use crate::control::Unattended;
use crate::packing::Spheres;
use crate::request::{Boundary, Specimen};

/// Width, height and pixels of a picture.
fn decoded(bytes: &[u8]) -> (usize, usize, Vec<[u8; 3]>) {
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let rows = pixels.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    (info.width as usize, info.height as usize, rows)
}

fn picture(specimen: &Specimen, spheres: &Spheres, pixels: u32, threads: usize) -> Vec<u8> {
    let mut out = Vec::new();
    let options = PictureOptions { pixels, threads };
    write(&Model::new(specimen, spheres), &options, &Unattended, &mut out).unwrap();
    out
}

/// A lattice of spheres of 4 mm in a region of 40 mm.
fn lattice() -> Spheres {
    let mut spheres = Spheres::with_capacity(512);
    for i in 0..512 {
        let at = |n: usize| 2.5 + 5.0 * (n % 8) as f64;
        spheres.push([at(i), at(i / 8), at(i / 64)], 4.0);
    }
    spheres
}

fn cube(boundary: Boundary) -> Specimen {
    Specimen::Box { size_mm: [40.0; 3], boundary }
}

#[test]
fn the_bytes_do_not_depend_on_the_threads() {
    let specimen = cube(Boundary::Walls);
    let one = picture(&specimen, &lattice(), 300, 1);
    assert!(one == picture(&specimen, &lattice(), 300, 1));
    assert!(one == picture(&specimen, &lattice(), 300, 3));
}

#[test]
fn the_specimen_touches_all_four_sides() {
    for specimen in [
        cube(Boundary::Walls),
        Specimen::Box { size_mm: [40.0, 80.0, 20.0], boundary: Boundary::Walls },
        Specimen::Cylinder { diameter_mm: 40.0, height_mm: 80.0 },
    ] {
        let (width, height, pixels) = decoded(&picture(&specimen, &Spheres::default(), 400, 1));
        assert_eq!(width.max(height), 400);
        let dark = |x: usize, y: usize| pixels[y * width + x][0] < 128;
        let margin = 4;
        for (name, found) in [
            ("left", (0..height).any(|y| (0..margin).any(|x| dark(x, y)))),
            ("right", (0..height).any(|y| (width - margin..width).any(|x| dark(x, y)))),
            ("top", (0..width).any(|x| (0..margin).any(|y| dark(x, y)))),
            ("bottom", (0..width).any(|x| (height - margin..height).any(|y| dark(x, y)))),
        ] {
            assert!(found, "{specimen:?}: nothing at the {name}");
        }
    }
}

/// Every ray agrees with a search over all grains without a grid.
#[test]
fn the_grid_finds_the_nearest_grain() {
    for (specimen, spheres) in [
        (cube(Boundary::Walls), lattice()),
        (cube(Boundary::Periodic), shifted(&lattice(), 1.7)),
        (Specimen::Cylinder { diameter_mm: 40.0, height_mm: 40.0 }, within_cylinder(&lattice())),
    ] {
        let grains = PlacedGrains::new(&spheres).unwrap();
        let scene = Scene::new(&Model::new(&specimen, &spheres), &grains).unwrap();
        let view = View::framing(&specimen, 90);
        let mut found = [0; 3];
        for y in 0..view.pixels[1] {
            for x in 0..view.pixels[0] {
                let through = view.unproject([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                match scene.trace(through) {
                    Hit::Grain { grain, at, depth } => {
                        let surface = at + view.eye * depth;
                        assert_eq!(nearest(&scene, &surface, &-view.eye), Some(grain));
                        found[0] += 1;
                    }
                    Hit::Cut { at, grain, .. } => {
                        let around = |i: &u32| (at - scene.grain(*i).center).norm() < scene.grain(*i).radius;
                        assert_eq!((0..scene.len() as u32).find(around), grain);
                        found[1] += 1;
                    }
                    Hit::Face { at, grain, .. } => {
                        assert!((at - scene.grain(grain).center).norm() < scene.grain(grain).radius);
                        found[2] += 1;
                    }
                    Hit::Background | Hit::Deep { .. } => {}
                }
            }
        }
        assert!(found[0] > 500 && found[1] > 500, "{specimen:?}: {found:?}");
        assert_eq!(found[2] > 0, specimen.is_periodic(), "{specimen:?}");
    }
}

fn nearest(scene: &Scene<'_>, from: &scene::Vector, direction: &scene::Vector) -> Option<u32> {
    let mut best: Option<(f64, u32)> = None;
    for i in 0..scene.len() as u32 {
        let grain = scene.grain(i);
        let to = grain.center - from;
        let along = to.dot(direction);
        let root = grain.radius * grain.radius - (to - direction * along).norm_squared();
        if root > 1e-12 {
            let t = along - root.sqrt();
            if t >= 0.0 && best.is_none_or(|(nearest, _)| t < nearest) {
                best = Some((t, i));
            }
        }
    }
    best.map(|(_, i)| i)
}

fn shifted(spheres: &Spheres, by: f64) -> Spheres {
    let mut moved = spheres.clone();
    for column in [&mut moved.x_mm, &mut moved.y_mm, &mut moved.z_mm] {
        for x in column {
            *x = (*x + by) % 40.0;
        }
    }
    moved
}

fn within_cylinder(spheres: &Spheres) -> Spheres {
    let mut inside = Spheres::default();
    for i in 0..spheres.len() {
        let [x, y, z] = spheres.center(i);
        if (x - 20.0).hypot(y - 20.0) <= 18.0 {
            inside.push([x, y, z], spheres.d_mm[i]);
        }
    }
    inside
}

/// A sphere appears at its true diameter: its disc in the cut plane covers the pixels of its area, as seen.
#[test]
fn a_sphere_has_its_true_size_in_the_picture() {
    let specimen = cube(Boundary::Walls);
    let mut spheres = Spheres::default();
    // In the corner next to the eye, below the cut, before everything else.
    spheres.push([36.0, 4.0, 10.0], 8.0);
    let grains = PlacedGrains::new(&spheres).unwrap();
    let scene = Scene::new(&Model::new(&specimen, &spheres), &grains).unwrap();
    let view = View::framing(&specimen, 700);
    let mut columns = Vec::new();
    for y in 0..view.pixels[1] {
        for x in 0..view.pixels[0] {
            let through = view.unproject([f64::from(x) + 0.5, f64::from(y) + 0.5]);
            if matches!(scene.trace(through), Hit::Grain { .. }) {
                columns.push(x);
            }
        }
    }
    let (low, high) = (columns.iter().min().unwrap(), columns.iter().max().unwrap());
    let diameter_mm = f64::from(high - low + 1) / view.pixels_per_mm;
    assert!((diameter_mm - 8.0).abs() < 2.0 / view.pixels_per_mm, "{diameter_mm}");
}

#[test]
fn a_stop_ends_the_work() {
    struct Stopped;
    impl Control for Stopped {
        fn report(&self, _: &crate::Progress) {}
        fn should_stop(&self) -> bool {
            true
        }
    }
    let (specimen, spheres) = (cube(Boundary::Walls), lattice());
    let ended =
        write(&Model::new(&specimen, &spheres), &PictureOptions::default(), &Stopped, &mut Vec::new());
    assert!(matches!(ended, Err(ExportError::Stopped)));
}

/// Cubes and octahedra, sharp and rounded, are seen as what they are: a ray meets a cube where it lies.
#[test]
fn polyhedra_are_rendered_and_the_bytes_do_not_depend_on_the_threads() {
    let specimen = cube(Boundary::Walls);
    for rounding in [0.0, 0.08] {
        let grains = crate::export::polyhedra_samples::packed(&specimen, 40, [9.0, 6.0], 0.5, rounding);
        let model = Model::new(&specimen, &grains);
        let picture = |threads| {
            let mut out = Vec::new();
            write(&model, &PictureOptions { pixels: 200, threads }, &Unattended, &mut out).unwrap();
            out
        };
        let one = picture(1);
        assert!(one == picture(2));
        // Points of rays that hit grains lie on their surfaces, and normals point towards the eye.
        let placed = PlacedGrains::new(model.grains).unwrap();
        let scene = Scene::new(&model, &placed).unwrap();
        let view = View::framing(&specimen, 200);
        let templates = crate::geometry::convex::Convex::all(&grains.templates);
        let mut hits = 0;
        for y in 0..view.pixels[1] {
            for x in 0..view.pixels[0] {
                let hit = scene.trace(view.unproject([f64::from(x) + 0.5, f64::from(y) + 0.5]));
                if let Hit::Grain { grain, at, .. } = hit {
                    let row = scene.grain(grain).number as usize;
                    let place =
                        crate::geometry::convex::Place::new(grains.shapes[row].d_mm(), &grains.poses[row]);
                    let template = &templates[grains.shapes[row].template().unwrap() as usize];
                    assert!(template.distance(&place.local(&at)).abs() < 1e-9);
                    assert!(scene.grain(grain).normal(&at).dot(&view.eye) > -1e-9);
                    hits += 1;
                }
            }
        }
        assert!(hits > 500, "{hits}");
    }
}
