//! Convex polytopes between plane walls: corners, volume and area from the planes alone.
//!
//! A corner is the point of three planes that lies inside all others. The volume is the sum of the pyramids over the
//! faces with their tips at one point inside; the area of a face is that of its corners, sorted by their angle around
//! its normal. With at most [`MOST_FACES`](super::MOST_FACES) planes there are few triples.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use super::{Domain, Face, FacePlane, MOST_FACES};
use crate::elementary::atan2;

/// Share of the size by which a corner may lie outside of a plane through it.
const ROUNDING: f64 = 1e-12;

/// Why planes do not bound a domain.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum PolytopeError {
    /// More planes than a domain has faces.
    #[error("{number} planes: must be at most {MOST_FACES}")]
    TooMany {
        /// Number of the planes.
        number: usize,
    },
    /// Not every plane has a name.
    #[error("{names} names for {number} planes: must be one for each")]
    Names {
        /// Number of the names.
        names: usize,
        /// Number of the planes.
        number: usize,
    },
    /// They do not enclose a volume, or one of them touches nothing of it.
    #[error("plane {index} is no face of a closed volume between the planes")]
    NotAFace {
        /// The plane, from 0.
        index: usize,
    },
    /// The volume reaches below a coordinate of 0, or begins above it.
    #[error("the bounding box begins at {low_mm} mm along axis {axis}: must begin at 0")]
    NotAtOrigin {
        /// The axis, from 0.
        axis: usize,
        /// Where the box begins.
        low_mm: f64,
    },
}

/// What planes enclose.
#[derive(Clone, Debug)]
pub(super) struct Polytope {
    pub(super) corners_mm: Vec<Vector3<f64>>,
    /// Area of each face.
    pub(super) areas_mm2: Vec<f64>,
    pub(super) volume_mm3: f64,
}

impl Domain {
    /// A convex polytope between plane walls, whose bounding box must begin at the origin.
    ///
    /// ```
    /// use nalgebra::Vector3;
    /// use packstone_engine::domain::{Domain, FacePlane};
    ///
    /// // A corner of a cube of 3 mm, cut off by the plane x + y + z = 3.
    /// let across = |axis| FacePlane::new(Vector3::ith(axis, 1.0), Vector3::zeros());
    /// let cut = FacePlane::new(Vector3::new(-1.0, -1.0, -1.0), Vector3::new(1.0, 1.0, 1.0));
    /// let planes = [across(0), across(1), across(2), cut];
    /// let domain = Domain::polytope(&planes, &["x_min", "y_min", "z_min", "cut"])?;
    /// assert!((domain.volume_mm3 - 4.5).abs() < 1e-12);
    /// # Ok::<(), packstone_engine::domain::PolytopeError>(())
    /// ```
    ///
    /// # Errors
    /// See [`PolytopeError`].
    pub fn polytope(
        planes: &[FacePlane],
        face_names: &'static [&'static str],
    ) -> Result<Self, PolytopeError> {
        let number = planes.len();
        if number > MOST_FACES {
            return Err(PolytopeError::TooMany { number });
        }
        if face_names.len() != number {
            return Err(PolytopeError::Names { names: face_names.len(), number });
        }
        let Some(Polytope { corners_mm, areas_mm2, volume_mm3 }) = Polytope::between(planes) else {
            return Err(PolytopeError::NotAFace { index: 0 });
        };
        let smallest = ROUNDING * areas_mm2.iter().sum::<f64>();
        // A value that is no number is no face either.
        if let Some(index) = areas_mm2.iter().position(|&area| area.is_nan() || area <= smallest) {
            return Err(PolytopeError::NotAFace { index });
        }
        let (mut low, mut high) = (corners_mm[0], corners_mm[0]);
        for corner in &corners_mm {
            (low, high) = (low.inf(corner), high.sup(corner));
        }
        if let Some(axis) = (0..3).find(|&axis| low[axis].abs() > ROUNDING * high.amax()) {
            return Err(PolytopeError::NotAtOrigin { axis, low_mm: low[axis] });
        }
        let mut faces = [None; MOST_FACES];
        for (face, &plane) in faces.iter_mut().zip(planes) {
            *face = Some(Face::Plane(plane));
        }
        let is_face = |plane: FacePlane| planes.contains(&plane);
        let pairs = [0, 1, 2].map(|axis| FacePlane::pair(axis, high[axis]).into_iter().all(is_face));
        let is_paired = |plane: &FacePlane| plane.across().is_some_and(|(axis, _)| pairs[axis]);
        Ok(Self {
            pairs,
            has_oblique: !planes.iter().all(is_paired),
            bounds_mm: high.into(),
            periods_mm: [None; 3],
            face_names,
            faces,
            volume_mm3,
            surface_mm2: areas_mm2.iter().sum(),
        })
    }
}

