//! The request: the specimen, the mix, the distance rule and the method of a packing, with defaults, bounds and JSON.
//!
//! Field names and variants are those of the HTTP interface. [`PackingRequest::from_json`] judges everything that needs
//! no computation: types, signs, intervals, order of sieves. Whether the mix fits its specimen is judged by
//! [`crate::plan`].

pub mod aggregate;
mod axis;
pub mod blend;
pub mod decode;
pub mod grading;
pub mod growth;
mod lengths;
pub mod materials;
mod mix;
mod packing_model;
pub mod proportions;
mod read;
#[cfg(feature = "openapi")]
pub(crate) mod schema;
pub mod segregation;
pub mod shape;
mod sieves;

use serde::{Deserialize, Serialize};

pub use crate::shape::SizeMeasure;
pub use aggregate::{Aggregate, MAX_AGGREGATES, MixPart};
pub use axis::Axis;
pub use blend::{BlendRequest, Stockpile, Target};
pub use decode::FieldError;
pub use grading::{
    Between, By, Distribution, DistributionLaw, Form, Grading, LimitCurve, SizeClass, SizeShare, Standard,
    standard,
};
pub use growth::{GrowthBy, GrowthOptions, GrowthStop};
pub use lengths::{MAX_LENGTH_MM, MIN_LENGTH_MM};
pub use materials::{Material, Materials};
pub use packing_model::PackingModel;
pub use proportions::{MixAddition, MixProportions};
pub use segregation::{FieldDirection, GradientField, Segregation, SpecimenFace};
pub use shape::{
    DEFAULT_TEMPLATES, GrainKind, GrainShape, MAX_FACES, MAX_TEMPLATES, MIN_FACES, MixturePart, Orientation,
    PlainShape, ShapeClass, ShapeMixture, ShapePreset, TemplateShape,
};
pub(crate) use sieves::{LEAST_TOP, MOST_UNDERSIZE, next_sieve};

/// Largest seed: seeds travel through JSON, and MATLAB and JavaScript hold integers exactly only
/// up to 2^53 - 1.
pub const MAX_SEED: u64 = (1 << 53) - 1;

/// Most points of a grading curve, and most size classes.
pub const MAX_CURVE_POINTS: usize = 1000;

/// Smallest share of a volume or a mass that a request may name: what rounding may take from a sum of them.
pub const MIN_SHARE: f64 = 1.0e-9;

/// Smallest exponent of a Fuller curve; such a curve has 99 % of its mass in dust already.
pub const MIN_FULLER_EXPONENT: f64 = 0.01;

/// Cut-off diameter of `standard` and `fuller` mixes that name none, in mm: grains below it are
/// mortar by convention (Titscher and Unger 2015, section 3).
pub const DEFAULT_D_MIN_MM: f64 = 2.0;

/// A packing to compute. Read it with [`PackingRequest::from_json`], or build it in code and judge it with
/// [`PackingRequest::validate`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PackingRequest {
    /// Seed of the random generator; the same seed and build give the same packing, bit for bit.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 9_007_199_254_740_991_u64))]
    pub seed: u64,
    /// What is filled.
    pub specimen: Specimen,
    /// What it is filled with.
    pub mix: Mix,
    /// The clear distance that grains keep from one another and from the walls.
    pub distance: Distance,
    /// How the packing is computed.
    pub method: Method,
    /// Where grains of which size are to lie; anywhere when absent.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Segregation::is_none")]
    pub segregation: Segregation,
    /// What becomes of a run that a limit or a jam ends before its target.
    #[cfg_attr(feature = "openapi", schema(default = "fail", required = false))]
    #[serde(skip_serializing_if = "OnLimit::is_fail")]
    pub on_limit: OnLimit,
    /// The materials of the phases, for models and properties of the packing; the packing does not depend on them.
    #[cfg_attr(feature = "openapi", schema(required = false, value_type = Materials))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub materials: Option<Materials>,
}

impl PackingRequest {
    /// The request without what its packing does not depend on: the materials.
    #[must_use]
    pub fn without_materials(&self) -> Self {
        Self { materials: None, ..self.clone() }
    }

    /// The request without what bounds its run: the limits of its method, and what becomes of a run that meets one; and
    /// without the materials. A run goes on with others of these where it was.
    #[must_use]
    pub fn without_limits(&self) -> Self {
        let mut method = self.method;
        if let Some(options) = method.growth_mut() {
            options.stop = GrowthStop::default();
        }
        Self { method, on_limit: OnLimit::Fail, materials: None, ..self.clone() }
    }
}

