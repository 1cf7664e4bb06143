//! The numbers that voxels have for what their centres lie in, by label and reader.

use super::{Label, Reader, VoxelOptions};
use crate::export::groups::AggregateGroups;

/// The numbers of matrix, bodies and outside.
#[derive(Clone, Debug)]
pub(super) struct Numbers {
    pub(super) label: Label,
    /// Bytes of a number, which is little-endian.
    pub(super) bytes: usize,
    pub(super) matrix: u32,
    /// What lies outside of a cylinder.
    pub(super) outside: u32,
    /// The number of each aggregate, where they are told apart. That of one without grains may be of another.
    pub(super) of_aggregates: Vec<u32>,
}

impl Numbers {
    /// Those of labels that no reader asks for.
    pub(super) fn plain(label: Label, groups: &AggregateGroups<'_>) -> Self {
        let count = if label == Label::Aggregate { groups.all().count() } else { 0 };
        Self {
            label,
            bytes: label.bytes() as usize,
            matrix: 0,
            outside: label.outside(),
            of_aggregates: (1..).take(count).collect(),
        }
    }

    /// Those of a packing of `grains` grains.
    pub(super) fn new(options: &VoxelOptions, groups: &AggregateGroups<'_>, grains: usize) -> Self {
        let plain = Self::plain(options.label, groups);
        let Some(reader) = options.reader else { return plain };
        let matrix = match reader {
            Reader::Damask | Reader::Fans => 0,
            Reader::Amitex | Reader::Automesh => 1,
        };
        let mut bodies = match options.label {
            Label::Phase => 1,
            // A packing has fewer grains than u32 can count.
            Label::Grain => grains as u32,
            Label::Aggregate => plain.of_aggregates.len().max(1) as u32,
        };
        let mut of_aggregates: Vec<u32> = plain.of_aggregates.iter().map(|number| matrix + number).collect();
        if reader == Reader::Amitex && !of_aggregates.is_empty() {
            // Without any gap: an aggregate of which no grain was placed has none.
            bodies = 0;
            for (number, _) in groups.with_grains() {
                bodies += 1;
                of_aggregates[number] = matrix + bodies;
            }
        }
        let outside = if reader == Reader::Automesh { 0 } else { matrix + bodies + 1 };
        let bytes = if reader == Reader::Damask { size_of::<i64>() } else { plain.bytes };
        Self { label: options.label, bytes, matrix, outside, of_aggregates }
    }

    /// The number of the voxels of a grain.
    pub(super) fn of_grain(&self, grain: usize, groups: &AggregateGroups<'_>) -> u32 {
        match self.label {
            Label::Phase => self.matrix + 1,
            Label::Grain => self.matrix + 1 + grain as u32,
            Label::Aggregate => {
                self.of_aggregates.get(groups.of_grain(grain)).copied().unwrap_or(self.matrix + 1)
            }
        }
    }

    /// NumPy's name of the type.
    pub(super) fn dtype(&self) -> &'static str {
        match self.bytes {
            1 => "|u1",
            8 => "<i8",
            _ => "<u4",
        }
    }
}
