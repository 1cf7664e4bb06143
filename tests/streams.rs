//! A service whose streams and log files are closed, full, or read by nobody goes on and ends in good order.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::harness::deadline::{eventually, patiently, within};
use crate::harness::machine::port;
use crate::harness::{Client, DataDir, Launch, id_of, jobs};

/// A service whose output nobody follows.
struct Unread {
    child: Child,
    client: Client,
}

impl Unread {
    /// Starts a command that says where it listens on standard output.
    fn start(mut command: Command) -> Self {
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().rsplit_once("http://").unwrap().1.parse().unwrap();
        Self { child, client: Client::new(address) }
    }

    /// Asks it to end, and waits for its end with success.
    async fn stop(mut self) {
        kill_process(Pid::from_child(&self.child), Signal::TERM).unwrap();
        let mut ended = None;
        within(Duration::from_secs(15), "the server to end", async {
            while ended.is_none() {
                ended = self.child.try_wait().unwrap();
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        })
        .await;
        assert!(ended.unwrap().success(), "{ended:?}");
    }
}

impl Drop for Unread {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The value of a counter in the metrics.
async fn counted(client: &Client, name: &str) -> u64 {
    let metrics = client.get("/metrics").send().await.expect(200).body.clone();
    let text = String::from_utf8(metrics.to_vec()).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("{name} is not in {text}")).parse().unwrap()
}

#[tokio::test]
async fn a_log_that_nobody_reads_holds_up_no_request_and_loses_counted_lines() {
    let data_dir = DataDir::new();
    let mut command = Launch::new(&data_dir).env("PACKSTONE_LOG", "trace").into_command();
    command.stderr(Stdio::piped());
    let server = Unread::start(command);
    // The pipe holds 64 KiB and the queue 4 MiB.
    patiently("lines to be lost", async {
        while counted(&server.client, "packstone_log_lines_lost_total").await == 0 {
            let begin = Instant::now();
            server.client.get("/v1/jobs").send().await.expect(200);
            assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
        }
    })
    .await;
    server.client.succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_log_on_a_full_disk_ends_nothing_and_its_lines_are_counted() {
    let data_dir = DataDir::new();
    let mut command = Launch::new(&data_dir).env("PACKSTONE_LOG", "info").into_command();
    command.stderr(File::options().write(true).open("/dev/full").unwrap());
    let server = Unread::start(command);
    server.client.succeed(&jobs::quick(1)).await;
    assert!(counted(&server.client, "packstone_log_lines_lost_total").await > 0);
    server.stop().await;
}

#[tokio::test]
async fn a_service_without_standard_output_and_error_serves() {
    let (data_dir, port) = (DataDir::new(), port());
    let address = format!("127.0.0.1:{port}");
    let launch = Launch::new(&data_dir).listen(&address).env("PACKSTONE_LOG", "debug").into_command();
    let mut command = Command::new("bash");
    command
        .args(["-c", "exec \"$@\" >&- 2>&- <&-", "bash"])
        .arg(launch.get_program())
        .args(launch.get_args());
    command.envs(launch.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let child = command.spawn().unwrap();
    let server = Unread { child, client: Client::new(address.parse().unwrap()) };
    eventually("the server to listen", || std::net::TcpStream::connect(&address).is_ok()).await;
    let job = server.client.succeed(&jobs::quick(1)).await;
    server.client.get(&format!("/v1/jobs/{}/result", id_of(&job))).send().await.expect(200);
    server.stop().await;
}

fn make_pipe(path: &Path) {
    rustix::fs::mknodat(rustix::fs::CWD, path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
}

#[tokio::test]
async fn an_audit_log_that_nobody_reads_holds_up_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("audit");
    make_pipe(&pipe);
    // One that nobody has opened, then one that somebody has opened and does not read.
    for opened in [false, true] {
        let reader = opened.then(|| File::options().read(true).write(true).open(&pipe).unwrap());
        let data_dir = DataDir::new();
        let server =
            Launch::new(&data_dir).workers(0).args(&["--audit-log", pipe.to_str().unwrap()]).start().await;
        let client = server.client();
        let begin = Instant::now();
        // Each line has about 300 bytes, and the pipe holds 64 KiB.
        for seed in 0..400 {
            client.submit(&jobs::quick(seed)).await;
        }
        assert!(begin.elapsed() < Duration::from_mins(1), "{:?}", begin.elapsed());
        server.terminate();
        let log = server.log_at_end().await;
        assert!(log.contains("the audit log takes no lines"), "{log}");
        drop(reader);
    }
}

#[tokio::test]
async fn an_audit_log_on_a_full_disk_holds_up_no_answer_and_its_lines_are_counted() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--audit-log", "/dev/full"]).start().await;
    for seed in 0..3 {
        server.client().submit(&jobs::quick(seed)).await;
    }
    assert_eq!(counted(&server.client(), "packstone_audit_lines_lost_total").await, 3);
    server.stop().await;
}

#[tokio::test]
async fn lines_of_the_audit_log_that_wait_are_written_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("audit");
    make_pipe(&pipe);
    let data_dir = DataDir::new();
    let server =
        Launch::new(&data_dir).workers(0).args(&["--audit-log", pipe.to_str().unwrap()]).start().await;
    for seed in 0..5 {
        server.client().submit(&jobs::quick(seed)).await;
    }
    let read = tokio::task::spawn_blocking(move || std::fs::read_to_string(pipe).unwrap());
    server.stop().await;
    let lines = patiently("the lines", read).await.unwrap();
    assert_eq!(lines.lines().filter(|line| line.contains("\"submit_job\"")).count(), 5, "{lines}");
}
