//! Draws requests at random, for the benchmark of forecasts: the same seed and number give the same request.
//!
//! Gradings, specimens, shapes, gaps and numbers of grains are those that users ask for. The volume fraction is left
//! open: the benchmark asks for shares of what is found to be reached.

use std::f64::consts::{PI, TAU};

use libm::{cbrt, exp, log, pow, sqrt};
use packstone_engine::{Limits, PackingRequest, Plan};
use serde_json::{Value, json};

/// The kinds of gradings, in the order of their draws.
pub(super) const KINDS: [&str; 9] = [
    "standard",
    "fuller",
    "single size",
    "narrow sieves",
    "gap-graded",
    "ballast",
    "sand",
    "normal list",
    "lognormal list",
];
/// Volume fraction that specimens are sized for.
const TYPICAL: f64 = 0.5;
/// Shortest edge of a specimen over its largest grain.
const LEAST_EDGE: f64 = 2.2;
/// Factor on the cut-off of a mix that has too many fine grains for its specimen.
const COARSER: f64 = 1.2;

/// A request without its volume fraction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Drawn {
    pub(super) kind: &'static str,
    /// The request; its volume fraction is `TYPICAL`.
    pub(super) request: Value,
    /// Volume of the grains of a list over that of the specimen; a list has no volume fraction of its own.
    pub(super) of_list: Option<f64>,
    /// What the runs ask for, over the reach.
    pub(super) share: f64,
    /// Whether runs add grains at random; else they let them grow.
    pub(super) is_random: bool,
    /// Whether the volume fraction or the distance is to be as large as possible.
    pub(super) maximizes: Option<&'static str>,
}

impl Drawn {
    /// The request at a volume fraction of the grains that are placed, by a method.
    pub(super) fn at(&self, volume_fraction: f64, method: &str) -> Value {
        let mut request = self.request.clone();
        match self.of_list {
            Some(filled) => scale(&mut request["specimen"], cbrt(filled / volume_fraction)),
            None => request["mix"]["volume_fraction"] = json!(volume_fraction),
        }
        request["method"] = json!({"type": method});
        request
    }

    /// Whether grains have shapes.
    pub(super) fn has_shapes(&self) -> bool {
        self.request["mix"].get("shape").is_some()
    }
}

/// The request of this number from a seed, of so many grains at most.
pub(super) fn draw(seed: u64, number: u64, most_grains: f64) -> Drawn {
    let mut of =
        Stream(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.wrapping_mul(0xd1b5_4a32_d192_ed03));
    // The kinds take turns, so that few requests have all of them.
    let turn = (number % KINDS.len() as u64) as usize;
    let grains = of.grains().min(most_grains);
    let (grading, [mut d_min, d_max]) = of.grading(turn, grains as usize);
    let shape = of.shape();
    let edges = of.specimen();
    let gap_share = if of.uniform() < 0.5 { 0.0 } else { of.uniform() };
    let (share, is_random) = (of.between(0.7, 1.1), of.uniform() < 0.5);
    let maximizes = match of.uniform() {
        u if u < 0.05 => Some("volume_fraction"),
        u if u < 0.10 => Some("distance"),
        _ => None,
    };
    let is_list = grading["type"] == "diameters";
    let mut request = json!({
        "specimen": edges,
        "mix": {"grading": grading, "allow_coarse": true},
    });
    loop {
        if !is_list {
            request["mix"]["d_min_mm"] = json!(d_min);
            request["mix"]["volume_fraction"] = json!(TYPICAL);
            request["mix"]["volume_fraction_of"] = json!("placed_grains");
        }
        request["specimen"] = edges.clone();
        scale(&mut request["specimen"], 4.0 * d_max);
        let volume = volume_mm3(&request["specimen"]);
        let factor = match &request["mix"]["grading"]["diameters_mm"] {
            Value::Array(list) => {
                let cubes: f64 = list.iter().filter_map(Value::as_f64).map(|d| d * d * d).sum();
                cbrt(cubes * PI / 6.0 / TYPICAL / volume)
            }
            _ => cbrt(grains / expected(&request).unwrap_or(grains)),
        };
        scale(&mut request["specimen"], factor);
        if is_list || shortest(&request["specimen"]) >= LEAST_EDGE * d_max || d_min * COARSER >= 0.9 * d_max {
            break;
        }
        d_min *= COARSER;
    }
    // Few grains of one size may still have more than one edge between the walls.
    let longer = LEAST_EDGE * d_max / shortest(&request["specimen"]);
    let of_list = is_list.then_some(TYPICAL);
    if longer > 1.0 && !is_list {
        scale(&mut request["specimen"], longer);
    }
    if gap_share > 0.0 && maximizes != Some("distance") {
        request["distance"] = json!({"type": "constant", "gap_mm": gap_share * d_min});
    }
    if maximizes == Some("distance") {
        request["distance"] = json!({"type": "maximize"});
    }
    if let Some(shape) = shape {
        request["mix"]["shape"] = shape;
        request["mix"]["size"] = json!("equivalent");
    }
    Drawn { kind: KINDS[turn], request, of_list, share, is_random, maximizes }
}

