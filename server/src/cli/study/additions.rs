//! What the command line adds to the jobs of a study: materials and exports.
//!
//! They become part of the request before it is read, so that the folder of the study records them and a study that is
//! resumed with others is refused.

use clap::Args;
use packstone_engine::export::ExportRequest;
use serde_json::{Map, Value};

use super::super::exit::{Exit, Failure};
use super::super::exports::{self, MaterialsFile};
use super::super::input::Input;

/// Options that add to each job of a study.
#[derive(Args)]
pub(super) struct Additions {
    /// An export that each job makes, below `results`, as if its `postprocess` named it; `properties` become columns of
    /// the table. May be repeated
    #[arg(long, value_name = "TYPE[:OPTION=VALUE,...]", value_parser = exports::parse)]
    export: Vec<ExportRequest>,
    #[command(flatten)]
    materials: MaterialsFile,
}

impl Additions {
    /// Adds them to the template of a study, or to each job of its list. Faults of the study itself are left to its
    /// reader.
    pub(super) fn add_to(&self, request: &mut Value, input: &Input) -> Result<(), Failure> {
        let materials = self.materials.read(input)?.map(serde_json::to_value).transpose()?;
        let exports = self.export.iter().map(serde_json::to_value).collect::<Result<Vec<_>, _>>()?;
        if materials.is_some() {
            refuse_varied(request, "materials", "--materials")?;
        }
        if !exports.is_empty() {
            refuse_varied(request, "postprocess", "--export")?;
        }
        for job in jobs(request) {
            if let Some(materials) = &materials {
                job.insert("materials".into(), materials.clone());
            }
            if !exports.is_empty() {
                let own = match job.get("postprocess") {
                    None | Some(Value::Null) => Vec::new(),
                    Some(Value::Array(list)) => list.clone(),
                    Some(one) => vec![one.clone()],
                };
                let all: Vec<Value> = own.into_iter().chain(exports.iter().cloned()).collect();
                job.insert("postprocess".into(), all.into());
            }
        }
        Ok(())
    }
}

/// The jobs of a study that are objects.
fn jobs(request: &mut Value) -> Vec<&mut Map<String, Value>> {
    let Some(study) = request.as_object_mut() else { return Vec::new() };
    let mut jobs = Vec::new();
    for (name, value) in study {
        match (name.as_str(), value) {
            ("template", Value::Object(job)) => jobs.push(job),
            ("list", Value::Array(list)) => jobs.extend(list.iter_mut().filter_map(Value::as_object_mut)),
            _ => {}
        }
    }
    jobs
}

/// Refuses an option for a field that the study varies.
fn refuse_varied(request: &Value, field: &str, option: &str) -> Result<(), Failure> {
    for axes in ["grid", "zip"] {
        let keys = request.get(axes).and_then(Value::as_object).into_iter().flat_map(Map::keys);
        for key in keys {
            if key.split('/').nth(1) == Some(field) {
                return Err(Exit::BadInput.because(format_args!(
                    "{option} is refused: the study varies {key} by its {axes}; put them into the template instead"
                )));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    fn additions(materials: &str, exports: &[&str]) -> (tempfile::TempDir, Additions) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("materials.json");
        std::fs::write(&file, materials).unwrap();
        let export = exports.iter().map(|text| exports::parse(text).unwrap()).collect();
        (folder, Additions { export, materials: MaterialsFile::of(file) })
    }

    fn added(mut request: Value) -> Result<Value, String> {
        let materials = r#"{"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}}"#;
        let (_folder, additions) = additions(materials, &["properties:cells=32", "slice"]);
        additions.add_to(&mut request, &Input::default()).map_err(|failure| failure.to_string())?;
        Ok(request)
    }

    #[test]
    fn each_job_gets_the_materials_and_the_exports_after_its_own() {
        let types = |job: &Value| -> Vec<String> {
            job["postprocess"].as_array().unwrap().iter().map(|one| one["type"].to_string()).collect()
        };
        let ours = ["\"properties\"", "\"slice\""];
        let study = added(json!({"template": {"materials": {"matrix": {}}, "seed": 1}})).unwrap();
        assert_eq!(study["template"]["materials"]["matrix"]["youngs_modulus_gpa"], 25.0);
        assert_eq!(
            (types(&study["template"]), &study["template"]["seed"]),
            (ours.map(String::from).to_vec(), &json!(1))
        );
        assert_eq!(study["template"]["postprocess"][0]["cells"], 32);
        let list = added(json!({"list": [
            {"postprocess": {"type": "mesh"}}, {"postprocess": [{"type": "ldpm"}]}, {"postprocess": null}, 7
        ]}))
        .unwrap();
        let firsts: Vec<usize> = (0..3).map(|i| types(&list["list"][i]).len()).collect();
        assert_eq!(firsts, [3, 3, 2]);
        assert_eq!(list["list"][3], 7, "left to the reader of the study");
        assert_eq!(added(json!([1])).unwrap(), json!([1]));
    }

    #[test]
    fn what_the_study_varies_is_not_replaced() {
        for (key, option) in [("/materials/aggregate", "--materials"), ("/postprocess/0/cells", "--export")] {
            for axes in ["grid", "zip"] {
                let refused = added(json!({"template": {}, axes: {key: [1]}})).unwrap_err();
                assert!(refused.contains(option) && refused.contains(key), "{refused}");
            }
        }
    }
}
