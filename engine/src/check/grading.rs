//! Whether the grains of a packing are those of its mix.
//!
//! With `F` the share of mass that passes a sieve, the grains between two sieves `a < b` shall have the volume
//! `(F(b) - F(a)) phi V`, where `phi` is the volume fraction of all aggregate and `V` the volume of the specimen. Sizes
//! are sampled class by class from the coarsest down, and the overshoot of the last grain is carried on, so that the
//! volume above any sieve exceeds what the curve asks for by less than the last grain sampled. That is checked at
//! every sieve; an explicit list must come back as it was.
//!
//! The size of a grain that is not a sphere is that of its sieve, or the diameter of the sphere of its volume; its
//! volume is its own in either case, so that the curve holds by mass. Such a size is known within an error. Grains so
//! close to a sieve that they may lie on either side of it count on both: the volume above the sieve lies between that
//! with and that without them, and one of the two bounds must do.
//!
//! Of a run that was ended early all sizes may be scaled by one factor, and the finest grains may be missing. Sizes are
//! then judged at the scale at which they were sampled, and without the finest grains the volume above a sieve must not
//! exceed what the curve asks for by more than the last grain; that it does not fall short of it is not asked. What is
//! reported are the sizes that the grains have, beside the curve of the request.
//!
//! Where a mix has several aggregates, the grains of each are judged by its own curve and its share of the volume.
//!
//! `F` and the classes are computed here from the grading itself, not taken from the sampler
//! ([`crate::mix::sampling`]); the numbers of a curve or a law ([`Form`]) are data that both read.

use super::asked::{Asked, asked, class, class_of, share_between, volume_mm3};
use super::region::SpecimenRegion;
use super::{Extent, counted};
use crate::packing::{AggregateReport, ClassReport};
use crate::request::{Mix, MixPart, PackingRequest};
use crate::sorting;

/// Sums of millions of volumes agree to this.
const ROUNDING: f64 = 1.0e-9;
/// Largest relative error of a size that was computed from the dimensions of a body in closed form.
pub(super) const SIZE_ERROR: f64 = 1.0e-12;

/// Sizes and volumes of the grains of a packing.
#[derive(Clone, Copy)]
pub(super) struct Sizes<'a> {
    /// Number of the grains.
    pub(super) grains: usize,
    /// Size in mm and volume in mm³ of each.
    pub(super) of: &'a dyn Fn(usize) -> (f64, f64),
    /// Largest relative error of the size of each; 0 of a size that was drawn. Others are computed from the dimensions
    /// of a body, which were computed from the size that was drawn.
    pub(super) error: &'a dyn Fn(usize) -> f64,
    /// Whether the volume follows from the size, as that of spheres does.
    pub(super) give_volumes: bool,
}

impl Sizes<'_> {
    fn rows(&self) -> Vec<(f64, f64)> {
        (0..self.grains).map(self.of).collect()
    }
}

/// What was found of the grading.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Graded {
    /// Size classes from fine to coarse.
    pub(super) classes: Vec<ClassReport>,
    /// The largest miss of a class of a part of the mix, as a share of the volume of all grains.
    pub(super) max_class_mass_error: f64,
    /// The aggregates; none where the mix names none.
    pub(super) aggregates: Vec<AggregateReport>,
}

/// Judges the grains of a packing; `part` is the aggregate of each, empty where the mix names none.
pub(super) fn check(
    sizes: Sizes<'_>,
    part: &[u16],
    request: &PackingRequest,
    extent: Extent,
) -> Result<Graded, String> {
    if extent.size_scale == 1.0 {
        return check_drawn(sizes, part, request, extent.has_all_grains);
    }
    // As they were drawn; a factor on a size and back leaves an error of rounding.
    let (scale, cube) = (extent.size_scale, extent.size_scale.powi(3));
    let of = |row: usize| {
        let (size_mm, volume_mm3) = (sizes.of)(row);
        (size_mm / scale, volume_mm3 / cube)
    };
    let error = |row: usize| (sizes.error)(row).max(SIZE_ERROR);
    let drawn = Sizes { of: &of, error: &error, give_volumes: false, ..sizes };
    let checked = check_drawn(drawn, part, request, extent.has_all_grains)?;
    Ok(as_they_are(checked, sizes, part))
}

