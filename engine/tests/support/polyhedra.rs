//! Packings of polyhedra for tests of exports: random sequential addition by trial and error.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use super::engine::gap::polyhedra::Body;
use super::engine::packing::Solids;
use super::engine::request::Specimen;
use super::engine::shape::polyhedron::{TemplateKind, draw_template};
use super::engine::shape::{Ellipsoid, Form, Polyhedron, Pose, Solid};

/// Templates of all kinds with that rounding, a share of the equivalent diameter.
pub(crate) fn templates(rounding: f64) -> Vec<Polyhedron> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let kinds =
        [TemplateKind::Cuts(12), TemplateKind::Cuboid(0.2), TemplateKind::Voronoi, TemplateKind::Cuts(20)];
    kinds
        .into_iter()
        .map(|kind| {
            let form = Form { elongation: 0.8, flatness: 0.75 };
            let template = draw_template(kind, form, &mut rng).unwrap();
            template.with_relative_rounding(rounding).unwrap().normalized()
        })
        .collect()
}

fn unit(rng: &mut Xoshiro256PlusPlus) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Grains with diameters from `d_mm` down to a share of it, that keep a gap from each other and from walls.
pub(crate) fn packed(
    specimen: &Specimen,
    grains: usize,
    d_mm: [f64; 2],
    gap_mm: f64,
    rounding: f64,
) -> Solids {
    let mut packed = Solids { templates: templates(rounding), ..Solids::default() };
    let mut bodies: Vec<Body> = Vec::new();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let bounds = Vector3::from(specimen.bounds_mm());
    let shifts: &[f64] = if specimen.is_periodic() { &[0.0, -1.0, 1.0] } else { &[0.0] };
    for grain in 0..grains {
        let d = d_mm[0] * (d_mm[1] / d_mm[0]).powf(grain as f64 / (grains.max(2) - 1) as f64);
        let which = grain % packed.templates.len();
        let template = &packed.templates[which];
        let (body, pose) = (0..200_000)
            .find_map(|_| {
                let center_mm = bounds.map(|length| length * unit(&mut rng));
                let [w, x, y, z] = [(); 4].map(|()| unit(&mut rng) - 0.5);
                let q = Quaternion::new(w, x, y, z);
                let pose = Pose { center_mm, orientation: UnitQuaternion::new_normalize(q) };
                let body = Body::new(template, d, &pose);
                let clears = clears_walls(specimen, template, d, &pose, gap_mm)
                    && bodies.iter().all(|other| {
                        shifts.iter().all(|x| {
                            shifts.iter().all(|y| {
                                shifts.iter().all(|z| {
                                    let moved = center_mm + Vector3::new(*x, *y, *z).component_mul(&bounds);
                                    other.with_at(&body, moved).decide(gap_mm).is_apart
                                })
                            })
                        })
                    });
                clears.then_some((body, pose))
            })
            .expect("no place is left");
        bodies.push(body);
        packed.shapes.push(Solid::Polyhedron { template: which as u32, d_mm: d });
        packed.poses.push(pose);
    }
    packed
}

/// The same with an ellipsoid in place of every second polyhedron, which lies inside of it.
#[allow(dead_code)]
pub(crate) fn mixed(
    specimen: &Specimen,
    grains: usize,
    d_mm: [f64; 2],
    gap_mm: f64,
    rounding: f64,
) -> Solids {
    let mut packed = packed(specimen, grains, d_mm, gap_mm, rounding);
    let mut rows: Vec<(Solid, Pose)> =
        packed.shapes.iter().copied().zip(packed.poses.iter().copied()).collect();
    for (shape, _) in rows.iter_mut().step_by(2) {
        let radius = packed.templates[shape.template().unwrap() as usize].inner_radius() * shape.d_mm();
        *shape = Ellipsoid::new([radius, 0.8 * radius, 0.6 * radius]).unwrap().into();
    }
    rows.sort_by(|p, q| q.0.d_mm().total_cmp(&p.0.d_mm()));
    (packed.shapes, packed.poses) = rows.into_iter().unzip();
    packed
}

fn clears_walls(specimen: &Specimen, template: &Polyhedron, d: f64, pose: &Pose, gap_mm: f64) -> bool {
    let margin = gap_mm + d * template.rounding();
    template.world_vertices_mm(d, pose).all(|p| match *specimen {
        Specimen::Box { size_mm, .. } => {
            specimen.is_periodic() || (0..3).all(|a| p[a] >= margin && p[a] <= size_mm[a] - margin)
        }
        Specimen::Cylinder { diameter_mm, height_mm } => {
            let radius = diameter_mm / 2.0;
            let from_axis = (p.x - radius).hypot(p.y - radius);
            from_axis <= radius - margin && p.z >= margin && p.z <= height_mm - margin
        }
    })
}
