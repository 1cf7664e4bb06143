//! The real service as a process of its own: start it, talk to it, end it in every way there is.

use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::process::{
    Pid, PidfdFlags, Resource, Rlimit, Signal, WaitId, WaitIdOptions, getrlimit, pidfd_open,
    pidfd_send_signal, prlimit, waitid,
};
use tokio::sync::{mpsc, watch};

use super::client::Client;
use super::deadline::{patiently, within};

/// A data directory that outlives the servers that use it. The first of them has to make it.
pub(crate) struct DataDir {
    path: PathBuf,
    _parent: tempfile::TempDir,
}

impl DataDir {
    /// The path of a fresh one.
    pub(crate) fn new() -> Self {
        let parent = tempfile::tempdir().expect("a temporary directory");
        Self { path: parent.path().join("packstone/data"), _parent: parent }
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The names of the checkpoints below it, whole ones only.
    pub(crate) fn checkpoints(&self) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.path.join("checkpoints")) else { return Vec::new() };
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.ends_with(".checkpoint")).collect()
    }

    /// The stored results below it, finished or not.
    pub(crate) fn artifacts(&self) -> Vec<PathBuf> {
        fn walk(directory: &Path, found: &mut Vec<PathBuf>) {
            for entry in std::fs::read_dir(directory).expect("a readable directory") {
                let entry = entry.unwrap();
                // A file may go while the server sweeps; a path is enough.
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() => walk(&entry.path(), found),
                    _ => found.push(entry.path()),
                }
            }
        }
        let mut found = Vec::new();
        let artifacts = self.path.join("artifacts");
        if artifacts.exists() {
            walk(&artifacts, &mut found);
        }
        found
    }
}

/// How a server is to be started.
pub(crate) struct Launch {
    command: Command,
}

impl Launch {
    /// One worker, a free loopback port, logs of warnings only.
    pub(crate) fn new(data_dir: &DataDir) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
        command.arg("serve").arg("--data-dir").arg(data_dir.path());
        // The environment of whoever runs the suite must not change what is tested.
        for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("PACKSTONE_")) {
            command.env_remove(name);
        }
        if let Some(store) = super::postgres::store_of(data_dir.path()) {
            // A server that may share a database takes nothing back at its start: jobs go on when leases run out.
            command.env("PACKSTONE_STORE", store).env("PACKSTONE_LEASE_S", "3");
        }
        Self { command }.listen("127.0.0.1:0").workers(1)
    }

    /// Packs so many jobs at once.
    pub(crate) fn workers(self, workers: usize) -> Self {
        self.env("PACKSTONE_WORKERS", &workers.to_string())
    }

    /// Listens there.
    pub(crate) fn listen(self, address: &str) -> Self {
        self.env("PACKSTONE_LISTEN", address)
    }

    /// Adds arguments.
    pub(crate) fn args(mut self, args: &[&str]) -> Self {
        self.command.args(args);
        self
    }

    /// Sets a variable of the environment.
    pub(crate) fn env(mut self, name: &str, value: &str) -> Self {
        self.command.env(name, value);
        self
    }

    /// Lets the server have so many bytes of address space from its start, as `ulimit -v` does.
    pub(crate) fn address_space(self, bytes: u64) -> Self {
        let mut command = Command::new("sh");
        let script = format!("ulimit -v {}; exec \"$0\" \"$@\"", bytes >> 10);
        command.args(["-c", &script]).arg(self.command.get_program()).args(self.command.get_args());
        for (name, value) in self.command.get_envs() {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        Self { command }
    }

    /// The command itself, for starts that are to be refused.
    pub(crate) fn into_command(self) -> Command {
        self.command
    }

    /// Starts the server and returns once it says where it listens.
    pub(crate) async fn start(mut self) -> Server {
        let mut child = self
            .command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary starts");
        let log = Arc::new(Mutex::new(String::new()));
        let (said, mut addresses) = mpsc::unbounded_channel();
        let followers = vec![
            follow(child.stdout.take().unwrap(), &log, said.clone()),
            follow(child.stderr.take().unwrap(), &log, said),
        ];
        let pidfd =
            pidfd_open(Pid::from_child(&child), PidfdFlags::empty()).expect("a handle of the process");
        let (pidfd, exited) = await_exit(pidfd);
        let mut server = Server { child, pidfd, exited, log, followers, address: ([0, 0, 0, 0], 0).into() };
        // The channel closes when the process ends: a server that refuses to start fails at once.
        match patiently("the server to listen", addresses.recv()).await {
            Some(address) => server.address = address,
            None => panic!("the server ended before it listened"),
        }
        server
    }
}

/// Watches for the end of a process from a thread of its own; its status is left to be collected.
fn await_exit(pidfd: OwnedFd) -> (Arc<OwnedFd>, watch::Receiver<bool>) {
    let pidfd = Arc::new(pidfd);
    let (ended, exited) = watch::channel(false);
    let watched = Arc::clone(&pidfd);
    std::thread::spawn(move || {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT;
        let outcome = waitid(WaitId::PidFd(watched.as_fd()), options);
        // A server that was dropped has been collected meanwhile: nobody listens any more.
        ended.send_replace(outcome.is_ok());
    });
    (pidfd, exited)
}

