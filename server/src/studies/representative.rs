//! The size of the representative volume of a property, from the scatter of the property over packings of several
//! volumes.
//!
//! Kanit, Forest, Galliet, Mounoury and Jeulin (2003, <https://doi.org/10.1016/S0020-7683(03)00143-4>): the variance of
//! a property `Z` over packings of the volume `V` is `D_Z^2(V) = D_Z^2 (A_3 / V)^alpha`, with the variance `D_Z^2` of
//! the property over the points of the phases, the integral range `A_3`, and an exponent that is 1 for quantities that
//! are means over the volume. `A_3` and `alpha` are fitted. The mean of `n` packings has the relative error `2 D_Z(V) /
//! (Z sqrt(n))` with a confidence of 95 %, so that `n = 4 D_Z^2(V) / (eps^2 Z^2)`.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value};

use super::Row;
use super::properties::{Property, Sample};

/// The relative error for which packings are counted and the volume is determined.
pub(crate) const RELATIVE_ERROR: f64 = 0.01;

/// How a property scatters over packings of several volumes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct RepresentativeVolume {
    /// The columns of the study that do not depend on the volume, and their values.
    #[cfg_attr(test, schema(value_type = Object))]
    pub(crate) values: Map<String, Value>,
    /// The property.
    pub(crate) property: Property,
    /// Variance of the property over the points of the packings (`D_Z^2` of the phase contrast), in its unit squared;
    /// `null` of properties that the phases do not have.
    #[cfg_attr(test, schema(required))]
    pub(crate) phase_variance: Option<f64>,
    /// Exponent of the volume in the variance, fitted; `null` where the scatter does not decrease.
    #[cfg_attr(test, schema(required))]
    pub(crate) alpha: Option<f64>,
    /// Integral range `A_3`, fitted.
    #[cfg_attr(test, schema(required))]
    pub(crate) integral_range_mm3: Option<f64>,
    /// Edge of the cube of which one packing has the property with a relative error of 1 %, by the fit. Below the
    /// smallest edge of the study the fit is not tested: take that one.
    #[cfg_attr(test, schema(required))]
    pub(crate) edge_mm: Option<f64>,
    /// The volumes, the smallest first.
    pub(crate) volumes: Vec<ScatterOfVolume>,
}

/// A property of packings of one volume.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ScatterOfVolume {
    /// Index of the row of the table.
    pub(crate) point: usize,
    /// Volume of the specimen.
    pub(crate) volume_mm3: f64,
    /// Edge of the cube of this volume.
    pub(crate) edge_mm: f64,
    /// Packings.
    pub(crate) count: u64,
    /// Mean of the property.
    pub(crate) mean: f64,
    /// Its standard deviation; `null` of one packing.
    #[cfg_attr(test, schema(required))]
    pub(crate) std: Option<f64>,
    /// Packings of this volume whose mean has a relative error of 1 %, at least 1.
    #[cfg_attr(test, schema(required))]
    pub(crate) realisations: Option<u64>,
}

/// A fitted relation.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fit {
    alpha: f64,
    integral_range_mm3: f64,
}

impl RepresentativeVolume {
    /// The standard deviation of the property at a volume, by the fit.
    pub(crate) fn std_at(&self, volume_mm3: f64) -> Option<f64> {
        let (alpha, range) = (self.alpha?, self.integral_range_mm3?);
        Some((self.phase_variance? * (range / volume_mm3).powf(alpha)).sqrt())
    }

    fn new(property: Property, values: Map<String, Value>, rows: &[(usize, f64, &Row)]) -> Option<Self> {
        let volume = |&(point, volume_mm3, row): &(usize, f64, &Row)| {
            let Sample { count, mean, std } = row.properties.sample(property);
            let mean = mean?;
            let realisations = std.filter(|_| mean != 0.0).map(|std| realisations(std, mean));
            let edge_mm = volume_mm3.cbrt();
            Some(ScatterOfVolume { point, volume_mm3, edge_mm, count, mean, std, realisations })
        };
        let mut volumes: Vec<ScatterOfVolume> = rows.iter().filter_map(volume).collect();
        volumes.sort_by(|a, b| a.volume_mm3.total_cmp(&b.volume_mm3));
        let largest = volumes.last().filter(|_| volumes.len() > 1)?;
        let runs = rows.iter().flat_map(|(_, _, row)| row.properties.of(property));
        let variances: Option<Vec<f64>> = runs.map(|(_, value)| value.phase_variance).collect();
        let phase_variance = variances.and_then(|variances| Sample::of(&variances).mean);
        let fit = phase_variance.and_then(|variance| fit(&volumes, variance));
        let edge_mm = fit.zip(phase_variance).and_then(|(fit, variance)| {
            let error = RELATIVE_ERROR * largest.mean;
            let ratio = 4.0 * variance / (error * error);
            let edge = (fit.integral_range_mm3 * ratio.powf(1.0 / fit.alpha)).cbrt();
            edge.is_finite().then_some(edge)
        });
        Some(Self {
            values,
            property,
            phase_variance,
            alpha: fit.map(|fit| fit.alpha),
            integral_range_mm3: fit.map(|fit| fit.integral_range_mm3),
            edge_mm,
            volumes,
        })
    }
}

