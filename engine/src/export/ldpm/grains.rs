//! Grains as the lattice sees them: how far they reach along a line, and how far points and walls are from them.

use nalgebra::{Matrix3, Vector3};

use crate::export::convex::{Convex, Place};
use crate::export::{ExportError, Model};
use crate::gap::ellipsoids::Body;
use crate::gap::linear::Symmetric;
use crate::gap::{polyhedra, walls};
use crate::memory::{OutOfMemory, collected};
use crate::packing::{Ellipsoids, GrainsRef, Polyhedra, Spheres};
use crate::request::Specimen;

/// The grains of a packing.
pub(super) enum Grains<'a> {
    Spheres(&'a Spheres),
    Ellipsoids { grains: &'a Ellipsoids, bodies: Vec<Body>, inverses: Vec<Matrix3<f64>> },
    Polyhedra { grains: &'a Polyhedra, templates: Vec<Convex>, bodies: Vec<polyhedra::Body<'a>> },
}

/// What the reach of grains along a line is computed from.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Reach {
    /// The radius, along every line.
    #[default]
    Radius,
    /// The inverse shape matrices `M` in 1/mm²: half of the chord along the unit vector `u` is `1 / sqrt(u · M u)`.
    Ellipsoids(Vec<Matrix3<f64>>),
    /// Templates, and the template and place of each grain.
    Polyhedra { templates: Vec<Convex>, grains: Vec<(u32, Place)> },
}

impl<'a> Grains<'a> {
    pub(super) fn new(model: &Model<'a>) -> Result<Self, ExportError> {
        match model.grains {
            GrainsRef::Spheres(spheres) => Ok(Self::Spheres(spheres)),
            GrainsRef::Ellipsoids(grains) => {
                let bodies = collected(grains.iter().map(|(shape, pose)| Body::new(shape, pose)))?;
                let inverses = collected(grains.iter().map(|(shape, pose)| {
                    let rotation = pose.rotation();
                    let inverse_squares = shape.semi_axes_mm().map(|axis| 1.0 / (axis * axis));
                    rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose()
                }))?;
                Ok(Self::Ellipsoids { grains, bodies, inverses })
            }
            GrainsRef::Polyhedra(grains) => {
                let body = |grain: usize| {
                    let shape = grains.shape(grain);
                    polyhedra::Body::new(shape.template, shape.scale_mm, &grains.poses[grain])
                };
                let bodies = collected((0..grains.len()).map(body))?;
                Ok(Self::Polyhedra { grains, templates: Convex::all(&grains.templates), bodies })
            }
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Spheres(spheres) => spheres.len(),
            Self::Ellipsoids { grains, .. } => grains.len(),
            Self::Polyhedra { grains, .. } => grains.len(),
        }
    }

    pub(super) fn center(&self, grain: usize) -> [f64; 3] {
        match self {
            Self::Spheres(spheres) => spheres.center(grain),
            Self::Ellipsoids { grains, .. } => grains.poses[grain].center_mm.into(),
            Self::Polyhedra { grains, .. } => grains.poses[grain].center_mm.into(),
        }
    }

