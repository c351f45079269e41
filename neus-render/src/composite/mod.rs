//! Joint compositing of two fields along rays, in depth order, as one differentiable op.
//!
//! An interval `i` of a ray has an opacity `a_F` of the object F (0 where F has no sample; times
//! its matte value, if [`MatteRole`] says so) and `a_B` of the background B. With the transmittance
//! of both,
//! `T_i = prod_{j<i} (1 - a_F_j)(1 - a_B_j)`, the weights are
//!
//! ```text
//! w_F = T a_F (1 - a_B / 2),   w_B = T a_B (1 - a_F / 2),   w_F + w_B = T (1 - (1 - a_F)(1 - a_B)),
//! ```
//!
//! which is what is left when F and B share the interval and neither is in front. Colours of F are
//! thereby hidden by what stands before the object, and `sum w_F` is the visible object's matte.
//! The same pass gives each field alone (weights `T_F a_F` and `T_B a_B`).
//!
//! Opacities are NeuS's (Wang et al. 2021, eq. 13, with the midpoint estimate of its section 3.2):
//! see [`neus_log_survival`](crate::alpha::neus_log_survival) for the stable form used, or those
//! of a density. Everything is done on `log(1 - a)`, so values and gradients stay finite. NaN in a
//! sample stays NaN in its ray's pixel and gradients; on GPUs as far as the shading language lets it, for
//! compilers of WGSL may assume that there is none.
//!
//! Tensors, all f32: the object's samples are the rows of `[m_f, 6]` (columns [`object_column`]), the
//! background's those of `[m_b, 5]` ([`background_column`]), sharpnesses `[2]` (F, B), the result
//! `[rays, 20]` ([`mod@column`]). Rows may have further columns behind these, which are not read and
//! have a gradient of zero. Everything is tracked but the [`Packing`].

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod adapters;
mod autodiff;
mod cpu;
#[cfg(feature = "cube")]
mod cube;
mod opacity;
mod packing;
mod reference;
mod survival;
mod visibility;

use std::sync::Arc;

use burn::{
    backend::{Backend, Dispatch, backend_extension, tensor::FloatTensor},
    tensor::Tensor,
};
use serde::{Deserialize, Serialize};

pub use cpu::{BACKWARD, FORWARD};
pub use packing::{Marks, Packing};
pub use reference::composite_reference;
pub use visibility::{Light, SampleVisibility, Visibility, sample_visibility, visibility_from};

/// Least divisor in the derivative of the log-transmittance with respect to a matte value.
const LEAST_SURVIVAL: f32 = 1e-4;

/// Columns of the object's samples.
pub mod object_column {
    /// The signed distance, or the density (not negative) for
    /// [`Transparency::Density`](super::Transparency::Density).
    pub const SDF: usize = 0;
    /// The derivative of the signed distance along the ray, normal . direction.
    pub const SLOPE: usize = 1;
    /// Red, green, blue from here.
    pub const COLOUR: usize = 2;
    /// The matte value in [0, 1]: see [`MatteRole`](super::MatteRole).
    pub const MATTE: usize = 5;
    /// How many columns there are.
    pub const COUNT: usize = 6;
}

/// Columns of the background's samples: as the object's, without the matte value.
pub mod background_column {
    /// As [`object_column::SDF`](super::object_column::SDF).
    pub const SDF: usize = 0;
    /// As [`object_column::SLOPE`](super::object_column::SLOPE).
    pub const SLOPE: usize = 1;
    /// Red, green, blue from here.
    pub const COLOUR: usize = 2;
    /// How many columns there are.
    pub const COUNT: usize = 5;
}

/// Columns of the result; colours are premultiplied (black where nothing is).
pub mod column {
    /// Red, green, blue of both fields from here: `sum w_F c_F + w_B c_B`.
    pub const JOINT_COLOUR: usize = 0;
    /// The object's share of the pixel: `sum w_F`.
    pub const MATTE: usize = 3;
    /// The object's opacity alone: `1 - prod (1 - a_F)`.
    pub const OBJECT_OPACITY: usize = 4;
    /// The object's transmittance alone, in logarithm: `sum log(1 - a_F)`, finite.
    pub const OBJECT_LOG_TRANSMITTANCE: usize = 5;
    /// Red, green, blue of the background alone from here.
    pub const BACKGROUND_COLOUR: usize = 6;
    /// The background's opacity alone.
    pub const BACKGROUND_OPACITY: usize = 9;
    /// Red, green, blue of the object alone from here.
    pub const OBJECT_COLOUR: usize = 10;
    /// Depth of both fields, `sum (w_F + w_B) t`: divide by the joint opacity for a distance.
    pub const JOINT_DEPTH: usize = 13;
    /// Depth of the object alone, to be divided by its opacity.
    pub const OBJECT_DEPTH: usize = 14;
    /// Opacity of both: `1 - prod (1 - a_F)(1 - a_B)`.
    pub const JOINT_OPACITY: usize = 15;
    /// The blend of both fields' [`Marks`](super::Marks) from here, `sum w_F m_F + w_B m_B`: two
    /// columns, zero where there are no marks.
    pub const MARKS: usize = 16;
    /// The matte values that multiply colours, blended jointly: `sum w_F m`; else zero.
    pub const HEAD: usize = 18;
    /// The same with the weights of the object alone.
    pub const HEAD_ALONE: usize = 19;
    /// How many columns there are.
    pub const COUNT: usize = 20;
}

