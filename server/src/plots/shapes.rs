//! The plots of grains that are no spheres: Zingg's diagram, and the flakiness index by particle size fraction.

use std::collections::BTreeMap;

use packstone_engine::analysis::MeasuredGrain;
use packstone_engine::request::{GrainKind, GrainShape, PackingRequest, PlainShape};
use packstone_engine::shape::{AxisRatios, Zingg, flakiness_fractions, flakiness_index};

use super::axis::{Axis, plain};
use super::chart::{Chart, Layout, Marks, Note, Point, Series, SeriesStyle};
use super::job::{PERCENT, title};

/// Why a packing of spheres has none of these plots.
pub(super) const OF_OTHERS_ALONE: &str =
    "all grains are spheres: a packing of ellipsoids or polyhedra has a `zingg` and a `flakiness`";

/// Boundary between the classes of Zingg.
const BOUNDARY: f64 = 2.0 / 3.0;
/// Grains whose ratios lie in the same cell of this width share a disc of their joint volume, so that a drawing of a
/// million grains has ten thousand discs at most. On paper it is half of a millimetre.
const CELL: f64 = 0.005;
/// The same where there are many grains.
const WIDE_CELL: f64 = 0.01;
const MANY: usize = 10_000;

/// Elongation of each grain across its flatness, with the classes of Zingg.
pub(super) fn zingg(request: &PackingRequest, grains: &[MeasuredGrain], name: Option<&str>) -> Chart {
    let discs = joined(grains);
    let largest = discs.iter().map(|disc| disc.volume_mm3).fold(0.0, f64::max);
    let all: f64 = grains.iter().map(|grain| grain.sizes.volume_mm3).sum();
    let share = |class: Zingg| {
        let of_class = grains.iter().filter(|grain| grain.form.zingg() == class);
        PERCENT * of_class.map(|grain| grain.sizes.volume_mm3).sum::<f64>() / all
    };
    // The name of each class stands where grains hardly ever are: at the edge of the diagram.
    let classes = [
        ("disc", Zingg::Disc, [BOUNDARY / 2.0, 0.965]),
        ("equant", Zingg::Equant, [f64::midpoint(BOUNDARY, 1.0), 0.965]),
        ("blade", Zingg::Blade, [BOUNDARY / 2.0, 0.035]),
        ("rod", Zingg::Rod, [f64::midpoint(BOUNDARY, 1.0), 0.035]),
    ];
    let shares = classes.map(|(name, class, at)| (name, plain(share(class), Some(1)), at));
    let line = |ends: [[f64; 2]; 2]| Series {
        points: ends.map(|[x, y]| Point::new(x, y)).into(),
        ..Series::reference("Zingg's classes, shares by volume", 0.0, 0.0, 0.0)
    };
    let (of_grain, shared) = match request.mix.grain_kind() {
        GrainKind::Polyhedra => ("grains of a template", " of the ellipsoid of equal inertia"),
        GrainKind::Mixed => {
            ("grains of a template", " (of polyhedra that of the ellipsoid of equal inertia)")
        }
        GrainKind::Ellipsoids | GrainKind::Spheres => ("grain", ""),
    };
    Chart {
        title: title("Zingg's diagram", name),
        description: format!(
            "Elongation against flatness{shared} of {} grains; by volume {}.",
            grains.len(),
            shares.each_ref().map(|(name, share, _)| format!("{share} % {name}")).join(", ")
        ),
        x: Axis::linear("flatness c/b").between(0.0, 1.0),
        y: Axis::linear("elongation b/a").between(0.0, 1.0),
        series: vec![
            line([[BOUNDARY, 0.0], [BOUNDARY, 1.0]]),
            line([[0.0, BOUNDARY], [1.0, BOUNDARY]]),
            Series {
                label: Some(format!("{of_grain}, area by volume")),
                style: SeriesStyle::Numbered(0),
                marks: Marks::Discs,
                points: discs
                    .iter()
                    .map(|disc| Point {
                        area: disc.volume_mm3 / largest,
                        ..Point::new(disc.flatness, disc.elongation)
                    })
                    .collect(),
            },
        ],
        layout: Layout {
            is_square: true,
            notes: shares
                .map(|(name, share, [x, y])| Note { x, y, text: format!("{name} {share} %") })
                .into(),
            below: Vec::new(),
        },
        when_empty: "the packing has no grains".into(),
    }
}

/// Grains of nearly the same form.
#[derive(Clone, Copy, Default)]
struct Disc {
    volume_mm3: f64,
    /// Means by volume.
    flatness: f64,
    elongation: f64,
}

