//! The columns of a result: what they are called, in which order they are stored, and how they are read.
//!
//! Spheres have four columns: the centre and the diameter. Ellipsoids have these four, whose diameter is that of the
//! sphere of equal volume, then the sieve size, the orientation as a quaternion, and the semi-axes. Convex polyhedra
//! have the index of their template in place of the semi-axes; the templates are stated once (`templates`). A result
//! with grains of both kinds has the semi-axes, 0 of polyhedra, and then the template, -1 of ellipsoids. Where a mix
//! has several aggregates, the last column is the index of that of the grain.

use std::io;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::memory::{filled, reserved};
use crate::packing::{Grains, GrainsRef, Solids, Spheres};
use crate::request::GrainKind;
use crate::shape::{Ellipsoid, Polyhedron, Pose, Solid};

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
    /// Smallest square sieve opening that the grain passes, in mm.
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

    /// The columns of all kinds of grains, without and with that of the aggregate.
    const OF_KINDS: [(GrainKind, &'static [Self], &'static [Self]); 4] = [
        (GrainKind::Spheres, Self::OF_SPHERES, &and_aggregate::<4, 5>(SPHERES)),
        (GrainKind::Ellipsoids, Self::OF_ELLIPSOIDS, &and_aggregate::<12, 13>(ELLIPSOIDS)),
        (GrainKind::Polyhedra, Self::OF_POLYHEDRA, &and_aggregate::<10, 11>(POLYHEDRA)),
        (GrainKind::Mixed, Self::OF_BOTH, &and_aggregate::<13, 14>(BOTH)),
    ];

    /// The columns of a kind of grains, in the order of storage; of a mix of several aggregates that of the aggregate
    /// last.
    #[must_use]
    pub fn of(kind: GrainKind, has_aggregates: bool) -> &'static [Self] {
        let of_kind = Self::OF_KINDS.into_iter().find(|of| of.0 == kind);
        of_kind.map_or(Self::OF_SPHERES, |(_, plain, with)| if has_aggregates { with } else { plain })
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
        Self::OF_KINDS
            .into_iter()
            .flat_map(|(_, plain, with)| [plain, with])
            .find(|columns| has_names(columns))
    }

    /// Whether its values count something.
    pub(super) fn is_index(self) -> bool {
        matches!(self, Self::Template | Self::Aggregate)
    }
}

const SPHERES: [Column; 4] = [Column::X, Column::Y, Column::Z, Column::Diameter];

const ELLIPSOIDS: [Column; 12] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Diameter,
    Column::Sieve,
    Column::Qw,
    Column::Qx,
    Column::Qy,
    Column::Qz,
    Column::A,
    Column::B,
    Column::C,
];

const POLYHEDRA: [Column; 10] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Diameter,
    Column::Sieve,
    Column::Qw,
    Column::Qx,
    Column::Qy,
    Column::Qz,
    Column::Template,
];

const BOTH: [Column; 13] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Diameter,
    Column::Sieve,
    Column::Qw,
    Column::Qx,
    Column::Qy,
    Column::Qz,
    Column::A,
    Column::B,
    Column::C,
    Column::Template,
];

/// `M - 1` columns and that of the aggregate.
const fn and_aggregate<const N: usize, const M: usize>(columns: [Column; N]) -> [Column; M] {
    let mut all = [Column::Aggregate; M];
    let mut i = 0;
    while i < N {
        all[i] = columns[i];
        i += 1;
    }
    all
}

/// Names of columns, in their order.
pub(super) fn names(columns: &[Column]) -> Vec<&'static str> {
    columns.iter().map(|column| column.name()).collect()
}

/// Where the columns of a result come from: memory, or a file of the caller's.
pub trait GrainSource {
    /// Number of grains.
    fn len(&self) -> usize;

    /// Whether there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Its columns in the order of storage: those of [`Column::of`].
    fn columns(&self) -> &'static [Column];

    /// What the grains are.
    fn kind(&self) -> GrainKind {
        let columns = self.columns();
        match (columns.contains(&Column::Template), columns.contains(&Column::A)) {
            (true, true) => GrainKind::Mixed,
            (true, false) => GrainKind::Polyhedra,
            (false, true) => GrainKind::Ellipsoids,
            (false, false) => GrainKind::Spheres,
        }
    }

    /// Whether the grains are those of several aggregates.
    fn has_aggregates(&self) -> bool {
        self.columns().contains(&Column::Aggregate)
    }

    /// What the column of templates refers to: polyhedra with an equivalent diameter of 1; none of other grains.
    fn templates(&self) -> &[Polyhedron] {
        &[]
    }

    /// Reads rows `start..start + block.len()` of one of its columns.
    ///
    /// # Errors
    /// Those of the storage behind; [`io::ErrorKind::InvalidInput`] for a column that it does not have.
    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()>;
}

