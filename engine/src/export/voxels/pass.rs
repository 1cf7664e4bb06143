//! Passes over a grid: labels and shares of all voxels, and text, made in pieces on several threads.

use std::cell::Cell;
use std::io::Write;
use std::num::NonZeroUsize;

use super::layers::{Bodies, Part, Sweep};
use super::numbers::Numbers;
use super::rows::RowPieces;
use super::{AggregateVoxels, Label};
use crate::arrays;
use crate::control::Control;
use crate::export::digits::SPARE_BYTES;
use crate::export::groups::AggregateGroups;
use crate::export::pieces::{in_order, slots};
use crate::export::steps::Steps;
use crate::export::{ExportError, go_on};
use crate::memory::{make_room, refill};

/// Voxels of a piece, where a row has not more: what is made of them stays in the cache of a core.
const VOXELS_PER_PIECE: usize = 1 << 17;

/// What all passes over a grid use.
pub(super) struct Work<'a> {
    pub(super) bodies: Bodies<'a>,
    pub(super) groups: &'a AggregateGroups<'a>,
    /// Threads that make the pieces, the caller's among them.
    pub(super) threads: NonZeroUsize,
    pub(super) control: &'a dyn Control,
    pub(super) layers_done: LayerSteps<'a>,
}

/// What a pass over the grid counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Found {
    pub(super) inside: u64,
    pub(super) aggregate: u64,
    pub(super) grains_without_voxel: u64,
    /// By the shares, where they were written.
    pub(super) sampled_mm3: f64,
    /// Of each aggregate, where they were told apart.
    pub(super) of_aggregates: Vec<u64>,
}

impl Found {
    /// The voxels of each of several aggregates, where they were told apart.
    pub(super) fn by_aggregate(
        &self,
        groups: &AggregateGroups<'_>,
        numbers: &Numbers,
    ) -> Vec<AggregateVoxels> {
        let all = numbers.of_aggregates.iter().zip(groups.all()).zip(&self.of_aggregates);
        let of = |((label, (name, grains)), voxels): ((&u32, (&str, u64)), &u64)| AggregateVoxels {
            label: *label,
            name: name.to_owned(),
            grains,
            voxels: *voxels,
        };
        all.map(of).collect()
    }
}

/// Counts the layers that passes over the grid have done.
pub(super) struct LayerSteps<'a> {
    steps: Steps<'a>,
    /// Layers of the passes before.
    before: Cell<usize>,
    done: Cell<usize>,
}

impl<'a> LayerSteps<'a> {
    pub(super) fn new(control: &'a dyn Control, layers: usize) -> Self {
        let steps = Steps { control, total: layers, unit: "layers", message: "" };
        Self { steps, before: Cell::new(0), done: Cell::new(0) }
    }

    /// Reports a piece of a pass where it ends a layer, and asks whether to go on.
    fn taken(&self, pieces: &RowPieces, piece: usize) -> Result<(), ExportError> {
        let done = self.before.get() + pieces.layers_done(piece);
        if piece + 1 == pieces.number() {
            self.before.set(done);
        }
        if self.done.replace(done) != done {
            self.steps.report(done);
        }
        go_on(self.steps.control)
    }
}

/// Labels of a piece, and what is counted of them.
struct Labelled<const BYTES: usize> {
    sweep: Sweep,
    labels: Vec<[u8; BYTES]>,
    aggregate: u64,
    /// Voxels of each label of a byte, where they are told apart.
    of_labels: Vec<u64>,
}

/// Shares of a piece.
#[derive(Default)]
struct Shared {
    sweep: Sweep,
    shares: Vec<f32>,
    bytes: Vec<[u8; 4]>,
}