/// What becomes of a run that a limit of time or events, a jam, or saturation ends before its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum OnLimit {
    /// It fails with `target-not-reached`, or with `timed-out` where `timeout_s` ended it.
    #[default]
    Fail,
    /// It succeeds with the packing that was reached. `summary.partial` of the result states how far it came: grains
    /// that grow are scaled by one factor, the largest at which every pair and every wall keeps its full distance;
    /// random addition keeps the grains that it placed, without the finest.
    Keep,
}

impl OnLimit {
    /// Whether such a run fails.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_fail(&self) -> bool {
        *self == Self::Fail
    }
}

/// How much aggregate a mix has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VolumeFraction {
    /// This volume over that of the specimen.
    Of(f64),
    /// As much as the method reaches: the grains grow until they jam, or until the limits of the method.
    Maximize,
}

impl Serialize for VolumeFraction {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Of(fraction) => serializer.serialize_f64(*fraction),
            Self::Maximize => serializer.serialize_str(MAXIMIZE),
        }
    }
}

/// The volume fraction of [`VolumeFraction::Maximize`] in JSON.
pub(crate) const MAXIMIZE: &str = "maximize";

/// The region that grains are placed in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Specimen {
    /// A box that spans 0..size on every axis.
    Box {
        /// Edge lengths in x, y, z.
        #[cfg_attr(feature = "openapi", schema(schema_with = schema::size_mm))]
        size_mm: [f64; 3],
        /// What the six faces are; rigid walls when absent.
        #[cfg_attr(feature = "openapi", schema(default = "walls", required = false))]
        boundary: Boundary,
    },
    /// A cylinder that stands on z = 0 with its axis at x = y = diameter / 2.
    Cylinder {
        /// Diameter of the cylinder.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        diameter_mm: f64,
        /// Height of the cylinder.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        height_mm: f64,
    },
}

impl Specimen {
    /// A box.
    #[must_use]
    pub const fn cuboid(size_mm: [f64; 3], boundary: Boundary) -> Self {
        Self::Box { size_mm, boundary }
    }

    /// Its lengths in mm, each with its pointer in a request.
    #[must_use]
    pub fn lengths(&self) -> Vec<(String, f64)> {
        match *self {
            Self::Box { size_mm, .. } => {
                (0..3).map(|axis| (format!("/specimen/size_mm/{axis}"), size_mm[axis])).collect()
            }
            Self::Cylinder { diameter_mm, height_mm } => {
                vec![("/specimen/diameter_mm".into(), diameter_mm), ("/specimen/height_mm".into(), height_mm)]
            }
        }
    }

    /// The same specimen with other lengths.
    #[must_use]
    pub fn with_lengths(&self, of: impl Fn(f64) -> f64) -> Self {
        match *self {
            Self::Box { size_mm, boundary } => Self::Box { size_mm: size_mm.map(of), boundary },
            Self::Cylinder { diameter_mm, height_mm } => {
                Self::Cylinder { diameter_mm: of(diameter_mm), height_mm: of(height_mm) }
            }
        }
    }
}

/// What the faces of a box are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Boundary {
    /// Rigid walls, as of a mould: whole grains lie inside.
    Walls,
    /// The box repeats endlessly: a representative volume element.
    Periodic,
}

