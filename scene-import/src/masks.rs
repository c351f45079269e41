//! Where masks come from, and how they get into the scene: always as one white-on-black PNG a photo.

use crate::coco::{self, Wanted};
use crate::error::ImportError;
use crate::gather::{Imported, common_folder};
use crate::labels::Labels;
use crate::write::photo_size;
use image::GrayImage;
use io_colmap::{
    IGNORE_FOLDER, MaskFiles, MaskSet, Polarity, Scene, alike_without_ending, same_shape, write_png,
};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Where to take masks from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum MaskSource {
    /// From where the poses' own files say, else from `masks/`, else from the photos' alpha
    /// channels, if any.
    #[default]
    Look,
    /// There are to be none.
    None,
    /// From the photos' alpha channels.
    Alpha,
    /// From a folder of pictures, or a COCO JSON file.
    Path(PathBuf),
}

/// What to do about masks.
#[derive(Debug, Clone, Default)]
pub struct MaskOptions {
    /// Where they come from.
    pub source: MaskSource,
    /// Which label of a label picture, or category of a COCO file, is the object.
    pub label: Option<u32>,
    /// Which colour of a plain mask is the object; `None` to find out.
    pub polarity: Option<Polarity>,
    /// The folder of pictures of what is not to be learned from; `None` for `ignore/` in the scene, if it has one.
    pub ignore: Option<PathBuf>,
}

/// A source that has been found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Chosen {
    None,
    /// If the photos have any.
    Alpha {
        required: bool,
    },
    Listed,
    Folder(PathBuf),
    Coco(PathBuf),
}

impl MaskOptions {
    pub(crate) fn choose(&self, imported: &Imported) -> Result<Chosen, ImportError> {
        let chosen = match &self.source {
            MaskSource::None => Chosen::None,
            MaskSource::Alpha => Chosen::Alpha { required: true },
            MaskSource::Path(path) if path.is_dir() => Chosen::Folder(path.clone()),
            MaskSource::Path(path) => {
                let json = path
                    .extension()
                    .is_some_and(|e| e.eq_ignore_ascii_case("json"));
                if !json || !path.is_file() {
                    return Err(ImportError::bad(
                        path,
                        if path.exists() {
                            "this is neither a folder nor a JSON file"
                        } else {
                            "there is no such folder or file"
                        },
                        "give the folder the masks lie in, or a COCO JSON file",
                    ));
                }
                Chosen::Coco(path.clone())
            }
            MaskSource::Look if imported.masks.iter().any(Option::is_some) => Chosen::Listed,
            MaskSource::Look => {
                let folder = imported.root.join("masks");
                if MaskFiles::are_in(&folder) {
                    Chosen::Folder(folder)
                } else {
                    Chosen::Alpha { required: false }
                }
            }
        };
        if let (Some(label), Chosen::None | Chosen::Alpha { .. }) = (self.label, &chosen) {
            return Err(ImportError::bad(
                &imported.root,
                format!("there are no masks to take the label {label} from"),
                "name the folder of label pictures or the COCO file with --masks",
            ));
        }
        Ok(chosen)
    }

    /// Refuses photos whose pictures of masks, or of what is ignored, would have one name, where there may be any.
    pub(crate) fn check_names(
        &self,
        chosen: &Chosen,
        imported: &Imported,
    ) -> Result<(), ImportError> {
        let has_masks = !matches!(chosen, Chosen::None | Chosen::Alpha { required: false });
        if !has_masks && self.ignored_in(imported).is_none() {
            return Ok(());
        }
        let names = imported.model.views.iter().map(|view| &*view.name);
        match alike_without_ending(names) {
            Some([first, second]) => Err(ImportError::bad(
                &imported.root,
                format!("the photos {first} and {second} would have one mask"),
                "rename one of the two, also where its pose is listed",
            )),
            None => Ok(()),
        }
    }

