//! A Gmsh script of a cut: plane surfaces of matrix and aggregates that share their edges, with physical groups.
//!
//! Groups: surfaces `matrix` and `aggregates`, curves `itz` and one per edge of the outline (`x_min` and so on;
//! `side` where that is a cylinder's lateral surface). Where all circles lie inside, the matrix is made with its holes
//! at once; circles that cross the edges of a periodic cut are clipped by the kernel's Boolean operations.

use std::collections::HashMap;
use std::io::{self, Write};

use super::{Circle, Cut, Outline};

/// Elements along the circumference of a circle; the user of the script may say otherwise.
const SEGMENTS: u32 = 20;
/// Elements along the longer edge where nothing asks for smaller ones.
const ELEMENTS_PER_EDGE: f64 = 25.0;
/// Tags of circles start after those of the outline's edges, those of surfaces after that of the matrix.
const FIRST_CIRCLE: usize = 5;
const FIRST_GRAIN: usize = 2;

pub(super) fn write(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    let [[u0, u1], [v0, v1]] = cut.outline.bounds_mm();
    let long = (u1 - u0).max(v1 - v0);
    let (axis, [u, v]) = (cut.axis.name(), cut.axis.plane().map(super::Axis::name));
    write!(
        out,
        "// Cut at {axis} = {at} mm, {n} circles; x and y here are {u} and {v} of the specimen, in mm.\n\
         SetFactory(\"OpenCASCADE\");\n\
         DefineConstant[ segments = {{{SEGMENTS}, Name \"Segments per circumference\"}} ];\n\
         DefineConstant[ size_max = {{{size}, Name \"Largest element, mm\"}} ];\n\
         Mesh.MeshSizeFromCurvature = segments;\n\
         Mesh.MeshSizeMax = size_max;\n\
         // Enlarges the radius r so that a regular polygon has the area of the circle, up to most.\n\
         Macro Enlarge\n  n = Ceil(2*Pi*r/size_max);\n  If (n < segments)\n    n = segments;\n  EndIf\n  \
         r = r*Sqrt(2*Pi/n/Sin(2*Pi/n));\n  If (r > most)\n    r = most;\n  EndIf\nReturn\n",
        at = cut.at_mm,
        n = cut.circles.len(),
        size = long / ELEMENTS_PER_EDGE,
    )?;
    if cut.circles.iter().any(|circle| circle.clipped) {
        clipped(cut, out)?;
    } else {
        with_holes(cut, out)?;
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

/// All circles inside: their loops are holes of the matrix and edges of the aggregates.
fn with_holes(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    outline(cut, out)?;
    let n = cut.circles.len();
    let most = most_radii(cut);
    for (i, (circle, most)) in cut.circles.iter().zip(most).enumerate() {
        let (curve, surface) = (FIRST_CIRCLE + i, FIRST_GRAIN + i);
        let [u, v] = circle.center_mm;
        writeln!(
            out,
            "r = {r}; most = {most}; Call Enlarge; Circle({curve}) = {{{u}, {v}, 0, r, 0, 2*Pi}}; \
             Curve Loop({surface}) = {{{curve}}}; Plane Surface({surface}) = {{{surface}}};",
            r = circle.radius_mm
        )?;
    }
    if n == 0 {
        return writeln!(out, "Plane Surface(1) = {{1}};\nPhysical Surface(\"matrix\") = {{1}};");
    }
    let (last_grain, last_circle) = (FIRST_GRAIN + n - 1, FIRST_CIRCLE + n - 1);
    writeln!(
        out,
        "Plane Surface(1) = {{1:{last_grain}}};\n\
         Physical Surface(\"matrix\") = {{1}};\n\
         Physical Surface(\"aggregates\") = {{{FIRST_GRAIN}:{last_grain}}};\n\
         Physical Curve(\"itz\") = {{{FIRST_CIRCLE}:{last_circle}}};"
    )
}

/// Some circles cross the rectangle: they are clipped by it, then all is made to fit together.
fn clipped(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    let [[u0, u1], [v0, v1]] = cut.outline.bounds_mm();
    writeln!(out, "Rectangle(1) = {{{u0}, {v0}, 0, {}, {}}};", u1 - u0, v1 - v0)?;
    // Those inside first, so that each kind is one range of tags.
    let most = most_radii(cut);
    let inside = cut.circles.iter().zip(&most).filter(|(circle, _)| !circle.clipped);
    let crossing = cut.circles.iter().zip(&most).filter(|(circle, _)| circle.clipped);
    let mut disk = |(i, (circle, most)): (usize, (&Circle, &f64))| {
        let ([u, v], r) = (circle.center_mm, circle.radius_mm);
        writeln!(out, "r = {r}; most = {most}; Call Enlarge; Disk({}) = {{{u}, {v}, 0, r}};", FIRST_GRAIN + i)
    };
    inside.clone().chain(crossing).enumerate().try_for_each(&mut disk)?;
    let first_crossing = FIRST_GRAIN + inside.count();
    let last = FIRST_GRAIN + cut.circles.len() - 1;
    writeln!(
        out,
        "grains() = BooleanIntersection{{ Surface{{{first_crossing}:{last}}}; Delete; }}{{ Surface{{1}}; }};"
    )?;
    if first_crossing > FIRST_GRAIN {
        writeln!(out, "grains() += {{{FIRST_GRAIN}:{}}};", first_crossing - 1)?;
    }
    writeln!(
        out,
        "all() = BooleanFragments{{ Surface{{1}}; Delete; }}{{ Surface{{grains()}}; Delete; }};\n\
         matrix() = all(); matrix() -= grains();\n\
         edges() = Abs(CombinedBoundary{{ Surface{{all()}}; }});\n\
         itz() = Abs(Boundary{{ Surface{{grains()}}; }}); itz() -= edges();\n\
         Physical Surface(\"matrix\") = {{matrix()}};\n\
         Physical Surface(\"aggregates\") = {{grains()}};\n\
         Physical Curve(\"itz\") = {{itz()}};"
    )
}

/// The groups of the outline's edges.
fn edges(cut: &Cut, out: &mut dyn Write) -> io::Result<()> {
    let Outline::Rectangle { u_mm: [u0, u1], v_mm: [v0, v1] } = cut.outline else {
        return writeln!(out, "Physical Curve(\"side\") = {{1}};");
    };
    let [u, v] = cut.axis.plane().map(super::Axis::name);
    if !cut.circles.iter().any(|circle| circle.clipped) {
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

/// The radii that circles may be enlarged to: each takes a quarter of the gap to its nearest neighbour, and half of
/// that to an edge that no circle crosses.
fn most_radii(cut: &Cut) -> Vec<f64> {
    let circles = &cut.circles;
    let mut order: Vec<usize> = (0..circles.len()).collect();
    order.sort_by(|&i, &j| circles[i].center_mm[0].total_cmp(&circles[j].center_mm[0]));
    let largest = circles.iter().map(|circle| circle.radius_mm).fold(0.0, f64::max);
    let mut most: Vec<f64> = circles.iter().map(|circle| to_edges(cut, circle)).collect();
    for (k, &i) in order.iter().enumerate() {
        let (one, reach) = (&circles[i], circles[i].radius_mm + largest * (1.0 + MOST_ENLARGED));
        for &j in &order[k + 1..] {
            let other = &circles[j];
            let [u, v] = [0, 1].map(|a| other.center_mm[a] - one.center_mm[a]);
            if u > reach {
                break;
            }
            let gap = (u.hypot(v) - one.radius_mm - other.radius_mm).max(0.0);
            most[i] = most[i].min(one.radius_mm + gap / 4.0);
            most[j] = most[j].min(other.radius_mm + gap / 4.0);
        }
    }
    // Images of one grain at opposite edges stay equal.
    let image = |i: usize| (circles[i].grain, circles[i].radius_mm.to_bits());
    let mut least: HashMap<(usize, u64), f64> = HashMap::new();
    for (i, most) in most.iter().enumerate() {
        let least = least.entry(image(i)).or_insert(f64::INFINITY);
        *least = least.min(*most);
    }
    (0..circles.len()).map(|i| least.get(&image(i)).copied().unwrap_or(most[i])).collect()
}

/// A triangle has to be enlarged by 0.56 of its radius to have the area of the circle.
const MOST_ENLARGED: f64 = 4.0 * 0.56;

/// The radius that a circle may have for the sake of the outline.
fn to_edges(cut: &Cut, circle: &Circle) -> f64 {
    let (center, radius) = (circle.center_mm, circle.radius_mm);
    if cut.periodic {
        return 2.0 * radius;
    }
    let inside = match cut.outline {
        Outline::Rectangle { u_mm, v_mm } => {
            let to = |x: f64, [low, high]: [f64; 2]| (x - low).min(high - x);
            to(center[0], u_mm).min(to(center[1], v_mm))
        }
        Outline::Disc { center_mm, radius_mm } => {
            radius_mm - (center[0] - center_mm[0]).hypot(center[1] - center_mm[1])
        }
    };
    radius + (inside - radius).max(0.0) / 2.0
}
