#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::*;

fn said(faults: &[FieldError]) -> Vec<String> {
    faults.iter().map(ToString::to_string).collect()
}

#[test]
fn every_type_is_found_by_its_name_and_has_its_formats() {
    for kind in ExportType::ALL {
        assert_eq!(ExportType::from_name(kind.name()), Some(kind));
        assert_eq!(json!(kind), kind.name());
        let plain = ExportRequest::from_json(&json!({"type": kind.name()})).unwrap();
        assert_eq!(plain.export_type(), kind, "every option has a default");
        assert_eq!(kind.formats()[0], plain.format(), "the first format is the default");
        for format in kind.formats() {
            let export = ExportRequest::from_text(kind, kind.options_of_format(format)).unwrap();
            let stored = serde_json::to_value(&export).unwrap();
            assert_eq!((&stored["type"], &stored["format"]), (&json!(kind.name()), &json!(format)));
            assert_eq!(ExportRequest::from_json(&stored).unwrap(), export, "the stored form reads back");
        }
        assert_eq!(ExportRequest::from_text(kind, []).unwrap(), plain);
        let stored = serde_json::to_value(&plain).unwrap();
        assert_eq!(stored["type"], kind.name());
        assert_eq!(ExportRequest::from_json(&stored).unwrap(), plain, "the stored form reads back");
        assert!(plain.media_type().contains('/') && !plain.file_extension().contains('.'), "{}", kind.name());
    }
    assert_eq!(ExportType::from_name("Slice"), None);
}

/// Of the formats that any type has, and of others, each type accepts those that it lists; alone, but for those that
/// are written for one program.
#[test]
fn the_formats_and_programs_that_a_type_lists_are_those_that_it_accepts() {
    let formats: Vec<&str> = ExportType::ALL.iter().flat_map(|kind| kind.formats()).copied().collect();
    let programs = [None, Some("damask"), Some("amitex"), Some("fans"), Some("automesh"), Some("abaqus")];
    for kind in ExportType::ALL {
        for format in formats.iter().copied().chain(["vtp", "vtm", "stp", "hdf5", "Vti", ""]) {
            let accepted: Vec<Option<&str>> = programs
                .into_iter()
                .filter(|program| {
                    let options = [("format", format)].into_iter().chain(program.map(|name| ("for", name)));
                    ExportRequest::from_text(kind, options).is_ok()
                })
                .collect();
            let mut listed: Vec<Option<&str>> = Vec::new();
            if kind.formats().contains(&format) {
                listed.extend(kind.needed_program(format).is_none().then_some(None));
                listed.extend(kind.programs(format).into_iter().map(Some));
            }
            assert_eq!(accepted, listed, "{} {format:?}", kind.name());
            let has_programs = kind.option_names(format).contains(&"for");
            assert_eq!(has_programs, !kind.programs(format).is_empty(), "{} {format:?}", kind.name());
        }
    }
    let needed: Vec<_> = ["vtk", "zip", "vti"].map(|format| ExportType::Voxels.needed_program(format)).into();
    assert_eq!(needed, [Some("amitex"), Some("fans"), None]);
    assert_eq!(ExportType::Deck.needed_program("zip"), None);
}

#[test]
fn what_comes_as_text_is_what_comes_as_json() {
    for (text, value) in [
        ("16", json!(16)),
        ("-1.5e3", json!(-1500.0)),
        ("true", json!(true)),
        ("z", json!("z")),
        ("", json!("")),
        ("1.2.3", json!("1.2.3")),
        ("[1, 2]", json!([1, 2])),
        ("{broken", json!("{broken")),
        ("trueish", json!("trueish")),
    ] {
        assert_eq!(value_of(text), value, "{text}");
    }
    let text = ExportRequest::from_text(ExportType::Slice, [("at_mm", "7.5"), ("format", "json")]);
    let value = ExportRequest::from_json(&json!({"type": "slice", "at_mm": 7.5, "format": "json"}));
    assert_eq!(text, value);
}

#[test]
fn faults_of_options_are_all_told_each_at_its_place() {
    let faults = ExportRequest::from_text(
        ExportType::Slice,
        [("format", "gif"), ("colour", "red"), ("at_mm", "1"), ("at_mm", "2")],
    )
    .unwrap_err();
    let said = said(&faults);
    assert!(
        said.iter().any(|fault| fault == "/at_mm: is given more than once: must be given once"),
        "{said:?}"
    );
    assert!(
        said.iter().any(|fault| fault.starts_with("/format: \"gif\" is unknown: must be one of")),
        "{said:?}"
    );
    assert!(said.iter().any(|fault| fault.starts_with("/colour: unknown option: slice has ")), "{said:?}");

    let faults = ExportRequest::from_json(&json!({"type": "sphere"})).unwrap_err();
    assert!(faults[0].to_string().starts_with("/type: \"sphere\" is unknown: must be one of"), "{faults:?}");
    let faults = ExportRequest::from_json(&json!({"type": "slice", "colour": "red"})).unwrap_err();
    assert!(
        faults[0].to_string().starts_with("/colour: unknown field: this object has type, "),
        "{faults:?}"
    );
}

