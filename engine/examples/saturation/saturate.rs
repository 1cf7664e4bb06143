//! Random sequential addition of equal solids in a periodic cube until no pose is left, which is proven.
//!
//! Poses, a centre and an orientation, are divided into cells: a cube of centres times a cube of Rodrigues vectors. No
//! point of a solid moves by more than `b` between the pose in the middle of a cell and any other of it. Where the
//! solid in the middle overlaps a grain by more than `b`, every pose of the cell does, and the cell goes. Attempts are
//! drawn from the cells that are left, which leaves the distribution of the grains as it is. When many have failed,
//! cells are divided and looked at again. Where none is left the packing is saturated. Haiduk, Kubala and Ciesla (2018,
//! DOI 10.1103/PhysRevE.98.063309) divide poses in the plane in this way.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use packstone_engine::shape::Pose;
use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::solid::{Placed, Solid};

/// What a cell may still let the solid move, at first and over that of the step before.
const FIRST_FINENESS: f64 = 1.0;
const FINER: f64 = 0.8;
/// Attempts in vain after which cells are divided: per cell, and at least.
const ATTEMPTS_PER_CELL: u64 = 2;
const LEAST_ATTEMPTS: u64 = 100_000;
/// About the edge of the cubes that have a list of the grains near them.
const LIST_EDGE: f64 = 0.4;

/// A set of poses. Its middle is in units of the edge of the box, and of half the edge of the zone of orientations; its
/// half edges are 1/2 to the power of the levels, in the same units.
#[derive(Clone, Copy)]
struct Cell {
    center: [f32; 3],
    rodrigues: [f32; 3],
    center_level: u8,
    rodrigues_level: u8,
}

/// A cell in lengths and Rodrigues vectors.
struct Extent {
    center: Vector3<f64>,
    half_edge: f64,
    rodrigues: Vector3<f64>,
    rodrigues_half_edge: f64,
}

/// A grain, or its periodic image, near a place.
struct Near {
    distance: f64,
    grain: usize,
    moved: Vector3<f64>,
}

/// A packing on its way to saturation.
pub(crate) struct Saturation<'a> {
    solid: &'a Solid,
    edge: f64,
    pub(crate) grains: Vec<Placed>,
    /// By cube of the lists, nearest first.
    near: Vec<Vec<Near>>,
    lists_per_edge: usize,
    cells: Vec<Cell>,
    fineness: f64,
    body: Placed,
}

impl<'a> Saturation<'a> {
    /// A cube of an edge of at least the diameter of the solid, with grains that do not overlap.
    pub(crate) fn new(solid: &'a Solid, edge: f64, grains: &[Pose]) -> Self {
        assert!(edge >= 2.0 * solid.outer, "a grain would meet itself: the edge is {edge}");
        let lists_per_edge = (edge / LIST_EDGE).ceil() as usize;
        let mut saturation = Self {
            solid,
            edge,
            grains: Vec::new(),
            near: (0..lists_per_edge.pow(3)).map(|_| Vec::new()).collect(),
            lists_per_edge,
            cells: vec![Cell { center: [0.5; 3], rodrigues: [0.0; 3], center_level: 1, rodrigues_level: 0 }],
            fineness: FIRST_FINENESS,
            body: solid.placed(Vector3::zeros(), UnitQuaternion::identity()),
        };
        for pose in grains {
            saturation.insert(solid.placed(pose.center_mm, pose.orientation));
        }
        saturation.divide();
        saturation
    }

    pub(crate) fn fraction(&self) -> f64 {
        self.grains.len() as f64 / self.edge.powi(3)
    }

