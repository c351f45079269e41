//! On a device the gradient is dense: kernels add to it with atomics, and [`LazyAdam`](crate::LazyAdam) zeroes what it
//! uses up.

use gpu_tensors::CubeTensor;

use super::buffer::{Buffer, Taken};
use super::{BLOCK_VALUES, SparseGrad};
use crate::layout::FEATURES;

impl SparseGrad {
    /// Hands the gradient `[entries, 2]` on the device of `like` to `add`, which may change it.
    ///
    /// What lies on the host or on another device goes there first. Where another call is at work, this is a gradient of its
    /// own, which is added to the other's afterwards.
    pub fn accumulate_on_device<R>(
        &self,
        like: &CubeTensor,
        add: impl FnOnce(&CubeTensor) -> R,
    ) -> R {
        self.on_device(self.shared.take(), like, add)
    }

    /// The same with all of the gradient, once nobody else is at work.
    pub(crate) fn use_up_on_device<R>(
        &self,
        like: &CubeTensor,
        change: impl FnOnce(&CubeTensor) -> R,
    ) -> R {
        self.on_device(self.shared.take_all(), like, change)
    }

    fn on_device<R>(
        &self,
        mut buffer: Taken<'_>,
        like: &CubeTensor,
        change: impl FnOnce(&CubeTensor) -> R,
    ) -> R {
        buffer.settle();
        let shape = [self.entries, FEATURES];
        let is_elsewhere = |device: &CubeTensor| device.device != like.device;
        if buffer.device.as_ref().is_some_and(is_elsewhere) || buffer.touched.contains(&1) {
            buffer.come_home();
        }
        let gradient = match buffer.device.take() {
            Some(gradient) => gradient,
            None if buffer.touched.contains(&1) => {
                let gradient = gpu_tensors::from_slice(like, &buffer.values, shape);
                buffer.values.fill(0.0);
                buffer.touched.fill(0);
                gradient
            }
            None => gpu_tensors::zeros(like, shape),
        };
        let out = change(&gradient);
        buffer.device = Some(gradient);
        out
    }
}

impl Buffer {
    /// Adds what a device holds to the host's values.
    pub(super) fn come_home(&mut self) {
        let Some(device) = self.device.take() else {
            return;
        };
        let added = gpu_tensors::read(&device);
        self.allocate();
        let blocks = self.values.chunks_exact_mut(BLOCK_VALUES);
        let blocks = blocks.zip(added.chunks_exact(BLOCK_VALUES));
        for ((values, added), touched) in blocks.zip(&mut self.touched) {
            if added.iter().any(|value| *value != 0.0) {
                *touched = 1;
                for (value, added) in values.iter_mut().zip(added) {
                    *value += added;
                }
            }
        }
    }

    /// Adds what another share of the gradient has on a device.
    pub(super) fn merge_device(&mut self, other: CubeTensor) {
        self.device = Some(match self.device.take() {
            Some(own) if own.device == other.device => gpu_tensors::add(own, other),
            Some(own) => {
                self.device = Some(own);
                self.come_home();
                other
            }
            None => other,
        });
    }
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use burn::Tensor;
    use burn::backend::DispatchTensorKind;

    use super::*;
    use crate::config::GridConfig;
    use crate::layout::GridLayout;

    /// `None` where there is no device and that is allowed, as in `tests/gpu_parity`.
    fn like() -> Option<CubeTensor> {
        let adapters = gpu_tensors::adapters();
        let Some(device) = adapters.iter().find_map(|adapter| adapter.device()) else {
            assert!(
                std::env::var_os("SOS_REQUIRE_GPU").is_none(),
                "SOS_REQUIRE_GPU is set, but this build finds no device"
            );
            return None;
        };
        match Tensor::<1>::zeros([1], &device).into_dispatch().kind {
            DispatchTensorKind::Cube(like) => Some(like.float()),
            _ => panic!("the device under test is not CubeCL's"),
        }
    }

    #[test]
    fn shares_on_the_host_and_on_a_device_come_together() {
        let Some(like) = like() else {
            return;
        };
        let layout = GridLayout::new(&GridConfig {
            levels: 2,
            log2_table_size: 10,
            ..GridConfig::default()
        });
        let gradient = SparseGrad::new(&layout);
        let add = || gradient.accumulate_levels(&layout, 2, |_, grad| grad[3] += 1.0);
        let defer = || {
            gradient.defer_levels(&layout, 2, |_, grad, touched| {
                grad[3] += 1.0;
                touched[0] = 1;
            });
        };
        let move_there = || gradient.accumulate_on_device(&like, gpu_tensors::read);
        add();
        assert_eq!(move_there()[3], 1.0);
        // One waits on the host while the first is on the device.
        defer();
        assert_eq!(move_there()[3], 2.0);
        // Two are added while a call is at work, which has the others.
        let inner = gradient.accumulate_on_device(&like, |_| {
            add();
            let inner = move_there();
            defer();
            inner
        });
        assert_eq!(inner[3], 1.0);
        let all = gradient.use_up_on_device(&like, gpu_tensors::read);
        assert_eq!((all[3], all.iter().sum::<f32>()), (4.0, 8.0));
        assert_eq!(gradient.to_dense(), all);
    }
}
