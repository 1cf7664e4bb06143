//! Areas of a disc inside rectangles and polygons, exactly but for rounding.

use std::f64::consts::PI;

use crate::arrays::Each as _;
use crate::elementary::{atan2, hypot};

/// Area of the disc about the origin to the left of `x`.
fn left_of(x: f64, radius: f64) -> f64 {
    if x <= -radius {
        0.0
    } else if x >= radius {
        PI * radius * radius
    } else {
        let half_chord = ((radius - x) * (radius + x)).sqrt();
        // The angle by both of its legs keeps its digits near the ends, where an arc sine loses them.
        radius * radius * (PI / 2.0 + atan2(x, half_chord)) + x * half_chord
    }
}

/// Area of the disc about the origin to the left of `x` and below `y`.
fn quadrant(x: f64, y: f64, radius: f64) -> f64 {
    let (x, y) = (x.clamp(-radius, radius), y.clamp(-radius, radius));
    if x * x + y * y < radius * radius {
        return (left_of(x, radius) + left_of(y, radius)) / 2.0 - PI / 4.0 * radius * radius + x * y;
    }
    match (x > 0.0, y > 0.0) {
        (false, false) => 0.0,
        (true, false) => left_of(y, radius),
        (false, true) => left_of(x, radius),
        (true, true) => left_of(x, radius) + left_of(y, radius) - PI * radius * radius,
    }
}

/// Area that a disc shares with the rectangle `u[0]..u[1]` by `v[0]..v[1]`.
pub(crate) fn with_rectangle(center: [f64; 2], radius: f64, u: [f64; 2], v: [f64; 2]) -> f64 {
    let (u, v) = (u.each(|x| x - center[0]), v.each(|y| y - center[1]));
    let at = |i: usize, j: usize| quadrant(u[i], v[j], radius);
    (at(1, 1) - at(0, 1) - at(1, 0) + at(0, 0)).max(0.0)
}

/// Area that the unit disc about the origin shares with a polygon, whose corners run anticlockwise.
///
/// Every edge with the origin makes a triangle; its part in the disc is a triangle between two sectors.
pub(crate) fn with_polygon(corners: &[[f64; 2]]) -> f64 {
    let twice: f64 = (0..corners.len()).map(|i| edge(corners[i], corners[(i + 1) % corners.len()])).sum();
    (twice / 2.0).clamp(0.0, PI)
}

/// Twice the signed area that the unit disc shares with the triangle of the origin, p and q.
fn edge(p: [f64; 2], q: [f64; 2]) -> f64 {
    let d = [q[0] - p[0], q[1] - p[1]];
    let sector = |a: [f64; 2], b: [f64; 2]| atan2(cross(a, b), a[0] * b[0] + a[1] * b[1]);
    let length2 = d[0] * d[0] + d[1] * d[1];
    // The square of half the chord, times that of the length of the edge.
    let chord2 = length2 - cross(p, d) * cross(p, d);
    if length2 == 0.0 || chord2 <= 0.0 {
        return sector(p, q);
    }
    let (middle, half) = (-(p[0] * d[0] + p[1] * d[1]) / length2, chord2.sqrt() / length2);
    let (from, to) = ((middle - half).max(0.0), (middle + half).min(1.0));
    if from >= to {
        return sector(p, q);
    }
    let at = |t: f64| [p[0] + t * d[0], p[1] + t * d[1]];
    let (a, b) = (at(from), at(to));
    let before = if from > 0.0 { sector(p, a) } else { 0.0 };
    let after = if to < 1.0 { sector(b, q) } else { 0.0 };
    before + (to - from) * cross(p, d) + after
}

/// Whether the unit disc about the origin shares an area with a convex polygon, whose corners run anticlockwise.
pub(crate) fn meets_polygon(corners: &[[f64; 2]]) -> bool {
    let edges = || (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()]));
    let contains_center = edges().all(|(p, q)| cross(p, [q[0] - p[0], q[1] - p[1]]) > 0.0);
    contains_center
        || edges().any(|(p, q)| {
            let d = [q[0] - p[0], q[1] - p[1]];
            let length2 = d[0] * d[0] + d[1] * d[1];
            let t =
                if length2 > 0.0 { (-(p[0] * d[0] + p[1] * d[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
            hypot(p[0] + t * d[0], p[1] + t * d[1]) < 1.0
        })
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::properties::properties;
    use proptest::prelude::*;

    #[test]
    fn halves_quarters_and_nothing() {
        let disc = |u, v| with_rectangle([1.0, 2.0], 0.5, u, v);
        let whole = PI / 4.0;
        assert!((disc([0.0, 5.0], [0.0, 5.0]) - whole).abs() < 1e-15);
        assert!((disc([1.0, 5.0], [0.0, 5.0]) - whole / 2.0).abs() < 1e-15);
        assert!((disc([1.0, 5.0], [2.0, 5.0]) - whole / 4.0).abs() < 1e-15);
        assert_eq!(disc([1.5, 5.0], [0.0, 5.0]), 0.0);
        // Near the corner of its bounding square, but outside of it.
        assert_eq!(disc([1.4, 5.0], [2.4, 5.0]), 0.0);
        // A small rectangle wholly inside.
        assert!((disc([1.1, 1.2], [1.9, 2.1]) - 0.02).abs() < 1e-15);
    }

    properties! {
        /// A rectangle is a polygon.
        #[test]
        fn polygons_share_what_rectangles_do(
            u0 in -2.0..2.0_f64, width in 0.0..3.0_f64, v0 in -2.0..2.0_f64, height in 0.0..3.0_f64,
        ) {
            let (u1, v1) = (u0 + width, v0 + height);
            let corners = [[u0, v0], [u1, v0], [u1, v1], [u0, v1]];
            let expected = with_rectangle([0.0; 2], 1.0, [u0, u1], [v0, v1]);
            prop_assert!((with_polygon(&corners) - expected).abs() < 1e-13);
            prop_assert!(meets_polygon(&corners) || expected < 1e-13);
        }

        #[test]
        fn columns_add_up_to_what_integration_says(
            center in prop::array::uniform2(-2.0..2.0_f64), radius in 0.01..2.0_f64,
            u0 in -2.0..2.0_f64, width in 0.0..3.0_f64, v0 in -2.0..2.0_f64, height in 0.0..3.0_f64,
        ) {
            const STEPS: usize = 4000;
            let step = width / STEPS as f64;
            let integral: f64 = (0..STEPS).map(|i| {
                let x = u0 + (i as f64 + 0.5) * step - center[0];
                let half = (radius * radius - x * x).max(0.0).sqrt();
                let low = (center[1] - half).max(v0);
                ((center[1] + half).min(v0 + height) - low).max(0.0) * step
            }).sum();
            let exact = with_rectangle(center, radius, [u0, u0 + width], [v0, v0 + height]);
            // The midpoint rule errs where the chord vanishes, as the step to the power of 3/2.
            prop_assert!((exact - integral).abs() < 4.0 * step.powf(1.5) + 1e-12, "{exact} {integral}");
        }
    }
}
