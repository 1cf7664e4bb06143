//! Every closed form against roots of thirty digits.
//!
//! These are found by bisection on the pieces on which a parabola is monotone, so that they share no
//! formula with what they judge.

use crate::properties::properties;
use proptest::prelude::*;

use super::collisions::{anywhere, growth, unit};
use super::double::{self, Double, Vector, vector};
use super::*;
use crate::methods::edmd::contact::{falls_to_zero, rises_to_zero, used_up};

const EPSILON: f64 = f64::EPSILON;

/// `c + 2 b t + a t²`.
#[derive(Clone, Copy, Debug)]
struct Parabola {
    a: Double,
    b: Double,
    c: Double,
}

impl Parabola {
    fn at(&self, t: Double) -> Double {
        self.c + (self.b + self.b) * t + self.a * t * t
    }

    /// Sum of the magnitudes of the terms: what rounding is measured by.
    fn magnitude(&self, t: f64) -> f64 {
        f64::from(self.c.abs()) + 2.0 * f64::from(self.b.abs()) * t + f64::from(self.a.abs()) * t * t
    }

    /// The first time after 0 at which it falls to zero from above; `None` where it never does.
    fn falls_to_zero(&self) -> Option<Double> {
        let zero = Double::from(0.0);
        let vertex = -self.b / self.a;
        if self.b < zero && self.a > zero {
            // Falls up to the vertex, and rises for ever.
            return (self.at(vertex) <= zero).then(|| self.bisect(zero, vertex));
        }
        // Falls for ever, at once or from the vertex on.
        let from = if self.b < zero { zero } else { vertex };
        if self.b >= zero && self.a >= zero {
            return None;
        }
        let mut step = Double::from(1e-9);
        while self.at(from + step) > zero {
            step = step + step;
        }
        Some(self.bisect(from, from + step))
    }

    /// The interval may be 10^21 times the root: 70 halvings reach the root, 107 more its thirty digits.
    fn bisect(&self, mut above: Double, mut below: Double) -> Double {
        for _ in 0..200 {
            let middle = (above + below) * 0.5.into();
            if self.at(middle) > 0.0.into() { above = middle } else { below = middle }
        }
        below
    }

    /// How much larger the error of the root may be than that of the coefficients.
    fn condition(&self) -> f64 {
        let (square, product) = (self.b * self.b, self.a * self.c);
        f64::from((square + product.abs()) / (square - product).abs())
    }

    /// Judges a root that was computed, from coefficients that are exact.
    fn judge(&self, computed: f64) -> Result<(), TestCaseError> {
        let Some(exact) = self.falls_to_zero() else {
            let grazing = self.condition() > 0.1 / EPSILON;
            prop_assert!(computed == f64::INFINITY || grazing, "{computed} where there is no root: {self:?}");
            return Ok(());
        };
        if computed == f64::INFINITY {
            prop_assert!(
                self.condition() > 0.1 / EPSILON,
                "no root where there is one at {exact:?}: {self:?}"
            );
            return Ok(());
        }
        let error = f64::from((exact - computed.into()).abs() / exact);
        let allowed = EPSILON * (8.0 + 2.0 * self.condition());
        prop_assert!(error <= allowed, "{computed} is off by {error:e}, {allowed:e} allowed: {self:?}");
        let left = f64::from(self.at(computed.into()).abs());
        prop_assert!(
            left <= 16.0 * EPSILON * self.magnitude(computed),
            "{left:e} left at {computed}: {self:?}"
        );
        Ok(())
    }
}

/// A number of either sign and of many magnitudes.
fn signed(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from..to, any::<bool>()).prop_map(|(exponent, negative)| {
        let magnitude = 10.0_f64.powf(exponent);
        if negative { -magnitude } else { magnitude }
    })
}