/// Numbers of grains that the plan of a mix expects.
fn expected(request: &Value) -> Option<f64> {
    let request = PackingRequest::from_json(request, 1).ok()?;
    let all = Limits { max_grains: u64::MAX, max_memory_bytes: u64::MAX, ..Limits::default() };
    Plan::new(&request, &all).ok().map(|plan| plan.grains)
}

/// Scales all lengths of a specimen.
fn scale(specimen: &mut Value, factor: f64) {
    for field in ["size_mm", "diameter_mm", "height_mm"] {
        match &mut specimen[field] {
            Value::Array(edges) => {
                for edge in edges {
                    *edge = json!(edge.as_f64().unwrap_or(1.0) * factor);
                }
            }
            Value::Number(length) => specimen[field] = json!(length.as_f64().unwrap_or(1.0) * factor),
            _ => {
                if let Some(fields) = specimen.as_object_mut() {
                    fields.remove(field);
                }
            }
        }
    }
}

fn lengths(specimen: &Value) -> [f64; 3] {
    match specimen["size_mm"].as_array() {
        Some(edges) => [0, 1, 2].map(|axis| edges[axis].as_f64().unwrap_or(1.0)),
        None => {
            ["diameter_mm", "diameter_mm", "height_mm"].map(|field| specimen[field].as_f64().unwrap_or(1.0))
        }
    }
}

fn shortest(specimen: &Value) -> f64 {
    lengths(specimen).into_iter().fold(f64::INFINITY, f64::min)
}

fn volume_mm3(specimen: &Value) -> f64 {
    let share = if specimen["size_mm"].is_array() { 1.0 } else { PI / 4.0 };
    share * lengths(specimen).into_iter().product::<f64>()
}

/// A length of three significant digits at least, as users write it.
fn rounded(mm: f64) -> f64 {
    (mm * 1000.0).round() / 1000.0
}

/// Random numbers (`SplitMix64`: Steele, Lea and Flood 2014, 10.1145/2660193.2660195).
struct Stream(u64);

impl Stream {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform in the logarithm.
    fn scaled(&mut self, low: f64, high: f64) -> f64 {
        exp(self.between(log(low), log(high)))
    }

    fn one_of<T: Clone>(&mut self, of: &[T]) -> T {
        of[(self.uniform() * of.len() as f64) as usize].clone()
    }

    fn normal(&mut self) -> f64 {
        let radius = sqrt(-2.0 * log(1.0 - self.uniform()));
        radius * libm::cos(TAU * self.uniform())
    }

    /// 20 to 100 000 grains, half of them more than 2000, one in twenty-five more than 20 000.
    fn grains(&mut self) -> f64 {
        let u = self.uniform();
        match u {
            u if u < 0.5 => self.scaled(20.0, 2000.0),
            u if u < 0.96 => self.scaled(2000.0, 20_000.0),
            _ => self.scaled(20_000.0, 100_000.0),
        }
        .round()
    }

