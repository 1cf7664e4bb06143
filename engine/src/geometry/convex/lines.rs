//! Chords of a template along many lines of one direction, to the last bit those that [`Convex::chord`] finds.
//!
//! What depends on the direction alone is computed once. Of a rounded body most vertices and edges are farther from a
//! line than its radius, which their pictures in the plane across the lines tell, and most faces cannot be where the
//! line enters or leaves; those are left out with margins that no rounding reaches.

use nalgebra::Vector3;

use super::{Convex, ConvexEdge};

/// Of the square of the size of what is computed with: far more than its rounding.
const MARGIN: f64 = 1e-9;
/// Height above a plane, in units of the template, from which a point is not on the body: far more than its rounding,
/// and so little that few lines come as near to an edge.
const HEIGHT_MARGIN: f64 = 1e-4;
/// Square of the sine of the angle between an edge and the lines, from which their distance is computed.
const LEAST_SINE2: f64 = 1e-6;

/// Lines of one direction. The memory serves many directions.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    direction: Vector3<f64>,
    length2: f64,
    /// Unit vectors across the direction and each other.
    axes: [Vector3<f64>; 2],
    /// Product of the direction and the normal, for each face.
    slopes: Vec<f64>,
    /// Pictures of the vertices along the axes.
    vertices: Vec<[f64; 2]>,
    edges: Vec<EdgeAcross>,
}

/// An edge as the lines see it.
#[derive(Clone, Copy, Debug)]
struct EdgeAcross {
    slant: Slant,
    /// Unit vector across the edge and the lines, along the axes; zero for an edge along the lines.
    normal: [f64; 2],
    /// The place of the edge along it.
    place: f64,
}

/// An edge and the direction of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slant {
    /// Product of the direction and the axis.
    of_line: f64,
    /// The part of the direction across the axis.
    across: Vector3<f64>,
    /// Its square.
    a: f64,
}

impl Slant {
    pub(super) fn new(edge: &ConvexEdge, direction: &Vector3<f64>) -> Self {
        let of_line = direction.dot(&edge.axis);
        let across = direction - edge.axis * of_line;
        Self { of_line, across, a: across.norm_squared() }
    }

    /// Calls `meets` with where a line meets the cylinder about an edge, between its ends. `from` is seen from its
    /// start.
    pub(super) fn cylinder(
        &self,
        edge: &ConvexEdge,
        from: &Vector3<f64>,
        radius: f64,
        length2: f64,
        mut meets: impl FnMut(f64),
    ) {
        let Self { of_line, across, a } = *self;
        let of_start = from.dot(&edge.axis);
        let apart = from - edge.axis * of_start;
        let b = across.dot(&apart);
        let root = b * b - a * (apart.norm_squared() - radius * radius);
        if root > 0.0 && a > 1e-24 * length2 {
            let root = root.sqrt();
            for t in [(-b - root) / a, (-b + root) / a] {
                if (0.0..=edge.length).contains(&(of_start + t * of_line)) {
                    meets(t);
                }
            }
        }
    }
}

/// Calls `meets` with where the line `from + t direction` meets the sphere about a vertex.
pub(super) fn sphere(
    vertex: &Vector3<f64>,
    [from, direction]: [&Vector3<f64>; 2],
    radius: f64,
    length2: f64,
    mut meets: impl FnMut(f64),
) {
    let to = vertex - from;
    let along = to.dot(direction);
    let root = along * along - length2 * (to.norm_squared() - radius * radius);
    if root > 0.0 {
        let root = root.sqrt();
        meets((along - root) / length2);
        meets((along + root) / length2);
    }
}

