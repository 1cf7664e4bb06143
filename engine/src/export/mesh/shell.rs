//! The surface of the specimen: its faces, the curves where two meet, and the points where curves end.
//!
//! Which of these a vertex lies on is kept as the set of faces it belongs to. Edges follow the gap to the grains.

use std::collections::HashMap;
use std::f64::consts::TAU;

use super::bodies::{Bodies, MeshModel};
use super::options::SurfaceOptions;
use super::size::{EDGE_PER_GAP, Facing};
use super::surface::{Shape, Surface, make_more_than_half_a_turn};
use crate::arrays::{self, Each as _};
use crate::domain::Lateral;
use crate::elementary::{cos, hypot, sin, sin_cos};

/// The meshed surface of a specimen.
#[derive(Debug)]
pub(super) struct Shell {
    /// Its triangles.
    pub(super) surface: Surface,
    /// The faces that each vertex lies on, one bit each.
    pub(super) faces_of: Vec<u8>,
    /// Names of the faces, by bit.
    pub(super) names: &'static [&'static str],
    /// Where the axis of a cylinder stands.
    pub(super) axis: Option<[f64; 2]>,
}

/// Bits of the faces of a cylinder.
const SIDE: u8 = 1;
const BOTTOM: u8 = 2;
const TOP: u8 = 4;

/// What new vertices of a shell need to know.
#[derive(Debug)]
struct Growing<'a> {
    faces_of: Vec<u8>,
    /// Where there is a lateral surface: its axis, and how far from it its vertices lie.
    lateral: Option<([f64; 2], f64)>,
    close: Close<'a>,
}

/// How a shell is divided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Division {
    /// Length of edges where nothing is close.
    pub(super) edge_mm: f64,
    /// Shortest edges that closeness may ask for.
    pub(super) floor_mm: f64,
    /// Whether edges follow the gap to the grains.
    pub(super) size_field: bool,
}

impl Division {
    /// Of the surface around these grains.
    pub(super) fn of(model: &MeshModel<'_>, options: &SurfaceOptions) -> Self {
        let typical_mm = super::surface_mean_mm(model);
        Self {
            edge_mm: options.edge_mm(typical_mm).min(model.shell_most_mm),
            floor_mm: options.floor_mm(typical_mm).min(model.shell_most_mm),
            size_field: options.size_field,
        }
    }
}

impl Shell {
    /// Meshes the surface of a specimen; `None` when that would take more than `most_triangles`.
    pub(super) fn new(model: &MeshModel<'_>, division: Division, most_triangles: usize) -> Option<Self> {
        let domain = model.specimen.domain();
        let ((points, triangles, faces_of), lateral) = match domain.lateral() {
            None => {
                let counts = domain.bounds_mm.each(|length| count(length, division.edge_mm, 1));
                let cells = 4.0 * (counts[0] * counts[1] + counts[1] * counts[2] + counts[2] * counts[0]);
                if 2.0 * cells > most_triangles as f64 {
                    return None;
                }
                (cuboid(domain.bounds_mm, counts.each(|n| n as usize)), None)
            }
            Some(Lateral { center_mm, radius_mm: radius }) => {
                let height_mm = domain.bounds_mm[2];
                let rings = count(radius, division.edge_mm, 2);
                let rows = count(height_mm, division.edge_mm, 1);
                if 12.0 * rings * rings + 24.0 * rings * rows > most_triangles as f64 {
                    return None;
                }
                let vertex_radius = vertex_radius(radius, 6.0 * rings, side_gap_mm(radius, &model.bodies));
                let made = cylinder(center_mm, vertex_radius, height_mm, rings as usize, rows as usize);
                (made, Some((center_mm, vertex_radius)))
            }
        };
        let mut surface = Surface::new(points, triangles);
        let mut growing = Growing { faces_of, lateral, close: Close::new(model, division) };
        if division.size_field && !surface.refine(&mut growing, most_triangles) {
            return None;
        }
        Some(Self {
            surface,
            faces_of: growing.faces_of,
            names: domain.face_names,
            axis: lateral.map(|(axis, _)| axis),
        })
    }

    /// The face that a triangle belongs to, by bit.
    pub(super) fn face_of(&self, corners: [u32; 3]) -> usize {
        let common = corners.iter().fold(u8::MAX, |common, &p| common & self.faces_of[p as usize]);
        common.trailing_zeros() as usize
    }
}

