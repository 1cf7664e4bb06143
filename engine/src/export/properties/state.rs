//! Load cases that are solved, of both grids: what a run that was stopped goes on from.
//!
//! The body of a checkpoint has a section for each grid that is begun, the coarse one first: the CRC-32 of its voxels,
//! the numbers of load cases of stiffness, conductivity and diffusivity that are solved, and these. Sections of other
//! voxels are of no use, and so are those that follow.

use std::io::{self, Read as _, Write};

use super::PropertyOptions;
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::Control;
use crate::homogenization::{CaseError, SolvedCases, Voxels};
use crate::memory::OutOfMemory;
use crate::request::Material;

/// Most load cases of a section: a larger number is damage.
const MOST_CASES: [u8; 3] = [7, 3, 3];

/// Load cases of a grid that are solved.
#[derive(Debug, Default)]
pub(super) struct GridCases {
    pub(super) elastic: SolvedCases<3>,
    pub(super) conductivity: SolvedCases<1>,
    pub(super) diffusivity: SolvedCases<1>,
}

/// The load cases of a grid with the sum of its voxels.
struct Section<'a> {
    sum: u32,
    elastic: &'a SolvedCases<3>,
    conducting: [&'a SolvedCases<1>; 2],
}

impl Section<'_> {
    fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let [conductivity, diffusivity] = self.conducting;
        out.write_all(&self.sum.to_le_bytes())?;
        out.write_all(&[self.elastic.len(), conductivity.len(), diffusivity.len()].map(|n| n as u8))?;
        self.elastic.write(out)?;
        conductivity.write(out)?;
        diffusivity.write(out)
    }
}

/// What a checkpoint of properties belongs to: the options and the materials of the phases.
pub(super) fn identity(options: &PropertyOptions, materials: &[Material]) -> Option<Vec<u8>> {
    serde_json::to_vec(&("properties", options, materials)).ok()
}

/// Keeps the load cases that are solved where a checkpoint is due, and gives back those of an earlier run.
pub(super) struct State<'a> {
    identity: Option<Vec<u8>>,
    /// What is left of the checkpoint of an earlier run.
    earlier: Option<(Vec<u8>, usize)>,
    control: &'a dyn Control,
    /// Grids that are done, with the sums of their voxels.
    done: Vec<(u32, GridCases)>,
}

impl<'a> State<'a> {
    pub(super) fn new(identity: Option<Vec<u8>>, resume: Option<Resume>, control: &'a dyn Control) -> Self {
        Self { identity, earlier: resume.map(|resume| (resume.body, 0)), control, done: Vec::new() }
    }

    /// The load cases of the next grid that an earlier run has solved.
    ///
    /// # Errors
    /// The system refused memory.
    pub(super) fn earlier(&mut self, voxels: &Voxels) -> Result<GridCases, OutOfMemory> {
        let Some((body, at)) = self.earlier.take() else { return Ok(GridCases::default()) };
        let mut rest = &body[at..];
        match read_section(&mut rest, voxels) {
            Ok(Some(cases)) => {
                let at = body.len() - rest.len();
                self.earlier = (at < body.len()).then_some((body, at));
                Ok(cases)
            }
            Ok(None) | Err(CaseError::Io(_)) => Ok(GridCases::default()),
            Err(CaseError::OutOfMemory(error)) => Err(error),
        }
    }

    /// Keeps the load cases so far of a grid after those that are done, where a checkpoint is due.
    pub(super) fn keep(&self, sum: u32, elastic: &SolvedCases<3>, conducting: [&SolvedCases<1>; 2]) {
        let Some(identity) = self.identity.as_ref().filter(|_| self.control.wants_checkpoint()) else {
            return;
        };
        let write_body = |out: &mut dyn Write| {
            for (sum, cases) in &self.done {
                let conducting = [&cases.conductivity, &cases.diffusivity];
                Section { sum: *sum, elastic: &cases.elastic, conducting }.write(out)?;
            }
            Section { sum, elastic, conducting }.write(out)
        };
        self.control.keep_checkpoint(&Checkpoint::of_export(identity, &write_body));
    }

    /// A grid is done.
    pub(super) fn end_grid(&mut self, sum: u32, cases: GridCases) {
        self.done.push((sum, cases));
    }

    /// The load cases of the grid that was done last.
    pub(super) fn last(&self) -> Option<&GridCases> {
        self.done.last().map(|(_, cases)| cases)
    }
}

/// The load cases of a section; none where it is of other voxels.
fn read_section(input: &mut &[u8], voxels: &Voxels) -> Result<Option<GridCases>, CaseError> {
    let mut sum = [0; 4];
    input.read_exact(&mut sum)?;
    let mut numbers = [0_u8; 3];
    input.read_exact(&mut numbers)?;
    if u32::from_le_bytes(sum) != voxels.checksum()
        || numbers.iter().zip(MOST_CASES).any(|(n, most)| *n > most)
    {
        return Ok(None);
    }
    let [elastic, conductivity, diffusivity] = numbers.map(usize::from);
    let n = voxels.len();
    Ok(Some(GridCases {
        elastic: SolvedCases::read(input, elastic, n)?,
        conductivity: SolvedCases::read(input, conductivity, n)?,
        diffusivity: SolvedCases::read(input, diffusivity, n)?,
    }))
}
