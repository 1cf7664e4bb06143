//! The check of shaped grains, and its certificates.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::f64::consts::PI;
use std::num::NonZeroUsize;

use super::convex::{Body, MixedBody};
use super::grading::{self, SIZE_ERROR, Sizes};
use super::packing::Packing;
use super::region::SpecimenRegion;
use super::required::Required;
use super::walk::Walk;
use super::{
    Check, Extent, Fault, Inspection, Pairs, SIEVE_ERROR, Scope, SeparationCertificate, SieveSizes, body,
    spheres,
};
use crate::control::Control;
use crate::elementary::cbrt;
use crate::memory::{OutOfMemory, collected, reserved};
use crate::packing::{GrainsRef, Solids};
use crate::request::{Distance, PackingRequest, Specimen};
use crate::shape::{self, Ellipsoid, Pose, SizeMeasure, SolidRef};

/// Checks what the scope names.
pub(super) fn judge(
    solids: &Solids,
    (request, extent): (&PackingRequest, Extent),
    scope: Scope,
    sieve_sizes: &SieveSizes,
    walk: &Walk<'_>,
) -> Result<Inspection, Fault> {
    let shapes = shapes_of(solids)?;
    let grains = (&*shapes, &*solids.poses, &*solids.aggregate);
    judge_shapes(grains, (request, extent), (request.mix.size, sieve_sizes), scope, walk)
}

fn shapes_of(solids: &Solids) -> Result<Vec<SolidRef<'_>>, Fault> {
    let mut shapes = reserved(solids.len())?;
    for (grain, shape) in solids.shapes.iter().enumerate() {
        shapes.push(shape.of(&solids.templates).ok_or(Fault::NotABody { grain })?);
    }
    Ok(shapes)
}

/// Checks a packing of ellipsoids and convex polyhedra against its request. Shape and pose of a grain have the same
/// index.
///
/// `size` is what the grading measures. The sieve size of each template is proven once; grains share a template where
/// they refer to the same one.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_shapes(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    request: &PackingRequest,
    size: SizeMeasure,
    control: &dyn Control,
) -> Result<Check, Fault> {
    let walk = &Walk { threads: NonZeroUsize::MIN, control };
    let conditions = (request, Extent::WHOLE);
    judge_shapes((shapes, poses, &[]), conditions, (size, &SieveSizes::default()), Scope::All, walk)?.grading
}

