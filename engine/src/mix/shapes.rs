//! The shapes of the grains of a mix: which law holds for which part and size, and what the mean grain of a size is.
//!
//! A size is drawn from the grading as for spheres and read as a sieve size or as an equivalent diameter; the shape is
//! drawn independently of it. The parts of a mixture have shares of the volume, so that a part is drawn with a
//! probability proportional to its share over the mean volume of its grains. An angular grain is one of the templates
//! of its part, all of which are equally likely.

use std::f64::consts::PI;

use rand_xoshiro::Xoshiro256PlusPlus;

use super::class::{Class, Law};
use super::sphere_volume;
use super::templates::Templates;
use crate::arrays;
use crate::elementary::cbrt;
use crate::request::{GrainKind, Mix, MixPart, PlainShape};
use crate::rng::uniform;
use crate::shape::{
    Ellipsoid, Form, ParallelBody, Polyhedron, RatioSampler, ScaledPolyhedron, SizeMeasure, Solid,
};
use crate::sorting;

/// Grains of a law that are looked at where one that fits is looked for.
const TRIALS: usize = 64;
/// Forms of a law of axis ratios that stand for all of them where a mean is asked for.
const FORMS: usize = 256;

/// Draws the shapes of grains by their size.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeSampler {
    measure: SizeMeasure,
    kind: GrainKind,
    /// Of each part of the mix, from the coarsest down.
    by_part: Vec<Vec<ShapesAbove>>,
}

/// The shapes above a size, up to the next.
#[derive(Clone, Debug, PartialEq)]
struct ShapesAbove {
    above_mm: f64,
    parts: Vec<Part>,
    mean_volume_ratio: f64,
    least_volume_ratio: f64,
}

#[derive(Clone, Debug, PartialEq)]
struct Part {
    /// Share of the grains, by number, that are of this part or of one before it.
    cumulative: f64,
    forms: Forms,
}

/// What the grains of a part are.
#[derive(Clone, Debug, PartialEq)]
enum Forms {
    Spheres,
    Ellipsoids(RatioSampler),
    Polyhedra {
        templates: Templates,
        /// Index of the first among the templates of the mix.
        first: u32,
    },
}

impl Forms {
    fn mean_volume_ratio(&self) -> f64 {
        match self {
            Self::Spheres => 1.0,
            Self::Ellipsoids(ratios) => ratios.mean_volume_ratio(),
            Self::Polyhedra { templates, .. } => templates.mean_volume_ratio(),
        }
    }

    fn least_volume_ratio(&self) -> f64 {
        match self {
            Self::Spheres => 1.0,
            Self::Ellipsoids(ratios) => ratios.least_volume_ratio(),
            Self::Polyhedra { templates, .. } => templates.least_volume_ratio(),
        }
    }
}

/// Mean volumes of grains with a coating, as polynomials of their size: the thickness of a coating is a share of the
/// equivalent diameter and a constant.
pub(super) struct CoatedVolumes {
    /// Of each part of the mix, from the coarsest down: the size above which a law of shapes holds, and the
    /// coefficients of the powers of the size from the zeroth up.
    by_part: Vec<Vec<(f64, [f64; 4])>>,
}

impl CoatedVolumes {
    /// Mean volume of a grain of this part and size with its coating, in mm³.
    pub(super) fn mean_mm3(&self, part: u16, size_mm: f64) -> f64 {
        let by_size = self.by_part.get(usize::from(part));
        let of_size =
            by_size.and_then(|laws| laws.iter().find(|(above_mm, _)| size_mm > *above_mm).or(laws.last()));
        of_size.map_or(0.0, |(_, [a, b, c, d])| a + size_mm * (b + size_mm * (c + size_mm * d)))
    }
}

impl ShapesAbove {
    /// The polynomial of [`CoatedVolumes`] for a coating of `share` equivalent diameters and `constant_mm`.
    fn coated(&self, measure: SizeMeasure, share: f64, constant_mm: f64) -> [f64; 4] {
        let mut bodies = Vec::new();
        let mut before = 0.0;
        for part in &self.parts {
            part.forms.add_bodies(part.cumulative - before, measure, &mut bodies);
            before = part.cumulative;
        }
        let mut sum = [0.0; 4];
        for (weight, equivalent, ParallelBody { volume, surface, mean_curvature }) in bodies {
            // Steiner's formula at the distance `p x + q` of a body of the size x.
            let (p, q, ball) = (share * equivalent, constant_mm, 4.0 / 3.0 * PI);
            let coefficients = [
                ball * q * q * q,
                q * q * (mean_curvature + 3.0 * ball * p),
                q * (surface + 2.0 * p * mean_curvature + 3.0 * ball * p * p),
                volume + p * (surface + p * (mean_curvature + p * ball)),
            ];
            sum = arrays::from_fn(|i| sum[i] + weight * coefficients[i]);
        }
        sum
    }
}

