//! VTK XML files with raw appended data, written array by array, for image data, poly data and unstructured grids.
//!
//! The length of every array is known before its values are, so that the head, which states the offset of each, comes
//! first and no more than a few blocks of values are held. Threads share the values that take time to compute.

use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::ops::Range;

use super::ExportError;
use super::pieces::{in_order, slots};
use super::provenance::Provenance;

/// Bytes that are gathered before they are written.
const BLOCK_BYTES: usize = 1 << 16;

/// A value of an array: a number, or a tuple of as many numbers as the array has components.
pub(super) trait Value: Copy {
    /// Name of the type of its components.
    const TYPE: &'static str;
    const COMPONENTS: u64;
    const BYTES: u64;

    /// Appends its bytes, little-endian.
    fn push(self, bytes: &mut Vec<u8>);
}

macro_rules! numbers {
    ($($number:ty => $name:literal),*) => {$(
        impl Value for $number {
            const TYPE: &'static str = $name;
            const COMPONENTS: u64 = 1;
            const BYTES: u64 = size_of::<Self>() as u64;

            fn push(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

numbers!(f64 => "Float64", f32 => "Float32", i64 => "Int64", i32 => "Int32", u32 => "UInt32", u8 => "UInt8");

impl<T: Value, const N: usize> Value for [T; N] {
    const TYPE: &'static str = T::TYPE;
    const COMPONENTS: u64 = N as u64 * T::COMPONENTS;
    const BYTES: u64 = N as u64 * T::BYTES;

    fn push(self, bytes: &mut Vec<u8>) {
        for component in self {
            component.push(bytes);
        }
    }
}

type Fill<'a> = Box<dyn FnOnce(&mut Sink<'_>) -> Result<(), ExportError> + 'a>;

/// An array of the appended data.
struct Array<'a> {
    name: &'static str,
    bytes: u64,
    fill: Fill<'a>,
}

/// A file that is put together array by array and then written.
pub(super) struct VtkXml<'a> {
    data_set: &'static str,
    head: String,
    /// Tag of the section that arrays are added to.
    section: Option<&'static str>,
    arrays: Vec<Array<'a>>,
    /// Threads that share the values of [`VtkXml::shared`].
    threads: NonZeroUsize,
}

/// Values of a piece of an array.
#[derive(Default)]
pub(super) struct Values(Vec<u8>);

impl Values {
    /// Takes the next value.
    pub(super) fn put(&mut self, value: impl Value) {
        value.push(&mut self.0);
    }
}

/// Where the values of an array go.
pub(super) struct Sink<'a> {
    out: &'a mut dyn Write,
    /// Told how many bytes of arrays are written, after each block; ends the work by an error.
    watch: &'a mut dyn FnMut(u64) -> Result<(), ExportError>,
    bytes: Vec<u8>,
    written: u64,
}

impl Sink<'_> {
    /// Takes the next value.
    pub(super) fn put(&mut self, value: impl Value) -> Result<(), ExportError> {
        value.push(&mut self.bytes);
        if self.bytes.len() >= BLOCK_BYTES { self.end_block() } else { Ok(()) }
    }

    fn end_block(&mut self) -> Result<(), ExportError> {
        self.flush()?;
        (self.watch)(self.written)
    }
}

/// Takes bytes of values as they are; does not ask whether to go on.
impl Write for Sink<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.flush()?;
        self.out.write_all(bytes)?;
        self.written += bytes.len() as u64;
        Ok(bytes.len())
    }

    /// Passes on what has been gathered, without flushing the writer behind.
    fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.bytes)?;
        self.written += self.bytes.len() as u64;
        self.bytes.clear();
        Ok(())
    }
}

impl<'a> VtkXml<'a> {
    /// A file of one data set with one piece, each with its attributes.
    pub(super) fn new(
        data_set: &'static str,
        attributes: &[(&str, String)],
        piece: &[(&str, String)],
        provenance: Option<&Provenance>,
    ) -> Self {
        let text = |attributes: &[(&str, String)]| -> String {
            attributes.iter().flat_map(|(name, value)| [" ", *name, "=\"", value.as_str(), "\""]).collect()
        };
        let head = [
            "<?xml version=\"1.0\"?>\n",
            &format!(
                "<VTKFile type=\"{data_set}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
            ),
            &format!("  <{data_set}{}>\n", text(attributes)),
            &provenance.map_or_else(String::new, |provenance| field_data(provenance, data_set)),
            &format!("    <Piece{}>\n", text(piece)),
        ];
        Self { data_set, head: head.concat(), section: None, arrays: Vec::new(), threads: NonZeroUsize::MIN }
    }

