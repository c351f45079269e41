//! A COLMAP scene on disk.

use crate::alpha;
use crate::error::ImportError;
use crate::gather::{Dropped, Imported};
use crate::masks::{Chosen, MaskOptions, mask_path, save};
use draft_folder::{Draft, Occupant};
use io_colmap::{Model, POLARITY_FILE, PhotoHeader, Polarity, Scene, picture_error, read_photo};
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
    /// Decisions taken, one sentence each: those of the import, and those about masks.
    pub notes: Vec<String>,
}

impl Imported {
    /// Makes a scene folder: photos in `images/`, the model in `sparse/0/`, masks in `masks/` (white
    /// is the object), and in `import.txt` what was decided.
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
        let draft = Draft::beside(out)?;
        let written = self.fill(draft.path(), masks, &chosen)?;
        draft.finish()?;
        Ok(written)
    }

    fn fill(
        &self,
        folder: &Path,
        masks: &MaskOptions,
        chosen: &Chosen,
    ) -> Result<Written, ImportError> {
        let (imported, rewritten) = self.with_final_names()?;
        let views = &imported.model.views;
        let (images, mask_dir) = (folder.join("images"), folder.join("masks"));
        let with_alpha: Vec<bool> = (0..views.len())
            .into_par_iter()
            .map(|i| {
                let (view, photo) = (&views[i], &imported.photos[i]);
                let to = images.join(&view.name);
                create_parent(&to)?;
                if !rewritten[i] {
                    fs::copy(photo, &to).map_err(|e| ImportError::io("copy", photo, e))?;
                    return Ok(false);
                }
                let picture = read_photo(photo, size(&imported.model, view.camera_id))?;
                alpha::flatten(&picture)
                    .save(&to)
                    .map_err(|e| ImportError::io("write", &to, picture_error(e)))?;
                match (chosen, alpha::mask(&picture)) {
                    (Chosen::Alpha { .. }, Some(mask)) => {
                        save(&mask, &mask_path(&mask_dir, &view.name)).map(|()| true)
                    }
                    _ => Ok(false),
                }
            })
            .collect::<Result<_, ImportError>>()?;
        imported.model.write_binary(&folder.join("sparse/0"))?;

        let mut notes = imported.notes.clone();
        let anew = rewritten.iter().filter(|anew| **anew).count();
        if anew > 0 {
            notes.push(format!(
                "{anew} photos are written anew as PNG, upright and without alpha"
            ));
        }
        let scene = Scene::open(folder)?;
        let mut count = masks.write(chosen, &imported, &scene, &mask_dir, &mut notes)?;
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
        let text = folder.join("import.txt");
        fs::write(&text, self.record(&notes)).map_err(|e| ImportError::io("write", &text, e))?;
        Ok(Written {
            photos: views.len(),
            masks: count,
            notes,
        })
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
                Ok(header.has_alpha || header.is_turned_for(size(&self.model, view.camera_id)))
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
        let mut examples: Vec<(&Dropped, usize)> = Vec::new();
        for dropped in &self.dropped {
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

fn size(model: &Model, camera_id: u32) -> (u32, u32) {
    let camera = model.cameras.get(&camera_id);
    camera.map_or((0, 0), |camera| (camera.width, camera.height))
}

fn create_parent(path: &Path) -> Result<(), ImportError> {
    let parent: PathBuf = path.parent().map(Path::to_path_buf).unwrap_or_default();
    fs::create_dir_all(&parent).map_err(|e| ImportError::io("create", &parent, e))
}
