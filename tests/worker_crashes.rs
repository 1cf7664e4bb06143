//! Kills and other faults of the server and of workers in other processes, at random moments: nothing is lost, and each
//! job ends once, by what the clients, the workers and the server have said (see [`crash`](crate::crash)).

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rustix::process::Signal;

use crate::crash::{Known, account, order_and_watch, swept};
use crate::harness::machine::{Network, faketime};
use crate::harness::{Client, DataDir, Launch, Running, Server, holds_every_store, packstone};

#[tokio::test]
async fn kills_of_workers_and_server_lose_nothing() {
    if holds_every_store() {
        return;
    }
    survive(15, 3, &KILLS, None).await;
}

#[tokio::test]
async fn kills_sleep_cut_links_and_wrong_clocks_lose_nothing() {
    if holds_every_store() {
        return;
    }
    let (Some(network), Some(library)) = (Network::make(), faketime()) else { return };
    survive(20, 5, &ALL_FAULTS, Some((network, library))).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e five_hundred -- --ignored"]
async fn five_hundred_kills_of_workers_and_server_lose_nothing() {
    survive(500, 4, &KILLS, None).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e five_hundred -- --ignored"]
async fn five_hundred_faults_of_all_kinds_lose_nothing() {
    let (Some(network), Some(library)) = (Network::make(), faketime()) else { return };
    survive(500, 6, &ALL_FAULTS, Some((network, library))).await;
}

/// What may befall the server and two workers in other processes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fault {
    KillWorker(usize),
    KillServer,
    /// It sleeps past its lease.
    Sleep(usize),
    /// The link of the second worker goes down, until the lease has run out.
    LinkDown,
}

impl Fault {
    fn name(self) -> &'static str {
        match self {
            Self::KillWorker(_) => "killed workers",
            Self::KillServer => "killed servers",
            Self::Sleep(_) => "workers asleep",
            Self::LinkDown => "links down",
        }
    }
}

const KILLS: [Fault; 3] = [Fault::KillWorker(0), Fault::KillWorker(1), Fault::KillServer];
const ALL_FAULTS: [Fault; 7] =
    [KILLS[0], KILLS[1], KILLS[2], Fault::Sleep(0), Fault::Sleep(1), Fault::LinkDown, Fault::LinkDown];
/// For how many moments, of 0.3 s in the mean, a worker sleeps or a link is down: longer than a lease of 2 s.
const MOMENTS: usize = 10;

/// A server, and two workers in other processes. With a network, the second worker is in it, and the clock of the first
/// is wrong.
struct Cluster {
    // Before the network, which goes when no process is in it.
    workers: [Option<Running>; 2],
    server: Option<Server>,
    network: Option<(Network, PathBuf)>,
    address: String,
    data_dir: DataDir,
    folder: tempfile::TempDir,
    /// The moments at which a worker wakes and the link is up again.
    wake: [Option<usize>; 2],
    link_up: Option<usize>,
    /// What the server and the workers said that were killed.
    said: Vec<String>,
    /// Faults by kind.
    faults: BTreeMap<&'static str, usize>,
}

const NAMES: [&str; 2] = ["one", "two"];

impl Cluster {
    async fn start(network: Option<(Network, PathBuf)>) -> Self {
        let listen = network.as_ref().map_or("127.0.0.1", |(network, _)| network.address());
        let mut cluster = Self {
            workers: [None, None],
            server: None,
            address: format!("{listen}:0"),
            network,
            data_dir: DataDir::new(),
            folder: tempfile::tempdir().unwrap(),
            wake: [None; 2],
            link_up: None,
            said: Vec::new(),
            faults: BTreeMap::new(),
        };
        cluster.start_server().await;
        cluster.workers = [0, 1].map(|index| Some(cluster.worker(index)));
        cluster
    }

    async fn start_server(&mut self) {
        let launch = Launch::new(&self.data_dir).workers(0).env("PACKSTONE_LEASE_S", "2");
        let server = launch.listen(&self.address).args(&["--insecure"]).start().await;
        self.address = server.address().to_string();
        self.server = Some(server);
    }

    fn server(&self) -> &Server {
        self.server.as_ref().expect("a server")
    }

    fn worker(&self, index: usize) -> Running {
        let program = env!("CARGO_BIN_EXE_packstone");
        let mut command = match &self.network {
            Some((network, _)) if index == 1 => network.command(program),
            _ => Command::new(program),
        };
        if let Some((_, library)) = self.network.as_ref().filter(|_| index == 0) {
            command.env("LD_PRELOAD", library).env("FAKETIME", "-9h x1.3");
        }
        let url = format!("http://{}", self.address);
        command.args(["worker", "--server", &url, "--slots", "2", "--name", NAMES[index]]);
        command.args([
            "--scratch",
            NAMES[index],
            "--checkpoint-every-s",
            "0",
            "--send-checkpoints-every-s",
            "0.1",
        ]);
        command.current_dir(self.folder.path());
        Running::of(command)
    }

    /// Ends the faults that last until this moment, or all of them.
    fn recover(&mut self, moment: Option<usize>) {
        let is_over = |at: &mut usize| moment.is_none_or(|moment| *at <= moment);
        for (wake, worker) in self.wake.iter_mut().zip(&self.workers) {
            if wake.take_if(is_over).is_some() {
                worker.as_ref().expect("a worker").signal(Signal::CONT);
            }
        }
        if self.link_up.take_if(is_over).is_some() {
            self.network.as_ref().expect("a network").0.link(true);
        }
    }

