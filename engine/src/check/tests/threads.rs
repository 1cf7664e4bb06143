#![allow(clippy::unwrap_used)]

//! What a check finds does not depend on its threads.

use std::num::NonZeroUsize;

use serde_json::{Value, json};

use crate::check::*;
use crate::control::{Control, Progress};
use crate::packing::{Grains, GrainsRef};
use crate::request::PackingRequest;
use crate::{Limits, Unattended, pack};

const THREADS: [usize; 4] = [1, 2, 3, 8];

/// Grains added at random, in several pieces of several octaves.
fn packed(boundary: &str, mix: &Value) -> (PackingRequest, Grains) {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [40, 40, 40], "boundary": boundary},
        "mix": mix, "method": {"type": "rsa"},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let grains = pack(&request, &Limits::default(), &Unattended).unwrap().grains;
    (request, grains)
}

fn found(grains: &Grains, request: &PackingRequest, control: &dyn Control) -> Vec<Result<Check, Fault>> {
    THREADS
        .iter()
        .map(|&threads| {
            let threads = NonZeroUsize::new(threads).unwrap();
            let known = &SieveSizes::default();
            check_grains(grains, request, Extent::WHOLE, Scope::All, known, threads, control)
        })
        .collect()
}

/// The same check, or the same fault, with every number of threads.
fn same(found: &[Result<Check, Fault>]) -> &Result<Check, Fault> {
    assert!(found.iter().all(|other| *other == found[0]), "{found:?}");
    &found[0]
}

struct Stop;

impl Control for Stop {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        true
    }
}

#[test]
fn the_check_of_spheres_is_the_same_on_any_number_of_threads() {
    let mix = json!({"grading": {"type": "fuller", "d_max_mm": 12, "exponent": 0.5}, "d_min_mm": 0.6,
        "volume_fraction": 0.55});
    for boundary in ["walls", "periodic"] {
        let (request, mut grains) = packed(boundary, &mix);
        assert!(grains.len() > 10_000);
        assert!(same(&found(&grains, &request, &Unattended)).is_ok());
        assert_eq!(same(&found(&grains, &request, &Stop)), &Err(Fault::Stopped));
        // Several grains that lie in another, in pieces of their own: the fault is that of the first piece.
        let Grains::Spheres(spheres) = &mut grains else { panic!("spheres") };
        let last = spheres.len() - 1;
        for grain in [last / 3, last / 2, last - 5, last] {
            for column in [&mut spheres.x_mm, &mut spheres.y_mm, &mut spheres.z_mm] {
                column[grain] = column[grain - 1] + 1.0e-9;
            }
        }
        let fault = same(&found(&grains, &request, &Unattended)).clone().unwrap_err();
        assert!(matches!(fault, Fault::Pair { .. }), "{fault}");
    }
}

#[test]
fn check_and_certificates_of_shapes_are_the_same_on_any_number_of_threads() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.7, "c_over_a": 0.5}});
    let polyhedron = json!({"type": "polyhedron", "template": "cube"});
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.5, "shape": ellipsoid}, {"share": 0.5, "shape": polyhedron},
    ]});
    for (boundary, shape) in [("walls", &ellipsoid), ("walls", &polyhedron), ("periodic", &mixture)] {
        let mix = json!({"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "d_min_mm": 1,
            "volume_fraction": 0.35, "shape": shape});
        let (request, mut grains) = packed(boundary, &mix);
        assert!(grains.len() > 1000, "{}", grains.len());
        assert!(same(&found(&grains, &request, &Unattended)).is_ok());
        assert_eq!(same(&found(&grains, &request, &Stop)), &Err(Fault::Stopped));
        let certified = THREADS.map(|threads| {
            let threads = NonZeroUsize::new(threads).unwrap();
            certify(GrainsRef::from(&grains), (request.distance, request.specimen), 0.3, threads, &Unattended)
                .unwrap()
        });
        assert!(certified[0].len() > 300);
        assert!(certified.iter().all(|other| *other == certified[0]));
        let Grains::Solids(solids) = &mut grains else { panic!("solids") };
        let last = solids.len() - 1;
        for grain in [last / 2, last - 5, last] {
            let near = solids.poses[grain - 1].center_mm;
            solids.poses[grain].center_mm = near.add_scalar(1.0e-9);
        }
        let fault = same(&found(&grains, &request, &Unattended)).clone().unwrap_err();
        assert!(matches!(fault, Fault::Pair { .. }), "{fault}");
    }
}
