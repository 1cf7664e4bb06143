//! The grains of a packing: their shapes and poses, largest first. The row number is the id of a grain.

use std::borrow::Cow;

use crate::request::GrainKind;
use crate::shape::{Ellipsoid, Polyhedron, Pose, ScaledPolyhedron, Solid, SolidRef};

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

/// Grains that are not spheres, by descending equivalent diameter. Many polyhedra share a template.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Solids {
    /// The forms of the polyhedra, with an equivalent diameter of 1, so that the equivalent diameter of a grain is its
    /// scale; none where all grains are ellipsoids.
    pub templates: Vec<Polyhedron>,
    /// What each grain is.
    pub shapes: Vec<Solid>,
    /// Where each grain is; as many as shapes, or none while the grains have no positions.
    pub poses: Vec<Pose>,
    /// The aggregate that each belongs to, counted from 0; empty where the mix names none.
    pub aggregate: Vec<u16>,
}

impl Solids {
    /// Ellipsoids with their poses.
    #[must_use]
    pub fn of_ellipsoids(shapes: Vec<Ellipsoid>, poses: Vec<Pose>) -> Self {
        let shapes = shapes.into_iter().map(Solid::Ellipsoid).collect();
        Self { templates: Vec::new(), shapes, poses, aggregate: Vec::new() }
    }

    /// Polyhedra with their poses, by the template and the equivalent diameter in mm of each.
    #[must_use]
    pub fn of_polyhedra(
        templates: Vec<Polyhedron>,
        template: &[u32],
        d_mm: &[f64],
        poses: Vec<Pose>,
    ) -> Self {
        let shape = |(&template, &d_mm): (&u32, &f64)| Solid::Polyhedron { template, d_mm };
        let shapes = template.iter().zip(d_mm).map(shape).collect();
        Self { templates, shapes, poses, aggregate: Vec::new() }
    }

    /// Number of grains.
    #[must_use]
    pub fn len(&self) -> usize {
        self.shapes.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.shapes.is_empty()
    }

    /// What they are. Looks at all grains.
    #[must_use]
    pub fn kind(&self) -> GrainKind {
        let is_polyhedron = |shape: &Solid| shape.template().is_some();
        match (self.shapes.iter().any(is_polyhedron), self.shapes.iter().all(is_polyhedron)) {
            (true, true) => GrainKind::Polyhedra,
            (true, false) => GrainKind::Mixed,
            (false, true) if !self.templates.is_empty() => GrainKind::Polyhedra,
            (false, _) => GrainKind::Ellipsoids,
        }
    }

    /// The shape of a grain.
    ///
    /// # Panics
    /// Without that grain, or without its template.
    #[must_use]
    pub fn shape(&self, grain: usize) -> SolidRef<'_> {
        match self.shapes[grain] {
            Solid::Ellipsoid(ellipsoid) => SolidRef::Ellipsoid(ellipsoid),
            Solid::Polyhedron { template, d_mm } => SolidRef::Polyhedron(ScaledPolyhedron {
                template: &self.templates[template as usize],
                scale_mm: d_mm,
            }),
        }
    }

    /// The grains one after the other.
    ///
    /// # Panics
    /// Without the template of a grain.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (SolidRef<'_>, &Pose)> {
        (0..self.len()).map(|grain| (self.shape(grain), &self.poses[grain]))
    }
}

/// The grains of a packing.
#[derive(Clone, Debug, PartialEq)]
pub enum Grains {
    /// All grains are spheres.
    Spheres(Spheres),
    /// The grains are ellipsoids or convex polyhedra.
    Solids(Solids),
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
            Self::Solids(_) => None,
        }
    }

    /// The grains, where they are no spheres.
    #[must_use]
    pub fn solids(&self) -> Option<&Solids> {
        match self {
            Self::Spheres(_) => None,
            Self::Solids(solids) => Some(solids),
        }
    }
}

