//! The allocator of glibc: fewer arenas, and free memory that is returned to the system.
//!
//! By default it makes up to eight arenas a core, each of 64 MiB of address space, and keeps what is freed within them:
//! a service holds hundreds of megabytes after a large request or packing. The two functions of glibc that change this
//! are declared unsafe because they are of another language; both take numbers alone.

use std::ffi::c_int;

/// Arenas of the process. Threads keep small free blocks of their own besides, so that they seldom wait for each other.
const ARENAS: c_int = 2;

/// Sets the number of arenas, unless an operator has done so (`MALLOC_ARENA_MAX`).
pub(crate) fn configure() {
    if std::env::var_os("MALLOC_ARENA_MAX").is_none() {
        // SAFETY: `mallopt` (glibc manual, "Malloc Tunable Parameters") takes two numbers and changes settings alone.
        // No other thread exists yet, so that none reads them meanwhile.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, ARENAS) };
    }
}

/// Returns the free pages of all arenas to the system.
pub(crate) fn release_free_memory() {
    // SAFETY: `malloc_trim` (Linux manual, malloc_trim(3): MT-Safe) locks each arena while it gives back the pages of
    // free blocks; blocks in use stay as they are.
    unsafe { libc::malloc_trim(0) };
}
