//! A folder of masks: found, matched to the photos, and understood.

use crate::error::{ColmapError, remedy};
use crate::listing::Search;
use crate::mask_names::{Whole, match_masks};
use crate::photo::PICTURE_ENDINGS;
use crate::polarity::{Polarity, Share, decide};
use crate::scene::{Scene, same_shape};
use image::{DynamicImage, GrayImage};
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// An 8-bit image with one channel.
pub type GreyImage = GrayImage;

/// What is as bright as this is white.
const WHITE: u8 = 128;

/// Pictures below the mask folder and below that of the photos.
const PICTURES: Search<'static> = Search {
    depth: 4,
    endings: &PICTURE_ENDINGS,
    mask_folders: true,
};

/// The masks of a scene; photos without one are fine.
#[derive(Debug, Clone)]
pub struct MaskSet {
    /// Parallel to the views of [`Scene::model`]; `None` where a photo has no mask.
    pub paths: Vec<Option<PathBuf>>,
    /// What the files mean. [`MaskSet::load`] always returns white for the object.
    pub polarity: Polarity,
    /// Names of the photos without a mask.
    pub missing: Vec<String>,
    /// Decisions taken, one sentence each, for the user to see. The first is the summary.
    pub notes: Vec<String>,
    /// Files hold the labels 0 and 1 instead of black and white.
    labels: bool,
}

/// What one look at a mask file tells.
struct Look {
    size: (u32, u32),
    brightest: u8,
    /// As found, and with the labels 0 and 1 stretched to black and white.
    share: [Share; 2],
}

impl MaskSet {
    /// Finds the masks in `dir` that belong to the scene's photos.
    ///
    /// Names are tried in the forms that tools write (`a.png`, `a.jpg.png`, `a_mask.png`,
    /// `mask_a.png`, `a.mask.png`, `dynamic_mask_a.png`; also .jpg and .jpeg), then the number in
    /// them, then their order. Polarity is decided over all masks together unless given, or stated in the folder's
    /// [`POLARITY_FILE`](crate::POLARITY_FILE).
    ///
    /// # Errors
    /// [`ColmapError::Mask`] where nothing matches, a mask cannot be read or has another shape
    /// than its photo, or no mask shows an object.
    pub fn find(
        dir: &Path,
        scene: &Scene,
        polarity: Option<Polarity>,
    ) -> Result<MaskSet, ColmapError> {
        let files = MaskFiles::find(dir, scene)?;
        Self::of_files(dir, files, scene, polarity)
    }