    /// The number of cells that are left; 0 of a saturated packing.
    pub(crate) fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Adds grains until many attempts have failed, and divides the cells.
    pub(crate) fn step(&mut self, rng: &mut Xoshiro256PlusPlus) {
        let Some(least_level) = self.cells.iter().map(level).min() else { return };
        let most = LEAST_ATTEMPTS.max(ATTEMPTS_PER_CELL * self.cells.len() as u64);
        let mut failed = 0;
        while failed < most {
            failed += 1;
            let cell = self.cells[(uniform(rng) * self.cells.len() as f64) as usize];
            // Cells count by their volume.
            if uniform(rng) > 0.125_f64.powi(level(&cell) - least_level) {
                continue;
            }
            let extent = self.extent(&cell);
            let mut within = |half: f64| Vector3::from_fn(|_, _| (2.0 * uniform(rng) - 1.0) * half);
            let center = extent.center + within(extent.half_edge);
            let rodrigues = extent.rodrigues + within(extent.rodrigues_half_edge);
            // Uniform orientations have this density of Rodrigues vectors.
            let density = (1.0 + rodrigues.norm_squared()).powi(-2);
            if uniform(rng) > density || !self.solid.is_in_zone(&rodrigues, 0.0) {
                continue;
            }
            self.solid.place(&mut self.body, center, orientation(&rodrigues));
            if self.fits() {
                self.insert(self.body.clone());
                failed = 0;
            }
        }
        self.refine();
    }

    /// Divides the cells once more.
    pub(crate) fn refine(&mut self) {
        self.fineness *= FINER;
        self.divide();
    }

    /// Whether a pose lies in one of the cells that are left.
    #[cfg(test)]
    pub(crate) fn is_left(&self, pose: &Pose) -> bool {
        let lies_within = |p: &Vector3<f64>, middle: &Vector3<f64>, half: f64| {
            (p - middle).iter().all(|x| x.abs() <= half * (1.0 + 1e-6))
        };
        self.solid.equal_orientations(&pose.orientation).any(|q| {
            let rodrigues = q.imag() / q.w;
            self.cells.iter().map(|cell| self.extent(cell)).any(|extent| {
                lies_within(&pose.center_mm, &extent.center, extent.half_edge)
                    && lies_within(&rodrigues, &extent.rodrigues, extent.rodrigues_half_edge)
            })
        })
    }

    fn insert(&mut self, grain: Placed) {
        let (n, index) = (self.lists_per_edge, self.grains.len());
        let list_edge = self.edge / n as f64;
        let range = 2.0 * self.solid.outer + list_edge * 3.0_f64.sqrt() / 2.0;
        for (at, list) in self.near.iter_mut().enumerate() {
            let middle = [at % n, at / n % n, at / (n * n)].map(|i| (i as f64 + 0.5) * list_edge);
            for image in 0..27_i32 {
                let periods = [image % 3 - 1, image / 3 % 3 - 1, image / 9 - 1].map(f64::from);
                let moved = Vector3::from(periods) * self.edge;
                let distance = (grain.center + moved - Vector3::from(middle)).norm();
                if distance < range {
                    let place = list.partition_point(|near| near.distance <= distance);
                    list.insert(place, Near { distance, grain: index, moved });
                }
            }
        }
        self.grains.push(grain);
    }

    fn near(&self, center: &Vector3<f64>) -> &[Near] {
        let n = self.lists_per_edge;
        let [x, y, z] = [0, 1, 2].map(|axis| ((center[axis] / self.edge * n as f64) as usize).min(n - 1));
        &self.near[x + n * (y + n * z)]
    }

    /// Whether the body overlaps no grain.
    fn fits(&self) -> bool {
        let reach = (2.0 * self.solid.outer).powi(2);
        self.near(&self.body.center).iter().all(|near| {
            let grain = &self.grains[near.grain];
            let apart = (grain.center + near.moved - self.body.center).norm_squared();
            apart >= reach || self.body.keeps(0.0, grain, &near.moved)
        })
    }

