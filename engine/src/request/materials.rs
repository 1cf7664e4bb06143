//! The materials of the phases: what models and properties of a finished packing are computed with.
//!
//! They decide nothing of the packing. A phase is the matrix, all aggregates, or one aggregate by its name. Exports
//! that need materials take them from the request, or from an option of their own, which wins.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::decode::{At, Bound, FieldError, Object, pointer_segment};
use super::{Aggregate, MAX_AGGREGATES};

/// Name of the phase between the grains.
pub const MATRIX: &str = "matrix";
/// Name of the phase of all grains that have no entry by the name of their aggregate.
pub const AGGREGATE: &str = "aggregate";
/// Name of the option of exports that holds materials, and of the field of a request.
pub const OPTION: &str = "materials";
/// Materials of a mortar with stiff grains, as messages show them to users who gave none.
pub const EXAMPLE: &str = r#"{"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "density_kg_m3": 2200, "conductivity_w_m_k": 1.8, "expansion_1_k": 1.1e-5}, "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2, "density_kg_m3": 2700, "conductivity_w_m_k": 3, "expansion_1_k": 8e-6}}"#;

const YOUNGS_MODULUS: Bound = Bound::closed(0.0, 1.0e6, "GPa");
const POISSONS_RATIO: Bound = Bound::open(-1.0, 0.5, "");
const DENSITY: Bound = Bound::positive(1.0e6, "kg/m3");
const CONDUCTIVITY: Bound = Bound::closed(0.0, 1.0e6, "W/(m K)");
// JSON has no other numbers.
const EXPANSION: Bound = Bound::closed(f64::MIN, f64::MAX, "1/K");
const DIFFUSIVITY: Bound = Bound::closed(0.0, 1.0e6, "m2/s");

/// An isotropic linear material. Each export says which of these it needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Material {
    /// Young's modulus in GPa; 0 is a pore.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub youngs_modulus_gpa: Option<f64>,
    /// Poisson's ratio.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = -1, exclusive_maximum = 0.5)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poissons_ratio: Option<f64>,
    /// Density in kg/m³.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density_kg_m3: Option<f64>,
    /// Thermal conductivity in W/(m K).
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conductivity_w_m_k: Option<f64>,
    /// Coefficient of linear thermal expansion in 1/K.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expansion_1_k: Option<f64>,
    /// Diffusivity in m²/s.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffusivity_m2_s: Option<f64>,
}

impl Material {
    /// Whether it is a pore, which has no stiffness.
    #[must_use]
    pub fn is_pore(&self) -> bool {
        self.youngs_modulus_gpa == Some(0.0)
    }

    fn read(at: &At<'_>) -> Option<Self> {
        let mut object = at.object()?;
        let mut number = |name, bound| object.optional(name).and_then(|at| at.number(bound));
        let material = Self {
            youngs_modulus_gpa: number("youngs_modulus_gpa", YOUNGS_MODULUS),
            poissons_ratio: number("poissons_ratio", POISSONS_RATIO),
            density_kg_m3: number("density_kg_m3", DENSITY),
            conductivity_w_m_k: number("conductivity_w_m_k", CONDUCTIVITY),
            expansion_1_k: number("expansion_1_k", EXPANSION),
            diffusivity_m2_s: number("diffusivity_m2_s", DIFFUSIVITY),
        };
        if at.value().as_object().is_some_and(serde_json::Map::is_empty) {
            at.fault(format!("has no property: must have at least one of {}", object.known().join(", ")));
            return None;
        }
        object.finish();
        Some(material)
    }
}

/// The material of each phase by its name: `matrix`, `aggregate` for all aggregates, or the name of one aggregate.
///
/// An entry by the name of an aggregate stands alone: what it leaves out does not come from `aggregate`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(examples(example)))]
#[serde(transparent)]
pub struct Materials(BTreeMap<String, Material>);

#[cfg(feature = "openapi")]
fn example() -> serde_json::Value {
    serde_json::from_str(EXAMPLE).unwrap_or_default()
}