impl Work<'_> {
    /// Writes the labels, x fastest, little-endian, and nothing else.
    pub(super) fn labels(&self, label: Label, out: &mut dyn Write) -> Result<Found, ExportError> {
        self.labels_by(&Numbers::plain(label, self.groups), out)
    }

    /// Writes the labels as the numbers that stand for them.
    pub(super) fn labels_by(&self, numbers: &Numbers, out: &mut dyn Write) -> Result<Found, ExportError> {
        match numbers.bytes {
            1 => self.labels_as::<1>(numbers, out),
            8 => self.labels_as::<8>(numbers, out),
            _ => self.labels_as::<4>(numbers, out),
        }
    }

    /// Writes numbers of `BYTES` bytes, and counts those of the aggregates.
    fn labels_as<const BYTES: usize>(
        &self,
        numbers: &Numbers,
        out: &mut dyn Write,
    ) -> Result<Found, ExportError> {
        let little_endian = |number: u32| -> [u8; BYTES] {
            let bytes = u64::from(number).to_le_bytes();
            arrays::from_fn(|i| bytes[i])
        };
        let encode = |grain: usize| little_endian(numbers.of_grain(grain, self.groups));
        let (matrix, outside) = (little_endian(numbers.matrix), little_endian(numbers.outside));
        // A mix has at most 16 aggregates, so that the lowest byte tells them apart. Numbers without grains are not
        // counted: they may be those of another.
        let told_apart = numbers.of_aggregates.len();
        let grid = self.bodies.grid;
        let [nx, _, nz] = grid.shape;
        let pieces = RowPieces::new(grid.shape, VOXELS_PER_PIECE);
        let mut slots = slots(self.threads, pieces.number(), || Labelled {
            sweep: Sweep::default(),
            labels: Vec::new(),
            aggregate: 0,
            of_labels: vec![0; told_apart],
        });
        let bodies = &self.bodies;
        let make = |piece: usize, made: &mut Labelled<BYTES>| {
            refill(&mut made.labels, pieces.rows(piece).len() * nx, matrix)?;
            let mut rest = made.labels.as_mut_slice();
            for (k, rows) in pieces.layers(piece) {
                let labels;
                (labels, rest) = rest.split_at_mut(rows.len() * nx);
                let part = Part { k, rows };
                bodies.fill(&mut made.sweep, &part, labels, &encode)?;
                grid.fill_outside(part.rows, labels, outside);
            }
            made.aggregate += count_of(&made.labels, |label| *label != matrix && *label != outside);
            let all = made.of_labels.iter_mut().zip(&numbers.of_aggregates).zip(self.groups.all());
            for ((of_label, value), _) in all.filter(|(_, (_, grains))| *grains > 0) {
                *of_label += count_of(&made.labels, |label| label[0] == *value as u8);
            }
            Ok(())
        };
        in_order(&mut slots, pieces.number(), make, |piece, made| {
            out.write_all(made.labels.as_flattened())?;
            self.layers_done.taken(&pieces, piece)
        })?;
        let of_label = |label: usize| slots.iter().map(|made| made.of_labels[label]).sum();
        Ok(Found {
            inside: grid.inside_per_layer() * nz as u64,
            aggregate: slots.iter().map(|made| made.aggregate).sum(),
            grains_without_voxel: bodies.grains_without_voxel(&slots.iter().map(|made| &made.sweep)),
            of_aggregates: (0..told_apart).map(of_label).collect(),
            ..Found::default()
        })
    }

    /// Writes the voxels' shares of aggregate as float32, and returns their volume.
    pub(super) fn shares(&self, samples: u32, out: &mut dyn Write) -> Result<f64, ExportError> {
        let grid = self.bodies.grid;
        let [nx, ny, _] = grid.shape;
        let (bodies, control) = (&self.bodies, self.control);
        let pieces = RowPieces::new(grid.shape, VOXELS_PER_PIECE);
        let make = |piece: usize, made: &mut Shared| {
            let voxels = pieces.rows(piece).len() * nx;
            refill(&mut made.shares, voxels, 0.0)?;
            refill(&mut made.bytes, voxels, [0; 4])?;
            let mut rest = made.shares.as_mut_slice();
            for (k, rows) in pieces.layers(piece) {
                let shares;
                (shares, rest) = rest.split_at_mut(rows.len() * nx);
                bodies.add_shares(&mut made.sweep, &Part { k, rows }, samples, shares)?;
                go_on(control)?;
            }
            for (bytes, share) in made.bytes.iter_mut().zip(&mut made.shares) {
                // Grains that touch may overlap by a digit of rounding.
                *share = share.min(1.0);
                *bytes = share.to_le_bytes();
            }
            Ok(())
        };
        // Layers are added up one by one, each voxel by voxel.
        let (mut sum, mut of_layer) = (0.0, 0.0);
        let mut slots = slots(self.threads, pieces.number(), Shared::default);
        in_order(&mut slots, pieces.number(), make, |piece, made| {
            let mut rest = made.shares.as_slice();
            for (_, rows) in pieces.layers(piece) {
                let shares;
                (shares, rest) = rest.split_at(rows.len() * nx);
                of_layer = shares.iter().fold(of_layer, |sum, share| sum + f64::from(*share));
                if rows.end == ny {
                    sum += std::mem::take(&mut of_layer);
                }
            }
            out.write_all(made.bytes.as_flattened())?;
            self.layers_done.taken(&pieces, piece)
        })?;
        Ok(sum * grid.voxel_mm3())
    }
}

/// Text that is made in pieces.
pub(super) struct Text<'a> {
    work: &'a Work<'a>,
    /// Where the text goes.
    pub(super) out: &'a mut dyn Write,
    /// Pieces under way.
    slots: Vec<Vec<u8>>,
}

impl<'a> Text<'a> {
    /// Text in that number of pieces at a time.
    pub(super) fn new(work: &'a Work<'a>, pieces: usize, out: &'a mut dyn Write) -> Self {
        Self { work, out, slots: slots(work.threads, pieces, Vec::new) }
    }

    /// Writes text that `append` makes of each piece, of so many bytes at most, behind a header if there is any.
    pub(super) fn write(
        &mut self,
        pieces: &RowPieces,
        most_bytes: usize,
        header: &str,
        append: impl Fn(usize, &mut Vec<u8>) + Sync,
    ) -> Result<(), ExportError> {
        let make = |piece: usize, slot: &mut Vec<u8>| {
            // On the stack: the lengths of the texts lie side by side, and several threads would write them in turn.
            let mut text = std::mem::take(slot);
            text.clear();
            make_room(&mut text, most_bytes + SPARE_BYTES)?;
            append(piece, &mut text);
            *slot = text;
            Ok(())
        };
        let mut header = Some(header);
        in_order(&mut self.slots, pieces.number(), make, |piece, text| {
            // A set without elements is no set, and a keyword without lines a fault.
            if !text.is_empty() {
                self.out.write_all(header.take().unwrap_or_default().as_bytes())?;
                self.out.write_all(text)?;
            }
            self.work.layers_done.taken(pieces, piece)
        })
    }
}

/// How many values are counted.
pub(super) fn count_of<T>(values: &[T], is_counted: impl Fn(&T) -> bool) -> u64 {
    // Sums of bytes are fast, and hold so many.
    let of_block = |block: &[T]| block.iter().map(|value| u8::from(is_counted(value))).sum::<u8>();
    values.chunks(usize::from(u8::MAX)).map(|block| u64::from(of_block(block))).sum()
}
