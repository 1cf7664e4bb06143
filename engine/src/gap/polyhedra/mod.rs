//! Gaps between convex polyhedra, rounded or not.
//!
//! `s(n)` is evaluated by scanning all vertices of the template, which lie in columns in its principal axes: `n` is
//! turned to them, no vertex is turned. A direction is sought by the algorithm of
//! Gilbert, Johnson and Keerthi 1988 ([doi:10.1109/56.2083](https://doi.org/10.1109/56.2083)) on the differences of the
//! vertices: the point of a growing simplex that is nearest to the origin gives the next `n`. A direction that parted
//! the pair before is tried first. A nearest point in the inside of a triangle gives the triangle's normal, which stays
//! exact where the bodies nearly touch. Where they overlap, the least depth and its normal come from the expanding
//! polytope (`penetration`).
//!
//! Implementations of this algorithm are known to err in plain cases (near-degenerate simplices), so its verdict counts
//! for nothing: a pair is apart only if `s(n) >= g` for the direction found, and counts as too close if none was found.
//!
//! Rounding adds a radius to each support function; all simplices are those of the cores, without it.

mod grains;
mod penetration;
mod simplex;

use nalgebra::Vector3;

use super::grain::ConvexShape;
use super::linear::{Symmetric, Vector};
use crate::arrays::Each as _;
use crate::cpu::Cpu;
use crate::shape::{Polyhedron, Pose, Principal, ScaledPolyhedron};
use simplex::{Difference, Simplex};

/// Steps after which a search ends; it takes some three to six.
const MOST_STEPS: usize = 100;
/// How much wider than known to suffice each turn of the search for the least widening looks, and the factor of a gain
/// that is worth another.
pub(super) const WIDER: f64 = 1.1;
const LEAST_GAIN: f64 = 1.0 - 1e-4;

/// A polyhedron, turned.
#[derive(Clone, Copy, Debug)]
pub struct TurnedPolyhedron<'a> {
    /// Rotation of the principal axes, by rows.
    rows: [Vector; 3],
    principal: &'a Principal,
    scale_mm: f64,
    rounding_mm: f64,
    /// Shape matrix of the ellipsoid around it.
    around: Symmetric,
}

/// What a pair reads of a turned body: the core, to which the rounding is added.
pub trait Core: Copy {
    /// Whether one point alone attains the support function along any direction.
    const IS_SMOOTH: bool;

    /// Support function of the core in mm for a unit vector, and a point that attains it, relative to the centre.
    fn core_support(&self, n: &Vector3<f64>) -> (f64, Vector3<f64>);

    /// Support function of the core in mm for a unit vector.
    fn core_height_mm(&self, n: &Vector3<f64>) -> f64;

    /// Radius of rounding in mm.
    fn rounding_mm(&self) -> f64;

    /// About the radius of the sphere that holds the body, in mm.
    fn size_mm(&self) -> f64;

    /// Points of the core that span what attains its support function along a unit vector within a tolerance.
    fn attaining(&self, n: &Vector3<f64>, tolerance: f64) -> Vec<Vector3<f64>>;
}

impl Core for TurnedPolyhedron<'_> {
    const IS_SMOOTH: bool = false;

    /// The point is a vertex.
    #[inline(always)]
    fn core_support(&self, n: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let [x, y, z] = self.local([n.x, n.y, n.z]);
        let mut best = [f64::NEG_INFINITY; 4];
        // Numbers of groups as floats, which share the masks of the heights.
        let mut at = [0.0_f64; 4];
        let mut number = 0.0;
        for group in &self.principal.groups {
            for lane in 0..4 {
                let h = x * group[0][lane] + y * group[1][lane] + z * group[2][lane];
                let is_larger = h > best[lane];
                best[lane] = if is_larger { h } else { best[lane] };
                at[lane] = if is_larger { number } else { at[lane] };
            }
            number += 1.0;
        }
        let mut lane = 0;
        for other in 1..4 {
            if best[other] > best[lane] {
                lane = other;
            }
        }
        let [x, y, z] = &self.principal.groups[at[lane] as usize];
        let vertex = [x[lane] * self.scale_mm, y[lane] * self.scale_mm, z[lane] * self.scale_mm];
        (best[lane] * self.scale_mm, self.in_space(vertex))
    }

    #[inline(always)]
    fn core_height_mm(&self, n: &Vector3<f64>) -> f64 {
        self.height(self.local([n.x, n.y, n.z])) * self.scale_mm
    }

    #[inline(always)]
    fn rounding_mm(&self) -> f64 {
        self.rounding_mm
    }

    /// Of the ellipsoid around it.
    fn size_mm(&self) -> f64 {
        self.principal.around[0].max(self.principal.around[1]).max(self.principal.around[2]) * self.scale_mm
    }

    fn attaining(&self, n: &Vector3<f64>, tolerance: f64) -> Vec<Vector3<f64>> {
        let least = self.core_support(n).0 - tolerance;
        self.vertices().filter(|v| v.dot(n) >= least).collect()
    }
}

