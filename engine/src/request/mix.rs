//! Reads the mix out of JSON.

use super::aggregate::{Aggregates, MixPart, mean_density_kg_m3, read_aggregates};
use super::decode::{At, Bound, Object};
use super::grading::{check_d_min, read_d_min, read_grading};
use super::lengths::LENGTH;
use super::packing_model::PackingModel;
use super::proportions::{MixProportions, read_proportions};
use super::shape::{MAX_TEMPLATES, MixShapes, read_mix_shapes, read_orientation};
use super::{MAXIMIZE, MIN_SHARE, Mix, Orientation, SizeMeasure, VolumeFraction, VolumeFractionOf};

const FRACTION: Bound = Bound::closed(MIN_SHARE, 1.0, "");
/// Most grains that a mix may count.
const MOST_GRAINS: i64 = 1_000_000_000;

/// Reads a mix: one grading, or several aggregates.
///
/// `None` means that faults were reported.
pub(super) fn read_mix(at: &At<'_>) -> Option<Mix> {
    let mut object = at.object()?;
    let d_min_at = object.optional("d_min_mm");
    let d_min = read_d_min(d_min_at.as_ref());
    let d_max_at = object.optional("d_max_mm");
    let d_max = match &d_max_at {
        Some(at) => at.number(LENGTH).map(Some),
        None => Some(None),
    };
    let aggregates_at = object.optional("aggregates");
    let (mut grading, grading_at, aggregates) = if let Some(at) = &aggregates_at {
        for field in ["grading", "shape", "shapes"] {
            if let Some(at) = object.optional(field) {
                at.fault("the mix has aggregates, each with its own: leave this field out");
            }
        }
        // An unreadable cut-off is reported already.
        (None, None, d_min.and_then(|d_min| read_aggregates(at, d_min)))
    } else {
        let at = object.required("grading");
        (at.as_ref().and_then(read_grading), at, Some(Aggregates { list: Vec::new(), mass_kg_m3: None }))
    };
    // By its name, for a list with a fault in it is a list too.
    let is_list = grading_at.as_ref().is_some_and(|at| at.value()["type"] == "diameters");
    let count = match read_count(&mut object, is_list, aggregates.as_ref()) {
        Some(count) => count.map(Some),
        None => Some(None),
    };
    let (volume_fraction, proportions) = match count {
        Some(None) => read_amount(&mut object, is_list, aggregates.as_ref()),
        _ => (None, None),
    };
    let volume_fraction_of = match object.optional("volume_fraction_of") {
        Some(at) => {
            let volume_fraction_of = at.choice(&[
                ("all_aggregate", VolumeFractionOf::AllAggregate),
                ("placed_grains", VolumeFractionOf::PlacedGrains),
            ]);
            if volume_fraction_of == Some(VolumeFractionOf::PlacedGrains) && proportions.is_some() {
                at.fault("`proportions` count all aggregate, that below the cut-off too: must be \"all_aggregate\"");
            }
            volume_fraction_of
        }
        None => Some(VolumeFractionOf::AllAggregate),
    };
    let allow_coarse = match object.optional("allow_coarse") {
        Some(at) => at.boolean(),
        None => Some(false),
    };
    let shapes = match &aggregates_at {
        Some(_) => Some(MixShapes::default()),
        None => read_mix_shapes(&mut object),
    };
    let orientation_at = object.optional("orientation");
    let orientation = match &orientation_at {
        Some(at) => read_orientation(at),
        None => Some(Orientation::default()),
    };
    let size = match object.optional("size") {
        Some(at) => at.choice(&[("sieve", SizeMeasure::Sieve), ("equivalent", SizeMeasure::Equivalent)]),
        None => Some(SizeMeasure::default()),
    };
    let packing_model = PackingModel::read_field(&mut object);
    let shape_at = object.optional("shape").or_else(|| object.optional("shapes")).or(aggregates_at);
    object.finish();
    let (d_min, d_max, shapes) = (d_min?, d_max?, shapes?);
    let d_min_mm = match grading_at {
        None => d_min,
        Some(grading_at) => {
            let grading = grading.as_mut()?;
            check_d_min(grading, d_min, d_min_at.as_ref().unwrap_or(&grading_at))?;
            d_min.or(grading.default_d_min_mm())
        }
    };
    let mix = Mix {
        grading,
        d_min_mm,
        d_max_mm: d_max,
        aggregates: aggregates?.list,
        volume_fraction,
        count: count?,
        proportions,
        volume_fraction_of: volume_fraction_of?,
        allow_coarse: allow_coarse?,
        shape: shapes.of_all,
        shapes: shapes.by_size,
        size: size?,
        orientation: orientation?,
        packing_model: packing_model?,
    };
    if let (Some(at), Some(d_max)) = (&d_max_at, d_max) {
        check_d_max(at, d_max, &mix)?;
    }
    if let Some(at) = &shape_at {
        judge_templates(at, &mix)?;
    }
    if let (false, false, Some(at)) = (mix.has_shapes(), mix.orientation.is_uniform(), &orientation_at) {
        at.fault("spheres have no orientation: must be \"uniform\", or the mix must have a shape");
        return None;
    }
    Some(mix)
}

