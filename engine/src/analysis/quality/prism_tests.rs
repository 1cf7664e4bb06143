use crate::properties::properties;
use proptest::prelude::*;

use super::*;

fn cuboid(low: [f64; 3], high: [f64; 3]) -> Prism {
    Prism {
        section: Section::Rectangle { low: [low[0], low[1]], high: [high[0], high[1]] },
        low: low[2],
        high: high[2],
    }
}

#[test]
fn known_parts_of_a_sphere() {
    let all = 4.0 / 3.0 * PI;
    let far = 9.0;
    for (prism, share) in [
        (cuboid([-far; 3], [far; 3]), 1.0),
        (cuboid([0.0, -far, -far], [far; 3]), 0.5),
        (cuboid([0.0, 0.0, -far], [far; 3]), 0.25),
        (cuboid([0.0; 3], [far; 3]), 0.125),
        (cuboid([0.5, -far, -far], [far; 3]), 5.0 / 32.0),
        (cuboid([-far, -far, 0.5], [far; 3]), 5.0 / 32.0),
        (cuboid([1.5, -far, -far], [far; 3]), 0.0),
        // The cube within the sphere.
        (cuboid([-0.5; 3], [0.5; 3]), 1.0 / all),
    ] {
        let found = prism.common_volume([0.0; 3], 1.0) / all;
        assert!((found - share).abs() < 1e-4, "{prism:?}: {found} {share}");
    }
    // A hole drilled along the axis leaves a ring whose volume depends on its height alone.
    let radius = 0.6;
    let drill = Prism { section: Section::Disc { center: [0.0; 2], radius }, low: -far, high: far };
    let ring = 4.0 / 3.0 * PI * (1.0 - radius * radius).powf(1.5);
    assert!((drill.common_volume([0.0; 3], 1.0) - (all - ring)).abs() < 1e-3 * all);
    // A wide lateral surface is nearly a plane.
    let wide =
        Prism { section: Section::Disc { center: [1000.0, 0.0], radius: 1000.5 }, low: -far, high: far };
    assert!((wide.common_volume([0.0; 3], 1.0) / all - 27.0 / 32.0).abs() < 1e-3);
}

properties! {
    /// Eight cuboids around a point share a sphere without a rest.
    #[test]
    fn parts_add_up(
        center in prop::array::uniform3(-1.0..1.0_f64),
        corner in prop::array::uniform3(-1.0..1.0_f64),
        r in 0.1..2.0_f64,
    ) {
        let sum: f64 = (0..8)
            .map(|octant| {
                let bound = |a: usize, is_low: bool| {
                    let is_upper = octant >> a & 1 == 1;
                    if is_low == is_upper { corner[a] } else if is_low { -9.0 } else { 9.0 }
                };
                let low = std::array::from_fn(|a| bound(a, true));
                let high = std::array::from_fn(|a| bound(a, false));
                cuboid(low, high).common_volume(center, r)
            })
            .sum();
        let all = sphere_volume(2.0 * r);
        prop_assert!((sum - all).abs() < 1e-3 * all, "{} of {}", sum, all);
    }
}
