//! How far grains may move, in the first cycle, before their lists are rebuilt.
//!
//! A grain of mean free path `l` leaves a sphere of radius `s` after about `x + x^2 / 2` collisions, `x = s / l`: first
//! it flies, then it diffuses. The first skins follow from the rebuilds per collision that are aimed at, and from mean
//! free paths by kinetic theory, for nothing has been counted yet. Grains of all sizes have the same energy: fine ones
//! are fast and fly far between two collisions, coarse ones hardly move.
//!
//! The sizes are taken by classes, two for each power of two.

use super::records::{Cold, Hot};
use crate::arrays;

/// Rebuilds per collision that the first skins aim at. Lists are longest in the first cycles, where a cycle has few
/// collisions; with fewer rebuilds, wide mixes spend more on their lists than they save.
const REBUILDS: f64 = 0.2;
/// Classes: 2^32 between the radii of the finest and the coarsest.
const CLASSES: usize = 64;
/// Least share of voids that is reckoned with.
const LEAST_VOIDS: f64 = 0.05;

/// Means over the grains of a class.
#[derive(Clone, Copy, Debug, Default)]
struct Class {
    per_mm3: f64,
    radius: f64,
    square_speed: f64,
}

/// Gives their first skin to the grains that have none.
pub(crate) fn choose_first(hot: &[Hot], cold: &mut [Cold], volume_mm3: f64) {
    if cold.iter().all(|cold| cold.skin > 0.0) {
        return;
    }
    let least = hot.iter().map(|hot| hot.radius).fold(f64::INFINITY, f64::min);
    let classes = classes(hot, least, volume_mm3);
    let paths = (1.0 + 2.0 / REBUILDS).sqrt() - 1.0;
    let skins: [f64; CLASSES] = arrays::from_fn(|class| paths * free_path(&classes, &classes[class]));
    for (hot, cold) in hot.iter().zip(cold) {
        if cold.skin <= 0.0 {
            cold.skin = skins[class(hot.radius, least)];
        }
    }
}

fn class(radius: f64, least: f64) -> usize {
    // The exponent and the first bit of the fraction.
    let steps = |x: f64| (x.to_bits() >> 51) as usize;
    steps(radius).saturating_sub(steps(least)).min(CLASSES - 1)
}

fn classes(hot: &[Hot], least: f64, volume_mm3: f64) -> [Class; CLASSES] {
    let mut grains = [0.0_f64; CLASSES];
    let mut classes = [Class::default(); CLASSES];
    for hot in hot {
        let at = class(hot.radius, least);
        grains[at] += 1.0;
        classes[at].radius += hot.radius;
        classes[at].square_speed += hot.velocity.iter().map(|v| v * v).sum::<f64>();
    }
    for (class, grains) in classes.iter_mut().zip(grains) {
        class.per_mm3 = grains / volume_mm3;
        class.radius /= grains.max(1.0);
        class.square_speed /= grains.max(1.0);
    }
    classes
}

/// Mean free path in mm of the grains of a class, by Enskog's theory with the contact values of Boublik (1970, DOI
/// 10.1063/1.1673824) and Mansoori, Carnahan, Starling and Leland (1971, DOI 10.1063/1.1675048).
fn free_path(classes: &[Class], own: &Class) -> f64 {
    let moment = |power: i32| {
        let sum: f64 = classes.iter().map(|class| class.per_mm3 * (2.0 * class.radius).powi(power)).sum();
        std::f64::consts::FRAC_PI_6 * sum
    };
    let (squares, voids) = (moment(2), (1.0 - moment(3)).max(LEAST_VOIDS));
    let rate: f64 = classes
        .iter()
        .filter(|other| other.per_mm3 > 0.0)
        .map(|other| {
            let both = own.radius + other.radius;
            let x = 2.0 * own.radius * other.radius / both * squares / voids;
            let contact = (1.0 + 3.0 * x + 2.0 * x * x) / voids;
            let speed = (own.square_speed + other.square_speed).sqrt();
            other.per_mm3 * std::f64::consts::PI * both * both * contact * speed
        })
        .sum();
    if rate > 0.0 { own.square_speed.sqrt() / rate } else { f64::INFINITY }
}
