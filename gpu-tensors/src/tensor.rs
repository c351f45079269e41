//! Tensors in and out of kernels.

use std::sync::atomic::{AtomicBool, Ordering};

use burn::tensor::{DType, Shape};
use burn_cubecl::cubecl::ir::{ElemType, FloatKind, IntKind};
use burn_cubecl::cubecl::prelude::{BufferArg, CubeCount, CubeDim, CubeElement, InputScalar};
use burn_cubecl::cubecl::{calculate_cube_count_elemwise, client::Client, server::Handle};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric;
use burn_cubecl::tensor::CubeTensor;

use crate::points::{BLOCK, padded};

/// Threads of a workgroup: two or four planes on today's GPUs, within every device's limits.
pub const UNITS: u32 = 64;

/// Whether [`fresh`] memory is filled with NaN, and [`fresh_words`] with [`POISON_WORD`].
static POISON: AtomicBool = AtomicBool::new(false);

/// No count, offset or set of flags that a test would expect.
const POISON_WORD: i32 = 0x7FC0_BAD1;

/// Has [`fresh`] fill its memory with NaN from now on, in the whole process, and [`fresh_words`] with a
/// large number: a kernel that leaves a part of its output unwritten then shows. For tests.
pub fn poison_fresh_memory(on: bool) {
    POISON.store(on, Ordering::Relaxed);
}

/// The tensor with its values in row-major order; copied only when they are not.
///
/// # Panics
/// When the tensor is not of type `f32`: the ops of this workspace are single precision.
#[must_use]
pub fn contiguous(tensor: CubeTensor) -> CubeTensor {
    assert_eq!(
        tensor.dtype,
        DType::F32,
        "gpu-tensors: expected an f32 tensor"
    );
    into_contiguous(tensor)
}

/// [`contiguous`] for whole numbers, which kernels read as `u32`.
///
/// # Panics
/// When the tensor is not of a 32-bit integer type.
#[must_use]
pub fn contiguous_words(tensor: CubeTensor) -> CubeTensor {
    assert!(
        matches!(tensor.dtype, DType::I32 | DType::U32),
        "gpu-tensors: expected a tensor of 32-bit integers, not {:?}",
        tensor.dtype
    );
    into_contiguous(tensor)
}

/// A row-major tensor of arbitrary content where `like` is.
#[must_use]
pub fn fresh<const D: usize>(like: &CubeTensor, shape: [usize; D]) -> CubeTensor {
    fresh_of(like, shape.into())
}

/// [`fresh`] of the shape of `like`.
#[must_use]
pub(crate) fn fresh_like(like: &CubeTensor) -> CubeTensor {
    fresh_of(like, like.meta.shape().clone())
}

fn fresh_of(like: &CubeTensor, shape: Shape) -> CubeTensor {
    if POISON.load(Ordering::Relaxed) {
        return filled(like, shape, f32::NAN);
    }
    empty(like, shape, DType::F32)
}

/// The most points, whole blocks of them, whose matrices of so many `rows` a device binds as one buffer each, up to a
/// number that no step of training exceeds and that is no burden to anybody's memory. Rows are counted with their padding,
/// see [`padded`], and of a matrix that is several times as wide as there are points, as often.
///
/// # Panics
/// When there are no rows.
#[must_use]
pub fn points_at_once(like: &CubeTensor, rows: usize) -> usize {
    points_within(like.client.properties().memory.max_page_size, rows)
}

/// [`points_at_once`] where a device binds so many `bytes`.
///
/// # Panics
/// As there.
#[must_use]
pub fn points_within(bytes: u64, rows: usize) -> usize {
    const MOST: usize = 1 << 17;
    let values = usize::try_from(bytes).unwrap_or(usize::MAX) / size_of::<f32>();
    let points = (values / padded(rows)).min(MOST);
    (points / BLOCK * BLOCK).max(BLOCK)
}

/// A row-major tensor of zeros where `like` is.
#[must_use]
pub fn zeros<const D: usize>(like: &CubeTensor, shape: [usize; D]) -> CubeTensor {
    filled(like, shape.into(), 0.0)
}

/// [`fresh`] for whole numbers: Burn's `Int`, `u32` for kernels.
#[must_use]
pub fn fresh_words<const D: usize>(like: &CubeTensor, shape: [usize; D]) -> CubeTensor {
    if POISON.load(Ordering::Relaxed) {
        return words_filled(like, shape, POISON_WORD);
    }
    empty(like, shape.into(), DType::I32)
}

