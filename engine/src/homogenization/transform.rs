//! Fourier transforms of real fields on a grid, in place, four lines at a time.
//!
//! A row along x has `2 H` numbers: `nx` values, or the real parts and then the imaginary parts of its `nx / 2 + 1`
//! frequencies, with `H` a multiple of four. Planes across z are transformed along x and y, each by one thread; then
//! planes across y along z, where the Green operator is applied between the transform and its inverse.

use std::sync::Arc;

use num_traits::Zero as _;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};

use super::green::{Complex, Green};
use super::lanes::{Lanes, WIDTH};

/// Groups of four columns that are copied at once, a cache line of each row.
const GROUPS: usize = 4;

/// Transforms of fields of a shape.
pub(super) struct Transform {
    shape: [usize; 3],
    half: usize,
    real: Arc<dyn RealToComplex<Lanes>>,
    back: Arc<dyn ComplexToReal<Lanes>>,
    along_y: [Arc<dyn Fft<Lanes>>; 2],
    along_z: [Arc<dyn Fft<Lanes>>; 2],
}

/// What a thread transforms in.
pub(super) struct Buffers {
    values: Vec<Lanes>,
    spectrum: Vec<Complex>,
    lines: Vec<Complex>,
    scratch: Vec<Complex>,
}

const ZERO: Complex = Complex { re: Lanes([0.0; WIDTH]), im: Lanes([0.0; WIDTH]) };

