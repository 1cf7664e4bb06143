//! Figures of a set of grains: flakiness index, shape index, orientation tensor.

use nalgebra::Matrix3;

use super::{Ellipsoid, Polyhedron, Pose, exceeds};

/// Particle size fractions `d_i/D_i` of EN 933-3:2012, table 1, with the width of the slots, `D_i/2` as rounded there;
/// in mm.
pub(super) const FLAKINESS_FRACTIONS_MM: [[f64; 3]; 14] = [
    [4.0, 5.0, 2.5],
    [5.0, 6.3, 3.15],
    [6.3, 8.0, 4.0],
    [8.0, 10.0, 5.0],
    [10.0, 12.5, 6.3],
    [12.5, 16.0, 8.0],
    [16.0, 20.0, 10.0],
    [20.0, 25.0, 12.5],
    [25.0, 31.5, 16.0],
    [31.5, 40.0, 20.0],
    [40.0, 50.0, 25.0],
    [50.0, 63.0, 31.5],
    [63.0, 80.0, 40.0],
    [80.0, 100.0, 50.0],
];
/// Sizes that EN 933-4:2008 applies to, in mm.
const SHAPE_INDEX_RANGE_MM: [f64; 2] = [4.0, 63.0];
/// Length over thickness above which EN 933-4 calls a grain non-cubical.
pub(super) const NON_CUBICAL: f64 = 3.0;

/// What the indices look at of a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaliperSizes {
    /// Volume in mm³.
    pub volume_mm3: f64,
    /// Sieve size in mm.
    pub sieve_mm: f64,
    /// Largest caliper width in mm.
    pub length_mm: f64,
    /// Least caliper width in mm.
    pub thickness_mm: f64,
}

impl From<&Ellipsoid> for CaliperSizes {
    fn from(grain: &Ellipsoid) -> Self {
        let axes = grain.semi_axes_mm();
        Self {
            volume_mm3: grain.volume_mm3(),
            sieve_mm: grain.sieve_size_mm(),
            length_mm: 2.0 * axes.x,
            thickness_mm: 2.0 * axes.z,
        }
    }
}

/// Of a body with a scale of 1 mm.
impl From<&Polyhedron> for CaliperSizes {
    fn from(body: &Polyhedron) -> Self {
        Self {
            volume_mm3: body.volume(),
            sieve_mm: body.sieve_size(),
            length_mm: body.length(),
            thickness_mm: body.thickness(),
        }
    }
}

impl CaliperSizes {
    /// Those of a grain that is larger by a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let Self { volume_mm3, sieve_mm, length_mm, thickness_mm } = self;
        Self {
            volume_mm3: volume_mm3 * factor.powi(3),
            sieve_mm: sieve_mm * factor,
            length_mm: length_mm * factor,
            thickness_mm: thickness_mm * factor,
        }
    }
}

/// The particle size fraction of EN 933-3 that a grain lies in.
fn flakiness_fraction(grain: &CaliperSizes) -> Option<usize> {
    let size = grain.sieve_mm;
    FLAKINESS_FRACTIONS_MM.iter().position(|[low, high, _]| exceeds(size, *low) && !exceeds(size, *high))
}

/// Whether a grain passes the slots of its fraction in EN 933-3; `None` where it lies in none.
fn is_flaky(grain: &CaliperSizes) -> Option<bool> {
    flakiness_fraction(grain).map(|fraction| passes_slots(grain, fraction))
}

/// Whether a grain passes the slots of a fraction: they are wider than its thickness, `2c` of an ellipsoid.
fn passes_slots(grain: &CaliperSizes, fraction: usize) -> bool {
    exceeds(FLAKINESS_FRACTIONS_MM[fraction][2], grain.thickness_mm)
}

/// A particle size fraction of EN 933-3 and the grains in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlakinessFraction {
    /// Sieve `d_i` in mm, which retains the grains.
    pub d_min_mm: f64,
    /// Sieve `D_i` in mm, which they pass.
    pub d_max_mm: f64,
    /// Volume of the grains in mm³.
    pub volume_mm3: f64,
    /// Volume in mm³ of those that pass slots of half of `D_i`.
    pub flaky_mm3: f64,
}

impl FlakinessFraction {
    /// Share of the mass that is flaky, 0 to 1; `None` without grains.
    #[must_use]
    pub fn index(&self) -> Option<f64> {
        (self.volume_mm3 > 0.0).then(|| self.flaky_mm3 / self.volume_mm3)
    }
}

/// The particle size fractions of EN 933-3 from fine to coarse, 4 to 100 mm, with the grains in each.
#[must_use]
pub fn flakiness_fractions(grains: impl Iterator<Item = CaliperSizes>) -> Vec<FlakinessFraction> {
    let empty = |[d_min_mm, d_max_mm, _]: [f64; 3]| FlakinessFraction {
        d_min_mm,
        d_max_mm,
        volume_mm3: 0.0,
        flaky_mm3: 0.0,
    };
    let mut fractions: Vec<FlakinessFraction> = FLAKINESS_FRACTIONS_MM.into_iter().map(empty).collect();
    for grain in grains {
        if let Some(at) = flakiness_fraction(&grain) {
            fractions[at].volume_mm3 += grain.volume_mm3;
            fractions[at].flaky_mm3 += if passes_slots(&grain, at) { grain.volume_mm3 } else { 0.0 };
        }
    }
    fractions
}

