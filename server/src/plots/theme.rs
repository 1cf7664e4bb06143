//! Plots for other grounds than paper: the colours of a drawing are exchanged for those of another theme.
//!
//! Only colours change, so that each theme shows the same in the same places. The drawing is recoloured as a text: the
//! colours in attributes are those of [`super::draw`] and [`super::style`], and texts of the chart lie outside of tags.

use super::kinds;

kinds! {
    /// The ground that a plot is made for.
    #[derive(Default)]
    Theme {
        /// Paper: dark on white.
        #[default]
        Light "light",
        /// A dark page: light strokes and text, without a ground of its own.
        Dark "dark",
    }
}

/// Colours on white, and those on a dark page. The series keep their hues; each has a contrast of at least 4.5 to a
/// ground of a lightness below 10 %.
const DARK: [(&str, &str); 12] = [
    // Strokes and text, and the series that is black on paper.
    ("#000000", "#E5E8EB"),
    // The grid, coarse and fine, notes, references.
    ("#E0E0E0", "#3A4148"),
    ("#F0F0F0", "#262B30"),
    ("#5A5A5A", "#A3ADB7"),
    ("#6E6E6E", "#9099A2"),
    // The series.
    ("#0072B2", "#4FA8E8"),
    ("#D55E00", "#F0803C"),
    ("#E69F00", "#E6A821"),
    ("#009E73", "#2FC29A"),
    ("#CC79A7", "#E096C0"),
    ("#56B4E9", "#9AD6FA"),
    // Markers that are open on paper.
    ("#FFFFFF", "#15191D"),
];

/// The drawing in a theme; the light one is the drawing itself.
pub(crate) fn themed(drawing: String, theme: Theme) -> String {
    match theme {
        Theme::Light => drawing,
        Theme::Dark => dark(&drawing),
    }
}

fn dark(drawing: &str) -> String {
    let mut themed = String::with_capacity(drawing.len());
    let mut has_ground = true;
    for piece in drawing.split_inclusive('>') {
        let tag = piece.find('<').unwrap_or(piece.len());
        themed.push_str(&piece[..tag]);
        let mut rest = &piece[tag..];
        // The first rectangle fills the drawing.
        if has_ground && rest.starts_with("<rect") {
            has_ground = false;
            themed.push_str(&rest.replacen("#FFFFFF", "none", 1));
            continue;
        }
        while let Some(at) = rest.find("=\"#") {
            let (before, value) = rest.split_at(at + 2);
            themed.push_str(before);
            let found = DARK.iter().find(|(light, _)| value.starts_with(light));
            let (color, length) = found.map_or(("#", 1), |(light, dark)| (*dark, light.len()));
            themed.push_str(color);
            rest = &value[length..];
        }
        themed.push_str(rest);
    }
    themed
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::axis::Axis;
    use super::super::chart::{Chart, Point, Series};
    use super::super::draw;
    use super::*;

    fn chart() -> Chart {
        let points = || vec![Point::new(1.0, 2.0), Point::new(3.0, 4.0)];
        let mut chart = Chart::without_points("");
        chart.title = "a \"#000000\" title=\"#FFFFFF\" <#0072B2>".into();
        (chart.x, chart.y) = (Axis::linear("x"), Axis::linear("y"));
        chart.series = (0..8).map(|number| Series::marked(format!("{number}"), number, points())).collect();
        chart.series.push(Series::reference("reference", 3.0, 1.0, 3.0));
        chart
    }

    /// The colours in the attributes of a drawing.
    fn colors(drawing: &str) -> Vec<&str> {
        drawing.split("=\"#").skip(1).filter_map(|rest| rest.get(..6)).collect()
    }

    #[test]
    fn every_colour_of_a_drawing_has_one_in_the_dark_theme() {
        let light = draw::svg(&chart(), true).unwrap();
        let dark = themed(light.clone(), Theme::Dark);
        assert_eq!(themed(light.clone(), Theme::Light), light);
        let body = |drawing: &str| drawing.split_once("</desc>").unwrap().1.to_owned();
        for color in colors(&body(&dark)) {
            assert!(DARK.iter().any(|(_, known)| &known[1..] == color), "{color} is no colour of the theme");
        }
        // But for the ground, one for one; lines and texts stay.
        assert_eq!(colors(&body(&dark)).len() + 1, colors(&body(&light)).len());
        let title = |drawing: &str| drawing.split("</title>").next().unwrap().to_owned();
        assert_eq!(title(&dark), title(&light), "texts are no colours");
        let lines = |drawing: &str| drawing.matches('<').count();
        assert_eq!(lines(&dark), lines(&light));
        assert!(dark.contains("fill=\"none\""));
    }

    #[test]
    fn strokes_and_series_stand_out_from_a_dark_ground() {
        let luminance = |color: &str| -> f64 {
            let part = |at: usize| {
                let share = f64::from(u8::from_str_radix(&color[at..at + 2], 16).unwrap()) / 255.0;
                if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
            };
            0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
        };
        let ground = luminance("#1B2024");
        let decoration = ["#3A4148", "#262B30", "#15191D"];
        for (_, color) in DARK.iter().filter(|(_, color)| !decoration.contains(color)) {
            let contrast = (luminance(color) + 0.05) / (ground + 0.05);
            assert!(contrast >= 4.5, "{color}: {contrast}");
        }
    }
}
