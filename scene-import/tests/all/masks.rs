//! Masks of every kind end as white-on-black PNG files of the right photo.

use crate::fixtures;
use crate::rig::{HEIGHT, WIDTH};
use image::{GrayImage, Luma, Rgba, RgbaImage};
use io_colmap::{MaskSet, Polarity, Scene};
use scene_import::{Format, ImportError, MaskOptions, MaskSource, Written, detect, read};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// Is the pixel in the object that all these masks show?
fn inside(x: u32, y: u32) -> bool {
    (20..70).contains(&x) && (10..50).contains(&y)
}

fn mask(white: u8, black: u8) -> GrayImage {
    GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
        Luma([if inside(x, y) { white } else { black }])
    })
}

fn save(mask: &GrayImage, path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    mask.save(path).unwrap();
}

fn import(dir: &Path, options: &MaskOptions) -> Result<(Written, PathBuf), ImportError> {
    let imported = read(&detect(dir, None)?, None)?;
    let out = tempfile::tempdir().unwrap().keep().join("out");
    Ok((imported.write(&out, options)?, out))
}

fn from(path: &Path) -> MaskOptions {
    MaskOptions {
        source: MaskSource::Path(path.to_owned()),
        ..MaskOptions::default()
    }
}

/// These photos' masks are written, show the object in white, and are found again.
fn assert_written(out: &Path, photos: &[&str]) {
    let mut names: Vec<String> = fs::read_dir(out.join("masks"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != io_colmap::POLARITY_FILE)
        .collect();
    names.sort();
    let expected: Vec<String> = photos.iter().map(|name| format!("{name}.png")).collect();
    assert_eq!(names, expected);
    for name in &names {
        let found = image::open(out.join("masks").join(name))
            .unwrap()
            .into_luma8();
        assert_eq!(found, mask(255, 0), "{name}");
    }
    let scene = Scene::open(out).unwrap();
    let set = MaskSet::find(&out.join("masks"), &scene, None).unwrap();
    assert_eq!(set.paths.iter().flatten().count(), photos.len());
    fs::remove_dir_all(out.parent().unwrap()).unwrap();
}

#[test]
fn mask_path_of_transforms_is_followed_whatever_its_polarity() {
    for (white, black) in [(255, 0), (0, 255)] {
        let dir = tempfile::tempdir().unwrap();
        fixtures::transforms(dir.path(), |file| {
            for i in [0, 1, 3] {
                file["frames"][i]["mask_path"] = format!("m/{}.png", 10 * i).into();
            }
        });
        for i in [0, 10] {
            save(&mask(white, black), &dir.path().join(format!("m/{i}.png")));
        }
        let (written, out) = import(dir.path(), &MaskOptions::default()).unwrap();
        assert_eq!(written.masks, 2);
        assert!(
            written
                .notes
                .iter()
                .any(|n| n.contains("m/30.png is missing"))
        );
        assert_written(&out, &["0001", "0002"]);
        fs::remove_dir_all(dir.path().join("m")).unwrap();
    }
}

#[test]
fn folders_are_looked_up_and_their_polarity_may_be_stated() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    for name in ["0001", "0003"] {
        save(&mask(255, 0), &dir.path().join(format!("masks/{name}.png")));
        save(
            &mask(0, 255),
            &dir.path().join(format!("hide/{name}_mask.png")),
        );
    }
    let (written, out) = import(dir.path(), &MaskOptions::default()).unwrap();
    assert_eq!(written.masks, 2);
    assert_written(&out, &["0001", "0003"]);
    let (_, out) = import(dir.path(), &from(&dir.path().join("hide"))).unwrap();
    assert_written(&out, &["0001", "0003"]);
    let stated = MaskOptions {
        polarity: Some(Polarity::WhiteIsObject),
        ..from(&dir.path().join("hide"))
    };
    let (_, out) = import(dir.path(), &stated).unwrap();
    let found = image::open(out.join("masks/0001.png"))
        .unwrap()
        .into_luma8();
    assert_eq!(found, mask(0, 255));
    // Whoever reads them takes what was said, though they look otherwise.
    let scene = Scene::open(&out).unwrap();
    let set = MaskSet::find(&out.join("masks"), &scene, None).unwrap();
    assert_eq!(set.polarity, Polarity::WhiteIsObject);
    fs::write(out.join("masks").join(io_colmap::POLARITY_FILE), "grey\n").unwrap();
    let error = MaskSet::find(&out.join("masks"), &scene, None).unwrap_err();
    assert!(error.to_string().contains("polarity.txt"), "{error}");
    let none = MaskOptions {
        source: MaskSource::None,
        ..MaskOptions::default()
    };
    let (written, out) = import(dir.path(), &none).unwrap();
    assert_eq!((written.masks, out.join("masks").exists()), (0, false));
}

