#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Mutex;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::control::Progress;
use crate::export::Provenance;
use crate::packing::Spheres;
use crate::request::Materials;
use crate::request::decode::{At, Faults};
use crate::{PackingRequest, Unattended, pack};

pub(super) fn read(format: VoxelFormat, value: &Value) -> Result<VoxelOptions, Vec<String>> {
    let mut value = value.clone();
    value["format"] = json!(format);
    let value = &value;
    let faults = Faults::default();
    let mut object = At::root(value, &faults).object().unwrap();
    let options = VoxelOptions::read(&mut object);
    object.finish();
    let faults: Vec<String> = faults.into_vec().iter().map(ToString::to_string).collect();
    if faults.is_empty() { Ok(options.unwrap()) } else { Err(faults) }
}

pub(super) fn written(model: &Model<'_>, format: VoxelFormat, options: &Value) -> (VoxelReport, Vec<u8>) {
    let mut bytes = Vec::new();
    let options = read(format, options).unwrap();
    let report = options.write(model, &Limits::default(), &Unattended, &mut bytes).unwrap();
    (report, bytes)
}

fn packed(specimen: &Value) -> (Specimen, Spheres) {
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "volume_fraction": 0.5},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    (request.specimen, pack(&request, &Limits::default(), &Unattended).unwrap().into_spheres().unwrap())
}

fn specimens() -> [Value; 3] {
    [
        json!({"type": "box", "size_mm": [30, 25, 20]}),
        json!({"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"}),
        json!({"type": "cylinder", "diameter_mm": 20, "height_mm": 26}),
    ]
}

/// The label of a point by looking at all grains; `None` where it is too near to a surface to say.
fn label_at(specimen: &Specimen, spheres: &Spheres, p: [f64; 3]) -> Option<u32> {
    const NEAR: f64 = 1e-9;
    if let Specimen::Cylinder { diameter_mm, .. } = specimen {
        let radius = diameter_mm / 2.0;
        let beyond = (p[0] - radius).hypot(p[1] - radius) - radius;
        if beyond.abs() < NEAR {
            return None;
        }
        if beyond > 0.0 {
            return Some(u32::MAX);
        }
    }
    let bounds = specimen.bounds_mm();
    let mut label = 0;
    for i in 0..spheres.len() {
        let center = spheres.center(i);
        let difference: [f64; 3] = std::array::from_fn(|a| {
            let d = (center[a] - p[a]).abs();
            if specimen.is_periodic() { d.min(bounds[a] - d) } else { d }
        });
        let distance = difference.iter().map(|d| d * d).sum::<f64>().sqrt() - spheres.d_mm[i] / 2.0;
        if distance.abs() < NEAR {
            return None;
        }
        if distance < 0.0 {
            label = i as u32 + 1;
        }
    }
    Some(label)
}

#[test]
fn every_voxel_has_the_label_of_its_centre() {
    for specimen in specimens() {
        let (specimen, spheres) = packed(&specimen);
        let model = Model::new(&specimen, &spheres);
        let (report, bytes) = written(&model, VoxelFormat::Raw, &json!({"label": "grain", "cells": 37}));
        let [nx, ny, nz] = report.shape.map(|n| n as usize);
        let labels: Vec<u32> = bytes.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(labels.len(), nx * ny * nz);
        let (mut compared, mut aggregate, mut inside) = (0, 0, 0);
        for (at, label) in labels.iter().enumerate() {
            let place = [at % nx, at / nx % ny, at / nx / ny];
            let p = std::array::from_fn(|a| (place[a] as f64 + 0.5) * report.spacing_mm[a]);
            if let Some(expected) = label_at(&specimen, &spheres, p) {
                assert_eq!(*label, expected, "{specimen:?} at {p:?}");
                compared += 1;
            }
            inside += u64::from(*label != u32::MAX);
            aggregate += u64::from(*label != u32::MAX && *label != 0);
        }
        assert!(compared > labels.len() * 99 / 100);
        assert_eq!((report.inside_voxels, report.aggregate_voxels), (inside, aggregate));
        let seen: BTreeSet<u32> = labels.iter().copied().filter(|l| *l != u32::MAX && *l != 0).collect();
        assert_eq!(report.grains_without_voxel, (spheres.len() - seen.len()) as u64);
        // The phases are those of the grains.
        let (_, phases) = written(&model, VoxelFormat::Raw, &json!({"cells": 37}));
        let phase = |label: u32| if label == u32::MAX { 2 } else { label.min(1) as u8 };
        assert_eq!(phases, labels.iter().map(|l| phase(*l)).collect::<Vec<_>>());
    }
}

