//! Packings that are kept of runs which ended before their target: they keep their full distances at the sizes that
//! they state, by a brute force over all pairs that shares nothing with the check.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::{checked_as, pack, pack_or_resume, verify};
use crate::check::{self, Scope, SieveSizes};
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Finish, Progress, Step, Unattended};
use crate::error::PackError;
use crate::packing::{Grains, GrainsRef, GrowthEnd, Packing, PartialReason, Solids};
use crate::plan::Limits;
use crate::request::PackingRequest;
use crate::shape::SolidRef;
use crate::template_cache::TemplateCache;

type V = Vector3<f64>;

pub(super) fn request(specimen: &Value, mix: &Value, more: &Value) -> PackingRequest {
    let mut value = json!({"seed": 5, "specimen": specimen, "mix": mix});
    for (name, field) in more.as_object().unwrap() {
        value[name] = field.clone();
    }
    PackingRequest::from_json(&value, 1).unwrap()
}

pub(super) fn walls(size: f64) -> Value {
    json!({"type": "box", "size_mm": [size, size, size]})
}

pub(super) fn periodic(size: f64) -> Value {
    json!({"type": "box", "size_mm": [size, size, size], "boundary": "periodic"})
}

fn fuller(fraction: f64) -> Value {
    json!({"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
           "volume_fraction": fraction, "volume_fraction_of": "placed_grains"})
}

fn shaped(fraction: f64, shape: &Value) -> Value {
    let mut mix = fuller(fraction);
    mix["shape"] = shape.clone();
    mix
}

pub(super) fn packed(request: &PackingRequest) -> Packing {
    pack(request, &Limits::default(), &Unattended).unwrap()
}

/// Support function of a body about its centre, from its dimensions alone.
fn support(shape: &SolidRef<'_>, turn: &nalgebra::Rotation3<f64>, n: &V) -> f64 {
    let n = turn.inverse() * n;
    match shape {
        SolidRef::Ellipsoid(ellipsoid) => ellipsoid.semi_axes_mm().component_mul(&n).norm(),
        SolidRef::Polyhedron(polyhedron) => {
            let corners = polyhedron.template.vertices().iter().map(|v| v.dot(&n));
            let most = corners.fold(f64::NEG_INFINITY, f64::max) + polyhedron.template.rounding();
            polyhedron.scale_mm * most
        }
    }
}

/// Normals of the faces and directions of the edges of a polyhedron; none of an ellipsoid.
fn axes(shape: &SolidRef<'_>, turn: &nalgebra::Rotation3<f64>) -> [Vec<V>; 2] {
    let Some(polyhedron) = shape.polyhedron() else { return [Vec::new(), Vec::new()] };
    let corner = |v: u32| polyhedron.template.vertices()[v as usize];
    let faces = polyhedron.template.faces();
    let normal = |f: &Vec<u32>| (corner(f[1]) - corner(f[0])).cross(&(corner(f[2]) - corner(f[0])));
    let edges = |f: &Vec<u32>| {
        let next = f[1..].iter().chain(&f[..1]).copied();
        f.iter().zip(next).filter(|(a, b)| **a < *b).map(|(a, b)| turn * (corner(b) - corner(*a))).collect()
    };
    let edges = faces.iter().flat_map(|f| -> Vec<V> { edges(f) }).collect();
    [faces.iter().map(|f| turn * normal(f)).collect(), edges]
}

/// The largest of `s(n) = r . n - h_a(n) - h_b(-n)` over the unit sphere: directions all around, then shorter and
/// shorter steps from the best.
fn gap_of(solids: &Solids, i: usize, j: usize, r: V) -> f64 {
    let [(a, turn_a), (b, turn_b)] =
        [i, j].map(|grain| (solids.shape(grain), solids.poses[grain].orientation.to_rotation_matrix()));
    let s = |n: &V| r.dot(n) - support(&a, &turn_a, n) - support(&b, &turn_b, &-n);
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let around = (0..300).map(|k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 300.0;
        let (sin, cos) = (golden * f64::from(k)).sin_cos();
        let across = (1.0 - z * z).sqrt();
        V::new(across * cos, across * sin, z)
    });
    // Of two polyhedra that touch, the directions of the separating axis theorem: face normals, and those across an
    // edge of each.
    let ([faces_a, edges_a], [faces_b, edges_b]) = (axes(&a, &turn_a), axes(&b, &turn_b));
    let crossed = edges_a.iter().flat_map(|e| edges_b.iter().map(move |f| e.cross(f)));
    let of_bodies = faces_a.iter().chain(&faces_b).copied().chain(crossed);
    let of_bodies = of_bodies.filter(|n| n.norm() > 1e-9).flat_map(|n| [n.normalize(), -n.normalize()]);
    let all = around.chain(of_bodies).chain([r.normalize()]);
    let mut best = all.map(|n| (s(&n), n)).max_by(|p, q| p.0.total_cmp(&q.0)).unwrap();
    let mut step = 0.2;
    while step > 1e-10 {
        let other = if best.1.x.abs() < 0.7 { V::x() } else { V::y() };
        let u = best.1.cross(&other).normalize();
        let v = best.1.cross(&u);
        let found = (0..12)
            .map(|k| (std::f64::consts::TAU * f64::from(k) / 12.0 + step).sin_cos())
            .map(|(sin, cos)| (best.1 + (u * cos + v * sin) * step).normalize())
            .map(|n| (s(&n), n))
            .max_by(|p, q| p.0.total_cmp(&q.0))
            .unwrap();
        if found.0 > best.0 {
            best = found;
        } else {
            step *= 0.6;
        }
    }
    best.0
}

