//! What is known of spheres, against growth and the hard-sphere fluid through the public interface:
//! densest packings of a few in a cube, the pressure and structure of the fluid, what motion conserves.

use std::f64::consts::{FRAC_PI_6, PI, SQRT_2};

use packstone_engine::methods::edmd::Fluid;
use packstone_engine::packing::GrowthEnd;
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

/// Volume fraction, coating included, to which equal spheres jam in a cube.
fn jammed(spheres: usize, method: &Value, seed: u64) -> f64 {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [10, 10, 10]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": vec![1.0; spheres]}},
        "distance": {"type": "maximize"}, "method": method,
    });
    let request = PackingRequest::from_json(&value, seed).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    assert_eq!(packing.report.statistics.edmd.unwrap().stop, GrowthEnd::Stalled);
    packing.report.summary.volume_fraction_with_coating
}

/// Volume fraction of `n` spheres of a diameter in units of the cube's edge.
fn fraction(n: u32, diameter: f64) -> f64 {
    f64::from(n) * FRAC_PI_6 * diameter.powi(3)
}

/// Grows one seed after the other until one is within 1e-5 of the optimum; none may be beyond it.
fn reaches_optimum(spheres: u32, diameter: f64, method: &Value) {
    let optimum = fraction(spheres, diameter);
    let mut best = 0.0_f64;
    for seed in 0..20 {
        best = best.max(jammed(spheres as usize, method, seed));
        assert!(best <= optimum + 1e-12, "{spheres} spheres at {best}: no packing is denser than {optimum}");
        if best > optimum - 1e-5 {
            return;
        }
    }
    panic!("{spheres} spheres: {best} in the best of 20 seeds, {optimum} is possible");
}

/// Optima of Schaer (1966): centres in opposite corners, in three and four corners of a tetrahedron, and
/// in all eight, of the cube that is left to them.
#[test]
fn a_few_spheres_jam_at_their_optimum_in_a_cube() {
    let between = |distance: f64| distance / (1.0 + distance);
    let method = json!({"type": "edmd"});
    for (spheres, diameter) in
        [(1, 1.0), (2, between(3.0_f64.sqrt())), (3, between(SQRT_2)), (4, between(SQRT_2)), (8, 0.5)]
    {
        reaches_optimum(spheres, diameter, &method);
    }
}

/// Simple cubic. Up to a minute or two: `cargo test -p packstone-engine simple_cubic -- --ignored`.
#[test]
#[ignore = "takes a minute"]
fn twenty_seven_spheres_jam_as_simple_cubic() {
    reaches_optimum(27, 1.0 / 3.0, &json!({"type": "edmd"}));
}

/// Carnahan and Starling (1969): compressibility factor of the hard-sphere fluid.
fn carnahan_starling(phi: f64) -> f64 {
    (1.0 + phi + phi * phi - phi.powi(3)) / (1.0 - phi).powi(3)
}

#[test]
fn the_fluid_has_the_pressure_of_carnahan_and_starling() {
    for phi in [0.1, 0.3, 0.45] {
        let mut fluid = Fluid::new(2000, phi, 7);
        // The ratio scatters by 0.0017 at most from seed to seed (12 seeds), about means of 1.0005 to 1.0034.
        fluid.run(100_000);
        let figures = fluid.run(250_000);
        assert_eq!(figures.collisions, 250_000);
        let ratio = figures.reduced_pressure / carnahan_starling(phi);
        assert!((ratio - 1.0).abs() < 0.01, "at {phi}: {} ({ratio})", figures.reduced_pressure);
    }
}

#[test]
fn the_fluid_has_that_pressure_in_blocks_too_with_any_number_of_threads() {
    const SPHERES: usize = 41_000;
    let measured = |threads: usize| {
        let mut fluid = Fluid::new(SPHERES, 0.3, 7).with_threads(threads.try_into().unwrap());
        let energy = fluid.energy_and_momentum().0;
        fluid.run(10 * SPHERES as u64);
        let figures = fluid.run(10 * SPHERES as u64);
        assert!((fluid.energy_and_momentum().0 / energy - 1.0).abs() < 1e-9);
        (figures.collisions, figures.reduced_pressure)
    };
    let (collisions, pressure) = measured(1);
    assert!(collisions >= 10 * SPHERES as u64);
    let ratio = pressure / carnahan_starling(0.3);
    assert!((ratio - 1.0).abs() < 0.01, "{pressure} ({ratio})");
    assert_eq!(measured(3), (collisions, pressure));
}

/// Shells from contact on, in which neighbours are counted.
const SHELLS: usize = 20;
const SHELL_MM: f64 = 0.01;

