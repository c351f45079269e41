//! COCO's JSON: outlines as polygons or run lengths, for pictures named in the same file.

use crate::error::{ImportError, load_text};
use crate::{polygon, run_lengths};
use image::{GrayImage, Luma};
use io_colmap::same_shape;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

/// Photos are scaled down for reconstruction, but not by more than this; drawing takes memory by the stated size.
const LARGEST_SCALE: u64 = 8;

/// Fewer enclose nothing.
const FEWEST_CORNERS: usize = 3;

#[derive(Debug, Deserialize)]
struct File {
    images: Vec<Picture>,
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Debug, Deserialize)]
struct Picture {
    /// A number or a text.
    id: Value,
    file_name: String,
    width: Option<u32>,
    height: Option<u32>,
}

#[derive(Debug, Deserialize)]
struct Annotation {
    image_id: Value,
    #[serde(default)]
    category_id: u32,
    segmentation: Option<Segmentation>,
}

#[derive(Debug, Deserialize)]
struct Category {
    id: u32,
    name: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "the segmentation of an annotation must be polygons ([[x, y, ...], ...]) or run lengths (size and counts)"
)]
enum Segmentation {
    Polygons(Vec<Vec<f64>>),
    /// A single one without the list around it, as some tools write it.
    Polygon(Vec<f64>),
    Runs {
        size: [u32; 2],
        counts: Counts,
    },
}

