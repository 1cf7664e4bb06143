//! Where the columns of a result come from: memory, or a file of the caller's.

use std::io;

use super::columns::Column;
use crate::arrays;
use crate::packing::{Grains, GrainsRef, Solids, Spheres};
use crate::request::GrainKind;
use crate::shape::Polyhedron;

/// The template of an ellipsoid among polyhedra.
pub(super) const OF_ELLIPSOID: f64 = -1.0;

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

    /// The same table with its rows in this order.
    #[must_use]
    pub fn reordered(self, rows: &[usize]) -> Self {
        let reordered = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
        Self { values: self.values.iter().map(reordered).collect(), ..self }
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
    for_each_rows(grains, &columns, &mut |columns| visit(arrays::from_fn(|i| columns[i])))
}

/// [`for_each_block`] for a number of columns that is not known at compile time.
pub(super) fn for_each_rows(
    grains: &dyn GrainSource,
    columns: &[Column],
    visit: &mut dyn FnMut(&[&[f64]]) -> io::Result<()>,
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
