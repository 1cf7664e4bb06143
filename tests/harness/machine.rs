//! What a test needs of the machine besides its processes: programs, the rights of root, a network, a disk, a clock.
//!
//! Where the machine has it not, the test says so past the capture of its output and passes, unless a variable of the
//! environment requires it.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// The variable that requires the tests of faults.
const FAULTS: &str = "PACKSTONE_FAULTS";

/// What of these programs and of the rights of root is lacking.
pub(crate) fn lacking(programs: &[&str]) -> Option<String> {
    if !rustix::process::geteuid().is_root() {
        return Some("not run as root".into());
    }
    missing(programs)
}

/// Which of these programs no folder of `PATH` has.
pub(crate) fn missing(programs: &[&str]) -> Option<String> {
    let missing: Vec<&str> = programs.iter().copied().filter(|name| !is_installed(name)).collect();
    (!missing.is_empty()).then(|| format!("{} missing", missing.join(", ")))
}

/// The Python of `PACKSTONE_PYTHON`, which has the packages of `tests/python/requirements.txt` in their versions.
/// Without it the test is to be skipped, which is said here with the advice; a Python that happens to be on the machine
/// may have other versions.
pub(crate) fn python(advice: &str) -> Option<PathBuf> {
    let python = std::env::var_os("PACKSTONE_PYTHON").filter(|value| !value.is_empty());
    if python.is_none() {
        skip("PACKSTONE_PYTHON", "PACKSTONE_PYTHON names no Python", advice);
    }
    python.map(PathBuf::from)
}

/// The Python with the wheel of Gmsh, and besides it the program of Debian: those that there are. Without Python the
/// test is to be skipped, which is said here with the advice.
///
/// # Panics
/// If `PACKSTONE_PYTHON` is set, and one of them is missing.
pub(crate) fn gmsh(advice: &str) -> Option<(PathBuf, Vec<PathBuf>)> {
    let python = python(advice)?;
    let mut all = vec![python.clone()];
    match missing(&["gmsh"]) {
        None => all.push("gmsh".into()),
        Some(missing) => skip("PACKSTONE_PYTHON", &missing, advice),
    }
    Some((python, all))
}

/// Whether the programs that users of the interface have are there: those of the scripts in the documents. Where one is
/// missing, the test is to be skipped, which is said here.
///
/// # Panics
/// If `PACKSTONE_PYTHON` is set, as the pipeline does, which has them all.
pub(crate) fn has_tools_of_scripts(programs: &[&str]) -> bool {
    let missing = missing(programs);
    if let Some(lacks) = &missing {
        skip("PACKSTONE_PYTHON", lacks, "Install what is missing; no script of the documents was run.");
    }
    missing.is_none()
}

/// Says that a test is skipped for what is lacking.
///
/// # Panics
/// If the variable requires the test.
pub(crate) fn skip(variable: &str, lacks: &str, advice: &str) {
    let required = std::env::var_os(variable).is_some_and(|value| !value.is_empty());
    assert!(!required, "{variable} is set, but a test is not possible: {lacks}");
    // Past the capture of the test harness: that nothing was tested must be seen.
    let warning = format!("\n*** SKIPPED: {lacks}.\n*** {advice}\n");
    std::io::stderr().write_all(warning.as_bytes()).unwrap();
}

/// A free port of this machine for a process that starts later. The system takes none of this range for those who ask
/// for any (`net.ipv4.ip_local_port_range` begins at 32 768 where nobody set it), and this function gives each once.
pub(crate) fn port() -> u16 {
    static GIVEN: AtomicU32 = AtomicU32::new(0);
    let first = std::process::id().wrapping_mul(61);
    let next = || 20_000 + (first.wrapping_add(GIVEN.fetch_add(1, Ordering::Relaxed)) % 10_000) as u16;
    let is_free = |port: &u16| std::net::TcpListener::bind(("127.0.0.1", *port)).is_ok();
    std::iter::repeat_with(next).take(10_000).find(is_free).expect("a free port from 20000 to 29999")
}

fn is_installed(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).exists()))
}

/// A network of its own, linked to that of this process. Dropped, it goes, but not before the processes in it.
pub(crate) struct Network {
    name: String,
    /// The ends of the link in this process's network and in the other: 10.200.0.0/16, in parts of four.
    address: String,
}

impl Network {
    /// Makes one; `None`, aloud, where that is not possible.
    pub(crate) fn make() -> Option<Self> {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let number = std::process::id().wrapping_mul(8) + MADE.fetch_add(1, Ordering::Relaxed);
        let name = format!("pks{number}");
        let part = (number % (1 << 14)) * 4;
        let end = |last: u32| format!("10.200.{}.{}", part >> 8, (part & 255) + last);
        let made = lacking(&["ip"]).or_else(|| {
            let added = Command::new("ip").args(["netns", "add", &name]).output().unwrap();
            (!added.status.success()).then(|| String::from_utf8_lossy(&added.stderr).trim().to_owned())
        });
        if let Some(lacks) = made {
            skip(
                FAULTS,
                &format!("no network namespace ({lacks})"),
                "Install iproute2 and run the tests as root.",
            );
            return None;
        }
        let network = Self { address: end(1), name };
        ip(&["link", "add", &network.name, "type", "veth", "peer", "name", "eth0", "netns", &network.name]);
        ip(&["address", "add", &format!("{}/30", end(1)), "dev", &network.name]);
        ip(&["link", "set", &network.name, "up"]);
        ip(&["-n", &network.name, "address", "add", &format!("{}/30", end(2)), "dev", "eth0"]);
        network.link(true);
        Some(network)
    }

    /// The address of this process's end of the link, by which processes in the other network reach it.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    /// Sets the other end of the link up or down.
    pub(crate) fn link(&self, up: bool) {
        ip(&["-n", &self.name, "link", "set", "eth0", if up { "up" } else { "down" }]);
    }

    /// A command in this network.
    pub(crate) fn command(&self, program: &str) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.name, program]);
        command
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // The link goes with either of its ends.
        let _ = Command::new("ip").args(["link", "del", &self.name]).output();
        let _ = Command::new("ip").args(["netns", "del", &self.name]).output();
    }
}

fn ip(args: &[&str]) {
    let ended = Command::new("ip").args(args).output().unwrap();
    assert!(ended.status.success(), "ip {args:?}: {}", String::from_utf8_lossy(&ended.stderr));
}

/// A file system in memory. Dropped, it goes.
pub(crate) struct SmallDisk {
    mount: PathBuf,
}

impl SmallDisk {
    /// Mounts one of so many bytes over a folder; `None`, aloud, where that is not possible.
    pub(crate) fn mount(folder: &Path, bytes: u64) -> Option<Self> {
        let size = format!("size={bytes}");
        let mut mounting = Command::new("mount");
        mounting.args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(folder);
        if mounting.status().is_ok_and(|status| status.success()) {
            return Some(Self { mount: folder.to_owned() });
        }
        skip(FAULTS, "no disk of its own (mounting a tmpfs needs root)", "Run the tests as root.");
        None
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.mount
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.mount).status();
    }
}

/// The library of faketime, which gives a process another clock; `None`, aloud, where it is not installed.
pub(crate) fn faketime() -> Option<PathBuf> {
    let folders = std::fs::read_dir("/usr/lib").into_iter().flatten().flatten();
    let found =
        folders.map(|folder| folder.path().join("faketime/libfaketimeMT.so.1")).find(|file| file.exists());
    if found.is_none() {
        skip(FAULTS, "no clock of its own (libfaketime missing)", "Install faketime (Debian).");
    }
    found
}