impl Segmentation {
    /// Whether it can hold a pixel; tools write polygons without corners for boxes that nobody has outlined.
    fn is_outline(&self) -> bool {
        let has_corners = |points: &Vec<f64>| points.len() >= 2 * FEWEST_CORNERS;
        match self {
            Self::Polygons(parts) => parts.iter().any(has_corners),
            Self::Polygon(points) => has_corners(points),
            Self::Runs { .. } => true,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Counts {
    Packed(String),
    Plain(Vec<u32>),
}

/// A photo that may get a mask.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wanted<'a> {
    pub(crate) name: &'a str,
    pub(crate) size: (u32, u32),
}

/// How many masks were drawn, and what a user should know about them.
#[derive(Debug)]
pub(crate) struct Drawn {
    pub(crate) count: usize,
    pub(crate) notes: Vec<String>,
}

/// Draws all annotations of each photo, or those of one category; white is the object.
///
/// Each mask is handed to `take`, with its photo's place among `photos`, before the next is drawn: as large as the
/// photos, all of them at once might not fit into memory.
pub(crate) fn draw(
    path: &Path,
    label: Option<u32>,
    photos: &[Wanted<'_>],
    mut take: impl FnMut(usize, GrayImage) -> Result<(), ImportError>,
) -> Result<Drawn, ImportError> {
    let file: File =
        serde_json::from_str(&load_text(path)?).map_err(|e| ImportError::json(path, &e))?;
    let mut notes = Vec::new();
    let (chosen, sentence) = choose(&file, label, path)?;
    notes.extend(sentence);

    let mut outlines: HashMap<String, Vec<&Segmentation>> = HashMap::new();
    let mut boxes_only = 0;
    for annotation in file.annotations.iter().filter(|a| chosen(a.category_id)) {
        match &annotation.segmentation {
            Some(segmentation) if segmentation.is_outline() => outlines
                .entry(id_of(&annotation.image_id))
                .or_default()
                .push(segmentation),
            _ => boxes_only += 1,
        }
    }
    if boxes_only > 0 {
        notes.push(format!(
            "{boxes_only} annotations are boxes without an outline and are left out"
        ));
    }
    let pictures = by_name(&file.images);
    let shared = shared_names(photos);
    let mut unknown = Vec::new();
    let mut found = Vec::new();
    for (i, photo) in photos.iter().enumerate() {
        let picture = match find(&pictures, photo.name) {
            // Whose picture it is, only its folders could say.
            Some((picture, key)) if key != full_name(photo.name) && shared.contains(&key) => {
                if outlines.contains_key(&id_of(&picture.id)) {
                    unknown.push((photo.name, &picture.file_name));
                }
                None
            }
            found => found.map(|(picture, _)| picture),
        };
        let parts = picture.and_then(|picture| outlines.get(&id_of(&picture.id)));
        found.extend(
            picture
                .zip(parts)
                .map(|(picture, parts)| (i, picture, parts)),
        );
    }
    if let Some((name, picture)) = unknown.first() {
        notes.push(format!(
            "{} photos have no outline as others bear their names too and the file does not state their folders: {name}, for one, may be its {picture} or not",
            unknown.len()
        ));
    }
    if found.is_empty() {
        return Err(ImportError::bad(
            path,
            match file.images.first() {
                Some(_) if !unknown.is_empty() => notes.pop().unwrap_or_default(),
                Some(first) => format!(
                    "none of its {} pictures (such as {:?}) has an outline and is one of the {} photos (such as {:?})",
                    file.images.len(),
                    first.file_name,
                    photos.len(),
                    photos.first().map_or("", |photo| photo.name)
                ),
                None => "it lists no pictures".to_owned(),
            },
            "annotate the photos of this scene",
        ));
    }
    for (i, picture, parts) in &found {
        let mask = draw_one(picture, parts, photos[*i].size).map_err(|what| {
            ImportError::bad(
                path,
                format!("{}: {what}", picture.file_name),
                "correct the annotation or export it again",
            )
        })?;
        take(*i, mask)?;
    }
    Ok(Drawn {
        count: found.len(),
        notes,
    })
}

/// Ids that are the same are the same text: 1.0, which tables make of it, is the number 1.
fn id_of(id: &Value) -> String {
    /// Up to here, all whole numbers are told apart.
    const EXACT: f64 = (1_u64 << 53) as f64;
    match id.as_f64() {
        Some(number) if number.fract() == 0.0 && number.abs() < EXACT => {
            (number as i64).to_string()
        }
        _ => id.to_string(),
    }
}

type Chosen = Box<dyn Fn(u32) -> bool>;

/// Which categories are the object, and what to say about it.
fn choose(
    file: &File,
    label: Option<u32>,
    path: &Path,
) -> Result<(Chosen, Option<String>), ImportError> {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for annotation in &file.annotations {
        *counts.entry(annotation.category_id).or_default() += 1;
    }
    let names: HashMap<u32, &str> = file
        .categories
        .iter()
        .filter_map(|c| Some((c.id, c.name.as_deref()?)))
        .collect();
    let list: Vec<String> = counts
        .iter()
        .take(12)
        .map(|(id, n)| match names.get(id) {
            Some(name) => format!("{id} {name} ({n})"),
            None => format!("{id} ({n})"),
        })
        .collect();
    let list = list.join(", ");
    match label {
        Some(label) if counts.contains_key(&label) => {
            Ok((Box::new(move |category| category == label), None))
        }
        Some(label) => Err(ImportError::bad(
            path,
            format!("no annotation has the category {label}; there are {list}"),
            "choose one of them with --label",
        )),
        None => Ok((
            Box::new(|_| true),
            (counts.len() > 1).then(|| {
                format!("all categories are taken as the object ({list}); choose one with --label")
            }),
        )),
    }
}

/// Pictures by the ends of their paths, from all of it to the name and to its stem; `None` where two share it.
fn by_name(pictures: &[Picture]) -> HashMap<String, Option<&Picture>> {
    let mut map: HashMap<String, Option<&Picture>> = HashMap::new();
    for picture in pictures {
        for key in keys(&picture.file_name) {
            map.entry(key)
                .and_modify(|known| {
                    if !known.is_some_and(|known| std::ptr::eq(known, picture)) {
                        *known = None;
                    }
                })
                .or_insert(Some(picture));
        }
    }
    map
}

/// The picture of a photo, and the name it was found by.
fn find<'a>(
    pictures: &HashMap<String, Option<&'a Picture>>,
    name: &str,
) -> Option<(&'a Picture, String)> {
    keys(name)
        .into_iter()
        .find_map(|key| Some((pictures.get(&key).copied().flatten()?, key)))
}

/// Ends of paths, with and without ending, that several photos have.
fn shared_names(photos: &[Wanted<'_>]) -> HashSet<String> {
    let mut seen = HashSet::new();
    let mut shared = HashSet::new();
    for photo in photos {
        // Of a photo without ending two of these are one.
        for name in keys(photo.name).into_iter().collect::<HashSet<_>>() {
            if !seen.insert(name.clone()) {
                shared.insert(name);
            }
        }
    }
    shared
}

fn full_name(name: &str) -> String {
    name.replace('\\', "/")
}

/// The ends of a path, longest first, and its name's stem.
fn keys(name: &str) -> Vec<String> {
    let full = full_name(name);
    let inner = full.match_indices('/').map(|(at, _)| &full[at + 1..]);
    let mut keys: Vec<String> = std::iter::once(&*full)
        .chain(inner)
        .map(str::to_owned)
        .collect();
    let base = full.rsplit('/').next().unwrap_or_default();
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
    keys.push(stem.to_owned());
    keys
}

fn draw_one(
    picture: &Picture,
    parts: &[&Segmentation],
    photo: (u32, u32),
) -> Result<GrayImage, String> {
    // Pixels are counted in the size that was annotated.
    let runs = parts.iter().find_map(|part| match part {
        Segmentation::Runs { size: [h, w], .. } => Some((*w, *h)),
        Segmentation::Polygons(_) | Segmentation::Polygon(_) => None,
    });
    let stated = picture.width.zip(picture.height);
    let (width, height) = stated.or(runs).unwrap_or(photo);
    if !same_shape((width, height), photo) {
        return Err(format!(
            "it was annotated at {width}x{height}, but the photo is {}x{}, another shape",
            photo.0, photo.1
        ));
    }
    let most = (LARGEST_SCALE * u64::from(photo.0)).min(1 << 16);
    if u64::from(width) > most {
        return Err(format!(
            "it was annotated at {width}x{height}, which is too large for the photo's {}x{}",
            photo.0, photo.1
        ));
    }
    let (w, h) = (width as usize, height as usize);
    let mut mask = vec![false; w * h];
    for part in parts {
        match part {
            Segmentation::Polygons(polygons) => {
                for points in polygons {
                    polygon::fill(&mut mask, w, h, points);
                }
            }
            Segmentation::Polygon(points) => polygon::fill(&mut mask, w, h, points),
            Segmentation::Runs { size, counts } => {
                if *size != [height, width] {
                    return Err(format!(
                        "an outline is for {}x{} pixels, not {width}x{height}",
                        size[1], size[0]
                    ));
                }
                match counts {
                    Counts::Plain(lengths) => run_lengths::fill(&mut mask, w, h, lengths)?,
                    Counts::Packed(text) => {
                        run_lengths::fill(&mut mask, w, h, &run_lengths::unpack(text)?)?;
                    }
                }
            }
        }
    }
    Ok(GrayImage::from_fn(width, height, |x, y| {
        Luma([if mask[y as usize * w + x as usize] {
            255
        } else {
            0
        }])
    }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_mask_is_handed_over_before_the_next_is_drawn() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("coco.json");
        // The third cannot be drawn: it was annotated in another shape.
        let text = r#"{
            "images": [
                {"id": 1, "file_name": "a.png"}, {"id": 2, "file_name": "b.png"},
                {"id": 3, "file_name": "c.png", "width": 9, "height": 2}
            ],
            "annotations": [
                {"image_id": 1, "segmentation": [[0, 0, 4, 0, 4, 4]]},
                {"image_id": 2, "segmentation": [[0, 0, 4, 0, 4, 4]]},
                {"image_id": 3, "segmentation": [[0, 0, 4, 0, 4, 4]]}
            ]
        }"#;
        std::fs::write(&path, text).unwrap();
        let photos =
            ["none.png", "a.png", "b.png", "c.png"].map(|name| Wanted { name, size: (8, 8) });
        let mut taken = Vec::new();
        let error = draw(&path, None, &photos, |i, mask| {
            taken.push((i, mask.dimensions()));
            Ok(())
        });
        assert!(
            error
                .unwrap_err()
                .to_string()
                .contains("c.png: it was annotated at 9x2")
        );
        assert_eq!(taken, [(1, (8, 8)), (2, (8, 8))]);
        // Nor is anything drawn after one that could not be kept.
        let mut tried = 0;
        let full = draw(&path, None, &photos, |_, _| {
            tried += 1;
            Err(ImportError::bad(&path, "full", "free some space"))
        });
        assert!(full.is_err() && tried == 1);
    }
}
