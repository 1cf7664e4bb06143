//! Options of decks.

use serde::{Deserialize, Serialize};

use super::load::Load;
use crate::export::mesh::{MeshOptions, MeshRequest, SurfaceOptions, TetrahedronOptions};
use crate::export::slice::{CutOptions, SliceFormat, SliceOptions, TriangleOptions, read_place};
use crate::export::voxels::{DEFAULT_SAMPLES, Label, MAX_CELLS, VoxelFormat, VoxelOptions};
use crate::request::decode::{At, Bound, Object};
use crate::request::{Axis, MAX_LENGTH_MM, Materials};

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
    /// Tetrahedra of an installed Gmsh, with 4 nodes (C3D4) or 10 (C3D10).
    Tetrahedra,
    /// Triangles of a cut by an installed Gmsh, a plane model (CPS3, CPS6, CPE3 or CPE6).
    Triangles,
}

impl DeckElements {
    /// All, the default first.
    const ALL: [Self; 3] = [Self::Voxels, Self::Tetrahedra, Self::Triangles];

    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Voxels => "voxels",
            Self::Tetrahedra => "tetrahedra",
            Self::Triangles => "triangles",
        }
    }
}

/// Faults of options that other elements have.
const OF_VOXELS: &str = "goes with elements=voxels: leave it out";
const OF_TETRAHEDRA: &str = "goes with elements=tetrahedra: leave it out";
const OF_TRIANGLES: &str = "goes with elements=triangles: leave it out";
const OF_MESHES: &str = "goes with elements=tetrahedra or triangles: give that too, or leave it out";

/// Options of a deck.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeckOptions {
    /// What is computed, and of what.
    #[serde(flatten)]
    pub case: LoadCase,
    /// The mesh.
    #[serde(flatten)]
    pub mesh: DeckMesh,
}

/// The options of a deck that do not depend on its mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LoadCase {
    /// What the deck is written as.
    #[cfg_attr(feature = "openapi", schema(default = "zip", required = false))]
    pub format: DeckFormat,
    /// The program that reads it.
    #[cfg_attr(feature = "openapi", schema(default = "calculix", required = false))]
    pub solver: Solver,
    /// What is done to the specimen. A cylinder has `uniaxial_z` and `temperature`, a cut the loads in its plane.
    /// Default of a cut across z: `uniaxial_y`.
    #[cfg_attr(feature = "openapi", schema(default = "uniaxial_z", required = false))]
    pub load: Load,
    /// Strain along the axis of a uniaxial load, or shear angle: 1e-9 to 0.1 in size; positive stretches. Default:
    /// 1e-4; absent for `temperature`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = -0.1, maximum = 0.1)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strain: Option<f64>,
    /// Rise of the temperature in K: 0.001 to 10000 in size. Default: 1; absent for other loads than `temperature`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = -1e4, maximum = 1e4)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_change_k: Option<f64>,
    /// The materials of the phases. Default: those of the request of the packing.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub materials: Option<Materials>,
}

/// The mesh of a deck, by its elements.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum DeckMesh {
    /// Hexahedra.
    Voxels(VoxelElements),
    /// Tetrahedra.
    Tetrahedra(TetrahedronElements),
    /// Triangles of a cut.
    Triangles(CutElements),
}

/// A mesh of voxels.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct VoxelElements {
    /// The elements.
    #[cfg_attr(feature = "openapi", schema(default = "voxels", required = false))]
    pub elements: DeckElements,
    /// Voxels along the longest edge of the specimen, for `voxels`. Default: 30, unless `voxel_mm` is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1, maximum = 8192))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cells: Option<u32>,
    /// Edge of a voxel, met as nearly as whole numbers of voxels along the specimen's edges allow; for `voxels`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel_mm: Option<f64>,
}

/// A mesh of tetrahedra.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TetrahedronElements {
    /// The surfaces that are filled.
    #[serde(flatten)]
    pub surfaces: SurfaceOptions,
    /// How they are filled.
    #[serde(flatten)]
    pub tetrahedra: TetrahedronOptions,
}

/// A mesh of a cut.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CutElements {
    /// Where the cut is.
    #[serde(flatten)]
    pub place: CutPlace,
    /// How it is divided.
    #[serde(flatten)]
    pub triangles: TriangleOptions,
}

/// Where a cut is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CutPlace {
    /// The axis that the cut of `triangles` is perpendicular to.
    #[cfg_attr(feature = "openapi", schema(default = "z", required = false))]
    pub axis: Axis,
    /// Where it meets that axis. Default: the middle of the specimen.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_mm: Option<f64>,
}

/// One object with the fields of all meshes: a request may have no others.
#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for DeckOptions {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::schema::Schema> {
        crate::export::schema::merged([
            LoadCase::schema(),
            CutPlace::schema(),
            TriangleOptions::schema(),
            MeshOptions::schema(),
            VoxelElements::schema(),
        ])
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for DeckOptions {
    fn schemas(schemas: &mut Vec<(String, utoipa::openapi::RefOr<utoipa::openapi::schema::Schema>)>) {
        LoadCase::schemas(schemas);
        CutPlace::schemas(schemas);
        TriangleOptions::schemas(schemas);
        MeshOptions::schemas(schemas);
        VoxelElements::schemas(schemas);
    }
}

