//! A COLMAP scene on disk.

use crate::alpha;
use crate::error::ImportError;
use crate::gather::{Dropped, Imported};
use crate::masks::{Chosen, MaskOptions, mask_path, save};
use draft_folder::{Draft, Occupant};
use io_colmap::{
    ColmapError, IGNORE_FOLDER, Model, POLARITY_FILE, PhotoHeader, Polarity, Scene, read_photo,
    write_png,
};
use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Number of photos, which is that of views.
    pub photos: usize,
    /// Number of masks.
    pub masks: usize,
    /// Number of photos with something that is not to be learned from.
    pub ignored: usize,
    /// Decisions taken, one sentence each: those of the import, and those about masks.
    pub notes: Vec<String>,
}

impl Imported {
    /// Makes a scene folder: photos in `images/`, the model in `sparse/0/`, masks in `masks/` (white
    /// is the object), what is not to be learned from in `ignore/` (white too), and in `import.txt` what was decided.
    ///
    /// Photos are copied. Those with an alpha channel, or that have to be turned, are written anew,
    /// as PNG. The folder appears when it is complete.
    ///
    /// # Errors
    /// [`ImportError`] if `out` is there and not empty, cannot be written to, a photo or mask cannot
    /// be read, or masks do not fit.
    pub fn write(&self, out: &Path, masks: &MaskOptions) -> Result<Written, ImportError> {
        let chosen = masks.choose(self)?;
        let elsewhere = "name a folder that is empty or does not exist";
        if out.is_file() {
            return Err(ImportError::bad(out, "this is a file", elsewhere));
        }
        // What cannot be listed is refused by what is written there.
        if let Ok(Some(occupant)) = Occupant::of(out) {
            return Err(ImportError::bad(
                out,
                format!("there is something in it already, {occupant}"),
                occupant.remedy(elsewhere),
            ));
        }
        let (imported, rewritten) = self.with_final_names()?;
        masks.check_names(&chosen, &imported)?;
        let draft = Draft::beside(out)?;
        let written = imported
            .fill(draft.path(), masks, &chosen, &rewritten)
            .map_err(|error| imported.outside(error, draft.path(), out))?;
        draft.finish()?;
        Ok(written)
    }

    /// The views have their final names here; `rewritten` says which photos are written anew.
    fn fill(
        &self,
        folder: &Path,
        masks: &MaskOptions,
        chosen: &Chosen,
        rewritten: &[bool],
    ) -> Result<Written, ImportError> {
        // First, as it refuses names that cannot be.
        self.model.write_binary(&folder.join("sparse/0"))?;
        let views = &self.model.views;
        let (images, mask_dir) = (folder.join("images"), folder.join("masks"));
        let with_alpha: Vec<bool> = (0..views.len())
            .into_par_iter()
            .map(|i| {
                let (view, photo) = (&views[i], &self.photos[i]);
                let to = images.join(&view.name);
                create_parent(&to)?;
                if !rewritten[i] {
                    fs::copy(photo, &to).map_err(|e| ImportError::io("copy", photo, e))?;
                    return Ok(false);
                }
                let picture = read_photo(photo, photo_size(&self.model, view.camera_id))?;
                write_png(&alpha::flatten(&picture), &to)?;
                match (chosen, alpha::mask(&picture)) {
                    (Chosen::Alpha { .. }, Some(mask)) => {
                        save(&mask, &mask_path(&mask_dir, &view.name)).map(|()| true)
                    }
                    _ => Ok(false),
                }
            })
            .collect::<Result<_, ImportError>>()?;

        let mut notes = self.notes.clone();
        let anew = rewritten.iter().filter(|anew| **anew).count();
        if anew > 0 {
            notes.push(format!(
                "{anew} photos are written anew as PNG, upright and without alpha"
            ));
        }
        let scene = Scene::open(folder)?;
        let mut count = masks.write(chosen, self, &scene, &mask_dir, &mut notes)?;
        let from_alpha = with_alpha.iter().filter(|mask| **mask).count();
        if from_alpha > 0 {
            count = from_alpha;
            notes.push(format!(
                "{from_alpha} of {} photos have a mask in their alpha channel",
                views.len()
            ));
        } else if matches!(chosen, Chosen::Alpha { required: true }) {
            return Err(ImportError::bad(
                &self.root,
                "no photo has an alpha channel that says anything",
                "name another source of masks, or none",
            ));
        }
        if count > 0 {
            // So that whoever reads them need not guess, and cannot guess otherwise than the user has said here.
            let path = mask_dir.join(POLARITY_FILE);
            let text = format!("{}\n", Polarity::WhiteIsObject);
            fs::write(&path, text).map_err(|e| ImportError::io("write", &path, e))?;
        }
        let ignore_dir = folder.join(IGNORE_FOLDER);
        let ignored = masks.write_ignored(self, &scene, &ignore_dir, &mut notes)?;
        let text = folder.join("import.txt");
        fs::write(&text, self.record(&notes)).map_err(|e| ImportError::io("write", &text, e))?;
        Ok(Written {
            photos: views.len(),
            masks: count,
            ignored,
            notes,
        })
    }

    /// The same about files that last: the draft is gone before the error is read. Photos in it are copies.
    fn outside(&self, mut error: ImportError, draft: &Path, out: &Path) -> ImportError {
        let is_about_photo = matches!(error, ImportError::Colmap(ColmapError::Scene { .. }));
        let path = error.path_mut();
        let lasting = path.strip_prefix(draft).ok().map(|inner| {
            let mut photos = self.model.views.iter().zip(&self.photos);
            let original = photos
                .find(|(view, _)| is_about_photo && Path::new("images").join(&view.name) == inner);
            original.map_or_else(|| out.join(inner), |(_, photo)| photo.clone())
        });
        if let Some(lasting) = lasting {
            *path = lasting;
        }
        error
    }

