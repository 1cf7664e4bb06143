//! The kinds of solid elements and of plane ones: nodes, sides, volumes and the quality of tetrahedra and triangles.
//!
//! Nodes and sides are numbered as Abaqus and CalculiX number them: those of tetrahedra with mid nodes are the corners
//! 1 to 4, then the middles of the edges 12, 23, 31, 14, 24, 34; those of triangles the corners 1 to 3, then the
//! middles of 12, 23, 31. Plane elements lie in the plane of x and y and are 1 mm thick.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A kind of solid elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementKind {
    /// Linear tetrahedra, `C3D4`.
    Tetrahedron4,
    /// Quadratic tetrahedra, `C3D10`.
    Tetrahedron10,
    /// Linear hexahedra, `C3D8`.
    Hexahedron8,
    /// Linear triangles, `CPS3` or `CPE3`.
    Triangle3(PlaneState),
    /// Quadratic triangles, `CPS6` or `CPE6`.
    Triangle6(PlaneState),
}

/// What a plane model assumes across its plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum PlaneState {
    /// No stress: thin plates. `CPS3` and `CPS6`.
    #[default]
    Stress,
    /// No strain: long bodies. `CPE3` and `CPE6`.
    Strain,
}

impl PlaneState {
    /// Both, the default first.
    pub const ALL: [Self; 2] = [Self::Stress, Self::Strain];

    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stress => "stress",
            Self::Strain => "strain",
        }
    }
}

/// Corners of the sides of a triangle, and the mid node.
const SIDES_OF_TRIANGLE: [&[usize]; 3] = [&[0, 1, 3], &[1, 2, 4], &[2, 0, 5]];

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
            Self::Triangle3(_) => 3,
            Self::Triangle6(_) => 6,
        }
    }

    /// Whether it is a plane element.
    pub fn is_plane(self) -> bool {
        matches!(self, Self::Triangle3(_) | Self::Triangle6(_))
    }

    /// Its name in Abaqus and CalculiX.
    pub fn abaqus_name(self) -> &'static str {
        match self {
            Self::Tetrahedron4 => "C3D4",
            Self::Tetrahedron10 => "C3D10",
            Self::Hexahedron8 => "C3D8",
            Self::Triangle3(PlaneState::Stress) => "CPS3",
            Self::Triangle3(PlaneState::Strain) => "CPE3",
            Self::Triangle6(PlaneState::Stress) => "CPS6",
            Self::Triangle6(PlaneState::Strain) => "CPE6",
        }
    }

    /// The kind of that name in Abaqus and CalculiX.
    pub fn of_abaqus(name: &str) -> Option<Self> {
        let plane =
            PlaneState::ALL.into_iter().flat_map(|state| [Self::Triangle3(state), Self::Triangle6(state)]);
        [Self::Tetrahedron4, Self::Tetrahedron10, Self::Hexahedron8]
            .into_iter()
            .chain(plane)
            .find(|kind| kind.abaqus_name() == name)
    }

    /// Number of the cell type in VTK.
    pub(super) fn vtk_type(self) -> u8 {
        match self {
            Self::Tetrahedron4 => 10,
            Self::Tetrahedron10 => 24,
            Self::Hexahedron8 => 12,
            Self::Triangle3(_) => 5,
            Self::Triangle6(_) => 22,
        }
    }

    /// The nodes of each side as places in an element, corners first, in the order of the sides' numbers.
    pub fn sides(self) -> impl Iterator<Item = &'static [usize]> {
        let sides: &[&'static [usize]] = match self {
            Self::Hexahedron8 => &SIDES_OF_HEXAHEDRON,
            Self::Tetrahedron4 | Self::Tetrahedron10 => &SIDES_OF_TETRAHEDRON,
            Self::Triangle3(_) | Self::Triangle6(_) => &SIDES_OF_TRIANGLE,
        };
        let is_linear = matches!(self, Self::Tetrahedron4 | Self::Triangle3(_));
        let of_side = if is_linear { self.corners_of_side() } else { usize::MAX };
        sides.iter().map(move |nodes| &nodes[..nodes.len().min(of_side)])
    }

    /// Number of the sides of an element.
    pub fn number_of_sides(self) -> usize {
        match self {
            Self::Hexahedron8 => 6,
            Self::Tetrahedron4 | Self::Tetrahedron10 => 4,
            Self::Triangle3(_) | Self::Triangle6(_) => 3,
        }
    }

    /// Corners of a side.
    pub fn corners_of_side(self) -> usize {
        match self {
            Self::Hexahedron8 => 4,
            Self::Tetrahedron4 | Self::Tetrahedron10 => 3,
            Self::Triangle3(_) | Self::Triangle6(_) => 2,
        }
    }

    /// Gmsh's quality by the corners: 1 regular, 0 flat; absent for hexahedra.
    pub(super) fn gamma(self, points: &[Vector3<f64>]) -> Option<f64> {
        match self {
            Self::Hexahedron8 => None,
            Self::Tetrahedron4 | Self::Tetrahedron10 => Some(gamma(&points[..4])),
            Self::Triangle3(_) | Self::Triangle6(_) => Some(gamma_of_triangle(&points[..3])),
        }
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
            Self::Triangle3(_) => {
                let area = of_triangle(points);
                (area, if area > 0.0 { 1.0 } else { area })
            }
            Self::Triangle6(_) => of_curved_triangle(points),
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

/// The area of a triangle in the plane of x and y with straight sides, negative where it runs clockwise.
fn of_triangle(corners: &[Vector3<f64>]) -> f64 {
    (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).z / 2.0
}

/// The determinant of a triangle with mid nodes is a polynomial of degree 2: the rule of the middles of the sides
/// integrates it exactly.
fn of_curved_triangle(points: &[Vector3<f64>]) -> (f64, f64) {
    let mut area = 0.0;
    let mut least = f64::INFINITY;
    for corner in 0..3 {
        let mut middle = [0.5; 3];
        middle[corner] = 0.0;
        let determinant = determinant_of_triangle(points, middle);
        area += determinant / 6.0;
        let mut at_corner = [0.0; 3];
        at_corner[corner] = 1.0;
        least = least.min(determinant).min(determinant_of_triangle(points, at_corner));
    }
    (area, least / (2.0 * area.abs()).max(f64::MIN_POSITIVE))
}

/// The determinant of a triangle with mid nodes, at barycentric coordinates.
fn determinant_of_triangle(points: &[Vector3<f64>], at: [f64; 3]) -> f64 {
    let mut by = [Vector3::zeros(); 3];
    for (corner, derivative) in by.iter_mut().enumerate() {
        *derivative += (4.0 * at[corner] - 1.0) * points[corner];
    }
    for (side, [a, b]) in [[0, 1], [1, 2], [2, 0]].into_iter().enumerate() {
        by[a] += 4.0 * at[b] * points[3 + side];
        by[b] += 4.0 * at[a] * points[3 + side];
    }
    (by[1] - by[0]).cross(&(by[2] - by[0])).z
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
fn gamma(corners: &[Vector3<f64>]) -> f64 {
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

/// Gmsh's quality of a triangle: twice the radius of the inscribed circle over that of the circumscribed one.
fn gamma_of_triangle(corners: &[Vector3<f64>]) -> f64 {
    let area = of_triangle(corners).abs();
    let [a, b, c] = [[0, 1], [1, 2], [2, 0]].map(|[a, b]: [usize; 2]| (corners[b] - corners[a]).norm());
    let denominator = (a + b + c) * a * b * c;
    if denominator <= 0.0 { 0.0 } else { 16.0 * area * area / denominator }
}