impl FromIterator<(String, Material)> for Materials {
    fn from_iter<T: IntoIterator<Item = (String, Material)>>(entries: T) -> Self {
        Self(entries.into_iter().collect())
    }
}

impl Materials {
    /// The entries with their phases, in the order of the names.
    pub fn entries(&self) -> impl ExactSizeIterator<Item = (&str, &Material)> {
        self.0.iter().map(|(phase, material)| (phase.as_str(), material))
    }

    /// The material between the grains.
    #[must_use]
    pub fn of_matrix(&self) -> Option<&Material> {
        self.0.get(MATRIX)
    }

    /// The material of the grains of an aggregate: the entry by its name, else that of all aggregates.
    #[must_use]
    pub fn of_aggregate(&self, name: Option<&str>) -> Option<&Material> {
        // These two names mean the same whatever aggregates are called.
        let own = name.filter(|name| ![MATRIX, AGGREGATE].contains(name)).and_then(|name| self.0.get(name));
        own.or_else(|| self.0.get(AGGREGATE))
    }

    /// CRC-32 of its JSON form as eight hexadecimal digits: it tells files apart in whose names it stands.
    #[must_use]
    pub fn digits(&self) -> String {
        format!("{:08x}", crc32fast::hash(&serde_json::to_vec(self).unwrap_or_default()))
    }

    /// The phases that a mix with aggregates of these names does not have, each as a fault below `pointer`.
    #[must_use]
    pub fn unknown_phases<'a>(
        &self,
        pointer: &str,
        aggregates: impl IntoIterator<Item = Option<&'a str>>,
    ) -> Vec<FieldError> {
        let named = aggregates.into_iter().flatten().filter(|name| ![MATRIX, AGGREGATE].contains(name));
        let phases: Vec<&str> = [MATRIX, AGGREGATE].into_iter().chain(named).collect();
        let unknown = self.0.keys().filter(|phase| !phases.contains(&phase.as_str()));
        let quoted = || phases.iter().map(|phase| format!("{phase:?}")).collect::<Vec<_>>().join(", ");
        unknown
            .map(|phase| {
                let place = format!("{pointer}/{}", pointer_segment(phase));
                FieldError::new(place, format!("is no phase of the mix: must be one of {}", quoted()))
            })
            .collect()
    }

    /// Reads the materials that lie at a place; [`unknown_phases`](Self::unknown_phases) judges the names.
    ///
    /// `None` means that faults were reported; the reverse does not hold, so ask the faults.
    pub fn read(at: &At<'_>) -> Option<Self> {
        let members = at.members(MAX_AGGREGATES + 2)?;
        if members.is_empty() {
            at.fault(format!("has no phase: must have at least {MATRIX:?} or {AGGREGATE:?}"));
            return None;
        }
        let read: Vec<Option<(String, Material)>> = members
            .iter()
            .map(|(phase, at)| Material::read(at).map(|material| ((*phase).to_owned(), material)))
            .collect();
        read.into_iter().collect()
    }

    /// Reads the option `materials` of an export. The names of aggregates are judged when there is a mix.
    ///
    /// `None` where it is absent, and where faults were reported.
    pub fn read_option(object: &mut Object<'_>) -> Option<Self> {
        object.optional(OPTION).and_then(|at| Self::read(&at))
    }

    /// Those of a request, with the phases of its mix.
    pub(super) fn read_field(object: &mut Object<'_>, aggregates: Option<&[Aggregate]>) -> Option<Self> {
        let at = object.optional(OPTION)?;
        let read = Self::read(&at)?;
        if let Some(aggregates) = aggregates {
            let names = aggregates.iter().map(|aggregate| aggregate.name.as_deref());
            for fault in read.unknown_phases("", names) {
                at.fault_below(&fault.pointer, fault.detail);
            }
        }
        Some(read)
    }

    /// Those of a request that was accepted before, where it has any.
    #[must_use]
    pub fn of_request(request: &serde_json::Value) -> Option<Self> {
        let faults = super::decode::Faults::default();
        request.get(OPTION).and_then(|value| Self::read(&At::root(value, &faults)))
    }
}

#[cfg(test)]
#[path = "materials_tests.rs"]
mod tests;