    /// Looks into files that are already matched to photos. `place` is what messages name: the
    /// folder of the masks, or the file that lists them.
    ///
    /// # Errors
    /// As [`MaskSet::find`].
    pub fn of_files(
        place: &Path,
        files: MaskFiles,
        scene: &Scene,
        polarity: Option<Polarity>,
    ) -> Result<MaskSet, ColmapError> {
        let MaskFiles {
            paths,
            how,
            notes: about_files,
        } = files;
        let views = &scene.model.views;
        let photos: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let missing: Vec<String> = photos
            .iter()
            .zip(&paths)
            .filter(|(_, path)| path.is_none())
            .map(|(name, _)| (*name).to_owned())
            .collect();

        let looks: Vec<Look> = paths
            .par_iter()
            .zip(views)
            .filter_map(|(path, view)| {
                let path = path.as_ref()?;
                let photo_size = scene
                    .model
                    .cameras
                    .get(&view.camera_id)
                    .map(|c| (c.width, c.height));
                Some(look(path, &scene.image_path(view), photo_size))
            })
            .collect::<Result<_, _>>()?;
        // JPEG is left out: its noise turns black into ones here and there.
        let labels = paths
            .iter()
            .flatten()
            .all(|p| p.extension().is_some_and(is_png))
            && looks.iter().all(|look| look.brightest <= 1)
            && looks.iter().any(|look| look.brightest == 1);
        let shares: Vec<Share> = looks
            .iter()
            .map(|look| look.share[usize::from(labels)])
            .collect();
        if shares.iter().all(Share::is_plain) {
            let colour = if shares.iter().all(|s| s.all < 0.5) {
                "all black"
            } else if shares.iter().all(|s| s.all > 0.5) {
                "all white"
            } else {
                "of a single colour each"
            };
            return Err(ColmapError::mask(
                place,
                format!(
                    "the {} masks found are {colour}, so none shows an object",
                    shares.len()
                ),
                "check how they were exported, or run without masks",
            ));
        }

        if !labels
            && let Some(brightest) = looks.iter().map(|look| look.brightest).max()
            && brightest < WHITE
        {
            return Err(ColmapError::mask(
                place,
                format!(
                    "no pixel of the {} masks is brighter than {brightest} of 255, so none is white",
                    looks.len()
                ),
                "say which label is the object with --label, if they hold labels; else save them in black and white",
            ));
        }

        let (detected, reasons) = decide(&shares);
        let polarity = match polarity {
            Some(stated) => stated,
            None => Polarity::stated_in(place)?.unwrap_or(detected),
        };
        let mut summary = format!(
            "{} of {} photos have a mask ({}), {} have none",
            looks.len(),
            photos.len(),
            how,
            missing.len()
        );
        if !missing.is_empty() {
            let some: Vec<&str> = missing.iter().take(5).map(String::as_str).collect();
            let more = if missing.len() > some.len() {
                ", ..."
            } else {
                ""
            };
            summary.push_str(&format!(" ({}{more})", some.join(", ")));
        }
        let mut notes = vec![summary];
        notes.push(if polarity == detected {
            reasons
        } else {
            format!("{polarity} as stated, though the masks look like {reasons}")
        });
        notes.extend(about_files);
        if labels {
            notes.push("masks hold the labels 0 and 1, read as black and white".to_owned());
        }
        let resized = looks
            .iter()
            .zip(views.iter().zip(&paths).filter(|(_, p)| p.is_some()));
        let resized = resized
            .filter(|(look, (view, _))| {
                scene
                    .model
                    .cameras
                    .get(&view.camera_id)
                    .is_some_and(|c| look.size != (c.width, c.height))
            })
            .count();
        if resized > 0 {
            notes.push(format!(
                "{resized} masks have another size than their photo and are resized"
            ));
        }
        Ok(MaskSet {
            paths,
            polarity,
            missing,
            notes,
            labels,
        })
    }
}

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
        let views = &scene.model.views;
        let photos: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let list = |dir: &Path| {
            let listed = PICTURES.list(dir);
            listed.map_err(|e| ColmapError::io("list", dir, e))
        };
        // Sorted: a PNG comes after a JPEG of the same name.
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
        if files.is_empty() {
            let what = "the folder holds no masks (PNG, JPEG, WebP or TIFF files)";
            return Err(match listing.closed.first() {
                Some((closed, error)) => ColmapError::mask(
                    dir,
                    format!(
                        "{what}, and its sub-folder {} cannot be read ({error})",
                        closed.display()
                    ),
                    remedy(error),
                ),
                None => ColmapError::mask(dir, what, "give the folder the masks lie in"),
            });
        }
        let about_masks = listing.notes("masks");
        let about_photos = photo_listing.notes("photos");
        let whole = Whole {
            all_photos: about_photos.is_empty(),
            masks: about_masks.is_empty(),
        };
        let Some(matches) = match_masks(&photos, &all_photos, &files, whole) else {
            let mut what = format!(
                "none of the {} masks (such as {:?}) can be matched to one of the {} photos (such as {:?})",
                files.len(),
                files[0],
                photos.len(),
                photos.first().copied().unwrap_or_default()
            );
            let mut remedy = "name each mask like its photo, with the ending .png".to_owned();
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
        let unused = files.len() - paths.iter().flatten().count();
        if unused > 0 {
            notes.push(format!(
                "{unused} files in {} belong to no registered photo",
                dir.display()
            ));
        }
        Ok(MaskFiles {
            paths,
            how: matches.how,
            notes,
        })
    }
}

impl MaskSet {
    /// One line: how many masks were found, how, and which colour is the object.
    #[must_use]
    pub fn summary(&self) -> String {
        self.notes
            .iter()
            .take(2)
            .map(String::as_str)
            .collect::<Vec<_>>()
            .join("; ")
    }

