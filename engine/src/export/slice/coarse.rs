//! Sections of polyhedra with few corners and no short sides, for meshes: long straight parts as they are, arcs as
//! chords.
//!
//! A section that is drawn has as many corners as it takes to look round, and a plane cuts off corners of a polyhedron
//! in sides of any length. A mesh has edges of a share of the circumference of the section, a twentieth where nothing
//! else is requested, or of the largest element where that is shorter. Parts that are curved, or shorter than a third
//! of such an edge, are divided evenly; one that is shorter than that as a whole becomes its middle. The polygon is
//! then enlarged about its centroid to the area of the section, as far as a quarter of the gaps to other sections and
//! half of those to the edges of the cut allow. A section without such parts stays as it is.

use std::collections::HashMap;

use super::sizes::Sizes;
use super::{Cut, Figure, Outline, Polygon};
use crate::elementary::hypot;
use crate::sorting;

/// Parts of the boundary that are shorter than that share of an edge are divided with their neighbours.
const SHORT: f64 = 0.35;
/// No section has to be enlarged by more.
const MOST_ENLARGED: f64 = 1.1;

type Point = [f64; 2];
/// A grain and the area of its section: images of one grain at opposite edges have the same.
type Image = (usize, u64);

/// The corners of each section of a polyhedron with curved or short sides, about its centre; none of other sections.
pub(super) fn corners(cut: &Cut, sizes: Sizes) -> Vec<Option<Vec<Point>>> {
    let all: Vec<Option<&Polygon>> =
        cut.sections.iter().map(|section| uneven(&section.figure, sizes)).collect();
    if all.iter().all(Option::is_none) {
        return vec![None; all.len()];
    }
    let rooms = rooms(cut);
    let mut least: HashMap<Image, f64> = HashMap::new();
    let mut made: Vec<Option<(Vec<Point>, Image)>> = Vec::with_capacity(all.len());
    for ((section, polygon), room) in cut.sections.iter().zip(all).zip(rooms) {
        made.push(polygon.map(|polygon| {
            let corners = divided(polygon, edge_mm(polygon, sizes));
            let (area, outer) = (polygon.area_mm2(), section.figure.outer_mm());
            let wanted = (area / crate::grain::figure::area(&corners)).sqrt();
            let factor = wanted.min(1.0 + room / outer);
            // Images of one grain at opposite edges stay equal.
            let image = (section.grain, area.to_bits());
            let least = least.entry(image).or_insert(f64::INFINITY);
            *least = least.min(factor);
            (corners, image)
        }));
    }
    let enlarged = |(corners, image): (Vec<Point>, Image)| {
        let factor = least.get(&image).copied().unwrap_or(1.0);
        corners.iter().map(|p| [factor * p[0], factor * p[1]]).collect()
    };
    made.into_iter().map(|made| made.map(enlarged)).collect()
}

/// The polygon of a section that has curved or short sides.
fn uneven(figure: &Figure, sizes: Sizes) -> Option<&Polygon> {
    match figure {
        Figure::Polygon(polygon) => {
            let edge_mm = edge_mm(polygon, sizes);
            (0..polygon.corners_mm.len()).any(|side| is_soft(polygon, side, edge_mm)).then_some(polygon)
        }
        Figure::Circle { .. } | Figure::Ellipse(_) => None,
    }
}

/// Length of the edges of the mesh along a section.
fn edge_mm(polygon: &Polygon, sizes: Sizes) -> f64 {
    sizes.longest_mm.min(circumference(&polygon.corners_mm) / f64::from(sizes.segments))
}

/// Whether the side from that corner to the next is curved or short.
fn is_soft(polygon: &Polygon, side: usize, edge_mm: f64) -> bool {
    let (all, n) = (&polygon.corners_mm, polygon.corners_mm.len());
    polygon.is_curved.get(side % n) == Some(&true)
        || length(all[side % n], all[(side + 1) % n]) < SHORT * edge_mm
}

fn length(p: Point, q: Point) -> f64 {
    hypot(q[0] - p[0], q[1] - p[1])
}

fn circumference(corners: &[Point]) -> f64 {
    (0..corners.len()).map(|i| length(corners[i], corners[(i + 1) % corners.len()])).sum()
}

