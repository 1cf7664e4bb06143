//! The order in which points are inserted: in random rounds, each eight times as large as those before, and along
//! a Hilbert curve within each (Amenta, Choi and Rote, 2003: "Incremental constructions con BRIO").
//!
//! It decides how long insertion takes, never what comes out.

use crate::arrays::Each as _;
use crate::memory::{OutOfMemory, collected};

/// Bits of a coordinate on the curve.
const BITS: u32 = 19;
/// Every round but the first holds 2^3 - 1 times the points of all before.
const ROUND_SHIFT: u32 = 3;
/// Rounds are told apart by the bits of the key that the curve leaves.
const MOST_ROUNDS: u32 = 1 << (64 - 3 * BITS - 1);

/// The numbers of all points, in the order to insert them.
pub(super) fn insertion_order(points: &[[f64; 3]]) -> Result<Vec<u32>, OutOfMemory> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    // One scale for all axes: cells of the curve are cubes, whatever the box.
    let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let cells = f64::from((1_u32 << BITS) - 1);
    let scale = if extent > 0.0 { cells / extent } else { 0.0 };
    let rounds = rounds(points.len());
    let key = |(number, point): (usize, &[f64; 3])| {
        let cell = [0, 1, 2].each(|axis| ((point[axis] - low[axis]) * scale) as u32);
        let round = u64::from(round(number as u64, rounds));
        (round << (3 * BITS) | hilbert(cell), number as u32)
    };
    let mut keyed = collected(points.iter().enumerate().map(key))?;
    keyed.sort_unstable();
    collected(keyed.iter().map(|&(_, number)| number))
}

/// So many that the first holds some dozens of points.
fn rounds(points: usize) -> u32 {
    let mut rounds = 1;
    while rounds < MOST_ROUNDS && points >> (ROUND_SHIFT * rounds) > 64 {
        rounds += 1;
    }
    rounds
}

/// The round of a point: the last for all but one in eight, and so on. Drawn by its number, so that it is
/// the same whenever asked.
fn round(number: u64, rounds: u32) -> u32 {
    let earlier = mixed(number).trailing_zeros() / ROUND_SHIFT;
    rounds - 1 - earlier.min(rounds - 1)
}

/// `SplitMix64`'s output function.
fn mixed(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Place of a cell on the Hilbert curve (Skilling, 2004: "Programming the Hilbert curve").
fn hilbert(mut cell: [u32; 3]) -> u64 {
    let mut q = 1 << (BITS - 1);
    while q > 1 {
        let p = q - 1;
        for axis in 0..3 {
            if cell[axis] & q != 0 {
                cell[0] ^= p;
            } else {
                let t = (cell[0] ^ cell[axis]) & p;
                cell[0] ^= t;
                cell[axis] ^= t;
            }
        }
        q >>= 1;
    }
    cell[1] ^= cell[0];
    cell[2] ^= cell[1];
    let mut t = 0;
    let mut q = 1 << (BITS - 1);
    while q > 1 {
        if cell[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    let cell = cell.each(|c| c ^ t);
    (0..BITS).rev().fold(0, |key, bit| cell.iter().fold(key, |key, &c| key << 1 | u64::from(c >> bit & 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_on_the_curve_are_neighbours_in_space() {
        const SIDE: u32 = 8;
        let shift = BITS - 3;
        let mut cells: Vec<(u64, [u32; 3])> = (0..SIDE.pow(3))
            .map(|i| [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE])
            .map(|cell| (hilbert(cell.map(|c| c << shift)) >> (3 * shift), cell))
            .collect();
        cells.sort_unstable();
        for (place, (key, _)) in cells.iter().enumerate() {
            assert_eq!(*key, place as u64);
        }
        for pair in cells.windows(2) {
            let apart: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(apart, 1, "{pair:?}");
        }
    }

    #[test]
    fn every_point_comes_once_and_rounds_grow() {
        let points: Vec<[f64; 3]> =
            (0..10_000).map(|i| [f64::from(i % 17), f64::from(i % 101), f64::from(i)]).collect();
        let mut order = insertion_order(&points).expect("memory");
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &number)| i as u32 == number));
        let rounds = rounds(points.len());
        let mut sizes = vec![0_usize; rounds as usize];
        for number in 0..points.len() {
            sizes[round(number as u64, rounds) as usize] += 1;
        }
        assert!(sizes.windows(2).all(|pair| pair[1] > 4 * pair[0]), "{sizes:?}");
    }
}
