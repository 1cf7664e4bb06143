//! The messages on their way, and which of those that are due go next.
//!
//! Owners take turns by what each has on its way, and the receivers of an owner by when each was tried last: a receiver
//! that was never tried comes first. A receiver is an owner together with a host, and gets one message at a time. So
//! neither an owner with many messages nor hosts that do not answer hold up others for long. An attempt may take
//! [`ATTEMPT`]; where all places are taken and other messages are due, it is cut after [`LEAST_ATTEMPT`].

use std::collections::{BTreeMap, HashMap, HashSet};
use std::time::Duration;

use tokio::task::{Id, JoinSet};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::jobs::store::{Receiver, WaitingDelivery};
use crate::tasks;

/// Messages on their way at once.
pub(crate) const AT_ONCE: usize = 256;
/// Of these, messages of one owner.
const OF_ONE_OWNER: usize = 192;
/// Of these, messages that were sent before: receivers that are down leave room for others.
const REPEATS: usize = 96;
/// Time for an attempt: resolution of the name, connection and answer.
pub(crate) const ATTEMPT: Duration = Duration::from_secs(10);
/// Time that an attempt has in any case.
pub(crate) const LEAST_ATTEMPT: Duration = Duration::from_millis(1500);
/// Receivers whose last attempt is known.
const KNOWN_RECEIVERS: usize = 20_000;

/// The messages on their way.
#[derive(Default)]
pub(super) struct OnTheWay {
    pub(super) tasks: JoinSet<()>,
    attempts: HashMap<Id, Attempt>,
    /// The number of the last attempt of each receiver.
    last_attempts: HashMap<Receiver, u64>,
    /// How many attempts there were.
    count: u64,
}

#[derive(Debug)]
struct Attempt {
    receiver: Receiver,
    sent_before: bool,
    began: Instant,
    cut: CancellationToken,
}

impl OnTheWay {
    /// Begins an attempt. The task ends soon after the token that it gets is cancelled.
    pub(super) fn begin(
        &mut self,
        delivery: &WaitingDelivery,
        attempt: impl FnOnce(CancellationToken) -> tasks::Boxed<()>,
    ) {
        self.count += 1;
        if self.last_attempts.len() >= KNOWN_RECEIVERS {
            self.last_attempts.clear();
        }
        self.last_attempts.insert(delivery.receiver.clone(), self.count);
        let cut = CancellationToken::new();
        let id = self.tasks.spawn(attempt(cut.clone())).id();
        let (receiver, sent_before) = (delivery.receiver.clone(), delivery.sent_before);
        self.attempts.insert(id, Attempt { receiver, sent_before, began: Instant::now(), cut });
    }

    /// Frees the place of an attempt.
    pub(super) fn ended(&mut self, id: Id) {
        self.attempts.remove(&id);
    }

