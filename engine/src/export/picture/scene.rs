//! The solid that is seen, the grains in it, and the rays through both.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::arrays::{self, Each as _};
use crate::domain::{Domain, Lateral};
use crate::elementary::{atan2, cbrt, cos, hypot, sin};
use crate::export::Model;
use crate::geometry::images::Images;
use crate::grain::{Grain as _, PlacedGrain, PlacedGrains};
use crate::memory::{OutOfMemory, reserved};
use crate::request::Specimen;

/// Points and directions, in mm.
pub(super) type Vector = Vector3<f64>;

/// From the specimen towards the eye; not normalised.
const TOWARDS_EYE: [f64; 3] = [1.0, -1.16, 0.86];
/// Share of the mean free path over which the matrix lets a share 1/e of the light through.
const FADE_PER_FREE_PATH: f64 = 0.55;
/// Cells of the grid per grain, about.
const CELLS_PER_GRAIN: f64 = 1.5;
/// Distance in edges of a cell within which grains shade each other.
const SHADE_PER_EDGE: f64 = 0.7;
/// Most cells along one axis.
const MOST_CELLS: f64 = 512.0;

/// The parallel projection and the pixels.
pub(super) struct View {
    /// Unit vectors of the picture: to the right, upwards, towards the eye.
    pub(super) right: Vector,
    pub(super) up: Vector,
    pub(super) eye: Vector,
    /// Lower left corner of the picture, in mm along `right` and `up`.
    low: [f64; 2],
    pub(super) pixels: [u32; 2],
    pub(super) pixels_per_mm: f64,
}

/// The unit vectors of the picture.
fn axes() -> [Vector; 3] {
    let eye = Vector::from(TOWARDS_EYE).normalize();
    let right = Vector::z().cross(&eye).normalize();
    [right, eye.cross(&right), eye]
}

impl View {
    /// The view in which the specimen fills the picture.
    pub(super) fn framing(specimen: &Specimen, pixels_long: u32) -> Self {
        let [right, up, eye] = axes();
        let size = Vector::from(specimen.bounds_mm());
        let middle = size / 2.0;
        let is_round = specimen.domain().lateral().is_some();
        let half: [f64; 2] = [right, up].each(|axis| {
            if is_round {
                middle.x * hypot(axis.x, axis.y) + middle.z * axis.z.abs()
            } else {
                axis.abs().dot(&middle)
            }
        });
        // Room for half the stroke of the edges.
        let margin = f64::from(pixels_long) / 400.0;
        let pixels_per_mm = (f64::from(pixels_long) - 2.0 * margin) / (2.0 * half[0].max(half[1]));
        let pixels = half.each(|half| (2.0 * (half * pixels_per_mm + margin)).ceil().max(1.0) as u32);
        let center = [right.dot(&middle), up.dot(&middle)];
        let low = [0, 1].each(|i| center[i] - f64::from(pixels[i]) / 2.0 / pixels_per_mm);
        Self { right, up, eye, low, pixels, pixels_per_mm }
    }

    /// Pixels per unit of stroke: strokes grow with the picture.
    pub(super) fn stroke(&self) -> f64 {
        f64::from(self.pixels[0].max(self.pixels[1])) / 1600.0
    }

    /// Position of a point in pixels from the upper left corner.
    pub(super) fn project(&self, p: &Vector) -> [f64; 2] {
        let x = (self.right.dot(p) - self.low[0]) * self.pixels_per_mm;
        let y = (self.up.dot(p) - self.low[1]) * self.pixels_per_mm;
        [x, f64::from(self.pixels[1]) - y]
    }

    /// Positions of many points.
    pub(super) fn projected(&self, points: &[Vector]) -> Vec<[f64; 2]> {
        points.iter().map(|p| self.project(p)).collect()
    }

