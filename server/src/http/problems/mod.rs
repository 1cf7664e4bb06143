//! Problem documents (RFC 9457): how a problem becomes a response, and which problems each route can give.

mod response;
#[cfg(test)]
pub(crate) mod sets;

pub(crate) use response::{PROBLEM_JSON, Unwritten, of_fault, refused, unusable};
