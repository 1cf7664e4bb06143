//! Carlson's symmetric elliptic integrals, by duplication.
//!
//! B. C. Carlson, "Numerical computation of real or complex elliptic integrals", Numerical Algorithms 10, 13-26, 1995,
//! DOI 10.1007/BF02198293, algorithms 1 and 2; `R_G` by equation 19.21.10 of the Digital Library of Mathematical
//! Functions (<https://dlmf.nist.gov/19.21>). Arguments are positive and finite.

use crate::elementary::powf;
use crate::sorting;

/// Relative error of the truncated series.
const TOLERANCE: f64 = 1.0e-17;
/// Most duplications; each divides the spread of the arguments by four, and none of the ratios of this crate needs
/// more than 30.
const MAX_DUPLICATIONS: usize = 200;

/// `R_F(x, y, z) = 1/2 integral over t from 0 of dt / sqrt((t + x)(t + y)(t + z))`.
pub(super) fn rf(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    let first = (x + y + z) / 3.0;
    let (x0, y0) = (x, y);
    let spread = (first - x).abs().max((first - y).abs()).max((first - z).abs());
    let mut bound = spread * powf(3.0 * TOLERANCE, -1.0 / 6.0);
    let (mut mean, mut power) = (first, 1.0);
    for _ in 0..MAX_DUPLICATIONS {
        if bound < mean {
            break;
        }
        let (p, q, r) = (x.sqrt(), y.sqrt(), z.sqrt());
        let shift = p * q + p * r + q * r;
        (x, y, z) = ((x + shift) / 4.0, (y + shift) / 4.0, (z + shift) / 4.0);
        mean = (mean + shift) / 4.0;
        power /= 4.0;
        bound /= 4.0;
    }
    let (x, y) = ((first - x0) * power / mean, (first - y0) * power / mean);
    let z = -x - y;
    let (e2, e3) = (x * y - z * z, x * y * z);
    (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0) / mean.sqrt()
}

/// `R_D(x, y, z) = 3/2 integral over t from 0 of dt / ((t + z) sqrt((t + x)(t + y)(t + z)))`.
pub(super) fn rd(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    let first = (x + y + 3.0 * z) / 5.0;
    let (x0, y0) = (x, y);
    let spread = (first - x).abs().max((first - y).abs()).max((first - z).abs());
    let mut bound = spread * powf(TOLERANCE / 4.0, -1.0 / 6.0);
    let (mut mean, mut power, mut sum) = (first, 1.0, 0.0);
    for _ in 0..MAX_DUPLICATIONS {
        if bound < mean {
            break;
        }
        let (p, q, r) = (x.sqrt(), y.sqrt(), z.sqrt());
        let shift = p * q + p * r + q * r;
        sum += power / (r * (z + shift));
        (x, y, z) = ((x + shift) / 4.0, (y + shift) / 4.0, (z + shift) / 4.0);
        mean = (mean + shift) / 4.0;
        power /= 4.0;
        bound /= 4.0;
    }
    let scale = power / mean;
    let (x, y) = ((first - x0) * scale, (first - y0) * scale);
    let z = -(x + y) / 3.0;
    let (xy, zz) = (x * y, z * z);
    let (e2, e3) = (xy - 6.0 * zz, (3.0 * xy - 8.0 * zz) * z);
    let (e4, e5) = (3.0 * (xy - zz) * zz, xy * zz * z);
    let series =
        1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0 - 3.0 * e4 / 22.0 - 9.0 * e2 * e3 / 52.0
            + 3.0 * e5 / 26.0;
    power * series / (mean * mean.sqrt()) + 3.0 * sum
}

/// `R_G(x, y, z)`, the mean of `sqrt(x u² + y v² + z w²)` over the unit vectors `(u, v, w)`.
pub(super) fn rg(x: f64, y: f64, z: f64) -> f64 {
    // With the middle argument in the third place no terms cancel.
    let mut sorted = [x, y, z];
    sorting::ascending(&mut sorted);
    let [x, z, y] = sorted;
    (z * rf(x, y, z) - (x - z) * (y - z) * rd(x, y, z) / 3.0 + (x / z * y).sqrt()) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, known: f64) {
        assert!((found / known - 1.0).abs() < 1e-15, "{found} for {known}");
    }

    /// Published values have 14 digits.
    fn published(found: f64, known: f64) {
        assert!((found - known).abs() < 1e-13, "{found} for {known}");
    }

    #[test]
    fn published_values_are_met() {
        // Carlson 1995, section 3.
        published(rf(1.0, 2.0, 1e-300), 1.311_028_777_146_1);
        published(rf(2.0, 3.0, 4.0), 0.584_082_841_677_15);
        published(rd(2.0, 3.0, 4.0), 0.165_105_272_942_61);
        // R_G(x, x, x) = sqrt(x), and R_G(2, 3, 4) of the same paper.
        close(rg(7.0, 7.0, 7.0), 7.0_f64.sqrt());
        published(rg(2.0, 3.0, 4.0), 1.725_503_028_069_2);
        close(rf(1.0, 1.0, 1.0), 1.0);
        close(rd(1.0, 1.0, 1.0), 1.0);
    }

    #[test]
    fn arguments_may_come_in_any_order() {
        let known = rg(0.01, 5.0, 300.0);
        for [x, y, z] in [[5.0, 0.01, 300.0], [300.0, 5.0, 0.01], [300.0, 0.01, 5.0]] {
            assert_eq!(rg(x, y, z).to_bits(), known.to_bits());
        }
    }
}
