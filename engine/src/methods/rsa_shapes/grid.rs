//! The inserted grains by cell: each cell lists those that can come closer than allowed to a new grain whose centre
//! lies in it.
//!
//! The lists are built for a stage; grains inserted since are chained to them.

use nalgebra::UnitQuaternion;

use super::Stage;
use crate::arrays::{self, Each as _};
use crate::distance::DistanceRule;
use crate::domain::Domain;
use crate::elementary::cbrt;
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Symmetric, Vector, minus};
use crate::geometry::images::{Image, Images};
use crate::memory::{OutOfMemory, filled, make_room};
use crate::methods::image_names::ImageNames;
use crate::shape::Pose;

/// Edge of a cell over the shortest inner radius of the stage, gap included. Smaller cells name each grain more often.
const CELL_EDGE: f64 = 3.0;
/// Largest number of cells: few grains in much space need no fine cells.
const MOST_CELLS: f64 = 2e6;
/// End of a chain.
const NONE: u32 = u32::MAX;
/// A voxel is said to be covered with this margin, far above rounding.
const COVERED_MARGIN: f64 = 1.0 - 1e-12;

/// A shape at a pose. Lengths are in mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed<T> {
    pub(super) center_mm: Vector,
    pub(super) turned: T,
    /// Radius of a sphere around it.
    pub(super) outer_mm: f64,
}

impl<T: Turned> Placed<T> {
    #[inline(always)]
    pub(super) fn new<S: ConvexShape<Turned = T>>(shape: &S, pose: &Pose) -> Self {
        let turned = shape.turned(&shape.rows(pose));
        Self { center_mm: pose.center_mm.into(), turned, outer_mm: shape.outer_mm() }
    }

    /// Whether the grain keeps a gap to another one, whose centre lies at `r` from its own.
    #[inline(always)]
    pub(super) fn keeps(&self, other: &Self, r: Vector, gap_mm: f64) -> bool {
        self.turned.decide(&other.turned, r, gap_mm, self.turned.first_direction(&other.turned, r)).is_apart
    }
}

/// What draws read of an inserted grain. Its shape and its pose are kept by the run; the next stage computes its
/// exclusion zones from them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inserted<T> {
    pub(super) body: Placed<T>,
    pub(super) d_mm: f64,
    /// Inverse shape matrix of the ellipsoid that no centre of a stage's grains lies in.
    excluded: Symmetric,
    /// One over that ellipsoid's shortest semi-axis.
    per_shortest: f64,
}

impl<T: Turned> Inserted<T> {
    pub(super) fn new(body: Placed<T>, d_mm: f64) -> Self {
        Self { body, d_mm, excluded: Symmetric([0.0; 6]), per_shortest: 0.0 }
    }

    /// Makes the exclusion that of a stage, for a grain of this shape and orientation.
    pub(super) fn cover(
        &mut self,
        stage: &Stage,
        rule: &DistanceRule,
        shape: &impl ConvexShape,
        orientation: UnitQuaternion<f64>,
    ) {
        let smallest = rule.gap_mm(stage.diameters[1], self.d_mm);
        let axes = shape.inside_mm().each(|axis| axis + stage.inner + smallest);
        let rows = shape.rows(&Pose { center_mm: self.body.center_mm.into(), orientation });
        self.excluded = Symmetric::rotated_diagonal(&rows, axes.each(|axis| 1.0 / (axis * axis)));
        self.per_shortest = 1.0 / axes[2];
    }

    /// Gap and radii: beyond this distance of the centres a grain of the stage has nothing to test.
    fn reach_mm(&self, stage: &Stage, rule: &DistanceRule) -> f64 {
        let largest = rule.gap_mm(stage.diameters[0], self.d_mm);
        (self.body.outer_mm + stage.outer + largest) * (1.0 + 1e-12)
    }

