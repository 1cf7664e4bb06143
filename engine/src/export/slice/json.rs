//! The circles and the figures of a cut as one JSON object.

use std::io::{self, Write};

use super::{Cut, SliceReport};

pub(super) fn write(cut: &Cut, report: &SliceReport, out: &mut dyn Write) -> io::Result<()> {
    let mut head = serde_json::to_vec(report)?;
    // The object is opened again for the circles, which are written as they come.
    head.pop();
    out.write_all(&head)?;
    out.write_all(
        br#","circles":{"columns":["u_mm","v_mm","radius_mm","grain","diameter_mm","area_mm2"],"rows":["#,
    )?;
    let mut digits = zmij::Buffer::new();
    for (i, circle) in cut.circles.iter().enumerate() {
        out.write_all(if i == 0 { b"\n[" } else { b",\n[" })?;
        for x in [circle.center_mm[0], circle.center_mm[1], circle.radius_mm] {
            out.write_all(digits.format_finite(x).as_bytes())?;
            out.write_all(b",")?;
        }
        write!(out, "{},", circle.grain)?;
        out.write_all(digits.format_finite(circle.diameter_mm).as_bytes())?;
        out.write_all(b",")?;
        out.write_all(digits.format_finite(circle.area_mm2).as_bytes())?;
        out.write_all(b"]")?;
    }
    out.write_all(b"\n]}}\n")
}
