//! Photos to a scene, with a stand-in for COLMAP.

use crate::stand_ins::{Dialect, Listener, Workshop, text};
use image::codecs::jpeg::JpegEncoder;
use image::{GrayImage, ImageEncoder as _, RgbImage};
use io_colmap::{PhotoHeader, Scene};
use scene_capture::{CaptureOptions, Existing, Progress, Source, Stage, Tools, capture};
use std::fs;
use std::path::Path;

const NAMES: [&str; 4] = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"];

/// How many photos a capture has, or what it complains about.
fn photos_in(
    source: &Source,
    out: &Path,
    tools: &Tools,
    existing: Existing,
) -> Result<usize, String> {
    let options = CaptureOptions {
        existing,
        ..CaptureOptions::default()
    };
    let captured = capture(source, out, tools, &options, &());
    captured
        .map(|captured| captured.photos)
        .map_err(|error| error.to_string())
}

#[test]
fn photos_become_a_scene_in_either_dialect() {
    for dialect in [Dialect::Three, Dialect::Four] {
        let shop = Workshop::new();
        let photos = shop.photos(&NAMES);
        shop.model(0, 0, &["a.jpg"]);
        shop.model(0, 1, &NAMES[1..]);
        let out = shop.path("made/scene");
        let watch = Listener::default();
        let captured = capture(
            &Source::Photos(photos.clone()),
            &out,
            &shop.tools(dialect),
            &CaptureOptions::default(),
            &watch,
        )
        .unwrap();
        assert_eq!((captured.photos, captured.registered), (4, 3));
        assert_eq!(captured.models, [3, 1]);
        assert_eq!(captured.warning, None);
        assert_eq!(captured.notes, *watch.notes.lock().unwrap());
        assert!(
            captured
                .notes
                .iter()
                .any(|n| n.contains("fell apart into 2 models"))
        );

        let scene = Scene::open(&out).unwrap();
        assert_eq!(scene.model.views.len(), 3, "the largest is sparse/0");
        assert_eq!(fs::read_dir(out.join("images")).unwrap().count(), 4);
        assert!(!out.join("work").exists());
        assert!(!shop.has_leftovers());
        let record = text(&out.join("capture.txt"));
        assert!(record.starts_with("captured from "), "{record}");
        assert!(record.contains("3 of 4 photos have poses"), "{record}");

        let told = shop.told();
        let gpu = match dialect {
            Dialect::Three => ["--SiftExtraction.use_gpu 0", "--SiftMatching.use_gpu 0"],
            Dialect::Four => [
                "--FeatureExtraction.use_gpu 0",
                "--FeatureMatching.use_gpu 0",
            ],
        };
        assert!(told[0].starts_with("feature_extractor ") && told[0].contains(gpu[0]));
        assert!(told[1].starts_with("exhaustive_matcher ") && told[1].contains(gpu[1]));
        assert!(told[2].starts_with("mapper "));
        let progress = watch.progress.lock().unwrap();
        for (stage, done, total) in [
            (Stage::Features, 4, 4),
            (Stage::Matches, 1, 1),
            (Stage::Poses, 3, 4),
        ] {
            assert!(
                progress.contains(&Progress { stage, done, total }),
                "{progress:?}"
            );
        }
    }
}

#[test]
fn models_that_share_photos_become_one() {
    let names = [
        "a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg", "g.jpg",
    ];
    let captured = |merged: Option<&[&str]>, second: &[&str]| {
        let shop = Workshop::new();
        let photos = shop.photos(&names);
        shop.model(0, 0, &names[..5]);
        shop.model(0, 1, second);
        if let Some(merged) = merged {
            shop.merged(merged);
        }
        let captured = capture(
            &Source::Photos(photos),
            &shop.path("scene"),
            &shop.tools(Dialect::Four),
            &CaptureOptions::default(),
            &(),
        )
        .unwrap();
        let scene = Scene::open(&shop.path("scene")).unwrap();
        assert_eq!(scene.model.views.len(), captured.registered);
        let merges = shop.told();
        let merges = merges
            .iter()
            .filter(|told| told.starts_with("model_merger "));
        (captured, merges.count())
    };
    let (made, _) = captured(Some(&names), &names[2..6]);
    assert_eq!(made.models, [7]);
    let note = "models of 5 and 4 photos share some, and were merged";
    assert!(made.notes.iter().any(|n| n == note), "{made:?}");
    assert!(!made.notes.iter().any(|n| n.contains("fell apart")));

    // A tool that fails on the way costs no more than the merging.
    let shop = Workshop::new();
    let photos = shop.photos(&names);
    shop.model(0, 0, &names[..5]);
    shop.model(0, 1, &names[2..6]);
    shop.merged(&names);
    let tools = Tools {
        colmap: shop.colmap(
            Dialect::Four,
            r#"if [ "$1" = bundle_adjuster ]; then exit 1; fi"#,
        ),
        ffmpeg: None,
    };
    let out = shop.path("scene");
    let options = CaptureOptions::default();
    let made = capture(&Source::Photos(photos), &out, &tools, &options, &()).unwrap();
    assert_eq!(made.models, [5, 4]);
    let said = |n: &String| n.starts_with("models were not merged: ") && n.contains("by hand");
    assert!(made.notes.iter().any(said), "{made:?}");

    // They do not fit; two photos are too few; there is nothing new in the second.
    let (made, merges) = captured(None, &names[2..6]);
    assert_eq!((&*made.models, merges), (&[5, 4][..], 1));
    assert!(made.notes.iter().any(|n| n.contains("fell apart")));
    for second in [&names[3..6], &names[1..5]] {
        let (made, merges) = captured(Some(&names), second);
        assert_eq!((made.models.len(), merges), (2, 0), "{second:?}");
    }
}

