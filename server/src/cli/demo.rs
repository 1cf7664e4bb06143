//! `packstone demo`: what a client does, shown on an example.
//!
//! It starts the service as `packstone serve` would, on a free port of this machine, and from then
//! on speaks to it over HTTP only: submit, follow the events, fetch the result.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Parser};
use indicatif::{ProgressBar, ProgressStyle};
use reqwest::Client;
use serde_json::Value;
use tokio::io::AsyncWriteExt as _;

use super::{Failure, block_on, print};
use crate::config::ServeOptions;
use crate::service::Service;
use crate::telemetry::{self, LogFormat};

const EXAMPLE: &str = include_str!("../../../examples/a16.json");
const FORMATS: [&str; 3] = ["json", "csv", "vtp"];
const STEPS: f64 = 1000.0;

/// Options of `packstone demo`.
#[derive(Args)]
pub(super) struct Options {
    /// Folder for the results and the service's data; made where it is missing
    #[arg(long, default_value = "packstone-demo")]
    out: PathBuf,
}

/// The options of `packstone serve` alone, to take their defaults.
#[derive(Parser)]
struct Defaults {
    #[command(flatten)]
    serve: ServeOptions,
}

pub(super) fn run(options: Options) -> Result<(), Failure> {
    telemetry::start(LogFormat::Text, "warn");
    block_on(demonstrate(options.out))
}

async fn demonstrate(out: PathBuf) -> Result<(), Failure> {
    tokio::fs::create_dir_all(&out)
        .await
        .map_err(|error| format!("{} cannot be made: {error}", out.display()))?;
    let data_dir = out.join("data");
    let service = Service::open(ServeOptions {
        listen: ([127, 0, 0, 1], 0).into(),
        data_dir: data_dir.clone(),
        api_keys_file: None,
        ..Defaults::try_parse_from(["packstone"])?.serve
    })
    .await?;
    let base = format!("http://{}", service.address()?);
    let shutdown = service.shutdown();
    let serving = tokio::spawn(service.serve());
    eprintln!("The service listens on {base} for the time of this demo.");
    let shown = show(&base, &out).await;
    shutdown.cancel();
    serving.await?;
    let (files, summary) = shown?;
    eprintln!(
        "Placed {} grains, volume fraction {:.4}.",
        summary["grains"],
        summary["volume_fraction_effective"].as_f64().unwrap_or(0.0)
    );
    for file in &files {
        print(&format!("{}\n", file.display()))?;
    }
    eprintln!(
        "\nNext: open the .vtp file in ParaView and add a Glyph filter (Sphere, scale by `diameter`, scale factor 1),"
    );
    eprintln!("or start the service yourself, with this job still in it:");
    eprintln!("  packstone serve --data-dir {}", data_dir.display());
    eprintln!("  curl http://127.0.0.1:8080/v1/jobs");
    eprintln!(
        "  curl -H 'content-type: application/json' -d @examples/a16.json http://127.0.0.1:8080/v1/jobs"
    );
    Ok(())
}

async fn show(base: &str, out: &Path) -> Result<(Vec<PathBuf>, Value), Failure> {
    // A proxy of the environment has no business between this process and itself.
    let client = Client::builder().no_proxy().build()?;
    let submitted = client
        .post(format!("{base}/v1/jobs"))
        .header("content-type", "application/json")
        .body(EXAMPLE)
        .send()
        .await?;
    let job = json(submitted).await?;
    let link = |name: &str| format!("{base}{}", job["links"][name].as_str().unwrap_or_default());
    eprintln!("Submitted {} as {}.", job["name"], link("self"));
    let ended = follow(&client, &link("events")).await?;
    if ended["state"] != "succeeded" {
        return Err(format!("the job {}: {}", ended["state"], ended["error"]["detail"]).into());
    }
    let mut files = Vec::new();
    for format in FORMATS {
        let file = out.join(format!("result.{format}"));
        let fetched = client.get(format!("{}?format={format}", link("result"))).send().await?;
        save(fetched, &file).await?;
        files.push(file);
    }
    Ok((files, ended["result"]["summary"].clone()))
}

/// Follows the events of a job to their end and shows its progress; the job as it ended.
async fn follow(client: &Client, events: &str) -> Result<Value, Failure> {
    let bar = progress_bar();
    let mut stream = client.get(events).send().await?.error_for_status()?;
    let mut text = Vec::new();
    while let Some(chunk) = stream.chunk().await? {
        text.extend_from_slice(&chunk);
        while let Some(end) = text.windows(2).position(|pair| pair == b"\n\n") {
            let block: Vec<u8> = text.drain(..end + 2).collect();
            let block = String::from_utf8_lossy(&block);
            let field = |name: &str| block.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
            let data: Value = serde_json::from_str(field("data:").unwrap_or("null"))?;
            match field("event:") {
                Some("progress") => {
                    bar.set_position((data["fraction"].as_f64().unwrap_or(0.0) * STEPS) as u64);
                    bar.set_message(
                        format!("{}: {} {}", data["phase"], data["done"], data["unit"]).replace('"', ""),
                    );
                }
                Some("end") => {
                    bar.finish_and_clear();
                    return Ok(data);
                }
                _ => {}
            }
        }
    }
    Err("the events ended before the job".into())
}

fn progress_bar() -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(STEPS as u64);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:40}] {percent} % {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

async fn json(response: reqwest::Response) -> Result<Value, Failure> {
    let status = response.status();
    let body: Value = response.json().await?;
    if status.is_success() { Ok(body) } else { Err(format!("{status}: {}", body["detail"]).into()) }
}

async fn save(response: reqwest::Response, file: &Path) -> Result<(), Failure> {
    let mut response = response.error_for_status()?;
    let failed = |error| format!("{} cannot be written: {error}", file.display());
    let mut out = tokio::fs::File::create(file).await.map_err(failed)?;
    while let Some(chunk) = response.chunk().await? {
        out.write_all(&chunk).await.map_err(failed)?;
    }
    Ok(out.flush().await.map_err(failed)?)
}
