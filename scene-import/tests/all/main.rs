//! Everything that needs files, in one binary so that it links once.
#![allow(clippy::unwrap_used)]

mod damage;
mod detection;
mod fixtures;
mod formats;
mod ignore;
mod lenses;
mod mask_files;
mod masks;
mod photogrammetry;
mod rig;
mod scene_folder;
mod shared_scenes;
mod sizes;
