//! Figures of the shapes of the grains of a packing, and of their orientation.

use nalgebra::Matrix3;

use crate::packing::{GrainsRef, ShapeReport, Solids, ZinggShares};
use crate::shape::{CaliperSizes, Form, Pose, ShapeFigures, Zingg, flakiness_index, shape_index};

/// The grains of a packing and the figures of their templates, which are measured once.
pub(crate) struct Measured<'a> {
    grains: GrainsRef<'a>,
    /// One for each template; those that no grain has are not measured.
    templates: Vec<Option<ShapeFigures>>,
}

impl<'a> Measured<'a> {
    pub(crate) fn new(grains: GrainsRef<'a>) -> Self {
        let mut templates = vec![None; grains.templates().len()];
        for template in (0..grains.len()).filter_map(|grain| grains.template(grain)) {
            let template = template as usize;
            templates[template].get_or_insert_with(|| (&grains.templates()[template]).into());
        }
        Self { grains, templates }
    }

    /// The figures of a grain.
    pub(crate) fn of(&self, grain: usize) -> ShapeFigures {
        match (self.grains.template(grain), self.grains.solids()) {
            (Some(template), _) => self.of_template(template).scaled(self.grains.d_mm(grain)),
            (None, Some(solids)) => solids.shape(grain).figures(),
            (None, None) => ShapeFigures::of_sphere(self.grains.d_mm(grain)),
        }
    }

    /// The form and the sizes of a grain alone, without an integral for its surface.
    fn measured(&self, grain: usize) -> MeasuredGrain {
        let shape = self.grains.solids().filter(|_| self.grains.template(grain).is_none());
        if let Some(shape) = shape.map(|solids| solids.shape(grain)) {
            return MeasuredGrain { form: shape.form(), sizes: shape.calipers() };
        }
        let ShapeFigures { form, sizes, .. } = self.of(grain);
        MeasuredGrain { form, sizes }
    }

    fn of_template(&self, template: u32) -> &ShapeFigures {
        self.templates[template as usize].as_ref().expect("the templates of all grains are measured")
    }
}

/// The form of a grain and its sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredGrain {
    /// Elongation and flatness; of a polyhedron those of the ellipsoid of equal inertia
    /// ([`crate::shape::Polyhedron::form`]).
    pub form: Form,
    /// Volume, sieve size, length and thickness.
    pub sizes: CaliperSizes,
}

/// The forms and sizes of all grains, in their order; `None` where all are spheres. Templates are measured once.
#[must_use]
pub fn measured_grains<'a>(grains: impl Into<GrainsRef<'a>>) -> Option<Vec<MeasuredGrain>> {
    let measured = Measured::new(grains.into());
    measured
        .grains
        .kind()
        .has_orientations()
        .then(|| (0..measured.grains.len()).map(|grain| measured.measured(grain)).collect())
}

/// The figures of grains that are not spheres; `None` without grains.
///
/// Means and shares are weighted by volume, which is mass for grains of one density. Of polyhedra, length and thickness
/// are the largest and the least caliper width, of the rounded body; elongation, flatness and the axes are those of the
/// ellipsoid of equal inertia ([`crate::shape::Polyhedron::form`]), of the core. Templates are measured once.
#[must_use]
pub fn shape_report(grains: &Solids) -> Option<ShapeReport> {
    if grains.is_empty() {
        return None;
    }
    let measured = Measured::new(grains.into());
    let mut sums = Sums::default();
    for (grain, pose) in grains.poses.iter().enumerate() {
        sums.add(&measured.of(grain), pose);
    }
    let sizes = || (0..grains.len()).map(|grain| measured.measured(grain).sizes);
    Some(sums.report(flakiness_index(sizes()), shape_index(sizes()), grains.len()))
}

/// Sums over the grains, of figures times volumes where means are weighted.
#[derive(Default)]
struct Sums {
    volume_mm3: f64,
    elongation: f64,
    flatness: f64,
    sphericity: f64,
    roundness: f64,
    disc: f64,
    equant: f64,
    blade: f64,
    rod: f64,
    surface_mm2: f64,
    long_axis: Matrix3<f64>,
    short_axis: Matrix3<f64>,
}