/// `packstone export` writes into one folder: no option may change a file and leave its name.
#[test]
fn names_of_files_tell_every_option_apart() {
    type Case = (ExportType, &'static [(&'static str, &'static str)], &'static str);
    let cases: [Case; 22] = [
        (ExportType::Mesh, &[], "msh"),
        (ExportType::Mesh, &[("segments", "24")], "segments-24.msh"),
        (ExportType::Mesh, &[("segments", "24"), ("max_segments", "30")], "segments-24.max_segments-30.msh"),
        (ExportType::Mesh, &[("size_mm", "0.5")], "size_mm-0.5.msh"),
        (ExportType::Mesh, &[("format", "stl"), ("size_field", "false")], "stl.size_field-false.zip"),
        (ExportType::Mesh, &[("format", "geo")], "geo"),
        (ExportType::Voxels, &[], "vti"),
        (ExportType::Voxels, &[("label", "grain")], "grain.vti"),
        (ExportType::Voxels, &[("fractions", "true"), ("cells", "40")], "cells-40.fractions-true.vti"),
        (ExportType::Voxels, &[("format", "inp"), ("voxel_mm", "2")], "voxel_mm-2.0.inp"),
        (ExportType::Voxels, &[("format", "npy"), ("label", "grain")], "grain.npy"),
        (ExportType::Voxels, &[("for", "automesh")], "automesh.npy"),
        (ExportType::Voxels, &[("for", "damask"), ("label", "aggregate")], "damask.aggregate.vti"),
        (ExportType::Voxels, &[("for", "amitex"), ("cells", "40")], "amitex.cells-40.vtk"),
        (ExportType::Voxels, &[("for", "fans"), ("cells", "40")], "fans.cells-40.zip"),
        (ExportType::Slice, &[], "slice.svg"),
        (ExportType::Slice, &[("axis", "x"), ("at_mm", "20")], "slice.x.at_mm-20.0.svg"),
        (ExportType::Slice, &[("format", "geo")], "slice.geo"),
        (ExportType::Ldpm, &[], "ldpm.chrono.zip"),
        (ExportType::Ldpm, &[("format", "tets")], "ldpm.tets.vtu"),
        (ExportType::Ldpm, &[("format", "facets")], "ldpm.facets.vtu"),
        (ExportType::Ldpm, &[("format", "cells"), ("seed", "3")], "ldpm.cells.seed-3.vtu"),
    ];
    let mut met = std::collections::BTreeSet::new();
    for (export, options, name) in cases {
        let request = ExportRequest::from_text(export, options.iter().copied()).unwrap();
        assert_eq!(request.file_ending(), name);
        assert!(met.insert(name), "{name}");
    }
}

fn job(gap_mm: f64, size_mm: f64) -> PackingRequest {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.5},
        "distance": {"type": "constant", "gap_mm": gap_mm},
    });
    PackingRequest::from_json(&value, 1).unwrap()
}

#[test]
fn files_are_as_long_as_estimated() {
    let limits = Limits::default();
    for gap_mm in [0.0, 0.3, 1.0] {
        let request = job(gap_mm, 32.0);
        let plan = Plan::new(&request, &limits).unwrap();
        let packing = crate::pack(&request, &limits, &crate::Unattended).unwrap();
        let model = Model::new(&request.specimen, packing.spheres().unwrap());
        for (export, options) in [
            (ExportType::Mesh, vec![]),
            (ExportType::Mesh, vec![("segments", "10")]),
            (ExportType::Mesh, vec![("size_mm", "1")]),
            (ExportType::Mesh, vec![("format", "stl")]),
            (ExportType::Mesh, vec![("format", "geo")]),
            (ExportType::Voxels, vec![("cells", "50"), ("fractions", "true")]),
            (ExportType::Slice, vec![("format", "json")]),
            (ExportType::Slice, vec![("format", "svg")]),
            (ExportType::Ldpm, vec![("format", "tets")]),
            (ExportType::Ldpm, vec![("format", "facets")]),
        ] {
            let export = ExportRequest::from_text(export, options).unwrap();
            let mut bytes = Vec::new();
            let report = export.write(&model, &limits, &crate::Unattended, &mut bytes).unwrap();
            let guess = export.estimate(&model).unwrap();
            let early = export.estimate_from_plan(&request, &plan).unwrap();
            let ratio = |estimate: &ExportEstimate| estimate.bytes as f64 / bytes.len() as f64;
            let name = export.file_ending();
            assert!(
                (1.0 / 1.5..1.5).contains(&ratio(&guess)),
                "{gap_mm} {name}: {} of {}",
                guess.bytes,
                bytes.len()
            );
            assert!(
                (0.4..2.5).contains(&ratio(&early)),
                "{gap_mm} {name}: {} of {}",
                early.bytes,
                bytes.len()
            );
            if let ExportReport::Mesh(mesh::MeshReport::Msh(report)) = report {
                let ratio = guess.mesh.unwrap().triangles as f64 / report.triangles as f64;
                assert!((1.0 / 1.5..1.5).contains(&ratio), "{gap_mm} {name}: {ratio}");
                assert_eq!(!early.warnings.is_empty(), gap_mm == 0.0, "{:?}", early.warnings);
            }
        }
    }
}

