//! Grains as lines and planes cut them: sections at a height, chords along x, and whether a point lies inside.
//!
//! For an ellipsoid with the shape matrix `A` and its inverse `M`, the points with `(p - x) · M (p - x) <= 1`, the
//! section at a height `dz` above the centre `x` is the ellipse around `(A_xz, A_yz) dz / A_zz` with the matrix of the
//! Schur complement of `A_zz`, scaled by `1 - dz² / A_zz`; a chord along x follows from the quadratic equation in x.
//! Chords of polyhedra are computed in the axes of their template (`convex`).

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::convex::{Convex, Place};
use crate::memory::{OutOfMemory, collected};
use crate::packing::{Ellipsoids, GrainsRef, Polyhedra, Spheres};

/// The grains of a packing.
pub(super) enum Solids<'a> {
    Spheres(&'a Spheres),
    Ellipsoids { grains: &'a Ellipsoids, forms: Vec<Form> },
    Polyhedra { grains: &'a Polyhedra, templates: Vec<Convex>, half_extents: Vec<[f64; 3]> },
}

/// What the sections of an ellipsoid are computed from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Form {
    /// Shape matrix `A` in mm².
    shape: Matrix3<f64>,
    /// Its inverse, in 1/mm².
    inverse: Matrix3<f64>,
}

/// The section of a grain by a plane across z.
pub(super) enum Section<'a> {
    Disc {
        center: [f64; 2],
        radius: f64,
    },
    Ellipse {
        center: [f64; 2],
        /// Half of its extent along y.
        half_y: f64,
        /// The step of the middle of a chord along x, per step in y.
        shear: f64,
        /// Half of the chord along x through the centre.
        half_x: f64,
    },
    Polyhedron {
        template: &'a Convex,
        /// Centre of the grain, x and y.
        center: [f64; 2],
        /// Half of the extent of the whole grain along y.
        half_y: f64,
        /// The point of the plane above the centre, in the axes and the unit of the template.
        above: Vector3<f64>,
        /// Steps of a mm along x and along y there.
        steps: [Vector3<f64>; 2],
    },
}

