use nalgebra::{Matrix3, Matrix6, SMatrix, SVector};

use super::moduli::{elastic_bounds, expansion, isotropic_projection, universal_anisotropy, youngs_moduli};
use super::*;
use crate::Unattended;

const MORTAR: (f64, f64, f64) = (25.0, 0.2, 1.1e-5);
const STONE: (f64, f64, f64) = (70.0, 0.25, 0.7e-5);

fn phase((e, nu, alpha): (f64, f64, f64)) -> ElasticPhase {
    ElasticPhase::new(e, nu, alpha)
}

fn settings(scheme: Scheme, tolerance: f64) -> Settings {
    Settings { scheme, tolerance, threads: NonZeroUsize::MIN }
}

fn elastic(voxels: &Voxels, phases: &[ElasticPhase], settings: &Settings) -> Elasticity {
    elasticity(voxels, phases, true, settings, &mut SolvedCases::default(), &mut |_| {}, &Unattended).unwrap()
}

fn conducting(voxels: &Voxels, conductivities: &[f64], settings: &Settings) -> Conduction {
    let cases = &mut SolvedCases::default();
    conduction(voxels, conductivities, settings, cases, &mut |_| {}, &Unattended).unwrap()
}

/// A repeatable sequence of phases 0 and 1, a share of about a third of the latter.
fn random_labels(n: usize, mut state: u64) -> Vec<u8> {
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    };
    (0..n).map(|_| u8::from(next() % 3 == 0)).collect()
}

/// Layers across an axis: phase 1 from 2.3 to 5.85 voxels, phase 0 elsewhere.
fn layers(axis: usize, shape: [usize; 3]) -> (Voxels, f64) {
    let (from, to) = (2.3_f64, 5.85_f64);
    let mut normal = [0.0; 3];
    normal[axis] = -1.0;
    let (mut labels, mut cuts, mut of_rows) = (Vec::new(), Vec::new(), Vec::new());
    for z in 0..shape[2] {
        for y in 0..shape[1] {
            let before = cuts.len();
            for x in 0..shape[0] {
                let at = [x, y, z][axis] as f64;
                let share = (to.min(at + 1.0) - from.max(at)).clamp(0.0, 1.0);
                if share > 0.0 && share < 1.0 {
                    cuts.push(CutVoxel { share, normal, x: x as u16, phases: [0, 1] });
                    labels.push(CUT);
                } else {
                    labels.push(share as u8);
                }
            }
            of_rows.push((cuts.len() - before) as u32);
        }
    }
    let voxels = Voxels::new(shape, [0.5, 0.7, 0.9], labels, cuts, &of_rows).unwrap();
    (voxels, (to - from) / shape[axis] as f64)
}

/// The stiffness of layers across an axis (Postma 1955), and their thermal pressure.
fn of_layers(axis: usize, share: f64, phases: [ElasticPhase; 2]) -> (Matrix6<f64>, [f64; 6]) {
    let mean = |of: &dyn Fn(&ElasticPhase) -> f64| (1.0 - share) * of(&phases[0]) + share * of(&phases[1]);
    let p = |phase: &ElasticPhase| phase.lambda_gpa + 2.0 * phase.mu_gpa;
    let c33 = 1.0 / mean(&|phase| 1.0 / p(phase));
    let ratio = mean(&|phase| phase.lambda_gpa / p(phase));
    let c13 = ratio * c33;
    let c11 = mean(&|phase| p(phase) - phase.lambda_gpa.powi(2) / p(phase)) + ratio * ratio * c33;
    let (c44, c66) = (1.0 / mean(&|phase| 1.0 / phase.mu_gpa), mean(&|phase| phase.mu_gpa));
    let b33 = c33 * mean(&|phase| phase.thermal_gpa_k() / p(phase));
    let b11 = mean(&|phase| phase.thermal_gpa_k() * (1.0 - phase.lambda_gpa / p(phase))) + ratio * b33;
    let (mut c, mut b) = (Matrix6::zeros(), [0.0; 6]);
    for i in 0..3 {
        for j in 0..3 {
            c[(i, j)] = match (i == axis, j == axis) {
                (true, true) => c33,
                (false, false) if i == j => c11,
                (false, false) => c11 - 2.0 * c66,
                _ => c13,
            };
        }
        c[(3 + i, 3 + i)] = if i == axis { c66 } else { c44 };
        b[i] = if i == axis { b33 } else { b11 };
    }
    (c, b)
}