/// An ellipsoid by its shape matrix, which is its own core.
impl Core for Symmetric {
    const IS_SMOOTH: bool = true;

    #[inline(always)]
    fn core_support(&self, n: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let of_n = self.times([n.x, n.y, n.z]);
        let height = super::linear::dot([n.x, n.y, n.z], of_n).sqrt();
        (height, Vector3::from(of_n) / height)
    }

    #[inline(always)]
    fn core_height_mm(&self, n: &Vector3<f64>) -> f64 {
        self.quadratic([n.x, n.y, n.z]).sqrt()
    }

    #[inline(always)]
    fn rounding_mm(&self) -> f64 {
        0.0
    }

    fn size_mm(&self) -> f64 {
        let [xx, _, _, yy, _, zz] = self.0;
        (xx + yy + zz).sqrt()
    }

    fn attaining(&self, n: &Vector3<f64>, _: f64) -> Vec<Vector3<f64>> {
        vec![self.core_support(n).1]
    }
}

impl TurnedPolyhedron<'_> {
    /// A vector in the principal axes.
    #[inline(always)]
    fn local(&self, n: Vector) -> Vector {
        let [x, y, z] = &self.rows;
        [
            n[0] * x[0] + n[1] * y[0] + n[2] * z[0],
            n[0] * x[1] + n[1] * y[1] + n[2] * z[1],
            n[0] * x[2] + n[1] * y[2] + n[2] * z[2],
        ]
    }

    /// Support function of the core for a vector in the principal axes, times its length, in units of the scale.
    #[inline(always)]
    fn height(&self, [x, y, z]: Vector) -> f64 {
        let mut best = [[f64::NEG_INFINITY; 4]; 2];
        // Two at a time, for the processor waits for the larger of two numbers.
        let pairs = self.principal.groups.chunks_exact(2);
        let last = pairs.remainder();
        for pair in pairs {
            for lane in 0..4 {
                let h = x * pair[0][0][lane] + y * pair[0][1][lane] + z * pair[0][2][lane];
                best[0][lane] = if h > best[0][lane] { h } else { best[0][lane] };
                let h = x * pair[1][0][lane] + y * pair[1][1][lane] + z * pair[1][2][lane];
                best[1][lane] = if h > best[1][lane] { h } else { best[1][lane] };
            }
        }
        let [mut best, other] = best;
        for lane in 0..4 {
            best[lane] = if other[lane] > best[lane] { other[lane] } else { best[lane] };
        }
        for group in last {
            for lane in 0..4 {
                let h = x * group[0][lane] + y * group[1][lane] + z * group[2][lane];
                best[lane] = if h > best[lane] { h } else { best[lane] };
            }
        }
        let [a, b, c, d] = best;
        let (ab, cd) = (if a > b { a } else { b }, if c > d { c } else { d });
        if ab > cd { ab } else { cd }
    }

    /// A vector of the principal axes.
    #[inline(always)]
    fn in_space(&self, v: Vector) -> Vector3<f64> {
        let [x, y, z] = &self.rows;
        Vector3::new(super::linear::dot(*x, v), super::linear::dot(*y, v), super::linear::dot(*z, v))
    }

    /// The vertices relative to the centre, in mm.
    fn vertices(&self) -> impl Iterator<Item = Vector3<f64>> {
        self.principal.groups.iter().flat_map(move |[x, y, z]| {
            (0..4).map(move |lane| self.in_space([x[lane], y[lane], z[lane]].each(|x| x * self.scale_mm)))
        })
    }
}

