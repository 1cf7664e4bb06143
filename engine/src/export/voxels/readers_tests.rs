#![allow(clippy::unwrap_used)]

use std::io::{Cursor, Read as _};

use serde_json::{Value, json};

use super::tests::{read, written};
use super::*;
use crate::Unattended;
use crate::export::Provenance;
use crate::packing::Spheres;
use crate::request::Materials;
use crate::{PackingRequest, pack};

/// A packing of three aggregates, of which the second has no grain.
fn packed(specimen: &Value) -> (PackingRequest, Spheres, Provenance) {
    let part = |name: &str, share: f64, d_min_mm: f64, d_max_mm: f64| {
        let classes = [json!({"d_min_mm": d_min_mm, "d_max_mm": d_max_mm, "mass_fraction": 1})];
        json!({"name": name, "share": share, "d_min_mm": 3, "grading": {"type": "classes", "classes": classes}})
    };
    let parts = [part("basalt", 0.6, 4.0, 8.0), part("air", 0.4, 3.0, 6.0)];
    let request = json!({
        "specimen": specimen,
        "mix": {"aggregates": parts, "volume_fraction": 0.35, "allow_coarse": true},
        "materials": {
            "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
            "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.25},
            "air": {"youngs_modulus_gpa": 0},
        },
    });
    let request = PackingRequest::from_json(&request, 3).unwrap();
    let mut spheres = pack(&request, &Limits::default(), &Unattended).unwrap().into_spheres().unwrap();
    spheres.aggregate.iter_mut().for_each(|aggregate| *aggregate *= 2);
    let provenance = Provenance {
        job_id: None,
        name: None,
        seed: Some(3),
        engine_version: "0".into(),
        volume_fraction_mixture: 0.35,
        volume_fraction_effective: 0.35,
        aggregates: ["basalt", "sand", "air"].map(|name| Some(name.to_owned())).to_vec(),
        result_sha256: None,
    };
    (request, spheres, provenance)
}

fn specimens() -> [Value; 2] {
    [
        json!({"type": "box", "size_mm": [24, 21, 18], "boundary": "periodic"}),
        json!({"type": "cylinder", "diameter_mm": 20, "height_mm": 24}),
    ]
}

/// The same packing without a reader: 0 matrix, 1 to 3 the aggregates, 255 outside.
fn plain(model: &Model<'_>, label: &str) -> Vec<u8> {
    written(model, VoxelFormat::Raw, &json!({"label": label, "cells": 22})).1
}

fn values_of_npy(bytes: &[u8]) -> &[u8] {
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((&bytes[..8], (10 + length) % 64), (&b"\x93NUMPY\x01\x00"[..], 0));
    &bytes[10 + length..]
}

#[test]
fn every_reader_gets_the_same_voxels_in_its_numbers() {
    for specimen in specimens() {
        let (request, grains, provenance) = packed(&specimen);
        let model = Model::new(&request.specimen, &grains).with_provenance(&provenance);
        let [phases, aggregates] = ["phase", "aggregate"].map(|label| plain(&model, label));
        let inside = aggregates.iter().filter(|label| **label != 255).count();
        assert!(aggregates.contains(&1) && aggregates.contains(&3) && !aggregates.contains(&2));

        let (report, bytes) = written(&model, VoxelFormat::Vtk, &json!({"for": "amitex", "cells": 22}));
        let [nx, ny, nz] = report.shape;
        let head = format!(
            "# vtk DataFile Version 4.5\nMaterials of a packing by Packstone, mm\nBINARY\nDATASET STRUCTURED_POINTS\n\
             DIMENSIONS    {}   {}   {}\nORIGIN    0.000   0.000   0.000\nSPACING    {}   {}   {}\nCELL_DATA   {}\n\
             SCALARS MaterialId unsigned_char\nLOOKUP_TABLE default\n",
            nx + 1,
            ny + 1,
            nz + 1,
            report.spacing_mm[0],
            report.spacing_mm[1],
            report.spacing_mm[2],
            nx * ny * nz
        );
        let values = bytes.strip_prefix(head.as_bytes()).unwrap();
        assert!(values.iter().zip(&phases).all(|(value, phase)| *value == phase + 1));
        assert_eq!((values.len(), report.matrix_label), (phases.len(), 1));

        // AMITEX takes no gaps: the aggregate without grains has no number.
        let options = json!({"for": "amitex", "label": "aggregate", "cells": 22});
        let (report, bytes) = written(&model, VoxelFormat::Vtk, &options);
        let values = &bytes[bytes.len() - aggregates.len()..];
        let number = |label: u8| match label {
            0 => 1,
            1 => 2,
            3 => 3,
            _ => 4,
        };
        assert!(values.iter().zip(&aggregates).all(|(value, label)| *value == number(*label)));
        let of_report: Vec<_> =
            report.aggregates.iter().filter(|of| of.grains > 0).map(|of| of.label).collect();
        assert_eq!(of_report, [2, 3]);
        assert_eq!(report.outside_label, (inside < aggregates.len()).then_some(4));

        let options = json!({"for": "automesh", "label": "aggregate", "cells": 22});
        let (report, bytes) = written(&model, VoxelFormat::Npy, &options);
        let number = |label: u8| if label == 255 { 0 } else { label + 1 };
        assert!(values_of_npy(&bytes).iter().zip(&aggregates).all(|(value, label)| *value == number(*label)));
        assert_eq!((report.matrix_label, report.dtype.as_deref()), (1, Some("|u1")));
        assert_eq!(report.aggregates.iter().map(|of| of.label).collect::<Vec<_>>(), [2, 3, 4]);

        let (report, bytes) = written(&model, VoxelFormat::Npy, &json!({"cells": 22, "label": "grain"}));
        assert_eq!(values_of_npy(&bytes), plain(&model, "grain"));
        let shape = format!("'descr': '<u4', 'fortran_order': True, 'shape': ({nx}, {ny}, {nz}), ");
        assert!(String::from_utf8_lossy(&bytes[..128]).contains(&shape) && report.matrix_label == 0);
    }
}

