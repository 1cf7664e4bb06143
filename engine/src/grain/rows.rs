//! The section of a grain by a plane across z as rows along x: from and to along x at each y.

use nalgebra::Vector3;

use crate::geometry::convex::{Convex, Lines};

/// What is used again from section to section.
#[derive(Debug, Default)]
pub(crate) struct RowLines {
    pub(super) lines: Lines,
    /// The grain that the lines are those of: all its sections, and those of its images, have the same.
    pub(super) grain: Option<usize>,
}

/// The section of a grain by a plane across z.
pub(crate) enum Rows<'a> {
    Disc(Disc),
    Ellipse(EllipseRows),
    Polygon(PolygonRows<'a>),
}

/// The section of a sphere.
pub(crate) struct Disc {
    pub(super) center: [f64; 2],
    pub(super) radius: f64,
}

/// The section of an ellipsoid.
pub(crate) struct EllipseRows {
    pub(super) center: [f64; 2],
    /// Half of its extent along y.
    pub(super) half_y: f64,
    /// The step of the middle of a row along x, per step in y.
    pub(super) shear: f64,
    /// Half of the row along x through the centre.
    pub(super) half_x: f64,
}

/// The section of a polyhedron.
pub(crate) struct PolygonRows<'a> {
    pub(super) template: &'a Convex,
    /// Centre of the grain, x and y.
    pub(super) center: [f64; 2],
    /// Half of the extent of the whole grain along y.
    pub(super) half_y: f64,
    /// The point of the plane above the centre, in the axes and the unit of the template.
    pub(super) above: Vector3<f64>,
    /// A step of a mm along y there.
    pub(super) across: Vector3<f64>,
    /// The lines along x there, with a mm as their unit.
    pub(super) lines: &'a Lines,
}

impl Rows<'_> {
    /// From and to along y; of a polyhedron those of the whole grain.
    #[inline]
    pub(crate) fn y(&self) -> [f64; 2] {
        let (y, half) = match self {
            Self::Disc(disc) => (disc.center[1], disc.radius),
            Self::Ellipse(ellipse) => (ellipse.center[1], ellipse.half_y),
            Self::Polygon(polygon) => (polygon.center[1], polygon.half_y),
        };
        [y - half, y + half]
    }

    /// The middle and half of the row at a coordinate y; half is less than 0 where the line does not meet the grain.
    #[inline]
    fn row(&self, y: f64) -> (f64, f64) {
        match self {
            Self::Disc(Disc { center, radius }) => {
                let dy = y - center[1];
                (center[0], ((radius - dy) * (radius + dy)).max(0.0).sqrt())
            }
            Self::Ellipse(EllipseRows { center, half_y, shear, half_x }) => {
                let dy = y - center[1];
                let part = ((half_y - dy) * (half_y + dy)).max(0.0).sqrt();
                (center[0] + shear * dy, if *half_y > 0.0 { half_x * (part / half_y) } else { 0.0 })
            }
            Self::Polygon(PolygonRows { template, center, above, across, lines, .. }) => {
                let ends = lines.chord(template, &(above + across * (y - center[1])));
                ends.map_or((center[0], -1.0), |[from, to]| {
                    (center[0] + (from + to) / 2.0, (to - from) / 2.0)
                })
            }
        }
    }

    /// From and to along x at a coordinate y; reversed where the line does not meet the grain.
    #[inline]
    pub(crate) fn x_at(&self, y: f64) -> [f64; 2] {
        let (middle, half) = self.row(y);
        [middle - half, middle + half]
    }

    /// Length of the row at a coordinate y.
    #[inline]
    pub(crate) fn length_at(&self, y: f64) -> f64 {
        2.0 * self.row(y).1.max(0.0)
    }
}