/// `n = 4 D_Z^2(V) / (eps^2 Z^2)`, rounded up.
fn realisations(std: f64, mean: f64) -> u64 {
    let ratio = 2.0 * std / (RELATIVE_ERROR * mean);
    // Rounding errors of the statistics do not ask for another packing.
    ((ratio * ratio * (1.0 - 1e-9)).ceil() as u64).max(1)
}

/// Fits `ln D_Z^2(V) = ln D_Z^2 + alpha (ln A_3 - ln V)` by least squares, each volume with the weight `n - 1`: the
/// variance of the logarithm of a variance of `n` values is about `2 / (n - 1)`. None of fewer than two volumes with a
/// scatter, and where the scatter does not decrease.
fn fit(volumes: &[ScatterOfVolume], phase_variance: f64) -> Option<Fit> {
    let scattered = |of: &ScatterOfVolume| {
        let std = of.std.filter(|std| *std > 0.0)?;
        Some((of.count.saturating_sub(1) as f64, of.volume_mm3.ln(), 2.0 * std.ln()))
    };
    let points: Vec<(f64, f64, f64)> = volumes.iter().filter_map(scattered).collect();
    let weight: f64 = points.iter().map(|(w, _, _)| w).sum();
    let mean = |of: fn(&(f64, f64, f64)) -> f64| points.iter().map(|p| p.0 * of(p)).sum::<f64>() / weight;
    let (x, y) = (mean(|p| p.1), mean(|p| p.2));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (w, of_x, of_y) in &points {
        xx += w * (of_x - x) * (of_x - x);
        xy += w * (of_x - x) * (of_y - y);
    }
    let alpha = -xy / xx;
    let integral_range_mm3 = (x + (y - phase_variance.ln()) / alpha).exp();
    let holds = points.len() > 1 && alpha > 0.0 && integral_range_mm3.is_finite() && integral_range_mm3 > 0.0;
    holds.then_some(Fit { alpha, integral_range_mm3 })
}

/// A row of a table with its number and the volume of its specimens in mm³.
type SizedRow<'a> = (usize, f64, &'a Row);

