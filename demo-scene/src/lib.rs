//! A small photographic scene with exact ground truth, made by its own code in seconds.
//!
//! A painted watering can stands on a cluttered table in a furnished room. Two handles and a
//! brace leave holes one can look through, the spout is thin: where a coarse segmentation goes
//! wrong and a multi-view reconstruction shows what it is worth. Around it 28 cameras take
//! photographs, and for every photo the truth is known: coverage by the target, the background
//! behind it with and without its shadow, the camera, surface points with tracks, the surface.
//! Flawed masks (mean IoU 0.80, two missing) play the part of a single-view segmenter.
//!
//! Everything is an analytic signed distance ([`target_sdf`] is the target's) with procedural
//! paint, sphere traced with soft shadows and ambient occlusion. Nothing is read from disk, and
//! the arithmetic avoids what differs between platforms, so that a [`DemoConfig`] determines
//! every byte.
//!
//! # Conventions
//! World: metres, z up, the table top's middle at [`TABLE_CENTRE`], not at the origin. Cameras:
//! x right, y down, z forward, poses stored as `camera_from_world`; the centre of the first
//! pixel is `(0.5, 0.5)`. Colours are 8-bit sRGB, mattes 8-bit linear coverage.
//!
//! # Example
//! ```
//! use demo_scene::{DemoConfig, generate};
//!
//! let config = DemoConfig { views: 3, width: 48, height: 36, sparse_points: 40, ..DemoConfig::tiny() };
//! let scene = generate(&config);
//! assert_eq!(scene.views[0].photo.dimensions(), (48, 36));
//!
//! let folder = std::env::temp_dir().join(format!("demo-scene-doc-{}", std::process::id()));
//! scene.write(&folder)?;
//! assert!(folder.join("sparse/0/images.txt").is_file());
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Map
//! | module | idea |
//! |---|---|
//! | `config`, `scene`, `write`, `error` | what to make, the result, the folder it becomes |
//! | `kind` | which scene: the demo, or one that is hard in a way of its own |
//! | `subject`, `watering_can`, `chair`, `bottle`, `clutter`, `room` | shapes and paint of the things |
//! | `prop`, `arrangement`, `stage` | a thing at its place, which places, what a ray meets |
//! | `primitives`, `noise`, `paint` | distances, lattice noise and random numbers, colours |
//! | `orbit`, `camera`, `lighting`, `film`, `render` | from stage to pictures |
//! | `target`, `sparse`, `coarse`, `mask`, `colmap_text` | mesh, points, flawed masks, the text model |

mod arrangement;
mod bottle;
mod camera;
mod chair;
mod clutter;
mod coarse;
mod colmap_text;
mod config;
mod error;
mod film;
mod kind;
mod lighting;
mod mask;
mod noise;
mod orbit;
mod paint;
mod primitives;
mod prop;
mod render;
mod room;
mod scene;
mod sparse;
mod stage;
mod subject;
mod target;
mod watering_can;
mod write;

pub use camera::Camera;
pub use config::DemoConfig;
pub use error::DemoError;
pub use kind::SceneKind;
pub use ply_mesh::Mesh;
pub use scene::{DemoScene, DemoView, generate};
pub use sparse::{Observation, SparsePoint};
pub use stage::TABLE_CENTRE;
pub use target::{target_bounds, target_sdf};
pub use write::check_vacant;

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;
