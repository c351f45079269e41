//! A posed photo and its rough mask, as training and rendering use them.

use glam::{Affine3A, DVec3, Vec2, Vec3};
use image::GrayImage;
use image::imageops::{FilterType, resize};
use io_colmap::{Camera, ColmapError, MaskSet, Model, Pose, Scene, View};
use neus_render::rays::{Projection, Ray};
use rayon::prelude::*;
use std::path::Path;

use super::error::PrepareError;
use super::frame::Frame;
use super::mask::Mask;
use super::pixels::{Photo, PixelStore};

/// How photos are made smaller. A tent as wide as two of the new pixels: what is finer does not come back as a pattern.
const SMALLER: FilterType = FilterType::Triangle;
/// Ignore pictures that hide a larger share of all photos are the wrong way round: what walks by does not.
const MOST_IGNORED: f64 = 0.95;

/// A lens, as the renderer asks for it.
#[derive(Clone, Debug)]
pub struct Lens(pub Camera);

impl Projection for Lens {
    fn unproject(&self, pixel: Vec2) -> Option<Vec3> {
        self.0.unproject(pixel.as_dvec2()).map(|d| d.as_vec3())
    }

    fn project(&self, point: Vec3) -> Option<Vec2> {
        self.0.project(point.as_dvec3()).map(|p| p.as_vec2())
    }
}

/// One photo of the scene.
#[derive(Clone, Debug)]
pub struct TrainView {
    /// The photo's name as the model has it, with subfolders.
    pub name: String,
    /// The lens at the photo's size.
    pub lens: Lens,
    /// Pose in the scene's own frame.
    pub camera_from_world: Pose,
    /// The photo, 8-bit sRGB.
    pub photo: Photo,
    /// The rough mask, where there is one.
    pub mask: Option<Mask>,
    /// Where the photo is not to be learned from, where that was said.
    pub ignored: Option<Mask>,
    /// Where all of these are kept.
    pub store: PixelStore,
}

impl TrainView {
    /// The same view at `1 / factor` of its width and height, averaged.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for it.
    pub fn downscaled(&self, factor: u32) -> Result<Self, PrepareError> {
        let part = |pixels: u32| (pixels / factor.max(1)).max(1);
        let (width, height) = (part(self.width()), part(self.height()));
        let smaller = |mask: &Mask| resize(&mask.picture(), width, height, SMALLER);
        let (mask, ignored) = (self.mask.as_ref(), self.ignored.as_ref());
        let photo = resize(&self.photo, width, height, SMALLER);
        Ok(Self {
            name: self.name.clone(),
            lens: Lens(self.lens.0.scaled_to(width, height)),
            camera_from_world: self.camera_from_world,
            photo: self.store.keep_photo(photo)?,
            mask: mask
                .map(|mask| Mask::of_white(&smaller(mask), &self.store))
                .transpose()?,
            // A pixel that holds any of it is out.
            ignored: ignored
                .map(|mask| Mask::of_not_black(&smaller(mask), &self.store))
                .transpose()?,
            store: self.store.clone(),
        })
    }

    /// A mask of the photo at its full size as a view of this size has it, white is the object.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for it.
    pub(crate) fn fitting(&self, mask: &GrayImage) -> Result<Mask, PrepareError> {
        let smaller = resize(mask, self.width(), self.height(), SMALLER);
        Mask::of_white(&smaller, &self.store)
    }

    /// The same view with another rough mask, white is the object.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for it.
    pub fn with_mask(self, mask: &GrayImage) -> Result<Self, PrepareError> {
        Ok(Self {
            mask: Some(Mask::of_white(mask, &self.store)?),
            ..self
        })
    }

    /// Whether a pixel of the photo is not to be learned from.
    #[must_use]
    pub fn ignores(&self, x: u32, y: u32) -> bool {
        self.ignored.as_ref().is_some_and(|all| all.contains(x, y))
    }

    /// Bytes that take room in memory for good.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        let masks = [&self.mask, &self.ignored].into_iter().flatten();
        let masks = masks.map(Mask::in_memory);
        self.photo.as_raw().in_memory() + masks.sum::<usize>()
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.photo.width()
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.photo.height()
    }

    /// Where a point of the scene's frame lies in the photo, and its depth; `None` outside it.
    #[must_use]
    pub fn project(&self, world: DVec3) -> Option<(Vec2, f32)> {
        let p = self.camera_from_world.transform_point(world);
        if p.z <= 0.0 {
            return None;
        }
        let pixel = self.lens.0.project(p)?.as_vec2();
        let inside = pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < self.width() as f32
            && pixel.y < self.height() as f32;
        inside.then_some((pixel, p.z as f32))
    }

    /// Where it was taken from, in the normalised frame.
    #[must_use]
    pub fn camera_centre(&self, frame: &Frame) -> Vec3 {
        self.world_from_camera(frame).translation.into()
    }

    /// Pose in the normalised frame.
    #[must_use]
    pub fn world_from_camera(&self, frame: &Frame) -> Affine3A {
        frame.world_from_camera(&self.camera_from_world)
    }

    /// How wide a pixel is at the middle of the object's box, in the normalised frame.
    #[must_use]
    pub fn pixel_at_object(&self, frame: &Frame) -> f64 {
        let (fx, fy) = self.lens.0.focal();
        let distance = (self.camera_from_world.centre() - frame.centre).length();
        distance.max(1e-9) / (frame.half_side * (fx * fy).sqrt())
    }

    /// The ray through a pixel position, in the normalised frame.
    #[must_use]
    pub fn ray(&self, world_from_camera: &Affine3A, pixel: Vec2) -> Option<Ray> {
        let direction = self.lens.unproject(pixel)?;
        Ray::new(
            world_from_camera.translation.into(),
            world_from_camera.transform_vector3(direction),
        )
    }
}

