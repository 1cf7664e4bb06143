//! Insertion of points, one after the other, into tetrahedra that fill all of space.
//!
//! Beyond each face of the hull stands a *ghost*: a tetrahedron whose fourth node is at infinity. A new point
//! takes out all tetrahedra whose circumsphere holds it (its *cavity*) and is joined to each face of what is left.
//! Why this can't fail for exact answers of the predicates is in `docs/delaunay.md`.

use super::predicates::{self, Bounds};
use super::{DelaunayError, FACES};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::memory::{self, OutOfMemory, collected, filled, reserved};

/// The node at infinity; always the last of its tetrahedron.
pub(super) const GHOST: u32 = u32::MAX;
/// Links hold a slot and one of four faces in 32 bits.
pub(super) const MOST_SLOTS: u32 = 1 << 30;
/// Points between two looks at the control: some milliseconds.
const STRIDE: usize = 1024;
/// Share of the whole time; canonical order takes the rest.
pub(super) const SHARE: f64 = 0.7;
/// Slots of tetrahedra a point, with some to spare: in space 6.8 and few ghosts.
const SLOTS_PER_POINT: usize = 7;
/// Slots that the points between two looks take, with some to spare.
const SLOTS_PER_STRIDE: usize = 16 * STRIDE;
/// Cavities with no more nodes than this are joined by a table of pairs of nodes.
const MOST_IN_TABLE: usize = 256;

/// What is known of a tetrahedron while a cavity is looked for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    Unknown,
    InCavity,
    Outside,
}

/// A face of the cavity.
struct Face {
    /// Counter-clockwise seen from outside the cavity's tetrahedron it belongs to; a ghost last.
    nodes: [u32; 3],
    /// Link to the tetrahedron that stays.
    outer: u32,
}

/// What insertion ends with: ghosts and free slots included.
pub(super) struct Raw {
    /// Original numbers of the points, by the order of insertion, which `nodes` speaks of.
    pub(super) numbers: Vec<u32>,
    pub(super) nodes: Vec<[u32; 4]>,
    pub(super) links: Vec<[u32; 4]>,
    /// Slots in use, all others marked as ghosts.
    pub(super) finite: usize,
}

struct Builder {
    /// In the order of insertion.
    points: Vec<[f64; 3]>,
    bounds: Bounds,
    nodes: Vec<[u32; 4]>,
    /// Slot across each face, times four, and which face it is there.
    links: Vec<[u32; 4]>,
    marks: Vec<Mark>,
    free: Vec<u32>,
    /// A finite tetrahedron near the last point.
    last: u32,
    cavity: Vec<u32>,
    faces: Vec<Face>,
    joints: Joints,
}

/// Inserts all points in the order given.
pub(super) fn build(
    points_mm: &[[f64; 3]],
    mut order: Vec<u32>,
    control: &dyn Control,
) -> Result<Raw, DelaunayError> {
    lead_with_a_tetrahedron(points_mm, &mut order)?;
    let points = collected(order.iter().map(|&number| points_mm[number as usize]))?;
    let mut builder = Builder::new(points)?;
    let total = builder.points.len();
    for next in 4..total {
        if next % STRIDE == 0 {
            super::go_on(control)?;
            super::report(control, SHARE * next as f64 / total as f64, next, total);
            builder.make_room()?;
        }
        builder.insert(next as u32).map_err(|refused| match refused {
            Refused::Same(other) => {
                let (a, b) = (order[next], order[other as usize]);
                DelaunayError::Duplicate { first: a.min(b), second: a.max(b) }
            }
            Refused::TooMany => DelaunayError::TooMany,
        })?;
    }
    let mut nodes = builder.nodes;
    for &slot in &builder.free {
        nodes[slot as usize][3] = GHOST;
    }
    let finite = nodes.iter().filter(|nodes| nodes[3] != GHOST).count();
    Ok(Raw { numbers: order, nodes, links: builder.links, finite })
}

