//! Polyhedra as grains of packing methods.

use nalgebra::{Quaternion, UnitQuaternion};

use super::{Core, Pair, TurnedPolyhedron};
use crate::arrays::Each as _;
use crate::cpu::Cpu;
use crate::gap::grain::{ConvexShape, Decision, Orientation, PushContact, Turned};
use crate::gap::linear::{Symmetric, Vector, norm, scaled};
use crate::shape::{Pose, ScaledPolyhedron};

impl<'a> ConvexShape for ScaledPolyhedron<'a> {
    type Turned = TurnedPolyhedron<'a>;

    fn volume_mm3(&self) -> f64 {
        self.volume_mm3()
    }

    fn equivalent_diameter_mm(&self) -> f64 {
        self.equivalent_diameter_mm()
    }

    fn scaled(&self, factor: f64) -> Option<Self> {
        let scale_mm = self.scale_mm * factor;
        (scale_mm.is_finite() && scale_mm > 0.0).then_some(Self { scale_mm, ..*self })
    }

    #[inline(always)]
    fn is_same(&self, other: &Self) -> bool {
        self.scale_mm == other.scale_mm && self.is_similar(other)
    }

    /// Templates are told apart by where they are.
    #[inline(always)]
    fn is_similar(&self, other: &Self) -> bool {
        std::ptr::eq(self.template, other.template)
    }

    #[inline(always)]
    fn outer_mm(&self) -> f64 {
        self.template.outer_radius() * self.scale_mm
    }

    #[inline(always)]
    fn inner_mm(&self) -> f64 {
        self.template.inner_radius().max(0.0) * self.scale_mm
    }

    #[inline(always)]
    fn inside_mm(&self) -> Vector {
        scaled(self.template.principal().inside, self.scale_mm)
    }

    #[inline(always)]
    fn around_mm(&self) -> Vector {
        scaled(self.template.principal().around, self.scale_mm)
    }

    /// No more than the radii differ, and by a vertex that moves.
    #[inline(always)]
    fn change_mm(&self, angle: f64) -> f64 {
        let most = self.template.outer_radius() - self.template.inner_radius();
        (self.template.principal().turn_radius * angle).min(most) * self.scale_mm
    }

    /// Of the core.
    #[inline(always)]
    fn per_inertia(&self, per_mass: f64) -> Vector {
        scaled(self.template.principal().per_inertia, per_mass / (self.scale_mm * self.scale_mm))
    }

    fn rows(&self, pose: &Pose) -> [Vector; 3] {
        let r = pose.rotation() * self.template.principal().axes.to_rotation_matrix();
        [0, 1, 2].each(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]])
    }

    fn to_principal(&self, orientation: Orientation) -> Orientation {
        product(orientation, self.template.principal().axes)
    }

    fn of_principal(&self, orientation: Orientation) -> Orientation {
        product(orientation, self.template.principal().axes.inverse())
    }

    #[inline(always)]
    fn turned(&self, rows: &[Vector; 3]) -> TurnedPolyhedron<'a> {
        let axes = self.around_mm();
        TurnedPolyhedron {
            rows: *rows,
            principal: self.template.principal(),
            scale_mm: self.scale_mm,
            rounding_mm: self.template.rounding() * self.scale_mm,
            around: Symmetric::rotated_diagonal(
                rows,
                [axes[0] * axes[0], axes[1] * axes[1], axes[2] * axes[2]],
            ),
        }
    }
}

fn product([w, i, j, k]: Orientation, by: UnitQuaternion<f64>) -> Orientation {
    let product = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k)) * by;
    [product.w, product.i, product.j, product.k]
}

impl<A: Core + Turned, B: Core + Turned> Pair<'_, A, B> {
    /// Where the two, which are too close along a unit vector, push each other.
    pub(in crate::gap) fn push_contact(&self, gap_mm: f64, normal: Vector, turns: u32) -> PushContact {
        Cpu::detect().call(
            #[inline(always)]
            || {
                let (n, points) = self.widening_from(&normal.into(), gap_mm, turns);
                let arms_mm = [points[0] + n * self.a.rounding_mm(), points[1] - n * self.b.rounding_mm()];
                let normal = n.into();
                PushContact {
                    normal,
                    supports_mm: [self.a.support_mm(normal), self.b.support_back_mm(normal)],
                    arms_mm: arms_mm.each(Vector::from),
                }
            },
        )
    }
}

impl Turned for TurnedPolyhedron<'_> {
    const IS_ELLIPSOID: bool = false;

    #[inline(always)]
    fn around(&self) -> Symmetric {
        self.around
    }

    #[inline(always)]
    fn support_mm(&self, n: Vector) -> f64 {
        let core = self.height(self.local(n)) * self.scale_mm;
        if self.rounding_mm > 0.0 { core + self.rounding_mm * norm(n) } else { core }
    }

    #[inline(always)]
    fn support_back_mm(&self, n: Vector) -> f64 {
        self.support_mm([-n[0], -n[1], -n[2]])
    }

    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector) -> Decision {
        let found = Pair { a: self, b: other, r: r.into() }.decide_from(gap_mm, &normal.into());
        Decision { is_apart: found.is_apart, normal: found.normal.into() }
    }

    /// That of the ellipsoids around the two ([`crate::gap::ellipsoids`]).
    #[inline(always)]
    fn first_direction(&self, other: &Self, r: Vector) -> Vector {
        let (a, b) = (&self.around, &other.around);
        let (h_a, h_b) = (a.quadratic(r).sqrt(), b.quadratic(r).sqrt());
        Symmetric::blend(a, b, h_a / (h_a + h_b)).solve(r)
    }

    fn contact(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector, turns: u32) -> PushContact {
        Pair { a: self, b: other, r: r.into() }.push_contact(gap_mm, normal, turns)
    }

    fn reach_across_mm(&self, [x, y]: [f64; 2]) -> (f64, Vector) {
        let mut farthest = (f64::NEG_INFINITY, [0.0; 2]);
        for v in self.vertices() {
            let at = [x + v.x, y + v.y];
            let square = at[0] * at[0] + at[1] * at[1];
            if square > farthest.0 {
                farthest = (square, at);
            }
        }
        let distance = farthest.0.sqrt();
        let [x, y] = farthest.1;
        let toward = if distance > 0.0 { [x / distance, y / distance, 0.0] } else { [1.0, 0.0, 0.0] };
        (distance + self.rounding_mm, toward)
    }
}
