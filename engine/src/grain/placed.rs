//! The kinds of grains, and the grains of a packing in their places.

use nalgebra::Vector3;

use super::ellipsoid::{Matrices, PlacedEllipsoid};
use super::figure::Figure;
use super::polyhedron::{PlacedPolyhedron, Placement, Template};
use super::sphere::Sphere;
use super::{Grain, RowLines, Rows, Surface, VolumeBelow};
use crate::arrays::Each as _;
use crate::gap::solids::Body;
use crate::geometry::convex::Lines;
use crate::memory::{OutOfMemory, collected};
use crate::packing::GrainsRef;
use crate::request::Specimen;
use crate::shape::{Ellipsoid, Solid};

/// A grain of any kind in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PlacedGrain<'a> {
    Sphere(Sphere),
    Ellipsoid(PlacedEllipsoid<'a>),
    Polyhedron(PlacedPolyhedron<'a>),
}

/// Asks a grain of any kind.
macro_rules! ask {
    ($grain:expr, $of:ident => $answer:expr) => {
        match $grain {
            PlacedGrain::Sphere($of) => $answer,
            PlacedGrain::Ellipsoid($of) => $answer,
            PlacedGrain::Polyhedron($of) => $answer,
        }
    };
}

impl<'a> Grain<'a> for PlacedGrain<'a> {
    fn volume_mm3(self) -> f64 {
        ask!(self, grain => grain.volume_mm3())
    }

    fn outer_radius_mm(self) -> f64 {
        ask!(self, grain => grain.outer_radius_mm())
    }

    fn inner_radius_mm(self) -> f64 {
        ask!(self, grain => grain.inner_radius_mm())
    }

    fn half_extents_mm(self) -> [f64; 3] {
        ask!(self, grain => grain.half_extents_mm())
    }

    fn contains(self, at: &Vector3<f64>) -> bool {
        ask!(self, grain => grain.contains(at))
    }

    fn distance_mm(self, at: &Vector3<f64>) -> f64 {
        ask!(self, grain => grain.distance_mm(at))
    }

    fn normal(self, at: &Vector3<f64>) -> Vector3<f64> {
        ask!(self, grain => grain.normal(at))
    }

    fn chord_mm(self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<[f64; 2]> {
        ask!(self, grain => grain.chord_mm(from, along))
    }

    fn reach_mm(self, along: &Vector3<f64>) -> f64 {
        ask!(self, grain => grain.reach_mm(along))
    }

    fn to_outline_mm(self, at: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        ask!(self, grain => grain.to_outline_mm(at, normal))
    }

    fn section(self, axes: [usize; 3], height_mm: f64) -> Option<([f64; 2], Figure)> {
        ask!(self, grain => grain.section(axes, height_mm))
    }

    #[inline]
    fn rows<'l>(self, center_mm: [f64; 3], height_mm: f64, lines: &'l mut Lines, is_aimed: bool) -> Rows<'l>
    where
        'a: 'l,
    {
        ask!(self, grain => grain.rows(center_mm, height_mm, lines, is_aimed))
    }

    fn volume_below(self, axis: usize) -> VolumeBelow<'a> {
        ask!(self, grain => grain.volume_below(axis))
    }

    fn surface(self) -> Surface<'a> {
        ask!(self, grain => grain.surface())
    }
}

/// What is computed once of a shaped grain.
#[derive(Debug)]
enum Computed<'a> {
    Ellipsoid(&'a Ellipsoid, Matrices),
    Polyhedron(Placement),
}

/// The grains of a packing in their places.
#[derive(Debug)]
pub(crate) struct PlacedGrains<'a> {
    grains: GrainsRef<'a>,
    templates: Vec<Template<'a>>,
    /// Of every grain, or of none where all are spheres.
    computed: Vec<Computed<'a>>,
}