    /// A grading, and its smallest and largest diameter.
    fn grading(&mut self, kind: usize, grains: usize) -> (Value, [f64; 2]) {
        let sieves = |points: &[[f64; 2]]| json!({"type": "sieves", "points": points});
        match KINDS[kind] {
            "standard" => {
                let (name, d_max) = self.one_of(&[
                    ("A8", 8.0),
                    ("B8", 8.0),
                    ("C8", 8.0),
                    ("A16", 16.0),
                    ("B16", 16.0),
                    ("C16", 16.0),
                    ("A32", 31.5),
                    ("B32", 31.5),
                    ("C32", 31.5),
                ]);
                let ratio = self.one_of(&[2.0, 4.0, 8.0, 16.0]);
                let d_min = rounded(d_max / ratio);
                (json!({"type": "standard", "name": name}), [d_min, d_max])
            }
            "fuller" => {
                let d_max = self.one_of(&[8.0, 16.0, 32.0]);
                let exponent = rounded(self.between(0.3, 0.8));
                let d_min = rounded(d_max / self.scaled(2.0, 24.0));
                (json!({"type": "fuller", "d_max_mm": d_max, "exponent": exponent}), [d_min, d_max])
            }
            "single size" => {
                let d = self.one_of(&[1.0, 4.0, 10.0]);
                (json!({"type": "monodisperse", "diameter_mm": d}), [d, d])
            }
            "narrow sieves" => {
                let d = self.one_of(&[2.0, 4.0, 8.0]);
                let wider = rounded(d * self.between(1.15, 2.5));
                (sieves(&[[d, 0.0], [wider, 1.0]]), [d, wider])
            }
            "gap-graded" => {
                let fine = self.one_of(&[1.0, 2.0, 4.0]);
                let (step, apart) = (self.between(1.2, 2.0), self.between(1.5, 4.0));
                let share = rounded(self.between(0.1, 0.6));
                let to = rounded(fine * step);
                let from = rounded(to * apart);
                let d_max = rounded(from * step);
                (sieves(&[[fine, 0.0], [to, share], [from, share], [d_max, 1.0]]), [fine, d_max])
            }
            "ballast" => {
                let d_min = self.one_of(&[20.0, 22.4, 31.5]);
                let [middle, coarse] = [rounded(self.between(0.15, 0.5)), rounded(self.between(0.6, 0.95))];
                (sieves(&[[d_min, 0.0], [40.0, middle], [50.0, coarse], [63.0, 1.0]]), [d_min, 63.0])
            }
            "sand" => {
                let shares = [self.uniform(), self.uniform(), self.uniform(), self.uniform()];
                let sum: f64 = shares.iter().sum();
                let mut passing = 0.0;
                let mut points = vec![[0.25, 0.0]];
                for (d, share) in [0.5, 1.0, 2.0, 4.0].into_iter().zip(shares) {
                    passing += share / sum;
                    points.push([d, if d == 4.0 { 1.0 } else { rounded(passing) }]);
                }
                let d_min = self.one_of(&[0.25, 0.5, 1.0]);
                (sieves(&points), [d_min, 4.0])
            }
            kind => {
                let sigma = self.between(0.03, if kind == "normal list" { 0.3 } else { 0.6 });
                let list: Vec<f64> = (0..grains)
                    .map(|_| {
                        let z = self.normal().clamp(-2.5, 2.5);
                        let d = if kind == "normal list" { 1.0 + sigma * z } else { exp(sigma * z) };
                        rounded(5.0 * d)
                    })
                    .collect();
                let least = list.iter().copied().fold(f64::INFINITY, f64::min);
                let most = list.iter().copied().fold(0.0, f64::max);
                (json!({"type": "diameters", "diameters_mm": list}), [least, most])
            }
        }
    }

    /// A specimen of the volume 1.
    fn specimen(&mut self) -> Value {
        let edge = |[x, y, z]: [f64; 3]| {
            let unit = 1.0 / cbrt(x * y * z);
            [x, y, z].map(|length| length * unit)
        };
        match self.uniform() {
            u if u < 0.3 => json!({"type": "box", "size_mm": [1.0, 1.0, 1.0]}),
            u if u < 0.45 => {
                json!({"type": "box", "size_mm": edge([1.0, self.between(0.5, 1.0), self.between(1.0, 4.0)])})
            }
            u if u < 0.6 => {
                json!({"type": "box", "size_mm": edge([1.0, self.between(0.7, 1.0), self.between(0.12, 0.4)])})
            }
            u if u < 0.8 => {
                let height = self.between(0.5, 3.0);
                let diameter = cbrt(4.0 / (PI * height));
                json!({"type": "cylinder", "diameter_mm": diameter, "height_mm": height * diameter})
            }
            _ => json!({"type": "box", "size_mm": [1.0, 1.0, 1.0], "boundary": "periodic"}),
        }
    }

