#![allow(missing_docs)]
use packstone_engine::*;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let text = std::fs::read_to_string(&a[1]).unwrap_or_else(|_| a[1].clone());
    let seeds: u64 = a.get(2).map_or(1, |s| s.parse().unwrap());
    for seed in 1..=seeds {
        let v: serde_json::Value = serde_json::from_str(&text).unwrap();
        let r = PackingRequest::from_json(&v, seed).unwrap();
        let t = Instant::now();
        match pack(&r, &Limits::default(), &Unattended) {
            Ok(p) => println!(
                "seed {seed} ok n={} phi={:.4} {:?} {:?} {:?}",
                p.spheres.len(),
                p.report.summary.volume_fraction_effective,
                p.report.timings_s,
                p.report.statistics.rsa,
                p.report.verification
            ),
            Err(e) => println!("seed {seed} {:.3}s {e}", t.elapsed().as_secs_f64()),
        }
    }
}