impl Lines {
    /// Makes these the lines of a direction through a template. The direction is not zero.
    pub(crate) fn aim(&mut self, form: &Convex, direction: &Vector3<f64>) {
        self.direction = *direction;
        self.length2 = direction.norm_squared();
        self.slopes.clear();
        self.slopes.extend(form.planes.iter().map(|(normal, _)| normal.dot(direction)));
        self.vertices.clear();
        self.edges.clear();
        if form.rounding <= 0.0 {
            return;
        }
        let unit = direction / self.length2.sqrt();
        let u = unit.cross(&[Vector3::x(), Vector3::y(), Vector3::z()][unit.iamin()]).normalize();
        self.axes = [u, unit.cross(&u)];
        let axes = self.axes;
        let picture = |p: &Vector3<f64>| axes.map(|axis| axis.dot(p));
        self.vertices.extend(form.vertices.iter().map(picture));
        for edge in &form.edges {
            let slant = Slant::new(edge, direction);
            let mut normal = [0.0; 2];
            if slant.a > LEAST_SINE2 * self.length2 {
                normal = picture(&unit.cross(&edge.axis).normalize());
            }
            let [u, v] = self.vertices[edge.ends[0] as usize];
            self.edges.push(EdgeAcross { slant, normal, place: normal[0] * u + normal[1] * v });
        }
    }

    /// Where the line through a point enters the template that was aimed at, and leaves it, in multiples of the
    /// direction.
    pub(crate) fn chord(&self, form: &Convex, from: &Vector3<f64>) -> Option<[f64; 2]> {
        if form.rounding > 0.0 {
            self.rounded_chord(form, from)
        } else {
            self.chord_of_planes(form, from, 0.0).map(|ends| ends.map(|(t, _)| t))
        }
    }

