//! Draws a chart as SVG, 160 mm wide. Series differ in colour, dash and marker at once, so that they can be told apart
//! in a grey copy and with any kind of colour blindness. The legend is below the data.
//!
//! plotters draws grid, axes and shapes in whole units, [`PER_MM`] to the mm; dashes and the legend are drawn here. The
//! bytes depend on the chart and on the heading option only.

use std::collections::{HashMap, HashSet};

use plotters::backend::SVGBackend;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea as _};
use plotters::element::{Circle, PathElement, Polygon};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{BLACK, Color as _, IntoFont as _, RGBColor, ShapeStyle, TextStyle, WHITE};

use super::PlotError;
use super::axis::Settled;
use super::chart::{Chart, Marks, Point, Series, SeriesStyle};
use super::style::{self, Marker};
use super::text::{FAMILY, cut, escaped, printable, width_em};

/// Units of the drawing per mm.
pub(super) const PER_MM: f64 = 20.0;
/// Counts the changes of a drawing's bytes; part of an `ETag`.
pub(crate) const REVISION: u32 = 3;

const WIDTH_MM: f64 = 160.0;
/// Height of the data area.
const PLOT_HEIGHT_MM: f64 = 82.0;
/// The same of each of several charts in one drawing.
const PANEL_HEIGHT_MM: f64 = 52.0;
/// Between them.
const PANEL_GAP_MM: f64 = 3.0;
/// Edge of a square data area.
const SQUARE_MM: f64 = 100.0;
const EDGE_MM: f64 = 2.0;
/// Margin for half of the last label of an axis.
const RIGHT_MM: f64 = 6.0;
const TITLE_MM: f64 = 9.0;
const X_LABELS_MM: f64 = 11.5;
const LEGEND_ROW_MM: f64 = 5.0;
/// Line and gap before the text of an entry.
const LEGEND_LINE_MM: f64 = 11.0;
const LEGEND_GAP_MM: f64 = 5.0;
/// Entries that are listed; the last one counts the others where there are more.
const MOST_ENTRIES: usize = 24;

const TITLE_SIZE_MM: f64 = 4.2;
const LABEL_SIZE_MM: f64 = 3.5;
const TICK_SIZE_MM: f64 = 3.2;
const LINE_MM: f64 = 0.5;
const THIN_MM: f64 = 0.25;
/// Half the width of a marker.
const MARKER_MM: f64 = 0.9;
/// Radius of the largest disc, and least radius of one.
const DISC_MM: f64 = 2.4;
const LEAST_DISC_MM: f64 = 0.15;
const DISC_OPACITY: f64 = 0.45;
const TICK_MARK_MM: f64 = 0.8;
/// Points of a line that are nearer to the last one are left out, because they cannot be seen.
const NEAR_MM: f64 = 0.15;
/// Offset between error bars at the same abscissa, and the most of all offsets together.
const ASIDE_MM: f64 = 1.0;
const MOST_ASIDE_MM: f64 = 5.0;
/// Units of a font's size in plotters per unit in the drawing.
const FONT_UNITS: f64 = 1.24;

const GRID: RGBColor = RGBColor(224, 224, 224);
const FINE_GRID: RGBColor = RGBColor(240, 240, 240);
const NOTE: RGBColor = RGBColor(90, 90, 90);
const REFERENCE: RGBColor = RGBColor(110, 110, 110);

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Failure = DrawingAreaErrorKind<std::io::Error>;
type Px = (i32, i32);

/// Draws a chart; `heading` states whether its title is printed above the data.
///
/// # Errors
/// [`PlotError::NotAvailable`] for a chart without a point that can be shown; what plotters cannot lay out, which no
/// known chart causes.
pub(crate) fn svg(chart: &Chart, heading: bool) -> Result<String, PlotError> {
    if chart.is_empty() {
        return Err(PlotError::NotAvailable(chart.when_empty.clone()));
    }
    let drawn = drawn(chart, heading).map_err(|error| PlotError::Failed(std::io::Error::other(error)))?;
    Ok(drawn)
}

