//! Where the columns of a result come from: memory, or a file of the caller's.

use std::io;
use std::ops::Range;

use super::columns::{BODY_ROW, Column};
use crate::arrays::{self, Each as _};
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
        Column::kind(self.columns())
    }

    /// Whether there is this column.
    fn has(&self, column: Column) -> bool {
        self.columns().contains(&column)
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

impl Spheres {
    fn read_rows(&self, column: Column, rows: Range<usize>, block: &mut [f64]) -> io::Result<()> {
        let all = match column {
            Column::X => &self.x_mm,
            Column::Y => &self.y_mm,
            Column::Z => &self.z_mm,
            Column::Diameter => &self.d_mm,
            other => return Err(no_column(other)),
        };
        block.copy_from_slice(&all[rows]);
        Ok(())
    }
}

impl Solids {
    fn read_rows(&self, column: Column, rows: Range<usize>, block: &mut [f64]) -> io::Result<()> {
        // Where some grains have a column, all others have a number in it too.
        let is_of_some = matches!(column, Column::A | Column::B | Column::C | Column::Template);
        let has_column = is_of_some && self.has(column);
        let absent = |number: f64| if has_column { Ok(number) } else { Err(no_column(column)) };
        for (value, row) in block.iter_mut().zip(rows) {
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

impl GrainSource for GrainsRef<'_> {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn columns(&self) -> &'static [Column] {
        Column::of(Self::kind(*self), !self.aggregate().is_empty())
    }

    fn templates(&self) -> &[Polyhedron] {
        Self::templates(*self)
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        let rows = start..start + block.len();
        if column == Column::Aggregate {
            let aggregate = self.aggregate().get(rows).ok_or_else(|| no_column(column))?;
            block.iter_mut().zip(aggregate).for_each(|(value, &index)| *value = f64::from(index));
            return Ok(());
        }
        match self {
            Self::Spheres(spheres) => spheres.read_rows(column, rows, block),
            Self::Solids(solids) => solids.read_rows(column, rows, block),
        }
    }
}

/// The columns of grains, which are those of a reference to them.
macro_rules! by_reference {
    ($($grains:ty),*) => {$(
        impl GrainSource for $grains {
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
    )*};
}

by_reference!(Spheres, Solids, Grains);

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

/// What a row says of a grain with an orientation.
pub(super) struct Body {
    pub(super) center_mm: [f64; 3],
    pub(super) d_mm: f64,
    pub(super) quaternion: [f64; 4],
    /// As long as its template is absent.
    pub(super) semi_axes_mm: [f64; 3],
    /// What the column of templates says; absent of an ellipsoid.
    pub(super) template: Option<f64>,
}

/// Calls `visit` with the grains of a source with orientations, from the first to the last.
pub(super) fn for_each_body(
    grains: &dyn GrainSource,
    visit: &mut dyn FnMut(&Body) -> io::Result<()>,
) -> io::Result<()> {
    let columns: Vec<Column> = BODY_ROW.into_iter().filter(|column| grains.has(*column)).collect();
    let has_axes = grains.has(Column::A);
    let template = columns.iter().position(|column| *column == Column::Template);
    for_each_rows(grains, &columns, &mut |values| {
        (0..values[0].len()).try_for_each(|row| {
            let at = |column: usize| values[column][row];
            visit(&Body {
                center_mm: [0, 1, 2].each(at),
                d_mm: at(3),
                quaternion: [4, 5, 6, 7].each(at),
                semi_axes_mm: if has_axes { [8, 9, 10].each(at) } else { [0.0; 3] },
                template: template.map(at).filter(|template| !(has_axes && *template == OF_ELLIPSOID)),
            })
        })
    })
}