#[test]
fn the_reference_is_exact_where_the_root_is_far_from_the_vertex() {
    // Found by the property below: 120 halvings left the reference with fifteen digits.
    let (a, b, c) = (1.656_695_118_597_402_4e-6, -955.795_123_561_231_5, 2.754_485_310_691_207_4e-10);
    let exact = Parabola { a: a.into(), b: b.into(), c: c.into() };
    exact.judge(falls_to_zero(a, b, c)).unwrap();
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(5000))]
    #[test]
    fn roots_have_the_digits_that_their_condition_leaves(
        a in signed(-6.0, 2.0), b in signed(-6.0, 3.0), c in -10.0..4.0_f64,
    ) {
        let c = 10.0_f64.powf(c);
        let exact = Parabola { a: a.into(), b: b.into(), c: c.into() };
        exact.judge(falls_to_zero(a, b, c))?;
        prop_assert_eq!(rises_to_zero(-a, -b, -c), falls_to_zero(a, b, c));
    }

    #[test]
    fn double_roots_graze_or_miss(a in 1e-3..10.0_f64, t in 1e-3..100.0_f64, off in signed(-17.0, -6.0)) {
        // All but a double root at t.
        let (b, c) = (-a * t, a * t * t * (1.0 + off));
        Parabola { a: a.into(), b: b.into(), c: c.into() }.judge(falls_to_zero(a, b, c))?;
    }

    #[test]
    fn what_rounding_violates_closes_now_or_never(
        a in signed(-6.0, 2.0), b in 1e-9..1e3_f64, c in -20.0..-9.0_f64,
    ) {
        let c = -10.0_f64.powf(c);
        prop_assert_eq!(falls_to_zero(a, -b, c), 0.0, "closing");
        prop_assert_eq!(falls_to_zero(a, -b, 0.0), 0.0, "closing");
        for c in [c, 0.0] {
            let opening = falls_to_zero(a, b, c);
            if a > 0.0 {
                prop_assert_eq!(opening, f64::INFINITY);
            } else {
                // Not before it has begun to close again.
                prop_assert!(opening >= (1.0 - 4.0 * EPSILON) * b / -a && opening < f64::INFINITY, "{opening}");
            }
        }
    }

    #[test]
    fn a_distance_is_used_up_at_its_rate(distance in 0.0..100.0_f64, rate in signed(-6.0, 2.0)) {
        let after = used_up(distance, rate);
        if rate > 0.0 {
            prop_assert_eq!(after, f64::INFINITY);
        } else {
            let left = Double::from(distance) + Double::from(rate) * after.into();
            prop_assert!(f64::from(left.abs()) <= EPSILON * distance);
        }
        prop_assert_eq!(used_up(-1e-15, -rate.abs()), 0.0, "violated by rounding");
    }
}

/// Contact distance of a pair and its rate, to thirty digits.
fn contact(growth: Growth, r_a: f64, r_b: f64) -> (Double, Double) {
    let double = Double::from;
    let start = double(r_a) + r_b.into() + double(growth.kappa) * r_a.min(r_b).into();
    (start, double(growth.alpha) * start + double(2.0 * growth.beta))
}

/// Squared distance of two grains less the squared contact distance.
fn pair_parabola(growth: Growth, a: Placed, b: Placed) -> Parabola {
    let minus =
        |a: [f64; 3], b: [f64; 3]| -> Vector { std::array::from_fn(|k| Double::from(a[k]) - b[k].into()) };
    let (way, motion) = (minus(b.position, a.position), minus(b.velocity, a.velocity));
    let (start, rate) = contact(growth, a.radius, b.radius);
    Parabola {
        a: double::dot(motion, motion) - rate * rate,
        b: double::dot(way, motion) - start * rate,
        c: double::dot(way, way) - start * start,
    }
}

const EDGE_MM: f64 = 120.0;
/// Rounding of positions in the box, for the few times that a record is moved on.
const ROUNDING_MM: f64 = 8.0 * EPSILON * EDGE_MM;

/// Lets two grains meet and judges when they did. What a time is off by, times the speed of closing in,
/// is a length, and no more than rounding of the positions: a relative error of the time of a few 1e-14
/// wherever they meet at an angle.
fn judge_meeting(growth: Growth, grains: [Placed; 2], end_s: f64) -> Result<bool, TestCaseError> {
    let [a, b] = grains;
    let exact = pair_parabola(growth, a, b);
    let mut scene = Scene::new(Container::Box { size_mm: [EDGE_MM; 3] }, growth, end_s, &grains);
    let met = scene.collide();
    let first = exact.falls_to_zero().filter(|&t| t < end_s.into());
    let (start, rate) = contact(growth, a.radius, b.radius);
    let clear =
        |t: Double| (exact.at(t) + (start + rate * t) * (start + rate * t)).sqrt() - (start + rate * t);
    match (met, first) {
        (Some(met), Some(first)) => {
            let left = f64::from(clear(met.into()).abs());
            prop_assert!(left <= ROUNDING_MM, "{left:e} mm left at {met}");
            // Half the slope of the squares, over the distance.
            let slope = (exact.b + exact.a * first) / (start + rate * first);
            let off = f64::from(((first - met.into()) * slope).abs());
            prop_assert!(off <= ROUNDING_MM, "{met} instead of {first:?} is {off:e} mm off");
        }
        (None, None) => {}
        // A miss and a hit by less than rounding are one.
        (Some(met), None) => {
            prop_assert!(f64::from(clear(met.into()).abs()) <= ROUNDING_MM, "met at {met} for nothing");
        }
        (None, Some(first)) => {
            let deepest = if exact.a > 0.0.into() { -exact.b / exact.a } else { end_s.into() };
            let depth = f64::from(clear(if deepest < end_s.into() { deepest } else { end_s.into() }));
            prop_assert!(depth > -ROUNDING_MM, "missed {first:?} by {depth:e} mm");
        }
    }
    Ok(met.is_some())
}

