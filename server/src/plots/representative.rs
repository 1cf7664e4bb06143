//! The plot of the representative volume of a study: mean and scatter of a property against the edge of the specimen,
//! and the scatter against its volume beside the fitted relation ([`crate::studies::representative`]).

use super::axis::Axis;
use super::chart::{Chart, Layout, Marks, Point, Series, SeriesStyle};
use super::names::value_label;
use crate::studies::properties::Property;
use crate::studies::representative::RepresentativeVolume;
use crate::studies::table::Table;

/// Why a plot of properties is empty.
pub(super) const NO_PROPERTIES: &str = "no run has this property: runs whose `postprocess` names `properties`, with \
                                        materials that allow it, have one";
const NO_VOLUMES: &str = "no packings of several volumes have properties: a study has them that varies \
                          `/specimen/size_mm`, and whose `postprocess` names `properties`";
/// Area of the disc of a packing, over that of the largest disc.
const PACKING_AREA: f64 = 0.04;
const PERCENT: f64 = 100.0;
/// Points of the line of a fitted relation.
const LINE_POINTS: u32 = 24;

/// A disc for one packing.
pub(super) fn disc(x: f64, y: f64) -> Point {
    Point { area: PACKING_AREA, ..Point::new(x, y) }
}

/// The discs of the packings of the series of that number.
pub(super) fn discs(number: usize, points: Vec<Point>) -> Series {
    Series { label: None, style: SeriesStyle::Numbered(number), marks: Marks::Discs, points }
}

/// The label of the axis of a property.
pub(super) fn property_label(property: Property) -> String {
    match property.unit() {
        "" => property.words().to_owned(),
        unit => format!("{} in {unit}", property.words()),
    }
}

/// Words as they begin a heading.
pub(super) fn capitalized(words: &str) -> String {
    let mut letters = words.chars();
    letters
        .next()
        .map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}

/// The chart of the first property that scatters over several volumes, which is Young's modulus where it is computed.
pub(super) fn representative_volume(title: &dyn Fn(&str) -> String, table: &Table) -> Chart {
    let Some(property) = table.representative_volumes.first().map(|of| of.property) else {
        return Chart::without_points(NO_VOLUMES);
    };
    let shown: Vec<&RepresentativeVolume> =
        table.representative_volumes.iter().filter(|of| of.property == property).collect();
    let (mut packings, mut means, mut scatters) = (Vec::new(), Vec::new(), Vec::new());
    for (number, of) in shown.iter().enumerate() {
        let label = label(of);
        let mean = |volume: &crate::studies::representative::ScatterOfVolume| {
            let interval = volume.std.map(|std| [volume.mean - std, volume.mean + std]);
            Point { interval, ..Point::new(volume.edge_mm, volume.mean) }
        };
        let mut points = Vec::new();
        for volume in &of.volumes {
            let values = table.rows.get(volume.point).map(|row| row.properties.values(property));
            points.extend(values.into_iter().flatten().map(|value| disc(volume.edge_mm, value)));
        }
        packings.push(discs(number, points));
        means.push(Series {
            label: label.clone(),
            ..Series::marked("", number, of.volumes.iter().map(mean).collect())
        });
        let scatter = |edge_mm: f64, std: f64, mean: f64| Point::new(edge_mm, PERCENT * std / mean.abs());
        let measured =
            of.volumes.iter().filter_map(|volume| Some(scatter(volume.edge_mm, volume.std?, volume.mean)));
        scatters.push(Series {
            label: None,
            style: SeriesStyle::Numbered(number),
            marks: Marks::Points,
            points: measured.collect(),
        });
        if let Some(line) = fitted(of, number, &scatter) {
            scatters.push(line);
        }
    }
    let edge = "edge of the cube of the volume in mm";
    let below = Chart {
        x: Axis::log(edge),
        y: Axis::log("std / mean in %"),
        series: scatters,
        ..Chart::without_points(NO_VOLUMES)
    };
    let heading = format!("Representative volume, {}", property.words());
    Chart {
        title: title(&heading),
        description: format!(
            "{} against the edge of the specimen with its standard deviation, and the standard deviation over the mean \
             with the relation of Kanit et al. 2003, {} series.",
            capitalized(property.words()),
            shown.len()
        ),
        x: Axis::linear(edge),
        y: Axis::linear(property_label(property)),
        series: packings.into_iter().chain(means).collect(),
        layout: Layout { below: vec![below], ..Layout::default() },
        when_empty: NO_VOLUMES.into(),
    }
}

/// The line of the fitted relation, from the smallest volume to the largest.
fn fitted(
    of: &RepresentativeVolume,
    number: usize,
    scatter: &dyn Fn(f64, f64, f64) -> Point,
) -> Option<Series> {
    let (first, last) = (of.volumes.first()?, of.volumes.last()?);
    let point = |i: u32| {
        let share = f64::from(i) / f64::from(LINE_POINTS);
        let edge_mm = first.edge_mm * (last.edge_mm / first.edge_mm).powf(share);
        Some(scatter(edge_mm, of.std_at(edge_mm.powi(3))?, last.mean))
    };
    let points = (0..=LINE_POINTS).map(point).collect::<Option<Vec<Point>>>()?;
    let (alpha, range) = (of.alpha?, of.integral_range_mm3?);
    let decimals = (2.0 - range.log10().floor()).max(0.0) as usize;
    let label = format!("\u{3B1} = {alpha:.2}, A3 = {range:.decimals$} mm\u{B3}");
    Some(Series::line(label, number, points))
}

/// The name of a series: the columns that do not depend on the volume.
fn label(of: &RepresentativeVolume) -> Option<String> {
    let parts: Vec<String> = of.values.iter().map(|(column, value)| value_label(column, value)).collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}