/// Against the XML by hand; DAMASK's own reader opens the file in the tests of the command line.
#[test]
fn damask_gets_metres_and_whole_numbers_from_zero() {
    for specimen in specimens() {
        let (request, grains, provenance) = packed(&specimen);
        let model = Model::new(&request.specimen, &grains).with_provenance(&provenance);
        let (report, bytes) =
            written(&model, VoxelFormat::Vti, &json!({"for": "damask", "label": "aggregate", "cells": 22}));
        let text = String::from_utf8(bytes).unwrap();
        let [x, y, z] = report.spacing_mm.map(|mm| mm / 1000.0);
        assert!(text.contains(&format!("Spacing=\"{x} {y} {z}\"")));
        let array = text.split_once("Name=\"material\" format=\"binary\">\n").unwrap().1;
        let encoded = array.split_once('\n').unwrap().0.trim();
        let decoded = decoded(encoded);
        let words: Vec<u64> =
            decoded.chunks_exact(8).map(|word| u64::from_le_bytes(word.try_into().unwrap())).collect();
        let labels = plain(&model, "aggregate");
        assert_eq!((words[0], words.len()), (8 * labels.len() as u64, labels.len() + 1));
        let number = |label: u8| if label == 255 { 4 } else { u64::from(label) };
        assert!(words[1..].iter().zip(&labels).all(|(word, label)| *word == number(*label)));
        assert_eq!(report.dtype.as_deref(), Some("<i8"));
    }
}

fn decoded(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let mut bytes = Vec::new();
    for group in text.as_bytes().chunks(4) {
        let kept = group.iter().filter(|c| **c != b'=').count();
        let bits = group.iter().take(kept).fold(0_u32, |bits, c| (bits << 6) | u32::from(digit(*c)));
        let bits = bits << (6 * (4 - kept));
        bytes.extend_from_slice(&bits.to_be_bytes()[1..kept]);
    }
    bytes
}

