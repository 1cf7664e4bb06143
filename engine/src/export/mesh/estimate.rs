//! How many triangles a surface mesh will have, and how long its file will be, before it is made.
//!
//! A sphere without anything close has the triangles of its polyhedron. Near something at the gap `g(r)` at the
//! distance `r` from the nearest point, edges are at most `3 g(r)` (but no shorter than the floor), so that the number
//! of triangles there is the integral of `DENSITY / h(r)^2` over the surface; on an ellipsoid the triangles are
//! stretched by its map, and there are so many more as they are narrower than long. Both are summed over everything a
//! grain faces. From a plan, what a grain faces is a mean: grains of the size `j` at gaps from `g` to `g + dg` number
//! `rho_j 4 pi sigma_ij^2 G_ij dg`, `G_ij` the contact value of the pair distribution of hard spheres (Mansoori,
//! Carnahan, Starling and Leland 1971, Journal of Chemical Physics 54). Measured: `docs/meshes.md`.

use std::f64::consts::PI;

use super::bodies::{Contact, MeshModel};
use super::grain::Grains;
use super::options::SurfaceOptions;
use super::shell::{Division, Shell};
use super::size::{CIRCUMRADIUS, EDGE_PER_GAP};
use super::sphere::Finenesses;
use super::{GRAINS_PER_LOOK, check, surface_mean_mm};
use crate::arrays::{self, Each as _};
use crate::control::Control;
use crate::distance::DistanceRule;
use crate::elementary::powf;
use crate::export::estimate::MeshEstimate;
use crate::export::{ExportError, go_on};
use crate::plan::ClassPlan;
use crate::request::Specimen;

/// Triangles per area over `1 / h^2`, where edges are cut in halves until none is longer than `h`: fitted to meshes of
/// packings with gaps from 0 to 1 mm. Equilateral triangles of the edge `h` would have 2.31.
const DENSITY: f64 = 5.0;
/// The same where nothing is close.
const EVEN_DENSITY: f64 = 2.31;
/// Bytes of a triangle and its half of a vertex in the file format `msh`: 32 + 16 bytes.
pub(super) const BYTES_PER_TRIANGLE: u64 = 48;
/// Steps of the integral over the surroundings of a nearest point.
const STEPS: usize = 16;
/// Most polyhedra, or ellipsoids, whose surfaces are made for an estimate, about.
const SAMPLED_GRAINS: usize = 200;
/// Sizes that a class of a plan is divided into.
const SIZES_PER_CLASS: usize = 4;
/// Gaps that the pair distribution is integrated over.
const GAPS: usize = 8;

/// Bytes of a triangle in the file format `stl`: twice 50 bytes, of which compression leaves 30 to 50 %.
const BYTES_PER_STL_TRIANGLE: u64 = 40;

impl MeshEstimate {
    /// The same triangles as STL.
    pub(super) fn as_stl(self) -> Self {
        Self { bytes: self.triangles.saturating_mul(BYTES_PER_STL_TRIANGLE), ..self }
    }

    fn of(triangles: f64) -> Self {
        let triangles = triangles.max(0.0).round() as u64;
        Self { triangles, bytes: triangles.saturating_mul(BYTES_PER_TRIANGLE), ..Self::default() }
    }
}

/// Estimates the mesh of a packing, and returns what was made for that: surfaces of templates, and in some cases that
/// of the specimen.
///
/// # Errors
/// [`ExportError::Unavailable`] for a periodic box, [`ExportError::Stopped`].
pub(super) fn of_model<'a>(
    model: &'a MeshModel<'_>,
    options: &'a SurfaceOptions,
    control: &dyn Control,
) -> Result<(MeshEstimate, Option<Shell>, Grains<'a>), ExportError> {
    check(model.specimen)?;
    let bodies = &model.bodies;
    if (0..bodies.len()).any(|row| bodies.polyhedron(row).is_some()) {
        return of_polyhedra(model, options, control);
    }
    let grains = Grains::new(model, options)?;
    let shell_mm = surface_mean_mm(model);
    let shell = Patch::of_diameter(options, shell_mm);
    let mut triangles = shell_triangles(model.specimen, shell.edge_mm);
    let of_even = even_share(&grains, bodies.len(), control)?;
    for row in 0..bodies.len() {
        if row % GRAINS_PER_LOOK == 0 {
            go_on(control)?;
        }
        let is_even = bodies.image(row).is_stretched();
        triangles += grains.fineness(row).triangles() as f64 * if is_even { of_even } else { 1.0 };
        if !options.size_field {
            continue;
        }
        let even = Patch::of_diameter(options, bodies.diameter(row));
        let mean_stretch = bodies.mean_stretch(row);
        let patch = |contact: &Contact| Patch {
            edge_mm: even.edge_mm * (contact.stretch / mean_stretch),
            aspect: contact.aspect,
            ..even
        };
        grains.for_each_facing(row, grains.reach_mm(row), |faced| {
            let contact = bodies.contact(row, faced.row, faced.toward);
            let patch = if is_even { even } else { patch(&contact) };
            triangles += patch.more_triangles(faced.gap, contact.bend);
        });
        for at_wall in model.walls(row) {
            let contact = bodies.contact(row, None, at_wall.toward);
            triangles += shell.more_triangles(at_wall.gap, contact.bend);
        }
    }
    Ok((MeshEstimate::of(triangles), None, grains))
}

