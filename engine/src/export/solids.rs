//! Grains as lines and planes cut them: sections at a height, chords along x, and whether a point lies inside.
//!
//! For an ellipsoid with the shape matrix `A` and its inverse `M`, the points with `(p - x) · M (p - x) <= 1`, the
//! section at a height `dz` above the centre `x` is the ellipse around `(A_xz, A_yz) dz / A_zz` with the matrix of the
//! Schur complement of `A_zz`, scaled by `1 - dz² / A_zz`; a chord along x follows from the quadratic equation in x.
//! Chords of polyhedra are computed in the axes of their template (`convex`).

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::arrays::Each as _;
use crate::geometry::convex::{Convex, Lines, Place};
use crate::memory::{OutOfMemory, collected};
use crate::packing::{GrainsRef, Solids, Spheres};
use crate::shape::{Ellipsoid, Pose, Solid};

/// The grains of a packing, with what their sections are computed from.
pub(super) enum Sectioned<'a> {
    Spheres(&'a Spheres),
    Solids { grains: &'a Solids, templates: Vec<Convex>, forms: Vec<Form> },
}

/// What the sections of a grain are computed from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Form {
    Ellipsoid {
        /// Shape matrix `A` in mm².
        shape: Matrix3<f64>,
        /// Its inverse, in 1/mm².
        inverse: Matrix3<f64>,
    },
    Polyhedron {
        template: u32,
        /// Half of the extents along x, y and z, the farther half.
        half_extents: [f64; 3],
    },
}

impl Form {
    fn of_ellipsoid(shape: &Ellipsoid, pose: &Pose) -> Self {
        let inverse_squares = shape.semi_axes_mm().map(|axis| 1.0 / (axis * axis));
        let rotation = pose.rotation();
        let inverse = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
        Self::Ellipsoid { shape: shape.matrix_mm2(pose), inverse }
    }

    fn of_polyhedron(template: u32, convex: &Convex, place: &Place) -> Self {
        let half_extents = [0, 1, 2].each(|axis| {
            let row = place.rotation.row(axis).transpose();
            let reaches = convex.vertices.iter().map(|vertex| row.dot(vertex).abs());
            place.scale * (reaches.fold(0.0, f64::max) + convex.rounding)
        });
        Self::Polyhedron { template, half_extents }
    }
}

/// What is used again from section to section of polyhedra.
#[derive(Debug, Default)]
pub(super) struct Aim {
    lines: Lines,
    /// The grain that the lines are those of: all its sections, and those of its images, have the same.
    grain: Option<usize>,
}

/// The section of a grain by a plane across z.
pub(super) enum Section<'a> {
    Disc {
        center: [f64; 2],
        radius: f64,
    },
    Ellipse {
        center: [f64; 2],
        /// Half of its extent along y.
        half_y: f64,
        /// The step of the middle of a chord along x, per step in y.
        shear: f64,
        /// Half of the chord along x through the centre.
        half_x: f64,
    },
    Polyhedron {
        template: &'a Convex,
        /// Centre of the grain, x and y.
        center: [f64; 2],
        /// Half of the extent of the whole grain along y.
        half_y: f64,
        /// The point of the plane above the centre, in the axes and the unit of the template.
        above: Vector3<f64>,
        /// A step of a mm along y there.
        across: Vector3<f64>,
        /// The lines along x there, with a mm as their unit.
        lines: &'a Lines,
    },
}

impl<'a> Sectioned<'a> {
    /// The grains of a packing, with what sections are computed from: 152 bytes a grain that is no sphere.
    ///
    /// # Errors
    /// The system refused memory.
    pub(super) fn new(grains: GrainsRef<'a>) -> Result<Self, OutOfMemory> {
        let grains = match grains {
            GrainsRef::Spheres(spheres) => return Ok(Self::Spheres(spheres)),
            GrainsRef::Solids(solids) => solids,
        };
        let templates = Convex::all(&grains.templates);
        let form = |grain: usize| match grains.shapes[grain] {
            Solid::Ellipsoid(shape) => Form::of_ellipsoid(&shape, &grains.poses[grain]),
            Solid::Polyhedron { template, d_mm } => {
                let place = Place::new(d_mm, &grains.poses[grain]);
                Form::of_polyhedron(template, &templates[template as usize], &place)
            }
        };
        let forms = collected((0..grains.len()).map(form))?;
        Ok(Self::Solids { grains, templates, forms })
    }