    /// The point of the plane through the origin that stands at a position of the picture.
    pub(super) fn unproject(&self, [x, y]: [f64; 2]) -> Vector {
        let u = self.low[0] + x / self.pixels_per_mm;
        let v = self.low[1] + (f64::from(self.pixels[1]) - y) / self.pixels_per_mm;
        self.right * u + self.up * v
    }
}

/// A grain, or the periodic image of one.
#[derive(Clone, Copy)]
pub(super) struct Grain<'a> {
    pub(super) center: Vector,
    /// Radius of the sphere of equal volume.
    pub(super) radius: f64,
    placed: PlacedGrain<'a>,
    /// The number of the grain, the same for its images.
    pub(super) number: u32,
}

impl Grain<'_> {
    /// Whether a point lies inside.
    fn contains(&self, p: &Vector) -> bool {
        self.placed.contains(&(p - self.center))
    }

    /// Outward normal at a point of the surface.
    pub(super) fn normal(&self, at: &Vector) -> Vector {
        self.placed.normal(&(at - self.center))
    }

    /// Distance along a ray to where it enters the grain.
    fn entry(&self, from: &Vector, direction: &Vector) -> Option<f64> {
        self.placed.chord_mm(&(from - self.center), direction).map(|[enter, _]| enter)
    }

    /// Distance in mm from a point inside to the edge of the section by the plane through it with a unit normal.
    pub(super) fn edge_distance(&self, at: &Vector, normal: &Vector) -> f64 {
        self.placed.to_outline_mm(&(at - self.center), normal)
    }
}

/// What a ray meets first.
#[derive(Clone, Copy)]
pub(super) enum Hit {
    /// Nothing.
    Background,
    /// The outer surface, behind which no grain is near enough to be seen.
    Deep { at: Vector },
    /// A grain behind the surface, at a depth in mm.
    Grain { grain: u32, at: Vector, depth: f64 },
    /// A plane of the cut: `axis` is its normal, `grain` what is cut there.
    Cut { axis: usize, at: Vector, grain: Option<u32> },
    /// A face of a periodic box, which cuts a grain.
    Face { axis: usize, at: Vector, grain: u32 },
}

impl Hit {
    /// Equal for hits of one smooth surface: pixels between different ones are contours.
    pub(super) fn surface(&self) -> u32 {
        match *self {
            Self::Background => u32::MAX,
            Self::Deep { .. } => u32::MAX - 1,
            Self::Cut { axis, grain: None, .. } => u32::MAX - 2 - axis as u32,
            Self::Cut { axis, grain: Some(grain), .. } => 8 * grain + 1 + axis as u32,
            Self::Face { axis, grain, .. } => 8 * grain + 4 + axis as u32,
            Self::Grain { grain, .. } => 8 * grain,
        }
    }
}

/// The specimen without the octant next to the eye, and its grains.
pub(super) struct Scene<'a> {
    domain: Domain,
    size: Vector,
    grid: SceneGrid<'a>,
    /// Smallest and largest diameter.
    pub(super) diameters: [f64; 2],
    /// Depth at which the matrix lets a share 1/e of the light through, in mm.
    pub(super) fade: f64,
    eye: Vector,
}

