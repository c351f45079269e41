//! Steps of Adam for a network's parameters, a few in one launch.
//!
//! By Burn's tensor operations a parameter takes a dozen launches, each of which costs the host more than such a small
//! tensor costs the device.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use std::sync::{Mutex, PoisonError};

use burn::backend::{BackendTensor, DispatchTensorKind};
use burn::tensor::Tensor;
use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, contiguous, fresh_like, own, units_for};

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

/// Steps that were asked for and are launched together: [`AdamSteps::launch`] has to follow before anybody reads them.
#[derive(Debug, Default)]
pub struct AdamSteps(Mutex<Vec<Step>>);

/// A parameter's step. Moments are changed in place.
#[derive(Clone, Debug)]
struct Step {
    before: CubeTensor,
    gradient: CubeTensor,
    first: CubeTensor,
    second: CubeTensor,
    stepped: CubeTensor,
    rule: AdamRule,
    /// Whether there were moments before.
    begun: bool,
}

/// Steps of one launch, where a kernel binds as many buffers.
const TOGETHER: usize = 4;
/// Buffers of a step.
const BUFFERS: usize = 5;

impl AdamSteps {
    /// Asks for a parameter's step down `gradient`. Returns the parameter after it and its moments, whose last ones `moments`
    /// are; `None` before the first step. Moments that nobody else holds stay where they are.
    ///
    /// # Errors
    /// `moments` as they came, where CubeCL does not run the parameter's device.
    ///
    /// # Panics
    /// When the gradient or a moment is of another shape than the parameter, or a moment is elsewhere.
    #[allow(clippy::type_complexity)]
    pub fn ask<const D: usize>(
        &self,
        parameter: &Tensor<D>,
        gradient: &Tensor<D>,
        moments: Option<[Tensor<D>; 2]>,
        rule: AdamRule,
    ) -> Result<[Tensor<D>; 3], Option<[Tensor<D>; 2]>> {
        for other in moments.iter().flatten().chain([gradient]) {
            assert_eq!(other.dims(), parameter.dims(), "AdamSteps: shapes");
        }
        let (Some(before), Some(gradient)) = (cube(parameter.clone()), cube(gradient.clone()))
        else {
            return Err(moments);
        };
        let [before, gradient] = [before, gradient].map(contiguous);
        let begun = moments.is_some();
        let [first, second] = match moments {
            Some(moments) => moments.map(|moment| match cube(moment) {
                Some(moment) => own(moment),
                None => panic!("AdamSteps: a moment is not where the parameter is"),
            }),
            None => std::array::from_fn(|_| fresh_like(&before)),
        };
        let step = Step {
            stepped: fresh_like(&before),
            before,
            gradient,
            first,
            second,
            rule,
            begun,
        };
        let results = [&step.stepped, &step.first, &step.second].map(|result| {
            let mut like = parameter.clone().into_dispatch();
            like.kind = DispatchTensorKind::Cube(BackendTensor::Float(result.clone()));
            Tensor::from_dispatch(like)
        });
        if step.count() > 0 {
            self.0
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(step);
        }
        Ok(results)
    }

    /// Has the device do all steps that were asked for.
    pub fn launch(&self) {
        let asked = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        let alike = asked.chunk_by(|a, b| {
            a.rule == b.rule && a.begun == b.begun && a.before.device == b.before.device
        });
        for steps in alike.flat_map(|steps| steps.chunks(TOGETHER)) {
            match steps.try_into() {
                Ok(together) if binds(together, TOGETHER * BUFFERS) => launch_together(together),
                _ => steps.iter().for_each(launch_one),
            }
        }
    }
}

impl Step {
    fn count(&self) -> usize {
        self.before.meta.shape().num_elements()
    }
}

/// Whether a kernel on their device binds so many buffers, and its scalars.
fn binds(steps: &[Step; TOGETHER], buffers: usize) -> bool {
    steps[0].before.client.properties().hardware.max_bindings as usize > buffers
}

fn launch_one(step: &Step) {
    let (client, rule) = (&step.before.client, step.rule);
    let (cubes, dim) = units_for(client, step.count());
    // SAFETY: threads beyond the values return at once, and all tensors have as many.
    unsafe {
        one_kernel::launch_unchecked(
            client,
            cubes,
            dim,
            buffer(&step.before),
            buffer(&step.gradient),
            buffer(&step.first),
            buffer(&step.second),
            buffer(&step.stepped),
            step.count() as u32,
            rule.decay[0],
            rule.decay[1],
            rule.rate,
            rule.epsilon,
            step.begun,
        );
    }
}