/// An EXIF block with the orientation as its only entry.
fn exif(orientation: u8) -> Vec<u8> {
    let mut block = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    block.extend([orientation, 0, 0, 0, 0, 0, 0]);
    block
}

#[test]
fn photos_are_turned_as_viewers_show_them() {
    let shop = Workshop::new();
    let photos = shop.photos(&NAMES);
    // Bright at the left as stored, which is above as seen.
    let stored = RgbImage::from_fn(64, 48, |x, _| {
        image::Rgb([if x < 32 { 240 } else { 10 }; 3])
    });
    let mut out = fs::File::create(photos.join("b.jpg")).unwrap();
    let mut encoder = JpegEncoder::new(&mut out);
    encoder.set_exif_metadata(exif(6)).unwrap();
    stored.write_with_encoder(encoder).unwrap();
    shop.model(0, 0, &["a.jpg", "c.jpg", "d.jpg"]);
    let masks = shop.path("m");
    fs::create_dir(&masks).unwrap();
    GrayImage::from_pixel(64, 48, image::Luma([255]))
        .save(masks.join("b.png"))
        .unwrap();
    let captured = capture(
        &Source::Photos(photos.clone()),
        &shop.path("scene"),
        &shop.tools(Dialect::Three),
        &CaptureOptions {
            masks: Some(masks),
            ..CaptureOptions::default()
        },
        &(),
    )
    .unwrap();
    let said = "of 4 photos 1 are turned upright, as their EXIF says they are seen";
    assert!(
        captured.notes.iter().any(|note| note == said),
        "{captured:?}"
    );
    let header = PhotoHeader::read(&shop.path("scene/images/b.jpg")).unwrap();
    assert_eq!((header.stored, header.upright()), ((48, 64), (48, 64)));
    let turned = image::open(shop.path("scene/images/b.jpg"))
        .unwrap()
        .into_rgb8();
    assert!(turned.get_pixel(24, 10).0[0] > 200 && turned.get_pixel(24, 54).0[0] < 60);
    let kept = PhotoHeader::read(&photos.join("b.jpg")).unwrap();
    assert_eq!(kept.stored, (64, 48), "the photo itself is left alone");
}

#[test]
fn names_that_differ_only_in_their_ending_are_refused_at_once() {
    let shop = Workshop::new();
    let photos = shop.photos(&["a.jpg", "b.jpg", "b.png", "c.jpg", "d.jpg"]);
    let refused = capture(
        &Source::Photos(photos),
        &shop.path("scene"),
        &shop.tools(Dialect::Three),
        &CaptureOptions::default(),
        &(),
    )
    .unwrap_err()
    .to_string();
    assert!(
        refused.contains("b.jpg and b.png differ only in their ending") && refused.contains("keep"),
        "{refused}"
    );
    assert!(!shop.path("scene").exists());
}

#[test]
fn each_size_is_a_call_and_a_camera() {
    let shop = Workshop::new();
    let photos = shop.photos(&NAMES);
    RgbImage::new(48, 64).save(photos.join("b.jpg")).unwrap();
    shop.model(0, 0, &["a.jpg", "c.jpg", "d.jpg"]);
    capture(
        &Source::Photos(photos),
        &shop.path("scene"),
        &shop.tools(Dialect::Three),
        &CaptureOptions::default(),
        &(),
    )
    .unwrap();
    assert_eq!(text(&shop.path("listed")), "b.jpg\na.jpg\nc.jpg\nd.jpg\n");
    let calls = shop.told();
    assert_eq!(
        calls
            .iter()
            .filter(|call| call.starts_with("feature"))
            .count(),
        2
    );
}