impl<'a> Scene<'a> {
    pub(super) fn new(model: &Model<'_>, placed: &'a PlacedGrains<'a>) -> Result<Self, OutOfMemory> {
        let size = Vector::from(model.specimen.bounds_mm());
        let grains = with_images(model, placed)?;
        let sections: f64 = model.grains.diameters_mm().map(|d| PI / 4.0 * d * d).sum();
        let diameters = model
            .grains
            .diameters_mm()
            .fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], d| [low.min(d), high.max(d)]);
        let fade = FADE_PER_FREE_PATH * (model.specimen.volume_mm3() / sections).min(size.norm());
        let domain = model.specimen.domain();
        Ok(Self { domain, size, grid: SceneGrid::new(grains, size), diameters, fade, eye: axes()[2] })
    }

    /// Number of grains, images included.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.grid.grains.len()
    }

    pub(super) fn grain(&self, grain: u32) -> &Grain<'a> {
        &self.grid.grains[grain as usize]
    }

    /// The octant next to the eye: x and z above the middle, y below it.
    fn is_cut_away(&self, p: &Vector) -> bool {
        p.x > self.size.x / 2.0 && p.y < self.size.y / 2.0 && p.z > self.size.z / 2.0
    }

    /// Distance in mm from a point of a cut plane to the nearest of the other two planes of the cut.
    pub(super) fn to_corner(&self, axis: usize, p: &Vector) -> f64 {
        (0..3).filter(|&a| a != axis).map(|a| (p[a] - self.size[a] / 2.0).abs()).fold(f64::INFINITY, f64::min)
    }

    /// What the ray through a point, parallel to the view, meets first.
    pub(super) fn trace(&self, through: Vector) -> Hit {
        let direction = -self.eye;
        let Some((enter, leave, face)) = self.crossing(&through, &direction) else { return Hit::Background };
        let at = through + direction * enter;
        // A little inside: on the surface itself the comparison would round either way.
        let inside = through + direction * (enter + 1e-9 * self.size.norm());
        if self.is_cut_away(&inside) {
            let to_plane = |a: usize| (self.size[a] / 2.0 - at[a]) / direction[a];
            let (axis, t) = (0..3)
                .map(|a| (a, to_plane(a)))
                .fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best });
            let at = at + direction * t;
            return Hit::Cut { axis, at, grain: self.grid.around(&at) };
        }
        if let (true, Some(axis)) = (self.domain.is_periodic(), face)
            && let Some(grain) = self.grid.around(&at)
        {
            return Hit::Face { axis, at, grain };
        }
        let farthest = (leave - enter).min(4.0 * self.fade);
        match self.grid.first(&at, &direction, farthest) {
            Some((grain, depth)) => Hit::Grain { grain, at: at + direction * depth, depth },
            None => Hit::Deep { at },
        }
    }

    /// Where a line enters and leaves the specimen, and the axis of the face by which it enters, if that is plane.
    fn crossing(&self, from: &Vector, direction: &Vector) -> Option<(f64, f64, Option<usize>)> {
        let (mut enter, mut leave, mut face) = (f64::NEG_INFINITY, f64::INFINITY, None);
        let lateral = self.domain.lateral();
        for a in if lateral.is_some() { 2..3 } else { 0..3 } {
            let (low, high) = (-from[a] / direction[a], (self.size[a] - from[a]) / direction[a]);
            if low.min(high) > enter {
                (enter, face) = (low.min(high), Some(a));
            }
            leave = leave.min(low.max(high));
        }
        if let Some(Lateral { center_mm, radius_mm: radius }) = lateral {
            let (x, y) = (from.x - center_mm[0], from.y - center_mm[1]);
            let a = direction.x * direction.x + direction.y * direction.y;
            let b = x * direction.x + y * direction.y;
            let root = b * b - a * (x * x + y * y - radius * radius);
            if root <= 0.0 {
                return None;
            }
            let root = root.sqrt();
            if (-b - root) / a > enter {
                (enter, face) = ((-b - root) / a, None);
            }
            leave = leave.min((-b + root) / a);
        }
        (enter < leave).then_some((enter, leave, face))
    }

    /// Outward normal of the outer surface.
    pub(super) fn normal(&self, p: &Vector) -> Vector {
        let margin = 1e-6 * self.size.norm();
        if self.size.z - p.z < margin {
            return Vector::z();
        }
        if let Some(Lateral { center_mm: [x, y], .. }) = self.domain.lateral() {
            return Vector::new(p.x - x, p.y - y, 0.0).normalize();
        }
        if self.size.x - p.x < margin { Vector::x() } else { -Vector::y() }
    }

    /// Share of the sky above a surface that grains nearby cover, 0..=1: the sum of their solid angles over a
    /// half-space, `(r / d)^2` times the cosine at their centres, each faded out with the gap to the point.
    pub(super) fn occlusion(&self, at: &Vector, normal: &Vector, but: u32) -> f64 {
        let grid = &self.grid;
        let mut covered = 0.0;
        for &i in grid.nearby.of(grid.index(grid.cell_of(at))) {
            let grain = &grid.grains[i as usize];
            let to = grain.center - at;
            let distance = to.norm();
            let faded = 1.0 - (distance - grain.radius) / grid.shade;
            if grain.number != but && faded > 0.0 {
                // What reaches below the horizon counts by its part above.
                let ratio = (grain.radius / distance).min(1.0);
                let above = (normal.dot(&to) / distance + 0.35 * ratio).max(0.0);
                covered += above * ratio * ratio * faded.min(1.0).powi(2);
            }
        }
        covered.min(1.0)
    }
}

