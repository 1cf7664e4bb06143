//! The client of the request that a task answers, as those know it who share out places.

use crate::accounts::Submitter;
use crate::fair_places::Client;
use crate::memory_budget::client_of;

tokio::task_local! {
    static CLIENT: Client;
}

/// The client at an address, as text, with a key or none: the address, and the owner of the key.
pub(crate) fn client(address: &str, by: &Submitter) -> Client {
    let owner = (!by.key.is_empty()).then(|| format!("owner {}", by.owner));
    Client::named([format!("address {}", client_of(address))].into_iter().chain(owner))
}

/// Answers a request of a client: what asks for a place meanwhile does so for the client.
pub(crate) async fn answering<T>(client: Client, answer: impl Future<Output = T>) -> T {
    CLIENT.scope(client, answer).await
}

/// The client whose request this task answers; outside a request the service itself.
pub(crate) fn current() -> Client {
    CLIENT.try_with(Client::clone).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_client_is_its_address_and_the_owner_of_its_key() {
        let anybody = client("[2001:db8::1]:80", &Submitter::default());
        assert_eq!(anybody, client("2001:db8::2", &Submitter::default()));
        assert_ne!(anybody, client("192.0.2.1", &Submitter::default()));
        let by = Submitter { key: "desk".into(), owner: "lab".into() };
        let with_key = client("192.0.2.1", &by);
        assert_ne!(with_key, client("192.0.2.1", &Submitter::default()));
        assert_eq!(answering(with_key.clone(), async { current() }).await, with_key);
        assert_eq!(current(), Client::default());
    }
}
