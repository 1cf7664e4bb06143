//! A Platonic solid of the volume 1: its rotations, and how deep two of them overlap.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use packstone_engine::shape::polyhedron::PlatonicSolid;

/// Components of vectors of the length 1 that differ by less are the same.
const SAME: f64 = 1e-6;
/// Least sine of the angle between two edges whose cross product is an axis: of edges that are more parallel it is that
/// of a face.
const LEAST_SINE: f64 = 1e-9;

/// A solid about its centroid.
pub(crate) struct Solid {
    corners: Vec<Vector3<f64>>,
    /// Normals of the faces and directions of the edges, of opposite ones one alone.
    normals: Vec<Vector3<f64>>,
    edges: Vec<Vector3<f64>>,
    /// Radii of the spheres about the centroid within the solid and around it.
    pub(crate) inner: f64,
    pub(crate) outer: f64,
    /// The rotations that map the solid to itself, but for the identity.
    symmetries: Vec<Quaternion<f64>>,
    /// Half the edge of a cube of Rodrigues vectors that holds the zone of [`Self::is_in_zone`].
    pub(crate) zone: f64,
}

/// A solid with a place. Corners are relative to the centre, in groups of four that repeat the last one.
#[derive(Clone)]
pub(crate) struct Placed {
    pub(crate) center: Vector3<f64>,
    pub(crate) orientation: UnitQuaternion<f64>,
    corners: Vec<[[f64; 4]; 3]>,
    normals: Vec<Vector3<f64>>,
    edges: Vec<Vector3<f64>>,
}

impl Solid {
    /// The solid; none if it has no volume.
    pub(crate) fn new(kind: PlatonicSolid) -> Option<Self> {
        let body = kind.body()?;
        let scale = 1.0 / libm::cbrt(body.volume());
        let corners: Vec<Vector3<f64>> = body.vertices().iter().map(|v| v * scale).collect();
        let (mut normals, mut edges): (Vec<Vector3<f64>>, Vec<Vector3<f64>>) = (Vec::new(), Vec::new());
        let add = |list: &mut Vec<Vector3<f64>>, v: Vector3<f64>| {
            if list.iter().all(|other| other.cross(&v).norm() > SAME) {
                list.push(v);
            }
        };
        for face in body.faces() {
            let at = |corner: usize| corners[face[corner % face.len()] as usize];
            add(&mut normals, (at(1) - at(0)).cross(&(at(2) - at(0))).normalize());
            (0..face.len()).for_each(|i| add(&mut edges, (at(i + 1) - at(i)).normalize()));
        }
        let (inner, outer) = (body.inner_radius() * scale, body.outer_radius() * scale);
        let symmetries = symmetries(&corners);
        let mut solid = Self { corners, normals, edges, inner, outer, symmetries, zone: 0.0 };
        solid.zone = solid.zone_half_edge()?;
        Some(solid)
    }

    /// The solid at a place; `placed` is overwritten.
    pub(crate) fn place(&self, placed: &mut Placed, center: Vector3<f64>, orientation: UnitQuaternion<f64>) {
        let turn = orientation.to_rotation_matrix();
        placed.center = center;
        placed.orientation = orientation;
        placed.corners.clear();
        placed.corners.extend(self.corners.chunks(4).map(|chunk| {
            let turned: [Vector3<f64>; 4] = std::array::from_fn(|i| turn * chunk[i.min(chunk.len() - 1)]);
            std::array::from_fn(|axis| turned.map(|corner| corner[axis]))
        }));
        placed.normals.clear();
        placed.normals.extend(self.normals.iter().map(|normal| turn * normal));
        placed.edges.clear();
        placed.edges.extend(self.edges.iter().map(|edge| turn * edge));
    }

    pub(crate) fn placed(&self, center: Vector3<f64>, orientation: UnitQuaternion<f64>) -> Placed {
        let (corners, normals, edges) = (Vec::new(), Vec::new(), Vec::new());
        let mut placed = Placed { center, orientation, corners, normals, edges };
        self.place(&mut placed, center, orientation);
        placed
    }

    /// Whether a cube of Rodrigues vectors (axis times tangent of half the angle) with this centre and half edge may
    /// hold an orientation that no symmetry of the solid brings nearer to the identity. Those are one of each set of
    /// orientations that look the same.
    pub(crate) fn is_in_zone(&self, center: &Vector3<f64>, half_edge: f64) -> bool {
        self.symmetries.iter().all(|g| {
            let v = g.imag();
            (g.w - center.dot(&v)).abs() - half_edge * v.abs().sum() <= 1.0
        })
    }

