//! Against brute force on small sets, and on the degenerate sets that specimens are made of.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use crate::properties::properties;
use proptest::prelude::*;
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::control::Unattended;
use crate::rng::uniform;

type Point = [f64; 3];

fn volume(points: &[Point], nodes: [u32; 4]) -> f64 {
    let [a, b, c, d] = nodes.map(|node| points[node as usize]);
    let [u, v, w] = [b, c, d].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
        + u[2] * (v[0] * w[1] - v[1] * w[0]))
        / 6.0
}

fn total_volume(points: &[Point], made: &Delaunay) -> f64 {
    made.nodes.iter().map(|&nodes| volume(points, nodes)).sum()
}

/// All that must hold of any result: form, orientation, neighbours, the hull convex, the empty spheres of neighbours
/// (which implies all others, by Delaunay's lemma), Euler's number.
fn check_all(points: &[Point], made: &Delaunay) {
    let Delaunay { nodes, neighbors } = made;
    assert_eq!(nodes.len(), neighbors.len());
    assert!(nodes.windows(2).all(|pair| pair[0] < pair[1]), "sorted, none twice");
    let at = |node: u32| points[node as usize];
    for (t, (four, across)) in (0_u32..).zip(nodes.iter().zip(neighbors)) {
        let [a, b, c, d] = *four;
        assert!(a < b && b < c.min(d) && c != d, "{four:?}");
        assert!(orientation(at(a), at(b), at(c), at(d)).is_gt(), "{four:?}");
        for k in 0..4 {
            let face = FACES[k].map(|i| four[i]);
            let Some(other) = nodes.get(across[k] as usize) else {
                assert_eq!(across[k], NONE);
                continue;
            };
            let back = (0..4).find(|&i| !face.contains(&other[i])).unwrap();
            assert!(face.iter().all(|node| other.contains(node)), "{four:?} {other:?}");
            assert_eq!(neighbors[across[k] as usize][back], t);
            assert!(inside_circumsphere(four.map(at), at(other[back])).is_le(), "{four:?} {other:?}");
        }
    }
    let hull = made.hull_triangles();
    // Each directed edge once, its reverse once: a closed surface; convex across each edge.
    let mut directed = std::collections::BTreeMap::new();
    for &[a, b, c] in &hull {
        for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert_eq!(directed.insert((from, to), opposite), None);
        }
    }
    for (&(from, to), &opposite) in &directed {
        let across = directed[&(to, from)];
        assert!(orientation(at(from), at(to), at(opposite), at(across)).is_le(), "the hull has a dent");
    }
    let on_hull: BTreeSet<u32> = hull.iter().flatten().copied().collect();
    assert_eq!(hull.len() + 4, 2 * on_hull.len(), "the hull is a sphere");
    let used: BTreeSet<u32> = nodes.iter().flatten().copied().collect();
    assert_eq!(used.len(), points.len(), "every point is a node");
    let (v, e) = (points.len() as i64, made.edges().len() as i64);
    assert_eq!(v - e + made.faces().count() as i64 - nodes.len() as i64, 1, "Euler");
}

/// No point inside any sphere, by all pairs.
fn check_by_brute_force(points: &[Point], made: &Delaunay) {
    for four in &made.nodes {
        let corners = four.map(|node| points[node as usize]);
        assert!(points.iter().all(|&p| inside_circumsphere(corners, p).is_le()), "{four:?}");
    }
}

fn made(points: &[Point]) -> Delaunay {
    let made = delaunay(points, &Unattended).unwrap();
    check_all(points, &made);
    made
}

/// Tetrahedra as sets of points, whatever the points' numbers.
fn by_coordinates(points: &[Point], made: &Delaunay) -> BTreeSet<Vec<[u64; 3]>> {
    made.nodes
        .iter()
        .map(|four| {
            let mut corners: Vec<_> = four.iter().map(|&n| points[n as usize].map(f64::to_bits)).collect();
            corners.sort_unstable();
            corners
        })
        .collect()
}

fn random(count: usize, seed: u64) -> Vec<Point> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    (0..count).map(|_| [0; 3].map(|_| uniform(&mut rng))).collect()
}

fn lattice(n: [usize; 3], spacing: f64) -> Vec<Point> {
    let [nx, ny, nz] = n;
    (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny].map(|i| i as f64 * spacing)).collect()
}

fn without_duplicates(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a.partial_cmp(b).unwrap());
    points.dedup();
    points
}

#[test]
fn one_tetrahedron() {
    let points = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]];
    let made = made(&points);
    assert_eq!(made.nodes.len(), 1);
    assert_eq!(made.neighbors, [[NONE; 4]]);
    assert_eq!(made.hull_triangles(), [[0, 1, 3], [0, 2, 1], [0, 3, 2], [1, 2, 3]]);
}

