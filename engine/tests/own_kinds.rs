//! A grain and a domain that the engine does not know: capsules in a hexagonal prism, packed, checked and written by
//! [`pack_with`]. What the check needs of both is written here a second time, by other formulas.

use std::f64::consts::PI;
use std::io::Write;
use std::num::NonZeroUsize;

use nalgebra::Vector3;
use packstone_engine::check::{self, Body, Direction, Fault, Image, Region, Verdict, check_bodies};
use packstone_engine::domain::{Domain, FacePlane, PolytopeError};
use packstone_engine::export::{ExportError, Writes};
use packstone_engine::gap::grain::{ConvexShape, Decision, Orientation, PushContact, Turned};
use packstone_engine::gap::linear::{Symmetric, Vector};
use packstone_engine::mix::uniform_orientation;
use packstone_engine::packing::MethodUsed;
use packstone_engine::request::{Distance, GrowthOptions, Method};
use packstone_engine::shape::Pose;
use packstone_engine::{Control, Limits, OwnError, OwnMix, OwnPacking, Unattended, pack_with};

/// Half of the distance between two sides of the prism, and its height.
const APOTHEM_MM: f64 = 15.0;
const HEIGHT_MM: f64 = 30.0;

/// Outward normals of the sides.
fn sides() -> [Vector3<f64>; 6] {
    let (s, c) = (3.0_f64.sqrt() / 2.0, 0.5);
    [
        Vector3::new(0.0, 1.0, 0.0),
        Vector3::new(s, c, 0.0),
        Vector3::new(s, -c, 0.0),
        Vector3::new(0.0, -1.0, 0.0),
        Vector3::new(-s, -c, 0.0),
        Vector3::new(-s, c, 0.0),
    ]
}

/// The axis of the prism in x and y: its box begins at the origin.
fn middle() -> Vector3<f64> {
    Vector3::new(2.0 * APOTHEM_MM / 3.0_f64.sqrt(), APOTHEM_MM, 0.0)
}

// The domain: a list of faces.

const FACES: [&str; 8] = ["n", "ne", "se", "s", "sw", "nw", "bottom", "top"];

fn prism() -> Domain {
    let mut planes: Vec<FacePlane> =
        sides().iter().map(|side| FacePlane::new(-side, middle() + APOTHEM_MM * side)).collect();
    planes.push(FacePlane::new(Vector3::z(), Vector3::zeros()));
    planes.push(FacePlane::new(-Vector3::z(), HEIGHT_MM * Vector3::z()));
    Domain::polytope(&planes, &FACES).unwrap()
}

// The grain: all points within a radius of a segment along its first axis.

#[derive(Clone, Copy, Debug, PartialEq)]
struct Capsule {
    half_length: f64,
    radius: f64,
}

#[derive(Clone, Copy, Debug)]
struct TurnedCapsule {
    /// From the centre to an end of the segment.
    arm: Vector3<f64>,
    radius: f64,
}

impl ConvexShape for Capsule {
    type Turned = TurnedCapsule;

    fn volume_mm3(&self) -> f64 {
        PI * self.radius.powi(2) * (2.0 * self.half_length + 4.0 / 3.0 * self.radius)
    }

    fn equivalent_diameter_mm(&self) -> f64 {
        (6.0 / PI * self.volume_mm3()).cbrt()
    }

    fn scaled(&self, factor: f64) -> Option<Self> {
        let scaled = Self { half_length: factor * self.half_length, radius: factor * self.radius };
        (scaled.radius > 0.0).then_some(scaled)
    }

    fn is_same(&self, other: &Self) -> bool {
        self == other
    }

    fn is_similar(&self, other: &Self) -> bool {
        self.half_length * other.radius == other.half_length * self.radius
    }

    fn outer_mm(&self) -> f64 {
        self.half_length + self.radius
    }

    fn inner_mm(&self) -> f64 {
        self.radius
    }

    fn inside_mm(&self) -> Vector {
        [self.outer_mm(), self.radius, self.radius]
    }

