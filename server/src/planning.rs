//! Plans of requests, and what several requests have in common: their plans, and the templates of angular grains.
//!
//! The templates are what a plan of polyhedra costs; they are kept by the engine's [`TemplateCache`], which the runs of
//! the process use as well. A plan follows from everything but the seed, and is kept by the digest of this. A kept plan
//! is equal to a new one in every bit. The cache is bounded in bytes; the least recently used entries leave first.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use packstone_engine::request::PackingRequest;
use packstone_engine::request::decode::FieldError;
use packstone_engine::samples::ShapeSamples;
use packstone_engine::{Limits, Plan, PlanError, TemplateCache};
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

/// Most bytes of the kept plans.
const PLAN_BYTES: usize = 8 << 20;
/// Bytes of a plan beside its classes and texts.
const BYTES_PER_PLAN: usize = 600;

/// Whether a plan proposes what else the specimen could hold, which takes a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Proposal {
    Made,
    None,
}

type Key = [u8; 32];

/// Plans requests, with the plans and templates of earlier requests at hand.
#[derive(Debug)]
pub(crate) struct Planner {
    plans: Mutex<Cache<Arc<Plan>>>,
    templates: Arc<TemplateCache>,
    /// Speed of the processor whose times plans tell.
    speed: f64,
}

impl Default for Planner {
    fn default() -> Self {
        Self::new(Arc::default(), 1.0)
    }
}

impl Planner {
    /// A planner with the templates that others use, of times on a processor of this speed over that of a core of
    /// 2 GHz.
    pub(crate) fn new(templates: Arc<TemplateCache>, speed: f64) -> Self {
        Self { plans: Mutex::new(Cache::new(PLAN_BYTES)), templates, speed }
    }

    /// Grains of the shape in an object.
    ///
    /// # Errors
    /// The faults of the object.
    pub(crate) fn samples(&self, shape: &Value) -> Result<ShapeSamples, Vec<FieldError>> {
        ShapeSamples::of_json(shape, &self.templates)
    }

    /// The plan of a request.
    ///
    /// # Errors
    /// Those of [`TemplateCache::plan`].
    pub(crate) fn plan(
        &self,
        request: &PackingRequest,
        limits: &Limits,
        proposal: Proposal,
    ) -> Result<Plan, PlanError> {
        let key = plan_key(request, limits, proposal);
        if let Some(plan) = key.and_then(|key| locked(&self.plans).get(&key)) {
            return Ok(Plan::clone(&plan));
        }
        let mut plan = self.templates.plan(request, limits)?.at_speed(request, self.speed);
        if proposal == Proposal::Made {
            plan = plan.with_proposal(&self.with_templates(request));
        }
        if let Some(key) = key {
            let bytes = plan_bytes(&plan);
            locked(&self.plans).put(key, Arc::new(plan.clone()), bytes);
        }
        Ok(plan)
    }

    /// Whether the plan of a request is kept.
    pub(crate) fn has_plan(&self, request: &PackingRequest, limits: &Limits, proposal: Proposal) -> bool {
        plan_key(request, limits, proposal).is_some_and(|key| locked(&self.plans).get(&key).is_some())
    }

    /// The request with the templates that are kept. Those that it draws are kept: its original holds none.
    pub(crate) fn with_templates<'a>(&self, request: &'a PackingRequest) -> Cow<'a, PackingRequest> {
        self.templates.attached(request)
    }
}

fn locked<V>(cache: &Mutex<Cache<V>>) -> MutexGuard<'_, Cache<V>> {
    cache.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a plan follows from; none for spheres, whose plans take less time than they take room.
fn plan_key(request: &PackingRequest, limits: &Limits, proposal: Proposal) -> Option<Key> {
    if !request.mix.has_shapes() {
        return None;
    }
    // Limits are obeyed whatever becomes of a run that meets one, and materials are for models of the packing.
    let PackingRequest { seed: _, specimen, mix, distance, method, segregation, on_limit: _, materials: _ } =
        request;
    key(&(specimen, mix, distance, method, segregation), &format!("{limits:?} {proposal:?}"))
}

fn key(content: &impl Serialize, more: &str) -> Option<Key> {
    let mut digest = Sha256::new();
    digest.update(serde_json::to_vec(content).ok()?);
    digest.update(more);
    Some(digest.finalize().into())
}

fn plan_bytes(plan: &Plan) -> usize {
    let texts = plan.warnings.iter().chain(&plan.extrapolations).map(String::len).sum::<usize>();
    BYTES_PER_PLAN + size_of_val(plan.classes.as_slice()) + texts
}

/// Values by key, of which the least recently used are removed once all take more than a number of bytes.
#[derive(Debug)]
struct Cache<V> {
    entries: HashMap<Key, Entry<V>>,
    bytes: usize,
    most_bytes: usize,
    /// Number of the last use.
    uses: u64,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    bytes: usize,
    used: u64,
}

impl<V: Clone> Cache<V> {
    fn new(most_bytes: usize) -> Self {
        Self { entries: HashMap::new(), bytes: 0, most_bytes, uses: 0 }
    }