#[test]
fn co3d_and_neus_bring_theirs_along() {
    let dir = tempfile::tempdir().unwrap();
    let sequence = fixtures::co3d(dir.path(), None);
    fixtures::neus(&dir.path().join("neus"));
    for name in ["0001", "0002", "0003", "0004"] {
        save(&mask(255, 0), &sequence.join(format!("masks/{name}.png")));
        save(
            &mask(255, 0),
            &dir.path().join(format!("neus/mask/{name}.png")),
        );
    }
    for scene in [sequence, dir.path().join("neus")] {
        let (written, out) = import(&scene, &MaskOptions::default()).unwrap();
        assert_eq!(written.masks, 4);
        assert_written(&out, &["0001", "0002", "0003", "0004"]);
    }
}

#[test]
fn coco_polygons_and_run_lengths_are_drawn() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let file = dir.path().join("coco.json");
    // The same rectangle as an outline, as two, as run lengths, and as pycocotools packs them.
    let mut lengths = vec![20 * 64 + 10];
    for _ in 0..49 {
        lengths.extend([40, 24]);
    }
    lengths.extend([40, 14 + 26 * 64]);
    let packed = PACKED;
    fs::write(
        &file,
        json!({
            "images": [
                {"id": 7, "file_name": "photos/0001.jpg", "width": 96, "height": 64},
                {"id": "b", "file_name": "0002.png"},
                {"id": 9, "file_name": "0003.png", "width": 96, "height": 64},
                {"id": 10, "file_name": "0004.png", "width": 96, "height": 64},
                {"id": 11, "file_name": "other.png", "width": 5, "height": 5},
            ],
            "annotations": [
                {"image_id": 7, "category_id": 3, "segmentation": [
                    [20, 10, 70, 10, 70, 30, 20, 30], [20, 30, 70, 30, 70, 50, 20, 50]]},
                {"image_id": "b", "category_id": 3, "segmentation": [[20, 10, 70, 10, 70, 50, 20, 50]]},
                {"image_id": 9, "category_id": 3, "iscrowd": 1,
                    "segmentation": {"size": [64, 96], "counts": lengths}},
                {"image_id": 10, "category_id": 3, "iscrowd": 1,
                    "segmentation": {"size": [64, 96], "counts": packed}},
                {"image_id": 10, "category_id": 4, "segmentation": [[0, 0, 9, 0, 9, 9]]},
                {"image_id": 10, "category_id": 3, "segmentation": []},
            ],
            "categories": [{"id": 3, "name": "cat"}, {"id": 4, "name": "dog"}],
        })
        .to_string(),
    )
    .unwrap();
    let labelled = |label| MaskOptions {
        label: Some(label),
        ..from(&file)
    };
    let (written, out) = import(dir.path(), &labelled(3)).unwrap();
    assert_eq!(written.masks, 4);
    assert!(
        written
            .notes
            .iter()
            .any(|n| n.contains("1 annotations are boxes")),
        "{:?}",
        written.notes
    );
    assert_written(&out, &["0001", "0002", "0003", "0004"]);
    let (written, _) = import(dir.path(), &from(&file)).unwrap();
    let notes = written.notes.join("; ");
    assert!(
        notes.contains("3 cat (5), 4 dog (1)") && notes.contains("--label"),
        "{notes}"
    );
    let error = import(dir.path(), &labelled(5)).unwrap_err().to_string();
    assert!(error.contains("3 cat (5)"), "{error}");
}

/// `pycocotools.mask.encode` of the 96 x 64 picture of [`inside`].
pub(crate) const PACKED: &str = "ZX1X1h00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000fc1";

#[test]
fn coco_files_may_begin_with_a_byte_order_mark() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let content = json!({
        "images": [{"id": 1, "file_name": "0001.png", "width": 96, "height": 64}],
        "annotations": [{"image_id": 1, "segmentation": [[20, 10, 70, 10, 70, 50, 20, 50]]}],
    });
    let file = dir.path().join("coco.json");
    fs::write(&file, format!("\u{feff}{content}")).unwrap();
    let (written, out) = import(dir.path(), &from(&file)).unwrap();
    assert_eq!(written.masks, 1);
    assert_written(&out, &["0001"]);
}