fn drawn(chart: &Chart, heading: bool) -> Result<String, Failure> {
    let top_mm = if heading { EDGE_MM + TITLE_MM } else { EDGE_MM };
    let mut panels: Vec<(&Chart, Legend, Frame)> = Vec::new();
    let mut end_mm = top_mm;
    for panel in chart.panels() {
        if !panels.is_empty() {
            end_mm += PANEL_GAP_MM;
        }
        let legend = Legend::of(panel);
        let plot_mm = plot_height_mm(chart, panel);
        let frame = Frame { top_mm: end_mm, plot_mm };
        end_mm += plot_mm + X_LABELS_MM + legend.height_mm() + EDGE_MM;
        panels.push((panel, legend, frame));
    }
    let height_mm = end_mm;
    let mut text = String::new();
    {
        let size = (units(WIDTH_MM) as u32, units(height_mm) as u32);
        let canvas = SVGBackend::with_string(&mut text, size).into_drawing_area();
        canvas.fill(&WHITE)?;
        if heading {
            let title = cut(&printable(&chart.title), (WIDTH_MM - 2.0 * EDGE_MM) / TITLE_SIZE_MM);
            let style = font(TITLE_SIZE_MM).pos(Pos::new(HPos::Center, VPos::Center));
            canvas.draw_text(&title, &style, (units(WIDTH_MM / 2.0), units(EDGE_MM + TITLE_MM / 2.0)))?;
        }
        for (panel, legend, frame) in &panels {
            draw_data(&canvas, panel, frame, height_mm)?;
            legend
                .draw(&canvas, frame.top_mm + frame.plot_mm + X_LABELS_MM + legend.height_mm() + EDGE_MM)?;
        }
        canvas.present()?;
    }
    Ok(headed(&text, chart, height_mm))
}

/// Where a chart lies in a drawing.
struct Frame {
    /// Above the data area.
    top_mm: f64,
    /// Height of the data area.
    plot_mm: f64,
}

/// Height of the data area of a chart in a drawing that begins with another or the same.
fn plot_height_mm(first: &Chart, chart: &Chart) -> f64 {
    if chart.layout.is_square {
        SQUARE_MM
    } else if first.layout.below.is_empty() {
        PLOT_HEIGHT_MM
    } else {
        PANEL_HEIGHT_MM
    }
}

/// The drawing with its size in mm, and with a title and a description for screen readers.
fn headed(text: &str, chart: &Chart, height_mm: f64) -> String {
    let body = text.split_once('>').map_or("", |(_, body)| body);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH_MM}mm\" height=\"{height_mm}mm\" \
         viewBox=\"0 0 {} {}\" role=\"img\" aria-labelledby=\"title desc\">\n\
         <title id=\"title\">{}</title>\n<desc id=\"desc\">{}</desc>{body}",
        units(WIDTH_MM),
        units(height_mm),
        escaped(&chart.title),
        escaped(&chart.description),
    )
}

