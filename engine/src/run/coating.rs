//! The volume of the grains of a packing with their coatings: each enlarged by half of the gap that it keeps from its
//! own kind.

use crate::distance::DistanceRule;
use crate::mix::sphere_volume;
use crate::packing::GrainsRef;
use crate::shape::{ParallelBody, Solid};

/// Volume in mm³ of the bodies parallel to the grains at half of their gap.
pub(super) fn volume_mm3(grains: GrainsRef<'_>, rule: &DistanceRule) -> f64 {
    let Some(solids) = grains.solids() else {
        return grains.diameters_mm().map(|d| sphere_volume(d + rule.gap_mm(d, d))).sum();
    };
    let templates: Vec<ParallelBody> = solids.templates.iter().map(ParallelBody::from).collect();
    let coated =
        |shape: &Solid| shape.coated_volume_mm3(0.5 * rule.gap_mm(shape.d_mm(), shape.d_mm()), &templates);
    solids.shapes.iter().map(coated).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use crate::control::Unattended;
    use crate::plan::{Limits, Plan};
    use crate::request::PackingRequest;
    use crate::run::pack;

    /// The planned and the counted volume fraction with coating.
    fn fractions(shape: &Value, distance: &Value, fraction: f64) -> [f64; 2] {
        let value = json!({"specimen": {"type": "box", "size_mm": [40, 40, 40]}, "distance": distance,
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "volume_fraction": fraction,
                "allow_coarse": true, "shape": shape}, "method": {"type": "rsa"}});
        let request = PackingRequest::from_json(&value, 1).unwrap();
        let plan = Plan::new(&request, &Limits::default()).unwrap();
        let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
        let summary = packing.report.summary;
        [plan.volume_fraction_with_coating, summary.volume_fraction_with_coating]
    }

    /// Equal discs `a : a : a/10` with a gap of 1 mm, by Steiner's formula with the closed forms of spheroids.
    #[test]
    fn coated_discs_have_the_volume_of_their_parallel_bodies() {
        let disc =
            json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 1, "flatness": 0.1}});
        let a = 4.0 / (2.0 * 1.01_f64).sqrt();
        let (c, e) = (0.1 * a, 0.99_f64.sqrt());
        let pi = std::f64::consts::PI;
        let surface = 2.0 * pi * a * a * (1.0 + (1.0 - e * e) / e * e.atanh());
        let volume = 4.0 / 3.0 * pi * a * a * c;
        for (distance, r) in [
            (json!({"type": "constant", "gap_mm": 1}), 0.5),
            (json!({"type": "proportional", "factor": 0.2}), 0.1 * 2.0 * (a * a * c).cbrt()),
        ] {
            let coated =
                volume + surface * r + 2.0 * pi * (c + a * e.asin() / e) * r * r + 4.0 / 3.0 * pi * r.powi(3);
            let [planned, counted] = fractions(&disc, &distance, 0.06);
            let grains = (0.06 * 64_000.0 / volume).ceil();
            assert!((counted - grains * coated / 64_000.0).abs() < 1e-9, "{counted}");
            assert!((planned - 0.06 * coated / volume).abs() < 1e-9, "{planned}");
        }
    }

    /// What is planned for laws of ratios and templates is near what is counted, and equal without a gap.
    #[test]
    fn planned_coatings_are_near_those_that_are_counted() {
        for shape in [
            json!({"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.3}}),
            json!({"type": "polyhedron", "rounding": 0.1, "template_count": 4,
                "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.4}}),
            json!({"type": "mixture", "of": [
                {"share": 0.5, "shape": {"type": "sphere"}},
                {"share": 0.5, "shape": {"type": "ellipsoid",
                    "ratios": {"type": "constant", "elongation": 0.5, "flatness": 0.5}}}]}),
        ] {
            let [planned, counted] = fractions(&shape, &json!({"type": "constant", "gap_mm": 0.6}), 0.1);
            assert!((planned / counted - 1.0).abs() < 0.02, "{shape}: {planned} {counted}");
            let [planned, counted] = fractions(&shape, &json!({"type": "none"}), 0.1);
            assert!((planned - 0.1).abs() < 1e-12 && (counted - 0.1).abs() < 0.01, "{planned} {counted}");
        }
    }
}
