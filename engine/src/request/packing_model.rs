//! How the aggregate of a mix is taken to be compacted, for its figures.

use serde::Serialize;

use super::decode::{Bound, Object};

const COMPACTION_INDEX: Bound = Bound::closed(0.1, 1.0e3, "");
const RESIDUAL_PACKING_DENSITY: Bound = Bound::closed(0.1, 0.95, "");

/// Parameters of de Larrard's compressible packing model (1999), by which the figures of a mix state its packing
/// density. The packing does not depend on them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct PackingModel {
    /// Compaction index `K`: 4.1 poured, 4.5 stick rodding, 4.75 vibration, 9 vibration and compaction.
    #[cfg_attr(feature = "openapi", schema(default = 9.0, required = false, minimum = 0.1, maximum = 1000))]
    pub compaction_index: f64,
    /// Residual packing density `beta`: the packing density of grains of one size at an index without bound.
    #[cfg_attr(feature = "openapi", schema(default = 0.64, required = false, minimum = 0.1, maximum = 0.95))]
    pub residual_packing_density: f64,
}

impl Default for PackingModel {
    fn default() -> Self {
        Self { compaction_index: 9.0, residual_packing_density: 0.64 }
    }
}

impl PackingModel {
    /// Whether it is the default one.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Reads the field of a mix or a blend that has the parameters; the default ones where it is absent.
    ///
    /// `None` means that faults were reported.
    pub(super) fn read_field(holder: &mut Object<'_>) -> Option<Self> {
        let usual = Self::default();
        let Some(at) = holder.optional("packing_model") else { return Some(usual) };
        let mut object = at.object()?;
        let mut number = |name, bound, usual| match object.optional(name) {
            Some(at) => at.number(bound),
            None => Some(usual),
        };
        let compaction_index = number("compaction_index", COMPACTION_INDEX, usual.compaction_index);
        let residual_packing_density =
            number("residual_packing_density", RESIDUAL_PACKING_DENSITY, usual.residual_packing_density);
        object.finish();
        Some(Self {
            compaction_index: compaction_index?,
            residual_packing_density: residual_packing_density?,
        })
    }
}
