//! Pair correlation by size class: how much more often, or more rarely, grains stand at a clear distance from another
//! than they would if they lay anywhere.
//!
//! The abscissa is the clear distance in mm, `|p_i - p_j| - (d_i + d_j) / 2`: grains of all sizes touch
//! at 0, a prescribed distance shows as an edge at its value, and the mortar between grains can be read off.
//! The ordinate counts pairs over those expected if every partner lay anywhere that the walls let it,
//! the reference grain being where it is. What is expected follows from the volumes of shells in closed
//! form, so that nothing is lost to the widths of bins or classes.
//!
//! Shaped grains are seen by their centres: the abscissa is the distance of the centres less the mean of
//! the two equivalent diameters, which is below 0 where flat sides face one another, and a partner may lie wherever the
//! walls let the centre of a sphere within it.
//!
//! Edges: in a periodic box distances to the nearest image are exact up to half of the shortest edge.
//! Between walls (minus sampling) a reference grain counts up to the distance at which the shell around
//! it would leave the region where the partner's centre can lie. Both are decided by reference grain,
//! class of the partner and bin; so grains near a wall still count for near partners and small ones.

use std::f64::consts::PI;

use super::neighbors::{Grain, NeighborGrid};
use crate::distance::DistanceRule;
use crate::grain::{Grain as _, PlacedGrains};
use crate::memory::{OutOfMemory, collected};
use crate::packing::GrainsRef;
use crate::request::Specimen;
use crate::sorting;

/// What to count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadialOptions<'a> {
    /// Upper bounds of the size classes, from fine to coarse.
    pub upper_mm: &'a [f64],
    /// Smallest clear distance that is counted: 0 for spheres; below 0 for other grains, whose centres may be closer
    /// than those of spheres of equal volume.
    pub min_gap_mm: f64,
    /// Largest clear distance that is counted.
    pub max_gap_mm: f64,
    /// Bins between them.
    pub bins: usize,
    /// Reference grains per class at most; evenly chosen where there are more.
    pub max_references: usize,
}

/// The grains around those of one class.
#[derive(Clone, Debug, PartialEq)]
pub struct PairCorrelation {
    /// The reference grains.
    pub class: SizeRange,
    /// How many of them were looked at.
    pub references: usize,
    /// Clear distances at the middle of the bins, in mm.
    pub gap_mm: Vec<f64>,
    /// Pairs counted over pairs expected; `None` where no reference grain could be used.
    pub correlation: Vec<Option<f64>>,
    /// Pairs counted.
    pub pairs: Vec<u64>,
    /// Pairs expected; one over their root is about the relative error of the correlation.
    pub expected: Vec<f64>,
}

/// A range of diameters that has grains in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeRange {
    /// Smallest diameter found.
    pub d_min_mm: f64,
    /// Largest diameter found.
    pub d_max_mm: f64,
}

/// The pair correlation of every class that has grains, from fine to coarse.
///
/// # Errors
/// The system refused memory.
pub fn radial<'a>(
    grains: impl Into<GrainsRef<'a>>,
    specimen: &Specimen,
    rule: &DistanceRule,
    options: &RadialOptions<'_>,
) -> Result<Vec<PairCorrelation>, OutOfMemory> {
    let classes = classes(grains.into(), specimen, rule, options)?;
    Ok(classes.iter().map(|class| around(class, &classes, options)).collect())
}

/// A grain: its centre and its equivalent radius, and what its centre keeps from the walls at least, without a gap.
#[derive(Clone, Copy)]
struct Member {
    grain: Grain,
    inner_radius: f64,
}

/// The grains of a packing, from the largest down.
fn members(grains: GrainsRef<'_>) -> Result<Vec<Member>, OutOfMemory> {
    let placed = PlacedGrains::new(grains)?;
    collected((0..placed.len()).map(|grain| {
        let ([x, y, z], r) = (placed.center_mm(grain), placed.d_mm(grain) / 2.0);
        Member { grain: [x, y, z, r], inner_radius: placed.grain(grain).inner_radius_mm().min(r) }
    }))
}

/// One class with what is expected of its grains as partners.
struct Class {
    range: SizeRange,
    grains: Vec<Member>,
    grid: NeighborGrid,
    /// Largest radius, and largest radius with its distance to the walls.
    radius: f64,
    clearance: f64,
    /// Sums over the grains of `r^k / V`, `k` from 0 to 3, with the volume `V` open to its centre: up to each grain,
    /// from the largest down.
    moments: Vec<[f64; 4]>,
    specimen: Specimen,
    rule: DistanceRule,
}

fn classes(
    grains: GrainsRef<'_>,
    specimen: &Specimen,
    rule: &DistanceRule,
    options: &RadialOptions<'_>,
) -> Result<Vec<Class>, OutOfMemory> {
    let mut by_class: Vec<Vec<Member>> = vec![Vec::new(); options.upper_mm.len().max(1)];
    for member in members(grains)? {
        let d = 2.0 * member.grain[3];
        let class = options.upper_mm.iter().position(|&upper| d <= upper).unwrap_or(by_class.len() - 1);
        by_class[class].push(member);
    }
    by_class.retain(|members| !members.is_empty());
    by_class
        .into_iter()
        .map(|mut members| {
            // Grains come from the largest down, as far as rounding lets equivalent diameters tell.
            sorting::by_number(&mut members, |member| -member.grain[3]);
            let fold = |f: fn(f64, f64) -> f64, from| members.iter().map(|m| m.grain[3]).fold(from, f);
            let (smallest, largest) = (fold(f64::min, f64::INFINITY), fold(f64::max, 0.0));
            let clearance_of = |member: &Member| clearance(rule, member);
            let grains: Vec<Grain> = members.iter().map(|member| member.grain).collect();
            let mut class = Class {
                range: SizeRange { d_min_mm: 2.0 * smallest, d_max_mm: 2.0 * largest },
                grid: NeighborGrid::new(
                    &grains,
                    specimen.bounds_mm(),
                    specimen.is_periodic(),
                    2.0 * largest + options.max_gap_mm,
                )?,
                radius: largest,
                clearance: members.iter().map(clearance_of).fold(0.0, f64::max),
                moments: Vec::new(),
                grains: members,
                specimen: *specimen,
                rule: *rule,
            };
            let mut sums = [0.0; 4];
            class.moments = class
                .grains
                .iter()
                .map(|member| {
                    let per_volume = class.per_volume(member);
                    for (power, sum) in sums.iter_mut().enumerate() {
                        *sum += member.grain[3].powi(power as i32) * per_volume;
                    }
                    sums
                })
                .collect();
            Ok(class)
        })
        .collect()
}

