//! What a deck is about: its report, which lies in the deck too, as `deck.json`.

use serde::{Deserialize, Serialize};

use super::frame::Frame;
use super::load::Load;
use super::options::{DeckElements, Solver};
use crate::export::mesh::TetrahedronReport;
use crate::export::slice::TriangleReport;
use crate::export::solid::PlaneState;
use crate::request::Axis;

/// The figures of a deck.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeckReport {
    /// The program that reads it.
    pub solver: Solver,
    /// What is done to the specimen.
    pub load: Load,
    /// Strain along the axis, or shear angle; absent for `temperature`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub strain: Option<f64>,
    /// Rise of the temperature in K; absent for other loads.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub temperature_change_k: Option<f64>,
    /// The elements.
    pub elements: DeckElements,
    /// Name of the elements in Abaqus and CalculiX.
    pub element_type: String,
    /// What the lateral faces are.
    pub lateral_faces: LateralFaces,
    /// The cut that a plane model is of; absent for solids.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub plane: Option<DeckPlane>,
    /// Lengths along the axes of the mesh: edges of the box around the specimen, of a cut its edges and its thickness.
    pub size_mm: [f64; 3],
    /// Volume of the meshed specimen or cut, pores included: mean stresses are means over it.
    pub volume_mm3: f64,
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub number_of_elements: u64,
    /// Displacements that the solver computes.
    pub degrees_of_freedom: u64,
    /// The solid phases, the matrix first.
    pub phases: Vec<DeckPhase>,
    /// Elements of phases of stiffness 0, which the deck leaves out.
    pub pore_elements: u64,
    /// Elements that only pores surround, which the deck leaves out.
    pub loose_elements: u64,
    /// How the tetrahedra came out and what made them; absent for voxels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub tetrahedra: Option<TetrahedronReport>,
    /// How the triangles of a cut came out and what made them; absent for solids.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub triangles: Option<TriangleReport>,
    /// What a reader should know.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl DeckReport {
    /// The axes of the mesh.
    pub(crate) fn frame(&self) -> Frame {
        let has_free_sides = self.lateral_faces == LateralFaces::Free;
        Frame::new(self.plane.map(|plane| plane.axis), self.size_mm, has_free_sides)
    }
}

/// What the faces are that no load moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum LateralFaces {
    /// Smooth rigid plates that are free to move: each face stays plane, the force on it is zero.
    Plane,
    /// No force acts on any point of them.
    Free,
}

/// The cut of a plane model. Its axes x and y are the other two of the specimen, in the order x, y, z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeckPlane {
    /// The axis that the cut is perpendicular to.
    pub axis: Axis,
    /// Where it meets that axis.
    pub at_mm: f64,
    /// What is assumed across the plane.
    pub state: PlaneState,
    /// Thickness of the model.
    pub thickness_mm: f64,
}

/// A solid phase of a deck.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeckPhase {
    /// Name of its set of elements and of its material.
    pub name: String,
    /// Its elements.
    pub elements: u64,
    /// Their volume.
    pub volume_mm3: f64,
    /// Young's modulus.
    pub youngs_modulus_gpa: f64,
    /// Poisson's ratio.
    pub poissons_ratio: f64,
    /// Density in kg/m³.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub density_kg_m3: Option<f64>,
    /// Thermal conductivity in W/(m K).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub conductivity_w_m_k: Option<f64>,
    /// Coefficient of linear thermal expansion in 1/K.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub expansion_1_k: Option<f64>,
}