#[test]
fn labels_and_shares_measure_the_volume() {
    for specimen in specimens() {
        let (specimen, spheres) = packed(&specimen);
        let model = Model::new(&specimen, &spheres);
        let (report, _) = written(&model, VoxelFormat::Raw, &json!({"cells": 40}));
        let error = |fraction: f64| (fraction / report.volume_fraction - 1.0).abs();
        assert!(error(report.volume_fraction_labels) < 0.02, "{report:?}");
        assert!(error(report.volume_fraction_samples) < 1e-3, "{report:?}");
    }
}

/// The appended array of that name.
fn appended<'a>(bytes: &'a [u8], name: &str) -> &'a [u8] {
    let data = bytes.windows(2).position(|pair| pair == b" _").unwrap() + 2;
    let text = String::from_utf8_lossy(&bytes[..data]);
    let tag = text.split("<DataArray").find(|tag| tag.contains(&format!("Name=\"{name}\""))).unwrap();
    let offset: usize = tag.split("offset=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
    let at = data + offset;
    let size = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    &bytes[at + 8..at + 8 + size]
}

fn provenance() -> Provenance {
    Provenance {
        job_id: Some("j".into()),
        name: None,
        seed: Some(17),
        engine_version: "1".into(),
        volume_fraction_mixture: 0.5,
        volume_fraction_effective: 0.25,
        aggregates: Vec::new(),
        result_sha256: Some("ab".into()),
    }
}

#[test]
fn image_data_says_where_it_comes_from() {
    let (specimen, spheres) = packed(&specimens()[0]);
    let provenance = provenance();
    let plain = Model::new(&specimen, &spheres);
    let (report, without) = written(&plain, VoxelFormat::Vti, &json!({"cells": 5}));
    let (same, bytes) = written(&plain.with_provenance(&provenance), VoxelFormat::Vti, &json!({"cells": 5}));
    assert_eq!(report, same);
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let fields = r#"    <FieldData>
      <DataArray type="String" Name="job_id" NumberOfTuples="1" format="ascii">106 0</DataArray>
      <DataArray type="String" Name="engine_version" NumberOfTuples="1" format="ascii">49 0</DataArray>
      <DataArray type="String" Name="result_sha256" NumberOfTuples="1" format="ascii">97 98 0</DataArray>
      <DataArray type="UInt64" Name="seed" NumberOfTuples="1" format="ascii">17</DataArray>
      <DataArray type="Float64" Name="volume_fraction_mixture" NumberOfTuples="1" format="ascii">0.5</DataArray>
      <DataArray type="Float64" Name="volume_fraction_effective" NumberOfTuples="1" format="ascii">0.25</DataArray>
    </FieldData>
"#;
    assert_eq!(text.replacen(fields, "", 1), String::from_utf8_lossy(&without));
}

/// Packed grains as those of three aggregates, the second without a grain.
fn of_three_aggregates(specimen: &Value) -> (Specimen, Spheres) {
    let (specimen, mut spheres) = packed(specimen);
    spheres.aggregate = (0..spheres.len()).map(|row| if row % 3 == 0 { 2 } else { 0 }).collect();
    (specimen, spheres)
}

