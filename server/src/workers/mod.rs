//! Workers: what runs tasks, in the server or in another process.
//!
//! [`executor`] runs tasks of either kind ([`task`]): [`packing`] of jobs, and exports
//! ([`exports::making`](crate::exports::making)). They come from the store of this process ([`here`]) or from a server
//! over HTTP ([`there`], whose messages are [`documents`]). Packings, and exports that take as long, hold [`slots`] of
//! their process ([`in_slots`]).
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
pub(crate) mod in_slots;
pub(crate) mod leased_export;
pub(crate) mod packing;
pub(crate) mod probe;
pub(crate) mod slots;
pub(crate) mod task;
pub(crate) mod there;
