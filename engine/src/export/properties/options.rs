//! What effective properties may be requested, and how large their grids may be.

use serde::ser::SerializeMap as _;
use serde::{Deserialize, Serialize, Serializer};

use crate::homogenization::Scheme;
use crate::request::Materials;
use crate::request::decode::{At, Bound, Object};

/// Voxels along the longest edge, where nothing else is requested.
pub const DEFAULT_CELLS: u32 = 128;
/// Fewest and most voxels along the longest edge.
pub const CELLS: [u32; 2] = [8, 1024];
/// Fewest voxels along any edge.
pub const LEAST_CELLS: usize = 4;
/// Largest relative error of the solver in a property, where nothing else is requested.
pub const DEFAULT_TOLERANCE: f64 = 1e-4;
/// Least and largest tolerance: fields are of single precision.
const TOLERANCES: [f64; 2] = [1e-9, 0.1];

/// What the properties are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum PropertyFormat {
    /// An object with the properties.
    Json,
    /// The fields of all load cases as VTK image data; the properties are in the report.
    Vti,
}

impl PropertyFormat {
    /// Name of the format, and file extension.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Vti => "vti",
        }
    }

    /// Media type without parameters.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Vti => "application/vnd.vtk.imagedata+xml",
        }
    }
}

/// A kind of properties.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PropertyKind {
    /// Elastic stiffness.
    Stiffness,
    /// Conductivity of heat, and diffusivity.
    Conductivity,
    /// Thermal expansion, with the stiffness that it needs.
    Expansion,
}

impl PropertyKind {
    /// All kinds in the order in which they are named.
    pub const ALL: [Self; 3] = [Self::Stiffness, Self::Conductivity, Self::Expansion];

    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stiffness => "stiffness",
            Self::Conductivity => "conductivity",
            Self::Expansion => "expansion",
        }
    }
}

/// The kinds of properties that are computed, each once and in the order of all kinds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PropertyKinds(Vec<PropertyKind>);

impl PropertyKinds {
    /// These kinds.
    pub(super) fn of(kinds: Vec<PropertyKind>) -> Self {
        Self(kinds)
    }

    /// Whether a kind is among them.
    #[must_use]
    pub fn has(&self, kind: PropertyKind) -> bool {
        self.0.contains(&kind)
    }

    /// Whether the stiffness is computed.
    #[must_use]
    pub fn is_elastic(&self) -> bool {
        self.has(PropertyKind::Stiffness) || self.has(PropertyKind::Expansion)
    }

    /// The kinds.
    pub fn iter(&self) -> impl Iterator<Item = PropertyKind> + '_ {
        self.0.iter().copied()
    }

    /// Reads names that commas separate, or a list of names.
    fn read(at: &At<'_>) -> Option<Self> {
        let names: Vec<&str> = match at.value().as_array() {
            Some(_) => at.array()?.iter().map(|item| item.string()).collect::<Option<_>>()?,
            None => at.string()?.split(',').map(str::trim).collect(),
        };
        let mut kinds = Vec::new();
        for name in names {
            let Some(kind) = PropertyKind::ALL.into_iter().find(|kind| kind.name() == name) else {
                let all = PropertyKind::ALL.map(PropertyKind::name).join(", ");
                at.fault(format!("{name:?} is no kind of properties: must be one or more of {all}"));
                return None;
            };
            kinds.push(kind);
        }
        kinds.sort_unstable();
        kinds.dedup();
        if kinds.is_empty() {
            at.fault("names no kind of properties: must name at least one");
            return None;
        }
        Some(Self(kinds))
    }
}

impl Serialize for PropertyKinds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let names: Vec<&str> = self.iter().map(PropertyKind::name).collect();
        serializer.serialize_str(&names.join(","))
    }
}

/// How a box with walls becomes a periodic cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Walls {
    /// The box is the cell.
    Periodic,
    /// The box and its mirror images are the cell, which deforms as the box does between smooth plates.
    Mirrored,
}

/// What becomes of voxels that the surface of a grain cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum CutVoxels {
    /// They have two phases, with the share and the normal of the surface.
    Mixed,
    /// They have the phase of their centre, as the labels of `voxels`.
    Labels,
}