    /// The same file, whose shared arrays are computed on so many threads. Its bytes do not depend on them.
    pub(super) fn on_threads(self, threads: NonZeroUsize) -> Self {
        Self { threads, ..self }
    }

    /// Begins a section, as `Points` or `CellData`; `scalars` names the array that readers show first.
    pub(super) fn section(&mut self, tag: &'static str, scalars: Option<&str>) {
        self.end_section();
        let scalars = scalars.map_or_else(String::new, |name| format!(" Scalars=\"{name}\""));
        self.head.extend(["      <", tag, &scalars, ">\n"]);
        self.section = Some(tag);
    }

    fn end_section(&mut self) {
        if let Some(tag) = self.section.take() {
            self.head.extend(["      </", tag, ">\n"]);
        }
    }

    /// Adds an array of `len` values to the section.
    pub(super) fn array<T: Value>(
        &mut self,
        name: &'static str,
        len: usize,
        values: impl Iterator<Item = T> + 'a,
    ) {
        self.fill::<T>(name, len, move |sink| {
            for value in values {
                sink.put(value)?;
            }
            Ok(())
        });
    }

    /// Adds an array of `len` values to the section, which `fill` writes when the arrays before it are written.
    pub(super) fn fill<T: Value>(
        &mut self,
        name: &'static str,
        len: usize,
        fill: impl FnOnce(&mut Sink<'_>) -> Result<(), ExportError> + 'a,
    ) {
        let offset: u64 = self.arrays.iter().map(|array| size_of::<u64>() as u64 + array.bytes).sum();
        let components = if T::COMPONENTS == 1 {
            String::new()
        } else {
            format!(" NumberOfComponents=\"{}\"", T::COMPONENTS)
        };
        let array = format!(
            "        <DataArray type=\"{}\" Name=\"{name}\"{components} format=\"appended\" offset=\"{offset}\"/>\n",
            T::TYPE
        );
        self.head.push_str(&array);
        self.arrays.push(Array { name, bytes: len as u64 * T::BYTES, fill: Box::new(fill) });
    }

    /// Adds an array of `len` values of a number of items, each of which has some of the values: `values` puts those of
    /// a range of items, and threads share the ranges.
    pub(super) fn shared<T: Value>(
        &mut self,
        name: &'static str,
        (len, items): (usize, usize),
        values: impl Fn(Range<usize>, &mut Values) + Sync + 'a,
    ) {
        let bytes_per_item = (len * T::BYTES as usize / items.max(1)).max(1);
        let items_per_piece = (BLOCK_BYTES / bytes_per_item).max(1);
        let pieces = items.div_ceil(items_per_piece);
        let threads = self.threads;
        self.fill::<T>(name, len, move |sink| {
            let make = |piece: usize, made: &mut Values| {
                let first = piece * items_per_piece;
                made.0.clear();
                values(first..items.min(first + items_per_piece), made);
                Ok(())
            };
            in_order(&mut slots(threads, pieces, Values::default), pieces, make, |_, made| {
                sink.write_all(&made.0)?;
                (sink.watch)(sink.written)
            })
        });
    }

    /// Bytes of all arrays.
    pub(super) fn bytes(&self) -> u64 {
        self.arrays.iter().map(|array| array.bytes).sum()
    }

    /// Writes the file. `watch` is told after each block how many bytes of arrays are written.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::CheckFailed`] for an array of another length than was stated, and those
    /// of `watch` and of what fills the arrays.
    pub(super) fn write(
        mut self,
        out: &mut dyn Write,
        watch: &mut dyn FnMut(u64) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        self.end_section();
        let data_set = self.data_set;
        write!(out, "{}    </Piece>\n  </{data_set}>\n  <AppendedData encoding=\"raw\">\n   _", self.head)?;
        let mut sink = Sink { out, watch, bytes: Vec::with_capacity(2 * BLOCK_BYTES), written: 0 };
        for Array { name, bytes, fill } in self.arrays {
            sink.out.write_all(&bytes.to_le_bytes())?;
            let before = sink.written;
            fill(&mut sink)?;
            sink.end_block()?;
            let written = sink.written - before;
            if written != bytes {
                return Err(ExportError::CheckFailed(format!(
                    "{written} of {bytes} bytes of the array {name} were written"
                )));
            }
        }
        out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
        Ok(())
    }
}

/// Where a packing comes from, as arrays of numbers and of text. Grids have the UTF-8 codes of a text as numbers:
/// meshio, which reads grids, refuses a file with arrays of the type `String`.
fn field_data(provenance: &Provenance, data_set: &str) -> String {
    let array = |kind: &str, name: &str, tuples: usize, values: &str| {
        format!(
            "      <DataArray type=\"{kind}\" Name=\"{name}\" NumberOfTuples=\"{tuples}\" format=\"ascii\">{values}</DataArray>\n"
        )
    };
    let texts = [
        ("job_id", provenance.job_id.as_deref()),
        ("name", provenance.name.as_deref()),
        ("engine_version", Some(provenance.engine_version.as_str())),
        ("result_sha256", provenance.result_sha256.as_deref()),
    ];
    let texts = texts.into_iter().filter_map(|(name, text)| {
        let codes: Vec<String> = text?.bytes().map(|byte| byte.to_string()).collect();
        if data_set == "UnstructuredGrid" {
            (!codes.is_empty()).then(|| array("UInt8", name, codes.len(), &codes.join(" ")))
        } else {
            Some(array("String", name, 1, &format!("{} 0", codes.join(" "))))
        }
    });
    let seed = provenance.seed.map(|seed| array("UInt64", "seed", 1, &seed.to_string()));
    let fractions = [
        ("volume_fraction_mixture", provenance.volume_fraction_mixture),
        ("volume_fraction_effective", provenance.volume_fraction_effective),
    ];
    let fractions = fractions.map(|(name, value)| array("Float64", name, 1, &value.to_string()));
    let lines: String = texts.chain(seed).chain(fractions).collect();
    format!("    <FieldData>\n{lines}    </FieldData>\n")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn written(file: VtkXml<'_>) -> Result<String, ExportError> {
        let mut out = Vec::new();
        file.write(&mut out, &mut |_| Ok(()))?;
        Ok(String::from_utf8_lossy(&out).into_owned())
    }

    #[test]
    fn an_array_of_another_length_than_stated_is_refused() {
        for len in [2, 4] {
            let mut file = VtkXml::new("PolyData", &[], &[], None);
            file.section("Points", None);
            file.array("Points", len, [[1.0, 2.0, 3.0]; 3].into_iter());
            let error = written(file).unwrap_err().to_string();
            assert!(error.contains(&format!("72 of {} bytes of the array Points", 24 * len)), "{error}");
        }
    }

    #[test]
    fn offsets_count_the_lengths_before_each_array() {
        let mut file =
            VtkXml::new("ImageData", &[("Origin", "0 0 0".into())], &[("Extent", "0 1".into())], None);
        file.section("PointData", Some("a"));
        file.array("a", 3, [1_u8, 2, 3].into_iter());
        file.section("CellData", None);
        file.array("b", 1, [[0.5_f32; 2]].into_iter());
        let text = written(file).unwrap();
        let head = "<?xml version=\"1.0\"?>
<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">
  <ImageData Origin=\"0 0 0\">
    <Piece Extent=\"0 1\">
      <PointData Scalars=\"a\">
        <DataArray type=\"UInt8\" Name=\"a\" format=\"appended\" offset=\"0\"/>
      </PointData>
      <CellData>
        <DataArray type=\"Float32\" Name=\"b\" NumberOfComponents=\"2\" format=\"appended\" offset=\"11\"/>
      </CellData>
    </Piece>
  </ImageData>
  <AppendedData encoding=\"raw\">
   _\u{3}";
        assert!(text.starts_with(head), "{text}");
    }

    #[test]
    fn a_watch_that_says_no_ends_the_writing() {
        let mut file = VtkXml::new("PolyData", &[], &[], None);
        file.section("PointData", None);
        file.array("a", 100_000, std::iter::repeat_n(1.0_f64, 100_000));
        let mut blocks = 0;
        let stopped = file.write(&mut io::sink(), &mut |_| {
            blocks += 1;
            if blocks == 3 { Err(ExportError::Stopped) } else { Ok(()) }
        });
        assert!(matches!(stopped, Err(ExportError::Stopped)));
    }
}
