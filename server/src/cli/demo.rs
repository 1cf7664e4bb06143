//! `packstone demo`: an example of what a client does, and a picture of the result.
//!
//! It starts the service as `packstone serve` would, on a free port of this machine, and then speaks to it over HTTP:
//! submit, follow the events, fetch the result. The picture is rendered from the result that was fetched.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Parser};
use hyper::Response;
use hyper::body::Incoming;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;

use super::exit::{Exit, Failure, cannot_be};
use super::exports::{PICTURE, write_picture};
use super::http_client::{Client, chunk, json};
use super::input::Input;
use super::outputs::refuse_existing;
use super::signals::stop_on_signals;
use super::unfinished::Unfinished;
use super::{block_on, packing_file, print_files};
use crate::atomic_file::Pieces;
use crate::config::{ServeOptions, cores};
use crate::service::Service;
use crate::telemetry::{self, LogFormat, say};

const EXAMPLE: &str = include_str!("../../../examples/a16.json");
/// That of the page is the last.
const FORMATS: [&str; 4] = ["json", "csv", "vtp", "html"];
const STEPS: f64 = 1000.0;

/// Options of `packstone demo`.
#[derive(Args)]
pub(super) struct Options {
    /// Folder for the results, the picture and the service's data; made where it is missing
    #[arg(long, default_value = "packstone-demo")]
    out: PathBuf,
    /// Overwrite the files of an earlier demo
    #[arg(long)]
    force: bool,
    /// Open the page with the packing in the browser
    #[arg(long)]
    open: bool,
}

/// The options of `packstone serve` alone, to take their defaults.
#[derive(Parser)]
struct Defaults {
    #[command(flatten)]
    serve: ServeOptions,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    telemetry::start(LogFormat::Text, "warn");
    let files: Vec<PathBuf> =
        FORMATS.iter().map(|format| options.out.join(format!("result.{format}"))).collect();
    let (picture, page) = (options.out.join(PICTURE), &files[FORMATS.len() - 1]);
    let unfinished = Unfinished::beside(&files[0]);
    let record = unfinished.read()?;
    let all: Vec<PathBuf> = files.iter().chain([&picture]).cloned().collect();
    let of_record = |file: &&PathBuf| record.as_ref().is_some_and(|record| record.names(file));
    refuse_existing(all.iter().filter(|file| !of_record(file)), options.force)?;
    std::fs::create_dir_all(&options.out).map_err(|error| cannot_be("made", &options.out, &error))?;
    unfinished.begin(&all, None)?;
    let data_dir = options.out.join("data");
    let summary = unfinished.ended(block_on(demonstrate(data_dir.clone(), &files)).and_then(|summary| {
        let stop = stop_on_signals()?;
        let packing = packing_file::read(&files[0], None, &Input::default(), cores(), &stop)?;
        write_picture(&packing.model(), &picture, cores(), &stop)?;
        Ok(summary)
    }))?;
    say(&format!(
        "Placed {} grains, volume fraction {:.4}.",
        summary["grains"],
        summary["volume_fraction_effective"].as_f64().unwrap_or(0.0)
    ));
    print_files(&all)?;
    say(&format!("\nNext: open {} in a browser, and turn and cut the packing.", page.display()));
    say("In ParaView, open the .vtp file and add a Glyph filter (glyph type Sphere, scale array");
    say("`diameter`, scale factor 1).");
    say("Or start the service, which still has this job, and open its page:");
    say(&format!("  packstone serve --data-dir {}", data_dir.display()));
    say("  http://127.0.0.1:8080");
    if options.open
        && let Err(error) = open::that_detached(page)
    {
        say(&format!("no browser was opened: {error}"));
    }
    Ok(())
}

/// Runs the service, and the job in it, whose result goes to these files, one for each of the formats; its summary.
async fn demonstrate(data_dir: PathBuf, files: &[PathBuf]) -> Result<Value, Failure> {
    let service = Service::open(ServeOptions {
        listen: ([127, 0, 0, 1], 0).into(),
        data_dir,
        api_keys_file: None,
        ..Defaults::try_parse_from(["packstone"])?.serve
    })
    .await?;
    let address = service.address()?;
    let shutdown = service.shutdown();
    let serving = tokio::spawn(service.serve());
    say(&format!("The service listens on http://{address} for the time of this demo."));
    let shown = show(Client::new(address), files).await;
    shutdown.cancel();
    serving.await??;
    shown
}

async fn show(client: Client, files: &[PathBuf]) -> Result<Value, Failure> {
    let job = json(client.post("/v1/jobs", EXAMPLE).await?).await?;
    let link = |name: &str| job["links"][name].as_str().unwrap_or_default();
    say(&format!("Submitted {} as {}.", job["name"], link("self")));
    let ended = follow(&client, link("events")).await?;
    if ended["state"] != "succeeded" {
        let text = format!("the job {}: {}", ended["state"], ended["error"]["detail"]);
        return Err(Exit::Unexpected.because(text));
    }
    for (file, format) in files.iter().zip(FORMATS) {
        save(client.get(&format!("{}?format={format}", link("result"))).await?, file).await?;
    }
    Ok(json(client.get(link("summary")).await?).await?["summary"].take())
}

/// Follows the events of a job to their end and shows its progress; the job as it ended.
async fn follow(client: &Client, events: &str) -> Result<Value, Failure> {
    let bar = progress_bar();
    let mut body = client.get(events).await?.into_body();
    let mut text = Vec::new();
    while let Some(chunk) = chunk(&mut body).await? {
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
                        format!("{}: {} {}", data["step"], data["done"], data["unit"]).replace('"', ""),
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

async fn save(response: Response<Incoming>, file: &Path) -> Result<(), Failure> {
    let failed = |error: std::io::Error| cannot_be("written", file, &error);
    let mut body = response.into_body();
    let mut out = Pieces::begin(file.to_owned()).map_err(failed)?;
    while let Some(chunk) = chunk(&mut body).await? {
        out.write(&chunk).map_err(failed)?;
    }
    out.finish().map_err(failed)
}
