//! A run where its lists are due, as the body of a checkpoint: every number that the next cycle depends on.

use std::io::{self, Write};
use std::time::Instant;

use super::{BEYOND_TARGET, LEAST_RATE, MOST_MARGIN, MOST_RATE, Pushes, Run, Stage};
use crate::arrays::Each as _;
use crate::gap::grain::ConvexShape;
use crate::memory::{OutOfMemory, filled, reserved};
use crate::methods::growth::codec::{Decoder, Encoder};
use crate::methods::growth::{Curve, Expansions};
use crate::methods::monte_carlo::MonteCarlo;
use crate::methods::monte_carlo::lists::Lists;
use crate::methods::monte_carlo::system::rotation;
use crate::packing::RsaStatistics;
use crate::shape::Pose;

/// Tells bodies of this method, and of this layout, from others.
const MARK: u64 = u64::from_le_bytes(*b"mc-body6");
/// Floats of a grain.
const FLOATS: usize = 9;

fn invalid() -> io::Error {
    io::ErrorKind::InvalidData.into()
}

impl<S: ConvexShape> Run<S> {
    /// The body of a checkpoint.
    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut out = Encoder(out);
        let counted = self.counted();
        for value in [
            MARK,
            self.system.len() as u64,
            u64::from(self.stage == Stage::Gap),
            counted.compression_cycles,
            counted.sweeps,
            counted.moves_tried,
            counted.moves_accepted,
            counted.swaps_tried,
            counted.swaps_accepted,
            counted.pushes,
            counted.list_rebuilds,
            counted.resumes,
            self.mark.1,
            self.rsa.attempts,
            self.rsa.grains_by_subdivision,
            self.rsa.voxels_tested,
            self.expansions.number,
            self.pushes.to_number(),
        ] {
            out.u64(value)?;
        }
        for value in [
            self.system.frame.stretch,
            self.system.frame.extra_gap,
            self.rate,
            self.swaps.window,
            self.mark.0,
            self.fraction,
            self.elapsed_s(),
            self.rsa_s,
            self.expansions.jammed_at,
        ] {
            out.f64(value)?;
        }
        let mut margins = self.margins.iter().peekable();
        for (site, &rank) in self.system.rank.iter().enumerate() {
            let (hot, cold) = (&self.system.hot[site], &self.system.cold[site]);
            out.u64(u64::from(rank) << 1 | u64::from(cold.list.left_skin()))?;
            let margin = margins.next_if(|margin| margin.0 as usize == site).map_or(1.0, |margin| margin.1);
            let floats = hot.center.into_iter().chain(cold.orientation).chain([cold.step, margin]);
            floats.into_iter().try_for_each(|value| out.f64(value))?;
        }
        self.curve.write(&mut out)
    }

    /// The run that a body was written by.
    ///
    /// # Errors
    /// When it cannot be one of this request; [`io::ErrorKind::OutOfMemory`].
    pub(in crate::methods::monte_carlo) fn read(
        of: &MonteCarlo<'_, S>,
        body: &[u8],
        started: Instant,
    ) -> io::Result<Self> {
        let mut input = Decoder(body);
        let n = of.shapes.len();
        if input.u64()? != MARK || input.u64()? != n as u64 {
            return Err(invalid());
        }
        let stage = if input.u64()? == 1 { Stage::Gap } else { Stage::Scale };
        if stage == Stage::Gap && of.maximize.is_none() {
            return Err(invalid());
        }
        let whole: [u64; 15] = {
            let mut whole = [0; 15];
            for value in &mut whole {
                *value = input.u64()?;
            }
            whole
        };
        let mut numbers = [0.0; 9];
        for value in &mut numbers {
            *value = input.f64()?;
        }
        let [stretch, extra_gap, rate, window, mark, fraction, earlier_s, rsa_s, jammed_at] = numbers;
        if !(stretch > 0.0 && extra_gap >= 0.0 && (LEAST_RATE..=MOST_RATE).contains(&rate)) {
            return Err(invalid());
        }
        // The grains by site, then by rank as the run takes them.
        let mut sites: Vec<(usize, bool, [f64; FLOATS])> = reserved(n)?;
        let mut seen = filled(n, false)?;
        for _ in 0..n {
            let packed = input.u64()?;
            let rank = (packed >> 1) as usize;
            if rank >= n || std::mem::replace(&mut seen[rank], true) {
                return Err(invalid());
            }
            let mut floats = [0.0; FLOATS];
            for value in &mut floats {
                *value = input.f64()?;
            }
            sites.push((rank, packed & 1 == 1, floats));
        }
        let poses = filled(n, Pose::at(nalgebra::Vector3::zeros()))?;
        let mut run = Self::new(of, poses, 1.0, started)?;
        run.stage = stage;
        run.system.frame.stretch = stretch;
        run.system.frame.extra_gap = extra_gap;
        run.rate = rate;
        run.swaps.window = window;
        run.mark = (mark, whole[9]);
        run.pushes = Pushes::of_number(whole[14]).ok_or_else(invalid)?;
        run.expansions = Expansions { number: whole[13], jammed_at };
        (run.fraction, run.earlier_s, run.rsa_s) = (fraction, earlier_s, rsa_s);
        let counted = &mut run.counted;
        counted.compression_cycles = whole[0];
        counted.sweeps = whole[1];
        counted.moves_tried = whole[2];
        counted.moves_accepted = whole[3];
        (run.swaps.tried, run.swaps.accepted) = (whole[4], whole[5]);
        counted.pushes = whole[6];
        counted.list_rebuilds = whole[7];
        counted.resumes = whole[8] + 1;
        run.rsa =
            RsaStatistics { attempts: whole[10], grains_by_subdivision: whole[11], voxels_tested: whole[12] };
        let margin = |floats: &[f64; FLOATS]| floats[FLOATS - 1];
        run.margins = reserved(sites.iter().filter(|(.., floats)| margin(floats) != 1.0).count())?;
        for (site, (rank, left_skin, floats)) in sites.into_iter().enumerate() {
            if margin(&floats) != 1.0 {
                run.margins.push((site as u32, margin(&floats)));
            }
            run.place(of, site, rank, floats);
            run.system.cold[site].list.mark_left_skin(left_skin);
        }
        run.curve = Curve::read(&mut input)?;
        input.finish()?;
        if run.is_possible() && run.is_valid()? { Ok(run) } else { Err(invalid()) }
    }

    /// Whether all grains keep their gaps.
    fn is_valid(&mut self) -> Result<bool, OutOfMemory> {
        Lists::default().build(&mut self.system, 1.0, 0.0)?;
        Ok(self.system.is_clear())
    }

    /// Puts the grain of a rank to a site.
    fn place(&mut self, of: &MonteCarlo<'_, S>, site: usize, rank: usize, floats: [f64; FLOATS]) {
        let [x, y, z, w, i, j, k, step, _margin] = floats;
        let shape = of.shapes[rank];
        self.system.rank[site] = rank as u32;
        self.system.hot[site].d = shape.equivalent_diameter_mm();
        let cold = &mut self.system.cold[site];
        (cold.shape, cold.step) = (shape, step);
        let turned = shape.turned(&rotation([w, i, j, k]));
        self.system.part().set_pose(site, [x, y, z], [w, i, j, k], turned);
    }

    /// Whether what was read can be a run of this request: one that cannot might never end.
    fn is_possible(&self) -> bool {
        let bounds = self.system.frame.container.bounds.each(|length| length * self.system.frame.stretch);
        let is_inside = |x: [f64; 3]| (0..3).all(|a| (x[a] - bounds[a] / 2.0).abs() <= 2.0 * bounds[a]);
        self.system.frame.stretch >= 1.0 / BEYOND_TARGET * (1.0 - 1e-9)
            && self.system.frame.extra_gap <= bounds.iter().sum()
            && self.swaps.window > 0.0
            && (0.0..=1.0).contains(&self.fraction)
            && self.system.hot.iter().all(|hot| is_inside(hot.center))
            && self.system.cold.iter().all(|cold| {
                let [w, i, j, k] = cold.orientation;
                (w * w + i * i + j * j + k * k - 1.0).abs() < 1e-9
                    && cold.step > 0.0
                    && cold.step <= self.largest_mm
            })
            && self.margins.iter().all(|(_, margin)| (1.0..=MOST_MARGIN).contains(margin))
    }
}
