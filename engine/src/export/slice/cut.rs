//! The cut itself: its outline and the sections of the grains.

use super::{Axis, Figure, FigureKind, SliceReport};
use crate::arrays::Each as _;
use crate::domain::Outline;
use crate::export::Model;
use crate::geometry::images::Images;
use crate::grain::{Grain as _, PlacedGrains};
use crate::memory::OutOfMemory;

/// A grain's section.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// Centre, u and v, of a polygon its centroid; outside of the outline for some images in a periodic box.
    pub center_mm: [f64; 2],
    /// A circle, an ellipse or a polygon.
    pub figure: Figure,
    /// The grain it is cut from.
    pub grain: usize,
    /// That grain's diameter; of other grains than spheres that of the sphere of equal volume.
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
    /// What the sections are, by the kinds of the grains.
    pub kinds: Vec<FigureKind>,
    /// The sections, in the order of their grains.
    pub sections: Vec<Section>,
}

impl Cut {
    /// Cuts a packing where the plane meets its specimen, which [`super::check`] has seen to.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn new(model: &Model<'_>, axis: Axis, at_mm: f64) -> Result<Self, OutOfMemory> {
        let [u, v] = axis.plane().each(Axis::index);
        let domain = model.specimen.domain();
        let bounds = domain.bounds_mm;
        let periodic = domain.is_periodic();
        let mut cut = Self {
            axis,
            at_mm,
            outline: domain.outline(axis.index(), at_mm),
            periodic,
            lateral: domain.lateral().is_some() && axis != Axis::Z,
            kinds: FigureKind::of_grains(model.grains.kind()),
            sections: Vec::new(),
        };
        let grains = PlacedGrains::new(model.grains)?;
        let images = Images::new(model.specimen);
        for grain in 0..grains.len() {
            let (center, half) = (grains.center_mm(grain), grains.grain(grain).half_extents_mm());
            let steps = |axis: usize| images.steps(axis, center[axis], half[axis]).map(f64::from);
            for step in steps(axis.index()) {
                let height = at_mm - (center[axis.index()] + step * bounds[axis.index()]);
                let section = grains.grain(grain).section([u, v, axis.index()], height);
                let Some((aside, figure)) = section else {
                    continue;
                };
                for du in steps(u) {
                    for dv in steps(v) {
                        let moved = [center[u] + du * bounds[u], center[v] + dv * bounds[v]];
                        let center_mm = [moved[0] + aside[0], moved[1] + aside[1]];
                        cut.push(center_mm, figure.clone(), grain, grains.d_mm(grain));
                    }
                }
            }
        }
        Ok(cut)
    }

    fn push(&mut self, center_mm: [f64; 2], figure: Figure, grain: usize, diameter_mm: f64) {
        let mut area_mm2 = figure.area_mm2();
        let mut clipped = false;
        if self.periodic {
            let [u, v] = self.outline.bounds_mm();
            let extents = figure.extents_mm();
            let crosses = |i: usize, [low, high]: [f64; 2]| {
                center_mm[i] + extents[i][0] < low || center_mm[i] + extents[i][1] > high
            };
            clipped = crosses(0, u) || crosses(1, v);
            if clipped {
                if !figure.reaches(center_mm, u, v) {
                    return;
                }
                area_mm2 = figure.area_in(center_mm, u, v);
                if area_mm2 <= 0.0 {
                    return;
                }
            }
        }
        self.sections.push(Section { center_mm, figure, grain, diameter_mm, clipped, area_mm2 });
    }

    /// What sections are called.
    pub(super) fn noun(&self) -> &'static str {
        match self.kinds[..] {
            [kind] => kind.noun(),
            _ => "ellipses and polygons",
        }
    }

    /// The sections of a kind.
    pub(super) fn of_kind(&self, kind: FigureKind) -> impl Iterator<Item = &Section> {
        self.sections.iter().filter(move |section| section.figure.kind() == kind)
    }

    /// Area of the sections inside the outline.
    pub fn aggregate_area_mm2(&self) -> f64 {
        // The sum of no numbers is minus zero.
        self.sections.iter().map(|section| section.area_mm2).fold(0.0, |sum, area| sum + area)
    }

    pub(super) fn report(&self) -> SliceReport {
        let (area_mm2, aggregate_area_mm2) = (self.outline.area_mm2(), self.aggregate_area_mm2());
        let count = |kind: FigureKind| self.kinds.contains(&kind).then(|| self.of_kind(kind).count() as u64);
        SliceReport {
            axis: self.axis,
            at_mm: self.at_mm,
            plane: self.axis.plane(),
            outline: self.outline,
            area_mm2,
            circle_count: count(FigureKind::Circle).unwrap_or(0),
            ellipse_count: count(FigureKind::Ellipse),
            polygon_count: count(FigureKind::Polygon),
            aggregate_area_mm2,
            area_fraction: aggregate_area_mm2 / area_mm2,
            image: None,
            triangles: None,
        }
    }
}
