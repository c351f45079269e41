//! The kernels around the network's layers: one thread for each point and row.
//!
//! Matrices are [`gpu_tensors::PointMatrix`], `across` their points. With normals, backward's are twice
//! as wide: beside a point's own column is a second one, of its normal's gradient.

use gpu_tensors::{AtomicSum, LANES, Quad, cubecl, padded, sigmoid, softplus};
use hashgrid::FEATURES;
use hashgrid::cube::{Entries, FeatureGradient, blend, locate, scatter};

use cubecl::prelude::*;

/// A kernel's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Sizes {
    pub(super) levels: usize,
    pub(super) hidden: usize,
    pub(super) outputs: usize,
    pub(super) normal: bool,
    pub(super) smooth: bool,
}

impl Sizes {
    pub(super) fn inputs(self) -> usize {
        3 + 2 * self.levels
    }

    /// Rows of the Jacobian: by x, y and z for each feature.
    pub(super) fn derivatives(self) -> usize {
        if self.normal { 6 * self.levels } else { 1 }
    }

    /// Rows of the largest matrix, padding included, as if all were as wide as there are points: with normals,
    /// backward's are twice as wide, and each is padded before that.
    pub(super) fn most_rows(self) -> usize {
        let widest = self.hidden.max(self.inputs()).max(self.outputs) + 1;
        (2 * padded(widest)).max(self.derivatives())
    }
}

/// Encodes `count` points from `first` on into the network's inputs and a one, the bias' input; zeros
/// beyond them. Where normals are wanted, also the Jacobian by the position in the unit cube.
///
/// One thread for each point and level.
#[cube(launch_unchecked)]
pub(super) fn encode_kernel<E: Entries>(
    points: &[f32],
    table: &[E::Word],
    levels: &[u32],
    x: &mut [f32],
    jacobian: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    stride: u32,
    active: u32,
    scale: f32,
    #[comptime] sizes: Sizes,
) {
    let (count, across, stride) = (count as usize, across as usize, stride as usize);
    let (point, level) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    if level < comptime!(sizes.levels) {
        let inside = point < count;
        let from = (first as usize + min(point, count - 1)) * 3;
        let (px, py, pz) = (points[from], points[from + 1], points[from + 2]);
        if level == 0 {
            x[point] = select(inside, px, 0.0f32);
            x[stride + point] = select(inside, py, 0.0f32);
            x[2 * stride + point] = select(inside, pz, 0.0f32);
            x[comptime!(sizes.inputs()) * stride + point] = select(inside, 1.0f32, 0.0f32);
        }
        let mut value0 = 0.0f32;
        let mut value1 = 0.0f32;
        if level < active as usize {
            let cell = locate(
                px * scale + 0.5f32,
                py * scale + 0.5f32,
                pz * scale + 0.5f32,
                levels,
                level,
                sizes.smooth,
            );
            let both = blend::<E>(&cell, table);
            value0 = select(inside, both.value.extract(0usize), 0.0f32);
            value1 = select(inside, both.value.extract(1usize), 0.0f32);
            if comptime!(sizes.normal) {
                let at = 6 * level * across + point;
                jacobian[at] = both.x.extract(0usize);
                jacobian[at + across] = both.y.extract(0usize);
                jacobian[at + 2 * across] = both.z.extract(0usize);
                jacobian[at + 3 * across] = both.x.extract(1usize);
                jacobian[at + 4 * across] = both.y.extract(1usize);
                jacobian[at + 5 * across] = both.z.extract(1usize);
            }
        }
        let row = (3 + 2 * level) * stride + point;
        x[row] = value0;
        x[row + stride] = value1;
    }
}