    /// The orientations that look like this one, and itself.
    #[cfg(test)]
    pub(crate) fn equal_orientations(
        &self,
        orientation: &UnitQuaternion<f64>,
    ) -> impl Iterator<Item = Quaternion<f64>> {
        let q = orientation.into_inner();
        std::iter::once(q).chain(self.symmetries.iter().map(move |g| q * g))
    }

    /// The least half edge, in steps, of a cube of Rodrigues vectors whose faces lie outside of the zone, which is
    /// convex and holds the identity.
    fn zone_half_edge(&self) -> Option<f64> {
        let is_beyond = |half: f64| {
            let cells = 32;
            let step = 2.0 * half / f64::from(cells);
            (0..3).all(|axis| {
                (0..cells * cells).all(|cell| {
                    let at = |i: i32| (f64::from(i) + 0.5) * step - half;
                    let mut center = Vector3::repeat(half);
                    center[(axis + 1) % 3] = at(cell % cells);
                    center[(axis + 2) % 3] = at(cell / cells);
                    let mut opposite = center;
                    opposite[axis] = -half;
                    !self.is_in_zone(&center, step / 2.0) && !self.is_in_zone(&opposite, step / 2.0)
                })
            })
        };
        (1..=60).map(|i| 0.02 * f64::from(i)).find(|half| is_beyond(*half))
    }
}

/// The rotations but for the identity that map corners to corners. Each is known from what it makes of the first corner
/// and a neighbour of it.
fn symmetries(corners: &[Vector3<f64>]) -> Vec<Quaternion<f64>> {
    let first = corners[0];
    let length = |p: &Vector3<f64>, q: &Vector3<f64>| (p - q).norm();
    let shortest = corners[1..].iter().map(|q| length(&first, q)).fold(f64::INFINITY, f64::min);
    let is_edge = |p: &Vector3<f64>, q: &Vector3<f64>| (length(p, q) - shortest).abs() < SAME;
    let Some(second) = corners.iter().find(|q| is_edge(&first, q)) else { return Vec::new() };
    let from = Rotation3::face_towards(&first, second).inverse();
    let mut found: Vec<Quaternion<f64>> = Vec::new();
    for p in corners {
        for q in corners.iter().filter(|q| is_edge(p, q)) {
            let turn = Rotation3::face_towards(p, q) * from;
            let maps = corners.iter().all(|v| corners.iter().any(|u| (turn * v - u).norm() < SAME));
            let quaternion = UnitQuaternion::from_rotation_matrix(&turn).into_inner();
            let is_new = found.iter().all(|g| g.dot(&quaternion).abs() < 1.0 - SAME);
            if maps && is_new && quaternion.w.abs() < 1.0 - SAME {
                found.push(quaternion);
            }
        }
    }
    found
}

impl Placed {
    /// Least and largest component of the corners along a vector, from the centre.
    #[inline]
    fn extent(&self, n: &Vector3<f64>) -> [f64; 2] {
        let (mut least, mut most) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
        for [x, y, z] in &self.corners {
            for lane in 0..4 {
                let height = x[lane] * n.x + y[lane] * n.y + z[lane] * n.z;
                least[lane] = if height < least[lane] { height } else { least[lane] };
                most[lane] = if height > most[lane] { height } else { most[lane] };
            }
        }
        [least.into_iter().fold(f64::INFINITY, f64::min), most.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Whether the other one, moved, lies apart from this one by a gap along some direction; a negative gap asks
    /// whether they overlap by less than so much.
    ///
    /// The direction along which two convex polyhedra that overlap need the least way apart is the normal of a face of
    /// one of them or of an edge of each (Gottschalk, Lin and Manocha 1996, DOI 10.1145/237170.237244).
    pub(crate) fn keeps(&self, gap: f64, other: &Self, moved: &Vector3<f64>) -> bool {
        let r = other.center + moved - self.center;
        let along = |n: &Vector3<f64>| {
            let ([low, high], [other_low, other_high]) = (self.extent(n), other.extent(n));
            let s = r.dot(n);
            (s + other_low - high).max(low - s - other_high)
        };
        if r.try_normalize(SAME).is_some_and(|n| along(&n) >= gap) {
            return true;
        }
        self.normals.iter().chain(&other.normals).any(|n| along(n) >= gap)
            || self.edges.iter().any(|edge| {
                let crosses = other.edges.iter().filter_map(|e| edge.cross(e).try_normalize(LEAST_SINE));
                crosses.into_iter().any(|n| along(&n) >= gap)
            })
    }
}
