//! Templates of polyhedra with what is computed of them once: planes, edges, distances, chords, and the surface of the
//! rounded body as polygons ([`Skin`]).
//!
//! All is done in the axes and the unit of the template; a grain of the diameter `d`, the rotation `R` and the centre
//! `x` is seen at `Rᵀ (p - x) / d`. The body of a core that is rounded by the radius `r` is the union of the core, the
//! prisms of the height `r` on its faces, the cylinders of the radius `r` about its edges and the spheres of that
//! radius about its vertices. The body is convex: a line enters it where it first meets one of these, and leaves it
//! where it leaves the last.

mod lines;
mod skin;

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::elementary::atan2;
use crate::shape::{Polyhedron, Pose};
pub(crate) use lines::Lines;
use lines::Slant;
pub(crate) use skin::{Skin, SkinPoint};

/// A template with what is computed of it once.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Convex {
    pub(crate) vertices: Vec<Vector3<f64>>,
    /// Faces by their vertices, counter-clockwise as seen from outside.
    pub(crate) faces: Vec<Vec<u32>>,
    /// Outward unit normal of each face and its height above the origin.
    pub(crate) planes: Vec<(Vector3<f64>, f64)>,
    pub(crate) edges: Vec<ConvexEdge>,
    /// Radius of rounding.
    pub(crate) rounding: f64,
    /// Radius of the sphere about the origin that holds the body.
    pub(crate) outer: f64,
}

/// An edge of a template.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ConvexEdge {
    pub(crate) ends: [u32; 2],
    /// The face where the first end comes before the second, and the other one.
    pub(crate) faces: [u32; 2],
    /// From the first end to the second, a unit vector.
    axis: Vector3<f64>,
    length: f64,
    /// Angle between the normals of the faces.
    pub(crate) angle: f64,
}

/// Where a grain is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) center: Vector3<f64>,
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) scale: f64,
}

impl Place {
    pub(crate) fn new(d_mm: f64, pose: &Pose) -> Self {
        Self { center: pose.center_mm, rotation: pose.rotation(), scale: d_mm }
    }

    /// A vector in the axes and the unit of the template.
    pub(crate) fn turned_back(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(vector) / self.scale
    }

    /// A point in the axes and the unit of the template.
    pub(crate) fn local(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.turned_back(&(p - self.center))
    }
}

impl Convex {
    pub(crate) fn new(template: &Polyhedron) -> Self {
        let vertices = template.vertices().to_vec();
        let faces = template.faces().to_vec();
        let planes: Vec<_> = (0..faces.len()).map(|face| template.plane(face)).collect();
        let mut face_of = BTreeMap::new();
        for (face, corners) in (0..).zip(&faces) {
            face_of.extend(directed_edges(corners).map(|edge| (edge, face)));
        }
        let both =
            face_of.iter().filter(|([from, to], _)| from < to).filter_map(|(&ends, &face): (_, &u32)| {
                let other = *face_of.get(&[ends[1], ends[0]])?;
                let along = vertices[ends[1] as usize] - vertices[ends[0] as usize];
                let (m, n) = (planes[face as usize].0, planes[other as usize].0);
                Some(ConvexEdge {
                    ends,
                    faces: [face, other],
                    axis: along.normalize(),
                    length: along.norm(),
                    angle: atan2(m.cross(&n).norm(), m.dot(&n)),
                })
            });
        let edges = both.collect();
        let rounding = template.rounding();
        let outer = rounding + vertices.iter().map(Vector3::norm).fold(0.0, f64::max);
        Self { vertices, faces, planes, edges, rounding, outer }
    }

    pub(crate) fn all(templates: &[Polyhedron]) -> Vec<Self> {
        templates.iter().map(Self::new).collect()
    }

    fn vertex(&self, vertex: u32) -> &Vector3<f64> {
        &self.vertices[vertex as usize]
    }

