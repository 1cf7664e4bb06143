//! The check of shaped grains: all pairs with all periodic images, all walls.
//!
//! Pairs come from the table of the check, which sees the spheres around the grains. What two grains prove and what a
//! wall asks for is said by their kind ([`Body`]). Required gaps are those of the diameters of equal volume.

use std::num::NonZeroUsize;

use nalgebra::Vector3;

use super::convex::Body;
use super::region::{Region, SpecimenRegion};
use super::required::Required;
use super::separation::{Direction, Image, Verdict};
use super::table::{Grain, Table};
use super::walk::{Findings, Walk};
use super::{Fault, Gaps, Pairs, SeparationCertificate, walls};
use crate::arrays::{self, Each as _};
use crate::control::Control;
use crate::memory::{OutOfMemory, make_room, push, reserved};
use crate::packing::Spheres;
use crate::request::Distance;

/// Grains of a piece of the walk: a fraction of a millisecond.
const GRAINS_PER_PIECE: usize = 256;

/// The bodies of a packing and what its request demands of them.
#[derive(Debug)]
pub(super) struct Packing<B, R = SpecimenRegion> {
    bodies: Vec<B>,
    /// The spheres around the bodies.
    spheres: Spheres,
    required: Required<R>,
}

impl<R: Region, B: Body<R>> Packing<B, R> {
    /// The bodies of a number of grains, made one by one, with the distances that they keep in their specimen.
    pub(super) fn new(
        grains: usize,
        body_of: impl Fn(usize) -> Option<B>,
        (distance, region): (Distance, R),
    ) -> Result<Self, Fault> {
        let mut bodies = reserved(grains)?;
        let mut spheres = Spheres::default();
        for column in [&mut spheres.x_mm, &mut spheres.y_mm, &mut spheres.z_mm, &mut spheres.d_mm] {
            *column = reserved(grains)?;
        }
        for grain in 0..grains {
            let body = body_of(grain).ok_or(Fault::NotABody { grain })?;
            spheres.push(body.center().into(), 2.0 * body.radius());
            bodies.push(body);
        }
        let required = Required::new(distance, region);
        Ok(Self { bodies, spheres, required })
    }

    /// The bodies.
    pub(super) fn bodies(&self) -> &[B] {
        &self.bodies
    }

    /// Smallest gap to a wall with its grain; `None` where there are no walls or no grains. The centres in a periodic
    /// box must lie in it.
    pub(super) fn check_walls(&self) -> Result<Option<(f64, usize)>, Fault> {
        let is_periodic = self.required.region().period_mm().is_some();
        let mut least: Option<(f64, usize)> = None;
        for (grain, body) in self.bodies.iter().enumerate() {
            if is_periodic {
                let clearance_mm = self.required.region().face_distance_mm(body.center().into());
                if clearance_mm < 0.0 {
                    return Err(Fault::Wall { grain, clearance_mm, required_mm: 0.0 });
                }
                continue;
            }
            let required_mm = self.required.wall_gap_mm(body.equivalent_diameter());
            let enough = least.map_or(f64::INFINITY, |(gap, _)| gap);
            let (clearance_mm, keeps) = body.wall_gap(self.required.region(), required_mm, enough);
            if !keeps {
                return Err(Fault::Wall { grain, clearance_mm, required_mm });
            }
            if clearance_mm < enough {
                least = Some((clearance_mm, grain));
            }
        }
        Ok(least)
    }

    /// Checks all pairs that may be closer than their rule demands, and looks as far beyond as it takes to know the
    /// smallest gap.
    pub(super) fn check_pairs(&self, walk: &Walk<'_>) -> Result<Pairs, Fault> {
        let mut findings = PairFindings::new(None);
        self.check_own_images(&mut findings)?;
        let Some(d_least) = self.bodies.iter().map(Body::equivalent_diameter).reduce(f64::min) else {
            return Ok(findings.pairs());
        };
        let farthest = self.farthest();
        let surely_kept = self.required.gap_mm(d_least, d_least);
        // A dense packing has many pairs closer than this; a loose one is looked at again, further out. Rounding errors
        // of the distances are far below.
        let mut look = (0.05 * d_least).max(1.0e-12 * farthest);
        loop {
            self.look_at_pairs(look, &mut findings, walk)?;
            // Pairs not seen keep their rule's distance and `look` more.
            let known = findings.gap <= surely_kept + look && findings.excess <= look;
            if known || look > farthest || self.bodies.len() < 2 {
                return Ok(findings.pairs());
            }
            look *= 4.0;
        }
    }

    /// A length that no distance of two grains, and no extent of a grain, exceeds.
    fn farthest(&self) -> f64 {
        let diagonal = self.required.region().bounds_mm().iter().map(|l| l * l).sum::<f64>().sqrt();
        self.bodies.iter().map(|b| 2.0 * b.radius()).fold(diagonal, f64::max)
    }

