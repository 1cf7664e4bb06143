//! The binary form for viewers: 8 bytes a sphere, 24 bytes another grain, largest first, so that any prefix of the
//! records is a picture. Its media type is `application/vnd.packstone.view`; `docs/view.md` describes it.
//!
//! Places and sizes are shares of the specimen's bounding box and of the largest size, as u16: in a box of 150 mm two
//! places are 2.3 micrometres apart. The size of a grain is the diameter of the sphere around its centre that holds it.
//! Grains are read twice, first their sizes. Grains that are not stored in the order of these sizes, as grains of other
//! shapes may be, are sorted as records in memory; all others are written block by block.

use std::io::{self, Write};

use serde_json::Value;

use super::load::invalid;
use super::source::{for_each_block, for_each_rows};
use super::vtk::classifier;
use super::{Column, GrainSource, Head, nominal_size};
use crate::arrays::Each as _;
use crate::memory::reserved;
use crate::shape::Polyhedron;

const MAGIC: [u8; 8] = *b"PKSTVIEW";
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 64;
const SPHERE_BYTES: usize = 8;
const SOLID_BYTES: usize = 24;
/// The largest share as u16.
const WHOLE: f64 = 65_535.0;
/// The largest component of a quaternion as i16.
const UNIT: f64 = 32_767.0;

/// The bounding box of a specimen, which starts at the origin.
struct Bounds {
    size_mm: [f64; 3],
    /// 0 for a box, 1 for a cylinder, 2 for any other.
    specimen: u32,
    /// Whether it repeats in x, y and z.
    is_periodic: bool,
}

impl Bounds {
    fn of(head: &Head) -> io::Result<Self> {
        let specimen = &head.request["specimen"];
        let length = |value: &Value| {
            let found = value.as_f64().filter(|length| length.is_finite() && *length > 0.0);
            found
                .ok_or_else(|| invalid(format!("the size of the specimen is no positive number: {specimen}")))
        };
        let is_periodic = specimen["boundary"] == "periodic";
        if specimen["type"] == "cylinder" {
            let (d, h) = (length(&specimen["diameter_mm"])?, length(&specimen["height_mm"])?);
            return Ok(Self { size_mm: [d, d, h], specimen: 1, is_periodic });
        }
        let size = &specimen["size_mm"];
        let size_mm = [length(&size[0])?, length(&size[1])?, length(&size[2])?];
        Ok(Self { size_mm, specimen: if specimen["type"] == "box" { 0 } else { 2 }, is_periodic })
    }

    /// A place on an axis as a share of the box; that of a periodic image is the place within the box.
    fn share(&self, axis: usize, place_mm: f64) -> u16 {
        let length = self.size_mm[axis];
        let place = if self.is_periodic { place_mm.rem_euclid(length) } else { place_mm };
        share(place / length)
    }
}

/// A number from 0 to 1 as u16; numbers beyond as the nearest of these.
fn share(of_one: f64) -> u16 {
    (of_one * WHOLE + 0.5) as u16
}

/// The share of a size, which is never 0: the grain is there.
fn size_share(of_largest: f64) -> u16 {
    share(of_largest).max(1)
}

/// The sizes of the grains.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sizes {
    smallest_mm: f64,
    largest_mm: f64,
    /// Whether no grain is larger than the one before it.
    is_sorted: bool,
}

/// The columns from which the size of a grain follows, and how.
struct SizeOf {
    columns: Vec<Column>,
    /// Diameters of the spheres that hold the templates, in equivalent diameters.
    outer: Vec<f64>,
}

impl SizeOf {
    fn new(grains: &dyn GrainSource) -> Self {
        let needed = [Column::Diameter, Column::A, Column::Template];
        Self {
            columns: needed.into_iter().filter(|column| grains.has(*column)).collect(),
            outer: grains.templates().iter().map(|template| 2.0 * template.outer_radius()).collect(),
        }
    }

    /// The size of a row of [`Self::columns`].
    fn size_mm(&self, values: &[&[f64]], row: usize) -> f64 {
        let at = |column| self.columns.iter().position(|own| *own == column).map(|at| values[at][row]);
        // The template of an ellipsoid is -1, which no index is.
        let outer = at(Column::Template).filter(|k| *k >= 0.0).and_then(|k| self.outer.get(k as usize));
        let d = at(Column::Diameter).unwrap_or_default();
        match (outer, at(Column::A)) {
            (Some(outer), _) => d * outer,
            (None, Some(a)) => 2.0 * a,
            (None, None) => d,
        }
    }

