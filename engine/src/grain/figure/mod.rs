//! What a plane cuts out of a grain: a circle of a sphere, an ellipse of an ellipsoid, in closed form; a polygon of a
//! polyhedron (`polygon`).
//!
//! An ellipsoid with the shape matrix `A` and its inverse `M` is the set of points with `(p - x) · M (p - x) <= 1`. The
//! plane across the axis `w` at the height `h` above its centre cuts it in the ellipse around `(A_uw, A_vw) h / A_ww`
//! that the block of `M` of the axes `u`, `v` describes, with the scale `1 - h² / A_ww`. Its semi-axes are
//! `sqrt(scale / e)` for the eigenvalues `e` of that block.

mod overlap;
mod polygon;

use std::f64::consts::PI;

use nalgebra::Matrix3;

use crate::arrays::Each as _;
use crate::elementary::{atan2, hypot};
use crate::gap::ellipsoids::Body;
use crate::gap::linear::Symmetric;
use crate::request::GrainKind;
pub(crate) use polygon::area;
pub use polygon::{Polygon, TOLERANCE};

/// The section of a grain, about its centre.
#[derive(Clone, Debug, PartialEq)]
pub enum Figure {
    /// Of a sphere.
    Circle {
        /// Its radius.
        radius_mm: f64,
    },
    /// Of an ellipsoid.
    Ellipse(Ellipse),
    /// Of a polyhedron.
    Polygon(Polygon),
}

/// An ellipse about the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Its semi-axes `a >= b`.
    pub semi_axes_mm: [f64; 2],
    /// Direction of the longer one, a unit vector.
    pub long: [f64; 2],
}

/// From and to along u of a figure within a strip of v.
pub(crate) struct Span {
    /// Around the whole part of the figure in the strip.
    pub(crate) outer: [f64; 2],
    /// Where the figure covers the strip from edge to edge; reversed where it does so nowhere.
    pub(crate) inner: [f64; 2],
}

/// What figures are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureKind {
    /// Circles.
    Circle,
    /// Ellipses.
    Ellipse,
    /// Polygons.
    Polygon,
}

impl FigureKind {
    /// What the sections of grains are.
    pub(crate) fn of_grains(kind: GrainKind) -> Vec<Self> {
        let all = [
            (Self::Circle, !kind.has_orientations()),
            (Self::Ellipse, kind.has_axes()),
            (Self::Polygon, kind.has_templates()),
        ];
        all.into_iter().filter(|(_, is_there)| *is_there).map(|(figure, _)| figure).collect()
    }

    /// What they are called, in the plural.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Circle => "circles",
            Self::Ellipse => "ellipses",
            Self::Polygon => "polygons",
        }
    }
}

impl Ellipse {
    /// The section of an ellipsoid by the plane across the last of the axes `u, v, w`, and the place of its centre
    /// seen from that of the ellipsoid; `None` where the plane does not meet it.
    pub(crate) fn of_section(
        shape: &Matrix3<f64>,
        inverse: &Matrix3<f64>,
        [u, v, w]: [usize; 3],
        height: f64,
    ) -> Option<([f64; 2], Self)> {
        let scale = 1.0 - height * height / shape[(w, w)];
        if scale <= 0.0 {
            return None;
        }
        let center = [u, v].each(|axis| shape[(axis, w)] / shape[(w, w)] * height);
        let (uu, uv, vv) = (inverse[(u, u)], inverse[(u, v)], inverse[(v, v)]);
        let half = (uu - vv) / 2.0;
        let root = hypot(half, uv);
        let larger = (uu + vv) / 2.0 + root;
        // By the determinant, which does not cancel as the difference would.
        let smaller = (uu * vv - uv * uv) / larger;
        // The eigenvector of the smaller one, by the column that does not cancel.
        let long = if half >= 0.0 { [-uv, half + root] } else { [root - half, -uv] };
        let length = hypot(long[0], long[1]);
        let long = if length > 0.0 { long.each(|x| x / length) } else { [1.0, 0.0] };
        Some((center, Self { semi_axes_mm: [smaller, larger].each(|e| (scale / e).sqrt()), long }))
    }

