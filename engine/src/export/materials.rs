//! The materials that an export computes with: those of its option `materials`, else those that the request of the
//! packing states.

use super::{ExportError, Model};
use crate::request::decode::pointer_segment;
use crate::request::materials::{AGGREGATE, EXAMPLE, MATRIX, Material, OPTION};
use crate::request::{FieldError, Materials};

/// The materials that an export of a packing computes with; `own` are those of its option.
///
/// # Errors
/// [`ExportError::Invalid`] where neither states any, and where the option names a phase that the mix does not have.
pub(super) fn of_model<'a>(
    own: Option<&'a Materials>,
    model: &Model<'a>,
) -> Result<&'a Materials, ExportError> {
    let names = model.provenance.map_or(&[][..], |provenance| &provenance.aggregates);
    chosen(own, model.materials, names.iter().map(Option::as_deref))
}

/// The materials of an option, else those that the request states, for a mix with aggregates of these names.
///
/// # Errors
/// As those of [`of_model`].
pub(super) fn chosen<'a, 'b>(
    own: Option<&'a Materials>,
    stated: Option<&'a Materials>,
    names: impl Iterator<Item = Option<&'b str>>,
) -> Result<&'a Materials, ExportError> {
    let pointer = format!("/{OPTION}");
    if let Some(own) = own {
        // Those of a request were judged with its mix.
        let unknown = own.unknown_phases(&pointer, names);
        return if unknown.is_empty() { Ok(own) } else { Err(ExportError::Invalid(unknown)) };
    }
    stated.ok_or_else(|| {
        let detail = format!(
            "is missing, and the request of the packing states no materials: must be one for each phase, as {EXAMPLE}"
        );
        ExportError::Invalid(vec![FieldError::new(pointer, detail)])
    })
}

/// A phase with its material.
#[derive(Clone, Copy, Debug)]
pub struct PhaseMaterial<'a> {
    /// `matrix`, `aggregate` or the name of an aggregate.
    pub name: &'a str,
    /// Its material.
    pub material: &'a Material,
}

/// The phases of a packing with their materials: the matrix, then each aggregate of `names`, or all as one where there
/// are none.
///
/// # Errors
/// [`ExportError::Invalid`] with every phase that has no material.
pub(super) fn phases<'a>(
    materials: &'a Materials,
    names: &'a [Option<String>],
) -> Result<Vec<PhaseMaterial<'a>>, ExportError> {
    /// All aggregate.
    const WHOLE: &[Option<String>] = &[None];
    let names = if names.is_empty() { WHOLE } else { names };
    let matrix = (MATRIX, materials.of_matrix());
    let aggregates = names.iter().map(|name| {
        let name = name.as_deref();
        (name.unwrap_or(AGGREGATE), materials.of_aggregate(name))
    });
    let (mut phases, mut missing) = (Vec::new(), Vec::new());
    for (name, material) in std::iter::once(matrix).chain(aggregates) {
        match material {
            Some(material) => phases.push(PhaseMaterial { name, material }),
            None => {
                missing
                    .push(FieldError::new(place(name, ""), "is missing: every phase must have a material"));
            }
        }
    }
    missing.dedup();
    if missing.is_empty() { Ok(phases) } else { Err(ExportError::Invalid(missing)) }
}

/// Bulk and shear modulus of each phase in GPa.
///
/// # Errors
/// [`ExportError::Invalid`] with every property that is missing.
pub(super) fn moduli_gpa(phases: &[PhaseMaterial<'_>]) -> Result<Vec<[f64; 2]>, ExportError> {
    let (mut moduli, mut missing) = (Vec::new(), Vec::new());
    for phase in phases {
        match phase.moduli_gpa() {
            Ok(of_phase) => moduli.push(of_phase),
            Err(fault) => missing.push(fault),
        }
    }
    missing.dedup();
    if missing.is_empty() { Ok(moduli) } else { Err(ExportError::Invalid(missing)) }
}

impl PhaseMaterial<'_> {
    /// A property that the export needs, or the fault that it is missing.
    pub(super) fn needed(&self, property: &str, value: Option<f64>) -> Result<f64, FieldError> {
        value.ok_or_else(|| {
            FieldError::new(place(self.name, property), "is missing: the export needs it of every phase")
        })
    }

    /// Bulk and shear modulus in GPa; both are 0 of a pore, whatever its Poisson's ratio is.
    pub(super) fn moduli_gpa(&self) -> Result<[f64; 2], FieldError> {
        if self.material.is_pore() {
            return Ok([0.0; 2]);
        }
        let youngs = self.needed("youngs_modulus_gpa", self.material.youngs_modulus_gpa)?;
        let poissons = self.needed("poissons_ratio", self.material.poissons_ratio)?;
        Ok([youngs / (3.0 * (1.0 - 2.0 * poissons)), youngs / (2.0 * (1.0 + poissons))])
    }
}