#[test]
fn a_coco_picture_without_folders_is_no_photos_that_share_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let stated = ["images/left/a.png", "images/right/a.png"];
    fixtures::transforms(dir.path(), |file| {
        for (i, path) in stated.into_iter().enumerate() {
            file["frames"][i]["file_path"] = path.into();
        }
    });
    for path in stated {
        crate::rig::write_photo(&dir.path().join(path), WIDTH, HEIGHT);
    }
    let file = dir.path().join("coco.json");
    let outline = json!([[20, 10, 70, 10, 70, 50, 20, 50]]);
    let import_with = |name: &str| {
        let content = json!({
            "images": [{"id": 1, "file_name": name}, {"id": 2, "file_name": "0003"}],
            "annotations": [
                {"image_id": 1, "segmentation": outline}, {"image_id": 2, "segmentation": outline},
            ],
        });
        fs::write(&file, content.to_string()).unwrap();
        import(dir.path(), &from(&file)).unwrap()
    };
    let (written, out) = import_with("a.png");
    assert_written(&out, &["0003"]);
    let says = "2 photos have no outline as others bear their names too and the file does not state their folders: left/a.png";
    let said = written.notes.iter().any(|note| note.contains(says));
    assert!(said, "{:?}", written.notes);
    // More folders than photos are named by are no hindrance.
    for name in [
        "right/a.png",
        "images/right/a.png",
        "data/images/right/a.png",
    ] {
        let (written, out) = import_with(name);
        assert_eq!(written.masks, 2, "{name}");
        let drawn = out.join("masks/right/a.png");
        let drawn = image::open(drawn).unwrap().into_luma8();
        assert!(drawn == mask(255, 0), "{name}");
        assert!(!out.join("masks/left").exists(), "{name}");
    }
}

#[test]
fn coco_files_for_other_photos_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let file = dir.path().join("coco.json");
    let refused = |content: serde_json::Value, says: &str| {
        fs::write(&file, content.to_string()).unwrap();
        let error = import(dir.path(), &from(&file)).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    };
    let images = json!([{"id": 1, "file_name": "0001.png", "width": 96, "height": 64}]);
    let with = |segmentation: serde_json::Value| json!({"images": images, "annotations": [{"image_id": 1, "segmentation": segmentation}]});
    refused(json!({"images": [], "annotations": []}), "no pictures");
    // Boxes, as tools write them; a line has no inside either.
    for no_outline in [
        json!([]),
        json!([[]]),
        json!([[20, 10, 70, 10]]),
        json!([20, 10]),
    ] {
        refused(with(no_outline), "has an outline");
    }
    refused(
        with(json!({"size": [64, 96], "counts": [1, 2]})),
        "cover 3 pixels",
    );
    refused(with(json!({"size": [63, 96], "counts": [1, 2]})), "96x63");
    refused(with(json!({"size": [64, 96], "counts": "~"})), "damaged");
    refused(
        with(json!(7)),
        "line 1: the segmentation of an annotation must be polygons",
    );
    let sized = |width: u32, height: u32| {
        json!({
            "images": [{"id": 1, "file_name": "0001.png", "width": width, "height": height}],
            "annotations": [{"image_id": 1, "segmentation": [[0, 0, 1, 0, 1, 1]]}],
        })
    };
    refused(sized(96, 96), "another shape");
    for (width, height) in [(960_000_000, 640_000_000), (65_536, 43_691), (864, 576)] {
        let says = format!("at {width}x{height}, which is too large for the photo's 96x64");
        refused(sized(width, height), &says);
    }
}

#[test]
fn coco_is_read_as_tables_and_simple_tools_write_it() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let file = dir.path().join("coco.json");
    let content = json!({
        "images": [
            {"id": 1, "file_name": "0001.png", "width": 96, "height": 64},
            // The largest size that is drawn.
            {"id": 2.0, "file_name": "0002.png", "width": 768, "height": 512},
            {"id": "3", "file_name": "0003.png"},
        ],
        "annotations": [
            {"image_id": 1.0, "segmentation": [20, 10, 70, 10, 70, 50, 20, 50]},
            {"image_id": 2, "segmentation": [[160, 80, 560, 80, 560, 400, 160, 400]]},
            {"image_id": 3, "segmentation": [[0, 0, 9, 0, 9, 9]]},
        ],
    });
    fs::write(&file, content.to_string()).unwrap();
    let (written, out) = import(dir.path(), &from(&file)).unwrap();
    assert_eq!(written.masks, 2, "a text is no number");
    assert_eq!(
        image::image_dimensions(out.join("masks/0002.png")).unwrap(),
        (768, 512)
    );
    fs::copy(out.join("masks/0001.png"), out.join("masks/0002.png")).unwrap();
    assert_written(&out, &["0001", "0002"]);
}

