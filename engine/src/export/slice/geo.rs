//! A Gmsh script of a cut: plane surfaces of matrix and aggregates that share their edges, with physical groups.
//!
//! Groups: surfaces `matrix` and `aggregates`, or one for each of several aggregates, curves `itz` and one per edge of
//! the outline (`x_min` and so on; `side` where that is a cylinder's lateral surface). Where all sections lie inside,
//! the matrix is made with its holes at once; sections that cross the edges of a periodic cut are clipped by the
//! kernel's Boolean operations.
//!
//! Circles are curves of the kernel, which Gmsh divides evenly. It divides ellipses by their curvature, and the area
//! of the polygon has no closed form then: an ellipse is written as the affine image of a regular polygon, whose area
//! is that of the ellipse at a known factor. Polygons have few corners and no short sides (`coarse`).

use std::collections::HashMap;
use std::io::{self, Write};

use super::coarse::corners;
use super::sizes::Sizes;
use super::{Cut, Figure, FigureKind, Outline, Section};
use crate::arrays::Each as _;
use crate::elementary::{atan2, hypot};
use crate::export::groups::AggregateGroups;
use crate::gap::ellipsoids::Body;
use crate::sorting;

/// Tags of circles start after those of the outline's edges, those of surfaces after that of the matrix.
const FIRST_CIRCLE: usize = 5;
const FIRST_GRAIN: usize = 2;
/// Name of the group of all sections, where the mix names no aggregates.
const AGGREGATES: &str = "aggregates";

// Gmsh reads a line before it runs the macro that the line calls: what needs its results stands on the next one.
const ENLARGE: &str = "\
// Enlarges the radius r so that a regular polygon has the area of the circle, up to most.
Macro Enlarge
  n = Ceil(2*Pi*r/size_max);
  If (n < segments)
    n = segments;
  EndIf
  r = r*Sqrt(2*Pi/n/Sin(2*Pi/n));
  If (r > most)
    r = most;
  EndIf
Return
";

const ELLIPSE_AS_POLYGON: &str = "\
// Makes surface s: the ellipse around (u, v) with the semi-axes r and ratio*r, the longer one at the angle t, as a
// polygon of the same area.
Macro Polygon
  Call Enlarge;
  p = newp; c = newc;
  For k In {0:n-1}
    x = r*Cos(2*Pi*k/n); y = ratio*r*Sin(2*Pi*k/n);
    Point(p + k) = {u + x*Cos(t) - y*Sin(t), v + x*Sin(t) + y*Cos(t), 0};
  EndFor
  For k In {0:n-2}
    Line(c + k) = {p + k, p + k + 1};
  EndFor
  Line(c + n - 1) = {p + n - 1, p};
  Curve Loop(s) = {c:c + n - 1}; Plane Surface(s) = {s};
  itz() += {c:c + n - 1};
Return
itz() = {};
";

pub(super) fn write(
    cut: &Cut,
    sizes: Sizes,
    groups: &AggregateGroups<'_>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let segments = sizes.segments;
    let (axis, [u, v]) = (cut.axis.name(), cut.axis.plane().each(super::Axis::name));
    write!(
        out,
        "// Cut at {axis} = {at} mm, {n} {noun}; x and y here are {u} and {v} of the specimen, in mm.\n\
         SetFactory(\"OpenCASCADE\");\n\
         DefineConstant[ segments = {{{segments}, Name \"Segments per circumference\"}} ];\n\
         DefineConstant[ size_max = {{{size}, Name \"Largest element, mm\"}} ];\n\
         Mesh.MeshSizeFromCurvature = segments;\n\
         Mesh.MeshSizeMax = size_max;\n\
         {ENLARGE}",
        at = cut.at_mm,
        n = cut.sections.len(),
        noun = cut.noun(),
        size = sizes.longest_mm,
    )?;
    if cut.kinds.contains(&FigureKind::Ellipse) {
        out.write_all(ELLIPSE_AS_POLYGON.as_bytes())?;
    } else if cut.kinds.contains(&FigureKind::Polygon) {
        writeln!(out, "itz() = {{}};")?;
    }
    if cut.sections.iter().any(|section| section.clipped) {
        clipped(cut, sizes, groups, out)?;
    } else {
        with_holes(cut, sizes, groups, out)?;
    }
    edges(cut, out)
}