#[test]
fn layers_through_cut_voxels_are_exact_along_each_axis() {
    let phases = [phase(MORTAR), phase(STONE)];
    for scheme in [Scheme::Rotated, Scheme::Hexahedra] {
        for axis in 0..3 {
            let (voxels, share) = layers(axis, [9, 10, 8]);
            let found = elastic(&voxels, &phases, &settings(scheme, 1e-13));
            let (c, b) = of_layers(axis, share, phases);
            let error = (found.stiffness_gpa - c).amax() / c.amax();
            assert!(error < 1e-10, "{scheme:?} {axis}: {error:e}\n{}\n{c}", found.stiffness_gpa);
            let thermal = found.thermal_gpa_k.unwrap();
            for i in 0..6 {
                assert!((thermal[i] - b[i]).abs() < 1e-10 * b[axis], "{scheme:?} {axis}: {thermal} {b:?}");
            }
            let ks = [1.8, 3.0];
            let found = conducting(&voxels, &ks, &settings(scheme, 1e-13));
            let along = (1.0 - share) * ks[0] + share * ks[1];
            let across = 1.0 / ((1.0 - share) / ks[0] + share / ks[1]);
            let expected =
                Matrix3::from_diagonal(&nalgebra::Vector3::from_fn(
                    |i, _| {
                        if i == axis { across } else { along }
                    },
                ));
            assert!((found.conductivity - expected).amax() < 1e-10, "{}", found.conductivity);
        }
    }
}

/// Gradients of the shape functions of a hexahedron's corners at local coordinates from -1 to 1, and the corners.
fn shape_gradients(at: [f64; 3], h: [f64; 3]) -> Vec<([usize; 3], [f64; 3])> {
    let mut all = Vec::new();
    for corner in 0..8 {
        let offset = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
        let factor = |axis: usize| 0.5 * (1.0 + (2.0 * offset[axis] as f64 - 1.0) * at[axis]);
        let slope = |axis: usize| (2.0 * offset[axis] as f64 - 1.0) / h[axis];
        let gradient = [0, 1, 2].map(|axis| {
            (0..3).map(|other| if other == axis { slope(axis) } else { factor(other) }).product()
        });
        all.push((offset, gradient));
    }
    all
}

/// Voxels along an edge of the cell that is assembled.
const N: usize = 3;
const DOFS: usize = 3 * N * N * N;

/// The stiffness of a cell of whole voxels by assembled hexahedra with these points of integration along an axis.
fn assembled(labels: &[u8], h: [f64; 3], phases: &[ElasticPhase], points: &[f64]) -> Matrix6<f64> {
    let n = N;
    let mut k = Box::new(SMatrix::<f64, DOFS, DOFS>::zeros());
    let mut loads = SMatrix::<f64, DOFS, 6>::zeros();
    let mut voigt = Matrix6::zeros();
    let weight = 1.0 / ((n * n * n) as f64 * points.len().pow(3) as f64);
    for (voxel, label) in labels.iter().enumerate() {
        let phase = &phases[usize::from(*label)];
        let mut c = Matrix6::zeros();
        for i in 0..3 {
            for j in 0..3 {
                c[(i, j)] = phase.lambda_gpa + if i == j { 2.0 * phase.mu_gpa } else { 0.0 };
            }
            c[(3 + i, 3 + i)] = phase.mu_gpa;
        }
        voigt += c / (n * n * n) as f64;
        let place = [voxel % n, voxel / n % n, voxel / (n * n)];
        for x in points {
            for y in points {
                for z in points {
                    let mut b = SMatrix::<f64, 6, 24>::zeros();
                    let mut numbers = Vec::new();
                    for (corner, (offset, g)) in shape_gradients([*x, *y, *z], h).into_iter().enumerate() {
                        let node = [0, 1, 2].map(|axis| (place[axis] + offset[axis]) % n);
                        numbers.push(3 * (node[0] + n * (node[1] + n * node[2])));
                        for (i, row) in [[0, 0], [1, 1], [2, 2]].into_iter().enumerate() {
                            b[(i, 3 * corner + row[0])] = g[row[1]];
                        }
                        for (i, [p, q]) in [[1, 2], [0, 2], [0, 1]].into_iter().enumerate() {
                            b[(3 + i, 3 * corner + p)] = g[q];
                            b[(3 + i, 3 * corner + q)] = g[p];
                        }
                    }
                    let stiffness = b.transpose() * c * b * weight;
                    let forces = b.transpose() * c * weight;
                    for row in 0..24 {
                        let to = numbers[row / 3] + row % 3;
                        for column in 0..24 {
                            k[(to, numbers[column / 3] + column % 3)] += stiffness[(row, column)];
                        }
                        for case in 0..6 {
                            loads[(to, case)] += forces[(row, case)];
                        }
                    }
                }
            }
        }
    }
    // A stiffness for each translation holds the cell.
    for axis in 0..3 {
        let ones = SVector::<f64, DOFS>::from_fn(|i, _| f64::from(u8::from(i % 3 == axis)));
        *k += ones * ones.transpose();
    }
    let moved = k.lu().solve(&loads).unwrap();
    voigt - loads.transpose() * moved
}