impl Forms {
    /// Adds the bodies of grains of the size 1, each with its share by number and its equivalent diameter; the shares
    /// sum to `share`.
    fn add_bodies(&self, share: f64, measure: SizeMeasure, to: &mut Vec<(f64, f64, ParallelBody)>) {
        match self {
            Self::Spheres => to.push((share, 1.0, ParallelBody::of_ball(1.0))),
            Self::Ellipsoids(ratios) => {
                let mut rng = crate::rng::stream(0, crate::rng::Stream::Shape);
                let number = if ratios.is_constant() { 1 } else { FORMS };
                let drawn: Vec<Ellipsoid> =
                    (0..number).map(|_| measure.ellipsoid(1.0, ratios.draw(&mut rng))).collect();
                // The mean volume is known.
                let mean = drawn.iter().map(Ellipsoid::volume_mm3).sum::<f64>() / number as f64;
                let factor = cbrt(ratios.mean_volume_ratio() * sphere_volume(1.0) / mean);
                to.extend(drawn.iter().map(|grain| {
                    let equivalent = factor * grain.equivalent_diameter_mm();
                    (share / number as f64, equivalent, ParallelBody::from(grain).scaled(factor))
                }));
            }
            Self::Polyhedra { templates, .. } => {
                let share = share / templates.len() as f64;
                to.extend(templates.bodies().iter().zip(&templates.equivalent_over_size).map(
                    |(body, &equivalent)| (share, equivalent, ParallelBody::from(body).scaled(equivalent)),
                ));
            }
        }
    }
}

/// The form of grains in the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeanForm {
    /// Surface over that of the sphere of equal volume.
    pub(crate) surface: f64,
    /// Mean width over its diameter.
    pub(crate) width: f64,
    /// Share of polyhedra,
    pub(crate) angular: f64,
    /// and of parallelepipeds, each less its roundness.
    pub(crate) cuboid: f64,
}

impl MeanForm {
    /// The form of spheres.
    pub(crate) const SPHERE: Self = Self { surface: 1.0, width: 1.0, angular: 0.0, cuboid: 0.0 };
}

impl ShapeSampler {
    /// The shapes of a mix; `None` where all grains are spheres. Laws with a target index meet it for the grains that
    /// the mix places in their range of sizes, `classes` or `list`.
    pub(super) fn new(mix: &Mix, classes: &[Class], list: Option<&[f64]>) -> Option<Self> {
        if !mix.has_shapes() {
            return None;
        }
        let mut first = 0;
        let parts = mix.parts();
        let by_part = parts.iter().enumerate().map(|(number, part)| {
            let of_part: Vec<Class> =
                classes.iter().filter(|class| usize::from(class.part) == number).copied().collect();
            let curve = Curve::new(&of_part, list);
            Self::of_part(part, mix.size, &curve, &mut first)
        });
        Some(Self { measure: mix.size, kind: mix.grain_kind(), by_part: by_part.collect() })
    }

    /// The shapes of a part; `number` counts the templates of all parts.
    fn of_part(
        part: &MixPart<'_>,
        size: SizeMeasure,
        curve: &Curve<'_>,
        number: &mut u32,
    ) -> Vec<ShapesAbove> {
        let Some(shapes) = part.grain_shapes() else {
            return vec![ShapesAbove::new(0.0, std::iter::once((1.0, Forms::Spheres)))];
        };
        let mut by_size = Vec::with_capacity(shapes.len());
        let mut up_to = f64::INFINITY;
        for (above_mm, shape) in shapes {
            let passing = |d: f64| curve.finer(d.clamp(above_mm, up_to));
            let parts = shape.parts().into_iter().map(|(share, shape)| {
                let forms = match (shape, Templates::of_shape(shape, size)) {
                    (_, Some(templates)) => {
                        let first = *number;
                        *number += templates.len() as u32;
                        Forms::Polyhedra { templates, first }
                    }
                    (PlainShape::Ellipsoid { ratios, .. }, _) => {
                        Forms::Ellipsoids(RatioSampler::of_valid(ratios, size, &passing))
                    }
                    _ => Forms::Spheres,
                };
                (share, forms)
            });
            by_size.push(ShapesAbove::new(above_mm, parts));
            up_to = above_mm;
        }
        by_size
    }

    /// What the grains are.
    pub fn kind(&self) -> GrainKind {
        self.kind
    }