    fn around_mm(&self) -> Vector {
        let across = (self.radius * self.outer_mm()).sqrt();
        [self.outer_mm(), across, across]
    }

    fn change_mm(&self, angle: f64) -> f64 {
        self.half_length * angle
    }

    /// Those of the ellipsoid of equal extents.
    fn per_inertia(&self, per_mass: f64) -> Vector {
        let (long, short) = (self.outer_mm().powi(2), self.radius.powi(2));
        let across = 5.0 * per_mass / (long + short);
        [2.5 * per_mass / short, across, across]
    }

    fn turned(&self, rows: &[Vector; 3]) -> TurnedCapsule {
        let along = Vector3::from_fn(|row, _| rows[row][0]);
        TurnedCapsule { arm: self.half_length * along, radius: self.radius }
    }
}

/// Places of two segments, from -1 to 1, that are nearest to each other (Ericson 2004, "Real-Time Collision Detection",
/// 5.1.9), with `r` from the middle of one to that of the other.
fn nearest(a: &Vector3<f64>, b: &Vector3<f64>, r: &Vector3<f64>) -> [f64; 2] {
    let (aa, bb, ab) = (a.dot(a), b.dot(b), a.dot(b));
    let (ar, br) = (a.dot(r), b.dot(r));
    let parting = aa * bb - ab * ab;
    let free = if parting > 1e-12 * aa * bb { (ar * bb - ab * br) / parting } else { 0.0 };
    let on_b = |s: f64| if bb > 0.0 { ((s * ab - br) / bb).clamp(-1.0, 1.0) } else { 0.0 };
    let on_a = |t: f64| if aa > 0.0 { ((t * ab + ar) / aa).clamp(-1.0, 1.0) } else { 0.0 };
    let t = on_b(free.clamp(-1.0, 1.0));
    let s = on_a(t);
    [s, on_b(s)]
}

impl TurnedCapsule {
    fn support(&self, n: &Vector3<f64>) -> f64 {
        self.arm.dot(n).abs() + self.radius * n.norm()
    }
}

impl Turned for TurnedCapsule {
    const IS_ELLIPSOID: bool = false;

    /// The sum of a segment and a ball lies in the ellipsoid of the matrix `(1 + r / l) l² u uᵀ + (1 + l / r) r² I`.
    fn around(&self) -> Symmetric {
        let (u, length) = (self.arm, self.arm.norm());
        let along = if length > 0.0 { 1.0 + self.radius / length } else { 1.0 };
        let round = self.radius * (self.radius + length);
        let entry = |i: usize, j: usize| along * u[i] * u[j] + if i == j { round } else { 0.0 };
        Symmetric([entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)])
    }

    fn support_mm(&self, n: Vector) -> f64 {
        self.support(&n.into())
    }

    fn support_back_mm(&self, n: Vector) -> f64 {
        self.support(&n.into())
    }

    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector) -> Decision {
        let r = Vector3::from(r);
        let [s, t] = nearest(&self.arm, &other.arm, &r);
        let between = r + t * other.arm - s * self.arm;
        let n = between.try_normalize(1e-12).unwrap_or(Vector3::from(normal).normalize());
        let is_apart = r.dot(&n) - self.support(&n) - other.support(&n) >= gap_mm;
        Decision { is_apart, normal: n.into() }
    }

    fn first_direction(&self, _: &Self, r: Vector) -> Vector {
        r
    }

    fn contact(&self, other: &Self, _: Vector, _: f64, normal: Vector, _: u32) -> PushContact {
        let n = Vector3::from(normal);
        let end = |of: &Self, along: Vector3<f64>| of.arm * of.arm.dot(&along).signum() + of.radius * along;
        PushContact {
            normal,
            supports_mm: [self.support(&n), other.support(&n)],
            arms_mm: [end(self, n).into(), end(other, -n).into()],
        }
    }

    fn reach_across_mm(&self, from_axis_mm: [f64; 2]) -> (f64, Vector) {
        let center = Vector3::new(from_axis_mm[0], from_axis_mm[1], 0.0);
        let arm = Vector3::new(self.arm.x, self.arm.y, 0.0);
        let [one, other] = [center + arm, center - arm];
        let farther = if one.norm() > other.norm() { one } else { other };
        let direction = farther.try_normalize(0.0).unwrap_or(Vector3::x());
        (farther.norm() + self.radius, direction.into())
    }
}

