//! The same in plain tensor operations, which Burn differentiates: the oracle of the kernel.
//!
//! Rays are padded to the longest, so that products along rays are cumulative sums of logarithms
//! over a dense [rays, longest].

use burn::tensor::{Int, Tensor, TensorData, activation};

use super::{
    CompositeConfig, MatteRole, Packing, Transparency, background_column, column, object_column,
};

/// [`composite`](super::composite) in plain tensor operations; slow, for tests and for reading.
///
/// Matte values of exactly one where the object is opaque to the last bit make the logarithm's
/// derivative infinite here; the kernel bounds it.
pub fn composite_reference(
    object: Tensor<2>,
    background: Tensor<2>,
    sharpness: Tensor<1>,
    packing: &Packing,
    config: CompositeConfig,
) -> Tensor<2> {
    super::check_shapes(
        [&object.dims(), &background.dims(), &sharpness.dims()],
        packing,
    );
    let device = object.device();
    let grid = Dense::new(packing, &device);
    if grid.longest == 0 {
        let zeros = Tensor::zeros([packing.ray_count(), column::COUNT], &object.device());
        // Keeps the result tied to the inputs.
        return zeros + sharpness.sum().reshape([1, 1]) * 0.0;
    }
    let f = grid.spread(object, packing.object());
    let b = grid.spread(background, packing.background());
    let s_f = sharpness.clone().narrow(0, 0, 1).reshape([1, 1]);
    let s_b = sharpness.narrow(0, 1, 1).reshape([1, 1]);

    let column_of = |x: &Tensor<3>, i: usize| -> Tensor<2> {
        let [rays, longest, _] = x.dims();
        x.clone()
            .slice([0..rays, 0..longest, i..i + 1])
            .reshape([rays, longest])
    };
    let bare_f = log_survival(
        column_of(&f.values, object_column::SDF),
        column_of(&f.values, object_column::SLOPE),
        grid.dt.clone(),
        s_f,
        config.object,
        config,
    ) * f.present.clone();
    let log_b = log_survival(
        column_of(&b.values, background_column::SDF),
        column_of(&b.values, background_column::SLOPE),
        grid.dt.clone(),
        s_b,
        config.background,
        config,
    ) * b.present;
    let values = column_of(&f.values, object_column::MATTE);
    let (matte, head) = match config.matte {
        MatteRole::Unused => (f.present.clone(), f.present.clone()),
        MatteRole::Opacity => (values, f.present.clone()),
        MatteRole::Colour => (f.present.clone(), values),
    };
    // 1 - m a with a = 1 - exp(bare); where the field is absent, m = 0 and a = 0.
    let survival_f = (matte.clone().neg() + 1.0) + matte.clone() * bare_f.clone().exp();
    let log_f = survival_f.log();

    let a_f = matte * (bare_f.exp().neg() + 1.0);
    let a_b = log_b.clone().exp().neg() + 1.0;
    let before_f = exclusive_sum(log_f.clone());
    let before_b = exclusive_sum(log_b.clone());
    let alone_f = before_f.clone().exp() * a_f.clone();
    let alone_b = before_b.clone().exp() * a_b.clone();
    let joint = (before_f + before_b).exp();
    let w_f = joint.clone() * a_f.clone() * (a_b.clone() * -0.5 + 1.0);
    let w_b = joint * a_b * (a_f * -0.5 + 1.0);

    let sum = |x: Tensor<2>| x.sum_dim(1);
    let blend = |w: &Tensor<2>, values: &Tensor<3>, c: usize| sum(w.clone() * column_of(values, c));
    let mut columns = Vec::with_capacity(column::COUNT);
    let (held, held_alone) = (w_f.clone() * head.clone(), alone_f.clone() * head);
    for c in 0..3 {
        columns.push(
            blend(&held, &f.values, object_column::COLOUR + c)
                + blend(&w_b, &b.values, background_column::COLOUR + c),
        );
    }
    let total_f = sum(log_f);
    let total_b = sum(log_b);
    columns.push(sum(w_f.clone()));
    columns.push(total_f.clone().exp().neg() + 1.0);
    columns.push(total_f.clone());
    for c in 0..3 {
        columns.push(blend(&alone_b, &b.values, background_column::COLOUR + c));
    }
    columns.push(total_b.clone().exp().neg() + 1.0);
    for c in 0..3 {
        columns.push(blend(&held_alone, &f.values, object_column::COLOUR + c));
    }
    columns.push(sum((w_f.clone() + w_b.clone()) * grid.t.clone()));
    columns.push(sum(alone_f * grid.t.clone()));
    columns.push((total_f + total_b).exp().neg() + 1.0);
    for i in 0..2 {
        let Some(marks) = packing.marks() else {
            columns.push(grid.t.zeros_like().sum_dim(1));
            continue;
        };
        let mark = |marks: &[[f32; 2]], intervals: &[u32]| {
            let values: Vec<f32> = marks.iter().map(|mark| mark[i]).collect();
            let rows = Tensor::from_data(TensorData::new(values, [marks.len(), 1]), &device);
            column_of(&grid.spread(rows, intervals).values, 0)
        };
        columns.push(sum(w_f.clone() * mark(&marks.object, packing.object())
            + w_b.clone() * mark(&marks.background, packing.background())));
    }
    for head in [held, held_alone] {
        let blended = sum(head);
        columns.push(match config.matte {
            MatteRole::Colour => blended,
            MatteRole::Unused | MatteRole::Opacity => blended.zeros_like(),
        });
    }
    Tensor::cat(columns, 1)
}

