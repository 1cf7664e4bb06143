//! What a voxel model may be asked for, and how large it may be.

use serde::ser::SerializeMap as _;
use serde::{Deserialize, Serialize, Serializer};

use super::{VoxelGrid, inp, vti};
use crate::export::ExportError;
use crate::plan::Limits;
use crate::request::decode::{Bound, Object};
use crate::request::{FieldError, MAX_LENGTH_MM};

/// Voxels along the longest edge, where nothing is asked for.
pub const DEFAULT_CELLS: u32 = 100;
/// Most voxels along an edge.
pub const MAX_CELLS: u32 = 8192;
/// Most voxels of a grid, whatever may be used.
pub const MAX_VOXELS: u64 = 4_000_000_000;
/// Most voxels of a model of hexahedra: a solver that reads text takes no more.
pub const MAX_HEXAHEDRA: u64 = 20_000_000;
/// Lines per edge of a voxel by which shares are measured, where nothing is asked for.
pub const DEFAULT_SAMPLES: u32 = 4;
/// Most lines per edge of a voxel by which shares are measured.
pub const MAX_SAMPLES: u32 = 16;

/// What the voxels are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = VoxelFormat))]
#[serde(rename_all = "lowercase")]
pub enum VoxelFormat {
    /// VTK XML image data, raw appended: cell data `label`, and `fraction` on request.
    Vti,
    /// The labels and nothing else, little-endian, x fastest.
    Raw,
    /// Abaqus keywords: nodes, hexahedra, sets and surfaces, to be included into a part.
    Inp,
}

impl VoxelFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Vti, Self::Raw, Self::Inp];

    /// Name of the format, and file extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vti => "vti",
            Self::Raw => "raw",
            Self::Inp => "inp",
        }
    }

    /// Media type without parameters.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Vti => "application/vnd.vtk.imagedata+xml",
            Self::Raw => "application/octet-stream",
            Self::Inp => "text/plain",
        }
    }
}

/// What a label says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = VoxelLabel))]
#[serde(rename_all = "lowercase")]
pub enum Label {
    /// 0 matrix, 1 aggregate, 2 outside of a cylinder; a byte.
    Phase,
    /// 0 matrix, else the grain's id + 1, or 4294967295 outside of a cylinder; four bytes.
    Grain,
    /// 0 matrix, else the number of the grain's aggregate, counted from 1, or 255 outside of a cylinder; a byte. A mix
    /// that names no aggregates is one.
    Aggregate,
}

impl Label {
    /// Bytes of a label.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Phase | Self::Aggregate => 1,
            Self::Grain => 4,
        }
    }

    /// NumPy's name of the type.
    pub fn dtype(self) -> &'static str {
        match self {
            Self::Phase | Self::Aggregate => "|u1",
            Self::Grain => "<u4",
        }
    }

    /// Label of what lies outside of a cylinder.
    pub fn outside(self) -> u32 {
        match self {
            Self::Phase => 2,
            Self::Grain => u32::MAX,
            Self::Aggregate => u8::MAX.into(),
        }
    }
}

/// Options of a voxel model.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = VoxelOptions))]
pub struct VoxelOptions {
    /// What the voxels are written as.
    #[cfg_attr(feature = "openapi", schema(default = "vti", required = false))]
    pub format: VoxelFormat,
    /// Voxels along the longest edge of the specimen. Default: 100, unless `voxel_mm` is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1, maximum = 8192))]
    pub cells: Option<u32>,
    /// Edge of a voxel, met as nearly as whole numbers of voxels along the specimen's edges allow.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    pub voxel_mm: Option<f64>,
    /// What a label says, for `vti` and `raw`.
    #[cfg_attr(feature = "openapi", schema(default = "phase", required = false))]
    pub label: Label,
    /// Whether each voxel's share of aggregate is written too (float32), for `vti`.
    #[cfg_attr(feature = "openapi", schema(default = false, required = false))]
    pub fractions: bool,
    /// Lines per edge of a voxel by which shares of aggregate are measured: samples² lines along x through
    /// each voxel, clipped exactly.
    #[cfg_attr(feature = "openapi", schema(default = 4, required = false, minimum = 1, maximum = 16))]
    pub samples: u32,
}

