//! Options of decks.

use serde::ser::SerializeMap as _;
use serde::{Deserialize, Serialize, Serializer};

use super::load::Load;
use crate::export::voxels::{DEFAULT_SAMPLES, Label, MAX_CELLS, VoxelFormat, VoxelOptions};
use crate::request::decode::{At, Bound, Object};
use crate::request::{MAX_LENGTH_MM, Materials};

/// Voxels along the longest edge, where nothing else is requested: CalculiX solves 27 000 hexahedra in seconds.
pub const DEFAULT_CELLS: u32 = 30;
/// Strain along the axis, or shear angle, where nothing else is requested.
pub const DEFAULT_STRAIN: f64 = 1e-4;
/// Rise of the temperature in K, where nothing else is requested.
pub const DEFAULT_TEMPERATURE_CHANGE_K: f64 = 1.0;
/// Least and largest size of a strain: the digits that CalculiX prints, and the range of a linear model.
const STRAINS: [f64; 2] = [1e-9, 0.1];
/// Least and largest size of a change of the temperature.
const TEMPERATURE_CHANGES_K: [f64; 2] = [1e-3, 1e4];

/// The program that reads a deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Solver {
    /// CalculiX.
    Calculix,
    /// Abaqus.
    Abaqus,
}

impl Solver {
    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Calculix => "calculix",
            Self::Abaqus => "abaqus",
        }
    }

    /// Its name for people.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Calculix => "CalculiX",
            Self::Abaqus => "Abaqus",
        }
    }
}

/// What a deck is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum DeckFormat {
    /// A zip with the files of the deck.
    Zip,
}

impl DeckFormat {
    /// Name of the format, and file extension.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Zip => "zip",
        }
    }

    /// Media type without parameters.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Zip => "application/zip",
        }
    }
}

/// The elements of a deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum DeckElements {
    /// Hexahedra with eight nodes (C3D8), one a voxel.
    Voxels,
}

/// Options of a deck.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DeckOptions {
    /// What the deck is written as.
    #[cfg_attr(feature = "openapi", schema(default = "zip", required = false))]
    pub format: DeckFormat,
    /// The program that reads it.
    #[cfg_attr(feature = "openapi", schema(default = "calculix", required = false))]
    pub solver: Solver,
    /// What is done to the specimen. A cylinder has `uniaxial_z` and `temperature`.
    #[cfg_attr(feature = "openapi", schema(default = "uniaxial_z", required = false))]
    pub load: Load,
    /// Strain along the axis of a uniaxial load, or shear angle: 1e-9 to 0.1 in size; positive stretches. Default:
    /// 1e-4; absent for `temperature`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = -0.1, maximum = 0.1)
    )]
    pub strain: Option<f64>,
    /// Rise of the temperature in K: 0.001 to 10000 in size. Default: 1; absent for other loads than `temperature`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = -1e4, maximum = 1e4)
    )]
    pub temperature_change_k: Option<f64>,
    /// The elements.
    #[cfg_attr(feature = "openapi", schema(default = "voxels", required = false))]
    pub elements: DeckElements,
    /// Voxels along the longest edge of the specimen. Default: 30, unless `voxel_mm` is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1, maximum = 8192))]
    pub cells: Option<u32>,
    /// Edge of a voxel, met as nearly as whole numbers of voxels along the specimen's edges allow.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    pub voxel_mm: Option<f64>,
    /// The materials of the phases. Default: those of the request of the packing.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    pub materials: Option<Materials>,
}

/// The options that apply, so that what is written reads back.
impl Serialize for DeckOptions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("format", &self.format)?;
        map.serialize_entry("solver", &self.solver)?;
        map.serialize_entry("load", &self.load)?;
        if let Some(strain) = self.strain {
            map.serialize_entry("strain", &strain)?;
        }
        if let Some(change) = self.temperature_change_k {
            map.serialize_entry("temperature_change_k", &change)?;
        }
        map.serialize_entry("elements", &self.elements)?;
        if let Some(cells) = self.cells {
            map.serialize_entry("cells", &cells)?;
        }
        if let Some(voxel_mm) = self.voxel_mm {
            map.serialize_entry("voxel_mm", &voxel_mm)?;
        }
        if let Some(materials) = &self.materials {
            map.serialize_entry("materials", materials)?;
        }
        map.end()
    }
}