// The same for the check: ends of the segment, and distances by a search.

struct Prism;

impl Region for Prism {
    fn bounds_mm(&self) -> [f64; 3] {
        [4.0 * APOTHEM_MM / 3.0_f64.sqrt(), 2.0 * APOTHEM_MM, HEIGHT_MM]
    }

    fn period_mm(&self) -> Option<[f64; 3]> {
        None
    }

    fn face_distance_mm(&self, p: [f64; 3]) -> f64 {
        // Folded into the sixth part between two normals.
        let (x, y) = (p[0] - 2.0 * APOTHEM_MM / 3.0_f64.sqrt(), p[1] - APOTHEM_MM);
        let angle = y.atan2(x).rem_euclid(PI / 3.0) - PI / 6.0;
        let outward = x.hypot(y) * angle.cos();
        (APOTHEM_MM - outward).min(p[2]).min(HEIGHT_MM - p[2])
    }
}

#[derive(Clone, Debug)]
struct Rod {
    ends: [Vector3<f64>; 2],
    radius: f64,
    diameter: f64,
}

impl Rod {
    fn new(shape: &Capsule, pose: &Pose) -> Self {
        let arm = pose.orientation * Vector3::new(shape.half_length, 0.0, 0.0);
        let volume = PI * shape.radius.powi(2) * 2.0 * shape.half_length + PI / 0.75 * shape.radius.powi(3);
        Self {
            ends: [pose.center_mm - arm, pose.center_mm + arm],
            radius: shape.radius,
            diameter: (volume * 6.0 / PI).cbrt(),
        }
    }

    fn at(&self, share: f64) -> Vector3<f64> {
        self.ends[0].lerp(&self.ends[1], share)
    }

    /// From the nearest point of the segment to another point.
    fn towards(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let along = self.ends[1] - self.ends[0];
        let share = (p - self.ends[0]).dot(&along) / along.norm_squared().max(1e-300);
        p - self.at(share.clamp(0.0, 1.0))
    }
}

/// Rounding errors of these tests.
const ERROR_MM: f64 = 1e-11;

impl Body<Prism> for Rod {
    fn center(&self) -> Vector3<f64> {
        self.at(0.5)
    }

    fn radius(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm() / 2.0 + self.radius
    }

    fn equivalent_diameter(&self) -> f64 {
        self.diameter
    }

    fn reach(&self, direction: &Vector3<f64>) -> f64 {
        let ends = self.ends.map(|end| (end - self.center()).dot(direction));
        ends[0].max(ends[1]) + self.radius
    }

    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict {
        let other = Self { ends: other.ends.map(|end| end + image.shift()), ..other.clone() };
        // The distance is convex along the segment.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..200 {
            let thirds = [low + (high - low) / 3.0, high - (high - low) / 3.0];
            let [one, two] = thirds.map(|share| self.towards(&other.at(share)).norm());
            if one < two { high = thirds[1] } else { low = thirds[0] }
        }
        let between = self.towards(&other.at(0.5 * (low + high)));
        let found = Direction {
            normal: between.try_normalize(0.0).unwrap_or(Vector3::x()),
            separation: between.norm() - self.radius - other.radius,
        };
        if found.separation > enough + ERROR_MM {
            Verdict::Clear
        } else if found.separation >= required - ERROR_MM {
            Verdict::Keeps(found)
        } else {
            Verdict::TooClose(found)
        }
    }

    fn wall_gap(&self, region: &Prism, required: f64, _: f64) -> (f64, bool) {
        let distances = self.ends.map(|end| region.face_distance_mm(end.into()));
        let gap = distances[0].min(distances[1]) - self.radius;
        (gap, gap >= required - ERROR_MM)
    }
}

