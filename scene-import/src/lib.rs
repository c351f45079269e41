//! Turns what other tools write into the one scene format that the rest reads: a COLMAP model with
//! its photos and masks.
//!
//! 1. [`detect`] finds out which tool a folder's camera poses come from ([`Format`]);
//! 2. [`read`] turns them into an [`Imported`]: an [`io_colmap::Model`], and the photo and mask of
//!    each view; what cannot be used is [`Dropped`] and says why;
//! 3. [`Imported::write`] makes a scene folder of it: `images/`, `sparse/0/`, `masks/`, with masks
//!    from whatever there is ([`MaskSource`]): folders, COCO JSON, label pictures, alpha channels.
//!
//! Each format is one file of this crate, which begins with what the format means. Files are treated
//! as hostile: damage gives an error with file, place and remedy, never a panic or an absurd
//! allocation. Decisions a user should see are left as sentences in `notes`; printing is the
//! caller's part.
//!
//! ```
//! use scene_import::{Format, MaskOptions, detect, read};
//! # let dir = tempfile::tempdir()?;
//! # let scene = dir.path().join("scene");
//! # std::fs::create_dir_all(scene.join("images"))?;
//! # image::RgbImage::new(64, 48).save(scene.join("images/a.png"))?;
//! std::fs::write(scene.join("transforms.json"), r#"{
//!     "camera_angle_x": 1.0,
//!     "frames": [{
//!         "file_path": "images/a",
//!         "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
//!     }]
//! }"#)?;
//!
//! let detected = detect(&scene, None)?;
//! assert_eq!(detected.format, Format::Transforms);
//! let imported = read(&detected, None)?;
//! assert_eq!(imported.model.views[0].camera_from_world.centre().z, 4.0);
//!
//! let written = imported.write(&dir.path().join("colmap"), &MaskOptions::default())?;
//! assert_eq!((written.photos, written.masks), (1, 0));
//! assert!(dir.path().join("colmap/sparse/0/cameras.bin").is_file());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod alpha;
mod blended_mvs;
mod co3d;
mod coco;
mod colmap;
mod error;
mod format;
mod gather;
mod labels;
mod lens;
mod llff;
mod masks;
mod metashape;
mod neus;
mod npy;
mod photos;
mod polygon;
mod pose;
mod reality_capture;
mod run_lengths;
mod transforms;
mod tum;
mod unposed;
mod write;

pub use error::ImportError;
pub use format::{Detected, Format, detect};
pub use gather::{Dropped, Imported};
pub use masks::{MaskOptions, MaskSource};
pub use write::Written;

use std::path::Path;

/// Reads the poses that [`detect`] found, and finds their photos: where the file says, or by name
/// in `images` or the scene's usual folders.
///
/// # Errors
/// [`ImportError`] for files that are missing, damaged or contradictory, poses and lenses that mean
/// nothing, photos of another shape than their camera, and scenes without a single photo.
pub fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    if let Some(folder) = images
        && !folder.is_dir()
    {
        return Err(ImportError::bad(
            folder,
            "there is no such folder",
            "give the folder the photos lie in",
        ));
    }
    match detected.format {
        Format::Colmap => colmap::read(detected, images),
        Format::Transforms => transforms::read(detected, images),
        Format::Llff => llff::read(detected, images),
        Format::Neus => neus::read(detected, images),
        Format::BlendedMvs => blended_mvs::read(detected, images),
        Format::Co3d => co3d::read(detected, images),
        Format::Tum => tum::read(detected, images),
        Format::Metashape => metashape::read(detected, images),
        Format::RealityCapture => reality_capture::read(detected, images),
    }
}
