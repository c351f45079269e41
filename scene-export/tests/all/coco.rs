//! COCO files read back, by a decoder of our own and by scene-import.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha};
use scene_export::{Options, Product, RunLengths, Target, export};
use scene_import::{MaskOptions, MaskSource, detect, read};
use serde_json::Value;
use std::fs;

/// The mask of plain run lengths, row-major.
fn decode(lengths: &[u64]) -> Vec<bool> {
    let mut columns = Vec::new();
    for (i, length) in lengths.iter().enumerate() {
        columns.extend(std::iter::repeat_n(i % 2 == 1, *length as usize));
    }
    assert_eq!(columns.len(), (WIDTH * HEIGHT) as usize);
    let pixel = |i: u32| columns[(i % WIDTH * HEIGHT + i / WIDTH) as usize];
    (0..WIDTH * HEIGHT).map(pixel).collect()
}

fn file(rig: &Rig, run_lengths: RunLengths) -> Value {
    let options = Options {
        run_lengths,
        ..Options::default()
    };
    let product = Product::Files(Target::Coco);
    let written = export(&rig.run(), product, &rig.out(), &options).unwrap();
    assert_eq!(written.count, 3);
    assert!(
        written.notes[0].contains("3 of 4 views"),
        "{:?}",
        written.notes
    );
    serde_json::from_slice(&fs::read(rig.out().join("coco.json")).unwrap()).unwrap()
}

#[test]
fn annotations_describe_the_mattes() {
    let rig = Rig::new();
    let coco = file(&rig, RunLengths::Plain);
    assert_eq!(coco["categories"][0]["id"], 1);
    let images = coco["images"].as_array().unwrap();
    assert_eq!(images.len(), PHOTOS.len());
    for (image, name) in images.iter().zip(PHOTOS) {
        assert_eq!(image["file_name"], name);
        assert_eq!(
            (&image["width"], &image["height"]),
            (&WIDTH.into(), &HEIGHT.into())
        );
    }
    let annotations = coco["annotations"].as_array().unwrap();
    let ids: Vec<u64> = annotations
        .iter()
        .map(|a| a["id"].as_u64().unwrap())
        .collect();
    assert_eq!(ids, [1, 2, 3]);
    for annotation in annotations {
        let photo = annotation["image_id"].as_u64().unwrap() as usize - 1;
        let segmentation = &annotation["segmentation"];
        assert_eq!(segmentation["size"], serde_json::json!([HEIGHT, WIDTH]));
        let counts = segmentation["counts"].as_array().unwrap();
        let lengths: Vec<u64> = counts.iter().map(|v| v.as_u64().unwrap()).collect();
        let mask = decode(&lengths);
        let mut area = 0;
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let inside = alpha(photo, x, y) >= 32768;
                assert_eq!(mask[(y * WIDTH + x) as usize], inside, "{x} {y}");
                area += u64::from(inside);
            }
        }
        assert_eq!(annotation["area"], area);
        assert_eq!(
            (&annotation["iscrowd"], &annotation["category_id"]),
            (&0.into(), &1.into())
        );
        // A disc of radius 8 around (20, 15); its edge is exactly half covered.
        assert_eq!(annotation["bbox"], serde_json::json!([13, 8, 15, 15]));
    }
}

#[test]
fn packed_run_lengths_are_read_by_scene_import() {
    let rig = Rig::new();
    let coco = file(&rig, RunLengths::Packed);
    assert!(coco["annotations"][0]["segmentation"]["counts"].is_string());
    let imported = read(&detect(&rig.run().join("scene"), None).unwrap(), None).unwrap();
    let options = MaskOptions {
        source: MaskSource::Path(rig.out().join("coco.json")),
        ..MaskOptions::default()
    };
    let scene = rig.run().join("again");
    let written = imported.write(&scene, &options).unwrap();
    assert_eq!(written.masks, 3);
    let mask = image::open(scene.join("masks/000.png.png"))
        .or_else(|_| image::open(scene.join("masks/000.png")))
        .unwrap()
        .into_luma8();
    for (x, y, pixel) in mask.enumerate_pixels() {
        assert_eq!(pixel[0] == 255, alpha(0, x, y) >= 32768);
    }
}