/// Keeps what a server prints, and looks in it for the address.
fn follow(
    from: impl Read + Send + 'static,
    log: &Arc<Mutex<String>>,
    said: mpsc::UnboundedSender<SocketAddr>,
) -> JoinHandle<()> {
    let log = Arc::clone(log);
    std::thread::spawn(move || {
        for line in BufReader::new(from).lines().map_while(Result::ok) {
            if let Some(address) = address_in(&line) {
                // The receiver is gone once the first address was heard.
                let _ = said.send(address);
            }
            let mut log = log.lock().unwrap();
            log.push_str(&line);
            log.push('\n');
        }
    })
}

fn address_in(line: &str) -> Option<SocketAddr> {
    let (_, rest) = line.split_once("http://")?;
    let end = rest.find(|c: char| !(c.is_ascii_hexdigit() || ".:[]".contains(c))).unwrap_or(rest.len());
    rest[..end].parse().ok()
}

/// A running server; dropped, it is killed.
pub(crate) struct Server {
    child: Child,
    /// Names this process even when its number is used again.
    pidfd: Arc<OwnedFd>,
    exited: watch::Receiver<bool>,
    log: Arc<Mutex<String>>,
    /// The readers of its two outputs.
    followers: Vec<JoinHandle<()>>,
    address: SocketAddr,
}

impl Server {
    /// One with the defaults of [`Launch::new`].
    pub(crate) async fn start(data_dir: &DataDir) -> Self {
        Launch::new(data_dir).start().await
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// A client of it.
    pub(crate) fn client(&self) -> Client {
        Client::new(self.address)
    }

    /// What it has printed so far.
    pub(crate) fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Ends it as a power cut would, and returns when it is gone.
    pub(crate) async fn kill(mut self) {
        self.signal(Signal::KILL);
        patiently("a killed process to end", self.wait()).await;
    }

    /// Asks it to end.
    pub(crate) fn terminate(&self) {
        self.signal(Signal::TERM);
    }

    /// Hangs up, as a terminal that is closed does.
    pub(crate) fn hang_up(&self) {
        self.signal(Signal::HUP);
    }

    /// Interrupts it, as a person at the terminal does.
    pub(crate) fn interrupt(&self) {
        self.signal(Signal::INT);
    }

    /// Waits until it has ended by itself.
    pub(crate) async fn ends_within(mut self, limit: Duration) -> ExitStatus {
        within(limit, "the server to end", self.wait()).await
    }

    /// Ends it as an operator would.
    pub(crate) async fn stop(self) {
        self.terminate();
        let status = self.ends_within(Duration::from_secs(10)).await;
        assert!(status.success(), "a server that was asked to end ended with {status}");
    }

    /// Waits for the end and returns all that was printed.
    pub(crate) async fn log_at_end(mut self) -> String {
        patiently("the server to end", self.wait()).await;
        for follower in self.followers.drain(..) {
            // The pipes close with the process: the last lines are on their way.
            follower.join().expect("a reader of the log");
        }
        self.log()
    }

    /// Resident memory in bytes.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.memory("VmRSS:")
    }

    /// Most resident memory since the start or the last [`reset_peak_bytes`](Self::reset_peak_bytes), in bytes.
    pub(crate) fn peak_bytes(&self) -> u64 {
        self.memory("VmHWM:")
    }

    /// Begins a new measurement of the peak, and tells the resident memory at that moment.
    pub(crate) fn reset_peak_bytes(&self) -> u64 {
        // 5 resets the peak (man 5 proc_pid_clear_refs).
        std::fs::write(format!("/proc/{}/clear_refs", self.child.id()), "5").expect("a process of this user");
        self.peak_bytes()
    }

    /// Lets the server open no file and accept no connection beside those that are open, until what is returned is
    /// dropped.
    pub(crate) fn without_descriptors(&self) -> NoDescriptors {
        let pid = Pid::from_child(&self.child);
        // The server has the hard limit of this process, and raises its soft one only.
        let none = Rlimit { current: Some(0), ..getrlimit(Resource::Nofile) };
        let before = prlimit(Some(pid), Resource::Nofile, none).expect("a process of this user");
        NoDescriptors { pid, before }
    }

    /// Lets the server have so many bytes of address space more than now.
    pub(crate) fn limit_address_space(&self, more: u64) {
        let most = Rlimit { current: Some(self.memory("VmSize:") + more), ..getrlimit(Resource::As) };
        prlimit(Some(Pid::from_child(&self.child)), Resource::As, most).expect("a process of this user");
    }

    fn memory(&self, name: &str) -> u64 {
        let path = format!("/proc/{}/status", self.child.id());
        let status = std::fs::read_to_string(path).expect("a running process");
        let line = status.lines().find(|line| line.starts_with(name)).expect("a line in /proc");
        let kilobytes: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
        kilobytes * 1024
    }

    fn signal(&self, signal: Signal) {
        pidfd_send_signal(&self.pidfd, signal).expect("a process that has not been waited for");
    }

    async fn wait(&mut self) -> ExitStatus {
        self.exited.wait_for(|exited| *exited).await.expect("the thread that watches the process");
        self.child.wait().expect("the status of the process")
    }
}

/// A server that may open no file; dropped, it may again.
pub(crate) struct NoDescriptors {
    pid: Pid,
    before: Rlimit,
}

impl Drop for NoDescriptors {
    fn drop(&mut self) {
        // A server that has ended has no limits.
        let _ = prlimit(Some(self.pid), Resource::Nofile, self.before);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            eprintln!("--- what the server printed ---\n{}", self.log());
        }
    }
}
