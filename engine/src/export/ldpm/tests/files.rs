use std::io::{Cursor, Read, Write};

use super::super::{LatticeFormat, LatticeOptions, LatticeReport};
use super::{in_cylinder, with_clearance};
use crate::Unattended;
use crate::export::{Export as _, ExportError, Model, Provenance};
use crate::plan::Limits;
use crate::request::Materials;
use crate::request::materials::Material;

fn written(
    format: LatticeFormat,
    (specimen, spheres): &(crate::request::Specimen, crate::Spheres),
) -> (Vec<u8>, LatticeReport) {
    let mut bytes = Vec::new();
    let options = LatticeOptions { format, ..LatticeOptions::default() };
    let report =
        options.write(&Model::new(specimen, spheres), &Limits::default(), &Unattended, &mut bytes).unwrap();
    (bytes, report)
}

#[test]
fn the_same_model_is_the_same_bytes() {
    let packing = in_cylinder();
    for file in [LatticeFormat::Chrono, LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells] {
        assert!(written(file, &packing).0 == written(file, &packing).0, "{file:?}");
    }
}

#[test]
fn grids_say_where_they_come_from() {
    let (specimen, spheres) = in_cylinder();
    let provenance = Provenance {
        job_id: None,
        name: Some("<>".into()),
        seed: Some(7),
        engine_version: "1".into(),
        volume_fraction_mixture: 0.5,
        volume_fraction_effective: 0.25,
        aggregates: Vec::new(),
        result_sha256: None,
    };
    let model = Model::new(&specimen, &spheres).with_provenance(&provenance);
    for format in [LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells] {
        let options = LatticeOptions { format, ..LatticeOptions::default() };
        let mut bytes = Vec::new();
        options.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes[..2000]).into_owned();
        let head = text.split_once("<Piece").unwrap().0;
        let (_, fields) = head.split_once("  <UnstructuredGrid>\n    <FieldData>\n").unwrap();
        for field in [
            r#"<DataArray type="UInt8" Name="name" NumberOfTuples="2" format="ascii">60 62</DataArray>"#,
            r#"<DataArray type="UInt64" Name="seed" NumberOfTuples="1" format="ascii">7</DataArray>"#,
        ] {
            assert!(fields.contains(field), "{fields}");
        }
    }
}

/// An aggregate without stiffness is air: its grains are no nodes, and the lattice is that of the others alone.
#[test]
fn air_voids_are_no_nodes() {
    let (specimen, spheres) = in_cylinder();
    let count = spheres.len();
    let mixed =
        crate::Spheres { aggregate: (0..count).map(|i| (i % 3 == 0).into()).collect(), ..spheres.clone() };
    let mut stiff = crate::Spheres::default();
    for grain in (0..count).filter(|i| i % 3 != 0) {
        stiff.push(spheres.center(grain), spheres.d_mm[grain]);
    }
    let provenance = Provenance {
        job_id: None,
        name: None,
        seed: Some(7),
        engine_version: "1".into(),
        volume_fraction_mixture: 0.5,
        volume_fraction_effective: 0.25,
        aggregates: vec![Some("gravel".into()), Some("air".into())],
        result_sha256: None,
    };
    let modulus = |youngs_modulus_gpa| Material { youngs_modulus_gpa, ..Material::default() };
    let materials = |air: f64| -> Materials {
        [("gravel".to_owned(), modulus(Some(70.0))), ("air".to_owned(), modulus(Some(air)))]
            .into_iter()
            .collect()
    };
    let nodes = |spheres: &crate::Spheres, materials: Option<&Materials>| {
        let model = Model::new(&specimen, spheres).with_provenance(&provenance).with_materials(materials);
        let options = LatticeOptions { format: LatticeFormat::Tets, ..LatticeOptions::default() };
        let report = options.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap();
        report.nodes
    };
    let alone = nodes(&stiff, None);
    assert_eq!(nodes(&mixed, Some(&materials(0.0))), alone);
    let all = nodes(&mixed, Some(&materials(1.0)));
    assert_eq!(all, nodes(&spheres, None));
    assert_ne!(all, alone);
}

/// Rows of numbers of one file of the archive, as Project Chrono's reader finds them.
fn rows(archive: &mut zip::ZipArchive<Cursor<Vec<u8>>>, suffix: &str) -> Vec<Vec<f64>> {
    let mut text = String::new();
    archive.by_name(&format!("ldpm-data-{suffix}.dat")).unwrap().read_to_string(&mut text).unwrap();
    text.lines()
        .filter(|line| !line.starts_with('/'))
        .map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect())
        .collect()
}

#[test]
fn the_archive_holds_what_the_report_says() {
    let packing = with_clearance();
    let (bytes, report) = written(LatticeFormat::Chrono, &packing);
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut summary = String::new();
    archive.by_name("summary.json").unwrap().read_to_string(&mut summary).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(serde_json::from_value::<LatticeReport>(summary["report"].clone()).unwrap(), report);

    for (suffix, count, columns) in [
        ("nodes", report.nodes.total, 3),
        ("tets", report.tetrahedra, 4),
        ("edges", report.edges, 2),
        ("particles", report.nodes.grains, 5),
        ("facets", report.facets, 19),
        ("facetsVertices", 3 * report.facets, 3),
        ("faceFacets", 6 * report.surface_triangles, 10),
    ] {
        let rows = rows(&mut archive, suffix);
        assert_eq!(rows.len() as u64, count, "{suffix}");
        assert!(rows.iter().all(|row| row.len() == columns), "{suffix}");
    }
    let nodes = rows(&mut archive, "nodes");
    let particles = rows(&mut archive, "particles");
    let grains = &nodes[nodes.len() - particles.len()..];
    let spheres = &packing.1;
    for (i, (row, node)) in particles.iter().zip(grains).enumerate() {
        let [x, y, z] = spheres.center(i);
        assert_eq!(row[..], [i as f64, x, y, z, spheres.d_mm[i]]);
        assert_eq!(node[..], [x, y, z]);
    }
    // Written with ten digits, and each volume counted as positive.
    let volume: f64 = rows(&mut archive, "facets").iter().map(|row| row[4]).sum();
    let expected = report.volume_mm3 * (1.0 + report.checks.unsigned_excess);
    assert!((volume - expected).abs() < 1e-9 * expected, "{volume} {expected}");
}

/// A disk that fills up.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.0 < bytes.len() {
            return Err(std::io::Error::from(std::io::ErrorKind::StorageFull));
        }
        self.0 -= bytes.len();
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_writer_that_fails_is_told_of() {
    let (specimen, spheres) = in_cylinder();
    for file in [LatticeFormat::Chrono, LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells] {
        for room in [0, 20_000] {
            let options = LatticeOptions { format: file, ..LatticeOptions::default() };
            let model = Model::new(&specimen, &spheres);
            let error = options.write(&model, &Limits::default(), &Unattended, &mut Full(room)).unwrap_err();
            let ExportError::Write(error) = error else { panic!("{error}") };
            assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
        }
    }
}