/// Judges the number of templates of all shapes of a mix.
fn judge_templates(at: &At<'_>, mix: &Mix) -> Option<()> {
    let parts = mix.parts();
    let shapes = parts.iter().filter_map(MixPart::grain_shapes).flatten();
    let templates: u32 =
        shapes.flat_map(|(_, shape)| shape.parts()).map(|(_, shape)| shape.templates()).sum();
    if templates > MAX_TEMPLATES {
        at.fault(format!(
            "the shapes have {templates} templates together: must have at most {MAX_TEMPLATES}; lower template_count"
        ));
        return None;
    }
    Some(())
}

/// The largest diameter must leave something to place.
fn check_d_max(at: &At<'_>, d_max_mm: f64, mix: &Mix) -> Option<()> {
    let is_left = match mix.listed_diameters_mm() {
        Some(list) => list.iter().any(|&d| mix.places_mm(d)),
        None => mix.parts().iter().any(|part| {
            let (low, high) = part.grading.form().range_mm();
            let least = part.d_min_mm.unwrap_or(0.0).max(low);
            // Equal grains have a diameter and no range.
            if low < high { least < d_max_mm && least < high } else { high <= d_max_mm }
        }),
    };
    if !is_left {
        at.fault(format!("{d_max_mm} is out of range: no grain of the mix lies between its d_min_mm and it"));
    }
    is_left.then_some(())
}

/// Reads the number of grains of a mix that has one. Outside: whether it has. Inside: whether it could be read, and
/// nothing else prescribes the amount.
#[allow(clippy::option_option)]
fn read_count(
    object: &mut Object<'_>,
    is_list: bool,
    aggregates: Option<&Aggregates>,
) -> Option<Option<u64>> {
    let at = object.optional("count")?;
    let count = at.integer(1, MOST_GRAINS).map(|count| count as u64);
    let is_alone = object.refuse_all(
        &["volume_fraction", "proportions"],
        "the mix has a count, from which the volume follows: leave one of the two out",
    );
    let prescribed_by = if is_list {
        Some("an explicit list of diameters has its number of grains")
    } else {
        let by_mass = aggregates.is_some_and(|aggregates| aggregates.mass_kg_m3.is_some());
        by_mass.then_some("the mass_kg_m3 of the aggregates prescribe the volume")
    };
    if let Some(words) = prescribed_by {
        at.fault(format!("{words}: leave this field out"));
    }
    Some(count.filter(|_| is_alone && prescribed_by.is_none()))
}

/// The amount of aggregate: exactly one of its two forms, and none beside an explicit list but the largest.
fn read_amount(
    object: &mut Object<'_>,
    is_list: bool,
    aggregates: Option<&Aggregates>,
) -> (Option<VolumeFraction>, Option<MixProportions>) {
    let content_at = object.optional("proportions");
    if is_list {
        let fraction_at = object.optional("volume_fraction");
        let maximizes = fraction_at.as_ref().is_some_and(|at| at.value() == MAXIMIZE);
        if let Some(at) = fraction_at.as_ref().filter(|_| !maximizes) {
            at.fault(
                "an explicit list of diameters prescribes the volume: leave this field out, or set it to \"maximize\", \
                 which scales all diameters of the list by one factor",
            );
        }
        if let Some(at) = &content_at {
            at.fault("an explicit list of diameters prescribes the volume: leave this field out");
        }
        return (maximizes.then_some(VolumeFraction::Maximize), None);
    }
    let mass_kg_m3 = aggregates.and_then(|aggregates| aggregates.mass_kg_m3);
    let density_kg_m3 = aggregates.and_then(|aggregates| mean_density_kg_m3(&aggregates.list));
    let Some(content_at) = content_at else {
        let (Some(mass), Some(density)) = (mass_kg_m3, density_kg_m3) else {
            return (object.required("volume_fraction").and_then(|at| read_volume_fraction(&at)), None);
        };
        if let Some(at) = object.optional("volume_fraction") {
            at.fault("follows from the mass_kg_m3 of the aggregates: leave this field out");
        }
        let fraction = mass / density;
        if fraction > 1.0 {
            object.at().fault_below(
                "/aggregates",
                format!("the masses of a cubic metre fill {fraction:.4} m3: must fill at most 1"),
            );
            return (None, None);
        }
        return (Some(VolumeFraction::Of(fraction)), None);
    };
    if let Some(at) = object.optional("volume_fraction") {
        if at.value() == MAXIMIZE {
            at.fault(
                "\"maximize\" leaves the volume open, and `proportions` prescribe it: leave one of the two out",
            );
        } else {
            content_at.fault("the mix has a volume_fraction too: leave one of the two out");
        }
        return (None, None);
    }
    (None, read_proportions(&content_at, density_kg_m3, mass_kg_m3))
}

fn read_volume_fraction(at: &At<'_>) -> Option<VolumeFraction> {
    if at.value().is_string() {
        return at.choice(&[(MAXIMIZE, VolumeFraction::Maximize)]);
    }
    at.number(FRACTION).map(VolumeFraction::Of)
}
