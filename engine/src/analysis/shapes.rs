//! Figures of the shapes of the grains of a packing, and of their orientation.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::packing::{Ellipsoids, Polyhedra, ShapeReport, ZinggShares};
use crate::shape::{
    BodyAxis, CaliperSizes, Ellipsoid, Form, Polyhedron, Zingg, flakiness_index, flakiness_index_of,
    orientation_tensor, shape_index, shape_index_of,
};

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

/// What a template tells of its grains, in units of its scale.
struct Template {
    sizes: CaliperSizes,
    form: Form,
    sphericity: f64,
    surface: f64,
    long_axis: Vector3<f64>,
    short_axis: Vector3<f64>,
}

impl Template {
    fn new(body: &Polyhedron) -> Self {
        let (surface, axes) = (body.surface(), body.principal_axes());
        Self {
            sizes: CaliperSizes {
                volume_mm3: body.volume(),
                sieve_mm: body.sieve_size(),
                length_mm: body.length(),
                thickness_mm: body.thickness(),
            },
            form: body.form(),
            sphericity: PI * body.equivalent_diameter().powi(2) / surface,
            surface,
            long_axis: axes.column(0).into(),
            short_axis: axes.column(2).into(),
        }
    }

    fn sizes_of(&self, scale_mm: f64) -> CaliperSizes {
        let CaliperSizes { volume_mm3, sieve_mm, length_mm, thickness_mm } = self.sizes;
        CaliperSizes {
            volume_mm3: volume_mm3 * scale_mm.powi(3),
            sieve_mm: sieve_mm * scale_mm,
            length_mm: length_mm * scale_mm,
            thickness_mm: thickness_mm * scale_mm,
        }
    }
}

/// The figures of polyhedra; `None` without grains. Templates are measured once.
///
/// Length and thickness are the largest and the least caliper width, of the rounded body; elongation, flatness and the
/// axes are those of the ellipsoid of equal inertia ([`Polyhedron::form`]), of the core.
#[must_use]
pub fn polyhedron_report(grains: &Polyhedra) -> Option<ShapeReport> {
    let mut templates: Vec<Option<Template>> = grains.templates.iter().map(|_| None).collect();
    for &template in &grains.template {
        let index = template as usize;
        templates[index].get_or_insert_with(|| Template::new(&grains.templates[index]));
    }
    // Every template that a grain has was measured.
    let measured = || {
        let of_grain =
            |(&template, &d_mm): (&u32, &f64)| Some((templates[template as usize].as_ref()?, d_mm));
        grains.template.iter().zip(&grains.d_mm).filter_map(of_grain)
    };
    let sizes = || measured().map(|(template, scale_mm)| template.sizes_of(scale_mm));
    let volume_mm3: f64 = sizes().map(|sizes| sizes.volume_mm3).sum();
    let mean = |figure: &dyn Fn(&Template) -> f64| {
        measured().map(|(template, d)| template.sizes_of(d).volume_mm3 * figure(template)).sum::<f64>()
            / volume_mm3
    };
    let share = |class: Zingg| mean(&|template| f64::from(u8::from(template.form.zingg() == class)));
    let tensor = |axis: fn(&Template) -> Vector3<f64>| {
        let mut sum = Matrix3::zeros();
        for ((template, _), pose) in measured().zip(&grains.poses) {
            let direction = pose.rotation() * axis(template);
            sum += direction * direction.transpose();
        }
        let mean = sum / grains.len() as f64;
        [mean.m11, mean.m22, mean.m33, mean.m12, mean.m23, mean.m13]
    };
    (!grains.is_empty()).then(|| ShapeReport {
        flakiness_index: flakiness_index_of(sizes()),
        shape_index: shape_index_of(sizes()),
        elongation_mean: mean(&|template| template.form.elongation),
        flatness_mean: mean(&|template| template.form.flatness),
        sphericity_mean: mean(&|template| template.sphericity),
        zingg: ZinggShares {
            disc: share(Zingg::Disc),
            equant: share(Zingg::Equant),
            blade: share(Zingg::Blade),
            rod: share(Zingg::Rod),
        },
        surface_mm2: measured().map(|(template, d)| template.surface * d * d).sum(),
        long_axis_tensor: tensor(|template| template.long_axis),
        short_axis_tensor: tensor(|template| template.short_axis),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::shape::Pose;

    /// A cuboid of equivalent diameter 1, and that of its edges times a factor.
    fn cuboid(edges: [f64; 3]) -> (Polyhedron, f64) {
        let corner =
            |i: usize| Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { edges[axis] } else { 0.0 });
        let body = Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        (body.normalized(), body.equivalent_diameter())
    }

    #[test]
    fn figures_of_cuboids_have_their_closed_forms() {
        // Sieve sizes 10 and 5 sqrt(2) < 10, thicknesses 10 and 4.
        let (cube, of_cube) = cuboid([10.0; 3]);
        let (plate, of_plate) = cuboid([20.0, 10.0, 4.0]);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let flat = Pose::at(Vector3::zeros());
        let grains = Polyhedra {
            templates: vec![cube, plate],
            template: vec![0, 1],
            d_mm: vec![of_cube, of_plate],
            poses: vec![flat, Pose { orientation: turned, ..flat }],
        };
        let report = polyhedron_report(&grains).unwrap();
        let of = |found: f64, known: f64| assert!((found - known).abs() < 1e-9, "{found} {known}");
        // The plate has 800 of 1800 mm³; D_s = 14 / sqrt 2 = 9.9 lies in 8..10, whose slots have 5 mm.
        let share = 800.0 / 1800.0;
        of(report.flakiness_index.unwrap(), share);
        of(report.shape_index.unwrap(), share);
        of(report.surface_mm2, 600.0 + 2.0 * (200.0 + 80.0 + 40.0));
        of(report.elongation_mean, 1.0 - share + share * 0.5);
        of(report.flatness_mean, 1.0 - share + share * 0.4);
        of(report.zingg.blade, share);
        of(report.zingg.equant, 1.0 - share);
        let sphericity = |volume: f64, surface: f64| (PI * (6.0 * volume) * (6.0 * volume)).cbrt() / surface;
        of(
            report.sphericity_mean,
            (1.0 - share) * sphericity(1000.0, 600.0) + share * sphericity(800.0, 640.0),
        );
        // The short axis of the plate lies along x; those of the cube are any of its own.
        assert!(report.short_axis_tensor[0] > 0.5 - 1e-9, "{report:?}");
        of(report.short_axis_tensor[..3].iter().sum(), 1.0);
        assert!(report.long_axis_tensor[2] > 0.5 - 1e-9, "{report:?}");
        assert_eq!(polyhedron_report(&Polyhedra::default()), None);
    }

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
