//! Masks for COLMAP: where not to look for features.

use crate::error::CaptureError;
use crate::photos::{Photo, PhotoSet};
use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, Luma};
use io_colmap::{MaskFiles, Model, Pose, Scene, View, read_mask, write_png};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Sizes of mask and photo differ in shape by no more than this, in pixels of the mask.
const ROUNDING: f64 = 2.0;
/// A mask that is nowhere as bright has no white.
const WHITE: u8 = 128;

/// Writes a mask per photo into `out`, as COLMAP wants them: `a.jpg.png`, of the photo's size, black
/// where features are ignored. Photos without a mask get a white one: some versions of COLMAP take
/// the whole photo where the file is missing, others none of it.
///
/// Returns what a user should know.
pub(crate) fn write(
    masks: &Path,
    photos: &PhotoSet,
    out: &Path,
) -> Result<Vec<String>, CaptureError> {
    if !masks.is_dir() {
        return Err(CaptureError::bad(
            masks,
            "there is no such folder",
            "give a folder with a mask per photo, of the same name",
        ));
    }
    let files = MaskFiles::find(masks, &named_views(photos))?;
    files.refuse_photos(masks)?;
    let as_stored = are_as_stored(photos, &files.paths);
    let black = photos
        .photos
        .par_iter()
        .zip(&files.paths)
        .map(|(photo, path)| {
            let mask = match path {
                Some(path) => read(path, photo, as_stored)?,
                None => GrayImage::from_pixel(photo.size.0, photo.size.1, Luma([255])),
            };
            let to = out.join(format!("{}.png", photo.name));
            if let Some(folder) = to.parent() {
                std::fs::create_dir_all(folder)
                    .map_err(|e| CaptureError::io("create", folder, e))?;
            }
            write_png(&mask, &to)?;
            Ok(usize::from(mask.iter().all(|value| *value == 0)))
        })
        .sum::<Result<usize, CaptureError>>()?;
    let count = files.paths.iter().flatten().count();
    if black == count {
        return Err(CaptureError::bad(
            masks,
            format!("the {count} masks found are all black, so they leave nothing to look at"),
            "check how they were exported, or capture without masks",
        ));
    }
    let mut notes = vec![format!(
        "features are looked for where masks are not black; {count} of {} photos have one ({})",
        photos.photos.len(),
        files.how
    )];
    if black > 0 {
        notes.push(format!(
            "{black} masks are all black: nothing is looked for in their photos"
        ));
    }
    notes.extend(files.notes);
    let masked = photos.photos.iter().zip(&files.paths);
    let unclear = masked.filter(|(photo, path)| {
        path.is_some() && photo.orientation != Orientation::NoTransforms && !shape_tells(photo)
    });
    let unclear = unclear.count();
    if unclear > 0 {
        let taken = match as_stored {
            true => "turned like the photos, as others are of photos as they were stored",
            false => "taken to be upright",
        };
        notes.push(format!(
            "masks whose shape does not tell whether they are turned: {unclear}, {taken}"
        ));
    }
    Ok(notes)
}

/// Whether the masks are of photos as they were stored: one of a photo that was turned on its side shows it by its shape.
fn are_as_stored(photos: &PhotoSet, masks: &[Option<PathBuf>]) -> bool {
    photos.photos.iter().zip(masks).any(|(photo, mask)| {
        let mask = mask.as_ref().filter(|_| shape_tells(photo));
        let lies = |(width, height)| {
            !is_shaped((width, height), photo.size) && is_shaped((height, width), photo.size)
        };
        mask.is_some_and(|mask| image::image_dimensions(mask).is_ok_and(lies))
    })
}

/// Whether a mask of the photo as it was stored has another shape than one of the photo as it is seen.
fn shape_tells(photo: &Photo) -> bool {
    let on_its_side = !matches!(
        photo.orientation,
        Orientation::NoTransforms
            | Orientation::Rotate180
            | Orientation::FlipHorizontal
            | Orientation::FlipVertical
    );
    on_its_side && !is_shaped((photo.size.1, photo.size.0), photo.size)
}

/// The photos as views without cameras, which is enough to match names.
fn named_views(photos: &PhotoSet) -> Scene {
    let view = |(id, photo): (u32, &Photo)| View {
        id,
        name: photo.name.clone(),
        camera_id: 0,
        camera_from_world: Pose::IDENTITY,
    };
    Scene {
        root: photos.root.clone(),
        image_dir: photos.root.clone(),
        model: Model {
            views: (1..).zip(&photos.photos).map(view).collect(),
            ..Model::default()
        },
        notes: Vec::new(),
    }
}

