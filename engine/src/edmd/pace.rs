//! How fast grains grow: fast while they are loose, slower the higher the pressure.
//!
//! The pace is the growth of the mean radius over the thermal velocity. At a pressure `Z` grains have
//! gaps of about `1 / Z` of their size, and what they need to rearrange before the next step of
//! growth rises with `Z`; a pace that falls as `Z^-1.5` keeps the packing close to equilibrium at
//! the cost of `Z^1.5` collisions per grain. Past `FROZEN` no rearrangement is worth its price, and
//! a constant pace closes the gaps, each factor of e at the same cost.
//!
//! It knows numbers about a packing; it must never know the packing.

/// Pace at low pressure, where the request names none.
pub(crate) const LOW_PRESSURE_PACE: f64 = 0.1;
/// Pressure from which growth slows down.
const DENSE: f64 = 10.0;
const EXPONENT: f64 = 1.5;
/// Pressure past which the structure is taken as it is.
const FROZEN: f64 = 4000.0;
/// Pace at which the gaps of a frozen packing close.
const CLOSING_PACE: f64 = 0.01;

/// Chooses the pace from the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pace {
    low_pressure: f64,
    frozen: bool,
}

impl Pace {
    pub(crate) fn new(low_pressure: f64) -> Self {
        Self { low_pressure, frozen: false }
    }

    /// The same pace for a structure that was, or was not, found frozen before.
    pub(crate) fn with_frozen(self, frozen: bool) -> Self {
        Self { frozen, ..self }
    }

    /// Whether the structure was found frozen; it stays so.
    pub(crate) fn is_frozen(&self) -> bool {
        self.frozen
    }

    /// The pace for the next epoch.
    pub(crate) fn next(&mut self, reduced_pressure: f64) -> f64 {
        self.frozen |= reduced_pressure > FROZEN;
        if self.frozen {
            return CLOSING_PACE.min(self.low_pressure);
        }
        self.low_pressure * (DENSE / reduced_pressure).powf(EXPONENT).min(1.0)
    }
}

/// Share of the events towards a target that are done, given the volume fractions at the start, now
/// and at the target, and the pressure now; `None` while the target looks out of reach.
///
/// A packing near jamming at `phi_j` has `Z = 3 / (1 - phi / phi_j)`, which tells `phi_j`; at the
/// pace above, getting to `phi` takes events as `(phi_j - phi)^-1.5`.
pub(crate) fn done_share(from: f64, now: f64, target: f64, reduced_pressure: f64) -> Option<f64> {
    let jammed = now / (1.0 - 3.0 / reduced_pressure.max(3.5));
    if jammed <= target {
        return None;
    }
    let events = |phi: f64| (jammed - phi).powf(-EXPONENT);
    let share = (events(now) - events(from)) / (events(target) - events(from));
    share.is_finite().then(|| share.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_slows_down_with_pressure_and_stays_frozen() {
        let mut pace = Pace::new(0.1);
        assert_eq!(pace.next(2.0), 0.1);
        assert!((pace.next(1000.0) - 1e-4).abs() < 1e-12);
        assert_eq!(pace.next(1e5), CLOSING_PACE);
        assert_eq!(pace.next(100.0), CLOSING_PACE);
    }

    #[test]
    fn most_events_lie_ahead_until_shortly_before_the_end() {
        let half_way = done_share(0.5, 0.6, 0.7, 3.0 / (1.0 - 0.6 / 0.71)).unwrap();
        assert!(half_way > 0.0 && half_way < 0.2, "{half_way}");
        assert_eq!(done_share(0.5, 0.7, 0.7, 1000.0), Some(1.0));
        assert_eq!(done_share(0.5, 0.6, 0.7, 1e4), None);
    }
}