/// From the hidden layer to its activation, and to the sdf's derivative by the hidden layer.
///
/// One thread for each four points and hidden value; `across` counts fours.
#[cube(launch_unchecked)]
pub(super) fn activate_kernel(
    z: &[Quad],
    w2: &[f32],
    activation: &mut [Quad],
    derivative: &mut [Quad],
    across: u32,
    beta: f32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let hidden = comptime!(sizes.hidden);
    let j = ABSOLUTE_POS / across;
    if j < hidden {
        let z = z[ABSOLUTE_POS];
        let mut a = Quad::new(0.0f32);
        let mut u = Quad::new(w2[j]);
        #[unroll]
        for lane in 0..LANES {
            let z = beta * z.extract(lane);
            a.insert(lane, softplus(z) / beta);
            u.insert(lane, u.extract(lane) * sigmoid(z));
        }
        activation[ABSOLUTE_POS] = a;
        if comptime!(sizes.normal) {
            derivative[ABSOLUTE_POS] = u;
        }
        if j == 0 {
            activation[hidden * across + ABSOLUTE_POS] = Quad::new(1.0f32);
        }
    }
}

/// Writes the results of `count` points: the network's outputs, and the normal from the sdf's derivative
/// `g` by the inputs.
///
/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn finish_kernel(
    y: &[f32],
    g: &[f32],
    jacobian: &[f32],
    out: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    active: u32,
    scale: f32,
    #[comptime] sizes: Sizes,
) {
    let point = ABSOLUTE_POS;
    if point < count as usize {
        let across = across as usize;
        let outputs = comptime!(sizes.outputs);
        let at = (first as usize + point) * (outputs + 3);
        for o in 0..outputs {
            out[at + o] = y[o * across + point];
        }
        let mut nx = 0.0f32;
        let mut ny = 0.0f32;
        let mut nz = 0.0f32;
        if comptime!(sizes.normal) {
            for k in 0..2 * active as usize {
                let by = g[(3 + k) * across + point];
                let j = 3 * k * across + point;
                nx += by * jacobian[j];
                ny += by * jacobian[j + across];
                nz += by * jacobian[j + 2 * across];
            }
            nx = g[point] + scale * nx;
            ny = g[across + point] + scale * ny;
            nz = g[2 * across + point] + scale * nz;
        }
        out[at + outputs] = nx;
        out[at + outputs + 1] = ny;
        out[at + outputs + 2] = nz;
    }
}

/// The outputs' gradients of `count` points, zeros beyond them; and of the second columns, in which the
/// sdf counts once.
///
/// One thread for each point and output.
#[cube(launch_unchecked)]
pub(super) fn outputs_kernel(
    grad: &[f32],
    d_outputs: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    stride: u32,
    #[comptime] sizes: Sizes,
) {
    let (across, stride) = (across as usize, stride as usize);
    let (point, o) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    if o < comptime!(sizes.outputs) {
        let mut value = 0.0f32;
        let mut second = 0.0f32;
        if point < count as usize {
            value = grad[(first as usize + point) * comptime!(sizes.outputs + 3) + o];
            second = select(o == 0, 1.0f32, 0.0f32);
        }
        d_outputs[o * stride + point] = value;
        if comptime!(sizes.normal) {
            d_outputs[o * stride + across + point] = second;
        }
    }
}

/// The second columns of the network's inputs: the gradients of `g`, which makes the normal.
///
/// One thread for each point and input, the bias' included.
#[cube(launch_unchecked)]
pub(super) fn normals_kernel(
    grad: &[f32],
    jacobian: &[f32],
    x: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    active: u32,
    scale: f32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let (point, k) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    if k < comptime!(sizes.inputs() + 1) {
        let mut value = 0.0f32;
        if point < count as usize && k < 3 + 2 * active as usize {
            let at =
                (first as usize + point) * comptime!(sizes.outputs + 3) + comptime!(sizes.outputs);
            if k < 3 {
                value = grad[at + k];
            } else {
                let j = 3 * (k - 3) * across + point;
                value = scale
                    * (jacobian[j] * grad[at]
                        + jacobian[j + across] * grad[at + 1]
                        + jacobian[j + 2 * across] * grad[at + 2]);
            }
        }
        x[(2 * k + 1) * across + point] = value;
    }
}