    /// The folder of pictures of what is not to be learned from, if there is one.
    fn ignored_in(&self, imported: &Imported) -> Option<PathBuf> {
        let beside = || Some(imported.root.join(IGNORE_FOLDER)).filter(|folder| folder.is_dir());
        self.ignore.clone().or_else(beside)
    }

    /// Writes the scene's masks into `out`, except those from alpha channels, which `alpha` says
    /// are there already. Returns their number and adds to the notes.
    pub(crate) fn write(
        &self,
        chosen: &Chosen,
        imported: &Imported,
        scene: &Scene,
        out: &Path,
        notes: &mut Vec<String>,
    ) -> Result<usize, ImportError> {
        let (place, files) = match chosen {
            Chosen::None | Chosen::Alpha { .. } => return Ok(0),
            Chosen::Coco(path) => return self.write_drawn(path, scene, out, notes),
            Chosen::Folder(folder) => {
                notes.push(format!("masks are taken from {}", folder.display()));
                let files = MaskFiles::find_among(folder, scene, &imported.unposed(folder))?;
                (folder.clone(), files)
            }
            Chosen::Listed => {
                let listed = imported.masks.iter().flatten();
                let files = MaskFiles {
                    paths: imported.masks.clone(),
                    how: "as listed with the poses".to_owned(),
                    notes: Vec::new(),
                };
                (common_folder(listed.map(PathBuf::as_path)), files)
            }
        };
        if let Some(label) = self.label {
            return write_label(label, &place, files, scene, out, notes);
        }
        let set = MaskSet::of_files(&place, files, scene, self.polarity)?;
        notes.extend(set.notes.iter().cloned());
        write_set(&set, scene, out)
    }

    /// Writes pictures of what is not to be learned from into `out`, white for that. Returns their number and adds to the
    /// notes.
    pub(crate) fn write_ignored(
        &self,
        imported: &Imported,
        scene: &Scene,
        out: &Path,
        notes: &mut Vec<String>,
    ) -> Result<usize, ImportError> {
        let Some(folder) = self.ignored_in(imported) else {
            return Ok(0);
        };
        let set = MaskSet::find_ignored_among(&folder, scene, &imported.unposed(&folder))?;
        notes.push(format!(
            "what is not to be learned from is taken from {}",
            folder.display()
        ));
        notes.extend(set.notes.iter().cloned());
        write_set(&set, scene, out)
    }

    fn write_drawn(
        &self,
        path: &Path,
        scene: &Scene,
        out: &Path,
        notes: &mut Vec<String>,
    ) -> Result<usize, ImportError> {
        let wanted: Vec<Wanted> = scene
            .model
            .views
            .iter()
            .map(|view| Wanted {
                name: &view.name,
                size: photo_size(&scene.model, view.camera_id),
            })
            .collect();
        let drawn = coco::draw(path, self.label, &wanted, |i, mask| {
            save(&mask, &mask_path(out, wanted[i].name))
        })?;
        notes.push(format!("masks are drawn from {}", path.display()));
        notes.extend(drawn.notes);
        notes.push(format!(
            "{} of {} photos have a mask",
            drawn.count,
            wanted.len()
        ));
        Ok(drawn.count)
    }
}

/// Writes pictures that belong to photos; returns their number.
fn write_set(set: &MaskSet, scene: &Scene, out: &Path) -> Result<usize, ImportError> {
    let views = scene.model.views.par_iter().enumerate();
    views
        .map(|(i, view)| {
            let Some(camera) = scene.model.cameras.get(&view.camera_id) else {
                return Ok(0);
            };
            match set.load(i, camera.width, camera.height)? {
                Some(mask) => save(&mask, &mask_path(out, &view.name)).map(|()| 1),
                None => Ok(0),
            }
        })
        .sum()
}