#[test]
fn a_cube_is_cut_into_no_flat_tetrahedra() {
    let points = lattice([2, 2, 2], 1.0);
    let made = made(&points);
    assert!(made.nodes.len() == 5 || made.nodes.len() == 6, "{}", made.nodes.len());
    assert!((total_volume(&points, &made) - 1.0).abs() < 1e-15);
    assert_eq!(made.hull_triangles().len(), 12);
}

#[test]
fn a_lattice_of_twenty() {
    for spacing in [1.0, 0.1, 1.0 / 3.0] {
        let points = lattice([20, 20, 20], spacing);
        let made = made(&points);
        let side = 19.0 * spacing;
        assert!((total_volume(&points, &made) / side.powi(3) - 1.0).abs() < 1e-12);
        assert_eq!(made.hull_triangles().len(), 6 * 19 * 19 * 2);
    }
}

#[test]
fn a_sphere_and_its_centre() {
    let mut points: Vec<Point> = random(5000, 1)
        .iter()
        .map(|&[u, v, _]| {
            let (z, angle) = (2.0 * u - 1.0, std::f64::consts::TAU * v);
            let r = (1.0 - z * z).sqrt();
            [50.0 * r * angle.cos(), 50.0 * r * angle.sin(), 50.0 * z]
        })
        .collect();
    let shell = made(&points);
    points.push([0.0; 3]);
    let with_centre = made(&points);
    // All spheres hold the centre, so all tetrahedra are replaced by those from it to the hull.
    assert_eq!(with_centre.hull_triangles(), shell.hull_triangles());
    assert_eq!(with_centre.nodes.len(), with_centre.hull_triangles().len());
}

#[test]
fn a_cylinder() {
    let (around, rings, radius, height) = (64, 33, 50.0, 200.0);
    let mut points = Vec::new();
    for ring in 0..rings {
        for step in 0..around {
            let angle = std::f64::consts::TAU * f64::from(step) / f64::from(around);
            points.push([
                radius * angle.cos(),
                radius * angle.sin(),
                height * f64::from(ring) / f64::from(rings - 1),
            ]);
        }
    }
    // Caps are full of coplanar points.
    for z in [0.0, height] {
        for [x, y, _] in lattice([13, 13, 1], 5.0) {
            points.push([x - 30.0, y - 30.0, z]);
        }
    }
    points.extend(random(2000, 2).iter().map(|p| [p[0] * 60.0 - 30.0, p[1] * 60.0 - 30.0, p[2] * height]));
    let made = made(&points);
    let polygon =
        0.5 * f64::from(around) * radius * radius * (std::f64::consts::TAU / f64::from(around)).sin();
    assert!((total_volume(&points, &made) / (polygon * height) - 1.0).abs() < 1e-12);
}

/// Points in a box, some on its faces and edges, and all its corners.
fn in_a_box(count: usize, seed: u64) -> (Vec<Point>, f64) {
    let size = [100.0, 150.0, 70.3];
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut points = lattice([2, 2, 2], 1.0);
    while points.len() < count {
        let mut p = [0; 3].map(|_| uniform(&mut rng));
        for x in &mut p {
            let side = uniform(&mut rng);
            if side < 0.1 {
                *x = if side < 0.05 { 0.0 } else { 1.0 };
            }
        }
        if !p.iter().all(|&x| x == 0.0 || x == 1.0) {
            points.push(p);
        }
    }
    for p in &mut points {
        *p = [0, 1, 2].map(|axis| p[axis] * size[axis]);
    }
    (points, size.iter().product())
}

#[test]
fn the_hull_of_a_boxs_nodes_is_the_box() {
    let (points, volume) = in_a_box(20_000, 3);
    let made = made(&points);
    assert!((total_volume(&points, &made) / volume - 1.0).abs() < 1e-12);
    for triangle in made.hull_triangles() {
        let [a, b, c] = triangle.map(|node| points[node as usize]);
        assert!((0..3).any(|axis| a[axis] == b[axis] && b[axis] == c[axis]), "{triangle:?} lies in no face");
    }
}

#[test]
fn the_numbers_of_the_points_change_nothing_but_names() {
    let (in_box, _) = in_a_box(3000, 4);
    for points in [in_box, lattice([9, 8, 7], 0.1), random(3000, 5)] {
        let expected = by_coordinates(&points, &made(&points));
        let mut shuffled = points.clone();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(6);
        for i in (1..shuffled.len()).rev() {
            shuffled.swap(i, (uniform(&mut rng) * (i + 1) as f64) as usize);
        }
        assert_eq!(by_coordinates(&shuffled, &made(&shuffled)), expected);
    }
}

