//! Templates of polyhedra as exports see them: planes, edges, distances, chords, and the skin of the rounded body.
//!
//! All is done in the axes and the unit of the template; a grain of the diameter `d`, the rotation `R` and the centre
//! `x`
//! is seen at `Rᵀ (p - x) / d`. The body of a core that is rounded by the radius `r` is the union of the core, the
//! prisms of the height `r` on its faces, the cylinders of the radius `r` about its edges and the spheres of that
//! radius about its vertices. Each of these is convex and lies inside, and so does the body: a line enters it where it
//! first meets one of them, and leaves it where it leaves the last.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::packing::Solids;
use crate::shape::{Polyhedron, Pose};

/// A template with what is computed of it once.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Convex {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Faces by their vertices, counter-clockwise as seen from outside.
    pub(super) faces: Vec<Vec<u32>>,
    /// Outward unit normal of each face and its height above the origin.
    pub(super) planes: Vec<(Vector3<f64>, f64)>,
    pub(super) edges: Vec<ConvexEdge>,
    /// Radius of rounding.
    pub(super) rounding: f64,
}

/// An edge of a template.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ConvexEdge {
    pub(super) ends: [u32; 2],
    /// The face where the first end comes before the second, and the other one.
    pub(super) faces: [u32; 2],
    /// From the first end to the second, a unit vector.
    axis: Vector3<f64>,
    length: f64,
    /// Angle between the normals of the faces.
    pub(super) angle: f64,
}

/// Where a grain is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) center: Vector3<f64>,
    pub(super) rotation: Matrix3<f64>,
    pub(super) scale: f64,
}

impl Place {
    pub(super) fn new(d_mm: f64, pose: &Pose) -> Self {
        Self { center: pose.center_mm, rotation: pose.rotation(), scale: d_mm }
    }

    /// Where a grain of a packing is.
    pub(super) fn of(grains: &Solids, grain: usize) -> Self {
        Self::new(grains.shapes[grain].d_mm(), &grains.poses[grain])
    }

    /// A vector in the axes and the unit of the template.
    pub(super) fn turned_back(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(vector) / self.scale
    }

    /// A point in the axes and the unit of the template.
    pub(super) fn local(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.turned_back(&(p - self.center))
    }
}