    fn look_at_pairs(&self, look: f64, known: &mut PairFindings, walk: &Walk<'_>) -> Result<(), Fault> {
        let required = &self.required;
        let period = required.region().period_mm();
        // Equivalent diameters are at most those of the spheres around, and no rule's gap falls with a diameter.
        let table = Table::build(
            &self.spheres,
            required.region().bounds_mm(),
            period.is_some(),
            #[inline(always)]
            |d_i, d_j| required.gap_mm(d_i, d_j) + look,
        )?;
        let walked = walk.over(
            &table,
            GRAINS_PER_PIECE,
            || known.of_a_piece(),
            #[inline(always)]
            |findings: &mut PairFindings, i: usize, j: usize, a: &Grain, b: &Grain| {
                let r = Vector3::from(b.center) - Vector3::from(a.center);
                let reach = 0.5 * (a.diameter + b.diameter) + required.gap_mm(a.diameter, b.diameter) + look;
                let Some(period) = period else {
                    if r.norm_squared() <= reach * reach {
                        self.look_at(i, j, [0.0; 3], look, findings);
                    }
                    return;
                };
                for_each_image(r, period, reach, |image| self.look_at(i, j, image, look, findings));
            },
        )?;
        known.checked += walked.pairs;
        walked.findings.into_iter().try_for_each(|piece| known.take(piece))
    }

    /// Looks at one pair: whether it keeps its gap, and whether it is among the closest.
    #[inline(always)]
    fn look_at(&self, first: usize, second: usize, image: [f64; 3], look: f64, findings: &mut PairFindings) {
        if findings.fault.is_some() {
            return;
        }
        let (a, b) = (&self.bodies[first], &self.bodies[second]);
        let required_mm = self.required.gap_mm(a.equivalent_diameter(), b.equivalent_diameter());
        // A pair needs no more once it keeps its rule, is not among the closest so far, and needs no certificate.
        let of_interest =
            findings.gap.max(required_mm + findings.excess).max(findings.closer_than.unwrap_or(0.0));
        let enough = of_interest.min(required_mm + look);
        let period = self.required.region().period_mm().unwrap_or_default();
        match a.judge(b, &Image { steps: image, period }, required_mm, enough) {
            Verdict::Clear => {}
            Verdict::Keeps(direction) => findings.note(first, second, image, required_mm, &direction),
            Verdict::TooClose(direction) => {
                let clearance_mm = direction.separation;
                let (first, second) = (first.min(second), first.max(second));
                findings.refuse(Fault::Pair { first, second, clearance_mm, required_mm });
            }
        }
    }

    /// In a periodic box a grain must also keep its distance from its own images.
    fn check_own_images(&self, findings: &mut PairFindings) -> Result<(), Fault> {
        let Some(period) = self.required.region().period_mm() else { return Ok(()) };
        let shortest = period.iter().copied().fold(f64::INFINITY, f64::min);
        for (grain, body) in self.bodies.iter().enumerate() {
            // These three first: where they keep a gap, it is at most a period, and few images are in reach.
            for image in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                self.look_at(grain, grain, image, f64::INFINITY, findings);
            }
            findings.judge()?;
            let required_mm = self.required.gap_mm(body.equivalent_diameter(), body.equivalent_diameter());
            // The nearest image is closer than the shortest period, those beyond this are not.
            let reach = shortest + 2.0 * body.radius() + required_mm;
            for_each_image(Vector3::zeros(), period, reach, |image| {
                let steps: f64 = image.iter().map(|k| k.abs()).sum();
                // Of two opposite images, which are alike, one.
                if steps > 1.0 && image.iter().find(|k| **k != 0.0).is_some_and(|k| *k > 0.0) {
                    self.look_at(grain, grain, image, f64::INFINITY, findings);
                }
            });
            findings.judge()?;
        }
        Ok(())
    }
}

impl<B: Body<SpecimenRegion>> Packing<B> {
    /// Checks all pairs and returns a direction for each that is closer than a gap.
    pub(super) fn certificates(
        &self,
        closer_than: f64,
        walk: &Walk<'_>,
    ) -> Result<Vec<SeparationCertificate>, Fault> {
        let mut findings = PairFindings::new(Some(closer_than));
        self.check_own_images(&mut findings)?;
        self.look_at_pairs(closer_than.max(1.0e-12 * self.farthest()), &mut findings, walk)?;
        let mut certificates = findings.certificates;
        let walls = self.wall_certificates(closer_than)?;
        make_room(&mut certificates, walls.len())?;
        certificates.extend(walls);
        // Walls come before other grains; those of a grain stay in the order of the walls.
        certificates.sort_by_key(|c| (c.first, c.second, c.image));
        Ok(certificates)
    }

    /// A direction for each grain and each wall that are closer than a gap.
    fn wall_certificates(&self, closer_than: f64) -> Result<Vec<SeparationCertificate>, OutOfMemory> {
        let (mut found, mut refused) = (Vec::new(), None);
        for (first, body) in self.bodies.iter().enumerate() {
            let required_mm = self.required.wall_gap_mm(body.equivalent_diameter());
            let reach = |n: &Vector3<f64>| body.reach(n);
            walls::for_each_near(
                self.required.region(),
                body.center(),
                body.radius(),
                closer_than,
                &reach,
                |normal, gap| {
                    let certificate = SeparationCertificate {
                        first,
                        second: None,
                        image: [0; 3],
                        normal: normal.into(),
                        separation_mm: gap,
                        required_mm,
                    };
                    push(&mut found, certificate, &mut refused);
                },
            );
        }
        refused.map_or(Ok(found), Err)
    }
}