/// Edges along a length.
fn count(length_mm: f64, edge_mm: f64, least: u32) -> f64 {
    (length_mm / edge_mm).round().max(f64::from(least))
}

impl Shape for Growing<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[[f64; 3]]) -> [f64; 3] {
        let common = self.faces_of[a as usize] & self.faces_of[b as usize];
        self.faces_of.push(common);
        let (p, q) = (points[a as usize], points[b as usize]);
        let middle = arrays::from_fn(|i| (p[i] + q[i]) / 2.0);
        match self.lateral {
            Some((axis, radius)) if common & SIDE != 0 => {
                let (x, y) = (middle[0] - axis[0], middle[1] - axis[1]);
                let out = radius / hypot(x, y);
                [axis[0] + out * x, axis[1] + out * y, middle[2]]
            }
            _ => middle,
        }
    }

    fn wants_shorter(&self, centroid: [f64; 3], longest_mm: f64) -> bool {
        self.close.want_shorter(centroid, longest_mm)
    }

    /// Whether, within a flat face, the angles opposite to ab make more than half a turn.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[[f64; 3]]) -> bool {
        let common = [a, b, c, d].iter().fold(u8::MAX, |common, &p| common & self.faces_of[p as usize]);
        // A diagonal of the lateral surface must not be made to cut deeper into it.
        if common == 0 || (self.lateral.is_some() && common & SIDE != 0) {
            return false;
        }
        let from = |at: u32, p: u32| [0, 1, 2].each(|i| points[p as usize][i] - points[at as usize][i]);
        let sides = |at: u32| [a, b].each(|p| from(at, p));
        make_more_than_half_a_turn(sides(c), sides(d))
    }
}

/// The grains close to a wall, by cell.
#[derive(Debug)]
struct Close<'a> {
    cells: HashMap<[i64; 3], Vec<Facing<'a>>>,
    per_mm: f64,
}

impl<'a> Close<'a> {
    fn new(model: &'a MeshModel<'_>, division: Division) -> Self {
        let reach = division.edge_mm / EDGE_PER_GAP;
        let mut all = Vec::new();
        // How far along the wall a grain can ask for shorter edges.
        let mut widest = division.edge_mm;
        let bodies = &model.bodies;
        for row in 0..bodies.len() {
            for at_wall in model.walls(row) {
                let gap = at_wall.gap;
                if gap < reach {
                    widest = widest.max(bodies.along(row, gap, reach) + 2.0 * division.edge_mm);
                    let other = bodies.other(row, [0.0; 3]);
                    all.push(Facing { other, at: at_wall.foot, floor_mm: division.floor_mm });
                }
            }
        }
        let mut close = Self { cells: HashMap::new(), per_mm: 1.0 / widest };
        for facing in all {
            close.cells.entry(close.cell(facing.at)).or_default().push(facing);
        }
        close
    }

    fn cell(&self, p: [f64; 3]) -> [i64; 3] {
        p.each(|x| (x * self.per_mm).floor() as i64)
    }

