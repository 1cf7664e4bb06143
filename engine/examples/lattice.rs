//! Packs a mix, makes its lattice, writes all files, and says how long each took and
//! what the checks found:
//!
//!     cargo run --release -p packstone-engine --features examples --example lattice -- edge=200 [KEY=VALUE ...]
//!
//! A Fuller mix of 2 to 16 mm, 60 % by volume, in a cube of that edge or, with `shape=cylinder`, in a cylinder of that
//! diameter and twice its height. Grains keep the clearance that the documentation recommends, or none with
//! `clearance=0`. `threads=N` check it and write them. The files go to the directory `out=...`, or nowhere. All other
//! keys are options of the lattice.

use std::error::Error;
use std::fs::File;
use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use packstone_engine::export::Model;
use packstone_engine::export::ldpm::{self, Lattice, LatticeOptions};
use packstone_engine::request::decode::{At, Faults};
use packstone_engine::{Limits, PackingRequest, Unattended, geometry::delaunay, pack};
use serde_json::{Value, json};

/// Counts what it passes on.
struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Time that the threads of this process had a processor, where the kernel tells; those that ended too.
fn processor_s() -> f64 {
    let told = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = told.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: f64 = fields.skip(11).take(2).map(|ticks| ticks.parse().unwrap_or(f64::NAN)).sum();
    ticks / 100.0
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut keys: serde_json::Map<String, Value> = std::env::args()
        .skip(1)
        .map(|argument| {
            let (key, value) = argument.split_once('=').ok_or("arguments are KEY=VALUE")?;
            Ok((key.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| value.into())))
        })
        .collect::<Result<_, Box<dyn Error>>>()?;
    let edge = keys.remove("edge").and_then(|edge| edge.as_f64()).ok_or("edge=MM is missing")?;
    let directory = keys.remove("out").and_then(|out| Some(PathBuf::from(out.as_str()?)));
    let threads = keys.remove("threads").and_then(|threads| NonZeroUsize::new(threads.as_u64()? as usize));
    let threads = threads.unwrap_or(NonZeroUsize::MIN);
    let specimen = match keys.remove("shape") {
        Some(_) => json!({"type": "cylinder", "diameter_mm": edge, "height_mm": 2.0 * edge}),
        None => json!({"type": "box", "size_mm": [edge, edge, edge]}),
    };
    let distance = match keys.remove("clearance") {
        Some(_) => json!({"type": "none"}),
        None => json!({"type": "constant", "gap_mm": 0.4, "wall_gap_mm": 1.1}),
    };
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16.0, "exponent": 0.5}, "d_min_mm": 2.0, "volume_fraction": 0.6},
        "distance": distance,
    });
    let request = PackingRequest::from_json(&request, 1).map_err(|faults| format!("{faults:?}"))?;
    let (faults, keys) = (Faults::default(), Value::Object(keys));
    let options = At::root(&keys, &faults).object().and_then(|mut object| {
        let options = LatticeOptions::read(&mut object);
        object.finish();
        options
    });
    let Some(options) = options.filter(|_| faults.count() == 0) else {
        return Err(format!("{:?}", faults.into_vec()).into());
    };
    let grains = pack(&request, &Limits::default(), &Unattended)?.grains;

    let mut since = (Instant::now(), processor_s());
    let mut lap = |what: &str, more: &str| {
        let now = (Instant::now(), processor_s());
        let clock_s = (now.0 - since.0).as_secs_f64();
        println!("{what:<20} {clock_s:7.2} s, {:6.2} s of a processor  {more}", now.1 - since.1);
        since = now;
    };
    let model = Model::new(&request.specimen, &grains);
    let limits = Limits { export_threads: threads, ..Limits::default() };
    let lattice = Lattice::make(&model, &options, &limits, &Unattended)?;
    lap("lattice with checks", "");
    let nodes = lattice.nodes().points_mm.clone();
    delaunay::delaunay(&nodes, &Unattended)?;
    lap("of it, Delaunay", "");
    for file in [
        ldpm::LatticeFormat::Chrono,
        ldpm::LatticeFormat::Tets,
        ldpm::LatticeFormat::Facets,
        ldpm::LatticeFormat::Cells,
    ] {
        let out: Box<dyn Write> = match &directory {
            Some(directory) => Box::new(File::create(
                directory.join(format!("{file:?}.{}", file.extension()).to_lowercase()),
            )?),
            None => Box::new(io::sink()),
        };
        let mut out = Counted { out, bytes: 0 };
        let options = LatticeOptions { format: file, ..options.clone() };
        lattice.write(&options, None, threads, &Unattended, &mut out)?;
        lap(&format!("{file:?}"), &format!("{:.1} MB", out.bytes as f64 / 1e6));
    }
    println!("{}", serde_json::to_string_pretty(lattice.report())?);
    Ok(())
}
