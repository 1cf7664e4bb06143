//! Measures the Delaunay tetrahedralisation:
//! `cargo run --release -p packstone-engine --features examples --example delaunay [POINTS [CASE]]`, or prints one for
//! `docs/pictures/delaunay.py`: `... --example delaunay print POINTS`.
#![allow(clippy::unwrap_used)]

use std::time::Instant;

use packstone_engine::Unattended;
use packstone_engine::geometry::delaunay::delaunay;

/// `SplitMix64`, so that the points are the same everywhere.
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Uniform in a cube of 150 mm, a share of them on its faces, and on a lattice for a share below zero.
fn points(count: usize, on_faces: f64) -> Vec<[f64; 3]> {
    if on_faces < 0.0 {
        let side = libm::cbrt(count as f64).round() as usize;
        return (0..side.pow(3))
            .map(|i| [i % side, i / side % side, i / side / side].map(|i| i as f64 * 1.5))
            .collect();
    }
    let mut state = 1;
    (0..count)
        .map(|_| {
            let mut p = [0; 3].map(|_| 150.0 * uniform(&mut state));
            if uniform(&mut state) < on_faces {
                p[(3.0 * uniform(&mut state)) as usize] = if uniform(&mut state) < 0.5 { 0.0 } else { 150.0 };
            }
            p
        })
        .collect()
}

/// A line of `/proc/self/status`, in MB.
fn memory_mb(line: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let value = status.lines().find_map(|l| l.strip_prefix(line)).unwrap_or_default();
    value.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0.0) / 1024.0
}

/// Time of this process on a processor, which other work on the machine lengthens less than time on the clock.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let ticks = stat.rsplit(')').next().into_iter().flat_map(|rest| rest.split_whitespace().skip(11).take(2));
    ticks.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// The points, a line each, and the tetrahedra after an empty line.
fn print(points: &[[f64; 3]]) {
    let made = delaunay(points, &Unattended).unwrap();
    for [x, y, z] in points {
        println!("{x} {y} {z}");
    }
    println!();
    for [a, b, c, d] in made.nodes {
        println!("{a} {b} {c} {d}");
    }
}

fn main() {
    if std::env::args().nth(1).is_some_and(|arg| arg == "print") {
        let mut shown = points(std::env::args().nth(2).unwrap().parse().unwrap(), 0.4);
        // Corners, and nodes along the edges.
        for corner in 0..8 {
            let at = [corner & 1, corner >> 1 & 1, corner >> 2].map(|end| 150.0 * f64::from(end));
            shown.push(at);
            for axis in (0..3).filter(|&axis| at[axis] == 0.0) {
                shown.extend((1..10).map(|step| {
                    let mut on_edge = at;
                    on_edge[axis] = 15.0 * f64::from(step);
                    on_edge
                }));
            }
        }
        return print(&shown);
    }
    let count = std::env::args().nth(1).map_or(1_000_000, |arg| arg.parse().unwrap());
    let only = std::env::args().nth(2);
    for (name, on_faces) in [("uniform", 0.0), ("10 % on the faces", 0.1), ("lattice", -1.0)] {
        if only.as_ref().is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        let points = points(count, on_faces);
        let before = memory_mb("VmRSS:");
        // Forgets the peak of the case before.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        let (start, cpu) = (Instant::now(), cpu_s());
        let made = delaunay(&points, &Unattended).unwrap();
        println!(
            "{} points, {name}: {} tetrahedra in {:.2} s ({:.2} s of a processor), {:.0} MB beyond the points",
            points.len(),
            made.nodes.len(),
            start.elapsed().as_secs_f64(),
            cpu_s() - cpu,
            memory_mb("VmHWM:") - before
        );
        let cpu = cpu_s();
        let edges = made.edges().len();
        println!("  {edges} edges in {:.2} s of a processor", cpu_s() - cpu);
    }
}