/// Gaps of all pairs, less what is asked of them, and of all grains to planes and to a cylinder: the least of each.
/// `gap` and `wall` are what is asked by the equivalent diameters.
pub(super) fn least_excess(
    request: &PackingRequest,
    grains: &Grains,
    gap: impl Fn(f64, f64) -> f64,
    wall: impl Fn(f64) -> f64,
) -> f64 {
    let grains_ref = GrainsRef::from(grains);
    let bounds = V::from(request.specimen.bounds_mm());
    let is_periodic = request.specimen.is_periodic();
    let steps: Vec<i32> = if is_periodic { vec![-1, 0, 1] } else { vec![0] };
    let mut least = f64::INFINITY;
    for i in 0..grains_ref.len() {
        let center = V::from(grains_ref.center_mm(i));
        for j in 0..=i {
            let to = V::from(grains_ref.center_mm(j)) - center;
            let asked = gap(grains_ref.d_mm(i), grains_ref.d_mm(j));
            for (x, y, z) in steps
                .iter()
                .flat_map(|&x| steps.iter().flat_map(move |&y| [-1, 0, 1].map(move |z| (x, y, z))))
            {
                if (i == j && (x, y, z) == (0, 0, 0)) || (!is_periodic && z != 0) {
                    continue;
                }
                let shift = V::new(f64::from(x), f64::from(y), f64::from(z)).component_mul(&bounds);
                let r = to + shift;
                let found = match grains {
                    Grains::Spheres(spheres) => r.norm() - (spheres.d_mm[i] + spheres.d_mm[j]) / 2.0,
                    Grains::Solids(solids) => {
                        let outer = [i, j].map(|grain| solids.shape(grain).outer_radius_mm());
                        if r.norm() - outer[0] - outer[1] > asked + least.max(0.0) {
                            continue;
                        }
                        gap_of(solids, i, j, r)
                    }
                };
                least = least.min(found - asked);
            }
        }
        if is_periodic {
            continue;
        }
        let asked = wall(grains_ref.d_mm(i));
        let reach = |n: V| match grains {
            Grains::Spheres(spheres) => spheres.d_mm[i] / 2.0,
            Grains::Solids(solids) => {
                support(&solids.shape(i), &solids.poses[i].orientation.to_rotation_matrix(), &n)
            }
        };
        let is_box = matches!(request.specimen, crate::request::Specimen::Box { .. });
        for axis in if is_box { 0..3 } else { 2..3 } {
            let n = V::from_fn(|a, _| if a == axis { 1.0 } else { 0.0 });
            least = least.min(center[axis] - reach(-n) - asked);
            least = least.min(bounds[axis] - center[axis] - reach(n) - asked);
        }
        if !is_box {
            let radius = bounds.x / 2.0;
            for k in 0..7200 {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 7200.0).sin_cos();
                let n = V::new(cos, sin, 0.0);
                let along = (center - V::new(radius, radius, 0.0)).dot(&n);
                least = least.min(radius - along - reach(n) - asked);
            }
        }
    }
    least
}

