//! The rows of a grid along x, one layer behind the other, and the pieces of them that threads make.

use std::ops::Range;

/// Pieces that a grid has at least, where it has as many rows: several for each thread.
const LEAST_PIECES: usize = 64;

/// Rows in pieces, each of which is some layers or a part of one.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowPieces {
    /// Rows of all layers.
    rows: usize,
    rows_per_layer: usize,
    rows_per_piece: usize,
}

impl RowPieces {
    /// Pieces of so many items at most, or of one row.
    pub(super) fn new([nx, ny, nz]: [usize; 3], most_items: usize) -> Self {
        let rows = ny * nz;
        let rows_per_piece = (most_items / nx).min(rows / LEAST_PIECES).max(1);
        Self { rows, rows_per_layer: ny, rows_per_piece }
    }

    /// Number of pieces.
    pub(super) fn number(&self) -> usize {
        self.rows.div_ceil(self.rows_per_piece)
    }

    /// Rows of the largest piece.
    pub(super) fn most_rows(&self) -> usize {
        self.rows_per_piece.min(self.rows)
    }

    /// The rows of a piece.
    pub(super) fn rows(&self, piece: usize) -> Range<usize> {
        let start = piece * self.rows_per_piece;
        start..(start + self.rows_per_piece).min(self.rows)
    }

    /// Those of each layer that a piece has a part in: the number of the layer, and the rows counted in it.
    pub(super) fn layers(&self, piece: usize) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
        let (rows, ny) = (self.rows(piece), self.rows_per_layer);
        (rows.start / ny..rows.end.div_ceil(ny)).map(move |k| {
            let first = k * ny;
            (k, rows.start.max(first) - first..rows.end.min(first + ny) - first)
        })
    }

    /// Layers of which all rows are in this piece or before it.
    pub(super) fn layers_done(&self, piece: usize) -> usize {
        self.rows(piece).end / self.rows_per_layer
    }
}

#[cfg(test)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;

    properties! {
        #[test]
        fn pieces_are_all_rows_once(shape in prop::array::uniform3(1_usize..40), most_items in 1_usize..3000) {
            let pieces = RowPieces::new(shape, most_items);
            let mut rows = Vec::new();
            for piece in 0..pieces.number() {
                let before = rows.len();
                for (k, of_layer) in pieces.layers(piece) {
                    prop_assert!(!of_layer.is_empty() && of_layer.end <= shape[1]);
                    rows.extend(of_layer.map(|j| (k, j)));
                }
                prop_assert_eq!(pieces.rows(piece), before..rows.len());
                prop_assert!(rows.len() - before <= pieces.most_rows());
                prop_assert_eq!(pieces.layers_done(piece), rows.len() / shape[1]);
            }
            prop_assert!(pieces.most_rows() == 1 || pieces.most_rows() * shape[0] <= most_items);
            prop_assert!(pieces.number() >= LEAST_PIECES.min(shape[1] * shape[2]));
            let all = (0..shape[2]).flat_map(|k| (0..shape[1]).map(move |j| (k, j)));
            prop_assert!(rows.into_iter().eq(all));
        }
    }
}