/// A polyhedron with position and orientation.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Centre in mm.
    pub center_mm: Vector3<f64>,
    /// The polyhedron about its centre.
    pub turned: TurnedPolyhedron<'a>,
    /// Radius of rounding in mm.
    pub rounding_mm: f64,
    /// Radius of the sphere around the centre that holds the body, in mm.
    pub outer_mm: f64,
    /// Radius of the largest sphere around the centre within the body, in mm.
    pub inner_mm: f64,
}

impl<'a> Body<'a> {
    /// A template of a scale, placed.
    pub fn new(template: &'a Polyhedron, scale_mm: f64, pose: &Pose) -> Self {
        let shape = ScaledPolyhedron { template, scale_mm };
        Self {
            center_mm: pose.center_mm,
            turned: shape.turned(&shape.rows(pose)),
            rounding_mm: scale_mm * template.rounding(),
            outer_mm: shape.outer_mm(),
            inner_mm: shape.inner_mm(),
        }
    }

    /// Support function `h(n)` in mm for a unit vector.
    pub fn support_mm(&self, n: &Vector3<f64>) -> f64 {
        self.core_support(n).0 + self.rounding_mm
    }

    #[inline(always)]
    fn core_support(&self, n: &Vector3<f64>) -> (f64, Vector3<f64>) {
        self.turned.core_support(n)
    }

    /// This body and another.
    pub fn with<'b>(&'b self, other: &'b Self) -> Pair<'b> {
        self.with_at(other, other.center_mm)
    }

    /// This body and another whose centre is moved, as a periodic image's is.
    pub fn with_at<'b>(&'b self, other: &'b Self, center_mm: Vector3<f64>) -> Pair<'b> {
        Pair { a: &self.turned, b: &other.turned, r: center_mm - self.center_mm }
    }
}

/// Two bodies, of which one at least is a polyhedron.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a, A = TurnedPolyhedron<'a>, B = TurnedPolyhedron<'a>> {
    /// The first body.
    pub a: &'a A,
    /// The second body.
    pub b: &'a B,
    /// From the centre of the first to that of the second, in mm.
    pub r: Vector3<f64>,
}

/// Whether two bodies keep a gap.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// Whether `s(n)` is at least the gap, for the normal given.
    pub is_apart: bool,
    /// The last direction tried, a unit vector: to be stored with the pair and tried first the next time.
    pub normal: Vector3<f64>,
}

/// How far two bodies lie apart, or how deep they overlap.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// `s(n)` in mm: the gap, or minus the depth.
    pub gap_mm: f64,
    /// The direction `n` from the first body to the second, a unit vector.
    pub normal: Vector3<f64>,
    /// The points of the surfaces that are nearest to each other, or deepest in the other body, relative to the
    /// centres.
    pub points_mm: [Vector3<f64>; 2],
}

/// How a search ended.
enum End {
    /// `s(n)` is enough.
    Apart,
    /// The simplex holds the nearest point, which is not far enough.
    Near(Simplex),
    /// The simplex holds the origin.
    Overlap(Simplex),
}

