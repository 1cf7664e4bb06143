//! The kinds of solid elements: nodes, sides, volumes and the quality of tetrahedra.
//!
//! Nodes and sides are numbered as Abaqus and CalculiX number them: those of tetrahedra with mid nodes are the corners
//! 1 to 4, then the middles of the edges 12, 23, 31, 14, 24, 34.

use nalgebra::{Matrix3, Vector3};

/// A kind of solid elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Linear tetrahedra, `C3D4`.
    Tetrahedron4,
    /// Quadratic tetrahedra, `C3D10`.
    Tetrahedron10,
    /// Linear hexahedra, `C3D8`.
    Hexahedron8,
}

/// Corners of the sides of a tetrahedron, and the mid nodes of its edges.
const SIDES_OF_TETRAHEDRON: [&[usize]; 4] =
    [&[0, 1, 2, 4, 5, 6], &[0, 3, 1, 7, 8, 4], &[1, 3, 2, 8, 9, 5], &[2, 3, 0, 9, 7, 6]];
/// Corners of the sides of a hexahedron.
const SIDES_OF_HEXAHEDRON: [&[usize]; 6] =
    [&[0, 1, 2, 3], &[4, 7, 6, 5], &[0, 4, 5, 1], &[1, 5, 6, 2], &[2, 6, 7, 3], &[3, 7, 4, 0]];
/// Ends of the edges of a tetrahedron, in the order of their mid nodes.
pub(super) const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
/// Signs of the local coordinates of a hexahedron's corners.
const CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

impl ElementKind {
    /// Nodes of an element.
    pub fn nodes(self) -> usize {
        match self {
            Self::Tetrahedron4 => 4,
            Self::Tetrahedron10 => 10,
            Self::Hexahedron8 => 8,
        }
    }

    /// Its name in Abaqus and CalculiX.
    pub fn abaqus_name(self) -> &'static str {
        match self {
            Self::Tetrahedron4 => "C3D4",
            Self::Tetrahedron10 => "C3D10",
            Self::Hexahedron8 => "C3D8",
        }
    }

    /// Number of the cell type in VTK.
    pub(super) fn vtk_type(self) -> u8 {
        match self {
            Self::Tetrahedron4 => 10,
            Self::Tetrahedron10 => 24,
            Self::Hexahedron8 => 12,
        }
    }

    /// The nodes of each side as places in an element, corners first, in the order of the sides' numbers.
    pub fn sides(self) -> impl Iterator<Item = &'static [usize]> {
        let sides: &[&'static [usize]] = match self {
            Self::Hexahedron8 => &SIDES_OF_HEXAHEDRON,
            Self::Tetrahedron4 | Self::Tetrahedron10 => &SIDES_OF_TETRAHEDRON,
        };
        let of_side = if self == Self::Tetrahedron4 { 3 } else { usize::MAX };
        sides.iter().map(move |nodes| &nodes[..nodes.len().min(of_side)])
    }

    /// Number of the sides of an element.
    pub fn number_of_sides(self) -> usize {
        if self == Self::Hexahedron8 { 6 } else { 4 }
    }

    /// The volume of an element, and the least determinant of the map from its reference element: at the corners, the
    /// mid nodes and the points of integration, in volumes of the element. It is 1 where the map is affine, and not
    /// positive where the element is turned inside out.
    pub(super) fn volume(self, points: &[Vector3<f64>]) -> (f64, f64) {
        match self {
            Self::Tetrahedron4 => {
                let volume = of_tetrahedron(points);
                (volume, if volume > 0.0 { 1.0 } else { volume })
            }
            Self::Tetrahedron10 => of_curved_tetrahedron(points),
            Self::Hexahedron8 => of_hexahedron(points),
        }
    }
}

/// The volume of a tetrahedron with plane sides.
fn of_tetrahedron(corners: &[Vector3<f64>]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner| corners[corner] - corners[0]);
    a.dot(&b.cross(&c)) / 6.0
}

