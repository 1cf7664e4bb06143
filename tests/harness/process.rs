//! Commands of the binary that end by themselves, or when they are told to.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use super::deadline::{eventually, patiently};

/// How a command ended.
#[derive(Debug)]
pub(crate) struct Finished {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// Runs `packstone` with `args` in `directory` until it ends.
pub(crate) async fn packstone(directory: &Path, args: &[&str]) -> Finished {
    let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
    command.args(args).current_dir(directory);
    run(command).await
}

/// Runs a command until it ends.
pub(crate) async fn run(mut command: Command) -> Finished {
    command.stdin(Stdio::null());
    let output = tokio::task::spawn_blocking(move || command.output());
    let output = patiently("a command to end", output).await.unwrap().expect("the command starts");
    finished(&output)
}

/// A command that runs until it is told to end; dropped, it is killed.
pub(crate) struct Running {
    child: Option<Child>,
    pid: Pid,
}

impl Running {
    /// Starts `packstone` with `args` in `directory`, and returns once it takes signals to end.
    pub(crate) async fn start(directory: &Path, args: &[&str]) -> Self {
        let running = Self::spawn(directory, args);
        eventually("a command to handle signals", || running.catches(Signal::TERM)).await;
        running
    }

    /// Starts `packstone` with `args` in `directory`, which may end at once.
    pub(crate) fn spawn(directory: &Path, args: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
        command.args(args).current_dir(directory);
        Self::of(command)
    }

    /// Starts a command, which may end at once.
    pub(crate) fn of(mut command: Command) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().expect("the command starts");
        let pid = Pid::from_child(&child);
        Self { child: Some(child), pid }
    }

    /// Whether the process has a handler for a signal, by Linux's table of its signals.
    fn catches(&self, signal: Signal) -> bool {
        let path = format!("/proc/{}/status", self.pid.as_raw_nonzero());
        let status = std::fs::read_to_string(path).expect("a process that was not waited for");
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).expect("SigCgt in /proc");
        let mask = u64::from_str_radix(mask.trim(), 16).expect("a mask in hexadecimal");
        mask & (1 << (signal.as_raw() - 1)) != 0
    }

    /// The processor time that it has used, by Linux's table.
    pub(crate) fn cpu_time(&self) -> Duration {
        let path = format!("/proc/{}/stat", self.pid.as_raw_nonzero());
        let stat = std::fs::read_to_string(path).expect("a process that was not waited for");
        // Fields 14 and 15 of proc(5); the name of the command may hold anything.
        let fields: Vec<&str> = stat.rsplit_once(')').expect("a name").1.split_whitespace().collect();
        let ticks: u64 = fields[11..13].iter().map(|ticks| ticks.parse::<u64>().expect("ticks")).sum();
        Duration::from_millis(ticks * 1000 / rustix::param::clock_ticks_per_second())
    }

    /// Sends it a signal.
    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(self.pid, signal).expect("a process that was not waited for");
    }

    /// Waits for its end.
    pub(crate) async fn ended(mut self) -> Finished {
        let child = self.child.take().expect("a process that was not waited for");
        let output = tokio::task::spawn_blocking(move || child.wait_with_output());
        let output = patiently("a command to end", output).await.unwrap().expect("its output");
        finished(&output)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn finished(output: &Output) -> Finished {
    Finished {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}
