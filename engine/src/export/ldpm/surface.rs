//! The surface of a specimen: its vertices, edges and faces, each with coordinates in which lengths and areas
//! are true. It is independent of where nodes go, except on lateral surfaces.
//!
//! The convex hull of points scattered on a lateral surface is no good surface: where nothing is curved along the axis,
//! its triangles are needles from end to end. So nodes of a lateral surface lie on common lines parallel to the axis,
//! its *rulings*, whose coordinates they share to the last bit: the hull is a prism of plane sides then, exactly.

use std::f64::consts::{PI, TAU};

use crate::arrays::{self, Each as _};
use crate::domain::Lateral;
use crate::elementary::{asin, hypot, sin_cos};
use crate::request::Specimen;

/// The parts of a surface.
#[derive(Debug)]
pub(super) struct Surface {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) edges: Vec<Edge>,
    pub(super) lateral: Option<LateralSurface>,
    pub(super) faces: Vec<Face>,
}

impl Surface {
    /// The surface of a specimen that has one.
    pub(super) fn of(specimen: &Specimen) -> Self {
        let domain = specimen.domain();
        let [.., height] = domain.bounds_mm;
        let Some(Lateral { radius_mm: radius, .. }) = domain.lateral() else {
            return Self::of_box(domain.bounds_mm);
        };
        Self {
            vertices: Vec::new(),
            edges: Vec::new(),
            lateral: Some(LateralSurface { radius, height }),
            faces: [0.0, height].map(|z| Face::Disc { radius, z }).to_vec(),
        }
    }

    fn of_box(size: [f64; 3]) -> Self {
        let corner =
            |bits: usize| -> [f64; 3] { arrays::from_fn(|a| if bits >> a & 1 == 1 { size[a] } else { 0.0 }) };
        let mut edges = Vec::new();
        let mut faces = Vec::new();
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            for sides in 0..4 {
                let origin = corner((sides & 1) << others[0] | (sides >> 1) << others[1]);
                edges.push(Edge { origin, axis, length: size[axis] });
            }
            for side in 0..2 {
                let origin = corner(side << axis);
                faces.push(Face::Rectangle { origin, axes: others, size: others.each(|a| size[a]) });
            }
        }
        Self { vertices: (0..8).map(corner).collect(), edges, lateral: None, faces }
    }
}

/// A straight line along an axis, measured by the length along it: an edge of a box, a ruling of a cylinder.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) origin: [f64; 3],
    pub(super) axis: usize,
    pub(super) length: f64,
}

impl Edge {
    /// The point after a length.
    pub(super) fn at(&self, along: f64) -> [f64; 3] {
        let mut p = self.origin;
        p[self.axis] += along;
        p
    }

    /// The part of the line inside a ball.
    pub(super) fn inside(&self, center: [f64; 3], radius: f64) -> Option<(f64, f64)> {
        let off2: f64 =
            (0..3).filter(|&a| a != self.axis).map(|a| (center[a] - self.origin[a]).powi(2)).sum();
        let half2 = radius * radius - off2;
        let middle = center[self.axis] - self.origin[self.axis];
        (half2 > 0.0).then(|| (middle - half2.sqrt(), middle + half2.sqrt()))
    }
}

/// The lateral surface of a cylinder.
#[derive(Clone, Copy, Debug)]
pub(super) struct LateralSurface {
    pub(super) radius: f64,
    pub(super) height: f64,
}

impl LateralSurface {
    pub(super) fn area(&self) -> f64 {
        TAU * self.radius * self.height
    }

    /// As many rulings as go around at distances of at least `distance`, the first after the fraction `turn` of a
    /// step.
    pub(super) fn rulings(&self, distance: f64, turn: f64) -> Vec<Edge> {
        let step = 2.0 * asin((distance / (2.0 * self.radius)).min(1.0));
        let count = ((TAU / step) as usize).max(1);
        let ruling = |i: usize| {
            let (sine, cosine) = sin_cos(TAU * (i as f64 + turn) / count as f64);
            let origin = [self.radius * (1.0 + cosine), self.radius * (1.0 + sine), 0.0];
            Edge { origin, axis: 2, length: self.height }
        };
        (0..count).map(ruling).collect()
    }
}

/// A plane face in plane coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) enum Face {
    /// A side of a box.
    Rectangle { origin: [f64; 3], axes: [usize; 2], size: [f64; 2] },
    /// An end of a cylinder, in the square around it.
    Disc { radius: f64, z: f64 },
}

impl Face {
    /// Width and height of the region of coordinates.
    pub(super) fn size(&self) -> [f64; 2] {
        match *self {
            Self::Rectangle { size, .. } => size,
            Self::Disc { radius, .. } => [2.0 * radius; 2],
        }
    }

    pub(super) fn area(&self) -> f64 {
        match *self {
            Self::Rectangle { size: [width, height], .. } => width * height,
            Self::Disc { radius, .. } => PI * radius * radius,
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
        }
    }

    /// Whether the coordinates are those of a point.
    pub(super) fn has(&self, uv: [f64; 2]) -> bool {
        self.reaches(uv, [0.0; 2])
    }

    /// Whether some point lies in a rectangle of coordinates, given by its middle and half its sides.
    pub(super) fn reaches(&self, middle: [f64; 2], half: [f64; 2]) -> bool {
        match *self {
            Self::Rectangle { .. } => true,
            Self::Disc { radius, .. } => {
                let off = |a: usize| ((middle[a] - radius).abs() - half[a]).max(0.0);
                hypot(off(0), off(1)) <= radius
            }
        }
    }
}