/// The aggregate: its grading, its cut-off, its shapes and its amount. One grading, or several aggregates.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Mix {
    /// Which diameters, in which proportion by mass. Either this or `aggregates` is required.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grading: Option<Grading>,
    /// Cut-off: finer grains are mortar and are not placed. Default: 2 for `standard` and
    /// `fuller`, else the smallest diameter that the grading describes.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d_min_mm: Option<f64>,
    /// Largest diameter that is placed: coarser grains count in `all_aggregate` and are not placed. All that the
    /// grading describes when absent.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d_max_mm: Option<f64>,
    /// Several aggregates, at most 16, each with its own grading and shapes, in place of `grading`, `shape` and
    /// `shapes`.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = schema::OneOrMore<schema::AggregateInput>)
    )]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub aggregates: Vec<Aggregate>,
    /// Volume of the aggregate over that of the specimen, or `"maximize"`: as dense as these grains get. This, `count`
    /// or `proportions` is required, except for the grading `diameters`, which prescribes it unless it is `"maximize"`.
    #[cfg_attr(feature = "openapi", schema(required = false, schema_with = schema::volume_fraction))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_fraction: Option<VolumeFraction>,
    /// Number of grains that are placed, in place of `volume_fraction`: of each narrow size class the number that the
    /// grading gives it, rounded so that all sum to this. Their volume follows, and `volume_fraction_of` has no
    /// meaning.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u64>,
    /// The same by the contents of a cubic metre of concrete. It counts all aggregate, so that `volume_fraction_of` is
    /// `all_aggregate`.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub proportions: Option<MixProportions>,
    /// Which aggregate `volume_fraction` counts.
    #[cfg_attr(feature = "openapi", schema(default = "all_aggregate", required = false))]
    pub volume_fraction_of: VolumeFractionOf,
    /// Whether a mix is packed although whole grains miss its total volume by more than 5 %. The deviation is then a
    /// warning; otherwise it is an error.
    #[cfg_attr(feature = "openapi", schema(default = false, required = false))]
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub allow_coarse: bool,
    /// The shape of all grains; spheres when absent.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, value_type = Option<schema::GrainShapeInput>)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<GrainShape>,
    /// The shapes by size, in place of `shape`.
    #[cfg_attr(feature = "openapi", schema(required = false, value_type = schema::OneOrMore<ShapeClass>))]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<ShapeClass>,
    /// What the diameters of the grading, the cut-off and the size classes are of shaped grains.
    #[cfg_attr(feature = "openapi", schema(default = "sieve", required = false))]
    #[serde(skip_serializing_if = "SizeMeasure::is_sieve")]
    pub size: SizeMeasure,
    /// How shaped grains are oriented; uniform when absent.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "Orientation::is_uniform")]
    pub orientation: Orientation,
    /// How the aggregate is taken to be compacted, for the figures of the mix; the packing does not depend on it.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "PackingModel::is_default")]
    pub packing_model: PackingModel,
}

impl Mix {
    /// Whether any grain may be no sphere.
    pub fn has_shapes(&self) -> bool {
        self.grain_kind().has_orientations()
    }

    /// What the grains are; spheres count as ellipsoids among other shapes.
    pub fn grain_kind(&self) -> GrainKind {
        let parts = self.parts();
        let is_polyhedron = |shape: &GrainShape, wanted: bool| {
            shape.parts().iter().any(|(_, shape)| shape.kind().has_templates() == wanted)
        };
        let shapes = || parts.iter().filter_map(MixPart::grain_shapes).flatten();
        let has_polyhedra = shapes().any(|(_, shape)| is_polyhedron(shape, true));
        let has_others = shapes().any(|(_, shape)| is_polyhedron(shape, false))
            || parts.iter().any(|part| part.grain_shapes().is_none());
        GrainKind::of(has_others && shapes().next().is_some(), has_polyhedra)
    }

    /// Requested volume of the aggregate over that of the specimen, whether by `volume_fraction` or by `proportions`;
    /// `None` where explicit diameters or a number of grains prescribe it, or where it is to be as large as possible.
    pub fn requested_fraction(&self) -> Option<f64> {
        match self.volume_fraction {
            Some(VolumeFraction::Of(fraction)) => Some(fraction),
            Some(VolumeFraction::Maximize) => None,
            None => self.proportions.as_ref().map(MixProportions::aggregate_fraction),
        }
    }

    /// Whether the volume fraction is to be as large as possible.
    pub fn maximizes_volume_fraction(&self) -> bool {
        self.volume_fraction == Some(VolumeFraction::Maximize)
    }

    /// What says how much aggregate there is.
    pub fn amount(&self) -> Amount {
        match self {
            Self { count: Some(_), .. } => Amount::Count,
            _ if self.listed_diameters_mm().is_some() => Amount::List,
            _ => Amount::Volume,
        }
    }

    /// JSON pointer of the field that says how much aggregate there is.
    pub(crate) fn amount_pointer(&self) -> &'static str {
        match self {
            Self { volume_fraction: Some(_), .. } => "/mix/volume_fraction",
            Self { proportions: Some(_), .. } => "/mix/proportions",
            Self { count: Some(_), .. } => "/mix/count",
            _ => "/mix/grading/diameters_mm",
        }
    }
}

/// What says how much aggregate a mix has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Amount {
    /// A volume fraction, or contents from which it follows.
    #[default]
    Volume,
    /// A number of grains.
    Count,
    /// A list of diameters.
    List,
}

