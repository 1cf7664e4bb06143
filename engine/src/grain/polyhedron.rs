//! The convex polyhedron, sharp or rounded, as a grain: computed in the axes of its template (`geometry::convex`).

use std::sync::OnceLock;

use nalgebra::Vector3;

use super::below::TriangleSkin;
use super::figure::{Figure, Polygon};
use super::rows::PolygonRows;
use super::{Grain, Rows, Surface, VolumeBelow};
use crate::arrays::Each as _;
use crate::geometry::convex::{Convex, Lines, Place};
use crate::shape::{Polyhedron, Pose, ScaledPolyhedron};

/// A template with what is computed of it once.
#[derive(Debug)]
pub(super) struct Template<'a> {
    body: &'a Polyhedron,
    convex: Convex,
    skin: OnceLock<TriangleSkin>,
}

impl<'a> Template<'a> {
    pub(super) fn new(body: &'a Polyhedron) -> Self {
        Self { body, convex: Convex::new(body), skin: OnceLock::new() }
    }
}

/// What is computed once of a polyhedron in its place.
#[derive(Debug)]
pub(super) struct Placement {
    pub(super) template: u32,
    /// About its own centre.
    place: Place,
    /// The farther half of the extents.
    half_extents_mm: [f64; 3],
}

impl Placement {
    pub(super) fn new(template: u32, of: &Template<'_>, d_mm: f64, pose: &Pose) -> Self {
        let place = Place::new(d_mm, &Pose { center_mm: Vector3::zeros(), ..*pose });
        let half_extents_mm = [0, 1, 2].each(|axis| {
            let row = place.rotation.row(axis).transpose();
            let reaches = of.convex.vertices.iter().map(|vertex| row.dot(vertex).abs());
            place.scale * (reaches.fold(0.0, f64::max) + of.convex.rounding)
        });
        Self { template, place, half_extents_mm }
    }
}

/// A polyhedron in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedPolyhedron<'a> {
    pub(super) template: &'a Template<'a>,
    pub(super) placement: &'a Placement,
}

impl<'a> PlacedPolyhedron<'a> {
    fn convex(self) -> &'a Convex {
        &self.template.convex
    }

    fn place(self) -> &'a Place {
        &self.placement.place
    }
}

impl<'a> Grain<'a> for PlacedPolyhedron<'a> {
    fn volume_mm3(self) -> f64 {
        ScaledPolyhedron { template: self.template.body, scale_mm: self.place().scale }.volume_mm3()
    }

    fn outer_radius_mm(self) -> f64 {
        self.template.body.outer_radius() * self.place().scale
    }

    fn inner_radius_mm(self) -> f64 {
        self.template.body.inner_radius() * self.place().scale
    }

    fn half_extents_mm(self) -> [f64; 3] {
        self.placement.half_extents_mm
    }

    fn contains(self, at: &Vector3<f64>) -> bool {
        let outer = self.outer_radius_mm();
        at.norm_squared() < outer * outer && self.convex().distance(&self.place().turned_back(at)) < 0.0
    }

    fn distance_mm(self, at: &Vector3<f64>) -> f64 {
        self.place().scale * self.convex().distance(&self.place().turned_back(at))
    }

    fn normal(self, at: &Vector3<f64>) -> Vector3<f64> {
        self.place().rotation * self.convex().normal(&self.place().turned_back(at))
    }

    fn chord_mm(self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<[f64; 2]> {
        self.convex().chord(&self.place().turned_back(from), &self.place().turned_back(along))
    }

    fn reach_mm(self, along: &Vector3<f64>) -> f64 {
        let chord = self.convex().chord(&Vector3::zeros(), &self.place().turned_back(along));
        chord.map_or(0.0, |[_, leave]| leave * along.norm())
    }

    /// The slope of the surface towards the plane is left out: the distance is at most the one to the outline.
    fn to_outline_mm(self, at: &Vector3<f64>, _: &Vector3<f64>) -> f64 {
        -self.distance_mm(at)
    }

    fn section(self, axes: [usize; 3], height_mm: f64) -> Option<([f64; 2], Figure)> {
        let (middle, polygon) = Polygon::of_section(self.convex(), self.place(), axes, height_mm)?;
        Some((middle, Figure::Polygon(polygon)))
    }

    #[inline]
    fn rows<'l>(self, center_mm: [f64; 3], height_mm: f64, lines: &'l mut Lines, is_aimed: bool) -> Rows<'l>
    where
        'a: 'l,
    {
        let Place { rotation, scale, .. } = self.place();
        let step = |axis: usize| rotation.row(axis).transpose() / *scale;
        if !is_aimed {
            lines.aim(self.convex(), &step(0));
        }
        Rows::Polygon(PolygonRows {
            template: self.convex(),
            center: [center_mm[0], center_mm[1]],
            half_y: self.placement.half_extents_mm[1],
            above: step(2) * height_mm,
            across: step(1),
            lines,
        })
    }

    fn volume_below(self, axis: usize) -> VolumeBelow<'a> {
        let skin = || TriangleSkin::new(self.convex(), self.template.body.volume());
        let skin = self.template.skin.get_or_init(skin);
        VolumeBelow::of_polyhedron(skin, self.place(), axis, self.volume_mm3())
    }

    fn surface(self) -> Surface<'a> {
        if self.convex().rounding > 0.0 { Surface::Curved } else { Surface::Flat(FlatFaces(self)) }
    }
}

/// The flat faces of a polyhedron.
#[derive(Clone, Copy)]
pub(crate) struct FlatFaces<'a>(PlacedPolyhedron<'a>);

impl<'a> FlatFaces<'a> {
    /// The faces by their corners in mm from the centre, counter-clockwise as seen from outside.
    pub(crate) fn corners_mm(self) -> impl Iterator<Item = impl Iterator<Item = Vector3<f64>> + 'a> + 'a {
        let (convex, place) = (self.0.convex(), self.0.place());
        let corner = |vertex: &u32| place.rotation * convex.vertices[*vertex as usize] * place.scale;
        convex.faces.iter().map(move |face| face.iter().map(corner))
    }
}
