//! Size and randomness of a scene.

use crate::kind::SceneKind;

/// What to generate. The default is the demo the training binary uses.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DemoConfig {
    /// Which scene.
    #[serde(default)]
    pub kind: SceneKind,
    /// Number of photographs.
    pub views: usize,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Camera rays per pixel; four or more for smooth edges.
    pub samples_per_pixel: u32,
    /// Seed of camera positions, sensor noise, sparse points and the flaws of the coarse masks.
    /// The objects and their textures are always the same.
    pub seed: u64,
    /// Number of sparse points to aim for.
    pub sparse_points: usize,
    /// Edge of a cell of the reference mesh, in metres.
    pub mesh_cell: f64,
}

impl Default for DemoConfig {
    /// 28 views of 320 x 240.
    fn default() -> Self {
        Self {
            kind: SceneKind::Can,
            views: 28,
            width: 320,
            height: 240,
            samples_per_pixel: 4,
            seed: 20,
            sparse_points: 900,
            mesh_cell: 0.0015,
        }
    }
}

impl DemoConfig {
    /// A miniature for tests: 12 views of 96 x 72 in well under two seconds.
    #[must_use]
    pub fn tiny() -> Self {
        Self {
            views: 12,
            width: 96,
            height: 72,
            mesh_cell: 0.003,
            ..Self::default()
        }
    }
}
