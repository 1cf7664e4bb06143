//! What a job packs, in a few words: for lists of jobs, their search, and the names of files.
//!
//! It is made of the request when the job is submitted and stored with the job, so that a list reads no request and a
//! search finds what the list shows.

use packstone_engine::request::{Grading, Mix};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::jobs::JobRequest;

/// What a request packs, in a few words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = JobOverview))]
pub(crate) struct Overview {
    /// All of it in one line, as `A16, 70 %, cube 150 mm`.
    title: String,
    /// The grading, or the number of aggregates.
    curve: String,
    /// Form and lengths of the specimen.
    specimen: String,
    /// Requested volume of the aggregate over that of the specimen; `null` where something else says how much there is.
    #[cfg_attr(test, schema(required))]
    volume_fraction: Option<f64>,
    /// What the grains are.
    shape: GrainWords,
    /// The clear distance of the grains.
    gap: String,
}

/// What the grains of a request are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = JobShape))]
#[serde(rename_all = "snake_case")]
pub(crate) enum GrainWords {
    /// Spheres.
    Spheres,
    /// Ellipsoids.
    Ellipsoids,
    /// Convex polyhedra.
    Angular,
    /// More than one of them.
    Mixed,
}

impl Overview {
    /// The overview of a request.
    pub(crate) fn of(request: &JobRequest) -> Self {
        let (mix, specimen) = (&request.mix, specimen_words(&json_of(&request.specimen)));
        let (curve, volume_fraction, shape) = (curve_words(mix), mix.requested_fraction(), shape_of(mix));
        let amount = match (volume_fraction, mix.count) {
            _ if mix.maximizes_volume_fraction() => Some("densest".to_owned()),
            (Some(fraction), _) => Some(format!("{} %", rounded(100.0 * fraction))),
            (None, Some(grains)) => Some(format!("{grains} grains")),
            (None, None) => None,
        };
        let words = match shape {
            GrainWords::Spheres => None,
            GrainWords::Ellipsoids => Some("ellipsoids".to_owned()),
            GrainWords::Angular => Some("angular".to_owned()),
            GrainWords::Mixed => Some("mixed shapes".to_owned()),
        };
        let parts = [Some(curve.clone()), words, amount, Some(specimen.clone())];
        let title = parts.into_iter().flatten().collect::<Vec<_>>().join(", ");
        Self { title, curve, specimen, volume_fraction, shape, gap: gap_words(&json_of(&request.distance)) }
    }

    /// The title as far as it belongs into the name of a file.
    pub(crate) fn file_stem(&self) -> String {
        self.title.replace(" %", "pct").replace(" mm", "mm").replace(" × ", "x")
    }
}

/// A number with at most four significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

fn millimetres(value: &Value) -> Option<f64> {
    value.as_f64().map(rounded)
}

/// A part of a request as clients see it: kinds are told apart by their names there.
fn json_of(part: &impl Serialize) -> Value {
    serde_json::to_value(part).unwrap_or_default()
}

fn specimen_words(specimen: &Value) -> String {
    let mm = |length: &Value| millimetres(length).unwrap_or_default();
    if specimen["type"] == "cylinder" {
        return format!("cylinder {} × {} mm", mm(&specimen["diameter_mm"]), mm(&specimen["height_mm"]));
    }
    let [x, y, z] = [0, 1, 2].map(|axis| mm(&specimen["size_mm"][axis]));
    let periodic = if specimen["boundary"] == "periodic" { ", periodic" } else { "" };
    #[allow(clippy::float_cmp)] // equal as typed
    let is_cube = x == y && y == z;
    if is_cube { format!("cube {x} mm{periodic}") } else { format!("box {x} × {y} × {z} mm{periodic}") }
}

fn curve_words(mix: &Mix) -> String {
    match (&mix.aggregates[..], &mix.grading) {
        // It may have a million.
        (_, Some(Grading::Diameters { .. })) => "listed diameters".to_owned(),
        ([], Some(grading)) => grading_words(&json_of(grading)),
        ([one], _) => grading_words(&json_of(&one.grading)),
        (list, _) => format!("{} aggregates", list.len()),
    }
}

fn grading_words(grading: &Value) -> String {
    let length = |name: &str| millimetres(&grading[name]).map(|mm| format!(" {mm} mm")).unwrap_or_default();
    let name = grading["name"].as_str().unwrap_or_default();
    match grading["type"].as_str().unwrap_or_default() {
        "standard" => {
            let of = grading["standard"].as_str().filter(|standard| *standard != "DIN 1045-2");
            let curve = grading["curve"].as_str().map(|curve| format!(" {curve}")).unwrap_or_default();
            format!("{}{name}{curve}", of.map(|of| format!("{of} ")).unwrap_or_default())
        }
        "fuller" => format!("Fuller{}", length("d_max_mm")),
        "andreasen" => format!("Andreasen{}", length("d_max_mm")),
        "bolomey" => format!("Bolomey{}", length("d_max_mm")),
        "faury" => format!("Faury{}", length("d_max_mm")),
        "dreux_gorisse" => format!("Dreux-Gorisse{}", length("d_max_mm")),
        "monodisperse" => format!("one size{}", length("diameter_mm")),
        "lognormal" => format!("lognormal{}", length("median_mm")),
        "normal" => format!("normal{}", length("mean_mm")),
        "weibull" => "Weibull".to_owned(),
        "rosin_rammler" => "Rosin-Rammler".to_owned(),
        "sizes" | "sieves" | "classes" => "own sieves".to_owned(),
        other => other.replace('_', " "),
    }
}