/// The outline's edges as curves from 1, and its loop 1.
fn outline(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    match cut.outline {
        Outline::Rectangle { u_mm: [u0, u1], v_mm: [v0, v1] } => {
            for (i, (u, v)) in [(u0, v0), (u1, v0), (u1, v1), (u0, v1)].into_iter().enumerate() {
                writeln!(out, "Point({}) = {{{u}, {v}, 0}};", i + 1)?;
            }
            for i in 1..=4 {
                writeln!(out, "Line({i}) = {{{i}, {}}};", i % 4 + 1)?;
            }
            writeln!(out, "Curve Loop(1) = {{1:4}};")
        }
        Outline::Disc { center_mm: [u, v], radius_mm } => {
            writeln!(out, "Circle(1) = {{{u}, {v}, 0, {radius_mm}, 0, 2*Pi}};\nCurve Loop(1) = {{1}};")
        }
    }
}

/// What makes a surface of a section with that tag; a circle of it where the curve has a tag.
fn surface(
    section: &Section,
    coarse: Option<&[[f64; 2]]>,
    most: f64,
    surface: usize,
    curve: Option<usize>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let [u, v] = section.center_mm;
    match (&section.figure, curve) {
        (Figure::Circle { radius_mm: r }, Some(curve)) => writeln!(
            out,
            "r = {r}; most = {most}; Call Enlarge;\nCircle({curve}) = {{{u}, {v}, 0, r, 0, 2*Pi}}; \
             Curve Loop({surface}) = {{{curve}}}; Plane Surface({surface}) = {{{surface}}};"
        ),
        (Figure::Circle { radius_mm: r }, None) => {
            writeln!(out, "r = {r}; most = {most}; Call Enlarge;\nDisk({surface}) = {{{u}, {v}, 0, r}};")
        }
        (Figure::Polygon(polygon), _) => {
            let corners = coarse.unwrap_or(&polygon.corners_mm);
            let n = corners.len();
            write!(out, "p = newp; c = newc;")?;
            for (k, corner) in corners.iter().enumerate() {
                write!(out, " Point(p + {k}) = {{{}, {}, 0}};", u + corner[0], v + corner[1])?;
            }
            for k in 0..n {
                write!(out, " Line(c + {k}) = {{p + {k}, p + {}}};", (k + 1) % n)?;
            }
            writeln!(
                out,
                " Curve Loop({surface}) = {{c:c + {last}}}; Plane Surface({surface}) = {{{surface}}}; \
                 itz() += {{c:c + {last}}};",
                last = n - 1
            )
        }
        (Figure::Ellipse(ellipse), _) => {
            let ([a, b], [c, s]) = (ellipse.semi_axes_mm, ellipse.long);
            let (ratio, angle) = (b / a, atan2(s, c));
            writeln!(
                out,
                "s = {surface}; r = {a}; ratio = {ratio}; t = {angle}; u = {u}; v = {v}; most = {most}; Call Polygon;"
            )
        }
    }
}

/// The sections of each aggregate, by the name of its group: places in the list. One group where the mix names no
/// aggregates.
fn by_group<'a>(
    sections: impl Iterator<Item = &'a Section>,
    groups: &'a AggregateGroups<'_>,
) -> Vec<(&'a str, Vec<usize>)> {
    let mut all: Vec<(usize, &str, Vec<usize>)> = if groups.is_empty() {
        vec![(0, AGGREGATES, Vec::new())]
    } else {
        groups.with_grains().map(|(number, name)| (number, name, Vec::new())).collect()
    };
    for (place, section) in sections.enumerate() {
        let number = groups.of_grain(section.grain);
        if let Some((_, _, places)) = all.iter_mut().find(|(own, _, _)| *own == number) {
            places.push(place);
        }
    }
    all.into_iter()
        .filter(|(_, _, places)| !places.is_empty())
        .map(|(_, name, places)| (name, places))
        .collect()
}

/// Tags from a first one on as a list of the script; without gaps as a range.
fn tags(places: &[usize], first: usize) -> String {
    let is_range = places.windows(2).all(|pair| pair[0] + 1 == pair[1]);
    match (places, is_range) {
        ([from, .., to], true) => format!("{}:{}", first + from, first + to),
        _ => places.iter().map(|place| (first + place).to_string()).collect::<Vec<_>>().join(", "),
    }
}

