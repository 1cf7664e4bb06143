//! Plane cuts through a packing: the sections of its grains, their area, and the picture, table or 2D model of them.
//!
//! The common two-dimensional mesoscale model of concrete is such a cut; `triangles` meshes it. A cut is perpendicular
//! to one axis; its own axes `u`, `v` are the other two in the order x, y, z, so that `v` points upwards wherever z is
//! one of them. Spheres are cut in circles, ellipsoids in ellipses, polyhedra in polygons (`grain::figure`).

mod coarse;
mod cut;
mod geo;
mod json;
mod png;
mod report_check;
mod sizes;
mod svg;
mod triangles;

use std::io::{BufWriter, Write};

use serde::{Deserialize, Serialize};

pub use crate::domain::Outline;
pub use crate::grain::figure::{Ellipse, Figure, FigureKind, Polygon, TOLERANCE};
pub use cut::{Cut, Section};
pub use json::SliceDocument;
pub(super) use triangles::mesh_of;
pub use triangles::{SliceElements, TriangleOptions, TriangleReport};

use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::estimate::{Expected, ExportEstimate};
use crate::export::groups::AggregateGroups;
use crate::export::kind::{Export, Made};
use crate::export::steps::Steps;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::GrainKind;
use crate::request::decode::{Bound, Object};
use crate::request::{Axis, FieldError, MAX_LENGTH_MM, Specimen};
use report_check::check_slice;
use sizes::Sizes;

/// Pixels along the longer edge of a picture, where none are asked for.
pub const DEFAULT_PIXELS: u32 = 1000;
/// Fewest pixels along the longer edge of a picture.
pub const MIN_PIXELS: u32 = 16;
/// Most pixels along the longer edge of a picture.
pub const MAX_PIXELS: u32 = 8192;

/// What is made of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = SliceFormat))]
#[serde(rename_all = "lowercase")]
pub enum SliceFormat {
    /// A drawing at full scale, for print.
    Svg,
    /// A picture of the cut and nothing else, anti-aliased by exact areas.
    Png,
    /// The circles, ellipses or polygons and the figures.
    Json,
    /// A Gmsh script of the plane surfaces, for a 2D mesh.
    Geo,
    /// A Gmsh file (MSH 4.1) of triangles.
    Msh,
    /// Triangles as keywords for Abaqus and `CalculiX`.
    Inp,
    /// Triangles as an unstructured grid of VTK.
    Vtu,
}

impl SliceFormat {
    /// All formats.
    pub const ALL: [Self; 7] = [Self::Svg, Self::Png, Self::Json, Self::Geo, Self::Msh, Self::Inp, Self::Vtu];

    /// Whether it has triangles, which an installed Gmsh makes.
    pub fn has_triangles(self) -> bool {
        matches!(self, Self::Msh | Self::Inp | Self::Vtu)
    }

    /// Name of the format, and file extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Png => "png",
            Self::Json => "json",
            Self::Geo => "geo",
            Self::Msh => "msh",
            Self::Inp => "inp",
            Self::Vtu => "vtu",
        }
    }

    /// Media type without parameters.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Svg => "image/svg+xml",
            Self::Png => "image/png",
            Self::Json => "application/json",
            Self::Geo | Self::Inp => "text/plain",
            Self::Msh => "application/vnd.gmsh.msh",
            Self::Vtu => "application/vnd.vtk.unstructuredgrid+xml",
        }
    }
}

/// Which cut, in which format, and of which triangles where that has some.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SliceOptions {
    /// The cut and its format.
    #[serde(flatten)]
    pub cut: CutOptions,
    /// The triangles, where there are any.
    #[serde(flatten)]
    pub triangles: Option<TriangleOptions>,
}

/// One object with the fields of both: a request may have no others.
#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for SliceOptions {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::schema::Schema> {
        crate::export::schema::merged([CutOptions::schema(), TriangleOptions::schema()])
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for SliceOptions {
    fn schemas(schemas: &mut Vec<(String, utoipa::openapi::RefOr<utoipa::openapi::schema::Schema>)>) {
        CutOptions::schemas(schemas);
        TriangleOptions::schemas(schemas);
    }
}

/// Which cut, and in which format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CutOptions {
    /// What is made of the cut. Default: `svg`, or `msh` where `elements` is given.
    #[cfg_attr(feature = "openapi", schema(default = "svg", required = false))]
    pub format: SliceFormat,
    /// The axis that the cut is perpendicular to.
    #[cfg_attr(feature = "openapi", schema(default = "z", required = false))]
    pub axis: Axis,
    /// Where the cut meets that axis. Default: the middle of the specimen.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_mm: Option<f64>,
    /// Pixels along the longer edge, for `png` alone. Default: 1000.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 16, maximum = 8192))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels: Option<u32>,
}

