//! Sampling of diameters, class by class from the coarsest down (Titscher and Unger 2015, Algorithm 1), and of shapes.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::{AngularGrain, GradedMix, sphere_volume};
use crate::error::{PackError, PlanError};
use crate::memory::{OutOfMemory, collected, copied, make_room, reserved};
use crate::request::{FieldError, GrainKind};
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Form, Polyhedron, SizeMeasure};

/// Draws between two looks at whether to stop: about a millisecond.
const DRAWS_PER_LOOK: usize = 1 << 14;

/// Diameters that were drawn, from the largest down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Diameters {
    /// Diameters in mm.
    pub d_mm: Vec<f64>,
    /// The aggregate that each belongs to; empty where the mix names none.
    pub parts: Vec<u16>,
}

/// Draws the diameters of one packing of spheres.
///
/// In each class grains are drawn until its volume is reached; the overshoot of the last grain is
/// taken from the next class, so that the total of every part misses by less than one of its smallest grains.
///
/// # Errors
/// [`PackError::Stopped`] when `should_stop` said so, [`PackError::OutOfMemory`], [`PackError::Plan`] for a mix whose
/// grains are no spheres.
pub fn sample(
    mix: &GradedMix,
    rng: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<Diameters, PackError> {
    if mix.shapes.is_some() {
        return Err(of_other_shape("grains that are no spheres cannot be drawn as spheres"));
    }
    if let Some(list) = &mix.list {
        return Ok(Diameters { d_mm: copied(list)?, parts: Vec::new() });
    }
    let mut diameters = reserved((mix.expected_grains() * 1.01) as usize + DRAWS_PER_LOOK)?;
    let mut ends = Vec::new();
    for part in 0..mix.parts {
        let mut overshoot = 0.0;
        for class in mix.classes_of(part).rev() {
            let target = mix.class_volume_mm3(class) - overshoot;
            let mut volume = 0.0;
            while volume < target {
                let d = class.diameter(uniform(rng));
                volume += sphere_volume(d);
                diameters.push(d);
                if diameters.len().is_multiple_of(DRAWS_PER_LOOK) {
                    if should_stop() {
                        return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
                    }
                    make_room(&mut diameters, DRAWS_PER_LOOK)?;
                }
            }
            overshoot = volume - target;
        }
        ends.push(diameters.len());
    }
    if !mix.has_aggregates {
        diameters.sort_unstable_by(|a, b| b.total_cmp(a));
        return Ok(Diameters { d_mm: diameters, parts: Vec::new() });
    }
    let part_of = |row: usize| ends.partition_point(|&end| end <= row) as u16;
    let rows = diameters.iter().enumerate().map(|(row, &d)| (d, part_of(row)));
    let mut rows: Vec<(f64, u16)> = collected(rows)?;
    rows.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    Ok(Diameters {
        d_mm: collected(rows.iter().map(|row| row.0))?,
        parts: collected(rows.iter().map(|row| row.1))?,
    })
}

/// Grains that were drawn, by equivalent diameter from the largest down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapedGrains {
    /// The bodies.
    pub ellipsoids: Vec<Ellipsoid>,
    /// The size that each was drawn with, in mm: its sieve size or its equivalent diameter, whichever the mix names, to
    /// a few units in the last place. Its size class by [`class_of`](super::sieve::class_of) is the one it was drawn
    /// for.
    pub sizes_mm: Vec<f64>,
    /// The aggregate that each belongs to; empty where the mix names none.
    pub parts: Vec<u16>,
}

/// Angular grains that were drawn, by equivalent diameter from the largest down: what they are, by the columns of
/// [`Polyhedra`](crate::packing::Polyhedra).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AngularGrains {
    /// The templates of the mix, with an equivalent diameter of 1; those too that no grain was drawn with.
    pub templates: Vec<Polyhedron>,
    /// The template of each grain.
    pub template: Vec<u32>,
    /// Equivalent diameters in mm.
    pub d_mm: Vec<f64>,
    /// The size that each was drawn with, in mm: its sieve size or its equivalent diameter, whichever the mix names.
    pub sizes_mm: Vec<f64>,
    /// The aggregate that each belongs to; empty where the mix names none.
    pub parts: Vec<u16>,
}

/// A grain with what it is sorted by.
struct Drawn<G> {
    equivalent_mm: f64,
    size_mm: f64,
    grain: G,
    part: u16,
    order: u32,
}

/// The aggregate of each grain; empty where the mix names none.
fn parts_of<G>(mix: &GradedMix, grains: &[Drawn<G>]) -> Result<Vec<u16>, OutOfMemory> {
    if mix.has_aggregates { collected(grains.iter().map(|grain| grain.part)) } else { Ok(Vec::new()) }
}

