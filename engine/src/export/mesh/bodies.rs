//! Grains as surface meshes see them: spheres, or ellipsoids as affine images of the spheres of equal volume.
//!
//! The map `L = R diag(a, b, c) / r`, `r³ = a b c`, takes the sphere of the radius `r` to the ellipsoid and leaves
//! volumes as they are. A surface is made, refined and corrected on the sphere; its vertices are placed by `L`. Planes
//! stay planes, so that what is convex stays so, and a vertex that is moved outwards along its radius is so here and
//! there. Polyhedra are no images of spheres; their surfaces are made of their own faces, or of facets
//! around a rounded body (`polyhedron`, `rounded`).
//!
//! On the tangent plane with the unit normal `n` an ellipsoid with the shape matrix `A` and the support `h(n)` has the
//! curvatures of the form `h(n) w · A⁻¹ w`. Beside a point where two surfaces come closest, their gap grows with half
//! of the sum of both forms, and is below a value in an ellipse whose area follows from the determinant of that sum.

use std::f64::consts::PI;

use super::cache::SurfaceCache;
use super::size::Other;
use super::walls::{Wall, walls};
use crate::arrays::{self, Each as _};
use crate::elementary::hypot;
use crate::export::Model;
use crate::gap::ellipsoids::Body;
use crate::gap::linear::{Vector, cross, dot, norm, scaled, unit};
use crate::gap::solids;
use crate::geometry::convex::{Convex, Place};
use crate::memory::{OutOfMemory, collected};
use crate::packing::{GrainsRef, Spheres};
use crate::request::Specimen;
use crate::shape::{Ellipsoid, Pose, ScaledPolyhedron};

/// Share by which images are smaller, so that rounding brings no vertex out of its ellipsoid.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Length over thickness beyond which triangles are made on an ellipsoid itself.
pub(super) const STRETCHED: f64 = 2.2;

/// A packing to be meshed.
#[derive(Debug)]
pub(super) struct MeshModel<'a> {
    pub(super) specimen: &'a Specimen,
    pub(super) bodies: Bodies<'a>,
    /// No edge on the specimen is longer.
    pub(super) shell_most_mm: f64,
    /// Surfaces of templates that were made before.
    pub(super) surfaces: Option<&'a SurfaceCache>,
}

/// The grains of a packing.
#[derive(Debug)]
pub(super) struct Bodies<'a> {
    grains: GrainsRef<'a>,
    /// Of every grain, or of none where all are spheres.
    solids: Vec<solids::Body<'a>>,
    templates: Vec<Convex>,
}

/// A polyhedron of a packing.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedPolyhedron<'a> {
    pub(super) shape: ScaledPolyhedron<'a>,
    pub(super) pose: &'a Pose,
    /// Index of its template.
    pub(super) number: u32,
    pub(super) template: &'a Convex,
}

/// How a grain is an image of the sphere of equal volume about the origin.
#[derive(Clone, Copy, Debug)]
pub(super) enum Image {
    /// It is that sphere.
    Sphere,
    /// By the rows of the map.
    Ellipsoid {
        map: [Vector; 3],
        /// Square roots of the factors along the axes.
        roots: Vector,
        body: Body,
    },
}

/// A grain at a wall.
pub(super) struct AtWall {
    pub(super) wall: Wall,
    /// The point of the wall nearest to the grain.
    pub(super) foot: Vector,
    pub(super) gap: f64,
    /// From the grain to the wall, a unit vector.
    pub(super) toward: Vector,
    /// The point of the grain nearest to the wall, seen from its centre; only of polyhedra.
    pub(super) own: Option<Vector>,
}

/// How a grain lies against another one.
pub(super) struct Between {
    pub(super) gap: f64,
    /// From the grain to the other, a unit vector.
    pub(super) toward: Vector,
    /// The point of the grain nearest to the other, seen from its centre; only of polyhedra.
    pub(super) own: Option<Vector>,
}

/// How a surface lies against something at its nearest point.
pub(super) struct Contact {
    /// The gap grows by that times the square of the distance from that point; in the mean of all directions where
    /// they differ.
    pub(super) bend: f64,
    /// Factor by which the image lengthens edges there, in the direction where it does so most.
    pub(super) stretch: f64,
    /// The same over that in the direction across.
    pub(super) aspect: f64,
}