impl SliceOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let cut = CutOptions::read(object);
        let has_triangles = cut.as_ref().is_some_and(|cut| cut.format.has_triangles());
        let triangles = if has_triangles { Some(TriangleOptions::read(object)?) } else { None };
        Some(Self { cut: cut?, triangles })
    }
}

/// Reads `axis` and `at_mm` out of a request; faults go where the object's go.
pub(super) fn read_place(object: &mut Object<'_>) -> Option<(Axis, Option<f64>)> {
    let axis = match object.optional("axis") {
        Some(at) => at.choice(&Axis::ALL.map(|axis| (axis.name(), axis))),
        None => Some(Axis::Z),
    };
    let at_mm = match object.optional("at_mm") {
        Some(at) => at.number(Bound::closed(0.0, MAX_LENGTH_MM, "mm")).map(Some),
        None => Some(None),
    };
    Some((axis?, at_mm?))
}

impl CutOptions {
    fn read(object: &mut Object<'_>) -> Option<Self> {
        let standard = if object.has("elements") { SliceFormat::Msh } else { SliceFormat::Svg };
        let format = match object.optional("format") {
            Some(at) => at.choice(&SliceFormat::ALL.map(|format| (format.name(), format))),
            None => Some(standard),
        };
        let place = read_place(object);
        let pixels = match object.optional("pixels") {
            Some(at) if format.is_some_and(|format| format != SliceFormat::Png) => {
                at.fault("pixels are for the format \"png\": leave them out");
                None
            }
            Some(at) => at.integer(MIN_PIXELS.into(), MAX_PIXELS.into()).map(|n| Some(n as u32)),
            None => Some((format == Some(SliceFormat::Png)).then_some(DEFAULT_PIXELS)),
        };
        let (axis, at_mm) = place?;
        Some(Self { format: format?, axis, at_mm, pixels: pixels? })
    }

    /// Where the cut of that specimen meets its axis.
    pub fn at_mm(&self, specimen: &Specimen) -> f64 {
        self.at_mm.unwrap_or(specimen.bounds_mm()[self.axis.index()] / 2.0)
    }
}

/// The figures of a cut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = SliceReport))]
pub struct SliceReport {
    /// The axis that the cut is perpendicular to.
    pub axis: Axis,
    /// Where it meets that axis.
    pub at_mm: f64,
    /// The axes `u`, `v` of the plane.
    pub plane: [Axis; 2],
    /// The part of the plane inside the specimen.
    pub outline: Outline,
    /// Its area.
    pub area_mm2: f64,
    /// Circles cut, with the images of those that cross the faces of a periodic box; 0 where grains are not spheres.
    pub circle_count: u64,
    /// Ellipses cut, with the images of those that cross the faces of a periodic box; absent where grains are not
    /// ellipsoids.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub ellipse_count: Option<u64>,
    /// Polygons cut, with the images of those that cross the faces of a periodic box; absent where grains are not
    /// polyhedra.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub polygon_count: Option<u64>,
    /// Area of the circles, ellipses or polygons inside the outline.
    pub aggregate_area_mm2: f64,
    /// Area of the circles, ellipses or polygons over that of the cut; exact, but for rounded polyhedra, whose polygons
    /// are inscribed.
    pub area_fraction: f64,
    /// Measures of the picture, for the format `png`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub image: Option<Image>,
    /// The triangles, for the formats that have them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub triangles: Option<TriangleReport>,
}

/// Measures of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = SliceImage))]
pub struct Image {
    /// Pixels along `u` and `v`.
    pub pixels: [u32; 2],
    /// Size of a pixel along `u` and `v`.
    pub pixel_mm: [f64; 2],
}

impl Export for SliceOptions {
    type Report = SliceReport;