/// [`zeros`] for whole numbers: Burn's `Int`, `u32` for kernels.
#[must_use]
pub fn zero_words<const D: usize>(like: &CubeTensor, shape: [usize; D]) -> CubeTensor {
    words_filled(like, shape, 0)
}

fn empty(like: &CubeTensor, shape: Shape, dtype: DType) -> CubeTensor {
    numeric::empty_device_contiguous_dtype(like.client.clone(), like.device.clone(), shape, dtype)
}

fn filled(like: &CubeTensor, shape: Shape, value: f32) -> CubeTensor {
    let value = InputScalar::new(value, ElemType::Float(FloatKind::F32));
    full(like, shape, value, DType::F32)
}

fn words_filled<const D: usize>(like: &CubeTensor, shape: [usize; D], value: i32) -> CubeTensor {
    let value = InputScalar::new(value, ElemType::Int(IntKind::I32));
    full(like, shape.into(), value, DType::I32)
}

fn full(like: &CubeTensor, shape: Shape, value: InputScalar, dtype: DType) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    let list = [shape.num_elements()].into();
    let list = numeric::full_device_dtype(client, list, device, value, dtype);
    shaped(list, shape)
}

/// The values of a row-major tensor as one row. What Burn's own operations give has rows that are apart on CUDA, each at a
/// multiple of 512 bytes; a single row is as it is on every device.
fn list(tensor: CubeTensor) -> CubeTensor {
    let count = tensor.meta.shape().num_elements();
    shaped(tensor, [count].into())
}

/// The values of a row-major tensor in another shape.
fn shaped(tensor: CubeTensor, shape: Shape) -> CubeTensor {
    expect_row_major(&tensor);
    let CubeTensor {
        client,
        device,
        handle,
        dtype,
        ..
    } = tensor;
    CubeTensor::new_contiguous(client, device, shape, handle, dtype)
}

fn expect_row_major(tensor: &CubeTensor) {
    assert!(
        tensor.is_contiguous(),
        "gpu-tensors: a tensor of shape {:?} has strides {:?}, which is not row-major",
        tensor.meta.shape(),
        tensor.meta.strides()
    );
}

/// A copy of a row-major tensor, which is row-major too.
///
/// # Panics
/// When the tensor is not row-major.
#[must_use]
pub fn copy(tensor: &CubeTensor) -> CubeTensor {
    let shape = tensor.meta.shape().clone();
    shaped(list(tensor.clone()).copy(), shape)
}

/// The tensor in row-major memory that nobody else holds, to be changed in place; copied only when
/// it has to be.
#[must_use]
pub fn own(tensor: CubeTensor) -> CubeTensor {
    let tensor = contiguous(tensor);
    if tensor.can_mut() {
        tensor
    } else {
        copy(&tensor)
    }
}

/// A row-major tensor of the host's values where `like` is.
///
/// # Panics
/// When the shape's product is not the number of values.
#[must_use]
pub fn from_slice<const D: usize>(
    like: &CubeTensor,
    values: &[f32],
    shape: [usize; D],
) -> CubeTensor {
    let expected: usize = shape.iter().product();
    assert_eq!(
        values.len(),
        expected,
        "gpu-tensors: {} values do not fill the shape {shape:?}",
        values.len()
    );
    CubeTensor::new_contiguous(
        like.client.clone(),
        like.device.clone(),
        shape.into(),
        like.client.create_from_slice(f32::as_bytes(values)),
        DType::F32,
    )
}

/// The sum of two row-major tensors of one shape, which is row-major too.
///
/// # Panics
/// When one is not row-major, or they are not of one shape.
#[must_use]
pub fn add(a: CubeTensor, b: CubeTensor) -> CubeTensor {
    let shape = a.meta.shape().clone();
    assert_eq!(&shape, b.meta.shape(), "gpu-tensors: shapes of a sum");
    shaped(numeric::add(list(a), list(b)), shape)
}

/// The tensor's values on the host, row-major: waits for everything that makes them.
#[must_use]
pub fn read(tensor: &CubeTensor) -> Vec<f32> {
    let tensor = contiguous(tensor.clone());
    let count = tensor.meta.shape().num_elements();
    let bytes = tensor.client.read_one_unchecked(tensor.handle.clone());
    f32::from_bytes(&bytes)[..count].to_vec()
}

