//! How much of the facets lies inside grains.
//!
//! Facets are plane and separate the grains of two nodes at one point, so that curved or long grains reach through
//! them. The share of their area inside grains is measured by the centroids of 16 equal triangles of each facet, in
//! tetrahedra that are evenly spaced over the numbers of all.

use super::nodes::Nodes;
use super::obstacles::{Obstacle, Obstacles};
use super::tessellation::{Point, Tet};
use crate::control::Control;
use crate::elementary::cbrt;
use crate::export::{ExportError, go_on};
use crate::grain::PlacedGrains;
use crate::request::Specimen;

/// Most tetrahedra whose facets are measured. The standard deviation of the share is below 0.005 then.
const MOST_TETRAHEDRA: usize = 6000;
/// Parts of an edge of a facet.
const PARTS: u32 = 4;
/// Tetrahedra between two looks at whether to go on.
const TETRAHEDRA_PER_LOOK: usize = 64;

/// Share of the facets' area that lies inside grains; 0 without facets.
pub(super) fn share_of_facets(
    specimen: &Specimen,
    grains: &PlacedGrains<'_>,
    nodes: &Nodes<'_>,
    tets: &[[u32; 4]],
    control: &dyn Control,
) -> Result<f64, ExportError> {
    let volume: f64 = specimen.bounds_mm().iter().product();
    let mut bodies = Obstacles::new(specimen.bounds_mm(), 0.5 * cbrt(volume / grains.len().max(1) as f64));
    (0..grains.len()).for_each(|grain| bodies.push(Obstacle::grain(grains, grain, 0.0)));
    let step = tets.len().div_ceil(MOST_TETRAHEDRA).max(1);
    let (mut inside, mut all) = (0.0, 0.0);
    for (done, tet) in tets.iter().skip(step / 2).step_by(step).enumerate() {
        if done % TETRAHEDRA_PER_LOOK == 0 {
            go_on(control)?;
        }
        for facet in Tet::new(nodes, *tet).facets() {
            let held = centroids(facet.vertices).filter(|p| bodies.hold(grains, (*p).into())).count();
            inside += facet.area() * held as f64;
            all += facet.area() * f64::from(PARTS * PARTS);
        }
    }
    Ok(if all > 0.0 { inside / all } else { 0.0 })
}

/// The centroids of the equal triangles that a triangle is divided into.
fn centroids([a, b, c]: [Point; 3]) -> impl Iterator<Item = Point> {
    let at = move |i: f64, j: f64| a + (b - a) * (i / f64::from(PARTS)) + (c - a) * (j / f64::from(PARTS));
    (0..PARTS).flat_map(move |i| {
        (0..PARTS - i).flat_map(move |j| {
            let (i, j) = (f64::from(i), f64::from(j));
            let third = 1.0 / 3.0;
            let upper = at(i + 2.0 * third, j + 2.0 * third);
            let has_upper = i + j + 2.0 <= f64::from(PARTS);
            std::iter::once(at(i + third, j + third)).chain(has_upper.then_some(upper))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_falls_into_equal_ones() {
        let triangle = [[0.0, 0.0, 1.0], [8.0, 0.0, 1.0], [0.0, 4.0, 1.0]].map(Point::from);
        let found: Vec<Point> = centroids(triangle).collect();
        assert_eq!(found.len(), 16);
        let mean = found.iter().sum::<Point>() / 16.0;
        assert!((mean - triangle.iter().sum::<Point>() / 3.0).norm() < 1e-12);
        // The part with the corner (8, 0), by hand.
        assert!(found.iter().any(|p| (p - Point::new(6.0 + 2.0 / 3.0, 1.0 / 3.0, 1.0)).norm() < 1e-12));
    }
}
