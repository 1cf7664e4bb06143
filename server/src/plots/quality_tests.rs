use packstone_engine::packing::Spheres;
use serde_json::{Value, json};

use super::*;
use crate::jobs::JobRequest;
use crate::plots::chart::SeriesStyle;
use crate::plots::draw;

fn request(specimen: &Value) -> PackingRequest {
    let job = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 4, "exponent": 0.5}, "d_min_mm": 2, "volume_fraction": 0.3}
    });
    JobRequest::read(&job, 0, None).unwrap().packing()
}

/// A cubic lattice of 5 mm with these diameters.
fn lattice(d_mm: impl Fn(usize) -> f64) -> Grains {
    let mut grains: Vec<([f64; 3], f64)> =
        (0..512).map(|i| ([i % 8, i / 8 % 8, i / 64].map(|x| 5.0 * x as f64 + 2.5), d_mm(i))).collect();
    grains.sort_by(|p, q| q.1.total_cmp(&p.1));
    let mut spheres = Spheres::default();
    for (center, d) in grains {
        spheres.push(center, d);
    }
    Grains::Spheres(spheres)
}

/// The marks of a chart that can be shown and are no reference.
fn shown(chart: &Chart) -> Vec<[f64; 2]> {
    let series = chart.series.iter().filter(|series| series.style != SeriesStyle::Reference);
    series.flat_map(|series| &series.points).filter(|point| chart.shows(point)).map(|p| [p.x, p.y]).collect()
}

#[test]
fn only_charts_with_data_are_drawn() {
    let walls = json!({"type": "box", "size_mm": [40, 40, 40]});
    let periodic = json!({"type": "box", "size_mm": [40, 40, 40], "boundary": "periodic"});
    // Sizes that differ by less than the gap of near pairs.
    let mixed = |i: usize| 4.9 + 0.02 * (i % 7) as f64;
    for (specimen, grains, labels) in [
        (&walls, lattice(mixed), &["distance from", "ratio of", "coherent bonds"][..]),
        (&periodic, lattice(mixed), &["ratio of", "coherent bonds"]),
        (&walls, lattice(|_| 4.9), &["distance from", "coherent bonds"]),
    ] {
        let chart = chart(&request(specimen), &grains, Some("TB-7")).unwrap();
        let found: Vec<&str> = chart.panels().map(|panel| panel.x.label.as_str()).collect();
        assert_eq!(found.len(), labels.len(), "{found:?}");
        for (found, label) in found.iter().zip(labels) {
            assert!(found.starts_with(label), "{found} {label}");
        }
        // A simple cubic crystal: all grains have 6 coherent bonds in a periodic box.
        let bonds = chart.panels().last().unwrap();
        if *specimen == periodic {
            assert!(shown(bonds).contains(&[6.0, 100.0]), "{bonds:?}");
        }
        let drawn = draw::svg(&chart, true).unwrap();
        for panel in chart.panels() {
            assert!(drawn.contains(&format!("\n{}\n</text>", panel.x.label)), "{drawn}");
        }
        assert_eq!(drawn.matches("Quality of the packing: TB-7").count(), 2);
    }
    let alone = Grains::Spheres(Spheres {
        x_mm: vec![20.0],
        y_mm: vec![20.0],
        z_mm: vec![20.0],
        d_mm: vec![3.0],
        aggregate: Vec::new(),
    });
    let chart = chart(&request(&periodic), &alone, None).unwrap();
    assert!(chart.is_empty() && chart.when_empty.contains("a `quality`"));
}