impl Transform {
    pub(super) fn new(shape: [usize; 3]) -> Self {
        let [nx, ny, nz] = shape;
        let mut of_reals = RealFftPlanner::new();
        let mut planner = FftPlanner::new();
        let mut both = |n: usize| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)];
        Self {
            shape,
            half: (nx / 2 + 1).next_multiple_of(WIDTH),
            real: of_reals.plan_fft_forward(nx),
            back: of_reals.plan_fft_inverse(nx),
            along_y: both(ny),
            along_z: both(nz),
        }
    }

    /// Numbers of a row.
    pub(super) fn stride(&self) -> usize {
        2 * self.half
    }

    /// Frequencies along x, those included that only fill the row.
    pub(super) fn half(&self) -> usize {
        self.half
    }

    /// Bytes that a thread transforms in, about.
    pub(super) fn bytes_per_thread([nx, ny, nz]: [usize; 3], components: usize) -> u64 {
        let (line, value) = (size_of::<Complex>() as u64, size_of::<Lanes>() as u64);
        let lines = (components * GROUPS * nz).max(GROUPS * ny) as u64;
        // Transforms of lengths with large prime factors need up to four times the length.
        nx as u64 * (line + value) + (lines + 4 * nx.max(ny).max(nz) as u64) * line
    }

    pub(super) fn lines(&self, components: usize) -> Buffers {
        let [nx, ny, nz] = self.shape;
        let scratch = self.along_y.iter().chain(&self.along_z).map(|fft| fft.get_inplace_scratch_len());
        let of_rows = self.real.get_scratch_len().max(self.back.get_scratch_len());
        Buffers {
            values: vec![Lanes::zero(); nx],
            spectrum: vec![ZERO; nx / 2 + 1],
            lines: vec![ZERO; GROUPS * ny.max(components * nz)],
            scratch: vec![ZERO; scratch.fold(of_rows, usize::max)],
        }
    }

    /// Transforms a plane across z along x and y.
    pub(super) fn forward(&self, plane: &mut [f32], space: &mut Buffers) {
        let [nx, ny, _] = self.shape;
        let frequencies = nx / 2 + 1;
        for rows in plane.chunks_mut(WIDTH * self.stride()) {
            for (lane, row) in rows.chunks_exact(self.stride()).enumerate() {
                for (value, x) in space.values.iter_mut().zip(&row[..nx]) {
                    value.0[lane] = *x;
                }
            }
            let done =
                self.real.process_with_scratch(&mut space.values, &mut space.spectrum, &mut space.scratch);
            debug_assert!(done.is_ok());
            for (lane, row) in rows.chunks_exact_mut(self.stride()).enumerate() {
                let (re, im) = row.split_at_mut(self.half);
                for ((re, im), value) in re.iter_mut().zip(&mut *im).zip(&space.spectrum) {
                    (*re, *im) = (value.re.0[lane], value.im.0[lane]);
                }
                re[frequencies..].fill(0.0);
                im[frequencies..].fill(0.0);
            }
        }
        self.columns(&*self.along_y[0], ny, plane, space);
    }

    /// The inverse of [`Self::forward`], but for a factor.
    pub(super) fn inverse(&self, plane: &mut [f32], space: &mut Buffers) {
        let [nx, ny, _] = self.shape;
        self.columns(&*self.along_y[1], ny, plane, space);
        for rows in plane.chunks_mut(WIDTH * self.stride()) {
            for (lane, row) in rows.chunks_exact(self.stride()).enumerate() {
                let (re, im) = row.split_at(self.half);
                for ((re, im), value) in re.iter().zip(im).zip(&mut space.spectrum) {
                    (value.re.0[lane], value.im.0[lane]) = (*re, *im);
                }
            }
            // Those of a real line have no imaginary part; rounding leaves one.
            space.spectrum[0].im = Lanes::zero();
            if nx.is_multiple_of(2) {
                space.spectrum[nx / 2].im = Lanes::zero();
            }
            let done =
                self.back.process_with_scratch(&mut space.spectrum, &mut space.values, &mut space.scratch);
            debug_assert!(done.is_ok());
            for (lane, row) in rows.chunks_exact_mut(self.stride()).enumerate() {
                for (x, value) in row[..nx].iter_mut().zip(&space.values) {
                    *x = value.0[lane];
                }
            }
        }
    }

    /// Transforms the columns of a plane of spectra.
    fn columns(&self, fft: &dyn Fft<Lanes>, n: usize, plane: &mut [f32], space: &mut Buffers) {
        let (half, stride) = (self.half, self.stride());
        for first in (0..half).step_by(GROUPS * WIDTH) {
            let groups = GROUPS.min((half - first) / WIDTH);
            for (y, row) in plane.chunks_exact(stride).enumerate() {
                load(&row[first..half], &row[half + first..], groups, n, y, &mut space.lines);
            }
            fft.process_with_scratch(&mut space.lines[..groups * n], &mut space.scratch);
            for (y, row) in plane.chunks_exact_mut(stride).enumerate() {
                store(&mut row[first..], half, groups, n, y, &space.lines);
            }
        }
    }

    /// Applies the Green operator to spectra of planes, in the plane across y of this number: transforms along z,
    /// multiplies, transforms back. Returns the product of the spectra before and after, which is that of the fields.
    #[inline(always)]
    pub(super) fn green<const D: usize>(
        &self,
        green: &Green,
        y: usize,
        rows: &mut [Vec<&mut [f32]>; D],
        space: &mut Buffers,
    ) -> f64 {
        let [nx, _, nz] = self.shape;
        let half = self.half;
        let mut product = 0.0;
        for first in (0..half).step_by(GROUPS * WIDTH) {
            let groups = GROUPS.min((half - first) / WIDTH);
            for (rows, lines) in rows.iter().zip(space.lines.chunks_exact_mut(GROUPS * nz)) {
                for (z, row) in rows.iter().enumerate() {
                    load(&row[first..half], &row[half + first..], groups, nz, z, lines);
                }
                self.along_z[0].process_with_scratch(&mut lines[..groups * nz], &mut space.scratch);
            }
            for group in 0..groups {
                let x = first + group * WIDTH;
                let mut sums = [0.0; WIDTH];
                for z in 0..nz {
                    let at = |component: usize| (component * GROUPS + group) * nz + z;
                    let mut forces = [ZERO; D];
                    for (component, force) in forces.iter_mut().enumerate() {
                        *force = space.lines[at(component)];
                    }
                    let moved = green.apply([x, y, z], forces);
                    let mut sum = Lanes::zero();
                    for component in 0..D {
                        sum = sum
                            + forces[component].re * moved[component].re
                            + forces[component].im * moved[component].im;
                        space.lines[at(component)] = moved[component];
                    }
                    for (total, of_lane) in sums.iter_mut().zip(sum.0) {
                        *total += f64::from(of_lane);
                    }
                }
                for (lane, sum) in sums.into_iter().enumerate() {
                    // The frequencies that are left out are the conjugates of those between.
                    let is_single = x + lane == 0 || 2 * (x + lane) == nx;
                    product += if is_single { sum } else { 2.0 * sum };
                }
            }
            for (rows, lines) in rows.iter_mut().zip(space.lines.chunks_exact_mut(GROUPS * nz)) {
                self.along_z[1].process_with_scratch(&mut lines[..groups * nz], &mut space.scratch);
                for (z, row) in rows.iter_mut().enumerate() {
                    store(&mut row[first..], half, groups, nz, z, lines);
                }
            }
        }
        product
    }
}

/// Copies groups of four numbers of a row to place `at` of lines of `n` numbers, a line for each group.
#[inline(always)]
fn load(re: &[f32], im: &[f32], groups: usize, n: usize, at: usize, lines: &mut [Complex]) {
    for (group, (re, im)) in re.chunks_exact(WIDTH).zip(im.chunks_exact(WIDTH)).take(groups).enumerate() {
        lines[group * n + at] = Complex { re: Lanes::load(re), im: Lanes::load(im) };
    }
}

/// The reverse of [`load`], into a row whose imaginary parts are `half` numbers behind the real ones.
#[inline(always)]
fn store(row: &mut [f32], half: usize, groups: usize, n: usize, at: usize, lines: &[Complex]) {
    for group in 0..groups {
        let value = lines[group * n + at];
        value.re.store(&mut row[group * WIDTH..]);
        value.im.store(&mut row[half + group * WIDTH..]);
    }
}
