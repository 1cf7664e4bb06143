//! Numbers of some 106 bits: the unevaluated sum of two floats.
//!
//! Sum, product and quotient: Joldes, Muller and Popescu 2017, [doi:10.1145/3121432](https://doi.org/10.1145/3121432),
//! algorithms 6, 12 and 17 with relative errors of at most 3, 5 and 15 times `2^-106`. Square root: Lefèvre, Louvet,
//! Muller, Picot and Rideau 2023, [doi:10.1145/3568672](https://doi.org/10.1145/3568672), algorithm 8, 25/8 times
//! `2^-106`. The bounds hold while no partial result leaves the range of normal numbers. `mul_add` rounds once on every
//! processor; it is slow on those without the instruction.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::arrays;

/// `high + low`, where `high` is the float nearest to the sum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DoubleDouble {
    high: f64,
    low: f64,
}

/// A sum and its rounding error.
fn two_sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    let of_b = high - a;
    let low = (a - (high - of_b)) + (b - of_b);
    DoubleDouble { high, low }
}

/// The same where `|a| >= |b|`, or `a` is 0.
fn fast_two_sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    DoubleDouble { high, low: b - (high - a) }
}

/// A product and its rounding error.
fn two_product(a: f64, b: f64) -> DoubleDouble {
    let high = a * b;
    DoubleDouble { high, low: a.mul_add(b, -high) }
}

impl DoubleDouble {
    /// The difference of two floats, without error.
    pub(super) fn difference(a: f64, b: f64) -> Self {
        two_sum(a, -b)
    }

    /// The product of two floats, without error.
    pub(super) fn product(a: f64, b: f64) -> Self {
        two_product(a, b)
    }

    /// The nearest float.
    pub(super) fn to_f64(self) -> f64 {
        self.high
    }

    /// The root of a number that is not negative.
    pub(super) fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Self::default();
        }
        let root = self.high.sqrt();
        let rest = (-root).mul_add(root, self.high);
        fast_two_sum(root, (self.low + rest) / (2.0 * root))
    }
}

impl From<f64> for DoubleDouble {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Add for DoubleDouble {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let high = two_sum(self.high, other.high);
        let low = two_sum(self.low, other.low);
        let sum = fast_two_sum(high.high, high.low + low.high);
        fast_two_sum(sum.high, low.low + sum.low)
    }
}

impl Neg for DoubleDouble {
    type Output = Self;

    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let product = two_product(self.high, other.high);
        let cross = self.low.mul_add(other.high, self.low * other.low);
        fast_two_sum(product.high, product.low + self.high.mul_add(other.low, cross))
    }
}

impl Div for DoubleDouble {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let quotient = self.high / other.high;
        let rest = self - other * quotient.into();
        fast_two_sum(quotient, rest.high / other.high)
    }
}

/// A vector of three such numbers.
pub(super) type Vector = [DoubleDouble; 3];

/// The scalar product.
pub(super) fn dot(a: &Vector, b: &Vector) -> DoubleDouble {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
pub(super) fn cross(a: &Vector, b: &Vector) -> Vector {
    arrays::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i] * b[j] - a[j] * b[i]
    })
}

/// `a - b`.
pub(super) fn minus(a: &Vector, b: &Vector) -> Vector {
    arrays::from_fn(|k| a[k] - b[k])
}

/// The length of a vector.
pub(super) fn norm(a: &Vector) -> DoubleDouble {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;

    /// `2^-106`.
    const U2: f64 = 1.0 / (1_u128 << 106) as f64;

    fn number() -> impl Strategy<Value = DoubleDouble> {
        (-1.0..1.0_f64, -0.5..0.5_f64, -20..20).prop_map(|(mantissa, low, exponent)| {
            let high = mantissa * f64::from(exponent).exp2();
            fast_two_sum(high, low * f64::EPSILON * high)
        })
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        /// Identities that hold exactly in real numbers, against the bounds on the errors of their operations.
        #[test]
        fn errors_keep_their_bounds(a in number(), b in number(), c in number()) {
            let size = |x: DoubleDouble| x.to_f64().abs();
            prop_assert!(size((a + b) - b - a) <= 16.0 * U2 * (size(a) + size(b)));
            let spread = a * (b + c) - (a * b + a * c);
            prop_assert!(size(spread) <= 32.0 * U2 * size(a) * (size(b) + size(c)));
            if size(b) > 0.0 {
                prop_assert!(size(a / b * b - a) <= 32.0 * U2 * size(a));
            }
            let root = (a * a).sqrt();
            let sign = if a.to_f64() < 0.0 { -a } else { a };
            prop_assert!(size(root - sign) <= 16.0 * U2 * size(a));
        }

        #[test]
        fn integers_of_a_hundred_bits_are_exact(a in 0_u64..1 << 50, b in 0_u64..1 << 50, c in 0_u64..1 << 50) {
            let of = |x: u64| DoubleDouble::from(x as f64);
            let exact = i128::from(a) * i128::from(b) - i128::from(c) * i128::from(c);
            let found = of(a) * of(b) - of(c) * of(c);
            prop_assert_eq!(found.high as i128 + found.low as i128, exact);
        }
    }

    #[test]
    fn what_floats_lose_is_kept() {
        let third = DoubleDouble::from(1.0) / DoubleDouble::from(3.0);
        assert_eq!((third * 3.0.into() - 1.0.into()).to_f64(), 0.0);
        assert_eq!(DoubleDouble::difference(1.0, 1.0e-30).low, -1.0e-30);
        assert_eq!(DoubleDouble::product(1.0 + f64::EPSILON, 1.0 - f64::EPSILON).low, -f64::EPSILON.powi(2));
        assert_eq!(DoubleDouble::from(-1.0).sqrt().to_f64(), 0.0);
        let two = DoubleDouble::from(2.0).sqrt();
        assert!((two * two - 2.0.into()).to_f64().abs() <= 16.0 * U2);
    }
}