    /// The templates of all parts, polyhedra with an equivalent diameter of 1; none but for polyhedra.
    pub fn templates(&self) -> impl Iterator<Item = &Polyhedron> {
        self.by_part.iter().flatten().flat_map(|shapes| &shapes.parts).flat_map(|part| match &part.forms {
            Forms::Polyhedra { templates, .. } => templates.bodies(),
            Forms::Spheres | Forms::Ellipsoids(_) => &[],
        })
    }

    /// The mean form of the grains by number. Aggregates and ranges of sizes with shapes of their own count alike.
    pub(crate) fn mean_form(&self) -> MeanForm {
        let (mut all, mut sum) = (0.0, MeanForm { surface: 0.0, width: 0.0, ..MeanForm::SPHERE });
        for shapes in self.by_part.iter().flatten() {
            let mut before = 0.0;
            for part in &shapes.parts {
                let mut bodies = Vec::new();
                part.forms.add_bodies(part.cumulative - before, self.measure, &mut bodies);
                before = part.cumulative;
                let [angular, cuboid] = if let Forms::Polyhedra { templates, .. } = &part.forms {
                    let of_body = |body: &Polyhedron| {
                        if body.is_parallelepiped() { 1.0 - body.roundness() } else { 0.0 }
                    };
                    let of_bodies = templates.bodies().iter().map(of_body).sum::<f64>();
                    [1.0, of_bodies / templates.len() as f64]
                } else {
                    [0.0; 2]
                };
                for (share, _, body) in bodies {
                    let ball = ParallelBody::of_ball(cbrt(body.volume / sphere_volume(1.0)));
                    all += share;
                    sum.surface += share * body.surface / ball.surface;
                    sum.width += share * body.mean_curvature / ball.mean_curvature;
                    sum.angular += share * angular;
                    sum.cuboid += share * cuboid;
                }
            }
        }
        if all == 0.0 {
            return MeanForm::SPHERE;
        }
        let of = |sum: f64| sum / all;
        MeanForm {
            surface: of(sum.surface),
            width: of(sum.width),
            angular: of(sum.angular),
            cuboid: of(sum.cuboid),
        }
    }

    fn of_size(&self, part: u16, size_mm: f64) -> Option<&ShapesAbove> {
        let by_size = self.by_part.get(usize::from(part))?;
        by_size.iter().find(|shapes| size_mm > shapes.above_mm).or(by_size.last())
    }

    /// Draws the shape of a grain of this part and size. The template of a polyhedron is one of [`Self::templates`].
    pub fn draw(&self, part: u16, size_mm: f64, rng: &mut Xoshiro256PlusPlus) -> Solid {
        let form = match self.of_size(part, size_mm).and_then(|shapes| shapes.draw_forms(rng)) {
            Some(Forms::Polyhedra { templates, first }) => {
                let of_part = ((uniform(rng) * templates.len() as f64) as usize).min(templates.len() - 1);
                let d_mm = size_mm * templates.equivalent_over_size[of_part];
                return Solid::of_template(first + of_part as u32, d_mm);
            }
            Some(Forms::Ellipsoids(ratios)) => ratios.draw(rng),
            Some(Forms::Spheres) | None => Form::SPHERE,
        };
        self.measure.ellipsoid(size_mm, form).into()
    }

    /// Mean volume of a grain of this part and size over that of a sphere of this diameter: `E[(d_eq / D_s)³]` for
    /// sieve sizes.
    pub fn mean_volume_ratio(&self, part: u16, size_mm: f64) -> f64 {
        self.of_size(part, size_mm).map_or(1.0, |shapes| shapes.mean_volume_ratio)
    }

    /// The least value of the same ratio.
    pub(super) fn least_volume_ratio(&self, part: u16, size_mm: f64) -> f64 {
        self.of_size(part, size_mm).map_or(1.0, |shapes| shapes.least_volume_ratio)
    }

