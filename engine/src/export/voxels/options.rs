//! What a voxel model may be asked for.

use serde::ser::SerializeMap as _;
use serde::{Deserialize, Serialize, Serializer};

use crate::export::ExportError;
use crate::request::decode::{Bound, Object};
use crate::request::materials::OPTION;
use crate::request::{MAX_LENGTH_MM, Materials, Specimen};

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
    /// The labels as an array of NumPy, indexed `[x, y, z]`, x fastest.
    Npy,
    /// VTK legacy format, by `for=amitex`.
    Vtk,
    /// An archive of the files that a program reads, by `for=fans`.
    Zip,
}

impl VoxelFormat {
    /// All formats.
    pub const ALL: [Self; 6] = [Self::Vti, Self::Raw, Self::Inp, Self::Npy, Self::Vtk, Self::Zip];

    /// Name of the format, and file extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vti => "vti",
            Self::Raw => "raw",
            Self::Inp => "inp",
            Self::Npy => "npy",
            Self::Vtk => "vtk",
            Self::Zip => "zip",
        }
    }

    /// Media type without parameters.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Vti => "application/vnd.vtk.imagedata+xml",
            Self::Raw | Self::Npy | Self::Vtk => "application/octet-stream",
            Self::Inp => "text/plain",
            Self::Zip => "application/zip",
        }
    }

    /// The program that the format is written for, where it is for one alone.
    pub fn program(self) -> Option<Reader> {
        match self {
            Self::Vti | Self::Raw | Self::Inp | Self::Npy => None,
            Self::Vtk => Some(Reader::Amitex),
            Self::Zip => Some(Reader::Fans),
        }
    }
}

/// A program that reads the voxels as they are. It decides the format, names, types, units and numbers of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = VoxelReader))]
#[serde(rename_all = "lowercase")]
pub enum Reader {
    /// DAMASK, `vti`: cell data `material` of Int64 from 0, in binary encoding, lengths in m.
    Damask,
    /// AMITEX, `vtk`: `MaterialId` of bytes from 1, lengths in mm.
    Amitex,
    /// FANS, `zip`: its input as JSON, the array as `npy`, and a script in Python that makes the HDF5 file.
    Fans,
    /// automesh, `npy`: bytes, 0 outside, 1 matrix, aggregate from 2.
    Automesh,
}

impl Reader {
    /// All readers.
    pub const ALL: [Self; 4] = [Self::Damask, Self::Amitex, Self::Fans, Self::Automesh];

    /// Its name in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Damask => "damask",
            Self::Amitex => "amitex",
            Self::Fans => "fans",
            Self::Automesh => "automesh",
        }
    }

    /// The format that it reads.
    pub fn format(self) -> VoxelFormat {
        match self {
            Self::Damask => VoxelFormat::Vti,
            Self::Amitex => VoxelFormat::Vtk,
            Self::Fans => VoxelFormat::Zip,
            Self::Automesh => VoxelFormat::Npy,
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
    /// The program that is to read the file. It decides `format`; `vtk` and `zip` are written for a program alone.
    #[cfg_attr(feature = "openapi", schema(rename = "for", required = false))]
    pub reader: Option<Reader>,
    /// Voxels along the longest edge of the specimen. Default: 100, unless `voxel_mm` is given.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1, maximum = 8192))]
    pub cells: Option<u32>,
    /// Edge of a voxel, met as nearly as whole numbers of voxels along the specimen's edges allow.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    pub voxel_mm: Option<f64>,
    /// What a label says, for `vti`, `raw`, `npy` and `vtk`; `grain` neither for `amitex` nor for `automesh`.
    #[cfg_attr(feature = "openapi", schema(default = "phase", required = false))]
    pub label: Label,
    /// Whether each voxel's share of aggregate is written too (float32), for `vti`.
    #[cfg_attr(feature = "openapi", schema(default = false, required = false))]
    pub fractions: bool,
    /// Lines per edge of a voxel by which shares of aggregate are measured: samples² lines along x through
    /// each voxel, clipped exactly.
    #[cfg_attr(feature = "openapi", schema(default = 4, required = false, minimum = 1, maximum = 16))]
    pub samples: u32,
    /// The materials of the phases for `for=fans`; those of the packing's request when absent.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub materials: Option<Materials>,
}

/// Whether labels are the user's choice.
fn has_labels(format: VoxelFormat) -> bool {
    !matches!(format, VoxelFormat::Inp | VoxelFormat::Zip)
}

/// Whether shares of aggregate can be written beside the labels.
fn has_fractions(format: VoxelFormat, reader: Option<Reader>) -> bool {
    format == VoxelFormat::Vti && reader.is_none()
}

/// What is wrong with a format for a reader, or for none.
fn format_fault(format: VoxelFormat, reader: Option<Reader>) -> Option<String> {
    let wanted = reader.map_or(format, Reader::format);
    if wanted != format {
        let reader = reader.map_or("", Reader::name);
        return Some(format!("{reader} reads {}: must be that, or left out", wanted.name()));
    }
    let needed = format.program().filter(|_| reader.is_none())?;
    Some(format!("{} is written for a program: must have for={} beside it", format.name(), needed.name()))
}

/// The options that the format has, so that what is written reads back.
impl Serialize for VoxelOptions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("format", &self.format)?;
        if let Some(reader) = self.reader {
            map.serialize_entry("for", &reader)?;
        }
        if let Some(cells) = self.cells {
            map.serialize_entry("cells", &cells)?;
        }
        if let Some(voxel_mm) = self.voxel_mm {
            map.serialize_entry("voxel_mm", &voxel_mm)?;
        }
        if has_labels(self.format) {
            map.serialize_entry("label", &self.label)?;
        }
        if has_fractions(self.format, self.reader) {
            map.serialize_entry("fractions", &self.fractions)?;
        }
        map.serialize_entry("samples", &self.samples)?;
        if let Some(materials) = &self.materials {
            map.serialize_entry(OPTION, materials)?;
        }
        map.end()
    }
}

