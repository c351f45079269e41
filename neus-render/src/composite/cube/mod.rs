//! The op on the GPU: one workgroup per ray, front to back, and for gradients back to front again.
//!
//! A thread takes an interval. What it needs to know of others, which is how much light is left and what lies
//! behind, it gets through the workgroup's memory, so that a ray takes hardly longer than an interval.

mod backward;
mod forward;
mod interval;
mod opacity;
mod workgroup;

use std::sync::{Arc, OnceLock};

use burn::backend::{Cube, tensor::FloatTensor};
use gpu_tensors::{
    CubeDevice, CubeTensor, Uploaded, buffer, column_sums, constant, contiguous, cubecl, fresh,
    units_for, zeros,
};

use super::{
    CompositeConfig, CompositeOps, MatteRole, Packing, Transparency,
    autodiff::{CompositeBackwardOps, CompositeGradients},
    check_shapes, column,
};
use cubecl::prelude::*;
use interval::NO_ROW;
use opacity::{Kind, Parameters};
use workgroup::UNITS;

/// Transmittances kept for each interval on the way back: of each field alone.
const KEPT: usize = 2;

impl CompositeOps for Cube {
    fn composite(
        object: FloatTensor<Self>,
        background: FloatTensor<Self>,
        sharpness: FloatTensor<Self>,
        packing: Arc<Packing>,
        config: CompositeConfig,
    ) -> FloatTensor<Self> {
        check([&object, &background, &sharpness], &packing);
        let out = fresh(&sharpness, [packing.ray_count(), column::COUNT]);
        if packing.ray_count() == 0 {
            return out;
        }
        let client = &out.client;
        let (count, dim) = units_for(client, packing.ray_count() * UNITS);
        let batch = Batch::new(&packing, config, [&object, &background]);
        let lists = packing.on_device.lists(&packing, &out);
        // SAFETY: workgroups beyond the rays read and write nothing, a packing is checked when made, and `check` has seen
        // that the rows are its own.
        unsafe {
            forward::forward_kernel::launch_unchecked(
                client,
                count,
                dim,
                rows(object),
                rows(background),
                buffer(&contiguous(sharpness)),
                lists.index.argument(),
                lists.times.argument(),
                lists.marks.argument(),
                buffer(&out),
                batch.starts(),
                config.cos_anneal,
                config.epsilon.ln(),
                batch.kinds,
            );
        }
        out
    }
}

impl CompositeBackwardOps for Cube {
    fn composite_backward(
        inputs: [FloatTensor<Self>; 3],
        grad: FloatTensor<Self>,
        packing: Arc<Packing>,
        config: CompositeConfig,
    ) -> CompositeGradients<Self> {
        let [object, background, sharpness] = inputs;
        check([&object, &background, &sharpness], &packing);
        let rays = packing.ray_count();
        assert_eq!(
            grad.meta.shape()[..],
            [rays, column::COUNT],
            "composite: the pixels' gradient"
        );
        let batch = Batch::new(&packing, config, [&object, &background]);
        let d_object = zeros(
            &sharpness,
            [packing.object().len(), batch.kinds.object_width],
        );
        let d_background = zeros(
            &sharpness,
            [packing.background().len(), batch.kinds.background_width],
        );
        let d_sharpness = fresh(&sharpness, [rays, 2]);
        let kept = fresh(&sharpness, [packing.interval_count().max(1), KEPT]);
        if rays > 0 {
            let client = &kept.client;
            let (count, dim) = units_for(client, rays * UNITS);
            let lists = packing.on_device.lists(&packing, &kept);
            // SAFETY: as in the forward pass.
            unsafe {
                backward::backward_kernel::launch_unchecked(
                    client,
                    count,
                    dim,
                    rows(object),
                    rows(background),
                    buffer(&contiguous(sharpness)),
                    lists.index.argument(),
                    lists.times.argument(),
                    lists.marks.argument(),
                    buffer(&contiguous(grad)),
                    buffer(&kept),
                    rows(d_object.clone()),
                    rows(d_background.clone()),
                    buffer(&d_sharpness),
                    batch.starts(),
                    config.cos_anneal,
                    config.epsilon.ln(),
                    batch.kinds,
                );
            }
        }
        CompositeGradients {
            object: d_object,
            background: d_background,
            sharpness: column_sums(&d_sharpness, 0, 2),
        }
    }
}