impl DeckOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let has_load = object.has("load");
        let case = LoadCase::read(object);
        let (mut case, mesh) = (case, DeckMesh::read(object)?);
        if let (Some(case), DeckMesh::Triangles(own)) = (&mut case, &mesh)
            && !has_load
            && !case.load.fits_cut(own.place.axis)
        {
            case.load = Load::UniaxialY;
        }
        Some(Self { case: case?, mesh })
    }
}

impl LoadCase {
    fn read(object: &mut Object<'_>) -> Option<Self> {
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
        Some(Self {
            format: format?,
            solver: solver?,
            load: load?,
            strain: strain.ok()?,
            temperature_change_k: change.ok()?,
            materials,
        })
    }
}

impl DeckMesh {
    /// Its elements.
    #[must_use]
    pub fn elements(&self) -> DeckElements {
        match self {
            Self::Voxels(_) => DeckElements::Voxels,
            Self::Tetrahedra(_) => DeckElements::Tetrahedra,
            Self::Triangles(_) => DeckElements::Triangles,
        }
    }

    /// Whether `max_segments` is what `segments` implies.
    pub(in crate::export) fn has_default_max_segments(&self) -> bool {
        match self {
            Self::Voxels(_) | Self::Triangles(_) => true,
            Self::Tetrahedra(own) => own.alone().has_default_max_segments(),
        }
    }

    fn read(object: &mut Object<'_>) -> Option<Self> {
        let elements = object.optional("elements").map_or(Some(DeckElements::Voxels), |at| {
            at.choice(&DeckElements::ALL.map(|elements| (elements.name(), elements)))
        });
        // Each option is asked for whatever the elements are, so that the names of all are known.
        match elements {
            Some(DeckElements::Tetrahedra) => {
                let sound = object.refuse_all(&VoxelElements::NAMES, OF_VOXELS)
                    & object.refuse_all(&CutElements::OWN_NAMES, OF_TRIANGLES);
                let read = MeshOptions::read_tetrahedra(object)?;
                let (surfaces, tetrahedra) = (read.surfaces, read.tetrahedra?);
                sound.then_some(Self::Tetrahedra(TetrahedronElements { surfaces, tetrahedra }))
            }
            Some(DeckElements::Triangles) => {
                let is_other = |name: &&'static str| !TriangleOptions::NAMES.contains(name);
                let surfaces: Vec<&'static str> =
                    SurfaceOptions::NAMES.into_iter().filter(is_other).collect();
                let tetrahedra: Vec<&'static str> =
                    TetrahedronOptions::NAMES.into_iter().filter(is_other).collect();
                let sound = object.refuse_all(&VoxelElements::NAMES, OF_VOXELS)
                    & object.refuse_all(&surfaces, OF_TETRAHEDRA)
                    & object.refuse_all(&tetrahedra, OF_TETRAHEDRA);
                let place = read_place(object);
                let triangles = TriangleOptions::read_sizes(object);
                let (axis, at_mm) = place?;
                let own = CutElements { place: CutPlace { axis, at_mm }, triangles: triangles? };
                sound.then_some(Self::Triangles(own))
            }
            _ => {
                let voxels = VoxelElements::read(object);
                let sound = object.refuse_all(&CutElements::OWN_NAMES, OF_TRIANGLES)
                    & object.refuse_all(&SurfaceOptions::NAMES, OF_MESHES)
                    & object.refuse_all(&TetrahedronOptions::NAMES, OF_MESHES);
                (elements.is_some() && sound).then_some(Self::Voxels(voxels?))
            }
        }
    }
}

impl CutElements {
    /// Names of the options that no other mesh has.
    const OWN_NAMES: [&str; 3] = ["axis", "at_mm", "plane"];

    /// The cut alone, as keywords.
    pub(in crate::export) fn alone(&self) -> SliceOptions {
        let CutPlace { axis, at_mm } = self.place;
        let cut = CutOptions { format: SliceFormat::Inp, axis, at_mm, pixels: None };
        SliceOptions { cut, triangles: Some(self.triangles.clone()) }
    }
}

impl VoxelElements {
    /// Names of the options.
    const NAMES: [&str; 2] = ["cells", "voxel_mm"];

    fn read(object: &mut Object<'_>) -> Option<Self> {
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
        let (cells, voxel_mm) = (cells?, voxel_mm?);
        let cells = if voxel_mm.is_none() { cells.or(Some(DEFAULT_CELLS)) } else { None };
        Some(Self { elements: DeckElements::Voxels, cells, voxel_mm })
    }

    /// The voxels of which the deck is made.
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

impl TetrahedronElements {
    /// The mesh alone, as keywords.
    pub(in crate::export) fn alone(&self) -> MeshRequest {
        let (surfaces, tetrahedra) = (self.surfaces.clone(), Some(self.tetrahedra.clone()));
        MeshRequest::Inp(MeshOptions { surfaces, tetrahedra })
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