impl<'a> MeshModel<'a> {
    pub(super) fn new(model: &Model<'a>) -> Result<Self, OutOfMemory> {
        Ok(Self {
            specimen: model.specimen,
            bodies: Bodies::new(model.grains)?,
            shell_most_mm: f64::INFINITY,
            surfaces: model.surfaces,
        })
    }

    /// A grain's walls.
    pub(super) fn walls(&self, row: usize) -> impl Iterator<Item = AtWall> {
        let center = self.bodies.center(row);
        walls(self.specimen, center).into_iter().map(move |(wall, foot)| self.bodies.at_wall(row, wall, foot))
    }
}

impl<'a> Bodies<'a> {
    fn new(grains: GrainsRef<'a>) -> Result<Self, OutOfMemory> {
        let solids = match grains.solids() {
            None => Vec::new(),
            Some(solids) => collected(solids.iter().map(|(shape, pose)| solids::Body::new(shape, pose)))?,
        };
        Ok(Self { grains, solids, templates: Convex::all(grains.templates()) })
    }

    /// The spheres, where all are spheres.
    pub(super) fn spheres(&self) -> Option<&'a Spheres> {
        self.grains.spheres()
    }

    pub(super) fn len(&self) -> usize {
        self.grains.len()
    }

    pub(super) fn center(&self, row: usize) -> Vector {
        self.grains.center_mm(row)
    }

    /// Diameter of the sphere of equal volume.
    pub(super) fn diameter(&self, row: usize) -> f64 {
        self.grains.d_mm(row)
    }

    /// An ellipsoid and its body.
    pub(super) fn ellipsoid(&self, row: usize) -> Option<(&Ellipsoid, &Pose, &Body)> {
        let solids = self.grains.solids()?;
        Some((solids.shapes[row].ellipsoid()?, &solids.poses[row], self.solids[row].ellipsoid()?))
    }

    /// A polyhedron.
    pub(super) fn polyhedron(&self, row: usize) -> Option<PlacedPolyhedron<'_>> {
        let solids = self.grains.solids()?;
        let (shape, number) = (solids.shape(row).polyhedron()?, self.grains.template(row)?);
        let template = &self.templates[number as usize];
        Some(PlacedPolyhedron { shape, pose: &solids.poses[row], number, template })
    }

    /// The same of all grains.
    pub(super) fn diameters(&self) -> impl Iterator<Item = f64> {
        (0..self.len()).map(|row| self.diameter(row))
    }

    pub(super) fn volume_mm3(&self, row: usize) -> f64 {
        match self.grains.solids() {
            None => PI / 6.0 * self.diameter(row).powi(3),
            Some(solids) => solids.shape(row).volume_mm3(),
        }
    }

    /// Radius of the smallest sphere around a grain.
    pub(super) fn outer(&self, row: usize) -> f64 {
        self.solids.get(row).map_or_else(|| self.diameter(row) / 2.0, solids::Body::outer_mm)
    }

    /// How far along a wall at that gap a grain lies within a reach of it.
    pub(super) fn along(&self, row: usize, gap: f64, reach: f64) -> f64 {
        // No grain reaches beyond the ball of its largest radius of curvature that touches it from around.
        let flattest = match self.solids.get(row) {
            None => self.diameter(row) / 2.0,
            Some(solids::Body::Ellipsoid(body)) => body.outer_mm * (body.outer_mm / body.inner_mm),
            Some(solids::Body::Polyhedron(body)) => return 2.0 * body.outer_mm,
        };
        ((flattest + reach).powi(2) - (flattest + gap).powi(2)).max(0.0).sqrt()
    }

    /// Smallest distance of a grain from a lateral surface of that radius about an axis at the same distance from both
    /// other walls.
    pub(super) fn side_gap(&self, row: usize, radius: f64) -> f64 {
        if let Some((_, _, body)) = self.ellipsoid(row) {
            return radius - body.reach_from_axis_mm([radius; 2]);
        }
        if let Some(polyhedron) = self.polyhedron(row) {
            return radius - polyhedron.reach_from_axis([radius; 2]).0;
        }
        let [x, y, _] = self.center(row);
        radius - hypot(x - radius, y - radius) - self.diameter(row) / 2.0
    }

    /// Square root of the surface over that of the sphere of equal volume: edges are longer by that in the mean.
    pub(super) fn mean_stretch(&self, row: usize) -> f64 {
        self.ellipsoid(row).map_or(1.0, |(shape, ..)| shape.sphericity().sqrt().recip())
    }

    /// Factor by which the image lengthens edges at most.
    pub(super) fn most_stretch(&self, row: usize) -> f64 {
        self.ellipsoid(row).map_or(1.0, |(_, _, body)| 2.0 * body.outer_mm / self.diameter(row))
    }

    /// A grain as something faced, seen from a point.
    pub(super) fn other(&self, row: usize, from: Vector) -> Other<'_> {
        let at = self.center(row);
        let center: Vector = arrays::from_fn(|a| at[a] - from[a]);
        if let Some((shape, pose, _)) = self.ellipsoid(row) {
            let rotation = pose.rotation();
            let axes = [0, 1, 2].each(|k| rotation.column(k).into_owned().into());
            return Other::Ellipsoid { center, axes, semi_axes: shape.semi_axes_mm().into() };
        }
        if let Some(PlacedPolyhedron { template, shape, pose, .. }) = self.polyhedron(row) {
            let place = Place { center: center.into(), ..Place::new(shape.scale_mm, pose) };
            return Other::Polyhedron(template, place);
        }
        Other::Sphere { center, radius: self.diameter(row) / 2.0 }
    }

    /// The gap to another grain and the unit vector towards it, given the gap of the spheres around both. Both grains
    /// of a pair get the same numbers.
    pub(super) fn facing(&self, row: usize, other: usize, of_spheres: f64) -> Between {
        let Some(body) = self.solids.get(row) else {
            let (center, theirs) = (self.center(row), self.center(other));
            let toward = unit(arrays::from_fn(|a| theirs[a] - center[a]));
            return Between { gap: of_spheres, toward, own: None };
        };
        let contact = self.solids[row.min(other)].contact(&self.solids[row.max(other)]);
        let (toward, own) = if row < other {
            (contact.normal, contact.points_mm[0])
        } else {
            (-contact.normal, contact.points_mm[1])
        };
        let own = body.ellipsoid().is_none().then(|| own.into());
        Between { gap: contact.gap_mm, toward: toward.into(), own }
    }

    /// A grain at a wall, given the point of that nearest to its centre.
    fn at_wall(&self, row: usize, wall: Wall, foot: Vector) -> AtWall {
        let center = self.center(row);
        if let Some(polyhedron) = self.polyhedron(row) {
            return polyhedron.at_wall(wall);
        }
        let Some((_, _, body)) = self.ellipsoid(row) else {
            let toward = unit(arrays::from_fn(|a| foot[a] - center[a]));
            let gap = wall.gap(center) - self.diameter(row) / 2.0;
            return AtWall { wall, foot, gap, toward, own: None };
        };
        let (mut toward, mut gap) = ([0.0; 3], 0.0);
        if let Other::Plane(axis, at) = wall.0 {
            toward[axis] = if at > center[axis] { 1.0 } else { -1.0 };
            gap = wall.gap(center) - body.support_mm(toward);
        } else if let Other::Lateral { axis, radius } = wall.0 {
            toward = body.reach_direction(axis);
            gap = radius - body.reach_from_axis_mm(axis);
        }
        let own = own_point(body, toward);
        let mut foot: Vector = arrays::from_fn(|a| center[a] + own[a]);
        match wall.0 {
            Other::Plane(axis, at) => foot[axis] = at,
            Other::Lateral { axis, radius } => {
                foot[0] = axis[0] + radius * toward[0];
                foot[1] = axis[1] + radius * toward[1];
            }
            Other::Sphere { .. } | Other::Ellipsoid { .. } | Other::Polyhedron(..) => {}
        }
        AtWall { wall, foot, gap, toward, own: None }
    }

    /// How a grain is an image of a sphere, where it is one.
    pub(super) fn image(&self, row: usize) -> Image {
        let Some((shape, pose, body)) = self.ellipsoid(row) else { return Image::Sphere };
        let rotation = pose.rotation();
        let axes = shape.semi_axes_mm() * (2.0 / self.diameter(row) * (1.0 - ROUNDING));
        let map = [0, 1, 2].each(|i| [0, 1, 2].each(|k| rotation[(i, k)] * axes[k]));
        Image::Ellipsoid { map, roots: axes.map(f64::sqrt).into(), body: *body }
    }

    /// How a grain lies against another one, or a wall that is taken as flat, in that direction.
    pub(super) fn contact(&self, row: usize, other: Option<usize>, toward: Vector) -> Contact {
        let Some((shape, pose, body)) = self.ellipsoid(row) else {
            let bend = if let Some(body) = self.solids.get(row) {
                1.0 / body.outer_mm()
            } else {
                let curvature = |row: usize| 1.0 / (self.diameter(row) / 2.0);
                (curvature(row) + other.map_or(0.0, curvature)) / 2.0
            };
            return Contact { bend, stretch: 1.0, aspect: 1.0 };
        };
        let (u, v) = across(toward);
        let form = |body: &Body| {
            let h = body.support_mm(toward);
            let (m_u, m_v) = (body.matrix_mm2.solve(u), body.matrix_mm2.solve(v));
            [h * dot(u, m_u), h * dot(u, m_v), h * dot(v, m_v)]
        };
        let theirs = other.and_then(|other| self.ellipsoid(other)).map_or([0.0; 3], |(.., body)| form(body));
        let own = form(body);
        let [uu, uv, vv] = arrays::from_fn(|i| own[i] + theirs[i]);
        // The tangent plane of the sphere at the point that is mapped to the nearest one, and its image.
        let axes: Vector = shape.semi_axes_mm().into();
        let rotation = pose.rotation();
        let local: Vector = [0, 1, 2].each(|k| (0..3).map(|i| rotation[(i, k)] * toward[i]).sum());
        let times_axes = |p: Vector| [0, 1, 2].each(|k| p[k] * axes[k]);
        let (p, q) = across(unit(times_axes(local)));
        let per_radius = 2.0 / self.diameter(row);
        let (p, q) = (scaled(times_axes(p), per_radius), scaled(times_axes(q), per_radius));
        let (pp, pq, qq) = (dot(p, p), dot(p, q), dot(q, q));
        let root = hypot((pp - qq) / 2.0, pq);
        let (larger, smaller) = ((pp + qq) / 2.0 + root, (pp + qq) / 2.0 - root);
        Contact {
            bend: (uu * vv - uv * uv).max(0.0).sqrt() / 2.0,
            stretch: larger.sqrt(),
            aspect: (larger / smaller).sqrt(),
        }
    }
}

