//! What a job packs, in a few words: for lists of jobs and for the names of files.
//!
//! It is read from the stored request as JSON, so that a page of a list costs one pass over short documents. What a
//! long list in a request says is not read.

use serde::Serialize;
use serde_json::Value;

use crate::jobs::JobRequest;

/// What a request packs, in a few words.
#[derive(Clone, Debug, PartialEq, Serialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
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
    /// The overview of a stored request; `None` of a document that is none.
    pub(crate) fn of(request: &Value) -> Option<Self> {
        let (mix, specimen) = (&request["mix"], specimen_words(&request["specimen"])?);
        let curve = curve_words(mix)?;
        let volume_fraction = match &mix["volume_fraction"] {
            Value::Null if mix["proportions"].is_object() => {
                JobRequest::read(request, 0, None).ok().and_then(|request| request.mix.requested_fraction())
            }
            given => given.as_f64(),
        };
        let amount = match (volume_fraction, &mix["volume_fraction"], mix["count"].as_u64()) {
            (Some(fraction), ..) => Some(format!("{} %", rounded(100.0 * fraction))),
            (None, Value::String(_), _) => Some("densest".to_owned()),
            (None, _, Some(grains)) => Some(format!("{grains} grains")),
            _ => None,
        };
        let shape = shape_of(mix);
        let words = match shape {
            GrainWords::Spheres => None,
            GrainWords::Ellipsoids => Some("ellipsoids".to_owned()),
            GrainWords::Angular => Some("angular".to_owned()),
            GrainWords::Mixed => Some("mixed shapes".to_owned()),
        };
        let parts = [Some(curve.clone()), words, amount, Some(specimen.clone())];
        let title = parts.into_iter().flatten().collect::<Vec<_>>().join(", ");
        Some(Self { title, curve, specimen, volume_fraction, shape, gap: gap_words(&request["distance"]) })
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

fn specimen_words(specimen: &Value) -> Option<String> {
    if specimen["type"] == "cylinder" {
        let (diameter, height) =
            (millimetres(&specimen["diameter_mm"])?, millimetres(&specimen["height_mm"])?);
        return Some(format!("cylinder {diameter} × {height} mm"));
    }
    let size = specimen["size_mm"].as_array()?.iter().map(millimetres).collect::<Option<Vec<f64>>>()?;
    let &[x, y, z] = &size[..] else { return None };
    let periodic = if specimen["boundary"] == "periodic" { ", periodic" } else { "" };
    #[allow(clippy::float_cmp)] // equal as typed
    let is_cube = x == y && y == z;
    Some(if is_cube {
        format!("cube {x} mm{periodic}")
    } else {
        format!("box {x} × {y} × {z} mm{periodic}")
    })
}

fn curve_words(mix: &Value) -> Option<String> {
    match mix["aggregates"].as_array() {
        Some(list) if list.len() > 1 => return Some(format!("{} aggregates", list.len())),
        Some(list) if list.len() == 1 => return grading_words(&list[0]["grading"]),
        _ => {}
    }
    grading_words(&mix["grading"])
}

fn grading_words(grading: &Value) -> Option<String> {
    let length = |name: &str| millimetres(&grading[name]).map(|mm| format!(" {mm} mm")).unwrap_or_default();
    let (kind, name) = (grading["type"].as_str()?, grading["name"].as_str().unwrap_or_default());
    Some(match kind {
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
        "diameters" => "listed diameters".to_owned(),
        "weibull" => "Weibull".to_owned(),
        "rosin_rammler" => "Rosin-Rammler".to_owned(),
        "sizes" | "sieves" | "classes" => "own sieves".to_owned(),
        other => other.replace('_', " "),
    })
}

/// What the grains of all parts of a mix are.
fn shape_of(mix: &Value) -> GrainWords {
    let parts = match mix["aggregates"].as_array() {
        Some(list) if !list.is_empty() => list.iter().collect(),
        _ => vec![mix],
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
            let overview = Overview::of(&request).unwrap();
            assert_eq!((&*overview.title, &*overview.file_stem()), (title, stem));
            assert_eq!((overview.shape, &*overview.gap), (shape, gap));
        }
        assert_eq!(Overview::of(&json!({"mix": 3})), None);
    }

    #[test]
    fn contents_of_a_cubic_metre_give_the_fraction() {
        let recipe = json!({
            "seed": 1, "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4,
                    "proportions": {"cement_kg_m3": 350, "water_cement": 0.5, "air": 0.02}}
        });
        let fraction = Overview::of(&recipe).unwrap().volume_fraction.unwrap();
        assert!((0.6..0.8).contains(&fraction), "{fraction}");
    }
}
