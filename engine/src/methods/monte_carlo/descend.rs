//! Work on the grains of all ranges of a system ([`Halves`]), on several threads.
//!
//! [`Halves`]: super::halves::Halves

use std::num::NonZeroUsize;

use super::system::Part;
use crate::gap::grain::ConvexShape;
use crate::threads::share;

/// Works on the grains of every range, on several threads: on those of both halves of a range before those of the range
/// itself. `work` gets the part of the system that it may read and write, and the number of the range; what it returns
/// is added up in the order of the ranges.
pub(super) fn descend<S: ConvexShape, R: Default + Send>(
    part: &mut Part<'_, S>,
    threads: NonZeroUsize,
    work: &(impl Fn(&mut Part<'_, S>, usize) -> R + Sync),
    add: fn(R, R) -> R,
) -> R {
    descend_from(part, 1, threads, work, add)
}

fn descend_from<S: ConvexShape, R: Default + Send>(
    part: &mut Part<'_, S>,
    range: usize,
    threads: NonZeroUsize,
    work: &(impl Fn(&mut Part<'_, S>, usize) -> R + Sync),
    add: fn(R, R) -> R,
) -> R {
    let leaves = part.halves.leaves();
    if range >= leaves {
        return work(part, range);
    }
    // The first leaf of the upper half.
    let mut upper = 2 * range + 1;
    while upper < leaves {
        upper *= 2;
    }
    let mut halves = part.split(upper - leaves).map(|half| (half, R::default()));
    let of_lower = NonZeroUsize::new(threads.get().div_ceil(2)).unwrap_or(NonZeroUsize::MIN);
    let of_upper = NonZeroUsize::new(threads.get() / 2).unwrap_or(NonZeroUsize::MIN);
    share(threads.min(NonZeroUsize::MIN.saturating_add(1)), &mut halves, |number, (half, done)| {
        let threads = if number == 0 { of_lower } else { of_upper };
        *done = descend_from(half, 2 * range + number, threads, work, add);
    });
    let [(lower, of_lower), (upper, of_upper)] = halves;
    let counts = [lower.skins_left, upper.skins_left];
    part.skins_left += counts.iter().sum::<u64>();
    let own = work(part, range);
    add(add(of_lower, of_upper), own)
}
