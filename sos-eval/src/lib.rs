//! Scores for what a matting system makes of a photo set: alpha mattes, background plates, a mesh,
//! each against ground truth.
//!
//! The metrics are pure functions on pictures in memory, each usable alone, each with its equation:
//!
//! | what | functions |
//! |---|---|
//! | overlap of masks | [`iou`], [`Overlap`] (IoU, two-class mIoU, accuracy), [`boundary_iou`] |
//! | errors of mattes | [`sad`], [`mse`], [`gradient_error`], [`connectivity_error`] |
//! | all of these for one view | [`score_alpha`] |
//! | likeness of pictures | [`psnr`], [`ssim`], inside a region [`psnr_in`], [`ssim_in`] |
//! | surfaces | [`compare_meshes`], [`sample_surface`], [`distances`] |
//!
//! Above them stand whole folders: [`compare_folders`] for mattes ([`compare_silhouettes`] where holes
//! are not to count), [`compare_plates`] for backgrounds, [`run_eval`] for all that one run wrote, [`compare_contenders`] for several results
//! side by side. They return a [`Report`], which is JSON through serde and text through
//! [`Report::table`]. [`degrade_folder`] makes masks with the faults of rough segmenters from true ones.
//!
//! Alpha is straight and in 0..=1 at native resolution; colours are in 0..=1 as stored. Everything
//! is row-major. Scores are taken per view, then averaged over views; a view for which nothing was
//! predicted counts as an empty matte.
//!
//! ```
//! use sos_eval::{Plane, score_alpha};
//!
//! // A disc of radius 20, and the same disc one pixel further right.
//! let disc = |cx: f32| {
//!     Plane::from_fn(64, 64, move |x, y| {
//!         let r = (x as f32 - cx).hypot(y as f32 - 32.0);
//!         (20.5 - r).clamp(0.0, 1.0)
//!     })
//! };
//! let score = score_alpha(&disc(33.0), &disc(32.0));
//! // A shift by s costs two crescents of area 2 r s: IoU = (pi r^2 - 2 r s) / (pi r^2 + 2 r s).
//! assert!((score.iou - 0.94).abs() < 0.01);
//! assert!((score.sad - 4.0 * 20.0 / 1000.0).abs() < 0.002);
//! ```

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;

mod boundary;
mod comparison;
mod degrade;
mod error;
mod filter;
mod folders;
mod growth;
mod holes;
mod image_quality;
mod iou;
mod matching;
mod mattes;
mod matting;
mod mesh;
mod picture;
mod plates;
mod ply;
mod report;
mod run;
mod splitmix;
mod table;

pub use boundary::{BOUNDARY_SHARE, band_width, boundary_band, boundary_iou};
pub use comparison::{
    Compared, Comparison, Contender, MatteFile, ViewFiles, compare_contenders, mattes_by_view,
    true_mattes,
};
pub use degrade::{Degraded, Fault, degrade, degrade_folder};
pub use error::EvalError;
pub use folders::{compare_folders, compare_silhouettes};
pub use glam;
pub use holes::fill_holes;
pub use image_quality::{LEAST_MSE, psnr, psnr_in, psnr_of_mse, ssim, ssim_in, ssim_map};
pub use iou::{Overlap, iou};
pub use matting::{
    CONNECTIVITY_THETA, GRADIENT_SIGMA, connectivity_error, gradient_error, mse, sad,
};
pub use mesh::{
    MESH_SAMPLES, MeshScore, SurfaceDistance, TriangleMesh, compare_meshes, distances,
    sample_surface,
};
pub use picture::{Mask, Plane, RgbPlane, read_alpha, read_rgb};
pub use plates::{MIN_SEEN, PlateScore, Quality, compare_plates};
pub use ply::read_ply;
pub use report::{AlphaScore, MASK_THRESHOLD, Report, ViewScore, score_alpha};
pub use run::run_eval;