    fn want_shorter(&self, centroid: [f64; 3], longest_mm: f64) -> bool {
        let [x, y, z] = self.cell(centroid);
        let mut cells =
            (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
        cells.any(|cell| {
            let facing = self.cells.get(&cell);
            facing.into_iter().flatten().any(|facing| facing.wants_shorter(centroid, longest_mm, 1.0))
        })
    }
}

/// Smallest distance of a grain from the lateral surface of a cylinder.
fn side_gap_mm(radius: f64, bodies: &Bodies<'_>) -> f64 {
    (0..bodies.len()).map(|row| bodies.side_gap(row, radius)).fold(f64::INFINITY, f64::min)
}

/// How far from the axis the vertices of a lateral surface of `columns` columns lie: such that the polygon has the area
/// of the circle, and no chord comes closer to a grain than half of what lay between.
fn vertex_radius(radius: f64, columns: f64, gap_mm: f64) -> f64 {
    let angle = TAU / columns;
    let of_equal_area = radius * (angle / sin(angle)).sqrt();
    let clear = (radius - (gap_mm / 2.0).max(0.0)) / cos(angle / 2.0);
    of_equal_area.max(clear)
}

type Parts = (Vec<[f64; 3]>, Vec<[u32; 3]>, Vec<u8>);

/// The faces of a box, each a grid of rectangles in four triangles about their middles.
fn cuboid(size: [f64; 3], counts: [usize; 3]) -> Parts {
    let (mut points, mut triangles, mut faces_of) = (Vec::new(), Vec::new(), Vec::new());
    // Places are counted in halves of an edge, so that middles have one too.
    let mut known: HashMap<[usize; 3], u32> = HashMap::new();
    let mut point = |place: [usize; 3]| {
        *known.entry(place).or_insert_with(|| {
            points.push(arrays::from_fn(|a| size[a] * (place[a] as f64 / (2 * counts[a]) as f64)));
            let mut faces = 0;
            for a in 0..3 {
                faces |= u8::from(place[a] == 0) << (2 * a);
                faces |= u8::from(place[a] == 2 * counts[a]) << (2 * a + 1);
            }
            faces_of.push(faces);
            faces_of.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for far in [false, true] {
            for i in 0..counts[u] {
                for j in 0..counts[v] {
                    let mut at = |du: usize, dv: usize| {
                        let mut place = [0; 3];
                        place[axis] = if far { 2 * counts[axis] } else { 0 };
                        (place[u], place[v]) = (2 * i + du, 2 * j + dv);
                        point(place)
                    };
                    let (middle, around) = (at(1, 1), [at(0, 0), at(2, 0), at(2, 2), at(0, 2)]);
                    for k in 0..4 {
                        let (a, b) = (around[k], around[(k + 1) % 4]);
                        triangles.push(if far { [a, b, middle] } else { [b, a, middle] });
                    }
                }
            }
        }
    }
    (points, triangles, faces_of)
}

/// The faces of a cylinder: rings of triangles about the middle of each end, rectangles in four triangles on
/// the lateral surface.
fn cylinder(axis: [f64; 2], radius: f64, height: f64, rings: usize, rows: usize) -> Parts {
    let (mut points, mut triangles, mut faces_of) = (Vec::new(), Vec::new(), Vec::new());
    let columns = 6 * rings;
    let mut point = |from_axis: f64, turn: f64, z: f64, faces: u8| {
        let (sin, cos) = sin_cos(TAU * turn);
        points.push([axis[0] + from_axis * cos, axis[1] + from_axis * sin, z]);
        faces_of.push(faces);
        faces_of.len() as u32 - 1
    };
    // Vertices of the lateral surface, row by row; the first and the last are the end circles.
    let mut grid: Vec<Vec<u32>> = Vec::new();
    for row in 0..=rows {
        let faces = SIDE | if row == 0 { BOTTOM } else { 0 } | if row == rows { TOP } else { 0 };
        let z = height * (row as f64 / rows as f64);
        grid.push((0..columns).map(|k| point(radius, k as f64 / columns as f64, z, faces)).collect());
    }
    for row in 0..rows {
        let z = height * ((row as f64 + 0.5) / rows as f64);
        for k in 0..columns {
            let middle = point(radius, (k as f64 + 0.5) / columns as f64, z, SIDE);
            let next = (k + 1) % columns;
            let around = [grid[row][k], grid[row][next], grid[row + 1][next], grid[row + 1][k]];
            for edge in 0..4 {
                triangles.push([around[edge], around[(edge + 1) % 4], middle]);
            }
        }
    }
    for (circle, z, faces) in [(&grid[0], 0.0, BOTTOM), (&grid[rows], height, TOP)] {
        let mut inner = vec![point(0.0, 0.0, z, faces)];
        for ring in 1..=rings {
            let around = 6 * ring;
            let outer: Vec<u32> = if ring == rings {
                circle.clone()
            } else {
                let from_axis = radius * (ring as f64 / rings as f64);
                (0..around).map(|k| point(from_axis, k as f64 / around as f64, z, faces)).collect()
            };
            let mut add = |a: u32, b: u32, c: u32| {
                triangles.push(if faces == TOP { [a, b, c] } else { [b, a, c] });
            };
            for sextant in 0..6 {
                let from = |k: usize| inner[(sextant * (ring - 1) + k) % inner.len()];
                let to = |k: usize| outer[(sextant * ring + k) % around];
                for k in 0..ring {
                    add(to(k), to(k + 1), from(k));
                }
                for k in 0..ring - 1 {
                    add(from(k), to(k + 1), from(k + 1));
                }
            }
            inner = outer;
        }
    }
    (points, triangles, faces_of)
}
