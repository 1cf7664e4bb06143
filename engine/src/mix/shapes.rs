//! The shapes of the grains of a mix: which law holds for which size, and what the mean grain of a size is.
//!
//! A size is drawn from the grading as for spheres and read as a sieve size or as an equivalent diameter; the shape is
//! drawn independently of it. The parts of a mixture have shares of the volume, so that a part is drawn with a
//! probability proportional to its share over the mean volume of its grains.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::class::{Class, Law};
use super::sphere_volume;
use crate::request::Mix;
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Form, RatioSampler, SizeMeasure};

/// Grains of a law that are looked at where one that fits is looked for.
const TRIALS: usize = 64;

/// Draws the shapes of grains by their size.
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeSampler {
    measure: SizeMeasure,
    /// From the coarsest down.
    by_size: Vec<ShapesAbove>,
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
    /// The law; none for spheres.
    ratios: Option<RatioSampler>,
}

impl ShapeSampler {
    /// The shapes of a mix; `None` where all grains are spheres. Laws with a target index meet it for the grains that
    /// the mix places in their range of sizes, `classes` or `list`.
    pub(super) fn new(mix: &Mix, classes: &[Class], list: Option<&[f64]>) -> Option<Self> {
        let shapes = mix.grain_shapes()?;
        let curve = Curve::new(classes, list);
        let mut by_size = Vec::with_capacity(shapes.len());
        let mut up_to = f64::INFINITY;
        for (above_mm, shape) in shapes {
            let passing = |d: f64| curve.finer(d.clamp(above_mm, up_to));
            let parts = shape.parts().into_iter().map(|(share, ratios)| {
                (share, ratios.map(|ratios| RatioSampler::of_valid(ratios, mix.size, &passing)))
            });
            by_size.push(ShapesAbove::new(above_mm, parts));
            up_to = above_mm;
        }
        Some(Self { measure: mix.size, by_size })
    }

    fn of_size(&self, size_mm: f64) -> Option<&ShapesAbove> {
        self.by_size.iter().find(|shapes| size_mm > shapes.above_mm).or(self.by_size.last())
    }

    /// Draws the shape of a grain of this size.
    pub fn draw(&self, size_mm: f64, rng: &mut Xoshiro256PlusPlus) -> Ellipsoid {
        let form = self.of_size(size_mm).map_or(Form::SPHERE, |shapes| shapes.draw(rng));
        self.measure.ellipsoid(size_mm, form)
    }

    /// Mean volume of a grain of this size over that of a sphere of this diameter: `E[(d_eq / D_s)³]` for sieve sizes.
    pub fn mean_volume_ratio(&self, size_mm: f64) -> f64 {
        self.of_size(size_mm).map_or(1.0, |shapes| shapes.mean_volume_ratio)
    }

    /// The least value of the same ratio.
    pub(super) fn least_volume_ratio(&self, size_mm: f64) -> f64 {
        self.of_size(size_mm).map_or(1.0, |shapes| shapes.least_volume_ratio)
    }

    /// Whether one of many grains of this size satisfies a condition.
    pub(crate) fn any(&self, size_mm: f64, condition: impl Fn(&Ellipsoid) -> bool) -> bool {
        let mut rng = crate::rng::stream(0, crate::rng::Stream::Shape);
        (0..TRIALS).any(|_| condition(&self.draw(size_mm, &mut rng)))
    }

    /// What the sizes are.
    pub fn measure(&self) -> SizeMeasure {
        self.measure
    }

    /// The class in parts that have one law of shapes each, from fine to coarse, with its mean volume ratio.
    pub(super) fn split(&self, class: Class) -> Vec<Class> {
        let mut parts = Vec::new();
        let mut rest = class;
        for shapes in self.by_size.iter().rev().skip(1) {
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
            part.volume_ratio = self.mean_volume_ratio(part.high_mm);
        }
        parts
    }
}

impl ShapesAbove {
    fn new(above_mm: f64, parts: impl Iterator<Item = (f64, Option<RatioSampler>)>) -> Self {
        let (mut shares, mut numbers, mut least) = (0.0, 0.0, f64::INFINITY);
        let mut parts: Vec<Part> = parts
            .map(|(share, ratios)| {
                let ratio = ratios.as_ref().map_or(1.0, RatioSampler::mean_volume_ratio);
                least = least.min(ratios.as_ref().map_or(1.0, RatioSampler::least_volume_ratio));
                shares += share;
                numbers += share / ratio;
                Part { cumulative: numbers, ratios }
            })
            .collect();
        for part in &mut parts {
            part.cumulative /= numbers;
        }
        Self { above_mm, parts, mean_volume_ratio: shares / numbers, least_volume_ratio: least }
    }

    fn draw(&self, rng: &mut Xoshiro256PlusPlus) -> Form {
        let part = match self.parts.as_slice() {
            [part] => Some(part),
            parts => {
                let u = uniform(rng);
                parts.iter().find(|part| u < part.cumulative).or(parts.last())
            }
        };
        part.and_then(|part| part.ratios.as_ref()).map_or(Form::SPHERE, |ratios| ratios.draw(rng))
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
                sizes.sort_unstable_by(f64::total_cmp);
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
