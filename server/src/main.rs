//! Packstone's binary: all but the settings of its allocator is in the library, so that tests reach it.
#![deny(unsafe_code)]

#[cfg(target_env = "gnu")]
#[allow(unsafe_code)]
mod allocator;

/// With the allocator of musl, threads wait for each other at every request. This one returns free memory by itself.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    #[cfg(target_env = "gnu")]
    {
        allocator::configure();
        packstone_server::release_memory_by(allocator::release_free_memory);
    }
    std::process::ExitCode::from(packstone_server::main(std::env::args_os()))
}