/// Of voxels nothing is unknown before they are made but the interface and the sets of hexahedra.
#[test]
fn voxels_are_as_long_as_estimated() {
    let limits = Limits::default();
    let part = |name: &str, d_min_mm: f64| {
        json!({"name": name, "share": 0.5, "d_min_mm": d_min_mm,
               "grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}})
    };
    let fine = json!({"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "volume_fraction": 0.5});
    let two = json!({"aggregates": [part("a", 2.0), part("b", 3.0)], "volume_fraction": 0.4});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 25, "height_mm": 30});
    for (specimen, mix) in [
        (json!({"type": "box", "size_mm": [32, 30, 28.1]}), fine.clone()),
        (json!({"type": "box", "size_mm": [32, 32, 32]}), two),
        (cylinder, fine),
    ] {
        let request = PackingRequest::from_json(&json!({"specimen": specimen, "mix": mix}), 1).unwrap();
        let plan = Plan::new(&request, &limits).unwrap();
        let packing = crate::pack(&request, &limits, &crate::Unattended).unwrap();
        let model = Model::new(&request.specimen, &packing.grains);
        for (options, tolerance) in [
            (vec![("format", "inp"), ("cells", "16")], 0.05),
            (vec![("format", "inp"), ("cells", "50")], 0.05),
            (vec![("format", "inp"), ("cells", "90")], 0.05),
            (vec![("format", "npy"), ("cells", "50")], 1e-2),
            (vec![("for", "damask"), ("cells", "50")], 1e-2),
            (vec![("for", "amitex"), ("cells", "50")], 1e-2),
            (vec![("cells", "50"), ("label", "grain")], 1e-2),
        ] {
            let export = ExportRequest::from_text(ExportType::Voxels, options.clone()).unwrap();
            let mut bytes = Vec::new();
            export.write(&model, &limits, &crate::Unattended, &mut bytes).unwrap();
            let of_model = export.estimate(&model).unwrap().bytes as f64 / bytes.len() as f64;
            let of_plan =
                export.estimate_from_plan(&request, &plan).unwrap().bytes as f64 / bytes.len() as f64;
            assert!((of_model - 1.0).abs() < tolerance, "{options:?} {specimen}: {of_model}");
            assert!((of_plan - 1.0).abs() < 1.2 * tolerance, "{options:?} {specimen}: {of_plan}");
        }
    }
    // One that is refused has an estimate too, and without looking at every one of its rows.
    let request = job(1.0, 32.0);
    let huge =
        ExportRequest::from_text(ExportType::Voxels, [("format", "inp"), ("voxel_mm", "1e-6")]).unwrap();
    let plan = Plan::new(&request, &limits).unwrap();
    assert_eq!(huge.estimate_from_plan(&request, &plan).unwrap().bytes, u64::MAX);
}

/// A mesh above its limit is refused before it is made, and the message says how to get below.
#[test]
fn meshes_beyond_their_limit_are_refused_with_advice() {
    let request = job(0.0, 32.0);
    let limits = Limits::default();
    let packing = crate::pack(&request, &limits, &crate::Unattended).unwrap();
    let model = Model::new(&request.specimen, packing.spheres().unwrap());
    let export = ExportRequest::from_text(ExportType::Mesh, [("max_bytes", "1000000")]).unwrap();
    let refused = export.write(&model, &limits, &crate::Unattended, &mut std::io::sink()).unwrap_err();
    let ExportError::TooLarge(fault) = refused else { panic!("{refused}") };
    assert_eq!(fault.pointer, "/segments");
    for word in ["million triangles", "at most 1 MB", "min_size_mm", "size_field", "distance", "max_bytes"] {
        assert!(fault.detail.contains(word), "{}", fault.detail);
    }
    let early = export.estimate_from_plan(&request, &Plan::new(&request, &limits).unwrap()).unwrap();
    assert!(early.warnings.iter().any(|warning| warning.contains("its limit of 1 MB")), "{early:?}");
}