/// The corners of a section for edges of that length.
fn divided(polygon: &Polygon, edge_mm: f64) -> Vec<Point> {
    let all = &polygon.corners_mm;
    let n = all.len();
    let at = |i: usize| all[i % n];
    let is_soft = |side: usize| is_soft(polygon, side, edge_mm);
    let Some(start) = (0..n).find(|&i| !is_soft(i)) else {
        // A closed curve.
        let parts = (circumference(all) / edge_mm).round().max(6.0) as usize;
        let mut points = evenly(&[all.as_slice(), &all[..1]].concat(), parts);
        points.pop();
        return points;
    };
    let mut corners = Vec::new();
    let mut i = start + 1;
    while i <= start + n {
        if !is_soft(i) {
            corners.push(at(i));
            i += 1;
            continue;
        }
        let first = i;
        while is_soft(i) {
            i += 1;
        }
        let run: Vec<Point> = (first..=i).map(at).collect();
        let long: f64 = run.windows(2).map(|pair| length(pair[0], pair[1])).sum();
        if long < SHORT * edge_mm {
            corners.push(evenly(&run, 2)[1]);
        } else {
            corners.extend(evenly(&run, (long / edge_mm).round().max(1.0) as usize));
        }
        // The end of the run begins a straight part.
        i += 1;
    }
    corners
}

/// Points that divide a line of points into equal parts, with both ends.
fn evenly(line: &[Point], parts: usize) -> Vec<Point> {
    let long: f64 = line.windows(2).map(|pair| length(pair[0], pair[1])).sum();
    let mut points = vec![line[0]];
    let (mut before, mut next) = (0.0, 1);
    for pair in line.windows(2) {
        let own = length(pair[0], pair[1]);
        while next < parts && before + own >= long * next as f64 / parts as f64 {
            let share = (long * next as f64 / parts as f64 - before) / own;
            points.push([0, 1].map(|axis| pair[0][axis] + share * (pair[1][axis] - pair[0][axis])));
            next += 1;
        }
        before += own;
    }
    points.extend(line.last());
    points
}

/// How far each section may be enlarged.
fn rooms(cut: &Cut) -> Vec<f64> {
    let sections = &cut.sections;
    let outer: Vec<f64> = sections.iter().map(|section| section.figure.outer_mm()).collect();
    let largest = outer.iter().copied().fold(0.0, f64::max);
    let boundaries: Vec<Vec<Point>> = sections.iter().map(boundary).collect();
    let mut rooms: Vec<f64> = (0..sections.len()).map(|i| (MOST_ENLARGED - 1.0) * outer[i]).collect();
    let mut order: Vec<usize> = (0..sections.len()).collect();
    sorting::by_number(&mut order, |&i| sections[i].center_mm[0]);
    for (k, &i) in order.iter().enumerate() {
        if !cut.periodic {
            rooms[i] = rooms[i].min(to_outline(cut, &boundaries[i]).max(0.0) / 2.0);
        }
        for &j in &order[k + 1..] {
            let [u, v] = [0, 1].map(|axis| sections[j].center_mm[axis] - sections[i].center_mm[axis]);
            let reach = 4.0 * (MOST_ENLARGED - 1.0) * largest;
            if u > outer[i] + largest + reach {
                break;
            }
            if hypot(u, v) < outer[i] + outer[j] + reach {
                let gap = distance(&boundaries[i], &boundaries[j]);
                rooms[i] = rooms[i].min(gap / 4.0);
                rooms[j] = rooms[j].min(gap / 4.0);
            }
        }
    }
    rooms
}

/// The corners of a section, of an ellipse those of a polygon, in the plane of the cut.
fn boundary(section: &super::Section) -> Vec<Point> {
    let [u, v] = section.center_mm;
    match &section.figure {
        Figure::Polygon(polygon) => polygon.corners_mm.iter().map(|p| [u + p[0], v + p[1]]).collect(),
        Figure::Circle { radius_mm } => of_ellipse([u, v], [*radius_mm; 2], [1.0, 0.0]),
        Figure::Ellipse(ellipse) => of_ellipse([u, v], ellipse.semi_axes_mm, ellipse.long),
    }
}

fn of_ellipse([u, v]: Point, [a, b]: [f64; 2], [c, s]: Point) -> Vec<Point> {
    const CORNERS: u32 = 64;
    let corner = |k: u32| {
        let (sin, cos) =
            crate::elementary::sin_cos(std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS));
        [u + a * cos * c - b * sin * s, v + a * cos * s + b * sin * c]
    };
    (0..CORNERS).map(corner).collect()
}