/// The hidden layer on the way back; see the CPU kernel's backward for the chain rule. `z` becomes its
/// gradient, and in second columns what it is multiplied with.
///
/// One thread for each four points and hidden value; `across` counts fours.
#[cube(launch_unchecked)]
pub(super) fn hidden_kernel(
    z: &mut [Quad],
    d_activation: &[Quad],
    w2: &[f32],
    activation: &mut [Quad],
    across: u32,
    beta: f32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let hidden = comptime!(sizes.hidden);
    let (point, j) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    if j < hidden {
        let mut at = ABSOLUTE_POS;
        let mut one = hidden * across + point;
        if comptime!(sizes.normal) {
            at = 2 * j * across + point;
            one = 2 * hidden * across + point;
        }
        let scaled = Quad::new(beta) * z[at];
        let mut slope = Quad::new(0.0f32);
        let mut a = Quad::new(0.0f32);
        #[unroll]
        for lane in 0..LANES {
            slope.insert(lane, sigmoid(scaled.extract(lane)));
            a.insert(lane, softplus(scaled.extract(lane)) / beta);
        }
        let mut dz = d_activation[ABSOLUTE_POS] * slope;
        activation[at] = a;
        if comptime!(sizes.normal) {
            let du = z[at + across];
            let u = Quad::new(w2[j]) * slope;
            dz += du * u * Quad::new(beta) * (Quad::new(1.0f32) - slope);
            z[at + across] = u;
            activation[at + across] = du * slope;
        }
        z[at] = dz;
        if j == 0 {
            activation[one] = Quad::new(1.0f32);
            if comptime!(sizes.normal) {
                activation[one + across] = Quad::new(0.0f32);
            }
        }
    }
}

/// Adds the gradients of `count` points to the table's: `dx` of the features, and `g` in second columns.
///
/// One thread for each of both features, point and active level.
#[cube(launch_unchecked)]
pub(super) fn scatter_kernel<A: AtomicSum>(
    points: &[f32],
    levels: &[u32],
    grad: &[f32],
    dx: &[f32],
    table: &[Atomic<A::Word>],
    first: u32,
    count: u32,
    across: u32,
    active: u32,
    scale: f32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let (feature, number) = (ABSOLUTE_POS % FEATURES, ABSOLUTE_POS / FEATURES);
    let (point, level) = (number % across, number / across);
    if point < count as usize && level < active as usize {
        let p = first as usize + point;
        let cell = locate(
            points[3 * p] * scale + 0.5f32,
            points[3 * p + 1] * scale + 0.5f32,
            points[3 * p + 2] * scale + 0.5f32,
            levels,
            level,
            sizes.smooth,
        );
        let k = 3 + FEATURES * level + feature;
        let mut d = FeatureGradient {
            value: 0.0f32,
            x: 0.0f32,
            y: 0.0f32,
            z: 0.0f32,
        };
        if comptime!(sizes.normal) {
            let row = 2 * k * across + point;
            d.value = dx[row];
            let g = scale * dx[row + across];
            let at = p * comptime!(sizes.outputs + 3) + comptime!(sizes.outputs);
            d.x = g * grad[at];
            d.y = g * grad[at + 1];
            d.z = g * grad[at + 2];
        } else {
            d.value = dx[k * across + point];
        }
        scatter::<A>(table, &cell, feature, &d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gpu_tensors::points_within;

    /// 128 MiB are what many devices bind at most.
    #[test]
    fn matrices_of_any_width_can_be_bound() {
        let bytes: u64 = 128 << 20;
        for (hidden, levels, outputs) in [
            (64, 16, 16),
            (128, 16, 16),
            (256, 16, 16),
            (512, 16, 16),
            (1024, 16, 16),
            (16, 64, 16),
            (16, 2, 1024),
        ] {
            let sizes = Sizes {
                levels,
                hidden,
                outputs,
                normal: true,
                smooth: false,
            };
            let points = points_within(bytes, sizes.most_rows());
            for (rows, wide) in [
                (sizes.hidden + 1, 2),
                (sizes.inputs() + 1, 2),
                (sizes.outputs, 2),
                (sizes.derivatives(), 1),
            ] {
                let size = (padded(rows) * wide * points * size_of::<f32>()) as u64;
                assert!(size <= bytes, "{sizes:?}: {rows} rows take {size} bytes");
            }
        }
    }
}
