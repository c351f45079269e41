//! From a folder of photos without poses, or a video, to a COLMAP scene, by running the COLMAP and
//! ffmpeg that are installed.
//!
//! 1. [`detect`] tells whether a path is a video or a folder of photos that nobody has put poses to
//!    ([`Source`]);
//! 2. [`Tools::find_for`] finds the programs that are needed, or says how to get them;
//! 3. [`capture`] takes the sharpest frames of a video ([`Ffmpeg::take_frames`]), has COLMAP find
//!    features, compare photos and find poses ([`Colmap`]), and puts `images/` and `sparse/0` in
//!    place when all is done.
//!
//! COLMAP is asked for its options, which differ between versions; everything runs on the CPU.
//! JPEG and PNG are turned upright as their EXIF says; photos of one folder, size and lens share a camera.
//! A [`Watch`] hears how far it is and what was
//! decided, and can stop it: whatever runs is ended then, and nothing is left behind. Where poses
//! are few or missing, it is said what to do about it.
//!
//! ```no_run
//! use scene_capture::{CaptureOptions, Tools, capture, detect};
//! use std::path::Path;
//!
//! if let Some(source) = detect(Path::new("cat.mp4")) {
//!     let tools = Tools::find_for(&source)?;
//!     let options = CaptureOptions::default();
//!     let captured = capture(&source, Path::new("scenes/cat"), &tools, &options, &())?;
//!     println!("{} of {} photos have poses", captured.registered, captured.photos);
//! }
//! # Ok::<(), scene_capture::CaptureError>(())
//! ```
//!
//! # Map
//! | module | idea |
//! |---|---|
//! | `source`, `photo_files`, `photos`, `upright` | what a path holds; which files; photos by camera; turned as EXIF says |
//! | `video`, `frames`, `sharpness` | ffprobe's answer and windows of time; the stream; which frame |
//! | `colmap`, `matching`, `masks` | command lines; pairs of photos; where not to look |
//! | `progress_lines`, `models`, `merging` | what COLMAP says on the way; what it made; models that share photos |
//! | `program`, `watch`, `scene`, `error` | running programs; being watched; the folder; failures |

mod colmap;
mod error;
mod frames;
mod masks;
mod matching;
mod merging;
mod models;
mod photo_files;
mod photos;
mod program;
mod progress_lines;
mod scene;
mod sharpness;
mod source;
mod upright;
mod video;
mod watch;

pub use colmap::Colmap;
pub use draft_folder::Existing;
pub use error::CaptureError;
pub use frames::TakenFrames;
pub use scene::{CaptureOptions, Captured, RECORD, Tools, capture};
pub use sharpness::Grey;
pub use source::{Source, detect};
pub use video::{Ffmpeg, FrameOptions, VideoInfo};
pub use watch::{Progress, Stage, Watch};

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;
