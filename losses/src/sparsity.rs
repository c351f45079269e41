//! Space that nobody saw should not be surface.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::{reduction::weighted_mean, shape::expect_weights};

/// The two forms of the sparsity loss in the paper, whose formula and text disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SparsityForm {
    /// `exp(-tau |sdf|)`: the formula.
    #[default]
    Plain,
    /// `exp(-tau |sdf|)^2 = exp(-2 tau |sdf|)`: the text; the same as twice the tau.
    Squared,
}

/// The sparsity loss of `sdf` `[n]`: keeps the surface away from samples that nothing else moves.
///
/// ```text
/// L = sum_i w_i exp(-tau |sdf_i|) / sum_i w_i
/// ```
///
/// L_sparsity of the paper, or its square by `form`. `tau` is per unit of distance: at `tau` 100 a
/// sample 0.01 off the surface still costs 0.37, so 20 to 100 suits a box of half side 1; at 1 the
/// loss is almost the same everywhere. At a distance of exactly 0 the gradient is 0.
/// `weights` `[n]` are optional.
///
/// # Panics
/// When a shape is wrong.
///
/// ```
/// use burn::tensor::{Device, Tensor};
/// use losses::{SparsityForm, sparsity_loss};
///
/// let device = Device::flex();
/// let sdf = || Tensor::<1>::from_floats([0.0, -0.05], &device);
///
/// let plain = sparsity_loss(sdf(), 20.0, SparsityForm::Plain, None);
/// assert!((plain.into_scalar::<f32>() - (1.0 + 0.367_879) / 2.0).abs() < 1e-6);
/// let squared = sparsity_loss(sdf(), 20.0, SparsityForm::Squared, None);
/// assert!((squared.into_scalar::<f32>() - (1.0 + 0.135_335) / 2.0).abs() < 1e-6);
/// ```
pub fn sparsity_loss(
    sdf: Tensor<1>,
    tau: f32,
    form: SparsityForm,
    weights: Option<Tensor<1>>,
) -> Tensor<1> {
    let [n] = sdf.dims();
    expect_weights("sparsity_loss", weights.as_ref(), n);
    let rate = match form {
        SparsityForm::Plain => tau,
        SparsityForm::Squared => 2.0 * tau,
    };
    weighted_mean((sdf.abs() * -rate).exp(), weights)
}
