//! Masks with the faults of rough segmenters, made from true ones: what a method that refines masks is
//! started from to learn how much it mends.
//!
//! Each fault is made by growing a region to a share of the object's area, so that its size does not
//! depend on the scene. With the share at 0.2, IoU with the truth is about 0.8 for all but
//! [`Fault::HalfMissing`].

use crate::EvalError;
use crate::growth::grow;
use crate::matching::{left_out, list_pictures, match_views};
use crate::mattes::Mattes;
use crate::picture::{Mask, RgbPlane, Sized2d, assert_same_size, read_rgb};
use crate::report::MASK_THRESHOLD;
use crate::splitmix::SplitMix64;
use draft_folder::{Draft, DraftError, Durability};
use image::{GrayImage, ImageError, ImageFormat};
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// Colour distance, in 0..=1 per channel, that makes a step of a growing region ten times as long.
const COLOUR_STEP: f32 = 0.02;

/// What is wrong with masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Fault {
    /// The outline lies inside the object all around: the share of its pixels nearest to the outline is
    /// lost.
    Eroded,
    /// The outline lies outside: the object grows to `1 / (1 - share)` of its area.
    Dilated,
    /// An extremity is lost, another one in every view: the share of its pixels farthest in a random
    /// direction.
    PartMissing,
    /// Something beside the object is taken for a part of it, another thing in every view: a region that
    /// starts at the outline and spreads over similar colours.
    NeighbourIncluded,
    /// Every second view has no mask; the others are right.
    HalfMissing,
    /// In a share of the views the mask shows something else, as large as the object; the others are
    /// right.
    SomeWrong,
}

impl Fault {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Eroded,
        Self::Dilated,
        Self::PartMissing,
        Self::NeighbourIncluded,
        Self::HalfMissing,
        Self::SomeWrong,
    ];
}

/// One true mask with a fault; `None` where the fault is that there is none.
///
/// `index` is the view's place among all views, `share` the size of the fault in 0..1, and `seed` with
/// `index` decides what is left to chance. A picture that shows nothing of the object stays empty.
///
/// # Panics
/// If the sizes of mask and photo differ.
#[must_use]
pub fn degrade(
    truth: &Mask,
    photo: &RgbPlane,
    fault: Fault,
    share: f64,
    index: usize,
    seed: u64,
) -> Option<Mask> {
    assert_same_size("degrade", truth, photo);
    let mut chance = Chance::of(seed, index);
    let area = truth.count();
    let part = |of: f64| (area as f64 * of).round() as usize;
    let around = 1.0 / (1.0 - share) - 1.0;
    match fault {
        Fault::Eroded => {
            let rim = grow(
                truth.size(),
                rim_of(truth, false),
                |p| truth.inside[p],
                |_| 1.0,
                part(share),
            );
            Some(without(truth, &rim))
        }
        Fault::Dilated => {
            let ring = grow(
                truth.size(),
                rim_of(truth, true),
                |p| !truth.inside[p],
                |_| 1.0,
                part(around),
            );
            Some(with(truth, &ring))
        }
        Fault::PartMissing => Some(without(
            truth,
            &extremity(truth, chance.angle(), part(share)),
        )),
        Fault::NeighbourIncluded => {
            let outside: Vec<usize> = rim_of(truth, true).collect();
            let Some(&start) = chance.one_of(&outside) else {
                return Some(truth.clone());
            };
            let open = |p: usize| !truth.inside[p];
            let leak = grow(
                truth.size(),
                [start],
                open,
                likeness(photo, start),
                part(around),
            );
            Some(with(truth, &leak))
        }
        Fault::HalfMissing => index.is_multiple_of(2).then(|| truth.clone()),
        Fault::SomeWrong => {
            // Spread over the views, not drawn one by one, so that the share holds for few views too.
            let (before, now) = (index as f64 * share, (index + 1) as f64 * share);
            if before.floor() as usize == now.floor() as usize {
                return Some(truth.clone());
            }
            let outside: Vec<usize> = (0..truth.inside.len())
                .filter(|&p| !truth.inside[p])
                .collect();
            let start = *chance.one_of(&outside)?;
            let open = |p: usize| !truth.inside[p];
            let other = grow(truth.size(), [start], open, likeness(photo, start), area);
            Some(with(&nothing_like(truth), &other))
        }
    }
}

