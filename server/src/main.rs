//! Packstone's binary: all of it is in the library, so that tests reach it.
#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(packstone_server::main(std::env::args_os()))
}
