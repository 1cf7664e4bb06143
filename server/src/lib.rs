//! Packstone's service: jobs, their store, their runner, their results, and the HTTP around them.
//!
//! Data passes one way: `http` takes a request in, `jobs` keeps it and runs it through the
//! engine, `artifacts` keeps what came out, `http` streams it. How a packing is computed is the
//! engine's secret; nothing here looks into one.
#![forbid(unsafe_code)]

mod accounts;
mod advice;
mod artifacts;
mod atomic_file;
mod audit;
mod base_path;
mod blobs;
mod checkpoints;
mod cli;
mod config;
mod descriptors;
mod disk;
mod exports;
mod failure;
mod fair_places;
mod formats;
mod gmsh;
mod hex;
mod http;
mod http_client;
mod http_server;
mod ids;
mod jobs;
#[cfg(test)]
mod layers;
pub mod local;
mod memory;
mod memory_budget;
mod metrics;
mod open_files;
mod page;
mod places;
mod planning;
mod plots;
mod problem;
mod processor;
mod programs;
mod remaining_time;
mod service;
mod storage;
mod strict_json;
mod studies;
mod tasks;
mod telemetry;
mod watched_file;
mod web_files;
mod webhooks;
mod workers;

/// Names the function that returns free memory of the allocator to the system: commands that run for long call it from
/// time to time. Without one, the allocator does as it likes.
pub fn release_memory_by(release: fn()) {
    memory::set_release(release);
}

/// Runs a command line, whose first argument is the name of the program, and returns the exit code. A wrong command
/// line ends the process with exit code 2, as `--help` does with 0.
pub fn main(arguments: impl IntoIterator<Item = std::ffi::OsString>) -> u8 {
    cli::main(arguments)
}
