//! What every test needs: a running service, a client that knows the contract, and jobs to send.
//!
//! Nothing in here asserts about packings or jobs; that is the tests' own matter.

mod bucket;
mod client;
mod contract;
pub(crate) mod deadline;
pub(crate) mod jobs;
pub(crate) mod machine;
mod postgres;
mod process;
mod proxy;
mod raw;
pub(crate) mod results;
mod server;
mod slurm;
mod sse;

pub(crate) use bucket::Bucket;
pub(crate) use client::{Client, Reply, Request, id_of};
pub(crate) use contract::{Contract, text as contract_text};
pub(crate) use postgres::{Postgres, holds_every_store};
pub(crate) use process::{Finished, Running, packstone, run};
pub(crate) use proxy::{Fault, Proxy};
pub(crate) use raw::RawConnection;
pub(crate) use server::{DataDir, Launch, Server};
pub(crate) use slurm::Slurm;
pub(crate) use sse::{Event, EventStream};