    /// With the names that photos will have: those that are written anew become PNG files. Also
    /// says which.
    fn with_final_names(&self) -> Result<(Imported, Vec<bool>), ImportError> {
        let anew: Vec<bool> = self
            .model
            .views
            .par_iter()
            .zip(&self.photos)
            .map(|(view, photo)| {
                let header = PhotoHeader::read(photo)?;
                Ok(header.has_alpha
                    || header.is_turned_for(photo_size(&self.model, view.camera_id)))
            })
            .collect::<Result<_, ImportError>>()?;
        let mut order: Vec<usize> = (0..self.photos.len()).collect();
        let names: Vec<String> = self
            .model
            .views
            .iter()
            .zip(&anew)
            .map(|(view, anew)| match anew {
                true => Path::new(&view.name)
                    .with_extension("png")
                    .to_string_lossy()
                    .into_owned(),
                false => view.name.clone(),
            })
            .collect();
        order.sort_by(|&a, &b| names[a].cmp(&names[b]));
        if let Some(&[a, b]) = order.array_windows().find(|[a, b]| names[*a] == names[*b]) {
            return Err(ImportError::bad(
                &self.photos[b],
                format!(
                    "this photo and {} would both be written as images/{}",
                    self.photos[a].display(),
                    names[a]
                ),
                "rename one of the two, also where its pose is listed",
            ));
        }
        let mut imported = self.clone();
        imported.model.views = order
            .iter()
            .map(|&i| io_colmap::View {
                name: names[i].clone(),
                ..self.model.views[i].clone()
            })
            .collect();
        imported.photos = order.iter().map(|&i| self.photos[i].clone()).collect();
        imported.masks = order.iter().map(|&i| self.masks[i].clone()).collect();
        Ok((imported, order.iter().map(|&i| anew[i]).collect()))
    }

    /// The text of `import.txt`.
    fn record(&self, notes: &[String]) -> String {
        let mut text = format!("Imported from {} ({}).\n", self.root.display(), self.format);
        for note in notes {
            text.push_str(&format!("- {note}\n"));
        }
        for dropped in &self.dropped {
            text.push_str(&format!(
                "- left out: {} {}\n",
                dropped.name,
                dropped.reason()
            ));
        }
        text
    }

    /// One sentence for each reason for which views were left out, with an example.
    #[must_use]
    pub fn dropped_sentences(&self) -> Vec<String> {
        Dropped::sentences(&self.dropped)
    }
}

impl Dropped {
    /// One sentence for each reason for which these were left out, with an example.
    #[must_use]
    pub fn sentences<'a>(all: impl IntoIterator<Item = &'a Dropped>) -> Vec<String> {
        let mut examples: Vec<(&Dropped, usize)> = Vec::new();
        for dropped in all {
            match examples.iter_mut().find(|(it, _)| it.why == dropped.why) {
                Some((_, count)) => *count += 1,
                None => examples.push((dropped, 1)),
            }
        }
        examples
            .into_iter()
            .map(|(example, count)| {
                let (name, reason) = (&example.name, example.reason());
                match count {
                    1 => format!("left out: {name} {reason}"),
                    _ => format!("{count} views are left out: {name}, for one, {reason}"),
                }
            })
            .collect()
    }
}

/// The size of the photos of a camera.
pub(crate) fn photo_size(model: &Model, camera_id: u32) -> (u32, u32) {
    let camera = model.cameras.get(&camera_id);
    camera.map_or((0, 0), |camera| (camera.width, camera.height))
}

fn create_parent(path: &Path) -> Result<(), ImportError> {
    let parent: PathBuf = path.parent().map(Path::to_path_buf).unwrap_or_default();
    fs::create_dir_all(&parent).map_err(|e| ImportError::io("create", &parent, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::Format;
    use io_colmap::{Pose, View};

    #[test]
    fn errors_name_files_that_last() {
        let mut model = Model::default();
        model.views.push(View {
            id: 1,
            name: "left/a.png".to_owned(),
            camera_id: 1,
            camera_from_world: Pose::IDENTITY,
        });
        let imported = Imported {
            format: Format::Transforms,
            model,
            photos: vec![PathBuf::from("scene/photos/a.webp")],
            masks: vec![None],
            root: PathBuf::from("scene"),
            notes: Vec::new(),
            dropped: Vec::new(),
        };
        let place = |error: ImportError| {
            let mut error = imported.outside(error, Path::new("draft"), Path::new("out"));
            error.path_mut().clone()
        };
        let scene = |path: &str| {
            ImportError::Colmap(ColmapError::Scene {
                path: PathBuf::from(path),
                what: String::new(),
                remedy: String::new(),
            })
        };
        let copy = "draft/images/left/a.png";
        assert_eq!(place(scene(copy)), Path::new("scene/photos/a.webp"));
        assert_eq!(place(scene("draft/sparse/0")), Path::new("out/sparse/0"));
        assert_eq!(place(scene("masks/a.png")), Path::new("masks/a.png"));
        // What was to be written is not the original.
        let full = std::io::ErrorKind::StorageFull.into();
        let error = ImportError::io("write", Path::new(copy), full);
        assert_eq!(place(error), Path::new("out/images/left/a.png"));
    }
}
