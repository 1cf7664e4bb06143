//! The plots of a job's result: grading curve, distance over time, pair correlation and wall effect; those of shapes
//! are in [`super::shapes`], that of the quality in [`super::quality`].

use std::io;

use packstone_engine::analysis::{self, RadialOptions, SizeRange, SizedGrain, Surface};
use packstone_engine::distance::DistanceRule;
use packstone_engine::export::tables::{self, Column, GrainSource, Head};
use packstone_engine::mix::GradedMix;
use packstone_engine::packing::{Grains, GrainsRef, Partial, Summary};
use packstone_engine::request::{Distance, Grading, GrainKind, Method, PackingRequest, VolumeFraction};

use super::axis::{Axis, plain};
use super::chart::{Chart, Layout, Marks, Point, Series, SeriesStyle};
use super::{PlotError, quality, shapes};
use crate::jobs::JobRequest;

super::kinds! {
    /// What a plot of a job's result shows.
    JobPlot {
        /// Target and achieved grading curve: mass passing each diameter.
        Grading "grading",
        /// Distance against packing time, for grown grains with a constant or the largest distance.
        Distance "distance",
        /// Pair correlation function against the gap between grains, by size class.
        Radial "radial",
        /// Volume fraction against depth from the walls.
        Profile "profile",
        /// Elongation against flatness of each grain that is no sphere, with Zingg's classes.
        Zingg "zingg",
        /// Share of flaky mass by particle size fraction, of grains that are no spheres.
        Flakiness "flakiness",
        /// Whether the packing is random: volumes near the walls, near pairs and bond order.
        Quality "quality",
    }
}

/// Bins of a pair correlation: fewer for few grains, so that each bin counts enough pairs.
const BINS: std::ops::RangeInclusive<usize> = 12..=60;
const GRAINS_PER_BIN: usize = 15;
/// Largest gap shown, in median diameters.
const GAP_DIAMETERS: f64 = 2.0;
/// Reference grains per class: a relative error of about 1 %, in one to two seconds at two million grains.
const MAX_REFERENCES: usize = 20_000;
/// Bins in which fewer pairs are expected are left out: their relative error is above 1/4.
const FEWEST_PAIRS: f64 = 16.0;
/// Classes of the mix shown at most; neighbours are joined where there are more.
const MOST_CLASSES: usize = 6;
/// Points of a profile, and its depth in largest diameters: the wall effect reaches two or three.
const DEPTHS: usize = 240;
const DEPTH_DIAMETERS: f64 = 4.0;
pub(super) const PERCENT: f64 = 100.0;

/// What a plot reads of a result.
pub(crate) struct JobResult<'a> {
    pub(crate) head: &'a Head,
    pub(crate) grains: &'a dyn GrainSource,
}

/// Why no packing of a request can have a plot; `None` where it depends on the result, or every result has it.
fn never(kind: JobPlot, request: &PackingRequest) -> Option<&'static str> {
    match (kind, request.distance) {
        (JobPlot::Zingg | JobPlot::Flakiness, _) if request.mix.grain_kind() == GrainKind::Spheres => {
            Some(shapes::OF_OTHERS_ALONE)
        }
        (JobPlot::Profile, _) if request.specimen.is_periodic() => Some(
            "a periodic box has no walls to measure a depth from: a box with walls or a cylinder has a `profile`",
        ),
        (JobPlot::Distance, Distance::None { .. } | Distance::Constant { gap_mm: 0.0, .. }) => Some(
            "the request sets no distance between grains: a packing that was grown (method `growth`) \
             with a constant or the largest distance has a `distance` over time",
        ),
        (JobPlot::Distance, Distance::Proportional { .. } | Distance::SmallerDiameter { .. }) => Some(
            "the distance varies from pair to pair: a packing that was grown (method `growth`) with \
             a constant or the largest distance has a `distance` over time",
        ),
        (JobPlot::Distance, _) if matches!(request.method, Method::Rsa { .. }) => Some(NOT_GROWN),
        _ => None,
    }
}

/// Why a packing without growth has no distance over time.
const NOT_GROWN: &str = "random sequential addition inserts grains at their full size and distance: a packing that was \
                         grown (method `growth`) with a constant or the largest distance has a `distance` over time";

/// Refuses a plot that no packing of a request can have.
///
/// # Errors
/// [`PlotError::NotAvailable`].
pub(crate) fn check(kind: JobPlot, request: &PackingRequest) -> Result<(), PlotError> {
    never(kind, request).map_or(Ok(()), |reason| Err(PlotError::NotAvailable(reason.into())))
}

