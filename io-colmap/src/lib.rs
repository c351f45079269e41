//! Reads a posed photo set: a COLMAP model, the photos it was made from, and masks to go with them.
//!
//! Everything that makes photo sets fail in practice is decided here, once, and said aloud:
//!
//! * [`Model`] reads and writes COLMAP's binary and text formats, with every camera model up to
//!   COLMAP 4. Files are treated as hostile: damage gives an error with file, place and remedy,
//!   never a panic or an absurd allocation.
//! * [`Camera`] maps rays to pixels and back, through the lens distortion.
//! * [`Scene`] finds the model (the sub-model with the most photos) and the photos in a folder,
//!   and checks that they fit each other.
//! * [`PhotoHeader`] and [`Scene::read_photo`] read photos of any usual format the way up that
//!   their cameras have.
//! * [`Search`] lists files in folders, and says what it had to leave out.
//! * [`MaskSet`] finds masks under the names that different tools give them, and works out
//!   whether white or black means the object.
//! * [`write_png`] writes pictures, and says so where the disk is full.
//!
//! Decisions a user should see are left as sentences in `notes`; printing is the caller's part.
//!
//! Conventions: camera space has +x right, +y down, +z forward; the top left pixel's centre is at
//! `(0.5, 0.5)`; poses are named by what they do (`camera_from_world`).
//!
//! ```
//! use io_colmap::{Camera, CameraModel, Model, Pose, View};
//! use glam::DVec3;
//!
//! let mut model = Model::default();
//! model.cameras.insert(1, Camera {
//!     id: 1,
//!     model: CameraModel::SimpleRadial,
//!     width: 640,
//!     height: 480,
//!     params: vec![500.0, 320.0, 240.0, 0.05], // f, cx, cy, k
//! });
//! model.views.push(View {
//!     id: 1,
//!     name: "photo.jpg".into(),
//!     camera_id: 1,
//!     camera_from_world: Pose { translation: DVec3::new(0.0, 0.0, 4.0), ..Pose::IDENTITY },
//! });
//!
//! let dir = tempfile::tempdir()?;
//! model.write_text(dir.path())?;
//! let read = Model::read(dir.path())?;
//! assert_eq!(read, model);
//!
//! let view = &read.views[0];
//! assert_eq!(view.camera_from_world.centre(), DVec3::new(0.0, 0.0, -4.0));
//!
//! let camera = &read.cameras[&view.camera_id];
//! let pixel = camera.project(view.camera_from_world.transform_point(DVec3::X)).unwrap();
//! let ray = camera.unproject(pixel).unwrap(); // z = 1
//! assert!((ray - DVec3::new(0.25, 0.0, 1.0)).length() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod binary;
mod camera;
mod camera_model;
mod distortion;
mod endings;
mod error;
mod jet;
mod listing;
mod mask_files;
mod mask_kind;
mod mask_names;
mod mask_pixels;
mod masks;
mod model;
mod photo;
mod photo_likeness;
mod png_file;
mod polarity;
mod pose;
mod scene;
mod srgb;
mod text;

pub use camera::Camera;
pub use camera_model::CameraModel;
pub use endings::{alike_without_ending, without_ending};
pub use error::{ColmapError, Place, picture_error, remedy};
pub use listing::{IGNORE_FOLDER, Listing, Search};
pub use mask_files::MaskFiles;
pub use mask_pixels::read_mask;
pub use masks::{GreyImage, MaskSet};
pub use model::{Model, Observation, SparsePoint, View, read_observations};
pub use photo::{PICTURE_ENDINGS, PhotoHeader, decode_photo, is_picture, read_photo};
pub use png_file::write_png;
pub use polarity::{POLARITY_FILE, Polarity};
pub use pose::Pose;
pub use scene::{Scene, same_shape};
pub use srgb::{linear_from_srgb, srgb_from_linear};
