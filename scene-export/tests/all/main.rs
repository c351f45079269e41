//! Everything that needs files, in one binary so that it links once.
#![allow(clippy::unwrap_used)]

mod coco;
mod colmap_scene;
mod damage;
mod folders;
mod layers;
mod mattes;
mod meshes;
mod outside_programs;
mod photos;
mod rig;
mod spin_nerf;
mod tool_masks;
mod videos;
