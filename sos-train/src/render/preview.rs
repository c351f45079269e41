//! A small picture of how the run is doing.

use glam::{Vec2, Vec3};

use super::rays::FrozenScene;
use crate::export::{ExportError, ViewRender, byte, write_preview};
use crate::prepare::Prepared;
use crate::prepare::pixels::Photo;
use crate::run_folder::RunFolder;
use image::{Rgb, RgbImage, imageops};

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

/// Writes `preview.png` of a view that is done: what its pictures show, which has what no field knows and its photo's outline.
///
/// # Errors
/// When the file cannot be written.
pub fn write_finished(
    run: &RunFolder,
    photo: &Photo,
    view: &ViewRender,
) -> Result<(), ExportError> {
    let height = (u64::from(view.height) * u64::from(PANEL) / u64::from(view.width.max(1))) as u32;
    let height = height.max(1);
    let mut strip = RgbImage::new(4 * PANEL, height);
    let mut put = |at: u32, small: RgbImage| {
        imageops::replace(&mut strip, &small, i64::from(at * PANEL), 0);
    };
    let small = |colour: &dyn Fn(usize) -> Vec3| {
        let picture = RgbImage::from_fn(view.width, view.height, |x, y| {
            Rgb(bytes(colour((y * view.width + x) as usize)))
        });
        imageops::thumbnail(&picture, PANEL, height)
    };
    let cut_out = |i: usize| Vec3::splat(0.5).lerp(view.foreground[i].into(), view.alpha[i]);
    put(0, imageops::thumbnail(photo, PANEL, height));
    put(1, small(&|i| Vec3::splat(view.alpha[i])));
    put(2, small(&cut_out));
    put(3, small(&|i| view.background[i].into()));
    write_preview(run, strip.width(), strip.height(), strip.as_raw())
}

fn bytes(colour: Vec3) -> [u8; 3] {
    colour.to_array().map(byte)
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
        rgb[slot..slot + 3].copy_from_slice(&bytes(colour));
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::prepare::pixels::PixelStore;
    use crate::run_folder::Existing;

    #[test]
    fn a_finished_preview_shows_what_the_pictures_do() {
        let dir = tempfile::tempdir().unwrap();
        let run = RunFolder::create(dir.path(), Existing::Keep).unwrap();
        let (width, height) = (2 * PANEL, 20);
        let pixels = (width * height) as usize;
        let left = |i: usize| (i as u32) % width < PANEL;
        let view = ViewRender {
            name: "a.png".to_owned(),
            width,
            height,
            alpha: (0..pixels).map(|i| f32::from(left(i))).collect(),
            foreground: vec![[1.0, 0.0, 0.0]; pixels],
            background: vec![[0.0, 0.0, 1.0]; pixels],
            seen: vec![0; pixels],
            normal: vec![[0.0; 3]; pixels],
            depth: vec![0.0; pixels],
        };
        let photo = RgbImage::from_pixel(width, height, Rgb([9, 90, 200]));
        let photo = PixelStore::new(dir.path()).keep_photo(photo).unwrap();
        write_finished(&run, &photo, &view).unwrap();
        let strip = image::open(run.preview_path()).unwrap().to_rgb8();
        assert_eq!(strip.dimensions(), (4 * PANEL, height / 2));
        let at = |panel: u32, x: u32| strip.get_pixel(panel * PANEL + x, 5).0;
        let (on, off) = (PANEL / 4, 3 * PANEL / 4);
        assert_eq!(at(0, on), [9, 90, 200]);
        assert_eq!([at(1, on), at(1, off)], [[255; 3], [0; 3]]);
        assert_eq!([at(2, on), at(2, off)], [[255, 0, 0], [128; 3]]);
        assert_eq!([at(3, on), at(3, off)], [[0, 0, 255]; 2]);
    }
}