/// A kept packing keeps its distances, and no more than that: the scale is the largest.
fn assert_kept(request: &PackingRequest, packing: &Packing, gap: f64, wall: f64, tolerance: f64) {
    let partial = packing.report.summary.partial.unwrap();
    let excess = least_excess(request, &packing.grains, |_, _| gap, |_| wall);
    assert!(excess > -tolerance, "{excess:e} {partial:?}");
    if partial.size_scale < 1.0 {
        assert!(excess < 1e-6, "a larger scale would do: {excess} {partial:?}");
    }
    for scope in [Scope::All, Scope::WithoutPairs] {
        verify(request, &packing.report, &packing.grains, scope, &TemplateCache::default(), &Unattended)
            .unwrap();
    }
    let volume: f64 = match &packing.grains {
        Grains::Spheres(spheres) => spheres.d_mm.iter().map(|d| std::f64::consts::PI / 6.0 * d.powi(3)).sum(),
        Grains::Solids(solids) => solids.iter().map(|(shape, _)| shape.volume_mm3()).sum(),
    };
    let reached = volume / request.specimen.volume_mm3();
    assert!((partial.volume_fraction_reached / reached - 1.0).abs() < 1e-9, "{partial:?}");
    assert_eq!(partial.grains_placed, packing.grains.len() as u64);
    let said = packing.report.warnings.iter().any(|warning| warning.contains("the packing is partial"));
    assert!(said, "{:?}", packing.report.warnings);
}

#[test]
fn growth_of_spheres_that_a_limit_or_a_jam_ends_is_kept_at_its_full_distance() {
    let distance = json!({"type": "constant", "gap_mm": 0.3});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 22, "height_mm": 22});
    for (specimen, fraction, events, reason) in [
        (walls(20.0), 0.5, 3_000, PartialReason::EventLimit),
        (periodic(20.0), 0.5, 3_000, PartialReason::EventLimit),
        (cylinder, 0.48, 3_000, PartialReason::EventLimit),
        (periodic(14.0), 0.56, 100_000_000, PartialReason::Stalled),
    ] {
        let method = json!({"type": "edmd", "stop": {"events": events}});
        let fails = request(&specimen, &fuller(fraction), &json!({"distance": distance, "method": method}));
        let ended = pack(&fails, &Limits::default(), &Unattended).unwrap_err();
        assert!(matches!(ended, PackError::TargetNotReached(_)), "{ended}");
        assert!(ended.to_string().contains("on_limit \"keep\" keeps the packing"), "{ended}");
        let keeps = PackingRequest { on_limit: crate::request::OnLimit::Keep, ..fails };
        let packing = packed(&keeps);
        let partial = packing.report.summary.partial.unwrap();
        assert_eq!((partial.reason, partial.volume_fraction_requested), (reason, Some(fraction)));
        assert_eq!((partial.distance_mm_requested, partial.distance_mm_reached), (Some(0.3), Some(0.3)));
        assert_eq!(partial.grains_requested, partial.grains_placed);
        // Growth scales the distance as well.
        let reached = packing.report.statistics.edmd.unwrap().growth_scale;
        assert!(partial.size_scale < reached && reached < 1.0, "{partial:?} {reached}");
        assert_kept(&keeps, &packing, 0.3, 0.15, 1e-12);
    }
}

#[test]
fn growth_of_shapes_that_a_limit_ends_is_kept_at_its_full_distance() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.7, "c_over_a": 0.5}});
    let polyhedron =
        json!({"type": "polyhedron", "template": "cuts", "faces": 12, "template_count": 3, "rounding": 0.1});
    let both = json!({"type": "mixture", "of": [
        {"share": 0.5, "shape": ellipsoid}, {"share": 0.5, "shape": polyhedron}]});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 13, "height_mm": 13});
    for (specimen, mix) in [
        (walls(13.0), shaped(0.5, &ellipsoid)),
        (cylinder.clone(), shaped(0.5, &ellipsoid)),
        (periodic(12.0), shaped(0.5, &polyhedron)),
        (walls(12.0), shaped(0.5, &both)),
        (walls(14.0), fuller(0.56)),
        (cylinder, fuller(0.56)),
        (periodic(14.0), fuller(0.6)),
    ] {
        let more = json!({
            "on_limit": "keep", "distance": {"type": "constant", "gap_mm": 0.2, "wall_gap_mm": 0.05},
            "method": {"type": "monte_carlo", "stop": {"sweeps": 60}},
        });
        let keeps = request(&specimen, &mix, &more);
        let packing = packed(&keeps);
        let partial = packing.report.summary.partial.unwrap();
        assert_eq!(partial.reason, PartialReason::EventLimit);
        let reached = packing.report.statistics.monte_carlo.unwrap().growth_scale;
        assert!(partial.size_scale < reached && reached < 1.0, "{partial:?} {reached}");
        assert_kept(&keeps, &packing, 0.2, 0.05, 1e-9);
    }
}