#[test]
fn one_label_of_a_label_picture_is_the_object() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    for name in ["0001", "0002"] {
        let labels = GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Luma([if inside(x, y) { 2 } else { u8::from(x > 80) }])
        });
        save(&labels, &dir.path().join(format!("labels/{name}.png")));
    }
    let labelled = |label| MaskOptions {
        label: Some(label),
        ..from(&dir.path().join("labels"))
    };
    let (written, out) = import(dir.path(), &labelled(2)).unwrap();
    assert_eq!(written.masks, 2);
    assert_written(&out, &["0001", "0002"]);
    let error = import(dir.path(), &labelled(9)).unwrap_err().to_string();
    assert!(error.contains("there are 0, 1, 2"), "{error}");
    let nothing = MaskOptions {
        label: Some(2),
        ..MaskOptions::default()
    };
    let error = import(dir.path(), &nothing).unwrap_err().to_string();
    assert!(error.contains("--masks"), "{error}");
    let other = dir.path().join("labels/0003.png");
    save(&GrayImage::from_pixel(64, 64, Luma([2])), &other);
    let error = import(dir.path(), &labelled(2)).unwrap_err().to_string();
    let says = "labels/0003.png: the label picture is 64x64 but its photo 0003.png is 96x64, another shape;";
    assert!(error.contains(says), "{error}");
}

#[test]
fn the_photos_themselves_are_no_masks_and_errors_name_what_lasts() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    crate::rig::write_photos(&dir.path().join("images_4"));
    for folder in ["images", "images_4"] {
        let error = import(dir.path(), &from(&dir.path().join(folder))).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(&format!(
                "{folder}: 4 of the 4 masks looked at are in many colours"
            )) && error.contains("--masks"),
            "{error}"
        );
    }
    let masks = dir.path().join("m");
    save(&GrayImage::new(64, 64), &masks.join("0002.png"));
    let error = import(dir.path(), &from(&masks)).unwrap_err().to_string();
    assert!(
        error.contains("m/0002.png: the mask is 64x64 but its photo 0002.png is 96x64")
            && !error.contains(".sos-partial-"),
        "{error}"
    );
}

#[test]
fn alpha_is_a_mask_and_leaves_the_photo() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    for name in ["0001", "0002", "0003"] {
        RgbaImage::from_fn(WIDTH, HEIGHT, |x, y| {
            let opaque = name == "0003" || inside(x, y);
            Rgba([x as u8, y as u8, 9, if opaque { 255 } else { 0 }])
        })
        .save(dir.path().join(format!("images/{name}.png")))
        .unwrap();
    }
    let (written, out) = import(dir.path(), &MaskOptions::default()).unwrap();
    assert_eq!(written.masks, 2, "an opaque channel says nothing");
    let photo = image::open(out.join("images/0001.png")).unwrap();
    assert!(!photo.color().has_alpha());
    // The photo under the mask is kept: it is one.
    assert_eq!(photo.into_rgb8().get_pixel(1, 2).0, [1, 2, 9]);
    assert_written(&out, &["0001", "0002"]);

    // Linear light times alpha, on nothing: half of 0.8 is half of the byte 231.
    let rendered = tempfile::tempdir().unwrap();
    fixtures::transforms(rendered.path(), |file| {
        file["frames"][0]["file_path"] = "images/0001.exr".into();
    });
    image::Rgba32FImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let alpha = match (inside(x, y), x) {
            (false, _) => 0.0,
            (true, 30) => 0.5,
            (true, _) => 1.0,
        };
        Rgba([0.8 * alpha, 0.8 * alpha, 0.8 * alpha, alpha])
    })
    .save(rendered.path().join("images/0001.exr"))
    .unwrap();
    let (_, out) = import(rendered.path(), &MaskOptions::default()).unwrap();
    let photo = image::open(out.join("images/0001.png"))
        .unwrap()
        .into_rgb8();
    let across = [5, 30, 50].map(|x| photo.get_pixel(x, 20).0[0]);
    assert_eq!(across, [0, 116, 231]);

    let opaque = tempfile::tempdir().unwrap();
    fixtures::transforms(opaque.path(), |_| {});
    let alpha = MaskOptions {
        source: MaskSource::Alpha,
        ..MaskOptions::default()
    };
    let error = import(opaque.path(), &alpha).unwrap_err().to_string();
    assert!(error.contains("alpha"), "{error}");
}

#[test]
fn masks_that_are_not_there_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    for (path, says) in [
        ("nowhere", "no such folder"),
        ("images/0001.png", "neither a folder"),
    ] {
        let error = import(dir.path(), &from(&dir.path().join(path))).unwrap_err();
        assert!(error.to_string().contains(says), "{error}");
    }
    assert_eq!(detect(dir.path(), None).unwrap().format, Format::Transforms);
}
