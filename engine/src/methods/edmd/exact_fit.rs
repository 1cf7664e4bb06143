//! Grains that fit exactly: the last step of growth where no room for rounding is left.
//!
//! Growth ends a little beyond its target, and grains that fit exactly cannot grow beyond it: they jam at the target
//! less some 1e-7. From there they are moved, not grown. At their full size every pair that is too close is moved
//! apart along its line of centres by half of what is missing each, and every centre back between the walls, until
//! nothing is missing (successive projection onto the constraints). Where the sizes are round numbers the projections
//! converge to positions of round numbers, but miss them by rounding, so the positions are also tried rounded to nine
//! digits. The result is taken only if it satisfies every constraint without tolerance.

use crate::arrays::{self, Each as _};
use crate::distance::DistanceRule;
use crate::domain::{Domain, Lateral};
use crate::elementary::{hypot, log10};
use crate::request::Specimen;

/// More grains than this do not fit exactly by chance, and all of their pairs are looked at.
const MOST_GRAINS: usize = 2000;
/// Sweeps over all constraints.
const SWEEPS: usize = 4000;
/// Pairs within this share of their contact distance can come into contact.
const NEAR: f64 = 1.0 + 1e-3;
/// What pairs keep beyond contact where the distance of their centres is rounded.
const ROUNDING_MARGIN: f64 = 1.0 + 8.0 * f64::EPSILON;
/// Decimal digits that positions are rounded to, of the longest edge.
const DIGITS: i32 = 9;

/// The constraints of grains in a specimen.
struct Constraints {
    domain: Domain,
    /// Centre to wall, in mm, by grain.
    wall_mm: Vec<f64>,
    /// Pairs that can come into contact, with the distance of their centres in contact, in mm.
    pairs: Vec<(usize, usize, f64)>,
}

/// Moves centres, at most a little, to where grains of these diameters keep their rule exactly; `None` where that
/// does not succeed.
pub(super) fn settle(
    centers_mm: &[[f64; 3]],
    diameters_mm: &[f64],
    specimen: &Specimen,
    rule: &DistanceRule,
) -> Option<Vec<[f64; 3]>> {
    if centers_mm.len() > MOST_GRAINS {
        return None;
    }
    let constraints = Constraints::new(centers_mm, diameters_mm, specimen, rule);
    let mut centers = centers_mm.to_vec();
    for _ in 0..SWEEPS {
        if !constraints.project(&mut centers) {
            break;
        }
    }
    let rounded = constraints.rounded(&centers);
    [centers, rounded].into_iter().find(|centers| constraints.are_kept(centers))
}

impl Constraints {
    fn new(centers: &[[f64; 3]], diameters: &[f64], specimen: &Specimen, rule: &DistanceRule) -> Self {
        let wall_mm = diameters.iter().map(|&d| d / 2.0 + rule.wall_gap_mm(d)).collect();
        let mut constraints = Self { domain: specimen.domain(), wall_mm, pairs: Vec::new() };
        for (j, &d_j) in diameters.iter().enumerate() {
            for (i, &d_i) in diameters[..j].iter().enumerate() {
                let contact = (d_i + d_j) / 2.0 + rule.gap_mm(d_i, d_j);
                if length(constraints.separation(centers[i], centers[j])) < NEAR * contact {
                    constraints.pairs.push((i, j, contact));
                }
            }
        }
        constraints
    }

    /// From the second point to the first, in a periodic box to its nearest image.
    fn separation(&self, p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
        arrays::from_fn(|a| {
            let step = p[a] - q[a];
            self.domain.periods_mm[a].map_or(step, |period| step - period * (step / period).round())
        })
    }

    /// One sweep over all pairs and walls; says whether anything moved.
    fn project(&self, centers: &mut [[f64; 3]]) -> bool {
        let before = centers.to_vec();
        for &(i, j, contact) in &self.pairs {
            let separation = self.separation(centers[i], centers[j]);
            let distance = length(separation);
            if distance < contact && distance > 0.0 {
                let share = (contact - distance) / 2.0 / distance;
                for a in 0..3 {
                    centers[i][a] += share * separation[a];
                    centers[j][a] -= share * separation[a];
                }
            }
        }
        for (center, &wall) in centers.iter_mut().zip(&self.wall_mm) {
            *center = self.inside(*center, wall);
        }
        before != centers
    }

