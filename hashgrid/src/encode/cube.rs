//! The kernels on the GPU: one thread per point and level, or per point for the points' gradient.

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::{
    AtomicSum, CompareAndSwap, CubeTensor, NativeSum, buffer, constant, contiguous, cubecl, fresh,
    has_native_sum, units_for, zeros,
};

use super::backward::EncodeBackward;
use super::{EncodeConfig, EncodeOps};
use crate::config::TableReads;
use crate::cube::{
    DeviceTable, Entries, FeatureGradient, Half, Pair, Single, blend, is_smooth, level_words,
    locate, pair, scatter,
};
use crate::layout::FEATURES;
use cubecl::prelude::*;

/// Numbers per feature of [`EncodeOps::hash_encode_with_jacobian`].
const WITH_JACOBIAN: usize = 4;

impl EncodeOps for Cube {
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self> {
        let n = checked("encode", &points, None, &config, 1);
        let features = config.layout.features();
        let out = fresh(&points, [n, features]);
        forward(points, table, &config, &out, 1);
        out
    }

    fn hash_encode_with_jacobian(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self> {
        let n = checked(
            "encode_with_jacobian",
            &points,
            None,
            &config,
            WITH_JACOBIAN,
        );
        let features = config.layout.features();
        let out = fresh(&points, [n, features, WITH_JACOBIAN]);
        forward(points, table, &config, &out, WITH_JACOBIAN);
        out
    }
}

impl EncodeBackward for Cube {
    fn hash_encode_table_gradient(
        points: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        config: &EncodeConfig,
    ) -> FloatTensor<Self> {
        let width = if grad.rank() == 2 { 1 } else { WITH_JACOBIAN };
        checked("encode's gradient", &points, Some(&grad), config, width);
        let out = zeros(&points, [config.layout.entries(), FEATURES]);
        if has_native_sum(&points.client) {
            table_gradient::<NativeSum>(points, grad, config, &out, width);
        } else {
            table_gradient::<CompareAndSwap>(points, grad, config, &out, width);
        }
        out
    }