/// Moves the first four points to the front that are no two the same, not on one line, not in one plane.
fn lead_with_a_tetrahedron(points: &[[f64; 3]], order: &mut [u32]) -> Result<(), DelaunayError> {
    let at = |order: &[u32], place: usize| points[order[place] as usize];
    let (a, b) = (at(order, 0), at(order, 1));
    if a == b {
        let (first, second) = (order[0].min(order[1]), order[0].max(order[1]));
        return Err(DelaunayError::Duplicate { first, second });
    }
    let third = (2..order.len())
        .find(|&place| !predicates::collinear(a, b, at(order, place)))
        .ok_or(DelaunayError::Coplanar)?;
    order[2..=third].rotate_right(1);
    let c = at(order, 2);
    let fourth = (3..order.len())
        .find(|&place| predicates::orientation(a, b, c, at(order, place)).is_ne())
        .ok_or(DelaunayError::Coplanar)?;
    order[3..=fourth].rotate_right(1);
    if predicates::orientation(a, b, c, at(order, 3)).is_lt() {
        order.swap(0, 1);
    }
    Ok(())
}

/// Why a point was not inserted.
enum Refused {
    /// It is where this one is.
    Same(u32),
    /// No slots are left.
    TooMany,
}

impl Builder {
    /// The first four points, which are positively oriented, and four ghosts around them.
    fn new(points: Vec<[f64; 3]>) -> Result<Self, OutOfMemory> {
        let slots = points.len() * SLOTS_PER_POINT + SLOTS_PER_STRIDE;
        let mut nodes = reserved(slots)?;
        let mut links = reserved(slots)?;
        nodes.push([0, 1, 2, 3]);
        links.push([1, 2, 3, 4].each(|ghost| ghost * 4 + 3));
        for face in FACES {
            // Counter-clockwise seen from outside: positive with a point out there.
            nodes.push([face[0] as u32, face[1] as u32, face[2] as u32, GHOST]);
        }
        for (k, face) in FACES.iter().enumerate() {
            let mut link = [0, 0, 0, k as u32];
            for (own, &opposite) in link.iter_mut().zip(face) {
                // Across the edge from `opposite` is the ghost of the face opposite it, and there the edge is
                // opposite node `k`.
                let there = FACES[opposite].iter().position(|&node| node == k).unwrap_or_default();
                *own = (1 + opposite as u32) * 4 + there as u32;
            }
            links.push(link);
        }
        let mut marks = reserved(slots)?;
        marks.resize(nodes.len(), Mark::Unknown);
        Ok(Builder {
            bounds: Bounds::of(&points),
            joints: Joints::new(points.len())?,
            points,
            nodes,
            links,
            marks,
            free: Vec::new(),
            last: 0,
            cavity: Vec::new(),
            faces: Vec::new(),
        })
    }

    /// Room for the tetrahedra of the points to come before the next look at the control.
    fn make_room(&mut self) -> Result<(), OutOfMemory> {
        memory::make_room(&mut self.nodes, SLOTS_PER_STRIDE)?;
        memory::make_room(&mut self.links, SLOTS_PER_STRIDE)?;
        memory::make_room(&mut self.marks, SLOTS_PER_STRIDE)
    }

    fn insert(&mut self, new: u32) -> Result<(), Refused> {
        let p = self.points[new as usize];
        let start = self.locate(p);
        let nodes = self.nodes[start as usize];
        if nodes[3] != GHOST
            && let Some(&same) = nodes.iter().find(|&&node| self.points[node as usize] == p)
        {
            return Err(Refused::Same(same));
        }
        self.find_cavity(start, p);
        self.fill_cavity(new)
    }