/// The classes and aggregates with the grains at the sizes that they have. Grains that are finer than all classes now
/// count in the finest.
fn as_they_are(mut graded: Graded, sizes: Sizes<'_>, part: &[u16]) -> Graded {
    let mut all = vec![&mut graded.classes];
    let by_aggregate = !graded.aggregates.is_empty();
    all.extend(graded.aggregates.iter_mut().map(|aggregate| &mut aggregate.classes));
    for class in all.iter_mut().flat_map(|classes| classes.iter_mut()) {
        (class.grains, class.volume_mm3) = (0, 0.0);
    }
    for row in 0..sizes.grains {
        let (d, volume_mm3) = (sizes.of)(row);
        let d = d * (1.0 - (sizes.error)(row));
        let of_aggregate = part.get(row).filter(|_| by_aggregate).map(|&number| 1 + usize::from(number));
        for number in std::iter::once(0).chain(of_aggregate) {
            if let Some(index) = class_of(all[number], d) {
                all[number][index].grains += 1;
                all[number][index].volume_mm3 += volume_mm3;
            }
        }
    }
    let miss = |class: &ClassReport| (class.volume_mm3 - class.target_volume_mm3).abs();
    let volume = |classes: &[ClassReport]| classes.iter().fold(0.0, |sum, class| sum + class.volume_mm3);
    let all_mm3 = volume(&graded.classes);
    for aggregate in &mut graded.aggregates {
        let placed_mm3 = volume(&aggregate.classes);
        aggregate.mass_kg = aggregate.mass_kg.map(|mass| mass * share_of(placed_mm3, aggregate.volume_mm3));
        aggregate.volume_mm3 = placed_mm3;
    }
    let parts = graded.aggregates.iter().map(|aggregate| &aggregate.classes);
    let worst_mm3 = if by_aggregate {
        parts.flatten().map(miss).fold(0.0, f64::max)
    } else {
        graded.classes.iter().map(miss).fold(0.0, f64::max)
    };
    graded.max_class_mass_error = share_of(worst_mm3, all_mm3);
    graded
}

/// Judges grains at the sizes that were drawn.
fn check_drawn(
    sizes: Sizes<'_>,
    part: &[u16],
    request: &PackingRequest,
    has_all: bool,
) -> Result<Graded, String> {
    let mix = &request.mix;
    let parts = mix.parts();
    let specimen_mm3 = SpecimenRegion::new(&request.specimen).volume_mm3;
    let fraction = match mix.count {
        None => mix.requested_fraction().unwrap_or(0.0),
        Some(count) => counted::all_mm3(&sizes.rows(), mix, count, has_all)? / specimen_mm3,
    };
    let asked = |part: &MixPart<'_>| asked(mix, part, fraction, specimen_mm3);
    if mix.aggregates.is_empty() {
        if !part.is_empty() {
            return Err("the grains belong to aggregates, and the mix names none".into());
        }
        let whole = parts.first().ok_or("the mix has no grading")?;
        let rows: Vec<usize> = (0..sizes.grains).collect();
        let checked = check_part(sizes, &rows, asked(whole), mix.count.is_some(), has_all)?;
        return Ok(Graded {
            max_class_mass_error: share_of(checked.worst_miss_mm3, checked.placed_mm3()),
            classes: checked.classes,
            aggregates: Vec::new(),
        });
    }
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); parts.len()];
    if part.len() != sizes.grains {
        return Err(format!("{} of {} grains belong to an aggregate", part.len(), sizes.grains));
    }
    for (row, &number) in part.iter().enumerate() {
        let Some(rows) = rows.get_mut(usize::from(number)) else {
            return Err(format!("grain {row} belongs to the aggregate {number} of {}", parts.len()));
        };
        rows.push(row);
    }
    let mut aggregates = Vec::with_capacity(parts.len());
    let (mut worst_mm3, mut all_mm3) = (0.0_f64, 0.0);
    for (number, (part, aggregate)) in parts.iter().zip(&mix.aggregates).enumerate() {
        let found = check_part(sizes, &rows[number], asked(part), mix.count.is_some(), has_all)
            .map_err(|fault| format!("aggregate {number}: {fault}"))?;
        worst_mm3 = worst_mm3.max(found.worst_miss_mm3);
        all_mm3 += found.placed_mm3();
        aggregates.push(AggregateReport {
            name: aggregate.name.clone(),
            share: part.share,
            grains: rows[number].len() as u64,
            // From 0, for a sum of nothing is -0.
            target_volume_mm3: found.classes.iter().fold(0.0, |sum, class| sum + class.target_volume_mm3),
            volume_mm3: found.placed_mm3(),
            mass_kg: aggregate.density_kg_m3.map(|density| density * 1.0e-9 * found.placed_mm3()),
            classes: found.classes,
        });
    }
    Ok(Graded {
        classes: divided(sizes, mix, &asked),
        max_class_mass_error: share_of(worst_mm3, all_mm3),
        aggregates,
    })
}