fn is_non_cubical(grain: &CaliperSizes) -> Option<bool> {
    let [low, high] = SHAPE_INDEX_RANGE_MM;
    let size = grain.sieve_mm;
    let is_in_range = exceeds(size, low) && !exceeds(size, high);
    is_in_range.then(|| exceeds(grain.length_mm, NON_CUBICAL * grain.thickness_mm))
}

/// Share of the volume of the grains for which `judge` is true, of all for which it is something.
fn share(
    grains: impl Iterator<Item = CaliperSizes>,
    judge: fn(&CaliperSizes) -> Option<bool>,
) -> Option<f64> {
    let (mut of, mut all) = (0.0, 0.0);
    for grain in grains {
        if let Some(counts) = judge(&grain) {
            let volume = grain.volume_mm3;
            all += volume;
            of += if counts { volume } else { 0.0 };
        }
    }
    (all > 0.0).then(|| of / all)
}

/// Flakiness index of EN 933-3, 0 to 1: the share of the mass of the grains from 4 to 100 mm by sieve size that pass
/// slots of half the upper sieve of their fraction. `None` where there are no such grains.
pub fn flakiness_index(grains: impl Iterator<Item = CaliperSizes>) -> Option<f64> {
    share(grains, is_flaky)
}

/// Shape index of EN 933-4, 0 to 1: the share of the mass of the grains from 4 to 63 mm by sieve size that are more
/// than three times as long as thick. `None` where there are no such grains.
pub fn shape_index(grains: impl Iterator<Item = CaliperSizes>) -> Option<f64> {
    share(grains, is_non_cubical)
}

/// An axis of a grain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyAxis {
    /// The longest, along x of the body.
    Long,
    /// The middle one, along y of the body.
    Middle,
    /// The shortest, along z of the body.
    Short,
}

