//! Effective properties as they are reported.

use serde::{Deserialize, Serialize};

use super::options::CutVoxels;
use crate::homogenization::moduli::{ConductionBounds, ElasticBounds, IsotropicModuli};
use crate::homogenization::{Effort, Scheme};
use crate::request::Material;

/// Which periodic cell was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum CellKind {
    /// The periodic box of the packing.
    PeriodicBox,
    /// A box with walls, repeated as it is.
    RepeatedBox,
    /// A box with walls and its mirror images.
    MirroredBox,
}

/// The cell and its voxels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PropertyCell {
    /// Which cell it is.
    pub kind: CellKind,
    /// Its edges along x, y, z.
    pub size_mm: [f64; 3],
    /// Its voxels along x, y, z.
    pub voxels: [u64; 3],
    /// Edges of a voxel.
    pub voxel_mm: [f64; 3],
    /// Voxels of two phases over all.
    pub cut_share: f64,
    /// Voxels in which a surface meets another: of more than two bodies, the matrix among them. They have the two
    /// phases of the largest shares.
    pub voxels_of_three_bodies: u64,
}

/// A phase of the cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PropertyPhase {
    /// `matrix`, `aggregate`, or the group of one of several aggregates as in meshes.
    pub name: String,
    /// Volume of its voxels over that of the cell.
    pub share: f64,
    /// Volume of its grains over that of the cell; exact.
    pub exact_share: f64,
    /// Its material.
    pub material: Material,
}

/// How exact a property is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PropertyError {
    /// Iterations of each load case.
    pub iterations: Vec<u64>,
    /// Relative error of the solver in the property, estimated; at most the tolerance.
    pub solver: f64,
    /// Relative error of the voxels: the difference to the property of half as many along each edge.
    pub voxels: f64,
    /// Relative difference of the property by the energy and by the mean flux.
    pub energy_against_work: f64,
}

impl PropertyError {
    pub(super) fn new(effort: &Effort, voxels: f64) -> Self {
        Self {
            iterations: effort.iterations.clone(),
            solver: effort.error,
            voxels,
            energy_against_work: effort.energy_against_work,
        }
    }
}

/// Elastic properties. Components are in the order xx, yy, zz, yz, xz, xy, shears those of engineering strains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StiffnessReport {
    /// Stiffness in GPa.
    pub stiffness_gpa: [[f64; 6]; 6],
    /// Young's moduli along x, y, z in GPa; `null` where the stiffness has no inverse.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub youngs_moduli_gpa: Option<[f64; 3]>,
    /// The isotropic material that is nearest to it: the mean over all rotations.
    pub isotropic: IsotropicModuli,
    /// Universal anisotropy index, 0 of isotropic materials; `null` where the stiffness has no inverse.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub universal_anisotropy: Option<f64>,
    /// Bounds of the moduli by the shares of the phases.
    pub bounds: ElasticBounds,
    /// How exact the stiffness is.
    pub error: PropertyError,
}

/// Thermal expansion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ExpansionReport {
    /// Free expansion in 1/K, as a symmetric matrix over x, y, z.
    pub expansion_1_k: [[f64; 3]; 3],
    /// A third of its trace.
    pub isotropic_1_k: f64,
    /// How exact it is.
    pub error: PropertyError,
}

/// Conductivity of heat, or diffusivity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ConductionReport {
    /// The symmetric matrix over x, y, z, in W/(m K), or of diffusivity in m²/s.
    pub matrix: [[f64; 3]; 3],
    /// A third of its trace.
    pub isotropic: f64,
    /// Bounds by the shares of the phases.
    pub bounds: ConductionBounds,
    /// How exact it is.
    pub error: PropertyError,
}

/// Effective properties of a packing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PropertyReport {
    /// The periodic cell that was computed.
    pub cell: PropertyCell,
    /// How strains follow from the displacements of the corners of a voxel.
    pub scheme: Scheme,
    /// What became of voxels that a surface cuts.
    pub cut_voxels: CutVoxels,
    /// Largest relative error of the solver.
    pub tolerance: f64,
    /// The phases: the matrix, then the aggregates.
    pub phases: Vec<PropertyPhase>,
    /// Elastic stiffness, where it was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub stiffness: Option<StiffnessReport>,
    /// Thermal expansion, where it was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub expansion: Option<ExpansionReport>,
    /// Conductivity in W/(m K), where it was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub conductivity: Option<ConductionReport>,
    /// Diffusivity in m²/s, where `conductivity` was requested and all materials have a diffusivity.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub diffusivity: Option<ConductionReport>,
}