// The export.

struct Table;

impl Writes<OwnPacking<'_, Capsule>> for Table {
    type Report = usize;

    fn write(
        &self,
        packing: &OwnPacking<'_, Capsule>,
        _: &Limits,
        _: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<usize, ExportError> {
        for (shape, pose) in packing.shapes.iter().zip(&packing.poses) {
            let [x, y, z]: [f64; 3] = pose.center_mm.into();
            writeln!(out, "{x},{y},{z},{},{}", shape.half_length, shape.radius)?;
        }
        Ok(packing.poses.len())
    }
}

/// Capsules of falling size that fill a share of the prism.
fn capsules(fraction: f64) -> Vec<Capsule> {
    let (mut left, mut capsules) = (fraction * prism().volume_mm3, Vec::new());
    let mut radius = 2.5;
    while left > 0.0 {
        let capsule = Capsule { half_length: 1.2 * radius, radius };
        left -= capsule.volume_mm3();
        capsules.push(capsule);
        radius = (radius * 0.99_f64).max(1.2);
    }
    capsules
}

fn packed<'a>(
    capsules: &'a [Capsule],
    domain: &'a Domain,
    method: Method,
    distance: Distance,
) -> Result<(OwnPacking<'a, Capsule>, String), OwnError> {
    let orientation = &uniform_orientation;
    let mix = OwnMix { shapes: capsules, domain, distance, method, orientation, seed: 7 };
    let mut file = Vec::new();
    let (packing, rows) =
        pack_with(&mix, (Prism, Rod::new), (&Table, &mut file), &Limits::default(), &Unattended)?;
    let text = String::from_utf8(file).unwrap();
    assert_eq!(text.lines().count(), rows);
    Ok((packing, text))
}

const GAP: Distance = Distance::Constant { gap_mm: 0.1, wall_gap_mm: None };

fn growth() -> Method {
    Method::Growth { options: GrowthOptions::default() }
}

#[test]
fn capsules_in_a_prism_are_packed_checked_and_written() {
    let domain = prism();
    for (method, fraction, expected) in [
        (Method::Rsa { attempts_per_grain: None }, 0.2, MethodUsed::Rsa),
        (growth(), 0.5, MethodUsed::MonteCarlo),
    ] {
        let capsules = capsules(fraction);
        let (packing, text) = packed(&capsules, &domain, method, GAP).unwrap();
        assert_eq!((packing.method_used, text.lines().count()), (expected, capsules.len()));
        assert!(packing.gaps.min_gap_mm.is_some_and(|gap| gap >= 0.1 - ERROR_MM), "{:?}", packing.gaps);
        assert!(packing.gaps.min_wall_gap_mm.is_some_and(|gap| gap >= 0.05 - ERROR_MM));
        let (_, again) = packed(&capsules, &domain, method, GAP).unwrap();
        assert!(text == again, "a seed gives one packing");
    }
}

#[test]
fn a_grain_that_is_moved_into_its_neighbour_or_a_wall_fails_the_check() {
    let (domain, capsules) = (prism(), capsules(0.4));
    let (packing, _) = packed(&capsules, &domain, growth(), GAP).unwrap();
    let rods: Vec<Rod> = capsules.iter().zip(&packing.poses).map(|(c, pose)| Rod::new(c, pose)).collect();
    let check = |rods: &[Rod]| check_bodies(rods, Prism, GAP, NonZeroUsize::MIN, &Unattended);
    let gaps: check::Gaps = check(&rods).unwrap();
    assert_eq!(gaps, packing.gaps);
    let [first, second] = gaps.closest.unwrap();
    let moved_by = |grain: usize, by: Vector3<f64>| {
        let mut rods = rods.clone();
        rods[grain].ends = rods[grain].ends.map(|end| end + by);
        check(&rods)
    };
    let towards = (rods[second].center() - rods[first].center()).normalize();
    let fault = moved_by(first, 0.2 * towards).unwrap_err();
    assert!(matches!(fault, Fault::Pair { .. }), "{fault}");
    let nearest = gaps.closest_to_wall.unwrap();
    let outward = moved_by(nearest, 40.0 * sides()[1]).unwrap_err();
    assert!(matches!(outward, Fault::Wall { grain, .. } if grain == nearest), "{outward}");
}

