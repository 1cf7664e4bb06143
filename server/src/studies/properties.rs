//! The effective properties of the runs of a study, and their mean and standard deviation over the runs of a point.
//!
//! A run has the properties of the exports `properties` that the request of its job names. Where several exports
//! compute the same property, the first of them counts.

use std::collections::BTreeMap;

use packstone_engine::export::ExportReport;
use packstone_engine::export::properties::{CellKind, PropertyReport};
use packstone_engine::request::Material;
use serde::{Deserialize, Serialize};

use super::Row;
use super::table::Cell;

/// Declares the properties once: for their names, units and words.
macro_rules! properties {
    ($($(#[$doc:meta])* $property:ident $name:literal $unit:literal $words:literal,)*) => {
        /// An effective property of a packing.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub(crate) enum Property {
            $($(#[$doc])* #[serde(rename = $name)] $property,)*
        }

        impl Property {
            /// All of them, in the order of the columns.
            pub(crate) const ALL: &[Self] = &[$(Self::$property,)*];

            /// Its name with its unit, from which the names of its columns begin.
            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$property => $name,)* }
            }

            /// Its unit; empty where it is a number.
            pub(crate) fn unit(self) -> &'static str {
                match self { $(Self::$property => $unit,)* }
            }

            /// What it is called in plots.
            pub(crate) fn words(self) -> &'static str {
                match self { $(Self::$property => $words,)* }
            }
        }
    };
}

properties! {
    /// Young's modulus of the nearest isotropic material.
    YoungsModulus "youngs_modulus_gpa" "GPa" "Young's modulus",
    /// Poisson's ratio of the nearest isotropic material.
    PoissonsRatio "poissons_ratio" "" "Poisson's ratio",
    /// Bulk modulus of the nearest isotropic material.
    BulkModulus "bulk_modulus_gpa" "GPa" "bulk modulus",
    /// Shear modulus of the nearest isotropic material.
    ShearModulus "shear_modulus_gpa" "GPa" "shear modulus",
    /// Universal anisotropy index.
    UniversalAnisotropy "universal_anisotropy" "" "universal anisotropy index",
    /// A third of the trace of the thermal expansion.
    Expansion "expansion_1_k" "1/K" "thermal expansion",
    /// A third of the trace of the conductivity.
    Conductivity "conductivity_w_m_k" "W/(m K)" "conductivity",
    /// A third of the trace of the diffusivity.
    Diffusivity "diffusivity_m2_s" "m\u{B2}/s" "diffusivity",
}

#[cfg(test)]
impl utoipa::PartialSchema for Property {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        utoipa::openapi::ObjectBuilder::new()
            .schema_type(utoipa::openapi::schema::Type::String)
            .description(Some("An effective property of a packing."))
            .enum_values(Some(Self::ALL.iter().map(|property| property.name())))
            .build()
            .into()
    }
}

#[cfg(test)]
impl utoipa::ToSchema for Property {
    fn name() -> std::borrow::Cow<'static, str> {
        "StudyProperty".into()
    }
}

/// What is computed of the values of a property over the runs of a point, in the order of its columns.
pub(crate) const FIGURES: [&str; 3] = ["mean", "std", "count"];

/// The column of the number of runs whose properties are still to be computed.
pub(crate) const WAITING: &str = "properties_waiting";

impl Property {
    /// Its value in a report.
    fn of_report(self, report: &PropertyReport) -> Option<f64> {
        let stiffness = report.stiffness.as_ref();
        match self {
            Self::YoungsModulus => Some(stiffness?.isotropic.youngs_modulus_gpa),
            Self::PoissonsRatio => Some(stiffness?.isotropic.poissons_ratio),
            Self::BulkModulus => Some(stiffness?.isotropic.bulk_modulus_gpa),
            Self::ShearModulus => Some(stiffness?.isotropic.shear_modulus_gpa),
            Self::UniversalAnisotropy => stiffness?.universal_anisotropy,
            Self::Expansion => Some(report.expansion.as_ref()?.isotropic_1_k),
            Self::Conductivity => Some(report.conductivity.as_ref()?.isotropic),
            Self::Diffusivity => Some(report.diffusivity.as_ref()?.isotropic),
        }
    }

    /// Its value in a phase, where the contrast of the phases is a measure of its scatter.
    fn of_phase(self, material: &Material) -> Option<f64> {
        let modulus = |over: fn(f64) -> f64| match material.youngs_modulus_gpa? {
            0.0 => Some(0.0),
            e => Some(e / over(material.poissons_ratio?)),
        };
        match self {
            Self::YoungsModulus => material.youngs_modulus_gpa,
            Self::BulkModulus => modulus(|nu| 3.0 * (1.0 - 2.0 * nu)),
            Self::ShearModulus => modulus(|nu| 2.0 * (1.0 + nu)),
            Self::Expansion => material.expansion_1_k,
            Self::Conductivity => material.conductivity_w_m_k,
            Self::Diffusivity => material.diffusivity_m2_s,
            Self::PoissonsRatio | Self::UniversalAnisotropy => None,
        }
    }

