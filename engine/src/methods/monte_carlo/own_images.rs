//! A grain of a periodic box and its own images, which it meets where it is long against an edge.
//!
//! The images keep their offsets and turn with the grain.

use super::planes::PUSH_TURNS;
use super::system::{Hot, Part};
use crate::arrays::Each as _;
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Vector, dot, minus, norm, scaled};

impl<S: ConvexShape> Part<'_, S> {
    /// The offsets of the images in which a grain with this gap can meet itself, one of each two opposite ones.
    #[inline(always)]
    pub(super) fn own_images_near(&self, turned: &S::Turned, gap: f64) -> impl Iterator<Item = Vector> {
        // The trace of the shape matrix is the sum of the squared semi-axes.
        let [xx, _, _, yy, _, zz] = turned.around().0;
        let reach = (2.0 * (xx + yy + zz).sqrt() + gap) / self.frame.stretch;
        let near = self.frame.own_images.iter().take_while(move |(_, distance)| *distance < reach);
        near.map(|(offset, _)| offset.each(|x| x * self.frame.stretch))
    }

    /// Whether a grain of a periodic box keeps its gap to its own images.
    pub(super) fn clears_itself(&self, hot: &Hot<S::Turned>) -> bool {
        self.own_image_met(hot).is_none()
    }

    /// The image of its own that a grain comes closer to than its gap, by its offset, and a unit vector along which it
    /// does.
    pub(super) fn own_image_met(&self, hot: &Hot<S::Turned>) -> Option<(Vector, Vector)> {
        let gap = self.frame.gap(hot.d, hot.d);
        self.own_images_near(&hot.turned, gap).find_map(|r| {
            let decision = hot.turned.decide(&hot.turned, r, gap, r);
            let n = decision.normal;
            (!decision.is_apart).then(|| (r, scaled(n, 1.0 / norm(n))))
        })
    }

    /// Calls `visit` for every image of its own that a grain comes closer to than its gap, with the distance of the
    /// centres along the direction of the least depth and the one that is needed.
    pub(super) fn for_each_own_overlap(
        &self,
        hot: &Hot<S::Turned>,
        turns: u32,
        mut visit: impl FnMut(f64, f64),
    ) {
        let gap = self.frame.gap(hot.d, hot.d);
        for r in self.own_images_near(&hot.turned, gap) {
            let decision = hot.turned.decide(&hot.turned, r, gap, r);
            if !decision.is_apart {
                let n = scaled(decision.normal, 1.0 / norm(decision.normal));
                let contact = hot.turned.contact(&hot.turned, r, gap, n, turns);
                let [h_a, h_b] = contact.supports_mm;
                visit(dot(r, contact.normal), h_a + h_b + gap);
            }
        }
    }

    /// Turns a grain that comes closer than its gap to its own image at an offset, along a unit vector. The image keeps
    /// its offset and turns with the grain, so that no displacement parts the two: what a turn `w` takes from the
    /// support functions is `w · ((x_A - x_B) × n)`, with the arms `x` from the centres to the points of contact.
    pub(super) fn turn_from_itself(&mut self, i: usize, r: Vector, n: Vector, [beyond, beyond_d]: [f64; 2]) {
        let hot = self.hot[i];
        let gap = self.frame.gap(hot.d, hot.d);
        let contact = hot.turned.contact(&hot.turned, r, gap, n, PUSH_TURNS);
        let ([h_a, h_b], [arm_a, arm_b]) = (contact.supports_mm, contact.arms_mm);
        let by = beyond * (gap + h_a + h_b - dot(r, contact.normal)) + beyond_d * hot.d;
        let impulse = self.inertia(i, &hot, minus(arm_a, arm_b), contact.normal);
        let of_turn = impulse.weight - impulse.per_mass;
        // Where it lies straight across, it turns neither way; random moves turn it.
        if by > 0.0 && of_turn > 0.0 {
            self.displace(i, [0.0; 3], scaled(impulse.turn, -by / of_turn));
        }
    }
}