/// The grains, with those images of a periodic box that reach into it.
fn with_images<'a>(model: &Model<'_>, placed: &'a PlacedGrains<'a>) -> Result<Vec<Grain<'a>>, OutOfMemory> {
    let images = Images::new(model.specimen);
    let mut grains = reserved(placed.len())?;
    for number in 0..placed.len() {
        let (grain, radius) = (placed.grain(number), placed.d_mm(number) / 2.0);
        let center = placed.center_mm(number);
        for image in images.meeting_box(center, grain.half_extents_mm()) {
            let center = Vector::from(center) + image.offset_mm;
            grains.push(Grain { center, radius, placed: grain, number: number as u32 });
        }
    }
    Ok(grains)
}

/// Grains by cell.
#[derive(Default)]
struct Lists {
    /// Where the list of each cell starts in `listed`, and the end of the last.
    starts: Vec<u32>,
    listed: Vec<u32>,
}

impl Lists {
    fn of(&self, cell: usize) -> &[u32] {
        &self.listed[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// A uniform grid.
struct SceneGrid<'a> {
    grains: Vec<Grain<'a>>,
    cells: [usize; 3],
    edge: Vector,
    /// Grains that reach into each cell.
    inside: Lists,
    /// Grains no further than `shade` from each cell.
    nearby: Lists,
    /// Distance in mm within which grains shade each other.
    shade: f64,
}

impl<'a> SceneGrid<'a> {
    fn new(grains: Vec<Grain<'a>>, size: Vector) -> Self {
        let wanted = cbrt(size.x * size.y * size.z / (CELLS_PER_GRAIN * grains.len().max(1) as f64));
        let cells: [usize; 3] =
            arrays::from_fn(|a| (size[a] / wanted).round().clamp(1.0, MOST_CELLS) as usize);
        let edge = Vector::from_fn(|a, _| size[a] / cells[a] as f64);
        let (inside, nearby) = (Lists::default(), Lists::default());
        let mut grid = Self { grains, cells, edge, inside, nearby, shade: SHADE_PER_EDGE * edge.min() };
        grid.inside = grid.lists(0.0);
        grid.nearby = grid.lists(grid.shade);
        grid
    }

    /// The grains no further than `reach` from each cell.
    fn lists(&self, reach: f64) -> Lists {
        let mut starts = vec![0_u32; self.cells.iter().product::<usize>() + 1];
        for grain in &self.grains {
            self.touched(grain, reach, |cell| starts[cell + 1] += 1);
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut listed = vec![0; starts.last().copied().unwrap_or(0) as usize];
        let mut next = starts.clone();
        for (i, grain) in self.grains.iter().enumerate() {
            self.touched(grain, reach, |cell| {
                listed[next[cell] as usize] = i as u32;
                next[cell] += 1;
            });
        }
        Lists { starts, listed }
    }

    /// Calls back for each cell that a grain comes as near to as `reach`.
    fn touched(&self, grain: &Grain<'_>, reach: f64, mut each: impl FnMut(usize)) {
        // A margin, because a ray may round into the next cell.
        let radius = (grain.placed.outer_radius_mm() + reach) * (1.0 + 1e-9);
        let [x, y, z] = std::array::from_fn(|a| {
            self.coordinate(a, grain.center[a] - radius)..=self.coordinate(a, grain.center[a] + radius)
        });
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let low = Vector::new(i as f64, j as f64, k as f64).component_mul(&self.edge);
                    let nearest = grain.center.zip_zip_map(&low, &self.edge, |c, l, e| c.clamp(l, l + e));
                    if (nearest - grain.center).norm() <= radius {
                        each(self.index([i, j, k]));
                    }
                }
            }
        }
    }