impl PlacedPolyhedron<'_> {
    fn vertices(&self) -> impl Iterator<Item = nalgebra::Vector3<f64>> {
        self.shape.template.world_vertices_mm(self.shape.scale_mm, self.pose)
    }

    fn rounding(&self) -> f64 {
        self.shape.scale_mm * self.shape.template.rounding()
    }

    /// Distance of the farthest point from an axis along z, and the direction of that point.
    pub(super) fn reach_from_axis(&self, axis: [f64; 2]) -> (f64, Vector) {
        let mut farthest = (0.0, [1.0, 0.0, 0.0]);
        for vertex in self.vertices() {
            let (x, y) = (vertex.x - axis[0], vertex.y - axis[1]);
            let distance = hypot(x, y);
            if distance > farthest.0 {
                farthest = (distance, [x / distance, y / distance, 0.0]);
            }
        }
        (farthest.0 + self.rounding(), farthest.1)
    }

    /// The polyhedron at a wall; its nearest point is that of a vertex.
    fn at_wall(&self, wall: Wall) -> AtWall {
        let center: Vector = self.pose.center_mm.into();
        let mut toward = [0.0; 3];
        let mut gap = None;
        if let Other::Plane(axis, at) = wall.0 {
            toward[axis] = if at > center[axis] { 1.0 } else { -1.0 };
        } else if let Other::Lateral { axis, radius } = wall.0 {
            let (reach, direction) = self.reach_from_axis(axis);
            toward = direction;
            gap = Some(radius - reach);
        }
        let mut own = [0.0; 3];
        let rounding = self.rounding();
        let mut farthest = f64::NEG_INFINITY;
        for vertex in self.vertices() {
            let from_center: Vector = (vertex - self.pose.center_mm).into();
            if dot(from_center, toward) > farthest {
                farthest = dot(from_center, toward);
                own = arrays::from_fn(|a| from_center[a] + rounding * toward[a]);
            }
        }
        let gap = gap.unwrap_or_else(|| wall.gap(center) - dot(own, toward));
        let foot = arrays::from_fn(|a| center[a] + own[a] + gap * toward[a]);
        AtWall { wall, foot, gap, toward, own: Some(own) }
    }
}

