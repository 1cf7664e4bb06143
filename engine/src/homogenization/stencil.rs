//! Gradients of nodal fields in voxels, and the nodal forces of fluxes: the transpose of the former.
//!
//! A voxel has eight nodes. The field within it is trilinear, a sum of the products `1, X, Y, Z, XY, XZ, YZ, XYZ` of
//! local coordinates from -1 to 1. Its gradient at the centre is that of the rotated scheme (Willot 2015, Fourier-based
//! schemes for computing the mechanical response of composites with accurate local fields,
//! 10.1016/j.crme.2014.12.005): hexahedra with one point of integration. With the other terms, which are orthogonal
//! over the voxel with weights 1/3 and 1/9, the energy is that of eight Gauss points: the hexahedron C3D8 of Abaqus and
//! `CalculiX`.

use std::ops::Range;

use super::Scheme;
use super::material::{Material, Rows};
use super::real::Real;
use super::voxels::Voxels;

/// Terms of the gradient of a trilinear field: those of `X, Y, Z, XY, XZ, YZ, XYZ`.
const TERMS: usize = 7;
/// Terms that the rotated scheme has.
const CENTRE_TERMS: usize = 3;

/// A term of the gradient over the voxel: mean of its square, and for each axis the term of the field that it is the
/// derivative of.
struct Mode {
    weight: f64,
    terms: [Option<usize>; 3],
}

const MODES: [Mode; 7] = [
    Mode { weight: 1.0, terms: [Some(0), Some(1), Some(2)] },
    Mode { weight: 1.0 / 3.0, terms: [None, Some(3), Some(4)] },
    Mode { weight: 1.0 / 3.0, terms: [Some(3), None, Some(5)] },
    Mode { weight: 1.0 / 3.0, terms: [Some(4), Some(5), None] },
    Mode { weight: 1.0 / 9.0, terms: [None, None, Some(6)] },
    Mode { weight: 1.0 / 9.0, terms: [Some(6), None, None] },
    Mode { weight: 1.0 / 9.0, terms: [None, Some(6), None] },
];

/// A mean gradient, and whether the temperature is raised by one unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Load<const D: usize> {
    pub(super) mean: [[f64; 3]; D],
    pub(super) thermal: bool,
}

impl<const D: usize> Load<D> {
    /// No load.
    pub(super) const NONE: Self = Self { mean: [[0.0; 3]; D], thermal: false };
}

/// Derivatives on the voxels of a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stencil {
    shape: [usize; 3],
    modes: usize,
    /// From sums over eight nodes to a derivative, along each axis.
    factors: [f64; 3],
}

/// What a row of voxels is computed in.
pub(super) struct Workspace<T, const D: usize> {
    sums: [Vec<T>; 4],
    terms: [[Vec<T>; TERMS]; D],
    /// Of the fluxes; the first number is that of the last voxel.
    transposed: [[Vec<T>; TERMS]; D],
    rows: Rows<T, D>,
    coefficients: [Vec<T>; 2],
    of_cuts: Vec<[T; 9]>,
    nodal: [Vec<T>; 4],
}

impl<T: Real, const D: usize> Workspace<T, D> {
    pub(super) fn new(nx: usize) -> Self {
        let row = || vec![T::default(); nx + 1];
        Self {
            sums: [0; 4].map(|_| row()),
            terms: [0; D].map(|_| [0; TERMS].map(|_| row())),
            transposed: [0; D].map(|_| [0; TERMS].map(|_| row())),
            rows: [0; D].map(|_| [0; 3].map(|_| row())),
            coefficients: [0; 2].map(|_| row()),
            of_cuts: Vec::new(),
            nodal: [0; 4].map(|_| row()),
        }
    }
}

impl Stencil {
    pub(super) fn new(voxels: &Voxels, scheme: Scheme) -> Self {
        let modes = match scheme {
            Scheme::Rotated => 1,
            Scheme::Hexahedra => MODES.len(),
        };
        Self { shape: voxels.shape, modes, factors: voxels.spacing_mm.map(|h| 0.25 / h) }
    }

    fn terms(&self) -> usize {
        if self.modes == 1 { CENTRE_TERMS } else { TERMS }
    }