#[test]
fn both_schemes_equal_assembled_hexahedra() {
    let h = [0.5, 0.7, 0.9];
    let gauss = 1.0 / 3.0_f64.sqrt();
    for contrast in [3.0, 30.0, 300.0] {
        let phases = [phase((10.0, 0.2, 1e-5)), phase((10.0 * contrast, 0.3, 2e-5))];
        let labels = random_labels(N * N * N, 7);
        let voxels = Voxels::of_labels([N; 3], h, labels.clone()).unwrap();
        for (scheme, points) in [(Scheme::Rotated, &[0.0][..]), (Scheme::Hexahedra, &[-gauss, gauss])] {
            let expected = assembled(&labels, h, &phases, points);
            let found = elastic(&voxels, &phases, &settings(scheme, 1e-11));
            let error = (found.stiffness_gpa - expected).amax() / expected.amax();
            assert!(error < 1e-9, "{scheme:?} {contrast}: {error:e}\n{}{expected}", found.stiffness_gpa);
            // A mean stress misses by the rounding of forces, which grow with the contrast, on few voxels most.
            let limit = if contrast > 100.0 { 1e-5 } else { 1e-6 };
            assert!(found.effort.energy_against_work < limit, "{scheme:?} {contrast}: {:?}", found.effort);
        }
    }
}

#[test]
fn the_expansion_of_two_phases_follows_levin() {
    let phases = [phase(MORTAR), phase(STONE)];
    let voxels = Voxels::of_labels([9, 8, 10], [1.0; 3], random_labels(720, 3)).unwrap();
    for scheme in [Scheme::Rotated, Scheme::Hexahedra] {
        let found = elastic(&voxels, &phases, &settings(scheme, 1e-12));
        let shares = voxels.shares(2);
        let compliance = |phase: &ElasticPhase| {
            Matrix6::from_fn(|i, j| {
                let e = phase.mu_gpa * (3.0 * phase.lambda_gpa + 2.0 * phase.mu_gpa)
                    / (phase.lambda_gpa + phase.mu_gpa);
                let nu = e / (2.0 * phase.mu_gpa) - 1.0;
                match (i < 3, j < 3) {
                    (true, true) => {
                        if i == j {
                            1.0 / e
                        } else {
                            -nu / e
                        }
                    }
                    (false, false) if i == j => 1.0 / phase.mu_gpa,
                    _ => 0.0,
                }
            })
        };
        let s = phases.map(|phase| compliance(&phase));
        let mean = s[0] * shares[0] + s[1] * shares[1];
        let alpha = phases.map(|phase| phase.expansion_1_k);
        let alphas = |a: f64| Vector6::new(a, a, a, 0.0, 0.0, 0.0);
        // Levin 1967, in the form of Rosen and Hashin 1970: alpha + (S - <S>) (S_2 - S_1)^-1 (alpha_2 - alpha_1).
        let expected = alphas(shares[0] * alpha[0] + shares[1] * alpha[1])
            + (found.stiffness_gpa.try_inverse().unwrap() - mean)
                * (s[1] - s[0]).try_inverse().unwrap()
                * alphas(alpha[1] - alpha[0]);
        let own = expansion(&found.stiffness_gpa, &found.thermal_gpa_k.unwrap()).unwrap();
        assert!((own - expected).amax() < 1e-9 * alpha[0], "{own}{expected}");
    }
}

#[test]
fn properties_have_the_same_bits_on_any_number_of_threads_and_on_both_instruction_sets() {
    let phases = [phase(MORTAR), phase(STONE)];
    let (voxels, _) = layers(0, [9, 7, 12]);
    let of = |threads: usize| {
        let threads = NonZeroUsize::new(threads).unwrap();
        let settings = Settings { threads, ..settings(Scheme::Rotated, 1e-4) };
        elastic(&voxels, &phases, &settings)
    };
    let one = of(1);
    assert!(one.effort.iterations.iter().any(|n| *n > 1), "{:?}", one.effort);
    for threads in [2, 3, 4, 16] {
        assert_eq!(of(threads), one);
    }
    let baseline = crate::cpu::tests::on_baseline(|| of(1));
    assert_eq!(baseline, one);
}

#[test]
fn one_material_needs_no_iteration_and_has_its_own_moduli() {
    let phases = [phase(STONE); 2];
    let voxels = Voxels::of_labels([5, 6, 7], [1.0; 3], random_labels(210, 3)).unwrap();
    let found = elastic(&voxels, &phases, &settings(Scheme::Rotated, 1e-4));
    assert!(found.effort.iterations.iter().all(|n| *n <= 1), "{:?}", found.effort);
    let moduli = isotropic_projection(&found.stiffness_gpa);
    assert!((moduli.youngs_modulus_gpa - 70.0).abs() < 1e-9 && (moduli.poissons_ratio - 0.25).abs() < 1e-9);
    assert!(universal_anisotropy(&found.stiffness_gpa).unwrap() < 1e-9);
    assert!(youngs_moduli(&found.stiffness_gpa).unwrap().iter().all(|e| (e - 70.0).abs() < 1e-9));
    let bounds = elastic_bounds(&[0.5, 0.5], &phases);
    for bound in [bounds.reuss, bounds.hashin_shtrikman_lower, bounds.hashin_shtrikman_upper, bounds.voigt] {
        assert!((bound.youngs_modulus_gpa - 70.0).abs() < 1e-9, "{bounds:?}");
    }
}

