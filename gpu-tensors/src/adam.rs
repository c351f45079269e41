//! A step of Adam for a network's parameter, in one launch.
//!
//! By Burn's tensor operations a parameter takes a dozen launches, each of which costs the host more than such a small
//! tensor costs the device.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn::backend::{BackendTensor, DispatchTensorKind};
use burn::tensor::Tensor;
use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, contiguous, fresh_like, units_for};

/// A step's numbers (Kingma and Ba 2015, algorithm 1, in the order of its section 2's last paragraph).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamRule {
    /// How much of each moment stays.
    pub decay: [f32; 2],
    /// The learning rate with both corrections of bias.
    pub rate: f32,
    /// Epsilon with the second moment's correction.
    pub epsilon: f32,
}

/// The parameter after a step down `gradient`, and its moments, whose last ones `moments` are; `None` before the first step.
///
/// `None` where CubeCL does not run the parameter's device.
///
/// # Panics
/// When the gradient or a moment is of another shape than the parameter.
#[must_use]
pub fn adam_step<const D: usize>(
    parameter: &Tensor<D>,
    gradient: &Tensor<D>,
    moments: Option<[&Tensor<D>; 2]>,
    rule: AdamRule,
) -> Option<[Tensor<D>; 3]> {
    let others = moments.into_iter().flatten().chain([gradient]);
    for other in others {
        assert_eq!(other.dims(), parameter.dims(), "adam_step: shapes");
    }
    let [parameter_there, gradient] = [cube(parameter)?, cube(gradient)?].map(contiguous);
    let before = match moments {
        Some([first, second]) => Some([cube(first)?, cube(second)?].map(contiguous)),
        None => None,
    };
    let results: [CubeTensor; 3] = std::array::from_fn(|_| fresh_like(&parameter_there));
    let count = parameter_there.meta.shape().num_elements();
    if count > 0 {
        let [first, second] = before
            .as_ref()
            .map_or([&gradient; 2], |moments| moments.each_ref());
        let client = &parameter_there.client;
        let (cubes, dim) = units_for(client, count);
        // SAFETY: threads beyond the values return at once, and all tensors have as many.
        unsafe {
            step_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&parameter_there),
                buffer(&gradient),
                buffer(first),
                buffer(second),
                buffer(&results[0]),
                buffer(&results[1]),
                buffer(&results[2]),
                count as u32,
                rule.decay[0],
                rule.decay[1],
                rule.rate,
                rule.epsilon,
                before.is_some(),
            );
        }
    }
    Some(results.map(|result| {
        let mut like = parameter.clone().into_dispatch();
        like.kind = DispatchTensorKind::Cube(BackendTensor::Float(result));
        Tensor::from_dispatch(like)
    }))
}

/// A tensor without history, as kernels see it.
fn cube<const D: usize>(tensor: &Tensor<D>) -> Option<CubeTensor> {
    match tensor.clone().into_dispatch().kind {
        DispatchTensorKind::Cube(BackendTensor::Float(tensor)) => Some(tensor),
        _ => None,
    }
}

/// One thread for each value.
#[cube(launch_unchecked)]
fn step_kernel(
    parameter: &[f32],
    gradient: &[f32],
    first: &[f32],
    second: &[f32],
    stepped: &mut [f32],
    new_first: &mut [f32],
    new_second: &mut [f32],
    count: u32,
    decay1: f32,
    decay2: f32,
    rate: f32,
    epsilon: f32,
    #[comptime] begun: bool,
) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        let g = gradient[at];
        let mut m = (1.0f32 - decay1) * g;
        let mut v = (1.0f32 - decay2) * (g * g);
        if comptime!(begun) {
            m += decay1 * first[at];
            v += decay2 * second[at];
        }
        new_first[at] = m;
        new_second[at] = v;
        stepped[at] = parameter[at] - rate * m / (v.sqrt() + epsilon);
    }
}