    /// Angle of the long axis from u towards v in degrees, greater than -90 and at most 90.
    pub fn angle_deg(&self) -> f64 {
        let [u, v] = self.long;
        let angle = atan2(v, u).to_degrees();
        let turned = if angle > 90.0 {
            angle - 180.0
        } else if angle <= -90.0 {
            angle + 180.0
        } else {
            angle
        };
        // No negative zero.
        turned + 0.0
    }

    /// The components uu, uv and vv of the shape matrix.
    fn matrix(&self) -> [f64; 3] {
        let [a2, b2] = self.semi_axes_mm.each(|x| x * x);
        let [u, v] = self.long;
        [a2 * u * u + b2 * v * v, (a2 - b2) * u * v, a2 * v * v + b2 * u * u]
    }

    /// The corners of a rectangle where the ellipse is the unit disc, anticlockwise.
    fn corners_on_disc(&self, center: [f64; 2], u: [f64; 2], v: [f64; 2]) -> [[f64; 2]; 4] {
        let ([a, b], [c, s]) = (self.semi_axes_mm, self.long);
        [(0, 0), (1, 0), (1, 1), (0, 1)].each(|(i, j)| {
            let (x, y) = (u[i] - center[0], v[j] - center[1]);
            [(c * x + s * y) / a, (c * y - s * x) / b]
        })
    }

    /// See [`Figure::span`].
    fn span(&self, center: [f64; 2], v: [f64; 2]) -> Option<Span> {
        let [uu, uv, vv] = self.matrix();
        let (half_u, half_v) = (uu.sqrt(), vv.sqrt());
        let edges = v.each(|v| v - center[1]);
        let (low, high) = (edges[0].max(-half_v), edges[1].min(half_v));
        if low >= high {
            return None;
        }
        let [a, b] = self.semi_axes_mm;
        let chord = |dv: f64| {
            let half = a * b / vv * ((half_v - dv) * (half_v + dv)).max(0.0).sqrt();
            let middle = center[0] + uv / vv * dv;
            [middle - half, middle + half]
        };
        // The points farthest along u, or the nearest to them in the strip.
        let [left, right] = [-uv / half_u, uv / half_u].each(|dv| chord(dv.clamp(low, high)));
        let crosses = edges[0] > -half_v && edges[1] < half_v;
        let inner = if crosses {
            let [p, q] = edges.each(chord);
            [p[0].max(q[0]), p[1].min(q[1])]
        } else {
            [f64::INFINITY, f64::NEG_INFINITY]
        };
        Some(Span { outer: [left[0], right[1]], inner })
    }
}

impl Figure {
    /// What it is.
    pub fn kind(&self) -> FigureKind {
        match self {
            Self::Circle { .. } => FigureKind::Circle,
            Self::Ellipse(_) => FigureKind::Ellipse,
            Self::Polygon(_) => FigureKind::Polygon,
        }
    }

    /// Its area.
    pub fn area_mm2(&self) -> f64 {
        match self {
            Self::Circle { radius_mm } => PI * radius_mm * radius_mm,
            Self::Ellipse(Ellipse { semi_axes_mm: [a, b], .. }) => PI * a * b,
            Self::Polygon(polygon) => polygon.area_mm2(),
        }
    }

    /// From and to along u and v, from its centre.
    pub(crate) fn extents_mm(&self) -> [[f64; 2]; 2] {
        match self {
            Self::Circle { radius_mm } => [[-radius_mm, *radius_mm]; 2],
            Self::Ellipse(ellipse) => {
                let [uu, _, vv] = ellipse.matrix();
                [uu.sqrt(), vv.sqrt()].each(|half| [-half, half])
            }
            Self::Polygon(polygon) => polygon.extents_mm(),
        }
    }

    /// Distance of its farthest point from its centre.
    pub(crate) fn outer_mm(&self) -> f64 {
        match self {
            Self::Circle { radius_mm } => *radius_mm,
            Self::Ellipse(Ellipse { semi_axes_mm: [a, _], .. }) => *a,
            Self::Polygon(polygon) => {
                polygon.corners_mm.iter().map(|p| hypot(p[0], p[1])).fold(0.0, f64::max)
            }
        }
    }