    /// Whether one of many ellipsoids of this part and size satisfies a condition, or one of the polyhedra of this size
    /// another.
    pub(crate) fn any(
        &self,
        part: u16,
        size_mm: f64,
        ellipsoid: impl Fn(&Ellipsoid) -> bool,
        polyhedron: impl Fn(&ScaledPolyhedron<'_>) -> bool,
    ) -> bool {
        let parts = self.of_size(part, size_mm).map_or(&[][..], |shapes| &shapes.parts);
        parts.iter().any(|part| match &part.forms {
            Forms::Polyhedra { templates, .. } => {
                templates.bodies().iter().zip(&templates.equivalent_over_size).any(|(template, ratio)| {
                    polyhedron(&ScaledPolyhedron { template, scale_mm: size_mm * ratio })
                })
            }
            Forms::Spheres => ellipsoid(&self.measure.ellipsoid(size_mm, Form::SPHERE)),
            Forms::Ellipsoids(ratios) => {
                let mut rng = crate::rng::stream(0, crate::rng::Stream::Shape);
                let mut draw = || self.measure.ellipsoid(size_mm, ratios.draw(&mut rng));
                (0..TRIALS).any(|_| ellipsoid(&draw()))
            }
        })
    }

    /// Mean volumes of grains with a coating of `share` equivalent diameters and `constant_mm`.
    pub(super) fn coated(&self, share: f64, constant_mm: f64) -> CoatedVolumes {
        let of_law =
            |shapes: &ShapesAbove| (shapes.above_mm, shapes.coated(self.measure, share, constant_mm));
        CoatedVolumes { by_part: self.by_part.iter().map(|laws| laws.iter().map(of_law).collect()).collect() }
    }

    /// What the sizes are.
    pub fn measure(&self) -> SizeMeasure {
        self.measure
    }

    /// The class in parts that have one law of shapes each, from fine to coarse, with its mean volume ratio.
    pub(super) fn split(&self, class: Class) -> Vec<Class> {
        let mut parts = Vec::new();
        let mut rest = class;
        for shapes in self.by_part.get(usize::from(class.part)).into_iter().flatten().rev().skip(1) {
            let edge = shapes.above_mm;
            if edge > rest.low_mm && edge < rest.high_mm {
                let below = Class {
                    high_mm: edge,
                    mass_fraction: rest.mass_fraction * rest.mass_share(rest.low_mm, edge),
                    ..rest
                };
                let above = rest.mass_fraction * rest.mass_share(edge, rest.high_mm);
                rest = Class { low_mm: edge, mass_fraction: above, ..rest };
                parts.push(below);
            }
        }
        parts.push(rest);
        for part in &mut parts {
            part.volume_ratio = self.mean_volume_ratio(part.part, part.high_mm);
        }
        parts
    }
}

impl ShapesAbove {
    fn new(above_mm: f64, parts: impl Iterator<Item = (f64, Forms)>) -> Self {
        let (mut shares, mut numbers, mut least) = (0.0, 0.0, f64::INFINITY);
        let mut parts: Vec<Part> = parts
            .map(|(share, forms)| {
                least = least.min(forms.least_volume_ratio());
                shares += share;
                numbers += share / forms.mean_volume_ratio();
                Part { cumulative: numbers, forms }
            })
            .collect();
        for part in &mut parts {
            part.cumulative /= numbers;
        }
        Self { above_mm, parts, mean_volume_ratio: shares / numbers, least_volume_ratio: least }
    }

    /// Draws the part that a grain belongs to.
    fn draw_forms(&self, rng: &mut Xoshiro256PlusPlus) -> Option<&Forms> {
        let part = match self.parts.as_slice() {
            [part] => Some(part),
            parts => {
                let u = uniform(rng);
                parts.iter().find(|part| u < part.cumulative).or(parts.last())
            }
        };
        part.map(|part| &part.forms)
    }
}

/// The mass finer than a diameter, in any unit.
enum Curve<'a> {
    /// Classes from fine to coarse, with the mass of those before each.
    Classes(&'a [Class], Vec<f64>),
    /// Diameters from fine to coarse, with the volume up to each.
    List(Vec<f64>, Vec<f64>),
}

impl<'a> Curve<'a> {
    fn new(classes: &'a [Class], list: Option<&[f64]>) -> Self {
        let summed = |sum: &mut f64, more: f64| {
            *sum += more;
            Some(*sum)
        };
        match list {
            Some(list) => {
                let mut sizes = list.to_vec();
                sorting::ascending(&mut sizes);
                let volumes = sizes.iter().map(|&d| sphere_volume(d)).scan(0.0, summed).collect();
                Self::List(sizes, volumes)
            }
            None => Self::Classes(
                classes,
                classes.iter().map(|class| class.mass_fraction).scan(0.0, summed).collect(),
            ),
        }
    }

    fn finer(&self, d: f64) -> f64 {
        match self {
            Self::List(sizes, sums) => match sizes.partition_point(|&size| size <= d) {
                0 => 0.0,
                n => sums[n - 1],
            },
            Self::Classes(classes, sums) => {
                let n = classes.partition_point(|class| class.high_mm <= d);
                let before = if n == 0 { 0.0 } else { sums[n - 1] };
                match classes.get(n) {
                    Some(class) if class.law != Law::Single && class.low_mm < d => {
                        before + class.mass_fraction * class.mass_share(class.low_mm, d)
                    }
                    _ => before,
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "shapes_tests.rs"]
mod tests;
