//! scene-decomp