/// Which aggregate a volume fraction counts (`docs/method.md`, section 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum VolumeFractionOf {
    /// All aggregate of the mix, that below the cut-off too (`phi_M`).
    AllAggregate,
    /// Only the grains that are placed (`phi_eff`).
    PlacedGrains,
}

/// The clear distance `g(i, j)` between two grains, and that to the walls (`docs/method.md`, section 3).
///
/// `wall_gap_mm` replaces the default distance to the walls, which is half of what the grain keeps
/// from another of its own size. It means nothing in a periodic box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Distance {
    /// Grains may touch.
    None {
        /// Distance to the walls; 0 when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        wall_gap_mm: Option<f64>,
    },
    /// The same for every pair.
    Constant {
        /// The distance.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1e6))]
        gap_mm: f64,
        /// Distance to the walls; `gap_mm / 2` when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        wall_gap_mm: Option<f64>,
    },
    /// `factor (d_i + d_j) / 2` (Schlangen and van Mier use 0.1).
    Proportional {
        /// The factor.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 100))]
        factor: f64,
        /// Distance to the walls; `factor d_i / 2` when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        wall_gap_mm: Option<f64>,
    },
    /// `factor min(d_i, d_j)` (Wang et al.).
    SmallerDiameter {
        /// The factor.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 100))]
        factor: f64,
        /// Distance to the walls; `factor d_i / 2` when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        wall_gap_mm: Option<f64>,
    },
    /// The largest distance, the same for every pair, that can be reached with these grains.
    Maximize {
        /// Distance to the walls; half of the distance reached when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        wall_gap_mm: Option<f64>,
    },
}

impl Distance {
    /// The distance to the walls in mm that replaces the default of the rule.
    #[must_use]
    pub fn wall_gap_mm(&self) -> Option<f64> {
        match *self {
            Self::None { wall_gap_mm }
            | Self::Constant { wall_gap_mm, .. }
            | Self::Proportional { wall_gap_mm, .. }
            | Self::SmallerDiameter { wall_gap_mm, .. }
            | Self::Maximize { wall_gap_mm } => wall_gap_mm,
        }
    }
}

/// How the packing is computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Method {
    /// Let the engine choose: `rsa` where that will surely do, else `growth`.
    Auto {},
    /// Random sequential addition, largest grain first.
    Rsa {
        /// Give up after so many failed attempts for one grain, as the paper does. An attempt of a sphere is a uniform
        /// random centre among those where the sphere keeps its distance from the walls; that of a grain of another
        /// shape, also of a sphere among such grains, is a uniform random centre in the specimen with a random
        /// orientation. When absent, the search is exhaustive: a grain fails when it is proven that no place is left.
        /// Shaped grains also fail after 20 000 000 draws without a proof. The failure says which of the
        /// two it was (`saturation_proven`).
        #[cfg_attr(
            feature = "openapi",
            schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000_000_u64)
        )]
        #[serde(skip_serializing_if = "Option::is_none")]
        attempts_per_grain: Option<u64>,
    },
    /// Grains move and grow until they have their size and distance: spheres as by `edmd`, other grains, and spheres
    /// among them, as by `monte_carlo`.
    Growth {
        /// Its parameters.
        #[serde(flatten)]
        options: GrowthOptions,
    },
    /// Growth by event-driven molecular dynamics, of spheres alone: grains move on straight lines and collide.
    Edmd {
        /// Its parameters.
        #[serde(flatten)]
        options: GrowthOptions,
    },
    /// Growth by hard-particle Monte Carlo, of any grains: they move, turn and exchange their places at random, and
    /// those that come to overlap push each other apart. Spheres are packed faster by `edmd`.
    MonteCarlo {
        /// Its parameters.
        #[serde(flatten)]
        options: GrowthOptions,
    },
}

impl Method {
    /// The parameters of growth, where the method is one that grows.
    #[must_use]
    pub fn growth(&self) -> Option<&GrowthOptions> {
        match self {
            Self::Growth { options } | Self::Edmd { options } | Self::MonteCarlo { options } => Some(options),
            Self::Auto {} | Self::Rsa { .. } => None,
        }
    }

    /// The same, to be changed.
    pub fn growth_mut(&mut self) -> Option<&mut GrowthOptions> {
        match self {
            Self::Growth { options } | Self::Edmd { options } | Self::MonteCarlo { options } => Some(options),
            Self::Auto {} | Self::Rsa { .. } => None,
        }
    }
}
