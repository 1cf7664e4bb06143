//! The cut itself: its outline and its circles.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::{Axis, SliceReport, overlap};
use crate::export::SphereModel;
use crate::request::Specimen;

/// The part of a plane inside the specimen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Outline {
    /// Of a box, or of a cylinder along its axis.
    Rectangle {
        /// From and to.
        u_mm: [f64; 2],
        /// From and to.
        v_mm: [f64; 2],
    },
    /// Of a cylinder across its axis.
    Disc {
        /// Its centre, u and v.
        center_mm: [f64; 2],
        /// Its radius.
        radius_mm: f64,
    },
}

impl Outline {
    /// Its area.
    pub fn area_mm2(&self) -> f64 {
        match *self {
            Self::Rectangle { u_mm: [u0, u1], v_mm: [v0, v1] } => (u1 - u0) * (v1 - v0),
            Self::Disc { radius_mm, .. } => PI * radius_mm * radius_mm,
        }
    }

    /// The rectangle around it, from and to along u and v.
    pub fn bounds_mm(&self) -> [[f64; 2]; 2] {
        match *self {
            Self::Rectangle { u_mm, v_mm } => [u_mm, v_mm],
            Self::Disc { center_mm, radius_mm } => center_mm.map(|c| [c - radius_mm, c + radius_mm]),
        }
    }
}

/// A grain's circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre, u and v; outside of the outline for some images in a periodic box.
    pub center_mm: [f64; 2],
    /// Its radius.
    pub radius_mm: f64,
    /// The grain it is cut from.
    pub grain: usize,
    /// That grain's diameter.
    pub diameter_mm: f64,
    /// Whether it crosses the outline, as in a periodic box it may.
    pub clipped: bool,
    /// Its area inside the outline.
    pub area_mm2: f64,
}

/// A plane cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// The axis that the plane is perpendicular to.
    pub axis: Axis,
    /// Where it meets that axis.
    pub at_mm: f64,
    /// The part of the plane inside the specimen.
    pub outline: Outline,
    /// Whether the cut repeats along u and v.
    pub periodic: bool,
    /// Whether edges of a rectangular outline along u are part of a cylinder's lateral surface.
    pub lateral: bool,
    /// The circles, in the order of their grains.
    pub circles: Vec<Circle>,
}

impl Cut {
    /// Cuts a packing where the plane meets its specimen, which [`super::check`] has seen to.
    pub(crate) fn new(model: &SphereModel<'_>, axis: Axis, at_mm: f64) -> Self {
        let bounds = model.specimen.bounds_mm();
        let [u, v] = axis.plane().map(Axis::index);
        let cylinder = matches!(model.specimen, Specimen::Cylinder { .. });
        let outline = match (model.specimen, axis) {
            (Specimen::Cylinder { diameter_mm, .. }, Axis::Z) => {
                Outline::Disc { center_mm: [diameter_mm / 2.0; 2], radius_mm: diameter_mm / 2.0 }
            }
            (Specimen::Cylinder { diameter_mm, height_mm }, _) => {
                let half_chord = (at_mm * (diameter_mm - at_mm)).max(0.0).sqrt();
                let middle = diameter_mm / 2.0;
                Outline::Rectangle {
                    u_mm: [middle - half_chord, middle + half_chord],
                    v_mm: [0.0, *height_mm],
                }
            }
            (Specimen::Box { .. }, _) => {
                Outline::Rectangle { u_mm: [0.0, bounds[u]], v_mm: [0.0, bounds[v]] }
            }
        };
        let periodic = model.specimen.is_periodic();
        let mut cut = Self {
            axis,
            at_mm,
            outline,
            periodic,
            lateral: cylinder && axis != Axis::Z,
            circles: Vec::new(),
        };
        let shifts: &[f64] = if periodic { &[-1.0, 0.0, 1.0] } else { &[0.0] };
        for grain in 0..model.spheres.len() {
            let center = model.spheres.center(grain);
            let diameter_mm = model.spheres.d_mm[grain];
            let radius = diameter_mm / 2.0;
            for shift in shifts {
                let height = (center[axis.index()] + shift * bounds[axis.index()] - at_mm).abs();
                if height < radius {
                    let radius_mm = ((radius - height) * (radius + height)).sqrt();
                    for du in shifts {
                        for dv in shifts {
                            let center_mm = [center[u] + du * bounds[u], center[v] + dv * bounds[v]];
                            cut.push(center_mm, radius_mm, grain, diameter_mm);
                        }
                    }
                }
            }
        }
        cut
    }

    fn push(&mut self, center_mm: [f64; 2], radius_mm: f64, grain: usize, diameter_mm: f64) {
        let mut area_mm2 = PI * radius_mm * radius_mm;
        let mut clipped = false;
        if self.periodic {
            let [u, v] = self.outline.bounds_mm();
            let crosses = |i: usize, [low, high]: [f64; 2]| {
                center_mm[i] - radius_mm < low || center_mm[i] + radius_mm > high
            };
            clipped = crosses(0, u) || crosses(1, v);
            if clipped {
                // Decided by distance: the area of a circle that does not reach the outline is a difference of equal
                // numbers, whose rounding may be positive.
                if !reaches(center_mm, radius_mm, u, v) {
                    return;
                }
                area_mm2 = overlap::with_rectangle(center_mm, radius_mm, u, v);
                if area_mm2 <= 0.0 {
                    return;
                }
            }
        }
        self.circles.push(Circle { center_mm, radius_mm, grain, diameter_mm, clipped, area_mm2 });
    }

    /// Area of the circles inside the outline.
    pub fn aggregate_area_mm2(&self) -> f64 {
        self.circles.iter().map(|circle| circle.area_mm2).sum()
    }

    pub(super) fn report(&self) -> SliceReport {
        let (area_mm2, aggregate_area_mm2) = (self.outline.area_mm2(), self.aggregate_area_mm2());
        SliceReport {
            axis: self.axis,
            at_mm: self.at_mm,
            plane: self.axis.plane(),
            outline: self.outline,
            area_mm2,
            circle_count: self.circles.len() as u64,
            aggregate_area_mm2,
            area_fraction: aggregate_area_mm2 / area_mm2,
            image: None,
        }
    }
}

/// Whether a circle shares an area with a rectangle: its centre is closer to the rectangle than its radius.
fn reaches(center: [f64; 2], radius: f64, u: [f64; 2], v: [f64; 2]) -> bool {
    let outside = |x: f64, [low, high]: [f64; 2]| (low - x).max(x - high).max(0.0);
    outside(center[0], u).hypot(outside(center[1], v)) < radius
}
