//! Everything between cameras and pixel colours for neural signed distance fields: small functions
//! that compose, and one differentiable Burn op. The caller brings the fields.
//!
//! # Notation
//!
//! Lengths are in *normalised* space: the object's box is [-1, 1]^3, and `t` and `dt` are lengths
//! along unit directions. Signed distances are negative inside. There are two fields: the object F
//! inside its box, and the background B in all of space, which is contracted to [-2, 2]^3. Shapes:
//! `n` intervals, `m_f` and `m_b` samples of the fields; everything is f32. Colours are
//! premultiplied RGB.
//!
//! # Contents
//!
//! In the order in which a pixel comes about:
//!
//! 1. [`rays`]: camera models and rays; [`intersect`]: rays with boxes and spheres
//! 2. [`contraction`]: all of space in a cube
//! 3. [`occupancy`]: which cells may hold something
//! 4. [`march`]: packed intervals on each ray, for both fields at once
//! 5. [`alpha`]: opacities, transmittances, weights, sums; [`composite`]: all of it for two fields
//!    as one op with a hand-written backward
//!
//! And what final renders and exports need:
//!
//! 6. [`field`]: a signed distance field evaluated in batches; [`trace`]: its first surface on each
//!    ray; [`isosurface`]: its surface as a closed mesh
//! 7. [`random`]: the seeded numbers behind jitter
//!
//! # From rays to pixels
//!
//! ```
//! use std::sync::Arc;
//! use burn::tensor::{Device, Tensor, TensorData};
//! use glam::Vec3;
//! use neus_render::{
//!     composite::{CompositeConfig, Packing, column, composite},
//!     march::{Field, Grids, MarchConfig, march},
//!     occupancy::OccupancyGrid,
//!     rays::Ray,
//! };
//!
//! // A red sphere of radius 0.5, seen by one ray; nothing is known to be empty, no background.
//! let rays = [Ray { origin: Vec3::new(0.0, 0.0, -3.0), direction: Vec3::Z }];
//! let mut grid = OccupancyGrid::new(32, 1.0);
//! grid.set_all(1.0);
//! let grids = Grids { object: Some(&grid), background: None };
//! let intervals = march(&rays, grids, &MarchConfig::default());
//!
//! // The field, here in closed form: signed distance, its slope along the ray, colour, matte.
//! let samples = intervals.samples(Field::Object, &rays);
//! let rows: Vec<f32> = samples
//!     .points
//!     .iter()
//!     .flat_map(|p| [p.length() - 0.5, p.normalize().z, 1.0, 0.0, 0.0, 1.0])
//!     .collect();
//! let device = Device::flex();
//! let pixels = composite(
//!     Tensor::from_data(TensorData::new(rows, [samples.len(), 6]), &device),
//!     Tensor::zeros([0, 5], &device),
//!     Tensor::from_floats([1000.0, 1000.0], &device),
//!     Arc::new(Packing::from_intervals(&intervals)),
//!     CompositeConfig::default(),
//! );
//! let pixel = pixels.into_data().try_to_vec::<f32>().expect("f32");
//! assert!(pixel[column::OBJECT_OPACITY] > 0.999);
//! let depth = pixel[column::OBJECT_DEPTH] / pixel[column::OBJECT_OPACITY];
//! assert!((depth - 2.5).abs() < 0.005);
//! ```

pub mod alpha;
pub mod composite;
pub mod contraction;
pub mod field;
pub mod intersect;
pub mod isosurface;
pub mod march;
pub mod occupancy;
pub mod random;
pub mod rays;
pub mod trace;
