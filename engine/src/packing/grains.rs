//! The grains of a packing: their shapes and poses, largest first. The row number is the id of a grain.

use crate::request::GrainKind;
use crate::shape::{Ellipsoid, Polyhedron, Pose, ScaledPolyhedron};

/// Spheres in columns of equal length, largest first; the row number is the grain's id.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spheres {
    /// Centres, x in mm.
    pub x_mm: Vec<f64>,
    /// Centres, y in mm.
    pub y_mm: Vec<f64>,
    /// Centres, z in mm.
    pub z_mm: Vec<f64>,
    /// Diameters in mm.
    pub d_mm: Vec<f64>,
    /// The aggregate that each belongs to, counted from 0; empty where the mix names none.
    pub aggregate: Vec<u16>,
}

impl Spheres {
    /// Number of spheres.
    pub fn len(&self) -> usize {
        self.d_mm.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.d_mm.is_empty()
    }

    /// Columns with room for `n` spheres.
    pub fn with_capacity(n: usize) -> Self {
        let column = || Vec::with_capacity(n);
        Self { x_mm: column(), y_mm: column(), z_mm: column(), d_mm: column(), aggregate: Vec::new() }
    }

    /// Appends one sphere.
    pub fn push(&mut self, [x, y, z]: [f64; 3], d: f64) {
        self.x_mm.push(x);
        self.y_mm.push(y);
        self.z_mm.push(z);
        self.d_mm.push(d);
    }

    /// Centre of sphere `i`.
    pub fn center(&self, i: usize) -> [f64; 3] {
        [self.x_mm[i], self.y_mm[i], self.z_mm[i]]
    }
}

/// Ellipsoids, by descending equivalent diameter. A sphere among them has three equal semi-axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ellipsoids {
    /// What each grain is.
    pub shapes: Vec<Ellipsoid>,
    /// Where each grain is; as many as shapes.
    pub poses: Vec<Pose>,
}

impl Ellipsoids {
    /// Number of ellipsoids.
    #[must_use]
    pub fn len(&self) -> usize {
        self.shapes.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.shapes.is_empty()
    }

    /// The grains one after the other.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&Ellipsoid, &Pose)> {
        self.shapes.iter().zip(&self.poses)
    }
}

/// Convex polyhedra, by descending equivalent diameter. Many grains share a template.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polyhedra {
    /// The forms of the grains: polyhedra with an equivalent diameter of 1, so that the equivalent diameter of a grain
    /// is its scale.
    pub templates: Vec<Polyhedron>,
    /// The template of each grain.
    pub template: Vec<u32>,
    /// Equivalent diameters in mm; as many as grains.
    pub d_mm: Vec<f64>,
    /// Where each grain is.
    pub poses: Vec<Pose>,
}

impl Polyhedra {
    /// Number of polyhedra.
    #[must_use]
    pub fn len(&self) -> usize {
        self.d_mm.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.d_mm.is_empty()
    }

    /// The shape of a grain.
    #[must_use]
    pub fn shape(&self, grain: usize) -> ScaledPolyhedron<'_> {
        let template = &self.templates[self.template[grain] as usize];
        ScaledPolyhedron { template, scale_mm: self.d_mm[grain] }
    }

    /// The grains one after the other.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (ScaledPolyhedron<'_>, &Pose)> {
        (0..self.len()).map(|grain| (self.shape(grain), &self.poses[grain]))
    }
}

/// The grains of a packing.
#[derive(Clone, Debug, PartialEq)]
pub enum Grains {
    /// All grains are spheres.
    Spheres(Spheres),
    /// The grains are ellipsoids.
    Ellipsoids(Ellipsoids),
    /// The grains are convex polyhedra.
    Polyhedra(Polyhedra),
}

impl Grains {
    /// Number of grains.
    #[must_use]
    pub fn len(&self) -> usize {
        GrainsRef::from(self).len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The spheres, where they are spheres.
    #[must_use]
    pub fn spheres(&self) -> Option<&Spheres> {
        match self {
            Self::Spheres(spheres) => Some(spheres),
            Self::Ellipsoids(_) | Self::Polyhedra(_) => None,
        }
    }
}

/// The grains of a packing, borrowed.
#[derive(Clone, Copy, Debug)]
pub enum GrainsRef<'a> {
    /// All grains are spheres.
    Spheres(&'a Spheres),
    /// The grains are ellipsoids.
    Ellipsoids(&'a Ellipsoids),
    /// The grains are convex polyhedra.
    Polyhedra(&'a Polyhedra),
}

impl<'a> GrainsRef<'a> {
    /// What they are.
    #[must_use]
    pub fn kind(self) -> GrainKind {
        match self {
            Self::Spheres(_) => GrainKind::Spheres,
            Self::Ellipsoids(_) => GrainKind::Ellipsoids,
            Self::Polyhedra(_) => GrainKind::Polyhedra,
        }
    }

    /// Diameters of the spheres of equal volume in mm, in the order of the grains.
    pub fn diameters_mm(self) -> impl Iterator<Item = f64> + 'a {
        let (diameters, ellipsoids): (&[f64], &[Ellipsoid]) = match self {
            Self::Spheres(spheres) => (&spheres.d_mm, &[]),
            Self::Ellipsoids(ellipsoids) => (&[], &ellipsoids.shapes),
            Self::Polyhedra(polyhedra) => (&polyhedra.d_mm, &[]),
        };
        diameters.iter().copied().chain(ellipsoids.iter().map(Ellipsoid::equivalent_diameter_mm))
    }

    /// Number of grains.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Spheres(spheres) => spheres.len(),
            Self::Ellipsoids(ellipsoids) => ellipsoids.len(),
            Self::Polyhedra(polyhedra) => polyhedra.len(),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> From<&'a Grains> for GrainsRef<'a> {
    fn from(grains: &'a Grains) -> Self {
        match grains {
            Grains::Spheres(spheres) => Self::Spheres(spheres),
            Grains::Ellipsoids(ellipsoids) => Self::Ellipsoids(ellipsoids),
            Grains::Polyhedra(polyhedra) => Self::Polyhedra(polyhedra),
        }
    }
}

impl<'a> From<&'a Spheres> for GrainsRef<'a> {
    fn from(spheres: &'a Spheres) -> Self {
        Self::Spheres(spheres)
    }
}

impl<'a> From<&'a Ellipsoids> for GrainsRef<'a> {
    fn from(ellipsoids: &'a Ellipsoids) -> Self {
        Self::Ellipsoids(ellipsoids)
    }
}

impl<'a> From<&'a Polyhedra> for GrainsRef<'a> {
    fn from(polyhedra: &'a Polyhedra) -> Self {
        Self::Polyhedra(polyhedra)
    }
}
