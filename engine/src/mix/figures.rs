//! Figures of a grading that laboratories compute by hand: fineness moduli, specific surface, packing density.
//!
//! They are those of all aggregate of a mix that is coarser than [`FINES_MM`], as spheres of the sieve sizes: finer
//! grains have most of the surface of a curve that goes on to dust, and are paste. Sources: fineness modulus, ASTM C125
//! and EN 12620, annex B; k-value (Körnungsziffer), the sum of what stays on the nine sieves of DIN 1045-2; packing
//! density, [`super::packing_model`]; thickness of paste, Kennedy (1940), Proceedings of the ACI 36, 373 to 400, and de
//! Larrard (1999), Concrete Mixture Proportioning, chapter 2.

use serde::Serialize;

use super::class::{Class, Law};
use super::packing_model::packing_density;
use super::{GradedMix, classes_above, sizes_of_list};
use crate::elementary::cbrt;
use crate::request::{Form, Grading, Mix, MixPart, PackingModel};
use crate::sorting;

/// Sieve that fines pass, in mm (EN 12620).
pub const FINES_MM: f64 = 0.063;
/// A share by which sums of shares may miss 1.
const ROUNDING: f64 = 1.0e-12;
/// Sieves of the fineness modulus of ASTM C125, in mm.
const ASTM_C125_MM: [f64; 11] = [0.15, 0.3, 0.6, 1.18, 2.36, 4.75, 9.5, 19.0, 37.5, 75.0, 150.0];
/// Sieves of that of EN 12620, in mm.
const EN_12620_MM: [f64; 6] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0];
/// Sieves of the k-value of DIN 1045-2, in mm.
const DIN_1045_MM: [f64; 9] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0];

/// Figures of the aggregate of a mix, told by a dry run and by a blend.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GradingFigures {
    /// Share of the aggregate that passes 0.063 mm. The surface and the packing density count the coarser rest.
    pub fines: f64,
    /// Fineness modulus of ASTM C125: what stays on each of the sieves 0.15, 0.3, 0.6, 1.18, 2.36, 4.75, 9.5, 19, 37.5,
    /// 75 and 150 mm, summed.
    pub fineness_modulus: f64,
    /// Fineness modulus of EN 12620, for sands: the same of the sieves 0.125, 0.25, 0.5, 1, 2 and 4 mm.
    pub fineness_modulus_en_12620: f64,
    /// k-value (Körnungsziffer) of DIN 1045-2: the same of the sieves 0.25, 0.5, 1, 2, 4, 8, 16, 31.5 and 63 mm.
    pub k_value: f64,
    /// Surface of spheres of these sizes over their volume. That of crushed grains is larger.
    pub specific_surface_m2_m3: f64,
    /// The same over their mass, where all aggregates have a density.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specific_surface_m2_kg: Option<f64>,
    /// How the aggregate was taken to be compacted.
    pub packing_model: PackingModel,
    /// Packing density of the compacted aggregate without walls, by de Larrard's compressible packing model (1999).
    pub packing_density: f64,
    /// The same of the grains that are placed, beside what the methods reach. Absent of a blend.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packing_density_placed: Option<f64>,
    /// The paste, where the amount of aggregate is known.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paste: Option<PasteFigures>,
}

/// How thick the paste lies between the grains of a concrete. Paste is all that is no aggregate coarser than 0.063 mm:
/// cement, water, air and fines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PasteFigures {
    /// Volume of the paste over that of the concrete.
    pub volume_fraction: f64,
    /// Volume of the paste that remains when the voids of the compacted aggregate are filled, over that of the
    /// concrete; negative where they are not filled.
    pub excess_volume_fraction: f64,
    /// Thickness of that rest on the surface of the grains (Kennedy 1940); 0 where the voids are not filled.
    pub film_thickness_mm: f64,
    /// Distance between two of the largest grains when all of the compacted aggregate is spread evenly, the maximum
    /// paste thickness of de Larrard (1999): `d_max (cbrt(packing density / aggregate) - 1)`; 0 where the voids are not
    /// filled.
    pub maximum_thickness_mm: f64,
}

/// The classes of a whole mix that stay on a sieve, with their shares of the volume of all aggregate.
fn classes_of(mix: &Mix, sieve_mm: f64) -> Vec<Class> {
    let of_part = |part: MixPart<'_>| {
        let classes = match part.grading.form() {
            Form::List(list) => listed(list),
            form => classes_above(&form, sieve_mm),
        };
        let coarser = classes.into_iter().filter(|class| class.high_mm > sieve_mm);
        coarser
            .map(|class| Class { mass_fraction: part.share * class.mass_fraction, ..class })
            .collect::<Vec<_>>()
    };
    mix.parts().into_iter().flat_map(of_part).collect()
}

/// The packing density of grains in these classes; `None` where there are none.
fn density_of(classes: &[Class], model: PackingModel) -> Option<f64> {
    let middle = |class: &Class| ((class.low_mm * class.high_mm).sqrt(), class.mass_fraction);
    let sizes: Vec<(f64, f64)> = classes.iter().flat_map(Class::narrow).map(|class| middle(&class)).collect();
    packing_density(&sizes, model)
}

/// The grains of a list as classes of one size each; many sizes are taken together.
fn listed(list: &[f64]) -> Vec<Class> {
    let mut coarse_first = list.to_vec();
    sorting::descending(&mut coarse_first);
    let sizes = sizes_of_list(&coarse_first);
    let all: f64 = sizes.iter().map(|(d, number)| number * d.powi(3)).sum();
    let single = |&(mm, number): &(f64, f64)| Class {
        law: Law::Single,
        low_mm: mm,
        high_mm: mm,
        mass_fraction: number * mm.powi(3) / all,
        volume_ratio: 1.0,
        part: 0,
    };
    sizes.iter().map(single).collect()
}

