//! Webhooks: a signed message to a URL of the client when a job ends or a study finishes.
//!
//! A submission names the URL ([`WebhookUrl`]). The store records a delivery in the transaction that ends the job or
//! the study. [`sender`] sends what is due, with the signature of Standard Webhooks ([`signature`],
//! <https://www.standardwebhooks.com>), to addresses that [`address`] does not refuse.

pub(crate) mod address;
mod on_the_way;
pub(crate) mod rules;
pub(crate) mod sender;
pub(crate) mod signature;
mod url;

/// Messages on their way at once, each of which has a connection.
pub(crate) const AT_ONCE: usize = on_the_way::AT_ONCE;

/// Why a URL for a job of a study is refused.
pub(crate) const NONE_OF_JOBS: &str =
    "the jobs of a study send no messages: leave this field out, and give it to the study itself";

pub(crate) use rules::WebhookRules;
#[cfg(test)]
pub(crate) use url::MAX_URL_CHARS;
pub(crate) use url::WebhookUrl;
