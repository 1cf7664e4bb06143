//! The grading curve that was asked for beside the one of the grains placed.
//!
//! Both are the mass fraction of the whole aggregate that passes a sieve. Grains below the cut-off are
//! not placed, but counted as passing in both, so that a curve of a standard looks as in the standard.

use crate::elementary::powf;
use crate::mix::class::Law;
use crate::mix::{GradedMix, sphere_volume};
use crate::sorting;

/// Diameters per curve, evenly spaced in the logarithm; the sieves come on top.
const POINTS: usize = 160;
/// How far beyond the extreme grains the curves reach, as a factor: so far that steps there are seen.
const MARGIN: f64 = 1.12;

/// Target and achieved grading.
#[derive(Clone, Debug, PartialEq)]
pub struct GradingCurve {
    /// Values at the bounds of the sieve classes, from fine to coarse.
    pub sieves: Vec<GradingPoint>,
    /// Values at the sieves and between, from fine to coarse.
    pub curve: Vec<GradingPoint>,
}

/// One diameter of the curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradingPoint {
    /// Diameter of the sieve, or between two.
    pub d_mm: f64,
    /// Mass fraction that the mix wants to pass.
    pub target: f64,
    /// Mass fraction that passes in the packing.
    pub achieved: f64,
}

/// A grain as sieves see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizedGrain {
    /// Size that the grading curve classifies: the diameter of a sphere.
    pub size_mm: f64,
    /// Volume.
    pub volume_mm3: f64,
}

impl SizedGrain {
    /// A sphere.
    #[must_use]
    pub fn sphere(d_mm: f64) -> Self {
        Self { size_mm: d_mm, volume_mm3: sphere_volume(d_mm) }
    }
}

/// The grading of grains beside that of the mix they were drawn from.
pub fn grading(grains: Vec<SizedGrain>, mix: &GradedMix) -> GradingCurve {
    let mut edges: Vec<f64> = mix.sieve_classes.iter().flat_map(|c| [c.low_mm, c.high_mm]).collect();
    sorting::ascending(&mut edges);
    edges.dedup();
    let target = Target::new(mix);
    let achieved = Cumulative::new(grains);
    // Volume of all aggregate of the mix, the part that is not placed included.
    let all_mm3 = mix.volume_fraction_mixture * mix.specimen_volume_mm3;
    let at = |d_mm: f64| GradingPoint {
        d_mm,
        target: target.passing(d_mm, all_mm3),
        achieved: if all_mm3 > 0.0 { (1.0 - achieved.above_mm3(d_mm) / all_mm3).max(0.0) } else { 0.0 },
    };
    let mut diameters = edges.clone();
    let (from, to) = (mix.d_min_mm / MARGIN, mix.d_max_mm * MARGIN);
    if from > 0.0 {
        diameters.extend((0..POINTS).map(|i| from * powf(to / from, i as f64 / (POINTS - 1) as f64)));
        // Equal grains make a step: the curve has to stand below it too.
        diameters.extend(edges.iter().map(|d| d * (1.0 - 1.0e-9)));
    }
    sorting::ascending(&mut diameters);
    diameters.dedup();
    GradingCurve {
        sieves: edges.into_iter().map(at).collect(),
        curve: diameters.into_iter().map(at).collect(),
    }
}

/// The mix's own curve.
enum Target<'a> {
    Classes(&'a GradedMix),
    List(Cumulative),
}

impl<'a> Target<'a> {
    fn new(mix: &'a GradedMix) -> Self {
        match &mix.list {
            Some(list) => {
                Self::List(Cumulative::new(list.iter().map(|&d_mm| SizedGrain::sphere(d_mm)).collect()))
            }
            None => Self::Classes(mix),
        }
    }

    fn passing(&self, d: f64, all_mm3: f64) -> f64 {
        let retained = match self {
            Self::List(list) if all_mm3 > 0.0 => list.above_mm3(d) / all_mm3,
            Self::List(_) => 0.0,
            Self::Classes(mix) => mix
                .sieve_classes
                .iter()
                .map(|class| {
                    let share = if d >= class.high_mm {
                        0.0
                    } else if d < class.low_mm || class.law == Law::Single {
                        1.0
                    } else {
                        class.mass_share(d, class.high_mm)
                    };
                    class.mass_fraction * share
                })
                .sum(),
        };
        (1.0 - retained).max(0.0)
    }
}

/// Grains from fine to coarse with the volume of all that are coarser.
struct Cumulative {
    size_mm: Vec<f64>,
    /// `above_mm3[i]`: volume of the grains from `i` on.
    above_mm3: Vec<f64>,
}

impl Cumulative {
    fn new(mut grains: Vec<SizedGrain>) -> Self {
        sorting::by_number(&mut grains, |grain| grain.size_mm);
        let mut above_mm3 = vec![0.0; grains.len() + 1];
        for (i, grain) in grains.iter().enumerate().rev() {
            above_mm3[i] = above_mm3[i + 1] + grain.volume_mm3;
        }
        Self { size_mm: grains.iter().map(|grain| grain.size_mm).collect(), above_mm3 }
    }

    /// Volume of the grains that a sieve of this size retains.
    fn above_mm3(&self, d: f64) -> f64 {
        self.above_mm3[self.size_mm.partition_point(|&x| x <= d)]
    }
}
