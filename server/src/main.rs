//! Packstone's binary: all of it is in the library, so that tests reach it.
#![forbid(unsafe_code)]

/// It gives memory back to the system after a large request or packing. The allocator of glibc keeps hundreds of
/// megabytes then (`docs/operation.md`, "Memory"); with that of musl, threads wait for each other at every request.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(packstone_server::main(std::env::args_os()))
}