#[test]
fn load_cases_that_are_read_back_change_no_bit_and_are_not_solved_again() {
    let phases = [phase(MORTAR), phase(STONE)];
    let (voxels, _) = layers(0, [9, 7, 12]);
    let settings = settings(Scheme::Rotated, 1e-4);
    let (mut cases, mut written) = (SolvedCases::default(), Vec::new());
    let mut solved = 0;
    let whole = elasticity(
        &voxels,
        &phases,
        true,
        &settings,
        &mut cases,
        &mut |cases| {
            solved += 1;
            assert_eq!(cases.len(), solved);
            if solved == 4 {
                cases.write(&mut written).unwrap();
            }
        },
        &Unattended,
    );
    let whole = whole.unwrap();
    assert_eq!(solved, 7);
    let mut read = SolvedCases::read(&mut &written[..], 4, voxels.len()).unwrap();
    let mut solved = 0;
    let resumed =
        elasticity(&voxels, &phases, true, &settings, &mut read, &mut |_| solved += 1, &Unattended).unwrap();
    assert_eq!((solved, resumed), (3, whole));
    assert_eq!(read, cases);
    written.pop();
    assert!(SolvedCases::<3>::read(&mut &written[..], 4, voxels.len()).is_err());
}

/// A layer in cut voxels, pulled across: one stress, and strains whose means are those of the phases.
#[test]
fn fields_of_layers_are_those_of_the_closed_form() {
    let phases = [phase(MORTAR), phase(STONE)];
    let shape = [6, 5, 8];
    let (voxels, share) = layers(2, shape);
    let mut cases = SolvedCases::default();
    let settings = settings(Scheme::Rotated, 1e-13);
    elasticity(&voxels, &phases, true, &settings, &mut cases, &mut |_| {}, &Unattended).unwrap();
    let fields = ElasticFields::new(&voxels, &phases, Scheme::Rotated, &cases);
    let (c, _) = of_layers(2, share, phases);
    let moduli = phases.map(|phase| phase.lambda_gpa + 2.0 * phase.mu_gpa);
    for k in 0..shape[2] {
        let part = (5.85_f64.min(k as f64 + 1.0) - 2.3_f64.max(k as f64)).clamp(0.0, 1.0);
        let expected = c[(2, 2)] * ((1.0 - part) / moduli[0] + part / moduli[1]);
        let mut count = 0;
        fields.plane(2, k, |strain, stress| {
            count += 1;
            assert!((f64::from(strain[2]) - expected).abs() < 1e-6, "{k}: {strain:?} {expected}");
            assert!((f64::from(stress[2]) / c[(2, 2)] - 1.0).abs() < 1e-6, "{k}: {stress:?}");
            assert!(strain[3..].iter().all(|shear| shear.abs() < 1e-6), "{strain:?}");
        });
        assert_eq!(count, shape[0] * shape[1]);
    }
    let mut cases = SolvedCases::default();
    conduction(&voxels, &[1.8, 3.0], &settings, &mut cases, &mut |_| {}, &Unattended).unwrap();
    let across = 1.0 / ((1.0 - share) / 1.8 + share / 3.0);
    ConductionFields::new(&voxels, &[1.8, 3.0], Scheme::Rotated, &cases).plane(2, 4, |gradient, flux| {
        assert!((f64::from(gradient[2]) - across / 3.0).abs() < 1e-6, "{gradient:?}");
        assert!((f64::from(flux[2]) + across).abs() < 1e-6, "{flux:?}");
    });
}

#[test]
fn a_run_stops_when_it_is_told_to() {
    struct Stops;
    impl Control for Stops {
        fn report(&self, _: &Progress) {}
        fn should_stop(&self) -> bool {
            true
        }
    }
    let voxels = Voxels::of_labels([6; 3], [1.0; 3], random_labels(216, 3)).unwrap();
    let phases = [phase(MORTAR), phase(STONE)];
    let settings = settings(Scheme::Rotated, 1e-4);
    let stopped =
        elasticity(&voxels, &phases, false, &settings, &mut SolvedCases::default(), &mut |_| {}, &Stops);
    assert_eq!(stopped.err(), Some(HomogenizationError::Stopped));
}
