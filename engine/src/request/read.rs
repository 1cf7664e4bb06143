//! Reads the request types out of JSON, with all their bounds.

use serde_json::Value;

use super::decode::{At, Bound, Faults, Object};
use super::growth;
use super::lengths::{LENGTH, length};
use super::mix::read_mix;
use super::segregation::read_segregation;
use super::{
    Boundary, Distance, FieldError, MAX_LENGTH_MM, MAX_SEED, Materials, Method, Mix, OnLimit, PackingRequest,
    Segregation, Specimen,
};

const GAP: Bound = Bound::closed(0.0, MAX_LENGTH_MM, "mm");
const FACTOR: Bound = Bound::closed(0.0, 100.0, "");

impl PackingRequest {
    /// Reads a request that holds nothing but the fields of a packing.
    ///
    /// `seed` is used when the document names none.
    ///
    /// ```
    /// use packstone_engine::PackingRequest;
    /// use serde_json::json;
    ///
    /// let mut document = json!({
    ///     "specimen": {"type": "box", "size_mm": [100, 100, 100]},
    ///     "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "volume_fraction": 0.6},
    ///     "distance": {"type": "constant", "gap_mm": 0.5},
    /// });
    /// let request = PackingRequest::from_json(&document, 7).expect("every field is within its bounds");
    /// assert_eq!((request.seed, request.mix.d_min_mm), (7, Some(2.0)));
    ///
    /// document["distance"]["gap_mm"] = json!(-1);
    /// let faults = PackingRequest::from_json(&document, 7).unwrap_err();
    /// assert_eq!(faults[0].pointer, "/distance/gap_mm");
    /// ```
    ///
    /// # Errors
    /// All faults of the document, each with its pointer.
    pub fn from_json(value: &Value, seed: u64) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let request = At::root(value, &faults).object().and_then(|mut object| {
            let request = Self::from_object(&mut object, seed);
            object.finish();
            request
        });
        match request {
            Some(request) if faults.count() == 0 => Ok(request),
            _ => Err(faults.into_vec()),
        }
    }

    /// Judges a request that was built in code by the bounds of one that is read from JSON.
    ///
    /// [`crate::pack`] calls it, so a request outside the bounds is refused whatever its origin.
    ///
    /// # Errors
    /// All faults, each with its pointer.
    pub fn validate(&self) -> Result<(), Vec<FieldError>> {
        let whole = |detail: String| vec![FieldError { pointer: String::new(), detail }];
        let value =
            serde_json::to_value(self).map_err(|error| whole(format!("has no JSON form: {error}")))?;
        let read = Self::from_json(&value, self.seed)?;
        if read == *self {
            return Ok(());
        }
        // JSON has no such numbers; and what is absent is read as its default.
        Err(whole("has a number that is not finite, or leaves out mix.d_min_mm, which has a default".into()))
    }

    /// Reads the packing's fields from an object that may hold others, which the caller asks for.
    ///
    /// `None` means that faults were reported; the reverse does not hold, so ask the faults.
    pub fn from_object(object: &mut Object<'_>, seed: u64) -> Option<Self> {
        let seed = match object.optional("seed") {
            Some(at) => at.integer(0, MAX_SEED as i64).map(|s| s as u64),
            None => Some(seed),
        };
        let specimen = object.required("specimen").and_then(|at| read_specimen(&at));
        let mix_at = object.required("mix");
        let mix = mix_at.as_ref().and_then(read_mix);
        let distance_at = object.optional("distance");
        let distance = match &distance_at {
            Some(at) => read_distance(at),
            None => Some(Distance::None { wall_gap_mm: None }),
        };
        let method_at = object.optional("method");
        let method = match &method_at {
            Some(at) => read_method(at),
            None => Some(Method::Auto {}),
        };
        let segregation_at = object.optional("segregation");
        let segregation = match &segregation_at {
            Some(at) => read_segregation(at, specimen.as_ref()),
            None => Some(Segregation::None {}),
        };
        let on_limit = match object.optional("on_limit") {
            Some(at) => at.choice(&[("fail", OnLimit::Fail), ("keep", OnLimit::Keep)]),
            None => Some(OnLimit::Fail),
        };
        let aggregates = mix.as_ref().map(|mix| mix.aggregates.as_slice());
        let materials = Materials::read_field(object, aggregates);
        if let (Some(at), Some(mix)) = (&mix_at, &mix) {
            judge_maximum(at, mix, distance.as_ref(), method.as_ref())?;
        }
        if let (Some(mix), Some(at), Some(method)) = (&mix, &method_at, &method) {
            growth::judge(at, method, mix.has_shapes())?;
        }
        if let (Some(at), Some(Distance::Maximize { .. }), Some(Method::Rsa { .. })) =
            (&distance_at, &distance, &method)
        {
            // Where the fault is: no other field of the distance would be right with this method.
            at.object()?.required("type")?.fault(
                "\"maximize\" needs grains that grow: the method must be \"growth\" or \"auto\", not \"rsa\"",
            );
            return None;
        }
        Some(Self {
            seed: seed?,
            specimen: specimen?,
            mix: mix?,
            distance: distance?,
            method: method?,
            segregation: segregation?,
            on_limit: on_limit?,
            materials,
        })
    }
}

