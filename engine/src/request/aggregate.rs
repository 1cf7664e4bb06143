//! Several aggregates in one mix: each has its own grading, cut-off, shapes and density, and a share of the volume.
//!
//! Types, bounds and JSON form only. A mix that names no aggregates is read as one of them ([`Mix::parts`]), so that
//! what works on parts works on every mix.

use serde::Serialize;

use super::decode::{At, Bound, Items, Object, all, bounded, rounded};
use super::grading::{check_d_min, read_d_min, read_grading};
use super::proportions::{DENSITY, MASS};
use super::shape::read_mix_shapes;
use super::{Grading, GrainShape, Mix, Orientation, PackingModel, ShapeClass, SizeMeasure, VolumeFractionOf};

/// Most aggregates of a mix.
pub const MAX_AGGREGATES: usize = 16;
/// Longest name of an aggregate, in characters.
pub const MAX_AGGREGATE_NAME: usize = 64;

const SHARE: Bound = Bound::positive(1.0, "");
/// Shares typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 2.0e-3;
const ROUNDING: f64 = 1.0e-9;

/// An aggregate of a mix: a supply of grains with one grading and one description of shapes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Aggregate {
    /// What it is called in results; no two aggregates of a mix share a name.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, min_length = 1, max_length = 64))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Share of the volume of all aggregate, that below the cut-off too; the shares of a mix sum to 1.
    #[cfg_attr(feature = "openapi", schema(exclusive_minimum = 0, maximum = 1))]
    pub share: f64,
    /// Density of the grains. Results state masses where it is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 100, maximum = 30_000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density_kg_m3: Option<f64>,
    /// Which diameters, in which proportion by mass; all but `diameters`.
    pub grading: Grading,
    /// Cut-off of this aggregate; that of the mix when absent. An aggregate that is finer than the cut-off of the mix
    /// has no grain.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d_min_mm: Option<f64>,
    /// The shape of all its grains; spheres when absent.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = Option<super::schema::GrainShapeInput>)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<GrainShape>,
    /// The shapes by size, in place of `shape`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = super::schema::OneOrMore<ShapeClass>)
    )]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<ShapeClass>,
}

/// One aggregate of a mix, or the whole mix where it names none.
#[derive(Clone, Copy, Debug)]
pub struct MixPart<'a> {
    /// Share of the volume of all aggregate; the shares of the parts sum to 1.
    pub share: f64,
    /// Which diameters, in which proportion by mass.
    pub grading: &'a Grading,
    /// The cut-off, where there is one.
    pub d_min_mm: Option<f64>,
    shape: Option<&'a GrainShape>,
    shapes: &'a [ShapeClass],
}

impl<'a> MixPart<'a> {
    /// The shapes of the grains with the size above which they hold, from the coarsest down; `None` where all grains
    /// are spheres.
    #[must_use]
    pub fn grain_shapes(&self) -> Option<Vec<(f64, &'a GrainShape)>> {
        let shapes: Vec<(f64, &GrainShape)> = match self.shape {
            Some(shape) => vec![(0.0, shape)],
            None => self.shapes.iter().map(|class| (class.above_mm, &class.shape)).collect(),
        };
        (!shapes.iter().all(|(_, shape)| shape.is_sphere())).then_some(shapes)
    }
}

impl Mix {
    /// The mix of these aggregates, which states no amount.
    pub(crate) fn of_aggregates(aggregates: Vec<Aggregate>) -> Self {
        Self {
            grading: None,
            d_min_mm: None,
            d_max_mm: None,
            aggregates,
            volume_fraction: None,
            count: None,
            proportions: None,
            volume_fraction_of: VolumeFractionOf::AllAggregate,
            allow_coarse: false,
            shape: None,
            shapes: Vec::new(),
            size: SizeMeasure::default(),
            orientation: Orientation::default(),
            packing_model: PackingModel::default(),
        }
    }

    /// The shapes that have templates, of all aggregates and sizes.
    pub(crate) fn polyhedra_mut(&mut self) -> impl Iterator<Item = &mut super::PlainShape> {
        let of_aggregates = self.aggregates.iter_mut().flat_map(|aggregate| {
            aggregate.shape.iter_mut().chain(aggregate.shapes.iter_mut().map(|class| &mut class.shape))
        });
        let of_all = self.shape.iter_mut().chain(self.shapes.iter_mut().map(|class| &mut class.shape));
        of_all
            .chain(of_aggregates)
            .flat_map(GrainShape::parts_mut)
            .filter(|shape| matches!(shape, super::PlainShape::Polyhedron { .. }))
    }