fn draw_data(canvas: &Canvas<'_>, chart: &Chart, frame: &Frame, height_mm: f64) -> Result<(), Failure> {
    let shown = || chart.series.iter().flat_map(|s| &s.points).filter(|point| chart.shows(point));
    let ends = |point: &Point| {
        let interval = point.interval.unwrap_or([point.y; 2]);
        [point.y, interval[0], interval[1]]
    };
    let mut x = chart.x.settled(shown().map(|point| point.x));
    let y = chart.y.settled(shown().flat_map(ends));
    let widest = y.major.iter().map(|tick| width_em(&tick.text)).fold(0.0, f64::max) * TICK_SIZE_MM;
    let left_mm = LABEL_SIZE_MM * 1.5 + widest + 2.0 * TICK_MARK_MM + 1.0;
    let full_mm = WIDTH_MM - EDGE_MM - left_mm - RIGHT_MM;
    let aside_mm = if chart.layout.is_square { (full_mm - SQUARE_MM) / 2.0 } else { 0.0 };
    thin_out(&mut x, full_mm - 2.0 * aside_mm);
    let below_mm = height_mm - frame.top_mm - frame.plot_mm - X_LABELS_MM;
    let mut context = ChartBuilder::on(canvas)
        .margin_top(units(frame.top_mm))
        .margin_bottom(units(below_mm))
        .margin_left(units(EDGE_MM + aside_mm))
        .margin_right(units(RIGHT_MM + aside_mm))
        .x_label_area_size(units(X_LABELS_MM))
        .y_label_area_size(units(left_mm))
        .build_cartesian_2d(x, y)?;
    context
        .configure_mesh()
        .label_style(font(TICK_SIZE_MM))
        .axis_desc_style(font(LABEL_SIZE_MM))
        .bold_line_style(GRID.stroke_width(stroke(THIN_MM)))
        .light_line_style(FINE_GRID.stroke_width(stroke(THIN_MM)))
        .axis_style(BLACK.stroke_width(stroke(THIN_MM)))
        .set_all_tick_mark_size(units(TICK_MARK_MM))
        .x_desc(printable(&chart.x.label))
        .y_desc(printable(&chart.y.label))
        .draw()?;
    let (across, down) = context.plotting_area().get_pixel_range();
    outline(canvas, (across.start, down.start), (across.end - 1, down.end - 1))?;
    let asides = asides_mm(chart);
    let aside = |series: &Series| units(asides.get(&series.style).copied().unwrap_or(0.0));
    for note in &chart.layout.notes {
        let style = font(LABEL_SIZE_MM).pos(Pos::new(HPos::Center, VPos::Center)).color(&NOTE);
        let at = context.plotting_area().map_coordinate(&(note.x, note.y));
        canvas.draw_text(&printable(&note.text), &style, at)?;
    }
    // References are drawn first, below the data.
    let is_reference = |series: &&Series| series.style == SeriesStyle::Reference;
    for series in chart.series.iter().filter(is_reference) {
        draw_series(canvas, &context, chart, series, aside(series))?;
    }
    for series in chart.series.iter().filter(|series| !is_reference(series)) {
        draw_series(canvas, &context, chart, series, aside(series))?;
    }
    Ok(())
}

/// Drops labels of the abscissa that would overlap the one before.
fn thin_out(axis: &mut Settled, width_mm: f64) {
    let mut end = f64::NEG_INFINITY;
    let ticks = std::mem::take(&mut axis.major);
    for tick in ticks {
        let half = width_em(&tick.text) * TICK_SIZE_MM / 2.0;
        let at = axis.share(tick.value) * width_mm;
        if at - half > end {
            end = at + half + 0.8;
            axis.major.push(tick);
        }
    }
}

fn draw_series(
    canvas: &Canvas<'_>,
    context: &ChartContext<'_, SVGBackend<'_>, Cartesian2d<Settled, Settled>>,
    chart: &Chart,
    series: &Series,
    aside: i32,
) -> Result<(), Failure> {
    let place = |x: f64, y: f64| context.plotting_area().map_coordinate(&(x, y));
    let pen = Pen::of(series.style);
    if series.marks == Marks::Discs {
        for point in series.points.iter().filter(|point| chart.shows(point)) {
            pen.disc(canvas, place(point.x, point.y), point.area)?;
        }
        return Ok(());
    }
    if series.marks != Marks::Points {
        for run in series.points.split(|point| !chart.shows(point)) {
            let path: Vec<Px> = run.iter().map(|point| place(point.x, point.y)).collect();
            pen.line(canvas, &spaced(&path))?;
        }
    }
    for point in series.points.iter().filter(|point| chart.shows(point)) {
        if let Some([low, high]) = point.interval {
            // An end that a logarithmic axis cannot show lies below all that it can.
            let low = if chart.y.accepts(low) { low } else { f64::MIN_POSITIVE };
            if chart.y.accepts(high) {
                let [low, high] = [low, high].map(|end| place(point.x, end));
                pen.error_bar(canvas, (low.0 + aside, low.1), (high.0 + aside, high.1))?;
            }
        }
    }
    if series.marks != Marks::Line {
        for point in series.points.iter().filter(|point| chart.shows(point)) {
            pen.marker(canvas, place(point.x, point.y))?;
        }
    }
    Ok(())
}

/// Horizontal offsets of the error bars of each style, so that error bars at the same abscissa do not overlap.
fn asides_mm(chart: &Chart) -> HashMap<SeriesStyle, f64> {
    let has_bars = |series: &&Series| series.points.iter().any(|point| point.interval.is_some());
    let mut places: HashMap<SeriesStyle, usize> = HashMap::new();
    for series in chart.series.iter().filter(has_bars) {
        let next = places.len();
        places.entry(series.style).or_insert(next);
    }
    let middle = places.len().saturating_sub(1) as f64 / 2.0;
    let step = ASIDE_MM.min(MOST_ASIDE_MM / places.len().max(1) as f64);
    places.into_iter().map(|(style, place)| (style, (place as f64 - middle) * step)).collect()
}

