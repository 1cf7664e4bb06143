//! Numbers of two doubles, about 32 digits: what the closed forms are held against.
//!
//! Sums and products are Dekker's and Knuth's, exact but for the last of the two; a root is one step of
//! Newton's from the double's.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// The unevaluated sum of two doubles, the second at most half a unit in the last place of the first.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) struct Double {
    high: f64,
    low: f64,
}

impl Double {
    fn of_sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let of_b = high - a;
        Self { high, low: (a - (high - of_b)) + (b - of_b) }
    }

    fn of_product(a: f64, b: f64) -> Self {
        let high = a * b;
        Self { high, low: a.mul_add(b, -high) }
    }

    pub(super) fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return 0.0.into();
        }
        let root = self.high.sqrt();
        let rest = self - Self::of_product(root, root);
        Self::of_sum(root, rest.high / (2.0 * root))
    }

    pub(super) fn abs(self) -> Self {
        if self.high < 0.0 { -self } else { self }
    }
}

impl From<f64> for Double {
    fn from(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }
}

impl From<Double> for f64 {
    fn from(value: Double) -> Self {
        value.high
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (Self::of_sum(self.high, other.high), Self::of_sum(self.low, other.low));
        let high = Self::of_sum(high.high, high.low + low.high);
        Self::of_sum(high.high, high.low + low.low)
    }
}

impl Neg for Double {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = Self::of_product(self.high, other.high);
        let low = product.low + (self.high * other.low + self.low * other.high);
        Self::of_sum(product.high, low)
    }
}

impl Div for Double {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * first.into();
        let second = rest.high / other.high;
        let rest = rest - other * second.into();
        Self::of_sum(first, second) + (rest.high / other.high).into()
    }
}

/// Three of them.
pub(super) type Vector = [Double; 3];

pub(super) fn vector(of: [f64; 3]) -> Vector {
    of.map(Double::from)
}

pub(super) fn dot(a: Vector, b: Vector) -> Double {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[test]
fn thirty_digits() {
    let third = Double::from(1.0) / 3.0.into();
    let error = (third * 3.0.into() - 1.0.into()).abs();
    assert!(f64::from(error) < 1e-31, "{error:?}");
    let root = Double::from(2.0).sqrt();
    let error = (root * root - 2.0.into()).abs();
    assert!(f64::from(error) < 1e-31, "{error:?}");
    let small = (Double::from(1.0) + 1e-25.into()) - 1.0.into();
    assert!((f64::from(small) - 1e-25).abs() < 1e-38, "{small:?}");
}