    /// The aggregates of the mix, or the mix itself where it names none.
    #[must_use]
    pub fn parts(&self) -> Vec<MixPart<'_>> {
        let whole = self.grading.iter().map(|grading| MixPart {
            share: 1.0,
            grading,
            d_min_mm: self.d_min_mm,
            shape: self.shape.as_ref(),
            shapes: &self.shapes,
        });
        let sum: f64 = self.aggregates.iter().map(|aggregate| aggregate.share).sum();
        // Shares that sum to 1 but for rounding stay as they are.
        let sum = if (sum - 1.0).abs() < ROUNDING { 1.0 } else { sum };
        let parts = self.aggregates.iter().map(|aggregate| MixPart {
            share: aggregate.share / sum,
            grading: &aggregate.grading,
            d_min_mm: aggregate.d_min_mm.or(self.d_min_mm),
            shape: aggregate.shape.as_ref(),
            shapes: &aggregate.shapes,
        });
        whole.chain(parts).collect()
    }

    /// Whether grains of this diameter in mm are placed, by the cut-off and the largest diameter of the mix.
    #[must_use]
    pub fn places_mm(&self, d_mm: f64) -> bool {
        self.d_min_mm.is_none_or(|least| d_mm >= least) && self.d_max_mm.is_none_or(|most| d_mm <= most)
    }

    /// The diameters of all grains in mm, where the mix lists them.
    #[must_use]
    pub fn listed_diameters_mm(&self) -> Option<&[f64]> {
        match &self.grading {
            Some(Grading::Diameters { diameters_mm }) => Some(diameters_mm),
            _ => None,
        }
    }
}

/// Mean density of all aggregate, in kg/m³; `None` unless every aggregate has one.
#[must_use]
pub fn mean_density_kg_m3(aggregates: &[Aggregate]) -> Option<f64> {
    let (mut mass, mut volume) = (0.0, 0.0);
    for aggregate in aggregates {
        mass += aggregate.share * aggregate.density_kg_m3?;
        volume += aggregate.share;
    }
    (volume > 0.0).then(|| mass / volume)
}

/// The aggregates of a mix, and their mass.
pub(super) struct Aggregates {
    pub(super) list: Vec<Aggregate>,
    /// Mass of all in a cubic metre of concrete, in kg, where each was given by its mass.
    pub(super) mass_kg_m3: Option<f64>,
}

/// Reads the aggregates of a mix that has this cut-off.
///
/// `None` means that faults were reported.
pub(super) fn read_aggregates(at: &At<'_>, d_min_mm: Option<f64>) -> Option<Aggregates> {
    let items = bounded(at, "aggregates", MAX_AGGREGATES)?;
    let read = all(items.iter().map(|item| read_aggregate(&item, d_min_mm)))?;
    let mass_kg_m3 = all(read.iter().map(|(_, mass_kg_m3)| *mass_kg_m3)).map(|masses| masses.iter().sum());
    let with_mass = read.iter().filter(|(_, mass_kg_m3)| mass_kg_m3.is_some()).count();
    if with_mass != 0 && with_mass != read.len() {
        at.fault(format!(
            "{with_mass} of {} aggregates have a mass_kg_m3: must be given for all, in place of share, or for none",
            read.len()
        ));
        return None;
    }
    let mut aggregates: Vec<Aggregate> = read.into_iter().map(|(aggregate, _)| aggregate).collect();
    if mass_kg_m3.is_some() {
        // Volumes so far.
        let all_m3: f64 = aggregates.iter().map(|aggregate| aggregate.share).sum();
        for aggregate in &mut aggregates {
            aggregate.share /= all_m3;
        }
    }
    let described: Vec<_> =
        aggregates.iter().map(|one| (one.name.as_deref(), one.density_kg_m3.is_some())).collect();
    check_described(at, &items, &described)?;
    let sum: f64 = aggregates.iter().map(|aggregate| aggregate.share).sum();
    if (sum - 1.0).abs() > SUM_TOLERANCE {
        at.fault(format!("the shares sum to {}: must sum to 1", rounded(sum)));
        return None;
    }
    let is_below = |aggregate: &Aggregate| {
        aggregate.d_min_mm.is_none() && d_min_mm.is_some_and(|d| aggregate.grading.form().range_mm().1 <= d)
    };
    if let (Some(d), true) = (d_min_mm, aggregates.iter().all(is_below)) {
        at.fault(format!(
            "no aggregate has grains above the d_min_mm {d} of the mix: must have one that does"
        ));
        return None;
    }
    Some(Aggregates { list: aggregates, mass_kg_m3 })
}

