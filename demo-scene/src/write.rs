//! The scene on disk.

use std::fs;
use std::io;
use std::path::Path;

use draft_folder::{Draft, DraftError, Durability, Occupant};
use image::{DynamicImage, ImageError, ImageFormat};
use rayon::prelude::*;

use crate::colmap_text;
use crate::error::DemoError;
use crate::scene::{DemoScene, DemoView};

/// Says whether [`DemoScene::write`] may write into `dir`, before anything is rendered for it.
///
/// # Errors
/// [`DemoError::Occupied`] when `dir` holds something; otherwise what the file system says.
pub fn check_vacant(dir: &Path) -> Result<(), DemoError> {
    match Occupant::of(dir).map_err(failed(dir))? {
        None => Ok(()),
        Some(occupant) => Err(DemoError::Occupied {
            path: dir.to_owned(),
            occupant,
        }),
    }
}

impl DemoScene {
    /// Writes the scene into the folder `dir`, which must not exist yet or be empty:
    ///
    /// ```text
    /// images/NNN.png                photos
    /// alpha_gt/NNN.png              coverage by the visible target
    /// background_gt/NNN.png         without the target and without its shadow
    /// background_shadow_gt/NNN.png  without the target, with its shadow
    /// coarse_masks/NNN.png          flawed segmentations; two are missing
    /// mesh_gt.ply                   the target's surface
    /// sparse/0/{cameras,images,points3D}.txt
    /// ```
    ///
    /// Everything goes to a sibling folder first, which is renamed at the end: `dir` never holds
    /// half a scene.
    ///
    /// # Errors
    /// [`DemoError::Occupied`] when `dir` holds something; otherwise what the file system says.
    pub fn write(&self, dir: &Path) -> Result<(), DemoError> {
        check_vacant(dir)?;
        let draft = Draft::beside(dir)?;
        self.write_into(draft.path())?;
        Ok(draft.finish()?)
    }

    fn write_into(&self, dir: &Path) -> Result<(), DemoError> {
        type Layer = fn(&DemoView) -> Option<DynamicImage>;
        let layers: [(&str, Layer); 5] = [
            ("images", |view| Some(view.photo.clone().into())),
            ("alpha_gt", |view| Some(view.alpha.clone().into())),
            ("background_gt", |view| Some(view.background.clone().into())),
            ("background_shadow_gt", |view| {
                Some(view.background_shadow.clone().into())
            }),
            ("coarse_masks", |view| {
                view.coarse_mask.clone().map(Into::into)
            }),
        ];
        for (name, layer) in layers {
            let folder = dir.join(name);
            fs::create_dir_all(&folder).map_err(failed(&folder))?;
            self.views.par_iter().try_for_each(|view| {
                let path = folder.join(&view.name);
                match layer(view) {
                    Some(picture) => save(&picture, &path),
                    None => Ok(()),
                }
            })?;
        }
        let model = dir.join("sparse").join("0");
        fs::create_dir_all(&model).map_err(failed(&model))?;
        let names = ["cameras.txt", "images.txt", "points3D.txt"];
        for (name, text) in names.iter().zip(colmap_text::model(self)) {
            let path = model.join(name);
            fs::write(&path, text).map_err(failed(&path))?;
        }
        let path = dir.join("mesh_gt.ply");
        draft_folder::write_file(&path, Durability::Program, |out| self.mesh.write(out, &[]))?;
        Ok(())
    }
}

/// `image`'s own `save` drops what the last flush says, such as that the disk is full.
fn save(picture: &DynamicImage, path: &Path) -> Result<(), DemoError> {
    draft_folder::write_file(path, Durability::Program, |out| {
        let written = picture.write_to(out, ImageFormat::Png);
        written.map_err(|error| match error {
            ImageError::IoError(error) => error,
            other => io::Error::other(other.to_string()),
        })
    })?;
    Ok(())
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> DraftError + use<> {
    let path = path.to_owned();
    |source| DraftError {
        action: "write",
        path,
        source,
    }
}
