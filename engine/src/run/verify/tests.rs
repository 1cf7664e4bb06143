//! A packing of another process is accepted as it was computed, and with any change refused.

#![allow(clippy::unwrap_used)]

use std::io;

use serde_json::{Value, json};

use super::super::pack;
use super::{VerifyError, verify, verify_failure};
use crate::check::Scope;
use crate::control::Unattended;
use crate::error::{PackError, PlanError, TargetNotReached};
use crate::export::tables::{Column, GrainSource};
use crate::packing::{Grains, MethodUsed, Packing};
use crate::plan::Limits;
use crate::request::{FieldError, PackingRequest};
use crate::shape::Polyhedron;
use crate::template_cache::TemplateCache;

const BOTH: [Scope; 2] = [Scope::All, Scope::WithoutPairs];

fn request(mix: Value, more: &Value) -> PackingRequest {
    let mut request = json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "distance": {"type": "constant", "gap_mm": 0.1},
    });
    request["mix"] = mix;
    for (name, value) in more.as_object().unwrap() {
        request[name] = value.clone();
    }
    PackingRequest::from_json(&request, 1).unwrap()
}

fn graded(fraction: f64) -> Value {
    json!({"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": fraction})
}

fn shaped(shape: Value) -> Value {
    let mut mix = graded(0.2);
    mix["shape"] = shape;
    mix
}

fn ellipsoid() -> Value {
    json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}})
}

fn polyhedron() -> Value {
    json!({"type": "polyhedron", "template_count": 3})
}

/// Requests of all kinds of grains, methods and figures.
fn requests() -> Vec<PackingRequest> {
    let fuller = |d_max_mm: f64| json!({"type": "fuller", "d_max_mm": d_max_mm, "exponent": 0.5});
    let aggregates = json!({
        "volume_fraction": 0.25,
        "aggregates": [
            {"name": "gravel", "share": 0.6, "grading": fuller(12.0), "d_min_mm": 6},
            {"name": "chips", "share": 0.4, "grading": fuller(8.0), "d_min_mm": 4},
        ],
    });
    let stopped = json!({"type": "edmd", "stop": {"events": 20_000}});
    let periodic = json!({"type": "box", "size_mm": [30, 30, 30], "boundary": "periodic"});
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.5, "shape": ellipsoid()}, {"share": 0.5, "shape": polyhedron()},
    ]});
    vec![
        request(graded(0.3), &json!({})),
        request(graded(0.4), &json!({"method": {"type": "edmd"}})),
        request(graded(0.3), &json!({"distance": {"type": "maximize"}, "method": stopped})),
        request(graded(0.2), &json!({"specimen": periodic})),
        request(aggregates, &json!({})),
        request(
            graded(0.2),
            &json!({"segregation": {"type": "gradient", "strength": 0.5, "field": {"type": "linear", "axis": "z"}}}),
        ),
        request(shaped(ellipsoid()), &json!({"method": {"type": "monte_carlo"}})),
        request(shaped(polyhedron()), &json!({})),
        request(shaped(mixture), &json!({})),
        request(graded(0.4), &json!({"method": {"type": "monte_carlo"}})),
        request(
            graded(0.3),
            &json!({"distance": {"type": "maximize"},
            "method": {"type": "monte_carlo", "stop": {"sweeps": 100}}}),
        ),
        request(graded(0.3), &json!({"method": {"type": "growth", "growth_rate": 0.2}})),
        request(shaped(ellipsoid()), &json!({"method": {"type": "growth", "stop": {"sweeps": 10_000}}})),
    ]
}

fn packed(request: &PackingRequest) -> Packing {
    pack(request, &Limits::default(), &Unattended).unwrap()
}