#[test]
fn random_addition_keeps_what_it_placed_and_says_that_the_finest_are_missing() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.7, "c_over_a": 0.5}});
    for mix in [fuller(0.62), shaped(0.6, &ellipsoid)] {
        let more = json!({"on_limit": "keep", "method": {"type": "rsa", "attempts_per_grain": 2000}});
        let keeps = request(&walls(14.0), &mix, &more);
        let packing = packed(&keeps);
        let partial = packing.report.summary.partial.unwrap();
        assert_eq!((partial.reason, partial.size_scale), (PartialReason::Saturated, 1.0));
        assert!(partial.grains_placed < partial.grains_requested, "{partial:?}");
        assert_kept(&keeps, &packing, 0.0, 0.0, 1e-9);
        assert!(packing.report.warnings.iter().any(|warning| warning.contains("the finest are missing")));
    }
}

#[test]
fn the_largest_distance_that_sizes_do_not_reach_leaves_them_smaller() {
    let more = json!({
        "on_limit": "keep", "distance": {"type": "maximize"},
        "method": {"type": "edmd", "stop": {"events": 3000}},
    });
    let keeps = request(&walls(20.0), &fuller(0.62), &more);
    let packing = packed(&keeps);
    let partial = packing.report.summary.partial.unwrap();
    assert!(partial.size_scale < 1.0, "{partial:?}");
    assert_eq!((partial.distance_mm_requested, partial.distance_mm_reached), (None, Some(0.0)));
    assert_kept(&keeps, &packing, 0.0, 0.0, 1e-12);
    // Where they have their sizes, the distance at the limit is the result, as ever.
    let more = json!({
        "on_limit": "keep", "distance": {"type": "maximize"},
        "method": {"type": "edmd", "stop": {"events": 3000}},
    });
    let whole = packed(&request(&walls(20.0), &fuller(0.3), &more)).report.summary;
    assert!(whole.partial.is_none() && whole.distance_mm.unwrap() > 0.0);
}

/// Finishes in a step, once so many reports were made in it; with an order for a last checkpoint.
struct Finishing {
    step: Step,
    after: u32,
    reports: AtomicU32,
    kept: Mutex<Vec<u8>>,
}

impl Finishing {
    fn new(step: Step, after: u32) -> Self {
        Self { step, after, reports: AtomicU32::new(0), kept: Mutex::default() }
    }
}

impl Control for Finishing {
    fn report(&self, progress: &Progress) {
        self.reports.fetch_add(u32::from(progress.step == self.step), Ordering::Relaxed);
    }
    fn should_stop(&self) -> bool {
        false
    }
    fn should_finish(&self) -> Option<Finish> {
        (self.reports.load(Ordering::Relaxed) >= self.after).then_some(Finish::Requested)
    }
    fn wants_last_checkpoint(&self) -> bool {
        true
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        *self.kept.lock().unwrap() = bytes;
    }
}

#[test]
fn a_run_that_is_to_finish_ends_with_what_it_has_whatever_its_limits_say() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.7, "c_over_a": 0.5}});
    let gap = json!({"type": "constant", "gap_mm": 0.1});
    let grown = json!({"distance": gap, "method": {"type": "edmd"}});
    let shaken = json!({"distance": gap, "method": {"type": "monte_carlo"}});
    let placed = json!({"distance": gap, "method": {"type": "rsa"}});
    for (size, mix, more, step, after) in [
        // Many grains, for random addition reports each few thousand draws.
        (60.0, fuller(0.56), &grown, Step::Rsa, 1),
        (24.0, fuller(0.58), &grown, Step::Edmd, 2),
        (60.0, fuller(0.56), &placed, Step::Rsa, 3),
        (14.0, shaped(0.55, &ellipsoid), &shaken, Step::MonteCarlo, 2),
        (24.0, fuller(0.58), &shaken, Step::MonteCarlo, 2),
        (20.0, shaped(0.55, &ellipsoid), &placed, Step::Rsa, 2),
    ] {
        let request = request(&walls(size), &mix, more);
        let control = Finishing::new(step, after);
        let packing = pack(&request, &Limits::default(), &control).unwrap();
        let partial = packing.report.summary.partial.unwrap();
        assert_eq!(partial.reason, PartialReason::Finished, "{step:?}");
        assert_eq!(partial.grains_placed < partial.grains_requested, step == Step::Rsa, "{partial:?}");
        verify(
            &request,
            &packing.report,
            &packing.grains,
            Scope::All,
            &TemplateCache::default(),
            &Unattended,
        )
        .unwrap();
        if let Grains::Spheres(_) = packing.grains {
            let (checked, extent) = checked_as(&request, &packing.report.summary).unwrap();
            check::check_grains(
                &packing.grains,
                &checked,
                extent,
                Scope::All,
                &SieveSizes::default(),
                std::num::NonZeroUsize::MIN,
                &Unattended,
            )
            .unwrap();
        }
        assert_eq!(control.kept.lock().unwrap().is_empty(), step == Step::Rsa, "{step:?}");
    }
    // During the check the packing is there as a whole.
    let request = request(&walls(14.0), &fuller(0.4), &grown);
    let packing = pack(&request, &Limits::default(), &Finishing::new(Step::Check, 1)).unwrap();
    assert!(packing.report.summary.partial.is_none());
}