fn share_of(part: f64, all: f64) -> f64 {
    if all > 0.0 { part / all } else { 0.0 }
}

/// The classes of a part of a mix with its grains.
struct CheckedPart {
    classes: Vec<ClassReport>,
    /// The largest miss of a class.
    worst_miss_mm3: f64,
}

impl CheckedPart {
    /// Volume of the grains.
    fn placed_mm3(&self) -> f64 {
        self.classes.iter().map(|class| class.volume_mm3).fold(0.0, |sum, volume| sum + volume)
    }
}

/// Judges the grains of one part of a mix, by the classes that it asks for and the diameters that it lists.
fn check_part(
    sizes: Sizes<'_>,
    rows: &[usize],
    (mut classes, list): Asked,
    is_counted: bool,
    has_all: bool,
) -> Result<CheckedPart, String> {
    let (d_min, d_max) = bounds_mm(&classes);
    // Largest grain that a class may hold: the overshoot of the last one.
    let most_mm3 = |class: &ClassReport| if sizes.give_volumes { volume_mm3(class.d_max_mm) } else { 0.0 };
    let mut largest: Vec<f64> = classes.iter().map(most_mm3).collect();
    // Volume of the grains of finer classes that may belong to this one or to a coarser one.
    let mut doubtful_mm3 = vec![0.0; classes.len()];
    for &row in rows {
        let ((d, volume_mm3), error) = ((sizes.of)(row), (sizes.error)(row));
        if d < d_min * (1.0 - error) || d > d_max * (1.0 + error) {
            return Err(format!("grain {row} of {d} mm lies outside {d_min}..{d_max} mm"));
        }
        if let Some(index) = class_of(&classes, d * (1.0 - error)) {
            let class = &mut classes[index];
            class.grains += 1;
            class.volume_mm3 += volume_mm3;
            let upper = class_of(&classes, d * (1.0 + error)).unwrap_or(index);
            for doubtful_mm3 in &mut doubtful_mm3[index + 1..=upper] {
                *doubtful_mm3 += volume_mm3;
            }
            for largest in &mut largest[index..=upper] {
                *largest = largest.max(volume_mm3);
            }
        }
    }
    let all: f64 = classes.iter().map(|c| c.volume_mm3).sum();
    if let Some(list) = &list {
        check_list(sizes, list, has_all)?;
        if !sizes.give_volumes {
            // A list names sizes; their volumes are those of the bodies.
            for class in &mut classes {
                class.target_volume_mm3 = class.volume_mm3;
            }
        }
    } else if is_counted {
        let rows = rows.iter().map(|&row| (sizes.of)(row)).collect();
        counted::check(rows, !sizes.give_volumes, &classes, &largest, has_all)?;
    } else {
        let rounding = ROUNDING * all.max(1.0);
        check_cumulative(&classes, &largest, &doubtful_mm3, rounding, has_all)?;
    }
    let miss = |c: &ClassReport| (c.volume_mm3 - c.target_volume_mm3).abs();
    let worst_miss_mm3 = classes.iter().map(miss).fold(0.0, f64::max);
    Ok(CheckedPart { classes, worst_miss_mm3 })
}

/// Classes between the sieves of all aggregates, with what all of them ask for and all grains. A grain within the error
/// of its size of a sieve counts below it.
fn divided(sizes: Sizes<'_>, mix: &Mix, asked: &dyn Fn(&MixPart<'_>) -> Asked) -> Vec<ClassReport> {
    let parts = mix.parts();
    let of_parts: Vec<Vec<ClassReport>> = parts.iter().map(|part| asked(part).0).collect();
    let mut edges: Vec<f64> = of_parts.iter().flatten().flat_map(|c| [c.d_min_mm, c.d_max_mm]).collect();
    sorting::ascending(&mut edges);
    edges.dedup();
    let Some(&finest) = edges.first() else { return Vec::new() };
    // Equal grains that are finer than all others have a class of their own.
    if of_parts.iter().flatten().any(|class| class.d_max_mm == finest) {
        edges.insert(0, finest);
    }
    let target_mm3 = |low: f64, high: f64| -> f64 {
        let mut sum = 0.0;
        for (part, classes) in parts.iter().zip(&of_parts) {
            for class in classes {
                if class.d_min_mm == class.d_max_mm {
                    let is_inside = class.d_max_mm == high && (low < high || class.d_max_mm == low);
                    sum += if is_inside { class.target_volume_mm3 } else { 0.0 };
                } else if class.d_min_mm <= low && high <= class.d_max_mm && low < high {
                    sum += class.target_volume_mm3 * share_between(part.grading, class, low, high);
                }
            }
        }
        sum
    };
    let pairs = edges.windows(2).map(|pair| class((pair[0], pair[1]), target_mm3(pair[0], pair[1])));
    let mut classes: Vec<ClassReport> = pairs.filter(|class| class.target_volume_mm3 > 0.0).collect();
    for row in 0..sizes.grains {
        let (d, volume_mm3) = (sizes.of)(row);
        if let Some(index) = class_of(&classes, d * (1.0 - (sizes.error)(row))) {
            classes[index].grains += 1;
            classes[index].volume_mm3 += volume_mm3;
        }
    }
    classes
}

