//! Two neural fields for one scene.
//!
//! Surface-SOS explains posed photos with **FoCoR**, the object, and **BaCo**, the scene without it.
//! Each is a scalar field on a multi-resolution hash grid with a small MLP, and a colour
//! network: a signed distance, or read as a density, as BaCo is by default in `sos`. This crate holds both as Burn modules, their geometric initialisation, the probability
//! map m^P that tells BaCo where the object is, and the two fused ops on which training rests:
//!
//! | op | what |
//! |---|---|
//! | [`sdf_field`] | signed distance, feature and normal, with the derivative of the normal |
//! | [`colour_field`] | the colour network on top of it |
//!
//! Each op has a reference in plain tensor operations, one slice kernel that serves NdArray and
//! Flex, and with the feature `wgpu` (or another runtime's) kernels for GPUs. Shapes: `n` points, `L` grid levels, `G` geometry features.

pub mod colour_field;
pub mod directions;
pub mod probability;
pub mod sdf_field;

#[cfg(feature = "cube")]
mod cube;
mod dense;
mod evaluate;
mod level_set;
mod model;
mod surface;
mod surface_votes;
mod tile;

pub use dense::Dense;
pub use evaluate::{FrozenSurface, Geometry};
pub use level_set::LevelSet;
pub use model::{BACKGROUND_HALF_SIDE, Scene, SceneConfig, Sharpness};
pub use surface::{InitialShape, Surface, SurfaceConfig, SurfaceConfigError, SurfaceSamples};
pub use surface_votes::SurfaceVotes;