    /// A shape, of half of the mixes; the others are spheres.
    fn shape(&mut self) -> Option<Value> {
        let u = self.uniform();
        let c_over_a = rounded(pow(10.0, -self.uniform()));
        let b_over_a = rounded(self.between(c_over_a, 1.0).max(c_over_a));
        let constant = json!({"type": "constant", "b_over_a": b_over_a, "c_over_a": c_over_a});
        let ratios =
            if self.uniform() < 0.75 { constant } else { json!({"type": "triangle", "k": c_over_a}) };
        let faces = self.between(6.0, 61.0) as u64;
        let template = self.one_of(&["cuts", "cuts", "cuts", "voronoi", "cube", "octahedron", "tetrahedron"]);
        let rounding = if self.uniform() < 0.7 { 0.0 } else { rounded(self.between(0.02, 0.3)) };
        let ellipsoid = json!({"type": "ellipsoid", "ratios": ratios});
        let mut polyhedron =
            json!({"type": "polyhedron", "template": template, "ratios": ratios, "rounding": rounding});
        if template == "cuts" {
            polyhedron["faces"] = json!(faces);
        }
        match u {
            u if u < 0.5 => None,
            u if u < 0.75 => Some(ellipsoid),
            u if u < 0.95 => Some(polyhedron),
            _ => Some(json!({"type": "mixture", "of": [
                {"share": 0.5, "shape": ellipsoid}, {"share": 0.5, "shape": polyhedron},
            ]})),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_draws_the_same_requests_and_all_kinds() {
        let drawn: Vec<Drawn> = (0..200).map(|number| draw(7, number, 1e5)).collect();
        assert_eq!(drawn[17], draw(7, 17, 1e5));
        assert_ne!(drawn[17].request, draw(8, 17, 1e5).request);
        let count = |holds: &dyn Fn(&Drawn) -> bool| drawn.iter().filter(|of| holds(of)).count();
        for kind in KINDS {
            assert!(count(&|of| of.kind == kind) >= 20, "{kind}");
        }
        for shape in ["ellipsoid", "polyhedron", "mixture"] {
            assert!(count(&|of| of.request["mix"]["shape"]["type"] == shape) >= 3, "{shape}");
        }
        for specimen in ["box", "cylinder"] {
            assert!(count(&|of| of.request["specimen"]["type"] == specimen) >= 20, "{specimen}");
        }
        assert!(count(&|of| of.request["specimen"]["boundary"] == "periodic") >= 20);
        assert!(count(&|of| of.maximizes.is_some()) >= 8);
    }

    #[test]
    fn drawn_requests_are_valid_and_of_many_sizes() {
        let mut grains = Vec::new();
        for number in 0..200 {
            let drawn = draw(3, number, 1e5);
            let method = if drawn.is_random && drawn.maximizes.is_none() { "rsa" } else { "auto" };
            let request = PackingRequest::from_json(&drawn.at(0.02, method), 1)
                .unwrap_or_else(|faults| panic!("{number}: {faults:?}"));
            // Some long grains do not fit; the benchmark leaves them out.
            let Ok(plan) = Plan::new(&request, &Limits::default()) else { continue };
            grains.push(plan.grains * if drawn.of_list.is_some() { 1.0 } else { TYPICAL / 0.02 });
        }
        grains.sort_by(f64::total_cmp);
        let n = grains.len();
        assert!(n > 190, "{n} of 200 have a plan");
        assert!((500.0..5000.0).contains(&grains[n / 2]), "{}", grains[n / 2]);
        assert!(grains[n - 11] <= 25_000.0 && grains[0] >= 1.0 && grains[n - 1] <= 150_000.0, "{grains:?}");
    }
}
