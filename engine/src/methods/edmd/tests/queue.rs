//! The queue against the plainest one: a binary heap whose entries are never removed, but dropped when
//! they come up and are no longer their grain's next event.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::properties::properties;
use proptest::prelude::*;

use crate::methods::edmd::queue::{Entry, Queue};
use crate::methods::edmd::records::Next;

/// A time with a total order, and the grain.
type Key = (u64, u32);

fn key(time: f64, grain: u32) -> Key {
    // Times are not negative, so their bits are in their order.
    (time.to_bits(), grain)
}

/// What happens to a queue.
#[derive(Clone, Debug)]
enum Step {
    /// A grain's next event is so much later than the last that came up.
    Push { grain: u32, after: f64 },
    /// A grain has no next event any more.
    Forget { grain: u32 },
    /// The earliest event comes up.
    Pop,
    /// The next so many come up, as in the middle of a cycle.
    PopMany(usize),
    /// A new cycle.
    Reset { grains: usize, events_per_time: f64 },
}

const GRAINS: u32 = 300;

/// Delays of all magnitudes, many of them alike, some of no length.
fn delay() -> impl Strategy<Value = f64> {
    let power = |from: f64, to: f64| (from..to).prop_map(|exponent| 10.0_f64.powf(exponent));
    prop_oneof![
        8 => power(-4.0, 1.0),
        2 => power(-15.0, 6.0),
        1 => power(6.0, 300.0),
        2 => Just(0.0),
        3 => (0..20_u32).prop_map(|n| f64::from(n) * 0.125),
    ]
}

fn rate() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => (-2.0..5.0_f64).prop_map(|exponent| 10.0_f64.powf(exponent)),
        1 => Just(0.0),
        1 => Just(1e-305),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NAN),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        30 => (0..GRAINS, delay()).prop_map(|(grain, after)| Step::Push { grain, after }),
        4 => (0..GRAINS).prop_map(|grain| Step::Forget { grain }),
        20 => Just(Step::Pop),
        1 => (2..80_usize).prop_map(Step::PopMany),
        1 => (1..2000_usize, rate()).prop_map(|(grains, events_per_time)| Step::Reset { grains, events_per_time }),
    ]
}

/// A queue and its model, fed alike.
struct Both {
    queue: Queue,
    heap: BinaryHeap<Reverse<Key>>,
    /// Each grain's next event; without one, at an infinite time.
    next: Vec<Next>,
    now: f64,
}

impl Both {
    fn new() -> Self {
        let mut both = Self { queue: Queue::default(), heap: BinaryHeap::new(), next: Vec::new(), now: 0.0 };
        both.reset(100, 10.0);
        both
    }

    fn reset(&mut self, grains: usize, events_per_time: f64) {
        self.queue.reset(grains, events_per_time).unwrap();
        self.heap.clear();
        self.next = vec![Next { time: f64::INFINITY, with: 0 }; GRAINS as usize];
        self.now = 0.0;
    }

    fn push(&mut self, grain: u32, after: f64) {
        let time = self.now + after;
        self.next[grain as usize].time = time;
        self.queue.push(time, grain);
        self.heap.push(Reverse(key(time, grain)));
    }

    /// What both say comes up next.
    fn pop(&mut self) -> (Option<Entry>, Option<Key>) {
        let next = &self.next;
        let entry = self.queue.pop(next);
        let expected = std::iter::from_fn(|| self.heap.pop())
            .map(|Reverse(key)| key)
            .find(|&(time, grain)| next[grain as usize].time.to_bits() == time);
        if let Some(entry) = entry {
            self.now = entry.time;
            self.next[entry.grain as usize].time = f64::INFINITY;
        }
        (entry, expected)
    }

    fn agree(&mut self) -> Result<bool, TestCaseError> {
        let (entry, expected) = self.pop();
        prop_assert_eq!(entry.map(|entry| key(entry.time, entry.grain)), expected, "{:?}", entry);
        Ok(entry.is_some())
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn events_come_up_as_from_a_heap(steps in prop::collection::vec(step(), 1..1500)) {
        let mut both = Both::new();
        for step in steps {
            match step {
                Step::Push { grain, after } => both.push(grain, after),
                Step::Forget { grain } => both.next[grain as usize].time = f64::INFINITY,
                Step::Pop => {
                    both.agree()?;
                }
                Step::PopMany(count) => {
                    for _ in 0..count {
                        both.agree()?;
                    }
                }
                Step::Reset { grains, events_per_time } => both.reset(grains, events_per_time),
            }
        }
        while both.agree()? {}
        prop_assert!(both.next.iter().all(|next| next.time == f64::INFINITY), "nothing is left behind");
    }

    /// As the dynamics use it: every event that comes up schedules another.
    #[test]
    fn events_that_bring_events_come_up_as_from_a_heap(
        rate in rate(), delays in prop::collection::vec(delay(), 50), growing in 0.9..1.1_f64,
    ) {
        let mut both = Both::new();
        both.reset(GRAINS as usize, rate);
        for grain in 0..GRAINS {
            both.push(grain, delays[grain as usize % delays.len()]);
        }
        let mut rate = 1.0;
        for turn in 0..4000_usize {
            let before = both.now;
            let (entry, expected) = both.pop();
            prop_assert_eq!(entry.map(|entry| key(entry.time, entry.grain)), expected);
            let Some(entry) = entry else { break };
            prop_assert!(entry.time >= before);
            // Rates may rise or fall by orders of magnitude in a cycle.
            rate *= if turn % 64 == 0 { growing } else { 1.0 };
            both.push(entry.grain, rate * delays[turn % delays.len()]);
            if turn % 5 == 0 {
                both.push((turn as u32 * 7) % GRAINS, rate * delays[(turn / 5) % delays.len()]);
            }
        }
    }
}