/// The representative volumes of a table whose points have several volumes: one for each property, and for each
/// combination of the columns that do not depend on the volume.
pub(super) fn of_rows(columns: &[String], rows: &[Row]) -> Vec<RepresentativeVolume> {
    let sized: Vec<SizedRow<'_>> = rows
        .iter()
        .enumerate()
        .filter_map(|(point, row)| Some((point, row.properties.runs.first()?.1.volume_mm3, row)))
        .collect();
    let kept: Vec<usize> = (0..columns.len()).filter(|column| !follows_volume(*column, &sized)).collect();
    let mut groups: Vec<(Map<String, Value>, Vec<SizedRow<'_>>)> = Vec::new();
    for of in sized {
        let values: Map<String, Value> =
            kept.iter().filter_map(|column| of.2.values.get(*column).cloned()).collect();
        match groups.iter_mut().find(|(known, _)| *known == values) {
            Some((_, rows)) => rows.push(of),
            None => groups.push((values, vec![of])),
        }
    }
    let mut found = Vec::new();
    for &property in Property::ALL {
        for (values, rows) in &groups {
            found.extend(RepresentativeVolume::new(property, values.clone(), rows));
        }
    }
    found
}

/// Whether all points of one volume have the same value of a column.
fn follows_volume(column: usize, sized: &[(usize, f64, &Row)]) -> bool {
    let mut known: BTreeMap<u64, &Value> = BTreeMap::new();
    sized.iter().all(|(_, volume_mm3, row)| {
        let Some((_, value)) = row.values.get(column) else { return true };
        *known.entry(volume_mm3.to_bits()).or_insert(value) == value
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::super::properties::{PropertyFacts, PropertyValue, sum_up};
    use super::*;

    const PHASE_VARIANCE: f64 = 400.0;

    /// A point with these values of Young's modulus in cubes of an edge.
    fn row(values: &[(&str, Value)], edge_mm: f64, moduli: &[f64]) -> Row {
        let mut row = Row {
            values: values.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect(),
            ..Row::default()
        };
        let run = |modulus: &f64| {
            let value = PropertyValue { value: *modulus, phase_variance: Some(PHASE_VARIANCE) };
            let values = BTreeMap::from([(Property::YoungsModulus, value)]);
            (Some(0.4), PropertyFacts { volume_mm3: edge_mm.powi(3), values })
        };
        row.properties.runs = moduli.iter().map(run).collect();
        row
    }

    fn found(columns: &[&str], mut rows: Vec<Row>) -> Vec<RepresentativeVolume> {
        sum_up(&mut rows);
        of_rows(&columns.iter().map(ToString::to_string).collect::<Vec<_>>(), &rows)
    }

    /// Two values with that mean and standard deviation.
    fn pair(mean: f64, std: f64) -> [f64; 2] {
        [mean - std / 2.0_f64.sqrt(), mean + std / 2.0_f64.sqrt()]
    }

    #[test]
    fn the_relation_is_recovered_from_values_that_obey_it() {
        let (alpha, range) = (0.9, 120.0);
        let std = |edge: f64| (PHASE_VARIANCE * (range / edge.powi(3)).powf(alpha)).sqrt();
        let rows =
            [20.0, 40.0, 30.0].map(|edge| row(&[("/size", json!(edge))], edge, &pair(35.0, std(edge))));
        let volumes = found(&["/size"], rows.to_vec());
        assert_eq!(volumes.len(), 1, "{volumes:?}");
        let of = &volumes[0];
        assert_eq!((of.property, &of.values), (Property::YoungsModulus, &Map::new()));
        assert!((of.alpha.unwrap() - alpha).abs() < 1e-12, "{of:?}");
        assert!((of.integral_range_mm3.unwrap() / range - 1.0).abs() < 1e-12, "{of:?}");
        assert!((of.std_at(8000.0).unwrap() / std(20.0) - 1.0).abs() < 1e-12);
        assert_eq!(of.volumes.iter().map(|of| of.point).collect::<Vec<_>>(), [0, 2, 1], "the smallest first");
        for of in &of.volumes {
            let expected = 4.0 * std(of.edge_mm).powi(2) / (0.01_f64 * 35.0).powi(2);
            assert_eq!(of.realisations, Some(expected.ceil() as u64), "{of:?}");
        }
        // One packing of this edge has twice the standard deviation over the mean equal to 1 %.
        let edge = of.edge_mm.unwrap();
        assert!((2.0 * std(edge) / 35.0 - 0.01).abs() < 1e-12, "{edge}");
    }

    /// By hand: standard deviations 2 and 1 at volumes 1000 and 8000 are `alpha = 2 ln 2 / ln 8 = 2/3`, and with
    /// `D_Z^2 = 400` it is `4 = 400 (A_3 / 1000)^(2/3)`, so that `A_3 = 1`.
    #[test]
    fn two_volumes_have_the_relation_of_a_hand_calculation() {
        let rows = vec![row(&[], 10.0, &pair(50.0, 2.0)), row(&[], 20.0, &pair(50.0, 1.0))];
        let of = found(&[], rows).remove(0);
        assert!((of.alpha.unwrap() - 2.0 / 3.0).abs() < 1e-12, "{of:?}");
        assert!((of.integral_range_mm3.unwrap() - 1.0).abs() < 1e-9, "{of:?}");
        assert_eq!(of.volumes.iter().map(|of| of.realisations).collect::<Vec<_>>(), [Some(64), Some(16)]);
        // n = 1: V^(2/3) = 4 * 400 / (0.01 * 50)^2 = 6400, the edge is its root.
        assert!((of.edge_mm.unwrap() - 80.0).abs() < 1e-9, "{of:?}");
    }

    #[test]
    fn points_are_grouped_by_what_does_not_follow_the_volume() {
        let point = |fraction: f64, edge: f64, cells: u32, std: f64| {
            let values = [
                ("/f", json!(fraction)),
                ("/specimen/size_mm", json!([edge, edge, edge])),
                ("/cells", json!(cells)),
            ];
            row(&values, edge, &pair(30.0 + fraction, std))
        };
        let rows = vec![
            point(0.3, 10.0, 32, 1.0),
            point(0.3, 20.0, 64, 0.5),
            point(0.4, 10.0, 32, 0.8),
            point(0.4, 20.0, 64, 0.9),
        ];
        let volumes = found(&["/f", "/specimen/size_mm", "/cells"], rows);
        let values: Vec<Value> = volumes.iter().map(|of| json!(of.values)).collect();
        assert_eq!(values, [json!({"/f": 0.3}), json!({"/f": 0.4})]);
        assert!(volumes[0].alpha.is_some());
        // A scatter that grows with the volume has no range.
        assert_eq!((volumes[1].alpha, volumes[1].integral_range_mm3, volumes[1].edge_mm), (None, None, None));
        assert_eq!(volumes[1].volumes.len(), 2);
    }

    #[test]
    fn one_volume_and_one_packing_have_no_relation() {
        let rows = vec![
            row(&[("/f", json!(1))], 10.0, &[30.0, 31.0]),
            row(&[("/f", json!(2))], 10.0, &[30.0, 31.0]),
        ];
        assert!(found(&["/f"], rows).is_empty());
        let of = found(&[], vec![row(&[], 10.0, &[30.0]), row(&[], 20.0, &pair(30.0, 0.1))]).remove(0);
        assert_eq!((of.volumes[0].std, of.volumes[0].realisations, of.alpha), (None, None, None));
        // Equal values have no scatter to fit.
        let of = found(&[], vec![row(&[], 10.0, &[30.0; 3]), row(&[], 20.0, &[30.0; 3])]).remove(0);
        assert_eq!((of.volumes[0].std, of.volumes[0].realisations, of.alpha), (Some(0.0), Some(1), None));
    }
}
