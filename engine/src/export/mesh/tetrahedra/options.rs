//! Options of meshes of tetrahedra.

use serde::{Deserialize, Serialize};

use crate::export::mesh::options::SurfaceOptions;
use crate::request::MAX_LENGTH_MM;
use crate::request::decode::{Bound, Object};

/// Most tetrahedra that may be aimed at: a solid mesh numbers its nodes by 32 bits.
const MOST_ELEMENTS: i64 = 400_000_000;
/// Bounds of the growth of edges: faster growth makes flat tetrahedra (`docs/meshes.md`).
const GROWTH: (f64, f64) = (1.05, 1.5);
/// Growth of edges where only the size in the matrix is given.
pub(super) const DEFAULT_GROWTH: f64 = 1.3;

/// What a mesh consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MeshElements {
    /// Triangles on the surfaces.
    Triangles,
    /// Tetrahedra of an installed Gmsh.
    #[default]
    Tetrahedra,
}

/// How the surfaces are filled with tetrahedra.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TetrahedronOptions {
    /// With `tetrahedra` an installed Gmsh fills the surfaces; without it `msh` has the surfaces alone. Files of the
    /// formats `inp`, `vtu` and `med` always have tetrahedra.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub elements: MeshElements,
    /// 1: tetrahedra with 4 nodes; 2: with 10, whose mid nodes are the middles of the edges.
    #[cfg_attr(feature = "openapi", schema(default = 1, required = false, minimum = 1, maximum = 2))]
    pub order: u32,
    /// No edge on a grain is asked to be longer, in mm; small grains keep the edges of `segments`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tet_size_mm: Option<f64>,
    /// Edges away from the grains, in mm: no edge is asked to be longer.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tet_size_matrix_mm: Option<f64>,
    /// Number of tetrahedra to aim at, in place of `segments`, `size_mm` and `tet_size_matrix_mm`. The surfaces are
    /// filled a second time where the first missed it by more than a tenth; the report says what came out.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1, maximum = 400_000_000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_elements: Option<u64>,
    /// Largest ratio of neighbouring edges where they grow away from the surfaces. Where neither it nor
    /// `tet_size_matrix_mm` is given, edges away from the surfaces have the lengths of those on them; 1.3 where only
    /// `tet_size_matrix_mm` is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1.05, maximum = 1.5))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tet_growth: Option<f64>,
}

/// A file of surfaces, filled or not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshOptions {
    /// The surfaces.
    #[serde(flatten)]
    pub surfaces: SurfaceOptions,
    /// The tetrahedra, where there are any.
    #[serde(flatten)]
    pub tetrahedra: Option<TetrahedronOptions>,
}

/// One object with the fields of both: a request may have no others.
#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for MeshOptions {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::schema::Schema> {
        crate::export::schema::merged([SurfaceOptions::schema(), TetrahedronOptions::schema()])
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for MeshOptions {
    fn schemas(schemas: &mut Vec<(String, utoipa::openapi::RefOr<utoipa::openapi::schema::Schema>)>) {
        SurfaceOptions::schemas(schemas);
        TetrahedronOptions::schemas(schemas);
    }
}

impl MeshOptions {
    /// Reads the options of a format that `has_tetrahedra`, or may have them.
    pub(in crate::export) fn read(object: &mut Object<'_>, has_tetrahedra: bool) -> Option<Self> {
        let elements = match object.optional("elements") {
            Some(at) if has_tetrahedra => at.choice(&[("tetrahedra", true)])?,
            Some(at) => at.choice(&[("triangles", false), ("tetrahedra", true)])?,
            None => has_tetrahedra,
        };
        Self::read_filled(object, elements)
    }

    /// Reads the options of tetrahedra, where something else has said that there are some.
    pub(in crate::export) fn read_tetrahedra(object: &mut Object<'_>) -> Option<Self> {
        Self::read_filled(object, true)
    }

    fn read_filled(object: &mut Object<'_>, has_tetrahedra: bool) -> Option<Self> {
        let given = ["segments", "size_mm", "max_segments"].map(|name| object.has(name));
        let tetrahedra = TetrahedronOptions::read(object, given, has_tetrahedra);
        let mut surfaces = SurfaceOptions::read(object)?;
        if tetrahedra.as_ref().is_some_and(|options| options.target_elements.is_some()) {
            // The aim decides them.
            (surfaces.segments, surfaces.max_segments) = (None, None);
        }
        Some(Self { surfaces, tetrahedra })
    }
}

impl TetrahedronOptions {
    /// Names of the options beside `elements`.
    pub(in crate::export) const NAMES: [&str; 5] =
        ["order", "tet_size_mm", "tet_size_matrix_mm", "target_elements", "tet_growth"];

    /// Reads the options; without tetrahedra there are none, and each that is given is a fault. None where faults were
    /// reported, too.
    fn read(object: &mut Object<'_>, given: [bool; 3], has_tetrahedra: bool) -> Option<Self> {
        if !has_tetrahedra {
            object.refuse_all(&Self::NAMES, "goes with elements=tetrahedra: give that too, or leave it out");
            return None;
        }
        let order = object.optional("order").map_or(Some(1), |at| at.integer(1, 2).map(|order| order as u32));
        let length = |object: &mut Object<'_>, name| match object.optional(name) {
            Some(at) => at.number(Bound::positive(MAX_LENGTH_MM, "mm")).map(Some),
            None => Some(None),
        };
        let tet_size_mm = length(object, "tet_size_mm");
        let tet_size_matrix_mm = length(object, "tet_size_matrix_mm");
        let target_at = object.optional("target_elements");
        let target = match &target_at {
            Some(at) => at.integer(1, MOST_ELEMENTS).map(|count| Some(count as u64)),
            None => Some(None),
        };
        let growth = match object.optional("tet_growth") {
            Some(at) => at.number(Bound::closed(GROWTH.0, GROWTH.1, "")).map(Some),
            None => Some(None),
        };
        let read = Self {
            elements: MeshElements::Tetrahedra,
            order: order?,
            tet_size_mm: tet_size_mm?,
            tet_size_matrix_mm: tet_size_matrix_mm?,
            target_elements: target?,
            tet_growth: growth?,
        };
        if let Some(at) = target_at {
            let others = [
                ("segments", given[0]),
                ("size_mm", given[1]),
                ("max_segments", given[2]),
                ("tet_size_matrix_mm", read.tet_size_matrix_mm.is_some()),
            ];
            if let Some((name, _)) = others.into_iter().find(|(_, is_given)| *is_given) {
                at.fault(format!("target_elements decides {name} too: leave one of them out"));
                return None;
            }
        }
        Some(read)
    }

    /// The options of the surfaces that these tetrahedra need.
    pub(in crate::export) fn of_surfaces(
        &self,
        surfaces: &SurfaceOptions,
        size_mm: Option<f64>,
    ) -> SurfaceOptions {
        let mut surfaces = surfaces.clone();
        if let Some(size_mm) = size_mm {
            // The shortest edges follow the aim, too.
            (surfaces.segments, surfaces.max_segments, surfaces.size_mm) = (None, None, Some(size_mm));
        }
        let most = self.tet_size_mm.into_iter().chain(surfaces.max_size_mm).reduce(f64::min);
        // The bounds of lengths stand in their order: the shortest edge that is asked for wins.
        surfaces.max_size_mm = most.map(|most| most.max(surfaces.min_size_mm.unwrap_or(0.0)));
        surfaces
    }
}
