//! Runs a loss on both CPU backends, with gradients.

#![allow(dead_code, unreachable_pub)] // Each test binary takes what it needs.

use burn::tensor::{Device, Tensor};

/// The devices every test runs on, with autodiff, and their names.
#[allow(deprecated)] // burn-ndarray is deprecated upstream in favour of Flex; both are supported here.
pub fn devices() -> [(&'static str, Device); 2] {
    [
        ("ndarray", Device::ndarray().autodiff()),
        ("flex", Device::flex().autodiff()),
    ]
}

/// What a loss gave: its value, and its gradient by each input, row-major.
pub struct Outcome {
    pub value: f32,
    pub gradients: Vec<Vec<f32>>,
}

/// Evaluates `loss` on `inputs`, which it gets as tracked tensors [values]; it reshapes them.
pub fn evaluate(
    device: &Device,
    inputs: &[Vec<f32>],
    loss: impl Fn(&[Tensor<1>]) -> Tensor<1>,
) -> Outcome {
    let tensors: Vec<_> = inputs.iter().map(|values| leaf(device, values)).collect();
    let loss = loss(&tensors);
    assert_eq!(loss.dims(), [1], "a loss is a scalar tensor");
    // As one of several terms: Burn refuses `backward` on a term of its own that no input reaches,
    // and slices of tensors without elements are cut off from them.
    let gradients = (loss.clone() + leaf(device, &[0.0])).backward();
    Outcome {
        value: loss.into_scalar::<f32>(),
        gradients: tensors
            .iter()
            .zip(inputs)
            .map(|(tensor, values)| match tensor.grad(&gradients) {
                Some(gradient) => gradient.into_data().try_into_vec::<f32>().expect("f32"),
                None => vec![0.0; values.len()],
            })
            .collect(),
    }
}

/// A tracked tensor [values].
pub fn leaf(device: &Device, values: &[f32]) -> Tensor<1> {
    constant(device, values).require_grad()
}

/// A tensor [values] of numbers that are not trained.
pub fn constant(device: &Device, values: &[f32]) -> Tensor<1> {
    Tensor::from_floats(values, device)
}

/// A tensor [values] as rows of three.
pub fn rows(tensor: &Tensor<1>) -> Tensor<2> {
    let [values] = tensor.dims();
    tensor.clone().reshape([values / 3, 3])
}