#[test]
fn bodies_that_are_larger_than_the_grains_fail_the_check_of_a_packing() {
    let (domain, capsules) = (prism(), capsules(0.4));
    let orientation = &uniform_orientation;
    let mix =
        OwnMix { shapes: &capsules, domain: &domain, distance: GAP, method: growth(), orientation, seed: 7 };
    let thicker = |shape: &Capsule, pose: &Pose| Rod { radius: 1.1 * shape.radius, ..Rod::new(shape, pose) };
    let mut file = Vec::new();
    let refused = pack_with(&mix, (Prism, thicker), (&Table, &mut file), &Limits::default(), &Unattended);
    assert!(matches!(refused, Err(OwnError::Check(_))), "{:?}", refused.err());
    assert!(file.is_empty());
}

#[test]
fn what_is_not_offered_is_refused_and_what_does_not_fit_is_said() {
    let (domain, many) = (prism(), capsules(0.4));
    let refusal = |capsules: &[Capsule], method, distance| {
        packed(capsules, &domain, method, distance).unwrap_err().to_string()
    };
    let ascending = [many[9], many[0]];
    assert_eq!(
        refusal(&ascending, growth(), GAP),
        "grain 1 is larger than the one before it: must be in the order of their volume, largest first"
    );
    let edmd = Method::Edmd { options: GrowthOptions::default() };
    assert_eq!(refusal(&many, edmd, GAP), "growth by events is offered to spheres alone");
    let largest = Distance::Maximize { wall_gap_mm: None };
    assert_eq!(refusal(&many, growth(), largest), "a largest distance is offered by requests alone");
    let long = [Capsule { half_length: 40.0, radius: 1.0 }];
    let few = Method::Rsa { attempts_per_grain: Some(1000) };
    assert_eq!(refusal(&long, few, GAP), "found no place for grain 0, after 1000 attempts");
}

#[test]
fn planes_that_enclose_nothing_are_no_domain() {
    let open: Vec<FacePlane> = sides().iter().map(|side| FacePlane::new(-side, 9.0 * side)).collect();
    assert_eq!(Domain::polytope(&open, &FACES[..6]), Err(PolytopeError::NotAFace { index: 0 }));
    assert_eq!(Domain::polytope(&open, &FACES), Err(PolytopeError::Names { names: 8, number: 6 }));
    let about_the_origin: Vec<FacePlane> = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .flat_map(|axis| [FacePlane::new(axis, -axis), FacePlane::new(-axis, axis)])
        .collect();
    let refused = Domain::polytope(&about_the_origin, &FACES[..6]).unwrap_err();
    assert_eq!(refused.to_string(), "the bounding box begins at -1 mm along axis 0: must begin at 0");
    assert!((prism().volume_mm3 - 2.0 * 3.0_f64.sqrt() * APOTHEM_MM.powi(2) * HEIGHT_MM).abs() < 1e-8);
}

/// The defaults of a shape whose axes are its principal axes.
#[test]
fn the_principal_axes_are_those_of_the_grain() {
    let capsule = Capsule { half_length: 2.0, radius: 1.0 };
    let unit: Orientation = [0.5; 4];
    assert_eq!(capsule.to_principal(unit), unit);
    let turned = capsule.turned(&capsule.rows(&Pose::at(Vector3::zeros())));
    assert_eq!(turned.arm, Vector3::new(2.0, 0.0, 0.0));
}
