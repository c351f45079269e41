//! The ops in plain tensor operations, which Burn differentiates: the oracle of the kernels.
//!
//! Written for comparison, not for speed. Unlike the kernels it does not define what happens to
//! NaN, and the gradient by the points is Burn's own.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::Int;

use crate::config::Interpolation;
use crate::hash::PRIMES;
use crate::layout::{FEATURES, GridLayout, LevelLayout};

/// Same as [`encode()`](super::encode()), slowly.
#[must_use]
pub fn encode(
    points: Tensor<2>,
    table: Tensor<2>,
    layout: &Arc<GridLayout>,
    active_levels: usize,
) -> Tensor<2> {
    let features: Vec<Tensor<2>> = layout
        .levels
        .iter()
        .enumerate()
        .map(|(l, level)| {
            let [n, _] = points.dims();
            if l >= active_levels {
                return Tensor::zeros([n, FEATURES], &points.device());
            }
            let cells = Cells::new(points.clone(), level, layout.interpolation);
            let corners = cells.corners(table.clone(), level);
            let blend = |c: usize| corners[c].clone() * cells.weight(c);
            (1..8).fold(blend(0), |sum, c| sum + blend(c))
        })
        .collect();
    Tensor::cat(features, 1)
}

/// Same as [`encode_with_jacobian`](super::encode_with_jacobian), slowly.
#[must_use]
pub fn encode_with_jacobian(
    points: Tensor<2>,
    table: Tensor<2>,
    layout: &Arc<GridLayout>,
    active_levels: usize,
) -> (Tensor<2>, Tensor<3>) {
    let [n, _] = points.dims();
    let jacobian: Vec<Tensor<3>> = layout
        .levels
        .iter()
        .enumerate()
        .map(|(l, level)| {
            if l >= active_levels {
                return Tensor::zeros([n, FEATURES, 3], &points.device());
            }
            let cells = Cells::new(points.clone(), level, layout.interpolation);
            let corners = cells.corners(table.clone(), level);
            let along = |axis: usize| {
                let blend = |c: usize| corners[c].clone() * cells.weight_gradient(c, axis);
                (1..8)
                    .fold(blend(0), |sum, c| sum + blend(c))
                    .reshape([n, FEATURES, 1])
            };
            Tensor::cat(vec![along(0), along(1), along(2)], 2)
        })
        .collect();
    (
        encode(points, table, layout, active_levels),
        Tensor::cat(jacobian, 1),
    )
}

/// Where points are on one level.
struct Cells {
    /// Lower node along each axis, `[n]`.
    node: [Tensor<1, Int>; 3],
    /// Weight of the upper node along each axis, `[n, 1]`.
    weight: [Tensor<2>; 3],
    /// Derivative of that weight by the position, `[n, 1]`.
    slope: [Tensor<2>; 3],
}

impl Cells {
    fn new(points: Tensor<2>, level: &LevelLayout, interpolation: Interpolation) -> Self {
        let [n, _] = points.dims();
        let resolution = f64::from(level.resolution);
        let axis = |axis: usize| {
            let position = points.clone().slice([0..n, axis..axis + 1]);
            let inside = position
                .clone()
                .greater_equal_elem(0.0)
                .bool_and(position.clone().lower_equal_elem(1.0))
                .float();
            let scaled = position.clamp(0.0, 1.0).mul_scalar(resolution);
            let cell = scaled.clone().detach().floor().clamp_max(resolution - 1.0);
            let t = scaled - cell.clone();
            let (weight, slope) = match interpolation {
                Interpolation::Linear => (t, inside.mul_scalar(resolution)),
                Interpolation::Smoothstep => (
                    t.clone() * t.clone() * (t.clone().mul_scalar(-2.0).add_scalar(3.0)),
                    t.clone() * (t.neg().add_scalar(1.0)) * inside.mul_scalar(6.0 * resolution),
                ),
            };
            (cell.int().reshape([n]), weight, slope)
        };
        let [(x, wx, sx), (y, wy, sy), (z, wz, sz)] = [0, 1, 2].map(axis);
        Self {
            node: [x, y, z],
            weight: [wx, wy, wz],
            slope: [sx, sy, sz],
        }
    }

    /// Both features of each corner, `[n, 2]`.
    fn corners(&self, table: Tensor<2>, level: &LevelLayout) -> [Tensor<2>; 8] {
        let range = [level.offset..level.offset + level.entries, 0..FEATURES];
        let own = table.slice(range);
        [0, 1, 2, 3, 4, 5, 6, 7].map(|c| own.clone().select(0, self.index(c, level)))
    }

    /// Entry of corner `c`, relative to the level, `[n]`.
    fn index(&self, c: usize, level: &LevelLayout) -> Tensor<1, Int> {
        let upper = [c & 1, c >> 1 & 1, c >> 2];
        let [x, y, z] =
            [0, 1, 2].map(|axis| self.node[axis].clone().add_scalar(upper[axis] as i32));
        if let Some(hash) = level.hash {
            // Only the result's low bits count, and a product's low bits come from its factors'
            // low bits: reduced primes keep this within 32-bit integers too.
            let mask = level.entries as u32 - 1;
            let side = 1_i32 << hash.block_shift();
            let part = |node: Tensor<1, Int>, axis: usize| {
                let block = node.clone().div_scalar(side);
                let within = node - block.clone().mul_scalar(side);
                let hashed = block.mul_scalar((PRIMES[axis] & mask) as i32);
                hashed.mul_scalar(side.pow(3)) + within.mul_scalar(side.pow(axis as u32))
            };
            part(x, 0)
                .bitwise_xor(part(y, 1))
                .bitwise_xor(part(z, 2))
                .bitwise_and_scalar(mask as i32)
        } else {
            let side = level.resolution as i32 + 1;
            x + (y + z.mul_scalar(side)).mul_scalar(side)
        }
    }

    /// `w_c`, `[n, 1]`.
    fn weight(&self, c: usize) -> Tensor<2> {
        let [x, y, z] = [0, 1, 2].map(|axis| self.factor(c, axis));
        x * y * z
    }

    /// `dw_c / dp_axis`, `[n, 1]`.
    fn weight_gradient(&self, c: usize, axis: usize) -> Tensor<2> {
        let slope = self.slope[axis].clone();
        let slope = if c >> axis & 1 == 1 {
            slope
        } else {
            slope.neg()
        };
        let [a, b] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| self.factor(c, other));
        slope * a * b
    }

    fn factor(&self, c: usize, axis: usize) -> Tensor<2> {
        let weight = self.weight[axis].clone();
        if c >> axis & 1 == 1 {
            weight
        } else {
            weight.neg().add_scalar(1.0)
        }
    }
}