fn across(normal: [f64; 3], any: [f64; 3]) -> [f64; 3] {
    let part = plus_times(any, -dot(any, normal), normal);
    part.map(|x| x / dot(part, part).sqrt())
}

/// Two grains near the middle of the box with a gap in shares of their contact distance, and a relative
/// velocity made of a part along the line of their centres and one across.
fn pair(
    growth: Growth,
    parts: ([f64; 3], [f64; 3], [f64; 2]),
    gap: f64,
    along: f64,
    slide: f64,
) -> [Placed; 2] {
    let (center, normal, [r_a, r_b]) = parts;
    let (start, _) = growth.pair(r_a, r_b);
    let position = center.map(|x| x + EDGE_MM / 2.0);
    let velocity = [0.05, -0.02, 0.03];
    let aside = across(normal, [0.3, 0.5, -0.7]);
    let a = Placed { position, velocity, radius: r_a, mass: 1.0 };
    let b = Placed {
        position: plus_times(position, start * (1.0 + gap), normal),
        velocity: plus_times(plus_times(velocity, along, normal), slide, aside),
        radius: r_b,
        mass: 2.0,
    };
    [a, b]
}

fn parts() -> impl Strategy<Value = ([f64; 3], [f64; 3], [f64; 2])> {
    (anywhere(10.0), unit(), prop::array::uniform2(0.5..6.0_f64))
        .prop_filter("a way across", |(_, normal, _)| dot(*normal, [0.3, 0.5, -0.7]).abs() < 0.9)
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn approaching_grains_meet_in_time(
        growth in growth(), parts in parts(), gap in -9.0..0.0_f64, along in -2.0..-0.3_f64, slide in -0.5..0.5_f64,
    ) {
        let gap = 10.0_f64.powf(gap);
        judge_meeting(growth, pair(growth, parts, gap, along, slide * along), 20.0)?;
    }

    #[test]
    fn receding_grains_are_overtaken_by_growth_or_get_away(
        growth in growth(), parts in parts(), gap in -9.0..-1.5_f64, share in 0.0..2.0_f64, slide in -0.3..0.3_f64,
    ) {
        let gap = 10.0_f64.powf(gap);
        let (_, rate) = growth.pair(parts.2[0], parts.2[1]);
        // Slower or faster than the surfaces grow; without growth all get away.
        let along = if rate > 0.0 { share * rate } else { share };
        let met = judge_meeting(growth, pair(growth, parts, gap, along, slide * along), 5.0)?;
        prop_assert!(!met || share < 1.0, "met while receding faster than growth");
    }

    #[test]
    fn grains_that_pass_by_touch_or_do_not(parts in parts(), before in 1.0..2.0_f64, off in signed(-17.0, -2.0)) {
        let (center, normal, [r_a, r_b]) = parts;
        let growth = Growth { wall_factor: 1.0, ..Growth::default() };
        let position = center.map(|x| x + EDGE_MM / 2.0);
        let aside = across(normal, [0.3, 0.5, -0.7]);
        // Past each other at a distance that is all but theirs in contact.
        let beside = plus_times(position, (r_a + r_b) * (1.0 + off), normal);
        let a = Placed { position, velocity: [0.0; 3], radius: r_a, mass: 1.0 };
        let b = Placed {
            position: plus_times(beside, -before * (r_a + r_b), aside), velocity: aside, radius: r_b, mass: 1.0,
        };
        let met = judge_meeting(growth, [a, b], 1.2 * before * (r_a + r_b))?;
        let depth_mm = -off * (r_a + r_b);
        prop_assert!(met || depth_mm < ROUNDING_MM, "passed through {depth_mm:e} mm deep");
        prop_assert!(!met || depth_mm > -ROUNDING_MM, "met {depth_mm:e} mm apart");
    }

    #[test]
    fn grains_in_contact_part_or_collide_at_once(
        growth in growth(), parts in parts(), off in -8..=8_i32, along in signed(-3.0, 0.0), slide in -0.5..0.5_f64,
    ) {
        let (_, rate) = growth.pair(parts.2[0], parts.2[1]);
        let grains = pair(growth, parts, f64::from(off) * EPSILON, along + rate, slide * along);
        let mut scene = Scene::new(Container::Box { size_mm: [EDGE_MM; 3] }, growth, 1e-3, &grains);
        let met = scene.collide();
        if along > 0.0 {
            prop_assert_eq!(met, None, "surfaces that part do not collide");
        } else {
            prop_assert!(met.is_some_and(|t| t * -along < 1e2 * ROUNDING_MM), "{met:?}");
        }
    }
}

const RADIUS_MM: f64 = 25.0;