impl<'a> PlacedGrains<'a> {
    /// The grains of a packing. Takes 152 bytes a shaped grain.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn new(grains: impl Into<GrainsRef<'a>>) -> Result<Self, OutOfMemory> {
        let grains = grains.into();
        let templates: Vec<_> = grains.templates().iter().map(Template::new).collect();
        let computed = match grains {
            GrainsRef::Spheres(_) => Vec::new(),
            GrainsRef::Solids(solids) => {
                collected(solids.shapes.iter().zip(&solids.poses).map(|(shape, pose)| match shape {
                    Solid::Ellipsoid(shape) => Computed::Ellipsoid(shape, Matrices::new(shape, pose)),
                    Solid::Polyhedron { template, d_mm } => {
                        let of = &templates[*template as usize];
                        Computed::Polyhedron(Placement::new(*template, of, *d_mm, pose))
                    }
                }))?
            }
        };
        Ok(Self { grains, templates, computed })
    }

    /// Number of grains.
    pub(crate) fn len(&self) -> usize {
        self.grains.len()
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Centre of a grain in mm.
    pub(crate) fn center_mm(&self, grain: usize) -> [f64; 3] {
        self.grains.center_mm(grain)
    }

    /// Diameter of the sphere of equal volume in mm.
    pub(crate) fn d_mm(&self, grain: usize) -> f64 {
        self.grains.d_mm(grain)
    }

    /// The least of these diameters.
    pub(crate) fn d_min_mm(&self) -> f64 {
        self.grains.diameters_mm().fold(f64::INFINITY, f64::min)
    }

    /// A grain.
    #[inline]
    pub(crate) fn grain(&self, grain: usize) -> PlacedGrain<'_> {
        match self.grains {
            GrainsRef::Spheres(spheres) => {
                PlacedGrain::Sphere(Sphere { radius_mm: spheres.d_mm[grain] / 2.0 })
            }
            GrainsRef::Solids(_) => match &self.computed[grain] {
                Computed::Ellipsoid(shape, matrices) => {
                    PlacedGrain::Ellipsoid(PlacedEllipsoid { shape, matrices })
                }
                Computed::Polyhedron(placement) => {
                    let template = &self.templates[placement.template as usize];
                    PlacedGrain::Polyhedron(PlacedPolyhedron { template, placement })
                }
            },
        }
    }

    /// The section of a grain that is moved to a centre, at a height above it, as rows along x.
    #[inline]
    pub(crate) fn rows<'l>(
        &'l self,
        grain: usize,
        center_mm: [f64; 3],
        height_mm: f64,
        scratch: &'l mut RowLines,
    ) -> Rows<'l> {
        let is_aimed = scratch.grain.replace(grain) == Some(grain);
        self.grain(grain).rows(center_mm, height_mm, &mut scratch.lines, is_aimed)
    }

    /// Whether two grains overlap by more than a length.
    pub(crate) fn overlap(&self, pair: [usize; 2], slack_mm: f64) -> bool {
        match self.grains {
            GrainsRef::Spheres(spheres) => {
                let [p, q] = pair.each(|grain| Vector3::from(spheres.center(grain)));
                (p - q).norm() < (spheres.d_mm[pair[0]] + spheres.d_mm[pair[1]]) / 2.0 - slack_mm
            }
            GrainsRef::Solids(solids) => {
                let [one, other] = pair.map(|grain| Body::new(solids.shape(grain), &solids.poses[grain]));
                !one.is_apart(&other, 0.0) && one.contact(&other).gap_mm < -slack_mm
            }
        }
    }

    /// Distance of a grain from the walls; infinite without walls.
    pub(crate) fn wall_gap_mm(&self, grain: usize, specimen: &Specimen) -> f64 {
        match self.grains {
            GrainsRef::Spheres(spheres) => {
                let clearance = specimen.clearance_reaching_all(spheres.center(grain), [0.0; 3]);
                clearance - spheres.d_mm[grain] / 2.0
            }
            GrainsRef::Solids(solids) => {
                Body::new(solids.shape(grain), &solids.poses[grain]).wall_gap_mm(specimen)
            }
        }
    }
}
