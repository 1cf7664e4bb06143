//! The walls of a specimen, as what grains face.

use super::size::Other;
use crate::domain::{Face, Lateral};
use crate::elementary::hypot;
use crate::request::Specimen;

/// The walls of a specimen, each with its point nearest to `p`. Specimens of requests have no oblique walls.
pub(super) fn walls(specimen: &Specimen, p: [f64; 3]) -> Vec<(Wall, [f64; 3])> {
    let with_foot = |face| match face {
        Face::Plane(plane) => {
            let (axis, at_mm) = plane.across()?;
            let mut foot = p;
            foot[axis] = at_mm;
            Some((Wall(Other::Plane(axis, at_mm)), foot))
        }
        Face::Lateral(Lateral { center_mm: axis, radius_mm: radius }) => {
            let (x, y) = (p[0] - axis[0], p[1] - axis[1]);
            let from_axis = hypot(x, y);
            // A grain on the axis is as near to the lateral surface all around.
            let (x, y) = if from_axis > 0.0 { (x / from_axis, y / from_axis) } else { (1.0, 0.0) };
            Some((Wall(Other::Lateral { axis, radius }), [axis[0] + radius * x, axis[1] + radius * y, p[2]]))
        }
    };
    specimen.domain().faces().filter_map(with_foot).collect()
}

/// A wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall(pub(super) Other<'static>);

impl Wall {
    /// The same seen from a point.
    pub(super) fn about(&self, [x, y, z]: [f64; 3]) -> Other<'static> {
        match self.0 {
            Other::Plane(axis, at) => Other::Plane(axis, at - [x, y, z][axis]),
            Other::Lateral { axis, radius } => Other::Lateral { axis: [axis[0] - x, axis[1] - y], radius },
            Other::Sphere { .. } | Other::Ellipsoid { .. } | Other::Polyhedron(..) => self.0,
        }
    }

    /// Distance of a point inside.
    pub(super) fn gap(&self, p: [f64; 3]) -> f64 {
        self.0.gap_mm(p)
    }
}