/// The determinant of a tetrahedron with mid nodes is a polynomial of degree 3: the rule of five points integrates it
/// exactly (Keast 1986, 10.1016/0045-7825(86)90059-9, its second rule).
fn of_curved_tetrahedron(points: &[Vector3<f64>]) -> (f64, f64) {
    let sixth = 1.0 / 6.0;
    let mut volume = -0.8 * determinant_of_tetrahedron(points, [0.25; 4]) * sixth;
    let mut least = determinant_of_tetrahedron(points, [0.25; 4]);
    for corner in 0..4 {
        let mut place = [sixth; 4];
        place[corner] = 0.5;
        let determinant = determinant_of_tetrahedron(points, place);
        volume += 0.45 * determinant * sixth;
        let mut at_corner = [0.0; 4];
        at_corner[corner] = 1.0;
        least = least.min(determinant).min(determinant_of_tetrahedron(points, at_corner));
    }
    for ends in EDGES {
        let mut middle = [0.0; 4];
        for end in ends {
            middle[end] = 0.5;
        }
        least = least.min(determinant_of_tetrahedron(points, middle));
    }
    (volume, least / (6.0 * volume.abs()).max(f64::MIN_POSITIVE))
}

/// The determinant of a tetrahedron with mid nodes, at barycentric coordinates.
fn determinant_of_tetrahedron(points: &[Vector3<f64>], at: [f64; 4]) -> f64 {
    // Derivatives by the barycentric coordinates; the local ones are the last three minus the first.
    let mut by = [Vector3::zeros(); 4];
    for (corner, derivative) in by.iter_mut().enumerate() {
        *derivative += (4.0 * at[corner] - 1.0) * points[corner];
    }
    for (edge, [a, b]) in EDGES.into_iter().enumerate() {
        by[a] += 4.0 * at[b] * points[4 + edge];
        by[b] += 4.0 * at[a] * points[4 + edge];
    }
    Matrix3::from_columns(&[by[1] - by[0], by[2] - by[0], by[3] - by[0]]).determinant()
}

/// The volume of a trilinear hexahedron by Gauss' rule of two points an axis, which is exact for it.
fn of_hexahedron(points: &[Vector3<f64>]) -> (f64, f64) {
    let gauss = 1.0 / 3.0_f64.sqrt();
    let mut volume = 0.0;
    let mut least = f64::INFINITY;
    for corner in CORNERS {
        let determinant = determinant_of_hexahedron(points, corner.map(|sign| sign * gauss));
        volume += determinant;
        least = least.min(determinant).min(determinant_of_hexahedron(points, corner));
    }
    (volume, 8.0 * least / volume.abs().max(f64::MIN_POSITIVE))
}

fn determinant_of_hexahedron(points: &[Vector3<f64>], at: [f64; 3]) -> f64 {
    let mut jacobian = Matrix3::zeros();
    for (point, signs) in points.iter().zip(CORNERS) {
        let factor = |axis: usize| 1.0 + signs[axis] * at[axis];
        for (axis, sign) in signs.iter().enumerate() {
            let derivative = sign * factor((axis + 1) % 3) * factor((axis + 2) % 3) / 8.0;
            jacobian.set_column(axis, &(jacobian.column(axis) + derivative * point));
        }
    }
    jacobian.determinant()
}

/// Gmsh's quality of the tetrahedron of four corners: three times the radius of the inscribed sphere over that of the
/// circumscribed one, 1 for a regular tetrahedron and 0 for a flat one.
pub(super) fn gamma(corners: &[Vector3<f64>]) -> f64 {
    let volume = of_tetrahedron(corners);
    let edge = |a: usize, b: usize| (corners[b] - corners[a]).norm();
    // With p, q, r the products of opposite edges, 24 V R is the root of (p + q + r)(p + q - r)(p - q + r)(q + r - p).
    let [p, q, r] = [edge(0, 1) * edge(2, 3), edge(0, 2) * edge(1, 3), edge(0, 3) * edge(1, 2)];
    let product = ((p + q + r) * (p + q - r) * (p - q + r) * (q + r - p)).max(0.0);
    let area = |a: usize, b: usize, c: usize| {
        0.5 * (corners[b] - corners[a]).cross(&(corners[c] - corners[a])).norm()
    };
    let surface = area(0, 1, 2) + area(0, 1, 3) + area(0, 2, 3) + area(1, 2, 3);
    let denominator = surface * product.sqrt();
    if volume <= 0.0 || denominator <= 0.0 { 0.0 } else { 216.0 * volume * volume / denominator }
}