impl Image {
    /// Where on the unit sphere a vertex of its polyhedron belongs.
    ///
    /// Convex polyhedra want the triangles equilateral on the sphere, tetrahedra want them so on the ellipsoid; where
    /// the map stretches by more than the square root of 3, an edge that the one wants is one that the other does not.
    /// Half of the stretch is taken back before, so that neither sees more than the square root of it. Without, Gmsh
    /// left 91 tetrahedra with a gamma below 0.1 in 45 ellipsoids with axes as 9 : 6 : 4, with it none.
    pub(super) fn balanced(&self, p: Vector) -> Vector {
        match self {
            Self::Sphere => p,
            Self::Ellipsoid { roots, .. } => unit(arrays::from_fn(|k| p[k] / roots[k])),
        }
    }

    /// Whether vertices are moved by that.
    pub(super) fn is_balanced(&self) -> bool {
        matches!(self, Self::Ellipsoid { .. })
    }

    /// Whether it is stretched by so much that triangles are made on the ellipsoid itself: no edge need be the one that
    /// both the sphere and the ellipsoid want.
    pub(super) fn is_stretched(&self) -> bool {
        match self {
            Self::Sphere => false,
            Self::Ellipsoid { roots, .. } => {
                let most = roots.iter().copied().fold(0.0, f64::max);
                let least = roots.iter().copied().fold(f64::INFINITY, f64::min);
                most * most > STRETCHED * least * least
            }
        }
    }