/// What [`degrade_folder`] wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Degraded {
    /// Number of masks.
    pub count: usize,
    /// What of the folders was left out, a sentence each.
    pub notes: Vec<String>,
}

/// Writes masks with a fault, an 8-bit PNG per view of `gt_dir` into the folder `out`, which appears when
/// all of them are there and may not hold anything before.
///
/// `photo_dir` holds a picture per view, matched as in [`compare_folders`](crate::compare_folders).
///
/// # Errors
/// When a folder or picture cannot be read, photos and mattes differ in size, a view has no photo, or a
/// mask cannot be written.
pub fn degrade_folder(
    gt_dir: &Path,
    photo_dir: &Path,
    fault: Fault,
    share: f64,
    seed: u64,
    out: &Path,
) -> Result<Degraded, EvalError> {
    let truth = list_pictures(gt_dir)?;
    let photos = match_views(gt_dir, &truth.pictures, photo_dir)?;
    let mattes = Mattes::of(gt_dir, &truth.pictures)?;
    let draft = Draft::beside(out)?;
    let views: Vec<_> = truth.pictures.iter().enumerate().collect();
    let written = views.par_iter().map(|&(index, (name, path))| {
        let matte = mattes.read(path)?;
        let photo_path = photos.pictures.get(name).ok_or_else(|| {
            let nowhere = EvalError::NoPhoto { view: name.clone() };
            photos.lacks(photo_dir, format!("photo of view {name:?}"), nowhere)
        })?;
        let photo = read_rgb(photo_path)?;
        if photo.size() != matte.size() {
            return Err(EvalError::SizeMismatch {
                path: photo_path.clone(),
                size: photo.size(),
                truth: path.clone(),
                truth_size: matte.size(),
            });
        }
        let mask = matte.mask(MASK_THRESHOLD);
        let Some(mask) = degrade(&mask, &photo, fault, share, index, seed) else {
            return Ok(0);
        };
        let file = format!("{name}.png");
        save(&picture(&mask), &draft.path().join(&file)).map_err(|error| DraftError {
            path: out.join(&file),
            ..error
        })?;
        Ok(1)
    });
    let count = written.sum::<Result<usize, EvalError>>()?;
    draft.finish()?;
    let mut notes = left_out([&truth, &photos]);
    notes.extend(mattes.note());
    Ok(Degraded { count, notes })
}

fn picture(mask: &Mask) -> GrayImage {
    GrayImage::from_fn(mask.width as u32, mask.height as u32, |x, y| {
        let inside = mask.inside[y as usize * mask.width + x as usize];
        image::Luma([if inside { 255 } else { 0 }])
    })
}

/// Writes a PNG file, and the folders on its way.
fn save(picture: &GrayImage, path: &Path) -> Result<(), DraftError> {
    draft_folder::write_file(path, Durability::Program, |out| {
        let written = picture.write_to(out, ImageFormat::Png);
        written.map_err(|error| match error {
            ImageError::IoError(error) => error,
            other => io::Error::other(other.to_string()),
        })
    })
}

fn nothing_like(mask: &Mask) -> Mask {
    Mask {
        inside: vec![false; mask.inside.len()],
        ..*mask
    }
}

fn with(mask: &Mask, pixels: &[usize]) -> Mask {
    let mut mask = mask.clone();
    pixels.iter().for_each(|&p| mask.inside[p] = true);
    mask
}