#[test]
fn a_partial_packing_is_gone_on_with_when_limits_are_raised() {
    let keeps = |events: u64, on_limit: &str| {
        let method = json!({"type": "edmd", "stop": {"events": events}});
        request(&walls(20.0), &fuller(0.58), &json!({"method": method, "on_limit": on_limit}))
    };
    let control = Finishing::new(Step::Check, u32::MAX);
    let short = pack(&keeps(2000, "keep"), &Limits::default(), &control).unwrap();
    assert_eq!(short.report.summary.partial.unwrap().reason, PartialReason::EventLimit);
    let bytes = control.kept.into_inner().unwrap();
    let read = |request: &PackingRequest| Resume::read_with_limits(&mut bytes.as_slice(), request);
    assert!(Resume::read_from(&mut bytes.as_slice(), &keeps(1_000_000_000, "fail")).is_err());
    let other = PackingRequest { seed: 6, ..keeps(2000, "keep") };
    assert!(read(&other).is_err());

    let raised = keeps(1_000_000_000, "fail");
    let whole = pack_or_resume(
        &raised,
        &Limits::default(),
        &TemplateCache::default(),
        Some(read(&raised).unwrap()),
        &Unattended,
    )
    .unwrap();
    let grown = whole.report.statistics.edmd.unwrap();
    assert_eq!((grown.stop, grown.resumes), (GrowthEnd::Target, 1));
    assert!(grown.events > 2000 && whole.report.summary.partial.is_none());
    // The same again to the last bit.
    let again = pack_or_resume(
        &raised,
        &Limits::default(),
        &TemplateCache::default(),
        Some(read(&raised).unwrap()),
        &Unattended,
    )
    .unwrap();
    assert_eq!(again.grains, whole.grains);
}

#[test]
fn a_partial_packing_with_any_change_is_refused() {
    let more = json!({"on_limit": "keep", "method": {"type": "edmd", "stop": {"events": 2000}}});
    let keeps = request(&walls(16.0), &fuller(0.58), &more);
    let packing = packed(&keeps);
    let refused = |change: &dyn Fn(&mut Packing)| {
        let mut changed = packing.clone();
        change(&mut changed);
        let verified = verify(
            &keeps,
            &changed.report,
            &changed.grains,
            Scope::All,
            &TemplateCache::default(),
            &Unattended,
        );
        verified.unwrap_err().to_string()
    };
    let partial = |packing: &mut Packing, change: &dyn Fn(&mut crate::packing::Partial)| {
        let mut partial = packing.report.summary.partial.unwrap();
        change(&mut partial);
        packing.report.summary.partial = Some(partial);
    };
    // All sizes smaller than they must be, as the scale says.
    let smaller = refused(&|packing| {
        partial(packing, &|partial| partial.size_scale *= 0.99);
        packing.grains.scale(0.99);
    });
    assert!(smaller.contains("size_scale") || smaller.contains("diameter"), "{smaller}");
    assert!(refused(&|p| partial(p, &|p| p.reason = PartialReason::TimeLimit)).contains("reason"));
    assert!(refused(&|p| partial(p, &|p| p.reason = PartialReason::Saturated)).contains("reason"));
    assert!(
        refused(&|p| partial(p, &|p| p.volume_fraction_reached += 1e-3)).contains("volume_fraction_reached")
    );
    assert!(refused(&|p| p.report.summary.partial = None).contains("grain"));
    // As of a request that does not keep.
    let fails = PackingRequest { on_limit: crate::request::OnLimit::Fail, ..keeps.clone() };
    assert!(
        verify(&fails, &packing.report, &packing.grains, Scope::All, &TemplateCache::default(), &Unattended)
            .is_err()
    );
}
