//! Position and orientation of a grain.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Position and orientation of a grain: a point `p` of the body lies at `center_mm + R(q) p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Centre of the grain in mm.
    pub center_mm: Vector3<f64>,
    /// Rotation from the body's axes to those of the specimen.
    ///
    /// Stored packings are read with [`UnitQuaternion::new_unchecked`], so that the numbers of the file stay as they
    /// are; [`Pose::rotation`] makes an exact rotation of them.
    pub orientation: UnitQuaternion<f64>,
}

impl Pose {
    /// A pose without rotation.
    #[must_use]
    pub fn at(center_mm: Vector3<f64>) -> Self {
        Self { center_mm, orientation: UnitQuaternion::identity() }
    }

    /// The rotation as a matrix, whose columns are the axes of the body.
    ///
    /// `R(q)` is divided by `|q|²`, so that the four stored numbers define a rotation also where their rounding leaves
    /// `|q|` different from 1.
    #[must_use]
    pub fn rotation(&self) -> Matrix3<f64> {
        let &Quaternion { coords } = self.orientation.quaternion();
        let (x, y, z, w) = (coords.x, coords.y, coords.z, coords.w);
        let scale = 2.0 / (w * w + x * x + y * y + z * z);
        Matrix3::new(
            1.0 - scale * (y * y + z * z),
            scale * (x * y - w * z),
            scale * (x * z + w * y),
            scale * (x * y + w * z),
            1.0 - scale * (x * x + z * z),
            scale * (y * z - w * x),
            scale * (x * z - w * y),
            scale * (y * z + w * x),
            1.0 - scale * (x * x + y * y),
        )
    }
}