impl<'a> Solids<'a> {
    /// The grains of a packing, with what sections are computed from: 144 bytes an ellipsoid, 24 a polyhedron.
    ///
    /// # Errors
    /// The system refused memory.
    pub(super) fn new(grains: GrainsRef<'a>) -> Result<Self, OutOfMemory> {
        Ok(match grains {
            GrainsRef::Spheres(spheres) => Self::Spheres(spheres),
            GrainsRef::Ellipsoids(grains) => {
                let form = |row: usize| {
                    let (shape, pose) = (&grains.shapes[row], &grains.poses[row]);
                    let inverse_squares = shape.semi_axes_mm().map(|axis| 1.0 / (axis * axis));
                    let rotation = pose.rotation();
                    let inverse = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
                    Form { shape: shape.matrix_mm2(pose), inverse }
                };
                Self::Ellipsoids { grains, forms: collected((0..grains.len()).map(form))? }
            }
            GrainsRef::Polyhedra(grains) => {
                let templates = Convex::all(&grains.templates);
                let half_extents = |grain: usize| {
                    let Place { rotation, scale, .. } = Place::new(grains, grain);
                    let template = &templates[grains.template[grain] as usize];
                    [0, 1, 2].map(|axis| {
                        let row = rotation.row(axis).transpose();
                        let reaches = template.vertices.iter().map(|vertex| row.dot(vertex).abs());
                        scale * (reaches.fold(0.0, f64::max) + template.rounding)
                    })
                };
                let half_extents = collected((0..grains.len()).map(half_extents))?;
                Self::Polyhedra { grains, templates, half_extents }
            }
        })
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Spheres(spheres) => spheres.len(),
            Self::Ellipsoids { grains, .. } => grains.len(),
            Self::Polyhedra { grains, .. } => grains.len(),
        }
    }

    pub(super) fn center(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => spheres.center(grain),
            Self::Ellipsoids { grains, .. } => grains.poses[grain].center_mm.into(),
            Self::Polyhedra { grains, .. } => grains.poses[grain].center_mm.into(),
        }
    }

    /// Volume in mm³.
    pub(super) fn volume_mm3(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let d = spheres.d_mm[grain];
                PI / 6.0 * d * d * d
            }
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].volume_mm3(),
            Self::Polyhedra { grains, .. } => grains.shape(grain).volume_mm3(),
        }
    }

    /// Half of the extents along x, y and z; of polyhedra the farther half.
    pub(super) fn half_extents(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => [spheres.d_mm[grain] / 2.0; 3],
            Self::Ellipsoids { forms, .. } => forms[grain].shape.diagonal().map(f64::sqrt).into(),
            Self::Polyhedra { half_extents, .. } => half_extents[grain],
        }
    }

    /// Radius of the smallest sphere around the centre that holds the grain.
    pub(super) fn outer_radius(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain] / 2.0,
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].semi_axes_mm().x,
            Self::Polyhedra { grains, .. } => {
                let shape = grains.shape(grain);
                shape.template.outer_radius() * shape.scale_mm
            }
        }
    }

    /// The inverse shape matrix of an ellipsoid, in 1/mm².
    pub(super) fn inverse(&self, grain: usize) -> Option<Matrix3<f64>> {
        match self {
            Self::Spheres(_) | Self::Polyhedra { .. } => None,
            Self::Ellipsoids { forms, .. } => Some(forms[grain].inverse),
        }
    }

    /// The shape matrix of an ellipsoid, in mm².
    pub(super) fn shape(&self, grain: usize) -> Option<Matrix3<f64>> {
        match self {
            Self::Spheres(_) | Self::Polyhedra { .. } => None,
            Self::Ellipsoids { forms, .. } => Some(forms[grain].shape),
        }
    }

    /// The template of a polyhedron, and where the grain is.
    pub(super) fn polyhedron(&self, grain: usize) -> Option<(&Convex, Place)> {
        match self {
            Self::Spheres(_) | Self::Ellipsoids { .. } => None,
            Self::Polyhedra { grains, templates, .. } => {
                Some((&templates[grains.template[grain] as usize], Place::new(grains, grain)))
            }
        }
    }

    /// Diameter of the sphere of equal volume.
    pub(super) fn equivalent_diameter(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain],
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].equivalent_diameter_mm(),
            Self::Polyhedra { grains, .. } => grains.d_mm[grain],
        }
    }

    /// The section at a height `dz` above the centre, for a grain that is moved to `center`.
    #[inline]
    pub(super) fn section(&self, grain: usize, center: [f64; 3], dz: f64) -> Section<'_> {
        match self {
            Self::Spheres(spheres) => {
                let radius = spheres.d_mm[grain] / 2.0;
                Section::Disc {
                    center: [center[0], center[1]],
                    radius: ((radius - dz) * (radius + dz)).max(0.0).sqrt(),
                }
            }
            Self::Ellipsoids { forms, .. } => {
                let Form { shape: a, inverse: m } = &forms[grain];
                let scale = (1.0 - dz * dz / a.m33).max(0.0);
                Section::Ellipse {
                    center: [center[0] + a.m13 / a.m33 * dz, center[1] + a.m23 / a.m33 * dz],
                    half_y: (scale * (a.m22 - a.m23 * a.m23 / a.m33).max(0.0)).sqrt(),
                    shear: -m.m12 / m.m11,
                    half_x: (scale / m.m11).sqrt(),
                }
            }
            Self::Polyhedra { grains, templates, half_extents } => {
                let Place { rotation, scale, .. } = Place::new(grains, grain);
                let step = |axis: usize| rotation.row(axis).transpose() / scale;
                Section::Polyhedron {
                    template: &templates[grains.template[grain] as usize],
                    center: [center[0], center[1]],
                    half_y: half_extents[grain][1],
                    above: step(2) * dz,
                    steps: [step(0), step(1)],
                }
            }
        }
    }
}

