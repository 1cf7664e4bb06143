//! When saturation is proven, and when voxels of the deepest level leave it open.

use std::num::NonZeroUsize;

use super::*;
use crate::control::Unattended;
use crate::request::Specimen;
use crate::request::{Boundary, Distance};
use crate::rng::{Stream, stream};

/// Three spheres on a line that touch cover all of it but the two points of contact, which no voxel that holds one can
/// show: the search ends with no voxel left, and has proven nothing. Where they overlap, it has.
#[test]
fn saturation_is_not_proven_where_voxels_are_left_undecided() {
    let specimen = Specimen::Box { size_mm: [12.0, 2.0, 2.0], boundary: Boundary::Walls };
    let rsa = Rsa {
        diameters_mm: &[2.0],
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
        attempts_per_grain: None,
        preference: None,
        threads: NonZeroUsize::MIN,
    };
    let (part, region) = (rsa.part(0), rsa.domain.center_region(rsa.clearance(0)).unwrap());
    let search = |reach: f64| {
        let placed = [2.0, 6.0, 10.0].map(|x| [x, 1.0, 1.0, reach - part]);
        let cells =
            Cells::build(CellBuffers::default(), &region, false, 3.0, &placed, part, &|| false).unwrap();
        let served = Served {
            domain: &specimen.domain(),
            largest_part: part,
            least_part: part,
            largest_clearance: rsa.clearance(0),
            least_clearance: rsa.clearance(0),
        };
        let mut free = FreeSpace::whole(VoxelBuffers::default(), &cells, served).unwrap();
        free.activate(part, true);
        let mut run = Run {
            rsa: &rsa,
            placed: Vec::new(),
            buffers: Default::default(),
            statistics: RsaStatistics::default(),
            looks: 0,
            draws_ahead: false,
            cpu: Cpu::detect(),
            control: &Unattended,
        };
        let mut search =
            Search { part, region, failed: 0, attempts: Attempts::new(None, u64::MAX), region_cells: 0.0 };
        match run.search(&mut search, &mut free, &cells, &mut stream(1, Stream::Rsa)) {
            Found::Nothing { saturation_proven } => saturation_proven,
            _ => panic!("a point of a covered line is a place"),
        }
    };
    assert!(!search(2.0));
    assert!(search(2.001));
}