/// Triangles of ellipsoids that are divided evenly over those of images of a sphere, by some of them.
fn even_share(grains: &Grains<'_>, count: usize, control: &dyn Control) -> Result<f64, ExportError> {
    let (mut of_even, mut of_images) = (0.0, 0.0);
    for row in (0..count).step_by(count.div_ceil(SAMPLED_GRAINS).max(1)) {
        go_on(control)?;
        if let Some(triangles) = grains.even_triangles(row) {
            of_even += triangles as f64;
            of_images += grains.fineness(row).triangles() as f64;
        }
    }
    Ok(if of_images > 0.0 { of_even / of_images } else { 1.0 })
}

/// Estimates the mesh of a packing of polyhedra: the surface of the specimen and those of some of the grains are made,
/// for the triangles of flat faces near each other follow from no curvature.
fn of_polyhedra<'a>(
    model: &'a MeshModel<'_>,
    options: &'a SurfaceOptions,
    control: &dyn Control,
) -> Result<(MeshEstimate, Option<Shell>, Grains<'a>), ExportError> {
    let most = (options.max_bytes / BYTES_PER_TRIANGLE) as usize + 1;
    let mut grains = Grains::new(model, options)?;
    let shell = Shell::new(model, Division::of(model, options), most);
    let shell_triangles = shell.as_ref().map_or(most, |shell| shell.surface.triangles.len());
    let step = model.bodies.len().div_ceil(SAMPLED_GRAINS).max(1);
    let (mut sampled, mut triangles) = (0, 0);
    for row in (step / 2..model.bodies.len()).step_by(step) {
        if sampled % GRAINS_PER_LOOK == 0 {
            go_on(control)?;
        }
        sampled += 1;
        let made = grains.surface(row, most);
        triangles += made.map_or(most, |(surface, _)| surface.triangles.len());
    }
    let share = model.bodies.len() as f64 / f64::max(sampled as f64, 1.0);
    Ok((MeshEstimate::of(shell_triangles as f64 + triangles as f64 * share), shell, grains))
}

/// Estimates the mesh of a packing of that plan: right within a factor of two or so, for gaps are known by their
/// statistics alone.
pub(super) fn of_plan(
    specimen: &Specimen,
    rule: &DistanceRule,
    classes: &[ClassPlan],
    options: &SurfaceOptions,
) -> MeshEstimate {
    let sizes = sizes(classes);
    let volume = specimen.volume_mm3();
    let of_power = |n: i32| sizes.iter().map(|size| size.grains * size.diameter_mm.powi(n)).sum::<f64>();
    let [x, y, z] = specimen.bounds_mm();
    let shell_mm = if of_power(2) > 0.0 { of_power(3) / of_power(2) } else { x }.min(x).min(y).min(z);
    let shell = Patch::of_diameter(options, shell_mm);
    let mut triangles = shell_triangles(specimen, shell.edge_mm);
    // Grains with half of the gap that they keep, which is what keeps them apart.
    let coated = |d: f64| d + rule.gap_mm(d, d);
    let moment = |n: i32| {
        let sum: f64 = sizes.iter().map(|size| size.grains * coated(size.diameter_mm).powi(n)).sum();
        PI / 6.0 * sum / volume
    };
    let (second, third) = (moment(2), moment(3).min(MOST_FILLED));
    let contact = |a: f64, b: f64| {
        let (free, share) = (1.0 - third, a * b / (a + b));
        1.0 / free + 3.0 * second * share / (free * free) + 2.0 * (second * share).powi(2) / free.powi(3)
    };
    let (faces, finenesses) = (specimen.domain().surface_mm2, Finenesses::new());
    for own in &sizes {
        let fineness = finenesses.nearest(PI * own.diameter_mm / options.edge_mm(own.diameter_mm));
        triangles += own.grains * fineness.triangles() as f64;
        if !options.size_field {
            continue;
        }
        let patch = Patch::of_diameter(options, own.diameter_mm);
        let radius = own.diameter_mm / 2.0;
        for other in &sizes {
            let sum = (own.diameter_mm + other.diameter_mm) / 2.0;
            let pairs = |gap: f64| {
                let area = 4.0 * PI * (sum + gap).powi(2);
                area * other.grains / volume * contact(coated(own.diameter_mm), coated(other.diameter_mm))
            };
            let least = rule.gap_mm(own.diameter_mm, other.diameter_mm);
            let more = patch.over_gaps(least, bend(Some(radius), Some(other.diameter_mm / 2.0)), pairs);
            triangles += own.grains * more;
        }
        // At a hard wall the density of centres is about that at contact with a grain without curvature.
        let at_wall = |_: f64| faces * own.grains / volume * contact(coated(own.diameter_mm), 1e12);
        let least = rule.wall_gap_mm(own.diameter_mm);
        let bend = bend(Some(radius), None);
        triangles += patch.over_gaps(least, bend, at_wall) + shell.over_gaps(least, bend, at_wall);
    }
    MeshEstimate::of(triangles)
}

