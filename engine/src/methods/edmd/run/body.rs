//! A run between two compression cycles as the body of a checkpoint: every number that the next cycle depends on.

use std::io::{self, Write};

use super::again::Again;
use super::{ENERGY_DRIFT, Frame, Run, Stage};
use crate::memory::{collected, filled};
use crate::methods::edmd::growth_protocol::GrowthProtocol;
use crate::methods::edmd::records::Cold;
use crate::methods::edmd::system::Counts;
use crate::methods::edmd::tolerances::BEYOND_TARGET;
use crate::methods::growth::codec::{Decoder, Encoder};
use crate::methods::growth::{Curve, Expansions};
use crate::packing::RsaStatistics;

/// Largest scale that grains can have grown to until they jam: a list may have sizes of any unit.
const MOST_SCALE: f64 = f64::MAX;

impl Run {
    /// The body of a checkpoint.
    pub(super) fn write(&self, frame: &Frame<'_>, out: &mut dyn Write) -> io::Result<()> {
        let mut out = Encoder(out);
        let counts = self.system.counts;
        for value in [
            u64::from(self.stage == Stage::Length),
            self.compression_cycles,
            self.rescalings,
            self.pinned_grains,
            self.resumes,
            self.expansions.number,
            self.again.number,
            self.again.from,
            self.swaps.tried,
            self.swaps.accepted,
            counts.grain_collisions,
            counts.wall_collisions,
            counts.list_rebuilds,
            counts.predictions,
            counts.stale_events,
            self.rsa.attempts,
            self.rsa.grains_by_subdivision,
            self.rsa.voxels_tested,
        ] {
            out.u64(value)?;
        }
        for value in [
            self.size,
            self.expansions.jammed_at,
            self.again.best,
            self.first_size,
            self.pressure,
            self.events_per_time,
            self.energy,
            self.swaps.window,
            self.simulated_s,
            self.fraction,
            self.elapsed_s(frame),
            self.rsa_s,
        ] {
            out.f64(value)?;
        }
        let hot = &self.system.hot;
        for a in 0..3 {
            out.f64s(hot.iter().map(|hot| hot.position[a]))?;
            out.f64s(hot.iter().map(|hot| hot.velocity[a]))?;
        }
        for a in 0..3 {
            out.f64s(self.again.places.iter().map(|place| place[a]))?;
        }
        out.f64s(self.system.cold.iter().map(|cold| cold.skin))?;
        let met = |cold: &Cold| u32::from(cold.collisions) | u32::from(cold.rebuilds) << 16;
        out.u32s(self.system.cold.iter().map(met))?;
        out.u32s(self.system.rank.iter().copied())?;
        self.curve.write(&mut out)
    }

