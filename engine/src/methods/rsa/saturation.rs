//! Where random sequential addition of wide mixes saturates, by a formula of one number.

/// Saturation of random sequential addition of equal spheres (Torquato, Uche and Stillinger 2006,
/// DOI 10.1103/PhysRevE.74.061308).
const EQUAL_SPHERES: f64 = 0.384;
/// Exponent of the voids that remain when the ratio of diameters grows: such that Fuller's curve, 2..16 mm, ends at
/// 0.697 as it does in a cube of 80 mm.
const VOIDS_EXPONENT: f64 = -0.341;

/// Volume fraction at which random sequential addition ends, for a ratio `r` of the largest contact diameter to the
/// smallest: `1 - (1 - 0.384) r^-0.341`.
pub(crate) fn saturation(ratio: f64) -> f64 {
    1.0 - (1.0 - EQUAL_SPHERES) * ratio.powf(VOIDS_EXPONENT)
}
