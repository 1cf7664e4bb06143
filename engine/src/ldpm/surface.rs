//! The surface of a specimen: its vertices, edges and faces, each with coordinates in which lengths and areas
//! are true. It knows shapes; it must never know where nodes go.

use std::f64::consts::{PI, TAU};

use crate::request::Specimen;

/// The parts of a surface.
#[derive(Debug)]
pub(super) struct Surface {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) edges: Vec<Edge>,
    pub(super) faces: Vec<Face>,
}

impl Surface {
    /// The surface of a specimen that has one.
    pub(super) fn of(specimen: &Specimen) -> Self {
        match *specimen {
            Specimen::Box { size_mm, .. } => Self::of_box(size_mm),
            Specimen::Cylinder { diameter_mm, height_mm } => {
                let radius = diameter_mm / 2.0;
                let heights = [0.0, height_mm];
                let mut faces = heights.map(|z| Face::Disc { radius, z }).to_vec();
                faces.push(Face::Mantle { radius, height: height_mm });
                Self { vertices: Vec::new(), edges: heights.map(|z| Edge::Rim { radius, z }).to_vec(), faces }
            }
        }
    }

    fn of_box(size: [f64; 3]) -> Self {
        let corner = |bits: usize| -> [f64; 3] {
            std::array::from_fn(|a| if bits >> a & 1 == 1 { size[a] } else { 0.0 })
        };
        let mut edges = Vec::new();
        let mut faces = Vec::new();
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            for sides in 0..4 {
                let origin = corner((sides & 1) << others[0] | (sides >> 1) << others[1]);
                edges.push(Edge::Segment { origin, axis, length: size[axis] });
            }
            for side in 0..2 {
                faces.push(Face::Rectangle {
                    origin: corner(side << axis),
                    axes: others,
                    size: others.map(|a| size[a]),
                });
            }
        }
        Self { vertices: (0..8).map(corner).collect(), edges, faces }
    }
}

/// An edge, measured by the length along it.
#[derive(Clone, Copy, Debug)]
pub(super) enum Edge {
    /// Along an axis, between two vertices.
    Segment { origin: [f64; 3], axis: usize, length: f64 },
    /// A circle around the axis of a cylinder.
    Rim { radius: f64, z: f64 },
}

impl Edge {
    pub(super) fn length(&self) -> f64 {
        match *self {
            Self::Segment { length, .. } => length,
            Self::Rim { radius, .. } => TAU * radius,
        }
    }

    pub(super) fn is_closed(&self) -> bool {
        matches!(self, Self::Rim { .. })
    }

    /// The point after a length, which wraps around on a rim.
    pub(super) fn at(&self, along: f64) -> [f64; 3] {
        match *self {
            Self::Segment { mut origin, axis, .. } => {
                origin[axis] += along;
                origin
            }
            Self::Rim { radius, z } => around(radius, along, z),
        }
    }

    /// Length along the edge between points that are `distance` apart.
    pub(super) fn along(&self, distance: f64) -> f64 {
        match *self {
            Self::Segment { .. } => distance,
            // Beyond the diameter there is one point on a rim, no more.
            Self::Rim { radius, .. } => 2.0 * radius * (distance / (2.0 * radius)).min(1.0).asin(),
        }
    }

    /// The part of the edge inside a ball. On a rim it may begin below 0 or end beyond the length.
    pub(super) fn inside(&self, center: [f64; 3], ball_radius: f64) -> Option<(f64, f64)> {
        match *self {
            Self::Segment { origin, axis, .. } => {
                let off2: f64 = (0..3).filter(|&a| a != axis).map(|a| (center[a] - origin[a]).powi(2)).sum();
                let half2 = ball_radius * ball_radius - off2;
                let middle = center[axis] - origin[axis];
                (half2 > 0.0).then(|| (middle - half2.sqrt(), middle + half2.sqrt()))
            }
            Self::Rim { radius, z } => {
                let (x, y) = (center[0] - radius, center[1] - radius);
                let off = x.hypot(y);
                let far2 = (radius + off).powi(2) + (center[2] - z).powi(2);
                if far2 <= ball_radius * ball_radius {
                    return Some((0.0, TAU * radius));
                }
                // |p - c|^2 = radius^2 + off^2 - 2 radius off cos + dz^2
                let cosine = (radius * radius + off * off + (center[2] - z).powi(2)
                    - ball_radius * ball_radius)
                    / (2.0 * radius * off);
                if cosine >= 1.0 || cosine.is_nan() {
                    return None;
                }
                let (middle, half) = (y.atan2(x).rem_euclid(TAU), cosine.max(-1.0).acos());
                Some((radius * (middle - half), radius * (middle + half)))
            }
        }
    }
}

/// A face in plane coordinates; a mantle is unrolled.
#[derive(Clone, Copy, Debug)]
pub(super) enum Face {
    /// A side of a box.
    Rectangle { origin: [f64; 3], axes: [usize; 2], size: [f64; 2] },
    /// An end of a cylinder, in the square around it.
    Disc { radius: f64, z: f64 },
    /// The mantle of a cylinder: length around, height.
    Mantle { radius: f64, height: f64 },
}

impl Face {
    /// Width and height of the region of coordinates.
    pub(super) fn size(&self) -> [f64; 2] {
        match *self {
            Self::Rectangle { size, .. } => size,
            Self::Disc { radius, .. } => [2.0 * radius; 2],
            Self::Mantle { radius, height } => [TAU * radius, height],
        }
    }

    pub(super) fn area(&self) -> f64 {
        match *self {
            Self::Disc { radius, .. } => PI * radius * radius,
            _ => self.size().iter().product(),
        }
    }

    pub(super) fn at(&self, [u, v]: [f64; 2]) -> [f64; 3] {
        match *self {
            Self::Rectangle { mut origin, axes, .. } => {
                origin[axes[0]] += u;
                origin[axes[1]] += v;
                origin
            }
            Self::Disc { z, .. } => [u, v, z],
            Self::Mantle { radius, .. } => around(radius, u, v),
        }
    }

    /// Whether the coordinates are those of a point.
    pub(super) fn has(&self, uv: [f64; 2]) -> bool {
        self.reaches(uv, [0.0; 2])
    }

    /// Whether some point lies in a rectangle of coordinates, given by its middle and half its sides.
    pub(super) fn reaches(&self, middle: [f64; 2], half: [f64; 2]) -> bool {
        match *self {
            Self::Disc { radius, .. } => {
                let off = |a: usize| ((middle[a] - radius).abs() - half[a]).max(0.0);
                off(0).hypot(off(1)) <= radius
            }
            _ => true,
        }
    }
}

fn around(radius: f64, along: f64, z: f64) -> [f64; 3] {
    let (sine, cosine) = (along / radius).sin_cos();
    [radius * (1.0 + cosine), radius * (1.0 + sine), z]
}
