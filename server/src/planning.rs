//! Plans of requests, and what several requests have in common: their plans, and the templates of angular grains.
//!
//! The templates are what a plan of polyhedra costs: drawing and measuring 128 of them takes 0.3 s. They follow from
//! the shape alone, and a plan from everything but the seed, so that both are kept by digests of these. A kept plan is
//! equal to a new one in every bit. Both caches are bounded in bytes; the least recently used entries leave first.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use packstone_engine::request::{GrainShape, Mix, PackingRequest, PlainShape, ShapeMixture};
use packstone_engine::shape::polyhedron::DrawnTemplates;
use packstone_engine::{Limits, Plan, PlanError};
use serde::Serialize;
use sha2::{Digest as _, Sha256};

/// Most bytes of the kept plans.
const PLAN_BYTES: usize = 8 << 20;
/// Most bytes of the kept templates: some 30 mixes of 128 templates of 60 faces.
const TEMPLATE_BYTES: usize = 48 << 20;
/// Bytes of a polyhedron beside its vertices and faces, with the room of its allocations.
const BYTES_PER_BODY: usize = 600;
/// The same of a plan, beside its classes and texts.
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
    templates: Mutex<Cache<DrawnTemplates>>,
}

impl Default for Planner {
    fn default() -> Self {
        Self { plans: Mutex::new(Cache::new(PLAN_BYTES)), templates: Mutex::new(Cache::new(TEMPLATE_BYTES)) }
    }
}

impl Planner {
    /// The plan of a request.
    ///
    /// # Errors
    /// Those of [`Plan::new`].
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
        let mut request = self.with_templates(request);
        let planned = Plan::new(&request, limits);
        self.keep_templates(&mut request);
        let mut plan = planned?;
        if proposal == Proposal::Made {
            plan = plan.with_proposal(&request);
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

    /// The request with the templates that are kept. Those that it draws are its own: its original holds none.
    pub(crate) fn with_templates(&self, request: &PackingRequest) -> PackingRequest {
        let mut request = request.clone();
        // Equal shapes of one mix share their templates, too.
        let mut own: HashMap<Key, DrawnTemplates> = HashMap::new();
        for shape in polyhedra(&mut request.mix) {
            let Some(key) = template_key(shape) else { continue };
            let kept = || locked(&self.templates).get(&key).unwrap_or_default();
            if let PlainShape::Polyhedron { drawn, .. } = shape {
                *drawn = own.entry(key).or_insert_with(kept).clone();
            }
        }
        request
    }

    /// Keeps the templates that were drawn for a request of [`with_templates`](Self::with_templates).
    fn keep_templates(&self, request: &mut PackingRequest) {
        for shape in polyhedra(&mut request.mix) {
            let PlainShape::Polyhedron { drawn, .. } = &*shape else { continue };
            let bytes = template_bytes(drawn);
            if let Some(key) = template_key(shape).filter(|_| bytes > 0) {
                locked(&self.templates).put(key, drawn.clone(), bytes);
            }
        }
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
    // Limits are obeyed whatever becomes of a run that meets one.
    let PackingRequest { seed: _, specimen, mix, distance, method, segregation, on_limit: _ } = request;
    key(&(specimen, mix, distance, method, segregation), &format!("{limits:?} {proposal:?}"))
}

fn template_key(shape: &PlainShape) -> Option<Key> {
    key(shape, "")
}

fn key(content: &impl Serialize, more: &str) -> Option<Key> {
    let mut digest = Sha256::new();
    digest.update(serde_json::to_vec(content).ok()?);
    digest.update(more);
    Some(digest.finalize().into())
}

/// The shapes of a mix that have templates.
fn polyhedra(mix: &mut Mix) -> impl Iterator<Item = &mut PlainShape> {
    let of_aggregates = mix.aggregates.iter_mut().flat_map(|aggregate| {
        aggregate.shape.iter_mut().chain(aggregate.shapes.iter_mut().map(|class| &mut class.shape))
    });
    let of_all = mix.shape.iter_mut().chain(mix.shapes.iter_mut().map(|class| &mut class.shape));
    of_all
        .chain(of_aggregates)
        .flat_map(plain_shapes)
        .filter(|shape| matches!(shape, PlainShape::Polyhedron { .. }))
}

fn plain_shapes(shape: &mut GrainShape) -> Vec<&mut PlainShape> {
    match shape {
        GrainShape::Plain(shape) => vec![shape],
        GrainShape::Mixture(ShapeMixture::Mixture { of }) => {
            of.iter_mut().map(|part| &mut part.shape).collect()
        }
    }
}

/// About what templates take in memory; 0 where none were drawn.
fn template_bytes(templates: &DrawnTemplates) -> usize {
    let of_faces = |faces: &[Vec<u32>]| {
        faces.iter().map(|face| size_of::<Vec<u32>>() + 16 + 4 * face.len()).sum::<usize>()
    };
    // Vertices are stored twice: as they are, and in the principal axes.
    let of_body = |body: &packstone_engine::shape::Polyhedron| {
        BYTES_PER_BODY + 2 * size_of_val(body.vertices()) + of_faces(body.faces())
    };
    templates.bodies().iter().map(of_body).sum()
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
        assert_eq!(locked(&planner.templates).entries.len(), 1);
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
            let drawn = planner.with_templates(&request_of(&shape));
            assert_eq!(drawn, request_of(&shape));
            assert!(polyhedra(&mut drawn.mix.clone()).all(|shape| {
                matches!(shape, PlainShape::Polyhedron { drawn, .. } if drawn.bodies().is_empty())
            }));
        }
    }

    #[test]
    fn a_request_does_not_hold_the_templates_of_its_plan() {
        let (planner, limits) = (Planner::default(), Limits::default());
        let mut request = request(&polyhedron(2, 0), 0.3, 1);
        planner.plan(&request, &limits, Proposal::None).unwrap();
        let held = |shape: &mut PlainShape| match shape {
            PlainShape::Polyhedron { drawn, .. } => template_bytes(drawn),
            _ => 0,
        };
        assert_eq!(polyhedra(&mut request.mix).map(held).sum::<usize>(), 0);
        let mut shared = planner.with_templates(&request);
        let bytes: Vec<usize> = polyhedra(&mut shared.mix).map(held).collect();
        assert_eq!(bytes.len(), 3);
        assert!(bytes.iter().all(|bytes| (2 * BYTES_PER_BODY..50_000).contains(bytes)), "{bytes:?}");
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
