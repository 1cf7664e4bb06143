//! The largest factor on the sizes of all grains, at their positions, at which they keep their distances.
//!
//! At a scale `s` a pair of grains must have the gap `g_0 + s g_1` of the distance rule (a constant, or a part of the
//! diameters), and so must a grain and a wall. A direction `n` from the centre of one grain to that of another, `r`
//! away, with the support functions `h`, proves this up to
//!
//! ```text
//! s(n) = (r · n - g_0) / (h_a(n) + h_b(-n) + g_1)
//! ```
//!
//! Of spheres the direction of `r` gives the largest `s` in closed form. Of other grains the largest `s` lies between
//! the best direction found and the least scale at which the pair is known to be too close, and is found by bisection:
//! a pair at the scale `s` is the pair at its own size with `r / s` and the gap `g_0 / s + g_1`, which the module `gap`
//! decides. The least value over all pairs and walls is rounded down, so that the check finds no violation.

use crate::arrays;
use crate::arrays::Each as _;
use crate::distance::DistanceRule;
use crate::domain::{Domain, Face, Lateral};
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Vector, dot, norm, scaled};
use crate::geometry::cells::Octaves;
use crate::geometry::images::Images;
use crate::memory::{OutOfMemory, collected, copied, reserved};
use crate::packing::{Grains, GrainsRef, Solids, Spheres};
use crate::request::Specimen;

/// Share by which the scale is rounded down: of spheres, whose gaps are a difference of two lengths, and of others,
/// which the check turns by formulas of its own.
const ROUNDING_SPHERES: f64 = 8.0 * f64::EPSILON;
const ROUNDING_SHAPES: f64 = 1.0e-12;
/// Relative width of the bracket at the end of the bisection, and most steps of it.
const BRACKET: f64 = 1.0e-13;
const MOST_STEPS: u32 = 200;
/// First bound of the scale where there is none, over the scale that growth reached.
const WIDER: f64 = 1.25;
/// Most times that the bound is raised.
const MOST_WIDER: u32 = 40;

/// The largest scale of grains with sizes and poses, at most `most`; 0 where there is no such scale.
///
/// # Errors
/// When the system refuses memory.
pub(super) fn largest_scale(
    grains: &Grains,
    specimen: &Specimen,
    rule: &DistanceRule,
    most: f64,
) -> Result<f64, OutOfMemory> {
    match grains.solids() {
        None => of_spheres(&GrainsRef::from(grains).equivalent_spheres(), specimen, rule, most),
        Some(solids) => of_solids(solids, specimen, rule, most),
    }
}

/// The same without a bound; `near` is a scale near it.
///
/// # Errors
/// When the system refuses memory.
pub(super) fn unbounded_scale(
    grains: &Grains,
    specimen: &Specimen,
    rule: &DistanceRule,
    near: f64,
) -> Result<f64, OutOfMemory> {
    let mut most = WIDER * near;
    for _ in 0..MOST_WIDER {
        let found = largest_scale(grains, specimen, rule, most)?;
        if found < most {
            return Ok(found);
        }
        most *= WIDER;
    }
    Ok(most)
}

/// A gap that depends on the scale: `fixed_mm + scale * per_scale_mm`.
#[derive(Clone, Copy, Debug)]
struct Gap {
    fixed_mm: f64,
    per_scale_mm: f64,
}

impl Gap {
    fn of_pair(rule: &DistanceRule, d_i: f64, d_j: f64) -> Self {
        let fixed_mm = rule.gap_mm(0.0, 0.0);
        Self { fixed_mm, per_scale_mm: rule.gap_mm(d_i, d_j) - fixed_mm }
    }

    fn of_wall(rule: &DistanceRule, d: f64) -> Self {
        let fixed_mm = rule.wall_gap_mm(0.0);
        Self { fixed_mm, per_scale_mm: rule.wall_gap_mm(d) - fixed_mm }
    }

    fn at(&self, scale: f64) -> f64 {
        self.fixed_mm + scale * self.per_scale_mm
    }

    /// The scale at which a length that grows with it, and the gap, fill a distance.
    fn scale(&self, distance_mm: f64, length_mm: f64) -> f64 {
        (distance_mm - self.fixed_mm) / (length_mm + self.per_scale_mm)
    }
}