    /// Height above the highest of the planes: a lower bound of the distance from the core, and minus the distance to
    /// its surface for points inside.
    pub(crate) fn height(&self, p: &Vector3<f64>) -> f64 {
        self.planes.iter().map(|(normal, height)| normal.dot(p) - height).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether the foot of a point on the plane of a face lies on the face.
    fn is_over(&self, face: usize, p: &Vector3<f64>) -> bool {
        let normal = &self.planes[face].0;
        directed_edges(&self.faces[face]).all(|[from, to]| {
            let (from, to) = (self.vertex(from), self.vertex(to));
            normal.dot(&(to - from).cross(&(p - from))) >= 0.0
        })
    }

    /// The point of the core that is nearest to a point outside of it; none for points inside.
    pub(crate) fn nearest(&self, p: &Vector3<f64>) -> Option<Vector3<f64>> {
        let mut is_outside = false;
        for (face, (normal, height)) in self.planes.iter().enumerate() {
            let above = normal.dot(p) - height;
            if above > 0.0 {
                is_outside = true;
                if self.is_over(face, p) {
                    return Some(p - normal * above);
                }
            }
        }
        if !is_outside {
            return None;
        }
        let on_edge = |edge: &ConvexEdge| {
            let from = self.vertex(edge.ends[0]);
            from + edge.axis * (p - from).dot(&edge.axis).clamp(0.0, edge.length)
        };
        let points = self.edges.iter().map(on_edge);
        points.min_by(|a, b| (p - a).norm_squared().total_cmp(&(p - b).norm_squared()))
    }

    /// Distance of a point from the body, negative inside: exact outside and near the surface of a rounded body, and
    /// within the core.
    pub(crate) fn distance(&self, p: &Vector3<f64>) -> f64 {
        let to_core = self.nearest(p).map_or_else(|| self.height(p), |nearest| (p - nearest).norm());
        to_core - self.rounding
    }

    /// Outward normal at a point of the surface.
    pub(crate) fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let from_core =
            || self.nearest(p).and_then(|nearest| (p - nearest).try_normalize(1e-9 * self.rounding));
        let rounded = if self.rounding > 0.0 { from_core() } else { None };
        rounded.unwrap_or_else(|| {
            let above = |plane: &&(Vector3<f64>, f64)| plane.0.dot(p) - plane.1;
            let highest = self.planes.iter().max_by(|a, b| above(a).total_cmp(&above(b)));
            highest.map_or_else(Vector3::z, |plane| plane.0)
        })
    }

    /// Where the line `from + t direction` enters the body and leaves it, in multiples of the direction.
    pub(crate) fn chord(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
        if self.rounding > 0.0 {
            self.rounded_chord(from, direction)
        } else {
            self.chord_of_planes(from, direction, 0.0)
        }
    }

    /// The same for the body that the planes of the faces enclose, moved outwards by a length.
    fn chord_of_planes(
        &self,
        from: &Vector3<f64>,
        direction: &Vector3<f64>,
        outwards: f64,
    ) -> Option<[f64; 2]> {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for (normal, height) in &self.planes {
            let (slope, above) = (normal.dot(direction), normal.dot(from) - height - outwards);
            if slope < 0.0 {
                enter = enter.max(-above / slope);
            } else if slope > 0.0 {
                leave = leave.min(-above / slope);
            } else if above > 0.0 {
                return None;
            }
        }
        (enter < leave).then_some([enter, leave])
    }

    fn rounded_chord(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
        let r = self.rounding;
        // The planes of the faces, moved outwards by the radius, enclose the body: most lines that miss it miss these.
        self.chord_of_planes(from, direction, r * (1.0 + 1e-9))?;
        let length2 = direction.norm_squared();
        let mut chord = [f64::INFINITY, f64::NEG_INFINITY];
        let mut meets = |t: f64| chord = [chord[0].min(t), chord[1].max(t)];
        for vertex in &self.vertices {
            lines::sphere(vertex, [from, direction], r, length2, &mut meets);
        }
        for edge in &self.edges {
            let from = from - self.vertex(edge.ends[0]);
            Slant::new(edge, direction).cylinder(edge, &from, r, length2, &mut meets);
        }
        for (face, (normal, height)) in self.planes.iter().enumerate() {
            let slope = normal.dot(direction);
            if slope != 0.0 {
                let t = (height + r - normal.dot(from)) / slope;
                if self.is_over(face, &(from + direction * t)) {
                    meets(t);
                }
            }
        }
        (chord[0] < chord[1]).then_some(chord)
    }
}