#[test]
fn labels_of_aggregates_are_those_of_their_grains() {
    for specimen in specimens() {
        let (specimen, spheres) = of_three_aggregates(&specimen);
        let provenance =
            Provenance { aggregates: vec![Some("gravel 4/8".into()), None, None], ..provenance() };
        let model = Model::new(&specimen, &spheres).with_provenance(&provenance);
        let (_, grains) = written(&model, VoxelFormat::Raw, &json!({"label": "grain", "cells": 37}));
        let (report, labels) = written(&model, VoxelFormat::Raw, &json!({"label": "aggregate", "cells": 37}));
        let mut counts = [0; 3];
        for (grain, label) in grains.chunks_exact(4).zip(&labels) {
            let expected = match u32::from_le_bytes(grain.try_into().unwrap()) {
                0 => 0,
                u32::MAX => 255,
                id => spheres.aggregate[id as usize - 1] as u8 + 1,
            };
            assert_eq!(*label, expected);
            if (1..255).contains(label) {
                counts[usize::from(*label) - 1] += 1;
            }
        }
        assert!(counts[0] > counts[2] && counts[2] > 0, "{counts:?}");
        assert_eq!(report.dtype.as_deref(), Some("|u1"));
        let named: Vec<(u32, &str, u64)> =
            report.aggregates.iter().map(|of| (of.label, of.name.as_str(), of.voxels)).collect();
        let names = ["aggregate_1_gravel_4_8", "aggregate_2", "aggregate_3"];
        assert_eq!(named, [(1, names[0], counts[0]), (2, names[1], 0), (3, names[2], counts[2])]);
        assert_eq!(report.aggregates.iter().map(|of| of.grains).sum::<u64>(), spheres.len() as u64);
        let (_, vti) = written(&model, VoxelFormat::Vti, &json!({"label": "aggregate", "cells": 37}));
        assert!(vti.windows(labels.len()).any(|bytes| bytes == labels));
        // Without aggregates, all grains are one.
        let plain = Spheres { aggregate: Vec::new(), ..spheres };
        let model = Model::new(&specimen, &plain);
        let (report, labels) = written(&model, VoxelFormat::Raw, &json!({"label": "aggregate", "cells": 37}));
        assert!(report.aggregates.is_empty() && labels.iter().all(|label| [0, 1, 255].contains(label)));
    }
}

#[test]
fn hexahedra_of_aggregates_are_sets_beside_those_of_the_phases() {
    for specimen in specimens() {
        let (specimen, spheres) = of_three_aggregates(&specimen);
        let (report, bytes) =
            written(&Model::new(&specimen, &spheres), VoxelFormat::Inp, &json!({"cells": 19}));
        let text = String::from_utf8(bytes).unwrap();
        let plain = Spheres { aggregate: Vec::new(), ..spheres.clone() };
        let (of_plain, bytes) =
            written(&Model::new(&specimen, &plain), VoxelFormat::Inp, &json!({"cells": 19}));
        let (_, labels) = written(
            &Model::new(&specimen, &spheres),
            VoxelFormat::Raw,
            &json!({"cells": 19, "label": "aggregate"}),
        );
        let mut rest = text.clone();
        for (label, name) in [(1, "aggregate_1"), (3, "aggregate_3")] {
            let head = format!("*ELSET, ELSET={name}\n");
            let start = rest.find(&head).unwrap();
            let end = start + head.len() + rest[start + head.len()..].find('*').unwrap();
            let lines = &rest[start + head.len()..end];
            assert!(lines.lines().all(|line| line.split(',').count() <= 16));
            let numbers: Vec<usize> =
                lines.split([',', '\n']).filter(|n| !n.is_empty()).map(|n| n.parse().unwrap()).collect();
            let expected: Vec<usize> =
                (1..).zip(&labels).filter(|(_, of)| **of == label).map(|(n, _)| n).collect();
            assert_eq!(numbers, expected);
            assert_eq!(report.aggregates[usize::from(label) - 1].voxels, expected.len() as u64);
            rest.replace_range(start..end, "");
        }
        assert!(!text.contains("aggregate_2"));
        assert_eq!(rest, String::from_utf8(bytes).unwrap());
        assert_eq!(report.aggregate_voxels, of_plain.aggregate_voxels);
    }
}

