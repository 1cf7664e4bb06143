//! Shapes of grains by name, each from a published source.
//!
//! A preset is resolved where a request is read: the stored request has the law of the axis ratios, and the name of the
//! preset beside it.

use super::PlainShape;
use crate::shape::AxisRatios;
use crate::shape::ratios::DEFAULT_TARGET_ELONGATION;

const EN_12620_FLAKINESS: &str = "EN 12620:2002+A1:2008, Aggregates for concrete, 4.4, \
     table 8 (categories for maximum values of flakiness index)";
const EN_12620_SHAPE: &str = "EN 12620:2002+A1:2008, Aggregates for concrete, 4.4, \
     table 9 (categories for maximum values of shape index)";

/// A shape with a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapePreset {
    /// Its name in requests.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Author, year, title, and table or page.
    pub source: &'static str,
    /// DOI of the source, where it has one.
    pub doi: Option<&'static str>,
    law: Law,
}

/// The law of the axis ratios of ellipsoids.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    Flakiness(f64),
    ShapeIndex(f64),
    Constant { elongation: f64, flatness: f64 },
}

const fn flakiness(name: &'static str, about: &'static str, index: f64) -> ShapePreset {
    ShapePreset { name, about, source: EN_12620_FLAKINESS, doi: None, law: Law::Flakiness(index) }
}

const fn shape_index(name: &'static str, about: &'static str, index: f64) -> ShapePreset {
    ShapePreset { name, about, source: EN_12620_SHAPE, doi: None, law: Law::ShapeIndex(index) }
}

impl ShapePreset {
    /// All presets, in the order of the documentation.
    pub const ALL: [Self; 9] = [
        flakiness("fi15", "Ellipsoids with a flakiness index of 15 %, the most of category FI15.", 0.15),
        flakiness("fi20", "Ellipsoids with a flakiness index of 20 %, the most of category FI20.", 0.20),
        flakiness("fi35", "Ellipsoids with a flakiness index of 35 %, the most of category FI35.", 0.35),
        flakiness("fi50", "Ellipsoids with a flakiness index of 50 %, the most of category FI50.", 0.50),
        shape_index("si15", "Ellipsoids with a shape index of 15 %, the most of category SI15.", 0.15),
        shape_index("si20", "Ellipsoids with a shape index of 20 %, the most of category SI20.", 0.20),
        shape_index("si40", "Ellipsoids with a shape index of 40 %, the most of category SI40.", 0.40),
        shape_index("si55", "Ellipsoids with a shape index of 55 %, the most of category SI55.", 0.55),
        Self {
            name: "impact_fragments",
            about: "Ellipsoids with the axes 2 : sqrt 2 : 1, the mean ratios b/a = 0.7 and c/a = 0.5 of rock fragments \
                    of catastrophic impacts; their scatter is left out.",
            source: "A. Fujiwara, G. Kamimoto and A. Tsukamoto, Nature 272, 602-603, 1978; the ratios as stated in the \
                     abstract of T. Michikami and others, Fragment shapes in impact experiments ranging from cratering \
                     to catastrophic disruption, Icarus 264, 316-330, 2016",
            doi: Some("10.1038/272602a0"),
            law: Law::Constant {
                elongation: std::f64::consts::FRAC_1_SQRT_2,
                flatness: std::f64::consts::FRAC_1_SQRT_2,
            },
        },
    ];

    /// The preset of a name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<&'static Self> {
        const ALL: &[ShapePreset] = &ShapePreset::ALL;
        ALL.iter().find(|preset| preset.name == name)
    }

    /// The law of the axis ratios.
    pub(super) fn ratios(&self) -> AxisRatios {
        match self.law {
            Law::Flakiness(index) => AxisRatios::Flakiness { index, elongation: DEFAULT_TARGET_ELONGATION },
            Law::ShapeIndex(index) => AxisRatios::ShapeIndex { index, elongation: DEFAULT_TARGET_ELONGATION },
            Law::Constant { elongation, flatness } => AxisRatios::Constant { elongation, flatness },
        }
    }

    /// The shape.
    #[must_use]
    pub fn shape(&self) -> PlainShape {
        PlainShape::Ellipsoid { ratios: self.ratios(), preset: Some(self.name) }
    }
}
