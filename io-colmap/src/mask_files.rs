//! Which files of a folder are masks of which photos.

use crate::error::{ColmapError, remedy};
use crate::listing::{Listing, Search};
use crate::mask_kind::MaskKind;
use crate::mask_names::{Whole, match_masks};
use crate::photo::PICTURE_ENDINGS;
use crate::scene::Scene;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Pictures below the mask folder and below that of the photos.
const PICTURES: Search<'static> = Search {
    depth: 4,
    endings: &PICTURE_ENDINGS,
    mask_folders: true,
};

/// Which file is whose mask, as far as names tell; what is in them has not been looked at.
#[derive(Debug, Clone)]
pub struct MaskFiles {
    /// Parallel to the views of [`Scene::model`]; `None` where a photo has no mask.
    pub paths: Vec<Option<PathBuf>>,
    /// How they were matched, in a few words.
    pub how: String,
    /// What a user should know about that, a sentence each.
    pub notes: Vec<String>,
}

impl MaskFiles {
    /// Whether a folder is there with a picture in it, or with something that cannot be read and may be one.
    #[must_use]
    pub fn are_in(dir: &Path) -> bool {
        dir.is_dir()
            && PICTURES.list(dir).map_or(true, |listing| {
                !(listing.names.is_empty() && listing.closed.is_empty())
            })
    }

    /// Matches the pictures in `dir` to the scene's photos by the names that tools give masks.
    ///
    /// # Errors
    /// [`ColmapError::Mask`] where nothing matches.
    pub fn find(dir: &Path, scene: &Scene) -> Result<MaskFiles, ColmapError> {
        Self::find_among(dir, scene, &Listing::default())
    }

    /// As [`MaskFiles::find`] of a scene that holds a part of the photos. The `others` are those that lie elsewhere, such
    /// as the ones without a pose: there may be masks of them too, and numbers and order count all photos.
    ///
    /// # Errors
    /// As [`MaskFiles::find`].
    pub fn find_among(
        dir: &Path,
        scene: &Scene,
        others: &Listing,
    ) -> Result<MaskFiles, ColmapError> {
        Self::find_kind(dir, scene, others, MaskKind::Masks)
    }

    pub(crate) fn find_kind(
        dir: &Path,
        scene: &Scene,
        others: &Listing,
        kind: MaskKind,
    ) -> Result<MaskFiles, ColmapError> {
        let (one, many) = (kind.one(), kind.many());
        let views = &scene.model.views;
        let photos: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let list = |dir: &Path| {
            let listed = PICTURES.list(dir);
            listed.map_err(|e| ColmapError::io("list", dir, e))
        };
        let mut listing = list(dir)?;
        let mut files = std::mem::take(&mut listing.names);
        // What cannot be read of these has none of the scene's registered photos: they were opened.
        let mut photo_listing = list(&scene.image_dir)?;
        let mut all_photos = std::mem::take(&mut photo_listing.names);
        if let (Ok(dir), Ok(images)) = (dir.canonicalize(), scene.image_dir.canonicalize()) {
            if dir == images {
                let registered: HashSet<&str> = photos.iter().copied().collect();
                files.retain(|file| !registered.contains(file.as_str()));
            }
            // Masks below the photo folder are not photos, whose numbers they might resemble.
            all_photos.retain(|file| !images.join(file).starts_with(&dir));
        }
        all_photos.extend_from_slice(&others.names);
        if files.is_empty() {
            let what = format!("the folder holds no {many} (PNG, JPEG, WebP or TIFF files)");
            return Err(match listing.closed.first() {
                Some((closed, error)) => ColmapError::mask(
                    dir,
                    format!(
                        "{what}, and its sub-folder {} cannot be read ({error})",
                        closed.display()
                    ),
                    remedy(error),
                ),
                None => ColmapError::mask(dir, what, format!("give the folder the {many} lie in")),
            });
        }
        let about_masks = listing.notes(many);
        let mut about_photos = photo_listing.notes("photos");
        about_photos.extend(others.notes("photos"));
        let whole = Whole {
            all_photos: about_photos.is_empty(),
            masks: about_masks.is_empty(),
        };
        let Some(matches) = match_masks(&photos, &all_photos, &files, whole) else {
            let mut what = format!(
                "none of the {} {many} (such as {:?}) can be matched to one of the {} photos (such as {:?})",
                files.len(),
                files[0],
                photos.len(),
                photos.first().copied().unwrap_or_default()
            );
            let mut remedy = format!("name each {one} like its photo, with the ending .png");
            if let Some(unknown) = about_masks.iter().chain(&about_photos).next() {
                what.push_str(&format!(", and their order is not known: {unknown}"));
                remedy = format!("make all of them readable, or {remedy}");
            }
            return Err(ColmapError::mask(dir, what, remedy));
        };
        let paths: Vec<Option<PathBuf>> = matches
            .mask_of
            .iter()
            .map(|m| m.map(|i| dir.join(&files[i])))
            .collect();
        let mut notes: Vec<String> = matches.guess.into_iter().collect();
        notes.extend(about_masks);
        let used: HashSet<usize> = matches.mask_of.iter().flatten().copied().collect();
        let unused = files.len() - used.len();
        if let Some(first) = (0..files.len()).find(|i| !used.contains(i)) {
            notes.push(format!(
                "{unused} files in {}, such as {}, belong to no registered photo, or to one that has a mask",
                dir.display(),
                files[first]
            ));
        }
        Ok(MaskFiles {
            paths,
            how: matches.how,
            notes,
        })
    }
}