/// The views at `1 / factor` of their width and height.
///
/// # Errors
/// [`PrepareError::Store`] when there is no room for them.
pub(crate) fn all_downscaled(
    views: Vec<TrainView>,
    factor: u32,
) -> Result<Vec<TrainView>, PrepareError> {
    let views = views.into_par_iter();
    views.map(|view| view.downscaled(factor)).collect()
}

/// The camera of a view.
///
/// # Errors
/// [`PrepareError::Scene`] where the model lacks it.
pub(crate) fn camera_of<'a>(model: &'a Model, view: &View) -> Result<&'a Camera, PrepareError> {
    model.cameras.get(&view.camera_id).ok_or_else(|| {
        PrepareError::Scene(format!(
            "{}: the model has no camera {}; export it again",
            view.name, view.camera_id
        ))
    })
}

/// Reads every registered photo and its mask.
///
/// What is too much for the memory lies in files of the system's folder for temporary ones (`TMPDIR`).
///
/// # Errors
/// When a photo or a mask can't be read, or there is no room for them.
pub fn load_views(scene: &Scene, masks: Option<&MaskSet>) -> Result<Vec<TrainView>, PrepareError> {
    let store = PixelStore::new(&std::env::temp_dir());
    scene
        .model
        .views
        .par_iter()
        .enumerate()
        .map(|(i, view)| {
            let photo = store.keep_photo(scene.read_photo(view)?.into_rgb8())?;
            let mask = match masks {
                Some(masks) => masks.load(i, photo.width(), photo.height())?,
                None => None,
            };
            let mask = mask.map(|mask| Mask::of_white(&mask, &store)).transpose()?;
            let camera = camera_of(&scene.model, view)?;
            Ok(TrainView {
                name: view.name.clone(),
                lens: Lens(camera.scaled_to(photo.width(), photo.height())),
                camera_from_world: view.camera_from_world,
                photo,
                mask,
                ignored: None,
                store: store.clone(),
            })
        })
        .collect()
}

/// Reads what is not to be learned from in the photos of [`load_views`].
///
/// # Errors
/// When a picture can't be read or has another shape than its photo, or there is no room for it.
pub fn load_ignored(views: &mut [TrainView], ignored: &MaskSet) -> Result<(), PrepareError> {
    let loaded = views.par_iter_mut().enumerate().map(|(i, view)| {
        let ignored = ignored.load(i, view.width(), view.height())?;
        view.ignored = ignored
            .map(|ignored| Mask::of_not_black(&ignored, &view.store))
            .transpose()?;
        Ok(())
    });
    loaded.collect::<Result<(), PrepareError>>()?;
    let hidden = views.iter().filter_map(|view| view.ignored.as_ref());
    let hidden: u64 = hidden.map(|mask| mask.area() as u64).sum();
    let all = views.iter();
    let all: u64 = all
        .map(|view| u64::from(view.width()) * u64::from(view.height()))
        .sum();
    let share = hidden as f64 / all.max(1) as f64;
    if share > MOST_IGNORED {
        return Err(PrepareError::Scene(format!(
            "the ignore pictures hide {:.0} % of the photos, and what is not black in them is not learned from; invert \
             them if black is what is to be left out, or leave them away",
            100.0 * share
        )));
    }
    Ok(())
}

/// Matches the pictures in `dir` to the scene's photos; what is not black in them is not to be learned
/// from. Nothing may be, in any photo.
///
/// # Errors
/// [`ColmapError::Mask`] where none belongs to a photo, or one cannot be read.
pub fn find_ignored(dir: &Path, scene: &Scene) -> Result<MaskSet, ColmapError> {
    MaskSet::find_ignored(dir, scene)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn nothing_may_be_ignored_in_any_photo() {
        let dir = tempfile::tempdir().unwrap();
        let [image_dir, ignore] = ["images", "ignore"].map(|name| dir.path().join(name));
        for folder in [&image_dir, &ignore] {
            std::fs::create_dir(folder).unwrap();
        }
        let mut model = Model::default();
        model.views.push(View {
            id: 1,
            name: "a.jpg".to_owned(),
            camera_id: 1,
            camera_from_world: Pose::IDENTITY,
        });
        let scene = Scene {
            root: dir.path().to_owned(),
            image_dir,
            model,
            notes: Vec::new(),
        };
        let black = GrayImage::new(8, 8);
        black.save(ignore.join("a.png")).unwrap();
        let found = find_ignored(&ignore, &scene).unwrap();
        assert_eq!(found.load(0, 8, 8).unwrap(), Some(black));
    }
}