#[test]
fn fractions_are_those_of_finer_labels() {
    for specimen in specimens() {
        let (specimen, spheres) = packed(&specimen);
        let model = Model::new(&specimen, &spheres);
        let options = json!({"voxel_mm": 1.0, "label": "phase", "fractions": true, "samples": 8});
        let (report, bytes) = written(&model, VoxelFormat::Vti, &options);
        let shares: Vec<f32> = appended(&bytes, "fraction")
            .chunks(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        let labels = appended(&bytes, "label");
        assert_eq!(
            (shares.len(), labels.len()),
            (labels.len(), report.shape.iter().product::<u64>() as usize)
        );
        let (_, fine) = written(&model, VoxelFormat::Raw, &json!({"voxel_mm": 0.125}));
        let [nx, ny, _] = report.shape.map(|n| n as usize);
        let mut sums = vec![0_u32; shares.len()];
        for (at, phase) in fine.iter().enumerate() {
            let [x, y, z] = [at % (8 * nx), at / (8 * nx) % (8 * ny), at / (64 * nx * ny)];
            sums[x / 8 + nx * (y / 8 + ny * (z / 8))] += u32::from(*phase == 1);
        }
        for (share, sum) in shares.iter().zip(&sums) {
            assert!((0.0..=1.0).contains(share));
            // Chords are exact here and counted by whole eighths there.
            assert!((f64::from(*share) - f64::from(*sum) / 512.0).abs() < 0.05, "{share} {sum}");
        }
        // What is full or empty is so exactly.
        assert!(shares.contains(&1.0) && shares.contains(&0.0));
        // Written or not, the volume is the same.
        let (without, _) = written(&model, VoxelFormat::Vti, &json!({"voxel_mm": 1.0, "samples": 8}));
        let ratio = report.volume_fraction_samples / without.volume_fraction_samples;
        assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
    }
}

#[test]
fn voxels_are_as_near_to_cubes_as_the_specimen_allows() {
    let specimen = Specimen::Box { size_mm: [100.0, 33.0, 0.2], boundary: crate::request::Boundary::Walls };
    let spheres = Spheres::default();
    let model = Model::new(&specimen, &spheres);
    let (report, bytes) = written(&model, VoxelFormat::Raw, &json!({"cells": 50}));
    assert_eq!(report.shape, [50, 17, 1]);
    assert_eq!(report.spacing_mm, [2.0, 33.0 / 17.0, 0.2]);
    assert_eq!((report.dtype.as_deref(), report.outside_label), (Some("|u1"), None));
    assert_eq!(bytes, vec![0; 850]);
    assert_eq!((report.volume_fraction, report.volume_fraction_labels), (0.0, 0.0));
    let (report, _) = written(&model, VoxelFormat::Raw, &json!({"voxel_mm": 30}));
    assert_eq!(report.shape, [3, 1, 1]);
}

#[test]
fn options_have_defaults_and_bounds() {
    let options = read(VoxelFormat::Vti, &json!({})).unwrap();
    assert_eq!((options.cells, options.voxel_mm, options.samples), (Some(100), None, 4));
    assert_eq!((options.label, options.fractions), (Label::Phase, false));
    assert_eq!(read(VoxelFormat::Raw, &json!({"voxel_mm": 0.5})).unwrap().cells, None);
    let faults = read(
        VoxelFormat::Vti,
        &json!({"cells": 0, "voxel_mm": -1, "label": "colour", "fractions": "no", "samples": 17}),
    );
    assert_eq!(
        faults.unwrap_err(),
        [
            "/cells: 0 is out of range: must be a whole number from 1 to 8192",
            "/voxel_mm: -1 is out of range: must be greater than 0 and at most 1000000 mm",
            "/label: \"colour\" is unknown: must be one of \"phase\", \"grain\", \"aggregate\"",
            "/fractions: \"no\" is not true or false",
            "/samples: 17 is out of range: must be a whole number from 1 to 16",
        ]
    );
    assert_eq!(
        read(VoxelFormat::Inp, &json!({"cells": 9, "voxel_mm": 1, "label": "grain", "fractions": true}))
            .unwrap_err(),
        [
            "/voxel_mm: cells and voxel_mm say the same: leave one of them out",
            "/label: unknown field: this object has format, cells, voxel_mm, samples",
            "/fractions: unknown field",
        ]
    );
}

#[test]
fn what_is_too_large_says_what_it_would_take() {
    let specimen = Specimen::Box { size_mm: [150.0; 3], boundary: crate::request::Boundary::Walls };
    let refused = |format: VoxelFormat, options: Value| {
        let limits = Limits { max_voxel_file_bytes: 1_000_000_000, ..Limits::default() };
        read(format, &options).unwrap().check(&specimen, &limits).unwrap_err().to_string()
    };
    assert_eq!(
        refused(VoxelFormat::Vti, json!({"cells": 1000, "label": "grain", "fractions": true})),
        "/cells: 1000 x 1000 x 1000 voxels are a file of 8000 MB: at most 1000 MB may be made"
    );
    assert_eq!(
        refused(VoxelFormat::Raw, json!({"voxel_mm": 0.05})),
        "/voxel_mm: 3000 x 3000 x 3000 voxels are 27000000000 in all, a file of 27000 MB: at most 4000000000 are made"
    );
    assert_eq!(
        refused(VoxelFormat::Raw, json!({"voxel_mm": 1e-6})),
        "/voxel_mm: 150000000 x 150000000 x 150000000 voxels are 150000000 along an edge: at most 8192 are made"
    );
    let hexahedra = refused(VoxelFormat::Inp, json!({"cells": 300}));
    assert!(
        hexahedra.starts_with("/cells: 300 x 300 x 300 voxels are 27000000 in all, a file of "),
        "{hexahedra}"
    );
    assert!(hexahedra.ends_with("at most 20000000 are made"), "{hexahedra}");
    let limits = Limits { max_voxel_file_bytes: 1_000_000_000, ..Limits::default() };
    read(VoxelFormat::Raw, &json!({"cells": 1000})).unwrap().check(&specimen, &limits).unwrap();
}

/// An Abaqus file's keywords, each with its lines.
fn keywords(text: &str) -> Vec<(&str, Vec<&str>)> {
    let mut found: Vec<(&str, Vec<&str>)> = Vec::new();
    for line in text.lines().filter(|line| !line.starts_with("**")) {
        if line.starts_with('*') {
            found.push((line, Vec::new()));
        } else {
            found.last_mut().unwrap().1.push(line);
        }
    }
    found
}

#[test]
fn hexahedra_sets_and_surfaces_are_those_of_the_voxels() {
    for specimen in specimens() {
        let (specimen, spheres) = packed(&specimen);
        let model = Model::new(&specimen, &spheres);
        let options = json!({"cells": 13});
        let (report, bytes) = written(&model, VoxelFormat::Inp, &options);
        let (_, labels) = written(&model, VoxelFormat::Raw, &options);
        let grid = VoxelGrid::new(&specimen, &read(VoxelFormat::Inp, &options).unwrap());
        let most = inp::bytes(&grid, &Interfaces::MOST);
        assert!((bytes.len() as u64) < most && most < 2 * bytes.len() as u64, "{} {most}", bytes.len());
        let text = String::from_utf8(bytes).unwrap();
        let keywords = keywords(&text);
        let lines = |keyword: &str| {
            let mut found = keywords.iter().filter(|(name, _)| *name == keyword);
            let lines = found.next().unwrap_or_else(|| panic!("{keyword} is missing")).1.clone();
            assert!(found.next().is_none(), "{keyword} comes twice");
            lines
        };
        let numbers = |line: &str| -> Vec<u64> { line.split(',').map(|n| n.parse().unwrap()).collect() };
        let nodes: BTreeMap<u64, [f64; 3]> = lines("*NODE")
            .iter()
            .map(|line| {
                let mut cells = line.split(',');
                let id = cells.next().unwrap().parse().unwrap();
                (id, std::array::from_fn(|_| cells.next().unwrap().parse().unwrap()))
            })
            .collect();
        // Elements lie where their number says, and have that voxel's phase.
        let mut used = BTreeSet::new();
        let mut elements = 0;
        for (phase, name) in [(0, "matrix"), (1, "aggregates")] {
            for line in lines(&format!("*ELEMENT, TYPE=C3D8, ELSET={name}")) {
                let numbers = numbers(line);
                let at = numbers[0] as usize - 1;
                assert_eq!(labels[at], phase);
                let [nx, ny, _] = report.shape.map(|n| n as usize);
                let place = [at % nx, at / nx % ny, at / nx / ny];
                let corners: Vec<[f64; 3]> = numbers[1..].iter().map(|n| nodes[n]).collect();
                let steps = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]];
                for (c, corner) in corners.iter().enumerate() {
                    for a in 0..3 {
                        let step = steps[c % 4][a] + if a == 2 { c / 4 } else { 0 };
                        let expected = (place[a] + step) as f64 * report.spacing_mm[a];
                        assert!((corner[a] - expected).abs() < 1e-9);
                    }
                }
                used.extend(numbers[1..].iter().copied());
                elements += 1;
            }
        }
        assert_eq!(elements, report.inside_voxels);
        assert!(used.iter().eq(nodes.keys()), "no node is without an element");
        // Sets of nodes lie on their faces.
        let bounds = specimen.bounds_mm();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            for (end, at) in [("min", 0.0), ("max", bounds[axis])] {
                if matches!(specimen, Specimen::Cylinder { .. }) && axis < 2 {
                    continue;
                }
                let on_face: BTreeSet<u64> =
                    nodes.iter().filter(|(_, p)| p[axis] == at).map(|(id, _)| *id).collect();
                let set: Vec<u64> =
                    lines(&format!("*NSET, NSET={name}_{end}")).iter().flat_map(|l| numbers(l)).collect();
                assert!(set.iter().eq(on_face.iter()), "{name}_{end}");
            }
        }
        // The interface is every face between the phases, once.
        let [nx, ny, nz] = report.shape.map(|n| n as usize);
        let at = |i: usize, j: usize, k: usize| labels[i + nx * (j + ny * k)];
        let differ = |a: u8, b: u8| usize::from(a != b && a + b == 1);
        let mut expected = 0;
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    expected += if i + 1 < nx { differ(at(i, j, k), at(i + 1, j, k)) } else { 0 };
                    expected += if j + 1 < ny { differ(at(i, j, k), at(i, j + 1, k)) } else { 0 };
                    expected += if k + 1 < nz { differ(at(i, j, k), at(i, j, k + 1)) } else { 0 };
                }
            }
        }
        let interface: BTreeSet<&str> = lines("*SURFACE, TYPE=ELEMENT, NAME=itz").into_iter().collect();
        assert_eq!(interface.len(), expected);
        for line in interface {
            let (element, side) = line.split_once(", ").unwrap();
            let element = element.parse::<usize>().unwrap() - 1;
            let way: i64 = match side {
                "S1" => -((nx * ny) as i64),
                "S2" => (nx * ny) as i64,
                "S3" => -(nx as i64),
                "S4" => 1,
                "S5" => nx as i64,
                "S6" => -1,
                _ => panic!("{side}"),
            };
            assert_eq!(labels[element], 1);
            assert_eq!(labels[(element as i64 + way) as usize], 0);
        }
    }
}

