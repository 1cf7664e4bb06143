//! The growth curve: a bounded number of points over a run of any length.

use std::io;

use super::codec::{Decoder, Encoder};
use crate::packing::GrowthPoint;

/// Most points of the curve; when it is full every other one goes.
const MOST_POINTS: usize = 500;

/// Points at the ends of cycles: of every cycle at first, then of every second, fourth and so on.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    points: Vec<GrowthPoint>,
    stride: u64,
}

impl Curve {
    pub(crate) fn new() -> Self {
        Self { points: Vec::new(), stride: 1 }
    }

    /// Whether the end of a cycle is one of the points.
    pub(crate) fn has(&self, cycle: u64) -> bool {
        cycle.is_multiple_of(self.stride)
    }

    pub(crate) fn push(&mut self, point: GrowthPoint) {
        self.points.push(point);
        if self.points.len() >= MOST_POINTS {
            let mut at = 0;
            self.points.retain(|_| {
                at += 1;
                at % 2 == 0
            });
            self.stride *= 2;
        }
    }

    pub(crate) fn last_mut(&mut self) -> Option<&mut GrowthPoint> {
        self.points.last_mut()
    }

    pub(crate) fn into_points(self) -> Vec<GrowthPoint> {
        self.points
    }

    pub(crate) fn write(&self, out: &mut Encoder<'_>) -> io::Result<()> {
        out.u64(self.stride)?;
        out.u64(self.points.len() as u64)?;
        for point in &self.points {
            out.f64(point.packing_time_s)?;
            out.u64(point.events)?;
            out.f64(point.volume_fraction)?;
            // None of these is negative.
            for value in [point.simulated_time_s, point.distance_mm, point.reduced_pressure] {
                out.f64(value.unwrap_or(-1.0))?;
            }
        }
        Ok(())
    }

    pub(crate) fn read(input: &mut Decoder<'_>) -> io::Result<Self> {
        let mut curve = Self { stride: input.u64()?.max(1), ..Self::new() };
        for _ in 0..input.u64()?.min(MOST_POINTS as u64) {
            let (packing_time_s, events, volume_fraction) = (input.f64()?, input.u64()?, input.f64()?);
            let mut optional = || input.f64().map(|value| Some(value).filter(|value| *value >= 0.0));
            curve.points.push(GrowthPoint {
                packing_time_s,
                events,
                volume_fraction,
                simulated_time_s: optional()?,
                distance_mm: optional()?,
                reduced_pressure: optional()?,
            });
        }
        Ok(curve)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(cycle: u64) -> GrowthPoint {
        GrowthPoint {
            packing_time_s: cycle as f64 / 8.0,
            events: 10 * cycle,
            volume_fraction: 0.5,
            simulated_time_s: cycle.is_multiple_of(2).then_some(0.25),
            distance_mm: cycle.is_multiple_of(3).then_some(0.0),
            reduced_pressure: None,
        }
    }

    #[test]
    fn a_long_run_keeps_points_at_equal_intervals() {
        let mut curve = Curve::new();
        for cycle in 1..=10_000 {
            if curve.has(cycle) {
                curve.push(point(cycle));
            }
        }
        let cycles: Vec<u64> = curve.points.iter().map(|point| point.events / 10).collect();
        assert!(cycles.len() < MOST_POINTS && cycles.len() >= MOST_POINTS / 2 - 1, "{}", cycles.len());
        assert!(cycles.windows(2).all(|pair| pair[1] - pair[0] == curve.stride), "{cycles:?}");
    }

    #[test]
    fn a_curve_reads_back() -> io::Result<()> {
        let mut curve = Curve::new();
        for cycle in 1..=1000 {
            if curve.has(cycle) {
                curve.push(point(cycle));
            }
        }
        let mut bytes = Vec::new();
        curve.write(&mut Encoder(&mut bytes))?;
        let mut input = Decoder(&bytes);
        let read = Curve::read(&mut input)?;
        input.finish()?;
        assert_eq!((read.points, read.stride), (curve.points, curve.stride));
        Ok(())
    }
}
