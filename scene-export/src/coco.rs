//! Masks as COCO's JSON: one category, one annotation per view that shows the object.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::picture::Matte;
use crate::run::{Posed, Run};
use crate::run_lengths::{of_matte, pack};
use rayon::prelude::*;
use serde::Serialize;
use std::io::Write as _;

/// How COCO's run lengths are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RunLengths {
    /// As text, as pycocotools' `encode` gives them and most data sets have them.
    #[default]
    Packed,
    /// As a list of numbers, which is longer and readable.
    Plain,
}

#[derive(Serialize)]
struct File<'a> {
    info: Info,
    licenses: [(); 0],
    images: Vec<Picture<'a>>,
    annotations: Vec<Annotation>,
    categories: [Category; 1],
}

#[derive(Serialize)]
struct Info {
    description: &'static str,
}

#[derive(Serialize)]
struct Picture<'a> {
    id: usize,
    file_name: &'a str,
    width: u32,
    height: u32,
}

#[derive(Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    category_id: u32,
    iscrowd: u32,
    area: u64,
    /// Left, top, width, height.
    bbox: [u32; 4],
    segmentation: Segmentation,
}

#[derive(Serialize)]
struct Segmentation {
    /// Height, width.
    size: [u32; 2],
    counts: Counts,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Counts {
    Packed(String),
    Plain(Vec<u32>),
}

#[derive(Serialize)]
struct Category {
    id: u32,
    name: &'static str,
    supercategory: &'static str,
}

/// Writes `coco.json`; returns how many views show the object.
pub(crate) fn write(
    run: &Run,
    posed: &[Posed<'_>],
    run_lengths: RunLengths,
    draft: &Draft,
) -> Result<usize, ExportError> {
    let found: Vec<Option<Annotation>> = posed
        .par_iter()
        .enumerate()
        .map(|(i, posed)| Ok(annotation(i + 1, &run.matte_of(*posed)?, run_lengths)))
        .collect::<Result<_, ExportError>>()?;
    let mut annotations: Vec<Annotation> = found.into_iter().flatten().collect();
    for (i, annotation) in annotations.iter_mut().enumerate() {
        annotation.id = i + 1;
    }
    let count = annotations.len();
    let file = File {
        info: Info {
            description: concat!(
                "masks of one object in posed photos, made by sos ",
                env!("CARGO_PKG_VERSION"),
                "; a pixel is the object's where its matte is at least 0.5"
            ),
        },
        licenses: [],
        images: (1..)
            .zip(posed)
            .map(|(id, posed)| Picture {
                id,
                file_name: &posed.view.name,
                width: posed.camera.width,
                height: posed.camera.height,
            })
            .collect(),
        annotations,
        categories: [Category {
            id: 1,
            name: "object",
            supercategory: "object",
        }],
    };
    draft.write("coco.json", |out| {
        serde_json::to_writer(&mut *out, &file)?;
        writeln!(out)
    })?;
    Ok(count)
}

/// What there is to say about a matte; nothing if the object is not in it.
fn annotation(image_id: usize, matte: &Matte, run_lengths: RunLengths) -> Option<Annotation> {
    let inside = matte.binary(1, 0);
    let width = matte.width as usize;
    let (mut left, mut top) = (u32::MAX, u32::MAX);
    let (mut right, mut bottom, mut area) = (0, 0, 0);
    for i in (0..inside.len()).filter(|i| inside[*i] == 1) {
        let (x, y) = ((i % width) as u32, (i / width) as u32);
        (left, right) = (left.min(x), right.max(x));
        (top, bottom) = (top.min(y), bottom.max(y));
        area += 1;
    }
    if area == 0 {
        return None;
    }
    let lengths = of_matte(matte);
    Some(Annotation {
        id: 0,
        image_id,
        category_id: 1,
        iscrowd: 0,
        area,
        bbox: [left, top, right - left + 1, bottom - top + 1],
        segmentation: Segmentation {
            size: [matte.height, matte.width],
            counts: match run_lengths {
                RunLengths::Packed => Counts::Packed(pack(&lengths)),
                RunLengths::Plain => Counts::Plain(lengths),
            },
        },
    })
}