fn of_spheres(
    spheres: &Spheres,
    specimen: &Specimen,
    rule: &DistanceRule,
    most: f64,
) -> Result<f64, OutOfMemory> {
    let bounds = specimen.bounds_mm();
    // What the differences of coordinates are rounded by.
    let rounding_mm = ROUNDING_SPHERES * bounds.iter().sum::<f64>();
    let mut best = most;
    let domain = specimen.domain();
    if domain.has_walls() {
        for (row, &d) in spheres.d_mm.iter().enumerate() {
            let distance_mm = domain.clearance_reaching_all(spheres.center(row), [0.0; 3]) - rounding_mm;
            best = best.min(Gap::of_wall(rule, d).scale(distance_mm, d / 2.0));
        }
    }
    let at_most = Spheres {
        x_mm: copied(&spheres.x_mm)?,
        y_mm: copied(&spheres.y_mm)?,
        z_mm: copied(&spheres.z_mm)?,
        d_mm: collected(spheres.d_mm.iter().map(|d| most * d))?,
        aggregate: Vec::new(),
    };
    let gap_mm = |row: usize| Gap::of_pair(rule, spheres.d_mm[row], spheres.d_mm[row]).at(most);
    let near = NearPairs::new(&at_most, specimen, gap_mm)?;
    near.for_each(|i, j, r| {
        let (d_i, d_j) = (spheres.d_mm[i], spheres.d_mm[j]);
        let (gap, radii) = (Gap::of_pair(rule, d_i, d_j), (d_i + d_j) / 2.0);
        let contact = best * radii + gap.at(best) + rounding_mm;
        let distance2 = dot(r, r);
        if distance2 < contact * contact {
            best = best.min(gap.scale(distance2.sqrt() - rounding_mm, radii));
        }
    });
    Ok(rounded_down(best, most, ROUNDING_SPHERES))
}

fn of_solids(
    solids: &Solids,
    specimen: &Specimen,
    rule: &DistanceRule,
    most: f64,
) -> Result<f64, OutOfMemory> {
    let mut turned = reserved(solids.len())?;
    let mut around = Spheres::default();
    for column in [&mut around.x_mm, &mut around.y_mm, &mut around.z_mm, &mut around.d_mm] {
        *column = reserved(solids.len())?;
    }
    let mut diameters = reserved(solids.len())?;
    for (shape, pose) in solids.iter() {
        turned.push(shape.turned(&shape.rows(pose)));
        around.push(pose.center_mm.into(), 2.0 * most * shape.outer_mm());
        diameters.push(shape.equivalent_diameter_mm());
    }
    let mut best = most;
    let domain = specimen.domain();
    if domain.has_walls() {
        for (row, body) in turned.iter().enumerate() {
            let gap = Gap::of_wall(rule, diameters[row]);
            best = best.min(between_walls(body, around.center(row), &domain, &gap, best));
        }
    }
    let gap_mm = |row: usize| Gap::of_pair(rule, diameters[row], diameters[row]).at(most);
    let near = NearPairs::new(&around, specimen, gap_mm)?;
    near.for_each(|i, j, r| {
        let gap = Gap::of_pair(rule, diameters[i], diameters[j]);
        let far = best / most * (around.d_mm[i] + around.d_mm[j]) / 2.0 + gap.at(best);
        if dot(r, r) < far * far {
            best = Pair { a: &turned[i], b: &turned[j], r, gap }.largest(best);
        }
    });
    Ok(rounded_down(best, most, ROUNDING_SHAPES))
}

fn rounded_down(best: f64, most: f64, share: f64) -> f64 {
    if best < most { (best * (1.0 - share)).max(0.0) } else { most }
}

/// Two grains that are turned, and the gap that they keep.
struct Pair<'a, T> {
    a: &'a T,
    b: &'a T,
    /// From the centre of one to that of the other.
    r: Vector,
    gap: Gap,
}