    /// The chord of the body that the planes of the faces enclose, moved outwards by a length: its ends, each with the
    /// slope of the face there.
    fn chord_of_planes(&self, form: &Convex, from: &Vector3<f64>, outwards: f64) -> Option<[(f64, f64); 2]> {
        let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0.0), (f64::INFINITY, 0.0));
        for ((normal, height), &slope) in form.planes.iter().zip(&self.slopes) {
            let above = normal.dot(from) - height - outwards;
            if slope < 0.0 {
                let t = -above / slope;
                if t > enter.0 {
                    enter = (t, slope);
                }
            } else if slope > 0.0 {
                let t = -above / slope;
                if t < leave.0 {
                    leave = (t, slope);
                }
            } else if above > 0.0 {
                return None;
            }
        }
        (enter.0 < leave.0).then_some([enter, leave])
    }

    fn rounded_chord(&self, form: &Convex, from: &Vector3<f64>) -> Option<[f64; 2]> {
        let (r, direction, length2) = (form.rounding, &self.direction, self.length2);
        let [enter, leave] = self.chord_of_planes(form, from, r * (1.0 + 1e-9))?;
        let mut chord = [f64::INFINITY, f64::NEG_INFINITY];
        let mut meets = |t: f64| chord = [chord[0].min(t), chord[1].max(t)];
        let [u, v] = [self.axes[0].dot(from), self.axes[1].dot(from)];
        let reach2 = r * r + MARGIN * (form.outer * form.outer + from.norm_squared());
        for (vertex, [at_u, at_v]) in form.vertices.iter().zip(&self.vertices) {
            let (du, dv) = (at_u - u, at_v - v);
            if du * du + dv * dv <= reach2 {
                sphere(vertex, [from, direction], r, length2, &mut meets);
            }
        }
        for (edge, EdgeAcross { slant, normal, place }) in form.edges.iter().zip(&self.edges) {
            let apart = normal[0] * u + normal[1] * v - place;
            if apart * apart <= reach2 {
                slant.cylinder(edge, &(from - form.vertex(edge.ends[0])), r, length2, &mut meets);
            }
        }
        // Beyond these the line is above the plane by which it enters or leaves.
        let first = enter.0 + HEIGHT_MARGIN / enter.1;
        let last = leave.0 + HEIGHT_MARGIN / leave.1;
        for (face, ((normal, height), &slope)) in form.planes.iter().zip(&self.slopes).enumerate() {
            let above = height + r - normal.dot(from);
            let [low, high] = if slope > 0.0 { [first, last] } else { [last, first] }.map(|t| t * slope);
            if slope != 0.0 && !(above < low || above > high) {
                let t = above / slope;
                if form.is_over(face, &(from + direction * t)) {
                    meets(t);
                }
            }
        }
        (chord[0] < chord[1]).then_some(chord)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;
    use crate::shape::Polyhedron;
    use crate::shape::polyhedron::samples::{cuboid, hull, octahedron};

    fn bodies() -> Vec<Convex> {
        let points = |count: usize| -> Vec<Vector3<f64>> {
            let at = |i: usize, step: f64| (i as f64 * step + 0.3).fract() - 0.5;
            let point = |i| Vector3::new(at(i, 0.618_034), 0.8 * at(i, 0.754_878), 0.6 * at(i, 0.569_84));
            (0..count).map(|i| point(i) / point(i).norm().sqrt()).collect()
        };
        let sharp = [
            cuboid([1.0, 0.7, 0.4], 0.0),
            octahedron(1.0),
            hull(&points(12), 0.0).unwrap(),
            hull(&points(24), 0.0).unwrap(),
        ];
        let rounded = |body: &Polyhedron| {
            [1e-6, 0.01, 0.1, 0.6]
                .map(|roundness| body.with_relative_rounding(roundness))
                .into_iter()
                .flatten()
        };
        let all: Vec<Polyhedron> = sharp.iter().flat_map(rounded).chain(sharp.clone()).collect();
        all.iter().map(|body| Convex::new(&body.normalized())).collect()
    }

    /// Lines through points of the surface, along edges and normals too, where ends of several pieces fall together.
    #[test]
    fn chords_along_a_direction_are_those_of_single_lines() {
        let mut lines = Lines::default();
        let mut met = 0;
        for form in bodies() {
            let axes = form.edges.iter().map(|edge| edge.axis);
            let normals = form.planes.iter().map(|(normal, _)| *normal);
            let others = (1..20).map(|i| Vector3::new(f64::from(i).sin(), f64::from(i * i).cos(), 0.1));
            let directions: Vec<Vector3<f64>> = axes.chain(normals).chain(others).collect();
            let through: Vec<Vector3<f64>> = form
                .edges
                .iter()
                .flat_map(|edge| {
                    let [a, b] = edge.ends.map(|end| *form.vertex(end));
                    let outwards = form.planes[edge.faces[0] as usize].0 * form.rounding;
                    [a, a + outwards, b + outwards, (a + b) / 2.0 + outwards, (a + b) * 0.45]
                })
                .collect();
            for direction in directions {
                for scale in [1.0, 0.13] {
                    let direction = direction * scale;
                    lines.aim(&form, &direction);
                    for from in &through {
                        let chord = lines.chord(&form, from);
                        assert_eq!(chord, form.chord(from, &direction), "{from} {direction}");
                        met += usize::from(chord.is_some());
                    }
                }
            }
        }
        assert!(met > 10_000, "{met}");
    }

    properties! {
        #[test]
        fn chords_along_any_direction_are_those_of_single_lines(
            starts in prop::collection::vec(prop::array::uniform3(-0.9..0.9_f64), 50),
            direction in prop::array::uniform3(-1.0..1.0_f64), scale in 0.01..100.0_f64, which in 0_usize..20,
        ) {
            let forms = bodies();
            let form = &forms[which % forms.len()];
            let direction = Vector3::from(direction) * scale;
            prop_assume!(direction.norm() > 0.1 * scale);
            let mut lines = Lines::default();
            lines.aim(form, &direction);
            for from in starts.into_iter().map(Vector3::from) {
                prop_assert_eq!(lines.chord(form, &from), form.chord(&from, &direction));
            }
        }
    }
}
