//! Everything that needs files, in one binary so that it links once.
#![allow(clippy::unwrap_used)]

mod damage;
mod formats;
mod lenses;
mod masks;
mod photos;
mod sample;
mod scenes;
mod shared_scenes;
