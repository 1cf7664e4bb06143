//! Templates of angular grains that were drawn and measured, for all runs of a process.
//!
//! Drawing a template, its sieve size, and the proof of that size ([`crate::check::SieveSizes`]) take milliseconds, and
//! follow from the shape of a request alone. A service, a study and a Python process own one cache and hand it to each
//! run; results do not depend on what it holds.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use crate::check::{Fault, SieveSizes};
use crate::error::PlanError;
use crate::mix::{GradedMix, ShapeSampler};
use crate::plan::{Limits, Plan};
use crate::request::{FieldError, PackingRequest, PlainShape};
use crate::shape::Polyhedron;
use crate::shape::polyhedron::DrawnTemplates;

/// Most templates that are kept: some 48 MB of those with the most faces.
const MOST_TEMPLATES: usize = 4096;

/// Templates with what was found of them, for further runs. May be shared between threads.
///
/// ```
/// use packstone_engine::{Limits, PackingRequest, TemplateCache, Unattended, pack_or_resume};
/// use serde_json::json;
///
/// let cache = TemplateCache::default();
/// let request = PackingRequest::from_json(&json!({
///     "specimen": {"type": "box", "size_mm": [40, 40, 40]},
///     "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2,
///             "shape": {"type": "polyhedron", "template_count": 2}, "allow_coarse": true},
/// }), 1).unwrap();
/// let first = pack_or_resume(&request, &Limits::default(), &cache, None, &Unattended)?;
/// let second = pack_or_resume(&request, &Limits::default(), &cache, None, &Unattended)?;
/// assert_eq!(cache.templates(), 2);
/// assert_eq!(first.grains, second.grains);
/// # Ok::<(), packstone_engine::PackError>(())
/// ```
#[derive(Debug, Default)]
pub struct TemplateCache {
    drawn: Mutex<Drawn>,
    sieve_sizes: SieveSizes,
}

/// Templates by the JSON of the shape that they follow from.
#[derive(Debug, Default)]
struct Drawn {
    by_shape: BTreeMap<String, Entry>,
    /// Number of the last use.
    uses: u64,
}

#[derive(Debug)]
struct Entry {
    templates: DrawnTemplates,
    used: u64,
}

impl TemplateCache {
    /// The request with the templates of its shapes: those that are kept, and those that a plan of it will draw, which
    /// are kept from then on.
    #[must_use]
    pub fn attached<'a>(&self, request: &'a PackingRequest) -> Cow<'a, PackingRequest> {
        if !request.mix.grain_kind().has_templates() {
            return Cow::Borrowed(request);
        }
        let mut request = request.clone();
        let mut kept = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        for shape in request.mix.polyhedra_mut() {
            let Some(key) = key_of(shape) else { continue };
            if let PlainShape::Polyhedron { drawn, .. } = shape {
                *drawn = kept.of(key);
            }
        }
        kept.remove_least_used();
        Cow::Owned(request)
    }

    /// The templates of the mix of a request, in the order in which its grains refer to them.
    #[must_use]
    pub fn of_request(&self, request: &PackingRequest) -> Vec<Polyhedron> {
        let request = self.attached(request);
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        mix.shapes.iter().flat_map(|shapes| shapes.templates().cloned()).collect()
    }

    /// Plans a request, after the sieve sizes of its templates are proven.
    ///
    /// # Errors
    /// Those of [`Plan::new`]; [`PlanError::Invalid`] where the least square opening that was found for a template is
    /// not the least.
    pub fn plan(&self, request: &PackingRequest, limits: &Limits) -> Result<Plan, PlanError> {
        self.plan_attached(&self.attached(request), limits)
    }

    /// Plans a request that has the templates of the cache.
    pub(crate) fn plan_attached(&self, request: &PackingRequest, limits: &Limits) -> Result<Plan, PlanError> {
        let plan = Plan::new(request, limits)?;
        self.prove(request)?;
        Ok(plan)
    }

    /// Proves the sieve sizes of the templates of a request.
    fn prove(&self, request: &PackingRequest) -> Result<(), PlanError> {
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        let templates = mix.shapes.iter().flat_map(ShapeSampler::templates);
        for (number, template) in templates.enumerate() {
            if let Err(fault) = self.sieve_sizes.proven(template) {
                return Err(refused(number, &fault));
            }
        }
        Ok(())
    }

    /// What the check has proven of templates.
    pub(crate) fn sieve_sizes(&self) -> &SieveSizes {
        &self.sieve_sizes
    }

    /// Number of templates that are kept.
    #[must_use]
    pub fn templates(&self) -> usize {
        let drawn = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        drawn.by_shape.values().map(|entry| entry.templates.bodies().len()).sum()
    }
}

