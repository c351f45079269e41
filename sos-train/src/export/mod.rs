//! Writers of everything a run leaves behind, each file in one piece.
//!
//! | file | content |
//! |---|---|
//! | `alpha/*.png` | coverage by the object, 16-bit grey, linear |
//! | `foreground/*.png` | RGBA, 8 bit, sRGB, straight alpha, free of background colour |
//! | `background/*.png` | the scene without the object, RGB, 8 bit, sRGB |
//! | `background_seen/*.png` | number of views that saw what the plate shows, 8-bit grey |
//! | `normal/*.png` | unit normals of the world frame, RGB = (n + 1) / 2; black where there is none |
//! | `depth/*.exr` | 32-bit float channel `Z`, along the optical axis in scene units; 0 where nothing is |
//! | `found_masks/*.png` | rough masks that the run found by itself, 8-bit grey, white is the object |
//! | `uncertainty/*.png` | where a matte should not be relied on, 8-bit grey, linear; 0 is sure |
//! | `cameras/*.bin` | a COLMAP model with the poses that the run refined; only where it did |
//! | `mesh.ply` | the object's surface in the scene's frame, with normals and vertex colours |
//! | `log.jsonl` | one JSON object per line: [`LogRecord`]s and events |
//!
//! Normals are in the world frame, not the camera's, so that one colour means one direction in all
//! views and a wrong pose shows.

mod cameras;
mod log;
mod mesh;
mod picture;
mod view;

pub use cameras::write_cameras;
pub use log::{LogRecord, TrainLog, read_log};
pub use mesh::write_mesh;
pub(crate) use picture::byte;
pub use picture::write_preview;
pub use view::{ViewRender, check_names, write_found_mask, write_uncertainty, write_view};

use crate::run_folder::RunError;
use std::path::PathBuf;

/// Why something could not be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file system refused.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Cameras that cannot be written.
    #[error(transparent)]
    Colmap(#[from] io_colmap::ColmapError),
    /// Two photos whose results would have one name.
    #[error(
        "{}: the photos {first:?} and {second:?} differ only in their ending, so that their mattes would have the same name; rename one of them in the photo folder and the model",
        folder.display()
    )]
    SameName {
        /// The scene's folder.
        folder: PathBuf,
        /// One photo.
        first: String,
        /// The other.
        second: String,
    },
}