/// Distance of two polygons that lie apart.
fn distance(one: &[Point], other: &[Point]) -> f64 {
    let to_edges = |p: &Point, polygon: &[Point]| {
        let edges = (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]));
        let of_edge = |(from, to): (Point, Point)| {
            let (along, apart) = ([to[0] - from[0], to[1] - from[1]], [p[0] - from[0], p[1] - from[1]]);
            let square = along[0] * along[0] + along[1] * along[1];
            let share = ((along[0] * apart[0] + along[1] * apart[1]) / square).clamp(0.0, 1.0);
            hypot(apart[0] - share * along[0], apart[1] - share * along[1])
        };
        edges.map(of_edge).fold(f64::INFINITY, f64::min)
    };
    let of_one = one.iter().map(|p| to_edges(p, other)).fold(f64::INFINITY, f64::min);
    other.iter().map(|p| to_edges(p, one)).fold(of_one, f64::min)
}

/// Distance of a polygon from the outline of the cut.
fn to_outline(cut: &Cut, corners: &[Point]) -> f64 {
    let of_corner = |p: &Point| match cut.outline {
        Outline::Rectangle { u_mm, v_mm } => {
            let to = |x: f64, [low, high]: [f64; 2]| (x - low).min(high - x);
            to(p[0], u_mm).min(to(p[1], v_mm))
        }
        Outline::Disc { center_mm, radius_mm } => radius_mm - hypot(p[0] - center_mm[0], p[1] - center_mm[1]),
    };
    corners.iter().map(of_corner).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const SIZES: Sizes = Sizes { segments: 20, longest_mm: 1.0 };

    /// A square of edge 2 whose corners are quarters of circles with the radius `r`.
    fn rounded_square(r: f64) -> Polygon {
        let (mut corners_mm, mut is_curved) = (Vec::new(), Vec::new());
        for quarter in 0..4 {
            let turned = |[x, y]: Point| (0..quarter).fold([x, y], |[x, y], _| [-y, x]);
            for k in 0..=32 {
                let (sin, cos) =
                    crate::elementary::sin_cos(f64::from(k) / 32.0 * std::f64::consts::FRAC_PI_2);
                corners_mm.push(turned([1.0 - r + r * cos, 1.0 - r + r * sin]));
                is_curved.push(k < 32);
            }
        }
        Polygon { corners_mm, is_curved }
    }

    #[test]
    fn a_sharp_section_loses_its_short_sides_and_keeps_the_others() {
        // A square with the edge 2, of which one corner is cut off.
        let cut_off = |by: f64| Polygon {
            corners_mm: vec![[1.0, -1.0], [1.0, 1.0 - by], [1.0 - by, 1.0], [-1.0, 1.0], [-1.0, -1.0]],
            is_curved: Vec::new(),
        };
        let short = cut_off(0.05);
        assert!(uneven(&Figure::Polygon(short.clone()), SIZES).is_some());
        let corners = divided(&short, edge_mm(&short, SIZES));
        assert_eq!(corners.len(), 4, "{corners:?}");
        assert!(corners.contains(&[0.975, 0.975]) && corners.contains(&[-1.0, -1.0]), "{corners:?}");
        assert!(uneven(&Figure::Polygon(cut_off(0.5)), SIZES).is_none());
    }

    #[test]
    fn a_rounded_square_has_few_corners_and_no_short_edges() {
        for (r, most) in [(0.02, 4), (0.1, 8), (0.3, 12), (0.9, 24)] {
            let polygon = rounded_square(r);
            let edge_mm = circumference(&polygon.corners_mm) / 20.0;
            let corners = divided(&polygon, edge_mm);
            assert!(corners.len() >= 4 && corners.len() <= most, "{r}: {}", corners.len());
            let shortest = (0..corners.len()).map(|i| length(corners[i], corners[(i + 1) % corners.len()]));
            assert!(shortest.fold(f64::INFINITY, f64::min) > SHORT * edge_mm, "{r}: {corners:?}");
            let (coarse, exact) = (crate::grain::figure::area(&corners), polygon.area_mm2());
            assert!((0.97..1.0).contains(&(coarse / exact)), "{r}: {coarse}, {exact}");
        }
    }
}