/// All sections inside: their loops are holes of the matrix and edges of the aggregates.
fn with_holes(cut: &Cut, sizes: Sizes, groups: &AggregateGroups<'_>, out: &mut dyn Write) -> io::Result<()> {
    outline(cut, out)?;
    let n = cut.sections.len();
    let most = most_radii(cut);
    let coarse = corners(cut, sizes);
    for (i, ((section, most), coarse)) in cut.sections.iter().zip(most).zip(&coarse).enumerate() {
        surface(section, coarse.as_deref(), most, FIRST_GRAIN + i, Some(FIRST_CIRCLE + i), out)?;
    }
    if n == 0 {
        return writeln!(out, "Plane Surface(1) = {{1}};\nPhysical Surface(\"matrix\") = {{1}};");
    }
    let (last_grain, last_circle) = (FIRST_GRAIN + n - 1, FIRST_CIRCLE + n - 1);
    let itz = match cut.kinds[..] {
        [FigureKind::Circle] => format!("{FIRST_CIRCLE}:{last_circle}"),
        _ => "itz()".to_owned(),
    };
    writeln!(
        out,
        "Plane Surface(1) = {{1:{last_grain}}};\n\
         Physical Surface(\"matrix\") = {{1}};"
    )?;
    for (name, places) in by_group(cut.sections.iter(), groups) {
        writeln!(out, "Physical Surface(\"{name}\") = {{{}}};", tags(&places, FIRST_GRAIN))?;
    }
    writeln!(out, "Physical Curve(\"itz\") = {{{itz}}};")
}

/// Some sections cross the rectangle: they are clipped by it, then all is made to fit together.
fn clipped(cut: &Cut, sizes: Sizes, groups: &AggregateGroups<'_>, out: &mut dyn Write) -> io::Result<()> {
    let [[u0, u1], [v0, v1]] = cut.outline.bounds_mm();
    writeln!(out, "Rectangle(1) = {{{u0}, {v0}, 0, {}, {}}};", u1 - u0, v1 - v0)?;
    // Those inside first, so that each kind is one range of tags.
    let most = most_radii(cut);
    let coarse = corners(cut, sizes);
    let all = cut.sections.iter().zip(most.iter().zip(&coarse));
    let inside = all.clone().filter(|(section, _)| !section.clipped);
    let crossing = all.filter(|(section, _)| section.clipped);
    for (i, (section, (most, coarse))) in inside.clone().chain(crossing.clone()).enumerate() {
        surface(section, coarse.as_deref(), *most, FIRST_GRAIN + i, None, out)?;
    }
    let first_crossing = inside.clone().count();
    let in_order = inside.chain(crossing).map(|(section, _)| section);
    let by_group = by_group(in_order, groups);
    for (number, (_, places)) in (1..).zip(&by_group) {
        let (whole, crossing) = places.split_at(places.partition_point(|place| *place < first_crossing));
        writeln!(out, "grains_{number}() = {{}};")?;
        if !crossing.is_empty() {
            writeln!(
                out,
                "grains_{number}() = BooleanIntersection{{ Surface{{{}}}; Delete; }}{{ Surface{{1}}; }};",
                tags(crossing, FIRST_GRAIN)
            )?;
        }
        if !whole.is_empty() {
            writeln!(out, "grains_{number}() += {{{}}};", tags(whole, FIRST_GRAIN))?;
        }
    }
    let names: Vec<String> = (1..=by_group.len()).map(|number| format!("grains_{number}()")).collect();
    writeln!(
        out,
        "grains() = {{{}}};\n\
         all() = BooleanFragments{{ Surface{{1}}; Delete; }}{{ Surface{{grains()}}; Delete; }};\n\
         matrix() = all(); matrix() -= grains();\n\
         edges() = Abs(CombinedBoundary{{ Surface{{all()}}; }});\n\
         itz() = Abs(Boundary{{ Surface{{grains()}}; }}); itz() -= edges();\n\
         Physical Surface(\"matrix\") = {{matrix()}};",
        names.join(", ")
    )?;
    for ((name, _), list) in by_group.iter().zip(&names) {
        writeln!(out, "Physical Surface(\"{name}\") = {{{list}}};")?;
    }
    writeln!(out, "Physical Curve(\"itz\") = {{itz()}};")
}

/// The groups of the outline's edges.
fn edges(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    let Outline::Rectangle { u_mm: [u0, u1], v_mm: [v0, v1] } = cut.outline else {
        return writeln!(out, "Physical Curve(\"side\") = {{1}};");
    };
    let [u, v] = cut.axis.plane().each(super::Axis::name);
    if !cut.sections.iter().any(|section| section.clipped) {
        if cut.lateral {
            writeln!(out, "Physical Curve(\"side\") = {{2, 4}};")?;
        } else {
            writeln!(out, "Physical Curve(\"{u}_min\") = {{4}};\nPhysical Curve(\"{u}_max\") = {{2}};")?;
        }
        return writeln!(out, "Physical Curve(\"{v}_min\") = {{1}};\nPhysical Curve(\"{v}_max\") = {{3}};");
    }
    // The edges are in pieces now: found by where they lie.
    let e = 1e-6 * (u1 - u0).max(v1 - v0);
    let boxes = [
        (u, "min", [u0, v0, u0, v1]),
        (u, "max", [u1, v0, u1, v1]),
        (v, "min", [u0, v0, u1, v0]),
        (v, "max", [u0, v1, u1, v1]),
    ];
    for (axis, end, [a0, b0, a1, b1]) in boxes {
        writeln!(
            out,
            "Physical Curve(\"{axis}_{end}\") = {{Curve In BoundingBox{{{}, {}, {}, {}, {}, {}}}}};",
            a0 - e,
            b0 - e,
            -e,
            a1 + e,
            b1 + e,
            e
        )?;
    }
    Ok(())
}

