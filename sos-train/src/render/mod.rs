//! Final pictures: mattes, cut-outs, plates, normals, depth and the mesh of a trained scene;
//! and pictures from where no photo was taken.

mod edge_width;
mod fill;
pub mod frame;
pub mod mesh;
pub mod path;
mod photo_outline;
pub mod preview;
pub mod rays;
mod semantic;
pub mod survey;
pub mod trained;
pub mod view;