    fn grains(&self) -> GrainsRef<'a> {
        match *self {
            Self::Spheres(spheres) => GrainsRef::Spheres(spheres),
            Self::Solids { grains, .. } => GrainsRef::Solids(grains),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.grains().len()
    }

    pub(super) fn center(&self, grain: usize) -> [f64; 3] {
        self.grains().center_mm(grain)
    }

    /// Volume in mm³.
    pub(super) fn volume_mm3(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let d = spheres.d_mm[grain];
                PI / 6.0 * d * d * d
            }
            Self::Solids { grains, .. } => grains.shape(grain).volume_mm3(),
        }
    }

    /// Half of the extents along x, y and z; of polyhedra the farther half.
    pub(super) fn half_extents(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => [spheres.d_mm[grain] / 2.0; 3],
            Self::Solids { forms, .. } => match &forms[grain] {
                Form::Ellipsoid { shape, .. } => shape.diagonal().map(f64::sqrt).into(),
                Form::Polyhedron { half_extents, .. } => *half_extents,
            },
        }
    }

    /// Radius of the smallest sphere around the centre that holds the grain.
    pub(super) fn outer_radius(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain] / 2.0,
            Self::Solids { grains, .. } => grains.shape(grain).outer_radius_mm(),
        }
    }

    fn form(&self, grain: usize) -> Option<&Form> {
        match self {
            Self::Spheres(_) => None,
            Self::Solids { forms, .. } => Some(&forms[grain]),
        }
    }

    /// The shape matrix of an ellipsoid in mm² and its inverse in 1/mm².
    pub(super) fn matrices(&self, grain: usize) -> Option<(&Matrix3<f64>, &Matrix3<f64>)> {
        match self.form(grain)? {
            Form::Ellipsoid { shape, inverse } => Some((shape, inverse)),
            Form::Polyhedron { .. } => None,
        }
    }

    /// The template of a polyhedron, and where the grain is.
    pub(super) fn polyhedron(&self, grain: usize) -> Option<(&Convex, Place)> {
        match (self, self.form(grain)?) {
            (Self::Solids { grains, templates, .. }, Form::Polyhedron { template, .. }) => {
                Some((&templates[*template as usize], Place::of(grains, grain)))
            }
            _ => None,
        }
    }

    /// Diameter of the sphere of equal volume.
    pub(super) fn equivalent_diameter(&self, grain: usize) -> f64 {
        self.grains().d_mm(grain)
    }

    /// The section at a height `dz` above the centre, for a grain that is moved to `center`. `aim` serves these grains
    /// alone.
    #[inline]
    pub(super) fn section<'s>(
        &'s self,
        grain: usize,
        center: [f64; 3],
        dz: f64,
        aim: &'s mut Aim,
    ) -> Section<'s> {
        let (grains, templates, form) = match self {
            Self::Spheres(spheres) => {
                let radius = spheres.d_mm[grain] / 2.0;
                return Section::Disc {
                    center: [center[0], center[1]],
                    radius: ((radius - dz) * (radius + dz)).max(0.0).sqrt(),
                };
            }
            Self::Solids { grains, templates, forms } => (grains, templates, &forms[grain]),
        };
        match form {
            Form::Ellipsoid { shape: a, inverse: m } => {
                let scale = (1.0 - dz * dz / a.m33).max(0.0);
                Section::Ellipse {
                    center: [center[0] + a.m13 / a.m33 * dz, center[1] + a.m23 / a.m33 * dz],
                    half_y: (scale * (a.m22 - a.m23 * a.m23 / a.m33).max(0.0)).sqrt(),
                    shear: -m.m12 / m.m11,
                    half_x: (scale / m.m11).sqrt(),
                }
            }
            Form::Polyhedron { template, half_extents } => {
                let Place { rotation, scale, .. } = Place::of(grains, grain);
                let step = |axis: usize| rotation.row(axis).transpose() / scale;
                let template = &templates[*template as usize];
                if aim.grain != Some(grain) {
                    aim.lines.aim(template, &step(0));
                    aim.grain = Some(grain);
                }
                Section::Polyhedron {
                    template,
                    center: [center[0], center[1]],
                    half_y: half_extents[1],
                    above: step(2) * dz,
                    across: step(1),
                    lines: &aim.lines,
                }
            }
        }
    }
}

