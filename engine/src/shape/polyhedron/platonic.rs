//! The five Platonic solids, by which packings are compared with those of the literature.

use nalgebra::Vector3;

use super::Polyhedron;
use crate::arrays::Each as _;

/// A convex body whose faces are equal regular polygons, as many at every corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlatonicSolid {
    /// Four triangles.
    Tetrahedron,
    /// Six squares.
    Cube,
    /// Eight triangles.
    Octahedron,
    /// Twelve pentagons.
    Dodecahedron,
    /// Twenty triangles.
    Icosahedron,
}

impl PlatonicSolid {
    /// All of them, by the number of faces.
    pub const ALL: [Self; 5] =
        [Self::Tetrahedron, Self::Cube, Self::Octahedron, Self::Dodecahedron, Self::Icosahedron];

    /// Its name in English, in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tetrahedron => "tetrahedron",
            Self::Cube => "cube",
            Self::Octahedron => "octahedron",
            Self::Dodecahedron => "dodecahedron",
            Self::Icosahedron => "icosahedron",
        }
    }

    /// Its corners, about the origin.
    #[must_use]
    pub fn corners(self) -> Vec<Vector3<f64>> {
        let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
        let signs = |i: u32| [0, 1, 2].each(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let cube = || (0..8).map(|i| Vector3::from(signs(i)));
        // Rectangles across the three axes, with sides of 2 `u` and 2 `v`.
        let rectangles = |u: f64, v: f64| {
            let corner = move |i: u32, axis: usize| {
                let [p, q, _] = signs(i);
                let mut corner = Vector3::zeros();
                (corner[axis], corner[(axis + 1) % 3]) = (p * u, q * v);
                corner
            };
            (0..3).flat_map(move |axis| (0..4).map(move |i| corner(i, axis)))
        };
        match self {
            Self::Tetrahedron => cube().filter(|corner| corner.iter().product::<f64>() > 0.0).collect(),
            Self::Cube => cube().collect(),
            Self::Octahedron => (0..3).flat_map(|axis| [-1.0, 1.0].each(|x| unit(axis) * x)).collect(),
            Self::Dodecahedron => cube().chain(rectangles(1.0 / golden, golden)).collect(),
            Self::Icosahedron => rectangles(1.0, golden).collect(),
        }
    }

    /// The solid with its centroid at the origin, of any size.
    #[must_use]
    pub fn body(self) -> Option<Polyhedron> {
        Polyhedron::hull_of(&self.corners())
    }
}

fn unit(axis: usize) -> Vector3<f64> {
    let mut unit = Vector3::zeros();
    unit[axis] = 1.0;
    unit
}