    /// The terms of a nodal field in a row of voxels.
    #[inline(always)]
    fn differences<T: Real>(&self, nodes: [&[f32]; 4], sums: &mut [Vec<T>; 4], terms: &mut [Vec<T>; TERMS]) {
        let nx = self.shape[0];
        let [a, b, c, d] = nodes.map(|row| &row[..nx]);
        let [sum, y, z, yz] = sums.each_mut().map(|row| &mut row[..=nx]);
        for x in 0..nx {
            let (a, b, c, d) = (T::single(a[x]), T::single(b[x]), T::single(c[x]), T::single(d[x]));
            sum[x] = (a + b) + (c + d);
            y[x] = (b + d) - (a + c);
            z[x] = (c + d) - (a + b);
            yz[x] = (a + d) - (b + c);
        }
        for row in [&mut *sum, &mut *y, &mut *z, &mut *yz] {
            row[nx] = row[0];
        }
        let [tx, ty, tz, txy, txz, tyz, txyz] = terms.each_mut().map(|row| &mut row[..nx]);
        for x in 0..nx {
            tx[x] = sum[x + 1] - sum[x];
            ty[x] = y[x + 1] + y[x];
            tz[x] = z[x + 1] + z[x];
        }
        if self.modes > 1 {
            for x in 0..nx {
                txy[x] = y[x + 1] - y[x];
                txz[x] = z[x + 1] - z[x];
                tyz[x] = yz[x + 1] + yz[x];
                txyz[x] = yz[x + 1] - yz[x];
            }
        }
    }