fn without(mask: &Mask, pixels: &[usize]) -> Mask {
    let mut mask = mask.clone();
    pixels.iter().for_each(|&p| mask.inside[p] = false);
    mask
}

/// Pixels of the mask that touch its outside, or those outside that touch the mask. The picture's border
/// is no outline.
fn rim_of(mask: &Mask, outside: bool) -> impl Iterator<Item = usize> {
    let (width, height) = mask.size();
    (0..mask.inside.len()).filter(move |&pixel| {
        let (x, y) = (pixel % width, pixel / width);
        mask.inside[pixel] != outside
            && (y.saturating_sub(1)..(y + 2).min(height)).any(|v| {
                (x.saturating_sub(1)..(x + 2).min(width))
                    .any(|u| mask.inside[v * width + u] == outside)
            })
    })
}

/// The `count` pixels of the mask farthest in a direction.
fn extremity(mask: &Mask, angle: f32, count: usize) -> Vec<usize> {
    let (sin, cos) = angle.sin_cos();
    let along =
        |pixel: usize| (pixel % mask.width) as f32 * cos + (pixel / mask.width) as f32 * sin;
    let mut inside: Vec<usize> = (0..mask.inside.len()).filter(|&p| mask.inside[p]).collect();
    inside.sort_by(|&a, &b| along(b).total_cmp(&along(a)));
    inside.truncate(count);
    inside
}

/// How hard it is to step onto a pixel for a region that began at `start`.
fn likeness(photo: &RgbPlane, start: usize) -> impl Fn(usize) -> f32 + '_ {
    let first = photo.values[start];
    move |pixel| {
        let colour = photo.values[pixel];
        let difference: f32 = (0..3)
            .map(|c| (colour[c] - first[c]).powi(2))
            .sum::<f32>()
            .sqrt();
        1.0 + 9.0 * difference / COLOUR_STEP
    }
}

/// What is left to chance in one view.
struct Chance(SplitMix64);

impl Chance {
    fn of(seed: u64, index: usize) -> Self {
        let seed = seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
        let mut random = SplitMix64::new(seed);
        random.next();
        Self(random)
    }

    /// In 0..2 pi.
    fn angle(&mut self) -> f32 {
        (self.0.next() >> 40) as f32 / (1 << 24) as f32 * std::f32::consts::TAU
    }

    fn one_of<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        let count = items.len() as u64;
        (count > 0).then(|| &items[(self.0.next() % count) as usize])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::iou::iou;

    /// A disc on a plain picture with a bright bar that touches it.
    fn scene() -> (Mask, RgbPlane) {
        let disc = |x: usize, y: usize| (x as f32 - 40.0).hypot(y as f32 - 32.0) < 18.0;
        let mask = Mask {
            width: 96,
            height: 64,
            inside: (0..96 * 64).map(|p| disc(p % 96, p / 96)).collect(),
        };
        let photo = RgbPlane::from_fn(96, 64, |x, y| {
            if (28..36).contains(&y) && x >= 58 {
                [0.9; 3]
            } else {
                [0.2; 3]
            }
        });
        (mask, photo)
    }

    fn faulty(fault: Fault, index: usize, seed: u64) -> Option<Mask> {
        let (mask, photo) = scene();
        degrade(&mask, &photo, fault, 0.2, index, seed)
    }

    #[test]
    fn faults_of_an_outline_cost_what_was_asked() {
        let (truth, _) = scene();
        for fault in [
            Fault::Eroded,
            Fault::Dilated,
            Fault::PartMissing,
            Fault::NeighbourIncluded,
        ] {
            let overlap = iou(&faulty(fault, 3, 7).unwrap(), &truth);
            assert!((overlap - 0.8).abs() < 0.005, "{fault:?}: {overlap}");
        }
    }