/// A row-major tensor's memory as a kernel's argument.
///
/// # Panics
/// When the tensor is not row-major, or its values are neither `f32` nor 32-bit integers: kernels index memory as if
/// each took four bytes.
#[must_use]
pub fn buffer(tensor: &CubeTensor) -> BufferArg {
    expect_row_major(tensor);
    assert!(
        matches!(tensor.dtype, DType::F32 | DType::I32 | DType::U32),
        "gpu-tensors: expected a tensor of f32 or of 32-bit integers, not {:?}",
        tensor.dtype
    );
    tensor.clone().into_buffer_arg()
}

/// Numbers from the host in a device's memory, for any number of kernels.
#[derive(Clone, Debug)]
pub struct Uploaded {
    handle: Handle,
    count: usize,
}

impl Uploaded {
    /// Of these values; at least one is always there to bind.
    #[must_use]
    pub fn new<T: CubeElement + Default>(client: &Client, values: &[T]) -> Self {
        let one = [T::default()];
        let values = if values.is_empty() { &one } else { values };
        Self {
            handle: client.create_from_slice(T::as_bytes(values)),
            count: values.len(),
        }
    }

    /// As a kernel's argument.
    #[must_use]
    pub fn argument(&self) -> BufferArg {
        // SAFETY: the handle was made for exactly so many values.
        unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.count) }
    }
}

/// Workgroups of [`UNITS`] threads with at least one thread for each of `items`, spread over the
/// grid's axes where one axis is too short. Threads from `items` on have nothing to do; `items` of
/// zero must not be launched.
///
/// # Panics
/// As [`workgroups`].
#[must_use]
pub fn units_for(client: &Client, items: usize) -> (CubeCount, CubeDim) {
    workgroups(client, items.div_ceil(UNITS as usize), UNITS as usize)
}

/// At least so many workgroups of so many threads, spread likewise; those beyond have nothing to do.
///
/// # Panics
/// When there are more threads than 32 bits number, which is what kernels tell them apart by: launch fewer at once.
#[must_use]
pub fn workgroups(client: &Client, count: usize, threads: usize) -> (CubeCount, CubeDim) {
    // Before the grid is made, for which the number of workgroups is cut to 32 bits, and of the grid, which may have more.
    expect_numbered([count], threads);
    let dim = CubeDim::new_1d(threads as u32);
    let grid = calculate_cube_count_elemwise(client, count * threads, dim);
    if let CubeCount::Static(x, y, z) = grid {
        expect_numbered([x, y, z].map(|along| along as usize), threads);
    }
    (grid, dim)
}

/// Panics unless each thread of a grid of workgroups has a number of its own.
fn expect_numbered<const D: usize>(grid: [usize; D], threads: usize) {
    const MOST: u128 = 1 << 32;
    let all = grid.iter().fold(threads as u128, |all, along| {
        all.saturating_mul(*along as u128)
    });
    assert!(
        all <= MOST,
        "gpu-tensors: a kernel numbers up to 2^32 threads, not {all}; launch fewer at once"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_points_are_taken_at_once_as_a_device_binds() {
        let bytes = 128 << 20;
        for rows in [1, 8, 9, 136, 257, 272, 1040, 4112] {
            let points = points_within(bytes, rows);
            let size = |points: usize| (points * padded(rows) * size_of::<f32>()) as u64;
            assert!(points.is_multiple_of(BLOCK) && size(points) <= bytes);
            assert!(points == 1 << 17 || size(points + BLOCK) > bytes, "{rows}");
        }
        // Fewer than a block do not exist, whatever is bound.
        assert_eq!(points_within(16, 1000), BLOCK);
    }

    #[test]
    fn threads_without_a_number_of_their_own_are_refused() {
        let refused =
            |grid: [usize; 3]| std::panic::catch_unwind(|| expect_numbered(grid, 64)).is_err();
        assert!(!refused([0, 0, 0]));
        assert!(!refused([1 << 26, 1, 1]));
        assert!(refused([(1 << 26) + 1, 1, 1]));
        assert!(!refused([1 << 13, 1 << 13, 1]));
        assert!(refused([1 << 13, 1 << 13, 2]));
        // Cut to 32 bits they would be none, and few.
        assert!(refused([1 << 32, 1, 1]));
        assert!(refused([
            u32::MAX as usize,
            u32::MAX as usize,
            u32::MAX as usize
        ]));
    }
}