/// The grains of a packing, borrowed.
#[derive(Clone, Copy, Debug)]
pub enum GrainsRef<'a> {
    /// All grains are spheres.
    Spheres(&'a Spheres),
    /// The grains are ellipsoids or convex polyhedra.
    Solids(&'a Solids),
}

impl<'a> GrainsRef<'a> {
    /// What they are.
    #[must_use]
    pub fn kind(self) -> GrainKind {
        match self {
            Self::Spheres(_) => GrainKind::Spheres,
            Self::Solids(solids) => solids.kind(),
        }
    }

    /// Diameter of the sphere of equal volume in mm.
    ///
    /// # Panics
    /// Without that grain.
    #[inline]
    #[must_use]
    pub fn d_mm(self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain],
            Self::Solids(solids) => solids.shapes[grain].d_mm(),
        }
    }

    /// Centre in mm.
    ///
    /// # Panics
    /// Without that grain.
    #[inline]
    #[must_use]
    pub fn center_mm(self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => spheres.center(grain),
            Self::Solids(solids) => solids.poses[grain].center_mm.into(),
        }
    }

    /// Diameters of the spheres of equal volume in mm, in the order of the grains.
    pub fn diameters_mm(self) -> impl DoubleEndedIterator<Item = f64> + 'a {
        (0..self.len()).map(move |grain| self.d_mm(grain))
    }

    /// The spheres of equal volume about the centres of the grains, in their order.
    #[must_use]
    pub fn equivalent_spheres(self) -> Cow<'a, Spheres> {
        if let Self::Spheres(spheres) = self {
            return Cow::Borrowed(spheres);
        }
        let mut spheres = Spheres::with_capacity(self.len());
        for grain in 0..self.len() {
            spheres.push(self.center_mm(grain), self.d_mm(grain));
        }
        Cow::Owned(spheres)
    }

    /// The aggregate that each grain belongs to, counted from 0; empty where the mix names none.
    #[must_use]
    pub fn aggregate(self) -> &'a [u16] {
        match self {
            Self::Spheres(spheres) => &spheres.aggregate,
            Self::Solids(solids) => &solids.aggregate,
        }
    }

    /// The templates of polyhedra; none of other grains.
    #[must_use]
    pub fn templates(self) -> &'a [Polyhedron] {
        match self {
            Self::Spheres(_) => &[],
            Self::Solids(solids) => &solids.templates,
        }
    }

    /// The grains of these rows alone, in the order of the rows.
    ///
    /// # Panics
    /// Without a grain of a row.
    #[must_use]
    pub fn of_rows(self, rows: &[usize]) -> Grains {
        fn picked<T: Copy>(column: &[T], rows: &[usize]) -> Vec<T> {
            rows.iter().map(|&row| column[row]).collect()
        }
        let aggregate = match self.aggregate() {
            [] => Vec::new(),
            all => picked(all, rows),
        };
        match self {
            Self::Spheres(all) => {
                let mut spheres = Spheres::with_capacity(rows.len());
                for &row in rows {
                    spheres.push(all.center(row), all.d_mm[row]);
                }
                Grains::Spheres(Spheres { aggregate, ..spheres })
            }
            Self::Solids(all) => Grains::Solids(Solids {
                templates: all.templates.clone(),
                shapes: picked(&all.shapes, rows),
                poses: picked(&all.poses, rows),
                aggregate,
            }),
        }
    }

    /// Number of grains.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Spheres(spheres) => spheres.len(),
            Self::Solids(solids) => solids.len(),
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
            Grains::Solids(solids) => Self::Solids(solids),
        }
    }
}

impl<'a> From<&'a Spheres> for GrainsRef<'a> {
    fn from(spheres: &'a Spheres) -> Self {
        Self::Spheres(spheres)
    }
}

impl<'a> From<&'a Solids> for GrainsRef<'a> {
    fn from(solids: &'a Solids) -> Self {
        Self::Solids(solids)
    }
}
