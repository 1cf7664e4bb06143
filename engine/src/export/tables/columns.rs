//! The columns of a result: what they are called, in which order they are stored, and how they are read.
//!
//! Spheres have four columns: the centre and the diameter. Ellipsoids have these four, whose diameter is that of the
//! sphere of equal volume, then the sieve size, the orientation as a quaternion, and the semi-axes. Convex polyhedra
//! have the index of their template in place of the semi-axes; the templates are stated once (`templates`). A result
//! with grains of both kinds has the semi-axes, 0 of polyhedra, and then the template, -1 of ellipsoids. Where a mix
//! has several aggregates, the last column is the index of that of the grain.

use crate::request::GrainKind;

/// A column of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// x of the centre in mm.
    X,
    /// y of the centre in mm.
    Y,
    /// z of the centre in mm.
    Z,
    /// Diameter of the sphere of equal volume in mm.
    Diameter,
    /// Smallest square sieve opening that the grain passes, in mm. Of a polyhedron it is defined as the least square
    /// that holds its shadow along some direction.
    Sieve,
    /// Real part of the orientation quaternion.
    Qw,
    /// First imaginary part of the orientation quaternion.
    Qx,
    /// Second imaginary part of the orientation quaternion.
    Qy,
    /// Third imaginary part of the orientation quaternion.
    Qz,
    /// Largest semi-axis in mm.
    A,
    /// Middle semi-axis in mm.
    B,
    /// Smallest semi-axis in mm.
    C,
    /// Index of the template, from 0; -1 of an ellipsoid.
    Template,
    /// Index of the aggregate, from 0.
    Aggregate,
}

impl Column {
    /// The columns of spheres, in the order of storage.
    pub const OF_SPHERES: &'static [Self] = &SPHERES;

    /// The columns of ellipsoids, in the order of storage.
    pub const OF_ELLIPSOIDS: &'static [Self] = &ELLIPSOIDS;

    /// The columns of convex polyhedra, in the order of storage.
    pub const OF_POLYHEDRA: &'static [Self] = &POLYHEDRA;

    /// The columns of ellipsoids and convex polyhedra in one result, in the order of storage. Of an ellipsoid the
    /// template is -1, of a polyhedron the semi-axes are 0.
    pub const OF_BOTH: &'static [Self] = &BOTH;

    /// All tables: what they are about, and the columns, without and with that of the aggregate.
    pub(super) const TABLES: [(&'static str, &'static [Self], &'static [Self]); 4] = [
        ("Spheres.", Self::OF_SPHERES, &joined::<5>(&[&SPHERES, &[Self::Aggregate]])),
        (
            "Ellipsoids: centre, diameter of the sphere of equal volume, sieve size, orientation, semi-axes.",
            Self::OF_ELLIPSOIDS,
            &joined::<13>(&[&ELLIPSOIDS, &[Self::Aggregate]]),
        ),
        (
            "Convex polyhedra: centre, diameter of the sphere of equal volume, sieve size, orientation, index of the \
             template.",
            Self::OF_POLYHEDRA,
            &joined::<11>(&[&POLYHEDRA, &[Self::Aggregate]]),
        ),
        (
            "Ellipsoids and convex polyhedra: centre, diameter of the sphere of equal volume, sieve size, orientation, \
             semi-axes (0 of polyhedra), index of the template (-1 of ellipsoids).",
            Self::OF_BOTH,
            &joined::<14>(&[&BOTH, &[Self::Aggregate]]),
        ),
    ];

    /// The columns of a kind of grains, in the order of storage; of a mix of several aggregates that of the aggregate
    /// last.
    #[must_use]
    pub fn of(kind: GrainKind, has_aggregates: bool) -> &'static [Self] {
        let of_kind = Self::TABLES.into_iter().find(|(_, plain, _)| Self::kind(plain) == kind);
        of_kind.map_or(Self::OF_SPHERES, |(_, plain, with)| if has_aggregates { with } else { plain })
    }

    /// The kind of grains that these columns describe.
    pub(super) fn kind(columns: &[Self]) -> GrainKind {
        GrainKind::of(columns.contains(&Self::A), columns.contains(&Self::Template))
    }

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x_mm",
            Self::Y => "y_mm",
            Self::Z => "z_mm",
            Self::Diameter => "d_mm",
            Self::Sieve => "sieve_mm",
            Self::Qw => "qw",
            Self::Qx => "qx",
            Self::Qy => "qy",
            Self::Qz => "qz",
            Self::A => "a_mm",
            Self::B => "b_mm",
            Self::C => "c_mm",
            Self::Template => "template",
            Self::Aggregate => "aggregate",
        }
    }

    /// The columns of these names, where they are those of a kind of grains.
    #[must_use]
    pub fn of_names(names: &[String]) -> Option<&'static [Self]> {
        let has_names = |columns: &[Self]| {
            columns.iter().map(|column| column.name()).eq(names.iter().map(String::as_str))
        };
        Self::TABLES.into_iter().flat_map(|(_, plain, with)| [plain, with]).find(|columns| has_names(columns))
    }

    /// Whether its values count something.
    pub(super) fn is_index(self) -> bool {
        matches!(self, Self::Template | Self::Aggregate)
    }
}

const CENTER: [Column; 3] = [Column::X, Column::Y, Column::Z];
const SIZES: [Column; 2] = [Column::Diameter, Column::Sieve];
const ORIENTATION: [Column; 4] = [Column::Qw, Column::Qx, Column::Qy, Column::Qz];
const SEMI_AXES: [Column; 3] = [Column::A, Column::B, Column::C];

const SPHERES: [Column; 4] = joined(&[&CENTER, &[Column::Diameter]]);
const ELLIPSOIDS: [Column; 12] = joined(&[&CENTER, &SIZES, &ORIENTATION, &SEMI_AXES]);
const POLYHEDRA: [Column; 10] = joined(&[&CENTER, &SIZES, &ORIENTATION, &[Column::Template]]);
const BOTH: [Column; 13] = joined(&[&CENTER, &SIZES, &ORIENTATION, &SEMI_AXES, &[Column::Template]]);

/// What a grain with an orientation is read from, as far as its table has these columns.
pub(super) const BODY_ROW: [Column; 12] =
    joined(&[&CENTER, &[Column::Diameter], &ORIENTATION, &SEMI_AXES, &[Column::Template]]);

/// The columns of all groups, one after another.
const fn joined<const N: usize>(groups: &[&[Column]]) -> [Column; N] {
    let mut all = [Column::X; N];
    let (mut at, mut group) = (0, 0);
    while group < groups.len() {
        let mut i = 0;
        while i < groups[group].len() {
            all[at] = groups[group][i];
            (at, i) = (at + 1, i + 1);
        }
        group += 1;
    }
    assert!(at == N, "the groups have another number of columns");
    all
}

/// Names of columns, in their order.
pub(super) fn names(columns: &[Column]) -> Vec<&'static str> {
    columns.iter().map(|column| column.name()).collect()
}
