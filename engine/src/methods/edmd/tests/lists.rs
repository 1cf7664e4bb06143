//! The lists of all grains, which threads share.

use std::num::NonZeroUsize;

use crate::methods::edmd::container::Container;
use crate::methods::edmd::growth::Growth;
use crate::methods::edmd::system::System;
use crate::rng::{Stream, stream, uniform};

/// Grains along an edge: more in all than threads share from.
const PER_EDGE: usize = 28;

#[test]
fn lists_do_not_depend_on_the_threads() {
    let size_mm = [PER_EDGE as f64; 3];
    for container in [Container::Box { size_mm }, Container::Periodic { size_mm }] {
        let mut rng = stream(1, Stream::Rsa);
        let centers: Vec<_> = (0..PER_EDGE.pow(3))
            .map(|i| {
                [i % PER_EDGE, i / PER_EDGE % PER_EDGE, i / PER_EDGE.pow(2)]
                    .map(|k| k as f64 + uniform(&mut rng))
            })
            .collect();
        // One in a thousand is coarse and has many neighbours.
        let radii: Vec<_> = (0..centers.len()).map(|i| if i % 1000 == 7 { 2.5 } else { 0.3 }).collect();
        let lists = |threads: usize| {
            let mut system = System::new(container, &centers, &radii, &vec![1.0; radii.len()]).unwrap();
            system.threads = NonZeroUsize::new(threads).unwrap();
            system.set_in_motion(1.0, &mut stream(2, Stream::Rsa));
            system.rebuild_all_lists(Growth { alpha: 0.1, ..Growth::default() }, 0.1).unwrap();
            (system.cold, system.slab, system.shortlist_of)
        };
        let one = lists(1);
        assert!(one.0.iter().filter(|cold| cold.is_coarse).count() > 20, "shortlists are laid out");
        for threads in [2, 3, 8] {
            assert!(lists(threads) == one, "{threads} threads, {container:?}");
        }
    }
}