impl DeckOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = object
            .optional("format")
            .map_or(Some(DeckFormat::Zip), |at| at.choice(&[("zip", DeckFormat::Zip)]));
        let solver = object.optional("solver").map_or(Some(Solver::Calculix), |at| {
            at.choice(&[Solver::Calculix, Solver::Abaqus].map(|solver| (solver.name(), solver)))
        });
        let load = object
            .optional("load")
            .map_or(Some(Load::UniaxialZ), |at| at.choice(&Load::ALL.map(|load| (load.name(), load))));
        let strain_at = object.optional("strain");
        let change_at = object.optional("temperature_change_k");
        let elements = object
            .optional("elements")
            .map_or(Some(DeckElements::Voxels), |at| at.choice(&[("voxels", DeckElements::Voxels)]));
        let cells_at = object.optional("cells");
        let cells = cells_at
            .as_ref()
            .map_or(Some(None), |at| at.integer(1, MAX_CELLS.into()).map(|n| Some(n as u32)));
        let voxel_mm = match object.optional("voxel_mm") {
            Some(at) if cells_at.is_some() => {
                at.fault("cells and voxel_mm say the same: leave one of them out");
                None
            }
            Some(at) => at.number(Bound::positive(MAX_LENGTH_MM, "mm")).map(Some),
            None => Some(None),
        };
        let materials = Materials::read_option(object);
        let heats = load == Some(Load::Temperature);
        let (strain, change) = if heats {
            let change =
                of_size(change_at.as_ref(), DEFAULT_TEMPERATURE_CHANGE_K, TEMPERATURE_CHANGES_K, "K");
            let other = "goes with a uniaxial load or shear: with load=temperature give temperature_change_k";
            (absent(strain_at.as_ref(), other), change)
        } else {
            let strain = of_size(strain_at.as_ref(), DEFAULT_STRAIN, STRAINS, "");
            (strain, absent(change_at.as_ref(), "goes with load=temperature: with other loads give strain"))
        };
        let (cells, voxel_mm) = (cells?, voxel_mm?);
        let cells = if voxel_mm.is_none() { cells.or(Some(DEFAULT_CELLS)) } else { None };
        Some(Self {
            format: format?,
            solver: solver?,
            load: load?,
            strain: strain.ok()?,
            temperature_change_k: change.ok()?,
            elements: elements?,
            cells,
            voxel_mm,
            materials,
        })
    }

    /// The voxels of which it is made.
    pub(super) fn voxels(&self) -> VoxelOptions {
        VoxelOptions {
            format: VoxelFormat::Inp,
            reader: None,
            cells: self.cells,
            voxel_mm: self.voxel_mm,
            label: Label::Phase,
            fractions: false,
            samples: DEFAULT_SAMPLES,
            materials: None,
        }
    }
}

/// A number that is not zero, of either sign. Faults are reported.
fn of_size(
    at: Option<&At<'_>>,
    default: f64,
    [least, most]: [f64; 2],
    unit: &'static str,
) -> Result<Option<f64>, ()> {
    let Some(at) = at else { return Ok(Some(default)) };
    let x = at.number(Bound::closed(-most, most, unit)).ok_or(())?;
    if x.abs() < least {
        at.fault(format!("{x} is out of range: must be at least {least:e} in size"));
        return Err(());
    }
    Ok(Some(x))
}

/// An option that the load does not have. Faults are reported.
fn absent(at: Option<&At<'_>>, detail: &str) -> Result<Option<f64>, ()> {
    at.map_or(Ok(None), |at| {
        at.fault(detail);
        Err(())
    })
}