/// What the grains of all parts of a mix are.
fn shape_of(mix: &Mix) -> GrainWords {
    let parts: Vec<Value> = if mix.aggregates.is_empty() {
        vec![serde_json::json!({"shape": mix.shape, "shapes": mix.shapes})]
    } else {
        mix.aggregates.iter().map(json_of).collect()
    };
    let mut found = Vec::new();
    for part in parts {
        let before = found.len();
        let by_size = part["shapes"].as_array().into_iter().flatten().map(|class| &class["shape"]);
        for shape in std::iter::once(&part["shape"]).chain(by_size) {
            let mixed = shape["of"].as_array().into_iter().flatten().map(|one| &one["shape"]["type"]);
            found.extend(std::iter::once(&shape["type"]).chain(mixed).filter_map(
                |kind| match kind.as_str()? {
                    "sphere" => Some(GrainWords::Spheres),
                    "polyhedron" => Some(GrainWords::Angular),
                    "mixture" => None,
                    _ => Some(GrainWords::Ellipsoids),
                },
            ));
        }
        if found.len() == before {
            found.push(GrainWords::Spheres);
        }
    }
    let first = found.first().copied().unwrap_or(GrainWords::Spheres);
    if found.iter().all(|one| *one == first) { first } else { GrainWords::Mixed }
}

fn gap_words(distance: &Value) -> String {
    let factor = || millimetres(&distance["factor"]).unwrap_or_default();
    match distance["type"].as_str() {
        Some("constant") => format!("{} mm", millimetres(&distance["gap_mm"]).unwrap_or_default()),
        Some("proportional") => format!("{} × mean diameter", factor()),
        Some("smaller_diameter") => format!("{} × smaller diameter", factor()),
        Some("maximize") => "largest".to_owned(),
        _ => "none".to_owned(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_request_is_said_in_a_line() {
        let cube = json!({"type": "box", "size_mm": [150.0, 150.0, 150.0]});
        let grading = json!({"type": "standard", "name": "A16"});
        let polyhedron = json!({"type": "polyhedron"});
        for (request, title, stem, shape, gap) in [
            (
                json!({"specimen": cube, "mix": {"grading": grading, "volume_fraction": 0.7},
                       "distance": {"type": "constant", "gap_mm": 0.5}}),
                "A16, 70 %, cube 150 mm",
                "A16, 70pct, cube 150mm",
                GrainWords::Spheres,
                "0.5 mm",
            ),
            (
                json!({"specimen": {"type": "cylinder", "diameter_mm": 50, "height_mm": 100},
                       "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
                               "volume_fraction": "maximize", "shape": polyhedron}}),
                "Fuller 16 mm, angular, densest, cylinder 50 × 100 mm",
                "Fuller 16mm, angular, densest, cylinder 50x100mm",
                GrainWords::Angular,
                "none",
            ),
            (
                json!({"specimen": {"type": "box", "size_mm": [60, 40, 20.5], "boundary": "periodic"},
                       "mix": {"volume_fraction": 0.123_456, "aggregates": [
                           {"share": 0.5, "grading": grading, "shape": polyhedron},
                           {"share": 0.5, "grading": grading}]},
                       "distance": {"type": "maximize"}}),
                "2 aggregates, mixed shapes, 12.35 %, box 60 × 40 × 20.5 mm, periodic",
                "2 aggregates, mixed shapes, 12.35pct, box 60x40x20.5mm, periodic",
                GrainWords::Mixed,
                "largest",
            ),
        ] {
            let overview = Overview::of(&JobRequest::read(&request, 1, None).unwrap());
            assert_eq!((&*overview.title, &*overview.file_stem()), (title, stem));
            assert_eq!((overview.shape, &*overview.gap), (shape, gap));
        }
    }

    #[test]
    fn contents_of_a_cubic_metre_give_the_fraction() {
        let recipe = json!({
            "seed": 1, "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4,
                    "proportions": {"cement_kg_m3": 350, "water_cement": 0.5, "air": 0.02}}
        });
        let fraction = Overview::of(&JobRequest::read(&recipe, 1, None).unwrap()).volume_fraction.unwrap();
        assert!((0.6..0.8).contains(&fraction), "{fraction}");
    }
}