    fn sizes(&self, grains: &dyn GrainSource) -> io::Result<Sizes> {
        let mut sizes = Sizes { smallest_mm: f64::INFINITY, largest_mm: 0.0, is_sorted: true };
        let mut before = f64::INFINITY;
        let mut note = |size: f64| {
            sizes.is_sorted &= size <= before;
            sizes.smallest_mm = sizes.smallest_mm.min(size);
            sizes.largest_mm = sizes.largest_mm.max(size);
            before = size;
        };
        if self.columns == [Column::Diameter] {
            for_each_block(grains, [Column::Diameter], |[d]| {
                d.iter().copied().for_each(&mut note);
                Ok(())
            })?;
        } else {
            for_each_rows(grains, &self.columns, &mut |values| {
                (0..values[0].len()).map(|row| self.size_mm(values, row)).for_each(&mut note);
                Ok(())
            })?;
        }
        if grains.is_empty() {
            sizes.smallest_mm = 0.0;
        }
        Ok(sizes)
    }
}

fn record_bytes(grains: &dyn GrainSource) -> usize {
    if grains.has(Column::Qw) { SOLID_BYTES } else { SPHERE_BYTES }
}

/// Number of bytes that [`write`] writes.
pub(super) fn length(grains: &dyn GrainSource) -> u64 {
    let records = grains.len() as u64 * record_bytes(grains) as u64;
    (HEAD_BYTES + template_table(grains).len()) as u64 + records
}

pub(super) fn write(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let bounds = Bounds::of(head)?;
    let size_of = SizeOf::new(grains);
    let sizes = size_of.sizes(grains)?;
    let table = template_table(grains);
    out.write_all(&head_bytes(head, grains, &bounds, sizes, table.len()))?;
    out.write_all(&table)?;
    if sizes.is_sorted {
        return for_each_record_block(head, grains, &bounds, &size_of, sizes, |block| out.write_all(block));
    }
    let record = record_bytes(grains);
    let mut records: Vec<u8> = reserved(grains.len() * record)?;
    for_each_record_block(head, grains, &bounds, &size_of, sizes, |block| {
        records.extend_from_slice(block);
        Ok(())
    })?;
    let mut order: Vec<u32> = reserved(grains.len())?;
    order.extend(0..grains.len() as u32);
    let size = |row: &u32| {
        let at = *row as usize * record + 6;
        u16::from_le_bytes([records[at], records[at + 1]])
    };
    order.sort_by_key(|row| std::cmp::Reverse(size(row)));
    for row in order {
        out.write_all(&records[row as usize * record..][..record])?;
    }
    Ok(())
}

fn head_bytes(
    head: &Head,
    grains: &dyn GrainSource,
    bounds: &Bounds,
    sizes: Sizes,
    table_bytes: usize,
) -> Vec<u8> {
    let aggregates = head.request["mix"]["aggregates"].as_array().map_or(1, Vec::len);
    let mut bytes = Vec::with_capacity(HEAD_BYTES);
    bytes.extend(MAGIC);
    bytes.extend((grains.len() as u32).to_le_bytes());
    bytes.extend(VERSION.to_le_bytes());
    for length in bounds.size_mm.into_iter().chain([sizes.smallest_mm, sizes.largest_mm]) {
        bytes.extend((length as f32).to_le_bytes());
    }
    let periodic = if bounds.is_periodic { 0b111 } else { 0 };
    let counts = [record_bytes(grains), table_bytes, aggregates].each(|count| count as u32);
    for number in [bounds.specimen, periodic].into_iter().chain(counts) {
        bytes.extend(number.to_le_bytes());
    }
    bytes.resize(HEAD_BYTES, 0);
    bytes
}

