//! The end-to-end suite: the real binary, over HTTP, as a client sees it.
//!
//! One test binary for all topics, because each further one would link the same crates once more
//! and wait for the one before it, while the tests of one binary share the cores. The suite may
//! know the published interface (`openapi.yaml`, the command line, the signals) and nothing else:
//! it must never import the server or the engine, or look into the store.
//!
//! Every answer that passes through [`harness::Client`] is held against `openapi.yaml`. Waiting is
//! done on signals (a long-poll, an event, the end of a process), each with a deadline that only a
//! fault can reach.
// An unwrap here is an assertion about the program under test, and its panic is the report.
#![allow(clippy::unwrap_used)]

mod harness;

mod actions;
mod aggregates;
mod auth;
mod bad_fields;
mod bad_requests;
mod blobs;
mod change_stream;
mod changes;
mod checkpoints;
mod command_line;
mod connections;
mod crash;
mod cross_site;
mod damaged_files;
mod damaged_store;
mod dashboard;
mod data_dir;
mod database_crashes;
mod decks;
mod determinism;
mod documents;
mod events;
mod exports;
mod faults;
mod finishing;
mod formats;
mod gallery;
mod gradient;
mod growth;
mod heavy_exports;
mod hostile;
mod idempotency;
mod idle_workers;
mod listing;
mod load;
mod memory;
mod migrate_store;
mod mixes;
mod models;
mod moved_store;
mod operations;
mod packing_files;
mod packings;
mod partial;
mod plane_models;
mod planning;
mod plots;
mod postgres;
mod properties;
mod proxies;
mod published_contract;
mod python_readers;
mod quotas;
mod ranges;
mod readme;
mod resuming;
mod retention;
mod scheduling;
mod sessions;
mod shapes;
mod shards;
mod shutdown;
mod slurm;
mod storage;
mod streaming;
mod streams;
mod studies;
mod study_command;
mod study_properties;
mod submission;
mod tetrahedra;
mod threads;
mod users;
mod voxel_readers;
mod waiting;
mod web_pages;
mod webhooks;
mod worker_crashes;
mod worker_faults;
mod worker_gmsh;
mod worker_results;
mod workers;
