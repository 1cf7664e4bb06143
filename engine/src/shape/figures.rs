//! Figures of the shape of a grain: sizes, form, sphericity, roundness, surface and axes.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::{CaliperSizes, Ellipsoid, Form, Polyhedron};

/// What a grain, or a template in units of its scale, has to tell.
#[derive(Clone, Copy, Debug)]
pub struct ShapeFigures {
    /// Volume, sieve size and caliper widths.
    pub sizes: CaliperSizes,
    /// Elongation and flatness.
    pub form: Form,
    /// Wadell's sphericity.
    pub sphericity: f64,
    /// Wadell's roundness in space.
    pub roundness: f64,
    /// Surface in mm².
    pub surface_mm2: f64,
    /// Along the length, in the axes of the body.
    pub long_axis: Vector3<f64>,
    /// Along the thickness, in the axes of the body.
    pub short_axis: Vector3<f64>,
}

impl ShapeFigures {
    /// Those of a sphere.
    #[must_use]
    pub fn of_sphere(d_mm: f64) -> Self {
        Self {
            sizes: CaliperSizes {
                volume_mm3: PI / 6.0 * d_mm.powi(3),
                sieve_mm: d_mm,
                length_mm: d_mm,
                thickness_mm: d_mm,
            },
            form: Form { elongation: 1.0, flatness: 1.0 },
            sphericity: 1.0,
            roundness: 1.0,
            surface_mm2: PI * d_mm * d_mm,
            long_axis: Vector3::x(),
            short_axis: Vector3::z(),
        }
    }

    /// Those of a body that is larger by a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let surface_mm2 = self.surface_mm2 * factor * factor;
        Self { sizes: self.sizes.scaled(factor), surface_mm2, ..*self }
    }
}

impl From<&Ellipsoid> for ShapeFigures {
    fn from(shape: &Ellipsoid) -> Self {
        Self {
            sizes: shape.into(),
            form: shape.form(),
            sphericity: shape.sphericity(),
            roundness: shape.roundness(),
            surface_mm2: shape.surface_mm2(),
            long_axis: Vector3::x(),
            short_axis: Vector3::z(),
        }
    }
}

/// In units of the polyhedron.
impl From<&Polyhedron> for ShapeFigures {
    fn from(body: &Polyhedron) -> Self {
        let (surface, axes) = (body.surface(), body.principal_axes());
        Self {
            sizes: body.into(),
            form: body.form(),
            sphericity: PI * body.equivalent_diameter().powi(2) / surface,
            roundness: body.roundness(),
            surface_mm2: surface,
            long_axis: axes.column(0).into(),
            short_axis: axes.column(2).into(),
        }
    }
}