/// How a field's first column becomes an opacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Transparency {
    /// A signed distance, by NeuS's formula.
    Sdf,
    /// A density: `a = 1 - exp(-density * dt)`; negative densities count as zero.
    Density,
}

/// What the object's matte values multiply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MatteRole {
    /// Nothing: they are not read.
    Unused,
    /// The sample's opacity, which lets what is behind shine through.
    Opacity,
    /// The sample's colour alone, which darkens: the object's opacity is what the surface says, and
    /// the values are composited beside it ([`column::HEAD`]).
    Colour,
}

/// What compositing depends on besides the samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompositeConfig {
    /// How the object's opacities come about.
    pub object: Transparency,
    /// How the background's opacities come about.
    pub background: Transparency,
    /// What the matte values multiply.
    pub matte: MatteRole,
    /// NeuS's annealing in [0, 1]: at 0 surfaces seen from any side count, at 1 (the end of it)
    /// only those that face the camera.
    pub cos_anneal: f32,
    /// The small constant of NeuS's code: `a = (Phi(prev) - Phi(next) + e) / (Phi(prev) + e)`. At
    /// 0, the default, this is the paper's formula, which needs no such help in the form used
    /// here. NeuS's 1e-5 makes the deep inside opaque, but also every interval of empty space by
    /// 1e-5: haze of 1 % where a ray has a thousand.
    pub epsilon: f32,
}

impl Default for CompositeConfig {
    fn default() -> Self {
        Self {
            object: Transparency::Sdf,
            background: Transparency::Sdf,
            matte: MatteRole::Opacity,
            cos_anneal: 1.0,
            epsilon: 0.0,
        }
    }
}

/// The op on a backend's tensors; use [`composite`].
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub trait CompositeOps: Backend {
    /// See [`composite`]: object `[m_f, 6 or more]`, background `[m_b, 5 or more]`, sharpness `[2]` to
    /// `[rays, 20]`.
    fn composite(
        object: FloatTensor<Self>,
        background: FloatTensor<Self>,
        sharpness: FloatTensor<Self>,
        packing: Arc<Packing>,
        config: CompositeConfig,
    ) -> FloatTensor<Self>;
}

/// Colours, mattes, opacities and depths of rays from the samples of two fields.
///
/// `object` `[m_f, 6]`, `background` `[m_b, 5]` and `sharpness` `[2]` (the `b` of `Phi_b` for F and B)
/// to `[rays, 20]`; what columns mean is in [`object_column`], [`background_column`] and [`mod@column`].
/// A field without any sample is a tensor with zero rows. Rays without intervals give zeros.
///
/// The gradient of the log-transmittance with respect to a matte value is `-a / (1 - m a)`; its
/// divisor is kept above 1e-4.
///
/// ```
/// use std::sync::Arc;
/// use burn::tensor::{Device, Tensor};
/// use neus_render::composite::{CompositeConfig, Packing, column, composite};
///
/// // A ray passes an opaque red surface: the sdf is 0.05 and then -0.05, falling at rate 1.
/// let device = Device::flex();
/// let packing = Packing::new(vec![0, 2], vec![2.0, 2.1], vec![0.1; 2], vec![0, 1], vec![]);
/// let red = [1.0, 0.0, 0.0];
/// let object = Tensor::<2>::from_floats(
///     [[0.05, -1.0, red[0], red[1], red[2], 1.0], [-0.05, -1.0, red[0], red[1], red[2], 1.0]],
///     &device,
/// );
/// let pixels = composite(
///     object,
///     Tensor::zeros([0, 5], &device),
///     Tensor::from_floats([200.0, 200.0], &device),
///     Arc::new(packing),
///     CompositeConfig::default(),
/// );
/// let pixel = pixels.into_data().try_to_vec::<f32>().expect("f32");
/// assert!(pixel[column::MATTE] > 0.99 && pixel[column::JOINT_COLOUR] > 0.99);
/// ```
///
/// # Panics
/// When a tensor's shape doesn't fit the packing.
pub fn composite(
    object: Tensor<2>,
    background: Tensor<2>,
    sharpness: Tensor<1>,
    packing: Arc<Packing>,
    config: CompositeConfig,
) -> Tensor<2> {
    check_shapes(
        [&object.dims(), &background.dims(), &sharpness.dims()],
        &packing,
    );
    Tensor::from_dispatch(Dispatch::composite(
        object.into_dispatch(),
        background.into_dispatch(),
        sharpness.into_dispatch(),
        packing,
        config,
    ))
}

/// What kernels rest on: the shapes of object, background and sharpness.
fn check_shapes([object, background, sharpness]: [&[usize]; 3], packing: &Packing) {
    for (name, found, rows, columns) in [
        (
            "object",
            object,
            packing.object().len(),
            object_column::COUNT,
        ),
        (
            "background",
            background,
            packing.background().len(),
            background_column::COUNT,
        ),
    ] {
        assert!(
            found.len() == 2 && found[0] == rows && found[1] >= columns,
            "composite: {name} has shape {found:?}, the packing wants [{rows}, {columns}]"
        );
    }
    assert_eq!(
        sharpness,
        [2],
        "composite: sharpness has shape {sharpness:?}, not [2]"
    );
}
