//! Everything that needs files and programs, in one binary so that it links once.
//!
//! COLMAP and ffmpeg are shell scripts here, which print what the real ones print; `real` runs the
//! real ones.
#![allow(clippy::unwrap_used)]

#[cfg(unix)]
mod failures;
#[cfg(unix)]
mod photos;
mod real;
#[cfg(unix)]
mod stand_ins;
#[cfg(unix)]
mod videos;

mod detection;
