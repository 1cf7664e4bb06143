//! Engineering constants of a stiffness, and bounds of the properties of isotropic mixtures.

use nalgebra::{Matrix3, Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::ElasticPhase;

/// An isotropic elastic material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct IsotropicModuli {
    /// Young's modulus in GPa.
    pub youngs_modulus_gpa: f64,
    /// Poisson's ratio.
    pub poissons_ratio: f64,
    /// Bulk modulus in GPa.
    pub bulk_modulus_gpa: f64,
    /// Shear modulus in GPa.
    pub shear_modulus_gpa: f64,
}

impl IsotropicModuli {
    /// The material with these moduli in GPa.
    #[must_use]
    pub fn new(bulk: f64, shear: f64) -> Self {
        let sum = 3.0 * bulk + shear;
        let over = |x: f64| if sum > 0.0 { x / sum } else { 0.0 };
        Self {
            youngs_modulus_gpa: over(9.0 * bulk * shear),
            poissons_ratio: over(1.5 * bulk - shear),
            bulk_modulus_gpa: bulk,
            shear_modulus_gpa: shear,
        }
    }
}

/// Sums of the stiffness or compliance over all directions: bulk modulus and shear modulus of Voigt.
fn averages(c: &Matrix6<f64>) -> (f64, f64) {
    let normal = c[(0, 0)] + c[(1, 1)] + c[(2, 2)];
    let coupling = c[(0, 1)] + c[(0, 2)] + c[(1, 2)];
    let shear = c[(3, 3)] + c[(4, 4)] + c[(5, 5)];
    ((normal + 2.0 * coupling) / 9.0, (normal - coupling + 3.0 * shear) / 15.0)
}

/// The isotropic stiffness that is nearest to a stiffness in GPa (its projection, the mean over all rotations).
#[must_use]
pub fn isotropic_projection(stiffness: &Matrix6<f64>) -> IsotropicModuli {
    let (bulk, shear) = averages(stiffness);
    IsotropicModuli::new(bulk, shear)
}

/// The universal anisotropy index `5 G_V / G_R + K_V / K_R - 6` (Ranganathan and Ostoja-Starzewski 2008,
/// 10.1103/PhysRevLett.101.055504), 0 of isotropic materials; none where the stiffness has no inverse.
#[must_use]
pub fn universal_anisotropy(stiffness: &Matrix6<f64>) -> Option<f64> {
    let compliance = stiffness.try_inverse()?;
    let (bulk, shear) = averages(stiffness);
    // Means of Reuss; the shears of the compliance are those of engineering strains.
    let s = &compliance;
    let normal = s[(0, 0)] + s[(1, 1)] + s[(2, 2)];
    let coupling = s[(0, 1)] + s[(0, 2)] + s[(1, 2)];
    let shears = s[(3, 3)] + s[(4, 4)] + s[(5, 5)];
    let bulk_reuss = 1.0 / (normal + 2.0 * coupling);
    let shear_reuss = 15.0 / (4.0 * (normal - coupling) + 3.0 * shears);
    Some((5.0 * shear / shear_reuss + bulk / bulk_reuss - 6.0).max(0.0))
}

/// Young's moduli along x, y and z in GPa; none where the stiffness has no inverse.
#[must_use]
pub fn youngs_moduli(stiffness: &Matrix6<f64>) -> Option<[f64; 3]> {
    let compliance = stiffness.try_inverse()?;
    Some([0, 1, 2].map(|axis| 1.0 / compliance[(axis, axis)]))
}

/// Free expansion in 1/K, in the order xx, yy, zz, and twice yz, xz, xy, of a stiffness and the pressure that a kelvin
/// takes at no strain; none where the stiffness has no inverse.
#[must_use]
pub fn expansion(stiffness: &Matrix6<f64>, thermal: &Vector6<f64>) -> Option<Vector6<f64>> {
    Some(stiffness.try_inverse()? * thermal)
}