/// Largest share of space that the pair distribution is evaluated at.
const MOST_FILLED: f64 = 0.7;

/// Grains of one size.
struct Size {
    diameter_mm: f64,
    grains: f64,
}

/// The sizes of a plan: within a class, numbers fall with a power of the diameter that gives the class its volume.
fn sizes(classes: &[ClassPlan]) -> Vec<Size> {
    let mut found = Vec::new();
    for class in classes.iter().filter(|class| class.grains > 0.0) {
        let ratio = (class.d_max_mm / class.d_min_mm).max(1.0);
        let diameters: [f64; SIZES_PER_CLASS] =
            arrays::from_fn(|i| class.d_min_mm * powf(ratio, (i as f64 + 0.5) / SIZES_PER_CLASS as f64));
        let mean_volume = class.volume_mm3 / class.grains;
        let mean_of = |power: f64| {
            let weights = diameters.each(|d| powf(d / class.d_min_mm, power));
            let volume: f64 = weights.iter().zip(diameters).map(|(w, d)| w * PI / 6.0 * d.powi(3)).sum();
            volume / weights.iter().sum::<f64>()
        };
        let (mut low, mut high) = (-20.0, 20.0);
        for _ in 0..40 {
            let middle = (low + high) / 2.0;
            if mean_of(middle) < mean_volume { low = middle } else { high = middle }
        }
        let weights = diameters.each(|d| powf(d / class.d_min_mm, low));
        let all: f64 = weights.iter().sum();
        found.extend(
            diameters
                .iter()
                .zip(weights)
                .map(|(&diameter_mm, w)| Size { diameter_mm, grains: class.grains * w / all }),
        );
    }
    found
}

/// Triangles of the specimen's faces where nothing is close: four to a rectangle of the edges' length.
fn shell_triangles(specimen: &Specimen, edge_mm: f64) -> f64 {
    4.0 * specimen.domain().surface_mm2 / (edge_mm * edge_mm)
}

/// A surface, to be refined near what it faces.
#[derive(Clone, Copy)]
struct Patch {
    edge_mm: f64,
    floor_mm: f64,
    /// Length of triangles over their width.
    aspect: f64,
}

/// How the gap of two surfaces grows, spheres of these radii or flat.
fn bend(one: Option<f64>, other: Option<f64>) -> f64 {
    let curvature = |radius: Option<f64>| radius.map_or(0.0, |r| 1.0 / r);
    (curvature(one) + curvature(other)) / 2.0
}

impl Patch {
    fn of_diameter(options: &SurfaceOptions, diameter: f64) -> Self {
        Self { edge_mm: options.edge_mm(diameter), floor_mm: options.floor_mm(diameter), aspect: 1.0 }
    }

    /// Triangles that a thing at that gap adds, which grows by `bend` times the square of the distance.
    fn more_triangles(&self, gap: f64, bend: f64) -> f64 {
        let gap = gap.max(0.0);
        if gap >= self.edge_mm / EDGE_PER_GAP {
            return 0.0;
        }
        // Gap to the other's surface at a distance along the own one.
        let farthest2 = (self.edge_mm / EDGE_PER_GAP - gap) / bend;
        // A triangle is as fine as its point nearest to the contact asks for.
        let farthest = farthest2.sqrt() + CIRCUMRADIUS * self.edge_mm;
        let mut more = 0.0;
        for step in 0..STEPS {
            let inner = farthest * step as f64 / STEPS as f64;
            let outer = farthest * (step + 1) as f64 / STEPS as f64;
            let r = (inner + outer) / 2.0;
            let mut length = self.edge_mm;
            for _ in 0..4 {
                let nearest = (r - CIRCUMRADIUS * length).max(0.0);
                let asked = EDGE_PER_GAP * (gap + bend * nearest * nearest);
                length = asked.clamp(self.floor_mm, self.edge_mm);
            }
            let density = DENSITY / (length * length) - EVEN_DENSITY / (self.edge_mm * self.edge_mm);
            if length < self.edge_mm {
                more += density.max(0.0) * PI * (outer * outer - inner * inner);
            }
        }
        more * self.aspect
    }

    /// The same over all gaps from the least, with that many things per mm of gap.
    fn over_gaps(&self, least: f64, bend: f64, per_mm: impl Fn(f64) -> f64) -> f64 {
        let most = self.edge_mm / EDGE_PER_GAP;
        if least >= most {
            return 0.0;
        }
        let width = (most - least) / GAPS as f64;
        (0..GAPS)
            .map(|i| least + (i as f64 + 0.5) * width)
            .map(|gap| per_mm(gap) * width * self.more_triangles(gap, bend))
            .sum()
    }
}