/// Makes a plot of a result. A chart without points states why, and is refused by [`super::draw::svg`].
///
/// # Errors
/// Those of the source of the grains; `InvalidData` where the stored request cannot be read.
pub(crate) fn chart(kind: JobPlot, result: &JobResult<'_>) -> io::Result<Chart> {
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidData, what);
    let request = JobRequest::read(&result.head.request, 0, None).map_err(|faults| {
        let faults: Vec<String> = faults.iter().map(ToString::to_string).collect();
        invalid(format!("the request of the result cannot be read: {}", faults.join("; ")))
    })?;
    let name = request.name.clone();
    let packing = request.packing();
    let mut chart = match kind {
        JobPlot::Grading => {
            grading(&at_scale(&packing, &result.head.report.summary), sized(result)?, name.as_deref())
        }
        JobPlot::Distance => distance(result.head, &packing, name.as_deref()),
        JobPlot::Radial => radial(result.head, &packing, &tables::load(result.grains)?, name.as_deref())?,
        JobPlot::Zingg | JobPlot::Flakiness => {
            match analysis::measured_grains(&tables::load(result.grains)?) {
                None => Chart::without_points(shapes::OF_OTHERS_ALONE),
                Some(grains) if kind == JobPlot::Zingg => shapes::zingg(&packing, &grains, name.as_deref()),
                Some(grains) => shapes::flakiness(&packing, &grains, name.as_deref()),
            }
        }
        JobPlot::Quality => quality::chart(&packing, &tables::load(result.grains)?, name.as_deref())?,
        JobPlot::Profile => profile(result.head, &packing, &tables::load(result.grains)?, name.as_deref())?,
    };
    if let Some(partial) = &result.head.report.summary.partial {
        mark_partial(&mut chart, partial);
    }
    Ok(chart)
}

/// States on a chart that its packing is partial: with a heading and without, and to who cannot see it.
fn mark_partial(chart: &mut Chart, partial: &Partial) {
    let reached = plain(PERCENT * partial.volume_fraction_reached, Some(2));
    let asked = partial.volume_fraction_requested.map(|asked| plain(PERCENT * asked, Some(2)));
    let of = asked.map(|asked| format!(" of {asked} %")).unwrap_or_default();
    let words = format!("partial packing: volume fraction {reached} %{of}");
    chart.description = format!("{} It is of a {words}.", chart.description);
    let lowest = chart.layout.below.last_mut().map_or(&mut chart.x, |below| &mut below.x);
    lowest.label = format!("{} ({words})", lowest.label);
}

/// The title of a plot: what it shows, and the name of the job.
pub(super) fn title(what: &str, name: Option<&str>) -> String {
    name.map_or_else(|| what.to_owned(), |name| format!("{what}: {name}"))
}

fn column(grains: &dyn GrainSource, column: Column) -> io::Result<Vec<f64>> {
    let mut values = vec![0.0; grains.len()];
    grains.read(column, 0, &mut values)?;
    Ok(values)
}

/// The grains as sieves see them.
fn sized(result: &JobResult<'_>) -> io::Result<Vec<SizedGrain>> {
    let diameters = column(result.grains, Column::Diameter)?;
    let grains = diameters.into_iter().map(SizedGrain::sphere);
    if tables::nominal_size(result.head, result.grains) == Column::Diameter {
        return Ok(grains.collect());
    }
    let sizes = column(result.grains, Column::Sieve)?;
    Ok(grains.zip(sizes).map(|(grain, size_mm)| SizedGrain { size_mm, ..grain }).collect())
}

/// A request as its packing has it, where the volume fraction was to be as large as possible: with the volume that is
/// placed, of a list with the sizes that it was scaled to.
fn at_scale(request: &PackingRequest, summary: &Summary) -> PackingRequest {
    let checked = packstone_engine::checked_as(request, summary);
    let mut request = checked.map_or_else(|_| request.clone(), |(checked, _)| checked);
    if let Some(scale) = summary.size_scale {
        if let Some(VolumeFraction::Of(fraction)) = &mut request.mix.volume_fraction {
            *fraction *= scale.powi(3);
        }
        if let Some(Grading::Diameters { diameters_mm }) = &mut request.mix.grading {
            for diameter_mm in diameters_mm {
                *diameter_mm *= scale;
            }
            request.mix.d_min_mm = request.mix.d_min_mm.map(|d| d * scale);
        }
    }
    request
}