    /// The tetrahedron that holds `p`, or a ghost beyond whose face it is. Each step crosses a face with `p` on its
    /// other side, which in a Delaunay tetrahedralisation leads round no circle.
    fn locate(&self, p: [f64; 3]) -> u32 {
        let mut slot = self.last;
        let mut from = 4;
        loop {
            let nodes = self.nodes[slot as usize];
            if nodes[3] == GHOST {
                return slot;
            }
            let corners = nodes.each(|node| self.points[node as usize]);
            let beyond = (0..4).find(|&k| {
                let [a, b, c] = FACES[k].each(|i| corners[i]);
                k != from && self.bounds.orientation(p, a, b, c).is_lt()
            });
            let Some(k) = beyond else { return slot };
            let link = self.links[slot as usize][k];
            slot = link >> 2;
            from = (link & 3) as usize;
        }
    }

    /// Whether the circumsphere holds `p`. That of a ghost is the open half-space beyond its face, and of the
    /// face's plane what the sphere of the tetrahedron on the other side holds.
    #[inline]
    fn in_conflict(&self, slot: u32, p: [f64; 3]) -> bool {
        let nodes = self.nodes[slot as usize];
        if nodes[3] == GHOST {
            return self.ghost_in_conflict(slot, p);
        }
        self.bounds.in_conflict(nodes.each(|node| self.points[node as usize]), p)
    }

    #[inline(never)]
    fn ghost_in_conflict(&self, slot: u32, p: [f64; 3]) -> bool {
        let [a, b, c, _] = self.nodes[slot as usize];
        let [a, b, c] = [a, b, c].each(|node| self.points[node as usize]);
        match self.bounds.orientation(a, b, c, p) {
            std::cmp::Ordering::Greater => true,
            std::cmp::Ordering::Less => false,
            std::cmp::Ordering::Equal => self.in_conflict(self.links[slot as usize][3] >> 2, p),
        }
    }

    /// Everything in conflict with `p`, from one that is: it is connected.
    fn find_cavity(&mut self, start: u32, p: [f64; 3]) {
        self.cavity.clear();
        self.faces.clear();
        self.cavity.push(start);
        self.marks[start as usize] = Mark::InCavity;
        let mut looked_at = 0;
        while let Some(&slot) = self.cavity.get(looked_at) {
            looked_at += 1;
            let nodes = self.nodes[slot as usize];
            let links = self.links[slot as usize];
            for k in 0..4 {
                let outer = links[k];
                let neighbor = outer >> 2;
                let mut mark = self.marks[neighbor as usize];
                if mark == Mark::Unknown {
                    mark = if self.in_conflict(neighbor, p) {
                        self.cavity.push(neighbor);
                        Mark::InCavity
                    } else {
                        Mark::Outside
                    };
                    self.marks[neighbor as usize] = mark;
                }
                if mark == Mark::Outside {
                    let [a, b, c] = FACES[k].each(|i| nodes[i]);
                    let nodes = if a == GHOST {
                        [b, c, a]
                    } else if b == GHOST {
                        [c, a, b]
                    } else {
                        [a, b, c]
                    };
                    self.faces.push(Face { nodes, outer });
                }
            }
        }
    }

    /// Replaces the cavity by tetrahedra from the new point to its faces, in the slots of those that go.
    fn fill_cavity(&mut self, new: u32) -> Result<(), Refused> {
        let surplus = self.cavity.len().saturating_sub(self.faces.len());
        for slot in self.cavity.drain(self.cavity.len() - surplus..) {
            self.marks[slot as usize] = Mark::Unknown;
            self.free.push(slot);
        }
        while self.cavity.len() < self.faces.len() {
            let slot = match self.free.pop() {
                Some(slot) => slot,
                None if self.nodes.len() < MOST_SLOTS as usize => {
                    self.nodes.push([GHOST; 4]);
                    self.links.push([0; 4]);
                    self.marks.push(Mark::Unknown);
                    self.nodes.len() as u32 - 1
                }
                None => return Err(Refused::TooMany),
            };
            self.cavity.push(slot);
        }
        for (face, &slot) in self.faces.iter().zip(&self.cavity) {
            let [a, b, c] = face.nodes;
            self.nodes[slot as usize] = [new, a, b, c];
            self.marks[slot as usize] = Mark::Unknown;
            self.links[slot as usize][0] = face.outer;
            let outer = (face.outer >> 2) as usize;
            self.links[outer][(face.outer & 3) as usize] = slot << 2;
            self.marks[outer] = Mark::Unknown;
            if c != GHOST {
                self.last = slot;
            }
        }
        self.joints.join(&self.faces, &self.cavity, &mut self.links);
        Ok(())
    }
}