    /// Semi-axes of the image of a sphere of that radius.
    pub(super) fn semi_axes(&self, radius: f64) -> Vector {
        match self {
            Self::Sphere => [radius; 3],
            Self::Ellipsoid { roots, .. } => roots.each(|root| root * root * radius),
        }
    }

    /// The point that is mapped to a point.
    pub(super) fn back(&self, p: Vector) -> Vector {
        match self {
            Self::Sphere => p,
            Self::Ellipsoid { map, roots, .. } => [0, 1, 2].each(|k| {
                let along: f64 = (0..3).map(|i| map[i][k] * p[i]).sum();
                along / roots[k].powi(4)
            }),
        }
    }

    /// Where a vertex of the sphere lies.
    pub(super) fn place(&self, p: Vector) -> Vector {
        match self {
            Self::Sphere => p,
            Self::Ellipsoid { map, .. } => map.each(|row| dot(row, p)),
        }
    }

    /// How far the image of the sphere of that radius reaches along a unit vector.
    pub(super) fn support(&self, toward: Vector, radius: f64) -> f64 {
        match self {
            Self::Sphere => radius,
            Self::Ellipsoid { body, .. } => body.support_mm(toward),
        }
    }

    /// The point of the image that reaches farthest along a unit vector.
    pub(super) fn point(&self, toward: Vector, radius: f64) -> Vector {
        match self {
            Self::Sphere => toward.each(|x| x * radius),
            Self::Ellipsoid { body, .. } => own_point(body, toward),
        }
    }

    /// Distance of a placed vertex from the centre, over that radius.
    pub(super) fn stretch(&self, placed: Vector, radius: f64) -> f64 {
        match self {
            Self::Sphere => 1.0,
            Self::Ellipsoid { .. } => norm(placed) / radius,
        }
    }
}

/// The point of an ellipsoid about its centre whose normal is that unit vector.
fn own_point(body: &Body, normal: Vector) -> Vector {
    scaled(body.matrix_mm2.times(normal), 1.0 / body.support_mm(normal))
}

/// Two unit vectors across a unit vector and each other.
fn across(n: Vector) -> (Vector, Vector) {
    let axis = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let u = unit(cross(n, axis));
    (u, cross(n, u))
}