impl Convex {
    pub(super) fn new(template: &Polyhedron) -> Self {
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
                    angle: m.cross(&n).norm().atan2(m.dot(&n)),
                })
            });
        let edges = both.collect();
        Self { edges, vertices, faces, planes, rounding: template.rounding() }
    }

    pub(super) fn all(templates: &[Polyhedron]) -> Vec<Self> {
        templates.iter().map(Self::new).collect()
    }

    fn vertex(&self, vertex: u32) -> &Vector3<f64> {
        &self.vertices[vertex as usize]
    }

    /// Height above the highest of the planes: a lower bound of the distance from the core, and minus the distance to
    /// its surface for points inside.
    pub(super) fn height(&self, p: &Vector3<f64>) -> f64 {
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
    pub(super) fn nearest(&self, p: &Vector3<f64>) -> Option<Vector3<f64>> {
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
    pub(super) fn distance(&self, p: &Vector3<f64>) -> f64 {
        let to_core = self.nearest(p).map_or_else(|| self.height(p), |nearest| (p - nearest).norm());
        to_core - self.rounding
    }

    /// Outward normal at a point of the surface.
    pub(super) fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
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
    pub(super) fn chord(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
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
            let to = vertex - from;
            let along = to.dot(direction);
            let root = along * along - length2 * (to.norm_squared() - r * r);
            if root > 0.0 {
                let root = root.sqrt();
                meets((along - root) / length2);
                meets((along + root) / length2);
            }
        }
        for edge in &self.edges {
            let start = self.vertex(edge.ends[0]);
            let (of_line, of_start) = (direction.dot(&edge.axis), (from - start).dot(&edge.axis));
            let (across, apart) = (direction - edge.axis * of_line, from - start - edge.axis * of_start);
            let (a, b) = (across.norm_squared(), across.dot(&apart));
            let root = b * b - a * (apart.norm_squared() - r * r);
            if root > 0.0 && a > 1e-24 * length2 {
                let root = root.sqrt();
                for t in [(-b - root) / a, (-b + root) / a] {
                    if (0.0..=edge.length).contains(&(of_start + t * of_line)) {
                        meets(t);
                    }
                }
            }
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
pub(super) fn directed_edges(corners: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&from, &to)| [from, to])
}

/// A point of a skin: a vertex of the core, and the unit normal along which it is moved by the radius of rounding.
#[derive(Clone, Copy, Debug)]
pub(super) struct SkinPoint {
    pub(super) vertex: u32,
    pub(super) normal: Vector3<f64>,
}

/// The surface of a body as convex polygons with their corners on it: of a sharp one its faces; of a rounded one its
/// faces, rectangles around its edges and triangles around its vertices.
#[derive(Clone, Debug, Default)]
pub(super) struct Skin {
    pub(super) points: Vec<SkinPoint>,
    /// The part of the body that each polygon belongs to, faces first, then edges, then vertices; and its corners,
    /// counter-clockwise as seen from outside.
    pub(super) polygons: Vec<(u32, Vec<u32>)>,
}

impl Skin {
    /// The skin of a template, whose arcs are divided so that no part turns by more than an angle.
    pub(super) fn new(form: &Convex, most_angle: f64) -> Self {
        if form.rounding == 0.0 {
            let points =
                (0..form.vertices.len() as u32).map(|vertex| SkinPoint { vertex, normal: Vector3::zeros() });
            return Self {
                points: points.collect(),
                polygons: (0..).zip(form.faces.iter().cloned()).collect(),
            };
        }
        let mut skin = Self::default();
        // The point of each face at each of its vertices.
        let mut own = BTreeMap::new();
        for (face, corners) in (0_u32..).zip(&form.faces) {
            let normal = form.planes[face as usize].0;
            let points: Vec<u32> = corners.iter().map(|&vertex| skin.point(vertex, normal)).collect();
            own.extend(corners.iter().zip(&points).map(|(&vertex, &point)| ((face, vertex), point)));
            skin.polygons.push((face, points));
        }
        // The points between the faces of an edge at each of its ends, from the first face to the second.
        let mut arcs = BTreeMap::new();
        for (i, edge) in (form.faces.len() as u32..).zip(&form.edges) {
            let [from, to] = edge.ends.map(|vertex| {
                let arc = skin.arc(form, edge, vertex, most_angle, &own);
                let [first, second] = edge.faces;
                arcs.insert((vertex, first, second), arc.clone());
                arcs.insert((vertex, second, first), arc.iter().rev().copied().collect());
                arc
            });
            for (a, b) in from.windows(2).zip(to.windows(2)) {
                skin.polygons.push((i, vec![a[0], a[1], b[1], b[0]]));
            }
        }
        let first = (form.faces.len() + form.edges.len()) as u32;
        for vertex in 0..form.vertices.len() as u32 {
            skin.cap(form, vertex, first + vertex, &arcs);
        }
        skin
    }

    fn point(&mut self, vertex: u32, normal: Vector3<f64>) -> u32 {
        self.points.push(SkinPoint { vertex, normal });
        self.points.len() as u32 - 1
    }

    fn arc(
        &mut self,
        form: &Convex,
        edge: &ConvexEdge,
        vertex: u32,
        most_angle: f64,
        own: &BTreeMap<(u32, u32), u32>,
    ) -> Vec<u32> {
        let [first, second] = edge.faces.map(|face| own[&(face, vertex)]);
        let [m, n] = edge.faces.map(|face| form.planes[face as usize].0);
        let parts = (edge.angle / most_angle - 1e-9).ceil().max(1.0);
        let mut arc = vec![first];
        for part in 1..parts as u32 {
            let turned = edge.angle * f64::from(part) / parts;
            let normal = m * (edge.angle - turned).sin() + n * turned.sin();
            arc.push(self.point(vertex, normal.normalize()));
        }
        arc.push(second);
        arc
    }

    /// The spherical polygon around a vertex as a fan about its middle.
    fn cap(&mut self, form: &Convex, vertex: u32, part: u32, arcs: &BTreeMap<(u32, u32, u32), Vec<u32>>) {
        // From each face around the vertex to the next, counter-clockwise: across the edge to the vertex before.
        let mut next = BTreeMap::new();
        for edge in form.edges.iter().filter(|edge| edge.ends.contains(&vertex)) {
            let [first, second] = edge.faces;
            if edge.ends[0] == vertex {
                next.insert(second, first)
            } else {
                next.insert(first, second)
            };
        }
        let Some(&start) = next.keys().next() else { return };
        let mut around = Vec::new();
        let mut face = start;
        for _ in 0..next.len() {
            let Some(&following) = next.get(&face) else { return };
            if let Some(arc) = arcs.get(&(vertex, face, following)) {
                around.extend_from_slice(&arc[..arc.len() - 1]);
            }
            face = following;
        }
        if around.len() == 3 {
            self.polygons.push((part, around));
            return;
        }
        let sum: Vector3<f64> = around.iter().map(|&point| self.points[point as usize].normal).sum();
        let middle = self.point(vertex, sum.normalize());
        for i in 0..around.len() {
            self.polygons.push((part, vec![around[i], around[(i + 1) % around.len()], middle]));
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;

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

    proptest! {
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