/// [`check_shapes`] for a device's tensors.
fn check(tensors: [&CubeTensor; 3], packing: &Packing) {
    check_shapes(tensors.map(|tensor| &tensor.meta.shape()[..]), packing);
}

/// A field's rows as a kernel's argument: there must be something to bind.
fn rows(tensor: CubeTensor) -> BufferArg {
    if tensor.meta.shape()[0] == 0 {
        constant(&tensor, &[0.0f32])
    } else {
        buffer(&contiguous(tensor))
    }
}

/// Both fields' kinds, the kernels' constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Kinds {
    object: Kind,
    background: Kind,
    object_width: usize,
    background_width: usize,
    matte: MatteRole,
    marked: bool,
}

/// A packing's lists in a device's memory, as the kernels read them.
#[derive(Clone, Debug)]
struct Lists {
    device: CubeDevice,
    /// Ray offsets, then the object's and the background's row of each interval, or [`NO_ROW`].
    index: Uploaded,
    /// Midpoint and length of each interval.
    times: Uploaded,
    /// The object's marks, then the background's; one zero where there are none.
    marks: Uploaded,
}

impl Lists {
    /// Where `like` is.
    fn new(packing: &Packing, like: &CubeTensor) -> Self {
        let intervals = packing.interval_count();
        let offsets = packing.ray_offsets();
        let mut index = Vec::with_capacity(offsets.len() + 2 * intervals);
        index.extend_from_slice(offsets);
        index.resize(offsets.len() + 2 * intervals, NO_ROW);
        let rows = &mut index[offsets.len()..];
        for (field, list) in [packing.object(), packing.background()].iter().enumerate() {
            for (row, interval) in list.iter().enumerate() {
                rows[2 * *interval as usize + field] = row as u32;
            }
        }
        let times = packing.t().iter().zip(packing.dt());
        let times: Vec<[f32; 2]> = times.map(|(t, dt)| [*t, *dt]).collect();
        let marks: Vec<f32> = packing.marks().map_or_else(Vec::new, |marks| {
            let all = marks.object.iter().chain(&marks.background);
            all.flatten().copied().collect()
        });
        Self {
            device: like.device.clone(),
            index: Uploaded::new(&like.client, &index),
            times: Uploaded::new(&like.client, times.as_flattened()),
            marks: Uploaded::new(&like.client, &marks),
        }
    }
}

/// A packing's lists on the device that first needed them.
#[derive(Clone, Debug, Default)]
pub(super) struct OnDevice(OnceLock<Lists>);

impl PartialEq for OnDevice {
    /// Where a packing has been does not make it another.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl OnDevice {
    /// The lists of `packing`, which this belongs to, where `like` is.
    fn lists(&self, packing: &Packing, like: &CubeTensor) -> Lists {
        let lists = self.0.get_or_init(|| Lists::new(packing, like));
        if lists.device == like.device {
            lists.clone()
        } else {
            Lists::new(packing, like)
        }
    }
}

/// What the kernels need to know of a packing beside its [`Lists`].
struct Batch {
    rays: u32,
    objects: u32,
    kinds: Kinds,
}

impl Batch {
    fn new(packing: &Packing, config: CompositeConfig, rows: [&CubeTensor; 2]) -> Self {
        let [object_width, background_width] = rows.map(|rows| rows.meta.shape()[1]);
        let kind = |transparency| Kind {
            density: transparency == Transparency::Density,
            epsilon: config.epsilon != 0.0,
        };
        Self {
            rays: packing.ray_count() as u32,
            objects: packing.object().len() as u32,
            kinds: Kinds {
                object: kind(config.object),
                background: kind(config.background),
                object_width,
                background_width,
                matte: config.matte,
                marked: packing.marks().is_some(),
            },
        }
    }

    fn starts(&self) -> StartsLaunch {
        StartsLaunch::new(self.rays, self.objects)
    }
}

/// What a kernel needs to find its way in [`Lists`].
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Starts {
    rays: u32,
    objects: u32,
}

/// Both fields' parameters.
#[cube]
fn parameters(sharpness: &[f32], field: usize, cos_anneal: f32, log_epsilon: f32) -> Parameters {
    Parameters {
        sharpness: sharpness[field],
        cos_anneal,
        log_epsilon,
    }
}
