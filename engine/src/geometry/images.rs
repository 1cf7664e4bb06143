//! The periodic images of a grain that meet the box.
//!
//! A periodic box with the edges `L` repeats every grain at `c + k L`, with three integers `k`. An image meets the box
//! `0 < x < L` if its own bounding box, `c + k L ± h`, has points in common with it. A grain may be longer than an
//! edge: then more than three of its images along this axis meet the box. All other questions are put in this form: the
//! boxes that the surroundings of a grain meet are the images of the surroundings that meet the box, the other way
//! round; and the images of a grain that come near the grain itself are those of its surroundings that hold its centre.

use nalgebra::Vector3;

use crate::domain::Domain;
use crate::memory::{OutOfMemory, make_room};

/// Share of a length by which reaches are longer than asked for, far above rounding.
const MARGIN: f64 = 1e-9;

/// The images of grains in a specimen; along an axis on which it does not repeat there is the grain itself alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Images {
    bounds_mm: [f64; 3],
    /// By axis.
    is_periodic: [bool; 3],
}

/// One image of a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Image {
    /// Edges of the box by which it is moved, along each axis.
    pub(crate) steps: [i32; 3],
    /// The same in mm.
    pub(crate) offset_mm: Vector3<f64>,
}

impl Images {
    pub(crate) fn new(domain: impl Into<Domain>) -> Self {
        let domain = domain.into();
        Self { bounds_mm: domain.bounds_mm, is_periodic: domain.periods_mm.map(|period| period.is_some()) }
    }

    /// Those of a box with these edges.
    pub(crate) fn of_box(bounds_mm: [f64; 3], is_periodic: bool) -> Self {
        Self { bounds_mm, is_periodic: [is_periodic; 3] }
    }

    /// Those of a specimen all of whose lengths are multiplied.
    #[must_use]
    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self { bounds_mm: self.bounds_mm.map(|length| length * factor), ..self }
    }

    /// The images whose bounding boxes, with the half-lengths `half_mm` around the centre, have a point in common with
    /// the inside of the box; in ascending order of the steps, the last axis fastest. With walls: the grain itself,
    /// wherever it lies.
    pub(crate) fn meeting_box(
        &self,
        center_mm: [f64; 3],
        half_mm: [f64; 3],
    ) -> impl Iterator<Item = Image> + use<> {
        let [x, y, z] = [0, 1, 2].map(|a| self.steps(a, center_mm[a], half_mm[a]));
        let bounds = self.bounds_mm;
        x.flat_map(move |i| {
            let z = z.clone();
            y.clone().flat_map(move |j| z.clone().map(move |k| [i, j, k]))
        })
        .map(move |steps| Image { steps, offset_mm: offset_mm(steps, bounds) })
    }

    /// What is added to a centre after these steps, in mm.
    pub(crate) fn offset_mm(&self, steps: [i32; 3]) -> Vector3<f64> {
        offset_mm(steps, self.bounds_mm)
    }

    /// The boxes, by the steps from the box itself, that the bounding box around a point has a point in common with; in
    /// ascending order of the steps, the last axis fastest. What is within `half_mm` of the point lies in them. With
    /// walls: the box itself.
    pub(crate) fn boxes_met(
        &self,
        center_mm: [f64; 3],
        half_mm: [f64; 3],
    ) -> impl Iterator<Item = [i32; 3]> + use<> {
        // A box moved by k meets the surroundings where these, moved by -k, meet the box.
        let [x, y, z] = [0, 1, 2].map(|a| self.steps(a, center_mm[a], half_mm[a]).rev().map(|step| -step));
        x.flat_map(move |i| {
            let z = z.clone();
            y.clone().flat_map(move |j| z.clone().map(move |k| [i, j, k]))
        })
    }

    /// The largest step along each axis after which a grain somewhere in the box, which reaches `reach_mm` from its
    /// centre, has a point in common with it; or a little more, for rounding.
    pub(crate) fn most_steps(&self, reach_mm: f64) -> [i32; 3] {
        [0, 1, 2].map(|a| {
            let half_mm = self.bounds_mm[a] / 2.0;
            let steps = self.steps(a, half_mm, half_mm + reach_mm * (1.0 + MARGIN));
            steps.map(i32::abs).max().unwrap_or(0)
        })
    }

    /// One of each two opposite images of a grain whose centres are less than `reach_mm` from its own, the nearest
    /// first; none with walls.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn of_itself(&self, reach_mm: f64) -> Result<Vec<Image>, OutOfMemory> {
        let mut images = Vec::new();
        let middle = self.bounds_mm.map(|length| length / 2.0);
        let half = middle.map(|half| half + reach_mm * (1.0 + MARGIN));
        for image in self.meeting_box(middle, half) {
            if image.steps > [0; 3] && image.offset_mm.norm() < reach_mm {
                make_room(&mut images, 1)?;
                images.push(image);
            }
        }
        images.sort_by(|a, b| a.offset_mm.norm().total_cmp(&b.offset_mm.norm()));
        Ok(images)
    }

    /// The steps along one axis after which the interval `center_mm ± half_mm` has a point in common with the inside of
    /// the box.
    pub(crate) fn steps(
        &self,
        axis: usize,
        center_mm: f64,
        half_mm: f64,
    ) -> impl DoubleEndedIterator<Item = i32> + Clone + use<> {
        let length = self.bounds_mm[axis];
        let is_periodic = self.is_periodic[axis];
        // One step more at both ends than the quotients say, which are rounded; the filter decides.
        let (low, high) = if is_periodic {
            let low = (-half_mm - center_mm) / length;
            let high = (length + half_mm - center_mm) / length;
            (low.floor() as i32, high.ceil() as i32)
        } else {
            (0, 0)
        };
        (low..=high).filter(move |step| {
            let at = center_mm + f64::from(*step) * length;
            !is_periodic || at + half_mm > 0.0 && at - half_mm < length
        })
    }
}