    /// Those of the messages that go now, in their order. Where others are due that find no place, attempts that have
    /// had [`LEAST_ATTEMPT`] are cut, and `room_in` is the time until the next may be.
    pub(super) fn choose(&self, waiting: Vec<WaitingDelivery>, now: Instant) -> Choice {
        let mut busy: HashSet<Receiver> = self.attempts.values().map(|at| at.receiver.clone()).collect();
        let mut of_owner: HashMap<String, usize> = HashMap::new();
        for attempt in self.attempts.values() {
            *of_owner.entry(attempt.receiver.owner.clone()).or_default() += 1;
        }
        let mut repeats = self.attempts.values().filter(|attempt| attempt.sent_before).count();
        let mut places = AT_ONCE.saturating_sub(self.attempts.len());
        let mut choice = Choice::default();
        let mut queues: BTreeMap<String, Vec<WaitingDelivery>> = BTreeMap::new();
        for delivery in waiting {
            if !delivery.due_in.is_zero() {
                choice.next_due_in =
                    Some(choice.next_due_in.map_or(delivery.due_in, |at| at.min(delivery.due_in)));
            } else if !busy.contains(&delivery.receiver) {
                queues.entry(delivery.receiver.owner.clone()).or_default().push(delivery);
            }
        }
        for queue in queues.values_mut() {
            // Taken from the end.
            queue.sort_by_key(|delivery| {
                let last = self.last_attempts.get(&delivery.receiver).copied().unwrap_or(0);
                std::cmp::Reverse((last, delivery.next_at, delivery.seq))
            });
        }
        let mut short = None;
        loop {
            let next = queues
                .iter_mut()
                .filter_map(|(owner, queue)| {
                    while let Some(first) = queue.last()
                        && (busy.contains(&first.receiver) || (first.sent_before && repeats >= REPEATS))
                    {
                        if !busy.contains(&first.receiver) {
                            short = Some(Short::OfRepeats);
                        }
                        queue.pop();
                    }
                    let on_the_way = of_owner.get(owner).copied().unwrap_or(0);
                    Some(((on_the_way, queue.last()?.next_at), queue))
                })
                .min_by_key(|(order, _)| *order);
            let Some(((on_the_way, _), queue)) = next else { break };
            if places == 0 || on_the_way >= OF_ONE_OWNER {
                short = Some(Short::OfPlaces);
                break;
            }
            let Some(delivery) = queue.pop() else { break };
            places -= 1;
            repeats += usize::from(delivery.sent_before);
            *of_owner.entry(delivery.receiver.owner.clone()).or_default() += 1;
            busy.insert(delivery.receiver.clone());
            choice.go.push(delivery);
        }
        if let Some(short) = short {
            let left: usize = queues.values().map(Vec::len).sum();
            choice.room_in = self.make_room(short, left.max(1), now);
        }
        choice
    }

    /// Cuts at most so many attempts of the owner with the most, the oldest first; the time until another may be cut.
    fn make_room(&self, short: Short, most: usize, now: Instant) -> Option<Duration> {
        let mut of_owner: BTreeMap<&str, Vec<&Attempt>> = BTreeMap::new();
        let may_be_cut = |attempt: &&Attempt| attempt.sent_before || short == Short::OfPlaces;
        for attempt in self.attempts.values().filter(may_be_cut) {
            of_owner.entry(&attempt.receiver.owner).or_default().push(attempt);
        }
        let mut running = of_owner.into_values().max_by_key(Vec::len)?;
        running.retain(|attempt| !attempt.cut.is_cancelled());
        running.sort_by_key(|attempt| attempt.began);
        let age = |attempt: &Attempt| now.saturating_duration_since(attempt.began);
        for attempt in running.iter().take(most).filter(|attempt| age(attempt) >= LEAST_ATTEMPT) {
            attempt.cut.cancel();
        }
        let next = running.iter().find(|attempt| age(attempt) < LEAST_ATTEMPT)?;
        Some(LEAST_ATTEMPT.saturating_sub(age(next)))
    }
}

/// What messages that are due do not find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Short {
    OfPlaces,
    /// Places for messages that were sent before.
    OfRepeats,
}

/// What goes next.
#[derive(Debug, Default)]
pub(super) struct Choice {
    /// In their order.
    pub(super) go: Vec<WaitingDelivery>,
    /// Time until a message is due that is not yet.
    pub(super) next_due_in: Option<Duration>,
    /// Time until an attempt may be cut to make room, where messages are due that find none.
    pub(super) room_in: Option<Duration>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn delivery(owner: &str, host: &str, next_at: i64) -> WaitingDelivery {
        let receiver = Receiver { owner: owner.into(), host: host.into() };
        WaitingDelivery { seq: next_at, receiver, sent_before: false, next_at, due_in: Duration::ZERO }
    }

    /// Hosts that hang, of one owner.
    fn hanging(owner: &str, count: usize) -> Vec<WaitingDelivery> {
        (0..count).map(|i| delivery(owner, &format!("hang{i}"), i as i64)).collect()
    }