/// The fault of a column that a source does not have.
pub(super) fn no_column(column: Column) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, format!("there is no column {}", column.name()))
}

/// Reads rows of the column of aggregates.
fn read_aggregate(aggregate: &[u16], start: usize, block: &mut [f64]) -> io::Result<()> {
    let rows = aggregate.get(start..start + block.len()).ok_or_else(|| no_column(Column::Aggregate))?;
    block.iter_mut().zip(rows).for_each(|(value, &index)| *value = f64::from(index));
    Ok(())
}

impl GrainSource for Spheres {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn columns(&self) -> &'static [Column] {
        Column::of(GrainKind::Spheres, !self.aggregate.is_empty())
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        if column == Column::Aggregate {
            return read_aggregate(&self.aggregate, start, block);
        }
        let all = match column {
            Column::X => &self.x_mm,
            Column::Y => &self.y_mm,
            Column::Z => &self.z_mm,
            Column::Diameter => &self.d_mm,
            other => return Err(no_column(other)),
        };
        block.copy_from_slice(&all[start..start + block.len()]);
        Ok(())
    }
}

impl GrainSource for Solids {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn columns(&self) -> &'static [Column] {
        Column::of(Self::kind(self), !self.aggregate.is_empty())
    }

    fn templates(&self) -> &[Polyhedron] {
        &self.templates
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        if column == Column::Aggregate {
            return read_aggregate(&self.aggregate, start, block);
        }
        let of_kind = matches!(column, Column::A | Column::B | Column::C | Column::Template);
        let is_mixed = of_kind && Self::kind(self) == GrainKind::Mixed;
        // Where grains of the other kind have a column, these have a number in it too.
        let absent = |number: f64| if is_mixed { Ok(number) } else { Err(no_column(column)) };
        for (value, row) in block.iter_mut().zip(start..) {
            let (shape, pose) = (&self.shapes[row], &self.poses[row]);
            let q = pose.orientation.quaternion();
            let semi_axis =
                |k: usize| shape.ellipsoid().map_or_else(|| absent(0.0), |of| Ok(of.semi_axes_mm()[k]));
            *value = match column {
                Column::X => pose.center_mm.x,
                Column::Y => pose.center_mm.y,
                Column::Z => pose.center_mm.z,
                Column::Diameter => shape.d_mm(),
                Column::Sieve => self.shape(row).sieve_size_mm(),
                Column::Qw => q.w,
                Column::Qx => q.i,
                Column::Qy => q.j,
                Column::Qz => q.k,
                Column::A => semi_axis(0)?,
                Column::B => semi_axis(1)?,
                Column::C => semi_axis(2)?,
                Column::Template => {
                    shape.template().map_or_else(|| absent(OF_ELLIPSOID), |template| Ok(template.into()))?
                }
                Column::Aggregate => return Err(no_column(column)),
            };
        }
        Ok(())
    }
}

impl GrainSource for Grains {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn columns(&self) -> &'static [Column] {
        GrainsRef::from(self).columns()
    }

    fn templates(&self) -> &[Polyhedron] {
        GrainsRef::from(self).templates()
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        GrainsRef::from(self).read(column, start, block)
    }
}

impl GrainSource for GrainsRef<'_> {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn columns(&self) -> &'static [Column] {
        match self {
            Self::Spheres(spheres) => spheres.columns(),
            Self::Solids(solids) => solids.columns(),
        }
    }

    fn templates(&self) -> &[Polyhedron] {
        Self::templates(*self)
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        match self {
            Self::Spheres(spheres) => spheres.read(column, start, block),
            Self::Solids(solids) => solids.read(column, start, block),
        }
    }
}

/// Columns in memory, as they were read from a file.
#[derive(Clone, Debug)]
pub struct Table {
    columns: &'static [Column],
    values: Vec<Vec<f64>>,
    templates: Vec<Polyhedron>,
}

impl Table {
    /// A table of these columns, whose values stand in the same order.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] unless there are as many vectors as columns, all of the same length.
    pub fn new(columns: &'static [Column], values: Vec<Vec<f64>>) -> io::Result<Self> {
        let rows = values.first().map_or(0, Vec::len);
        if values.len() != columns.len() || values.iter().any(|column| column.len() != rows) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "the columns of the grains differ in length",
            ));
        }
        Ok(Self { columns, values, templates: Vec::new() })
    }

    /// The same table with the templates that its column of templates refers to.
    #[must_use]
    pub fn with_templates(self, templates: Vec<Polyhedron>) -> Self {
        Self { templates, ..self }
    }
}

impl GrainSource for Table {
    fn len(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    fn columns(&self) -> &'static [Column] {
        self.columns
    }

