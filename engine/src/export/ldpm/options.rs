//! What is asked for: the parameters of the lattice, their bounds and their JSON form.

use serde::Serialize;

use crate::request::MAX_SEED;
use crate::request::decode::{Bound, Object};

/// Distance of boundary nodes over the smallest diameter (Cusatis, Pelessone and Mencarelli 2011).
const SPACING: f64 = 1.5;
/// Fictitious diameter of boundary nodes over the smallest diameter (ibid.).
const FICTITIOUS_DIAMETER: f64 = 1.1;

/// How a packing becomes a lattice, and which file is made of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LatticeOptions))]
#[serde(deny_unknown_fields)]
pub struct LatticeOptions {
    /// Distance that boundary nodes keep from one another, times the smallest diameter of the packing.
    #[cfg_attr(
        feature = "openapi",
        schema(default = 1.5, required = false, exclusive_minimum = 0, maximum = 100)
    )]
    pub spacing: f64,
    /// Diameter that boundary nodes, which have none, are given where they meet grains, times the smallest
    /// diameter: a node that can be chosen keeps half of it from the surface of every grain. With `random`
    /// nodes, their smallest distance too.
    #[cfg_attr(feature = "openapi", schema(default = 1.1, required = false, minimum = 0, maximum = 100))]
    pub fictitious_diameter: f64,
    /// How nodes are laid on edges and faces.
    #[cfg_attr(feature = "openapi", schema(default = "poisson_disk", required = false))]
    pub boundary_nodes: BoundaryNodes,
    /// Seed of the boundary nodes; the same seed gives the same nodes.
    #[cfg_attr(
        feature = "openapi",
        schema(default = 0, required = false, minimum = 0, maximum = 9_007_199_254_740_991_u64)
    )]
    pub seed: u64,
    /// Radius of boundary nodes in the tessellation, times the smallest diameter. Default: half the
    /// fictitious diameter, as other programs have it; 0 leaves fewer inverted pieces.
    #[cfg_attr(feature = "openapi", schema(required = false, minimum = 0, maximum = 100))]
    pub surface_radius: f64,
    /// File format.
    #[cfg_attr(feature = "openapi", schema(default = "chrono", required = false))]
    pub format: LatticeFormat,
}

/// How nodes are laid on edges and faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum BoundaryNodes {
    /// Edges and the rulings of a lateral surface divided evenly, plane faces filled with Poisson disks until none
    /// fits: no two nodes are nearer than the spacing, and no point that a node may take is farther than that from one.
    PoissonDisk,
    /// As many as length over spacing and area over its square, drawn uniformly (on a lateral surface, on its rulings)
    /// and rejected where nearer than the fictitious diameter, until they are all placed or no place is found.
    Random,
}

/// File format of a lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LatticeFormat))]
#[serde(rename_all = "snake_case")]
pub enum LatticeFormat {
    /// Zip of the `.dat` files that Project Chrono reads, and the report.
    Chrono,
    /// VTK unstructured grid of the tetrahedra.
    Tets,
    /// VTK unstructured grid of the facets.
    Facets,
    /// VTK unstructured grid of the polyhedral cells.
    Cells,
}

impl LatticeFormat {
    /// Its name in requests.
    pub fn name(self) -> &'static str {
        match self {
            Self::Chrono => "chrono",
            Self::Tets => "tets",
            Self::Facets => "facets",
            Self::Cells => "cells",
        }
    }

    /// File extension.
    pub fn extension(self) -> &'static str {
        if self == Self::Chrono { "zip" } else { "vtu" }
    }

    /// Media type without parameters.
    pub fn media_type(self) -> &'static str {
        if self == Self::Chrono { "application/zip" } else { "application/vnd.vtk.unstructuredgrid+xml" }
    }
}

impl Default for LatticeOptions {
    fn default() -> Self {
        Self {
            spacing: SPACING,
            fictitious_diameter: FICTITIOUS_DIAMETER,
            boundary_nodes: BoundaryNodes::PoissonDisk,
            seed: 0,
            surface_radius: FICTITIOUS_DIAMETER / 2.0,
            format: LatticeFormat::Chrono,
        }
    }
}

impl LatticeOptions {
    /// Reads the options from an object that may hold others, which the caller asks for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let spacing_at = object.optional("spacing");
        let spacing = match &spacing_at {
            Some(at) => at.number(Bound::positive(100.0, "")),
            None => Some(SPACING),
        };
        let diameter_at = object.optional("fictitious_diameter");
        let fictitious_diameter = match &diameter_at {
            Some(at) => at.number(Bound::closed(0.0, 100.0, "")),
            None => Some(FICTITIOUS_DIAMETER),
        };
        let boundary_nodes = match object.optional("boundary_nodes") {
            Some(at) => {
                at.choice(&[("poisson_disk", BoundaryNodes::PoissonDisk), ("random", BoundaryNodes::Random)])
            }
            None => Some(BoundaryNodes::PoissonDisk),
        };
        let seed = match object.optional("seed") {
            Some(at) => at.integer(0, MAX_SEED as i64).map(|seed| seed as u64),
            None => Some(0),
        };
        let surface_radius = match object.optional("surface_radius") {
            Some(at) => at.number(Bound::closed(0.0, 100.0, "")),
            None => fictitious_diameter.map(|diameter| diameter / 2.0),
        };
        let format = match object.optional("format") {
            Some(at) => at.choice(&[
                ("chrono", LatticeFormat::Chrono),
                ("tets", LatticeFormat::Tets),
                ("facets", LatticeFormat::Facets),
                ("cells", LatticeFormat::Cells),
            ]),
            None => Some(LatticeFormat::Chrono),
        };
        let (spacing, fictitious_diameter) = (spacing?, fictitious_diameter?);
        if spacing < fictitious_diameter {
            // Where the user set something; by default the two go together.
            let at = spacing_at.as_ref().or(diameter_at.as_ref())?;
            at.fault(format!(
                "nodes {spacing} d_min apart overlap with the fictitious diameter of {fictitious_diameter} d_min: \
                 the spacing must be at least the fictitious diameter"
            ));
            return None;
        }
        Some(Self {
            spacing,
            fictitious_diameter,
            boundary_nodes: boundary_nodes?,
            seed: seed?,
            surface_radius: surface_radius?,
            format: format?,
        })
    }
}