/// The bodies that polyhedra refer to, scaled into the unit sphere; nothing where there are no polyhedra.
///
/// A viewer draws flat faces. The vertices of a rounded body are moved outwards by its radius of rounding, so that the
/// drawn body is as long as the grain.
fn template_table(grains: &dyn GrainSource) -> Vec<u8> {
    if !grains.has(Column::Template) {
        return Vec::new();
    }
    let templates = grains.templates();
    let mut bytes = (templates.len() as u32).to_le_bytes().to_vec();
    for template in templates {
        push_template(&mut bytes, template);
    }
    bytes
}

fn push_template(bytes: &mut Vec<u8>, template: &Polyhedron) {
    let triangles = template
        .faces()
        .iter()
        .flat_map(|face| face.windows(2).skip(1).map(|edge| [face[0], edge[0], edge[1]]));
    let triangles: Vec<[u32; 3]> = triangles.collect();
    bytes.extend((template.vertices().len() as u32).to_le_bytes());
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for vertex in template.vertices() {
        let factor = (1.0 + template.rounding() / vertex.norm()) / template.outer_radius();
        bytes.extend((vertex * factor).iter().flat_map(|x| (*x as f32).to_le_bytes()));
    }
    bytes.extend(triangles.iter().flatten().flat_map(|vertex| (*vertex as u16).to_le_bytes()));
    bytes.resize(bytes.len().next_multiple_of(4), 0);
}

/// Calls `visit` with the records of the grains in the order of storage.
fn for_each_record_block(
    head: &Head,
    grains: &dyn GrainSource,
    bounds: &Bounds,
    size_of: &SizeOf,
    sizes: Sizes,
    mut visit: impl FnMut(&[u8]) -> io::Result<()>,
) -> io::Result<()> {
    let mut bytes = Vec::new();
    let begin = |bytes: &mut Vec<u8>, place: [f64; 3], size_mm: f64| {
        let [x, y, z] = [0, 1, 2].each(|axis| u64::from(bounds.share(axis, place[axis])));
        let size = u64::from(size_share(size_mm / sizes.largest_mm));
        bytes.extend_from_slice(&(x | y << 16 | z << 32 | size << 48).to_le_bytes());
    };
    if !grains.has(Column::Qw) {
        return for_each_block(
            grains,
            [Column::X, Column::Y, Column::Z, Column::Diameter],
            |[x, y, z, d]| {
                bytes.clear();
                for row in 0..d.len() {
                    begin(&mut bytes, [x[row], y[row], z[row]], d[row]);
                }
                visit(&bytes)
            },
        );
    }
    let fixed = [Column::X, Column::Y, Column::Z, Column::Qx, Column::Qy, Column::Qz, Column::Qw];
    let others = [
        Column::A,
        Column::B,
        Column::C,
        Column::Template,
        Column::Aggregate,
        Column::Diameter,
        Column::Sieve,
    ];
    let mut columns = fixed.to_vec();
    columns.extend(others.into_iter().filter(|column| grains.has(*column)));
    let position = |column: Column| columns.iter().position(|own| *own == column);
    let [a, b, c, template, aggregate, _, _] = others.each(position);
    let (class_of, nominal) = (classifier(head), position(nominal_size(head, grains)));
    let of_size: Vec<usize> = size_of.columns.iter().filter_map(|column| position(*column)).collect();
    for_each_rows(grains, &columns, &mut |values| {
        bytes.clear();
        let size_values: Vec<&[f64]> = of_size.iter().map(|at| values[*at]).collect();
        for row in 0..values[0].len() {
            let at = |column: Option<usize>| column.map(|column| values[column][row]);
            begin(
                &mut bytes,
                [values[0][row], values[1][row], values[2][row]],
                size_of.size_mm(&size_values, row),
            );
            for component in &values[3..7] {
                bytes.extend(((component[row] * UNIT).round() as i16).to_le_bytes());
            }
            let template = at(template).filter(|k| *k >= 0.0);
            let axis = |axis| match (template, at(a), at(axis)) {
                (None, Some(a), Some(axis)) => share(axis / a),
                _ => u16::MAX,
            };
            let kind = template.map_or(0, |k| (k + 1.0) as u16);
            for number in [axis(b), axis(c), kind] {
                bytes.extend(number.to_le_bytes());
            }
            let class = at(nominal).map_or(0, &class_of);
            bytes.extend([at(aggregate).unwrap_or_default() as u8, u8::try_from(class).unwrap_or(u8::MAX)]);
        }
        visit(&bytes)
    })
}