    fn begin_all(on_the_way: &mut OnTheWay, waiting: Vec<WaitingDelivery>) -> usize {
        let go = on_the_way.choose(waiting, Instant::now()).go;
        for delivery in &go {
            on_the_way.begin(delivery, |cut| Box::pin(async move { cut.cancelled().await }));
        }
        go.len()
    }

    #[tokio::test]
    async fn an_owner_with_many_messages_leaves_places_to_others() {
        let mut on_the_way = OnTheWay::default();
        assert_eq!(begin_all(&mut on_the_way, hanging("a", 1000)), OF_ONE_OWNER);
        let mut waiting = hanging("a", 1000);
        waiting.extend([delivery("b", "good", 5000), delivery("c", "good", 6000)]);
        let choice = on_the_way.choose(waiting, Instant::now());
        let hosts: Vec<&str> = choice.go.iter().map(|delivery| delivery.receiver.owner.as_str()).collect();
        assert_eq!(hosts, ["b", "c"]);
        assert!(choice.room_in.is_some_and(|room_in| room_in <= LEAST_ATTEMPT), "{choice:?}");
    }

    #[tokio::test]
    async fn two_owners_with_one_host_each_get_one_message_to_it_at_a_time() {
        let on_the_way = OnTheWay::default();
        let mut waiting: Vec<_> = (0..5).map(|i| delivery("a", "host", i)).collect();
        waiting.push(delivery("b", "host", 9));
        let choice = on_the_way.choose(waiting, Instant::now());
        let chosen: Vec<_> = choice.go.iter().map(|at| (at.receiver.owner.as_str(), at.next_at)).collect();
        assert_eq!(chosen, [("a", 0), ("b", 9)]);
    }

    #[tokio::test]
    async fn a_receiver_that_was_never_tried_comes_before_those_that_hang() {
        let mut on_the_way = OnTheWay::default();
        begin_all(&mut on_the_way, hanging("", 1000));
        let waiting = || {
            // The next messages of the same hosts, and of others, are older.
            let mut waiting = hanging("", 1000);
            waiting.push(delivery("", "good", 5000));
            waiting
        };
        let choice = on_the_way.choose(waiting(), Instant::now() + LEAST_ATTEMPT);
        assert!(
            choice.go.is_empty() && on_the_way.attempts.values().all(|attempt| attempt.cut.is_cancelled())
        );
        while let Some(ended) = on_the_way.tasks.join_next_with_id().await {
            on_the_way.ended(ended.map_or_else(|error| error.id(), |(id, ())| id));
        }
        let choice = on_the_way.choose(waiting(), Instant::now());
        assert_eq!(choice.go.len(), OF_ONE_OWNER);
        assert!(
            choice.go.iter().all(|delivery| delivery.receiver.host != "hang0"),
            "others were never tried"
        );
        assert!(begin_all(&mut on_the_way, vec![delivery("", "good", 5000), delivery("", "hang0", 0)]) == 2);
        let order = on_the_way.last_attempts;
        let of = |host: &str| order[&Receiver { owner: String::new(), host: host.into() }];
        assert!(of("good") < of("hang0"), "the one that was never tried went first");
    }

    #[tokio::test]
    async fn messages_that_were_sent_before_leave_places_to_others() {
        let mut on_the_way = OnTheWay::default();
        let repeats: Vec<_> = hanging("a", 500)
            .into_iter()
            .map(|delivery| WaitingDelivery { sent_before: true, ..delivery })
            .collect();
        assert_eq!(begin_all(&mut on_the_way, repeats), REPEATS);
        assert_eq!(begin_all(&mut on_the_way, vec![delivery("a", "good", 900)]), 1);
        let later = WaitingDelivery { due_in: Duration::from_secs(7), ..delivery("a", "late", 1) };
        assert_eq!(on_the_way.choose(vec![later], Instant::now()).next_due_in, Some(Duration::from_secs(7)));
    }
}