    /// The variance of its value over the points of a packing, whose phases have it.
    fn phase_variance(self, report: &PropertyReport) -> Option<f64> {
        let of_phase = |phase: &packstone_engine::export::properties::PropertyPhase| {
            Some((phase.exact_share, self.of_phase(&phase.material)?))
        };
        let phases = report.phases.iter().map(of_phase).collect::<Option<Vec<(f64, f64)>>>()?;
        let mean: f64 = phases.iter().map(|(share, value)| share * value).sum();
        Some(phases.iter().map(|(share, value)| share * (value - mean) * (value - mean)).sum())
    }

    /// The names of its columns.
    pub(crate) fn columns(self) -> [String; 3] {
        FIGURES.map(|figure| format!("{}_{figure}", self.name()))
    }
}

/// A property of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PropertyValue {
    pub(crate) value: f64,
    /// Variance of the property over the points of the packing, by the shares of the phases; in its unit squared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) phase_variance: Option<f64>,
}

/// The properties of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PropertyFacts {
    /// Volume of the specimen.
    pub(crate) volume_mm3: f64,
    pub(crate) values: BTreeMap<Property, PropertyValue>,
}

impl PropertyFacts {
    /// Of the reports of the exports of a run, in the order of its request; none without properties.
    pub(crate) fn of_reports(reports: impl IntoIterator<Item = ExportReport>) -> Option<Self> {
        let mut facts: Option<Self> = None;
        for report in reports {
            let ExportReport::Properties(report) = report else { continue };
            let facts = facts.get_or_insert_with(|| Self {
                volume_mm3: specimen_volume_mm3(&report),
                values: BTreeMap::new(),
            });
            for &property in Property::ALL {
                if let Some(value) = property.of_report(&report) {
                    let phase_variance = property.phase_variance(&report);
                    facts.values.entry(property).or_insert(PropertyValue { value, phase_variance });
                }
            }
        }
        facts
    }
}

/// The volume of the specimen that a cell was made of.
fn specimen_volume_mm3(report: &PropertyReport) -> f64 {
    let specimens = if report.cell.kind == CellKind::MirroredBox { 8.0 } else { 1.0 };
    report.cell.size_mm.iter().product::<f64>() / specimens
}

/// Mean and standard deviation of a property over runs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    /// Number of runs.
    pub(crate) count: u64,
    pub(crate) mean: Option<f64>,
    /// Standard deviation of the population, estimated with `count - 1`; none of fewer than two runs.
    pub(crate) std: Option<f64>,
}

impl Sample {
    pub(crate) fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = (!values.is_empty()).then(|| values.iter().sum::<f64>() / n);
        let squares = mean.map(|mean| values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>());
        let std = squares.filter(|_| values.len() > 1).map(|squares| (squares / (n - 1.0)).sqrt());
        Self { count: values.len() as u64, mean, std }
    }
}

/// The properties of the runs of a point that reached their packing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RowProperties {
    /// The properties that any row of the table has.
    pub(crate) samples: Vec<(Property, Sample)>,
    /// Runs whose properties are still to be computed; none where no run of the table has any.
    pub(crate) waiting: Option<u64>,
    /// The properties of each run, and the volume fraction of its grains.
    pub(crate) runs: Vec<(Option<f64>, PropertyFacts)>,
}

impl RowProperties {
    /// The values of a property.
    pub(crate) fn values(&self, property: Property) -> Vec<f64> {
        self.of(property).map(|(_, value)| value.value).collect()
    }

    /// The runs that have a property: their volume fraction, and its value.
    pub(crate) fn of(&self, property: Property) -> impl Iterator<Item = (Option<f64>, PropertyValue)> {
        self.runs.iter().filter_map(move |(fraction, facts)| Some((*fraction, *facts.values.get(&property)?)))
    }

    /// Mean and standard deviation of a property.
    pub(crate) fn sample(&self, property: Property) -> Sample {
        self.samples
            .iter()
            .find(|(of, _)| *of == property)
            .map_or_else(Sample::default, |(_, sample)| *sample)
    }

    /// Names and values of the columns.
    pub(crate) fn cells(&self) -> Vec<(String, Cell)> {
        let of = |(property, sample): &(Property, Sample)| {
            let [mean, std, count] = property.columns();
            let Sample { count: n, mean: of_mean, std: of_std } = *sample;
            [(mean, of_mean.into()), (std, of_std.into()), (count, Cell::from(n))]
        };
        let waiting = self.waiting.map(|n| (WAITING.to_owned(), Cell::from(n)));
        self.samples.iter().flat_map(of).chain(waiting).collect()
    }
}

