//! The memory that requests being read and answers being sent may hold: over all connections, and for each address of a
//! client.
//!
//! Bytes are counted when they arrive, not when they are announced, so that a slow sender holds what it has sent. A few
//! bytes of each request are not counted. Their sum is bounded by the number of connections, and small requests are
//! served while large ones hold the whole budget.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of a request or of an answer that are not counted.
pub(crate) const UNCOUNTED_BYTES: u64 = 16 << 10;

/// A bound of memory for all clients together, and one for each.
#[derive(Clone, Debug)]
pub(crate) struct MemoryBudget(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    most: u64,
    most_per_client: u64,
    counts: Mutex<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    all: u64,
    by_client: HashMap<String, u64>,
}

/// The bound that would be exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Exceeded {
    /// That of all clients.
    #[error("requests and answers of all clients hold as much memory as they may: at most {0} bytes")]
    All(u64),
    /// That of one client.
    #[error("requests and answers of this address hold as much memory as they may: at most {0} bytes")]
    Client(u64),
}

/// Memory of one request or answer; dropped, it is free again.
#[derive(Debug)]
pub(crate) struct Reservation {
    budget: MemoryBudget,
    client: Option<String>,
    bytes: u64,
}

impl MemoryBudget {
    /// At most `most` bytes for all clients, and `most_per_client` for each of them.
    pub(crate) fn new(most: u64, most_per_client: u64) -> Self {
        Self(Arc::new(Shared { most, most_per_client, counts: Mutex::default() }))
    }

    /// An empty reservation of the client at an address, as text; without one only the bound of all clients holds.
    pub(crate) fn reservation(&self, client: Option<&str>) -> Reservation {
        Reservation { budget: self.clone(), client: client.map(client_of), bytes: 0 }
    }

    /// Reserves the memory of an answer that exists already. One that is longer than a client's bound takes all of it:
    /// it could never be sent otherwise.
    ///
    /// # Errors
    /// The bound that would be exceeded.
    pub(crate) fn reserve_answer(&self, client: &str, bytes: u64) -> Result<Reservation, Exceeded> {
        let mut reservation = self.reservation(Some(client));
        reservation.grow(bytes.min(UNCOUNTED_BYTES + self.0.most_per_client))?;
        Ok(reservation)
    }
}

impl Reservation {
    /// Bytes that are held, counted or not.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Holds more bytes.
    ///
    /// # Errors
    /// The bound that would be exceeded; nothing is added then.
    pub(crate) fn grow(&mut self, bytes: u64) -> Result<(), Exceeded> {
        let grown = self.bytes.saturating_add(bytes);
        let more = counted(grown) - counted(self.bytes);
        if more > 0 {
            let Shared { most, most_per_client, counts } = &*self.budget.0;
            let mut counts = counts.lock().unwrap_or_else(PoisonError::into_inner);
            if counts.all.saturating_add(more) > *most {
                return Err(Exceeded::All(*most));
            }
            if let Some(client) = &self.client {
                let held = counts.by_client.get(client).copied().unwrap_or_default();
                if held.saturating_add(more) > *most_per_client {
                    return Err(Exceeded::Client(*most_per_client));
                }
                counts.by_client.insert(client.clone(), held + more);
            }
            counts.all += more;
        }
        self.bytes = grown;
        Ok(())
    }

    /// Frees all bytes.
    pub(crate) fn clear(&mut self) {
        let bytes = counted(std::mem::take(&mut self.bytes));
        if bytes == 0 {
            return;
        }
        let mut counts = self.budget.0.counts.lock().unwrap_or_else(PoisonError::into_inner);
        counts.all -= bytes;
        if let Some(client) = &self.client
            && let Some(held) = counts.by_client.get_mut(client)
        {
            *held -= bytes;
            if *held == 0 {
                counts.by_client.remove(client);
            }
        }
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.clear();
    }
}

