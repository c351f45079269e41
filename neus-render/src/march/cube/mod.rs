//! The op on the GPU: one thread per ray counts its intervals, running sums place them, and one thread per
//! ray writes them.

mod path;
mod walk;

use burn::backend::{
    Cube,
    tensor::{FloatTensor, IntTensor},
};
use gpu_tensors::{
    CubeTensor, buffer, contiguous, contiguous_words, cubecl, fresh, fresh_words, running_sums,
    units_for, zero_words, zeros,
};

use super::{
    MAX_DOUBLINGS,
    device::{March, MarchOps, Shape},
};
use cubecl::prelude::*;
use path::{Grid, GridLaunch, Steps, StepsLaunch, path_of};
use walk::march_once;

impl MarchOps for Cube {
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
    ) {
        let batch = Batch {
            rays: contiguous(rays),
            offsets: contiguous(offsets),
            object: contiguous_words(object),
            background: contiguous_words(background),
            march,
        };
        let out = Out {
            t: zeros(&batch.rays, [march.capacity]),
            dt: zeros(&batch.rays, [march.capacity]),
            flags: zero_words(&batch.rays, [march.capacity]),
        };
        let (ray_offsets, ray_count) = if batch.count() == 0 {
            (zero_words(&batch.rays, [1]), zero_words(&batch.rays, [1]))
        } else {
            let plan = batch.plan(&out);
            batch.write(&plan, &out);
            batch.cut(&plan)
        };
        (ray_offsets, out.t, out.dt, out.flags, ray_count)
    }
}

/// The op's inputs.
struct Batch {
    rays: CubeTensor,
    offsets: CubeTensor,
    object: CubeTensor,
    background: CubeTensor,
    march: March,
}

/// Intervals, all `[capacity]`; zero where nothing is written.
struct Out {
    t: CubeTensor,
    dt: CubeTensor,
    flags: CubeTensor,
}

/// What counting has found.
struct Plan {
    /// How much longer than they should be a ray's steps are; `[rays]`.
    stretches: CubeTensor,
    /// Where a ray's intervals begin and the one before's end, beyond the capacity if need be; `[rays + 1]`.
    starts: CubeTensor,
}

impl Batch {
    fn count(&self) -> usize {
        self.rays.meta.shape()[0]
    }

    /// The first pass. It has the outputs at hand, but does not write to them.
    fn plan(&self, out: &Out) -> Plan {
        let counts = fresh_words(&self.rays, [self.count()]);
        let stretches = fresh(&self.rays, [self.count()]);
        let (cubes, dim) = units_for(&counts.client, self.count());
        // SAFETY: threads beyond the rays return at once; cells are found within their grids.
        unsafe {
            count_kernel::launch_unchecked(
                &counts.client,
                cubes,
                dim,
                buffer(&self.rays),
                buffer(&self.offsets),
                buffer(&self.object),
                buffer(&self.background),
                buffer(&out.t),
                buffer(&out.dt),
                buffer(&out.flags),
                buffer(&counts),
                buffer(&stretches),
                self.count() as u32,
                self.march.most_per_ray,
                self.steps(),
                grid(self.march.object),
                grid(self.march.background),
            );
        }
        Plan {
            stretches,
            // Sums that are too large need not be told apart.
            starts: running_sums(&counts, self.march.capacity as u32 + 1),
        }
    }

