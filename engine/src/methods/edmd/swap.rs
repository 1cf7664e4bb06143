//! Monte Carlo swap moves of grains of similar size between two compression cycles (Berthier, Coslovich, Ninarello and
//! Ozawa 2016, DOI 10.1103/PhysRevLett.116.238002).
//!
//! A packing only needs each diameter somewhere. Two grains may therefore change positions whenever the larger fits
//! where the smaller was; velocities, masses and diameters go with the grains, so momentum and energy stay what they
//! were. Near jamming, where grains hardly move, this is what still lets sizes and voids find each other.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::system::{System, unpack};
use crate::arrays;
use crate::elementary::ln;
use crate::memory::OutOfMemory;
use crate::methods::swap_pairs::{Families, SwapPairs};
use crate::rng::uniform;

/// The logarithm of a ratio of weights, of a larger and a smaller grain by rank and their places.
pub(crate) type LogRatio<'a> = &'a dyn Fn([usize; 2], [[f64; 3]; 2]) -> f64;

/// Tries swaps in a system whose lists were just rebuilt. `sizes` are contact radii by rank, falling, in any
/// unit; grains that are held have no rank and stay. `log_ratio` is what the logarithm of the weight of a larger and a
/// smaller grain, by rank, gains if they change their places, which are given. Swaps are then as Metropolis and others
/// (1953) have it: those that lose happen the more rarely the more they do, so that a gradient is kept and not
/// levelled.
///
/// # Errors
/// When the system refuses memory.
pub(crate) fn sweep(
    pairs: &mut SwapPairs,
    system: &mut System,
    sizes: &[f64],
    log_ratio: Option<LogRatio<'_>>,
    tries: u64,
    rng: &mut Xoshiro256PlusPlus,
) -> Result<(), OutOfMemory> {
    let n = sizes.len();
    if n < 2 || sizes[0] <= sizes[n - 1] {
        return Ok(());
    }
    pairs.prepare(&Families::default(), &system.rank[..n], sizes)?;
    let cpu = system.cpu;
    let (tried, accepted) = cpu.call(
        #[inline(always)]
        || try_pairs(pairs, system, sizes, log_ratio, tries, rng),
    );
    pairs.count(tried, accepted);
    Ok(())
}

/// Tries pairs; returns how many had different sizes, and how many of these were swapped.
#[inline(always)]
fn try_pairs(
    pairs: &mut SwapPairs,
    system: &mut System,
    sizes: &[f64],
    log_ratio: Option<LogRatio<'_>>,
    tries: u64,
    rng: &mut Xoshiro256PlusPlus,
) -> (u64, u64) {
    let (mut tried, mut accepted) = (0_u64, 0_u64);
    for _ in 0..tries {
        let [larger, smaller] = pairs.draw(rng);
        if sizes[larger] <= sizes[smaller] {
            continue;
        }
        tried += 1;
        let (i, j) = (pairs.site(larger), pairs.site(smaller));
        let places = [system.hot[i].position, system.hot[j].position];
        let wanted =
            log_ratio.is_none_or(|log_ratio| ln(uniform(rng)) <= log_ratio([larger, smaller], places));
        if wanted && swap(system, i, j) {
            pairs.swap([larger, smaller]);
            accepted += 1;
        }
    }
    (tried, accepted)
}

/// Tries to swap a grain for a smaller one anywhere, so that it gets free; says whether it is.
pub(crate) fn unjam(system: &mut System, grain: usize, tries: u64, rng: &mut Xoshiro256PlusPlus) -> bool {
    let n = system.len();
    let radius = system.hot[grain].radius;
    for _ in 0..tries {
        let other = (uniform(rng) * n as f64) as usize;
        if system.hot[other].radius < radius && swap(system, grain, other) {
            return true;
        }
    }
    false
}

/// Lets grain `i` and the smaller `j` change places if `i` fits.
#[inline(always)]
fn swap(system: &mut System, i: usize, j: usize) -> bool {
    let (large, small) = (system.hot[i].radius, system.hot[j].radius);
    let more = system.growth.radius(large, system.end) - system.growth.radius(small, system.end);
    // The list at j was made for the smaller grain: what the larger one needs more is taken from
    // the skin.
    let needed = more * (1.0 + system.growth.kappa) * system.growth.wall_factor.max(1.0);
    if needed > 0.5 * system.cold[j].skin {
        return false;
    }
    let position = system.hot[j].position;
    for &entry in system.list(j) {
        let (k, image) = unpack(entry);
        let other = if k == i {
            // It will be the smaller one that stands there.
            small
        } else {
            system.hot[k].radius
        };
        let shift = if system.container.is_periodic() { system.shifts[image] } else { [0.0; 3] };
        let d: [f64; 3] = arrays::from_fn(|a| system.hot[k].position[a] + shift[a] - position[a]);
        let (contact, _) = system.growth.pair(large, other);
        if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < contact * contact {
            return false;
        }
    }
    if system.cold[j].walls != 0 {
        let mut walls = system.cold[j].walls;
        while walls != 0 {
            let wall = walls.trailing_zeros();
            walls &= walls - 1;
            let (contact, _) = system.wall_contact(large, wall);
            if system.container.wall_normal(wall, position).1 < contact {
                return false;
            }
        }
    }
    system.hot[i].radius = small;
    system.hot[j].radius = large;
    let (v_i, v_j) = (system.hot[i].velocity, system.hot[j].velocity);
    (system.hot[i].velocity, system.hot[j].velocity) = (v_j, v_i);
    system.mass.swap(i, j);
    system.rank.swap(i, j);
    system.cold[j].skin -= needed;
    // And the list at i was made for a larger grain.
    system.cold[i].skin += more * system.growth.wall_factor.min(1.0);
    true
}