/// Black and white at the photo's size; white is from half the mask's brightest value on, or all numbers of objects. A mask of the photo `as_stored`
/// is turned like the photo, as is one whose shape says so.
fn read(path: &Path, photo: &Photo, as_stored: bool) -> Result<GrayImage, CaptureError> {
    let size = photo.size;
    let mut mask = read_mask(path)?;
    let turned = photo.orientation != Orientation::NoTransforms;
    if turned && (!is_shaped(mask.dimensions(), size) || as_stored && !shape_tells(photo)) {
        let mut turned = DynamicImage::ImageLuma8(mask);
        turned.apply_orientation(photo.orientation);
        mask = turned.into_luma8();
    }
    let (width, height) = mask.dimensions();
    if (width, height) != size {
        if !is_shaped(mask.dimensions(), size) {
            return Err(CaptureError::bad(
                path,
                format!(
                    "the mask is {width}x{height} but its photo {}x{}, another shape",
                    size.0, size.1
                ),
                "make the mask from the photo itself, without cropping or turning",
            ));
        }
        let nearest = image::imageops::FilterType::Nearest;
        mask = image::imageops::resize(&mask, size.0, size.1, nearest);
    }
    let brightest = mask.iter().copied().max().unwrap_or_default();
    let is_png = path
        .extension()
        .is_some_and(|it| it.eq_ignore_ascii_case("png"));
    // Without white, these are numbers of objects. JPEG is left out: its noise turns black into ones here and there.
    let least = match brightest < WHITE && is_png {
        true => 1,
        false => brightest.div_ceil(2).max(1),
    };
    for value in mask.iter_mut() {
        *value = if *value >= least { 255 } else { 0 };
    }
    Ok(mask)
}

