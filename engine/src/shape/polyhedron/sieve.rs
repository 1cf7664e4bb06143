//! The sieve size of a polyhedron: the least square, over all directions, that holds its shadow.
//!
//! `max(width along x, width along y)` is minimised over the rotations by steps about the three axes, which shrink
//! where none of them helps, from rotations spread over the group. The result is the width of a square that the shadow
//! fits into; the least of all starts is taken for the minimum.

use std::sync::OnceLock;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::Polyhedron;

/// Rotations that the search starts from.
const STARTS: usize = 24;
/// First and last step, in radians.
const FIRST_STEP: f64 = 0.3;
const LAST_STEP: f64 = 1.0e-6;

/// The sieve size, once it is known. It follows from the rest of a polyhedron, so that any two are equal.
#[derive(Clone, Debug, Default)]
pub(super) struct SieveSize(OnceLock<f64>);

impl PartialEq for SieveSize {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Polyhedron {
    /// Sieve size: the edge of the least square opening that the body passes by moving straight. It is computed when it
    /// is first asked for.
    #[must_use]
    pub fn sieve_size(&self) -> f64 {
        let least = || (0..STARTS).map(|i| self.opening_from(start(i))).fold(f64::INFINITY, f64::min);
        *self.sieve_size.0.get_or_init(least)
    }

    fn opening(&self, frame: &Matrix3<f64>) -> f64 {
        let width = |axis: Vector3<f64>| self.width(&axis);
        width(frame.column(0).into_owned()).max(width(frame.column(1).into_owned()))
    }

    /// The least opening near a frame.
    fn opening_from(&self, mut frame: Matrix3<f64>) -> f64 {
        let mut best = self.opening(&frame);
        let mut step = FIRST_STEP;
        while step > LAST_STEP {
            let mut improved = false;
            for turn in TURNS {
                for angle in [step, -step] {
                    let axis = Vector3::from(turn) * angle;
                    let next = frame * Rotation3::new(axis).matrix();
                    let opening = self.opening(&next);
                    if opening < best {
                        (best, frame, improved) = (opening, next, true);
                    }
                }
            }
            if !improved {
                step /= 2.0;
            }
        }
        best
    }
}

/// Axes that are turned about: the least of two widths has a kink, across which single axes stall.
const TURNS: [[f64; 3]; 9] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.7, 0.7, 0.0],
    [0.7, -0.7, 0.0],
    [0.7, 0.0, 0.7],
    [0.7, 0.0, -0.7],
    [0.0, 0.7, 0.7],
    [0.0, 0.7, -0.7],
];

/// One of [`STARTS`] frames that fill the group of rotations evenly (super-Fibonacci spirals; M. Alexa, CVPR 2022,
/// 8291-8300, DOI 10.1109/CVPR52688.2022.00811).
fn start(i: usize) -> Matrix3<f64> {
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = i as f64 + 0.5;
    let (t, d) = (s / STARTS as f64, 2.0 * std::f64::consts::PI * s);
    let (r, q) = (t.sqrt(), (1.0 - t).sqrt());
    let (alpha, beta) = (d / std::f64::consts::SQRT_2, d / PSI);
    let rotation = Quaternion::new(q * beta.cos(), r * alpha.sin(), r * alpha.cos(), q * beta.sin());
    UnitQuaternion::new_normalize(rotation).to_rotation_matrix().into_inner()
}
