//! A Slurm of its own, on this machine and for one test: Debian's munge, slurmctld and slurmd, without systemd and
//! without control groups.

use std::fs;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::deadline::eventually;
use super::machine::{lacking, port, skip};
use super::process::{Finished, run};

const PROGRAMS: [&str; 7] = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "sinfo"];

/// A cluster of one node with two cores. Dropped, its programs are killed.
pub(crate) struct Slurm {
    directory: tempfile::TempDir,
    daemons: Vec<Child>,
}

impl Slurm {
    /// Starts one. Returns `None` where that is not possible and `PACKSTONE_SLURM` does not require it.
    pub(crate) async fn start() -> Option<Self> {
        if let Some(lacks) = lacking(&PROGRAMS) {
            let advice =
                "Install slurmctld, slurmd, slurm-client and munge (Debian) and run the tests as root.";
            skip("PACKSTONE_SLURM", &format!("no Slurm ({lacks}); no array was run"), advice);
            return None;
        }
        let mut slurm = Self { directory: tempfile::tempdir().unwrap(), daemons: Vec::new() };
        let path = slurm.directory.path().to_owned();
        let named = |name: &str| path.join(name).display().to_string();
        // Munge refuses to work in a folder that others may look into or write.
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        let mut key = [0; 128];
        fs::File::open("/dev/urandom").unwrap().read_exact(&mut key).unwrap();
        fs::write(path.join("munge.key"), key).unwrap();
        fs::set_permissions(path.join("munge.key"), fs::Permissions::from_mode(0o600)).unwrap();
        for folder in ["state", "spool"] {
            fs::create_dir(path.join(folder)).unwrap();
        }
        fs::write(path.join("slurm.conf"), configuration(&path.display().to_string())).unwrap();
        slurm.spawn(
            "munged",
            &[
                "--foreground".into(),
                "--force".into(),
                format!("--key-file={}", named("munge.key")),
                format!("--socket={}", named("munge.socket")),
                format!("--pid-file={}", named("munged.pid")),
                format!("--log-file={}", named("munged.log")),
                format!("--seed-file={}", named("munge.seed")),
            ],
        );
        eventually("munge", || path.join("munge.socket").exists()).await;
        slurm.spawn("slurmctld", &["-D".into(), "-c".into()]);
        slurm.spawn("slurmd", &["-D".into(), "-N".into(), "localhost".into()]);
        eventually("an idle node of Slurm", || {
            let output = slurm.command("sinfo").args(["--noheader", "--format=%T"]).output().unwrap();
            output.stdout.starts_with(b"idle")
        })
        .await;
        Some(slurm)
    }

    fn spawn(&mut self, program: &str, args: &[String]) {
        let mut command = self.command(program);
        command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        self.daemons.push(command.spawn().unwrap_or_else(|error| panic!("{program}: {error}")));
    }

    /// A command that talks to this Slurm.
    pub(crate) fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("SLURM_"))
        {
            command.env_remove(name);
        }
        command.env("SLURM_CONF", self.directory.path().join("slurm.conf"));
        command
    }

    /// Runs a command in a directory until it ends.
    pub(crate) async fn run(&self, directory: &Path, program: &str, args: &[&str]) -> Finished {
        let mut command = self.command(program);
        command.args(args).current_dir(directory);
        run(command).await
    }

    /// The jobs that wait or run.
    pub(crate) fn queue(&self) -> String {
        let output = self.command("squeue").args(["--noheader", "--format=%i %T"]).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // Jobs that a failed test left would outlive the daemon.
        let _ = self.command("scancel").args(["--signal=KILL", "--full", "--user=root"]).output();
        for daemon in self.daemons.iter_mut().rev() {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

fn configuration(directory: &str) -> String {
    let (controller, node) = (port(), port());
    format!(
        "ClusterName=test
SlurmctldHost=localhost
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser=root
AuthInfo=socket={directory}/munge.socket
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_min_interval=100000,sched_interval=1,batch_sched_delay=0
MpiDefault=none
ReturnToService=2
KillWait=5
StateSaveLocation={directory}/state
SlurmdSpoolDir={directory}/spool
SlurmctldPidFile={directory}/slurmctld.pid
SlurmdPidFile={directory}/slurmd.pid
SlurmctldLogFile={directory}/slurmctld.log
SlurmdLogFile={directory}/slurmd.log
NodeName=localhost CPUs=2 RealMemory=2000
PartitionName=main Nodes=localhost Default=YES
"
    )
}
