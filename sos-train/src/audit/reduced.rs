//! A view at the size at which views are compared: few enough pixels that all of them fit into memory.

use super::depth::read_depth;
use crate::cells::around;
use crate::report::{ReportError, open_picture};
use crate::run_folder::{RunFolder, view_file};
use crate::squares::Squares;
use glam::{DVec2, DVec3};
use image::GrayImage;
use io_colmap::{Camera, MaskSet, Pose, Scene};

/// Longest side of a reduced view, in cells.
const LONGEST: u32 = 640;
/// From this byte on, a pixel is the object's.
pub(super) const HALF: u8 = 128;

/// What says where the object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outline {
    /// The run's own matte.
    Matte,
    /// The mask that the run was given.
    StartMask,
}

/// A view in squares of its pixels, which are its cells.
pub(super) struct ReducedView {
    /// The photo's name.
    pub(super) name: String,
    /// At the photo's own size.
    pub(super) camera: Camera,
    pub(super) camera_from_world: Pose,
    pub(super) squares: Squares,
    /// Mean coverage of each cell.
    pub(super) alpha: Vec<u8>,
    /// Along the optical axis at each cell's middle; 0 where nothing is. Empty without a depth file.
    pub(super) depth: Vec<f32>,
    /// Mean sRGB of each cell.
    pub(super) photo: Vec<[u8; 3]>,
    /// The start mask, mean of each cell; empty without one.
    pub(super) mask: Vec<u8>,
    /// Overlap of start mask and matte, at full size.
    pub(super) mask_iou: Option<f64>,
}

impl ReducedView {
    /// Reads view `index`; `None` if the run has no matte of it.
    pub(super) fn load(
        run: &RunFolder,
        scene: &Scene,
        masks: Option<&MaskSet>,
        index: usize,
    ) -> Result<Option<Self>, ReportError> {
        let view = &scene.model.views[index];
        let path = view_file(&run.alpha_dir(), &view.name, "png");
        let camera = scene.model.cameras.get(&view.camera_id);
        let (true, Some(camera)) = (path.is_file(), camera) else {
            return Ok(None);
        };
        let alpha = open_picture(&path)?.into_luma8();
        let photo = scene.read_photo(view)?.into_rgb8();
        let (w, h) = alpha.dimensions();
        if (w, h) != photo.dimensions() {
            return Err(ReportError::Picture {
                path,
                reason: format!(
                    "it is {w}x{h} but the photo is {}x{}",
                    photo.width(),
                    photo.height()
                ),
            });
        }
        let mask = masks.map(|masks| masks.load(index, w, h)).transpose()?;
        let mask = mask.flatten();
        let mask_iou = mask.as_ref().map(|mask| overlap(mask, &alpha));
        let depth = read_depth(&view_file(&run.depth_dir(), &view.name, "exr"), (w, h))?;

        let squares = Squares::new(w, h, LONGEST);
        let cells = || 0..squares.len();
        let mean = |cell: usize, of: &dyn Fn(u32, u32) -> u8| {
            let (mut sum, mut count) = (0u32, 0u32);
            for (x, y) in squares.pixels_of(cell) {
                sum += u32::from(of(x, y));
                count += 1;
            }
            ((sum + count / 2) / count.max(1)) as u8
        };
        Ok(Some(Self {
            name: view.name.clone(),
            camera: camera.scaled_to(w, h),
            camera_from_world: view.camera_from_world,
            squares,
            alpha: cells()
                .map(|cell| mean(cell, &|x, y| alpha.get_pixel(x, y).0[0]))
                .collect(),
            depth: depth.map_or(Vec::new(), |depth| {
                let middles = cells().map(|cell| squares.middle(cell));
                middles.map(|(x, y)| depth[(y * w + x) as usize]).collect()
            }),
            photo: cells()
                .map(|cell| [0, 1, 2].map(|c| mean(cell, &|x, y| photo.get_pixel(x, y).0[c])))
                .collect(),
            mask: mask.map_or(Vec::new(), |mask| {
                cells()
                    .map(|cell| mean(cell, &|x, y| mask.get_pixel(x, y).0[0]))
                    .collect()
            }),
            mask_iou,
        }))
    }

    /// What says where the object is.
    pub(super) fn outline(&self, by: Outline) -> &[u8] {
        match by {
            Outline::Matte => &self.alpha,
            Outline::StartMask => &self.mask,
        }
    }

    /// Where the object is at a cell, in the scene's frame; `None` where the outline has none, or the
    /// run found no surface.
    pub(super) fn point(
        &self,
        by: Outline,
        world_from_camera: &Pose,
        cell: usize,
    ) -> Option<DVec3> {
        let depth = f64::from(*self.depth.get(cell)?);
        if *self.outline(by).get(cell)? < HALF || depth <= 0.0 {
            return None;
        }
        let (x, y) = self.squares.middle(cell);
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let ray = self.camera.unproject(pixel).filter(|ray| ray.z > 0.0)?;
        Some(world_from_camera.transform_point(ray * (depth / ray.z)))
    }

    /// The cell in which a point of the scene's frame appears; `None` outside the photo.
    pub(super) fn cell(&self, world: DVec3) -> Option<usize> {
        let seen = self.camera_from_world.transform_point(world);
        if seen.z <= 0.0 {
            return None;
        }
        let pixel = self.camera.project(seen)?;
        let inside = pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(self.camera.width)
            && pixel.y < f64::from(self.camera.height);
        inside.then(|| self.squares.of(pixel.x as u32, pixel.y as u32))
    }

    /// The cell and its up to eight neighbours.
    pub(super) fn around(&self, cell: usize) -> impl Iterator<Item = usize> {
        around(cell, self.squares.columns as usize, self.squares.len())
    }
}

/// Overlap at one half; 1 if both are empty.
fn overlap(mask: &GrayImage, alpha: &GrayImage) -> f64 {
    let (mut both, mut either) = (0u64, 0u64);
    for (mask, alpha) in mask.as_raw().iter().zip(alpha.as_raw()) {
        let (mask, alpha) = (*mask >= HALF, *alpha >= HALF);
        both += u64::from(mask && alpha);
        either += u64::from(mask || alpha);
    }
    if either == 0 {
        1.0
    } else {
        both as f64 / either as f64
    }
}
