//! Facets and triangles of templates, which the estimate of a mesh and the mesh itself share.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::facets::Facets;
use super::template_surface::TemplateFacets;
use crate::elementary::exp;
use crate::geometry::convex::Convex;

/// Steps of edges over diameters that share their facets, for each factor of e.
pub(super) const EDGE_STEPS: f64 = 8.0;

/// Surfaces of templates that were made for a mesh, for further meshes with about the same edges over diameters. May be
/// shared between threads; what is written does not depend on it.
#[derive(Clone, Debug, Default)]
pub struct SurfaceCache(Arc<Mutex<HashMap<Key, Shared>>>);

/// Facets that one thread makes and others wait for.
type Shared = Arc<OnceLock<Arc<TemplateFacets>>>;

/// What the facets of a template follow from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Key {
    /// Vertices, faces and rounding.
    template: Vec<u64>,
    form: FacetsForm,
}

/// Which facets of a template are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct FacetsForm {
    /// Logarithm of the length of edges in [`EDGE_STEPS`].
    pub(super) step: i64,
    /// Level of precision.
    pub(super) level: usize,
    /// Whether no face of the template is left out.
    pub(super) all_faces: bool,
}

impl SurfaceCache {
    /// The facets of a template.
    pub(super) fn facets(&self, template: &Convex, form: FacetsForm) -> Arc<TemplateFacets> {
        let key = Key { template: bits_of(template), form };
        let shared = self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(key).or_default().clone();
        let make = || {
            let edge = exp(form.step as f64 / EDGE_STEPS);
            Arc::new(TemplateFacets::new(Facets::new(template, edge, form.level, form.all_faces), edge))
        };
        shared.get_or_init(make).clone()
    }

    /// Number of facets that are kept.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}

fn bits_of(template: &Convex) -> Vec<u64> {
    let faces = template.faces.iter().flat_map(|corners| {
        std::iter::once(corners.len() as u64).chain(corners.iter().map(|&corner| corner.into()))
    });
    let coordinates = template.vertices.iter().flat_map(|v| v.iter().map(|x| x.to_bits()));
    std::iter::once(template.rounding.to_bits()).chain(coordinates).chain(faces).collect()
}