impl<T: Turned> Pair<'_, T> {
    /// The scale up to which a direction proves the gap; 0 where it proves none.
    fn by(&self, n: Vector) -> f64 {
        let n = scaled(n, 1.0 / norm(n));
        let found = self.gap.scale(dot(self.r, n), self.a.support_mm(n) + self.b.support_back_mm(n));
        // A direction of no length proves nothing.
        if found > 0.0 { found } else { 0.0 }
    }

    /// The largest scale that is at most `most`.
    fn largest(&self, most: f64) -> f64 {
        let first = self.a.first_direction(self.b, self.r);
        let decide = |scale: f64, normal: Vector| {
            let gap_mm = self.gap.fixed_mm / scale + self.gap.per_scale_mm;
            self.a.decide(self.b, scaled(self.r, 1.0 / scale), gap_mm, normal)
        };
        let mut found = decide(most, first);
        if found.is_apart {
            return most;
        }
        let (mut low, mut high) = (self.by(found.normal).max(self.by(first)).min(most), most);
        for _ in 0..MOST_STEPS {
            if high - low <= BRACKET * high {
                break;
            }
            let middle = 0.5 * (low + high);
            found = decide(middle, found.normal);
            if found.is_apart {
                low = middle;
            } else {
                high = middle;
            }
            low = low.max(self.by(found.normal)).min(high);
        }
        low
    }
}

/// The largest scale, at most `most`, at which a grain keeps its gap from the walls.
fn between_walls<T: Turned>(grain: &T, center: Vector, domain: &Domain, gap: &Gap, most: f64) -> f64 {
    let mut most = most;
    for wall in domain.walls() {
        if let Face::Plane(plane) = wall {
            let reach = grain.support_back_mm(plane.normal.into());
            most = most.min(gap.scale(plane.distance_mm(center), reach));
        }
    }
    let most = most.max(0.0);
    let Some(Lateral { center_mm, radius_mm }) = domain.lateral() else { return most };
    let is_inside = |scale: f64| {
        let offset = [0, 1].each(|a| (center[a] - center_mm[a]) / scale);
        scale * grain.reach_across_mm(offset).0 + gap.at(scale) <= radius_mm
    };
    if most <= 0.0 || is_inside(most) {
        return most;
    }
    let (mut low, mut high) = (0.0, most);
    for _ in 0..MOST_STEPS {
        if high - low <= BRACKET * high {
            break;
        }
        let middle = 0.5 * (low + high);
        if is_inside(middle) { low = middle } else { high = middle }
    }
    low
}

/// Pairs of grains that may touch, by the spheres around them; in a periodic box with all their images.
pub(super) struct NearPairs<'a, G> {
    spheres: &'a Spheres,
    gap_mm: G,
    octaves: Octaves,
    images: Images,
    largest_mm: f64,
}

impl<'a, G: Fn(usize) -> f64> NearPairs<'a, G> {
    /// `gap_mm` is the largest gap that a grain may keep from one that is no larger.
    pub(super) fn new(spheres: &'a Spheres, specimen: &Specimen, gap_mm: G) -> Result<Self, OutOfMemory> {
        let bounds_mm = specimen.bounds_mm();
        let widest_gap_mm = (0..spheres.len()).map(&gap_mm).fold(0.0, f64::max);
        Ok(Self {
            spheres,
            octaves: Octaves::new(spheres, bounds_mm, widest_gap_mm)?,
            gap_mm,
            images: Images::new(specimen),
            largest_mm: spheres.d_mm.iter().copied().fold(0.0, f64::max) + widest_gap_mm,
        })
    }

    /// Calls `visit` once with every pair that may touch, or two images of it: its rows and the vector from the centre
    /// of one to that of the other. A grain and its own images are pairs, too.
    pub(super) fn for_each(&self, mut visit: impl FnMut(usize, usize, Vector)) {
        for row in 0..self.spheres.len() {
            let center = self.spheres.center(row);
            let (radius_mm, gap_mm) = (self.spheres.d_mm[row] / 2.0, (self.gap_mm)(row));
            let far_mm = radius_mm + gap_mm + self.largest_mm;
            for image in self.images.meeting_box(center, [far_mm; 3]) {
                let is_own = image.steps == [0; 3];
                let image: Vector = arrays::from_fn(|a| center[a] + image.offset_mm[a]);
                self.octaves.for_each_near(image, radius_mm, gap_mm, |other| {
                    let number = other.row as usize;
                    // Of the pair of two grains one meets the image of the other: the finer one is visited.
                    if number > row || number == row && !is_own {
                        visit(row, number, arrays::from_fn(|a| other.center_mm[a] - image[a]));
                    }
                });
            }
        }
    }
}