    fn get(&mut self, key: &Key) -> Option<V> {
        self.uses += 1;
        let entry = self.entries.get_mut(key)?;
        entry.used = self.uses;
        Some(entry.value.clone())
    }

    /// Keeps a value, unless it is larger than all may be.
    fn put(&mut self, key: Key, value: V, bytes: usize) {
        if bytes > self.most_bytes {
            return;
        }
        self.uses += 1;
        if let Some(before) = self.entries.insert(key, Entry { value, bytes, used: self.uses }) {
            self.bytes -= before.bytes;
        }
        self.bytes += bytes;
        if self.bytes > self.most_bytes {
            self.remove_least_used();
        }
    }

    /// Makes room for some entries at once, so that not every new entry looks at all others.
    fn remove_least_used(&mut self) {
        let mut by_use: Vec<(u64, Key)> =
            self.entries.iter().map(|(key, entry)| (entry.used, *key)).collect();
        by_use.sort_unstable();
        // The newest stays.
        by_use.pop();
        for (_, key) in by_use {
            if self.bytes <= self.most_bytes - self.most_bytes / 8 {
                break;
            }
            if let Some(entry) = self.entries.remove(&key) {
                self.bytes -= entry.bytes;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn request(shape: &Value, volume_fraction: f64, seed: u64) -> PackingRequest {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"aggregates": [
                {"share": 0.5, "grading": {"type": "standard", "name": "A16"}, "shape": shape},
                {"share": 0.5, "grading": {"type": "standard", "name": "B16"},
                    "shapes": [{"above_mm": 8, "shape": shape}, {"above_mm": 0, "shape": {"type": "mixture", "of": [
                        {"share": 0.5, "shape": {"type": "sphere"}}, {"share": 0.5, "shape": shape}]}}]}],
                "d_min_mm": 4, "volume_fraction": volume_fraction},
            "distance": {"type": "constant", "gap_mm": 0.1},
        });
        PackingRequest::from_json(&request, seed).unwrap()
    }

    fn polyhedron(templates: u32, seed: u64) -> Value {
        json!({"type": "polyhedron", "template_count": templates, "template_seed": seed, "faces": 12,
            "ratios": {"type": "independent", "elongation": {"type": "uniform", "min": 0.6, "max": 0.9},
                "flatness": {"type": "uniform", "min": 0.6, "max": 0.9}}})
    }

    #[test]
    fn kept_plans_and_templates_give_the_plans_of_new_ones() {
        let (planner, limits) = (Planner::default(), Limits::default());
        for seed in [1, 2] {
            for volume_fraction in [0.3, 0.31, 0.3] {
                for proposal in [Proposal::None, Proposal::Made] {
                    let request = request(&polyhedron(3, 7), volume_fraction, seed);
                    let alone = Plan::new(&request, &limits).unwrap();
                    let alone =
                        if proposal == Proposal::Made { alone.with_proposal(&request) } else { alone };
                    let planned = planner.plan(&request, &limits, proposal).unwrap();
                    assert_eq!(planned, alone);
                    assert_eq!(
                        serde_json::to_string(&planned).unwrap(),
                        serde_json::to_string(&alone).unwrap(),
                        "every digit"
                    );
                    assert!(planner.has_plan(&request, &limits, proposal));
                }
            }
        }
        // Two fractions, each with and without a proposal; one shape, though the mix names it three times.
        assert_eq!(locked(&planner.plans).entries.len(), 4);
        assert_eq!(planner.templates.templates(), 3);
    }

    #[test]
    fn other_limits_and_other_shapes_have_other_plans() {
        let (planner, limits) = (Planner::default(), Limits::default());
        let request_of = |shape: &Value| request(shape, 0.3, 1);
        planner.plan(&request_of(&polyhedron(2, 0)), &limits, Proposal::None).unwrap();
        let narrow = Limits { max_grains: 1, ..limits };
        assert!(planner.plan(&request_of(&polyhedron(2, 0)), &narrow, Proposal::None).is_err());
        for shape in [polyhedron(2, 1), polyhedron(3, 0)] {
            assert!(!planner.has_plan(&request_of(&shape), &limits, Proposal::None));
            assert_eq!(*planner.with_templates(&request_of(&shape)), request_of(&shape));
        }
    }

    #[test]
    fn a_cache_holds_no_more_than_it_may_and_drops_what_was_used_least() {
        let mut cache = Cache::new(1000);
        let key = |i: usize| -> Key { Sha256::digest(i.to_be_bytes()).into() };
        for i in 0..1000 {
            cache.put(key(i), i, 100);
            assert!(cache.bytes <= 1000 && cache.bytes == 100 * cache.entries.len());
            assert_eq!(cache.get(&key(0)), Some(0), "it is used all the time");
            assert_eq!(cache.get(&key(i)), Some(i));
        }
        cache.put(key(0), 7, 300);
        assert_eq!((cache.get(&key(0)), cache.bytes <= 1000), (Some(7), true));
        cache.put(key(2000), 1, 1001);
        assert_eq!(cache.get(&key(2000)), None);
    }
}