/// The refusal of a request, one of whose templates has another sieve size than was found.
fn refused(number: usize, fault: &Fault) -> PlanError {
    let detail =
        format!("template {number} of the mix cannot be used: {fault}; choose another template_seed");
    PlanError::Invalid(vec![FieldError::new("/mix", detail)])
}

/// What the templates of a shape follow from.
fn key_of(shape: &PlainShape) -> Option<String> {
    serde_json::to_string(shape).ok()
}

impl Drawn {
    /// The templates of a shape, which may not be drawn yet.
    fn of(&mut self, key: String) -> DrawnTemplates {
        self.uses += 1;
        let used = self.uses;
        let entry =
            self.by_shape.entry(key).or_insert_with(|| Entry { templates: DrawnTemplates::default(), used });
        entry.used = used;
        entry.templates.clone()
    }

    /// Keeps as many templates as there may be. Shapes whose templates are not drawn yet count as one.
    fn remove_least_used(&mut self) {
        let number = |entry: &Entry| entry.templates.bodies().len().max(1);
        let mut kept: usize = self.by_shape.values().map(number).sum();
        while kept > MOST_TEMPLATES && self.by_shape.len() > 1 {
            let least = self.by_shape.iter().min_by_key(|(_, entry)| entry.used).map(|(key, _)| key.clone());
            let Some(removed) = least.and_then(|key| self.by_shape.remove(&key)) else { break };
            kept -= number(&removed);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::Unattended;
    use crate::run::{pack, pack_or_resume};

    fn request(template_seed: u64, seed: u64) -> PackingRequest {
        let shape = json!({"type": "polyhedron", "template_count": 3, "template_seed": template_seed});
        let value = json!({"specimen": {"type": "box", "size_mm": [50, 50, 50]}, "mix": {
            "grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2, "shape": shape}});
        PackingRequest::from_json(&value, seed).unwrap()
    }

    /// Counts the searches instead of the time that they take.
    #[test]
    fn templates_are_searched_once_for_all_runs() {
        let (cache, limits) = (TemplateCache::default(), Limits::default());
        for seed in 0..3 {
            let packed = pack_or_resume(&request(1, seed), &limits, &cache, None, &Unattended).unwrap();
            assert_eq!(packed.grains, pack(&request(1, seed), &limits, &Unattended).unwrap().grains);
            assert_eq!((cache.templates(), cache.sieve_sizes.len()), (3, 3), "seed {seed}");
        }
        cache.plan(&request(2, 0), &limits).unwrap();
        assert_eq!((cache.templates(), cache.sieve_sizes.len()), (6, 6));
        // A run without a cache leaves it alone, and the request holds nothing.
        let mut request = request(3, 0);
        cache.plan(&request, &limits).unwrap();
        assert!(request.mix.polyhedra_mut().all(|shape| {
            matches!(shape, PlainShape::Polyhedron { drawn, .. } if drawn.bodies().is_empty())
        }));
    }

    #[test]
    fn the_cache_is_bounded_and_drops_what_was_used_least() {
        let cache = TemplateCache::default();
        let count = |seed: u64| {
            let shape = json!({"type": "polyhedron", "template": "cube", "template_seed": seed});
            let value = json!({"specimen": {"type": "box", "size_mm": [50, 50, 50]}, "mix": {
                "grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2, "shape": shape}});
            let _ = cache.attached(&PackingRequest::from_json(&value, 1).unwrap());
            cache.drawn.lock().unwrap().by_shape.len()
        };
        for seed in 0..MOST_TEMPLATES as u64 + 10 {
            let kept = count(seed);
            assert!(kept <= MOST_TEMPLATES);
            count(0);
        }
        let drawn = cache.drawn.lock().unwrap();
        assert!(drawn.by_shape.keys().any(|key| key.contains("\"template_seed\":0")));
        assert!(!drawn.by_shape.keys().any(|key| key.contains("\"template_seed\":1}")));
    }
}
