//! The voxels of a packing for homogenization: phases, and shares and normals where a surface cuts a voxel.
//!
//! Shares of spheres, ellipsoids and sharp polyhedra are exact ([`cut_ellipsoid`](super::cut_ellipsoid),
//! [`cut_polyhedron`](super::cut_polyhedron)), and normals are along the area vector of the surface in the voxel.
//! Shares of rounded polyhedra are measured along lines, each of which the surface cuts exactly, and their normals are
//! those of the surface near the centre of the voxel. A voxel with more than two phases has the two of the largest
//! shares.

use nalgebra::{Matrix3, Vector3};

use super::cut_ellipsoid::CutEllipsoid;
use super::cut_polyhedron::{Cutter, Pieces, Range, shares};
use crate::control::Control;
use crate::export::steps::Steps;
use crate::export::voxels::VoxelGrid;
use crate::export::{ExportError, Model, go_on};
use crate::geometry::images::Images;
use crate::grain::{FlatFaces, Grain as _, PlacedGrains, RowLines, Surface};
use crate::homogenization::{CUT, CutVoxel, Voxels};
use crate::memory::{OutOfMemory, filled, make_room, reserved};
use crate::threads::share;

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Lines along each edge of a voxel that shares of rounded polyhedra are measured along.
const LINES: usize = 8;
/// A single surface that cuts a share off a voxel has at least about this area vector, in faces of the voxel, over the
/// power 2/3 of the share.
const LEAST_AREA: f64 = 0.01;
/// Shares below this are nothing.
const LEAST_SHARE: f64 = 1e-9;
/// The phase of the matrix.
const MATRIX: u8 = 0;

/// What becomes of voxels that a surface cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cuts {
    /// They have two phases.
    Mixed,
    /// They have the phase of their centre.
    Labels,
}

/// The voxels of a packing.
pub(super) struct Voxelized {
    pub(super) voxels: Voxels,
    /// Cut voxels of more than two bodies, the matrix among them.
    pub(super) of_three_bodies: u64,
}

/// A grain, or the image of one.
struct Body {
    grain: usize,
    center: [f64; 3],
    half: [f64; 3],
    phase: u8,
}

/// A part of a voxel that a grain fills.
struct Entry {
    /// Number in the layer.
    voxel: u32,
    phase: u8,
    share: f64,
    normal: Vector3<f64>,
}

/// A layer of voxels across z.
struct Plane<'p> {
    labels: &'p mut [u8],
    cuts: Vec<CutVoxel>,
    of_rows: Vec<u32>,
    of_three_bodies: u64,
    refused: Option<OutOfMemory>,
}

/// Makes the voxels. `phase` is that of a grain, counted from 1: 0 is the matrix.
///
/// # Errors
/// [`ExportError::Stopped`] and [`ExportError::OutOfMemory`].
pub(super) fn voxelize(
    model: &Model<'_>,
    grains: &PlacedGrains<'_>,
    grid: &VoxelGrid,
    cuts: Cuts,
    phase: impl Fn(usize) -> u8,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Voxelized, ExportError> {
    let [nx, ny, nz] = grid.shape;
    let images = Images::new(model.specimen);
    let mut bodies: Vec<Body> = reserved(grains.len())?;
    for grain in 0..grains.len() {
        let (center, half) = (grains.center_mm(grain), grains.grain(grain).half_extents_mm());
        for image in images.meeting_box(center, half) {
            let center = [0, 1, 2].map(|axis| center[axis] + image.offset_mm[axis]);
            make_room(&mut bodies, 1)?;
            bodies.push(Body { grain, center, half, phase: phase(grain) });
        }
    }
    let mut labels = filled(nx * ny * nz, MATRIX)?;
    let mut planes: Vec<Plane<'_>> = labels
        .chunks_exact_mut(nx * ny)
        .map(|labels| Plane {
            labels,
            cuts: Vec::new(),
            of_rows: Vec::new(),
            of_three_bodies: 0,
            refused: None,
        })
        .collect();
    let work = Work { grains, grid, bodies: &bodies };
    let steps = Steps { control, total: nz, unit: "layers", message: "making voxels" };
    let done = AtomicUsize::new(0);
    share(threads, &mut planes, |k, plane| {
        if !control.should_stop() {
            match cuts {
                Cuts::Labels => work.label(k, plane),
                Cuts::Mixed => work.cut(k, plane),
            }
            steps.report(done.fetch_add(1, Ordering::Relaxed) + 1);
        }
    });
    go_on(control)?;
    let all_cuts = planes.iter().map(|plane| plane.cuts.len()).sum();
    let (mut cuts, mut of_rows) = (reserved(all_cuts)?, reserved(ny * nz)?);
    let mut of_three_bodies = 0;
    for plane in planes {
        if let Some(refused) = plane.refused {
            return Err(refused.into());
        }
        cuts.extend(plane.cuts);
        of_rows.extend(plane.of_rows);
        of_three_bodies += plane.of_three_bodies;
    }
    let voxels = Voxels::new(grid.shape, grid.spacing_mm, labels, cuts, &of_rows)?;
    Ok(Voxelized { voxels, of_three_bodies })
}

struct Work<'a> {
    grains: &'a PlacedGrains<'a>,
    grid: &'a VoxelGrid,
    bodies: &'a [Body],
}