    /// The second pass, over rays that fit.
    fn write(&self, plan: &Plan, out: &Out) {
        let client = &self.rays.client;
        let (cubes, dim) = units_for(client, self.count());
        // SAFETY: as in the first pass; a ray writes between its start and the next one's, and only where that
        // is within the capacity.
        unsafe {
            write_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&self.rays),
                buffer(&self.offsets),
                buffer(&self.object),
                buffer(&self.background),
                buffer(&plan.stretches),
                buffer(&plan.starts),
                buffer(&out.t),
                buffer(&out.dt),
                buffer(&out.flags),
                self.count() as u32,
                self.march.capacity as u32,
                self.steps(),
                grid(self.march.object),
                grid(self.march.background),
            );
        }
    }

    /// The offsets of the rays `[rays + 1]` without intervals of those that do not fit, and how many do `[1]`.
    fn cut(&self, plan: &Plan) -> (CubeTensor, CubeTensor) {
        let ray_offsets = fresh_words(&self.rays, [self.count() + 1]);
        let ray_count = fresh_words(&self.rays, [1]);
        let client = &self.rays.client;
        let (cubes, dim) = units_for(client, self.count() + 1);
        // SAFETY: threads beyond the offsets return at once.
        unsafe {
            cut_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&plan.starts),
                buffer(&ray_offsets),
                buffer(&ray_count),
                self.count() as u32,
                self.march.capacity as u32,
            );
        }
        (ray_offsets, ray_count)
    }

    fn steps(&self) -> StepsLaunch {
        StepsLaunch::new(
            self.march.step_object,
            self.march.stride,
            self.march.step_outside,
            u32::from(self.march.behind_box),
            self.march.near,
            self.march.far,
        )
    }
}

fn grid(shape: Shape) -> GridLaunch {
    let scale = shape.resolution as f32 / (2.0 * shape.half);
    GridLaunch::new(shape.resolution, shape.half, scale)
}

/// One thread per ray: how many intervals it has, with steps so long that they are no more than `most`.
#[cube(launch_unchecked)]
fn count_kernel(
    rays: &[f32],
    offsets: &[f32],
    object: &[u32],
    background: &[u32],
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    counts: &mut [u32],
    stretches: &mut [f32],
    ray_count: u32,
    most: u32,
    steps: Steps,
    of_object: Grid,
    of_background: Grid,
) {
    let ray = ABSOLUTE_POS;
    if ray < ray_count as usize {
        let path = path_of(rays, ray, &steps);
        let mut count = most + 1;
        let mut stretch = 0.5f32;
        let mut attempts = 0u32;
        while count > most && attempts <= MAX_DOUBLINGS {
            stretch *= 2.0f32;
            attempts += 1;
            count = march_once(
                &path,
                object,
                background,
                t,
                dt,
                flags,
                0u32,
                // One more tells that there are too many.
                most + 1,
                offsets[ray],
                stretch,
                &steps,
                &of_object,
                &of_background,
                false,
            );
        }
        counts[ray] = min(count, most);
        stretches[ray] = stretch;
    }
}

/// One thread per ray: its intervals, as many as were counted.
#[cube(launch_unchecked)]
fn write_kernel(
    rays: &[f32],
    offsets: &[f32],
    object: &[u32],
    background: &[u32],
    stretches: &[f32],
    starts: &[u32],
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    ray_count: u32,
    capacity: u32,
    steps: Steps,
    of_object: Grid,
    of_background: Grid,
) {
    let ray = ABSOLUTE_POS;
    if ray < ray_count as usize {
        let (start, end) = (starts[ray], starts[ray + 1]);
        if start < end && end <= capacity {
            let path = path_of(rays, ray, &steps);
            march_once(
                &path,
                object,
                background,
                t,
                dt,
                flags,
                start,
                end - start,
                offsets[ray],
                stretches[ray],
                &steps,
                &of_object,
                &of_background,
                true,
            );
        }
    }
}

/// One thread per offset: its own, or the last one that is within the capacity, which tells how many rays fit.
#[cube(launch_unchecked)]
fn cut_kernel(
    starts: &[u32],
    ray_offsets: &mut [u32],
    fitting: &mut [u32],
    ray_count: u32,
    capacity: u32,
) {
    let i = ABSOLUTE_POS;
    if i <= ray_count as usize {
        // Offsets ascend from zero: the last that fits is in `low..high`, or is `i` itself.
        let mut low = i;
        let mut high = i + 1;
        if starts[i] > capacity {
            low = 0;
            high = i;
        }
        while high - low > 1 {
            let middle = (low + high) / 2;
            if starts[middle] <= capacity {
                low = middle;
            } else {
                high = middle;
            }
        }
        ray_offsets[i] = starts[low];
        if i == ray_count as usize {
            fitting[0] = low as u32;
        }
    }
}
