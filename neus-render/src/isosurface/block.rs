//! One block of cells: its values, and marching cubes over them.

use glam::IVec3;

use super::cases::{CASES, edge_corners};

/// Cells along a block's edge.
pub(crate) const BLOCK: usize = 16;
/// Nodes along a block's edge.
const SIDE: usize = BLOCK + 1;
/// Nodes of a block, those it shares with its neighbours included.
pub(crate) const NODES: usize = SIDE * SIDE * SIDE;
/// What stands for a value whose sign was settled against it: as good as zero.
const TINY: f32 = 1e-12;
/// No vertex yet.
const NONE: u32 = u32::MAX;

/// A bit per node: whether it lies inside the solid.
pub(crate) type Signs = [u64; NODES.div_ceil(64)];

/// Values at the nodes of a block whose first node is `first` in the lattice.
pub(crate) struct Block {
    first: IVec3,
    values: Vec<f32>,
}

fn number(node: IVec3) -> usize {
    node.x as usize + SIDE * (node.y as usize + SIDE * node.z as usize)
}

/// The first and last node of a block that a neighbour at `offset` has, too, along one axis.
fn shared_range(offset: i32) -> std::ops::RangeInclusive<i32> {
    let last = BLOCK as i32;
    match offset {
        0 => 0..=last,
        1 => last..=last,
        _ => 0..=0,
    }
}

impl Block {
    /// The nodes of a block relative to its first, in the order of values.
    pub(crate) fn nodes() -> impl Iterator<Item = IVec3> {
        let side = SIDE as i32;
        (0..side).flat_map(move |z| {
            (0..side).flat_map(move |y| (0..side).map(move |x| IVec3::new(x, y, z)))
        })
    }

    pub(crate) fn new(first: IVec3, values: &[f32]) -> Self {
        Self {
            first,
            values: values.to_vec(),
        }
    }

    /// Makes everything on or beyond the lattice's surface lie outside the solid.
    pub(crate) fn close_border(&mut self, cells: IVec3) {
        for (value, node) in self.values.iter_mut().zip(Self::nodes()) {
            let node = node + self.first;
            let within = node.cmpgt(IVec3::ZERO).all() && node.cmplt(cells).all();
            if !within && *value < TINY {
                *value = TINY;
            }
        }
    }

    /// Takes over the signs of a neighbour `offset` (-1 to 1 along each axis) blocks away.
    pub(crate) fn adopt_signs(&mut self, offset: IVec3, signs: &Signs) {
        for z in shared_range(offset.z) {
            for y in shared_range(offset.y) {
                for x in shared_range(offset.x) {
                    let here = IVec3::new(x, y, z);
                    let there = number(here - offset * BLOCK as i32);
                    let inside = signs[there / 64] >> (there % 64) & 1 == 1;
                    let value = &mut self.values[number(here)];
                    if (*value < 0.0) != inside {
                        *value = if inside { -TINY } else { TINY };
                    }
                }
            }
        }
    }

    pub(crate) fn signs(&self) -> Signs {
        let mut signs = [0; NODES.div_ceil(64)];
        for (i, &value) in self.values.iter().enumerate() {
            signs[i / 64] |= u64::from(value < 0.0) << (i % 64);
        }
        signs
    }

    /// Whether the side of the block at node coordinate `at` (first or last) along `axis` has nodes
    /// of both signs.
    pub(crate) fn side_is_cut(&self, axis: usize, at: usize) -> bool {
        let (mut inside, mut outside) = (false, false);
        for i in 0..SIDE as i32 {
            for j in 0..SIDE as i32 {
                let mut node = IVec3::ZERO;
                node[axis] = at as i32;
                node[(axis + 1) % 3] = i;
                node[(axis + 2) % 3] = j;
                let negative = self.values[number(node)] < 0.0;
                inside |= negative;
                outside |= !negative;
            }
        }
        inside && outside
    }

    /// Whether the edge from `node` (relative to the block) along `axis` lies in the block's sides.
    pub(crate) fn edge_in_side(node: IVec3, axis: usize) -> bool {
        (0..3).any(|other| other != axis && (node[other] == 0 || node[other] == BLOCK as i32))
    }

    /// Marches all cells within the lattice of `cells` cells. `vertex` is called once for each cut
    /// edge with the node it starts from (in the lattice), its axis, and where it is cut (0 to 1),
    /// and gives the vertex's number.
    pub(crate) fn march(
        &self,
        cells: IVec3,
        mut vertex: impl FnMut(IVec3, usize, f32) -> u32,
        triangles: &mut Vec<[u32; 3]>,
    ) {
        let mut vertices = vec![NONE; 3 * NODES];
        let count = (cells - self.first).min(IVec3::splat(BLOCK as i32));
        let step = [1, SIDE, SIDE * SIDE];
        let corner_offset: [usize; 8] =
            std::array::from_fn(|c| (0..3).map(|axis| (c >> axis & 1) * step[axis]).sum());
        for z in 0..count.z {
            for y in 0..count.y {
                for x in 0..count.x {
                    let node = IVec3::new(x, y, z);
                    let at = number(node);
                    let case = (0..8).fold(0, |case, c| {
                        let inside = self.values[at + corner_offset[c]] < 0.0;
                        case | usize::from(inside) << c
                    });
                    for triangle in &CASES[case] {
                        triangles.push(triangle.map(|edge| {
                            let edge = edge as usize;
                            let axis = edge / 4;
                            let [low, high] = edge_corners(edge);
                            let from = at + corner_offset[low];
                            let slot = &mut vertices[3 * from + axis];
                            if *slot == NONE {
                                let start =
                                    node + IVec3::from([0, 1, 2].map(|a| (low >> a & 1) as i32));
                                let a = self.values[from];
                                let b = self.values[at + corner_offset[high]];
                                *slot = vertex(start + self.first, axis, a / (a - b));
                            }
                            *slot
                        }));
                    }
                }
            }
        }
    }
}
