//! Fields in the voxels of a load case that is solved: gradients and fluxes, each the mean over its voxel.
//!
//! In a voxel that a surface cuts they are the means over both phases.

use super::cases::SolvedCases;
use super::material::{Conducting, Elastic, ElasticPhase, Material, Rows};
use super::solve::slices;
use super::stencil::{Load, Stencil, Workspace};
use super::voxels::Voxels;
use super::{Scheme, conduction_loads, elastic_loads};

/// The load cases of a cell with what their fields are computed from.
#[derive(Debug)]
struct Solved<'a, M, const D: usize> {
    voxels: &'a Voxels,
    material: M,
    scheme: Scheme,
    loads: Vec<Load<D>>,
    cases: &'a SolvedCases<D>,
}

/// Strains and stresses of the strains of a unit, and of the temperature of a unit where it is the seventh case.
#[derive(Debug)]
pub struct ElasticFields<'a>(Solved<'a, Elastic, 3>);

/// Gradients and fluxes of the gradients of a unit.
#[derive(Debug)]
pub struct ConductionFields<'a>(Solved<'a, Conducting, 1>);

impl<'a> ElasticFields<'a> {
    /// Those of load cases that are solved.
    #[must_use]
    pub fn new(
        voxels: &'a Voxels,
        phases: &[ElasticPhase],
        scheme: Scheme,
        cases: &'a SolvedCases<3>,
    ) -> Self {
        let loads = elastic_loads(cases.len() > 6);
        Self(Solved { voxels, material: Elastic::new(phases), scheme, loads, cases })
    }

    /// Calls `each` with strain and stress in GPa of the voxels of a plane across z, in the order xx, yy, zz, xy, yz,
    /// xz; shear strains are halves of the engineering strains.
    pub fn plane(&self, case: usize, k: usize, mut each: impl FnMut([f32; 6], [f32; 6])) {
        const PLACES: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [0, 2]];
        self.0.plane(case, k, |[gradients, fluxes], x| {
            let strain = PLACES.map(|[i, j]| ((gradients[i][j][x] + gradients[j][i][x]) / 2.0) as f32);
            each(strain, PLACES.map(|[i, j]| fluxes[i][j][x] as f32));
        });
    }
}

impl<'a> ConductionFields<'a> {
    /// Those of load cases that are solved.
    #[must_use]
    pub fn new(
        voxels: &'a Voxels,
        conductivities: &[f64],
        scheme: Scheme,
        cases: &'a SolvedCases<1>,
    ) -> Self {
        let loads = conduction_loads();
        Self(Solved { voxels, material: Conducting::new(conductivities), scheme, loads, cases })
    }

    /// Calls `each` with the gradient, and the flux down it, of the voxels of a plane across z.
    pub fn plane(&self, case: usize, k: usize, mut each: impl FnMut([f32; 3], [f32; 3])) {
        self.0.plane(case, k, |[[gradient], [flux]], x| {
            each([0, 1, 2].map(|i| gradient[i][x] as f32), [0, 1, 2].map(|i| -flux[i][x] as f32));
        });
    }
}

impl<M: Material<D>, const D: usize> Solved<'_, M, D> {
    fn plane(&self, case: usize, k: usize, mut each: impl FnMut(&[Rows<f64, D>; 2], usize)) {
        let [nx, ny, _] = self.voxels.shape;
        let stencil = Stencil::new(self.voxels, self.scheme);
        let mut space = Workspace::<f64, D>::new(nx);
        let rows = || -> Rows<f64, D> { [0; D].map(|_| [0; 3].map(|_| vec![0.0; nx])) };
        let mut fields = [rows(), rows()];
        let displacement = slices(&self.cases.0[case].displacement);
        for j in 0..ny {
            let load = &self.loads[case];
            // The first term is the mean over the voxel.
            stencil.mode(0, self.voxels, &self.material, displacement, load, [j, k], &mut space, &mut fields);
            (0..nx).for_each(|x| each(&fields, x));
        }
    }
}