/// Options of effective properties.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PropertyOptions {
    /// What is written: the properties, or with `fields` the fields. Default: `json`, with `fields` `vti`.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub format: PropertyFormat,
    /// Voxels along the longest edge of the specimen.
    #[cfg_attr(feature = "openapi", schema(default = 128, required = false, minimum = 8, maximum = 1024))]
    pub cells: u32,
    /// Kinds of properties, separated by commas: `stiffness`, `conductivity` (diffusivity too, where the materials have
    /// it), `expansion` (with the stiffness that it needs). Default: the kinds that all materials have properties for.
    #[cfg_attr(
        feature = "openapi",
        schema(
            required = false,
            nullable,
            value_type = String,
            pattern = "^(stiffness|conductivity|expansion)(,(stiffness|conductivity|expansion))*$"
        )
    )]
    pub kinds: Option<PropertyKinds>,
    /// How strains follow from the displacements of the corners of a voxel.
    #[cfg_attr(feature = "openapi", schema(default = "rotated", required = false))]
    pub scheme: Scheme,
    /// What becomes of voxels that a surface cuts. Default: `mixed` with `scheme=rotated`, `labels` with
    /// `scheme=hexahedra`.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub cut_voxels: CutVoxels,
    /// Largest relative error of the solver in a property.
    #[cfg_attr(feature = "openapi", schema(default = 1e-4, required = false, minimum = 1e-9, maximum = 0.1))]
    pub tolerance: f64,
    /// How a box with walls becomes a periodic cell.
    #[cfg_attr(feature = "openapi", schema(default = "periodic", required = false))]
    pub walls: Walls,
    /// Whether the file has the strain and stress, or gradient and flux, of each voxel in each load case, as VTK image
    /// data; the properties are in its report.
    #[cfg_attr(feature = "openapi", schema(default = false, required = false))]
    pub fields: bool,
    /// The materials of the phases. Default: those of the request of the packing.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    pub materials: Option<Materials>,
}

/// The options that apply, so that what is written reads back.
impl Serialize for PropertyOptions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("format", &self.format)?;
        map.serialize_entry("cells", &self.cells)?;
        if let Some(kinds) = &self.kinds {
            map.serialize_entry("kinds", kinds)?;
        }
        map.serialize_entry("scheme", &self.scheme)?;
        map.serialize_entry("cut_voxels", &self.cut_voxels)?;
        map.serialize_entry("tolerance", &self.tolerance)?;
        map.serialize_entry("walls", &self.walls)?;
        map.serialize_entry("fields", &self.fields)?;
        if let Some(materials) = &self.materials {
            map.serialize_entry("materials", materials)?;
        }
        map.end()
    }
}

impl PropertyOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = object.optional("format").map_or(Some(None), |at| {
            at.choice(&[("json", PropertyFormat::Json), ("vti", PropertyFormat::Vti)]).map(Some)
        });
        let is_vti = format.flatten() == Some(PropertyFormat::Vti);
        let fields = object.optional("fields").map_or(Some(is_vti), |at| {
            let fields = at.boolean()?;
            match format? {
                Some(PropertyFormat::Json) if fields => {
                    at.fault("true needs format=vti: fields are not written as json");
                }
                Some(PropertyFormat::Vti) if !fields => {
                    at.fault("false needs format=json: vti has the fields");
                }
                _ => return Some(fields),
            }
            None
        });
        let [least, most] = CELLS;
        let cells = object
            .optional("cells")
            .map_or(Some(DEFAULT_CELLS), |at| at.integer(least.into(), most.into()).map(|n| n as u32));
        let kinds = object.optional("kinds").map_or(Some(None), |at| PropertyKinds::read(&at).map(Some));
        let scheme = object.optional("scheme").map_or(Some(Scheme::Rotated), |at| {
            at.choice(&[("rotated", Scheme::Rotated), ("hexahedra", Scheme::Hexahedra)])
        });
        let cut_voxels = match object.optional("cut_voxels") {
            Some(at) => at.choice(&[("mixed", CutVoxels::Mixed), ("labels", CutVoxels::Labels)]),
            None if scheme == Some(Scheme::Hexahedra) => Some(CutVoxels::Labels),
            None => Some(CutVoxels::Mixed),
        };
        let [least, most] = TOLERANCES;
        let tolerance = object
            .optional("tolerance")
            .map_or(Some(DEFAULT_TOLERANCE), |at| at.number(Bound::closed(least, most, "")));
        let walls = object.optional("walls").map_or(Some(Walls::Periodic), |at| {
            at.choice(&[("periodic", Walls::Periodic), ("mirrored", Walls::Mirrored)])
        });
        let materials = Materials::read_option(object);
        let format = match (format?, fields?) {
            (Some(format), _) => format,
            (None, true) => PropertyFormat::Vti,
            (None, false) => PropertyFormat::Json,
        };
        Some(Self {
            format,
            cells: cells?,
            kinds: kinds?,
            scheme: scheme?,
            cut_voxels: cut_voxels?,
            tolerance: tolerance?,
            walls: walls?,
            fields: fields?,
            materials,
        })
    }
}
