//! Numbers that the discrete operators compute with: single precision in the solver, double precision where a property
//! is measured.

use std::ops::{Add, Div, Mul, Sub};

/// A floating-point number.
pub(super) trait Real:
    Copy
    + Default
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
{
    /// A number of single precision.
    fn single(x: f32) -> Self;
    /// A number of double precision, rounded.
    fn double(x: f64) -> Self;
    /// The values of a table in this precision.
    fn of(table: &Table) -> &[Self; PHASES];
}

/// Values that a byte can select.
pub(super) const PHASES: usize = 256;

/// A value for each phase in both precisions.
#[derive(Clone, Debug)]
pub(super) struct Table {
    single: [f32; PHASES],
    double: [f64; PHASES],
}

impl Table {
    /// The values of the phases from the first on; 0 of those that are missing.
    pub(super) fn new(values: impl Iterator<Item = f64>) -> Self {
        let mut table = Self { single: [0.0; PHASES], double: [0.0; PHASES] };
        for (phase, value) in values.enumerate().take(PHASES) {
            table.single[phase] = value as f32;
            table.double[phase] = value;
        }
        table
    }
}

impl Real for f32 {
    #[inline(always)]
    fn single(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn double(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn of(table: &Table) -> &[Self; PHASES] {
        &table.single
    }
}

impl Real for f64 {
    #[inline(always)]
    fn single(x: f32) -> Self {
        x.into()
    }
    #[inline(always)]
    fn double(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn of(table: &Table) -> &[Self; PHASES] {
        &table.double
    }
}