    /// Area that it shares with the rectangle `u[0]..u[1]` by `v[0]..v[1]`, exactly but for rounding.
    ///
    /// An affine map makes the ellipse the unit disc and the rectangle a parallelogram.
    pub(crate) fn area_in(&self, center: [f64; 2], u: [f64; 2], v: [f64; 2]) -> f64 {
        match self {
            Self::Circle { radius_mm } => overlap::with_rectangle(center, *radius_mm, u, v),
            Self::Ellipse(ellipse) => {
                let [a, b] = ellipse.semi_axes_mm;
                a * b * overlap::with_polygon(&ellipse.corners_on_disc(center, u, v))
            }
            Self::Polygon(polygon) => polygon.area_in(center, u, v),
        }
    }

    /// Whether it shares an area with a rectangle, decided by distance: the area where it does not is a difference of
    /// equal numbers, whose rounding may be positive.
    pub(crate) fn reaches(&self, center: [f64; 2], u: [f64; 2], v: [f64; 2]) -> bool {
        match self {
            Self::Circle { radius_mm } => {
                let outside = |x: f64, [low, high]: [f64; 2]| (low - x).max(x - high).max(0.0);
                hypot(outside(center[0], u), outside(center[1], v)) < *radius_mm
            }
            Self::Ellipse(ellipse) => overlap::meets_polygon(&ellipse.corners_on_disc(center, u, v)),
            Self::Polygon(polygon) => polygon.area_in(center, u, v) > 0.0,
        }
    }

    /// How far it spans along u within the strip `v[0]..v[1]`; `None` where it is not in it.
    pub(crate) fn span(&self, center: [f64; 2], v: [f64; 2]) -> Option<Span> {
        let radius = match self {
            Self::Circle { radius_mm } => *radius_mm,
            Self::Ellipse(ellipse) => return ellipse.span(center, v),
            Self::Polygon(polygon) => return polygon.span(center, v),
        };
        let half_chord = |dv: f64| ((radius - dv) * (radius + dv)).max(0.0).sqrt();
        let distances = v.each(|v| (v - center[1]).abs());
        let nearest = if (v[0]..=v[1]).contains(&center[1]) { 0.0 } else { distances[0].min(distances[1]) };
        (nearest < radius).then(|| {
            let around = |half: f64| [center[0] - half, center[0] + half];
            Span {
                outer: around(half_chord(nearest)),
                inner: around(half_chord(distances[0].max(distances[1]))),
            }
        })
    }

