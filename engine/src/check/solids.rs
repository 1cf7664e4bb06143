//! The check of grains that are no spheres, and its certificates.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::num::NonZeroUsize;

use super::convex::{Body, Convex};
use super::grading::{self, Grains, SIEVE_ERROR, SIZE_ERROR};
use super::packing::Packing;
use super::walk::Walk;
use super::{Check, Extent, Fault, Pairs, Scope, SeparationCertificate, body, sieve};
use crate::control::Control;
use crate::elementary::cbrt;
use crate::memory::{OutOfMemory, collected, reserved};
use crate::packing::{GrainsRef, Solids};
use crate::request::{Distance, PackingRequest, Specimen};
use crate::shape::{self, Ellipsoid, Pose, SizeMeasure, SolidRef};

/// Checks a packing of grains that are no spheres against its request, by the sizes of its mix, on so many threads.
/// What is found does not depend on the threads.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn check_solids(
    solids: &Solids,
    request: &PackingRequest,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Check, Fault> {
    judge(solids, request, Extent::WHOLE, Scope::All, &Walk { threads, control })
}

/// Checks what the scope names.
pub(super) fn judge(
    solids: &Solids,
    request: &PackingRequest,
    extent: Extent,
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Check, Fault> {
    let shapes = shapes_of(solids)?;
    let grains = (&*shapes, &*solids.poses, &*solids.aggregate);
    judge_shapes(grains, (request, extent), request.mix.size, scope, walk)
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
/// `size` is what the grading measures. The sieve size of each template is measured once, by a search of the check's
/// own that finds it to 1e-5; grains share a template where they refer to the same one.
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
    judge_shapes((shapes, poses, &[]), (request, Extent::WHOLE), size, Scope::All, walk)
}

/// Checks shapes at their poses with the aggregate of each, none where the mix names none.
fn judge_shapes(
    (shapes, poses, aggregate): (&[SolidRef<'_>], &[Pose], &[u16]),
    (request, extent): (&PackingRequest, Extent),
    size: SizeMeasure,
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Check, Fault> {
    let region = (request.distance, request.specimen);
    // Pairs of ellipsoids are worth a loop of their own.
    if let Some(ellipsoids) = ellipsoids_of(shapes)? {
        let packing = ellipsoid_bodies(&ellipsoids, poses, region)?;
        let sizes = collected(ellipsoids.iter().map(|shape| ellipsoid_size(shape, size)))?;
        let grains = Grains::Bodies { sizes: &sizes, error: &|_| SIZE_ERROR };
        return check_bodies(&packing, (grains, aggregate), (request, extent), scope, walk);
    }
    let packing = bodies(shapes, poses, region)?;
    let mut sieves: BTreeMap<*const shape::Polyhedron, f64> = BTreeMap::new();
    let sizes = packing.bodies().iter().zip(shapes).map(|(body, shape)| match (shape, size) {
        (SolidRef::Ellipsoid(ellipsoid), _) => ellipsoid_size(ellipsoid, size),
        (SolidRef::Polyhedron(_), SizeMeasure::Equivalent) => (body.equivalent_diameter(), body.own_volume()),
        (SolidRef::Polyhedron(shape), SizeMeasure::Sieve) => {
            let template: *const _ = shape.template;
            let of_template = *sieves.entry(template).or_insert_with(|| sieve::sieve_size(shape.template));
            (of_template * shape.scale_mm, body.own_volume())
        }
    });
    let sizes = collected(sizes)?;
    let error = |grain: usize| match (&shapes[grain], size) {
        (SolidRef::Polyhedron(_), SizeMeasure::Sieve) => SIEVE_ERROR,
        _ => SIZE_ERROR,
    };
    let grains = Grains::Bodies { sizes: &sizes, error: &error };
    check_bodies(&packing, (grains, aggregate), (request, extent), scope, walk)
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
    let region = (request.distance, request.specimen);
    certificates(shapes, poses, region, closer_than_mm, &Walk { threads: NonZeroUsize::MIN, control })
}

/// Checks on so many threads that no two grains overlap, and returns a direction for each pair whose gap is less than
/// `closer_than_mm`, in the order of their rows. Spheres are checked as ellipsoids with equal axes.
///
/// # Errors
/// The first fault found, or [`Fault::Stopped`].
pub fn certify(
    grains: GrainsRef<'_>,
    specimen: &Specimen,
    closer_than_mm: f64,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Vec<SeparationCertificate>, Fault> {
    let region = (Distance::None { wall_gap_mm: None }, *specimen);
    let walk = &Walk { threads, control };
    match grains {
        GrainsRef::Spheres(spheres) => {
            let body = |i: usize| {
                let shape = Ellipsoid::new([spheres.d_mm[i] / 2.0; 3])?;
                body::Ellipsoid::new(&shape, &Pose::at(spheres.center(i).into()))
            };
            let packing = Packing::new(spheres.len(), body, region)?;
            packing.check_walls()?;
            packing.certificates(closer_than_mm, walk)
        }
        GrainsRef::Solids(solids) => {
            certificates(&shapes_of(solids)?, &solids.poses, region, closer_than_mm, walk)
        }
    }
}

fn certificates(
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
    region: (Distance, Specimen),
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
    region: (Distance, Specimen),
) -> Result<Packing<body::Ellipsoid>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| body::Ellipsoid::new(&shapes[i], &poses[i]), region)
}

fn bodies<'a>(
    shapes: &[SolidRef<'a>],
    poses: &[Pose],
    region: (Distance, Specimen),
) -> Result<Packing<Body<'a>>, Fault> {
    if shapes.len() != poses.len() {
        return Err(Fault::Columns);
    }
    Packing::new(shapes.len(), |i| Body::new(&shapes[i], &poses[i]), region)
}

/// Checks the walls, all pairs, and the grading of grains.
fn check_bodies<B: Convex>(
    packing: &Packing<B>,
    (grains, aggregate): (Grains<'_>, &[u16]),
    (request, extent): (&PackingRequest, Extent),
    scope: Scope,
    walk: &Walk<'_>,
) -> Result<Check, Fault> {
    let min_wall_gap_mm = packing.check_walls()?;
    let pairs = match scope {
        Scope::All => packing.check_pairs(walk)?,
        Scope::WithoutPairs => Pairs::default(),
    };
    let graded = grading::check(grains, aggregate, request, extent).map_err(Fault::Grading)?;
    Ok(Check::new(min_wall_gap_mm, &pairs, graded))
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