/// Smallest and largest diameter that the classes allow.
fn bounds_mm(classes: &[ClassReport]) -> (f64, f64) {
    (classes.first().map_or(0.0, |c| c.d_min_mm), classes.last().map_or(0.0, |c| c.d_max_mm))
}

fn check_list(sizes: Sizes<'_>, list: &[f64], has_all: bool) -> Result<(), String> {
    let mut found: Vec<(f64, f64)> =
        (0..sizes.grains).map(|row| ((sizes.of)(row).0, (sizes.error)(row))).collect();
    sorting::by_number(&mut found, |(size, _)| -size);
    if found.len() != list.len() && (has_all || found.len() > list.len()) {
        return Err(format!("{} grains instead of {}", found.len(), list.len()));
    }
    let mut listed = list.iter().copied();
    for (size, error) in found {
        let is_same = |mm: f64| (size - mm).abs() <= error * mm;
        let next = listed.next().unwrap_or(f64::NAN);
        // Sizes that are listed and not placed are passed over.
        let is_listed = is_same(next) || !has_all && listed.any(is_same);
        if !is_listed {
            return Err(format!("a grain of {size} mm instead of {next} mm"));
        }
    }
    Ok(())
}

/// Compares the volume above each sieve with what the curve asks for; `largest` are the volumes of the largest grains
/// of the classes, `doubtful_mm3` those of the grains below the sieve that may belong above it.
fn check_cumulative(
    classes: &[ClassReport],
    largest: &[f64],
    doubtful_mm3: &[f64],
    rounding: f64,
    has_all: bool,
) -> Result<(), String> {
    let (mut asked_mm3, mut excess, mut allowed) = (0.0, 0.0, 0.0);
    for ((class, &largest), &doubtful) in classes.iter().zip(largest).zip(doubtful_mm3).rev() {
        asked_mm3 += class.target_volume_mm3;
        excess += class.volume_mm3 - class.target_volume_mm3;
        allowed =
            if class.grains > 0 || doubtful > 0.0 { largest } else { allowed - class.target_volume_mm3 };
        let is_short = has_all && excess + doubtful < -rounding;
        if is_short || excess > allowed + rounding {
            let (sieve, asked) = (class.d_min_mm, asked_mm3 + excess);
            return Err(if is_short {
                format!(
                    "above {sieve} mm the grains have {asked} mm3 of the {asked_mm3} mm3 that the curve asks for: grains \
                     are missing"
                )
            } else {
                format!(
                    "above {sieve} mm the grains have {asked} mm3, and the curve asks for {asked_mm3} mm3: must be from \
                     {asked_mm3} to {} mm3",
                    asked_mm3 + allowed.max(0.0)
                )
            });
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::super::SIEVE_ERROR;
    use super::super::sieve::sieve_size;
    use super::*;
    use crate::mix::GradedMix;
    use crate::mix::sampling::{sample, sample_shaped};
    use crate::rng::{Stream, stream};

    /// Checks sizes and volumes of bodies, with the error of each size.
    fn check_bodies(
        rows: &[(f64, f64)],
        error: &dyn Fn(usize) -> f64,
        request: &PackingRequest,
    ) -> Result<Graded, String> {
        let sizes = Sizes { grains: rows.len(), of: &|row| rows[row], error, give_volumes: false };
        check(sizes, &[], request, Extent::WHOLE)
    }

    fn request(edge_mm: f64, mix: &Value) -> PackingRequest {
        let value = json!({"specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm]}, "mix": mix});
        PackingRequest::from_json(&value, 1).unwrap()
    }

    #[test]
    fn a_grain_close_to_a_sieve_counts_on_either_side_of_it() {
        // 200 mm³ on each side of 8 mm.
        let sieves = json!({"type": "sieves", "points": [[4.0, 0.0], [8.0, 0.5], [16.0, 1.0]]});
        let request = request(10.0, &json!({"grading": sieves, "volume_fraction": 0.4}));
        let accepted = |sizes: &[(f64, f64)], error: f64| check_bodies(sizes, &|_| error, &request).is_ok();
        for (size, exactly, roughly) in
            [(8.000_04, true, true), (7.999_96, false, true), (7.999, false, false), (8.001, true, true)]
        {
            let grains = [(12.0, 150.0), (size, 50.0), (6.0, 200.0)];
            assert_eq!((accepted(&grains, 1e-12), accepted(&grains, 1e-5)), (exactly, roughly), "{size}");
        }
        // Too much above the sieve, unless grains in doubt lie below it.
        for (size, expected) in [(8.000_04, true), (8.001, false)] {
            let grains = [(12.0, 100.0), (11.0, 100.0), (size, 60.0), (size, 60.0), (6.0, 80.0)];
            assert_eq!(accepted(&grains, 1e-5), expected, "{size}");
        }
        let outside = [(16.000_04, 200.0), (3.999_98, 200.0)];
        assert!(accepted(&outside, 1e-5) && !accepted(&outside, 1e-12));
    }

    #[test]
    fn counted_grains_follow_the_curve_and_have_their_number() {
        let sieves = json!({"type": "sieves", "points": [[4.0, 0.0], [8.0, 0.5], [16.0, 1.0]]});
        let request = request(100.0, &json!({"grading": sieves, "count": 2000}));
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        let drawn = sample(&mix, &mut stream(5, Stream::Sampling), &|| false).unwrap().d_mm;
        let judged = |d_mm: &[f64], extent: Extent| {
            let of = |row: usize| (d_mm[row], volume_mm3(d_mm[row]));
            let sizes = Sizes { grains: d_mm.len(), of: &of, error: &|_| 0.0, give_volumes: true };
            check(sizes, &[], &request, extent)
        };
        let classes = judged(&drawn, Extent::WHOLE).unwrap().classes;
        assert_eq!(classes.iter().map(|class| class.grains).sum::<u64>(), 2000);
        for fewer in [&drawn[1..], &drawn[..1999]] {
            assert_eq!(judged(fewer, Extent::WHOLE).unwrap_err(), "1999 grains instead of 2000");
        }
        // Without the finest, what is left has its share of the whole.
        let part = Extent { has_all_grains: false, ..Extent::WHOLE };
        assert!(judged(&drawn[..900], part).is_ok());
        // Ten of the largest are as fine as the finest.
        let mut wrong = drawn.clone();
        wrong[..10].fill(4.1);
        sorting::descending(&mut wrong);
        let fault = judged(&wrong, Extent::WHOLE).unwrap_err();
        assert!(fault.starts_with("above 8 mm the grains have"), "{fault}");
        assert!(judged(&wrong[..900], part).is_err());
    }

    #[test]
    fn sampled_polyhedra_follow_the_curve_by_the_sieve_sizes_of_the_check() {
        let shape =
            json!({"type": "polyhedron", "template_count": 6, "ratios": {"type": "triangle", "k": 0.3}});
        let grading = json!({"type": "standard", "name": "A16"});
        let request = request(100.0, &json!({"grading": grading, "volume_fraction": 0.5, "shape": shape}));
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        for seed in 0..5 {
            let [mut sizes, mut forms] = [Stream::Sampling, Stream::Shape].map(|of| stream(seed, of));
            let grains = sample_shaped(&mix, &mut sizes, &mut forms, &|| false).unwrap().grains;
            let sieves: Vec<f64> = grains.templates.iter().map(sieve_size).collect();
            let found: Vec<(f64, f64)> = (grains.shapes.iter())
                .map(|shape| (shape.d_mm(), shape.template().unwrap()))
                .map(|(d, template)| (sieves[template as usize] * d, volume_mm3(d)))
                .collect();
            let judge = |sizes: &[(f64, f64)]| check_bodies(sizes, &|_| SIEVE_ERROR, &request);
            let classes = judge(&found).unwrap().classes;
            assert_eq!(classes.iter().map(|class| class.grains).sum::<u64>(), found.len() as u64);
            assert!(judge(&found[5..]).unwrap_err().contains("grains are missing"));
            for factor in [0.9, 1.1] {
                let other: Vec<(f64, f64)> = found.iter().map(|(size, of)| (size * factor, *of)).collect();
                assert!(judge(&other).is_err());
            }
        }
    }
}