    /// The ellipsoid with a centre in the plane whose section it is, as thick as it is narrow: in the plane its gaps
    /// are those of the figure; of a polygon those of the circle around it.
    pub(crate) fn body(&self, [u, v]: [f64; 2]) -> Body {
        let ([xx, xy, yy], [outer_mm, inner_mm]) = match self {
            Self::Circle { radius_mm: r } => ([r * r, 0.0, r * r], [*r; 2]),
            Self::Ellipse(ellipse) => (ellipse.matrix(), ellipse.semi_axes_mm),
            Self::Polygon(_) => {
                let r = self.outer_mm();
                ([r * r, 0.0, r * r], [r; 2])
            }
        };
        Body {
            center_mm: [u, v, 0.0],
            matrix_mm2: Symmetric([xx, xy, 0.0, yy, 0.0, inner_mm * inner_mm]),
            outer_mm,
            inner_mm,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::properties::properties;
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::shape::{Ellipsoid, Pose};

    fn matrices(axes: [f64; 3], angles: [f64; 3]) -> (Matrix3<f64>, Matrix3<f64>) {
        let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        let shape =
            Ellipsoid::new(axes).unwrap().matrix_mm2(&Pose { center_mm: Vector3::zeros(), orientation });
        (shape, shape.try_inverse().unwrap())
    }

    #[test]
    fn angles_are_those_of_the_long_axis() {
        let of = |long: [f64; 2]| Ellipse { semi_axes_mm: [2.0, 1.0], long }.angle_deg();
        assert_eq!(
            [of([1.0, 0.0]), of([-1.0, 0.0]), of([0.0, 1.0]), of([0.0, -1.0])],
            [0.0, 0.0, 90.0, 90.0]
        );
        assert!((of([-1.0, -1.0]) - 45.0).abs() < 1e-12 && (of([-1.0, 1.0]) + 45.0).abs() < 1e-12);
        // The long axis is x of the body, turned by 30 degrees about z.
        let (shape, inverse) = matrices([1.0, 2.0, 1.0], [0.0, 0.0, 30.0_f64.to_radians()]);
        let (center, ellipse) = Ellipse::of_section(&shape, &inverse, [0, 1, 2], 0.0).unwrap();
        assert_eq!(center, [0.0; 2]);
        assert!(
            (ellipse.semi_axes_mm[0] - 2.0).abs() < 1e-12 && (ellipse.semi_axes_mm[1] - 1.0).abs() < 1e-12
        );
        assert!((ellipse.angle_deg() - 30.0).abs() < 1e-9, "{}", ellipse.angle_deg());
    }

    properties! {
        #[test]
        fn the_outline_of_a_section_lies_on_the_ellipsoid(
            axes in prop::array::uniform3(0.3..3.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
            at in -0.99..0.99_f64, which in 0..3_usize,
        ) {
            let (shape, inverse) = matrices(axes, angles);
            let order = [[1, 2, 0], [0, 2, 1], [0, 1, 2]][which];
            let height = at * shape[(which, which)].sqrt();
            let (center, ellipse) = Ellipse::of_section(&shape, &inverse, order, height).unwrap();
            let ([a, b], [c, s]) = (ellipse.semi_axes_mm, ellipse.long);
            prop_assert!(a >= b);
            for turn in 0..16 {
                let (sin, cos) = (f64::from(turn) * PI / 8.0).sin_cos();
                let mut p = Vector3::zeros();
                p[order[0]] = center[0] + a * cos * c - b * sin * s;
                p[order[1]] = center[1] + a * cos * s + b * sin * c;
                p[which] = height;
                prop_assert!((p.dot(&(inverse * p)) - 1.0).abs() < 1e-8, "{}", p.dot(&(inverse * p)));
            }
            prop_assert!(Ellipse::of_section(&shape, &inverse, order, shape[(which, which)].sqrt() * 1.001).is_none());
        }

        /// The shared area against the integral of chords.
        #[test]
        fn areas_in_rectangles_are_those_of_integration(
            axes in prop::array::uniform2(0.2..2.0_f64), turn in -1.6..1.6_f64,
            center in prop::array::uniform2(-2.0..2.0_f64), u0 in -2.0..2.0_f64, width in 0.0..3.0_f64,
            v0 in -2.0..2.0_f64, height in 0.01..3.0_f64,
        ) {
            const STEPS: usize = 4000;
            let semi_axes_mm = [axes[0].max(axes[1]), axes[0].min(axes[1])];
            let figure = Figure::Ellipse(Ellipse { semi_axes_mm, long: [turn.cos(), turn.sin()] });
            let step = height / STEPS as f64;
            let integral: f64 = (0..STEPS).map(|i| {
                let v = v0 + (i as f64 + 0.5) * step;
                figure.span(center, [v, v + 1e-12]).map_or(0.0, |span| {
                    (span.outer[1].min(u0 + width) - span.outer[0].max(u0)).max(0.0) * step
                })
            }).sum();
            let (u, v) = ([u0, u0 + width], [v0, v0 + height]);
            let exact = figure.area_in(center, u, v);
            let curved = semi_axes_mm[0] / semi_axes_mm[1].sqrt();
            prop_assert!((exact - integral).abs() < 8.0 * curved * step.powf(1.5) + 1e-8, "{exact} {integral}");
            prop_assert!(figure.reaches(center, u, v) || exact < 1e-12);
            let whole = figure.area_in([0.0; 2], [-3.0, 3.0], [-3.0, 3.0]);
            prop_assert!((whole - figure.area_mm2()).abs() < 1e-12);
        }
    }
}