    /// Whether the body overlaps some grain by more than a length.
    fn overlaps_by(&self, least: f64) -> bool {
        let within = (2.0 * self.solid.inner - least).max(0.0).powi(2);
        let reach = (2.0 * self.solid.outer - least).max(0.0).powi(2);
        let distance =
            |near: &Near| (self.grains[near.grain].center + near.moved - self.body.center).norm_squared();
        let near = self.near(&self.body.center);
        near.iter().any(|near| distance(near) < within)
            || near.iter().any(|near| {
                let grain = &self.grains[near.grain];
                distance(near) < reach && !self.body.keeps(-least, grain, &near.moved)
            })
    }

    fn extent(&self, cell: &Cell) -> Extent {
        Extent {
            center: Vector3::from(cell.center.map(f64::from)) * self.edge,
            half_edge: self.edge * 0.5_f64.powi(i32::from(cell.center_level)),
            rodrigues: Vector3::from(cell.rodrigues.map(f64::from)) * self.solid.zone,
            rodrigues_half_edge: self.solid.zone * 0.5_f64.powi(i32::from(cell.rodrigues_level)),
        }
    }

    /// Divides the cells until no point moves by more than the fineness in what is left of each.
    fn divide(&mut self) {
        let cells = std::mem::take(&mut self.cells);
        let mut left = Vec::new();
        for cell in cells {
            self.divide_cell(cell, &mut left);
        }
        self.cells = left;
    }

    fn divide_cell(&mut self, cell: Cell, left: &mut Vec<Cell>) {
        let extent = self.extent(&cell);
        if !self.solid.is_in_zone(&extent.rodrigues, extent.rodrigues_half_edge) {
            return;
        }
        let middle = orientation(&extent.rodrigues);
        let [by_center, by_rotation] =
            moves(extent.half_edge, &extent.rodrigues, extent.rodrigues_half_edge, self.solid.outer);
        let moves = by_center + by_rotation;
        if moves < self.solid.inner + self.solid.outer {
            self.solid.place(&mut self.body, extent.center, middle);
            if self.overlaps_by(moves) {
                return;
            }
        }
        if moves <= self.fineness {
            left.push(cell);
            return;
        }
        for part in 0..8_u32 {
            let mut smaller = cell;
            let (middle, level) = if by_center > by_rotation {
                (&mut smaller.center, &mut smaller.center_level)
            } else {
                (&mut smaller.rodrigues, &mut smaller.rodrigues_level)
            };
            *level += 1;
            let step = 0.5_f32.powi(i32::from(*level));
            for (axis, x) in middle.iter_mut().enumerate() {
                *x += if part >> axis & 1 == 1 { step } else { -step };
            }
            self.divide_cell(smaller, left);
        }
    }
}

/// How far a point of a solid may move at most between the middle of a cell and another pose: by the centre, and by the
/// rotation of points as far from the centre as `outer`.
///
/// That is half the diagonal of the cube, and the chord of the largest rotation. A rotation is largest in a corner of
/// the cube: rotations up to an angle are a convex set of Rodrigues vectors, as they are the section of a cone with a
/// plane.
pub(crate) fn moves(
    half_edge: f64,
    rodrigues: &Vector3<f64>,
    rodrigues_half_edge: f64,
    outer: f64,
) -> [f64; 2] {
    let middle = orientation(rodrigues);
    let cosine = |corner: u32| {
        let sign = |axis: u32| f64::from(2 * (corner >> axis & 1)) - 1.0;
        let at = rodrigues + Vector3::new(sign(0), sign(1), sign(2)) * rodrigues_half_edge;
        orientation(&at).dot(&middle).abs()
    };
    let least_cosine = (0..8).map(cosine).fold(1.0, f64::min);
    let half_chord = (1.0 - least_cosine * least_cosine).max(0.0).sqrt();
    [3.0_f64.sqrt() * half_edge, 2.0 * half_chord * outer]
}

fn level(cell: &Cell) -> i32 {
    i32::from(cell.center_level) + i32::from(cell.rodrigues_level)
}

pub(crate) fn orientation(rodrigues: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::from_parts(1.0, *rodrigues))
}

/// A number from 0 to 1, without 1.
fn uniform(rng: &mut Xoshiro256PlusPlus) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}