impl Work<'_> {
    /// The bodies that have a point in common with a range of heights.
    fn at(&self, low: f64, high: f64) -> impl Iterator<Item = &Body> {
        self.bodies
            .iter()
            .filter(move |body| body.center[2] - body.half[2] < high && body.center[2] + body.half[2] > low)
    }

    /// The voxels along an axis that a body may reach.
    fn reach(&self, axis: usize, body: &Body) -> std::ops::Range<usize> {
        let (n, h) = (self.grid.shape[axis], self.grid.spacing_mm[axis]);
        let [low, high] = [-1.0, 1.0].map(|side| (body.center[axis] + side * body.half[axis]) / h);
        let from = (low.max(0.0) as usize).min(n);
        from..((high.max(0.0) as usize) + 1).min(n).max(from)
    }

    /// Phases by the centres of the voxels.
    fn label(&self, k: usize, plane: &mut Plane<'_>) {
        let (nx, z) = (self.grid.shape[0], self.grid.center(2, k));
        let mut lines = RowLines::default();
        for body in self.at(z, z) {
            let section = self.grains.rows(body.grain, body.center, z - body.center[2], &mut lines);
            let [low, high] = section.y();
            for j in self.grid.centers_within(1, low, high) {
                let [from, to] = section.x_at(self.grid.center(1, j));
                plane.labels[j * nx..][self.grid.centers_within(0, from, to)].fill(body.phase);
            }
        }
    }

    /// Phases, and shares of voxels that are cut.
    fn cut(&self, k: usize, plane: &mut Plane<'_>) {
        let heights = [self.grid.corner(2, k), self.grid.corner(2, k + 1)];
        let mut entries = Vec::new();
        let (mut lines, mut space) = (RowLines::default(), (Cutter::default(), Vec::new()));
        for body in self.at(heights[0], heights[1]) {
            match self.grains.grain(body.grain).surface() {
                Surface::Quadric(matrix) => self.quadric(&matrix, heights, body, plane, &mut entries),
                Surface::Flat(faces) => self.flat(faces, heights, body, plane, &mut entries, &mut space),
                Surface::Curved => self.along_lines(heights, body, &mut entries, &mut lines),
            }
        }
        // Stable: of bodies in the order of the grains.
        entries.sort_by_key(|entry: &Entry| entry.voxel);
        plane.of_rows = vec![0; self.grid.shape[1]];
        let nx = self.grid.shape[0];
        for of_voxel in entries.chunk_by(|a, b| a.voxel == b.voxel) {
            let voxel = of_voxel[0].voxel as usize;
            if plane.labels[voxel] != MATRIX {
                // A grain fills it.
                continue;
            }
            let (label, cut) = plane.mixed(of_voxel, (voxel % nx) as u16);
            plane.labels[voxel] = label;
            if let Some(cut) = cut {
                plane.of_rows[voxel / nx] += 1;
                crate::memory::push(&mut plane.cuts, cut, &mut plane.refused);
            }
        }
    }

    /// The voxels of a layer that the ellipsoid `p · M p <= 1` about the centre of a body fills or cuts.
    fn quadric(
        &self,
        matrix: &Matrix3<f64>,
        [low, _]: [f64; 2],
        body: &Body,
        plane: &mut Plane<'_>,
        entries: &mut Vec<Entry>,
    ) {
        let Some(cut) = CutEllipsoid::new(matrix, self.grid.spacing_mm) else { return };
        for j in self.reach(1, body) {
            for i in self.reach(0, body) {
                let corner = Vector3::new(self.grid.corner(0, i), self.grid.corner(1, j), low);
                let part = cut.part(&(corner - Vector3::from(body.center)));
                self.take([i, j], body, (part.share, part.area), plane, entries, low);
            }
        }
    }

    /// The voxels of a layer that a body with flat faces fills or cuts.
    fn flat(
        &self,
        faces: FlatFaces<'_>,
        heights: [f64; 2],
        body: &Body,
        plane: &mut Plane<'_>,
        entries: &mut Vec<Entry>,
        (cutter, pieces): &mut (Cutter, Vec<Pieces>),
    ) {
        let (columns, rows) = (self.reach(0, body), self.reach(1, body));
        let range = |axis: usize, of: &std::ops::Range<usize>| Range {
            first: of.start,
            n: of.len(),
            edge_mm: self.grid.spacing_mm[axis],
            origin_mm: -body.center[axis],
        };
        let ranges = [range(0, &columns), range(1, &rows)];
        pieces.clear();
        pieces.resize((columns.len() + 1) * rows.len(), Pieces::NONE);
        for corners in faces.corners_mm() {
            cutter.add(corners, heights.map(|z| z - body.center[2]), ranges, pieces);
        }
        let [dx, dy, dz] = self.grid.spacing_mm;
        let face_mm2 = (dx * dy).max(dy * dz).max(dx * dz);
        for (j, pieces) in rows.zip(pieces.chunks_exact(columns.len() + 1)) {
            for (i, (share, area)) in columns.clone().rev().zip(shares(pieces, self.grid.spacing_mm)) {
                self.take([i, j], body, (share, area / face_mm2), plane, entries, heights[0]);
            }
        }
    }

    /// Takes note of the part of a voxel that a grain fills, with the area vector of its surface there in faces of the
    /// voxel.
    fn take(
        &self,
        [i, j]: [usize; 2],
        body: &Body,
        (share, area): (f64, Vector3<f64>),
        plane: &mut Plane<'_>,
        entries: &mut Vec<Entry>,
        low: f64,
    ) {
        let voxel = j * self.grid.shape[0] + i;
        let rest = share.min(1.0 - share);
        if share <= LEAST_SHARE {
            return;
        }
        if rest < LEAST_SHARE {
            plane.labels[voxel] = body.phase;
        } else if area.norm() > LEAST_AREA * crate::elementary::powf(rest, 2.0 / 3.0) {
            push(entries, voxel, body.phase, share, area);
        } else {
            // Surfaces on both sides of the grain: that which is nearer to the centre.
            let z = low + self.grid.spacing_mm[2] / 2.0;
            let center = Vector3::new(self.grid.center(0, i), self.grid.center(1, j), z);
            push(entries, voxel, body.phase, share, self.normal(body, &center));
        }
    }

    /// The parts of a layer's voxels that a body fills, by lines through it.
    fn along_lines(
        &self,
        [low, high]: [f64; 2],
        body: &Body,
        entries: &mut Vec<Entry>,
        scratch: &mut RowLines,
    ) {
        let (columns, rows) = (self.reach(0, body), self.reach(1, body));
        let [dx, dy, _] = self.grid.spacing_mm;
        let width = columns.len();
        let mut shares = vec![0.0; width * rows.len()];
        let weight = 1.0 / (LINES * LINES) as f64;
        let middle = |line: usize| (line as f64 + 0.5) / LINES as f64;
        for line in 0..LINES {
            let z = low + middle(line) * (high - low);
            let dz = z - body.center[2];
            if dz.abs() >= body.half[2] {
                continue;
            }
            let section = self.grains.rows(body.grain, body.center, dz, scratch);
            for (j, shares) in rows.clone().zip(shares.chunks_exact_mut(width)) {
                for line in 0..LINES {
                    let [from, to] = section.x_at((j as f64 + middle(line)) * dy);
                    let (from, to) = (from / dx - columns.start as f64, to / dx - columns.start as f64);
                    add_interval(shares, from.max(0.0), to.min(width as f64), weight);
                }
            }
        }
        for (row, shares) in rows.zip(shares.chunks_exact(width)) {
            for (i, share) in columns.clone().zip(shares) {
                let voxel = row * self.grid.shape[0] + i;
                let center =
                    Vector3::new(self.grid.center(0, i), self.grid.center(1, row), (low + high) / 2.0);
                push(entries, voxel, body.phase, *share, Vector3::zeros());
                if let Some(entry) = entries.last_mut()
                    && entry.voxel as usize == voxel
                    && entry.share < 1.0
                {
                    entry.normal = self.normal(body, &center);
                }
            }
        }
    }

    /// The outward normal of a grain near a point.
    fn normal(&self, body: &Body, at: &Vector3<f64>) -> Vector3<f64> {
        self.grains.grain(body.grain).normal(&(at - Vector3::from(body.center)))
    }
}

