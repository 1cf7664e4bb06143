//! Packstone's binary: all of it is in the library, so that tests reach it.
#![forbid(unsafe_code)]

/// With the allocator of musl, threads wait for each other at every request.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(packstone_server::main(std::env::args_os()))
}
