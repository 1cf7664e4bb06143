//! Benchmarks of the engine's kernels with criterion: `cargo bench -p packstone-benches`. Whole problems are measured
//! by `packstone bench`.