fn grading(request: &PackingRequest, grains: Vec<SizedGrain>, name: Option<&str>) -> Chart {
    let number = grains.len();
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let found = analysis::grading(grains, &mix);
    let target = |p: &analysis::GradingPoint| Point::new(p.d_mm, PERCENT * p.target);
    let achieved = |p: &analysis::GradingPoint| Point::new(p.d_mm, PERCENT * p.achieved);
    let sieves: Vec<f64> = found.sieves.iter().map(|p| p.d_mm).collect();
    let missed = found.sieves.iter().map(|p| (p.target - p.achieved).abs()).fold(0.0, f64::max);
    Chart {
        title: title("Grading curve", name),
        description: format!(
            "Mass passing against grain diameter, requested and packed with {} grains; at the sieves the two differ by \
             at most {} percentage points.",
            number,
            plain(PERCENT * missed, Some(2))
        ),
        x: Axis { ticks: sieves, ..Axis::log("grain diameter in mm") },
        y: Axis::linear("mass passing in %").between(0.0, PERCENT),
        series: vec![
            Series::line("target", 0, found.curve.iter().map(target).collect()),
            Series::line("achieved", 1, found.curve.iter().map(achieved).collect()),
            Series {
                label: Some("achieved at the sieves".into()),
                style: SeriesStyle::Numbered(1),
                marks: Marks::Points,
                points: found.sieves.iter().map(achieved).collect(),
            },
        ],
        layout: Layout::default(),
        when_empty: "the packing has no grains".into(),
    }
}

fn distance(head: &Head, request: &PackingRequest, name: Option<&str>) -> Chart {
    let mut curve = head.report.distance_curve();
    if curve.iter().all(|&[_, mm]| mm == 0.0) {
        curve.clear();
    }
    let points: Vec<Point> = curve.iter().map(|&[time_s, mm]| Point::new(time_s, mm)).collect();
    let reached = curve.last().map_or_else(String::new, |&[time_s, mm]| {
        format!(" It reaches {} mm after {} s.", plain(mm, Some(3)), plain(time_s, Some(1)))
    });
    Chart {
        title: title("Distance between grains", name),
        description: format!("Smallest gap between grains against packing time.{reached}"),
        x: Axis::linear("packing time in s").with_zero(),
        y: Axis::linear("distance between grains in mm").with_zero(),
        series: vec![Series { label: None, ..Series::line("", 0, points) }],
        layout: Layout::default(),
        when_empty: never(JobPlot::Distance, request).unwrap_or(NOT_GROWN).into(),
    }
}

fn radial(head: &Head, request: &PackingRequest, grains: &Grains, name: Option<&str>) -> io::Result<Chart> {
    let summary = &head.report.summary;
    let mut distance = request.distance;
    if let (Distance::Maximize { wall_gap_mm }, Some(mm)) = (distance, summary.distance_mm) {
        distance = Distance::Constant { gap_mm: mm, wall_gap_mm };
    }
    let rule = DistanceRule::new(&distance, &request.specimen);
    // Largest first, so the middle one is the median.
    let median = GrainsRef::from(grains).diameters_mm().nth(grains.len() / 2).unwrap_or(1.0);
    let nearest = head.report.check.min_gap_mm.unwrap_or(0.0);
    let is_spherical = grains.spheres().is_some();
    // Centres of other grains may be closer than those of spheres of equal volume.
    let min_gap_mm = if is_spherical { 0.0 } else { -median };
    let upper: Vec<f64> = summary.classes.iter().map(|class| class.d_max_mm).collect();
    let upper = joined(&upper);
    let options = RadialOptions {
        upper_mm: &upper,
        min_gap_mm,
        max_gap_mm: nearest + GAP_DIAMETERS * median,
        bins: (grains.len() / GRAINS_PER_BIN).clamp(*BINS.start(), *BINS.end()),
        max_references: MAX_REFERENCES,
    };
    let found = analysis::radial(grains, &request.specimen, &rule, &options).map_err(io::Error::from)?;
    let mut series = vec![Series::reference("random positions", 1.0, min_gap_mm, options.max_gap_mm)];
    for (number, class) in found.iter().enumerate() {
        let values = class.gap_mm.iter().zip(&class.correlation).zip(&class.expected);
        let points = values
            .map(|((&gap, &g), &expected)| match g {
                Some(g) if expected >= FEWEST_PAIRS => Point::new(gap, g),
                _ => Point::new(gap, f64::NAN),
            })
            .collect();
        let label = class_label(class.class, &upper, summary.d_min_mm);
        let what = if is_spherical { "grains of" } else { "equivalent diameters of" };
        series.push(Series::line(format!("{what} {label}"), number, points));
    }
    let (quantity, label) = if is_spherical {
        ("a gap", "gap between grains in mm")
    } else {
        (
            "a distance of the centres, less the mean equivalent diameter,",
            "centre distance less mean equivalent diameter in mm",
        )
    };
    Ok(Chart {
        title: title("Pair correlation function by size class", name),
        description: format!(
            "Frequency of {quantity} between a grain of a class and a grain of any size, over its frequency for grains \
             at random positions; {} classes.",
            found.len()
        ),
        x: Axis::linear(label).between(min_gap_mm, options.max_gap_mm),
        y: Axis::linear("pair correlation function g").with_zero(),
        series,
        layout: Layout::default(),
        when_empty: "too few grains, or all of them too near the walls, for a pair correlation function: a packing of \
                     more grains has a `radial`"
            .into(),
    })
}