fn fault(request: &PackingRequest, packing: &Packing, scope: Scope) -> Option<String> {
    match verify(request, &packing.report, &packing.grains, scope, &TemplateCache::default(), &Unattended) {
        Ok(()) => None,
        Err(VerifyError::Wrong(what)) => Some(what),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn packings_are_accepted_as_they_were_computed() {
    for request in requests() {
        let packing = packed(&request);
        for scope in BOTH {
            assert_eq!(fault(&request, &packing, scope), None, "{scope:?} of {request:?}");
        }
    }
}

/// Moves a grain.
fn moved(grains: &mut Grains, grain: usize, to: [f64; 3]) {
    match grains {
        Grains::Spheres(spheres) => {
            [spheres.x_mm[grain], spheres.y_mm[grain], spheres.z_mm[grain]] = to;
        }
        Grains::Solids(solids) => solids.poses[grain].center_mm = to.into(),
    }
}

fn center(grains: &Grains, grain: usize) -> [f64; 3] {
    crate::packing::GrainsRef::from(grains).center_mm(grain)
}

#[test]
fn a_grain_that_is_moved_changed_or_missing_is_found() {
    for request in requests() {
        let right = packed(&request);
        let refused = |change: &dyn Fn(&mut Packing), scopes: &[Scope]| {
            let mut packing = right.clone();
            change(&mut packing);
            for &scope in scopes {
                assert!(fault(&request, &packing, scope).is_some(), "{scope:?} of {request:?}");
            }
        };
        let last = right.grains.len() - 1;
        refused(
            &|packing| {
                let [x, y, z] = center(&packing.grains, 0);
                moved(&mut packing.grains, last, [x + 0.01, y, z]);
            },
            &[Scope::All],
        );
        for outside in
            [[-1.0, 15.0, 15.0], [15.0, 1.0e9, 15.0], [f64::NAN, 15.0, 15.0], [15.0, 15.0, f64::INFINITY]]
        {
            refused(&|packing| moved(&mut packing.grains, last, outside), &BOTH);
        }
        refused(
            &|packing| match &mut packing.grains {
                Grains::Spheres(spheres) => {
                    let columns =
                        [&mut spheres.x_mm, &mut spheres.y_mm, &mut spheres.z_mm, &mut spheres.d_mm];
                    let _ = columns.map(Vec::pop);
                    spheres.aggregate.pop();
                }
                Grains::Solids(solids) => {
                    solids.shapes.pop();
                    solids.poses.pop();
                    solids.aggregate.pop();
                }
            },
            &BOTH,
        );
        // The sizes of another seed.
        let other = packed(&PackingRequest { seed: 4, ..request.clone() });
        refused(&|packing| *packing = other.clone(), &BOTH);
    }
}

#[test]
fn a_size_or_an_aggregate_that_differs_in_its_last_bit_is_found() {
    let [spheres, aggregates, polyhedra] = [0, 4, 7].map(|i| requests().swap_remove(i));
    for scope in BOTH {
        let mut packing = packed(&spheres);
        let Grains::Spheres(grains) = &mut packing.grains else { panic!() };
        grains.d_mm[5] = grains.d_mm[5].next_down();
        assert!(fault(&spheres, &packing, scope).unwrap().starts_with("grain 5 has the diameter"));
        let mut packing = packed(&aggregates);
        let Grains::Spheres(grains) = &mut packing.grains else { panic!() };
        grains.aggregate[7] = 1 - grains.aggregate[7];
        assert!(fault(&aggregates, &packing, scope).unwrap().starts_with("grain 7 "));
        let mut packing = packed(&polyhedra);
        let Grains::Solids(grains) = &mut packing.grains else { panic!() };
        grains.poses[2].orientation =
            nalgebra::UnitQuaternion::new_unchecked(grains.poses[2].orientation.into_inner() * 1.001);
        assert!(fault(&polyhedra, &packing, scope).is_some());
    }
}

type Change = &'static dyn Fn(&mut Packing);

#[test]
fn a_report_that_tells_of_another_packing_is_refused() {
    let request = requests().swap_remove(1);
    let right = packed(&request);
    let changes: [(&str, Change); 10] = [
        ("summary/grains", &|p| p.report.summary.grains += 1),
        ("summary/volume_fraction_effective", &|p| p.report.summary.volume_fraction_effective *= 1.01),
        ("method_used", &|p| p.report.summary.method_used = Some(MethodUsed::Rsa)),
        ("check/max_class_mass_error", &|p| p.report.check.max_class_mass_error = 0.0),
        ("check/min_wall_gap_mm", &|p| p.report.check.min_wall_gap_mm = Some(1.0)),
        ("warnings", &|p| p.report.warnings.push("x".repeat(1 << 20))),
        ("growth_scale", &|p| p.report.statistics.edmd.as_mut().unwrap().growth_scale = 0.99),
        ("timings_s/total", &|p| p.report.timings_s.total = -1.0),
        ("growth_curve", &|p| p.report.growth_curve = vec![p.report.growth_curve[0]; 1001]),
        ("statistics", &|p| p.report.statistics.edmd = None),
    ];
    for (place, change) in changes {
        let mut packing = right.clone();
        change(&mut packing);
        for scope in BOTH {
            let what = fault(&request, &packing, scope).unwrap();
            assert!(what.contains(place) && what.len() < 300, "{place}: {what}");
        }
    }
    let mut packing = right;
    packing.report.check.min_gap_mm = Some(0.5);
    assert!(fault(&request, &packing, Scope::All).unwrap().contains("min_gap_mm"));
}

/// Grains with another number in one place of one column.
struct Changed<'a>(&'a Grains, Column, f64);

impl GrainSource for Changed<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn columns(&self) -> &'static [Column] {
        self.0.columns()
    }

    fn templates(&self) -> &[Polyhedron] {
        self.0.templates()
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        self.0.read(column, start, block)?;
        if column == self.1
            && let Some(value) = block.get_mut(1)
        {
            *value = self.2;
        }
        Ok(())
    }
}