fn counted(bytes: u64) -> u64 {
    bytes.saturating_sub(UNCOUNTED_BYTES)
}

/// The address that stands for a client: one machine may have all 2^64 addresses of a network of IPv6 (RFC 4291,
/// section 2.5.4).
pub(crate) fn network_of(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => address,
        IpAddr::V6(v6) => match v6.to_ipv4_mapped() {
            Some(v4) => v4.into(),
            None => Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64).into(),
        },
    }
}

/// The same of an address as text, which a proxy may write with a port.
pub(crate) fn client_of(address: &str) -> String {
    let bare = address.trim().trim_start_matches('[').trim_end_matches(']');
    let parsed = bare.parse().ok().or_else(|| address.parse::<SocketAddr>().ok().map(|address| address.ip()));
    parsed.map_or_else(|| address.to_owned(), |address| network_of(address).to_string())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_client_gets_its_share_and_all_get_the_whole() {
        let budget = MemoryBudget::new(100, 60);
        let mut first = budget.reservation(Some("192.0.2.1"));
        first.grow(UNCOUNTED_BYTES + 50).unwrap();
        let mut same = budget.reservation(Some("::ffff:192.0.2.1"));
        assert_eq!(same.grow(UNCOUNTED_BYTES + 11), Err(Exceeded::Client(60)));
        same.grow(UNCOUNTED_BYTES + 10).unwrap();
        let mut other = budget.reservation(Some("192.0.2.2:4711"));
        assert_eq!(other.grow(UNCOUNTED_BYTES + 41), Err(Exceeded::All(100)));
        other.grow(UNCOUNTED_BYTES + 40).unwrap();
        // Small requests are served whatever others hold.
        budget.reservation(Some("192.0.2.1")).grow(UNCOUNTED_BYTES).unwrap();
        drop(first);
        same.grow(50).unwrap();
        drop((same, other));
        let counts = budget.0.counts.lock().unwrap();
        assert_eq!((counts.all, counts.by_client.len()), (0, 0));
    }

    #[test]
    fn an_answer_that_is_longer_than_a_share_is_sent_alone() {
        let budget = MemoryBudget::new(1 << 20, 1 << 19);
        let long = budget.reserve_answer("192.0.2.1", 1 << 30).unwrap();
        assert!(budget.reserve_answer("192.0.2.1", 1 << 18).is_err());
        assert!(budget.reserve_answer("192.0.2.2", 1 << 18).is_ok());
        drop(long);
        assert!(budget.reserve_answer("192.0.2.1", 1 << 18).is_ok());
    }

    #[test]
    fn a_network_of_ipv6_is_one_client() {
        assert_eq!(client_of("2001:db8::1"), client_of("[2001:db8::ffff:1]:80"));
        assert_ne!(client_of("2001:db8::1"), client_of("2001:db8:0:1::1"));
        assert_eq!(client_of("_hidden"), "_hidden");
    }

    proptest! {
        #[test]
        fn what_is_held_is_counted_exactly(steps in proptest::collection::vec((0_usize..4, 0_u64..40_000), 0..60)) {
            let budget = MemoryBudget::new(100_000, 70_000);
            let mut held: Vec<_> = ["a", "a", "b"].map(|client| budget.reservation(Some(client))).into();
            held.push(budget.reservation(None));
            for (which, bytes) in steps {
                if bytes % 5 == 0 { held[which].clear() } else { let _ = held[which].grow(bytes); }
                let sum: u64 = held.iter().map(|one| counted(one.bytes())).sum();
                let counts = budget.0.counts.lock().unwrap();
                prop_assert_eq!(counts.all, sum);
                prop_assert!(sum <= 100_000);
                let of_a = counts.by_client.get("a").copied().unwrap_or_default();
                prop_assert_eq!(of_a, counted(held[0].bytes()) + counted(held[1].bytes()));
                prop_assert!(of_a <= 70_000);
            }
        }
    }
}
