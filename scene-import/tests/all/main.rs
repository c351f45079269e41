//! Everything that needs files, in one binary so that it links once.
#![allow(clippy::unwrap_used)]

mod damage;
mod fixtures;
mod formats;
mod ignore;
mod lenses;
mod masks;
mod photogrammetry;
mod rig;
mod scene_folder;
mod shared_scenes;