    /// Whether the exclusion covers a ball around a point, of the image at an offset.
    #[inline(always)]
    pub(super) fn covers(&self, shift: Vector, point: Vector, radius_mm: f64) -> bool {
        let r = minus(minus(point, self.body.center_mm), shift);
        let left = COVERED_MARGIN - radius_mm * self.per_shortest;
        left > 0.0 && self.excluded.quadratic(r) <= left * left
    }
}

/// The grid of a stage.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) counts: [usize; 3],
    pub(super) edge: Vector,
    images: Images,
    /// What entries name: grains with their images.
    names: ImageNames,
    /// In which images a grain can come close to itself: one of each two opposite ones, the nearest first.
    own_images: Vec<Image>,
    /// Entries of cell `i` known at the build are `entries[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    entries: Vec<u32>,
    /// Entries since: head of each cell's chain, and the chains.
    heads: Vec<u32>,
    links: Vec<[u32; 2]>,
}

impl Grid {
    /// The grid of a stage, with the grains inserted before, of so many that may be inserted.
    ///
    /// # Errors
    /// When the system refuses memory, or so many grains cannot be named beside their images.
    pub(super) fn new(
        domain: &Domain,
        stage: &Stage,
        rule: &DistanceRule,
        inserted: &[Inserted<impl Turned>],
        grains: usize,
    ) -> Result<Self, OutOfMemory> {
        let bounds_mm = domain.bounds_mm;
        let wanted = CELL_EDGE * (stage.inner + rule.gap_mm(stage.diameters[1], stage.diameters[1]) / 2.0);
        let edge_mm = wanted.max(cbrt(bounds_mm.iter().product::<f64>() / MOST_CELLS));
        let counts = bounds_mm.each(|length| (length / edge_mm).round().max(1.0) as usize);
        let images = Images::new(domain);
        // Of the grains of the stage among themselves, and of those inserted before.
        let own_reach_mm = 2.0 * stage.outer + rule.gap_mm(stage.diameters[0], stage.diameters[0]);
        let reach_mm = inserted.iter().map(|one| one.reach_mm(stage, rule)).fold(own_reach_mm, f64::max);
        let number = counts.iter().product::<usize>();
        let mut grid = Self {
            counts,
            edge: arrays::from_fn(|a| bounds_mm[a] / counts[a] as f64),
            images,
            names: ImageNames::new(&images, reach_mm)?,
            own_images: images.of_itself(own_reach_mm)?,
            starts: filled(number + 1, 0)?,
            entries: Vec::new(),
            heads: filled(number, NONE)?,
            links: Vec::new(),
        };
        if grid.names.grains() < grains as u64 {
            return Err(OutOfMemory { bytes: grains as u64 * 8 });
        }
        let mut starts = std::mem::take(&mut grid.starts);
        for one in inserted {
            grid.for_each_touched(one, one.reach_mm(stage, rule), |cell, _| starts[cell + 1] += 1);
        }
        for i in 0..number {
            starts[i + 1] += starts[i];
        }
        let mut entries = filled(starts[number] as usize, 0)?;
        for (id, one) in inserted.iter().enumerate() {
            grid.for_each_touched(one, one.reach_mm(stage, rule), |cell, image| {
                entries[starts[cell] as usize] = grid.names.name(id, image);
                starts[cell] += 1;
            });
        }
        starts.rotate_right(1);
        starts[0] = 0;
        (grid.starts, grid.entries) = (starts, entries);
        Ok(grid)
    }

    /// Adds a grain to the lists of all cells that it can matter to in a stage, that of the grid.
    pub(super) fn insert(
        &mut self,
        id: usize,
        inserted: &Inserted<impl Turned>,
        stage: &Stage,
        rule: &DistanceRule,
    ) -> Result<(), OutOfMemory> {
        let reach_mm = inserted.reach_mm(stage, rule);
        let mut touched = 0;
        self.for_each_touched(inserted, reach_mm, |_, _| touched += 1);
        make_room(&mut self.links, touched)?;
        let (mut heads, mut links) = (std::mem::take(&mut self.heads), std::mem::take(&mut self.links));
        self.for_each_touched(inserted, reach_mm, |cell, image| {
            links.push([self.names.name(id, image), heads[cell]]);
            heads[cell] = (links.len() - 1) as u32;
        });
        (self.heads, self.links) = (heads, links);
        Ok(())
    }

