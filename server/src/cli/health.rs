//! `packstone health`: whether a service takes jobs, for containers and init systems without an HTTP client.

use std::io::{Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use clap::Args;

use super::{Failure, print};

/// Time for the connection and for each answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Options of `packstone health`.
#[derive(Args)]
pub(super) struct Options {
    /// Address of the service
    #[arg(default_value = "http://127.0.0.1:8080")]
    url: String,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let address = options.url.strip_prefix("http://").unwrap_or(&options.url).trim_end_matches('/');
    // The service may lie below a path.
    let (authority, below) = address.split_once('/').unwrap_or((address, ""));
    let prefix = if below.is_empty() { String::new() } else { format!("/{below}") };
    let address = authority.to_socket_addrs()?.next().ok_or("the address has no host")?;
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let request = format!("GET {prefix}/readyz HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut answer = String::new();
    stream.take(1 << 16).read_to_string(&mut answer)?;
    let status = answer.lines().next().unwrap_or_default();
    if status.split(' ').nth(1) == Some("200") {
        return print("ready\n");
    }
    let body = answer.split_once("\r\n\r\n").map_or("", |(_, body)| body);
    let problem: serde_json::Value = serde_json::from_str(body).unwrap_or_default();
    let why = problem["detail"].as_str().unwrap_or(status);
    Err(format!("{} is not ready: {why}", options.url).into())
}