    fn templates(&self) -> &[Polyhedron] {
        &self.templates
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        let position = self.columns.iter().position(|own| *own == column).ok_or_else(|| no_column(column))?;
        block.copy_from_slice(&self.values[position][start..start + block.len()]);
        Ok(())
    }
}

/// Memory that the grains of a result take, in bytes: 32 a sphere, 88 another grain, and 2 for the aggregate of each.
pub fn loaded_bytes(source: &dyn GrainSource) -> u64 {
    let bytes = match source.kind() {
        GrainKind::Spheres => 4 * size_of::<f64>(),
        GrainKind::Ellipsoids | GrainKind::Polyhedra | GrainKind::Mixed => {
            size_of::<Solid>() + size_of::<Pose>()
        }
    };
    let bytes = if source.has_aggregates() { bytes + size_of::<u16>() } else { bytes };
    (source.len() as u64).saturating_mul(bytes as u64)
}

/// Reads all columns of a result into memory: [`loaded_bytes`].
///
/// # Errors
/// Those of the source, [`io::ErrorKind::OutOfMemory`], and [`io::ErrorKind::InvalidData`] for an ellipsoid whose
/// semi-axes are not positive, and for a polyhedron without a template, a diameter or an orientation.
pub fn load(source: &dyn GrainSource) -> io::Result<Grains> {
    let column = |column| -> io::Result<Vec<f64>> {
        let mut values = filled(source.len(), 0.0)?;
        source.read(column, 0, &mut values)?;
        Ok(values)
    };
    let aggregate = load_aggregate(source)?;
    let solids = match source.kind() {
        GrainKind::Spheres => {
            return Ok(Grains::Spheres(Spheres {
                x_mm: column(Column::X)?,
                y_mm: column(Column::Y)?,
                z_mm: column(Column::Z)?,
                d_mm: column(Column::Diameter)?,
                aggregate,
            }));
        }
        GrainKind::Ellipsoids => load_ellipsoids(source)?,
        GrainKind::Polyhedra | GrainKind::Mixed => load_polyhedra(source)?,
    };
    Ok(Grains::Solids(Solids { aggregate, ..solids }))
}

/// Reads the column of aggregates; none where there is no such column.
fn load_aggregate(source: &dyn GrainSource) -> io::Result<Vec<u16>> {
    if !source.has_aggregates() {
        return Ok(Vec::new());
    }
    let mut aggregate = reserved(source.len())?;
    for_each_block(source, [Column::Aggregate], |[values]| {
        for &value in values {
            if !(value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u16::MAX)) {
                return Err(invalid(format!("grain {} has the aggregate {value}", aggregate.len())));
            }
            aggregate.push(value as u16);
        }
        Ok(())
    })?;
    Ok(aggregate)
}

/// Reads ellipsoids.
fn load_ellipsoids(source: &dyn GrainSource) -> io::Result<Solids> {
    let rows = source.len();
    let mut grains = Solids { shapes: reserved(rows)?, poses: reserved(rows)?, ..Solids::default() };
    let mut fault = None;
    for_each_block(source, ELLIPSOID_ROW, |columns| {
        for row in 0..columns[0].len() {
            let [x, y, z, w, i, j, k, a, b, c] = columns.map(|column| column[row]);
            let Some(shape) = Ellipsoid::new([a, b, c]) else {
                fault.get_or_insert(grains.shapes.len());
                continue;
            };
            let orientation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
            grains.shapes.push(shape.into());
            grains.poses.push(Pose { center_mm: Vector3::new(x, y, z), orientation });
        }
        Ok(())
    })?;
    match fault {
        None => Ok(grains),
        Some(grain) => Err(invalid(format!("the semi-axes of grain {grain} are not positive numbers"))),
    }
}

