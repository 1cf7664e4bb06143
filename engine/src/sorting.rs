//! Sorting by numbers, for all places where the time that it takes does not count.
//!
//! The sort of the standard library is some thousand instructions long, and is compiled again for each comparison that
//! it is called with: 60 copies were 0.39 of 4.4 MB of machine code of the engine. Two serve all that is sorted here.
//! Numbers are in the order of [`f64::total_cmp`].

/// Sorts numbers from the least to the largest.
pub(crate) fn ascending(numbers: &mut [f64]) {
    numbers.sort_unstable_by(f64::total_cmp);
}

/// Sorts numbers from the largest to the least.
pub(crate) fn descending(numbers: &mut [f64]) {
    ascending(numbers);
    numbers.reverse();
}

/// Sorts items by a number of each, from the least to the largest; equal ones stay in their order. The number is asked
/// for once. Takes 16 bytes of memory an item.
pub(crate) fn by_number<T>(items: &mut [T], number: impl FnMut(&T) -> f64) {
    let mut order: Vec<(i64, u32)> = items.iter().map(number).map(rank).zip(0..).collect();
    order.sort_unstable();
    for place in 0..items.len() {
        // What belongs here may have been exchanged with what was at an earlier place, and that again.
        let mut from = order[place].1 as usize;
        while from < place {
            from = order[from].1 as usize;
        }
        items.swap(place, from);
    }
}

/// A whole number of the same order: of negative numbers, all bits but the sign are inverted.
fn rank(number: f64) -> i64 {
    let bits = number.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;

    /// Numbers that are often equal, and special ones.
    fn numbers() -> impl Strategy<Value = Vec<f64>> {
        let special = prop::sample::select(vec![0.0, -0.0, f64::NAN, -f64::NAN, f64::INFINITY, -1.0e-310]);
        prop::collection::vec(prop_oneof![(-5..5_i32).prop_map(f64::from), special, any::<f64>()], 0..60)
    }

    fn bits<'a>(numbers: impl Iterator<Item = &'a f64>) -> impl Iterator<Item = u64> {
        numbers.map(|x| x.to_bits())
    }

    fn places(rows: &[(f64, usize)]) -> Vec<usize> {
        rows.iter().map(|row| row.1).collect()
    }

    properties! {
        #[test]
        fn the_order_is_that_of_the_standard_library(numbers in numbers()) {
            let rows: Vec<(f64, usize)> = numbers.iter().copied().zip(0..).collect();
            let (mut items, mut expected) = (rows.clone(), rows.clone());
            expected.sort_by(|a, b| a.0.total_cmp(&b.0));
            by_number(&mut items, |item| item.0);
            prop_assert_eq!(places(&items), places(&expected));
            let mut sorted = numbers.clone();
            ascending(&mut sorted);
            prop_assert!(bits(sorted.iter()).eq(bits(expected.iter().map(|item| &item.0))));
            let (mut items, mut expected) = (rows.clone(), rows);
            expected.sort_by(|a, b| b.0.total_cmp(&a.0));
            by_number(&mut items, |item| -item.0);
            prop_assert_eq!(places(&items), places(&expected));
            descending(&mut sorted);
            prop_assert!(bits(sorted.iter()).eq(bits(expected.iter().map(|item| &item.0))));
        }
    }
}