fn launch_together(steps: &[Step; TOGETHER]) {
    let (client, rule) = (&steps[0].before.client, steps[0].rule);
    let counts = steps.each_ref().map(Step::count);
    let (cubes, dim) = units_for(client, counts.iter().sum());
    let [a, b, c, d] = steps.each_ref();
    // SAFETY: as for one.
    unsafe {
        together_kernel::launch_unchecked(
            client,
            cubes,
            dim,
            buffer(&a.before),
            buffer(&a.gradient),
            buffer(&a.first),
            buffer(&a.second),
            buffer(&a.stepped),
            buffer(&b.before),
            buffer(&b.gradient),
            buffer(&b.first),
            buffer(&b.second),
            buffer(&b.stepped),
            buffer(&c.before),
            buffer(&c.gradient),
            buffer(&c.first),
            buffer(&c.second),
            buffer(&c.stepped),
            buffer(&d.before),
            buffer(&d.gradient),
            buffer(&d.first),
            buffer(&d.second),
            buffer(&d.stepped),
            counts[0] as u32,
            counts[1] as u32,
            counts[2] as u32,
            counts[3] as u32,
            rule.decay[0],
            rule.decay[1],
            rule.rate,
            rule.epsilon,
            a.begun,
        );
    }
}

/// A tensor without history, as kernels see it.
fn cube<const D: usize>(tensor: Tensor<D>) -> Option<CubeTensor> {
    match tensor.into_dispatch().kind {
        DispatchTensorKind::Cube(BackendTensor::Float(tensor)) => Some(tensor),
        _ => None,
    }
}

/// One thread for each value.
#[cube(launch_unchecked)]
fn one_kernel(
    parameter: &[f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    stepped: &mut [f32],
    count: u32,
    decay1: f32,
    decay2: f32,
    rate: f32,
    epsilon: f32,
    #[comptime] begun: bool,
) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        step_at(
            parameter, gradient, first, second, stepped, at, decay1, decay2, rate, epsilon, begun,
        );
    }
}

/// One thread for each value of all four.
#[cube(launch_unchecked)]
fn together_kernel(
    parameter_a: &[f32],
    gradient_a: &[f32],
    first_a: &mut [f32],
    second_a: &mut [f32],
    stepped_a: &mut [f32],
    parameter_b: &[f32],
    gradient_b: &[f32],
    first_b: &mut [f32],
    second_b: &mut [f32],
    stepped_b: &mut [f32],
    parameter_c: &[f32],
    gradient_c: &[f32],
    first_c: &mut [f32],
    second_c: &mut [f32],
    stepped_c: &mut [f32],
    parameter_d: &[f32],
    gradient_d: &[f32],
    first_d: &mut [f32],
    second_d: &mut [f32],
    stepped_d: &mut [f32],
    count_a: u32,
    count_b: u32,
    count_c: u32,
    count_d: u32,
    decay1: f32,
    decay2: f32,
    rate: f32,
    epsilon: f32,
    #[comptime] begun: bool,
) {
    let end_a = count_a as usize;
    let end_b = end_a + count_b as usize;
    let end_c = end_b + count_c as usize;
    let end_d = end_c + count_d as usize;
    let at = ABSOLUTE_POS;
    if at < end_a {
        step_at(
            parameter_a,
            gradient_a,
            first_a,
            second_a,
            stepped_a,
            at,
            decay1,
            decay2,
            rate,
            epsilon,
            begun,
        );
    } else if at < end_b {
        step_at(
            parameter_b,
            gradient_b,
            first_b,
            second_b,
            stepped_b,
            at - end_a,
            decay1,
            decay2,
            rate,
            epsilon,
            begun,
        );
    } else if at < end_c {
        step_at(
            parameter_c,
            gradient_c,
            first_c,
            second_c,
            stepped_c,
            at - end_b,
            decay1,
            decay2,
            rate,
            epsilon,
            begun,
        );
    } else if at < end_d {
        step_at(
            parameter_d,
            gradient_d,
            first_d,
            second_d,
            stepped_d,
            at - end_c,
            decay1,
            decay2,
            rate,
            epsilon,
            begun,
        );
    }
}

/// The step of one value.
#[cube]
fn step_at(
    parameter: &[f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    stepped: &mut [f32],
    at: usize,
    decay1: f32,
    decay2: f32,
    rate: f32,
    epsilon: f32,
    #[comptime] begun: bool,
) {
    let g = gradient[at];
    let mut m = (1.0f32 - decay1) * g;
    let mut v = (1.0f32 - decay2) * (g * g);
    if comptime!(begun) {
        m += decay1 * first[at];
        v += decay2 * second[at];
    }
    first[at] = m;
    second[at] = v;
    stepped[at] = parameter[at] - rate * m / (v.sqrt() + epsilon);
}
