//! Grids on a GPU: the bits that [`march_on_device`](crate::march::march_on_device) reads, and cells that are
//! renewed where they lie.
//!
//! Bits are words of 32 cells, bit `i` of word `w` being cell `32 w + i`.

use burn::{
    backend::{
        Backend, Dispatch, backend_extension,
        tensor::{FloatTensor, IntTensor},
    },
    tensor::{DType, Device, Int, Tensor, TensorData},
};

use super::OccupancyGrid;

/// Which cells of a grid are occupied, on a GPU.
#[derive(Clone, Debug)]
pub struct DeviceBits {
    resolution: u32,
    half: f32,
    /// `[words]`.
    words: Tensor<1, Int>,
}

impl DeviceBits {
    /// A copy of `grid`'s bits on `device`.
    pub fn upload(grid: &OccupancyGrid, device: &Device) -> Self {
        Self {
            resolution: grid.resolution,
            half: grid.half,
            words: words_on(device, &grid.bits),
        }
    }

    /// Cells per axis.
    pub fn resolution(&self) -> u32 {
        self.resolution
    }

    /// Half the edge of the cube.
    pub fn half(&self) -> f32 {
        self.half
    }

    /// The bits, a word for 32 cells; two words for each 64 cells begun.
    pub fn words(&self) -> &Tensor<1, Int> {
        &self.words
    }
}

/// An [`OccupancyGrid`] on a GPU: values, bits and protected cells.
///
/// Nothing of it comes back to the host unless asked for. A value is four bytes on a device whose buffers have
/// a limit: 128 MiB, which every device can bind, hold the values of 322^3 cells, and the bits of 1024^3.
#[derive(Clone, Debug)]
pub struct DeviceOccupancy {
    decay: f32,
    /// `[resolution^3]`.
    values: Tensor<1>,
    /// As the bits.
    protected: Tensor<1, Int>,
    bits: DeviceBits,
}

impl DeviceOccupancy {
    /// A copy of `grid` on `device`.
    pub fn upload(grid: &OccupancyGrid, device: &Device) -> Self {
        let device = &device.clone().inner();
        let bits = DeviceBits::upload(grid, device);
        let protected = match &grid.protected {
            Some(protected) => words_on(device, protected),
            None => bits.words.zeros_like(),
        };
        let values = TensorData::new(grid.values.clone(), [grid.values.len()]);
        Self {
            decay: grid.decay,
            values: Tensor::from_data(values, (device, DType::F32)),
            protected,
            bits,
        }
    }

    /// [`OccupancyGrid::update`] on the device: `values` `[n]` are news of `cells` `[n]`.
    ///
    /// A cell that is named twice fades twice and keeps the larger news, in one of the possible orders. Cells that
    /// don't exist are left out: the device has nobody to tell.
    ///
    /// # Panics
    /// When the lengths differ, or the device is not one of CubeCL's.
    #[must_use]
    pub fn update(self, cells: Tensor<1, Int>, values: Tensor<1>) -> Self {
        let (cell_count, value_count) = (cells.dims()[0], values.dims()[0]);
        assert_eq!(
            cell_count, value_count,
            "DeviceOccupancy::update: {cell_count} cells but {value_count} values"
        );
        let values = Dispatch::occupancy_update(
            self.values.into_dispatch(),
            cells.without_autodiff().into_dispatch(),
            values.without_autodiff().into_dispatch(),
            self.decay,
        );
        Self {
            values: Tensor::from_dispatch(values),
            ..self
        }
    }

    /// [`OccupancyGrid::rebuild_bits`] on the device.
    ///
    /// # Panics
    /// When the device is not one of CubeCL's.
    #[must_use]
    pub fn rebuild_bits(mut self, threshold: f32) -> Self {
        self.bits.words = Tensor::from_dispatch(Dispatch::occupancy_bits(
            self.values.clone().into_dispatch(),
            self.protected.clone().into_dispatch(),
            threshold,
        ));
        self
    }

    /// What marching reads.
    pub fn bits(&self) -> &DeviceBits {
        &self.bits
    }

    /// The values of all cells; `[resolution^3]`.
    pub fn values(&self) -> &Tensor<1> {
        &self.values
    }
}

/// Words of 64 cells as twice as many of 32.
fn words_on(device: &Device, bits: &[u64]) -> Tensor<1, Int> {
    let words: Vec<i32> = bits
        .iter()
        .flat_map(|word| [*word as u32 as i32, (word >> 32) as u32 as i32])
        .collect();
    let count = words.len();
    let device = &device.clone().inner();
    Tensor::from_data(TensorData::new(words, [count]), (device, DType::I32))
}

/// Grids' ops on a GPU's tensors; use [`DeviceOccupancy`].
#[backend_extension(Cube)]
pub(super) trait OccupancyOps: Backend {
    /// See [`DeviceOccupancy::update`]: values `[resolution^3]`, cells and their news `[n]`; in place when this is
    /// the values' only owner.
    fn occupancy_update(
        values: FloatTensor<Self>,
        cells: IntTensor<Self>,
        news: FloatTensor<Self>,
        decay: f32,
    ) -> FloatTensor<Self>;

    /// See [`DeviceOccupancy::rebuild_bits`]: values `[resolution^3]` and protected cells' words to words.
    fn occupancy_bits(
        values: FloatTensor<Self>,
        protected: IntTensor<Self>,
        threshold: f32,
    ) -> IntTensor<Self>;
}