/// The points of a path without those that cannot be seen; the first and the last are kept.
fn spaced(path: &[Px]) -> Vec<Px> {
    let near = units(NEAR_MM);
    let mut kept: Vec<Px> = Vec::new();
    for (i, &at) in path.iter().enumerate() {
        let far = kept.last().is_none_or(|last| (at.0 - last.0).abs() + (at.1 - last.1).abs() > near);
        if far || i + 1 == path.len() {
            kept.push(at);
        }
    }
    kept
}

/// How a series is drawn.
struct Pen {
    color: RGBColor,
    width_mm: f64,
    /// Lengths of dashes and gaps in turn, in mm; a whole line where empty.
    dashes: &'static [f64],
    marker: Marker,
}

impl Pen {
    fn of(style: SeriesStyle) -> Self {
        match style {
            SeriesStyle::Reference => {
                Self { color: REFERENCE, width_mm: THIN_MM, dashes: &[1.5, 1.0], marker: Marker::Dot }
            }
            SeriesStyle::Numbered(number) => Self {
                color: style::color(number),
                width_mm: LINE_MM,
                dashes: style::dashes(number),
                marker: style::marker(number),
            },
        }
    }

    fn stroke(&self, width_mm: f64) -> ShapeStyle {
        self.color.stroke_width(stroke(width_mm))
    }

    fn line(&self, canvas: &Canvas<'_>, path: &[Px]) -> Result<(), Failure> {
        let dashes: Vec<f64> = self.dashes.iter().map(|mm| mm * PER_MM).collect();
        for piece in style::dashed(path, &dashes) {
            canvas.draw(&PathElement::new(piece, self.stroke(self.width_mm)))?;
        }
        Ok(())
    }

    fn error_bar(&self, canvas: &Canvas<'_>, low: Px, high: Px) -> Result<(), Failure> {
        let cap = units(0.9);
        for piece in [
            vec![low, high],
            vec![(low.0 - cap, low.1), (low.0 + cap, low.1)],
            vec![(high.0 - cap, high.1), (high.0 + cap, high.1)],
        ] {
            canvas.draw(&PathElement::new(piece, self.stroke(THIN_MM)))?;
        }
        Ok(())
    }

    fn disc(&self, canvas: &Canvas<'_>, at: Px, area: f64) -> Result<(), Failure> {
        let radius = units((DISC_MM * area.max(0.0).sqrt()).max(LEAST_DISC_MM));
        canvas.draw(&Circle::new(at, radius, self.color.mix(DISC_OPACITY).filled()))
    }

    fn marker(&self, canvas: &Canvas<'_>, (x, y): Px) -> Result<(), Failure> {
        let size = units(MARKER_MM);
        let fill = if self.marker.is_open() { WHITE } else { self.color };
        match self.marker.corners() {
            None => {
                canvas.draw(&Circle::new((x, y), size, fill.filled()))?;
                if self.marker.is_open() {
                    canvas.draw(&Circle::new((x, y), size, self.stroke(0.35)))?;
                }
            }
            Some(corners) => {
                let at = |&(dx, dy): &(f64, f64)| {
                    (x + (dx * f64::from(size)).round() as i32, y + (dy * f64::from(size)).round() as i32)
                };
                let mut path: Vec<Px> = corners.iter().map(at).collect();
                canvas.draw(&Polygon::new(path.clone(), fill.filled()))?;
                if self.marker.is_open() {
                    // The first corner is drawn over again, so that its two lines meet.
                    path.extend_from_within(..2);
                    canvas.draw(&PathElement::new(path, self.stroke(0.35)))?;
                }
            }
        }
        Ok(())
    }
}

/// The style and marks of a series, and its name; no style for a remark.
type Entry = (Option<(SeriesStyle, Marks)>, String);

/// The names of the series, in columns below the data.
struct Legend {
    entries: Vec<Entry>,
    columns: usize,
}

