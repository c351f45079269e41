//! demo-scene
