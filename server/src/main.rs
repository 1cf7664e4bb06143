//! Packstone's binary: all but its allocator is in the library, so that tests reach it.
#![deny(unsafe_code)]

mod allocator;

#[global_allocator]
static ALLOCATOR: allocator::HugePages = allocator::HugePages;

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(packstone_server::main(std::env::args_os()))
}
