//! A blend of stockpiles that is to meet a curve or a band: types, bounds and JSON form.

use serde_json::Value;

use super::aggregate::{check_described, read_name};
use super::decode::{At, Bound, Faults, Object, all, bounded};
use super::grading::{read_grading, read_named};
use super::lengths::LENGTH;
use super::packing_model::PackingModel;
use super::proportions::DENSITY;
#[cfg(feature = "openapi")]
use super::schema;
use super::sieves::{are_percents, complete_below};
use super::{FieldError, Grading, MAX_AGGREGATES, MAX_CURVE_POINTS};
use crate::sorting;

/// A fraction, or in percent.
const PASSING: Bound = Bound::closed(0.0, 100.0, "(0 to 1, or percent)");

/// Stockpiles, and the curve or band that their blend is to meet.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BlendRequest {
    /// The stockpiles, at most 16.
    #[cfg_attr(feature = "openapi", schema(value_type = schema::OneOrMore<Stockpile>))]
    pub aggregates: Vec<Stockpile>,
    /// What is to be met.
    #[cfg_attr(feature = "openapi", schema(value_type = schema::TargetInput))]
    pub target: Target,
    /// The sieves in mm at which it is to be met, at most 1000; those of the target when absent, or standard ones where
    /// it is a law.
    #[cfg_attr(feature = "openapi", schema(required = false, value_type = schema::OneOrMore<f64>))]
    pub sieves_mm: Vec<f64>,
    /// How the blend is taken to be compacted, for its figures.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub packing_model: PackingModel,
}

/// A supply of aggregate with one grading.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Stockpile {
    /// What it is called; no two share a name.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, min_length = 1, max_length = 64))]
    pub name: Option<String>,
    /// Which diameters, in which proportion by mass; all but `diameters`.
    pub grading: Grading,
    /// Density of the grains; given for all stockpiles or for none.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 100, maximum = 30_000))]
    pub density_kg_m3: Option<f64>,
}

/// What a blend is to meet.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// A curve.
    Curve(Grading),
    /// A band: sieves in mm with the least and the most that may pass, from 0 to 1, from fine to coarse.
    Band(Vec<[f64; 3]>),
}

impl BlendRequest {
    /// Reads the request out of JSON.
    ///
    /// ```
    /// use packstone_engine::request::BlendRequest;
    /// use serde_json::json;
    ///
    /// let request = BlendRequest::from_json(&json!({
    ///     "aggregates": [
    ///         {"name": "sand", "grading": {"type": "standard", "standard": "BS 882", "name": "sand M"}},
    ///         {"name": "gravel", "grading": {"type": "sieves", "points": [[4, 0.05], [8, 0.4], [16, 1]]}},
    ///     ],
    ///     "target": {"type": "standard", "name": "A16"},
    /// }));
    /// assert_eq!(request.map(|request| request.aggregates.len()), Ok(2));
    /// ```
    ///
    /// # Errors
    /// All faults of the document, each with its pointer.
    pub fn from_json(value: &Value) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let request = At::root(value, &faults).object().and_then(|mut object| {
            let request = Self::from_object(&mut object);
            object.finish();
            request
        });
        match request {
            Some(request) if faults.count() == 0 => Ok(request),
            _ => Err(faults.into_vec()),
        }
    }

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        let aggregates = object.required("aggregates").and_then(|at| read_stockpiles(&at));
        let target = object.required("target").and_then(|at| read_target(&at));
        let sieves_mm = match object.optional("sieves_mm") {
            Some(at) => read_sieves(&at, target.as_ref()),
            None => Some(Vec::new()),
        };
        let packing_model = PackingModel::read_field(object);
        Some(Self {
            aggregates: aggregates?,
            target: target?,
            sieves_mm: sieves_mm?,
            packing_model: packing_model?,
        })
    }
}

fn read_stockpiles(at: &At<'_>) -> Option<Vec<Stockpile>> {
    let items = bounded(at, "aggregates", MAX_AGGREGATES)?;
    let aggregates = all(items.iter().map(|item| read_stockpile(&item)))?;
    let described: Vec<_> =
        aggregates.iter().map(|one| (one.name.as_deref(), one.density_kg_m3.is_some())).collect();
    check_described(at, &items, &described)?;
    Some(aggregates)
}

fn read_stockpile(at: &At<'_>) -> Option<Stockpile> {
    let mut object = at.object()?;
    let name = match object.optional("name") {
        Some(at) => read_name(&at).map(Some),
        None => Some(None),
    };
    let grading = object.required("grading").and_then(|at| read_curve(&at));
    let density_kg_m3 = match object.optional("density_kg_m3") {
        Some(at) => at.number(DENSITY).map(Some),
        None => Some(None),
    };
    object.finish();
    let mut grading = grading?;
    complete(&mut grading);
    Some(Stockpile { name: name?, grading, density_kg_m3: density_kg_m3? })
}

