//! What tells series apart: colour, dash and marker, each alone enough for a handful of them.

use plotters::style::RGBColor;

type Px = (i32, i32);

/// The palette of Okabe and Ito (2008) without its yellow, which is lost on white: distinguishable with
/// any of the common kinds of colour blindness, and here in an order in which neighbours differ in grey.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

/// Lengths of dashes and gaps in turn, in mm.
const DASHES: [&[f64]; 5] = [&[], &[2.6, 1.2], &[0.7, 0.9], &[3.4, 0.9, 0.7, 0.9], &[5.0, 1.0]];

const MARKERS: [Marker; 8] = [
    Marker::Dot,
    Marker::OpenSquare,
    Marker::Triangle,
    Marker::OpenDiamond,
    Marker::Square,
    Marker::Ring,
    Marker::Diamond,
    Marker::OpenTriangle,
];

/// Corners as shares of the marker's radius; the ordinate points down.
const SQUARE: [(f64, f64); 4] = [(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)];
const TRIANGLE: [(f64, f64); 3] = [(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)];
const DIAMOND: [(f64, f64); 4] = [(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)];

/// Colour of the series of that number.
pub(super) fn color(number: usize) -> RGBColor {
    COLORS[number % COLORS.len()]
}

/// Its dashes; a whole line where empty.
pub(super) fn dashes(number: usize) -> &'static [f64] {
    DASHES[number % DASHES.len()]
}

/// Its marker.
pub(super) fn marker(number: usize) -> Marker {
    MARKERS[number % MARKERS.len()]
}

/// A shape at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Marker {
    Dot,
    Ring,
    Square,
    OpenSquare,
    Triangle,
    OpenTriangle,
    Diamond,
    OpenDiamond,
}

impl Marker {
    /// Whether it is white inside.
    pub(super) fn is_open(self) -> bool {
        matches!(self, Self::Ring | Self::OpenSquare | Self::OpenTriangle | Self::OpenDiamond)
    }

    /// Its corners in its radius; none of a circle.
    pub(super) fn corners(self) -> Option<&'static [(f64, f64)]> {
        match self {
            Self::Dot | Self::Ring => None,
            Self::Square | Self::OpenSquare => Some(&SQUARE),
            Self::Triangle | Self::OpenTriangle => Some(&TRIANGLE),
            Self::Diamond | Self::OpenDiamond => Some(&DIAMOND),
        }
    }
}

/// The pieces of a path that are drawn, for lengths of dashes and gaps in turn. Corners do not begin a
/// dash anew, as they do in the dashed line of plotters, which so draws curves of many points whole.
pub(super) fn dashed(path: &[Px], lengths: &[f64]) -> Vec<Vec<Px>> {
    if path.len() < 2 {
        return Vec::new();
    }
    if lengths.iter().sum::<f64>() <= 0.0 {
        return vec![path.to_vec()];
    }
    let (mut pieces, mut piece) = (Vec::new(), vec![path[0]]);
    let (mut index, mut left) = (0, lengths[0]);
    for ends in path.windows(2) {
        let [from, to] = [ends[0], ends[1]].map(|(x, y)| (f64::from(x), f64::from(y)));
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let share = done / length;
            let at = (
                (from.0 + share * (to.0 - from.0)).round() as i32,
                (from.1 + share * (to.1 - from.1)).round() as i32,
            );
            if index % 2 == 0 {
                piece.push(at);
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![at];
            }
            index = (index + 1) % lengths.len();
            left = lengths[index];
        }
        left -= length - done;
        if index % 2 == 0 {
            piece.push(ends[1]);
        }
    }
    if piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_go_on_around_corners() {
        assert_eq!(dashed(&[(0, 0), (10, 0)], &[]), [[(0, 0), (10, 0)]]);
        let pieces = dashed(&[(0, 0), (5, 0), (5, 5)], &[3.0, 4.0]);
        assert_eq!(pieces, [vec![(0, 0), (3, 0)], vec![(5, 2), (5, 5)]]);
        let pieces = dashed(&[(0, 0), (5, 0), (5, 5)], &[7.0, 2.0]);
        assert_eq!(pieces, [vec![(0, 0), (5, 0), (5, 2)], vec![(5, 4), (5, 5)]]);
    }

    #[test]
    fn a_line_of_many_short_steps_is_dashed_as_a_long_one() {
        let steps: Vec<Px> = (0..=1000).map(|x| (x, 0)).collect();
        let drawn = |pieces: &[Vec<Px>]| -> i32 {
            pieces.iter().filter_map(|p| Some(p.last()?.0 - p.first()?.0)).sum()
        };
        let pieces = dashed(&steps, &[20.0, 20.0]);
        assert_eq!((pieces.len(), drawn(&pieces)), (25, 500));
        assert_eq!(dashed(&steps, &[20.0, 20.0]).len(), dashed(&[(0, 0), (1000, 0)], &[20.0, 20.0]).len());
    }

    #[test]
    fn neighbours_differ_in_all_three() {
        for number in 0..100 {
            let next = number + 1;
            assert_ne!(color(number), color(next));
            assert_ne!(dashes(number), dashes(next));
            assert_ne!(marker(number), marker(next));
        }
        // Colour, dash and marker repeat together only after 7 * 5 * 8 series.
        for other in 1..280 {
            let same = color(0) == color(other) && dashes(0) == dashes(other) && marker(0) == marker(other);
            assert!(!same, "{other}");
        }
    }
}
