//! A range of an array, read and written by the numbers of the whole array.

use std::ops::{Index, IndexMut, Range};

/// Elements `first..` of an array, as many as there are. Windows of one array that do not overlap can be written by
/// several threads.
#[derive(Debug)]
pub(super) struct Window<'a, T> {
    first: usize,
    items: &'a mut [T],
}

impl<'a, T> Window<'a, T> {
    /// All elements of an array.
    pub(super) fn whole(items: &'a mut [T]) -> Self {
        Self { first: 0, items }
    }

    /// The same elements in two windows, cut before the element of this number.
    pub(super) fn split(&mut self, at: usize) -> [Window<'_, T>; 2] {
        Window { first: self.first, items: self.items }.cut(at)
    }

    /// As [`Self::split`], for good.
    pub(super) fn cut(self, at: usize) -> [Self; 2] {
        let count = at.saturating_sub(self.first).min(self.items.len());
        let (low, high) = self.items.split_at_mut(count);
        [Window { first: self.first, items: low }, Window { first: self.first + count, items: high }]
    }

    pub(super) fn range(&self) -> Range<usize> {
        self.first..self.first + self.items.len()
    }

    /// Asks the processor for an element that is read soon.
    #[inline(always)]
    pub(super) fn prefetch(&self, number: usize) {
        crate::cpu::prefetch(self.items, number - self.first);
    }
}

impl<T> Index<usize> for Window<'_, T> {
    type Output = T;

    #[inline(always)]
    fn index(&self, number: usize) -> &T {
        &self.items[number.wrapping_sub(self.first)]
    }
}

impl<T> IndexMut<usize> for Window<'_, T> {
    #[inline(always)]
    fn index_mut(&mut self, number: usize) -> &mut T {
        &mut self.items[number.wrapping_sub(self.first)]
    }
}

impl<T> Index<Range<usize>> for Window<'_, T> {
    type Output = [T];

    #[inline(always)]
    fn index(&self, numbers: Range<usize>) -> &[T] {
        &self.items[numbers.start.wrapping_sub(self.first)..numbers.end.wrapping_sub(self.first)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_keep_their_numbers_in_all_windows() {
        let mut numbers = [0, 1, 2, 3, 4, 5, 6];
        let mut whole = Window::whole(&mut numbers);
        let [mut low, mut high] = whole.split(3);
        assert_eq!((low.range(), high.range()), (0..3, 3..7));
        low[2] = 20;
        let [_, mut highest] = high.split(5);
        highest[6] = 60;
        assert_eq!(highest[5..7], [5, 60]);
        // Arrays that a part has no use of are empty.
        let mut none = Window::whole(&mut [0_u8; 0]);
        let [low, high] = none.split(3);
        assert_eq!((low.range(), high.range()), (0..0, 0..0));
        assert_eq!(numbers, [0, 1, 20, 3, 4, 5, 60]);
    }
}
