//! A small picture of how the run is doing.

use glam::{Vec2, Vec3};

use super::rays::FrozenScene;
use crate::export::{ExportError, write_preview};
use crate::prepare::Prepared;
use crate::run_folder::RunFolder;
use image::RgbImage;

/// Width of one panel, in pixels.
const PANEL: u32 = 240;

/// Writes `preview.png`: the [`panels`] of the first view.
///
/// # Errors
/// When the file cannot be written.
pub fn write(run: &RunFolder, scene: &FrozenScene, data: &Prepared) -> Result<(), ExportError> {
    if data.views.is_empty() {
        return Ok(());
    }
    let picture = panels(scene, data, 0, PANEL);
    write_preview(run, picture.width(), picture.height(), picture.as_raw())
}

/// View `index` as four panels side by side, each `panel` pixels wide: photo, matte, cut-out on grey,
/// and plate.
#[must_use]
pub fn panels(scene: &FrozenScene, data: &Prepared, index: usize, panel: u32) -> RgbImage {
    let view = &data.views[index];
    let scale = view.width() as f32 / panel as f32;
    let height = ((view.height() as f32 / scale) as u32).max(1);
    let world_from_camera = view.world_from_camera(&data.frame);
    let (mut rays, mut at) = (Vec::new(), Vec::new());
    for i in 0..panel * height {
        let pixel = Vec2::new((i % panel) as f32 + 0.5, (i / panel) as f32 + 0.5) * scale;
        if let Some(ray) = view.ray(&world_from_camera, pixel) {
            rays.push(ray);
            at.push(i);
        }
    }
    let width = 4 * panel;
    let mut rgb = vec![0u8; (3 * width * height) as usize];
    let mut put = |at: u32, i: u32, colour: Vec3| {
        let x = at * panel + i % panel;
        let slot = 3 * ((i / panel) * width + x) as usize;
        for (byte, value) in rgb[slot..slot + 3].iter_mut().zip(colour.to_array()) {
            *byte = (255.0 * value.clamp(0.0, 1.0) + 0.5) as u8;
        }
    };
    for (&i, hit) in at.iter().zip(scene.render(&rays)) {
        let x = (((i % panel) as f32 + 0.5) * scale) as u32;
        let y = (((i / panel) as f32 + 0.5) * scale) as u32;
        let photo = view
            .photo
            .get_pixel(x.min(view.width() - 1), y.min(view.height() - 1))
            .0
            .map(|c| f32::from(c) / 255.0);
        put(0, i, Vec3::from(photo));
        put(1, i, Vec3::splat(hit.matte));
        put(2, i, Vec3::splat(0.5).lerp(hit.object, hit.matte));
        put(3, i, hit.background);
    }
    // The size fits by construction.
    RgbImage::from_raw(width, height, rgb).unwrap_or_default()
}