fn sum(classes: &[Class]) -> f64 {
    classes.iter().map(|class| class.mass_fraction).sum()
}

/// What passes sieves of a grading.
pub(crate) struct Passing<'a> {
    form: Form<'a>,
    /// The narrow classes of a law of sizes, from fine to coarse, each with the share of the mass that is coarser than
    /// all of it.
    narrow: Vec<(Class, f64)>,
}

impl<'a> Passing<'a> {
    /// Prepares a grading.
    pub(crate) fn of(grading: &'a Grading) -> Self {
        let form = grading.form();
        let mut narrow = Vec::new();
        if matches!(form, Form::Distribution(_)) {
            let mut coarser = 0.0;
            for class in classes_above(&form, 0.0).iter().flat_map(Class::narrow).rev() {
                narrow.push((class, coarser));
                coarser += class.mass_fraction;
            }
            narrow.reverse();
        }
        Self { form, narrow }
    }

    /// Share of the mass that passes a sieve in mm.
    pub(crate) fn share(&self, sieve_mm: f64) -> f64 {
        let coarser = match &self.form {
            Form::List(list) => {
                let volume = |stays: &dyn Fn(f64) -> bool| -> f64 {
                    list.iter().filter(|&&d| stays(d)).map(|d| d.powi(3)).sum()
                };
                volume(&|d| d > sieve_mm) / volume(&|_| true)
            }
            Form::Distribution(_) => {
                let first = self.narrow.partition_point(|(class, _)| class.high_mm <= sieve_mm);
                self.narrow.get(first).map_or(0.0, |(class, coarser)| {
                    coarser + class.above(sieve_mm).map_or(0.0, |class| class.mass_fraction)
                })
            }
            // Grains that are as large as the openings of a sieve pass it.
            form => {
                let mut classes = classes_above(form, sieve_mm);
                classes.retain(|class| class.high_mm > sieve_mm);
                sum(&classes)
            }
        };
        (1.0 - coarser).clamp(0.0, 1.0)
    }
}

/// The figures of all aggregate of a mix, of which no grain is placed; `None` where all of it is fines.
pub fn figures(mix: &Mix) -> Option<GradingFigures> {
    let parts: Vec<(f64, Passing<'_>)> =
        mix.parts().iter().map(|part| (part.share, Passing::of(part.grading))).collect();
    let retained =
        |mm: f64| parts.iter().map(|(share, passing)| share * (1.0 - passing.share(mm))).sum::<f64>();
    let modulus = |sieves: &[f64]| sieves.iter().map(|&mm| retained(mm)).sum::<f64>();
    let classes = classes_of(mix, FINES_MM);
    let counted = sum(&classes);
    let packing_density = density_of(&classes, mix.packing_model)?;
    // Of spheres: 6 / d by the mean of the volume.
    let per_mm = |class: &Class| {
        class.mass_fraction * std::f64::consts::PI * class.grains_per_volume() * class.mean_of(&|d| d * d)
    };
    let surface_m2_m3 = 1000.0 * classes.iter().map(per_mm).sum::<f64>() / counted;
    Some(GradingFigures {
        // Sums of shares miss 1 by rounding.
        fines: Some(1.0 - counted).filter(|fines| *fines > ROUNDING).unwrap_or(0.0),
        fineness_modulus: modulus(&ASTM_C125_MM),
        fineness_modulus_en_12620: modulus(&EN_12620_MM),
        k_value: modulus(&DIN_1045_MM),
        specific_surface_m2_m3: surface_m2_m3,
        specific_surface_m2_kg: density_kg_m3(mix, &parts).map(|density| surface_m2_m3 / density),
        packing_model: mix.packing_model,
        packing_density,
        packing_density_placed: None,
        paste: None,
    })
}

/// Mean density of the aggregate that is coarser than fines; `None` unless every aggregate has one.
fn density_kg_m3(mix: &Mix, parts: &[(f64, Passing<'_>)]) -> Option<f64> {
    let (mut mass, mut volume) = (0.0, 0.0);
    for (aggregate, (share, passing)) in mix.aggregates.iter().zip(parts) {
        let coarser = share * (1.0 - passing.share(FINES_MM));
        mass += coarser * aggregate.density_kg_m3?;
        volume += coarser;
    }
    (volume > 0.0).then(|| mass / volume)
}

/// The figures of a mix in a specimen.
pub(crate) fn figures_in_specimen(mix: &Mix, graded: &GradedMix, has_amount: bool) -> Option<GradingFigures> {
    let figures = figures(mix)?;
    let placed = match &graded.list {
        Some(list) => density_of(&listed(list), mix.packing_model),
        None => density_of(&graded.sieve_classes, mix.packing_model),
    };
    let largest_mm = mix.parts().iter().map(|part| part.grading.form().range_mm().1).fold(0.0, f64::max);
    let paste = has_amount.then(|| {
        let aggregate = graded.volume_fraction_mixture * (1.0 - figures.fines);
        let per_mm = figures.specific_surface_m2_m3 / 1000.0;
        let excess = 1.0 - aggregate / figures.packing_density;
        PasteFigures {
            volume_fraction: 1.0 - aggregate,
            excess_volume_fraction: excess,
            film_thickness_mm: (excess / (aggregate * per_mm)).max(0.0),
            maximum_thickness_mm: (largest_mm * (cbrt(figures.packing_density / aggregate) - 1.0)).max(0.0),
        }
    });
    Some(GradingFigures { packing_density_placed: placed, paste, ..figures })
}

#[cfg(test)]
#[path = "figures_tests.rs"]
mod tests;
