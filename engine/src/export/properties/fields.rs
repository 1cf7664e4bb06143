//! The fields of all load cases as VTK XML image data: strain and stress, gradient and flux of each voxel.

use std::io::Write;
use std::num::NonZeroUsize;

use super::Properties;
use super::phases::Phases;
use super::report::PropertyCell;
use super::state::GridCases;
use crate::control::Control;
use crate::export::vtk_xml::{Values, VtkXml};
use crate::export::{ExportError, Model, go_on};
use crate::homogenization::{ConductionFields, ElasticFields, Scheme};

/// Names of the strains and stresses by load case.
const ELASTIC: [[&str; 2]; 7] = [
    ["strain_of_xx", "stress_of_xx"],
    ["strain_of_yy", "stress_of_yy"],
    ["strain_of_zz", "stress_of_zz"],
    ["strain_of_yz", "stress_of_yz"],
    ["strain_of_xz", "stress_of_xz"],
    ["strain_of_xy", "stress_of_xy"],
    ["strain_of_temperature", "stress_of_temperature"],
];
/// Names of the gradients and fluxes by load case, of heat and of what diffuses.
const CONDUCTION: [[[&str; 2]; 3]; 2] = [
    [
        ["temperature_gradient_of_x", "heat_flux_of_x"],
        ["temperature_gradient_of_y", "heat_flux_of_y"],
        ["temperature_gradient_of_z", "heat_flux_of_z"],
    ],
    [
        ["concentration_gradient_of_x", "diffusion_flux_of_x"],
        ["concentration_gradient_of_y", "diffusion_flux_of_y"],
        ["concentration_gradient_of_z", "diffusion_flux_of_z"],
    ],
];

/// Bytes of a voxel with these numbers of elastic and of other load cases, its phase included.
pub(super) fn bytes_per_voxel(elastic: usize, conducting: usize) -> u64 {
    1 + 48 * elastic as u64 + 24 * conducting as u64
}

/// Writes the fields.
///
/// # Errors
/// [`ExportError::Write`] and [`ExportError::Stopped`].
pub(super) fn write(
    model: &Model<'_>,
    phases: &Phases,
    (cell, scheme): (&PropertyCell, Scheme),
    (properties, cases): (&Properties, &GridCases),
    threads: NonZeroUsize,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let voxels = &properties.voxels;
    let [nx, ny, nz] = voxels.shape();
    let [dx, dy, dz] = cell.voxel_mm;
    let extent = format!("0 {nx} 0 {ny} 0 {nz}");
    let attributes = [
        ("WholeExtent", extent.clone()),
        ("Origin", "0 0 0".to_owned()),
        ("Spacing", format!("{dx} {dy} {dz}")),
    ];
    let items = (voxels.len(), nz);
    let elastic = ElasticFields::new(voxels, &phases.elastic, scheme, &cases.elastic);
    let elastic_cases = cases.elastic.len();
    let none = Vec::new();
    let of = [&phases.conductivity, &phases.diffusivity].map(|values| values.as_ref().unwrap_or(&none));
    let cases = [&cases.conductivity, &cases.diffusivity];
    let fields = [0, 1].map(|i| ConductionFields::new(voxels, of[i], scheme, cases[i]));
    let mut file =
        VtkXml::new("ImageData", &attributes, &[("Extent", extent)], model.provenance).on_threads(threads);
    file.section("CellData", Some("phase"));
    file.array::<u8>("phase", voxels.len(), voxels.largest_phases());
    for (case, [strain, stress]) in ELASTIC.into_iter().enumerate().take(elastic_cases) {
        let elastic = &elastic;
        file.shared::<[f32; 6]>(strain, items, move |planes, values: &mut Values| {
            planes.for_each(|k| elastic.plane(case, k, |strain, _| values.put(strain)));
        });
        file.shared::<[f32; 6]>(stress, items, move |planes, values: &mut Values| {
            planes.for_each(|k| elastic.plane(case, k, |_, stress| values.put(stress)));
        });
    }
    for ((names, fields), cases) in CONDUCTION.into_iter().zip(&fields).zip(cases) {
        for (case, [gradient, flux]) in names.into_iter().enumerate().take(cases.len()) {
            file.shared::<[f32; 3]>(gradient, items, move |planes, values: &mut Values| {
                planes.for_each(|k| fields.plane(case, k, |gradient, _| values.put(gradient)));
            });
            file.shared::<[f32; 3]>(flux, items, move |planes, values: &mut Values| {
                planes.for_each(|k| fields.plane(case, k, |_, flux| values.put(flux)));
            });
        }
    }
    file.write(out, &mut |_| go_on(control))
}
