//! Draws the orientations of grains.
//!
//! Uniform: a point of the unit sphere in four dimensions by rejection (G. Marsaglia, Ann. Math. Statist. 43, 645-646,
//! 1972, DOI 10.1214/aoms/1177692644), taken as a quaternion. It has the distribution of the method of Shoemake
//! (Graphics Gems III, 124-132, 1992, DOI 10.1016/B978-0-08-050755-2.50036-1), but needs square roots only, whose
//! results are the same on every processor.
//!
//! About an axis: the cosine `t` between the short axis of the grain and the axis has the density `exp(k t²)`
//! (Dimroth-Watson), drawn by rejection (D. J. Best and N. I. Fisher, Austral. J. Statist. 28, 13-31, 1986,
//! DOI 10.1111/j.1467-842X.1986.tb00580.x): for `k > 0` from the density `exp(k t)`, because `t² <= t`; for `k < 0`
//! from `1 / (1 + |k| t²)`, because `exp(-x) <= 1 / (1 + x)`. Half of the draws at least are accepted.

use nalgebra::{Quaternion, UnitQuaternion};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::elementary::{atan, exp, exp_m1, ln_1p, tan};
use crate::request::{Axis, Orientation};
use crate::rng::uniform;

/// Draws the orientation of a grain: the rotation from its own axes, of which the longest is x and the shortest z, to
/// those of the specimen.
pub fn draw_orientation(orientation: &Orientation, rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    match *orientation {
        Orientation::Uniform {} => uniform_orientation(rng),
        Orientation::Axis { axis, concentration } => about_axis(axis, concentration, rng),
    }
}

/// A point in the unit disc, but for its centre, with its squared distance from there.
fn in_disc(rng: &mut Xoshiro256PlusPlus) -> ([f64; 2], f64) {
    loop {
        let point = [2.0 * uniform(rng) - 1.0, 2.0 * uniform(rng) - 1.0];
        let square = point[0] * point[0] + point[1] * point[1];
        if square > 0.0 && square < 1.0 {
            return (point, square);
        }
    }
}

/// Draws an orientation that is uniform on the rotation group.
pub fn uniform_orientation(rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    let ([w, x], square) = in_disc(rng);
    let ([y, z], other) = in_disc(rng);
    let scale = ((1.0 - square) / other).sqrt();
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y * scale, z * scale))
}

fn about_axis(axis: Axis, concentration: f64, rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    let mut cosine = cosine(concentration, rng);
    if uniform(rng) < 0.5 {
        cosine = -cosine;
    }
    // A turn about z, then a tilt of z by the angle, about an axis at right angles to z.
    let ([w, z], square) = in_disc(rng);
    let turn = Quaternion::new(w, 0.0, 0.0, z) / square.sqrt();
    let ([x, y], square) = in_disc(rng);
    let sine = ((1.0 - cosine) / 2.0).max(0.0).sqrt() / square.sqrt();
    let tilt = Quaternion::new(((1.0 + cosine) / 2.0).max(0.0).sqrt(), x * sine, y * sine, 0.0);
    // A third of a turn about the space diagonal takes z to x, and its inverse z to y.
    let to_axis = match axis {
        Axis::X => Quaternion::new(0.5, 0.5, 0.5, 0.5),
        Axis::Y => Quaternion::new(0.5, -0.5, -0.5, -0.5),
        Axis::Z => Quaternion::identity(),
    };
    UnitQuaternion::new_normalize(to_axis * tilt * turn)
}

