//! Options of surface meshes: how long edges are, and what is done about the volume of polyhedra.

use std::f64::consts::PI;

use serde::Serialize;

use crate::request::MAX_LENGTH_MM;
use crate::request::decode::{At, Bound, Object};

/// Bounds of both numbers of segments.
pub(super) const SEGMENTS: (u32, u32) = (6, 256);
/// Segments of a circumference where neither they nor a size are given.
const DEFAULT_SEGMENTS: u32 = 16;
/// Shortest edge that closeness may ask for, in edges of where nothing is close.
const FLOOR: f64 = 0.25;
/// Longest file that is made unless more is asked for, in bytes.
pub(super) const DEFAULT_MAX_BYTES: u64 = 500_000_000;

/// How finely surfaces are meshed.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SurfaceOptions {
    /// Segments of the circumference of each grain; met within 15 % from 8 on. Default: 16, where there is no
    /// `size_mm`.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 6, maximum = 256))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub segments: Option<u32>,
    /// Length of edges in mm where nothing is close, the same for all grains; in place of `segments`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_mm: Option<f64>,
    /// No edge is asked to be shorter, in mm; grains keep at least 6 segments.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_size_mm: Option<f64>,
    /// No edge is asked to be longer, in mm; grains have at most 256 segments.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_size_mm: Option<f64>,
    /// Whether edges become shorter where surfaces come close to one another: an edge is at most three times the gap
    /// that it faces.
    #[cfg_attr(feature = "openapi", schema(default = true, required = false))]
    pub size_field: bool,
    /// Segments of a circumference that the size field may ask for; four times `segments` when absent. With `size_mm`,
    /// the size field stops at a quarter of that, or at `min_size_mm`.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 6, maximum = 256))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_segments: Option<u32>,
    /// Whether polyhedra are enlarged to the volume of their spheres.
    #[cfg_attr(feature = "openapi", schema(default = "scaled", required = false))]
    pub volume_correction: VolumeCorrection,
    /// Whether faces of polyhedra that are too narrow for the edges may be left out.
    #[cfg_attr(feature = "openapi", schema(default = "simplified", required = false))]
    pub faces: FaceChoice,
    /// Longest file that may be made, in bytes: a mesh that is estimated to be longer is refused.
    #[cfg_attr(feature = "openapi", schema(default = 500_000_000, required = false, minimum = 1))]
    pub max_bytes: u64,
}

/// Whether polyhedra are enlarged to the volume of their spheres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum VolumeCorrection {
    /// Inscribed: vertices on the spheres, a few percent too little volume.
    None,
    /// Vertices moved outwards until the polyhedron has the volume of its sphere, as far as half of every gap is left.
    #[default]
    Scaled,
}

/// Share of the gap between two grains, or a grain and a wall, that a correction of volumes may use up.
pub(super) const GAP_SHARE: f64 = 0.5;

/// Which faces of polyhedra are meshed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum FaceChoice {
    /// Faces and edges that are much narrower than the edges asked for may be left out, and the other faces moved, as
    /// far as the volume is kept.
    #[default]
    Simplified,
    /// All faces of sharp grains, as they are.
    Exact,
}

impl FaceChoice {
    /// Reads `faces` out of a request; faults go where the object's go.
    pub(super) fn read(object: &mut Object<'_>) -> Option<Self> {
        match object.optional("faces") {
            Some(at) => at.choice(&[("simplified", Self::Simplified), ("exact", Self::Exact)]),
            None => Some(Self::default()),
        }
    }
}

impl VolumeCorrection {
    /// Reads `volume_correction` out of a request; faults go where the object's go.
    pub(super) fn read(object: &mut Object<'_>) -> Option<Self> {
        match object.optional("volume_correction") {
            Some(at) => at.choice(&[("none", Self::None), ("scaled", Self::Scaled)]),
            None => Some(Self::default()),
        }
    }
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self {
            segments: Some(DEFAULT_SEGMENTS),
            size_mm: None,
            min_size_mm: None,
            max_size_mm: None,
            size_field: true,
            max_segments: Some(4 * DEFAULT_SEGMENTS),
            volume_correction: VolumeCorrection::default(),
            faces: FaceChoice::default(),
            max_bytes: DEFAULT_MAX_BYTES,
        }
    }
}

impl SurfaceOptions {
    /// Names of the options.
    pub(in crate::export) const NAMES: [&str; 9] = [
        "segments",
        "size_mm",
        "min_size_mm",
        "max_size_mm",
        "size_field",
        "max_segments",
        "volume_correction",
        "faces",
        "max_bytes",
    ];

    /// These segments, and the size field up to four times as many.
    #[must_use]
    pub fn with_segments(self, segments: u32) -> Self {
        Self {
            segments: Some(segments),
            size_mm: None,
            max_segments: Some((4 * segments).min(SEGMENTS.1)),
            ..self
        }
    }