impl<A: Core, B: Core> Pair<'_, A, B> {
    /// `s(n)` in mm for a unit vector.
    pub fn separation_mm(&self, n: &Vector3<f64>) -> f64 {
        let core = self.r.dot(n) - self.a.core_support(n).0 - self.b.core_support(&-n).0;
        core - self.a.rounding_mm() - self.b.rounding_mm()
    }

    /// Whether the bodies keep a gap, from the line of the centres.
    pub fn decide(&self, gap_mm: f64) -> Decision {
        self.decide_from(gap_mm, &self.r)
    }

    /// Whether the bodies keep a gap, from the direction that was found for the pair before.
    pub fn decide_from(&self, gap_mm: f64, normal: &Vector3<f64>) -> Decision {
        Cpu::detect().call(
            #[inline(always)]
            || self.decide_with(gap_mm, normal),
        )
    }

    #[inline(always)]
    fn decide_with(&self, gap_mm: f64, normal: &Vector3<f64>) -> Decision {
        let enough = gap_mm + self.rounding_mm();
        let (best, end) = self.search(normal, enough, enough);
        Decision { is_apart: matches!(end, End::Apart), normal: best.1 }
    }

    /// The gap of the bodies or the least depth to which they overlap, with the points where they do.
    pub fn contact(&self) -> Contact {
        self.contact_from(&self.r)
    }

    /// The same, from the direction that was found for the pair before.
    pub fn contact_from(&self, normal: &Vector3<f64>) -> Contact {
        let (best, end) = self.search(normal, f64::INFINITY, 0.0);
        let (normal, points) = match end {
            End::Near(simplex) if best.0 > 0.0 => (best.1, self.nearest_points(&best.1, &simplex)),
            End::Near(simplex) | End::Overlap(simplex) => {
                let deepest = penetration::least_depth(self, simplex.corners()).unwrap_or(best.1);
                let n = if self.core_separation(&deepest).0 >= best.0 { deepest } else { best.1 };
                (n, self.deepest_points(&n))
            }
            End::Apart => (best.1, self.deepest_points(&best.1)),
        };
        Contact {
            gap_mm: self.separation_mm(&normal),
            normal,
            points_mm: [points[0] + normal * self.a.rounding_mm(), points[1] - normal * self.b.rounding_mm()],
        }
    }

    /// Of bodies that are too close along a direction: one along which their centres need be moved apart by nearly the
    /// least factor, with the points of the cores that face each other there.
    ///
    /// The factor along `n` is `(h_A(n) + h_B(n) + g) / (r · n)`. With centres that lie apart by somewhat more than the
    /// factor of a known direction the pair keeps its gap, and the direction of its distance has a smaller factor
    /// (Dinkelbach 1967, DOI 10.1287/mnsc.13.7.492), again and again.
    #[inline(always)]
    fn widening_from(
        &self,
        normal: &Vector3<f64>,
        gap_mm: f64,
        turns: u32,
    ) -> (Vector3<f64>, [Vector3<f64>; 2]) {
        let mut n = *normal;
        if self.r.dot(&n) <= 0.0 {
            n = self.r.try_normalize(0.0).unwrap_or(n);
        }
        let mut best = 1.0 / self.factor(&n, gap_mm);
        let mut points = None;
        for _ in 0..turns {
            let wider = Self { r: self.r * (best * WIDER), ..*self };
            let ((s, next), end) = wider.search(&n, f64::INFINITY, 0.0);
            let End::Near(simplex) = end else { break };
            let factor = 1.0 / self.factor(&next, gap_mm);
            if s <= 0.0 || factor.is_nan() || factor <= 0.0 {
                break;
            }
            points = Some(wider.nearest_points(&next, &simplex));
            let has_gained = factor < best * LEAST_GAIN;
            if factor < best {
                (best, n) = (factor, next);
            }
            if !has_gained {
                break;
            }
        }
        (n, points.unwrap_or_else(|| self.deepest_points(&n)))
    }

    /// Factor by which both bodies and the gap may grow at least, about their centres, before they are closer than the
    /// gap: `r . n / (h_A + h_B + g)`. Below 1 where they are too close along `n`. The centres must lie inside.
    #[inline(always)]
    pub fn factor(&self, normal: &Vector3<f64>, gap_mm: f64) -> f64 {
        let cores = self.a.core_height_mm(normal) + self.b.core_height_mm(&-normal);
        self.r.dot(normal) / (cores + self.rounding_mm() + gap_mm)
    }

    /// About the rounding error of `s(n)`.
    fn rounding(&self) -> f64 {
        4.0 * f64::EPSILON * (self.r.norm() + self.a.size_mm() + self.b.size_mm())
    }

    fn rounding_mm(&self) -> f64 {
        self.a.rounding_mm() + self.b.rounding_mm()
    }

    /// The points of the cores that are nearest to each other, by the direction between them and the simplex that gave
    /// it. Where corners of the simplex lie close together, as they do on a smooth body, the direction is the more
    /// exact.
    #[inline(always)]
    fn nearest_points(&self, n: &Vector3<f64>, simplex: &Simplex) -> [Vector3<f64>; 2] {
        if A::IS_SMOOTH || B::IS_SMOOTH {
            let (s, Difference { of_a, of_b, .. }) = self.core_separation(n);
            let across = n * s - self.r;
            if A::IS_SMOOTH { [of_a, of_a + across] } else { [of_b - across, of_b] }
        } else {
            simplex.points()
        }
    }

    /// Points of the cores that attain the support functions along `n`, as near to each other across `n` as they come.
    fn deepest_points(&self, n: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let tolerance = 1.0e-9 * (self.a.size_mm() + self.b.size_mm());
        let (of_a, of_b) = (self.a.attaining(n, tolerance), self.b.attaining(&-n, tolerance));
        let differences: Vec<Difference> = of_a
            .iter()
            .flat_map(|&of_a| of_b.iter().map(move |&of_b| (of_a, of_b)))
            .map(|(of_a, of_b)| {
                let way = (self.r + of_b) - of_a;
                Difference { w: way - n * n.dot(&way), of_a, of_b }
            })
            .collect();
        let mut simplex = Simplex::default();
        let mut v = differences[0].w;
        let mut nearest = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let next = differences.iter().min_by(|p, q| p.w.dot(&v).total_cmp(&q.w.dot(&v)));
            let Some(next) = next.filter(|next| !simplex.has(next)) else { break };
            let mut larger = simplex;
            match larger.add(*next, false) {
                Some((nearer, _)) if nearer.norm() < nearest => (v, nearest) = (nearer, nearer.norm()),
                _ => break,
            }
            simplex = larger;
        }
        simplex.points()
    }

    /// `s(n)` of the cores, and the vertices that attain it.
    #[inline(always)]
    fn core_separation(&self, n: &Vector3<f64>) -> (f64, Difference) {
        let (h_a, of_a) = self.a.core_support(n);
        let (h_b, of_b) = self.b.core_support(&-n);
        (self.r.dot(n) - h_a - h_b, Difference { w: (self.r + of_b) - of_a, of_a, of_b })
    }

    /// The better of a direction with its `s` and the one of least depth. Where cores are apart by as little as the
    /// rounding errors of their corners leave of it, the direction of their distance is lost, and a face or a pair of
    /// edges gives a better one.
    #[cold]
    fn past_rounding(&self, best: (f64, Vector3<f64>), simplex: &Simplex) -> (f64, Vector3<f64>) {
        let deepest =
            penetration::least_depth(self, simplex.corners()).map(|n| (self.core_separation(&n).0, n));
        deepest.filter(|deepest| deepest.0 > best.0).unwrap_or(best)
    }

    /// Seeks a direction with `s(n) >= enough` of the cores; ends early where their distance is less than `least`.
    /// Returns the best direction with its `s`.
    #[inline(always)]
    fn search(&self, from: &Vector3<f64>, enough: f64, least: f64) -> ((f64, Vector3<f64>), End) {
        let start = from.try_normalize(0.0).or_else(|| self.r.try_normalize(0.0));
        let mut n = start.unwrap_or_else(Vector3::x);
        let mut best = (f64::NEG_INFINITY, n);
        let mut simplex = Simplex::default();
        let mut nearest = f64::INFINITY;
        let rounding = 2.0 * self.rounding();
        let mut is_last = false;
        for _ in 0..MOST_STEPS {
            let (s, difference) = self.core_separation(&n);
            if s > best.0 {
                best = (s, n);
            }
            if is_last && nearest >= enough {
                best = self.past_rounding(best, &simplex);
            }
            if best.0 >= enough {
                return (best, End::Apart);
            }
            // No point of the difference lies farther along `n`: the nearest one is found.
            if is_last || nearest - best.0 <= rounding || simplex.has(&difference) {
                return (best, End::Near(simplex));
            }
            // Where a direction parts the bodies, rounding alone can put the origin into a simplex.
            let is_outside = best.0 > rounding;
            let Some((v, normal)) = simplex.add(difference, is_outside) else {
                return (best, End::Overlap(simplex));
            };
            let distance = v.norm();
            if distance < least {
                return (best, End::Near(simplex));
            }
            // Rounding alone makes a point farther away. Its direction may still be the best one.
            is_last = distance >= nearest;
            nearest = distance;
            match normal {
                Some(normal) => n = normal,
                // The origin is a vertex of the difference, or lies on one of its edges.
                None => return (best, End::Near(simplex)),
            }
        }
        (best, End::Near(simplex))
    }
}

#[cfg(test)]
mod tests;
