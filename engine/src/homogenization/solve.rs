//! Displacements under a mean strain: conjugate gradients, preconditioned by the Green operator of a reference medium.
//!
//! With displacements as unknowns (Lucarini and Segurado 2019, An algorithm for stress and mixed control in
//! Galerkin-based FFT homogenization, 10.1002/nme.6069, and Schneider 2021, A review of nonlinear FFT-based
//! computational homogenization methods, 10.1007/s00707-021-02962-1), an iteration keeps four fields of them. The
//! operator `A = B^T C B` is applied in real space, the Green operator at the frequencies; the fields are transformed
//! in one buffer.
//!
//! The error of a property is the energy of the error of the displacements, `|u - u_k|_A^2`. It is at most
//! `r . G r / c`, where `c` is the least stiffness over that of the reference medium. Where this bound is too far off,
//! and where there are pores, it is estimated from the decrease of the energy, `a_k r_k . G r_k` in iteration `k`
//! (Strakos and Tichy 2002, On error estimation in the conjugate gradient method and why it works in finite precision
//! computations, ETNA 13), which is extrapolated as a geometric series.
//!
//! Sums are added up plane by plane, so that bits depend neither on the threads nor on what each of them does.

use std::num::NonZeroUsize;

use super::green::{Green, Reference};
use super::material::Material;
use super::stencil::{Load, Stencil};
use super::transform::Transform;
use super::voxels::Voxels;
use super::{HomogenizationError, Settings};
use crate::cpu::Cpu;
use crate::memory::{OutOfMemory, filled};
use crate::threads::share;

/// Iterations after which the solver gives up.
pub(super) const MAX_ITERATIONS: usize = 2000;
/// Ratio of decreases that the error is extrapolated with at most.
const MAX_RATIO: f64 = 0.98;
/// Of a force of single precision nothing is left to be solved for below this part of the first.
const ROUNDING: f64 = 1e-13;

/// A field of `D` numbers at each node, in single precision.
pub(super) type Field<const D: usize> = [Vec<f32>; D];

/// A field of zeros.
pub(super) fn zeros<const D: usize>(length: usize) -> Result<Field<D>, OutOfMemory> {
    let mut field = [const { Vec::new() }; D];
    for component in &mut field {
        *component = filled(length, 0.0)?;
    }
    Ok(field)
}

/// The whole of each component.
pub(super) fn slices<const D: usize>(field: &Field<D>) -> [&[f32]; D] {
    field.each_ref().map(Vec::as_slice)
}

/// Parts of the components of a field, of so many numbers each.
fn parts<const D: usize>(field: &mut Field<D>, length: usize) -> Vec<[&mut [f32]; D]> {
    let mut all = field.each_mut().map(|component| component.chunks_mut(length));
    let mut parts = Vec::new();
    while let Some(first) = all[0].next() {
        let mut part = [0; D].map(|_| -> &mut [f32] { &mut [] });
        part[0] = first;
        for (part, rest) in part.iter_mut().zip(&mut all).skip(1) {
            *part = rest.next().unwrap_or_default();
        }
        parts.push(part);
    }
    parts
}

/// How a load case ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Solved {
    pub(super) iterations: usize,
    /// Energy of the error over that of the load case, estimated.
    pub(super) error: f64,
}

/// When a load case has ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// Energy of the error over that of the load case.
    pub(super) tolerance: f64,
    /// Energy of the load case without displacements, summed over the voxels.
    pub(super) energy: f64,
    /// Whether the energy falls with the displacements, as that of a mean strain does.
    pub(super) decreases: bool,
    /// Least stiffness over that of the reference medium; 0 where there are pores.
    pub(super) least_stiffness: f64,
}

/// What all threads read.
struct Problem<'a, M> {
    voxels: &'a Voxels,
    material: &'a M,
    stencil: Stencil,
    transform: Transform,
    green: Green,
    threads: NonZeroUsize,
    cpu: Cpu,
}

