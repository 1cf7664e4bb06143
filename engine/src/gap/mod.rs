//! Gaps between grains, and between a grain and the walls: true distances from surface to surface.
//!
//! A convex body `K` with the centre `x_K` has the support function `h_K(n) = max over p in K of (p - x_K) · n`. For
//! two bodies A and B with `r = x_B - x_A` and a unit vector `n`
//!
//! ```text
//! s(n) = r · n - h_A(n) - h_B(-n)
//! ```
//!
//! is the distance of two parallel planes that part them. Every `n` proves a gap of at least `s(n)`; the largest `s(n)`
//! is the gap or, where the bodies overlap, minus the smallest depth. However a vector `n` was found, a pair is
//! accepted only because `s(n) >= g` for that vector.
//!
//! [`ellipsoids`], [`polyhedra`] and [`spheres`] have the pairs, [`solids`] the bodies of all kinds, [`walls`] the
//! plane and the cylindrical wall. Packing methods are generic over the kinds by way of [`grain`]. The module knows no
//! packings.

// Pair tests are inlined into the loops over pairs, which are compiled for several instruction sets.
#![allow(clippy::inline_always)]

pub mod ellipsoids;
pub mod grain;
pub mod linear;
pub mod polyhedra;
pub mod solids;
pub mod spheres;
pub mod walls;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