    /// The four rows of nodes of a row of voxels: at `(j, k)`, `(j + 1, k)`, `(j, k + 1)` and `(j + 1, k + 1)`.
    fn node_rows<'a>(&self, component: &'a [f32], j: usize, k: usize) -> [&'a [f32]; 4] {
        let [nx, ny, nz] = self.shape;
        let (j1, k1) = ((j + 1) % ny, (k + 1) % nz);
        [(j, k), (j1, k), (j, k1), (j1, k1)].map(|(j, k)| &component[(k * ny + j) * nx..][..nx])
    }

    /// A mode of the gradients of a row of voxels.
    #[inline(always)]
    fn gradient<T: Real, const D: usize>(
        &self,
        mode: usize,
        load: &Load<D>,
        terms: &[[Vec<T>; TERMS]; D],
        rows: &mut Rows<T, D>,
    ) {
        let nx = self.shape[0];
        for (component, of_component) in rows.iter_mut().enumerate() {
            for (axis, row) in of_component.iter_mut().enumerate() {
                let row = &mut row[..nx];
                let Some(term) = MODES[mode].terms[axis] else {
                    row.fill(T::default());
                    continue;
                };
                let mean = if mode == 0 { load.mean[component][axis] } else { 0.0 };
                let (factor, mean) = (T::double(self.factors[axis]), T::double(mean));
                for (gradient, term) in row.iter_mut().zip(&terms[component][term][..nx]) {
                    *gradient = *term * factor + mean;
                }
            }
        }
    }

    /// Terms of the gradient that are not 0.
    pub(super) fn modes(&self) -> usize {
        self.modes
    }

    /// A term of the gradients of a row of voxels, and its fluxes. Returns the mean of the square of the term.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub(super) fn mode<T: Real, const D: usize>(
        &self,
        mode: usize,
        voxels: &Voxels,
        material: &impl Material<D>,
        field: [&[f32]; D],
        load: &Load<D>,
        [j, k]: [usize; 2],
        space: &mut Workspace<T, D>,
        [gradients, fluxes]: &mut [Rows<T, D>; 2],
    ) -> f64 {
        let row = voxels.row(j, k);
        for (component, terms) in field.iter().zip(&mut space.terms) {
            self.differences(self.node_rows(component, j, k), &mut space.sums, terms);
        }
        material.coefficients(row, &mut space.coefficients);
        self.gradient(mode, load, &space.terms, gradients);
        for (to, from) in fluxes.as_flattened_mut().iter_mut().zip(gradients.as_flattened()) {
            to.copy_from_slice(from);
        }
        material.flux(row, &space.coefficients, load.thermal && mode == 0, fluxes, &mut space.of_cuts);
        MODES[mode].weight
    }

    /// The forces of a field of displacements under a load, at the nodes of a range of planes across z: the transpose
    /// of the gradient of the fluxes. `out` has the rows of these planes with a stride.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub(super) fn forces<const D: usize>(
        &self,
        voxels: &Voxels,
        material: &impl Material<D>,
        field: [&[f32]; D],
        load: &Load<D>,
        planes: Range<usize>,
        stride: usize,
        out: &mut [&mut [f32]; D],
    ) {
        let [nx, ny, nz] = self.shape;
        let mut space = Workspace::<f32, D>::new(nx);
        let mut lower = [0; D].map(|_| vec![0.0_f32; nx * ny]);
        let mut upper = lower.clone();
        // The plane of voxels below the first nodes comes first.
        for step in 0..=planes.len() {
            let k = (planes.start + step + nz - 1) % nz;
            std::mem::swap(&mut lower, &mut upper);
            for plane in &mut upper {
                plane.fill(0.0);
            }
            for j in 0..ny {
                self.row_forces(voxels, material, field, load, [j, k], &mut space, &mut lower, &mut upper);
            }
            // All of the nodes below these voxels is known.
            if step > 0 {
                for (out, plane) in out.iter_mut().zip(&lower) {
                    let rows = &mut out[(step - 1) * ny * stride..][..ny * stride];
                    for (out, row) in rows.chunks_exact_mut(stride).zip(plane.chunks_exact(nx)) {
                        out[..nx].copy_from_slice(row);
                    }
                }
            }
        }
    }

    /// Adds the forces of a row of voxels to the planes of nodes below and above it.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn row_forces<const D: usize>(
        &self,
        voxels: &Voxels,
        material: &impl Material<D>,
        field: [&[f32]; D],
        load: &Load<D>,
        [j, k]: [usize; 2],
        space: &mut Workspace<f32, D>,
        lower: &mut [Vec<f32>; D],
        upper: &mut [Vec<f32>; D],
    ) {
        let [nx, ny, _] = self.shape;
        let row = voxels.row(j, k);
        for (component, terms) in field.iter().zip(&mut space.terms) {
            self.differences(self.node_rows(component, j, k), &mut space.sums, terms);
        }
        material.coefficients(row, &mut space.coefficients);
        for of_component in &mut space.transposed {
            of_component[CENTRE_TERMS..self.terms()].iter_mut().for_each(|row| row.fill(0.0));
        }
        for (mode, Mode { weight, terms }) in MODES.iter().enumerate().take(self.modes) {
            self.gradient(mode, load, &space.terms, &mut space.rows);
            let thermal = load.thermal && mode == 0;
            material.flux(row, &space.coefficients, thermal, &mut space.rows, &mut space.of_cuts);
            for (transposed, fluxes) in space.transposed.iter_mut().zip(&space.rows) {
                for (axis, flux) in fluxes.iter().enumerate() {
                    let Some(term) = terms[axis] else { continue };
                    let factor = (*weight * self.factors[axis]) as f32;
                    let (sums, flux) = (&mut transposed[term][1..=nx], &flux[..nx]);
                    if mode == 0 {
                        for (sum, flux) in sums.iter_mut().zip(flux) {
                            *sum = factor * *flux;
                        }
                    } else {
                        for (sum, flux) in sums.iter_mut().zip(flux) {
                            *sum += factor * *flux;
                        }
                    }
                }
            }
        }
        let (here, next) = (j * nx, (j + 1) % ny * nx);
        for (component, transposed) in space.transposed.iter_mut().enumerate() {
            for row in &mut transposed[..self.terms()] {
                row[0] = row[nx];
            }
            self.at_nodes(transposed, &mut space.nodal);
            for (plane, [first, second]) in [(&mut *lower, [0, 1]), (&mut *upper, [2, 3])] {
                for (at, nodal) in [(here, &space.nodal[first]), (next, &space.nodal[second])] {
                    for (sum, force) in plane[component][at..at + nx].iter_mut().zip(&nodal[..nx]) {
                        *sum += *force;
                    }
                }
            }
        }
    }

    /// What the nodes of the four rows get of the terms of a row of voxels.
    #[inline(always)]
    fn at_nodes(&self, transposed: &[Vec<f32>; TERMS], nodal: &mut [Vec<f32>; 4]) {
        let nx = self.shape[0];
        let [tx, ty, tz, txy, txz, tyz, txyz] = transposed.each_ref().map(|row| &row[..=nx]);
        let [first, second, third, fourth] = nodal.each_mut().map(|row| &mut row[..nx]);
        if self.modes == 1 {
            for x in 0..nx {
                let sum = tx[x] - tx[x + 1];
                let (y, z) = (ty[x] + ty[x + 1], tz[x] + tz[x + 1]);
                first[x] = sum - y - z;
                second[x] = sum + y - z;
                third[x] = sum - y + z;
                fourth[x] = sum + y + z;
            }
            return;
        }
        for x in 0..nx {
            let sum = tx[x] - tx[x + 1];
            let y = (ty[x] + ty[x + 1]) + (txy[x] - txy[x + 1]);
            let z = (tz[x] + tz[x + 1]) + (txz[x] - txz[x + 1]);
            let yz = (tyz[x] + tyz[x + 1]) + (txyz[x] - txyz[x + 1]);
            first[x] = sum - y - z + yz;
            second[x] = sum + y - z - yz;
            third[x] = sum - y + z - yz;
            fourth[x] = sum + y + z + yz;
        }
    }
}
