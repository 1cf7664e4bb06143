//! The grains of a mix as the model of forecasts sees them: numbers by size, each with its distance as a coating.

use std::f64::consts::PI;

use crate::elementary::cbrt;
use crate::mix::{GradedMix, MeanForm, ShapeSampler};
use crate::shape::ParallelBody;

/// Grains of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Size {
    /// Diameter of the sphere of their volume.
    pub(crate) diameter: f64,
    pub(crate) number: f64,
    /// Their surface over that of this sphere,
    pub(crate) surface: f64,
    /// and their mean width over its diameter.
    pub(crate) width: f64,
}

/// The mean form of the grains of a mix.
pub(super) fn form_of(mix: &GradedMix) -> MeanForm {
    mix.shapes.as_ref().map_or(MeanForm::SPHERE, ShapeSampler::mean_form)
}

/// Sizes of the expected grains from fine to coarse, with a coating that makes a diameter `d` to `factor d + offset`.
pub(super) fn sizes(mix: &GradedMix, form: MeanForm, factor: f64, offset: f64) -> Vec<Size> {
    let MeanForm { surface, width, .. } = form;
    let mut sizes: Vec<Size> = mix
        .expected_sizes()
        .into_iter()
        .map(|(d, number)| {
            if mix.shapes.is_none() {
                return Size { diameter: factor * d + offset, number, surface: 1.0, width: 1.0 };
            }
            let coating = 0.5 * ((factor - 1.0) * d + offset);
            let ball = ParallelBody::of_ball(d);
            let body = ParallelBody {
                surface: surface * ball.surface,
                mean_curvature: width * ball.mean_curvature,
                ..ball
            };
            let diameter = cbrt(body.volume_at(coating) * 6.0 / PI);
            // Steiner's formula for the surface and the mean width of a parallel body.
            let surface = body.surface + 2.0 * coating * (body.mean_curvature + 2.0 * PI * coating);
            Size {
                diameter,
                number,
                surface: surface / (PI * diameter * diameter),
                width: (width * d + 2.0 * coating) / diameter,
            }
        })
        .collect();
    sizes.sort_by(|a, b| a.diameter.total_cmp(&b.diameter));
    sizes
}

/// The surface and the mean width over those of spheres, in the mean by volume: 1 and 1 for spheres.
pub(super) fn surface_and_width(sizes: &[Size]) -> [f64; 2] {
    let sum = |of: &dyn Fn(&Size) -> f64| -> f64 {
        sizes.iter().map(|size| size.number * size.diameter.powi(3) * of(size)).sum()
    };
    let volume = sum(&|_| 1.0);
    if volume > 0.0 {
        [sum(&|size| size.surface) / volume, sum(&|size| size.width) / volume]
    } else {
        [1.0; 2]
    }
}
