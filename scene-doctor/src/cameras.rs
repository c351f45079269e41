//! Cameras, and the files that should go with them.

use crate::finding::{Finding, some_names};
use crate::scene::Exam;
use io_colmap::{Camera, is_picture};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Fewer photos than this leave most of an object's surface to two or three of them.
const FEW: usize = 12;
/// Two rays determine a point, a third one that it is right.
const LEAST: usize = 3;
/// A larger share of photos without a pose is worth a word: the model may be a part of the scene.
const UNPOSED: f64 = 0.1;

/// How many photos, and through which lenses.
pub(crate) fn cameras(exam: &Exam) -> Finding {
    let count = exam.views.len();
    let mut lenses: Vec<&Camera> = Vec::new();
    for view in &exam.views {
        let same = |known: &&Camera| {
            known.model == view.camera.model
                && known.params == view.camera.params
                && (known.width, known.height) == (view.camera.width, view.camera.height)
        };
        if !lenses.iter().any(same) {
            lenses.push(view.camera);
        }
    }
    let mut models: BTreeSet<String> = BTreeSet::new();
    let mut sizes: BTreeSet<(u32, u32)> = BTreeSet::new();
    for camera in &lenses {
        models.insert(camera.model.to_string());
        sizes.insert((camera.width, camera.height));
    }
    let distorted = lenses.iter().any(|camera| is_distorted(camera));
    let sizes: Vec<String> = sizes.iter().map(|(w, h)| format!("{w}x{h}")).collect();
    let models: Vec<String> = models.into_iter().collect();
    let says = format!(
        "{count} photos of {} pixels through {} ({}), {}",
        shortened(&sizes),
        match lenses.len() {
            1 => "one lens".to_owned(),
            n => format!("{n} calibrated lenses"),
        },
        models.join(", "),
        if distorted {
            "whose distortion every ray follows"
        } else {
            "without distortion"
        }
    );
    let finding = Finding::pass("cameras", says)
        .number("photos", count)
        .number("lenses", lenses.len())
        .number("distorted", distorted);
    if count < LEAST {
        finding.fail(format!(
            "take more photos: {LEAST} at the very least, {FEW} to 60 are usual"
        ))
    } else if count < FEW {
        finding.warn(format!(
            "with fewer than {FEW} photos much is guessed; take more if you can"
        ))
    } else {
        finding
    }
}

/// Whether straight lines come out bent: the lens differs from a pinhole of its focal length.
fn is_distorted(camera: &Camera) -> bool {
    let (fx, fy) = camera.focal();
    let (cx, cy) = camera.principal_point();
    let corner = glam::DVec2::new(0.5, 0.5);
    let pinhole = glam::DVec3::new((corner.x - cx) / fx, (corner.y - cy) / fy, 1.0);
    match camera.unproject(corner) {
        Some(ray) if ray.z > 0.0 => (ray / ray.z - pinhole).length() > 1e-4,
        _ => true,
    }
}

fn shortened(sizes: &[String]) -> String {
    match sizes {
        [a] => a.clone(),
        [a, .., b] => format!("{a} to {b}"),
        [] => "no".to_owned(),
    }
}

/// Photos and poses that have no partner.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Files {
    /// Photos that the poses name and that are not there.
    pub missing: Vec<String>,
    /// What becomes of those.
    pub missing_are: Missing,
    /// What becomes of views for other reasons, such as photos that several of them may be of: a sentence each.
    pub left_out: Vec<String>,
    /// Photos that lie beside the others and have no pose.
    pub unposed: Vec<String>,
}

/// What becomes of views whose photo is missing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Missing {
    /// Training refuses the scene.
    #[default]
    Refused,
    /// They are left out.
    LeftOut,
}

/// The pictures that lie in the folders of `photos` and are none of them, nor of their `masks`, nor made of one of them by
/// their name, as `0001_depth.png` beside `0001.png`.
#[must_use]
pub fn photos_without_pose<'a>(
    photos: &'a [PathBuf],
    masks: impl IntoIterator<Item = &'a PathBuf>,
) -> Vec<String> {
    let posed = photos.iter().map(PathBuf::as_path);
    let posed: BTreeSet<&Path> = posed
        .chain(masks.into_iter().map(PathBuf::as_path))
        .collect();
    let folders: BTreeSet<&Path> = photos.iter().filter_map(|photo| photo.parent()).collect();
    let stems: BTreeSet<PathBuf> = photos
        .iter()
        .map(|photo| photo.with_extension(""))
        .collect();
    let mut unposed: Vec<String> = folders
        .into_iter()
        .flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| !posed.contains(path.as_path()) && !is_made_of(path, &stems))
        .filter_map(|path| Some(path.file_name()?.to_str()?.to_owned()))
        .filter(|name| is_picture(name) && !name.starts_with('.'))
        .collect();
    unposed.sort();
    unposed
}