    /// Lets a fault happen, unless it meets a worker that sleeps or is cut off: few would be heard again.
    async fn strike(&mut self, fault: Fault, moment: usize) -> bool {
        let is_spared = match fault {
            Fault::KillWorker(index) | Fault::Sleep(index) => {
                self.wake[index].is_some() || (index == 1 && self.link_up.is_some())
            }
            Fault::LinkDown => self.wake[1].is_some() || self.link_up.is_some(),
            Fault::KillServer => false,
        };
        if is_spared {
            return false;
        }
        *self.faults.entry(fault.name()).or_default() += 1;
        match fault {
            Fault::KillServer => {
                let server = self.server.take().expect("a server");
                self.said.push(server.log());
                server.kill().await;
                self.start_server().await;
            }
            Fault::KillWorker(index) => {
                let killed = self.workers[index].take().expect("a worker");
                killed.signal(Signal::KILL);
                self.said.push(killed.ended().await.stderr);
                self.workers[index] = Some(self.worker(index));
            }
            Fault::Sleep(index) => {
                self.workers[index].as_ref().expect("a worker").signal(Signal::STOP);
                self.wake[index] = Some(moment + MOMENTS);
            }
            Fault::LinkDown => {
                self.network.as_ref().expect("a network").0.link(false);
                self.link_up = Some(moment + MOMENTS);
            }
        }
        true
    }

    /// Holds all against what is known, and ends it.
    async fn account(mut self, known: &mut Known) {
        account(&self.server().client(), &self.data_dir, known).await;
        for worker in self.workers.each_mut().into_iter().filter_map(Option::take) {
            worker.signal(Signal::TERM);
            let ended = worker.ended().await;
            assert_eq!(ended.code, Some(0), "{ended:?}");
            self.said.push(ended.stderr);
        }
        let server = self.server.take().expect("a server");
        self.said.push(server.log());
        let ends = check_ends(&server.client(), known, &self.said).await;
        server.stop().await;
        // A server that was killed between a file and its record leaves the file, until the sweep at the next start.
        swept(&self.data_dir, known).await;
        let path = self.data_dir.path().display().to_string();
        let checked = packstone(self.folder.path(), &["check", &path]).await;
        assert_eq!(checked.code, Some(0), "{checked:?}");
        println!("{:?}: {ends} ends in the logs", self.faults);
    }

    /// How often leases ran out, and ends came too late, as far as was said.
    fn lost_leases(&self) -> (usize, usize) {
        let told = |text: &str| self.said.iter().map(|log| log.matches(text).count()).sum::<usize>();
        (told("leases ran out; the jobs wait"), told("the lease was lost; this attempt leaves no"))
    }
}

async fn survive(times: usize, seed: u64, faults: &[Fault], network: Option<(Network, PathBuf)>) {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut known = Known::default();
    let mut cluster = Cluster::start(network).await;
    let (mut moment, mut struck) = (0, 0);
    while struck < times {
        let pause = Duration::from_micros(random.next_u64() % 600_000);
        let client = cluster.server().client();
        tokio::select! {
            () = order_and_watch(&client, &mut known, &mut random) => unreachable!("a client goes on for ever"),
            // Not a wait for anything: the moment of the fault is drawn.
            () = tokio::time::sleep(pause) => {}
        }
        cluster.recover(Some(moment));
        let fault = faults[random.next_u64() as usize % faults.len()];
        struck += usize::from(cluster.strike(fault, moment).await);
        moment += 1;
    }
    cluster.recover(None);
    let (out, late) = cluster.lost_leases();
    println!("{out} times leases ran out, {late} late ends");
    // By chance a few faults meet no job; many do.
    assert!(times < 300 || faults.len() == KILLS.len() || (out > 0 && late > 0), "no lease was lost");
    cluster.account(&mut known).await;
    known.print(times);
}

/// Holds what the server and the workers said against the jobs as they are: each succeeded once, by its last attempt.
/// Whoever was killed may have said less than it did. The metrics count the jobs that there are. Returns the ends that
/// were told.
async fn check_ends(client: &Client, known: &Known, said: &[String]) -> usize {
    let mut ended: HashMap<(&str, String), Vec<String>> = HashMap::new();
    for line in said.iter().flat_map(|log| log.lines()) {
        // `ended` is said by a worker, `a lease ended` by the server.
        let who = if line.contains(" a lease ended ") {
            "the server"
        } else if line.contains(": ended outcome") {
            "a worker"
        } else {
            continue;
        };
        let field = |name: &str| {
            let (_, rest) =
                line.split_once(&format!("{name}=")).unwrap_or_else(|| panic!("no {name} in {line}"));
            rest.split([' ', '}']).next().unwrap().trim_matches('"').to_owned()
        };
        if field("outcome") == "succeeded" {
            ended.entry((who, field("job_id"))).or_default().push(field("attempt"));
        }
    }
    for ((who, id), attempts) in &ended {
        let job = client.job(id).await;
        assert_eq!(attempts, &[job["attempt"].to_string()], "{who} told other ends of {job:#}");
    }
    assert!(ended.keys().all(|(_, id)| known.accepted.values().any(|known| known == id)), "{ended:?}");
    assert_eq!(client.metric("packstone_jobs{state=\"succeeded\"}").await, known.accepted.len() as f64);
    for state in ["queued", "running", "failed", "cancelled"] {
        assert_eq!(client.metric(&format!("packstone_jobs{{state=\"{state}\"}}")).await, 0.0, "{state}");
    }
    ended.len()
}
