//! NeuS's and IDR's `cameras_sphere.npz`: for each photo, in the order of their names, a matrix
//! `world_mat_i = K [R | t]` and the similarity `scale_mat_i` of the object's unit sphere.
//!
//! Pixels are taken as COLMAP's: converters write `K` as they find it there.

use crate::error::ImportError;
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::{Frame, check_size};
use crate::npy::{Array, read_npz};
use crate::photos::{Match, first_folder, in_folder, stored_size};
use crate::pose;
use glam::{DMat3, DVec2, DVec3};
use io_colmap::Pose;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// The camera of each photo, by its number.
const CAMERA: &str = "world_mat_";
/// The sphere around the object; that of every other camera is the same.
const SPHERE: &str = "scale_mat_0";

/// A projection matrix taken apart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projection {
    pub(crate) focal: DVec2,
    pub(crate) centre: DVec2,
    pub(crate) skew: f64,
    pub(crate) camera_from_world: Pose,
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let arrays = read_npz(path, is_used)?;
    let count = (0..)
        .take_while(|i| arrays.contains_key(&format!("{CAMERA}{i}")))
        .count();
    if count == 0 {
        return Err(ImportError::bad(
            path,
            "it holds no array world_mat_0",
            "take the file that NeuS or IDR trains from",
        ));
    }
    let folder = first_folder(&detected.root, images, &["image", "images", "rgb", "."]);
    let photos = folder.as_deref().map(in_folder).unwrap_or_default();
    let pairs = pair(path, count, &photos)?;
    let masks = ["mask", "masks"]
        .iter()
        .map(|name| in_folder(&detected.root.join(name)))
        .find(|masks| !masks.is_empty())
        .unwrap_or_default();

    let matched = masks_of(&photos, &masks);

    let mut gather = Gather::default();
    for (order, (i, photo)) in pairs.into_iter().enumerate() {
        let name = format!("{CAMERA}{i}");
        let bad = |what: String| {
            ImportError::bad(
                path,
                format!("{name}: {what}"),
                "it must be the camera's 3x4 or 4x4 projection matrix",
            )
        };
        let projection = arrays
            .get(&name)
            .ok_or_else(|| "it is missing".to_owned())
            .and_then(rows)
            .and_then(|rows| decompose(&rows))
            .map_err(bad)?;
        let (width, height) = stored_size(&photo)?;
        let frame = Frame {
            width,
            height,
            focal: projection.focal,
            centre: projection.centre,
        };
        if let Some(lost) = frame.lost_with_skew(projection.skew) {
            return Err(bad(format!(
                "the camera's axes are skew by {lost:.1} pixels, which no COLMAP camera is"
            )));
        }
        let camera = frame.perspective([0.0; 4], [0.0; 2]).map_err(bad)?;
        check_size(&camera, false).map_err(|what| {
            let what = format!("{name}: {what} than {}", photo.display());
            ImportError::bad(path, what, "use the photos that the cameras were made for")
        })?;
        gather.views.push(Found {
            // By the photo's place: a camera's number counts photos that are gone too.
            mask: matched.as_ref().map(|masks| masks[order].clone()),
            photo: Match::by_place(photo),
            camera,
            camera_from_world: projection.camera_from_world,
        });
    }
    if !masks.is_empty() && matched.is_none() {
        gather.notes.push(format!(
            "{} masks do not go with {} photos and are left out; name their folder with --masks to match them by name",
            masks.len(),
            photos.len()
        ));
    }
    gather.notes.extend(sphere(&arrays));
    gather.finish(detected.format, &detected.root, path)
}

/// Whether an array of that name is read: converters put their own beside them.
fn is_used(name: &str) -> bool {
    let number = name.strip_prefix(CAMERA);
    name == SPHERE || number.is_some_and(|number| number.parse::<usize>().is_ok())
}

/// Photos in order if there are as many, else by the numbers in their names.
fn pair(
    path: &Path,
    count: usize,
    photos: &[PathBuf],
) -> Result<Vec<(usize, PathBuf)>, ImportError> {
    if photos.len() == count {
        return Ok(photos.iter().cloned().enumerate().collect());
    }
    let numbered: Option<Vec<(usize, PathBuf)>> = photos
        .iter()
        .map(|photo| {
            let number: usize = photo.file_stem()?.to_str()?.parse().ok()?;
            (number < count).then(|| (number, photo.clone()))
        })
        .collect();
    match numbered {
        Some(pairs) if !pairs.is_empty() => Ok(pairs),
        _ => Err(ImportError::bad(
            path,
            format!(
                "it holds {count} cameras, but there are {} photos",
                photos.len()
            ),
            "cameras belong to photos by their order, so there must be as many; restore the photos or name their folder with sos import --images",
        )),
    }
}

