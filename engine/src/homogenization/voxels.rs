//! The voxels of a periodic cell: the phase of each, and what is known of those that a surface cuts.

use crate::memory::{OutOfMemory, reserved};

/// In place of a phase: the voxel is one of [`CutVoxel`].
pub const CUT: u8 = u8::MAX;
/// Most phases of a cell.
pub const MAX_PHASES: usize = CUT as usize;

/// A voxel of two phases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutVoxel {
    /// Volume of the second phase over that of the voxel.
    pub share: f64,
    /// Unit normal of the surface between the phases, of either sign; 0 where the phases are to deform alike (rule of
    /// Voigt).
    pub normal: [f32; 3],
    /// Number of the voxel in its row along x.
    pub x: u16,
    /// Its phases.
    pub phases: [u8; 2],
}

/// The voxels of a periodic cell, x fastest.
#[derive(Clone, Debug)]
pub struct Voxels {
    /// Voxels along x, y, z.
    pub(super) shape: [usize; 3],
    /// Edges of a voxel.
    pub(super) spacing_mm: [f64; 3],
    /// The phase of each voxel.
    pub(super) phase: Vec<u8>,
    cuts: Vec<CutVoxel>,
    /// The first cut voxel of each row along x, and the number of all at the end.
    first_cut: Vec<u32>,
}

/// A row of voxels along x.
#[derive(Clone, Copy)]
pub(super) struct VoxelRow<'a> {
    pub(super) phase: &'a [u8],
    pub(super) cuts: &'a [CutVoxel],
}

impl Voxels {
    /// Voxels of whole phases; `phase` has as many values as the shape has voxels.
    ///
    /// # Errors
    /// The system refused memory.
    pub fn of_labels(shape: [usize; 3], spacing_mm: [f64; 3], phase: Vec<u8>) -> Result<Self, OutOfMemory> {
        Self::new(shape, spacing_mm, phase, Vec::new(), &[])
    }

    /// Voxels of which some are cut: those whose phase is [`CUT`], in the order of the voxels, with the number of cut
    /// voxels in each row along x.
    ///
    /// # Errors
    /// The system refused memory.
    pub fn new(
        shape: [usize; 3],
        spacing_mm: [f64; 3],
        phase: Vec<u8>,
        cuts: Vec<CutVoxel>,
        cuts_of_rows: &[u32],
    ) -> Result<Self, OutOfMemory> {
        let rows = shape[1] * shape[2];
        debug_assert_eq!(phase.len(), shape[0] * rows);
        let mut first_cut = reserved(rows + 1)?;
        let mut first = 0;
        for row in 0..rows {
            first_cut.push(first);
            first += cuts_of_rows.get(row).copied().unwrap_or(0);
        }
        first_cut.push(first);
        debug_assert_eq!(first as usize, cuts.len());
        Ok(Self { shape, spacing_mm, phase, cuts, first_cut })
    }

    /// The cell and its images at the planes across x, y and z through its end: a cell with twice the edges.
    ///
    /// # Errors
    /// The system refused memory.
    pub fn mirrored(&self) -> Result<Self, OutOfMemory> {
        let [nx, ny, nz] = self.shape;
        let shape = [2 * nx, 2 * ny, 2 * nz];
        let mut phase = reserved(8 * self.len())?;
        let mut cuts = reserved(8 * self.cuts.len())?;
        let mut of_rows = reserved(4 * ny * nz)?;
        for k in (0..nz).map(|k| (k, 1.0)).chain((0..nz).rev().map(|k| (k, -1.0))) {
            for j in (0..ny).map(|j| (j, 1.0)).chain((0..ny).rev().map(|j| (j, -1.0))) {
                let row = self.row(j.0, k.0);
                phase.extend_from_slice(row.phase);
                phase.extend(row.phase.iter().rev());
                let image = |cut: &CutVoxel, of_x: f32, x: u16| {
                    let [a, b, c] = cut.normal;
                    CutVoxel { normal: [of_x * a, j.1 * b, k.1 * c], x, ..*cut }
                };
                let last = (2 * nx - 1) as u16;
                cuts.extend(row.cuts.iter().map(|cut| image(cut, 1.0, cut.x)));
                cuts.extend(row.cuts.iter().rev().map(|cut| image(cut, -1.0, last - cut.x)));
                of_rows.push(2 * row.cuts.len() as u32);
            }
        }
        Self::new(shape, self.spacing_mm, phase, cuts, &of_rows)
    }

    /// Voxels along x, y, z.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.phase.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.phase.is_empty()
    }

    /// The CRC-32 of the shape, the phases and the cut voxels.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let mut sum = crc32fast::Hasher::new();
        for n in self.shape {
            sum.update(&(n as u64).to_le_bytes());
        }
        for h in self.spacing_mm {
            sum.update(&h.to_le_bytes());
        }
        sum.update(&self.phase);
        for CutVoxel { share, normal, x, phases } in &self.cuts {
            sum.update(&share.to_le_bytes());
            for n in normal {
                sum.update(&n.to_le_bytes());
            }
            sum.update(&x.to_le_bytes());
            sum.update(phases);
        }
        sum.finalize()
    }

    /// The phase of each voxel, x fastest; of one that a surface cuts the phase with the larger share.
    pub fn largest_phases(&self) -> impl Iterator<Item = u8> + '_ {
        let mut cuts = self.cuts.iter();
        self.phase.iter().map(move |phase| match phase {
            &CUT => cuts.next().map_or(CUT, |cut| cut.phases[usize::from(cut.share > 0.5)]),
            phase => *phase,
        })
    }

    /// The cut voxels.
    pub fn cuts(&self) -> &[CutVoxel] {
        &self.cuts
    }

    /// Volume of each of the first phases over that of the cell.
    pub fn shares(&self, phases: usize) -> Vec<f64> {
        let mut voxels = [0_u64; 1 + CUT as usize];
        self.phase.iter().for_each(|phase| voxels[usize::from(*phase)] += 1);
        let mut sums: Vec<f64> = voxels[..phases].iter().map(|n| *n as f64).collect();
        for cut in &self.cuts {
            let [first, second] = cut.phases.map(usize::from);
            sums[first] += 1.0 - cut.share;
            sums[second] += cut.share;
        }
        let all = self.len() as f64;
        sums.into_iter().map(|sum| sum / all).collect()
    }

    /// The row along x with these numbers along y and z.
    pub(super) fn row(&self, j: usize, k: usize) -> VoxelRow<'_> {
        let row = k * self.shape[1] + j;
        let nx = self.shape[0];
        let cuts = self.first_cut[row] as usize..self.first_cut[row + 1] as usize;
        VoxelRow { phase: &self.phase[row * nx..][..nx], cuts: &self.cuts[cuts] }
    }
}