/// Lower and upper bound of the moduli.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ElasticBounds {
    /// Mean of the compliances: a lower bound of every material of these shares.
    pub reuss: IsotropicModuli,
    /// Lower bound of isotropic materials.
    pub hashin_shtrikman_lower: IsotropicModuli,
    /// Upper bound of isotropic materials.
    pub hashin_shtrikman_upper: IsotropicModuli,
    /// Mean of the stiffnesses: an upper bound of every material of these shares.
    pub voigt: IsotropicModuli,
}

/// Bounds of a conductivity or diffusivity, in its unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ConductionBounds {
    /// Mean of the resistances.
    pub reuss: f64,
    /// Lower bound of isotropic materials.
    pub hashin_shtrikman_lower: f64,
    /// Upper bound of isotropic materials.
    pub hashin_shtrikman_upper: f64,
    /// Mean of the conductivities.
    pub voigt: f64,
}

/// The mean of `1 / (value + shift)`, inverted and without the shift; 0 where a phase has neither.
fn shifted_harmonic(shares: &[f64], values: impl Iterator<Item = f64>, shift: f64) -> f64 {
    let sum: f64 = shares
        .iter()
        .zip(values)
        .filter(|(share, _)| **share > 0.0)
        .map(|(share, value)| share / (value + shift))
        .sum();
    1.0 / sum - shift
}

/// Least and largest of the values of phases that have a share.
fn range(shares: &[f64], values: impl Iterator<Item = f64>) -> [f64; 2] {
    let present = shares.iter().zip(values).filter(|(share, _)| **share > 0.0).map(|(_, value)| value);
    present.fold([f64::INFINITY, 0.0], |[low, high], value| [low.min(value), high.max(value)])
}

/// Bounds of Voigt, Reuss, and Hashin and Shtrikman (1963, 10.1016/0022-5096(63)90060-7), the latter for any number of
/// phases in the form of Walpole (1966, 10.1016/0022-5096(66)90035-4).
#[must_use]
pub fn elastic_bounds(shares: &[f64], phases: &[ElasticPhase]) -> ElasticBounds {
    let bulk = || phases.iter().map(ElasticPhase::bulk_gpa);
    let shear = || phases.iter().map(|phase| phase.mu_gpa);
    let mean = |values: &mut dyn Iterator<Item = f64>| -> f64 {
        shares.iter().zip(values).map(|(share, value)| share * value).sum()
    };
    let (bulks, shears) = (range(shares, bulk()), range(shares, shear()));
    let of = |k: f64, g: f64| {
        let h = if k + 2.0 * g > 0.0 { g * (9.0 * k + 8.0 * g) / (6.0 * (k + 2.0 * g)) } else { 0.0 };
        IsotropicModuli::new(
            shifted_harmonic(shares, bulk(), 4.0 / 3.0 * g),
            shifted_harmonic(shares, shear(), h),
        )
    };
    ElasticBounds {
        reuss: IsotropicModuli::new(
            shifted_harmonic(shares, bulk(), 0.0),
            shifted_harmonic(shares, shear(), 0.0),
        ),
        hashin_shtrikman_lower: of(bulks[0], shears[0]),
        hashin_shtrikman_upper: of(bulks[1], shears[1]),
        voigt: IsotropicModuli::new(mean(&mut bulk()), mean(&mut shear())),
    }
}

/// Bounds of Wiener, and of Hashin and Shtrikman (1962, 10.1063/1.1728579).
#[must_use]
pub fn conduction_bounds(shares: &[f64], conductivities: &[f64]) -> ConductionBounds {
    let values = || conductivities.iter().copied();
    let [low, high] = range(shares, values());
    ConductionBounds {
        reuss: shifted_harmonic(shares, values(), 0.0),
        hashin_shtrikman_lower: shifted_harmonic(shares, values(), 2.0 * low),
        hashin_shtrikman_upper: shifted_harmonic(shares, values(), 2.0 * high),
        voigt: shares.iter().zip(values()).map(|(share, value)| share * value).sum(),
    }
}

/// The mean of the diagonal: the conductivity of the isotropic projection.
#[must_use]
pub fn isotropic_conductivity(conductivity: &Matrix3<f64>) -> f64 {
    conductivity.trace() / 3.0
}