fn offset_mm(steps: [i32; 3], bounds_mm: [f64; 3]) -> Vector3<f64> {
    Vector3::from_fn(|a, _| f64::from(steps[a]) * bounds_mm[a])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashSet;

    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;
    use crate::request::Boundary;
    use crate::request::Specimen;

    fn periodic(size_mm: [f64; 3]) -> Images {
        Images::new(&Specimen::cuboid(size_mm, Boundary::Periodic))
    }

    #[test]
    fn a_grain_inside_has_one_image_and_one_across_a_face_two() {
        let images = periodic([10.0, 20.0, 30.0]);
        let steps =
            |center, half| images.meeting_box(center, half).map(|image| image.steps).collect::<Vec<_>>();
        assert_eq!(steps([5.0, 5.0, 5.0], [1.0; 3]), [[0, 0, 0]]);
        assert_eq!(steps([0.5, 5.0, 5.0], [1.0; 3]), [[0, 0, 0], [1, 0, 0]]);
        assert_eq!(steps([5.0, 5.0, 29.5], [1.0; 3]), [[0, 0, -1], [0, 0, 0]]);
        // A bounding box that ends at a face has no point inside beyond it.
        assert_eq!(steps([1.0, 5.0, 5.0], [1.0; 3]), [[0, 0, 0]]);
    }

    #[test]
    fn a_grain_longer_than_an_edge_has_all_its_images() {
        let images = periodic([8.0, 60.0, 60.0]);
        let found: Vec<_> = images.meeting_box([4.0, 30.0, 30.0], [14.0, 1.0, 1.0]).collect();
        // 4 - 14 + 8 k < 8 and 4 + 14 + 8 k > 0.
        assert_eq!(found.iter().map(|image| image.steps[0]).collect::<Vec<_>>(), [-2, -1, 0, 1, 2]);
        assert_eq!(found[0].offset_mm, Vector3::new(-16.0, 0.0, 0.0));
    }

    #[test]
    fn walls_leave_the_grain_itself() {
        let size_mm = [10.0; 3];
        let images = Images::new(&Specimen::cuboid(size_mm, Boundary::Walls));
        let found: Vec<_> = images.meeting_box([0.5, 5.0, 9.9], [1.0; 3]).collect();
        assert_eq!(found, [Image { steps: [0; 3], offset_mm: Vector3::zeros() }]);
    }

    #[test]
    fn an_axis_between_walls_has_no_images() {
        let images = Images { bounds_mm: [10.0; 3], is_periodic: [true, false, true] };
        let found: Vec<_> = images.meeting_box([0.5, 0.5, 5.0], [1.0; 3]).map(|image| image.steps).collect();
        assert_eq!(found, [[0, 0, 0], [1, 0, 0]]);
        let itself = images.of_itself(10.5).unwrap();
        assert_eq!(itself.iter().map(|image| image.steps).collect::<Vec<_>>(), [[0, 0, 1], [1, 0, 0]]);
        assert_eq!(images.most_steps(1.0), [1, 0, 1]);
    }

    #[test]
    fn images_of_a_grain_near_itself_are_one_of_each_two_from_the_nearest_on() {
        let found = periodic([3.0, 10.0, 10.0]).of_itself(10.2).unwrap();
        let steps: Vec<[i32; 3]> = found.iter().map(|image| image.steps).collect();
        // 3, 6 and 9 mm along x, 10 mm along y and z; one step along x and y is sqrt(109) = 10.44 mm.
        assert_eq!(steps, [[1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1], [0, 1, 0]]);
        assert_eq!(found[2].offset_mm, Vector3::new(9.0, 0.0, 0.0));
        let walls = Images::new(&Specimen::cuboid([3.0; 3], Boundary::Walls));
        assert_eq!(walls.of_itself(100.0).unwrap(), []);
        assert_eq!(walls.boxes_met([1.0; 3], [9.0; 3]).collect::<Vec<_>>(), [[0; 3]]);
    }

    properties! {
        /// Against all steps up to 12 boxes away.
        #[test]
        fn they_are_those_of_brute_force(
            size in prop::array::uniform3(1.0..20.0_f64),
            center in prop::array::uniform3(0.0..1.0_f64),
            half in prop::array::uniform3(0.01..40.0_f64),
        ) {
            let center: [f64; 3] = std::array::from_fn(|a| center[a] * size[a]);
            let half: [f64; 3] = std::array::from_fn(|a| half[a].min(10.0 * size[a]));
            let found: HashSet<[i32; 3]> =
                periodic(size).meeting_box(center, half).map(|image| image.steps).collect();
            let meets = |a: usize, step: i32| {
                let at = center[a] + f64::from(step) * size[a];
                at + half[a] > 0.0 && at - half[a] < size[a]
            };
            let along = |a: usize| (-12..=12).filter(move |step| meets(a, *step)).collect::<Vec<_>>();
            let [x, y, z] = [0, 1, 2].map(along);
            prop_assert_eq!(found.len(), x.len() * y.len() * z.len());
            for steps in found {
                prop_assert!((0..3).all(|a| meets(a, steps[a])));
            }
            // A box moved by the steps has points within the half-lengths of the centre.
            let meets = |a: usize, step: i32| {
                let low = f64::from(step) * size[a];
                center[a] + half[a] > low && center[a] - half[a] < low + size[a]
            };
            let along = |a: usize| (-12..=12).filter(move |step| meets(a, *step)).collect::<Vec<_>>();
            let [x, y, z] = [0, 1, 2].map(along);
            let met: Vec<[i32; 3]> = periodic(size).boxes_met(center, half).collect();
            prop_assert_eq!(met.len(), x.len() * y.len() * z.len());
            prop_assert!(met.is_sorted());
            let most = periodic(size).most_steps(half.into_iter().fold(0.0, f64::max));
            for steps in met {
                prop_assert!((0..3).all(|a| meets(a, steps[a]) && steps[a].abs() <= most[a]));
            }
        }
    }
}
