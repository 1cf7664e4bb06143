//! Which process claims a point, and whether it is still alive as far as this machine can tell.

use std::fmt;
use std::fs;

use serde::{Deserialize, Serialize};
use uuid::Uuid;

use crate::hex;

/// A process that runs a shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Process {
    /// Unique name.
    pub(super) name: String,
    pub(super) host: String,
    pub(super) pid: u32,
    /// The boot of the machine and the namespace of its process IDs, where Linux tells them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    machine: Option<String>,
    /// When the process started, in ticks after the boot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    started: Option<u64>,
    /// Job of Slurm, that of the array if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) slurm_job: Option<String>,
    /// Its task of the array.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) slurm_task: Option<String>,
}

impl Process {
    /// This process.
    pub(super) fn current() -> Self {
        let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let pid = std::process::id();
        Self {
            name: Uuid::now_v7().simple().to_string(),
            host: line_of("/proc/sys/kernel/hostname")
                .or_else(|| variable("SLURMD_NODENAME"))
                .or_else(|| variable("HOSTNAME"))
                .unwrap_or_else(|| "unknown".into()),
            pid,
            machine: machine(),
            started: start_of(pid),
            slurm_job: variable("SLURM_ARRAY_JOB_ID").or_else(|| variable("SLURM_JOB_ID")),
            slurm_task: variable("SLURM_ARRAY_TASK_ID"),
        }
    }

    /// The process in a few characters, for the name of a file; `None` where its machine does not tell all of it.
    pub(super) fn mark(&self) -> Option<String> {
        let machine = hex::sha256(self.machine.as_ref()?.as_bytes());
        Some(format!("{}-{}-{}", self.pid, self.started?, &machine[..16]))
    }

    /// Whether the process of a [mark](Self::mark) is alive; `None` where only its own machine knows.
    pub(super) fn is_alive_by(mark: &str) -> Option<bool> {
        let mut parts = mark.split('-');
        let (pid, started, machine) =
            (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?);
        let is_here = hex::sha256(self::machine()?.as_bytes()).starts_with(machine) && machine.len() == 16;
        is_here.then(|| start_of(pid) == Some(started))
    }

    /// Whether it is alive; `None` where only its own machine knows.
    pub(super) fn is_alive(&self) -> Option<bool> {
        let machine = self.machine.as_ref()?;
        let started = self.started?;
        (Some(machine) == self::machine().as_ref()).then(|| start_of(self.pid) == Some(started))
    }
}

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {} on {}", self.pid, self.host)?;
        match (&self.slurm_job, &self.slurm_task) {
            (Some(job), Some(task)) => write!(f, " (Slurm job {job}_{task})"),
            (Some(job), None) => write!(f, " (Slurm job {job})"),
            (None, _) => Ok(()),
        }
    }
}

fn line_of(file: &str) -> Option<String> {
    let text = fs::read_to_string(file).ok()?;
    Some(text.trim().to_owned()).filter(|line| !line.is_empty())
}

fn machine() -> Option<String> {
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    Some(format!("{} {}", line_of("/proc/sys/kernel/random/boot_id")?, namespace.display()))
}

/// When a process started, in ticks after the boot; `None` where there is none, or a dead one that nobody has waited
/// for.
fn start_of(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name of the command, in brackets, may hold anything; the fields after it are numbered from 3 (proc(5)).
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    if matches!(*fields.first()?, "Z" | "X") {
        return None;
    }
    fields.get(22 - 3)?.parse().ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_of_a_process_of_this_machine_it_is_known_whether_it_lives() {
        let this = Process::current();
        assert_eq!(this.is_alive(), Some(true));
        let mark = this.mark().unwrap();
        assert_eq!(Process::is_alive_by(&mark), Some(true));
        let (pid, rest) = mark.split_once('-').unwrap();
        assert_eq!(Process::is_alive_by(&format!("{pid}-1{rest}")), Some(false));
        assert_eq!(Process::is_alive_by(&format!("{}g", &mark[..mark.len() - 1])), None);
        assert_eq!(Process::is_alive_by("01900000000070008000000000000000"), None);
        // Another process has its number since.
        let before = Process { started: this.started.map(|ticks| ticks - 1), ..this.clone() };
        assert_eq!(before.is_alive(), Some(false));
        let elsewhere = Process { machine: Some("another".into()), ..this.clone() };
        assert_eq!(elsewhere.is_alive(), None);
        let text = serde_json::to_string(&this).unwrap();
        assert_eq!(serde_json::from_str::<Process>(&text).unwrap(), this);
    }

    #[test]
    fn a_dead_process_is_known_to_be_dead() {
        let mut child = std::process::Command::new("sleep").arg("600").spawn().unwrap();
        let process = Process { pid: child.id(), started: start_of(child.id()), ..Process::current() };
        assert_eq!(process.is_alive(), Some(true));
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(process.is_alive(), Some(false));
    }

    #[test]
    fn the_job_is_named() {
        let mut process = Process::current();
        (process.host, process.pid) = ("node7".into(), 12);
        (process.slurm_job, process.slurm_task) = (Some("4711".into()), Some("3".into()));
        assert_eq!(process.to_string(), "process 12 on node7 (Slurm job 4711_3)");
    }
}
