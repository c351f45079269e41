//! Multi-resolution hash encoding.

pub mod cpu;

mod config;
mod layout;

pub use config::{GridConfig, GridConfigError, Interpolation};
pub use layout::{BLOCK_ENTRIES, FEATURES, GridLayout, LevelLayout};