/// A mask for every photo: by name where each has its own, else by order where there are as many.
fn masks_of(photos: &[PathBuf], masks: &[PathBuf]) -> Option<Vec<PathBuf>> {
    // `image/000012.png` goes with `mask/012.png`.
    let key = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        match stem.parse::<u64>() {
            Ok(number) => number.to_string(),
            Err(_) => stem.into_owned(),
        }
    };
    let by_name: HashMap<String, &PathBuf> = masks.iter().map(|mask| (key(mask), mask)).collect();
    let named = photos
        .iter()
        .map(|photo| by_name.get(&key(photo)).map(|mask| (*mask).clone()))
        .collect::<Option<Vec<PathBuf>>>()
        // Two masks of one name, such as 1.png and 01.png, say nothing about which is whose.
        .filter(|_| by_name.len() == masks.len());
    named.or_else(|| (masks.len() == photos.len()).then(|| masks.to_vec()))
}

/// What the file says about where the object is.
fn sphere(arrays: &BTreeMap<String, Array>) -> Option<String> {
    let rows = rows(arrays.get(SPHERE)?).ok()?;
    let centre = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
    centre.is_finite().then(|| {
        format!(
            "scale_mat puts the object within {:.3} of ({:.3}, {:.3}, {:.3}), in the scene's units",
            rows[0][0], centre.x, centre.y, centre.z
        )
    })
}

/// The upper three rows of a 3x4 or 4x4 array.
fn rows(array: &Array) -> Result<[[f64; 4]; 3], String> {
    if array.shape != [4, 4] && array.shape != [3, 4] {
        return Err(format!("its shape is {:?}", array.shape));
    }
    let mut rows = [[0.0; 4]; 3];
    for (row, values) in rows.iter_mut().zip(array.values.chunks_exact(4)) {
        row.copy_from_slice(values);
    }
    Ok(rows)
}

/// `P = K [R | t]` up to a factor: an RQ decomposition by Gram and Schmidt, from the last row.
pub(crate) fn decompose(p: &[[f64; 4]; 3]) -> Result<Projection, String> {
    if p.iter().flatten().any(|v| !v.is_finite()) {
        return Err("it is not finite".to_owned());
    }
    let [mut m1, mut m2, mut m3] = [0, 1, 2].map(|i| DVec3::new(p[i][0], p[i][1], p[i][2]));
    let mut last = DVec3::new(p[0][3], p[1][3], p[2][3]);
    let determinant = m1.dot(m2.cross(m3));
    let size = m1.length() * m2.length() * m3.length();
    if size == 0.0 || determinant.abs() < 1e-9 * size {
        return Err("it is singular".to_owned());
    }
    // The factor is taken so that K has a positive diagonal and R does not mirror.
    let factor = m3.length().copysign(determinant);
    for row in [&mut m1, &mut m2, &mut m3, &mut last] {
        *row /= factor;
    }
    let r3 = m3;
    let cy = m2.dot(r3);
    let fy_r2 = m2 - r3 * cy;
    let fy = fy_r2.length();
    let r2 = fy_r2 / fy;
    let (cx, skew) = (m1.dot(r3), m1.dot(r2));
    let fx_r1 = m1 - r3 * cx - r2 * skew;
    let fx = fx_r1.length();
    let rotation = DMat3::from_cols(fx_r1 / fx, r2, r3).transpose();
    // K t = last, from below.
    let tz = last.z;
    let ty = (last.y - cy * tz) / fy;
    let tx = (last.x - cx * tz - skew * ty) / fx;
    Ok(Projection {
        focal: DVec2::new(fx, fy),
        centre: DVec2::new(cx, cy),
        skew,
        camera_from_world: pose::from_camera_from_world(rotation, DVec3::new(tx, ty, tz))?,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_projection_matrix_comes_apart_as_it_was_put_together() {
        let (f, c, skew) = (DVec2::new(900.0, 880.0), DVec2::new(310.0, 250.0), 1.5);
        let rotation = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 2.0, -1.0));
        let t = DVec3::new(0.3, -0.2, 4.0);
        for factor in [1.0, -1.0, 250.0, -1e-3] {
            let row = |k: DVec3| {
                let r = rotation.transpose() * k;
                [r.x, r.y, r.z, k.dot(t)].map(|v| v * factor)
            };
            let p = [
                row(DVec3::new(f.x, skew, c.x)),
                row(DVec3::new(0.0, f.y, c.y)),
                row(DVec3::Z),
            ];
            let found = decompose(&p).unwrap();
            assert!(found.focal.distance(f) < 1e-8 && found.centre.distance(c) < 1e-8);
            assert!((found.skew - skew).abs() < 1e-8);
            let pose = found.camera_from_world;
            assert!(pose.translation.distance(t) < 1e-9);
            let turned = pose.rotation * DVec3::new(1.0, 2.0, 3.0);
            assert!(turned.distance(rotation * DVec3::new(1.0, 2.0, 3.0)) < 1e-9);
        }
        assert!(decompose(&[[0.0; 4]; 3]).unwrap_err().contains("singular"));
        assert!(
            decompose(&[[f64::NAN; 4]; 3])
                .unwrap_err()
                .contains("finite")
        );
        assert!(
            decompose(&[[1.0, 2.0, 3.0, 4.0]; 3])
                .unwrap_err()
                .contains("singular")
        );
    }
}
