//! LLFF's `poses_bounds.npy`: 17 numbers a photo, photos in the order of their names.
//!
//! A 3x5 matrix by rows, whose columns are the camera's down, right and backward directions, its
//! centre, and (height, width, focal length); then the nearest and farthest depth. The principal
//! point is in the middle. The size is that of the original photos, which scenes seldom ship.

use crate::error::ImportError;
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::Frame;
use crate::npy::read_npy;
use crate::photos::{Match, in_folder};
use crate::pose;
use glam::{DMat3, DVec3};
use io_colmap::{Camera, Pose};
use std::path::{Path, PathBuf};

const COLUMNS: usize = 17;

/// Where photos are, the largest first.
const FOLDERS: [&str; 5] = ["images", "images_2", "images_4", "images_8", "."];

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let array = read_npy(path)?;
    let &[count, COLUMNS] = array.shape.as_slice() else {
        return Err(ImportError::bad(
            path,
            format!("the array's shape is {:?}, not (photos, 17)", array.shape),
            "take the file that LLFF's imgs2poses.py wrote",
        ));
    };
    let photos = photos(detected, images, count)?;
    let mut gather = Gather::default();
    if let Some(folder) = photos.first().and_then(|photo| photo.parent())
        && folder != detected.root.join("images")
    {
        gather
            .notes
            .push(format!("photos are taken from {}", folder.display()));
    }
    for (i, (row, photo)) in array.values.chunks_exact(COLUMNS).zip(photos).enumerate() {
        let (camera, camera_from_world) = camera_and_pose(row).map_err(|what| {
            ImportError::bad(
                path,
                format!("row {} ({}): {what}", i + 1, photo.display()),
                "the reconstruction failed for this photo; run imgs2poses.py again without it",
            )
        })?;
        gather.views.push(Found {
            photo: Match::by_place(photo),
            mask: None,
            camera,
            camera_from_world,
        });
    }
    gather.finish(detected.format, &detected.root, path)
}

/// The first folder with as many photos as there are poses.
fn photos(
    detected: &Detected,
    stated: Option<&Path>,
    count: usize,
) -> Result<Vec<PathBuf>, ImportError> {
    let folders: Vec<PathBuf> = match stated {
        Some(folder) => vec![folder.to_path_buf()],
        None => FOLDERS
            .iter()
            .map(|name| detected.root.join(name))
            .collect(),
    };
    let mut counts = Vec::new();
    for folder in folders {
        let found = in_folder(&folder);
        if !found.is_empty() && found.len() == count {
            return Ok(found);
        }
        if !found.is_empty() {
            counts.push(format!("{} in {}", found.len(), folder.display()));
        }
    }
    Err(ImportError::bad(
        &detected.source,
        if counts.is_empty() {
            format!("it holds {count} poses, but there are no photos")
        } else {
            format!(
                "it holds {count} poses, but photos are {}",
                counts.join(", ")
            )
        },
        "poses belong to photos by their order, so there must be as many; restore the photos or name their folder with sos import --images",
    ))
}

fn camera_and_pose(row: &[f64]) -> Result<(Camera, Pose), String> {
    // Entry of the 3x5 matrix.
    let at = |r: usize, c: usize| row[5 * r + c];
    let column = |c: usize| DVec3::new(at(0, c), at(1, c), at(2, c));
    let (height, width, focal) = (at(0, 4), at(1, 4), at(2, 4));
    let side = |v: f64| {
        // Scaled sizes are sometimes not whole.
        (0.5..1_048_576.0)
            .contains(&v)
            .then(|| v.round() as u32)
            .ok_or_else(|| format!("a picture size of {v} is none"))
    };
    let camera =
        Frame::centred(side(width)?, side(height)?, focal).perspective([0.0; 4], [0.0; 2])?;
    let axes = DMat3::from_cols(column(1), column(0), -column(2));
    Ok((camera, pose::camera_from_world(axes, column(3))?))
}
