//! What CalculiX computed of a deck: the mean stress and strain, the property that follows, and the fields.
//!
//! The mean stress over a specimen of volume V is the sum of `f_i x_j / V` over the nodes of its faces, with the forces
//! `f` from outside and the positions `x` (the divergence theorem; Hill 1963, 10.1016/0022-5096(63)90036-X). The mean
//! strain follows from the displacements of the plates. `dat`, `frd` and `deck_mesh` read the files.

mod dat;
mod deck_mesh;
mod frd;
mod vtu;

use std::io::Write;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::control::Control;
use crate::export::deck::{DeckReport, LateralFaces, Load, PRINTED_SET};
use crate::export::solid::SolidMesh;
use crate::export::{ExportError, Provenance};

/// Largest residual of the reactions, in the sum of their sizes, that counts as balance: seven digits are printed.
pub const BALANCE: f64 = 1e-6;

/// Why the results of a solver cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SolutionError {
    /// A line that does not have the form of its file.
    #[error("{file}, line {line} is not what CalculiX writes: {text:?}")]
    Unreadable {
        /// The file.
        file: &'static str,
        /// The line, counted from 1.
        line: usize,
        /// Its beginning.
        text: String,
    },
    /// A file lacks something.
    #[error("{0}")]
    Missing(String),
}

/// What a solver computed of a deck. Properties that the load does not give are absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solution {
    /// What was done to the specimen.
    pub load: Load,
    /// Mean stress xx, yy, zz, yz, xz, xy in MPa along the axes of the mesh, positive in tension; of a cut the
    /// components across it are not computed and 0.
    pub mean_stress_mpa: [f64; 6],
    /// Mean strain along x, y, z of the mesh, of the plates; of a cut the last is not computed and 0; of a cylinder the
    /// radial strain stands for x and y.
    pub mean_strain: [f64; 3],
    /// Young's modulus along the axis of a uniaxial load.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub youngs_modulus_gpa: Option<f64>,
    /// Minus the lateral strain over the strain, along the lateral axes in their order; of a cylinder one number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poissons_ratios: Option<Vec<f64>>,
    /// Shear modulus in the plane of a shear load.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shear_modulus_gpa: Option<f64>,
    /// Coefficients of linear thermal expansion in 1/K along the axes of the mesh: x, y, z, or the two of a cut.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expansion_1_k: Option<Vec<f64>>,
    /// Reactions on the faces that a load or a support holds, in N.
    pub reactions_n: Vec<FaceReaction>,
    /// Size of the sum of all reactions over the sum of their sizes; of reactions below a thousandth of the force that
    /// the stiffest phase would need for such a strain, over this.
    pub imbalance: f64,
    /// Largest mean stress along a lateral axis over that along the axis of a uniaxial load.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stray_stress: Option<f64>,
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub elements: u64,
}

/// The reaction on a face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaceReaction {
    /// Name of the face.
    pub face: String,
    /// The sum of the forces on its nodes from outside, in N.
    pub force_n: [f64; 3],
}

/// The files of a deck and of its results.
#[derive(Clone, Debug)]
pub struct Results {
    deck: DeckReport,
    mesh: SolidMesh,
}

impl Results {
    /// Reads a deck's figures and its mesh, from the texts of `deck.json` and `mesh.inp`.
    ///
    /// # Errors
    /// [`SolutionError`].
    pub fn of_deck(deck_json: &str, mesh_inp: &str) -> Result<Self, SolutionError> {
        let deck = serde_json::from_str(deck_json)
            .map_err(|error| SolutionError::Missing(format!("deck.json is not that of a deck: {error}")))?;
        Ok(Self { deck, mesh: deck_mesh::read(mesh_inp)? })
    }

    /// The figures of the deck.
    #[must_use]
    pub fn deck(&self) -> &DeckReport {
        &self.deck
    }

