//! Final pictures: mattes, cut-outs, plates, normals, depth and the mesh of a trained scene.

pub mod mesh;
pub mod preview;
pub mod rays;
pub mod survey;
pub mod view;
