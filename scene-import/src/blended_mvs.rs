//! BlendedMVS's and MVSNet's `cams/NAME_cam.txt`: the words `extrinsic` (a 4x4 matrix that takes
//! world points into the camera, OpenCV's axes) and `intrinsic` (a 3x3 matrix in pixels), then a
//! range of depths.

use crate::error::{ImportError, load_text};
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::{Frame, check_size};
use crate::photos::{Match, NO_PHOTO, at_path, stored_size};
use crate::pose;
use glam::{DVec2, DVec3};
use io_colmap::Pose;
use std::path::{Path, PathBuf};

/// Where photos are; the masked ones beside them are not what a camera saw.
const FOLDERS: [&str; 4] = ["blended_images", "images", "image", "."];

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let folder = &detected.source;
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(|e| ImportError::io("list", folder, e))?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| stem(path).is_some())
        .collect();
    files.sort();
    let mut gather = Gather::default();
    for path in files {
        let Some(name) = stem(&path) else { continue };
        let Some(photo) = photo(&detected.root, images, &name) else {
            gather.drop_view(name, NO_PHOTO);
            continue;
        };
        let text = load_text(&path)?;
        let bad = |what: String| {
            ImportError::bad(
                &path,
                what,
                "copy the file again, or remove it to leave the photo out",
            )
        };
        let (camera_from_world, focal, centre, skew) = parse(&text).map_err(bad)?;
        let (width, height) = stored_size(&photo.photo)?;
        let frame = Frame {
            width,
            height,
            focal,
            centre,
        };
        if let Some(lost) = frame.lost_with_skew(skew) {
            return Err(bad(format!(
                "the camera's axes are skew by {lost:.1} pixels, which no COLMAP camera is"
            )));
        }
        let camera = frame.perspective([0.0; 4], [0.0; 2]).map_err(bad)?;
        check_size(&camera, false).map_err(|what| {
            let remedy = "use the photos that the cameras were made for";
            ImportError::bad(
                &path,
                format!("{what} than {}", photo.photo.display()),
                remedy,
            )
        })?;
        gather.views.push(Found {
            photo,
            mask: None,
            camera,
            camera_from_world,
        });
    }
    gather.finish(detected.format, &detected.root, folder)
}

/// `00000003` of `00000003_cam.txt`.
fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    name.strip_suffix("_cam.txt").map(str::to_owned)
}

fn photo(root: &Path, stated: Option<&Path>, name: &str) -> Option<Match> {
    let folders = match stated {
        Some(folder) => vec![folder.to_path_buf()],
        None => FOLDERS.iter().map(|folder| root.join(folder)).collect(),
    };
    folders.iter().find_map(|folder| at_path(folder, name))
}

fn parse(text: &str) -> Result<(Pose, DVec2, DVec2, f64), String> {
    let e = numbers::<16>(text, "extrinsic")?;
    let k = numbers::<9>(text, "intrinsic")?;
    if [k[3], k[6], k[7]].iter().any(|v| v.abs() > 1e-6) || (k[8] - 1.0).abs() > 1e-6 {
        return Err("the intrinsic matrix is not upper triangular with a one".to_owned());
    }
    let rotation = pose::rows([[e[0], e[1], e[2]], [e[4], e[5], e[6]], [e[8], e[9], e[10]]]);
    let pose = pose::from_camera_from_world(rotation, DVec3::new(e[3], e[7], e[11]))?;
    Ok((pose, DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5]), k[1]))
}

/// The numbers that follow a word.
fn numbers<const N: usize>(text: &str, word: &str) -> Result<[f64; N], String> {
    let mut words = text.split_whitespace().skip_while(|found| *found != word);
    if words.next().is_none() {
        return Err(format!("the word {word:?} is missing"));
    }
    let mut values = [0.0_f64; N];
    for value in &mut values {
        let next = words
            .next()
            .ok_or_else(|| format!("fewer than {N} numbers follow {word:?}"))?;
        *value = next
            .parse()
            .map_err(|_| format!("{next:?} after {word:?} is no number"))?;
    }
    if values.iter().all(|v| v.is_finite()) {
        Ok(values)
    } else {
        Err(format!("a number after {word:?} is not finite"))
    }
}