#[test]
fn edges_are_found_and_surrounded() {
    let (points, _) = in_a_box(2000, 7);
    let made = made(&points);
    let edges = made.edges();
    let mut expected = BTreeSet::new();
    let mut around = std::collections::BTreeMap::<[u32; 2], BTreeSet<u32>>::new();
    for (t, four) in (0_u32..).zip(&made.nodes) {
        for [i, j] in topology::EDGES {
            let edge = [four[i].min(four[j]), four[i].max(four[j])];
            expected.insert(edge);
            around.entry(edge).or_default().insert(t);
        }
    }
    assert!(expected.iter().eq(&edges.nodes));
    for at_once in [0, 100, 5000] {
        assert_eq!(made.edges_by(at_once), edges);
    }
    let mut outside = BTreeSet::new();
    for [a, b, c] in made.hull_triangles() {
        outside.extend([[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]));
    }
    let mut ring = Vec::new();
    for (number, &[a, b]) in (0_u32..).zip(&edges.nodes) {
        assert_eq!(edges.find(a, b), Some(number));
        assert_eq!(edges.find(b, a), Some(number));
        let all = &around[&[a, b]];
        let closed = made.ring(*all.last().unwrap(), [b, a], &mut ring);
        assert_eq!(ring.iter().copied().collect::<BTreeSet<_>>(), *all);
        assert_eq!(ring.len(), all.len());
        assert_eq!(closed, !outside.contains(&[a, b]));
        assert!(ring.windows(2).all(|pair| made.neighbors[pair[0] as usize].contains(&pair[1])));
    }
    assert_eq!(edges.find(0, 0), None);
    assert_eq!(edges.find(0, u32::MAX), None);
    assert!(!made.ring(0, [u32::MAX, 0], &mut ring) && ring.is_empty());
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |points: &[Point]| delaunay(points, &Unattended).unwrap_err();
    assert_eq!(refused(&random(3, 1)), DelaunayError::TooFew { points: 3 });
    assert_eq!(refused(&lattice([30, 30, 1], 0.1)), DelaunayError::Coplanar);
    assert_eq!(refused(&lattice([30, 1, 1], 0.1)), DelaunayError::Coplanar);
    assert_eq!(refused(&[[1.0; 3]; 4]), DelaunayError::Duplicate { first: 0, second: 1 });
    for value in [f64::NAN, f64::INFINITY, 1e36, -1e-36] {
        let mut points = random(10, 1);
        points[7][1] = value;
        assert_eq!(refused(&points), DelaunayError::Coordinate { point: 7 });
    }
    for (first, second) in [(0, 1), (3, 999), (500, 501)] {
        let mut points = random(1000, 1);
        points[second as usize] = points[first as usize];
        assert_eq!(refused(&points), DelaunayError::Duplicate { first, second });
    }
    // Zeros of both signs are one.
    let mut points = lattice([3, 3, 3], 1.0);
    points.push([-0.0, 1.0, -0.0]);
    assert_eq!(refused(&points), DelaunayError::Duplicate { first: 3, second: 27 });
}

#[test]
fn it_stops_and_tells_how_far_it_is() {
    struct Watch(std::sync::Mutex<Vec<f64>>, usize);
    impl Control for Watch {
        fn report(&self, progress: &Progress) {
            assert_eq!(progress.step, Step::Export);
            self.0.lock().unwrap().push(progress.fraction);
        }
        fn should_stop(&self) -> bool {
            self.0.lock().unwrap().len() >= self.1
        }
    }
    let points = random(20_000, 1);
    let watch = Watch(Vec::new().into(), usize::MAX);
    assert!(delaunay(&points, &watch).is_ok());
    let told = watch.0.into_inner().unwrap();
    assert!(
        told.len() > 10 && told.windows(2).all(|pair| pair[0] <= pair[1]) && *told.last().unwrap() == 1.0
    );
    let watch = Watch(Vec::new().into(), 5);
    assert_eq!(delaunay(&points, &watch), Err(DelaunayError::Stopped));
    assert_eq!(watch.0.lock().unwrap().len(), 5);
}

/// Two lines make a tetrahedron of every pair of their segments.
#[test]
fn two_skew_lines() {
    let n = 60;
    let mut points: Vec<Point> = (0..n).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    points.extend((0..n).map(|i| [0.0, f64::from(i), 10.0]));
    let made = made(&points);
    assert_eq!(made.nodes.len(), (n as usize - 1).pow(2));
}

/// Coordinates that differ in the last bits only, where adaptive arithmetic has to go all the way.
#[test]
fn points_that_nearly_lie_on_a_lattice() {
    for seed in 0..4 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut points = lattice([5, 5, 5], 0.7);
        for x in points.iter_mut().flatten() {
            *x += 0.1;
            if uniform(&mut rng) < 0.3 {
                *x = x.next_up();
            }
        }
        let made = made(&points);
        check_by_brute_force(&points, &made);
    }
}

