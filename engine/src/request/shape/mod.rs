//! What a request says about the shapes of grains and about their orientation.
//!
//! Types, bounds and JSON form only; the laws of the axis ratios are those of [`crate::shape::ratios`].

mod presets;
mod ratios;
mod read;

use serde::Serialize;

use super::Axis;
use crate::shape::polyhedron::DrawnTemplates;
use crate::shape::ratios::AxisRatios;

pub use presets::ShapePreset;
pub(super) use read::{MixShapes, read_mix_shapes, read_orientation};

/// Most size classes with a shape of their own.
pub const MAX_SHAPE_CLASSES: usize = 16;
/// Most parts of a mixture of shapes.
pub const MAX_MIXTURE_PARTS: usize = 16;
/// Largest concentration of orientations about an axis, and largest away from it: axes then lie within some 6 degrees
/// of the axis or of the plane across it.
pub const MAX_CONCENTRATION: f64 = 100.0;

/// Most templates of all shapes of a mix, so that they are drawn and measured in a moment.
pub const MAX_TEMPLATES: u32 = 128;
/// Number of templates of a shape that names none.
pub const DEFAULT_TEMPLATES: u32 = 32;
/// Fewest half-spaces that cut a template.
pub const MIN_FACES: u32 = 6;
/// Most half-spaces that cut a template.
pub const MAX_FACES: u32 = 60;

/// The shape of the grains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum GrainShape {
    /// Grains of one shape.
    Plain(PlainShape),
    /// Grains of several shapes.
    Mixture(ShapeMixture),
}

/// Grains of several shapes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeMixture {
    /// Grains of several shapes.
    Mixture {
        /// The shapes with their shares of the volume.
        #[cfg_attr(
            feature = "openapi",
            schema(value_type = super::schema::OneOrMore<MixturePart>)
        )]
        of: Vec<MixturePart>,
    },
}

/// A shape of a mixture.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MixturePart {
    /// Share of the volume of the grains; the shares of a mixture sum to 1.
    #[cfg_attr(feature = "openapi", schema(exclusive_minimum = 0, maximum = 1))]
    pub share: f64,
    /// The shape.
    #[cfg_attr(feature = "openapi", schema(value_type = super::schema::PlainShapeInput))]
    pub shape: PlainShape,
}

/// A shape that is no mixture.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum PlainShape {
    /// Spheres.
    Sphere {},
    /// Ellipsoids with axes `a >= b >= c`.
    Ellipsoid {
        /// How the ratios of the axes are distributed.
        #[cfg_attr(feature = "openapi", schema(value_type = super::schema::AxisRatiosInput))]
        ratios: AxisRatios,
        /// The preset that these ratios are of, where the request named one.
        #[cfg_attr(
            feature = "openapi",
            schema(required = false, nullable, value_type = super::schema::ShapePresetName)
        )]
        #[serde(skip_serializing_if = "Option::is_none")]
        preset: Option<&'static str>,
    },
    /// Angular grains: convex polyhedra. Each grain is one of some templates, in its own size.
    Polyhedron {
        /// How templates are made.
        #[cfg_attr(feature = "openapi", schema(default = "cuts", required = false))]
        template: TemplateShape,
        /// Half-spaces that cut a template out of a ball; of `cuts` alone, 24 when absent. Some of them may leave no
        /// face.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 6, maximum = 60))]
        #[serde(skip_serializing_if = "Option::is_none")]
        faces: Option<u32>,
        /// How far the corners of a cube are displaced along each axis, at most, as a share of its edge; of
        /// `deformed_cuboid` alone, 0.2 when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 0.4))]
        #[serde(skip_serializing_if = "Option::is_none")]
        displacement: Option<f64>,
        /// The ratios by which templates are stretched, drawn for each template; 1 when absent. Laws with a target
        /// index are for ellipsoids alone.
        #[cfg_attr(
            feature = "openapi",
            schema(required = false, value_type = super::schema::AxisRatiosInput)
        )]
        ratios: AxisRatios,
        /// Radius by which edges and corners are rounded, over the equivalent diameter of the grain.
        #[cfg_attr(feature = "openapi", schema(default = 0, required = false, minimum = 0, maximum = 0.4))]
        rounding: f64,
        /// Number of templates; when absent 32, and 1 of a Platonic solid. All shapes of a mix have 128 at most.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1, maximum = 128))]
        template_count: u32,
        /// Seed of the templates, which do not depend on the seed of the job.
        #[cfg_attr(
            feature = "openapi",
            schema(default = 0, required = false, maximum = 9_007_199_254_740_991_u64)
        )]
        template_seed: u64,
        /// The templates, once they are drawn.
        #[serde(skip)]
        drawn: DrawnTemplates,
    },
}