/// Pairs by their distance beyond contact, in shells, of spheres of diameter 1 in a periodic cube.
fn count_shells(centers: &[[f64; 3]], edge: f64, shells: &mut [f64; SHELLS]) {
    let reach = 1.0 + SHELL_MM * SHELLS as f64;
    let cells = (edge / reach).floor() as usize;
    let cell_of = |p: [f64; 3]| p.map(|x| ((x / edge * cells as f64) as usize).min(cells - 1));
    let mut by_cell = vec![Vec::new(); cells * cells * cells];
    let index = |c: [usize; 3]| (c[2] * cells + c[1]) * cells + c[0];
    for (i, &p) in centers.iter().enumerate() {
        by_cell[index(cell_of(p))].push(i);
    }
    for (i, &p) in centers.iter().enumerate() {
        let home = cell_of(p);
        for near in 0..27 {
            let step = [near % 3, near / 3 % 3, near / 9];
            let cell: [usize; 3] = std::array::from_fn(|a| (home[a] + step[a] + cells - 1) % cells);
            for &j in by_cell[index(cell)].iter().filter(|&&j| j > i) {
                let way: [f64; 3] = std::array::from_fn(|a| {
                    let way = centers[j][a] - p[a];
                    way - edge * (way / edge).round()
                });
                let distance = way.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!(distance > 1.0 - 1e-12, "spheres {i} and {j} overlap: {distance}");
                if let Some(shell) = shells.get_mut(((distance - 1.0).max(0.0) / SHELL_MM) as usize) {
                    *shell += 1.0;
                }
            }
        }
    }
}

/// Value at 0 of the parabola that fits points best (normal equations, Cramer's rule).
fn extrapolated(points: &[(f64, f64)]) -> f64 {
    let moment = |k: i32| points.iter().map(|(x, _)| x.powi(k)).sum::<f64>();
    let target = |k: i32| points.iter().map(|(x, y)| y * x.powi(k)).sum::<f64>();
    let det = |m: [[f64; 3]; 3]| {
        let minor = |r: usize, s: usize| m[1][r] * m[2][s] - m[1][s] * m[2][r];
        m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
    };
    let row = |k: i32, first: f64| [first, moment(k + 1), moment(k + 2)];
    let of = |first: fn(i32) -> Option<i32>| {
        std::array::from_fn(|k| {
            let k = k as i32;
            row(k, first(k).map_or_else(|| target(k), moment))
        })
    };
    det(of(|_| None)) / det(of(Some))
}

#[test]
fn the_fluid_has_the_contact_value_of_carnahan_and_starling() {
    let (phi, spheres, snapshots) = (0.3, 3000, 70);
    let mut fluid = Fluid::new(spheres, phi, 11);
    fluid.run(200_000);
    let mut shells = [0.0; SHELLS];
    for _ in 0..snapshots {
        fluid.run(9_000);
        let (centers, edge) = fluid.centers_mm();
        count_shells(&centers, edge, &mut shells);
    }
    let (_, edge) = fluid.centers_mm();
    let pairs = (spheres * (spheres - 1) / 2 * snapshots) as f64;
    let points: Vec<_> = (0..SHELLS)
        .map(|shell| {
            let (from, to) = (1.0 + SHELL_MM * shell as f64, 1.0 + SHELL_MM * (shell + 1) as f64);
            let ideal = pairs * 4.0 / 3.0 * PI * (to.powi(3) - from.powi(3)) / edge.powi(3);
            (SHELL_MM * (shell as f64 + 0.5), shells[shell] / ideal)
        })
        .collect();
    let contact = extrapolated(&points);
    let expected = (1.0 - phi / 2.0) / (1.0 - phi).powi(3);
    assert!((contact / expected - 1.0).abs() < 0.02, "{contact} instead of {expected}");
    // The virial theorem ties it to the pressure.
    let pressure = fluid.run(300_000).reduced_pressure;
    assert!(
        ((1.0 + 4.0 * phi * contact) / pressure - 1.0).abs() < 0.02,
        "{contact} at a pressure of {pressure}"
    );
}

#[test]
fn the_fluid_keeps_its_energy_and_momentum() {
    let mut fluid = Fluid::new(1000, 0.4, 3);
    let (energy, _) = fluid.energy_and_momentum();
    let (mut drift, mut momentum) = (0.0_f64, 0.0_f64);
    for _ in 0..20 {
        fluid.run(25_000);
        let (now, sums) = fluid.energy_and_momentum();
        drift = drift.max((now / energy - 1.0).abs());
        momentum = sums.iter().fold(momentum, |most, p| most.max(p.abs()));
    }
    assert!(drift < 1e-12, "energy drifts by {drift:e}");
    // A thousand spheres of speeds near 1, none of whose sums is ever more than rounding.
    assert!(momentum < 1e-11, "momentum of {momentum:e}");
}