/// The fields of the iterations.
struct Fields<const D: usize> {
    residual: Field<D>,
    direction: Field<D>,
    /// Forces, or spectra; rows have the stride of spectra.
    spectrum: Field<D>,
}

/// Planes of the fields that one thread computes.
struct Planes<'p, const D: usize> {
    displacement: [&'p mut [f32]; D],
    residual: [&'p mut [f32]; D],
    direction: [&'p mut [f32]; D],
    spectrum: [&'p mut [f32]; D],
}

/// Rows of all planes across z, in one plane across y.
struct Across<'p, const D: usize> {
    rows: [Vec<&'p mut [f32]>; D],
    sum: f64,
}

/// Solves one load case after the other in the same memory.
pub(super) struct Solver<'a, M, const D: usize> {
    problem: Problem<'a, M>,
    fields: Fields<D>,
}

impl<'a, M: Material<D>, const D: usize> Solver<'a, M, D> {
    pub(super) fn new(
        voxels: &'a Voxels,
        material: &'a M,
        reference: Reference,
        settings: &Settings,
    ) -> Result<Self, OutOfMemory> {
        let transform = Transform::new(voxels.shape);
        let [_, ny, nz] = voxels.shape;
        let fields = Fields {
            residual: zeros(voxels.len())?,
            direction: zeros(voxels.len())?,
            spectrum: zeros(transform.stride() * ny * nz)?,
        };
        let problem = Problem {
            voxels,
            material,
            stencil: Stencil::new(voxels, settings.scheme),
            green: Green::new(voxels.shape, voxels.spacing_mm, transform.half(), settings.scheme, reference),
            transform,
            threads: settings.threads,
            cpu: Cpu::detect(),
        };
        Ok(Self { problem, fields })
    }

    /// Improves displacements, which are 0 at first, until they reach the goal. After each iteration `on_iteration` is
    /// called with the estimated error over that of the goal.
    ///
    /// # Errors
    /// [`HomogenizationError::NotConverged`], and what `on_iteration` returns.
    pub(super) fn solve(
        &mut self,
        displacement: &mut Field<D>,
        load: &Load<D>,
        goal: &Goal,
        mut on_iteration: impl FnMut(f64) -> Result<(), HomogenizationError>,
    ) -> Result<Solved, HomogenizationError> {
        let Self { problem, fields } = self;
        problem.forces(&slices(displacement), load, &mut fields.spectrum);
        let (mut step, mut previous, mut first) = (0.0, 0.0, 0.0);
        let mut decreases = [0.0_f64; 2];
        let mut energy = goal.energy;
        for iteration in 0..=MAX_ITERATIONS {
            // At first the forces of the load, then those of the direction.
            problem.update(displacement, fields, (iteration > 0).then_some(step as f32));
            let product = problem.precondition(&mut fields.spectrum);
            if iteration == 0 {
                first = product;
            }
            let least = goal.least_stiffness;
            let bound = if least > 0.0 { product / least } else { f64::INFINITY };
            if product <= ROUNDING * first || bound <= goal.tolerance * energy {
                let error = if bound.is_finite() { bound } else { product };
                return Ok(Solved { iterations: iteration, error: relative(error, energy) });
            }
            let ratio = if iteration == 0 { 0.0 } else { (product / previous) as f32 };
            problem.redirect(displacement, fields, ratio);
            problem.forces(&slices(&fields.direction), &Load::NONE, &mut fields.spectrum);
            let curvature = problem.product(&fields.direction, &fields.spectrum);
            step = product / curvature;
            previous = product;
            let decrease = step * product;
            let ratio_of = |now: f64, before: f64| if before > 0.0 { now / before } else { 1.0 };
            let slowest = ratio_of(decrease, decreases[1]).max(ratio_of(decreases[1], decreases[0]));
            let ratio = slowest.min(MAX_RATIO);
            decreases = [decreases[1], decrease];
            if goal.decreases {
                energy = (energy - decrease).max(0.0);
            }
            let estimate = if iteration > 1 { decrease * ratio / (1.0 - ratio) } else { f64::INFINITY };
            let error = estimate.min(bound);
            if estimate <= goal.tolerance * energy {
                problem.advance(displacement, &fields.direction, step as f32);
                return Ok(Solved { iterations: iteration + 1, error: relative(error, energy) });
            }
            if iteration == MAX_ITERATIONS || !(curvature > 0.0 && product.is_finite()) {
                return Err(HomogenizationError::NotConverged {
                    iterations: iteration,
                    error: relative(error, energy),
                });
            }
            on_iteration(error / (goal.tolerance * energy))?;
        }
        Err(HomogenizationError::NotConverged { iterations: MAX_ITERATIONS, error: f64::INFINITY })
    }
}

impl<M: Sync> Problem<'_, M> {
    /// Planes that a thread computes at once.
    fn planes_per_piece(&self) -> usize {
        self.voxels.shape[2].div_ceil(2 * self.threads.get()).max(2)
    }

    /// Does work on planes of all fields.
    fn on_planes<const D: usize>(
        &self,
        displacement: &mut Field<D>,
        fields: &mut Fields<D>,
        work: impl Fn(&mut Planes<'_, D>) + Sync,
    ) {
        let [nx, ny, _] = self.voxels.shape;
        let rows = ny * self.planes_per_piece();
        let mut pieces: Vec<Planes<'_, D>> = parts(displacement, nx * rows)
            .into_iter()
            .zip(parts(&mut fields.residual, nx * rows))
            .zip(parts(&mut fields.direction, nx * rows))
            .zip(parts(&mut fields.spectrum, self.transform.stride() * rows))
            .map(|(((displacement, residual), direction), spectrum)| Planes {
                displacement,
                residual,
                direction,
                spectrum,
            })
            .collect();
        share(self.threads, &mut pieces, |_, planes| work(planes));
    }

    /// The forces of a field under a load, at all nodes, in rows of the stride of spectra.
    fn forces<const D: usize>(&self, field: &[&[f32]; D], load: &Load<D>, out: &mut Field<D>)
    where
        M: Material<D>,
    {
        let [_, ny, nz] = self.voxels.shape;
        let (per_piece, stride) = (self.planes_per_piece(), self.transform.stride());
        let mut pieces = parts(out, stride * ny * per_piece);
        share(self.threads, &mut pieces, |piece, out| {
            let planes = piece * per_piece..((piece + 1) * per_piece).min(nz);
            self.cpu.call(|| {
                self.stencil.forces(self.voxels, self.material, *field, load, planes, stride, out);
            });
        });
    }

    /// Takes forces into the residual and transforms it along x and y. At first these are those of the load. Later they
    /// are those of the direction, along which the displacements go a step.
    fn update<const D: usize>(&self, displacement: &mut Field<D>, fields: &mut Fields<D>, step: Option<f32>) {
        let [nx, ny, _] = self.voxels.shape;
        let stride = self.transform.stride();
        self.on_planes(displacement, fields, |planes| {
            let mut lines = self.transform.lines(D);
            for component in 0..D {
                let residual = planes.residual[component].chunks_exact_mut(nx * ny);
                let spectrum = planes.spectrum[component].chunks_exact_mut(stride * ny);
                for (residual, spectrum) in residual.zip(spectrum) {
                    let rows = residual.chunks_exact_mut(nx).zip(spectrum.chunks_exact_mut(stride));
                    self.cpu.call(|| {
                        for (residual, forces) in rows {
                            let forces = &mut forces[..nx];
                            match step {
                                Some(step) => add(residual, forces, -step),
                                None => residual.iter_mut().zip(&*forces).for_each(|(r, f)| *r = -f),
                            }
                            forces.copy_from_slice(residual);
                        }
                    });
                    self.transform.forward(spectrum, &mut lines);
                }
                if let Some(step) = step {
                    let direction = &planes.direction[component];
                    self.cpu.call(|| add(planes.displacement[component], direction, step));
                }
            }
        });
    }

    /// Applies the Green operator to spectra of planes; returns the product of the residual and what it becomes.
    fn precondition<const D: usize>(&self, spectrum: &mut Field<D>) -> f64 {
        let [_, ny, nz] = self.voxels.shape;
        let rows = || [0; D].map(|_| Vec::with_capacity(nz));
        let mut across: Vec<Across<'_, D>> = (0..ny).map(|_| Across { rows: rows(), sum: 0.0 }).collect();
        for (component, field) in spectrum.iter_mut().enumerate() {
            for (number, row) in field.chunks_exact_mut(self.transform.stride()).enumerate() {
                across[number % ny].rows[component].push(row);
            }
        }
        let per_piece = ny.div_ceil(4 * self.threads.get());
        let mut pieces: Vec<&mut [Across<'_, D>]> = across.chunks_mut(per_piece).collect();
        share(self.threads, &mut pieces, |piece, across| {
            let mut lines = self.transform.lines(D);
            for (number, across) in across.iter_mut().enumerate() {
                let y = piece * per_piece + number;
                across.sum = self.transform.green(&self.green, y, &mut across.rows, &mut lines);
            }
        });
        across.iter().map(|across| across.sum).sum()
    }

    /// Transforms spectra of planes back, and adds the direction times a ratio to them: the new direction.
    fn redirect<const D: usize>(&self, displacement: &mut Field<D>, fields: &mut Fields<D>, ratio: f32) {
        let [nx, ny, _] = self.voxels.shape;
        let stride = self.transform.stride();
        self.on_planes(displacement, fields, |planes| {
            let mut lines = self.transform.lines(D);
            for (direction, spectrum) in planes.direction.iter_mut().zip(&mut planes.spectrum) {
                let planes = direction.chunks_exact_mut(nx * ny).zip(spectrum.chunks_exact_mut(stride * ny));
                for (direction, spectrum) in planes {
                    self.transform.inverse(spectrum, &mut lines);
                    self.cpu.call(|| {
                        let rows = direction.chunks_exact_mut(nx).zip(spectrum.chunks_exact(stride));
                        for (direction, moved) in rows {
                            for (p, z) in direction.iter_mut().zip(moved) {
                                *p = *z + ratio * *p;
                            }
                        }
                    });
                }
            }
        });
    }

    /// The product of a field and forces.
    fn product<const D: usize>(&self, field: &Field<D>, forces: &Field<D>) -> f64 {
        let [nx, ny, nz] = self.voxels.shape;
        let stride = self.transform.stride();
        let mut sums = vec![0.0; nz];
        share(self.threads, &mut sums, |k, sum| {
            for (field, forces) in field.iter().zip(forces) {
                let rows = field[k * nx * ny..][..nx * ny].chunks_exact(nx);
                let forces = forces[k * stride * ny..][..stride * ny].chunks_exact(stride);
                *sum += self
                    .cpu
                    .call(|| rows.zip(forces).map(|(row, forces)| dot(row, &forces[..nx])).sum::<f64>());
            }
        });
        sums.iter().sum()
    }

    /// Goes a step along the direction.
    fn advance<const D: usize>(&self, displacement: &mut Field<D>, direction: &Field<D>, step: f32) {
        for (displacement, direction) in displacement.iter_mut().zip(direction) {
            self.cpu.call(|| add(displacement, direction, step));
        }
    }
}

/// An error over an energy; 0 where there is nothing to be solved.
fn relative(error: f64, energy: f64) -> f64 {
    if error > 0.0 { error / energy } else { 0.0 }
}

/// Adds numbers times a factor.
#[inline(always)]
fn add(to: &mut [f32], numbers: &[f32], factor: f32) {
    for (sum, number) in to.iter_mut().zip(numbers) {
        *sum += factor * *number;
    }
}

/// The product of two rows, added up in double precision.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    const SUMS: usize = 8;
    let mut sums = [0.0; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
    for (a, b) in a.zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += f64::from(*a) * f64::from(*b);
        }
    }
    sums.iter().sum::<f64>() + rest
}
