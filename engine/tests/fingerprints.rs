//! Packings of fixed seeds keep their bits from commit to commit.
//!
//! `fingerprints.json` holds requests of every method, distance rule and specimen with the CRC-32 of the packing
//! that version 0.2.0 makes of each: the little-endian bytes of the columns x, y, z and diameter. Those of random
//! sequential addition are older: commit 722a477 made them. Growth that starts at its largest scale is newer: that was
//! 0.985, and is 0.97; so is growth to the largest distance, which was not paced by the collisions left. A change that
//! alters one bit of a packing alters what a published seed means, and fails here. The sums hold on every machine.

use packstone_engine::{Limits, PackingRequest, Spheres, Unattended, pack};
use serde_json::Value;

fn fingerprint(spheres: &Spheres) -> String {
    let mut sum = crc32fast::Hasher::new();
    for column in [&spheres.x_mm, &spheres.y_mm, &spheres.z_mm, &spheres.d_mm] {
        for value in column {
            sum.update(&value.to_le_bytes());
        }
    }
    format!("{:08x}", sum.finalize())
}

#[test]
fn packings_of_fixed_seeds_keep_their_bits() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("fingerprints.json")).unwrap();
    let mut changed = Vec::new();
    for case in &cases {
        let request = PackingRequest::from_json(&case["request"], 0).unwrap();
        match pack(&request, &Limits::default(), &Unattended) {
            Ok(packing) if fingerprint(packing.spheres().unwrap()) == case["crc32"] => {}
            Ok(packing) => {
                changed.push(format!("{}: {}", case["name"], fingerprint(packing.spheres().unwrap())));
            }
            Err(error) => changed.push(format!("{}: {error}", case["name"])),
        }
    }
    assert!(cases.len() > 40 && changed.is_empty(), "{} of {}: {changed:#?}", changed.len(), cases.len());
}