    /// Reads the options out of a request; faults go where the object's go.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let segments_at = object.optional("segments");
        let segments = number(segments_at.as_ref());
        let size_at = object.optional("size_mm");
        let size_mm = length(size_at.as_ref());
        let min_size_mm = length(object.optional("min_size_mm").as_ref());
        let max_at = object.optional("max_size_mm");
        let max_size_mm = length(max_at.as_ref());
        let size_field = object.optional("size_field").map_or(Some(true), |at| at.boolean());
        let most_at = object.optional("max_segments");
        let most = number(most_at.as_ref());
        let volume_correction = VolumeCorrection::read(object);
        let faces = FaceChoice::read(object);
        let max_bytes = object
            .optional("max_bytes")
            .map_or(Some(DEFAULT_MAX_BYTES), |at| at.integer(1, MOST_BYTES).map(|n| n as u64));
        let (segments, size_mm, most) = (segments.ok()?, size_mm.ok()?, most.ok()?);
        let (min_size_mm, max_size_mm) = (min_size_mm.ok()?, max_size_mm.ok()?);
        let mut sound = true;
        let mut refuse = |at: Option<&At<'_>>, detail: String| {
            at.inspect(|at| at.fault(detail));
            sound = false;
        };
        if size_mm.is_some() && segments.is_some() {
            refuse(size_at.as_ref(), "segments and size_mm say the same: leave one of them out".into());
        }
        if size_mm.is_some() && most.is_some() {
            let detail = "max_segments goes with segments: with size_mm give min_size_mm instead";
            refuse(most_at.as_ref(), detail.into());
        }
        if let (Some(low), Some(high)) = (min_size_mm, max_size_mm)
            && high < low
        {
            refuse(
                max_at.as_ref(),
                format!("{high} is out of range: must be at least min_size_mm, which is {low} mm"),
            );
        }
        let by_segments = size_mm.is_none().then(|| segments.unwrap_or(DEFAULT_SEGMENTS));
        let max_segments = by_segments.map(|n| most.unwrap_or((4 * n).min(SEGMENTS.1)));
        if let (Some(segments), Some(most)) = (by_segments, max_segments)
            && most < segments
        {
            let detail = format!("{most} is out of range: must be at least segments, which is {segments}");
            refuse(most_at.as_ref(), detail);
        }
        let read = Self {
            segments: by_segments,
            size_mm,
            min_size_mm,
            max_size_mm,
            size_field: size_field?,
            max_segments,
            volume_correction: volume_correction?,
            faces: faces?,
            max_bytes: max_bytes?,
        };
        sound.then_some(read)
    }

    /// Whether `max_segments` is what `segments` implies.
    pub(super) fn has_default_max_segments(&self) -> bool {
        self.max_segments == self.segments.map(|n| (4 * n).min(SEGMENTS.1))
    }

    /// Length of edges on a sphere of that diameter where nothing is close.
    pub(super) fn edge_mm(&self, diameter: f64) -> f64 {
        let segments = f64::from(self.segments.unwrap_or(DEFAULT_SEGMENTS));
        let edge = self.size_mm.unwrap_or(PI * diameter / segments);
        let edge = edge.max(self.min_size_mm.unwrap_or(0.0)).min(self.max_size_mm.unwrap_or(f64::INFINITY));
        edge.clamp(PI * diameter / f64::from(SEGMENTS.1), PI * diameter / f64::from(SEGMENTS.0))
    }

    /// Shortest edges that closeness may ask for on a sphere of that diameter.
    pub(super) fn floor_mm(&self, diameter: f64) -> f64 {
        let floor = match self.max_segments {
            Some(most) => PI * diameter / f64::from(most),
            None => FLOOR * self.edge_mm(diameter),
        };
        floor.max(self.min_size_mm.unwrap_or(0.0)).min(self.edge_mm(diameter))
    }
}

/// Most bytes that may be asked for: 1 PB, which JSON numbers hold exactly.
const MOST_BYTES: i64 = 1_000_000_000_000_000;

/// An option whose fault has been reported.
struct Refused;

/// An optional number of segments.
fn number(at: Option<&At<'_>>) -> Result<Option<u32>, Refused> {
    let read = at.map(|at| at.integer(SEGMENTS.0.into(), SEGMENTS.1.into()).ok_or(Refused));
    Ok(read.transpose()?.map(|n| n as u32))
}

/// An optional length.
fn length(at: Option<&At<'_>>) -> Result<Option<f64>, Refused> {
    at.map(|at| at.number(Bound::positive(MAX_LENGTH_MM, "mm")).ok_or(Refused)).transpose()
}