#[test]
fn the_lateral_surface_of_a_cylinder_is_one_closed_surface() {
    let (specimen, spheres) = packed(&specimens()[2]);
    let model = Model::new(&specimen, &spheres);
    let (report, bytes) = written(&model, VoxelFormat::Inp, &json!({"cells": 12}));
    let (_, labels) = written(&model, VoxelFormat::Raw, &json!({"cells": 12}));
    let text = String::from_utf8(bytes).unwrap();
    let count = |face: &str| -> usize {
        let keyword = format!("*ELSET, ELSET=side_{face}");
        let found = keywords(&text).into_iter().find(|(name, _)| *name == keyword).unwrap();
        found.1.iter().map(|line| line.split(',').count()).sum()
    };
    // Seen from either side a row of voxels has one end.
    let [nx, ny, nz] = report.shape.map(|n| n as usize);
    let rows = (0..ny * nz).filter(|row| labels[row * nx..(row + 1) * nx].iter().any(|l| *l != 2)).count();
    assert_eq!([count("S6"), count("S4")], [rows, rows]);
    assert_eq!([count("S3"), count("S5")], [rows, rows], "as wide as long");
}

#[test]
fn a_run_stops_when_it_is_told_to() {
    struct After(AtomicU32);
    impl Control for After {
        fn report(&self, progress: &Progress) {
            assert!((0.0..=1.0).contains(&progress.fraction));
            self.0.fetch_sub(1, Relaxed);
        }
        fn should_stop(&self) -> bool {
            self.0.load(Relaxed) == 0
        }
    }
    let (specimen, spheres) = packed(&specimens()[0]);
    let elastic = json!({"youngs_modulus_gpa": 25, "poissons_ratio": 0.2});
    let materials =
        Materials::of_request(&json!({"materials": {"matrix": elastic, "aggregate": elastic}})).unwrap();
    let model = Model::new(&specimen, &spheres).with_materials(Some(&materials));
    for (format, threads) in VoxelFormat::ALL.into_iter().flat_map(|format| [(format, 1), (format, 3)]) {
        let control = After(AtomicU32::new(5));
        let only_by_reader = [("vtk", "amitex"), ("zip", "fans")];
        let of_reader =
            only_by_reader.iter().find(|(name, _)| *name == format.name()).map(|(_, reader)| reader);
        let mut options = json!({"cells": 20});
        if let Some(reader) = of_reader {
            options["for"] = json!(reader);
        }
        let options = read(format, &options).unwrap();
        let limits = Limits { export_threads: threads.try_into().unwrap(), ..Limits::default() };
        let mut out = Vec::new();
        let stopped = options.write(&model, &limits, &control, &mut out);
        assert!(matches!(stopped, Err(ExportError::Stopped)), "{stopped:?}");
    }
}