impl Plane<'_> {
    /// A voxel of parts of grains: its label, and its phases if there are two.
    fn mixed(&mut self, parts: &[Entry], x: u16) -> (u8, Option<CutVoxel>) {
        let filled: f64 = parts.iter().map(|part| part.share).sum();
        let scale = 1.0 / filled.max(1.0);
        // Shares of phases, with the normal of the largest part of each.
        let mut phases: Vec<(u8, f64, f64, Vector3<f64>)> = Vec::new();
        for part in parts {
            let share = part.share * scale;
            match phases.iter_mut().find(|(phase, ..)| *phase == part.phase) {
                Some((_, sum, largest, normal)) => {
                    *sum += share;
                    if share > *largest {
                        (*largest, *normal) = (share, part.normal);
                    }
                }
                None => phases.push((part.phase, share, share, part.normal)),
            }
        }
        let matrix = 1.0 - filled * scale;
        let has_matrix = matrix > LEAST_SHARE;
        if has_matrix {
            phases.push((MATRIX, matrix, matrix, Vector3::zeros()));
        }
        self.of_three_bodies += u64::from(parts.len() + usize::from(has_matrix) > 2);
        // Of equal shares the grain comes first.
        phases.sort_by(|a, b| b.1.total_cmp(&a.1));
        match phases[..] {
            [] => (MATRIX, None),
            [(phase, ..)] => (phase, None),
            [first, second, ..] => {
                // The matrix has no normal of its own.
                let [one, other] = if first.0 == MATRIX { [first, second] } else { [second, first] };
                let normal = (other.3 - one.3).try_normalize(0.0).unwrap_or_default();
                let cut = CutVoxel {
                    share: other.1 / (one.1 + other.1),
                    normal: normal.map(|x| x as f32).into(),
                    x,
                    phases: [one.0, other.0],
                };
                (CUT, Some(cut))
            }
        }
    }
}

/// Takes note of a share that counts.
fn push(entries: &mut Vec<Entry>, voxel: usize, phase: u8, share: f64, normal: Vector3<f64>) {
    if share > LEAST_SHARE {
        let share = if share > 1.0 - LEAST_SHARE { 1.0 } else { share };
        let normal = normal.try_normalize(0.0).unwrap_or_default();
        entries.push(Entry { voxel: voxel as u32, phase, share, normal });
    }
}

/// Adds to each voxel of a row the part of it that an interval covers, in units of voxels, times a weight.
fn add_interval(row: &mut [f64], low: f64, high: f64, weight: f64) {
    if high <= low {
        return;
    }
    let (first, last) = (low as usize, (high as usize).min(row.len() - 1));
    if first == last {
        row[first] += weight * (high - low);
        return;
    }
    row[first] += weight * (first as f64 + 1.0 - low);
    row[first + 1..last].iter_mut().for_each(|share| *share += weight);
    row[last] += weight * (high - last as f64);
}