/// The radii, of ellipses the longer semi-axes, that sections may be enlarged to: each takes a quarter of the gap to
/// its nearest neighbour, and half of that to an edge that no section crosses. No point of an ellipse moves farther
/// than the end of its long axis.
fn most_radii(cut: &Cut) -> Vec<f64> {
    let sections = &cut.sections;
    // Polygons have their area as they are.
    if cut.kinds == [FigureKind::Polygon] {
        return vec![0.0; sections.len()];
    }
    let mut order: Vec<usize> = (0..sections.len()).collect();
    sorting::by_number(&mut order, |&i| sections[i].center_mm[0]);
    let radius = |i: usize| sections[i].figure.outer_mm();
    let largest = (0..sections.len()).map(radius).fold(0.0, f64::max);
    let mut most: Vec<f64> = sections.iter().map(|section| to_edges(cut, section)).collect();
    for (k, &i) in order.iter().enumerate() {
        let (one, reach) = (&sections[i], radius(i) + largest * (1.0 + MOST_ENLARGED));
        for &j in &order[k + 1..] {
            let other = &sections[j];
            let [u, v] = [0, 1].each(|a| other.center_mm[a] - one.center_mm[a]);
            if u > reach {
                break;
            }
            let gap = gap_mm(one, other, hypot(u, v)).max(0.0);
            most[i] = most[i].min(radius(i) + gap / 4.0);
            most[j] = most[j].min(radius(j) + gap / 4.0);
        }
    }
    // Images of one grain at opposite edges stay equal.
    let image = |i: usize| (sections[i].grain, radius(i).to_bits());
    let mut least: HashMap<(usize, u64), f64> = HashMap::new();
    for (i, most) in most.iter().enumerate() {
        let least = least.entry(image(i)).or_insert(f64::INFINITY);
        *least = least.min(*most);
    }
    (0..sections.len()).map(|i| least.get(&image(i)).copied().unwrap_or(most[i])).collect()
}

/// A triangle has to be enlarged by 0.56 of its radius to have the area of the circle, and a quarter of a gap may be
/// used.
const MOST_ENLARGED: f64 = 4.0 * 0.56;

/// Gap between two sections whose centres are that far apart.
fn gap_mm(one: &Section, other: &Section, apart: f64) -> f64 {
    let between_outer = apart - one.figure.outer_mm() - other.figure.outer_mm();
    match (&one.figure, &other.figure) {
        (Figure::Circle { .. }, Figure::Circle { .. }) => between_outer,
        // Farther apart than either can be enlarged: a lower bound is enough.
        _ if between_outer > 4.0 * MOST_ENLARGED * one.figure.outer_mm().max(other.figure.outer_mm()) => {
            between_outer
        }
        _ => body(one).with(&body(other)).gap().gap_mm,
    }
}

fn body(section: &Section) -> Body {
    section.figure.body(section.center_mm)
}

/// The radius, of an ellipse the longer semi-axis, that a section may have for the sake of the outline.
fn to_edges(cut: &Cut, section: &Section) -> f64 {
    let (center, figure) = (section.center_mm, &section.figure);
    let radius = figure.outer_mm();
    if cut.periodic {
        return 2.0 * radius;
    }
    let gap = match (cut.outline, figure) {
        (Outline::Rectangle { u_mm, v_mm }, _) => {
            let to = |x: f64, [low, high]: [f64; 2]| (x - low).min(high - x);
            let [[_, half_u], [_, half_v]] = figure.extents_mm();
            (to(center[0], u_mm) - half_u).min(to(center[1], v_mm) - half_v)
        }
        (Outline::Disc { center_mm, radius_mm }, Figure::Circle { .. }) => {
            radius_mm - hypot(center[0] - center_mm[0], center[1] - center_mm[1]) - radius
        }
        (Outline::Disc { center_mm, radius_mm }, Figure::Ellipse(_) | Figure::Polygon(_)) => {
            radius_mm - body(section).reach_from_axis_mm(center_mm)
        }
    };
    radius + gap.max(0.0) / 2.0
}
