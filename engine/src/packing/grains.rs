//! The grains of a packing: their shapes and poses, largest first. The row number is the id of a grain.

use std::borrow::Cow;

use crate::request::GrainKind;
use crate::shape::{Ellipsoid, Polyhedron, Pose, Solid, SolidRef, sphere_volume};

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
        let shapes = shapes.into_iter().map(Solid::from).collect();
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
        let shapes = template.iter().zip(d_mm).map(|(&of, &d_mm)| Solid::of_template(of, d_mm)).collect();
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
        let any = |has_template: bool| self.shapes.iter().any(|of| of.template().is_some() == has_template);
        let has_templates = if self.is_empty() { !self.templates.is_empty() } else { any(true) };
        GrainKind::of(!has_templates || any(false), has_templates)
    }

    /// The shape of a grain.
    ///
    /// # Panics
    /// Without that grain, or without its template.
    #[must_use]
    pub fn shape(&self, grain: usize) -> SolidRef<'_> {
        self.shapes[grain].of(&self.templates).expect("a template of these grains")
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
        GrainsRef::from(self).spheres()
    }

    /// The grains, where they are shaped.
    #[must_use]
    pub fn solids(&self) -> Option<&Solids> {
        GrainsRef::from(self).solids()
    }

    /// The grains with their shapes, or the spheres where all are spheres.
    ///
    /// # Errors
    /// They are spheres.
    pub fn into_solids(self) -> Result<Solids, Spheres> {
        match self {
            Self::Spheres(spheres) => Err(spheres),
            Self::Solids(solids) => Ok(solids),
        }
    }

    /// Takes templates in place of those of the grains, as many.
    pub fn set_templates(&mut self, templates: &[Polyhedron]) {
        if let Self::Solids(solids) = self {
            templates.clone_into(&mut solids.templates);
        }
    }

    /// Leaves the first grains, that many.
    pub fn truncate(&mut self, grains: usize) {
        match self {
            Self::Spheres(Spheres { x_mm, y_mm, z_mm, d_mm, aggregate }) => {
                for column in [x_mm, y_mm, z_mm, d_mm] {
                    column.truncate(grains);
                }
                aggregate.truncate(grains);
            }
            Self::Solids(Solids { shapes, poses, aggregate, .. }) => {
                shapes.truncate(grains);
                poses.truncate(grains);
                aggregate.truncate(grains);
            }
        }
    }

    /// Multiplies the sizes of all grains.
    pub fn scale(&mut self, factor: f64) {
        match self {
            _ if factor == 1.0 => {}
            Self::Spheres(spheres) => spheres.d_mm.iter_mut().for_each(|d| *d *= factor),
            Self::Solids(solids) => {
                solids.shapes.iter_mut().for_each(|shape| *shape = shape.scaled(factor));
            }
        }
    }

    /// The grains with the sizes of others, as many of the same kind; `None` where their kind is another.
    #[must_use]
    pub fn with_sizes_of(&self, other: &Self) -> Option<Self> {
        Some(match (self, other) {
            (Self::Spheres(own), Self::Spheres(other)) => {
                Self::Spheres(Spheres { d_mm: other.d_mm.clone(), ..own.clone() })
            }
            (Self::Solids(own), Self::Solids(other)) => {
                Self::Solids(Solids { shapes: other.shapes.clone(), ..own.clone() })
            }
            _ => return None,
        })
    }
}

impl From<Spheres> for Grains {
    fn from(spheres: Spheres) -> Self {
        Self::Spheres(spheres)
    }
}

impl From<Solids> for Grains {
    fn from(solids: Solids) -> Self {
        Self::Solids(solids)
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

    /// The spheres, where all are spheres.
    #[must_use]
    pub fn spheres(self) -> Option<&'a Spheres> {
        match self {
            Self::Spheres(spheres) => Some(spheres),
            Self::Solids(_) => None,
        }
    }

    /// The grains with their shapes, where they are not all spheres.
    #[must_use]
    pub fn solids(self) -> Option<&'a Solids> {
        match self {
            Self::Spheres(_) => None,
            Self::Solids(solids) => Some(solids),
        }
    }

    /// What a grain is called.
    ///
    /// # Panics
    /// Without that grain.
    #[must_use]
    pub fn noun(self, grain: usize) -> &'static str {
        self.solids().map_or("sphere", |solids| solids.shapes[grain].noun())
    }

    /// Index of the template of a grain, where it has one.
    ///
    /// # Panics
    /// Without that grain.
    #[must_use]
    pub fn template(self, grain: usize) -> Option<u32> {
        self.solids()?.shapes[grain].template()
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

    /// Volume of a grain in mm³.
    ///
    /// # Panics
    /// Without that grain.
    #[must_use]
    pub fn volume_mm3(self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => sphere_volume(spheres.d_mm[grain]),
            Self::Solids(solids) => solids.shapes[grain].volume_mm3(),
        }
    }

    /// Whether a grain has the size and the shape of that of other grains times a factor, to the last bit, and its
    /// aggregate.
    ///
    /// # Panics
    /// Without that grain.
    #[must_use]
    pub fn is_scaled(self, grain: usize, other: GrainsRef<'_>, factor: f64) -> bool {
        let has_size = match (self, other) {
            (Self::Spheres(own), GrainsRef::Spheres(other)) => {
                own.d_mm[grain].to_bits() == (factor * other.d_mm[grain]).to_bits()
            }
            (Self::Solids(own), GrainsRef::Solids(other)) => {
                own.shapes[grain].has_bits_of(&other.shapes[grain].scaled(factor))
            }
            _ => false,
        };
        has_size && self.aggregate().get(grain) == other.aggregate().get(grain)
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
        self.solids().map_or(&[], |solids| &solids.templates)
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