/// How the templates of angular grains are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum TemplateShape {
    /// A ball cut by half-spaces at nearly equal distances from its centre.
    #[default]
    Cuts,
    /// The convex hull of the displaced corners of a cube (Titscher and Unger 2015, figure 12b).
    DeformedCuboid,
    /// A cell of a Poisson-Voronoi tessellation.
    Voronoi,
    /// The Platonic solid of four triangles.
    Tetrahedron,
    /// The Platonic solid of six squares.
    Cube,
    /// The Platonic solid of eight triangles.
    Octahedron,
    /// The Platonic solid of twelve pentagons.
    Dodecahedron,
    /// The Platonic solid of twenty triangles.
    Icosahedron,
}

impl TemplateShape {
    /// Whether every draw is the same body, but for the ratios by which it is stretched.
    #[must_use]
    pub fn is_platonic(self) -> bool {
        !matches!(self, Self::Cuts | Self::DeformedCuboid | Self::Voronoi)
    }
}

/// What the grains of a mix are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GrainKind {
    /// All grains are spheres.
    #[default]
    Spheres,
    /// Ellipsoids, spheres among them.
    Ellipsoids,
    /// Convex polyhedra, sharp or rounded.
    Polyhedra,
    /// Ellipsoids, spheres among them, and convex polyhedra.
    Mixed,
}

impl GrainKind {
    /// That of grains some of which have semi-axes, or a template. Spheres have neither.
    #[must_use]
    pub fn of(has_axes: bool, has_templates: bool) -> Self {
        match (has_axes, has_templates) {
            (true, true) => Self::Mixed,
            (false, true) => Self::Polyhedra,
            (true, false) => Self::Ellipsoids,
            (false, false) => Self::Spheres,
        }
    }

    /// Whether grains are described by semi-axes.
    #[must_use]
    pub fn has_axes(self) -> bool {
        matches!(self, Self::Ellipsoids | Self::Mixed)
    }

    /// Whether grains are described by templates.
    #[must_use]
    pub fn has_templates(self) -> bool {
        matches!(self, Self::Polyhedra | Self::Mixed)
    }

    /// Whether grains have an orientation, which spheres alone have not.
    #[must_use]
    pub fn has_orientations(self) -> bool {
        self != Self::Spheres
    }

    /// What they are called, in the plural.
    #[must_use]
    pub fn noun(self) -> &'static str {
        match self {
            Self::Spheres => "spheres",
            Self::Ellipsoids => "ellipsoids",
            Self::Polyhedra => "polyhedra",
            Self::Mixed => "ellipsoids and polyhedra",
        }
    }
}

/// The shape of the grains above a size.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct ShapeClass {
    /// The size above which grains have this shape, up to the next class. The smallest of all classes is 0.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1e6))]
    pub above_mm: f64,
    /// The shape.
    #[cfg_attr(feature = "openapi", schema(value_type = super::schema::GrainShapeInput))]
    pub shape: GrainShape,
}

/// How shaped grains are oriented before a method moves them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Orientation {
    /// All orientations are equally likely.
    Uniform {},
    /// The short axis `n` of a grain has the density `exp(concentration (n . axis)²)` over the sphere (Dimroth-Watson),
    /// and the grain any turn about it. Flat grains in concrete that is cast along z lie flat: axis z and a
    /// concentration above 0.
    Axis {
        /// The axis of the specimen.
        axis: Axis,
        /// 0 is uniform; short axes gather about the axis above 0, about the plane across it below 0.
        #[cfg_attr(feature = "openapi", schema(minimum = -100, maximum = 100))]
        concentration: f64,
    },
}

impl Default for Orientation {
    fn default() -> Self {
        Self::Uniform {}
    }
}

impl Orientation {
    /// Whether all orientations are equally likely.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        matches!(self, Self::Uniform {})
    }
}

impl PlainShape {
    /// What the grains are.
    #[must_use]
    pub fn kind(&self) -> GrainKind {
        match self {
            Self::Sphere {} => GrainKind::Spheres,
            Self::Ellipsoid { .. } => GrainKind::Ellipsoids,
            Self::Polyhedron { .. } => GrainKind::Polyhedra,
        }
    }

    /// Number of its templates.
    pub(super) fn templates(&self) -> u32 {
        match self {
            Self::Polyhedron { template_count, .. } => *template_count,
            Self::Sphere {} | Self::Ellipsoid { .. } => 0,
        }
    }
}

impl GrainShape {
    /// Whether all grains are spheres.
    #[must_use]
    pub fn is_sphere(&self) -> bool {
        self.parts().iter().all(|(_, shape)| !shape.kind().has_orientations())
    }

    /// Shares of the volume with their shapes.
    #[must_use]
    pub fn parts(&self) -> Vec<(f64, &PlainShape)> {
        match self {
            Self::Plain(shape) => vec![(1.0, shape)],
            Self::Mixture(ShapeMixture::Mixture { of }) => {
                of.iter().map(|part| (part.share, &part.shape)).collect()
            }
        }
    }

    /// The same shapes, to be changed.
    pub(crate) fn parts_mut(&mut self) -> Vec<&mut PlainShape> {
        match self {
            Self::Plain(shape) => vec![shape],
            Self::Mixture(ShapeMixture::Mixture { of }) => {
                of.iter_mut().map(|part| &mut part.shape).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests;