/// Computes the columns of the properties, which rows have of all that any run has.
pub(super) fn sum_up(rows: &mut [Row]) {
    let has = |property: Property| rows.iter().any(|row| row.properties.of(property).next().is_some());
    let shown: Vec<Property> = Property::ALL.iter().copied().filter(|property| has(*property)).collect();
    if shown.is_empty() {
        return;
    }
    for row in rows {
        let sample = |property: &Property| (*property, Sample::of(&row.properties.values(*property)));
        row.properties.samples = shown.iter().map(sample).collect();
        row.properties.waiting.get_or_insert(0);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    /// The report of a box of 10 mm with one ball, with these options.
    fn report(options: &Value) -> ExportReport {
        use packstone_engine::export::{ExportRequest, Model};
        use packstone_engine::request::{Boundary, Specimen};
        use packstone_engine::{Limits, Spheres, Unattended};
        let specimen = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Walls };
        let mut ball = Spheres::default();
        ball.push([5.0; 3], 6.0);
        let mut options = options.clone();
        options["type"] = json!("properties");
        options["cells"] = json!(8);
        let export = ExportRequest::from_json(&options).unwrap();
        let model = Model::new(&specimen, &ball);
        export.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap()
    }

    #[test]
    fn means_and_deviations_are_those_of_the_textbook() {
        assert_eq!(Sample::of(&[]), Sample::default());
        assert_eq!(Sample::of(&[3.0]), Sample { count: 1, mean: Some(3.0), std: None });
        // 2, 4, 4, 4, 5, 5, 7, 9: mean 5, sum of squares 32.
        let sample = Sample::of(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert_eq!((sample.count, sample.mean), (8, Some(5.0)));
        assert!((sample.std.unwrap() - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_run_has_the_first_value_of_each_property_and_the_variance_of_its_phases() {
        let of = |e: f64, nu: f64, k: f64| json!({"youngs_modulus_gpa": e, "poissons_ratio": nu, "conductivity_w_m_k": k});
        let materials = json!({"matrix": of(20.0, 0.2, 1.0), "aggregate": of(60.0, 0.25, 4.0)});
        let stiff = report(&json!({"materials": materials, "kinds": "stiffness", "walls": "mirrored"}));
        let conducts = report(&json!({"materials": materials, "kinds": "conductivity"}));
        let other = json!({"matrix": of(1.0, 0.1, 7.0), "aggregate": of(1.0, 0.1, 7.0)});
        let later = report(&json!({"materials": other, "kinds": "stiffness"}));
        let facts = PropertyFacts::of_reports([stiff.clone(), conducts, later]).unwrap();
        // The mirrored cell has eight times the volume.
        assert!((facts.volume_mm3 - 1000.0).abs() < 1e-9, "{facts:?}");
        let ExportReport::Properties(stiff) = stiff else { panic!("other properties") };
        let value = |property| facts.values[&property];
        let isotropic = stiff.stiffness.unwrap().isotropic;
        assert_eq!(value(Property::YoungsModulus).value.to_bits(), isotropic.youngs_modulus_gpa.to_bits());
        assert!(value(Property::Conductivity).value > 1.0 && value(Property::Conductivity).value < 4.0);
        assert!(!facts.values.contains_key(&Property::Diffusivity));
        let share = std::f64::consts::PI / 6.0 * 0.216;
        // Of two phases f (1 - f) (z_1 - z_2)^2: K = E / (3 (1 - 2 nu)), G = E / (2 (1 + nu)).
        for (property, difference) in [
            (Property::YoungsModulus, 40.0),
            (Property::BulkModulus, 60.0 / 1.5 - 20.0 / 1.8),
            (Property::ShearModulus, 60.0 / 2.5 - 20.0 / 2.4),
            (Property::Conductivity, 3.0),
        ] {
            let expected = share * (1.0 - share) * difference * difference;
            let found = value(property).phase_variance.unwrap();
            assert!((found / expected - 1.0).abs() < 1e-12, "{property:?}: {found} {expected}");
        }
        assert_eq!(value(Property::PoissonsRatio).phase_variance, None);
        assert_eq!(PropertyFacts::of_reports([]), None);
        // The form that is stored is read back.
        let text = serde_json::to_string(&facts).unwrap();
        assert!(text.contains("\"youngs_modulus_gpa\":{\"value\":"), "{text}");
        assert_eq!(serde_json::from_str::<PropertyFacts>(&text).unwrap(), facts);
    }
}