/// Checks that bodies of any kind keep their gaps in a region of any kind: all pairs with all periodic images, and all
/// walls. That the bodies are those of a mix is not asked.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_bodies<R: Region, B: Body<R> + Clone>(
    bodies: &[B],
    region: R,
    distance: Distance,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Gaps, Fault> {
    let packing = Packing::new(bodies.len(), |i| Some(bodies[i].clone()), (distance, region))?;
    let wall = packing.check_walls()?;
    let pairs = packing.check_pairs(&Walk { threads, control })?;
    Ok(Gaps::new(wall, &pairs))
}

/// Calls `visit` with the periods to move by, for all that make a vector no longer than `reach`, and for some beyond.
#[inline(always)]
fn for_each_image(r: Vector3<f64>, period: [f64; 3], reach: f64, mut visit: impl FnMut([f64; 3])) {
    let widened = reach * (1.0 + 1.0e-9);
    let low: [f64; 3] = arrays::from_fn(|k| ((-widened - r[k]) / period[k] - 1.0e-9).ceil());
    let high: [f64; 3] = arrays::from_fn(|k| ((widened - r[k]) / period[k] + 1.0e-9).floor());
    let mut image = low;
    if (0..3).any(|k| low[k] > high[k]) {
        return;
    }
    loop {
        let moved = Vector3::from_fn(|k, _| r[k] + image[k] * period[k]);
        if moved.norm_squared() <= widened * widened {
            visit(image);
        }
        // The next of a counter with three digits.
        let Some(digit) = (0..3).find(|&k| image[k] < high[k]) else { return };
        image[digit] += 1.0;
        image[..digit].copy_from_slice(&low[..digit]);
    }
}

/// What the pairs looked at so far have shown.
#[derive(Debug)]
struct PairFindings {
    gap: f64,
    /// The pair that has this gap; none of a piece that has found no closer one.
    closest: Option<[usize; 2]>,
    excess: f64,
    checked: u64,
    fault: Option<Fault>,
    closer_than: Option<f64>,
    certificates: Vec<SeparationCertificate>,
    refused: Option<OutOfMemory>,
}

impl Findings for PairFindings {
    fn have_fault(&self) -> bool {
        self.fault.is_some()
    }
}

impl PairFindings {
    fn new(closer_than: Option<f64>) -> Self {
        Self {
            gap: f64::INFINITY,
            closest: None,
            excess: f64::INFINITY,
            checked: 0,
            fault: None,
            closer_than,
            certificates: Vec::new(),
            refused: None,
        }
    }

    /// What a piece begins with: the distances that are known, for only closer pairs are of interest, and nothing else.
    fn of_a_piece(&self) -> Self {
        Self { gap: self.gap, excess: self.excess, ..Self::new(self.closer_than) }
    }

    /// Takes what a piece has shown.
    fn take(&mut self, mut piece: Self) -> Result<(), Fault> {
        piece.judge()?;
        if piece.gap < self.gap {
            (self.gap, self.closest) = (piece.gap, piece.closest);
        }
        self.excess = self.excess.min(piece.excess);
        make_room(&mut self.certificates, piece.certificates.len())?;
        self.certificates.append(&mut piece.certificates);
        Ok(())
    }

    #[cold]
    fn refuse(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
    }

    fn note(&mut self, first: usize, second: usize, image: [f64; 3], required_mm: f64, found: &Direction) {
        let separation_mm = found.separation;
        if separation_mm < self.gap {
            (self.gap, self.closest) = (separation_mm, Some([first.min(second), first.max(second)]));
        }
        // Within the error of `s` that a decision in double-double arithmetic has overruled.
        self.excess = self.excess.min((separation_mm - required_mm).max(0.0));
        if self.closer_than.is_some_and(|closer_than| separation_mm < closer_than) {
            let (sign, first, second) =
                if first <= second { (1.0, first, second) } else { (-1.0, second, first) };
            let certificate = SeparationCertificate {
                first,
                second: Some(second),
                image: image.each(|k| (sign * k) as i32),
                normal: (found.normal * sign).into(),
                separation_mm,
                required_mm,
            };
            push(&mut self.certificates, certificate, &mut self.refused);
        }
    }

    fn judge(&mut self) -> Result<(), Fault> {
        match (self.fault.take(), self.refused.take()) {
            (Some(fault), _) => Err(fault),
            (None, Some(refused)) => Err(refused.into()),
            (None, None) => Ok(()),
        }
    }

    fn pairs(&self) -> Pairs {
        let known = |least: f64| least.is_finite().then_some(least);
        Pairs {
            min_gap_mm: known(self.gap),
            closest: self.closest,
            min_excess_gap_mm: known(self.excess),
            checked: self.checked,
        }
    }
}