    /// The nearest point that keeps a distance from the walls; the middle where there is only one. In a periodic box
    /// the same point in the box.
    fn inside(&self, p: [f64; 3], wall: f64) -> [f64; 3] {
        let between = |a: usize| {
            let (low, high) = (wall, self.domain.bounds_mm[a] - wall);
            if low < high { p[a].clamp(low, high) } else { self.domain.bounds_mm[a] / 2.0 }
        };
        let along =
            |a: usize| self.domain.periods_mm[a].map_or_else(|| between(a), |period| p[a].rem_euclid(period));
        match self.domain.lateral() {
            None => arrays::from_fn(along),
            Some(Lateral { center_mm: [axis_x, axis_y], radius_mm }) => {
                let (x, y) = (p[0] - axis_x, p[1] - axis_y);
                let (far, most) = (hypot(x, y), (radius_mm - wall).max(0.0));
                let share = if far > most { most / far } else { 1.0 };
                [axis_x + share * x, axis_y + share * y, along(2)]
            }
        }
    }

    fn rounded(&self, centers: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let longest = self.domain.bounds_mm.into_iter().fold(0.0, f64::max);
        let per_mm = 10.0_f64.powi(DIGITS - log10(longest).floor() as i32);
        let rounded = |p: &[f64; 3]| p.each(|x| (x * per_mm).round() / per_mm);
        centers.iter().zip(&self.wall_mm).map(|(p, &wall)| self.inside(rounded(p), wall)).collect()
    }

    /// Whether every constraint is kept, by what the check computes or more strictly.
    fn are_kept(&self, centers: &[[f64; 3]]) -> bool {
        let walls = !self.domain.has_walls()
            || centers
                .iter()
                .zip(&self.wall_mm)
                .all(|(&p, &wall)| self.domain.clearance_reaching_all(p, [0.0; 3]) >= wall);
        walls
            && self.pairs.iter().all(|&(i, j, contact)| {
                let separation = self.separation(centers[i], centers[j]);
                // Along an axis nothing is rounded.
                let is_exact = separation.iter().filter(|x| **x != 0.0).count() <= 1;
                length(separation) >= if is_exact { contact } else { contact * ROUNDING_MARGIN }
            })
    }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::request::{Boundary, Distance};

    fn box_of(size_mm: [f64; 3]) -> Specimen {
        Specimen::cuboid(size_mm, Boundary::Walls)
    }

    fn settled(
        specimen: &Specimen,
        gap_mm: f64,
        centers: &[[f64; 3]],
        diameter: f64,
    ) -> Option<Vec<[f64; 3]>> {
        let rule = DistanceRule::new(&Distance::Constant { gap_mm, wall_gap_mm: None }, specimen);
        settle(centers, &vec![diameter; centers.len()], specimen, &rule)
    }

    #[test]
    fn a_row_of_grains_gets_its_only_positions() {
        let row: Vec<[f64; 3]> = (0..5)
            .map(|i| [5.0 + 10.0 * f64::from(i) + 1e-7 * f64::from(i * i % 3), 5.0, 5.0 + 1e-8])
            .collect();
        let found = settled(&box_of([50.0, 10.0, 10.0]), 0.0, &row, 10.0).unwrap();
        assert_eq!(found, (0..5).map(|i| [5.0 + 10.0 * f64::from(i), 5.0, 5.0]).collect::<Vec<_>>());
        // With a gap of 0.2 and 0.1 at the walls, of diameters and edges that binary numbers do not have.
        let row: Vec<[f64; 3]> = (0..3).map(|i| [0.61 + 1.2 * f64::from(i), 0.59, 0.6]).collect();
        assert!(settled(&box_of([3.6, 1.2, 1.2]), 0.2, &row, 1.0).is_some());
    }

    #[test]
    fn what_does_not_fit_is_not_settled() {
        let pair = [[5.0, 5.0, 5.0], [15.0, 5.0, 5.0]];
        assert_eq!(settled(&box_of([19.999_999, 10.0, 10.0]), 0.0, &pair, 10.0), None);
        assert_eq!(settled(&box_of([20.0, 10.0, 10.0]), 1e-9, &pair, 10.0), None);
    }
}
