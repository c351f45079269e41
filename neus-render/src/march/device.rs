//! Marching on a GPU: rays in, packed intervals out, and nothing in between comes back to the host.
//!
//! For renderers that stay on the device. Training on a GPU marches on the CPU, which gathers a batch while the
//! device works on the one before.

use burn::{
    backend::{
        Backend, Dispatch, backend_extension,
        tensor::{FloatTensor, IntTensor},
    },
    tensor::{DType, Device, Int, Tensor, TensorData},
};

use super::{CLEARANCE, MarchConfig};
use crate::{occupancy::DeviceBits, rays::Ray};

/// As [`Grids`](super::Grids), on a GPU.
#[derive(Clone, Copy, Debug, Default)]
pub struct DeviceGrids<'a> {
    /// The object's, over the box [-1, 1]^3, as in [`Grids::object`](super::Grids::object).
    pub object: Option<&'a DeviceBits>,
    /// The background's, over contracted space [-2, 2]^3.
    pub background: Option<&'a DeviceBits>,
}

/// As [`Intervals`](super::Intervals), on a GPU, where a fixed number of places is there for them.
#[derive(Clone, Debug)]
pub struct DeviceIntervals {
    /// Ray `i` has the intervals `ray_offsets[i]..ray_offsets[i + 1]`; `[rays + 1]`, of which the last is `n`.
    pub ray_offsets: Tensor<1, Int>,
    /// Midpoints, ascending within a ray; `[capacity]`, zero from `n` on.
    pub t: Tensor<1>,
    /// Lengths; `[capacity]`, zero from `n` on.
    pub dt: Tensor<1>,
    /// Which fields are to be evaluated, [`OBJECT`](Self::OBJECT) and [`BACKGROUND`](Self::BACKGROUND); `[capacity]`,
    /// zero from `n` on.
    pub flags: Tensor<1, Int>,
    /// How many rays have all of their intervals here; those behind them have none. `[1]`.
    pub ray_count: Tensor<1, Int>,
}

impl DeviceIntervals {
    /// The bit of the object in [`flags`](Self::flags).
    pub const OBJECT: u32 = 1;
    /// The bit of the background.
    pub const BACKGROUND: u32 = 2;
}

/// Rays as [`march_on_device`] takes them: origin and direction; `[rays, 6]`.
pub fn rays_on(device: &Device, rays: &[Ray]) -> Tensor<2> {
    let values: Vec<f32> = rays
        .iter()
        .flat_map(|ray| [ray.origin.to_array(), ray.direction.to_array()])
        .flatten()
        .collect();
    Tensor::from_data(
        TensorData::new(values, [rays.len(), 6]),
        (device, DType::F32),
    )
}

/// [`Marcher::march`](super::Marcher::march) on a GPU: the intervals of `rays` `[rays, 6]`, each the origin and the
/// unit direction.
///
/// At most `capacity` intervals are kept, so that nothing has to wait for their number: rays are cut off, as a whole
/// and from the end of the batch, until the others' fit. Devices round in their own ways: where an interval's midpoint
/// lies on a cell's face, it can be found there and not on the CPU, or the other way round.
///
/// # Panics
/// When the rays' shape is another, the capacity is zero or above `i32::MAX - 1`, a step has no length, there are more
/// than 2^20 background samples, the background would be marched from or to infinity (see [`MarchConfig::far`]), or
/// the device is not one of CubeCL's.
pub fn march_on_device(
    rays: Tensor<2>,
    grids: DeviceGrids<'_>,
    config: &MarchConfig,
    capacity: usize,
) -> DeviceIntervals {
    let [count, columns] = rays.dims();
    assert_eq!(
        columns, 6,
        "march_on_device: rays have {columns} columns, not 6"
    );
    assert!(
        (1..i32::MAX as usize).contains(&capacity),
        "march_on_device: a capacity of {capacity} intervals"
    );
    assert!(
        config.background_samples <= MOST_SAMPLES,
        "march_on_device: {} background samples are more than {MOST_SAMPLES}",
        config.background_samples
    );
    config.check("march_on_device", grids.background.is_some());
    let rays = rays.without_autodiff();
    let device = rays.device();
    let offsets: Vec<f32> = (0..count).map(|ray| config.jitter.offset(ray)).collect();
    let offsets = TensorData::new(offsets, [count]);
    let offsets = Tensor::<1>::from_data(offsets, (&device, DType::F32));
    let words = |grid: Option<&DeviceBits>| match grid {
        Some(grid) => grid.words().clone(),
        // There must be something to bind.
        None => Tensor::zeros([1], (&device, DType::I32)),
    };
    let (ray_offsets, t, dt, flags, ray_count) = Dispatch::march(
        rays.into_dispatch(),
        offsets.into_dispatch(),
        words(grids.object).into_dispatch(),
        words(grids.background).into_dispatch(),
        March::new(grids, config, capacity),
    );
    DeviceIntervals {
        ray_offsets: Tensor::from_dispatch(ray_offsets),
        t: Tensor::from_dispatch(t),
        dt: Tensor::from_dispatch(dt),
        flags: Tensor::from_dispatch(flags),
        ray_count: Tensor::from_dispatch(ray_count),
    }
}

/// Raster lines outside the box are counted in `f32`.
const MOST_SAMPLES: u32 = 1 << 20;

/// Intervals of a ray; more need more memory than devices have.
const MOST_INTERVALS: usize = 1 << 30;

/// What kernels march by.
#[derive(Clone, Copy, Debug)]
pub(super) struct March {
    pub(super) object: Shape,
    pub(super) background: Shape,
    pub(super) step_object: f32,
    pub(super) stride: u32,
    /// Spacing of the raster outside the box.
    pub(super) step_outside: f32,
    pub(super) behind_box: bool,
    pub(super) near: f32,
    pub(super) far: f32,
    pub(super) most_per_ray: u32,
    pub(super) capacity: usize,
}

/// A grid's resolution, zero where there is none, and half its edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) resolution: u32,
    pub(super) half: f32,
}

impl March {
    fn new(grids: DeviceGrids<'_>, config: &MarchConfig, capacity: usize) -> Self {
        let shape = |grid: Option<&DeviceBits>| Shape {
            resolution: grid.map_or(0, DeviceBits::resolution),
            half: grid.map_or(1.0, DeviceBits::half),
        };
        Self {
            object: shape(grids.object),
            background: shape(grids.background),
            step_object: config.step_object,
            stride: config.background_stride.clamp(1, CLEARANCE as u32),
            step_outside: 1.0 / config.background_samples.max(1) as f32,
            behind_box: config.behind_box,
            near: config.near,
            far: config.far,
            most_per_ray: config.max_intervals_per_ray.min(MOST_INTERVALS) as u32,
            capacity,
        }
    }
}

/// The op on a GPU's tensors; use [`march_on_device`].
#[backend_extension(Cube)]
pub(super) trait MarchOps: Backend {
    /// See [`march_on_device`]: rays `[rays, 6]`, their offsets `[rays]` and both grids' words to
    /// [`DeviceIntervals`]' fields in their order.
    #[allow(clippy::type_complexity)] // the macro routes tensors as plain tuples
    fn march(
        rays: FloatTensor<Self>,
        offsets: FloatTensor<Self>,
        object: IntTensor<Self>,
        background: IntTensor<Self>,
        march: March,
    ) -> (
        IntTensor<Self>,
        FloatTensor<Self>,
        FloatTensor<Self>,
        IntTensor<Self>,
        IntTensor<Self>,
    );
}
