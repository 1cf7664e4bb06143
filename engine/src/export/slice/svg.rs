//! A drawing of a cut at full scale, for print: grey grains on white, the outline, a scale bar.

use std::io::{self, Write};

use super::{Cut, Figure, Outline, SliceReport};
use crate::arrays::Each as _;
use crate::elementary::{log10, powf};
use crate::export::digits::fixed;

pub(super) fn write(cut: &Cut, report: &SliceReport, out: &mut dyn Write) -> io::Result<()> {
    let [[u0, u1], [v0, v1]] = cut.outline.bounds_mm();
    let (width, height) = (u1 - u0, v1 - v0);
    let long = width.max(height);
    // A millionth of the longer edge is finer than any printer.
    let decimals = (5.0 - log10(long).floor()).clamp(0.0, 12.0) as usize;
    // So wide a text fits between the scale bar and the right edge of any cut.
    let (margin, font, line) = (0.03 * long, 0.035 * width, 0.003 * long);
    let bar = scale_bar(width);
    let (left, top) = (-margin, -margin);
    let (full_width, full_height) = (width + 2.0 * margin, height + 2.0 * margin + 2.2 * font);
    let axis = cut.axis.name();
    write!(
        out,
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="{full_width:.decimals$}mm" height="{full_height:.decimals$}mm" viewBox="{left:.decimals$} {top:.decimals$} {full_width:.decimals$} {full_height:.decimals$}">
<title>Cut at {axis} = {at} mm</title>
<desc>{count} {noun}, area fraction {fraction:.4}; axes {u} to the right and {v} up, units mm</desc>
<rect x="{left:.decimals$}" y="{top:.decimals$}" width="{full_width:.decimals$}" height="{full_height:.decimals$}" fill="#fff"/>
"##,
        at = cut.at_mm,
        count = cut.sections.len(),
        noun = cut.noun(),
        fraction = report.area_fraction,
        u = report.plane[0].name(),
        v = report.plane[1].name(),
    )?;
    let clipped = cut.sections.iter().any(|section| section.clipped);
    if clipped {
        writeln!(
            out,
            r#"<clipPath id="cut"><rect x="0" y="0" width="{width:.decimals$}" height="{height:.decimals$}"/></clipPath>"#
        )?;
    }
    let clip = if clipped { r#" clip-path="url(#cut)""# } else { "" };
    writeln!(out, r##"<g id="aggregates" fill="#a0a0a0"{clip}>"##)?;
    for section in &cut.sections {
        let (x, y) = (section.center_mm[0] - u0, v1 - section.center_mm[1]);
        let [at_x, at_y] = [x, y].map(|x| fixed(x, decimals));
        match &section.figure {
            Figure::Circle { radius_mm: r } => {
                writeln!(out, r#"<circle cx="{at_x}" cy="{at_y}" r="{r:.decimals$}"/>"#)?;
            }
            Figure::Polygon(polygon) => {
                let points: Vec<String> = polygon
                    .corners_mm
                    .iter()
                    .map(|[u, v]| format!("{},{}", fixed(x + u, decimals), fixed(y - v, decimals)))
                    .collect();
                writeln!(out, r#"<polygon points="{}"/>"#, points.join(" "))?;
            }
            Figure::Ellipse(ellipse) => {
                // y points down here: what turns towards v turns the other way.
                let ([a, b], angle) = (ellipse.semi_axes_mm, fixed(0.0 - ellipse.angle_deg(), 4));
                writeln!(
                    out,
                    r#"<ellipse cx="{at_x}" cy="{at_y}" rx="{a:.decimals$}" ry="{b:.decimals$}" transform="rotate({angle} {at_x} {at_y})"/>"#
                )?;
            }
        }
    }
    writeln!(out, "</g>")?;
    let pen = format!(r##"fill="none" stroke="#000" stroke-width="{line:.decimals$}""##);
    match cut.outline {
        Outline::Rectangle { .. } => writeln!(
            out,
            r#"<rect id="outline" x="0" y="0" width="{width:.decimals$}" height="{height:.decimals$}" {pen}/>"#
        )?,
        Outline::Disc { radius_mm: r, .. } => writeln!(
            out,
            r#"<circle id="outline" cx="{r:.decimals$}" cy="{r:.decimals$}" r="{r:.decimals$}" {pen}/>"#
        )?,
    }
    let (baseline, right) = (height + margin + 1.5 * font, bar + 0.5 * font);
    let bar_y = baseline - 0.35 * font;
    write!(
        out,
        r##"<path id="scale" d="M0 {bar_y:.decimals$}h{bar:.decimals$}" stroke="#000" stroke-width="{thick:.decimals$}"/>
<g font-family="sans-serif" font-size="{font:.decimals$}" fill="#000">
<text x="{right:.decimals$}" y="{baseline:.decimals$}">{bar} mm</text>
<text x="{width:.decimals$}" y="{baseline:.decimals$}" text-anchor="end">{axis} = {at} mm, {percent:.1} % aggregate</text>
</g>
</svg>
"##,
        at = short(cut.at_mm),
        percent = 100.0 * report.area_fraction,
        thick = 0.4 * font,
    )
}

/// The largest of 1, 2, 5 times a power of ten that is at most a fifth of the width.
fn scale_bar(width: f64) -> f64 {
    let most = width / 5.0;
    let power = powf(10.0, log10(most).floor());
    // Divided rather than multiplied below 1, so that the label has no digits of rounding.
    let times =
        |factor: f64| if power < 1.0 { factor / (1.0 / power).round() } else { factor * power.round() };
    [5.0, 2.0, 1.0].each(times).into_iter().find(|length| *length <= most).unwrap_or_else(|| times(1.0))
}

/// A number with at most four decimals.
fn short(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_bars_are_round() {
        assert_eq!([150.0, 100.0, 49.0, 4.0, 0.06].map(scale_bar), [20.0, 20.0, 5.0, 0.5, 0.01]);
    }
}