/// Judges a volume fraction that is to be as large as possible beside a distance and a method.
fn judge_maximum(
    mix_at: &At<'_>,
    mix: &Mix,
    distance: Option<&Distance>,
    method: Option<&Method>,
) -> Option<()> {
    if !mix.maximizes_volume_fraction() {
        return Some(());
    }
    let detail = if let Some(Method::Rsa { .. }) = method {
        "\"maximize\" needs grains that grow: the method must be \"growth\" or \"auto\", not \"rsa\""
    } else if let Some(Distance::Maximize { .. }) = distance {
        "\"maximize\" needs a given distance: the distance must be another than \"maximize\", or this a number"
    } else {
        return Some(());
    };
    mix_at.fault_below("/volume_fraction", detail);
    None
}

impl Specimen {
    /// Reads the specimen of a request that was accepted before.
    ///
    /// # Errors
    /// All faults of the document, each with its pointer.
    pub fn from_json(value: &Value) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        read_specimen(&At::root(value, &faults)).ok_or_else(|| faults.into_vec())
    }
}

fn read_specimen(at: &At<'_>) -> Option<Specimen> {
    #[derive(Clone, Copy)]
    enum Kind {
        Box,
        Cylinder,
    }
    let mut object = at.object()?;
    let specimen = match object.variant(&[("box", Kind::Box), ("cylinder", Kind::Cylinder)])? {
        Kind::Box => {
            let size = object.required("size_mm").and_then(|at| {
                let [x, y, z] = at.array_of()?.map(|at| at.number(LENGTH));
                Some([x?, y?, z?])
            });
            let boundary = match object.optional("boundary") {
                Some(at) => at.choice(&[("walls", Boundary::Walls), ("periodic", Boundary::Periodic)]),
                None => Some(Boundary::Walls),
            };
            size.zip(boundary).map(|(size_mm, boundary)| Specimen::Box { size_mm, boundary })
        }
        Kind::Cylinder => {
            let diameter = length(&mut object, "diameter_mm");
            let height = length(&mut object, "height_mm");
            diameter.zip(height).map(|(diameter_mm, height_mm)| Specimen::Cylinder { diameter_mm, height_mm })
        }
    };
    object.finish();
    specimen
}

fn read_distance(at: &At<'_>) -> Option<Distance> {
    #[derive(Clone, Copy)]
    enum Kind {
        None,
        Constant,
        Proportional,
        SmallerDiameter,
        Maximize,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("none", Kind::None),
        ("constant", Kind::Constant),
        ("proportional", Kind::Proportional),
        ("smaller_diameter", Kind::SmallerDiameter),
        ("maximize", Kind::Maximize),
    ])?;
    let size = match kind {
        Kind::None | Kind::Maximize => Some(0.0),
        Kind::Constant => object.required("gap_mm").and_then(|at| at.number(GAP)),
        Kind::Proportional | Kind::SmallerDiameter => {
            object.required("factor").and_then(|at| at.number(FACTOR))
        }
    };
    let wall_at = object.optional("wall_gap_mm");
    let wall_gap_mm = wall_at.as_ref().and_then(|at| at.number(GAP));
    object.finish();
    let size = size?;
    if wall_at.is_some() && wall_gap_mm.is_none() {
        return None;
    }
    Some(match kind {
        Kind::None => Distance::None { wall_gap_mm },
        Kind::Constant => Distance::Constant { gap_mm: size, wall_gap_mm },
        Kind::Proportional => Distance::Proportional { factor: size, wall_gap_mm },
        Kind::SmallerDiameter => Distance::SmallerDiameter { factor: size, wall_gap_mm },
        Kind::Maximize => Distance::Maximize { wall_gap_mm },
    })
}

fn read_method(at: &At<'_>) -> Option<Method> {
    #[derive(Clone, Copy)]
    enum Kind {
        Auto,
        Rsa,
        Growth,
        Edmd,
        MonteCarlo,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("auto", Kind::Auto),
        ("rsa", Kind::Rsa),
        ("growth", Kind::Growth),
        ("edmd", Kind::Edmd),
        ("monte_carlo", Kind::MonteCarlo),
    ])?;
    let method = match kind {
        Kind::Auto => Some(Method::Auto {}),
        Kind::Rsa => match object.optional("attempts_per_grain") {
            Some(at) => {
                at.integer(1, 1_000_000_000_000).map(|n| Method::Rsa { attempts_per_grain: Some(n as u64) })
            }
            None => Some(Method::Rsa { attempts_per_grain: None }),
        },
        Kind::Growth => growth::read_options(&mut object).map(|options| Method::Growth { options }),
        Kind::Edmd => growth::read_options(&mut object).map(|options| Method::Edmd { options }),
        Kind::MonteCarlo => growth::read_options(&mut object).map(|options| Method::MonteCarlo { options }),
    };
    object.finish();
    method
}

#[cfg(test)]
#[path = "read_tests.rs"]
mod tests;
