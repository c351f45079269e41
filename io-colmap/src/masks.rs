//! A folder of masks: found, matched to the photos, and understood.

use crate::error::ColmapError;
use crate::listing::Listing;
use crate::mask_files::MaskFiles;
use crate::mask_kind::MaskKind;
use crate::mask_pixels::{MaskPixels, Reading, decode};
use crate::model::View;
use crate::photo_likeness::{is_like_photo, refuse_photos};
use crate::polarity::{Polarity, Share, decide};
use crate::scene::{Scene, same_shape};
use image::GrayImage;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// An 8-bit image with one channel.
pub type GreyImage = GrayImage;

/// What is as bright as this is white.
const WHITE: u8 = 128;

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
    reading: Reading,
    /// Whether alpha channels are the masks, also of photos that have the same alpha everywhere.
    of_cutouts: bool,
    kind: MaskKind,
}

/// What one look at a mask file tells.
struct Look {
    size: (u32, u32),
    /// The largest number in it, and whether it is one of 16 bits.
    largest: u16,
    is_wide: bool,
    is_like_photo: bool,
    /// Whether there is an alpha channel, and whether it is the mask.
    has_alpha: bool,
    is_alpha: bool,
    /// For each of [`Reading::ALL`].
    shares: [Share; 3],
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
    /// than its photo, most of them look like photos, or no mask shows an object.
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
        Self::look_into(place, files, scene, polarity, MaskKind::Masks)
    }

    /// Finds the pictures in `dir` that say what is to be ignored in the scene's photos, whatever is not black. There
    /// may be nothing in any of them. Names are tried as those of masks.
    ///
    /// # Errors
    /// [`ColmapError::Mask`] where nothing matches, a picture cannot be read or has another shape than its photo, or
    /// most of them look like photos.
    pub fn find_ignored(dir: &Path, scene: &Scene) -> Result<MaskSet, ColmapError> {
        Self::find_ignored_among(dir, scene, &Listing::default())
    }

    /// As [`MaskSet::find_ignored`], with `others` as of [`MaskFiles::find_among`].
    ///
    /// # Errors
    /// As [`MaskSet::find_ignored`].
    pub fn find_ignored_among(
        dir: &Path,
        scene: &Scene,
        others: &Listing,
    ) -> Result<MaskSet, ColmapError> {
        let files = MaskFiles::find_kind(dir, scene, others, MaskKind::Ignored)?;
        Self::look_into(dir, files, scene, None, MaskKind::Ignored)
    }

    fn look_into(
        place: &Path,
        files: MaskFiles,
        scene: &Scene,
        polarity: Option<Polarity>,
        kind: MaskKind,
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

        let mut looks: Vec<Look> = paths
            .par_iter()
            .zip(views)
            .filter_map(|(path, view)| Some(look(path.as_ref()?, scene, view, kind, false)))
            .collect::<Result<_, _>>()?;
        let of_cutouts = looks.iter().any(|look| look.is_alpha);
        if of_cutouts {
            let views = views.iter().zip(&paths);
            let files = views.filter_map(|(view, path)| Some((view, path.as_ref()?)));
            for (seen, (view, path)) in looks.iter_mut().zip(files) {
                if seen.has_alpha && !seen.is_alpha {
                    *seen = look(path, scene, view, kind, true)?;
                }
            }
        }
        let looked_at = paths.iter().flatten().zip(&looks);
        let looked_at = looked_at.map(|(path, look)| (path, look.is_like_photo));
        refuse_photos(place, &looked_at.collect::<Vec<_>>(), kind)?;
        let reading = reading_of(&paths, &looks);
        let shares: Vec<Share> = looks
            .iter()
            .map(|look| look.shares[reading as usize])
            .collect();
        let (polarity, meaning) = match kind {
            MaskKind::Ignored => (
                Polarity::WhiteIsObject,
                "what is not black is ignored".to_owned(),
            ),
            MaskKind::Masks => {
                refuse_without_object(place, &looks, &shares, reading)?;
                let (detected, reasons) = decide(&shares);
                let polarity = match polarity {
                    Some(stated) => stated,
                    None => Polarity::stated_in(place)?.unwrap_or(detected),
                };
                if polarity == detected {
                    (polarity, reasons)
                } else {
                    let though =
                        format!("{polarity} as stated, though the masks look like {reasons}");
                    (polarity, though)
                }
            }
        };
        let mut summary = format!(
            "{} of {} photos have {} ({}), {} have none",
            looks.len(),
            photos.len(),
            kind.any(),
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
        let mut notes = vec![summary, meaning];
        notes.extend(about_files);
        if reading == Reading::Labels {
            notes.push(format!(
                "{} hold the labels 0 and 1, read as black and white",
                kind.many()
            ));
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
                "{resized} {} have another size than their photo and are resized",
                kind.many()
            ));
        }
        Ok(MaskSet {
            paths,
            polarity,
            missing,
            notes,
            reading,
            of_cutouts,
            kind,
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
        let decoded = decode(path, self.kind)?;
        let mut mask = MaskPixels::of(&decoded, self.of_cutouts).into_grey(self.reading);
        let (w, h) = mask.dimensions();
        if (w, h) != (width, height) && !same_shape((w, h), (width, height)) {
            return Err(ColmapError::mask(
                path,
                format!(
                    "the {} is {w}x{h} but {width}x{height} is needed, another shape",
                    self.kind.one()
                ),
                self.kind.remedy_for_shape((w, h), (width, height)),
            ));
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

fn look(
    path: &Path,
    scene: &Scene,
    view: &View,
    kind: MaskKind,
    of_cutouts: bool,
) -> Result<Look, ColmapError> {
    let decoded = decode(path, kind)?;
    let pixels = MaskPixels::of(&decoded, of_cutouts);
    let size = pixels.size();
    let camera = scene.model.cameras.get(&view.camera_id);
    if let Some(photo) = camera.map(|camera| (camera.width, camera.height))
        && !same_shape(size, photo)
    {
        return Err(ColmapError::mask(
            path,
            format!(
                "the {} is {}x{} but its photo {} is {}x{}, another shape",
                kind.one(),
                size.0,
                size.1,
                view.name,
                photo.0,
                photo.1
            ),
            kind.remedy_for_shape(size, photo),
        ));
    }
    Ok(Look {
        size,
        largest: pixels.largest(),
        is_wide: pixels.is_wide(),
        is_like_photo: is_like_photo(&pixels, &decoded),
        has_alpha: decoded.color().has_alpha(),
        is_alpha: pixels.is_alpha(),
        shares: Reading::ALL.map(|reading| Share::of(size, |x, y| pixels.byte(x, y, reading))),
    })
}

/// One for all files: in some the object, or the highest label, is not seen.
fn reading_of(paths: &[Option<PathBuf>], looks: &[Look]) -> Reading {
    // JPEG is left out: its noise turns black into ones here and there.
    let may_be_labels = paths
        .iter()
        .flatten()
        .all(|p| p.extension().is_some_and(is_png));
    let largest = looks.iter().map(|look| look.largest).max();
    let wide = looks.iter().filter(|look| look.is_wide);
    if may_be_labels && largest == Some(1) {
        Reading::Labels
    } else if wide.map(|look| look.largest).max() <= Some(255) {
        Reading::Bytes
    } else {
        Reading::Full
    }
}

fn refuse_without_object(
    place: &Path,
    looks: &[Look],
    shares: &[Share],
    reading: Reading,
) -> Result<(), ColmapError> {
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
    let bytes = looks
        .iter()
        .map(|look| reading.byte(look.largest, look.is_wide));
    match bytes.max() {
        Some(brightest) if brightest < WHITE => Err(ColmapError::mask(
            place,
            format!(
                "no pixel of the {} masks is brighter than {brightest} of 255, so none is white",
                looks.len()
            ),
            "say which label is the object with --label, if they hold labels; else save them in black and white",
        )),
        _ => Ok(()),
    }
}

fn is_png(ending: &std::ffi::OsStr) -> bool {
    ending.eq_ignore_ascii_case("png")
}
