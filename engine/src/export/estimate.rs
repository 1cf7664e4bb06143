//! What exports are likely to come out as, of a packing or of its plan.

use serde::{Deserialize, Serialize};

use super::Model;
use crate::plan::{ClassPlan, Plan};
use crate::request::{GrainKind, Materials, PackingRequest, Specimen};

/// What an export is likely to come out as.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ExportEstimate {
    /// Length of the file.
    pub bytes: u64,
    /// The triangles of a surface mesh; absent for everything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub mesh: Option<MeshEstimate>,
    /// Memory and time that properties take; absent for everything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub computation: Option<ComputationEstimate>,
    /// What is likely to go wrong, in words.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl ExportEstimate {
    /// That of a file of which only the length is told.
    pub(super) fn of_bytes(bytes: u64) -> Self {
        Self { bytes, ..Self::default() }
    }
}

/// What a surface mesh is likely to come out as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MeshEstimate {
    /// Triangles, those of the specimen's faces too; true within a factor of 1.5 for a packing.
    pub triangles: u64,
    /// Length of the file.
    pub bytes: u64,
    /// Tetrahedra, where there are any; true within a factor of 1.5 where the triangles are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub tetrahedra: Option<u64>,
    /// Nodes of the tetrahedra.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub nodes: Option<u64>,
    /// Three for each node of the tetrahedra.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub degrees_of_freedom: Option<u64>,
}

/// What a computation is likely to take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ComputationEstimate {
    /// Memory at most, in bytes.
    pub memory_bytes: u64,
    /// CPU time in s, within a factor of three.
    pub cpu_s: f64,
}

/// The packing that an estimate is for.
#[derive(Clone, Copy)]
pub enum Expected<'a> {
    /// It is there.
    Packed(&'a Model<'a>),
    /// It is planned.
    Planned(&'a PackingRequest, &'a Plan),
}

impl Expected<'_> {
    /// Its specimen.
    pub fn specimen(&self) -> &Specimen {
        match self {
            Self::Packed(model) => model.specimen,
            Self::Planned(request, _) => &request.specimen,
        }
    }

    /// The materials that its request states.
    pub fn materials(&self) -> Option<&Materials> {
        match self {
            Self::Packed(model) => model.materials,
            Self::Planned(request, _) => request.materials.as_ref(),
        }
    }

    /// What its grains are.
    pub fn kind(&self) -> GrainKind {
        match self {
            Self::Packed(model) => model.grains.kind(),
            Self::Planned(request, _) => request.mix.grain_kind(),
        }
    }

    /// Number of grains.
    pub fn grains(&self) -> f64 {
        match self {
            Self::Packed(model) => model.grains.len() as f64,
            Self::Planned(_, plan) => plan.grains,
        }
    }

    /// Smallest diameter in mm.
    pub fn d_min_mm(&self) -> f64 {
        match self {
            Self::Packed(model) => model.grains.diameters_mm().fold(f64::INFINITY, f64::min),
            Self::Planned(_, plan) => plan.classes.first().map_or(1.0, |class| class.d_min_mm),
        }
    }

    /// Numbers of grains and their diameters in mm.
    pub fn sizes(&self) -> Box<dyn Iterator<Item = (f64, f64)> + '_> {
        let mean = |class: &ClassPlan| (class.d_min_mm * class.d_max_mm).sqrt();
        match self {
            Self::Packed(model) => Box::new(model.grains.diameters_mm().map(|d| (1.0, d))),
            Self::Planned(_, plan) => {
                Box::new(plan.classes.iter().map(move |class| (class.grains, mean(class))))
            }
        }
    }

    /// Sum of the diameters in mm.
    pub fn sum_mm(&self) -> f64 {
        self.sizes().map(|(grains, d_mm)| grains * d_mm).sum()
    }

    /// Whether the mix has several aggregates.
    pub fn has_aggregates(&self) -> bool {
        match self {
            Self::Packed(model) => !model.grains.aggregate().is_empty(),
            Self::Planned(request, _) => !request.mix.aggregates.is_empty(),
        }
    }
}