fn place(phase: &str, property: &str) -> String {
    let mut place = format!("/{OPTION}/{}", pointer_segment(phase));
    if !property.is_empty() {
        place.extend(["/", property]);
    }
    place
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::export::ExportRequest;
    use crate::request::PackingRequest;

    fn fans(options: &Value) -> ExportRequest {
        let mut export = json!({"type": "voxels", "for": "fans"});
        export.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
        ExportRequest::from_json(&export).unwrap()
    }

    fn request(materials: &Value) -> PackingRequest {
        let part =
            |name: &str| json!({"name": name, "share": 0.5, "grading": {"type": "standard", "name": "A8"}});
        let value = json!({
            "specimen": {"type": "box", "size_mm": [30, 30, 30]},
            "mix": {"aggregates": [part("basalt"), part("air")], "volume_fraction": 0.3},
            "materials": materials,
        });
        PackingRequest::from_json(&value, 1).unwrap()
    }

    fn faults(error: ExportError) -> Vec<FieldError> {
        let ExportError::Invalid(faults) = error else { panic!("{error}") };
        faults
    }

    #[test]
    fn the_option_wins_over_the_request_and_what_is_missing_is_told_with_an_example() {
        let plain = fans(&json!({}));
        let fault = faults(plain.check_materials(&request(&Value::Null)).unwrap_err()).remove(0);
        assert_eq!(fault.pointer, "/materials");
        let example = fault.detail.split_once(", as ").unwrap().1;
        let example: Value = serde_json::from_str(example).unwrap();
        assert!(fans(&json!({"materials": example})).check_materials(&request(&Value::Null)).is_ok());
        assert!(plain.check_materials(&request(&example)).is_ok());

        let other = fans(
            &json!({"materials": {"matrix": {"poissons_ratio": 0.1}, "granite": {"poissons_ratio": 0}}}),
        );
        let fault = faults(other.check_materials(&request(&example)).unwrap_err()).remove(0);
        assert_eq!(fault.pointer, "/materials/granite");
        assert!(fault.detail.ends_with("\"matrix\", \"aggregate\", \"basalt\", \"air\""), "{}", fault.detail);

        // A file of materials is for the exports that name none, and others do not compute with materials.
        let given = request(&example).materials.unwrap();
        assert_eq!(plain.clone().with_materials(&given), fans(&json!({"materials": example})));
        assert_eq!(other.clone().with_materials(&given), other);
        let partial =
            json!({"matrix": {"youngs_modulus_gpa": 1, "poissons_ratio": 0.2}, "air": {"density_kg_m3": 1}});
        let missing = faults(plain.check_materials(&request(&partial)).unwrap_err());
        assert_eq!(missing.len(), 1);
        assert_eq!(missing[0].pointer, "/materials/basalt");
        let partial = json!({"matrix": {"youngs_modulus_gpa": 1}, "aggregate": {"youngs_modulus_gpa": 0},
                             "air": {"density_kg_m3": 1}});
        let missing = faults(plain.check_materials(&request(&partial)).unwrap_err());
        let pointers: Vec<&str> = missing.iter().map(|fault| &*fault.pointer).collect();
        assert_eq!(pointers, ["/materials/matrix/poissons_ratio", "/materials/air/youngs_modulus_gpa"]);
        let mesh = ExportRequest::from_json(&json!({"type": "mesh"})).unwrap();
        assert_eq!(mesh.clone().with_materials(&given), mesh);
        assert!(mesh.check_materials(&request(&Value::Null)).is_ok());
    }

    #[test]
    fn names_of_files_have_the_digits_of_the_materials() {
        let ending = |youngs: f64| {
            let materials = json!({"matrix": {"youngs_modulus_gpa": youngs}});
            fans(&json!({"cells": 40, "materials": materials})).file_ending()
        };
        let given = ending(25.0);
        let digits = given.strip_prefix("fans.cells-40.materials-").unwrap().strip_suffix(".zip").unwrap();
        assert!(digits.len() == 8 && digits.bytes().all(|c| c.is_ascii_hexdigit()), "{given}");
        assert_eq!(ending(25.0), given);
        assert_ne!(ending(26.0), given);
        assert_eq!(fans(&json!({})).file_ending(), "fans.zip");
    }

    #[test]
    fn phases_have_moduli_or_the_property_that_is_missing_is_named() {
        let materials = request(&json!({
            "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
            "aggregate": {"youngs_modulus_gpa": 70},
            "air": {"youngs_modulus_gpa": 0},
        }))
        .materials
        .unwrap();
        let names = ["basalt", "air"].map(|name| Some(name.to_owned()));
        let phases_of = phases(&materials, &names).unwrap();
        let moduli: Vec<_> = phases_of.iter().map(PhaseMaterial::moduli_gpa).collect();
        // K = E / 3 (1 - 2 nu) = 25 / 1.8, G = E / 2 (1 + nu) = 25 / 2.4
        let [bulk, shear] = *moduli[0].as_ref().unwrap();
        assert!(
            (bulk - 13.888_888_888_888_89).abs() < 1e-14 && (shear - 10.416_666_666_666_666).abs() < 1e-14
        );
        assert_eq!(moduli[1].as_ref().unwrap_err().pointer, "/materials/basalt/poissons_ratio");
        assert_eq!(moduli[2], Ok([0.0, 0.0]));
        let only_matrix: Materials = [("matrix".to_owned(), Material::default())].into_iter().collect();
        let missing = |names: &[Option<String>]| -> Vec<String> {
            faults(phases(&only_matrix, names).unwrap_err()).into_iter().map(|fault| fault.pointer).collect()
        };
        assert_eq!(missing(&names), ["/materials/basalt", "/materials/air"]);
        assert_eq!(missing(&[None, None]), ["/materials/aggregate"]);
        assert_eq!(missing(&[]), ["/materials/aggregate"]);
    }
}
