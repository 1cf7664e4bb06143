//! Places for work at once that many clients share: a client holds at most a part of them, and those who wait take
//! turns by client.
//!
//! With one line for all, whoever asks most often has all places; clients that are slow have them without end.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// Who asks for a place: names that each hold a part of the places at most, as the address of a client and the owner of
/// its key. The service itself has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Client(Arc<[String]>);

impl Client {
    /// A client with these names.
    pub(crate) fn named(names: impl IntoIterator<Item = String>) -> Self {
        Self(names.into_iter().collect())
    }
}

/// Places; clones share them.
#[derive(Clone, Debug)]
pub(crate) struct FairPlaces(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    most_per_name: usize,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    free: usize,
    /// Places that each name holds.
    held: HashMap<String, usize>,
    /// Those who wait, by client: the first client is the next.
    waiting: VecDeque<(Client, VecDeque<oneshot::Sender<Place>>)>,
}

/// A place of a client; dropped, it is free again.
#[derive(Debug)]
pub(crate) struct Place {
    places: FairPlaces,
    client: Client,
}

impl FairPlaces {
    /// So many places, of which each name holds at most `most_per_name`.
    pub(crate) fn new(places: usize, most_per_name: usize) -> Self {
        let state = State { free: places, held: HashMap::new(), waiting: VecDeque::new() };
        Self(Arc::new(Shared { most_per_name: most_per_name.max(1), state: Mutex::new(state) }))
    }

    /// Waits for a place. Who gives up gets none.
    pub(crate) async fn wait(&self, client: &Client) -> Place {
        loop {
            let (sender, place) = oneshot::channel();
            self.state().join(client, sender);
            self.hand_out();
            // A line whose client has left is removed, and with it one who joins in that moment.
            if let Ok(place) = place.await {
                return place;
            }
        }
    }

    /// Places that nobody holds.
    pub(crate) fn free(&self) -> usize {
        self.state().free
    }

    /// Gives free places to those whose turn it is.
    fn hand_out(&self) {
        while let Some((client, waiting)) = self.next() {
            // One who has given up in this moment gives it back.
            let _ = waiting.send(Place { places: self.clone(), client });
        }
    }

    fn next(&self) -> Option<(Client, oneshot::Sender<Place>)> {
        let mut state = self.state();
        if state.free == 0 {
            return None;
        }
        for (_, line) in &mut state.waiting {
            while line.front().is_some_and(oneshot::Sender::is_closed) {
                line.pop_front();
            }
        }
        state.waiting.retain(|(_, line)| !line.is_empty());
        let most = self.0.most_per_name;
        let may_have_one = |client: &Client| {
            client.0.iter().all(|name| state.held.get(name).is_none_or(|held| *held < most))
        };
        let turn = state.waiting.iter().position(|(client, _)| may_have_one(client))?;
        let (client, mut line) = state.waiting.remove(turn)?;
        let next = line.pop_front()?;
        state.free -= 1;
        for name in client.0.iter() {
            *state.held.entry(name.clone()).or_default() += 1;
        }
        if !line.is_empty() {
            state.waiting.push_back((client.clone(), line));
        }
        Some((client, next))
    }

    /// One who panicked cannot have left it half-changed.
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn join(&mut self, client: &Client, waiting: oneshot::Sender<Place>) {
        match self.waiting.iter_mut().find(|(known, _)| known == client) {
            Some((_, line)) => {
                line.retain(|other| !other.is_closed());
                line.push_back(waiting);
            }
            None => self.waiting.push_back((client.clone(), VecDeque::from([waiting]))),
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        {
            let mut state = self.places.state();
            state.free += 1;
            for name in self.client.0.iter() {
                if let Some(held) = state.held.get_mut(name) {
                    *held -= 1;
                    if *held == 0 {
                        state.held.remove(name);
                    }
                }
            }
        }
        self.places.hand_out();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::pin::Pin;

    use futures_util::FutureExt as _;

    use super::*;

    type Waiting = Pin<Box<dyn Future<Output = Place>>>;

    fn client(name: &str) -> Client {
        Client::named([name.to_owned()])
    }

    /// One who has joined the line; at once where there is a place.
    fn waits(places: &FairPlaces, name: &str) -> (Waiting, Option<Place>) {
        let (places, client) = (places.clone(), client(name));
        let mut waiting: Waiting = Box::pin(async move { places.wait(&client).await });
        let place = waiting.as_mut().now_or_never();
        (waiting, place)
    }

    #[test]
    fn a_client_holds_its_part_and_the_others_get_the_rest() {
        let places = FairPlaces::new(4, 2);
        let held: Vec<Place> = (0..2).map(|_| waits(&places, "slow").1.unwrap()).collect();
        let (mut third, none) = waits(&places, "slow");
        assert!(none.is_none() && places.free() == 2);
        let other = waits(&places, "other").1.unwrap();
        drop(other);
        assert!(third.as_mut().now_or_never().is_none(), "what others give back is not for it");
        drop(held);
        assert!(third.now_or_never().is_some());
        assert_eq!(places.free(), 4);
        assert!(places.state().held.is_empty());
    }

    #[test]
    fn each_name_of_a_client_is_bounded() {
        let places = FairPlaces::new(4, 1);
        let two = |address: &str, owner: &str| Client::named([address.to_owned(), owner.to_owned()]);
        let held = places.wait(&two("here", "lab")).now_or_never().unwrap();
        assert!(places.wait(&two("there", "lab")).now_or_never().is_none());
        assert!(places.wait(&two("here", "office")).now_or_never().is_none());
        places.wait(&two("there", "office")).now_or_never().unwrap();
        drop(held);
        places.wait(&two("there", "lab")).now_or_never().unwrap();
    }

    #[test]
    fn those_who_wait_take_turns_by_client() {
        let places = FairPlaces::new(1, 1);
        let mut held = waits(&places, "many").1;
        let mut line: Vec<(&str, Option<Waiting>)> = Vec::new();
        for name in ["many", "many", "many", "many", "one", "two", "two"] {
            let (waiting, none) = waits(&places, name);
            assert!(none.is_none());
            line.push((name, Some(waiting)));
        }
        // One of them gives up.
        line[5].1 = None;
        let mut order = Vec::new();
        while held.is_some() {
            held = None;
            for (name, waiting) in &mut line {
                let Some(place) = waiting.as_mut().and_then(|waiting| waiting.as_mut().now_or_never()) else {
                    continue;
                };
                order.push(*name);
                (held, *waiting) = (Some(place), None);
                break;
            }
        }
        assert_eq!(order, ["many", "one", "two", "many", "many", "many"]);
        assert_eq!(places.free(), 1);
    }
}