/// The diameters of a class: its bounds, or its only one.
fn class_label(found: SizeRange, upper_mm: &[f64], finest_mm: f64) -> String {
    if found.d_min_mm == found.d_max_mm {
        return format!("{} mm", rounded(found.d_min_mm));
    }
    // Equivalent diameters may lie above all sieves: such grains are in the coarsest class.
    let class = upper_mm.iter().position(|upper| found.d_max_mm <= *upper);
    let high = class.map_or(found.d_max_mm, |class| upper_mm[class]);
    let class = class.or(upper_mm.len().checked_sub(1));
    let low = class.filter(|class| *class > 0).map_or(finest_mm, |class| upper_mm[class - 1]);
    format!("{} to {} mm", rounded(low), rounded(high))
}

/// Upper bounds of at most [`MOST_CLASSES`] classes, of which each joins neighbours.
fn joined(upper_mm: &[f64]) -> Vec<f64> {
    let together = upper_mm.len().div_ceil(MOST_CLASSES).max(1);
    // From the coarse end, so that the coarsest bound stays.
    let mut bounds: Vec<f64> = upper_mm.iter().rev().step_by(together).copied().collect();
    bounds.reverse();
    bounds
}

fn profile(head: &Head, request: &PackingRequest, grains: &Grains, name: Option<&str>) -> io::Result<Chart> {
    let summary = &head.report.summary;
    let depth_mm = DEPTH_DIAMETERS * summary.d_max_mm;
    let found =
        analysis::depth_profiles(grains, &request.specimen, depth_mm, DEPTHS).map_err(io::Error::from)?;
    let mean = PERCENT * summary.volume_fraction_effective;
    let deepest = found.iter().filter_map(|p| p.depth_mm.last()).copied().fold(0.0, f64::max);
    // Near the axis a single grain determines the volume fraction of a coaxial surface.
    let [width_mm, ..] = request.specimen.bounds_mm();
    let axis_mm = width_mm / 2.0 - summary.d_max_mm / 2.0;
    let mut series = vec![Series::reference("mean of the specimen", mean, 0.0, deepest)];
    for (number, profile) in found.iter().enumerate() {
        let label = match profile.surface {
            Surface::Faces => "mean of the six faces",
            Surface::Ends => "mean of the two ends",
            Surface::Lateral => "lateral surface",
        };
        let values = profile.depth_mm.iter().zip(&profile.volume_fraction);
        let points = values
            .map(|(&depth, &share)| Point::new(depth, PERCENT * share))
            .filter(|point| profile.surface != Surface::Lateral || point.x < axis_mm)
            .collect();
        series.push(Series::line(label, number, points));
    }
    Ok(Chart {
        title: title("Volume fraction near the walls", name),
        description: format!(
            "Volume fraction of the grains on surfaces parallel to the walls against the depth of the surface; the mean \
             of the specimen is {} %.",
            plain(mean, Some(1))
        ),
        x: Axis::linear("depth from the wall in mm").between(0.0, if deepest > 0.0 { deepest } else { 1.0 }),
        y: Axis::linear("volume fraction in %").with_zero(),
        series,
        layout: Layout::default(),
        when_empty: never(JobPlot::Profile, request).unwrap_or("the packing has no grains").into(),
    })
}

/// A diameter, rounded to three digits.
pub(super) fn rounded(mm: f64) -> String {
    let digits = 2 - mm.abs().max(f64::MIN_POSITIVE).log10().floor() as i32;
    let scale = 10_f64.powi(digits);
    plain((mm * scale).round() / scale, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn diameters_are_rounded_to_three_digits() {
        for (mm, text) in
            [(2.0341, "2.03"), (15.98, "16"), (0.250_01, "0.25"), (63.04, "63"), (1234.0, "1230")]
        {
            assert_eq!(rounded(mm), text);
        }
    }

    #[test]
    fn many_classes_are_joined_from_the_coarse_end() {
        assert_eq!(joined(&[4.0, 8.0, 16.0]), [4.0, 8.0, 16.0]);
        let many: Vec<f64> = (1..=13).map(f64::from).collect();
        assert_eq!(joined(&many), [1.0, 4.0, 7.0, 10.0, 13.0]);
        assert!(joined(&[]).is_empty());
    }
}