impl Section<'_> {
    /// From and to along y; of a polyhedron those of the whole grain.
    #[inline]
    pub(super) fn y(&self) -> [f64; 2] {
        let (y, half) = match *self {
            Self::Disc { center, radius } => (center[1], radius),
            Self::Ellipse { center, half_y, .. } | Self::Polyhedron { center, half_y, .. } => {
                (center[1], half_y)
            }
        };
        [y - half, y + half]
    }

    /// The middle and half of the chord along x at a distance from the centre along y; half is less than 0 where the
    /// line does not meet the grain.
    #[inline]
    fn chord(&self, dy: f64) -> (f64, f64) {
        match *self {
            Self::Disc { center, radius } => (center[0], ((radius - dy) * (radius + dy)).max(0.0).sqrt()),
            Self::Ellipse { center, half_y, shear, half_x } => {
                let part = ((half_y - dy) * (half_y + dy)).max(0.0).sqrt();
                (center[0] + shear * dy, if half_y > 0.0 { half_x * (part / half_y) } else { 0.0 })
            }
            Self::Polyhedron { template, center, above, across, lines, .. } => {
                let ends = lines.chord(template, &(above + across * dy));
                ends.map_or((center[0], -1.0), |[from, to]| {
                    (center[0] + (from + to) / 2.0, (to - from) / 2.0)
                })
            }
        }
    }

    /// From and to along x at a coordinate y; reversed where the line does not meet the grain.
    #[inline]
    pub(super) fn x_at(&self, y: f64) -> [f64; 2] {
        let (middle, half) = self.chord(y - self.center_y());
        [middle - half, middle + half]
    }

    /// Length of the chord along x at a coordinate y.
    #[inline]
    pub(super) fn length_at(&self, y: f64) -> f64 {
        2.0 * self.chord(y - self.center_y()).1.max(0.0)
    }

    #[inline]
    fn center_y(&self) -> f64 {
        match *self {
            Self::Disc { center, .. } | Self::Ellipse { center, .. } | Self::Polyhedron { center, .. } => {
                center[1]
            }
        }
    }
}

/// Value of the quadratic form: less than 1 inside the ellipsoid.
pub(super) fn quadratic(inverse: &Matrix3<f64>, from_center: &Vector3<f64>) -> f64 {
    from_center.dot(&(inverse * from_center))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::properties::properties;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;

    fn solids(axes: [f64; 3], angles: [f64; 3]) -> Solids {
        let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        let pose = Pose { center_mm: Vector3::new(1.0, 2.0, 3.0), orientation };
        Solids::of_ellipsoids(vec![Ellipsoid::new(axes).unwrap()], vec![pose])
    }

    properties! {
        #[test]
        fn the_ends_of_chords_lie_on_the_surface(
            axes in prop::array::uniform3(0.3..3.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
            at_z in -0.999..0.999_f64, at_y in -0.999..0.999_f64,
        ) {
            let grains = solids(axes, angles);
            let solids = Sectioned::new((&grains).into()).unwrap();
            let (_, inverse) = solids.matrices(0).unwrap();
            let center = Vector3::from(solids.center(0));
            let dz = at_z * solids.half_extents(0)[2];
            let mut aim = Aim::default();
            let section = solids.section(0, center.into(), dz, &mut aim);
            let [low, high] = section.y();
            let y = (low + high) / 2.0 + at_y * (high - low) / 2.0;
            let [from, to] = section.x_at(y);
            for x in [from, to] {
                let on = Vector3::new(x, y, center.z + dz) - center;
                prop_assert!((quadratic(inverse, &on) - 1.0).abs() < 1e-9);
            }
            prop_assert!((section.length_at(y) - (to - from)).abs() < 1e-12);
        }

        #[test]
        fn equal_semi_axes_give_the_sections_of_a_sphere(radius in 0.3..3.0_f64, at in -0.9..0.9_f64) {
            let grains = solids([radius; 3], [0.3, 0.5, 0.7]);
            let mut spheres = Spheres::default();
            spheres.push([1.0, 2.0, 3.0], 2.0 * radius);
            let (one, other) = (Sectioned::new((&grains).into()).unwrap(), Sectioned::new((&spheres).into()).unwrap());
            let mut aims = [Aim::default(), Aim::default()];
            let [first, second] = &mut aims;
            let sections = [(&one, first), (&other, second)]
                .map(|(solids, aim)| solids.section(0, [1.0, 2.0, 3.0], at * radius, aim));
            let y = 2.0 + 0.5 * at * radius;
            for (a, b) in sections[0].x_at(y).into_iter().zip(sections[1].x_at(y)) {
                prop_assert!((a - b).abs() < 1e-12 * radius.max(1.0), "{a} {b}");
            }
            prop_assert!((one.volume_mm3(0) - other.volume_mm3(0)).abs() < 1e-12 * other.volume_mm3(0));
        }
    }
}