/// The room left of a grain in a cylinder less its distance from the axis, both squared.
fn mantle_parabola(p: [f64; 3], v: [f64; 3], contact: f64, rate: f64) -> Parabola {
    let double = Double::from;
    let bound = double(RADIUS_MM) - contact.into();
    let (x, y) = (double(p[0]) - RADIUS_MM.into(), double(p[1]) - RADIUS_MM.into());
    let (v, rate) = (vector(v), double(rate));
    Parabola {
        a: rate * rate - v[0] * v[0] - v[1] * v[1],
        b: -(bound * rate + x * v[0] + y * v[1]),
        c: bound * bound - x * x - y * y,
    }
}

fn cylinder() -> Container {
    Container::Cylinder { radius_mm: RADIUS_MM, height_mm: 60.0 }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(5000))]
    #[test]
    fn the_mantle_is_met_in_time(
        share in 0.0..1.0_f64, angle in 0.0..7.0_f64, v in anywhere(1.0), contact in 0.2..24.0_f64,
        rate in prop_oneof![Just(0.0), (-6.0..1.0_f64).prop_map(|exponent| 10.0_f64.powf(exponent))],
    ) {
        let out = share * (RADIUS_MM - contact);
        let p = [RADIUS_MM + out * angle.cos(), RADIUS_MM + out * angle.sin(), 30.0];
        let exact = mantle_parabola(p, v, contact, rate);
        let computed = cylinder().time_to_wall(0, p, v, contact, rate);
        let Some(first) = exact.falls_to_zero() else { return Err(TestCaseError::fail("it must be met")) };
        prop_assert!(computed.is_finite(), "not met, instead of at {first:?}");
        // In lengths, as for pairs; where room and way from the axis both vanish only their squares are known.
        let bound = Double::from(RADIUS_MM) - contact.into() - Double::from(rate) * computed.into();
        let left = f64::from(exact.at(computed.into()).abs());
        let known = ROUNDING_MM * f64::from(bound.abs()) + 64.0 * EPSILON * exact.magnitude(computed);
        prop_assert!(left <= known, "{left:e} mm2 left at {computed}, {known:e} known");
        let slope = f64::from((exact.b + exact.a * first).abs());
        let off = f64::from((first - computed.into()).abs());
        prop_assert!(off * slope <= known, "{computed} instead of {first:?}");
    }

    #[test]
    fn a_grain_on_the_axis_grows_up_to_the_mantle(contact in 0.2..24.0_f64, rate in 1e-6..1.0_f64, along in -1.0..1.0_f64) {
        // At rest across, the parabola has a double root: when the room is used up.
        let p = [RADIUS_MM, RADIUS_MM, 30.0];
        let computed = cylinder().time_to_wall(0, p, [0.0, 0.0, along], contact, rate);
        let expected = (RADIUS_MM - contact) / rate;
        prop_assert!((computed / expected - 1.0).abs() < 1e-7, "{computed} instead of {expected}");
    }

    #[test]
    fn planes_are_met_in_time(
        share in anywhere(1.0), v in anywhere(1.0), contact in 0.2..20.0_f64,
        rate in prop_oneof![Just(0.0), 1e-6..0.5_f64], wall in 0_u32..6,
    ) {
        let size = [41.0, 50.0, 59.0];
        let (axis, low) = ((wall / 2) as usize, wall % 2 == 0);
        let p: [f64; 3] = std::array::from_fn(|k| size[k] / 2.0 + share[k] * (size[k] / 2.0 - contact));
        let computed = Container::Box { size_mm: size }.time_to_wall(wall, p, v, contact, rate);
        let double = Double::from;
        let clear = if low { double(p[axis]) } else { double(size[axis]) - p[axis].into() } - contact.into();
        let closing = if low { v[axis] } else { -v[axis] };
        let closing = double(closing) - rate.into();
        if closing >= 0.0.into() {
            prop_assert_eq!(computed, f64::INFINITY);
        } else {
            let off = f64::from((clear + closing * computed.into()).abs());
            prop_assert!(off <= 4.0 * EPSILON * size[axis], "{off:e} mm left at {computed}");
        }
    }

    #[test]
    fn the_sphere_of_free_movement_is_left_in_time(way in anywhere(1.0), v in anywhere(1.0), skin in 1.8..3.0_f64) {
        let (a, b, c) = (dot(v, v), dot(way, v), dot(way, way) - skin * skin);
        let computed = rises_to_zero(a, b, c);
        let (way, v) = (vector(way), vector(v));
        let exact = Parabola {
            a: -double::dot(v, v),
            b: -double::dot(way, v),
            c: Double::from(skin) * skin.into() - double::dot(way, way),
        };
        let first = exact.falls_to_zero().unwrap();
        let error = f64::from((first - computed.into()).abs() / first);
        // The way to go is a difference of at most four parts in five.
        prop_assert!(error < 3e-14, "{computed} instead of {first:?}: {error:e}");
    }
}