/// Progress counts the layers of all passes, and comes to its end.
#[test]
fn progress_counts_layers_up_to_the_last() {
    struct Last(Mutex<Progress>);
    impl Control for Last {
        fn report(&self, progress: &Progress) {
            let mut last = self.0.lock().unwrap();
            assert!(progress.done > last.done && progress.done <= progress.total, "{last:?} {progress:?}");
            *last = progress.clone();
        }
        fn should_stop(&self) -> bool {
            false
        }
    }
    let (specimen, spheres) = of_three_aggregates(&specimens()[2]);
    let model = Model::new(&specimen, &spheres);
    for (format, options, layers) in [
        (VoxelFormat::Raw, json!({"cells": 26}), 26),
        (VoxelFormat::Vti, json!({"cells": 26, "fractions": true}), 2 * 26),
        // The nodes, and then labels, matrix, aggregates, two of them, and the interface.
        (VoxelFormat::Inp, json!({"cells": 26}), 27 + 6 * 26),
    ] {
        let start = Progress {
            step: crate::control::Step::Export,
            fraction: 0.0,
            done: 0,
            total: 0,
            unit: "",
            message: String::new(),
            growth: None,
        };
        let control = Last(Mutex::new(start));
        read(format, &options).unwrap().write(&model, &Limits::default(), &control, &mut io::sink()).unwrap();
        let last = control.0.into_inner().unwrap();
        assert_eq!((last.done, last.total, last.unit), (layers, layers, "layers"));
    }
}

properties! {
    /// A grain's chords add up to its volume, wherever it lies.
    #[test]
    fn a_grain_is_measured_wherever_it_lies(
        center in prop::array::uniform3(0.0..10.0_f64), d in 1.0..5.0_f64, cells in 5_u32..30,
    ) {
        let mut spheres = Spheres::default();
        spheres.push(center, d);
        let specimen = Specimen::Box { size_mm: [10.0; 3], boundary: crate::request::Boundary::Periodic };
        let model = Model::new(&specimen, &spheres);
        let (report, bytes) =
            written(&model, VoxelFormat::Vti, &json!({"cells": cells, "fractions": true, "samples": 8}));
        let voxels = d * f64::from(cells) / 10.0 * 8.0;
        let error = (report.volume_fraction_samples / report.volume_fraction - 1.0).abs();
        prop_assert!(error < 3.0 / voxels.powf(1.5), "{error} of {voxels}");
        prop_assert!(appended(&bytes, "fraction").len() == 4 * (cells as usize).pow(3));
    }
}
