//! The simplex of the search: up to four differences of vertices, and its point nearest to the origin.
//!
//! The regions of segment, triangle and tetrahedron are those of Ericson, Real-Time Collision Detection, 2005, section
//! 5.1.

use nalgebra::Vector3;

/// A difference of vertices, with what it was made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Difference {
    /// Vertex of the second body minus vertex of the first.
    pub(super) w: Vector3<f64>,
    /// The vertices relative to the centres of their bodies.
    pub(super) of_a: Vector3<f64>,
    pub(super) of_b: Vector3<f64>,
}

/// Up to four differences, with the weights of the point nearest to the origin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Simplex {
    corners: [Difference; 4],
    weights: [f64; 4],
    len: usize,
}

/// Weights of the nearest point; corners of weight 0 are not needed.
type Weights = [f64; 4];

impl Simplex {
    /// The corners.
    pub(super) fn corners(&self) -> &[Difference] {
        &self.corners[..self.len]
    }

    /// Whether a difference is a corner already.
    pub(super) fn has(&self, difference: &Difference) -> bool {
        self.corners().iter().any(|corner| corner.w == difference.w)
    }

    /// Adds a corner and keeps those that span the nearest point. Returns the point and the unit vector towards it,
    /// which is `None` where the point is the origin and no triangle has a normal; returns nothing where the simplex
    /// holds the origin inside, unless it is known to lie outside.
    pub(super) fn add(
        &mut self,
        difference: Difference,
        is_outside: bool,
    ) -> Option<(Vector3<f64>, Option<Vector3<f64>>)> {
        self.corners[self.len] = difference;
        self.len += 1;
        let [a, b, c, d] = [self.corners[0].w, self.corners[1].w, self.corners[2].w, self.corners[3].w];
        self.weights = match self.len {
            1 => [1.0, 0.0, 0.0, 0.0],
            2 => segment(&a, &b),
            3 => triangle(&a, &b, &c),
            _ => tetrahedron([a, b, c, d], is_outside)?,
        };
        self.reduce();
        let corners = self.corners();
        let v: Vector3<f64> =
            corners.iter().zip(&self.weights).map(|(corner, weight)| corner.w * *weight).sum();
        // Close to the origin the weighted sum has lost the direction; what is across the simplex keeps it.
        let direction = match corners {
            [a, b] => {
                let along = b.w - a.w;
                v - along * (along.dot(&v) / along.norm_squared())
            }
            [a, b, c] => {
                let normal = (b.w - a.w).cross(&(c.w - a.w));
                if normal.dot(&v) < 0.0 { -normal } else { normal }
            }
            _ => v,
        };
        Some((v, direction.try_normalize(f64::MIN_POSITIVE)))
    }

    /// The points of the two bodies, relative to their centres, whose difference is nearest to the origin.
    pub(super) fn points(&self) -> [Vector3<f64>; 2] {
        let weighted = |of: fn(&Difference) -> Vector3<f64>| {
            self.corners().iter().zip(&self.weights).map(|(corner, weight)| of(corner) * *weight).sum()
        };
        [weighted(|corner| corner.of_a), weighted(|corner| corner.of_b)]
    }

    /// Drops corners of weight 0.
    fn reduce(&mut self) {
        let mut len = 0;
        for i in 0..self.len {
            if self.weights[i] > 0.0 {
                (self.corners[len], self.weights[len]) = (self.corners[i], self.weights[i]);
                len += 1;
            }
        }
        self.len = len;
    }
}

fn segment(a: &Vector3<f64>, b: &Vector3<f64>) -> Weights {
    let along = b - a;
    let (t, length2) = (-along.dot(a), along.norm_squared());
    if t <= 0.0 {
        [1.0, 0.0, 0.0, 0.0]
    } else if t >= length2 {
        [0.0, 1.0, 0.0, 0.0]
    } else {
        [1.0 - t / length2, t / length2, 0.0, 0.0]
    }
}

/// Weights of the point of a triangle nearest to the origin.
fn triangle(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Weights {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (-ab.dot(a), -ac.dot(a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    let (d3, d4) = (-ab.dot(b), -ac.dot(b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0, 0.0];
    }
    let (d5, d6) = (-ab.dot(c), -ac.dot(c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0, 0.0];
    }
    // Twice the areas of the triangles with the origin's foot, times twice the whole area.
    let (of_c, of_b, of_a) = (d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4);
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0, 0.0];
    }
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t, 0.0];
    }
    if of_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t, 0.0];
    }
    let whole = of_a + of_b + of_c;
    [of_a / whole, of_b / whole, of_c / whole, 0.0]
}

/// `None` where the origin lies inside, as far as it is not known to lie outside: rounding may turn a tetrahedron over
/// that is nearly flat.
fn tetrahedron(corners: [Vector3<f64>; 4], is_outside: bool) -> Option<Weights> {
    let nearest = nearest_face(&corners, false);
    if nearest.is_none() && is_outside { nearest_face(&corners, true) } else { nearest }
}

/// Weights of the point nearest to the origin of the faces that the origin lies beyond, or of all.
#[inline(always)]
fn nearest_face(corners: &[Vector3<f64>; 4], of_all: bool) -> Option<Weights> {
    let mut best: Option<(f64, Weights)> = None;
    for [i, j, k, opposite] in [[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 3, 1], [1, 2, 3, 0]] {
        let (a, b, c) = (&corners[i], &corners[j], &corners[k]);
        let normal = (b - a).cross(&(c - a));
        let (of_opposite, of_origin) = (normal.dot(&(corners[opposite] - a)), -normal.dot(a));
        // The origin lies beyond this face, or the tetrahedron is flat.
        if of_all || of_opposite * of_origin <= 0.0 {
            let [u, v, w, _] = triangle(a, b, c);
            let distance2 = (a * u + b * v + c * w).norm_squared();
            if best.is_none_or(|(least, _)| distance2 < least) {
                let mut weights = [0.0; 4];
                (weights[i], weights[j], weights[k]) = (u, v, w);
                best = Some((distance2, weights));
            }
        }
    }
    best.map(|(_, weights)| weights)
}