    /// Number of the cell at these positions.
    #[inline(always)]
    pub(super) fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Lower corner of a cell.
    #[inline(always)]
    pub(super) fn corner(&self, cell: usize) -> Vector {
        let [nx, ny, _] = self.counts;
        let at = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        arrays::from_fn(|a| at[a] as f64 * self.edge[a])
    }

    /// Calls `visit` with the entries of a cell, from the largest grain down within each list.
    #[inline(always)]
    pub(super) fn any_near(&self, cell: usize, mut visit: impl FnMut(usize, Vector) -> bool) -> bool {
        let range = self.starts[cell] as usize..self.starts[cell + 1] as usize;
        for &entry in &self.entries[range] {
            let (grain, image) = self.names.read(entry);
            if visit(grain, self.names.offset_mm(image)) {
                return true;
            }
        }
        let mut link = self.heads[cell];
        while link != NONE {
            let [entry, next] = self.links[link as usize];
            let (grain, image) = self.names.read(entry);
            if visit(grain, self.names.offset_mm(image)) {
                return true;
            }
            link = next;
        }
        false
    }

    /// The grain whose exclusion holds a point of a cell, with the offset of its image.
    #[inline(always)]
    pub(super) fn covering(
        &self,
        cell: usize,
        point: Vector,
        inserted: &[Inserted<impl Turned>],
    ) -> Option<(usize, Vector)> {
        self.covering_ball(cell, point, 0.0, inserted)
    }

    /// The grain whose exclusion holds a ball around a point of a cell.
    #[inline(always)]
    pub(super) fn covering_ball(
        &self,
        cell: usize,
        point: Vector,
        radius_mm: f64,
        inserted: &[Inserted<impl Turned>],
    ) -> Option<(usize, Vector)> {
        let mut found = None;
        self.any_near(cell, |grain, shift| {
            let is_covered = inserted[grain].covers(shift, point, radius_mm);
            if is_covered {
                found = Some((grain, shift));
            }
            is_covered
        });
        found
    }

    /// Whether a body comes closer than a gap to an image of its own.
    pub(super) fn meets_own_image(&self, body: &Placed<impl Turned>, gap_mm: f64) -> bool {
        let reach_mm = 2.0 * body.outer_mm + gap_mm;
        let near = self.own_images.iter().map(|image| image.offset_mm);
        near.take_while(|offset_mm| offset_mm.norm() < reach_mm)
            .any(|offset_mm| !body.keeps(body, offset_mm.into(), gap_mm))
    }

    /// Calls `visit` with every cell, and the image, that a grain can matter to by its reach.
    fn for_each_touched(
        &self,
        inserted: &Inserted<impl Turned>,
        reach: f64,
        mut visit: impl FnMut(usize, u32),
    ) {
        for image in self.images.meeting_box(inserted.body.center_mm, [reach; 3]) {
            let center: Vector = arrays::from_fn(|a| inserted.body.center_mm[a] + image.offset_mm[a]);
            let image = self.names.code(image.steps);
            let index = |a: usize, x: f64| ((x / self.edge[a]).max(0.0) as usize).min(self.counts[a] - 1);
            let span = |a: usize| index(a, center[a] - reach)..index(a, center[a] + reach) + 1;
            let gap2 = |a: usize, i: usize| {
                let low = i as f64 * self.edge[a];
                let gap = (low - center[a]).max(center[a] - low - self.edge[a]).max(0.0);
                gap * gap
            };
            for z in span(2) {
                for y in span(1) {
                    let left = reach * reach - gap2(2, z) - gap2(1, y);
                    if left < 0.0 {
                        continue;
                    }
                    for x in span(0) {
                        if gap2(0, x) <= left {
                            visit(self.number([x, y, z]), image);
                        }
                    }
                }
            }
        }
    }
}