impl Polytope {
    /// What planes enclose; `None` where they have no corners, or a volume without an end.
    pub(super) fn between(planes: &[FacePlane]) -> Option<Self> {
        let mut corners_mm: Vec<Vector3<f64>> = Vec::new();
        for (a, first) in planes.iter().enumerate() {
            for (b, second) in planes.iter().enumerate().skip(a + 1) {
                for third in &planes[b + 1..] {
                    corners_mm.extend(corner(first, second, third).filter(|p| is_inside(p, planes)));
                }
            }
        }
        let middle = corners_mm.iter().sum::<Vector3<f64>>() / corners_mm.len() as f64;
        let size = corners_mm.iter().map(|p| (p - middle).norm()).reduce(f64::max)?;
        let areas_mm2: Vec<f64> = planes.iter().map(|plane| area_mm2(plane, &corners_mm, size)).collect();
        // Faces of a closed volume with their normals add up to nothing.
        let sum: Vector3<f64> = planes.iter().zip(&areas_mm2).map(|(plane, &area)| plane.normal * area).sum();
        if sum.norm() > 1e-9 * areas_mm2.iter().sum::<f64>() {
            return None;
        }
        let pyramids = planes.iter().zip(&areas_mm2);
        let volume_mm3 =
            pyramids.map(|(plane, area)| plane.distance_mm(middle.into()).max(0.0) * area / 3.0).sum();
        Some(Self { corners_mm, areas_mm2, volume_mm3 })
    }
}

/// The point of three planes; `None` where they have none or more.
fn corner(first: &FacePlane, second: &FacePlane, third: &FacePlane) -> Option<Vector3<f64>> {
    let normals =
        Matrix3::from_rows(&[first.normal.transpose(), second.normal.transpose(), third.normal.transpose()]);
    if normals.determinant().abs() < ROUNDING {
        return None;
    }
    let offsets = Vector3::new(first.offset_mm, second.offset_mm, third.offset_mm);
    normals.try_inverse().map(|inverse| inverse * offsets)
}

/// Whether a point lies inside all planes, or on them within rounding.
fn is_inside(p: &Vector3<f64>, planes: &[FacePlane]) -> bool {
    planes
        .iter()
        .all(|plane| plane.distance_mm((*p).into()) >= -ROUNDING * (p.norm() + plane.offset_mm.abs()))
}

/// Area of the polygon that the corners on a plane span.
fn area_mm2(plane: &FacePlane, corners_mm: &[Vector3<f64>], size_mm: f64) -> f64 {
    let is_on = |p: &&Vector3<f64>| plane.distance_mm((**p).into()).abs() <= 1e3 * ROUNDING * size_mm;
    let on: Vec<Vector3<f64>> = corners_mm.iter().filter(is_on).copied().collect();
    let middle = on.iter().sum::<Vector3<f64>>() / on.len().max(1) as f64;
    let u = plane.normal.cross(&Vector3::ith(plane.normal.iamin(), 1.0)).normalize();
    let v = plane.normal.cross(&u);
    let mut around: Vec<(f64, Vector3<f64>)> =
        on.iter().map(|p| p - middle).map(|arm| (atan2(arm.dot(&v), arm.dot(&u)), arm)).collect();
    around.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    let next = around.iter().cycle().skip(1);
    around.iter().zip(next).map(|((_, p), (_, q))| p.cross(q).dot(&plane.normal) / 2.0).sum()
}
