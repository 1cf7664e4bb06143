//! The plot of the quality of a packing: volumes near the walls by size, near pairs by ratio of diameters, and bond
//! order, each beside what chance gives.

use std::io;

use packstone_engine::Unattended;
use packstone_engine::analysis::quality::{
    BondOrder, ContactFigures, QualityClass, QualityReport, WallFigures, quality, wall_layers,
};
use packstone_engine::packing::Grains;
use packstone_engine::request::PackingRequest;

use super::axis::{Axis, plain};
use super::chart::{Chart, Layout, Point, Series};
use super::job::{PERCENT, rounded, title};

/// Layers along the walls, and their depth in largest diameters.
const LAYERS: usize = 32;
const DEPTH_DIAMETERS: f64 = 1.0;
/// Bins of ratios in which chance gives fewer near pairs are left out: their relative error is above 1/4.
const FEWEST_PAIRS: f64 = 16.0;
/// Coherent bonds of a solid-like grain.
const SOLID_BONDS: f64 = packstone_engine::analysis::quality::order::SOLID_BONDS as f64;

/// The charts that have data, one below the other.
///
/// # Errors
/// The system refused memory.
pub(super) fn chart(request: &PackingRequest, grains: &Grains, name: Option<&str>) -> io::Result<Chart> {
    let report = quality(grains, &request.specimen, &Unattended)?;
    let bounds: Vec<f64> =
        (1..=LAYERS).map(|i| DEPTH_DIAMETERS * report.d_max_mm * i as f64 / LAYERS as f64).collect();
    let walls = wall_layers(grains, &request.specimen, &bounds, &Unattended)?;
    let panels = [
        walls.map(|walls| of_walls(&walls, &report.classes)),
        report.contacts.as_ref().map(of_pairs),
        report.bond_order.as_ref().map(of_bonds),
    ];
    let mut panels = panels.into_iter().flatten().filter(|panel| !panel.is_empty());
    let Some(first) = panels.next() else {
        return Ok(Chart::without_points(
            "too few grains, or a specimen too small for them: a packing of more grains has a `quality`",
        ));
    };
    Ok(Chart {
        title: title("Quality of the packing", name),
        description: described(&report),
        layout: Layout { below: panels.collect(), ..first.layout },
        ..first
    })
}

/// One sentence for each measure.
fn described(report: &QualityReport) -> String {
    let mut said = vec![format!("Quality of {} grains.", report.grains)];
    if let Some(found) = &report.contacts {
        if let Some(correlation) = found.mark_correlation {
            said.push(format!("The mark correlation of near pairs is {}.", plain(correlation, Some(2))));
        }
        said.push(format!(
            "{} % of the near pairs are of like size, {} % if partners were shuffled.",
            plain(PERCENT * found.like_share, Some(1)),
            plain(PERCENT * found.like_share_shuffled, Some(1))
        ));
    }
    if let Some(found) = &report.bond_order {
        said.push(format!(
            "Q6 is {}, by chance {}; {} % of the grains are solid-like.",
            plain(found.q6, Some(3)),
            plain(found.q6_by_chance, Some(3)),
            plain(PERCENT * found.solid_like_share, Some(1))
        ));
    }
    if let Some(found) = &report.blocks {
        said.push(format!(
            "The volume of the finest third varies by {} from block to block, {} if its grains were independent.",
            plain(found.fine_variation, Some(3)),
            plain(found.fine_variation_independent, Some(3))
        ));
    }
    said.join(" ")
}

fn panel(x: Axis, y: Axis, series: Vec<Series>) -> Chart {
    Chart { x, y, series, ..Chart::without_points("") }
}

/// Volume fraction of each class in thin layers over that in the core.
fn of_walls(walls: &WallFigures, classes: &[QualityClass]) -> Chart {
    let deepest = walls.core.from_mm;
    let mut series = vec![Series::reference("core", 1.0, 0.0, deepest)];
    for (number, class) in classes.iter().enumerate() {
        let of_core = walls.core.volume_fraction[number];
        let points = walls.layers.iter().map(|layer| {
            Point::new(f64::midpoint(layer.from_mm, layer.to_mm), layer.volume_fraction[number] / of_core)
        });
        let label = if class.d_min_mm == class.d_max_mm {
            format!("grains of {} mm", rounded(class.d_min_mm))
        } else {
            format!("grains of {} to {} mm", rounded(class.d_min_mm), rounded(class.d_max_mm))
        };
        series.push(Series::line(label, number, points.collect()));
    }
    panel(
        Axis::linear("distance from the nearest wall in mm").between(0.0, deepest),
        Axis::linear("volume fraction over core").with_zero(),
        series,
    )
}

/// Near pairs of each ratio of diameters over those of shuffled partners.
fn of_pairs(found: &ContactFigures) -> Chart {
    let pairs = found.near_per_grain * found.references as f64 / 2.0;
    let points: Vec<Point> = found
        .by_ratio
        .iter()
        .map(|bin| {
            let ratio = (bin.ratio_min * bin.ratio_max).sqrt();
            if bin.share_shuffled * pairs < FEWEST_PAIRS {
                return Point::new(ratio, f64::NAN);
            }
            Point::new(ratio, bin.share / bin.share_shuffled)
        })
        .collect();
    let largest = found.by_ratio.last().map_or(1.0, |bin| bin.ratio_max);
    let label = format!("pairs with a gap below {} mm", rounded(found.near_gap_mm));
    panel(
        Axis::log("ratio of the two diameters").between(1.0, largest),
        Axis::linear("near pairs over chance").with_zero(),
        vec![Series::reference("shuffled partners", 1.0, 1.0, largest), Series::marked(label, 0, points)],
    )
}

/// Grains by the number of their coherent bonds.
fn of_bonds(found: &BondOrder) -> Chart {
    let shares = &found.share_by_coherent_bonds;
    let points = shares.iter().enumerate().map(|(bonds, share)| Point::new(bonds as f64, PERCENT * share));
    let threshold = Series {
        points: [0.0, PERCENT].map(|y| Point::new(SOLID_BONDS - 0.5, y)).into(),
        ..Series::reference(format!("solid-like from {SOLID_BONDS} on"), 0.0, 0.0, 0.0)
    };
    let label = format!(
        "Q6 {} (by chance {}), solid-like {} %",
        plain(found.q6, Some(3)),
        plain(found.q6_by_chance, Some(3)),
        plain(PERCENT * found.solid_like_share, Some(1))
    );
    panel(
        Axis::linear("coherent bonds with grains of like size").between(0.0, shares.len() as f64 - 1.0),
        Axis::linear("grains in %").between(0.0, PERCENT),
        vec![threshold, Series::marked(label, 0, points.collect())],
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "quality_tests.rs"]
mod tests;