    /// Reads what CalculiX printed, from the text of `model.dat`.
    ///
    /// # Errors
    /// [`SolutionError`].
    pub fn solution(&self, dat: &str) -> Result<Solution, SolutionError> {
        let printed = dat::Printed::read(dat, PRINTED_SET)?;
        let (deck, mesh) = (&self.deck, &self.mesh);
        let place = |node: u32| mesh.nodes_mm.get((node as usize).wrapping_sub(1)).copied();
        let (mut stress, mut sum, mut sizes) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for (node, force) in &printed.forces_n {
            let Some(place) = place(*node) else {
                return Err(SolutionError::Missing(format!(
                    "mesh.inp has no node {node}, which model.dat has"
                )));
            };
            stress += force * place.transpose() / deck.volume_mm3;
            sum += force;
            sizes += force.norm();
        }
        let strain = self.mean_strain(&printed)?;
        let stress_of = |a: usize, b: usize| f64::midpoint(stress[(a, b)], stress[(b, a)]);
        let mean_stress_mpa = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|(a, b)| stress_of(a, b));
        let frame = deck.frame();
        let axis = deck.load.axis().and_then(|axis| frame.place(axis));
        let lateral = |axis: usize| -> Vec<f64> {
            let axes = (0..frame.dimension()).filter(|lateral| *lateral != axis);
            let axes = axes.take(if deck.lateral_faces == LateralFaces::Free { 1 } else { 2 });
            axes.map(|lateral| -strain[lateral] / strain[axis]).collect()
        };
        let plane = deck.load.plane().and_then(|[a, b]| Some([frame.place(a)?, frame.place(b)?]));
        let shear = plane.zip(deck.strain).map(|([a, b], angle)| stress_of(a, b) / angle / 1e3);
        let heated = deck.temperature_change_k;
        let stray_stress = axis.map(|axis| {
            let lateral = (0..frame.dimension()).filter(|lateral| *lateral != axis);
            let largest = lateral.map(|lateral| stress[(lateral, lateral)].abs()).fold(0.0, f64::max);
            largest / stress[(axis, axis)].abs()
        });
        let stiffest_gpa = deck.phases.iter().map(|phase| phase.youngs_modulus_gpa).fold(0.0, f64::max);
        let largest_strain =
            strain.iter().fold(deck.strain.unwrap_or_default().abs(), |most, x| most.max(x.abs()));
        // GPa times a thousandth is MPa.
        let scale = stiffest_gpa * largest_strain * crate::elementary::powf(deck.volume_mm3, 2.0 / 3.0);
        Ok(Solution {
            load: deck.load,
            mean_stress_mpa,
            mean_strain: strain,
            youngs_modulus_gpa: axis.map(|axis| stress[(axis, axis)] / strain[axis] / 1e3),
            poissons_ratios: axis.map(lateral),
            shear_modulus_gpa: shear,
            expansion_1_k: heated
                .map(|change| strain[..frame.dimension()].iter().map(|strain| strain / change).collect()),
            reactions_n: self.reactions(&printed),
            imbalance: sum.norm() / sizes.max(scale).max(f64::MIN_POSITIVE),
            stray_stress,
            nodes: mesh.nodes_mm.len() as u64,
            elements: mesh.len() as u64,
        })
    }

    /// The displacements of opposite plates over their distance; of a cylinder the radial displacement of the lateral
    /// surface over its radius, by least squares beside a motion of the whole.
    fn mean_strain(&self, printed: &dat::Printed) -> Result<[f64; 3], SolutionError> {
        let mean = |face: &str, axis: usize| {
            let nodes = self.nodes(face)?;
            let displacement = |node: &u32| printed.displacements_mm.get(&(node + 1));
            let displacements: Option<Vec<_>> = nodes.iter().map(displacement).collect();
            let displacements = displacements.filter(|all| !all.is_empty()).ok_or_else(|| {
                SolutionError::Missing(format!("model.dat lacks displacements of the face {face}"))
            })?;
            Ok(displacements.iter().map(|u| u[axis]).sum::<f64>() / displacements.len() as f64)
        };
        let frame = self.deck.frame();
        let along = |axis: usize| {
            let [low, high] = frame.faces(axis);
            Ok((mean(high, axis)? - mean(low, axis)?) / self.deck.size_mm[axis])
        };
        if self.deck.load.plane().is_some() {
            return Ok([0.0; 3]);
        }
        if self.deck.lateral_faces == LateralFaces::Plane {
            let across = if frame.dimension() == 3 { along(2)? } else { 0.0 };
            return Ok([along(0)?, along(1)?, across]);
        }
        let mut moved: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::new();
        for node in self.nodes("side")? {
            let place = self.mesh.nodes_mm[*node as usize];
            if let Some(u) = printed.displacements_mm.get(&(node + 1)) {
                moved.push((Vector3::new(place.x, place.y, 0.0), Vector3::new(u.x, u.y, 0.0)));
            }
        }
        // The node that is held need not lie on the axis: the cylinder moves as a whole.
        let number = moved.len() as f64;
        let centre = moved.iter().map(|(place, _)| place).sum::<Vector3<f64>>() / number;
        let shift = moved.iter().map(|(_, u)| u).sum::<Vector3<f64>>() / number;
        let outward: f64 = moved.iter().map(|(place, u)| (u - shift).dot(&(place - centre))).sum();
        let squares: f64 = moved.iter().map(|(place, _)| (place - centre).norm_squared()).sum();
        let radial = outward / squares;
        Ok([radial, radial, along(2)?])
    }

    fn nodes(&self, face: &str) -> Result<&[u32], SolutionError> {
        let found = self.mesh.faces.iter().find(|set| set.name == face);
        let found =
            found.filter(|set| set.nodes.iter().all(|node| (*node as usize) < self.mesh.nodes_mm.len()));
        found
            .map(|set| set.nodes.as_slice())
            .ok_or_else(|| SolutionError::Missing(format!("mesh.inp has no set of nodes {face}")))
    }

    fn reactions(&self, printed: &dat::Printed) -> Vec<FaceReaction> {
        let of = |face: &crate::export::solid::SpecimenFace| {
            let force: Vector3<f64> =
                face.nodes.iter().filter_map(|node| printed.forces_n.get(&(node + 1))).sum();
            FaceReaction { face: face.name.clone(), force_n: force.into() }
        };
        let is_face = |face: &&crate::export::solid::SpecimenFace| {
            matches!(face.name.as_str(), "x_min" | "x_max" | "y_min" | "y_max" | "z_min" | "z_max")
        };
        self.mesh.faces.iter().filter(is_face).map(of).collect()
    }

    /// Writes the mesh with the fields of the text of `model.frd`: displacements, stresses and strains at the nodes,
    /// and the phase of each element.
    ///
    /// # Errors
    /// [`ResultsError`].
    pub fn write_vtu(
        &self,
        frd: &str,
        provenance: Option<&Provenance>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ResultsError> {
        let fields = frd::read(frd)?;
        Ok(vtu::write(&self.mesh, &fields, provenance, control, out)?)
    }
}

/// Why fields were not written.
#[derive(Debug, Error)]
pub enum ResultsError {
    /// The file of the solver cannot be used.
    #[error("{0}")]
    Solution(#[from] SolutionError),
    /// The file could not be written.
    #[error("{0}")]
    Export(#[from] ExportError),
}

impl From<std::io::Error> for ResultsError {
    fn from(error: std::io::Error) -> Self {
        Self::Export(error.into())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