/// Checks shapes at their poses with the aggregate of each, none where the mix names none.
fn judge_shapes(
    (shapes, poses, aggregate): (&[SolidRef<'_>], &[Pose], &[u16]),
    (request, extent): (&PackingRequest, Extent),
    (size, sieve_sizes): (SizeMeasure, &SieveSizes),
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Inspection, Fault> {
    let region = (request.distance, SpecimenRegion::new(&request.specimen));
    // Pairs of ellipsoids are worth a loop of their own.
    if let Some(ellipsoids) = ellipsoids_of(shapes)? {
        let packing = ellipsoid_bodies(&ellipsoids, poses, region)?;
        let sizes = collected(ellipsoids.iter().map(|shape| ellipsoid_size(shape, size)))?;
        let sizes =
            Sizes { grains: sizes.len(), of: &|row| sizes[row], error: &|_| SIZE_ERROR, give_volumes: false };
        return judge_bodies(&packing, (sizes, aggregate), (request, extent), scope, walk);
    }
    let packing = bodies(shapes, poses, region)?;
    let mut of_templates: BTreeMap<*const shape::Polyhedron, f64> = BTreeMap::new();
    let mut sizes = reserved(shapes.len())?;
    for (body, shape) in packing.bodies().iter().zip(shapes) {
        sizes.push(match (shape, size) {
            (SolidRef::Ellipsoid(ellipsoid), _) => ellipsoid_size(ellipsoid, size),
            (SolidRef::Polyhedron(_), SizeMeasure::Equivalent) => {
                (body.equivalent_diameter(), body.own_volume())
            }
            (SolidRef::Polyhedron(shape), SizeMeasure::Sieve) => {
                let of_template = match of_templates.entry(std::ptr::from_ref(shape.template)) {
                    Entry::Occupied(known) => *known.get(),
                    Entry::Vacant(place) => *place.insert(sieve_sizes.proven(shape.template)?),
                };
                (of_template * shape.scale_mm, body.own_volume())
            }
        });
    }
    let error = |grain: usize| match (&shapes[grain], size) {
        // The size that was sampled follows from the one that was found, which may differ from the proven one.
        (SolidRef::Polyhedron(_), SizeMeasure::Sieve) => 2.0 * SIEVE_ERROR,
        _ => SIZE_ERROR,
    };
    let sizes = Sizes { grains: sizes.len(), of: &|row| sizes[row], error: &error, give_volumes: false };
    judge_bodies(&packing, (sizes, aggregate), (request, extent), scope, walk)
}

/// Checks all pairs of a packing of ellipsoids and convex polyhedra and returns a direction for each whose gap is less
/// than `closer_than_mm`, in the order of their rows.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`]. The grading is not looked at.
pub fn certify_shapes(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    request: &PackingRequest,
    closer_than_mm: f64,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    let region = (request.distance, SpecimenRegion::new(&request.specimen));
    certificates(shapes, poses, region, closer_than_mm, &Walk { threads: NonZeroUsize::MIN, control })
}

/// Checks on several threads that grains keep the gaps of a rule, and returns a direction for each pair, and for each
/// grain and wall, whose gap is less than `closer_than_mm`, in the order of the rows. Directions of spheres are those
/// of ellipsoids with equal axes.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn certify(
    grains: GrainsRef<'_>,
    (distance, specimen): (Distance, Specimen),
    closer_than_mm: f64,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    let walk = &Walk { threads, control };
    match grains {
        GrainsRef::Spheres(spheres) => {
            let required = Required::new(distance, SpecimenRegion::new(&specimen));
            spheres::judge_gaps(spheres, &required, walk)?;
            let body = |i: usize| {
                let shape = Ellipsoid::new([spheres.d_mm[i] / 2.0; 3])?;
                body::Ellipsoid::new(&shape, &Pose::at(spheres.center(i).into()))
            };
            // The gaps are checked already, as those of spheres.
            let region = (Distance::None { wall_gap_mm: None }, SpecimenRegion::new(&specimen));
            let mut found = Packing::new(spheres.len(), body, region)?.certificates(closer_than_mm, walk)?;
            for certificate in &mut found {
                let d = spheres.d_mm[certificate.first];
                certificate.required_mm = match certificate.second {
                    Some(second) => required.gap_mm(d, spheres.d_mm[second]),
                    None => required.wall_gap_mm(d),
                };
            }
            Ok(found)
        }
        GrainsRef::Solids(solids) => {
            let region = (distance, SpecimenRegion::new(&specimen));
            certificates(&shapes_of(solids)?, &solids.poses, region, closer_than_mm, walk)
        }
    }
}

fn certificates(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    region: (Distance, SpecimenRegion),
    closer_than_mm: f64,
    walk: &Walk<'_>,
) -> Result<Vec<SeparationCertificate>, Fault> {
    if let Some(ellipsoids) = ellipsoids_of(shapes)? {
        let packing = ellipsoid_bodies(&ellipsoids, poses, region)?;
        packing.check_walls()?;
        return packing.certificates(closer_than_mm, walk);
    }
    let packing = bodies(shapes, poses, region)?;
    packing.check_walls()?;
    packing.certificates(closer_than_mm, walk)
}

/// The ellipsoids, where all are.
fn ellipsoids_of(shapes: &[SolidRef<'_>]) -> Result<Option<Vec<Ellipsoid>>, OutOfMemory> {
    if shapes.iter().any(|shape| shape.ellipsoid().is_none()) {
        return Ok(None);
    }
    let mut ellipsoids = reserved(shapes.len())?;
    ellipsoids.extend(shapes.iter().filter_map(SolidRef::ellipsoid));
    Ok(Some(ellipsoids))
}

fn ellipsoid_bodies(
    shapes: &[Ellipsoid],
    poses: &[Pose],
    region: (Distance, SpecimenRegion),
) -> Result<Packing<body::Ellipsoid>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| body::Ellipsoid::new(&shapes[i], &poses[i]), region)
}

fn bodies<'a>(
    shapes: &[SolidRef<'a>],
    poses: &[Pose],
    region: (Distance, SpecimenRegion),
) -> Result<Packing<MixedBody<'a>>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| MixedBody::new(&shapes[i], &poses[i]), region)
}

/// Checks the walls, all pairs, and the grading of grains.
fn judge_bodies<B: Body<SpecimenRegion>>(
    packing: &Packing<B>,
    (sizes, aggregate): (Sizes<'_>, &[u16]),
    (request, extent): (&PackingRequest, Extent),
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Inspection, Fault> {
    let wall = packing.check_walls()?;
    let pairs = match scope {
        Scope::All => packing.check_pairs(walk)?,
        Scope::WithoutPairs => Pairs::default(),
    };
    Ok(Inspection::new(wall, &pairs, grading::check(sizes, aggregate, request, extent)))
}

/// Size and volume of an ellipsoid.
fn ellipsoid_size(shape: &Ellipsoid, size: SizeMeasure) -> (f64, f64) {
    let [a, b, c]: [f64; 3] = shape.semi_axes_mm().into();
    let size = match size {
        // The narrowest passage is along the longest axis, the ellipse (b, c) turned by 45 degrees in the square.
        SizeMeasure::Sieve => (2.0 * (b * b + c * c)).sqrt(),
        SizeMeasure::Equivalent => 2.0 * cbrt(a * b * c),
    };
    (size, 4.0 / 3.0 * PI * a * b * c)
}