    fn coordinate(&self, axis: usize, at: f64) -> usize {
        (at / self.edge[axis]).clamp(0.0, (self.cells[axis] - 1) as f64) as usize
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.cells[1] + j) * self.cells[0] + i
    }

    fn cell_of(&self, p: &Vector) -> [usize; 3] {
        arrays::from_fn(|a| self.coordinate(a, p[a]))
    }

    /// The grain around a point.
    fn around(&self, p: &Vector) -> Option<u32> {
        let list = self.inside.of(self.index(self.cell_of(p)));
        list.iter().copied().find(|&i| self.grains[i as usize].contains(p))
    }

    /// The first grain that a ray from a point inside the specimen meets within a distance.
    fn first(&self, from: &Vector, direction: &Vector, farthest: f64) -> Option<(u32, f64)> {
        let mut cell = self.cell_of(from);
        let step = direction.map(f64::signum);
        let next_wall = |cell: usize, a: usize| {
            let wall = (cell as f64 + f64::from(step[a] > 0.0)) * self.edge[a];
            if direction[a] == 0.0 { f64::INFINITY } else { (wall - from[a]) / direction[a] }
        };
        let mut leaves: [f64; 3] = arrays::from_fn(|a| next_wall(cell[a], a));
        let mut best: Option<(u32, f64)> = None;
        loop {
            for &i in self.inside.of(self.index(cell)) {
                if let Some(t) = self.grains[i as usize].entry(from, direction)
                    && t >= 0.0
                    && best.is_none_or(|(_, nearest)| t < nearest)
                {
                    best = Some((i, t));
                }
            }
            let axis = if leaves[0] <= leaves[1] && leaves[0] <= leaves[2] {
                0
            } else if leaves[1] <= leaves[2] {
                1
            } else {
                2
            };
            let end = leaves[axis];
            if best.is_some_and(|(_, t)| t <= end) || end > farthest {
                return best.filter(|&(_, t)| t <= farthest);
            }
            let moved = cell[axis] as f64 + step[axis];
            if moved < 0.0 || moved >= self.cells[axis] as f64 {
                return best.filter(|&(_, t)| t <= farthest);
            }
            cell[axis] = moved as usize;
            leaves[axis] = next_wall(cell[axis], axis);
        }
    }
}

/// Points of a circle of a cylinder, between two angles in turns of 45 degrees.
pub(super) fn arc(specimen: &Specimen, z: f64, from: f64, to: f64) -> Vec<Vector> {
    let [diameter, ..] = specimen.bounds_mm();
    let radius = diameter / 2.0;
    let points = 96;
    (0..=points)
        .map(|i| {
            let angle = PI / 4.0 * (from + (to - from) * f64::from(i) / f64::from(points));
            Vector::new(radius + radius * cos(angle), radius + radius * sin(angle), z)
        })
        .collect()
}

/// The azimuth of the eye, in turns of 45 degrees.
pub(super) fn azimuth_of_eye() -> f64 {
    atan2(TOWARDS_EYE[1], TOWARDS_EYE[0]) / (PI / 4.0)
}