/// What the centre of a grain keeps from the walls at least.
fn clearance(rule: &DistanceRule, member: &Member) -> f64 {
    member.inner_radius + rule.wall_gap_mm(2.0 * member.grain[3])
}

impl Class {
    /// One over the volume in which the centre of a grain may lie; 0 where it has one place only, which no reference
    /// grain's shell lies in.
    fn per_volume(&self, member: &Member) -> f64 {
        let region = self.specimen.center_region(clearance(&self.rule, member));
        let volume = region.map_or(0.0, |region| region.volume_mm3());
        if volume > 0.0 { 1.0 / volume } else { 0.0 }
    }

    /// Clear distance up to which partners of this class are seen without an edge around a grain.
    fn reach_mm(&self, grain: &Grain) -> f64 {
        let [x, y, z, radius] = *grain;
        let farthest = if self.specimen.is_periodic() {
            let [x, y, z] = self.specimen.bounds_mm();
            x.min(y).min(z) / 2.0
        } else {
            self.specimen.clearance_reaching_all([x, y, z], [0.0; 3]) - self.clearance
        };
        farthest - radius - self.radius
    }

    /// Expected grains with centres within `gap` and all radii of the distance at contact with a grain, `itself` not
    /// counted where it is of this class: the sum of `4 pi / 3 (radius + r + gap)^3 / V`.
    fn expected_within(&self, radius: f64, gap: f64, itself: Option<&Member>) -> f64 {
        let c = radius + gap;
        // Grains that are smaller than the distance is negative are nowhere.
        let some = if c < 0.0 { self.grains.partition_point(|m| m.grain[3] > -c) } else { self.grains.len() };
        let [m0, m1, m2, m3] = some.checked_sub(1).map_or([0.0; 4], |last| self.moments[last]);
        let all = c * c * c * m0 + 3.0 * c * c * m1 + 3.0 * c * m2 + m3;
        let own = itself.map_or(0.0, |member| (c + radius).max(0.0).powi(3) * self.per_volume(member));
        4.0 * PI / 3.0 * (all - own)
    }
}

/// Counts the grains around those of a class.
fn around(class: &Class, partners: &[Class], options: &RadialOptions<'_>) -> PairCorrelation {
    let bins = options.bins.max(1);
    let from = options.min_gap_mm;
    let width = (options.max_gap_mm - from) / bins as f64;
    let reach_of =
        |grain: &Grain| partners.iter().map(|p| p.reach_mm(grain) - from).fold(f64::NEG_INFINITY, f64::max);
    let usable: Vec<&Member> = class.grains.iter().filter(|m| reach_of(&m.grain) >= width).collect();
    let references = evenly(&usable, options.max_references);
    let (mut pairs, mut expected) = (vec![0_u64; bins], vec![0.0; bins]);
    for &member in &references {
        let grain = &member.grain;
        for partner in partners {
            let itself = std::ptr::eq(class, partner).then_some(member);
            let seen = (((partner.reach_mm(grain) - from) / width).floor().max(0.0) as usize).min(bins);
            if seen == 0 {
                continue;
            }
            let radius = grain[3];
            let mut below = partner.expected_within(radius, from, itself);
            for (bin, expected) in expected.iter_mut().enumerate().take(seen) {
                let within = partner.expected_within(radius, from + (bin + 1) as f64 * width, itself);
                *expected += within - below;
                below = within;
            }
            let last = from + seen as f64 * width;
            let reach = radius + partner.radius + last;
            partner.grid.for_each_near([grain[0], grain[1], grain[2]], reach, |distance2, r| {
                let contact = radius + r;
                let farthest = contact + last;
                // At the same place lies the grain itself: no other can.
                if distance2 < farthest * farthest && distance2 > 0.0 {
                    let gap = distance2.sqrt() - contact - from;
                    // A clear distance of 0 may come out below it by rounding.
                    if gap > -1.0e-9 * contact {
                        let bin = ((gap.max(0.0) / width) as usize).min(seen - 1);
                        pairs[bin] += 1;
                    }
                }
            });
        }
    }
    let correlation = pairs
        .iter()
        .zip(&expected)
        .map(|(&pairs, &expected)| (expected > 0.0).then(|| pairs as f64 / expected))
        .collect();
    PairCorrelation {
        class: class.range,
        references: references.len(),
        gap_mm: (0..bins).map(|bin| from + (bin as f64 + 0.5) * width).collect(),
        correlation,
        pairs,
        expected,
    }
}

/// At most `most` of the items, at equal steps.
fn evenly<'a, T>(items: &[&'a T], most: usize) -> Vec<&'a T> {
    if items.len() <= most {
        return items.to_vec();
    }
    (0..most).map(|i| items[i * items.len() / most]).collect()
}
