//! How fast grains grow: as fast as the pressure allows a packing that is to reach its target.
//!
//! The pace is the growth of the mean radius over the thermal velocity. While grains are loose it is
//! constant. Further on the pressure `Z` tells how much growth is left before the packing jams as it
//! is, and that is held against the growth the target still needs: with room to spare growth goes on
//! fast, without it the product of pace and pressure is kept at a low constant, at which grains
//! rearrange and exchange places about as fast as they grow and jamming recedes. A constant product
//! also closes the gaps of a jammed packing by the same factor for the same number of collisions.
//!
//! It knows numbers about a packing; it must never know the packing.

/// Pace while grains are loose, where the request names none.
pub(crate) const LOOSE_PACE: f64 = 0.1;
/// Pressure up to which they are.
const LOOSE: f64 = 40.0;
/// Product of pace and pressure without room to spare.
const SLOW: f64 = 0.12;
/// How steeply the product rises with the room there is.
const ROOM_EXPONENT: i32 = 8;
/// Fewer grains than this have fewer ways to rearrange: they grow more slowly in proportion, and by its
/// square while they are loose and without a target, for it is then that they order;
const MANY_GRAINS: f64 = 500.0;
/// down to so few.
const FEW_GRAINS: f64 = 27.0;
/// Share of the loose pace at which equal grains grow to the largest distance: they have nothing to
/// exchange, and order is all that makes them denser.
const EQUAL_GRAINS: f64 = 0.02;
/// Pressure past which the structure is taken as it is,
const FROZEN: f64 = 1500.0;
/// and the pace at which its gaps close.
const CLOSING_PACE: f64 = 0.01;

/// Chooses the pace from the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pace {
    loose: f64,
    slow: f64,
    frozen: bool,
}

impl Pace {
    /// The pace of so many grains towards a target, `loose` while they are loose.
    pub(crate) fn new(loose: f64, grains: usize) -> Self {
        Self { loose, slow: SLOW * few(grains), frozen: false }
    }

    /// The pace towards the largest distance, of grains that may be all equal.
    pub(crate) fn without_target(self, grains: usize, equal: bool) -> Self {
        let few = few(grains).powi(2);
        Self { loose: self.loose * if equal { few.min(EQUAL_GRAINS) } else { few }, ..self }
    }

    /// The same pace for a structure that was, or was not, found frozen before.
    pub(crate) fn with_frozen(self, frozen: bool) -> Self {
        Self { frozen, ..self }
    }

    /// Whether the structure was found frozen; it stays so.
    pub(crate) fn is_frozen(&self) -> bool {
        self.frozen
    }

    /// The pace for the next epoch, with the [`room`] there is.
    pub(crate) fn next(&mut self, reduced_pressure: f64, room: f64) -> f64 {
        self.frozen |= reduced_pressure > FROZEN;
        if reduced_pressure < LOOSE && !self.frozen {
            return self.loose;
        }
        let slow = self.slow * room.max(1.0).powi(ROOM_EXPONENT) / reduced_pressure;
        self.loose.min(if self.frozen { slow.max(CLOSING_PACE) } else { slow })
    }
}

/// What few grains grow more slowly by.
fn few(grains: usize) -> f64 {
    ((grains as f64).max(FEW_GRAINS) / MANY_GRAINS).min(1.0)
}

/// Volume fraction at which a packing jams as it is: near jamming at `phi_j` it has
/// `Z = 3 / (1 - phi / phi_j)` (free volume; Salsburg and Wood 1962).
fn jamming(now: f64, reduced_pressure: f64) -> f64 {
    now / (1.0 - 3.0 / reduced_pressure.max(3.5))
}

/// Growth that the pressure leaves room for over that which the target needs, in volume fraction; 1
/// and less where the packing would jam first.
pub(crate) fn room(now: f64, target: f64, reduced_pressure: f64) -> f64 {
    if now >= target { 1.0 } else { (jamming(now, reduced_pressure) - now) / (target - now) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn growth_slows_down_with_pressure() {
        let mut pace = Pace::new(0.1, 10_000);
        assert_eq!(pace.next(2.0, 1.0), 0.1);
        assert!((pace.next(1000.0, 0.5) - SLOW / 1000.0).abs() < 1e-12);
        assert!(pace.next(1000.0, 1.5) > 10.0 * pace.next(1000.0, 1.0));
        assert_eq!(pace.next(1000.0, 1e9), 0.1);
        assert_eq!(pace.next(1e4, 1.0), CLOSING_PACE);
        assert!(pace.is_frozen());
        assert!(Pace::new(0.1, 50).without_target(50, false).next(2.0, 1.0) < 0.0011);
    }

    #[test]
    fn room_is_what_jamming_leaves() {
        let pressure = 3.0 / (1.0 - 0.6 / 0.7);
        assert!((room(0.6, 0.65, pressure) - 2.0).abs() < 1e-9);
        assert!((room(0.6, 0.7, pressure) - 1.0).abs() < 1e-9);
        assert_eq!(room(0.7, 0.7, pressure), 1.0);
    }
}