impl Legend {
    fn of(chart: &Chart) -> Self {
        let (mut entries, mut known): (Vec<Entry>, HashSet<Entry>) = Default::default();
        for series in &chart.series {
            let Some(label) = &series.label else { continue };
            let entry = (Some((series.style, series.marks)), printable(label));
            if series.points.iter().any(|point| chart.shows(point)) && known.insert(entry.clone()) {
                entries.push(entry);
            }
        }
        if entries.len() > MOST_ENTRIES {
            let more = entries.len() - (MOST_ENTRIES - 1);
            entries.truncate(MOST_ENTRIES - 1);
            entries.push((None, format!("and {more} more")));
        }
        let widest = entries.iter().map(|(_, text)| entry_mm(text)).fold(1.0, f64::max);
        let fit = ((legend_width_mm() + LEGEND_GAP_MM) / (widest + LEGEND_GAP_MM)) as usize;
        Self { columns: fit.clamp(1, entries.len().max(1)), entries }
    }

    fn rows(&self) -> usize {
        self.entries.len().div_ceil(self.columns)
    }

    fn height_mm(&self) -> f64 {
        if self.entries.is_empty() { 0.0 } else { self.rows() as f64 * LEGEND_ROW_MM + 1.5 }
    }

    /// Draws the entries column by column.
    fn draw(&self, canvas: &Canvas<'_>, height_mm: f64) -> Result<(), Failure> {
        let rows = self.rows().max(1);
        let columns: Vec<&[Entry]> = self.entries.chunks(rows).collect();
        let widths: Vec<f64> = columns
            .iter()
            .map(|column| column.iter().map(|(_, text)| entry_mm(text)).fold(0.0, f64::max))
            .collect();
        let all: f64 = widths.iter().sum::<f64>() + LEGEND_GAP_MM * widths.len().saturating_sub(1) as f64;
        let mut left = f64::midpoint(WIDTH_MM, -all.min(legend_width_mm()));
        let top = height_mm - EDGE_MM - rows as f64 * LEGEND_ROW_MM;
        for (column, width) in columns.iter().zip(&widths) {
            for (row, (style, text)) in column.iter().enumerate() {
                let middle = units(top + (row as f64 + 0.5) * LEGEND_ROW_MM);
                if let Some((style, marks)) = style {
                    let pen = Pen::of(*style);
                    let (from, to) = (units(left), units(left + LEGEND_LINE_MM - 2.0));
                    if *marks == Marks::Discs {
                        pen.disc(canvas, (i32::midpoint(from, to), middle), 0.4)?;
                    }
                    if matches!(marks, Marks::Line | Marks::LineAndPoints) {
                        pen.line(canvas, &[(from, middle), (to, middle)])?;
                    }
                    if matches!(marks, Marks::Points | Marks::LineAndPoints) {
                        pen.marker(canvas, (i32::midpoint(from, to), middle))?;
                    }
                }
                let text = cut(text, (legend_width_mm() - LEGEND_LINE_MM) / TICK_SIZE_MM);
                let style = font(TICK_SIZE_MM).pos(Pos::new(HPos::Left, VPos::Center));
                canvas.draw_text(&text, &style, (units(left + LEGEND_LINE_MM), middle))?;
            }
            left += width + LEGEND_GAP_MM;
        }
        Ok(())
    }
}

/// Width of an entry of the legend.
fn entry_mm(text: &str) -> f64 {
    (LEGEND_LINE_MM + width_em(text) * TICK_SIZE_MM).min(legend_width_mm())
}

fn legend_width_mm() -> f64 {
    WIDTH_MM - 2.0 * EDGE_MM
}

/// A rectangle's edge.
fn outline(canvas: &Canvas<'_>, (x0, y0): Px, (x1, y1): Px) -> Result<(), Failure> {
    let corners = vec![(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)];
    canvas.draw(&PathElement::new(corners, BLACK.stroke_width(stroke(THIN_MM))))
}

fn font(size_mm: f64) -> TextStyle<'static> {
    (FAMILY, size_mm * PER_MM * FONT_UNITS).into_font().into()
}

fn units(mm: f64) -> i32 {
    (mm * PER_MM).round() as i32
}

fn stroke(mm: f64) -> u32 {
    (mm * PER_MM).round().max(1.0) as u32
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "draw_tests.rs"]
mod tests;