    /// The mask of view `i`, white for the object, at the size asked for in pixels; `None` where
    /// the photo has no mask or there is no such view.
    ///
    /// # Errors
    /// [`ColmapError::Mask`] if the file cannot be read, or is of another shape.
    pub fn load(
        &self,
        i: usize,
        width: u32,
        height: u32,
    ) -> Result<Option<GreyImage>, ColmapError> {
        let Some(Some(path)) = self.paths.get(i) else {
            return Ok(None);
        };
        let mut mask = read_mask(path)?;
        let (w, h) = mask.dimensions();
        if (w, h) != (width, height) && !same_shape((w, h), (width, height)) {
            return Err(ColmapError::mask(
                path,
                format!("the mask is {w}x{h} but {width}x{height} is needed, another shape"),
                remedy_of_shape((w, h), (width, height)),
            ));
        }
        if self.labels {
            stretch_labels(&mut mask);
        }
        if self.polarity == Polarity::BlackIsObject {
            mask.iter_mut().for_each(|value| *value = 255 - *value);
        }
        if (w, h) != (width, height) {
            mask = image::imageops::resize(
                &mask,
                width,
                height,
                image::imageops::FilterType::Triangle,
            );
        }
        Ok(Some(mask))
    }
}

/// What to do about a mask of another shape than its photo.
fn remedy_of_shape((width, height): (u32, u32), photo: (u32, u32)) -> &'static str {
    if same_shape((height, width), photo) {
        "turn the mask, which lies on its side beside its photo: one of the two was not turned as the photo's EXIF says"
    } else {
        "make the mask from the photo itself, without cropping"
    }
}

fn look(path: &Path, photo: &Path, photo_size: Option<(u32, u32)>) -> Result<Look, ColmapError> {
    let mut mask = read_mask(path)?;
    let size = mask.dimensions();
    if let Some((w, h)) = photo_size
        && !same_shape(size, (w, h))
    {
        return Err(ColmapError::mask(
            path,
            format!(
                "the mask is {}x{} but its photo {} is {w}x{h}, another shape",
                size.0,
                size.1,
                photo.display()
            ),
            remedy_of_shape(size, (w, h)),
        ));
    }
    let brightest = mask.iter().copied().max().unwrap_or(0);
    let plain = Share::of(&mask);
    stretch_labels(&mut mask);
    Ok(Look {
        size,
        brightest,
        share: [plain, Share::of(&mask)],
    })
}

fn is_png(ending: &std::ffi::OsStr) -> bool {
    ending.eq_ignore_ascii_case("png")
}

fn stretch_labels(mask: &mut GreyImage) {
    mask.iter_mut()
        .for_each(|value| *value = value.saturating_mul(255));
}

/// A mask file as it is, whatever its polarity: its alpha where that says something, else its brightness.
///
/// What was stored in 16 bits without rescaling, such as the labels 0 and 1, keeps its values.
///
/// # Errors
/// [`ColmapError`] if the file cannot be read or decoded.
pub fn read_mask(path: &Path) -> Result<GreyImage, ColmapError> {
    let decoded = image::ImageReader::open(path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(|e| ColmapError::io("read", path, e))?
        .decode()
        .map_err(|e| {
            ColmapError::mask(
                path,
                format!("the mask cannot be decoded ({e})"),
                "it must be a PNG, JPEG, WebP or TIFF file; export it again",
            )
        })?;
    Ok(to_grey(&decoded))
}

fn to_grey(image: &DynamicImage) -> GreyImage {
    if image.color().has_alpha() {
        let alpha = image.to_rgba16();
        let first = alpha.pixels().next().map(|p| p.0[3]);
        if alpha.pixels().any(|p| Some(p.0[3]) != first) {
            return GreyImage::from_fn(alpha.width(), alpha.height(), |x, y| {
                image::Luma([eight_bits(alpha.get_pixel(x, y).0[3])])
            });
        }
    }
    if image.color().bytes_per_pixel() / image.color().channel_count() == 1 {
        return image.to_luma8();
    }
    let wide = image.to_luma16();
    // Some tools store 8-bit masks, or the labels 0 and 1, in 16 bits without rescaling. What is as dark throughout, but neither, is a
    // matte with next to nothing in it.
    let small = matches!(wide.iter().max(), None | Some(0 | 1 | 255));
    GreyImage::from_fn(wide.width(), wide.height(), |x, y| {
        let value = wide.get_pixel(x, y).0[0];
        image::Luma([if small {
            value as u8
        } else {
            eight_bits(value)
        }])
    })
}

fn eight_bits(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}