/// The discs of a diagram, from the largest to the smallest, so that the small ones are seen.
fn joined(grains: &[MeasuredGrain]) -> Vec<Disc> {
    let width = if grains.len() > MANY { WIDE_CELL } else { CELL };
    let mut cells: BTreeMap<[u32; 2], Disc> = BTreeMap::new();
    for MeasuredGrain { form, sizes } in grains {
        let cell = [form.flatness, form.elongation].map(|ratio| (ratio / width) as u32);
        let disc = cells.entry(cell).or_default();
        disc.volume_mm3 += sizes.volume_mm3;
        disc.flatness += sizes.volume_mm3 * form.flatness;
        disc.elongation += sizes.volume_mm3 * form.elongation;
    }
    let mut discs: Vec<Disc> = cells
        .into_values()
        .map(|Disc { volume_mm3, flatness, elongation }| Disc {
            volume_mm3,
            flatness: flatness / volume_mm3,
            elongation: elongation / volume_mm3,
        })
        .collect();
    discs.sort_by(|p, q| q.volume_mm3.total_cmp(&p.volume_mm3));
    discs
}

/// Share of flaky mass in each particle size fraction of EN 933-3.
pub(super) fn flakiness(request: &PackingRequest, grains: &[MeasuredGrain], name: Option<&str>) -> Chart {
    let sizes = || grains.iter().map(|grain| grain.sizes);
    let fractions = flakiness_fractions(sizes());
    let present = || fractions.iter().filter(|fraction| fraction.volume_mm3 > 0.0);
    let from = present().map(|fraction| fraction.d_min_mm).fold(f64::INFINITY, f64::min);
    let to = present().map(|fraction| fraction.d_max_mm).fold(0.0, f64::max);
    let of_all = flakiness_index(sizes());
    let mut ticks: Vec<f64> = present().flat_map(|fraction| [fraction.d_min_mm, fraction.d_max_mm]).collect();
    ticks.dedup();
    let mut series = Vec::new();
    for (low, high, index) in requested(request) {
        let (low, high) = (low.max(from), high.min(to));
        if low < high {
            series.push(Series {
                style: SeriesStyle::Reference,
                ..Series::reference(
                    format!("requested index, {} %", plain(PERCENT * index, None)),
                    PERCENT * index,
                    low,
                    high,
                )
            });
        }
    }
    if let Some(index) = of_all {
        let points = [from, to].map(|size| Point::new(size, PERCENT * index)).into();
        series.push(Series::line(format!("all grains, {} %", plain(PERCENT * index, Some(1))), 1, points));
    }
    // One series of steps; a fraction without grains interrupts it.
    let mut steps = Vec::new();
    for fraction in &fractions {
        let share = fraction.index().map_or(f64::NAN, |index| PERCENT * index);
        steps.extend([fraction.d_min_mm, fraction.d_max_mm].map(|size| Point::new(size, share)));
    }
    series.push(Series::line("particle size fractions", 0, steps));
    Chart {
        title: title("Flakiness index", name),
        description: format!(
            "Share of flaky mass in each particle size fraction of EN 933-3 against the sieve size of the grains, \
             measured on {} grains{}.",
            grains.len(),
            of_all.map_or_else(String::new, |index| format!("; of all it is {} %", plain(PERCENT * index, Some(1))))
        ),
        x: Axis { ticks, ..Axis::log("particle size fraction in mm") },
        y: Axis::linear("flaky mass in %").with_zero(),
        series,
        layout: Layout::default(),
        when_empty: "no grain lies in the particle size fractions of EN 933-3, 4 to 100 mm by sieve size: a packing of \
                     coarser ellipsoids or polyhedra has a `flakiness`"
            .into(),
    }
}

/// The flakiness indices that a mix requests: lower and upper size in mm, and the index. None of several aggregates,
/// whose grains the plot does not tell apart.
fn requested(request: &PackingRequest) -> Vec<(f64, f64, f64)> {
    let parts = request.mix.parts();
    let [part] = parts.as_slice() else { return Vec::new() };
    let mut upper = f64::INFINITY;
    let mut found = Vec::new();
    for (above_mm, shape) in part.grain_shapes().unwrap_or_default() {
        if let Some(index) = requested_of(shape) {
            found.push((above_mm, upper, index));
        }
        upper = above_mm;
    }
    found
}

/// The flakiness index of a shape, by the shares of a mixture; `None` where a part states none. Spheres have none that
/// is flaky.
fn requested_of(shape: &GrainShape) -> Option<f64> {
    let index_of = |shape: &PlainShape| match shape {
        PlainShape::Ellipsoid { ratios: AxisRatios::Flakiness { index, .. }, .. } => Some(*index),
        PlainShape::Sphere {} => Some(0.0),
        PlainShape::Ellipsoid { .. } | PlainShape::Polyhedron { .. } => None,
    };
    let parts = shape.parts();
    if parts.iter().all(|(_, shape)| shape.kind() == GrainKind::Spheres) {
        return None;
    }
    parts.into_iter().map(|(share, shape)| Some(share * index_of(shape)?)).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "shapes_tests.rs"]
mod tests;