#[test]
fn each_column_is_compared_with_the_grains() {
    for index in [0, 4, 6, 7, 8] {
        let request = requests().swap_remove(index);
        let packing = packed(&request);
        for &column in packing.grains.columns() {
            for value in [f64::NAN, f64::INFINITY, 1.0e300, -7.25] {
                let source = Changed(&packing.grains, column, value);
                let verified = verify(
                    &request,
                    &packing.report,
                    &source,
                    Scope::WithoutPairs,
                    &TemplateCache::default(),
                    &Unattended,
                );
                let is_wrong = matches!(verified, Err(VerifyError::Wrong(_)));
                assert!(is_wrong, "{value} in {column:?}: {verified:?}");
            }
        }
    }
}

#[test]
fn a_failure_is_accepted_with_the_figures_of_its_grains_only() {
    let limits = Limits::default();
    let failed =
        |request: &PackingRequest| pack(request, &limits, &Unattended).map(|_| "packed").unwrap_err();
    let judged = |request: &PackingRequest, told: &PackError| {
        verify_failure(request, &limits, told, &TemplateCache::default(), &Unattended)
    };
    let rsa = request(graded(0.6), &json!({"method": {"type": "rsa", "attempts_per_grain": 100}}));
    let told = failed(&rsa);
    assert!(judged(&rsa, &told).is_ok(), "{told}");
    let PackError::TargetNotReached(TargetNotReached::InsertionFailed(right)) = told else {
        panic!("{told}")
    };
    let changes: [&dyn Fn(&mut crate::error::InsertionFailed); 4] = [
        &|told| told.placed = told.grains,
        &|told| told.grains += 1,
        &|told| told.diameter_mm *= 1.5,
        &|told| told.volume_fraction_reached *= 1.5,
    ];
    for change in changes {
        let mut told = right.clone();
        change(&mut told);
        let told = PackError::TargetNotReached(TargetNotReached::InsertionFailed(told));
        assert!(matches!(judged(&rsa, &told), Err(VerifyError::Wrong(_))), "{told}");
    }
    let stop = json!({"type": "edmd", "stop": {"events": 1000}});
    let edmd = request(graded(0.9), &json!({"method": stop}));
    let told = failed(&edmd);
    assert!(judged(&edmd, &told).is_ok(), "{told}");
    assert!(judged(&rsa, &told).is_err(), "of another method");
    let without_limit = request(graded(0.9), &json!({"method": {"type": "edmd"}}));
    assert!(judged(&without_limit, &told).is_err(), "there is no limit of events");
    let fits = request(graded(0.3), &json!({}));
    let told = PackError::Plan(PlanError::Infeasible(FieldError::new("/mix/volume_fraction", "too much")));
    assert!(judged(&fits, &told).is_err(), "a claimed proof that is none");
    let dense = request(graded(0.6), &json!({"distance": {"type": "constant", "gap_mm": 8}}));
    let told = failed(&dense);
    assert!(matches!(told, PackError::Plan(PlanError::Infeasible(_))), "{told}");
    assert!(judged(&dense, &told).is_ok());
}