/// A cosine from 0 to 1 with a density proportional to `exp(k t²)`.
fn cosine(k: f64, rng: &mut Xoshiro256PlusPlus) -> f64 {
    loop {
        let (u, v) = (uniform(rng), uniform(rng));
        let (t, accepted) = if k > 0.0 {
            let t = (ln_1p(u * exp_m1(k)) / k).min(1.0);
            (t, exp(k * t * (t - 1.0)))
        } else if k < 0.0 {
            let root = (-k).sqrt();
            let t = (tan(u * atan(root)) / root).min(1.0);
            (t, (1.0 - k * t * t) * exp(k * t * t))
        } else {
            (u, 1.0)
        };
        if v < accepted {
            return t;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::shape::{BodyAxis, Pose, orientation_tensor};
    use nalgebra::{Matrix3, Vector3};

    const N: usize = 100_000;

    fn poses(orientation: &Orientation) -> Vec<Pose> {
        let mut rng = stream(4, Stream::Rsa);
        let mut draw =
            || Pose { orientation: draw_orientation(orientation, &mut rng), ..Pose::at(Vector3::zeros()) };
        (0..N).map(|_| draw()).collect()
    }

    /// Mean of `t²` with the density `exp(k t²)`.
    fn mean_square(k: f64) -> f64 {
        let steps = 20_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..steps {
            let t = (f64::from(i) + 0.5) / f64::from(steps);
            let density = (k * (t * t - 1.0)).exp();
            sum += density;
            squares += density * t * t;
        }
        squares / sum
    }

    #[test]
    fn uniform_orientations_have_no_direction() {
        let poses = poses(&Orientation::Uniform {});
        for axis in [BodyAxis::Long, BodyAxis::Middle, BodyAxis::Short] {
            let tensor = orientation_tensor(&poses, axis).unwrap();
            assert!((tensor - Matrix3::identity() / 3.0).amax() < 5e-3, "{tensor}");
        }
        // The angle of a uniform rotation has the density (1 - cos a) / pi, so that w² has the mean 1/4, and w⁴ 1/8.
        let mean = |power: i32| {
            poses.iter().map(|pose| pose.orientation.w.abs().powi(power)).sum::<f64>() / N as f64
        };
        assert!((mean(2) - 0.25).abs() < 3e-3 && (mean(4) - 0.125).abs() < 3e-3, "{} {}", mean(2), mean(4));
        // A coordinate of a uniform axis is uniform in -1..1.
        let mut heights: Vec<f64> = poses.iter().map(|pose| pose.rotation()[(2, 0)]).collect();
        heights.sort_by(f64::total_cmp);
        for (i, z) in heights.iter().enumerate() {
            let below = (i as f64 + 0.5) / N as f64;
            assert!((f64::midpoint(*z, 1.0) - below).abs() < 6e-3, "{z} {below}");
        }
    }

    #[test]
    fn orientations_about_an_axis_have_its_moments() {
        for axis in Axis::ALL {
            for concentration in [-100.0, -3.0, 0.0, 0.5, 4.0, 100.0] {
                let poses = poses(&Orientation::Axis { axis, concentration });
                let known = mean_square(concentration);
                let tensor = orientation_tensor(&poses, BodyAxis::Short).unwrap();
                let mut expected = Matrix3::from_diagonal_element((1.0 - known) / 2.0);
                expected[(axis.index(), axis.index())] = known;
                assert!((tensor - expected).amax() < 5e-3, "{axis:?} {concentration}: {tensor}");
                // The long axis takes any turn about the short one.
                let long = orientation_tensor(&poses, BodyAxis::Long).unwrap();
                let middle = orientation_tensor(&poses, BodyAxis::Middle).unwrap();
                assert!((long - middle).amax() < 1e-2, "{axis:?} {concentration}: {long} {middle}");
                // Both ends of the short axis are alike.
                let mean =
                    poses.iter().map(|pose| pose.rotation().column(2).into_owned()).sum::<Vector3<f64>>();
                assert!((mean / N as f64).amax() < 1e-2, "{mean}");
            }
        }
    }

    #[test]
    fn the_same_seed_draws_the_same_orientations() {
        let orientation = Orientation::Axis { axis: Axis::Z, concentration: 2.0 };
        assert_eq!(poses(&orientation), poses(&orientation));
    }
}
