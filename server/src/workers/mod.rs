//! Workers: what runs tasks, in the server or in another process.
//!
//! [`executor`] runs tasks of either kind ([`task`]): [`packing`] of jobs, and exports
//! ([`exports::making`](crate::exports::making)). Jobs come from the store of this process ([`here`]) or from a server
//! over HTTP ([`there`], whose messages are [`documents`]); a packing holds [`slots`] of its process.
//! What other processes send is checked by [`claims`] and [`checks`].
//! [`heard`] knows the processes that ask for jobs, and [`probe`] tells whether two processes compute the same bits.

pub(crate) mod checks;
pub(crate) mod claims;
pub(crate) mod control;
pub(crate) mod documents;
pub(crate) mod ending;
pub(crate) mod executor;
pub(crate) mod heard;
pub(crate) mod here;
pub(crate) mod packing;
pub(crate) mod probe;
pub(crate) mod slots;
pub(crate) mod task;
pub(crate) mod there;