fn write_label(
    label: u32,
    place: &Path,
    files: MaskFiles,
    scene: &Scene,
    out: &Path,
    notes: &mut Vec<String>,
) -> Result<usize, ImportError> {
    let found: Vec<(bool, BTreeSet<u16>)> = scene
        .model
        .views
        .par_iter()
        .zip(&files.paths)
        .map(|(view, path)| {
            let Some(path) = path else {
                return Ok((false, BTreeSet::new()));
            };
            let labels = Labels::read(path)?;
            let photo = photo_size(&scene.model, view.camera_id);
            let size = labels.size();
            if !same_shape(size, photo) {
                return Err(ImportError::bad(
                    path,
                    format!(
                        "the label picture is {}x{} but its photo {} is {}x{}, another shape",
                        size.0, size.1, view.name, photo.0, photo.1
                    ),
                    "label the photo itself, without cropping or turning it",
                ));
            }
            save(&labels.mask(label), &mask_path(out, &view.name))?;
            Ok((true, labels.all()))
        })
        .collect::<Result<_, ImportError>>()?;
    let all: BTreeSet<u16> = found
        .iter()
        .flat_map(|(_, labels)| labels)
        .copied()
        .collect();
    if !all.iter().any(|found| u32::from(*found) == label) {
        let some: Vec<String> = all.iter().take(20).map(u16::to_string).collect();
        return Err(ImportError::bad(
            place,
            format!(
                "no picture has the label {label}; there are {}",
                some.join(", ")
            ),
            "choose one of them with --label",
        ));
    }
    let written = found.iter().filter(|(is_there, _)| *is_there).count();
    notes.push(format!(
        "label {label} is the object; {written} of {} photos have labels ({})",
        found.len(),
        files.how
    ));
    notes.extend(files.notes);
    Ok(written)
}

/// Where a photo's mask goes: its name, with another ending.
pub(crate) fn mask_path(folder: &Path, photo: &str) -> PathBuf {
    folder.join(photo).with_extension("png")
}

pub(crate) fn save(mask: &GrayImage, path: &Path) -> Result<(), ImportError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| ImportError::io("create", folder, e))?;
    }
    Ok(write_png(mask, path)?)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::format::Format;
    use io_colmap::{Model, Pose, View};

    #[test]
    fn photos_whose_masks_would_have_one_name_are_refused() {
        let view = |name: &str| View {
            id: 1,
            name: name.to_owned(),
            camera_id: 1,
            camera_from_world: Pose {
                rotation: glam::DQuat::IDENTITY,
                translation: glam::DVec3::ZERO,
            },
        };
        let of = |names: [&str; 2], chosen: Chosen, ignore: Option<&str>| {
            let imported = Imported {
                format: Format::Transforms,
                model: Model {
                    views: names.map(view).to_vec(),
                    ..Model::default()
                },
                photos: names.map(PathBuf::from).to_vec(),
                masks: vec![None; 2],
                root: PathBuf::from("no such scene"),
                notes: Vec::new(),
                dropped: Vec::new(),
            };
            let options = MaskOptions {
                ignore: ignore.map(PathBuf::from),
                ..MaskOptions::default()
            };
            options.check_names(&chosen, &imported)
        };
        let masks = || Chosen::Folder(PathBuf::from("masks"));
        let (apart, alike) = (["a/1.jpg", "b/1.jpg"], ["a/1.jpg", "a/1.png"]);
        assert!(of(apart, masks(), None).is_ok() && of(alike, Chosen::None, None).is_ok());
        for refused in [
            of(alike, masks(), None),
            of(alike, Chosen::None, Some("ignore")),
        ] {
            let said = refused.unwrap_err().to_string();
            assert!(
                said.contains("a/1.jpg and a/1.png would have one mask"),
                "{said}"
            );
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_mask_that_a_full_disk_does_not_take_is_an_error() {
        let said = save(&GrayImage::new(4, 4), Path::new("/dev/full")).unwrap_err();
        let said = said.to_string();
        assert!(said.starts_with("cannot write /dev/full: "), "{said}");
    }
}
