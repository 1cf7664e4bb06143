//! Whether the grains of a packing are those of its mix.
//!
//! Drawn class by class from the coarsest down, with the overshoot carried on, the volume of all
//! grains above any sieve exceeds what the curve asks for by less than the last grain drawn. That
//! is checked at every sieve; an explicit list must come back as it was.

use crate::mix::sieve::{class_of, sieve_classes};
use crate::mix::{GradedMix, sphere_volume};
use crate::packing::{ClassReport, Spheres};
use crate::request::PackingRequest;

/// Sums of millions of volumes agree to this.
const ROUNDING: f64 = 1.0e-9;

/// The classes from fine to coarse, and the largest miss as a share of the whole mass.
pub(super) fn check(spheres: &Spheres, request: &PackingRequest) -> Result<(Vec<ClassReport>, f64), String> {
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let mut classes: Vec<ClassReport> = sieve_classes(&mix)
        .iter()
        .map(|c| ClassReport {
            d_min_mm: c.low_mm,
            d_max_mm: c.high_mm,
            grains: 0,
            target_volume_mm3: c.volume_mm3,
            volume_mm3: 0.0,
        })
        .collect();
    let upper: Vec<f64> = classes.iter().map(|c| c.d_max_mm).collect();
    for (row, &d) in spheres.d_mm.iter().enumerate() {
        if d < mix.d_min_mm || d > mix.d_max_mm {
            return Err(format!("grain {row} of {d} mm lies outside {}..{} mm", mix.d_min_mm, mix.d_max_mm));
        }
        let class = &mut classes[class_of(d, upper.iter().copied())];
        class.grains += 1;
        class.volume_mm3 += sphere_volume(d);
    }
    let all: f64 = classes.iter().map(|c| c.volume_mm3).sum();
    match &mix.list {
        Some(list) => check_list(&spheres.d_mm, list)?,
        None => check_cumulative(&classes, ROUNDING * all.max(1.0))?,
    }
    let miss = |c: &ClassReport| (c.volume_mm3 - c.target_volume_mm3).abs() / all;
    let worst = classes.iter().map(miss).fold(0.0, f64::max);
    Ok((classes, if all > 0.0 { worst } else { 0.0 }))
}

fn check_list(found: &[f64], list: &[f64]) -> Result<(), String> {
    let mut found = found.to_vec();
    found.sort_unstable_by(|a, b| b.total_cmp(a));
    if found.len() != list.len() {
        return Err(format!("{} grains instead of {}", found.len(), list.len()));
    }
    match found.iter().zip(list).find(|(a, b)| a != b) {
        Some((a, b)) => Err(format!("a grain of {a} mm instead of {b} mm")),
        None => Ok(()),
    }
}

fn check_cumulative(classes: &[ClassReport], rounding: f64) -> Result<(), String> {
    let (mut excess, mut allowed) = (0.0, 0.0);
    for class in classes.iter().rev() {
        excess += class.volume_mm3 - class.target_volume_mm3;
        allowed =
            if class.grains > 0 { sphere_volume(class.d_max_mm) } else { allowed - class.target_volume_mm3 };
        if excess < -rounding || excess > allowed + rounding {
            return Err(format!(
                "above {} mm the grains have {excess} mm3 more than the curve asks for: must be from 0 to {allowed} mm3",
                class.d_min_mm
            ));
        }
    }
    Ok(())
}