/// Whether a picture's name begins with one of `stems` and goes on with a word, not with a number, which would make it the
/// next of a row.
fn is_made_of(picture: &Path, stems: &BTreeSet<PathBuf>) -> bool {
    let Some(stem) = picture.file_stem().and_then(|stem| stem.to_str()) else {
        return false;
    };
    stem.match_indices(['_', '-', '.']).any(|(at, _)| {
        let word = stem[at + 1..].starts_with(char::is_alphabetic);
        word && stems.contains(&picture.with_file_name(&stem[..at]))
    })
}

/// Whether every pose has its photo, and every photo its pose.
pub(crate) fn files(posed: usize, files: &Files) -> Finding {
    let (missing, unposed) = (files.missing.len(), files.unposed.len());
    let mut says = match missing {
        0 if files.left_out.is_empty() && unposed == 0 => {
            "every pose has its photo, every photo its pose".to_owned()
        }
        0 if files.left_out.is_empty() => "every pose has its photo".to_owned(),
        0 => "no photo that the poses name is missing".to_owned(),
        1 => format!(
            "1 photo that the poses name is missing: {}",
            files.missing[0]
        ),
        n => format!(
            "{n} photos that the poses name are missing: {}",
            some_names(&files.missing)
        ),
    };
    for sentence in &files.left_out {
        says.push_str(&format!("; {sentence}"));
    }
    if unposed > 0 {
        says.push_str(&format!(
            "; {unposed} of {} photos have no pose and are not used: {}",
            unposed + posed,
            some_names(&files.unposed)
        ));
    }
    let finding = Finding::pass("photos", says)
        .number("missing", missing)
        .number("without_pose", unposed)
        .about(files.missing.iter().chain(&files.unposed).cloned());
    let back = "put them back under the names that the poses give them";
    match (missing, files.missing_are) {
        (1.., Missing::Refused) => {
            finding.fail(format!("{back}, or export the model again without them"))
        }
        (1.., Missing::LeftOut) => finding.warn(format!(
            "these views are left out; {back} if that is not meant"
        )),
        _ if !files.left_out.is_empty() => {
            finding.warn("correct or remove these views where the poses are, if that is not meant")
        }
        _ if unposed as f64 > UNPOSED * (posed + unposed) as f64 => finding.warn(
            "they found no place among the others: take photos in between, with more overlap, and \
             find the poses again",
        ),
        _ => finding,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn photos_that_are_there_are_not_said_to_be_missing() {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let said = |found: &Files| {
            let finding = super::files(10, found);
            (
                finding.says,
                finding.remedy,
                finding.numbers["missing"].clone(),
            )
        };
        let all = "every pose has its photo, every photo its pose";
        assert_eq!(said(&Files::default()), (all.to_owned(), None, 0.into()));
        let twice = Files {
            missing_are: Missing::LeftOut,
            left_out: names(&["left out: a.jpg is listed twice"]),
            ..Files::default()
        };
        let (says, remedy, missing) = said(&twice);
        assert_eq!(
            says,
            "no photo that the poses name is missing; left out: a.jpg is listed twice"
        );
        assert!(remedy.unwrap().starts_with("correct or remove"));
        assert_eq!(missing, 0);
        let gone = Files {
            missing: names(&["b.jpg"]),
            unposed: names(&["c.jpg"]),
            ..twice
        };
        let (says, remedy, missing) = said(&gone);
        assert_eq!(
            says,
            "1 photo that the poses name is missing: b.jpg; left out: a.jpg is listed twice; 1 of 11 photos have no \
             pose and are not used: c.jpg"
        );
        assert!(remedy.unwrap().starts_with("these views are left out"));
        assert_eq!(missing, 1);
    }

    #[test]
    fn what_is_made_of_a_photo_needs_no_pose() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [
            "r_0.png",
            "r_0_depth_0001.png",
            "r_0-masked.png",
            "r_0.matte.png",
            "r_1.png",
            "r_0_2.png",
            "r_0x.png",
            "r_9_depth.png",
            "mask.png",
            "notes.txt",
        ] {
            fs::write(at(name), "").unwrap();
        }
        let (photos, masks) = ([at("r_0.png")], [at("mask.png")]);
        assert_eq!(
            photos_without_pose(&photos, &masks),
            ["r_0_2.png", "r_0x.png", "r_1.png", "r_9_depth.png"]
        );
    }
}