#[test]
fn fans_gets_its_input_with_the_moduli_of_each_phase() {
    let (request, grains, provenance) = packed(&specimens()[0]);
    let bare = Model::new(&request.specimen, &grains).with_provenance(&provenance);
    let model = bare.with_materials(request.materials.as_ref());
    let (report, bytes) = written(&model, VoxelFormat::Zip, &json!({"for": "fans", "cells": 22}));
    let mut archive = zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
    let mut file = |name: &str| {
        let mut bytes = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    };
    assert_eq!(values_of_npy(&file("microstructure.npy")), plain(&model, "aggregate"));
    let input: Value = serde_json::from_slice(&file("input.json")).unwrap();
    let properties = &input["materials"][0]["material_properties"];
    assert_eq!(input["materials"][0]["phases"], json!([0, 1, 2, 3]));
    assert_eq!(input["microstructure"]["L"], json!([24.0, 21.0, 18.0]));
    let near = |value: &Value, expected: [f64; 4]| {
        let values: Vec<f64> = serde_json::from_value(value.clone()).unwrap();
        values.len() == 4 && values.iter().zip(expected).all(|(value, of)| (value - of).abs() <= 1e-12 * of)
    };
    // K = E / 3 (1 - 2 nu) and G = E / 2 (1 + nu), in MPa.
    assert!(near(&properties["bulk_modulus"], [25e3 / 1.8, 70e3 / 1.5, 70e3 / 1.5, 0.0]), "{properties}");
    assert!(near(&properties["shear_modulus"], [25e3 / 2.4, 70e3 / 2.5, 70e3 / 2.5, 0.0]), "{properties}");
    assert!(String::from_utf8(file("make_h5.py")).unwrap().contains("permute_order"));
    assert_eq!((report.matrix_label, report.aggregates.len()), (0, 3));

    let failed = |model: &Model<'_>, options: &Value| {
        let options = read(VoxelFormat::Zip, options).unwrap();
        options.write(model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap_err().to_string()
    };
    let missing = failed(&bare, &json!({"for": "fans"}));
    assert!(missing.starts_with("/materials: is missing") && missing.contains("\"youngs_modulus_gpa\": 25"));
    let thermal: Materials = Materials::of_request(&json!({"materials": {
        "matrix": {"conductivity_w_m_k": 2}, "aggregate": {"youngs_modulus_gpa": 70}}}))
    .unwrap();
    let missing = failed(&bare.with_materials(Some(&thermal)), &json!({"for": "fans"}));
    assert!(missing.starts_with("/materials/matrix/youngs_modulus_gpa: is missing"), "{missing}");
    assert!(missing.contains("/materials/basalt/poissons_ratio: is missing"), "{missing}");
    let cylinder = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 20.0 };
    let none = Spheres::default();
    let refused = failed(&Model::new(&cylinder, &none), &json!({"for": "fans"}));
    assert!(refused.starts_with("FANS computes a periodic cell"), "{refused}");
}

#[test]
fn a_phase_without_a_voxel_is_refused_where_numbers_may_have_no_gap() {
    let (request, grains, provenance) = packed(&specimens()[0]);
    let model = Model::new(&request.specimen, &grains).with_provenance(&provenance);
    let options =
        read(VoxelFormat::Vtk, &json!({"for": "amitex", "cells": 1, "label": "aggregate"})).unwrap();
    let refused = options.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap_err();
    assert!(refused.to_string().contains("has no voxel, and AMITEX reads no numbers with gaps"), "{refused}");
}

#[test]
fn readers_decide_the_format_and_refuse_what_means_nothing() {
    for (options, says) in [
        (json!({"format": "npy", "for": "damask"}), "/format: damask reads vti: must be that, or left out"),
        (json!({"format": "raw", "for": "damask"}), "/for: unknown field"),
        (json!({"format": "vtk"}), "/format: vtk is written for a program: must have for=amitex beside it"),
        (json!({"format": "zip"}), "/format: zip is written for a program: must have for=fans beside it"),
        (json!({"for": "abaqus"}), "/for: \"abaqus\" is unknown: must be one of \"damask\", \"amitex\""),
        (
            json!({"for": "amitex", "label": "grain"}),
            "/label: \"grain\" is unknown: must be one of \"phase\"",
        ),
        (json!({"for": "damask", "fractions": true}), "/fractions: unknown field"),
        (json!({"for": "fans", "label": "phase"}), "/label: unknown field"),
        (json!({"for": "damask", "materials": {}}), "/materials: unknown field"),
    ] {
        let faults = crate::request::decode::Faults::default();
        let mut object = crate::request::decode::At::root(&options, &faults).object().unwrap();
        let read = VoxelOptions::read(&mut object);
        if read.is_some() {
            object.finish();
        }
        let said: Vec<String> = faults.into_vec().iter().map(ToString::to_string).collect();
        assert!(said.len() == 1 && said[0].starts_with(says), "{said:?}");
    }
    for reader in Reader::ALL {
        let options = read(reader.format(), &json!({"for": reader.name()})).unwrap();
        let stored = serde_json::to_value(&options).unwrap();
        assert_eq!(read(reader.format(), &stored).unwrap(), options, "the stored form reads back");
    }
}