impl VoxelOptions {
    /// Reads the format and its options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format_at = object.optional("format");
        let format = match &format_at {
            Some(at) => Some(at.choice(&VoxelFormat::ALL.map(|format| (format.name(), format)))?),
            None => None,
        };
        let has_readers =
            format.is_none_or(|format| Reader::ALL.iter().any(|reader| reader.format() == format));
        let reader = match has_readers.then(|| object.optional("for")).flatten() {
            Some(at) => Some(at.choice(&Reader::ALL.map(|reader| (reader.name(), reader)))?),
            None => None,
        };
        let format = format.unwrap_or_else(|| reader.map_or(VoxelFormat::Vti, Reader::format));
        if let Some((at, fault)) = format_at.zip(format_fault(format, reader)) {
            at.fault(fault);
            return None;
        }
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
        let label = match has_labels(format).then(|| object.optional("label")).flatten() {
            Some(at) => {
                let mut choices =
                    vec![("phase", Label::Phase), ("grain", Label::Grain), ("aggregate", Label::Aggregate)];
                // The numbers of these are bytes.
                let bytes = matches!(reader, Some(Reader::Amitex | Reader::Automesh));
                choices.retain(|(_, label)| !bytes || *label != Label::Grain);
                at.choice(&choices)
            }
            // Each phase has its own material.
            None if reader == Some(Reader::Fans) => Some(Label::Aggregate),
            None => Some(Label::Phase),
        };
        let fractions = has_fractions(format, reader).then(|| object.optional("fractions")).flatten();
        let fractions = match fractions {
            Some(at) => at.boolean(),
            None => Some(false),
        };
        let samples = match object.optional("samples") {
            Some(at) => at.integer(1, MAX_SAMPLES.into()).map(|n| n as u32),
            None => Some(DEFAULT_SAMPLES),
        };
        let materials = (reader == Some(Reader::Fans)).then(|| Materials::read_option(object)).flatten();
        let (mut cells, voxel_mm) = (cells?, voxel_mm?);
        if voxel_mm.is_none() {
            cells = cells.or(Some(DEFAULT_CELLS));
        }
        let (label, fractions, samples) = (label?, fractions?, samples?);
        Some(Self { format, reader, cells, voxel_mm, label, fractions, samples, materials })
    }

    /// Refuses a specimen that the reader cannot compute.
    pub(super) fn check_specimen(&self, specimen: &Specimen) -> Result<(), ExportError> {
        if self.reader == Some(Reader::Fans) && specimen.domain().lateral().is_some() {
            return Err(ExportError::Unavailable(
                "FANS computes a periodic cell, and what is outside of a cylinder has no material: pack a box".into(),
            ));
        }
        Ok(())
    }
}