/// The directed edges of a face.
pub(crate) fn directed_edges(corners: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&from, &to)| [from, to])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;

    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;
    use crate::shape::polyhedron::samples::{cuboid, hull, octahedron};

    fn bodies() -> Vec<Polyhedron> {
        let sharp = [
            cuboid([1.0, 0.7, 0.4], 0.0),
            octahedron(1.0),
            hull(
                &[[1.0, 0.1, 0.0], [-0.8, 0.5, 0.1], [0.1, -0.9, -0.3], [0.2, 0.3, 1.1], [-0.1, -0.2, -0.9]]
                    .map(Vector3::from),
                0.0,
            )
            .unwrap(),
        ];
        let rounded = sharp.each_ref().map(|body| body.with_relative_rounding(0.1).unwrap());
        sharp.into_iter().chain(rounded).map(|body| body.normalized()).collect()
    }

    /// Skins are closed, turned outwards, and their corners lie on the body; with finer arcs they have its volume.
    #[test]
    fn skins_are_closed_and_have_the_volume_of_the_body() {
        for body in bodies() {
            let form = Convex::new(&body);
            for (angle, most_missing) in [(2.0, 0.1), (0.1, 0.003)] {
                let skin = Skin::new(&form, angle);
                let at = |p: u32| {
                    let SkinPoint { vertex, normal } = skin.points[p as usize];
                    form.vertices[vertex as usize] + normal * form.rounding
                };
                assert!((0..skin.points.len() as u32).all(|p| form.distance(&at(p)).abs() < 1e-9));
                let edges: Vec<[u32; 2]> =
                    skin.polygons.iter().flat_map(|(_, corners)| directed_edges(corners)).collect();
                let all: BTreeSet<[u32; 2]> = edges.iter().copied().collect();
                assert_eq!(all.len(), edges.len());
                assert!(all.iter().all(|[a, b]| all.contains(&[*b, *a])));
                let volume: f64 = skin
                    .polygons
                    .iter()
                    .flat_map(|(_, corners)| {
                        corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]])
                    })
                    .map(|corners| {
                        let [a, b, c] = corners.map(at);
                        a.dot(&b.cross(&c)) / 6.0
                    })
                    .sum();
                let missing = 1.0 - volume / body.volume();
                assert!((-1e-9..most_missing).contains(&missing), "{missing}");
            }
        }
    }

    properties! {
        /// The ends of chords lie on the surface, what is between them inside, and lines that are told to miss do.
        #[test]
        fn chords_end_on_the_surface(
            from in prop::array::uniform3(-1.5..1.5_f64), direction in prop::array::uniform3(-1.0..1.0_f64),
            which in 0..6_usize,
        ) {
            let form = Convex::new(&bodies()[which]);
            let (from, direction) = (Vector3::from(from), Vector3::from(direction));
            prop_assume!(direction.norm() > 0.1);
            match form.chord(&from, &direction) {
                Some([enter, leave]) => {
                    for t in [enter, leave] {
                        let d = form.distance(&(from + direction * t));
                        prop_assert!(d.abs() < 1e-9, "{d}");
                    }
                    prop_assert!(form.distance(&(from + direction * ((enter + leave) / 2.0))) < 1e-9);
                }
                None => {
                    for i in -40..=40 {
                        let p = from + direction * (0.1 * f64::from(i));
                        prop_assert!(form.distance(&p) > -1e-9);
                    }
                }
            }
        }

        /// Normals are those along which the distance grows.
        #[test]
        fn points_moved_along_normals_are_as_far_away(
            from in prop::array::uniform3(-0.2..0.2_f64), direction in prop::array::uniform3(-1.0..1.0_f64),
            which in 0..6_usize,
        ) {
            let form = Convex::new(&bodies()[which]);
            let (from, direction) = (Vector3::from(from), Vector3::from(direction));
            prop_assume!(direction.norm() > 0.1);
            if let Some([_, leave]) = form.chord(&from, &direction) {
                let on = from + direction * leave;
                let away = on + form.normal(&on) * 0.3;
                prop_assert!((form.distance(&away) - 0.3).abs() < 1e-9);
            }
        }
    }
}