/// Coordinates of exact predicates in integers.
fn exact_orientation(p: [[i128; 3]; 4]) -> std::cmp::Ordering {
    let [u, v, w] = [1, 2, 3].map(|i| [0, 1, 2].map(|axis| p[i][axis] - p[0][axis]));
    let det = u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
        + u[2] * (v[0] * w[1] - v[1] * w[0]);
    det.cmp(&0)
}

fn exact_insphere(p: [[i128; 3]; 4], q: [i128; 3]) -> std::cmp::Ordering {
    let rows = p.map(|p| [0, 1, 2].map(|axis| p[axis] - q[axis]));
    let mut det = 0;
    for i in 0..4 {
        let [u, v, w] = FACES[i].map(|k| rows[k]);
        let lift: i128 = rows[i].iter().map(|x| x * x).sum();
        det += lift
            * (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
                + u[2] * (v[0] * w[1] - v[1] * w[0]));
    }
    det.cmp(&0)
}

properties! {
    #[test]
    fn predicates_are_exact(p in prop::array::uniform5(prop::array::uniform3(-3_i128..=3)), scale in 0_u32..20) {
        // Times 2^-scale and shifted by a thousand: exact, and far from the origin.
        let float = p.map(|p| p.map(|x| 1000.0 + x as f64 / f64::from(1_u32 << scale)));
        let [a, b, c, d, q] = float;
        let [ia, ib, ic, id, iq] = p;
        let expected = exact_orientation([ia, ib, ic, id]);
        prop_assert_eq!(orientation(a, b, c, d), expected);
        if expected.is_gt() {
            prop_assert_eq!(inside_circumsphere([a, b, c, d], q), exact_insphere([ia, ib, ic, id], iq));
        }
    }

    #[test]
    fn small_lattices(points in prop::collection::vec(prop::array::uniform3(0_i32..4), 4..40), scale in prop::sample::select(vec![1.0, 0.1, 1e-9, 3e7])) {
        let points = without_duplicates(points.iter().map(|p| p.map(|x| f64::from(x) * scale)).collect());
        check_small(&points)?;
    }

    #[test]
    fn on_the_faces_of_a_box(points in prop::collection::vec((prop::array::uniform3(0.0_f64..1.0), 0_usize..9), 4..60)) {
        let points = points.into_iter().map(|(mut p, place)| {
            if place < 6 { p[place % 3] = (place / 3) as f64; }
            if place == 0 { p[1] = 1.0; }
            p
        }).collect();
        check_small(&without_duplicates(points))?;
    }

    #[test]
    fn on_spheres(points in prop::collection::vec((prop::sample::select(vec![[0, 0, 9], [1, 4, 8], [4, 4, 7], [3, 6, 6]]), 0_usize..6, 0_u32..8), 4..60), centre in any::<bool>()) {
        // All of these are 9 from the origin, exactly.
        let mut points: Vec<Point> = points.into_iter().map(|(of, turn, signs)| {
            let order = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]][turn];
            [0, 1, 2].map(|axis| if signs >> axis & 1 == 1 { -f64::from(of[order[axis]]) } else { f64::from(of[order[axis]]) })
        }).collect();
        if centre { points.push([0.0; 3]); }
        check_small(&without_duplicates(points.into_iter().map(|p| p.map(|x| x + 0.0)).collect()))?;
    }

    #[test]
    fn with_points_on_lines(lines in prop::collection::vec((prop::array::uniform3(-4_i32..5), prop::array::uniform3(-2_i32..3), 1_i32..12), 1..6)) {
        let points = lines.iter().flat_map(|&(at, step, count)| {
            (0..count).map(move |i| [0, 1, 2].map(|axis| f64::from(at[axis] + i * step[axis]) * 0.1))
        }).collect();
        check_small(&without_duplicates(points))?;
    }

    #[test]
    fn anywhere(points in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4..60)) {
        check_small(&without_duplicates(points))?;
    }
}

fn check_small(points: &[Point]) -> Result<(), TestCaseError> {
    match delaunay(points, &Unattended) {
        Ok(made) => {
            check_all(points, &made);
            check_by_brute_force(points, &made);
            let reversed: Vec<Point> = points.iter().rev().copied().collect();
            let again = delaunay(&reversed, &Unattended).unwrap();
            prop_assert_eq!(by_coordinates(&reversed, &again), by_coordinates(points, &made));
        }
        Err(DelaunayError::TooFew { points: count }) => prop_assert_eq!(count, points.len()),
        Err(DelaunayError::Coplanar) => {
            // Then any three not on a line span the plane of all.
            for q in points.windows(4) {
                prop_assert!(orientation(q[0], q[1], q[2], q[3]).is_eq());
            }
        }
        Err(other) => prop_assert!(false, "{other}"),
    }
    Ok(())
}
