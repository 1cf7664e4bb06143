//! Packs a job and writes a mesh of it, to measure and to look at:
//! `mesh JOB.json msh|geo|stl OUT ['{"segments": 16}']`.
#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::time::Instant;

use packstone_engine::export::Model;
use packstone_engine::export::mesh::{SurfaceOptions, geo, msh, stl};
use packstone_engine::request::decode::{At, Faults};
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::Value;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [job, format, target, options @ ..] = arguments.as_slice() else {
        panic!("usage: mesh JOB.json msh|geo|stl OUT [OPTIONS]");
    };
    let job: Value = serde_json::from_str(&std::fs::read_to_string(job).unwrap()).unwrap();
    let request = PackingRequest::from_json(&job, 1).unwrap();
    let limits = Limits::default();
    let packing = pack(&request, &limits, &Unattended).unwrap();
    let model = Model::new(&request.specimen, &packing.grains);
    let options: Value = options
        .first()
        .map_or(Value::Object(serde_json::Map::new()), |text| serde_json::from_str(text).unwrap());
    let faults = Faults::default();
    let mut object = At::root(&options, &faults).object().unwrap();
    let start = Instant::now();
    let mut out = File::create(target).unwrap();
    let report = match format.as_str() {
        "msh" => {
            let options = SurfaceOptions::read(&mut object);
            object.finish();
            options.map(|o| format!("{:#?}", msh::write(&model, &o, &limits, &Unattended, &mut out).unwrap()))
        }
        "stl" => {
            let options = SurfaceOptions::read(&mut object);
            object.finish();
            options.map(|o| format!("{:#?}", stl::write(&model, &o, &limits, &Unattended, &mut out).unwrap()))
        }
        "geo" => {
            let options = geo::GeoOptions::read(&mut object);
            object.finish();
            options.map(|o| format!("{:#?}", geo::write(&model, &o, &limits, &Unattended, &mut out).unwrap()))
        }
        other => panic!("{other} is no format"),
    };
    for fault in faults.into_vec() {
        println!("{fault}");
    }
    println!("{}\n{:.3} s", report.unwrap_or_default(), start.elapsed().as_secs_f64());
}
