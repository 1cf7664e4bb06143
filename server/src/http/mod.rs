//! The HTTP interface: a folder per resource, and below them what they share.
//!
//! A handler reads its request, calls the store, and writes a view of what it found. Every error is a problem document.
//! The contract with clients is `openapi.yaml`. What describes handlers and types for it is compiled in tests alone,
//! which make the document from it and compare ([`contract`]).

mod access;
mod app;
mod auditing;
mod auth;
mod body;
mod client;
mod coding;
mod computing;
mod conditional;
mod contract;
mod drawing;
mod event_stream;
mod events;
mod exports;
mod files;
mod hosts;
mod jobs;
mod leases;
mod mixes;
mod negotiation;
mod observe;
#[cfg(test)]
mod openapi;
mod pace;
mod pages;
mod params;
mod problems;
mod ranges;
mod response;
mod results;
mod router;
mod service;
mod session;
mod shapes;
mod storage;
mod studies;
mod submission;
mod waiting;
pub(crate) mod web;
mod webhooks;
mod workers;

pub(crate) use app::{App, OperatorFiles};
pub(crate) use body::no_memory;
pub(crate) use contract::YAML as OPENAPI_YAML;
pub(crate) use observe::{OPEN_ROUTES, Refused, client_address};
pub(crate) use router::router;