/// Orientation tensor: the mean of `n nᵀ` over the poses, where `n` is an axis of the body in the frame of the
/// specimen. Its trace is 1; without a preferred direction it is a third of the unit tensor. `None` without poses.
#[must_use]
pub fn orientation_tensor(poses: &[Pose], axis: BodyAxis) -> Option<Matrix3<f64>> {
    let mut sum = Matrix3::zeros();
    for pose in poses {
        let rotation = pose.rotation();
        let direction = rotation.column(axis as usize);
        sum += direction * direction.transpose();
    }
    (!poses.is_empty()).then(|| sum / poses.len() as f64)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::shape::Form;
    use nalgebra::{UnitQuaternion, Vector3};

    fn grain(size: f64, flatness: f64) -> Ellipsoid {
        Ellipsoid::with_sieve_size(size, Form { elongation: 0.5, flatness }).unwrap()
    }

    fn is_flaky(grain: &Ellipsoid) -> Option<bool> {
        super::is_flaky(&grain.into())
    }

    #[test]
    fn flaky_is_what_passes_half_the_upper_sieve() {
        // Certain below 0.378, none above 0.493 in fractions 1 : 1.25.
        for size in [4.01, 4.9, 8.01, 9.9, 16.01, 80.01] {
            assert_eq!(is_flaky(&grain(size, 0.377)), Some(true), "{size}");
            assert_eq!(is_flaky(&grain(size, 0.494)), Some(false), "{size}");
        }
        assert_eq!(is_flaky(&grain(4.1, 0.45)), Some(true));
        assert_eq!(is_flaky(&grain(4.9, 0.45)), Some(false));
        assert_eq!((is_flaky(&grain(3.9, 0.3)), is_flaky(&grain(101.0, 0.3))), (None, None));
    }

    #[test]
    fn indices_are_shares_of_the_mass() {
        let (flaky, round) = (grain(5.0, 0.3), grain(10.0, 1.0));
        let share = flaky.volume_mm3() / (flaky.volume_mm3() + round.volume_mm3());
        let calipers = |grains: &[Ellipsoid]| grains.iter().map(CaliperSizes::from).collect::<Vec<_>>();
        let flakiness = |grains: &[Ellipsoid]| flakiness_index(calipers(grains).into_iter());
        let shape = |grains: &[Ellipsoid]| shape_index(calipers(grains).into_iter());
        assert_eq!(flakiness(&[flaky, round, grain(2.0, 0.3)]), Some(share));
        // a/c is 6.7 and 2.
        assert_eq!(shape(&[flaky, round, grain(70.0, 0.3)]), Some(share));
        assert_eq!((flakiness(&[]), shape(&[grain(2.0, 0.3)])), (None, None));
    }

    /// EN 933-4 counts grains that are more than three times as long as thick, EN 933-3 those that are thinner than the
    /// slot. Exact ratios and sizes miss these limits by the last digit, on either side.
    #[test]
    fn grains_at_a_limit_lie_on_the_side_that_the_standards_say() {
        for i in 0..500 {
            let size = 4.5 + 0.037 * f64::from(i % 97) + 0.1 * f64::from(i % 7);
            let of_ratios = |ratios: [f64; 3]| {
                CaliperSizes::from(&Ellipsoid::with_sieve_size(size, Form::of_axes(ratios)).unwrap())
            };
            assert_eq!(is_non_cubical(&of_ratios([3.0, 2.0, 1.0])), Some(false), "{size}");
            assert_eq!(is_non_cubical(&of_ratios([0.3, 0.2, 0.1])), Some(false), "{size}");
            assert_eq!(is_non_cubical(&of_ratios([3.000_001, 2.0, 1.0])), Some(true), "{size}");
        }
        for [low, high, slot] in FLAKINESS_FRACTIONS_MM {
            for flatness in [0.37, 0.41, 0.45, 0.6, 0.83, 1.0] {
                // As large as the upper sieve, as the lower one, and a little larger than this.
                let of_size = |mm: f64| CaliperSizes::from(&grain(mm, flatness));
                assert_eq!(
                    flakiness_fraction(&of_size(high)).map(|i| FLAKINESS_FRACTIONS_MM[i][1]),
                    Some(high)
                );
                let below = flakiness_fraction(&of_size(low)).map(|i| FLAKINESS_FRACTIONS_MM[i][1]);
                assert_eq!(below, (low > 4.0).then_some(low));
                let above = flakiness_fraction(&of_size(low * (1.0 + 1e-6)));
                assert_eq!(above.map(|i| FLAKINESS_FRACTIONS_MM[i][1]), Some(high));
            }
            // As thick as the slot is wide: a/c of (a, b, c) with b such that the sieve size lies in the fraction.
            let c = slot / 2.0;
            let b = ((0.49 * (low + high)).powi(2) / 2.0 - c * c).sqrt();
            for factor in [1.0, 1.0 - 1e-15, 1.0 + 1e-15] {
                let thick = CaliperSizes::from(&Ellipsoid::new([2.0 * b, b, c * factor]).unwrap());
                assert_eq!(super::is_flaky(&thick), Some(false), "{low}..{high}");
            }
            let thin = CaliperSizes::from(&Ellipsoid::new([2.0 * b, b, c * (1.0 - 1e-6)]).unwrap());
            assert_eq!(super::is_flaky(&thin), Some(true), "{low}..{high}");
        }
        let range = |mm: f64| is_non_cubical(&CaliperSizes::from(&grain(mm, 0.7))).is_some();
        assert_eq!([4.0, 4.000_001, 63.0, 63.000_1].map(range), [false, true, true, false]);
    }

    #[test]
    fn the_fractions_add_up_to_the_index_of_all() {
        let grains = [grain(4.5, 0.3), grain(4.9, 0.45), grain(9.0, 0.3), grain(9.5, 0.9), grain(2.0, 0.3)];
        let sizes = || grains.iter().map(CaliperSizes::from);
        let fractions = flakiness_fractions(sizes());
        let present: Vec<_> = fractions.iter().filter(|fraction| fraction.volume_mm3 > 0.0).collect();
        assert_eq!(
            present.iter().map(|f| [f.d_min_mm, f.d_max_mm]).collect::<Vec<_>>(),
            [[4.0, 5.0], [8.0, 10.0]]
        );
        let first = grains[0].volume_mm3() / (grains[0].volume_mm3() + grains[1].volume_mm3());
        assert!((present[0].index().unwrap() - first).abs() < 1e-15);
        let sum = |of: fn(&FlakinessFraction) -> f64| fractions.iter().map(of).sum::<f64>();
        let all = sum(|f| f.flaky_mm3) / sum(|f| f.volume_mm3);
        assert!((all - flakiness_index(sizes()).unwrap()).abs() < 1e-15);
        assert_eq!(fractions.iter().filter(|fraction| fraction.index().is_none()).count(), 12);
    }

    #[test]
    fn the_orientation_tensor_follows_the_axes() {
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        let poses = [Pose::at(Vector3::zeros()), Pose { orientation: turned, ..Pose::at(Vector3::zeros()) }];
        let long = orientation_tensor(&poses, BodyAxis::Long).unwrap();
        assert!((long - Matrix3::from_diagonal(&Vector3::new(0.5, 0.5, 0.0))).norm() < 1e-15, "{long}");
        let short = orientation_tensor(&poses, BodyAxis::Short).unwrap();
        assert!((short - Matrix3::from_diagonal(&Vector3::z())).norm() < 1e-15, "{short}");
        assert_eq!(orientation_tensor(&[], BodyAxis::Long), None);
    }
}
