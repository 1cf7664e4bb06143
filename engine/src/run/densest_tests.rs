//! Packings whose volume fraction is as large as possible.

use serde_json::{Value, json};

use super::partial_tests::{least_excess, packed, periodic, request, walls};
use super::{pack, pack_or_resume, verify};
use crate::check::Scope;
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Progress, Unattended};
use crate::packing::{GrainsRef, GrowthEnd};
use crate::plan::{Limits, Plan};
use crate::request::PackingRequest;
use crate::template_cache::TemplateCache;

fn equal() -> Value {
    json!({"grading": {"type": "monodisperse", "diameter_mm": 3}, "volume_fraction": "maximize"})
}

/// The grains keep their distances, the scale is the largest, and the packing is accepted from elsewhere.
fn assert_densest(request: &PackingRequest, gap: f64) -> f64 {
    let packing = packed(request);
    let summary = &packing.report.summary;
    assert!(summary.partial.is_none(), "{summary:?}");
    let excess = least_excess(request, &packing.grains, |_, _| gap, |_| gap / 2.0);
    assert!(excess > -1e-9 && excess < 1e-6, "{excess:e}");
    for scope in [Scope::All, Scope::WithoutPairs] {
        verify(request, &packing.report, &packing.grains, scope, &TemplateCache::default(), &Unattended)
            .unwrap();
    }
    let scale = summary.size_scale.unwrap();
    if request.mix.listed_diameters_mm().is_none() {
        assert!((0.97..=1.03).contains(&scale), "{scale}");
        assert!(summary.volume_fraction_drawn.is_some());
    }
    let plan = Plan::new(request, &Limits::default()).unwrap();
    assert!(plan.success_probability == 1.0 && plan.keeps_checkpoints, "{plan:?}");
    summary.volume_fraction_effective
}

#[test]
fn grains_of_all_kinds_are_packed_until_they_jam() {
    let stop = json!({"type": "edmd", "stop": {"events": 300_000}});
    let reached = assert_densest(&request(&periodic(18.0), &equal(), &json!({"method": stop})), 0.0);
    assert!(reached > 0.62 && reached < 0.7405, "{reached}");

    let fuller = json!({"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
                        "volume_fraction": "maximize"});
    let more = json!({"method": stop, "distance": {"type": "constant", "gap_mm": 0.4}});
    assert_densest(&request(&walls(20.0), &fuller, &more), 0.4);

    // Just after they were compressed from a loose state, grains have a pressure that tells of a jam far too early.
    let a16 = json!({"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2,
                     "volume_fraction": "maximize", "allow_coarse": true});
    let stop = json!({"type": "edmd", "stop": {"events": 1_000_000}});
    let more = json!({"method": stop, "distance": {"type": "constant", "gap_mm": 0.5}});
    let reached = assert_densest(&request(&walls(40.0), &a16, &more), 0.5);
    assert!(reached > 0.53, "{reached}");

    let more = json!({"method": {"type": "monte_carlo", "stop": {"sweeps": 1500}}});
    let reached = assert_densest(&request(&periodic(14.0), &equal(), &more), 0.0);
    assert!(reached > 0.6, "{reached}");

    let mut octahedra = equal();
    octahedra["shape"] = json!({"type": "polyhedron", "template": "octahedron"});
    let more = json!({"method": {"type": "monte_carlo", "stop": {"sweeps": 1500}}});
    let reached = assert_densest(&request(&periodic(14.0), &octahedra, &more), 0.0);
    assert!(reached > 0.55, "{reached}");
}

#[test]
fn grains_that_meet_no_other_than_their_own_images_fill_a_periodic_box() {
    for (diameters, edges) in
        [(json!([10]), [40, 40, 40]), (json!([10]), [40, 50, 60]), (json!([10, 0.01]), [40; 3])]
    {
        let specimen = json!({"type": "box", "size_mm": edges, "boundary": "periodic"});
        let mix = json!({"grading": {"type": "diameters", "diameters_mm": diameters}, "volume_fraction": "maximize"});
        for method in ["growth", "auto"] {
            let packing = packed(&request(&specimen, &mix, &json!({"method": {"type": method}})));
            let largest = GrainsRef::from(&packing.grains).d_mm(0);
            assert!(largest <= 40.0 && largest > 39.9, "{method} {edges:?}: {largest}");
        }
    }
}

#[test]
fn a_list_is_scaled_to_the_densest_packing_whatever_its_sizes() {
    for unit in [0.2, 1.0, 9.0] {
        let diameters: Vec<f64> = (0..60).map(|i| unit * (2.0 + f64::from(i % 5) * 0.3)).collect();
        let mix = json!({"grading": {"type": "diameters", "diameters_mm": diameters},
                         "volume_fraction": "maximize"});
        let more = json!({"method": {"type": "edmd", "stop": {"events": 120_000}},
                          "distance": {"type": "constant", "gap_mm": 0.2}});
        let request = request(&periodic(10.0), &mix, &more);
        let reached = assert_densest(&request, 0.2);
        assert!(reached > 0.4, "{unit}: {reached}");
        let packing = packed(&request);
        let scale = packing.report.summary.size_scale.unwrap();
        let largest = GrainsRef::from(&packing.grains).d_mm(0);
        assert!((largest / (3.2 * unit) / scale - 1.0).abs() < 1e-12);
    }
}