/// No two aggregates have the same name, and all or none have a density: of each its name, and whether it has one.
pub(super) fn check_described(
    at: &At<'_>,
    items: &Items<'_>,
    described: &[(Option<&str>, bool)],
) -> Option<()> {
    for (number, (name, _)) in described.iter().enumerate() {
        if name.is_some() && described[..number].iter().any(|(other, _)| other == name) {
            items.at(number).fault_below("/name", "is the name of another aggregate: must differ");
            return None;
        }
    }
    let with_density = described.iter().filter(|(_, has_density)| *has_density).count();
    if with_density != 0 && with_density != described.len() {
        at.fault(format!(
            "{with_density} of {} aggregates have a density_kg_m3: must be given for all or for none",
            described.len()
        ));
        return None;
    }
    Some(())
}

/// Reads an aggregate, with its mass in a cubic metre of concrete where it is given in place of its share: the share is
/// then its volume in m³.
fn read_aggregate(at: &At<'_>, of_mix_mm: Option<f64>) -> Option<(Aggregate, Option<f64>)> {
    let mut object = at.object()?;
    let name = match object.optional("name") {
        Some(at) => read_name(&at).map(Some),
        None => Some(None),
    };
    let mass_at = object.optional("mass_kg_m3");
    let share_at = if mass_at.is_some() { object.optional("share") } else { object.required("share") };
    if let (Some(_), Some(at)) = (&mass_at, &share_at) {
        at.fault("follows from mass_kg_m3 and density_kg_m3: leave one of share and mass_kg_m3 out");
    }
    let mass_kg_m3 = mass_at.as_ref().map(|at| at.number(MASS));
    let density_at =
        if mass_at.is_some() { object.required("density_kg_m3") } else { object.optional("density_kg_m3") };
    let density_kg_m3 = match density_at {
        Some(at) => at.number(DENSITY).map(Some),
        None => Some(None),
    };
    let share = match (&mass_kg_m3, density_kg_m3) {
        (Some(mass), Some(Some(density))) => mass.map(|mass| mass / density),
        (Some(_), _) => None,
        (None, _) => share_at.and_then(|at| at.number(SHARE)),
    };
    let grading_at = object.required("grading");
    let mut grading = grading_at.as_ref().and_then(read_grading);
    let d_min_mm = read_cut_off(&mut object, grading_at.as_ref(), grading.as_mut(), of_mix_mm);
    let shapes = read_mix_shapes(&mut object);
    object.finish();
    let shapes = shapes?;
    let aggregate = Aggregate {
        name: name?,
        share: share?,
        density_kg_m3: density_kg_m3?,
        grading: grading?,
        d_min_mm: d_min_mm?,
        shape: shapes.of_all,
        shapes: shapes.by_size,
    };
    Some((aggregate, mass_kg_m3.flatten()))
}

/// The cut-off of an aggregate's own; none where that of the mix holds.
#[allow(clippy::option_option)] // Outside: whether it could be read. Inside: whether there is one.
fn read_cut_off(
    object: &mut Object<'_>,
    grading_at: Option<&At<'_>>,
    grading: Option<&mut Grading>,
    of_mix_mm: Option<f64>,
) -> Option<Option<f64>> {
    let d_min_at = object.optional("d_min_mm");
    let given = read_d_min(d_min_at.as_ref())?;
    let (grading, grading_at) = (grading?, grading_at?);
    if matches!(grading, Grading::Diameters { .. }) {
        grading_at.fault(
            "an explicit list of diameters prescribes the volume of the whole mix: must be another type of grading in \
             an aggregate",
        );
        return None;
    }
    match (given, of_mix_mm) {
        // Finer than the cut-off of the mix: mortar as a whole.
        (None, Some(d)) if grading.form().range_mm().1 <= d => Some(None),
        (None, Some(d)) => check_d_min(grading, Some(d), grading_at).map(|()| None),
        (given, _) => {
            check_d_min(grading, given, d_min_at.as_ref().unwrap_or(grading_at))?;
            Some(given.or(grading.default_d_min_mm()))
        }
    }
}

pub(super) fn read_name(at: &At<'_>) -> Option<String> {
    let name = at.string()?;
    let characters = name.chars().count();
    if characters == 0 || characters > MAX_AGGREGATE_NAME {
        at.fault(format!("has {characters} characters: must have 1 to {MAX_AGGREGATE_NAME}"));
        return None;
    }
    if name.chars().any(char::is_control) {
        at.fault("has a control character: must be printable");
        return None;
    }
    Some(name.to_owned())
}

#[cfg(test)]
#[path = "aggregate_tests.rs"]
mod tests;
