//! Expansions of a packing that jams just below its target.
//!
//! Grains of an expanded packing rearrange and change places while they grow again, and jam at a larger size. That is
//! tried as long as the expansions that are left, by the mean gain of those before, add up to what is missing.

/// Share of its scale that a packing is expanded by.
pub(crate) const EXPANSION: f64 = 3e-3;
/// Expansions of a run.
const MOST_EXPANSIONS: u64 = 12;

/// The expansions of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Expansions {
    /// How many there were.
    pub(crate) number: u64,
    /// The scale at which the packing jammed before the first of them.
    pub(crate) jammed_at: f64,
}

impl Expansions {
    /// Whether a packing that jams at a scale is to be expanded, which is counted then. It may lack at most `near` of
    /// its target.
    pub(crate) fn begin(&mut self, scale: f64, near: f64) -> bool {
        let missing = 1.0 - scale;
        let gain = (scale - self.jammed_at) / self.number.max(1) as f64;
        let helps = gain * MOST_EXPANSIONS.saturating_sub(self.number) as f64 >= missing;
        if missing > near || !helps {
            return false;
        }
        if self.number == 0 {
            self.jammed_at = scale;
        }
        self.number += 1;
        true
    }
}