impl Section<'_> {
    /// From and to along y; of a polyhedron those of the whole grain.
    #[inline]
    pub(super) fn y(&self) -> [f64; 2] {
        let (y, half) = match *self {
            Self::Disc { center, radius } => (center[1], radius),
            Self::Ellipse { center, half_y, .. } | Self::Polyhedron { center, half_y, .. } => {
                (center[1], half_y)
            }
        };
        [y - half, y + half]
    }

    /// The middle and half of the chord along x at a distance from the centre along y; half is less than 0 where the
    /// line does not meet the grain.
    #[inline]
    fn chord(&self, dy: f64) -> (f64, f64) {
        match *self {
            Self::Disc { center, radius } => (center[0], ((radius - dy) * (radius + dy)).max(0.0).sqrt()),
            Self::Ellipse { center, half_y, shear, half_x } => {
                let part = ((half_y - dy) * (half_y + dy)).max(0.0).sqrt();
                (center[0] + shear * dy, if half_y > 0.0 { half_x * (part / half_y) } else { 0.0 })
            }
            Self::Polyhedron { template, center, above, steps: [along, across], .. } => {
                let ends = template.chord(&(above + across * dy), &along);
                ends.map_or((center[0], -1.0), |[from, to]| {
                    (center[0] + (from + to) / 2.0, (to - from) / 2.0)
                })
            }
        }
    }

    /// From and to along x at a coordinate y; reversed where the line does not meet the grain.
    #[inline]
    pub(super) fn x_at(&self, y: f64) -> [f64; 2] {
        let (middle, half) = self.chord(y - self.center_y());
        [middle - half, middle + half]
    }

    /// Length of the chord along x at a coordinate y.
    #[inline]
    pub(super) fn length_at(&self, y: f64) -> f64 {
        2.0 * self.chord(y - self.center_y()).1.max(0.0)
    }

    #[inline]
    fn center_y(&self) -> f64 {
        match *self {
            Self::Disc { center, .. } | Self::Ellipse { center, .. } | Self::Polyhedron { center, .. } => {
                center[1]
            }
        }
    }
}

/// Value of the quadratic form: less than 1 inside the ellipsoid.
pub(super) fn quadratic(inverse: &Matrix3<f64>, from_center: &Vector3<f64>) -> f64 {
    from_center.dot(&(inverse * from_center))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;
    use crate::shape::{Ellipsoid, Pose};

    fn solids(axes: [f64; 3], angles: [f64; 3]) -> Ellipsoids {
        let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        Ellipsoids {
            shapes: vec![Ellipsoid::new(axes).unwrap()],
            poses: vec![Pose { center_mm: Vector3::new(1.0, 2.0, 3.0), orientation }],
        }
    }

    proptest! {
        #[test]
        fn the_ends_of_chords_lie_on_the_surface(
            axes in prop::array::uniform3(0.3..3.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
            at_z in -0.999..0.999_f64, at_y in -0.999..0.999_f64,
        ) {
            let grains = solids(axes, angles);
            let solids = Solids::new((&grains).into()).unwrap();
            let inverse = solids.inverse(0).unwrap();
            let center = Vector3::from(solids.center(0));
            let dz = at_z * solids.half_extents(0)[2];
            let section = solids.section(0, center.into(), dz);
            let [low, high] = section.y();
            let y = (low + high) / 2.0 + at_y * (high - low) / 2.0;
            let [from, to] = section.x_at(y);
            for x in [from, to] {
                let on = Vector3::new(x, y, center.z + dz) - center;
                prop_assert!((quadratic(&inverse, &on) - 1.0).abs() < 1e-9);
            }
            prop_assert!((section.length_at(y) - (to - from)).abs() < 1e-12);
        }

        #[test]
        fn equal_semi_axes_give_the_sections_of_a_sphere(radius in 0.3..3.0_f64, at in -0.9..0.9_f64) {
            let grains = solids([radius; 3], [0.3, 0.5, 0.7]);
            let mut spheres = Spheres::default();
            spheres.push([1.0, 2.0, 3.0], 2.0 * radius);
            let (one, other) = (Solids::new((&grains).into()).unwrap(), Solids::new((&spheres).into()).unwrap());
            let sections = [&one, &other].map(|solids| solids.section(0, [1.0, 2.0, 3.0], at * radius));
            let y = 2.0 + 0.5 * at * radius;
            for (a, b) in sections[0].x_at(y).into_iter().zip(sections[1].x_at(y)) {
                prop_assert!((a - b).abs() < 1e-12 * radius.max(1.0), "{a} {b}");
            }
            prop_assert!((one.volume_mm3(0) - other.volume_mm3(0)).abs() < 1e-12 * other.volume_mm3(0));
        }
    }
}