/// Reads polyhedra, and ellipsoids among them; the numbers of the source stay as they are.
fn load_polyhedra(source: &dyn GrainSource) -> io::Result<Solids> {
    let rows = source.len();
    let templates = source.templates().to_vec();
    let mut grains =
        Solids { templates, shapes: reserved(rows)?, poses: reserved(rows)?, aggregate: Vec::new() };
    let templates = grains.templates.len();
    for_each_rows(source, angular_row(source), |columns| {
        for row in 0..columns[0].len() {
            let [x, y, z, d, w, i, j, k, template] = std::array::from_fn(|column| columns[column][row]);
            let grain = grains.len();
            let fault = |what: String| Err(invalid(format!("grain {grain} {what}")));
            let semi_axes = columns.get(POLYHEDRON_ROW.len()..).filter(|axes| axes.len() == 3);
            let semi_axes = semi_axes.filter(|_| template == OF_ELLIPSOID);
            let ellipsoid = match semi_axes.map(|axes| Ellipsoid::new([0, 1, 2].map(|k| axes[k][row]))) {
                Some(None) => return fault("has semi-axes that are not positive numbers".into()),
                Some(found) => found,
                None => None,
            };
            let is_template = template >= 0.0 && template.fract() == 0.0 && template < templates as f64;
            if !is_template && ellipsoid.is_none() {
                return fault(format!(
                    "has the template {template}, and there are {templates}, counted from 0"
                ));
            }
            if !([x, y, z, d].iter().all(|x| x.is_finite()) && d > 0.0) {
                return fault("has a coordinate that is no number, or no positive diameter".into());
            }
            let quaternion = Quaternion::new(w, i, j, k);
            let is_unit = (quaternion.norm() - 1.0).abs() <= UNIT_TOLERANCE;
            if !is_unit {
                return fault(format!(
                    "has an orientation that is no unit quaternion: its length is {}",
                    quaternion.norm()
                ));
            }
            let orientation = UnitQuaternion::new_unchecked(quaternion);
            let polyhedron = || Solid::Polyhedron { template: template as u32, d_mm: d };
            grains.shapes.push(ellipsoid.map_or_else(polyhedron, Solid::Ellipsoid));
            grains.poses.push(Pose { center_mm: Vector3::new(x, y, z), orientation });
        }
        Ok(())
    })?;
    Ok(grains)
}

/// Data that are no result.
pub(super) fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// How far the length of the quaternion of a polyhedron may be from 1.
const UNIT_TOLERANCE: f64 = 1.0e-6;

/// What a polyhedron is read from.
pub(super) const POLYHEDRON_ROW: [Column; 9] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Diameter,
    Column::Qw,
    Column::Qx,
    Column::Qy,
    Column::Qz,
    Column::Template,
];

/// The template of an ellipsoid among polyhedra.
pub(super) const OF_ELLIPSOID: f64 = -1.0;

/// What a grain of a result with polyhedra is read from: the semi-axes come last, where there are ellipsoids too.
pub(super) fn angular_row(source: &dyn GrainSource) -> &'static [Column] {
    const MIXED_ROW: [Column; 12] = [
        Column::X,
        Column::Y,
        Column::Z,
        Column::Diameter,
        Column::Qw,
        Column::Qx,
        Column::Qy,
        Column::Qz,
        Column::Template,
        Column::A,
        Column::B,
        Column::C,
    ];
    if source.kind() == GrainKind::Mixed { &MIXED_ROW } else { &POLYHEDRON_ROW }
}

/// What an ellipsoid is read from.
const ELLIPSOID_ROW: [Column; 10] = [
    Column::X,
    Column::Y,
    Column::Z,
    Column::Qw,
    Column::Qx,
    Column::Qy,
    Column::Qz,
    Column::A,
    Column::B,
    Column::C,
];

/// A source of that many rows of zeros.
pub(super) struct Zeros {
    pub(super) rows: usize,
    pub(super) columns: &'static [Column],
}

impl GrainSource for Zeros {
    fn len(&self) -> usize {
        self.rows
    }

    fn columns(&self) -> &'static [Column] {
        self.columns
    }

    fn read(&self, _: Column, _: usize, block: &mut [f64]) -> io::Result<()> {
        block.fill(0.0);
        Ok(())
    }
}

/// Rows that are read, converted and written at a time.
pub(super) const BLOCK_ROWS: usize = 4096;

/// Calls `visit` with blocks of rows, as slices of these columns, from the first row to the last.
pub(super) fn for_each_block<const N: usize>(
    grains: &dyn GrainSource,
    columns: [Column; N],
    mut visit: impl FnMut([&[f64]; N]) -> io::Result<()>,
) -> io::Result<()> {
    for_each_rows(grains, &columns, |columns| visit(std::array::from_fn(|i| columns[i])))
}

/// [`for_each_block`] for a number of columns that is not known at compile time.
pub(super) fn for_each_rows(
    grains: &dyn GrainSource,
    columns: &[Column],
    mut visit: impl FnMut(&[&[f64]]) -> io::Result<()>,
) -> io::Result<()> {
    let most = BLOCK_ROWS.min(grains.len());
    let mut buffers: Vec<Vec<f64>> = columns.iter().map(|_| vec![0.0; most]).collect();
    let mut start = 0;
    while start < grains.len() {
        let rows = BLOCK_ROWS.min(grains.len() - start);
        for (column, buffer) in columns.iter().zip(&mut buffers) {
            grains.read(*column, start, &mut buffer[..rows])?;
        }
        let views: Vec<&[f64]> = buffers.iter().map(|buffer| &buffer[..rows]).collect();
        visit(&views)?;
        start += rows;
    }
    Ok(())
}
