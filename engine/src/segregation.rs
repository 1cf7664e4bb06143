//! Size gradients: how the request's gradient weighs a position for a grain (`docs/gradient.md`).
//!
//! Positions along a field are quantiles: at 0.3 of a field, three tenths of the volume that the walls leave for the
//! centre of a grain lie further down. So a grain that lies anywhere with equal probability has any quantile with
//! equal probability, whatever its size and the specimen's shape, and a grain coarser than three tenths of the mass
//! may be assigned to 0.3 without displacing others.
//!
//! The weight of a position at the quantile `u` for a grain of mass quantile `q` is `exp(-k (u - q)^2)` with the
//! strength `k`. A grain that is no sphere counts as the sphere of equal volume about its centre.

use crate::distance::DistanceRule;
use crate::domain::{Domain, Region};
use crate::mix::sphere_volume;
use crate::request::{Axis, FieldDirection, GradientField, PackingRequest, Segregation, SpecimenFace};

/// How far up a field a centre lies in the region that is left for it: 0 to 1.
pub(crate) fn share_of_field(field: GradientField, region: &Region, p: [f64; 3]) -> f64 {
    let (axis, rises) = match field {
        GradientField::Linear { axis, direction } => (axis, direction == FieldDirection::Up),
        GradientField::Face { face } => match face {
            SpecimenFace::XMin => (Axis::X, false),
            SpecimenFace::XMax => (Axis::X, true),
            SpecimenFace::YMin => (Axis::Y, false),
            SpecimenFace::YMax => (Axis::Y, true),
            SpecimenFace::ZMin => (Axis::Z, false),
            SpecimenFace::ZMax => (Axis::Z, true),
            SpecimenFace::Side => return region.share_within(p),
        },
    };
    let below = region.share_below(axis.index(), p[axis.index()]);
    if rises { below } else { 1.0 - below }
}

/// The gradient of a request and the grains it sorts.
#[derive(Clone, Debug)]
pub struct Preference {
    field: GradientField,
    strength: f64,
    domain: Domain,
    grains: Vec<Grain>,
}

#[derive(Clone, Copy, Debug)]
struct Grain {
    volume_mm3: f64,
    /// What its centre keeps from the walls.
    clearance_mm: f64,
    /// Share of the mass that is finer.
    quantile: f64,
}

impl Preference {
    /// That of a request for grains of these equivalent diameters, from the largest down; `None` where it has none.
    ///
    /// Equal grains have quantiles of their own: asked for at one share of the field they would crowd there.
    pub fn new(request: &PackingRequest, diameters_mm: &[f64]) -> Option<Self> {
        let Segregation::Gradient { field, strength } = request.segregation else { return None };
        if strength <= 0.0 {
            return None;
        }
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let all: f64 = diameters_mm.iter().map(|&d| sphere_volume(d)).sum();
        let mut coarser = 0.0;
        let grains = diameters_mm
            .iter()
            .map(|&d| {
                let own = sphere_volume(d);
                let quantile = 1.0 - (coarser + own / 2.0) / all;
                coarser += own;
                Grain { volume_mm3: own, clearance_mm: d / 2.0 + rule.wall_gap_mm(d), quantile }
            })
            .collect();
        Some(Self { field, strength, domain: request.specimen.domain(), grains })
    }

    /// Logarithm of the weight of a place for a grain whose centre has this region.
    #[inline]
    pub(crate) fn log_weight(&self, grain: usize, region: &Region, p: [f64; 3]) -> f64 {
        let off = share_of_field(self.field, region, p) - self.grains[grain].quantile;
        -self.strength * off * off
    }

    /// The same with the region that is left for the centre of a sphere of the grain's diameter.
    pub(crate) fn log_weight_at(&self, grain: usize, p: [f64; 3]) -> f64 {
        let region = self.domain.center_region(self.grains[grain].clearance_mm);
        region.map_or(0.0, |region| self.log_weight(grain, &region, p))
    }

    /// What two grains would gain in the logarithm of their weights if they changed places, each counted by its
    /// share of their mass, so that it is mass that the swaps sort: by number, the mass of the fine grains
    /// would be carried upwards by the largest of them.
    pub(crate) fn log_acceptance_ratio(&self, [i, j]: [usize; 2], [p_i, p_j]: [[f64; 3]; 2]) -> f64 {
        let gain = |grain: usize, from: [f64; 3], to: [f64; 3]| {
            let volume_mm3 = self.grains[grain].volume_mm3;
            volume_mm3 * (self.log_weight_at(grain, to) - self.log_weight_at(grain, from))
        };
        let mean_volume_mm3 = (self.grains[i].volume_mm3 + self.grains[j].volume_mm3) / 2.0;
        (gain(i, p_i, p_j) + gain(j, p_j, p_i)) / mean_volume_mm3
    }
}

#[cfg(test)]
#[path = "segregation_tests.rs"]
mod tests;