    /// The run that a body was written by.
    ///
    /// # Errors
    /// When it cannot be one of this request; [`io::ErrorKind::OutOfMemory`].
    pub(crate) fn read(frame: &Frame<'_>, protocols: &[GrowthProtocol; 2], body: &[u8]) -> io::Result<Self> {
        let mut input = Decoder(body);
        let mut whole = || input.u64();
        let stage = if whole()? == 1 { Stage::Length } else { Stage::Scale };
        let (cycles, rescalings, pinned_grains, resumes) = (whole()?, whole()?, whole()?, whole()?);
        let number = whole()?;
        let (times, from) = (whole()?, whole()?);
        let (tried, accepted) = (whole()?, whole()?);
        let counts = Counts {
            grain_collisions: whole()?,
            wall_collisions: whole()?,
            list_rebuilds: whole()?,
            predictions: whole()?,
            stale_events: whole()?,
        };
        let rsa =
            RsaStatistics { attempts: whole()?, grains_by_subdivision: whole()?, voxels_tested: whole()? };
        let (size, jammed_at, best) = (input.f64()?, input.f64()?, input.f64()?);
        let protocol = &protocols[usize::from(stage == Stage::Length)];
        let n = protocol.radii_mm.len();
        let mut run = Self::new(frame, protocol, stage, size, &filled(n, [0.0; 3])?)?;
        let started_with = run.energy;
        run.first_size = input.f64()?;
        run.pressure = input.f64()?;
        run.events_per_time = input.f64()?;
        run.energy = input.f64()?;
        run.swaps.window = input.f64()?;
        run.simulated_s = input.f64()?;
        run.fraction = input.f64()?;
        run.earlier_s = input.f64()?;
        (run.rsa, run.rsa_s) = (rsa, input.f64()?);
        (run.compression_cycles, run.rescalings, run.pinned_grains) = (cycles, rescalings, pinned_grains);
        (run.swaps.tried, run.swaps.accepted) = (tried, accepted);
        run.resumes = resumes + 1;
        run.expansions = Expansions { number, jammed_at };
        run.system.counts = counts;
        let invalid = || io::Error::from(io::ErrorKind::InvalidData);
        let same = |column: Vec<f64>| if column.len() == n { Ok(column) } else { Err(invalid()) };
        for a in 0..3 {
            let (positions, velocities) = (same(input.f64s()?)?, same(input.f64s()?)?);
            for (i, hot) in run.system.hot.iter_mut().enumerate() {
                hot.position[a] = positions[i];
                hot.velocity[a] = velocities[i];
            }
        }
        let places = [input.f64s()?, input.f64s()?, input.f64s()?];
        let kept = if times > 0 { n } else { 0 };
        if places.iter().any(|column| column.len() != kept) {
            return Err(invalid());
        }
        let places = collected((0..kept).map(|rank| [0, 1, 2].map(|a| places[a][rank])))?;
        run.again = Again { number: times, from, best, places };
        run.set_rate(frame, protocol);
        let skin = same(input.f64s()?)?;
        let collisions = input.u32s()?;
        let rank = input.u32s()?;
        let mut seen = filled(n, false)?;
        if collisions.len() != n || rank.len() != n {
            return Err(invalid());
        }
        for &rank in &rank {
            if rank as usize >= n || std::mem::replace(&mut seen[rank as usize], true) {
                return Err(invalid());
            }
        }
        let masses = frame.masses()?;
        for (i, cold) in run.system.cold.iter_mut().enumerate() {
            cold.skin = skin[i];
            (cold.collisions, cold.rebuilds) = (collisions[i] as u16, (collisions[i] >> 16) as u16);
        }
        run.system.mass = collected(rank.iter().map(|&rank| masses[rank as usize]))?;
        run.system.rank = rank;
        run.set_radii(protocol);
        run.curve = Curve::read(&mut input)?;
        input.finish()?;
        if run.is_possible(frame, started_with) { Ok(run) } else { Err(invalid()) }
    }

    /// Whether what was read can be a run of this request: one that cannot might never end.
    fn is_possible(&self, frame: &Frame<'_>, energy_at_start: f64) -> bool {
        let bounds = self.system.container.bounds_mm();
        let longest: f64 = bounds.iter().sum();
        let sizes = match self.stage {
            Stage::Scale if frame.to_jamming.is_some() => f64::MIN_POSITIVE..=MOST_SCALE,
            Stage::Scale => f64::MIN_POSITIVE..=BEYOND_TARGET,
            Stage::Length => 0.0..=frame.most_half_distance_mm().max(0.0),
        };
        let near = |value: f64, expected: f64, share: f64| (value - expected).abs() <= share * expected;
        // A grain may leave a periodic box by an edge, or a wall by rounding, between two looks.
        let inside = |position: &[f64; 3]| (0..3).all(|a| near(position[a], bounds[a] / 2.0, 3.0));
        sizes.contains(&self.size)
            && (0.0..=1.0).contains(&self.expansions.jammed_at)
            && (0.0..=1.0).contains(&self.again.best)
            && self.again.places.iter().all(inside)
            && self.pressure > 0.0
            && self.events_per_time > 0.0
            && (0.0..=1.0).contains(&self.fraction)
            && near(self.energy, energy_at_start, 1e-9)
            && near(self.system.energy(), self.energy, 2.0 * ENERGY_DRIFT)
            && self.system.hot.iter().all(|hot| inside(&hot.position))
            && self.system.cold.iter().all(|cold| (0.0..=longest).contains(&cold.skin))
    }
}
