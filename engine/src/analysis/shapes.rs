//! Figures of the shapes of the grains of a packing, and of their orientation.

use crate::packing::{Ellipsoids, ShapeReport, ZinggShares};
use crate::shape::{BodyAxis, Ellipsoid, Zingg, flakiness_index, orientation_tensor, shape_index};

/// The figures of grains that are not spheres; `None` without grains.
///
/// Means and shares are weighted by volume, which is mass for grains of one density.
#[must_use]
pub fn shape_report(grains: &Ellipsoids) -> Option<ShapeReport> {
    let volume_mm3: f64 = grains.shapes.iter().map(Ellipsoid::volume_mm3).sum();
    let mean = |figure: &dyn Fn(&Ellipsoid) -> f64| {
        grains.shapes.iter().map(|shape| shape.volume_mm3() * figure(shape)).sum::<f64>() / volume_mm3
    };
    let share = |class: Zingg| mean(&|shape| f64::from(u8::from(shape.zingg() == class)));
    let tensor =
        |axis| orientation_tensor(&grains.poses, axis).map(|t| [t.m11, t.m22, t.m33, t.m12, t.m23, t.m13]);
    Some(ShapeReport {
        flakiness_index: flakiness_index(&grains.shapes),
        shape_index: shape_index(&grains.shapes),
        elongation_mean: mean(&Ellipsoid::elongation),
        flatness_mean: mean(&Ellipsoid::flatness),
        sphericity_mean: mean(&Ellipsoid::sphericity),
        zingg: ZinggShares {
            disc: share(Zingg::Disc),
            equant: share(Zingg::Equant),
            blade: share(Zingg::Blade),
            rod: share(Zingg::Rod),
        },
        surface_mm2: grains.shapes.iter().map(Ellipsoid::surface_mm2).sum(),
        long_axis_tensor: tensor(BodyAxis::Long)?,
        short_axis_tensor: tensor(BodyAxis::Short)?,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::shape::Pose;

    #[test]
    fn figures_are_weighted_by_volume() {
        let (disc, ball) = (Ellipsoid::new([4.0, 4.0, 1.0]).unwrap(), Ellipsoid::new([1.0; 3]).unwrap());
        let poses = vec![Pose::at(Vector3::zeros()); 2];
        let report = shape_report(&Ellipsoids { shapes: vec![disc, ball], poses }).unwrap();
        let of_disc = 16.0 / 17.0;
        assert!(
            (report.zingg.disc - of_disc).abs() < 1e-12
                && (report.zingg.equant - 1.0 + of_disc).abs() < 1e-12
        );
        assert!((report.flatness_mean - (of_disc / 4.0 + 1.0 / 17.0)).abs() < 1e-12);
        assert_eq!((report.zingg.rod, report.zingg.blade, report.elongation_mean), (0.0, 0.0, 1.0));
        assert_eq!(report.long_axis_tensor, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(report.short_axis_tensor, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!(report.surface_mm2 > disc.surface_mm2());
        assert_eq!(shape_report(&Ellipsoids::default()), None);
    }
}
