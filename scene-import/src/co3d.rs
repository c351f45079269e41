//! CO3D's `frame_annotations.jgz`: a gzipped list of the frames of all sequences of a category.
//!
//! Poses are PyTorch3D's: `p_camera = p_world R + T` with row vectors, x left, y up, z forward.
//! Focal lengths and principal points are in units of half the picture: of each side for
//! `ndc_norm_image_bounds` (version 1), of the shorter side for `ndc_isotropic` (version 2).

use crate::error::ImportError;
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::Frame;
use crate::photos::{ByName, Match, NO_PHOTO};
use crate::pose;
use flate2::read::MultiGzDecoder;
use glam::{DMat3, DVec2, DVec3};
use io_colmap::{Camera, Pose};
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer as _};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};

/// What the file may unpack to: four times the largest category.
const LARGEST: u64 = 8 << 30;

#[derive(Debug, Deserialize)]
struct Annotation {
    sequence_name: String,
    image: Picture,
    mask: Option<Mask>,
    viewpoint: Option<Viewpoint>,
}

#[derive(Debug, Deserialize)]
struct Picture {
    path: String,
    /// Height, width.
    size: [u32; 2],
}

#[derive(Debug, Deserialize)]
struct Mask {
    path: String,
}

#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the file's names")]
struct Viewpoint {
    R: [[f64; 3]; 3],
    T: [f64; 3],
    focal_length: [f64; 2],
    principal_point: [f64; 2],
    intrinsics_format: Option<String>,
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let category = path.parent().unwrap_or(Path::new("."));
    // The folder of one sequence, or of the category.
    let root = detected
        .root
        .canonicalize()
        .unwrap_or_else(|_| detected.root.clone());
    let is_category = root.join("frame_annotations.jgz").is_file();
    let wanted = root
        .file_name()
        .filter(|_| !is_category)
        .map(|name| name.to_string_lossy().into_owned());
    let frames = annotations(path, |frame| match &wanted {
        Some(name) => frame.sequence_name == *name,
        None => category.join(&frame.sequence_name).is_dir(),
    })?;
    let sequences: BTreeSet<&str> = frames.iter().map(|f| f.sequence_name.as_str()).collect();
    if sequences.len() != 1 {
        let some: Vec<&str> = sequences.iter().take(3).copied().collect();
        return Err(ImportError::bad(
            &detected.root,
            match &wanted {
                Some(name) => format!("{} has no frames of a sequence {name:?}", path.display()),
                None if some.is_empty() => "no sequence's photos are there".to_owned(),
                None => format!(
                    "there are {} sequences, such as {}",
                    sequences.len(),
                    some.join(", ")
                ),
            },
            "give the folder of one sequence, with its images/ in it",
        ));
    }

    let named = match images {
        Some(folder) => Some(ByName::below(&root, Some(folder))?),
        None => None,
    };
    let mut gather = Gather::default();
    if let Some(photos) = &named {
        gather.leave_out(photos.left_out());
    }
    for frame in &frames {
        let name = &frame.image.path;
        let photo = match &named {
            Some(photos) => photos.find(name),
            None => find(category, name).map(Match::by_place).ok_or(NO_PHOTO),
        };
        let photo = match photo {
            Ok(photo) => photo,
            Err(why) => {
                gather.drop_view(name, why);
                continue;
            }
        };
        let Some(viewpoint) = &frame.viewpoint else {
            gather.drop_view(name, "has no pose");
            gather.rivals.push(photo);
            continue;
        };
        let (camera, camera_from_world) =
            camera_and_pose(viewpoint, frame.image.size).map_err(|what| {
                ImportError::bad(path, format!("{name}: {what}"), "leave the photo out")
            })?;
        gather.views.push(Found {
            photo,
            mask: frame
                .mask
                .as_ref()
                .and_then(|mask| find(category, &mask.path)),
            camera,
            camera_from_world,
        });
    }
    let masks = gather
        .views
        .iter()
        .filter(|view| view.mask.is_some())
        .count();
    if masks > 0 {
        gather
            .notes
            .push(format!("{masks} frames bring a mask along"));
    }
    gather.finish(detected.format, &detected.root, path)
}

/// Paths are stated from the data set's folder, which may have been renamed or left behind.
fn find(category: &Path, stated: &str) -> Option<PathBuf> {
    let parts: Vec<&str> = stated.split(['/', '\\']).collect();
    let below = |count: usize| {
        parts
            .get(parts.len().checked_sub(count)?..)
            .map(|p| p.join("/"))
    };
    [
        category.parent().map(|root| root.join(stated)),
        below(3).map(|tail| category.join(tail)),
    ]
    .into_iter()
    .flatten()
    .find(|path| path.is_file())
}

fn camera_and_pose(view: &Viewpoint, [height, width]: [u32; 2]) -> Result<(Camera, Pose), String> {
    let half = DVec2::new(f64::from(width), f64::from(height)) * 0.5;
    let unit = match view.intrinsics_format.as_deref() {
        None => half,
        Some(word) if word.eq_ignore_ascii_case("ndc_norm_image_bounds") => half,
        Some(word) if word.eq_ignore_ascii_case("ndc_isotropic") => {
            DVec2::splat(half.min_element())
        }
        Some(other) => return Err(format!("the intrinsics_format {other:?} is unknown")),
    };
    let frame = Frame {
        width,
        height,
        focal: DVec2::from_array(view.focal_length) * unit,
        // Their x points left and their y up.
        centre: half - DVec2::from_array(view.principal_point) * unit,
    };
    let camera = frame.perspective([0.0; 4], [0.0; 2])?;
    // Row vectors: what is written as rows are our columns.
    let matrix = DMat3::from_cols_array_2d(&view.R);
    let turn = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let pose = pose::from_camera_from_world(turn * matrix, turn * DVec3::from_array(view.T))?;
    Ok((camera, pose))
}

/// The frames that `keep` says; the others, which may be very many, are read over.
fn annotations(
    path: &Path,
    keep: impl Fn(&Annotation) -> bool,
) -> Result<Vec<Annotation>, ImportError> {
    struct Frames<F>(F);

    impl<'de, F: Fn(&Annotation) -> bool> Visitor<'de> for Frames<F> {
        type Value = Vec<Annotation>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("a list of frames")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
            let mut frames = Vec::new();
            while let Some(frame) = list.next_element::<Annotation>()? {
                if (self.0)(&frame) {
                    frames.push(frame);
                }
            }
            Ok(frames)
        }
    }

    let file = File::open(path).map_err(|e| ImportError::io("read", path, e))?;
    let unpacked = MultiGzDecoder::new(BufReader::new(file)).take(LARGEST);
    let mut reader = serde_json::Deserializer::from_reader(BufReader::new(unpacked));
    let frames = reader
        .deserialize_seq(Frames(keep))
        .and_then(|frames| reader.end().map(|()| frames));
    frames.map_err(|e| {
        if e.is_io() {
            ImportError::bad(
                path,
                format!("it cannot be unpacked ({e})"),
                "download it again",
            )
        } else {
            ImportError::json(path, &e)
        }
    })
}
