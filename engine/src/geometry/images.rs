//! The periodic images of a grain that meet the box.
//!
//! A periodic box with the edges `L` repeats every grain at `c + k L`, with three integers `k`. An image meets the box
//! `0 < x < L` if its own bounding box, `c + k L ± h`, has points in common with it. A grain may be longer than an edge:
//! then more than three of its images along this axis meet the box.

use nalgebra::Vector3;

use crate::request::Specimen;

/// The images of grains in a specimen; walls leave the grain itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Images {
    bounds_mm: [f64; 3],
    is_periodic: bool,
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
    pub(crate) fn new(specimen: &Specimen) -> Self {
        Self { bounds_mm: specimen.bounds_mm(), is_periodic: specimen.is_periodic() }
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
        .map(move |steps| Image {
            steps,
            offset_mm: Vector3::from_fn(|a, _| f64::from(steps[a]) * bounds[a]),
        })
    }

    /// The steps along one axis after which the interval `center_mm ± half_mm` has a point in common with the inside of
    /// the box.
    pub(crate) fn steps(
        &self,
        axis: usize,
        center_mm: f64,
        half_mm: f64,
    ) -> impl Iterator<Item = i32> + Clone + use<> {
        let length = self.bounds_mm[axis];
        let is_periodic = self.is_periodic;
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

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;
    use crate::request::Boundary;

    fn periodic(size_mm: [f64; 3]) -> Images {
        Images::new(&Specimen::Box { size_mm, boundary: Boundary::Periodic })
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
        let images = Images::new(&Specimen::Box { size_mm, boundary: Boundary::Walls });
        let found: Vec<_> = images.meeting_box([0.5, 5.0, 9.9], [1.0; 3]).collect();
        assert_eq!(found, [Image { steps: [0; 3], offset_mm: Vector3::zeros() }]);
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
        }
    }
}