    fn hash_encode_points_gradient(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        config: &EncodeConfig,
    ) -> FloatTensor<Self> {
        let n = checked("encode's gradient", &points, Some(&grad), config, 1);
        let out = fresh(&points, [n, 3]);
        if n > 0 {
            let table = DeviceTable::new(table, &config.layout);
            match table.reads {
                TableReads::Single => {
                    points_gradient::<Single>(points, &table, grad, config, &out);
                }
                TableReads::Half => points_gradient::<Half>(points, &table, grad, config, &out),
            }
        }
        out
    }
}

/// The number of `points`.
///
/// # Panics
/// When kernels would read or write beyond them or beyond `width` numbers for each of their features, which are those of
/// `grad` if there is one. Tables are checked by themselves: [`DeviceTable::new`].
fn checked(
    op: &str,
    points: &CubeTensor,
    grad: Option<&CubeTensor>,
    config: &EncodeConfig,
    width: usize,
) -> usize {
    let shape = points.shape();
    let n = shape[0];
    assert!(
        shape[..] == [n, 3],
        "{op}: points are {shape:?}, not [n, 3]"
    );
    config.check_for_kernels(op, n, width);
    if let Some(grad) = grad {
        let (found, expected) = (grad.shape(), n * config.layout.features() * width);
        assert_eq!(
            found.num_elements(),
            expected,
            "{op}: numbers that came back, {found:?}"
        );
    }
    n
}

fn forward(
    points: CubeTensor,
    table: CubeTensor,
    config: &EncodeConfig,
    out: &CubeTensor,
    width: usize,
) {
    if points.shape()[0] == 0 {
        return;
    }
    let table = DeviceTable::new(table, &config.layout);
    match table.reads {
        TableReads::Single => forward_from::<Single>(points, &table, config, out, width),
        TableReads::Half => forward_from::<Half>(points, &table, config, out, width),
    }
}

fn forward_from<E: Entries>(
    points: CubeTensor,
    table: &DeviceTable,
    config: &EncodeConfig,
    out: &CubeTensor,
    width: usize,
) {
    let n = points.shape()[0];
    let client = &out.client;
    let levels = config.layout.levels.len();
    let (count, dim) = units_for(client, n * levels);
    // SAFETY: threads beyond the points return at once; `level_words` has checked the levels, and `checked` the rest.
    unsafe {
        forward_kernel::launch_unchecked::<E>(
            client,
            count,
            dim,
            buffer(&contiguous(points)),
            table.buffer(),
            constant(out, &level_words(&config.layout)),
            buffer(out),
            n as u32,
            config.active_levels as u32,
            levels,
            width,
            is_smooth(&config.layout),
        );
    }
}

fn points_gradient<E: Entries>(
    points: CubeTensor,
    table: &DeviceTable,
    grad: CubeTensor,
    config: &EncodeConfig,
    out: &CubeTensor,
) {
    let n = points.shape()[0];
    let client = &out.client;
    let (count, dim) = units_for(client, n);
    // SAFETY: threads beyond the points return at once; `level_words` has checked the levels, and `checked` the rest.
    unsafe {
        points_kernel::launch_unchecked::<E>(
            client,
            count,
            dim,
            buffer(&contiguous(points)),
            table.buffer(),
            constant(out, &level_words(&config.layout)),
            buffer(&contiguous(grad)),
            buffer(out),
            n as u32,
            config.active_levels as u32,
            config.layout.levels.len(),
            is_smooth(&config.layout),
        );
    }
}

fn table_gradient<A: AtomicSum>(
    points: CubeTensor,
    grad: CubeTensor,
    config: &EncodeConfig,
    out: &CubeTensor,
    width: usize,
) {
    let n = points.shape()[0];
    if n == 0 || config.active_levels == 0 {
        return;
    }
    let client = &out.client;
    let (count, dim) = units_for(client, FEATURES * n * config.active_levels);
    // SAFETY: threads beyond the points return at once; `level_words` has checked the levels, and `checked` the rest.
    unsafe {
        table_kernel::launch_unchecked::<A>(
            client,
            count,
            dim,
            buffer(&contiguous(points)),
            constant(out, &level_words(&config.layout)),
            buffer(&contiguous(grad)),
            buffer(out),
            n as u32,
            config.active_levels as u32,
            config.layout.levels.len(),
            width,
            is_smooth(&config.layout),
        );
    }
}

/// Thread `i` encodes point `i % n` on level `i / n`: neighbours share a level's part of the table.
#[cube(launch_unchecked)]
fn forward_kernel<E: Entries>(
    points: &[f32],
    table: &[E::Word],
    levels: &[u32],
    out: &mut [f32],
    n: u32,
    active: u32,
    #[comptime] level_count: usize,
    #[comptime] width: usize,
    #[comptime] smooth: bool,
) {
    let n = n as usize;
    let (point, level) = (ABSOLUTE_POS % n, ABSOLUTE_POS / n);
    if level < level_count {
        let at = (point * level_count + level) * 2 * width;
        if level < active as usize {
            let p = point * 3;
            let cell = locate(
                points[p],
                points[p + 1],
                points[p + 2],
                levels,
                level,
                smooth,
            );
            let both = blend::<E>(&cell, table);
            out[at] = both.value.extract(0usize);
            out[at + width] = both.value.extract(1usize);
            if comptime!(width > 1) {
                out[at + 1] = both.x.extract(0usize);
                out[at + 2] = both.y.extract(0usize);
                out[at + 3] = both.z.extract(0usize);
                out[at + width + 1] = both.x.extract(1usize);
                out[at + width + 2] = both.y.extract(1usize);
                out[at + width + 3] = both.z.extract(1usize);
            }
        } else {
            #[unroll]
            for i in 0..comptime!(2 * width) {
                out[at + i] = 0.0f32;
            }
        }
    }
}

/// Threads `2 i` and `2 i + 1` add what point `i % n` gives to both features of the entries of level `i / n`.
#[cube(launch_unchecked)]
fn table_kernel<A: AtomicSum>(
    points: &[f32],
    levels: &[u32],
    grad: &[f32],
    table: &[Atomic<A::Word>],
    n: u32,
    active: u32,
    #[comptime] level_count: usize,
    #[comptime] width: usize,
    #[comptime] smooth: bool,
) {
    let n = n as usize;
    let (feature, number) = (ABSOLUTE_POS % FEATURES, ABSOLUTE_POS / FEATURES);
    let (point, level) = (number % n, number / n);
    if level < active as usize {
        let p = point * 3;
        let cell = locate(
            points[p],
            points[p + 1],
            points[p + 2],
            levels,
            level,
            smooth,
        );
        let at = ((point * level_count + level) * FEATURES + feature) * width;
        let mut d = FeatureGradient {
            value: grad[at],
            x: 0.0f32,
            y: 0.0f32,
            z: 0.0f32,
        };
        if comptime!(width > 1) {
            d.x = grad[at + 1];
            d.y = grad[at + 2];
            d.z = grad[at + 3];
        }
        scatter::<A>(table, &cell, feature, &d);
    }
}

/// One thread per point: `Jᵀ grad` over all levels.
#[cube(launch_unchecked)]
fn points_kernel<E: Entries>(
    points: &[f32],
    table: &[E::Word],
    levels: &[u32],
    grad: &[f32],
    out: &mut [f32],
    n: u32,
    active: u32,
    #[comptime] level_count: usize,
    #[comptime] smooth: bool,
) {
    let point = ABSOLUTE_POS;
    if point < n as usize {
        let p = point * 3;
        let mut dx = Pair::new(0.0f32);
        let mut dy = Pair::new(0.0f32);
        let mut dz = Pair::new(0.0f32);
        for level in 0..active as usize {
            let cell = locate(
                points[p],
                points[p + 1],
                points[p + 2],
                levels,
                level,
                smooth,
            );
            let both = blend::<E>(&cell, table);
            let at = (point * level_count + level) * 2;
            let g = pair(grad[at], grad[at + 1]);
            dx += g * both.x;
            dy += g * both.y;
            dz += g * both.z;
        }
        out[p] = dx.extract(0usize) + dx.extract(1usize);
        out[p + 1] = dy.extract(0usize) + dy.extract(1usize);
        out[p + 2] = dz.extract(0usize) + dz.extract(1usize);
    }
}
