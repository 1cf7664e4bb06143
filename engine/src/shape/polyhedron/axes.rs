//! The principal axes of a polyhedron, and its form by them.
//!
//! The form is that of the ellipsoid of equal inertia: with the second moments `S = integral of x xᵀ` over the core,
//! whose eigenvalues are `s1 >= s2 >= s3`, its semi-axes are proportional to their roots, as those of an ellipsoid are.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::Polyhedron;
use crate::arrays::Each as _;
use crate::shape::Form;
use crate::sorting;

impl Polyhedron {
    /// The principal axes of the core about the origin as columns, the longest first; a rotation.
    #[must_use]
    pub fn principal_axes(&self) -> Matrix3<f64> {
        self.second_moments().0
    }

    /// The ratios of the axes of the ellipsoid of equal inertia, of the core.
    #[must_use]
    pub fn form(&self) -> Form {
        let moments = self.second_moments().1;
        Form::of_axes(moments.map(|moment| moment.max(0.0).sqrt()).into())
    }

    /// Principal axes and second moments along them, the longest first.
    fn second_moments(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let inertia = self.core_inertia();
        let second = Matrix3::from_diagonal_element(inertia.trace() / 2.0) - inertia;
        let eigen = SymmetricEigen::new(second);
        let mut order = [0, 1, 2];
        sorting::by_number(&mut order, |&i| -eigen.eigenvalues[i]);
        let axis = |i: usize| eigen.eigenvectors.column(order[i]).into_owned();
        let (long, middle) = (axis(0), axis(1));
        let axes = Matrix3::from_columns(&[long, middle, long.cross(&middle)]);
        (axes, Vector3::from(order.each(|i| eigen.eigenvalues[i])))
    }

    /// The body turned so that its principal axes lie along x, y and z, the longest along x.
    #[must_use]
    pub fn on_principal_axes(&self) -> Self {
        let axes = self.principal_axes();
        let vertices = self.vertices.iter().map(|vertex| axes.tr_mul(vertex)).collect();
        Self::of_parts(vertices, self.faces.clone(), self.rounding)
    }
}
