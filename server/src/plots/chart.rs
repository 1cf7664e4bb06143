//! A chart: described here without a word about drawing, drawn by [`super::draw`].
//!
//! Whoever makes one says what is shown; fonts, colours, ticks and the place of the legend are the
//! drawing's, so that all charts of the service look alike.

use super::axis::Axis;

/// What is drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// One line above.
    pub(crate) title: String,
    /// One sentence for those who cannot see it.
    pub(crate) description: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) series: Vec<Series>,
    /// What is said in its place where no series has a point that can be shown.
    pub(crate) when_empty: String,
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Its name in the legend; series of one name and look share an entry. None leaves it out.
    pub(crate) label: Option<String>,
    pub(crate) look: Look,
    pub(crate) marks: Marks,
    /// In the order of the line.
    pub(crate) points: Vec<Point>,
}

/// How a series is told from others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Look {
    /// By colour, dash and marker of that number.
    Numbered(usize),
    /// A thin grey line to compare with.
    Reference,
}

/// What is drawn of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Marks {
    Line,
    Points,
    LineAndPoints,
}

/// A point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    pub(crate) x: f64,
    /// A value that has no place on its axis, as NaN, interrupts the line.
    pub(crate) y: f64,
    /// The ends of its error bar.
    pub(crate) interval: Option<[f64; 2]>,
}

impl Point {
    /// A point without an error bar.
    pub(crate) fn new(x: f64, y: f64) -> Self {
        Self { x, y, interval: None }
    }
}

impl Series {
    /// A line through points.
    pub(crate) fn line(label: impl Into<String>, number: usize, points: Vec<Point>) -> Self {
        Self { label: Some(label.into()), look: Look::Numbered(number), marks: Marks::Line, points }
    }

    /// The same with a marker at each.
    pub(crate) fn marked(label: impl Into<String>, number: usize, points: Vec<Point>) -> Self {
        Self { marks: Marks::LineAndPoints, ..Self::line(label, number, points) }
    }

    /// A value to compare with, from one end of the data to the other.
    pub(crate) fn reference(label: impl Into<String>, value: f64, from: f64, to: f64) -> Self {
        let points = vec![Point::new(from, value), Point::new(to, value)];
        Self { look: Look::Reference, ..Self::line(label, 0, points) }
    }
}

impl Chart {
    /// Whether a point can be shown.
    pub(super) fn shows(&self, point: &Point) -> bool {
        self.x.holds(point.x) && self.y.holds(point.y)
    }

    /// Whether no series but a reference has a point that can be shown.
    pub(crate) fn is_empty(&self) -> bool {
        let empty = |series: &Series| !series.points.iter().any(|point| self.shows(point));
        self.series.iter().filter(|series| series.look != Look::Reference).all(empty)
    }
}
