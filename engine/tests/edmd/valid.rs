//! What a packing is held against: a check of its own, all pairs and images one by one, that shares
//! nothing with the engine's; and jobs to pack.

use std::sync::atomic::{AtomicU64, Ordering};

use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::{Control, Limits, PackError, Packing, PackingRequest, Progress, pack};
use serde_json::{Value, json};

pub(super) fn request(value: &Value, seed: u64) -> PackingRequest {
    PackingRequest::from_json(value, seed).unwrap()
}

/// Loses patience after so many questions whether to stop, so that a run which never ends fails its
/// test instead of hanging it.
pub(super) struct Patience {
    questions: AtomicU64,
    most: u64,
}

impl Patience {
    pub(super) fn new(most: u64) -> Self {
        Self { questions: AtomicU64::new(0), most }
    }
}

impl Control for Patience {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        self.questions.fetch_add(1, Ordering::Relaxed) >= self.most
    }
}

/// Clear distance that a rule of the request asks of two grains, and of one and a wall. `maximized` is
/// what was found to be the largest distance.
fn rule(distance: &Distance, maximized: f64, d_i: f64, d_j: f64) -> (f64, f64) {
    let (gap, wall) = match *distance {
        Distance::None { wall_gap_mm } => (0.0, wall_gap_mm),
        Distance::Constant { gap_mm: mm, wall_gap_mm } => (mm, wall_gap_mm),
        Distance::Proportional { factor, wall_gap_mm } => (factor * (d_i + d_j) / 2.0, wall_gap_mm),
        Distance::SmallerDiameter { factor, wall_gap_mm } => (factor * d_i.min(d_j), wall_gap_mm),
        Distance::Maximize { wall_gap_mm } => (maximized, wall_gap_mm),
    };
    (gap, wall.unwrap_or(gap / 2.0))
}

/// Says what is wrong with a packing: every grain against every other in all 125 images near by, against
/// its own images and against every wall.
pub(super) fn fault(packing: &Packing, request: &PackingRequest) -> Option<String> {
    let spheres = packing.spheres().unwrap();
    let maximized = packing.report.summary.distance_mm.unwrap_or(0.0);
    let periodic = matches!(request.specimen, Specimen::Box { boundary: Boundary::Periodic, .. });
    let size = match request.specimen {
        Specimen::Box { size_mm, .. } => size_mm,
        Specimen::Cylinder { diameter_mm, height_mm } => [diameter_mm, diameter_mm, height_mm],
    };
    let images: Vec<[f64; 3]> = if periodic {
        let of = |code: usize, a: usize| (code as f64 - 2.0) * size[a];
        (0..125).map(|code| [of(code / 25, 0), of(code / 5 % 5, 1), of(code % 5, 2)]).collect()
    } else {
        vec![[0.0; 3]]
    };
    for i in 0..spheres.len() {
        let (p, d_i) = (spheres.center(i), spheres.d_mm[i]);
        for j in i..spheres.len() {
            let (q, d_j) = (spheres.center(j), spheres.d_mm[j]);
            let (gap, _) = rule(&request.distance, maximized, d_i, d_j);
            for shift in images.iter().filter(|shift| i != j || **shift != [0.0; 3]) {
                let way: [f64; 3] = std::array::from_fn(|a| q[a] + shift[a] - p[a]);
                let clear = way.iter().map(|x| x * x).sum::<f64>().sqrt() - (d_i + d_j) / 2.0;
                if clear.is_nan() || clear < gap {
                    return Some(format!(
                        "{i} and {j}, shifted by {shift:?}: {clear:e} instead of {gap:e} mm"
                    ));
                }
            }
        }
        // The wall asks of a grain half of what its own kind does.
        let (_, wall) = rule(&request.distance, maximized, d_i, d_i);
        let walls: Vec<f64> = match request.specimen {
            // No walls, but every grain is named by its image inside.
            _ if periodic => {
                (0..3).flat_map(|a| [p[a] + d_i / 2.0 + wall, size[a] - p[a] + d_i / 2.0 + wall]).collect()
            }
            Specimen::Box { .. } => (0..3).flat_map(|a| [p[a], size[a] - p[a]]).collect(),
            Specimen::Cylinder { diameter_mm: d, height_mm } => {
                vec![d / 2.0 - (p[0] - d / 2.0).hypot(p[1] - d / 2.0), p[2], height_mm - p[2]]
            }
        };
        for from_wall in walls {
            let clear = from_wall - d_i / 2.0;
            // As a distance of the centre: a grain that fits exactly is one that fits.
            if clear.is_nan() || from_wall < d_i / 2.0 + wall {
                return Some(format!("{i} to a wall: {clear:e} instead of {wall:e} mm"));
            }
        }
    }
    None
}

/// A job on its own specimen, with a limit of events.
pub(super) fn job(specimen: &Value, mix: &Value, distance: &Value, method: &Value) -> Value {
    let mut method = method.clone();
    method["type"] = json!("edmd");
    if method["stop"].is_null() {
        method["stop"] = json!({"events": 20_000});
    }
    json!({"specimen": specimen, "mix": mix, "distance": distance, "method": method})
}

pub(super) fn cube(edge: f64, boundary: &str) -> Value {
    json!({"type": "box", "size_mm": [edge, edge, edge], "boundary": boundary})
}

pub(super) fn diameters(mm: &[f64]) -> Value {
    json!({"grading": {"type": "diameters", "diameters_mm": mm}})
}

/// Packs with the patience of a run that ends, and checks what comes out.
pub(super) fn grown(value: &Value, seed: u64) -> Result<Packing, PackError> {
    let request = request(value, seed);
    let packing = pack(&request, &Limits::default(), &Patience::new(100_000))?;
    assert_eq!(fault(&packing, &request), None);
    Ok(packing)
}