fn of_other_shape(detail: &str) -> PackError {
    PackError::Plan(PlanError::Invalid(vec![FieldError::new("/mix", detail)]))
}

/// Draws the grains of one packing; spheres too, where the mix has no shapes.
///
/// Sizes come from `sizes` as for spheres, shapes from `forms`. In each class grains are drawn until their bodies have
/// its volume; the overshoot of the last grain is taken from the next class. Of an explicit list every size has a
/// grain.
///
/// # Errors
/// [`PackError::Stopped`] when `should_stop` said so, [`PackError::OutOfMemory`], [`PackError::Plan`] for polyhedra.
pub fn sample_shaped(
    mix: &GradedMix,
    sizes: &mut Xoshiro256PlusPlus,
    forms: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<ShapedGrains, PackError> {
    let draw = |part: u16, size_mm: f64| {
        let ellipsoid = match &mix.shapes {
            Some(shapes) => shapes.draw(part, size_mm, forms),
            None => Some(SizeMeasure::Equivalent.ellipsoid(size_mm, Form::SPHERE)),
        };
        let ellipsoid = ellipsoid.ok_or_else(|| of_other_shape("polyhedra cannot be drawn as ellipsoids"))?;
        Ok((ellipsoid, ellipsoid.equivalent_diameter_mm(), ellipsoid.volume_mm3()))
    };
    let grains = drawn(mix, sizes, draw, should_stop)?;
    Ok(ShapedGrains {
        ellipsoids: collected(grains.iter().map(|grain| grain.grain))?,
        sizes_mm: collected(grains.iter().map(|grain| grain.size_mm))?,
        parts: parts_of(mix, &grains)?,
    })
}

/// Draws the grains of one packing of polyhedra, as [`sample_shaped`] does those of ellipsoids. The templates do not
/// depend on the streams.
///
/// # Errors
/// As [`sample_shaped`]; [`PackError::Plan`] for a mix of other grains.
pub fn sample_angular(
    mix: &GradedMix,
    sizes: &mut Xoshiro256PlusPlus,
    forms: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<AngularGrains, PackError> {
    let refused = || of_other_shape("spheres and ellipsoids cannot be drawn as polyhedra");
    let shapes =
        mix.shapes.as_ref().filter(|shapes| shapes.kind() == GrainKind::Polyhedra).ok_or_else(refused)?;
    let draw = |part: u16, size_mm: f64| {
        let AngularGrain { template, equivalent_mm } =
            shapes.draw_angular(part, size_mm, forms).ok_or_else(refused)?;
        Ok((template, equivalent_mm, sphere_volume(equivalent_mm)))
    };
    let grains = drawn(mix, sizes, draw, should_stop)?;
    Ok(AngularGrains {
        templates: shapes.templates().cloned().collect(),
        template: collected(grains.iter().map(|grain| grain.grain))?,
        d_mm: collected(grains.iter().map(|grain| grain.equivalent_mm))?,
        sizes_mm: collected(grains.iter().map(|grain| grain.size_mm))?,
        parts: parts_of(mix, &grains)?,
    })
}

/// Draws grains class by class, each with its equivalent diameter and its volume, and sorts them.
fn drawn<G>(
    mix: &GradedMix,
    sizes: &mut Xoshiro256PlusPlus,
    mut of_size: impl FnMut(u16, f64) -> Result<(G, f64, f64), PackError>,
    should_stop: &dyn Fn() -> bool,
) -> Result<Vec<Drawn<G>>, PackError> {
    let mut grains: Vec<Drawn<G>> = reserved((mix.expected_grains() * 1.01) as usize + DRAWS_PER_LOOK)?;
    let mut draw = |part: u16, size_mm: f64| -> Result<f64, PackError> {
        let (grain, equivalent_mm, volume_mm3) = of_size(part, size_mm)?;
        let order = grains.len() as u32;
        grains.push(Drawn { equivalent_mm, size_mm, grain, part, order });
        if grains.len().is_multiple_of(DRAWS_PER_LOOK) {
            if should_stop() {
                return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
            }
            make_room(&mut grains, DRAWS_PER_LOOK)?;
        }
        Ok(volume_mm3)
    };
    for &size_mm in mix.list.iter().flatten() {
        draw(0, size_mm)?;
    }
    for part in 0..mix.parts {
        let mut overshoot = 0.0;
        for class in mix.classes_of(part).rev() {
            let target = mix.class_volume_mm3(class) - overshoot;
            let mut volume = 0.0;
            while volume < target {
                volume += draw(part, class.diameter(uniform(sizes)))?;
            }
            overshoot = volume - target;
        }
    }
    grains.sort_unstable_by(|p, q| q.equivalent_mm.total_cmp(&p.equivalent_mm).then(p.order.cmp(&q.order)));
    Ok(grains)
}
