//! Openings of sieves in mm: from micrometres, inches, numbers of sieves, meshes and phi.
//!
//! Sources: ASTM E11 (openings by number and by inches), BS 410 (meshes), Tyler (openings of meshes), Krumbein 1934
//! (phi = -log2 of the diameter in mm).

use crate::elementary::powf;

/// The unit of sieves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Millimetres.
    Mm,
    /// Micrometres.
    Um,
    /// Inches.
    Inch,
    /// Numbers of ASTM E11.
    UsSieve,
    /// Meshes of BS 410.
    BsMesh,
    /// Meshes of Tyler.
    TylerMesh,
    /// `-log2` of the size in mm.
    Phi,
}

impl Unit {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Mm, Self::Um, Self::Inch, Self::UsSieve, Self::BsMesh, Self::TylerMesh, Self::Phi];

    /// Its name in answers and options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Um => "um",
            Self::Inch => "in",
            Self::UsSieve => "us_sieve",
            Self::BsMesh => "bs_mesh",
            Self::TylerMesh => "tyler_mesh",
            Self::Phi => "phi",
        }
    }

    /// What a note calls it.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Um => "micrometres",
            Self::Inch => "inches",
            Self::UsSieve => "US sieve numbers (ASTM E11)",
            Self::BsMesh => "BS meshes (BS 410)",
            Self::TylerMesh => "Tyler meshes",
            Self::Phi => "phi (-log2 of the size in mm)",
        }
    }

    /// The unit with this name.
    pub(super) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.name() == name)
    }

    /// The size in mm of a number in this unit; `None` where the unit has no such sieve.
    pub(super) fn mm(self, number: f64) -> Option<f64> {
        let listed = |list: &[(f64, f64)]| list.iter().find(|(of, _)| *of == number).map(|(_, mm)| *mm);
        match self {
            Self::Mm => Some(number),
            Self::Um => Some(number / 1000.0),
            Self::Inch => {
                let nominal = INCHES.iter().find(|(inch, _)| (number / inch - 1.0).abs() < 6.0e-3);
                Some(nominal.map_or(25.4 * number, |(_, mm)| *mm))
            }
            Self::UsSieve => listed(&US_SIEVES),
            Self::BsMesh => listed(&BS_MESHES),
            Self::TylerMesh => listed(&TYLER_MESHES),
            Self::Phi => Some(powf(2.0, -number)),
        }
    }
}

/// Sieves of ASTM E11 by number, in mm.
const US_SIEVES: [(f64, f64); 29] = [
    (3.5, 5.6),
    (4.0, 4.75),
    (5.0, 4.0),
    (6.0, 3.35),
    (7.0, 2.8),
    (8.0, 2.36),
    (10.0, 2.0),
    (12.0, 1.7),
    (14.0, 1.4),
    (16.0, 1.18),
    (18.0, 1.0),
    (20.0, 0.85),
    (25.0, 0.71),
    (30.0, 0.6),
    (35.0, 0.5),
    (40.0, 0.425),
    (45.0, 0.355),
    (50.0, 0.3),
    (60.0, 0.25),
    (70.0, 0.212),
    (80.0, 0.18),
    (100.0, 0.15),
    (120.0, 0.125),
    (140.0, 0.106),
    (170.0, 0.09),
    (200.0, 0.075),
    (230.0, 0.063),
    (270.0, 0.053),
    (325.0, 0.045),
];

/// Meshes of BS 410 of 1943 to 1969, in mm.
const BS_MESHES: [(f64, f64); 23] = [
    (5.0, 3.35),
    (6.0, 2.8),
    (7.0, 2.4),
    (8.0, 2.0),
    (10.0, 1.68),
    (12.0, 1.4),
    (14.0, 1.2),
    (16.0, 1.0),
    (18.0, 0.85),
    (22.0, 0.71),
    (25.0, 0.6),
    (30.0, 0.5),
    (36.0, 0.42),
    (44.0, 0.355),
    (52.0, 0.3),
    (60.0, 0.25),
    (72.0, 0.21),
    (85.0, 0.18),
    (100.0, 0.15),
    (120.0, 0.125),
    (150.0, 0.105),
    (170.0, 0.09),
    (200.0, 0.075),
];

/// Meshes of Tyler, in mm.
const TYLER_MESHES: [(f64, f64); 18] = [
    (3.0, 6.7),
    (4.0, 4.75),
    (6.0, 3.35),
    (8.0, 2.36),
    (10.0, 1.7),
    (14.0, 1.18),
    (20.0, 0.85),
    (28.0, 0.6),
    (35.0, 0.425),
    (48.0, 0.3),
    (65.0, 0.212),
    (100.0, 0.15),
    (150.0, 0.106),
    (200.0, 0.075),
    (250.0, 0.063),
    (270.0, 0.053),
    (325.0, 0.045),
    (400.0, 0.038),
];

/// Sieves of ASTM E11 by their size in inches, in mm.
const INCHES: [(f64, f64); 33] = [
    (6.0, 150.0),
    (5.0, 125.0),
    (4.24, 106.0),
    (4.0, 100.0),
    (3.5, 90.0),
    (3.0, 75.0),
    (2.5, 63.0),
    (2.12, 53.0),
    (2.0, 50.0),
    (1.75, 45.0),
    (1.5, 37.5),
    (1.25, 31.5),
    (1.06, 26.5),
    (1.0, 25.0),
    (0.875, 22.4),
    (0.75, 19.0),
    (0.625, 16.0),
    (0.53, 13.2),
    (0.5, 12.5),
    (0.4375, 11.2),
    (0.375, 9.5),
    (0.3125, 8.0),
    (0.265, 6.7),
    (0.25, 6.3),
    (0.1875, 4.75),
    (0.125, 3.15),
    (0.0937, 2.36),
    (0.0469, 1.18),
    (0.0234, 0.6),
    (0.0117, 0.3),
    (0.0059, 0.15),
    (0.0029, 0.075),
    (0.0787, 2.0),
];
