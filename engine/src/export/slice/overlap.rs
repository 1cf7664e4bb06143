//! Areas of a disc inside rectangles, exactly but for rounding.

use std::f64::consts::PI;

/// Area of the disc about the origin to the left of `x`.
fn left_of(x: f64, radius: f64) -> f64 {
    if x <= -radius {
        0.0
    } else if x >= radius {
        PI * radius * radius
    } else {
        let half_chord = ((radius - x) * (radius + x)).sqrt();
        // The angle by both of its legs keeps its digits near the ends, where an arc sine loses them.
        radius * radius * (PI / 2.0 + x.atan2(half_chord)) + x * half_chord
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
pub(super) fn with_rectangle(center: [f64; 2], radius: f64, u: [f64; 2], v: [f64; 2]) -> f64 {
    let (u, v) = (u.map(|x| x - center[0]), v.map(|y| y - center[1]));
    let at = |i: usize, j: usize| quadrant(u[i], v[j], radius);
    (at(1, 1) - at(0, 1) - at(1, 0) + at(0, 0)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
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

    proptest! {
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