/// Stops a run that has taken so many events, which should have ended before.
struct AtMost(u64);

impl Control for AtMost {
    fn report(&self, progress: &Progress) {
        let events = progress.growth.map_or(0, |growth| growth.events);
        assert!(events < self.0, "{events} events");
    }
    fn should_stop(&self) -> bool {
        false
    }
}

/// Grains that jam beyond the sizes that were drawn are not expanded again and again.
#[test]
fn growth_without_a_limit_ends_whatever_the_scale_is() {
    let list = |d_mm: f64| {
        let grading = json!({"type": "diameters", "diameters_mm": vec![d_mm; 40]});
        json!({"grading": grading, "volume_fraction": "maximize"})
    };
    for (mix, gap_mm) in [(equal(), 0.2), (equal(), 0.0), (list(2.0), 0.2), (list(5.0), 0.2)] {
        let more = json!({"method": {"type": "edmd"}, "distance": {"type": "constant", "gap_mm": gap_mm}});
        let request = request(&periodic(12.0), &mix, &more);
        let packing = pack(&request, &Limits::default(), &AtMost(5_000_000)).unwrap();
        let edmd = packing.report.statistics.edmd.unwrap();
        assert_eq!((edmd.stop, edmd.expansions), (GrowthEnd::Stalled, 0), "{:?}", packing.report.summary);
    }
}

/// Keeps the checkpoint of a cycle, and stops there.
#[derive(Default)]
struct Killer(std::sync::Mutex<(u32, Vec<u8>)>, u32);

impl Control for Killer {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        !self.0.lock().unwrap().1.is_empty()
    }
    fn wants_checkpoint(&self) -> bool {
        let mut state = self.0.lock().unwrap();
        state.0 += 1;
        state.0 == self.1
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        self.0.lock().unwrap().1 = bytes;
    }
}

#[test]
fn a_run_that_is_killed_and_resumed_has_the_same_bits() {
    let more = json!({"method": {"type": "edmd", "stop": {"events": 60_000}}});
    let request = request(&periodic(12.0), &equal(), &more);
    let whole = packed(&request);
    for cycle in [1, 20, 60] {
        let killer = Killer(std::sync::Mutex::default(), cycle);
        pack(&request, &Limits::default(), &killer).unwrap_err();
        let bytes = killer.0.into_inner().unwrap().1;
        let resume = Resume::read_from(&mut bytes.as_slice(), &request).unwrap();
        let resumed = pack_or_resume(
            &request,
            &Limits::default(),
            &TemplateCache::default(),
            Some(resume),
            &Unattended,
        )
        .unwrap();
        assert_eq!(resumed.grains, whole.grains, "{cycle}");
    }
}

#[test]
fn a_volume_that_is_prescribed_otherwise_is_refused_beside_the_largest_one() {
    let refused = |change: &Value| {
        let mut value = json!({"specimen": walls(20.0), "mix": equal()});
        for (pointer, field) in change.as_object().unwrap() {
            let (at, name) = pointer.rsplit_once('/').unwrap();
            value.pointer_mut(at).unwrap()[name] = field.clone();
        }
        let faults = PackingRequest::from_json(&value, 1).unwrap_err();
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults[0].to_string()
    };
    let rsa = refused(&json!({"/method": {"type": "rsa"}}));
    assert!(rsa.starts_with("/mix/volume_fraction: ") && rsa.contains("not \"rsa\""), "{rsa}");
    let distance = refused(&json!({"/distance": {"type": "maximize"}}));
    assert!(distance.starts_with("/mix/volume_fraction: ") && distance.contains("distance"), "{distance}");
    let content = json!({"aggregate_kg_m3": 1800, "aggregate_density_kg_m3": 2650});
    let proportions = refused(&json!({"/mix/proportions": content}));
    assert!(proportions.starts_with("/mix/volume_fraction: "), "{proportions}");
    assert!(proportions.contains("proportions"), "{proportions}");
    let word = refused(&json!({"/mix/volume_fraction": "maximise"}));
    assert!(word.contains("must be one of \"maximize\""), "{word}");
    let list = json!({"type": "diameters", "diameters_mm": [1, 2]});
    let number = refused(&json!({"/mix/grading": list, "/mix/volume_fraction": 0.5}));
    assert!(number.contains("\"maximize\", which scales"), "{number}");
    let limit = refused(&json!({"/on_limit": "retain"}));
    assert!(limit.starts_with("/on_limit: ") && limit.contains("\"fail\", \"keep\""), "{limit}");
}
