//! Grains as lines and planes cut them: sections at a height, chords along x, and whether a point lies inside.
//!
//! For an ellipsoid with the shape matrix `A` and its inverse `M`, the points with `(p - x) · M (p - x) <= 1`, the
//! section at a height `dz` above the centre `x` is the ellipse around `(A_xz, A_yz) dz / A_zz` with the matrix of the
//! Schur complement of `A_zz`, scaled by `1 - dz² / A_zz`; a chord along x follows from the quadratic equation in x.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::memory::{OutOfMemory, collected};
use crate::packing::{Ellipsoids, GrainsRef, Spheres};

/// The grains of a packing.
pub(super) enum Solids<'a> {
    Spheres(&'a Spheres),
    Ellipsoids { grains: &'a Ellipsoids, forms: Vec<Form> },
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
pub(super) enum Section {
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
}

impl<'a> Solids<'a> {
    /// The grains of a packing, with what sections are computed from: 144 bytes an ellipsoid.
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
        })
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Spheres(spheres) => spheres.len(),
            Self::Ellipsoids { grains, .. } => grains.len(),
        }
    }

    pub(super) fn center(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => spheres.center(grain),
            Self::Ellipsoids { grains, .. } => grains.poses[grain].center_mm.into(),
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
        }
    }

    /// Half of the extents along x, y and z.
    pub(super) fn half_extents(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => [spheres.d_mm[grain] / 2.0; 3],
            Self::Ellipsoids { forms, .. } => forms[grain].shape.diagonal().map(f64::sqrt).into(),
        }
    }

    /// Radius of the smallest sphere around the grain.
    pub(super) fn outer_radius(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain] / 2.0,
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].semi_axes_mm().x,
        }
    }

    /// The inverse shape matrix in 1/mm²; none of a sphere.
    pub(super) fn inverse(&self, grain: usize) -> Option<Matrix3<f64>> {
        match self {
            Self::Spheres(_) => None,
            Self::Ellipsoids { forms, .. } => Some(forms[grain].inverse),
        }
    }

    /// The shape matrix in mm²; none of a sphere.
    pub(super) fn shape(&self, grain: usize) -> Option<Matrix3<f64>> {
        match self {
            Self::Spheres(_) => None,
            Self::Ellipsoids { forms, .. } => Some(forms[grain].shape),
        }
    }

    /// Diameter of the sphere of equal volume.
    pub(super) fn equivalent_diameter(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain],
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].equivalent_diameter_mm(),
        }
    }

    /// The section at a height `dz` above the centre, for a grain that is moved to `center`.
    #[inline]
    pub(super) fn section(&self, grain: usize, center: [f64; 3], dz: f64) -> Section {
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
        }
    }
}

impl Section {
    /// From and to along y.
    #[inline]
    pub(super) fn y(&self) -> [f64; 2] {
        let (y, half) = match *self {
            Self::Disc { center, radius } => (center[1], radius),
            Self::Ellipse { center, half_y, .. } => (center[1], half_y),
        };
        [y - half, y + half]
    }

    /// The middle and half of the chord along x at a distance from the centre along y.
    #[inline]
    fn chord(&self, dy: f64) -> (f64, f64) {
        match *self {
            Self::Disc { center, radius } => (center[0], ((radius - dy) * (radius + dy)).max(0.0).sqrt()),
            Self::Ellipse { center, half_y, shear, half_x } => {
                let part = ((half_y - dy) * (half_y + dy)).max(0.0).sqrt();
                (center[0] + shear * dy, if half_y > 0.0 { half_x * (part / half_y) } else { 0.0 })
            }
        }
    }

    /// From and to along x at a coordinate y.
    #[inline]
    pub(super) fn x_at(&self, y: f64) -> [f64; 2] {
        let (middle, half) = self.chord(y - self.center_y());
        [middle - half, middle + half]
    }

    /// Length of the chord along x at a coordinate y.
    #[inline]
    pub(super) fn length_at(&self, y: f64) -> f64 {
        2.0 * self.chord(y - self.center_y()).1
    }

    #[inline]
    fn center_y(&self) -> f64 {
        match *self {
            Self::Disc { center, .. } | Self::Ellipse { center, .. } => center[1],
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