#[test]
fn masks_are_handed_on_and_few_poses_warned_of() {
    let shop = Workshop::new();
    let photos = shop.photos(&["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg"]);
    fs::create_dir(photos.join("masks")).unwrap();
    GrayImage::from_pixel(64, 48, image::Luma([255]))
        .save(photos.join("masks/a.png"))
        .unwrap();
    shop.model(0, 0, &NAMES[..3]);
    let options = CaptureOptions {
        masks: Some(photos.join("masks")),
        ..CaptureOptions::default()
    };
    let captured = capture(
        &Source::Photos(photos),
        &shop.path("scene"),
        &shop.tools(Dialect::Four),
        &options,
        &(),
    )
    .unwrap();
    assert!(shop.told()[0].contains("--ImageReader.mask_path "));
    assert!(
        captured
            .notes
            .iter()
            .any(|note| note.contains("1 of 6 photos have one"))
    );
    let warning = captured.warning.unwrap();
    assert!(
        warning.starts_with("only 3 of 6 photos have poses; for more, take"),
        "{warning}"
    );
    assert!(text(&shop.path("scene/capture.txt")).contains(&warning));
}

#[test]
fn poses_by_fewer_matches_are_taken_where_there_are_no_others() {
    let shop = Workshop::new();
    shop.model(1, 0, &NAMES);
    let captured = capture(
        &Source::Photos(shop.photos(&NAMES)),
        &shop.path("scene"),
        &shop.tools(Dialect::Three),
        &CaptureOptions::default(),
        &(),
    )
    .unwrap();
    assert_eq!((captured.registered, captured.warning), (4, None));
    let said =
        "COLMAP's own thresholds gave poses for 0 of 4 photos, so poses by fewer matches are tried";
    assert!(
        captured.notes.iter().any(|note| note == said),
        "{:?}",
        captured.notes
    );
}

#[test]
fn only_a_captured_scene_is_replaced() {
    let shop = Workshop::new();
    let source = Source::Photos(shop.photos(&NAMES));
    for attempt in 0..2 {
        shop.model(attempt, 0, &NAMES);
    }
    let tools = shop.tools(Dialect::Three);
    let out = shop.path("scene");
    let make = |existing| photos_in(&source, &out, &tools, existing);
    // An empty folder is as good as none.
    fs::create_dir(&out).unwrap();
    assert_eq!(make(Existing::Keep), Ok(4));
    let refused = make(Existing::Keep).unwrap_err();
    assert!(
        refused.contains("there is something in it already, such as capture.txt; name"),
        "{refused}"
    );
    fs::write(out.join("old"), "").unwrap();
    assert_eq!(make(Existing::Replace), Ok(4));
    assert!(!out.join("old").exists());
    assert!(!shop.has_leftovers());

    fs::remove_file(out.join("capture.txt")).unwrap();
    let refused = make(Existing::Replace).unwrap_err();
    assert!(
        refused.contains("such as images, and no captured scene, so it is not replaced"),
        "{refused}"
    );
    assert!(out.join("sparse/0").is_dir());

    // All that a run leaves that was killed.
    fs::remove_dir_all(&out).unwrap();
    fs::create_dir_all(out.join(".sos-partial-a1B2c3")).unwrap();
    for existing in [Existing::Keep, Existing::Replace] {
        let refused = make(existing).unwrap_err();
        assert!(
            refused.contains("such as .sos-partial-a1B2c3") && refused.contains("delete"),
            "{refused}"
        );
    }
}

#[test]
fn what_has_come_meanwhile_stays_and_so_do_the_poses() {
    let shop = Workshop::new();
    let source = Source::Photos(shop.photos(&NAMES));
    for attempt in 0..3 {
        shop.model(attempt, 0, &NAMES);
    }
    let out = shop.path("scene");
    let theirs = out.display();
    let make = |existing, meanwhile: &str| {
        let before = format!("if [ $1 = mapper ]; then {meanwhile}; fi");
        let tools = Tools {
            colmap: shop.colmap(Dialect::Three, &before),
            ffmpeg: None,
        };
        photos_in(&source, &out, &tools, existing)
    };
    let refused = make(
        Existing::Keep,
        &format!("mkdir '{theirs}'; touch '{theirs}/theirs'"),
    );
    let (refused, kept) = (refused.unwrap_err(), shop.path("scene-2"));
    let says = format!(
        "such as theirs; it came while poses were looked for; the captured scene is {}",
        kept.display()
    );
    assert!(refused.contains(&says), "{refused}");
    assert!(out.join("theirs").is_file() && !out.join("sparse").exists());
    assert_eq!(io_colmap::Scene::open(&kept).unwrap().model.views.len(), 4);
    assert!(kept.join("capture.txt").is_file());

    // What was to be replaced was a captured scene, and is none any more.
    fs::write(out.join("capture.txt"), "").unwrap();
    let refused = make(Existing::Replace, &format!("rm '{theirs}/capture.txt'"));
    assert!(refused.unwrap_err().contains("scene-3 instead"));
    assert!(out.join("theirs").is_file() && shop.path("scene-3/sparse/0").is_dir());
    // As long as it is one, it makes place.
    fs::write(out.join("capture.txt"), "").unwrap();
    assert_eq!(make(Existing::Replace, "true"), Ok(4));
    assert!(!out.join("theirs").exists() && !shop.has_leftovers());
}
