//! Grains and their periodic images by one number of 32 bits, as lists of neighbours name them.
//!
//! The upper bits name the image, by its steps along the axes; as many as the images need that grains of these lengths
//! can have near one another. The lower bits name the grain. Where grains are shorter than the edges of the box, 2 to 3
//! steps along each axis and 6 or 7 bits suffice; a grain of ten edges has hundreds of images.

// Names are read in the loops over pairs, which are compiled for several instruction sets.
#![allow(clippy::inline_always)]

use crate::gap::linear::Vector;
use crate::geometry::images::Images;
use crate::memory::{OutOfMemory, collected};

/// The images that pairs of grains need, and the names of grains with their images.
#[derive(Clone, Debug)]
pub(crate) struct ImageNames {
    /// Largest number of steps along each axis.
    most_steps: [i32; 3],
    /// Offsets by the code of the image, in mm.
    offsets_mm: Vec<Vector>,
    /// Bits that name the grain.
    grain_bits: u32,
    grain_mask: u32,
}

impl ImageNames {
    /// Names for all images in which grains with their centres in the box can be less than `reach_mm` from a point of
    /// it.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn new(images: &Images, reach_mm: f64) -> Result<Self, OutOfMemory> {
        let most_steps = images.most_steps(reach_mm);
        let count = images_within(most_steps);
        let count = u32::try_from(count).map_err(|_| OutOfMemory { bytes: count })?;
        let grain_bits = grain_bits(count.into());
        let mut names =
            Self { most_steps, offsets_mm: Vec::new(), grain_bits, grain_mask: (1 << grain_bits) - 1 };
        names.offsets_mm = collected((0..count as usize).map(|code| {
            let steps = names.steps(code as u32);
            images.offset_mm(steps).into()
        }))?;
        Ok(names)
    }

    /// Number of grains that can be named.
    pub(crate) fn grains(&self) -> u64 {
        1 << self.grain_bits
    }

    /// Most grains that can be named beside the images within a reach.
    pub(crate) fn most_grains(images: &Images, reach_mm: f64) -> u64 {
        1 << grain_bits(images_within(images.most_steps(reach_mm)))
    }

    fn edges(&self) -> [u32; 3] {
        self.most_steps.map(|most| 2 * most as u32 + 1)
    }

    fn steps(&self, code: u32) -> [i32; 3] {
        let [_, y, z] = self.edges();
        let at = [code / (y * z), code / z % y, code % z];
        [0, 1, 2].map(|a: usize| at[a] as i32 - self.most_steps[a])
    }

    /// The code of the image at these steps, which must not be more than the reach needs.
    #[inline(always)]
    pub(crate) fn code(&self, steps: [i32; 3]) -> u32 {
        let [_, y, z] = self.edges();
        let at = |a: usize| {
            debug_assert!(steps[a].abs() <= self.most_steps[a]);
            (steps[a] + self.most_steps[a]) as u32
        };
        (at(0) * y + at(1)) * z + at(2)
    }

    /// The code of the opposite image.
    #[inline(always)]
    pub(crate) fn opposite(&self, code: u32) -> u32 {
        self.offsets_mm.len() as u32 - 1 - code
    }

    /// What to add to a centre, in mm.
    #[inline(always)]
    pub(crate) fn offset_mm(&self, code: u32) -> Vector {
        self.offsets_mm[code as usize]
    }

    /// The name of a grain with an image.
    #[inline(always)]
    pub(crate) fn name(&self, grain: usize, code: u32) -> u32 {
        grain as u32 | code << self.grain_bits
    }

    /// The grain and the code of the image of a name.
    #[inline(always)]
    pub(crate) fn read(&self, name: u32) -> (usize, u32) {
        ((name & self.grain_mask) as usize, name >> self.grain_bits)
    }
}

/// Number of the images with no more steps than these.
fn images_within(most_steps: [i32; 3]) -> u64 {
    most_steps.into_iter().map(|most| 2 * u64::from(most.unsigned_abs()) + 1).product()
}

/// Bits that are left for the grain. No image has all of the upper bits: such names are free for other things.
fn grain_bits(images: u64) -> u32 {
    u32::BITS.saturating_sub(u64::BITS - images.leading_zeros())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::request::{Boundary, Specimen};

    fn boxed(size_mm: [f64; 3], boundary: Boundary) -> Images {
        Images::new(&Specimen::cuboid(size_mm, boundary))
    }

    #[test]
    fn names_read_back_and_opposite_images_have_opposite_offsets() {
        let images = boxed([3.0, 10.0, 20.0], Boundary::Periodic);
        let names = ImageNames::new(&images, 13.0).unwrap();
        // |k| < 1 + 13 / L.
        assert_eq!(names.most_steps, [5, 2, 1]);
        assert_eq!(names.offsets_mm.len(), 11 * 5 * 3);
        assert_eq!(ImageNames::most_grains(&images, 13.0), 1 << 24);
        for x in -5..=5 {
            for (y, z) in [(-2, 1), (0, 0), (2, -1)] {
                let code = names.code([x, y, z]);
                assert_eq!(names.steps(code), [x, y, z]);
                let offset = [x, y, z].map(f64::from);
                assert_eq!(names.offset_mm(code), [3.0 * offset[0], 10.0 * offset[1], 20.0 * offset[2]]);
                assert_eq!(names.opposite(code), names.code([-x, -y, -z]));
                assert_eq!(names.read(names.name((1 << 24) - 1, code)), ((1 << 24) - 1, code));
            }
        }
    }

    #[test]
    fn walls_leave_one_image_and_no_name_has_all_upper_bits() {
        let names = ImageNames::new(&boxed([3.0; 3], Boundary::Walls), 13.0).unwrap();
        assert_eq!((names.offsets_mm.len(), names.grain_bits), (1, 31));
        assert_eq!([1, 2, 3, 4, 127, 128].map(grain_bits), [31, 30, 30, 29, 25, 24]);
    }
}