/// Adds the sieve below a curve that ends a sieve early, as a job with a fine cut-off does.
fn complete(grading: &mut Grading) {
    if let Grading::Sieves { points, completed_mm, .. } = grading
        && points[0][1] > 0.0
    {
        complete_below(points, completed_mm);
    }
}

/// A grading that is a curve.
fn read_curve(at: &At<'_>) -> Option<Grading> {
    let grading = read_grading(at)?;
    if matches!(grading, Grading::Diameters { .. }) {
        at.fault_below("/type", "\"diameters\" lists the grains of one packing: must be a curve or a law");
        return None;
    }
    Some(grading)
}

fn read_target(at: &At<'_>) -> Option<Target> {
    if at.value().get("type").is_none_or(|name| name != "band") {
        let mut curve = read_curve(at)?;
        complete(&mut curve);
        return Some(Target::Curve(curve));
    }
    let mut object = at.object()?;
    object.required("type");
    let target = match object.optional("points") {
        Some(at) => object
            .refuse_all(&["standard", "name"], "the band has points: leave one of the two out")
            .then(|| read_band(&at))
            .flatten(),
        None => read_band_of_standard(&mut object),
    };
    object.finish();
    target
}

/// Reads the band of a grading of a standard.
fn read_band_of_standard(object: &mut Object<'_>) -> Option<Target> {
    if !object.has("name") {
        object.optional("standard");
        object.optional("name");
        object.at().fault("must have either points, or the name of a grading with its standard");
        return None;
    }
    let (grading, name_at) = read_named(object)?;
    if grading.is_curve() {
        name_at.fault(format!("{} is one curve and no band: set the type to \"standard\"", grading.name));
        return None;
    }
    let share = |percent: u8| f64::from(percent) / 100.0;
    let limits = grading.limits.iter().map(|&(mm, low, high)| [mm, share(low), share(high)]);
    Some(Target::Band(limits.collect()))
}

/// Reads the limits of a band: `[sieve in mm, least, most]`.
fn read_band(at: &At<'_>) -> Option<Target> {
    let items = at.array()?;
    if items.is_empty() || items.len() > MAX_CURVE_POINTS {
        at.fault(format!("has {} points: must have 1 to {MAX_CURVE_POINTS}", items.len()));
        return None;
    }
    let mut rows: Vec<([f64; 3], usize)> = Vec::with_capacity(items.len());
    for (row, item) in items.iter().enumerate() {
        let [mm, low, high] = item.array_of()?;
        rows.push(([mm.number(LENGTH)?, low.number(PASSING)?, high.number(PASSING)?], row));
    }
    sorting::by_number(&mut rows, |([mm, ..], _)| *mm);
    for (number, &([mm, low, high], row)) in rows.iter().enumerate() {
        if low > high {
            items.at(row).fault(format!("the least {low} is above the most {high}: must not be"));
            return None;
        }
        let before = number.checked_sub(1).map(|before| rows[before].0);
        if let Some([finer, least, most]) = before
            && (finer == mm || low < least || high < most)
        {
            items.at(row).fault(if finer == mm {
                format!("the sieve {mm} mm stands in two points: must stand in one")
            } else {
                format!("the limits fall from {finer} mm to {mm} mm: must rise towards coarser sieves")
            });
            return None;
        }
    }
    let column = |limit: usize| -> Vec<f64> { rows.iter().map(|(row, _)| row[limit]).collect() };
    let scale = if are_percents(at, &[&column(1), &column(2)])? { 0.01 } else { 1.0 };
    Some(Target::Band(rows.into_iter().map(|([mm, low, high], _)| [mm, scale * low, scale * high]).collect()))
}

fn read_sieves(at: &At<'_>, target: Option<&Target>) -> Option<Vec<f64>> {
    let items = bounded(at, "sieves", MAX_CURVE_POINTS)?;
    let mut sieves = all(items.iter().map(|item| item.number(LENGTH)))?;
    if let Some(Target::Band(points)) = target {
        let (from, to) = (points[0][0], points[points.len() - 1][0]);
        if let Some(row) = sieves.iter().position(|mm| !(from..=to).contains(mm)) {
            items.at(row).fault(format!(
                "{} is out of range: the band has limits from {from} to {to} mm",
                sieves[row]
            ));
            return None;
        }
    }
    sorting::ascending(&mut sieves);
    sieves.dedup();
    Some(sieves)
}

#[cfg(test)]
#[path = "blend_tests.rs"]
mod tests;