/// The options that the format has, so that what is written reads back.
impl Serialize for VoxelOptions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("format", &self.format)?;
        if let Some(cells) = self.cells {
            map.serialize_entry("cells", &cells)?;
        }
        if let Some(voxel_mm) = self.voxel_mm {
            map.serialize_entry("voxel_mm", &voxel_mm)?;
        }
        if self.format != VoxelFormat::Inp {
            map.serialize_entry("label", &self.label)?;
        }
        if self.format == VoxelFormat::Vti {
            map.serialize_entry("fractions", &self.fractions)?;
        }
        map.serialize_entry("samples", &self.samples)?;
        map.end()
    }
}

impl VoxelOptions {
    /// Reads the format and its options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = match object.optional("format") {
            Some(at) => at.choice(&VoxelFormat::ALL.map(|format| (format.name(), format)))?,
            None => VoxelFormat::Vti,
        };
        let cells = match object.optional("cells") {
            Some(at) => at.integer(1, MAX_CELLS.into()).map(|n| Some(n as u32)),
            None => Some(None),
        };
        let voxel_mm = match object.optional("voxel_mm") {
            Some(at) if matches!(cells, Some(Some(_))) => {
                at.fault("cells and voxel_mm say the same: leave one of them out");
                None
            }
            Some(at) => at.number(Bound::positive(MAX_LENGTH_MM, "mm")).map(Some),
            None => Some(None),
        };
        // What means nothing for a format is unknown there.
        let label = match (format != VoxelFormat::Inp).then(|| object.optional("label")).flatten() {
            Some(at) => at.choice(&[
                ("phase", Label::Phase),
                ("grain", Label::Grain),
                ("aggregate", Label::Aggregate),
            ]),
            None => Some(Label::Phase),
        };
        let fractions = match (format == VoxelFormat::Vti).then(|| object.optional("fractions")).flatten() {
            Some(at) => at.boolean(),
            None => Some(false),
        };
        let samples = match object.optional("samples") {
            Some(at) => at.integer(1, MAX_SAMPLES.into()).map(|n| n as u32),
            None => Some(DEFAULT_SAMPLES),
        };
        let (mut cells, voxel_mm) = (cells?, voxel_mm?);
        if voxel_mm.is_none() {
            cells = cells.or(Some(DEFAULT_CELLS));
        }
        Some(Self { format, cells, voxel_mm, label: label?, fractions: fractions?, samples: samples? })
    }

    /// Length of the file, but for a head of a kilobyte; of `inp` the most it can be.
    pub(super) fn bytes(&self, grid: &VoxelGrid) -> u64 {
        match self.format {
            VoxelFormat::Raw => grid.voxels() * self.label.bytes(),
            VoxelFormat::Vti => grid.voxels() * vti::bytes_per_voxel(self),
            VoxelFormat::Inp => inp::most_bytes(grid),
        }
    }

    /// Judges the size of the grid.
    pub(super) fn check(&self, grid: &VoxelGrid, limits: &Limits) -> Result<(), ExportError> {
        let pointer = if self.voxel_mm.is_some() { "/voxel_mm" } else { "/cells" };
        let refused = |detail: String| {
            let [x, y, z] = grid.shape;
            let detail = format!("{x} x {y} x {z} voxels are {detail}");
            Err(ExportError::TooLarge(FieldError { pointer: pointer.into(), detail }))
        };
        if let Some(n) = grid.shape.into_iter().find(|n| *n > MAX_CELLS as usize) {
            return refused(format!("{n} along an edge: at most {MAX_CELLS} are made"));
        }
        let voxels = grid.voxels();
        let most = if self.format == VoxelFormat::Inp { MAX_HEXAHEDRA } else { MAX_VOXELS };
        let bytes = self.bytes(grid);
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        if voxels > most {
            return refused(format!(
                "{voxels} in all, a file of {} MB: at most {most} are made",
                megabytes(bytes)
            ));
        }
        if bytes > limits.max_memory_bytes {
            return refused(format!(
                "a file of {} MB: at most {} MB may be made",
                megabytes(bytes),
                limits.max_memory_bytes / 1_000_000
            ));
        }
        Ok(())
    }
}