fn is_shaped(mask: (u32, u32), size: (u32, u32)) -> bool {
    let scaled = f64::from(mask.0) * f64::from(size.1) / f64::from(size.0);
    (scaled - f64::from(mask.1)).abs() <= ROUNDING
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use image::{ImageBuffer, RgbImage, Rgba, RgbaImage};

    /// Folders of photos, 16 x 8, of masks and of what is written.
    fn folders(names: &[&str]) -> (tempfile::TempDir, [PathBuf; 3]) {
        let dir = tempfile::tempdir().unwrap();
        let folders = ["photos", "m", "out"].map(|name| dir.path().join(name));
        for folder in &folders {
            std::fs::create_dir(folder).unwrap();
        }
        for name in names {
            RgbImage::new(16, 8).save(folders[0].join(name)).unwrap();
        }
        (dir, folders)
    }

    #[test]
    fn every_photo_gets_a_mask_that_colmap_understands() {
        let (dir, [photos, masks, out]) = folders(&["a.jpg", "b.png", "c.png"]);
        // Labels 0, 1 and 3, at half the size; black and white, of another name.
        let mut small = GrayImage::new(8, 4);
        small.put_pixel(0, 0, Luma([1]));
        small.put_pixel(7, 3, Luma([3]));
        small.save(masks.join("a.png")).unwrap();
        GrayImage::new(16, 8)
            .save(masks.join("b_mask.png"))
            .unwrap();
        let set = PhotoSet::find(&photos).unwrap();
        let notes = write(&masks, &set, &out).unwrap();
        assert!(notes[0].contains("2 of 3 photos"), "{notes:?}");
        assert!(notes[1].contains("1 masks are all black"), "{notes:?}");
        let whites = |name: &str| {
            let mask = image::open(out.join(name)).unwrap().into_luma8();
            assert_eq!(mask.dimensions(), (16, 8));
            mask.iter().filter(|value| **value == 255).count()
        };
        assert_eq!(whites("a.jpg.png"), 8);
        assert_eq!(whites("b.png.png"), 0);
        assert_eq!(whites("c.png.png"), 128);

        GrayImage::new(8, 8).save(masks.join("c.png")).unwrap();
        let said = write(&masks, &set, &out).unwrap_err().to_string();
        assert!(
            said.contains("8x8 but its photo 16x8, another shape"),
            "{said}"
        );
        std::fs::write(masks.join("c.png"), "no mask").unwrap();
        let said = write(&masks, &set, &out).unwrap_err().to_string();
        assert!(said.contains("c.png: the mask cannot be decoded"), "{said}");
        let said = write(&dir.path().join("x"), &set, &out).unwrap_err();
        assert!(said.to_string().contains("no such folder"));
    }

    #[test]
    fn photos_are_no_masks() {
        let names = ["a.png", "b.png", "c.png"];
        // Photos in a folder beside them, of the same names.
        let (_dir, [photos, others, out]) = folders(&names);
        let colours = RgbImage::from_fn(16, 8, |x, y| {
            image::Rgb([(15 * x) as u8, (30 * y) as u8, 80])
        });
        for name in names {
            colours.save(others.join(name)).unwrap();
        }
        let set = PhotoSet::find(&photos).unwrap();
        let said = write(&others, &set, &out).unwrap_err().to_string();
        assert!(said.contains("3 of the 3 masks looked at"), "{said}");
        assert!(std::fs::read_dir(&out).unwrap().next().is_none());
    }

    #[test]
    fn masks_are_read_as_training_reads_them() {
        let (_dir, [photos, masks, out]) = folders(&["a.png", "b.png", "c.png"]);
        let inside = |x: u32| x < 4;
        // A cut-out of something dark before something bright; the labels 0 and 1 in 16 bits.
        let cut_out = RgbaImage::from_fn(16, 8, |x, _| match inside(x) {
            true => Rgba([10, 10, 10, 255]),
            false => Rgba([250, 250, 250, 0]),
        });
        cut_out.save(masks.join("a.png")).unwrap();
        let labels = ImageBuffer::from_fn(16, 8, |x, _| Luma([u16::from(inside(x))]));
        labels.save(masks.join("b.png")).unwrap();
        let set = PhotoSet::find(&photos).unwrap();
        write(&masks, &set, &out).unwrap();
        for name in ["a.png.png", "b.png.png"] {
            let mask = image::open(out.join(name)).unwrap().into_luma8();
            let expected =
                GrayImage::from_fn(16, 8, |x, _| Luma([if inside(x) { 255 } else { 0 }]));
            assert!(mask == expected, "{name}");
        }
    }

    #[test]
    fn masks_that_lie_on_their_sides_tell_how_the_others_are_turned() {
        let (_dir, [photos, masks, out]) = folders(&["a.png", "b.png", "c.png"]);
        let left = GrayImage::from_fn(16, 8, |x, _| Luma([if x < 4 { 255 } else { 0 }]));
        left.save(masks.join("b.png")).unwrap();
        let mut set = PhotoSet::find(&photos).unwrap();
        set.photos[0].size = (8, 16);
        set.photos[0].orientation = Orientation::Rotate90;
        set.photos[1].orientation = Orientation::Rotate180;
        let white_column = || {
            let mask = image::open(out.join("b.png.png")).unwrap().into_luma8();
            [0, 15].map(|x| mask.get_pixel(x, 3).0[0] == 255)
        };
        let notes = write(&masks, &set, &out).unwrap();
        assert_eq!(white_column(), [true, false]);
        assert!(
            notes
                .iter()
                .any(|note| note.contains("taken to be upright")),
            "{notes:?}"
        );
        left.save(masks.join("a.png")).unwrap();
        let notes = write(&masks, &set, &out).unwrap();
        assert_eq!(white_column(), [false, true]);
        assert!(
            notes
                .iter()
                .any(|note| note.contains("as they were stored")),
            "{notes:?}"
        );
    }

    #[test]
    fn masks_that_leave_nothing_are_refused() {
        let (_dir, [photos, masks, out]) = folders(&["a.png", "b.png", "c.png"]);
        for name in ["a.png", "b.png"] {
            GrayImage::new(16, 8).save(masks.join(name)).unwrap();
        }
        let set = PhotoSet::find(&photos).unwrap();
        let said = write(&masks, &set, &out).unwrap_err().to_string();
        assert!(
            said.contains(
                "m: the 2 masks found are all black, so they leave nothing to look at; check how"
            ),
            "{said}"
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_mask_that_a_full_disk_does_not_take_is_an_error() {
        let (_dir, [photos, masks, out]) = folders(&["a.png", "b.png", "c.png"]);
        let white = GrayImage::from_pixel(16, 8, Luma([255]));
        white.save(masks.join("a.png")).unwrap();
        std::os::unix::fs::symlink("/dev/full", out.join("a.png.png")).unwrap();
        let set = PhotoSet::find(&photos).unwrap();
        let said = write(&masks, &set, &out).unwrap_err().to_string();
        assert!(
            said.contains("out/a.png.png: ") && said.ends_with("; free some space"),
            "{said}"
        );
    }
}