/// Finds which new tetrahedra share an edge of the cavity. The faces form a closed surface, so that each edge occurs
/// twice, once in each direction.
struct Joints {
    /// Nodes' numbers within the cavity, plus `base`; less than `base` where they have none.
    local: Vec<u32>,
    base: u32,
    /// Link by pair of local numbers. What earlier cavities left is never read: each entry that is read has been
    /// written for the same cavity, in the other direction.
    table: Vec<u32>,
    locals: Vec<[u32; 3]>,
    edges: Vec<(u64, u32)>,
}

impl Joints {
    fn new(points: usize) -> Result<Self, OutOfMemory> {
        // The last entry is the ghost's.
        Ok(Joints {
            local: filled(points + 1, 0)?,
            base: 1,
            table: Vec::new(),
            locals: Vec::new(),
            edges: Vec::new(),
        })
    }

    fn join(&mut self, faces: &[Face], slots: &[u32], links: &mut [[u32; 4]]) {
        // Euler: a surface of triangles without holes.
        let nodes = faces.len() / 2 + 2;
        if nodes > MOST_IN_TABLE {
            self.join_sorted(faces, slots, links);
        } else if nodes <= 64 {
            self.join_by_table::<64>(faces, slots, links);
        } else {
            self.join_by_table::<MOST_IN_TABLE>(faces, slots, links);
        }
    }

    fn join_by_table<const WIDTH: usize>(&mut self, faces: &[Face], slots: &[u32], links: &mut [[u32; 4]]) {
        if self.table.len() < WIDTH * WIDTH {
            self.table.resize(WIDTH * WIDTH, 0);
        }
        if self.base > u32::MAX - WIDTH as u32 {
            self.local.fill(0);
            self.base = 1;
        }
        let table = &mut self.table[..WIDTH * WIDTH];
        let ghost = self.local.len() - 1;
        let mut next = self.base;
        self.locals.clear();
        for (face, &slot) in faces.iter().zip(slots) {
            let [a, b, c] = face.nodes.each(|node| {
                let local = &mut self.local[(node as usize).min(ghost)];
                if *local < self.base {
                    *local = next;
                    next += 1;
                }
                *local - self.base
            });
            for (k, from, to) in [(1, b, c), (2, c, a), (3, a, b)] {
                table[from as usize % WIDTH * WIDTH + to as usize % WIDTH] = slot << 2 | k;
            }
            self.locals.push([a, b, c]);
        }
        self.base = next;
        for (&[a, b, c], &slot) in self.locals.iter().zip(slots) {
            let link = &mut links[slot as usize];
            for (k, from, to) in [(1, c, b), (2, a, c), (3, b, a)] {
                link[k] = table[from as usize % WIDTH * WIDTH + to as usize % WIDTH];
            }
        }
    }

    fn join_sorted(&mut self, faces: &[Face], slots: &[u32], links: &mut [[u32; 4]]) {
        self.edges.clear();
        for (face, &slot) in faces.iter().zip(slots) {
            let [a, b, c] = face.nodes.each(u64::from);
            for (k, from, to) in [(1, b, c), (2, c, a), (3, a, b)] {
                self.edges.push((from.min(to) << 32 | from.max(to), slot << 2 | k));
            }
        }
        self.edges.sort_unstable();
        for pair in self.edges.chunks_exact(2) {
            let (one, other) = (pair[0].1, pair[1].1);
            links[(one >> 2) as usize][(one & 3) as usize] = other;
            links[(other >> 2) as usize][(other & 3) as usize] = one;
        }
    }
}