    /// Equivalent diameter.
    pub(super) fn d_mm(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain],
            Self::Ellipsoids { grains, .. } => grains.shapes[grain].equivalent_diameter_mm(),
            Self::Polyhedra { grains, .. } => grains.d_mm[grain],
        }
    }

    /// Smallest equivalent diameter.
    pub(super) fn d_min_mm(&self) -> f64 {
        (0..self.len()).map(|grain| self.d_mm(grain)).fold(f64::INFINITY, f64::min)
    }

    /// Radius of the smallest sphere around the centre that holds the grain.
    pub(super) fn outer_mm(&self, grain: usize) -> f64 {
        match self {
            Self::Spheres(spheres) => spheres.d_mm[grain] / 2.0,
            Self::Ellipsoids { bodies, .. } => bodies[grain].outer_mm,
            Self::Polyhedra { bodies, .. } => bodies[grain].outer_mm,
        }
    }

    /// Distance of a point from the surface of a grain; inside, minus a distance that the surface is at least away.
    pub(super) fn beyond_mm(&self, grain: usize, p: [f64; 3]) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let from_center = Vector3::from(p) - Vector3::from(spheres.center(grain));
                from_center.norm() - spheres.d_mm[grain] / 2.0
            }
            Self::Ellipsoids { bodies, inverses, .. } => {
                let body = &bodies[grain];
                let from_center = Vector3::from(p) - Vector3::from(body.center_mm);
                let scale = from_center.dot(&(inverses[grain] * from_center)).sqrt();
                if scale <= 1.0 {
                    // The ellipsoid of this scale, widened by the difference of the shortest semi-axes, lies inside.
                    return body.inner_mm * (scale - 1.0);
                }
                // A ball about the point whose radius is taken off again.
                let radius = body.inner_mm;
                let square = radius * radius;
                let ball = Symmetric([square, 0.0, 0.0, square, 0.0, square]);
                let at_point = Body { center_mm: p, matrix_mm2: ball, outer_mm: radius, inner_mm: radius };
                let normal: [f64; 3] = (inverses[grain] * from_center).normalize().into();
                body.with(&at_point).gap_from(normal).gap_mm + radius
            }
            Self::Polyhedra { grains, templates, .. } => {
                let place = Place::new(grains, grain);
                place.scale * templates[grains.template[grain] as usize].distance(&place.local(&p.into()))
            }
        }
    }

    /// Distance of a grain from the walls.
    pub(super) fn wall_gap_mm(&self, grain: usize, specimen: &Specimen) -> f64 {
        match self {
            Self::Spheres(spheres) => {
                let clearance = specimen.clearance_reaching_all(spheres.center(grain), [0.0; 3]);
                clearance - spheres.d_mm[grain] / 2.0
            }
            Self::Ellipsoids { bodies, .. } => bodies[grain].wall_gap_mm(specimen),
            Self::Polyhedra { bodies, .. } => {
                let body = &bodies[grain];
                walls::wall_gap_mm(body.center_mm.into(), &body.turned, specimen)
            }
        }
    }

    /// Whether two grains overlap by more than a length.
    pub(super) fn overlap(&self, [one, other]: [usize; 2], slack_mm: f64) -> bool {
        match self {
            Self::Spheres(spheres) => {
                let [p, q] = [one, other].map(|grain| Vector3::from(spheres.center(grain)));
                (p - q).norm() < (spheres.d_mm[one] + spheres.d_mm[other]) / 2.0 - slack_mm
            }
            Self::Ellipsoids { bodies, .. } => {
                let pair = bodies[one].with(&bodies[other]);
                !pair.decide(0.0).is_apart && pair.gap().gap_mm < -slack_mm
            }
            Self::Polyhedra { bodies, .. } => {
                let pair = bodies[one].with(&bodies[other]);
                !pair.decide(0.0).is_apart && pair.contact().gap_mm < -slack_mm
            }
        }
    }

    /// What the reach along lines is computed from.
    pub(super) fn reach(&self) -> Result<Reach, OutOfMemory> {
        Ok(match self {
            Self::Spheres(_) => Reach::Radius,
            Self::Ellipsoids { inverses, .. } => Reach::Ellipsoids(crate::memory::copied(inverses)?),
            Self::Polyhedra { grains, templates, .. } => {
                let grains =
                    (0..grains.len()).map(|grain| (grains.template[grain], Place::new(grains, grain)));
                Reach::Polyhedra { templates: templates.clone(), grains: collected(grains)? }
            }
        })
    }
}

impl Reach {
    /// How far a grain of this radius reaches from its centre along a vector, which must not be zero.
    pub(super) fn along_mm(&self, grain: usize, radius_mm: f64, along: &Vector3<f64>) -> f64 {
        match self {
            Self::Radius => radius_mm,
            Self::Ellipsoids(inverses) => along.norm() / along.dot(&(inverses[grain] * along)).sqrt(),
            Self::Polyhedra { templates, grains } => {
                let (template, place) = &grains[grain];
                let direction = place.turned_back(along);
                let chord = templates[*template as usize].chord(&Vector3::zeros(), &direction);
                chord.map_or(0.0, |[_, leave]| leave * along.norm())
            }
        }
    }
}
