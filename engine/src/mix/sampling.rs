//! Sampling of diameters, class by class from the coarsest down (Titscher and Unger 2015, Algorithm 1), and of shapes.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::{GradedMix, ShapeSampler, sphere_volume};
use crate::error::{PackError, PlanError};
use crate::memory::{collected, copied, make_room, reserved};
use crate::packing::Solids;
use crate::request::FieldError;
use crate::rng::uniform;
use crate::shape::{Form, SizeMeasure, Solid};
use crate::sorting;

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
/// [`PackError::Stopped`] when `should_stop` said so, [`PackError::OutOfMemory`], [`PackError::Plan`] for a mix of
/// shaped grains.
pub fn sample(
    mix: &GradedMix,
    rng: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<Diameters, PackError> {
    if mix.shapes.is_some() {
        let detail = "shaped grains cannot be drawn as spheres";
        return Err(PackError::Plan(PlanError::Invalid(vec![FieldError::new("/mix", detail)])));
    }
    if let Some(list) = &mix.list {
        return Ok(Diameters { d_mm: copied(list)?, parts: Vec::new() });
    }
    let mut diameters = reserved((mix.expected_grains() * 1.01) as usize + DRAWS_PER_LOOK)?;
    let mut ends = Vec::new();
    for part in 0..mix.parts {
        draw_part(mix, part, rng, &mut |d| {
            diameters.push(d);
            if diameters.len().is_multiple_of(DRAWS_PER_LOOK) {
                if should_stop() {
                    return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
                }
                make_room(&mut diameters, DRAWS_PER_LOOK)?;
            }
            Ok(sphere_volume(d))
        })?;
        ends.push(diameters.len());
    }
    if !mix.has_aggregates {
        sorting::descending(&mut diameters);
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

/// Draws the sizes of a part of a mix, class by class from the coarsest down; `draw` takes each and answers with the
/// volume of its grain in mm³.
///
/// In each class grains are drawn until its volume is reached, and the overshoot of the last one is taken from the next
/// class. Where the mix counts its grains, a class has its number of them, one from each of as many equal parts of its
/// number distribution.
fn draw_part(
    mix: &GradedMix,
    part: u16,
    rng: &mut Xoshiro256PlusPlus,
    draw: &mut impl FnMut(f64) -> Result<f64, PackError>,
) -> Result<(), PackError> {
    let mut overshoot = 0.0;
    for (class, number) in mix.numbered_classes_of(part).rev() {
        if let Some(number) = number {
            for of_class in 0..number {
                draw(class.diameter((of_class as f64 + uniform(rng)) / number as f64))?;
            }
            continue;
        }
        let target = mix.class_volume_mm3(class) - overshoot;
        let mut volume = 0.0;
        while volume < target {
            volume += draw(class.diameter(uniform(rng)))?;
        }
        overshoot = volume - target;
    }
    Ok(())
}

/// Grains that were drawn, by equivalent diameter from the largest down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapedGrains {
    /// The bodies, without poses. The templates are those of the mix, those too that no grain was drawn with.
    pub grains: Solids,
    /// The size that each was drawn with, in mm: its sieve size or its equivalent diameter, whichever the mix names, to
    /// a few units in the last place. Its size class by [`class_of`](super::sieve::class_of) is the one it was drawn
    /// for.
    pub sizes_mm: Vec<f64>,
}

/// A grain with what it is sorted by.
struct Drawn {
    equivalent_mm: f64,
    size_mm: f64,
    grain: Solid,
    part: u16,
    order: u32,
}

/// Draws the grains of one packing; spheres too, where the mix has no shapes.
///
/// Sizes come from `sizes` as for spheres, shapes from `forms`. In each class grains are drawn until their bodies have
/// its volume; the overshoot of the last grain is taken from the next class. Of an explicit list every size has a
/// grain.
///
/// # Errors
/// [`PackError::Stopped`] when `should_stop` said so, [`PackError::OutOfMemory`].
pub fn sample_shaped(
    mix: &GradedMix,
    sizes: &mut Xoshiro256PlusPlus,
    forms: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<ShapedGrains, PackError> {
    let mut grains: Vec<Drawn> = reserved((mix.expected_grains() * 1.01) as usize + DRAWS_PER_LOOK)?;
    let mut draw = |part: u16, size_mm: f64| -> Result<f64, PackError> {
        let grain = match &mix.shapes {
            Some(shapes) => shapes.draw(part, size_mm, forms),
            None => SizeMeasure::Equivalent.ellipsoid(size_mm, Form::SPHERE).into(),
        };
        let equivalent_mm = grain.d_mm();
        let order = grains.len() as u32;
        grains.push(Drawn { equivalent_mm, size_mm, grain, part, order });
        if grains.len().is_multiple_of(DRAWS_PER_LOOK) {
            if should_stop() {
                return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
            }
            make_room(&mut grains, DRAWS_PER_LOOK)?;
        }
        Ok(grain.volume_mm3())
    };
    for &size_mm in mix.list.iter().flatten() {
        draw(0, size_mm)?;
    }
    for part in 0..mix.parts {
        draw_part(mix, part, sizes, &mut |size_mm| draw(part, size_mm))?;
    }
    grains.sort_unstable_by(|p, q| q.equivalent_mm.total_cmp(&p.equivalent_mm).then(p.order.cmp(&q.order)));
    Ok(ShapedGrains {
        grains: Solids {
            templates: mix.shapes.iter().flat_map(ShapeSampler::templates).cloned().collect(),
            shapes: collected(grains.iter().map(|grain| grain.grain))?,
            poses: Vec::new(),
            aggregate: if mix.has_aggregates {
                collected(grains.iter().map(|grain| grain.part))?
            } else {
                Vec::new()
            },
        },
        sizes_mm: collected(grains.iter().map(|grain| grain.size_mm))?,
    })
}