/// `log(1 - a)` without the matte value; all [rays, longest], sharpness [1, 1].
fn log_survival(
    sdf: Tensor<2>,
    slope: Tensor<2>,
    dt: Tensor<2>,
    sharpness: Tensor<2>,
    transparency: Transparency,
    config: CompositeConfig,
) -> Tensor<2> {
    if transparency == Transparency::Density {
        return (activation::relu(sdf) * dt).neg();
    }
    let anneal = config.cos_anneal;
    let soft = activation::relu(slope.clone() * -0.5 + 0.5) * (1.0 - anneal);
    let hard = activation::relu(slope.neg()) * anneal;
    let half = (soft + hard) * dt * 0.5;
    let log_phi = |x: Tensor<2>| activation::log_sigmoid(x);
    let before = log_phi((sdf.clone() + half.clone()) * sharpness.clone());
    let after = log_phi((sdf - half) * sharpness);
    let ratio = after - before.clone();
    if config.epsilon == 0.0 {
        return ratio;
    }
    // Times 1 / (1 + e / Phi(before)).
    ratio + log_phi(before - config.epsilon.ln())
}

/// Sums of everything before each column; [rays, longest].
fn exclusive_sum(x: Tensor<2>) -> Tensor<2> {
    x.clone().cumsum(1) - x
}

/// A batch padded to its longest ray.
struct Dense {
    rays: usize,
    longest: usize,
    /// Slot of every interval in [rays * longest].
    slots: Vec<usize>,
    t: Tensor<2>,
    dt: Tensor<2>,
}

/// A field's samples in the dense layout.
struct Spread {
    /// [rays, longest, columns]; zero where the field has no sample.
    values: Tensor<3>,
    /// One where it has a sample, else zero; [rays, longest].
    present: Tensor<2>,
}

impl Dense {
    fn new(packing: &Packing, device: &burn::tensor::Device) -> Self {
        let rays = packing.ray_count();
        let ranges = || {
            let offsets = packing.ray_offsets().windows(2);
            offsets.map(|range| range[0] as usize..range[1] as usize)
        };
        let longest = ranges().map(|range| range.len()).max().unwrap_or(0);
        let mut slots = vec![0; packing.interval_count()];
        for (ray, range) in ranges().enumerate() {
            for (i, interval) in range.enumerate() {
                slots[interval] = ray * longest + i;
            }
        }
        let spread = |values: &[f32]| {
            let mut dense = vec![0.0f32; rays * longest];
            for (&slot, &value) in slots.iter().zip(values) {
                dense[slot] = value;
            }
            Tensor::from_data(TensorData::new(dense, [rays, longest]), device)
        };
        Self {
            rays,
            longest,
            t: spread(packing.t()),
            dt: spread(packing.dt()),
            slots,
        }
    }

    /// Rows [m, columns] to where their intervals lie.
    fn spread(&self, rows: Tensor<2>, intervals: &[u32]) -> Spread {
        let [count, columns] = rows.dims();
        let device = rows.device();
        // Row `count` is a row of zeros for everything absent.
        let mut index = vec![count as i32; self.rays * self.longest];
        let mut present = vec![0.0f32; index.len()];
        for (row, &interval) in intervals.iter().enumerate() {
            let slot = self.slots[interval as usize];
            index[slot] = row as i32;
            present[slot] = 1.0;
        }
        let shape = [self.rays, self.longest];
        let zeros = Tensor::zeros([1, columns], &device);
        let rows = if count == 0 {
            zeros
        } else {
            Tensor::cat(vec![rows, zeros], 0)
        };
        let len = index.len();
        let index = Tensor::<1, Int>::from_data(TensorData::new(index, [len]), &device);
        Spread {
            values: rows
                .select(0, index)
                .reshape([self.rays, self.longest, columns]),
            present: Tensor::from_data(TensorData::new(present, shape), &device),
        }
    }
}
