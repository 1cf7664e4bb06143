//! Lengths of edges in space, which grow away from the surfaces, for Gmsh's field `Structured`.
//!
//! Values stand on a regular grid. Near the surfaces they are the lengths of the edges there, and from there they grow
//! by `growth - 1` per length: the largest function that is below the given lengths and grows no faster, along the axes
//! and diagonals of the grid (a chamfer distance; Borgefors 1986, 10.1016/S0734-189X(86)80047-0).

use nalgebra::Vector3;

use crate::arrays::Each as _;
use crate::control::Control;
use crate::elementary::cbrt;
use crate::export::mesh::surfaces::Mesh;
use crate::export::{ExportError, go_on};
use crate::memory::{filled, reserved};

/// Most values of a grid.
const MOST_VALUES: f64 = 2e6;
/// Values per edge, where that takes no more than [`MOST_VALUES`].
const PER_EDGE: f64 = 2.0;

/// Values on a regular grid from the origin on.
pub(super) struct SizeField {
    step_mm: f64,
    shape: [usize; 3],
    /// The last axis is the fastest.
    values_mm: Vec<f64>,
}

impl SizeField {
    /// The field of edges that grow by a ratio away from the surfaces of a mesh, up to the length `most_mm`.
    pub(super) fn new(
        mesh: &Mesh,
        bounds_mm: [f64; 3],
        growth: f64,
        most_mm: f64,
        control: &dyn Control,
    ) -> Result<Self, ExportError> {
        let triangles = edges(mesh)?;
        let mean = triangles.iter().map(|(_, edge)| edge).sum::<f64>() / triangles.len().max(1) as f64;
        let [x, y, z] = bounds_mm;
        let step_mm = (mean / PER_EDGE).max(cbrt(x * y * z / MOST_VALUES));
        let shape = bounds_mm.each(|length| (length / step_mm).ceil() as usize + 1);
        let mut field = Self { step_mm, shape, values_mm: filled(shape.iter().product(), most_mm)? };
        for (center, edge) in triangles {
            let at = [0, 1, 2]
                .each(|axis| ((center[axis] / step_mm).round().max(0.0) as usize).min(shape[axis] - 1));
            let place = field.place(at);
            field.values_mm[place] = field.values_mm[place].min(edge);
        }
        field.limit((growth - 1.0) * step_mm, control)?;
        Ok(field)
    }

    fn place(&self, [i, j, k]: [usize; 3]) -> usize {
        k + self.shape[2] * (j + self.shape[1] * i)
    }

    /// Lowers values until none is more than `slope` per step above a neighbour: a pass forth and a pass back, each
    /// over the half of the 26 neighbours that it has passed.
    fn limit(&mut self, slope: f64, control: &dyn Control) -> Result<(), ExportError> {
        let mut neighbors = Vec::new();
        for i in -1_isize..=1 {
            for j in -1_isize..=1 {
                for k in -1_isize..=1 {
                    if (i, j, k) < (0, 0, 0) {
                        let steps = ((i * i + j * j + k * k) as f64).sqrt();
                        neighbors.push(([i, j, k], slope * steps));
                    }
                }
            }
        }
        let [nx, ny, nz] = self.shape;
        for sign in [1, -1] {
            for i in 0..nx {
                go_on(control)?;
                for j in 0..ny {
                    for k in 0..nz {
                        let at = if sign > 0 { [i, j, k] } else { [nx - 1 - i, ny - 1 - j, nz - 1 - k] };
                        let own = self.place(at);
                        for (offset, rise) in &neighbors {
                            let there =
                                [0, 1, 2].each(|axis| at[axis].checked_add_signed(sign * offset[axis]));
                            if let [Some(i), Some(j), Some(k)] = there
                                && i < nx
                                && j < ny
                                && k < nz
                            {
                                let limit = self.values_mm[self.place([i, j, k])] + rise;
                                self.values_mm[own] = self.values_mm[own].min(limit);
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// The binary file that Gmsh's field `Structured` reads: origin, steps, shape, values.
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, ExportError> {
        let mut bytes = reserved(8 * 6 + 4 * 3 + 8 * self.values_mm.len())?;
        for x in [0.0, 0.0, 0.0, self.step_mm, self.step_mm, self.step_mm] {
            bytes.extend_from_slice(&x.to_le_bytes());
        }
        for count in self.shape {
            bytes.extend_from_slice(&(count as i32).to_le_bytes());
        }
        for value in &self.values_mm {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        Ok(bytes)
    }
}

/// The triangles of all surfaces: centre and mean length of the edges.
fn edges(mesh: &Mesh) -> Result<Vec<(Vector3<f64>, f64)>, ExportError> {
    let shell = &mesh.shell.surface;
    let mut found = reserved(shell.triangles.len() + mesh.grain_triangles())?;
    let mut add = |points: &[[f64; 3]], corners: &[u32; 3]| {
        let [a, b, c] = corners.each(|corner| Vector3::from(points[corner as usize]));
        found.push(((a + b + c) / 3.0, ((a - b).norm() + (b - c).norm() + (c - a).norm()) / 3.0));
    };
    shell.triangles.iter().for_each(|corners| add(&shell.points, corners));
    for row in 0..mesh.grains() {
        let (points, triangles) = mesh.grain(row);
        for corners in triangles {
            add(points, corners);
        }
    }
    Ok(found)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::control::Unattended;

    /// Against all pairs: between two values the rise is that along the shortest way over neighbours of the grid.
    #[test]
    fn a_field_grows_no_faster_than_it_may() {
        let shape = [7, 5, 6];
        let mut field = SizeField { step_mm: 0.5, shape, values_mm: vec![9.0; 210] };
        let seeds = [([0, 0, 0], 1.0), ([6, 4, 2], 0.3), ([3, 1, 5], 2.0)];
        for (at, value) in seeds {
            let place = field.place(at);
            field.values_mm[place] = value;
        }
        field.limit(0.2, &Unattended).unwrap();
        for i in 0..7_usize {
            for j in 0..5_usize {
                for k in 0..6_usize {
                    let way = |from: [usize; 3]| {
                        let mut apart = [i.abs_diff(from[0]), j.abs_diff(from[1]), k.abs_diff(from[2])];
                        apart.sort_unstable();
                        let [least, middle, most] = apart.map(|n| n as f64);
                        3.0_f64.sqrt() * least + 2.0_f64.sqrt() * (middle - least) + (most - middle)
                    };
                    let expected = seeds.iter().map(|(at, value)| value + 0.2 * way(*at)).fold(9.0, f64::min);
                    let found = field.values_mm[field.place([i, j, k])];
                    assert!((found - expected).abs() < 1e-12, "{found} for {expected} at {i} {j} {k}");
                }
            }
        }
        let bytes = field.to_bytes().unwrap();
        assert_eq!(bytes.len(), 60 + 8 * 210);
        assert_eq!(bytes[60..68], 1.0_f64.to_le_bytes());
    }
}