    const NAME: &'static str = "slice";
    const FORMATS: &'static [&'static str] = &["svg", "png", "json", "geo", "msh", "inp", "vtu"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.cut.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.cut.format.media_type()
    }

    /// Judges options before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Invalid`] where the plane does not cut the specimen, and [`ExportError::TooLarge`] for
    /// triangles that are too many.
    fn check(&self, specimen: &Specimen, limits: &Limits) -> Result<(), ExportError> {
        let own = &self.cut;
        check_place(specimen, own)?;
        match &self.triangles {
            Some(triangles) => {
                let [u, v] = own.axis.plane().each(|axis| specimen.bounds_mm()[axis.index()]);
                triangles.check([u, v], 0.0, limits)
            }
            None => Ok(()),
        }
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        Ok(ExportEstimate::of_bytes(expected_bytes(of.specimen(), self, of.sum_mm(), of.kind())))
    }

    fn is_quick(&self) -> bool {
        self.triangles.is_none()
    }

    fn needs_mesher(&self) -> bool {
        self.triangles.is_some()
    }

    fn check_report(&self, _: &Made<'_>, report: &SliceReport) -> Result<(), String> {
        check_slice(report)
    }

    /// Cuts the packing and writes what is asked for.
    ///
    /// # Errors
    /// Those of [`Export::check`], of the writer, and [`ExportError::Stopped`].
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<SliceReport, ExportError> {
        self.check(model.specimen, limits)?;
        go_on(control)?;
        let SliceOptions { cut: options, triangles } = self;
        let cut = Cut::new(model, options.axis, options.at_mm(model.specimen))?;
        let mut report = cut.report();
        if let Some(triangles) = triangles {
            let meshed = mesh_of(model, &cut, triangles, limits, control)?;
            meshed.write(options.format, model.provenance, control, out)?;
            report.triangles = Some(meshed.report);
            return Ok(report);
        }
        let unit = if options.format == SliceFormat::Png { "rows" } else { cut.noun() };
        let progress = |done: u64, total: u64| {
            Steps { control, total: total as usize, unit, message: "" }.report(done as usize);
            go_on(control)
        };
        let sections = cut.sections.len() as u64;
        let mut out = BufWriter::new(out);
        match options.format {
            SliceFormat::Svg => svg::write(&cut, &report, &mut out)?,
            SliceFormat::Png => {
                let image = png::measures(&cut.outline, options.pixels.unwrap_or(DEFAULT_PIXELS));
                report.image = Some(image);
                png::write(&cut, &image, &mut out, &progress)?;
            }
            SliceFormat::Json => SliceDocument { report: &report, cut: &cut }.write(&mut out)?,
            // Those with triangles are written above.
            SliceFormat::Geo | SliceFormat::Msh | SliceFormat::Inp | SliceFormat::Vtu => {
                geo::write(&cut, Sizes::of(&cut.outline), &AggregateGroups::of(model), &mut out)?;
            }
        }
        out.flush()?;
        progress(sections, sections)?;
        Ok(report)
    }
}

fn check_place(specimen: &Specimen, options: &CutOptions) -> Result<(), ExportError> {
    let at_mm = options.at_mm(specimen);
    let length = specimen.bounds_mm()[options.axis.index()];
    // A plane that touches a cylinder's lateral surface cuts out a line: nothing has a share of its area.
    let touches = specimen.domain().lateral().is_some() && options.axis != Axis::Z;
    let (inside, bound) = if touches {
        (at_mm > 0.0 && at_mm < length, format!("greater than 0 and less than {length} mm"))
    } else {
        ((0.0..=length).contains(&at_mm), format!("at least 0 and at most {length} mm"))
    };
    if inside {
        return Ok(());
    }
    let axis = options.axis.name();
    let detail = format!("{at_mm} is out of range: a cut along {axis} must be {bound}, inside the specimen");
    Err(ExportError::Invalid(vec![FieldError { pointer: "/at_mm".into(), detail }]))
}

/// Length of the file of a slice through grains of that sum of diameters: a plane meets a grain with the probability
/// diameter over length.
pub(super) fn expected_bytes(
    specimen: &Specimen,
    options: &SliceOptions,
    sum_mm: f64,
    kind: GrainKind,
) -> u64 {
    let bounds = specimen.bounds_mm();
    let SliceOptions { cut: options, triangles } = options;
    let sections = sum_mm / bounds[options.axis.index()];
    if let Some(triangles) = triangles {
        let size_mm = options.axis.plane().each(|axis| bounds[axis.index()]);
        return triangles.expected_bytes(size_mm, sections);
    }
    let (frame, circle, ellipse, polygon) = match options.format {
        SliceFormat::Svg => (1000.0, 45.0, 115.0, 550.0),
        SliceFormat::Json => (350.0, 105.0, 145.0, 1800.0),
        SliceFormat::Geo | SliceFormat::Msh | SliceFormat::Inp | SliceFormat::Vtu => {
            (1400.0, 190.0, 165.0, 3600.0)
        }
        SliceFormat::Png => {
            let [u, v] = options.axis.plane().each(|axis| bounds[axis.index()]);
            let long = f64::from(options.pixels.unwrap_or(DEFAULT_PIXELS));
            return (0.1 * long * long * u.min(v) / u.max(v)) as u64 + 1000;
        }
    };
    let kinds = FigureKind::of_grains(kind);
    let bytes = kinds.iter().map(|kind| match kind {
        FigureKind::Circle => circle,
        FigureKind::Ellipse => ellipse,
        FigureKind::Polygon => polygon,
    });
    let per_section = bytes.sum::<f64>() / kinds.len() as f64;
    (frame + per_section * sections) as u64
}

#[cfg(test)]
mod ellipsoid_tests;
#[cfg(test)]
mod polyhedron_tests;
#[cfg(test)]
mod tests;
