//! A chart: what is shown, without how it is drawn.
//!
//! [`super::draw`] decides on fonts, colours, ticks and the position of the legend, so that all charts have one style.

use super::axis::Axis;

/// What is drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Heading, one line.
    pub(crate) title: String,
    /// One sentence for readers who cannot see the picture.
    pub(crate) description: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) series: Vec<Series>,
    pub(crate) layout: Layout,
    /// Why there is nothing to draw, where no series has a point that can be shown, and which results have it.
    pub(crate) when_empty: String,
}

impl Chart {
    /// A chart with nothing to draw, and the reason.
    pub(crate) fn without_points(reason: &str) -> Self {
        Self {
            title: String::new(),
            description: String::new(),
            x: Axis::linear(""),
            y: Axis::linear(""),
            series: Vec::new(),
            layout: Layout::default(),
            when_empty: reason.into(),
        }
    }
}

/// What distinguishes the data area of a chart from that of others.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Layout {
    /// Whether the data area is a square, for axes of one kind.
    pub(crate) is_square: bool,
    /// Texts in the data area, drawn below the data.
    pub(crate) notes: Vec<Note>,
    /// Charts that are drawn below this one in the same drawing. Their titles, descriptions and charts below are not
    /// used.
    pub(crate) below: Vec<Chart>,
}

/// A text in the data area, centred at a point.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Note {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) text: String,
}

/// A series of points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Name in the legend; series of the same name and style share an entry. `None` leaves the series out of it.
    pub(crate) label: Option<String>,
    pub(crate) style: SeriesStyle,
    pub(crate) marks: Marks,
    /// In the order of the line.
    pub(crate) points: Vec<Point>,
}

/// The style by which a series differs from others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum SeriesStyle {
    /// By colour, dash and marker of that number.
    Numbered(usize),
    /// A thin grey line for comparison.
    Reference,
}

/// The marks of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Marks {
    Line,
    Points,
    LineAndPoints,
    /// Translucent discs with the areas of the points.
    Discs,
}

/// A point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    pub(crate) x: f64,
    /// A value outside the domain of its axis, as NaN, interrupts the line.
    pub(crate) y: f64,
    /// The ends of its error bar.
    pub(crate) interval: Option<[f64; 2]>,
    /// Area of its disc, over that of the largest.
    pub(crate) area: f64,
}

impl Point {
    /// A point without an error bar.
    pub(crate) fn new(x: f64, y: f64) -> Self {
        Self { x, y, interval: None, area: 1.0 }
    }
}

impl Series {
    /// A line through points.
    pub(crate) fn line(label: impl Into<String>, number: usize, points: Vec<Point>) -> Self {
        Self { label: Some(label.into()), style: SeriesStyle::Numbered(number), marks: Marks::Line, points }
    }

    /// The same with a marker at each.
    pub(crate) fn marked(label: impl Into<String>, number: usize, points: Vec<Point>) -> Self {
        Self { marks: Marks::LineAndPoints, ..Self::line(label, number, points) }
    }

    /// A constant value for comparison, from one end of the data to the other.
    pub(crate) fn reference(label: impl Into<String>, value: f64, from: f64, to: f64) -> Self {
        let points = vec![Point::new(from, value), Point::new(to, value)];
        Self { style: SeriesStyle::Reference, ..Self::line(label, 0, points) }
    }
}

impl Chart {
    /// Whether a point can be shown.
    pub(super) fn shows(&self, point: &Point) -> bool {
        self.x.accepts(point.x) && self.y.accepts(point.y)
    }

    /// The charts of the drawing, from top to bottom.
    pub(super) fn panels(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.layout.below)
    }

    /// Whether no series but a reference has a point that can be shown; charts below are not looked at.
    pub(crate) fn is_empty(&self) -> bool {
        let empty = |series: &Series| !series.points.iter().any(|point| self.shows(point));
        self.series.iter().filter(|series| series.style != SeriesStyle::Reference).all(empty)
    }
}