    #[test]
    fn erosion_takes_the_rim_and_dilation_adds_one() {
        let radius = |pixel: usize| ((pixel % 96) as f32 - 40.0).hypot((pixel / 96) as f32 - 32.0);
        let eroded = faulty(Fault::Eroded, 0, 1).unwrap();
        let dilated = faulty(Fault::Dilated, 0, 1).unwrap();
        for pixel in 0..96 * 64 {
            // Radii of discs with 0.8 and 1.25 times the area: 16.1 and 20.1.
            assert!(!eroded.inside[pixel] || radius(pixel) < 17.3);
            assert!(!dilated.inside[pixel] || radius(pixel) < 21.5);
            assert!(eroded.inside[pixel] || radius(pixel) > 15.0);
            assert!(dilated.inside[pixel] || radius(pixel) > 19.0);
        }
    }

    #[test]
    fn chance_is_a_function_of_seed_and_view() {
        let of = |index, seed| faulty(Fault::PartMissing, index, seed).unwrap();
        assert_eq!(of(1, 1), of(1, 1));
        assert_ne!(of(1, 1), of(2, 1));
        assert_ne!(of(1, 1), of(1, 2));
    }

    #[test]
    fn half_of_the_views_have_no_mask_and_one_in_five_shows_something_else() {
        let (truth, _) = scene();
        let present = (0..10).filter(|&i| faulty(Fault::HalfMissing, i, 1).is_some());
        assert_eq!(present.count(), 5);
        let overlaps: Vec<f64> = (0..10)
            .map(|i| iou(&faulty(Fault::SomeWrong, i, 1).unwrap(), &truth))
            .collect();
        assert_eq!(overlaps.iter().filter(|&&o| o == 0.0).count(), 2);
        assert_eq!(overlaps.iter().filter(|&&o| o == 1.0).count(), 8);
    }

    #[test]
    fn a_leak_stays_in_what_it_began_with() {
        let (truth, photo) = scene();
        let start = 32 * 96 + 58;
        assert!(!truth.inside[start]);
        let bar = grow(
            truth.size(),
            [start],
            |p| !truth.inside[p],
            likeness(&photo, start),
            250,
        );
        assert!(bar.iter().all(|&p| photo.values[p][0] > 0.5));
    }

    #[test]
    fn a_folder_appears_whole_or_not_at_all() {
        let root = tempfile::tempdir().unwrap();
        let [truth, photos, out] = ["truth", "photos", "out"].map(|name| root.path().join(name));
        std::fs::create_dir_all(&truth).unwrap();
        std::fs::create_dir_all(&photos).unwrap();
        let grey = image::GrayImage::from_pixel(8, 8, image::Luma([255]));
        for (folder, name) in [(&truth, "a"), (&truth, "b"), (&photos, "a"), (&photos, "b")] {
            grey.save(folder.join(format!("{name}.png"))).unwrap();
        }
        let degrade = || degrade_folder(&truth, &photos, Fault::Eroded, 0.2, 1, &out);
        std::fs::write(photos.join("b.png"), "no picture").unwrap();
        assert!(degrade().is_err() && !out.exists());
        grey.save(photos.join("b.png")).unwrap();
        assert_eq!(degrade().unwrap().count, 2);
        // Masks of another call would not be told from these.
        assert!(matches!(degrade(), Err(EvalError::Write { .. })));
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2);
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 3);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_of_a_small_mask_too() {
        let grey = GrayImage::from_pixel(8, 8, image::Luma([255]));
        let error = save(&grey, Path::new("/dev/full")).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull);
        let error = EvalError::from(error).to_string();
        assert!(error.ends_with("free some space"), "{error}");
    }

    #[test]
    fn an_empty_view_stays_empty() {
        let (truth, photo) = scene();
        let empty = nothing_like(&truth);
        for fault in Fault::ALL {
            if let Some(mask) = degrade(&empty, &photo, fault, 0.2, 0, 1) {
                assert_eq!(mask.count(), 0, "{fault:?}");
            }
        }
    }
}