impl Sums {
    fn add(&mut self, figures: &ShapeFigures, pose: &Pose) {
        let volume_mm3 = figures.sizes.volume_mm3;
        self.volume_mm3 += volume_mm3;
        self.elongation += volume_mm3 * figures.form.elongation;
        self.flatness += volume_mm3 * figures.form.flatness;
        self.sphericity += volume_mm3 * figures.sphericity;
        self.roundness += volume_mm3 * figures.roundness;
        *match figures.form.zingg() {
            Zingg::Disc => &mut self.disc,
            Zingg::Equant => &mut self.equant,
            Zingg::Blade => &mut self.blade,
            Zingg::Rod => &mut self.rod,
        } += volume_mm3;
        self.surface_mm2 += figures.surface_mm2;
        let rotation = pose.rotation();
        for (sum, axis) in
            [(&mut self.long_axis, figures.long_axis), (&mut self.short_axis, figures.short_axis)]
        {
            let direction = rotation * axis;
            *sum += direction * direction.transpose();
        }
    }

    fn report(&self, flakiness: Option<f64>, shape: Option<f64>, grains: usize) -> ShapeReport {
        let mean = |sum: f64| sum / self.volume_mm3;
        let tensor = |sum: &Matrix3<f64>| {
            let mean = sum / grains as f64;
            [mean.m11, mean.m22, mean.m33, mean.m12, mean.m23, mean.m13]
        };
        ShapeReport {
            flakiness_index: flakiness,
            shape_index: shape,
            elongation_mean: mean(self.elongation),
            flatness_mean: mean(self.flatness),
            sphericity_mean: mean(self.sphericity),
            roundness_mean: Some(mean(self.roundness)),
            zingg: ZinggShares {
                disc: mean(self.disc),
                equant: mean(self.equant),
                blade: mean(self.blade),
                rod: mean(self.rod),
            },
            surface_mm2: self.surface_mm2,
            long_axis_tensor: tensor(&self.long_axis),
            short_axis_tensor: tensor(&self.short_axis),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::shape::{Ellipsoid, Polyhedron, Solid};

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
        let shapes = [(0, of_cube), (1, of_plate)];
        let grains = Solids {
            templates: vec![cube, plate],
            shapes: shapes.map(|(template, d_mm)| Solid::of_template(template, d_mm)).to_vec(),
            poses: vec![flat, Pose { orientation: turned, ..flat }],
            aggregate: Vec::new(),
        };
        let report = shape_report(&grains).unwrap();
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
        let sphericity =
            |volume: f64, surface: f64| libm::cbrt(PI * (6.0 * volume) * (6.0 * volume)) / surface;
        of(
            report.sphericity_mean,
            (1.0 - share) * sphericity(1000.0, 600.0) + share * sphericity(800.0, 640.0),
        );
        assert_eq!(report.roundness_mean, Some(0.0));
        // The short axis of the plate lies along x; those of the cube are any of its own.
        assert!(report.short_axis_tensor[0] > 0.5 - 1e-9, "{report:?}");
        of(report.short_axis_tensor[..3].iter().sum(), 1.0);
        assert!(report.long_axis_tensor[2] > 0.5 - 1e-9, "{report:?}");
        let none = Solids { shapes: Vec::new(), poses: Vec::new(), ..grains };
        assert_eq!(shape_report(&none), None);
    }

    #[test]
    fn figures_are_weighted_by_volume() {
        let (disc, ball) = (Ellipsoid::new([4.0, 4.0, 1.0]).unwrap(), Ellipsoid::new([1.0; 3]).unwrap());
        let poses = vec![Pose::at(Vector3::zeros()); 2];
        let report = shape_report(&Solids::of_ellipsoids(vec![disc, ball], poses)).unwrap();
        let of_disc = 16.0 / 17.0;
        assert!(
            (report.zingg.disc - of_disc).abs() < 1e-12
                && (report.zingg.equant - 1.0 + of_disc).abs() < 1e-12
        );
        assert!((report.flatness_mean - (of_disc / 4.0 + 1.0 / 17.0)).abs() < 1e-12);
        assert!((report.roundness_mean.unwrap() - (of_disc / 4.0 + 1.0 / 17.0)).abs() < 1e-12);
        assert_eq!((report.zingg.rod, report.zingg.blade, report.elongation_mean), (0.0, 0.0, 1.0));
        assert_eq!(report.long_axis_tensor, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(report.short_axis_tensor, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!(report.surface_mm2 > disc.surface_mm2());
        assert_eq!(shape_report(&Solids::default()), None);
    }
}
