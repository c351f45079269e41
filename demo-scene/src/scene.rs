//! A whole generated scene, in memory.

use image::{GrayImage, RgbImage};
use ply_mesh::Mesh;

use crate::camera::Camera;
use crate::coarse::coarse_masks;
use crate::config::DemoConfig;
use crate::mask::iou;
use crate::orbit::shots;
use crate::render::render;
use crate::sparse::{SparsePoint, sparse_points};
use crate::stage::Stage;
use crate::target::mesh;

/// One photograph and everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct DemoView {
    /// File name of its pictures: `000.png`, `001.png`, ...
    pub name: String,
    /// Exact camera.
    pub camera: Camera,
    /// What the camera recorded, sRGB.
    pub photo: RgbImage,
    /// Coverage by the visible target: 255 is full.
    pub alpha: GrayImage,
    /// The view without the target: not its shadow either. Free of sensor noise.
    pub background: RgbImage,
    /// The view with the target hidden from the camera but still casting its shadow. Free of
    /// sensor noise.
    pub background_shadow: RgbImage,
    /// A flawed segmentation, 0 or 255; `None` in views where the segmenter found nothing.
    pub coarse_mask: Option<GrayImage>,
}

/// A generated scene.
#[derive(Clone, Debug, PartialEq)]
pub struct DemoScene {
    /// The views in order around the target.
    pub views: Vec<DemoView>,
    /// Points on surfaces with the views that see them.
    pub points: Vec<SparsePoint>,
    /// The target's surface, closed, in metres.
    pub mesh: Mesh,
}

/// Renders the scene: the same configuration gives the same bytes on every run.
#[must_use]
pub fn generate(config: &DemoConfig) -> DemoScene {
    let stage = Stage::new(config.kind);
    let shots = shots(&stage, config);
    let mut views: Vec<DemoView> = shots
        .iter()
        .enumerate()
        .map(|(index, shot)| {
            let per_pixel = config.samples_per_pixel.max(1) as usize;
            let turned = stage.turned(shot.turn);
            let pictures = render(&turned, &shot.in_room, per_pixel, config.seed, index as u64);
            DemoView {
                name: format!("{index:03}.png"),
                camera: shot.camera,
                photo: pictures.photo,
                alpha: pictures.alpha,
                background: pictures.background,
                background_shadow: pictures.background_shadow,
                coarse_mask: None,
            }
        })
        .collect();
    let pictures: Vec<_> = views
        .iter()
        .map(|view| (&view.photo, &view.alpha))
        .collect();
    let masks = coarse_masks(&pictures, config.seed);
    let photos: Vec<_> = views.iter().map(|view| &view.photo).collect();
    let cameras: Vec<_> = shots.iter().map(|shot| shot.camera).collect();
    let points = sparse_points(&stage, &cameras, &photos, config);
    for (view, mask) in views.iter_mut().zip(masks) {
        view.coarse_mask = mask;
    }
    DemoScene {
        views,
        points,
        mesh: mesh(&stage, config.mesh_cell),
    }
}

impl DemoScene {
    /// Mean intersection over union of the coarse masks with the true silhouettes; a missing mask
    /// counts as 0.
    #[must_use]
    pub fn mean_coarse_iou(&self) -> f64 {
        let sum: f64 = self
            .views
            .iter()
            .map(|view| iou(view.coarse_mask.as_ref(), &view.alpha))
            .sum();
        sum / self.views.len().max(1) as f64
    }
}
