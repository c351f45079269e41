use crate::{assert_near, disc};
#[cfg(unix)]
use crate::{make_closed, open_again};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, Rgba, RgbaImage};
use sos_eval::*;
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) fn save(plane: &Plane, path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let bytes = plane
        .values
        .iter()
        .map(|v| (v * 255.0).round() as u8)
        .collect();
    GrayImage::from_raw(plane.width as u32, plane.height as u32, bytes)
        .unwrap()
        .save(path)
        .unwrap();
}

fn scene() -> (tempfile::TempDir, PathBuf, PathBuf, PathBuf) {
    let root = tempfile::tempdir().unwrap();
    let [pred, truth, start] = ["pred", "truth", "start"].map(|name| root.path().join(name));
    for i in 0..3 {
        save(
            &disc(40, 20.0, 20.0, 10.0),
            &truth.join(format!("{i:03}.png")),
        );
    }
    (root, pred, truth, start)
}

#[test]
fn missing_views_count_as_empty_and_are_listed() {
    let (_root, pred, truth, start) = scene();
    save(&disc(40, 20.0, 20.0, 10.0), &pred.join("000.png"));
    save(&disc(40, 21.0, 20.0, 10.0), &pred.join("002.png"));
    save(&disc(40, 20.0, 20.0, 10.0), &start.join("001.png"));
    let report = compare_folders(&pred, &truth, Some(&start)).unwrap();
    assert_eq!(
        report
            .views
            .iter()
            .map(|v| v.name.as_str())
            .collect::<Vec<_>>(),
        ["000", "001", "002"]
    );
    assert_eq!(report.missing, ["001"]);
    assert_eq!(report.start_missing, ["000", "002"]);
    assert_eq!(
        (report.views[0].score.iou, report.views[1].score.iou),
        (1.0, 0.0)
    );
    assert_near(
        report.mean.iou,
        (1.0 + report.views[2].score.iou) / 3.0,
        1e-12,
    );
    assert_near(report.start.unwrap().iou, 1.0 / 3.0, 1e-12);
}

#[test]
fn json_has_the_promised_keys_in_order() {
    let (_root, _, truth, _) = scene();
    let report = compare_folders(&truth, &truth, Some(&truth)).unwrap();
    let json = serde_json::to_string(&report).unwrap();
    let scores = r#""iou":1.0,"miou":1.0,"acc":1.0,"boundary_iou":1.0,"sad":0.0,"mse":0.0,"grad":0.0,"conn":0.0"#;
    let views: Vec<String> = (0..3)
        .map(|i| format!(r#"{{"name":"00{i}",{scores}}}"#))
        .collect();
    assert_eq!(
        json,
        format!(
            r#"{{"views":[{}],"mean":{{{scores}}},"start":{{{scores}}}}}"#,
            views.join(",")
        )
    );
    assert_eq!(serde_json::from_str::<Report>(&json).unwrap(), report);
}

#[test]
fn names_may_differ_in_padding_and_prefix() {
    let matte = disc(40, 20.0, 20.0, 10.0);
    for names in [
        ["0", "1", "2"],
        ["alpha_00000", "alpha_00001", "alpha_00002"],
        ["000", "m1", "mask-2"],
    ] {
        let (_root, pred, truth, _) = scene();
        names
            .iter()
            .for_each(|name| save(&matte, &pred.join(format!("{name}.png"))));
        let report = compare_folders(&pred, &truth, None).unwrap();
        assert_eq!(
            (report.mean.iou, report.missing.len()),
            (1.0, 0),
            "{names:?}"
        );
    }
}

#[test]
fn a_prefix_tells_two_cameras_apart() {
    let root = tempfile::tempdir().unwrap();
    let (pred, truth) = (root.path().join("pred"), root.path().join("truth"));
    for (camera, radius) in [("left", 5.0), ("right", 12.0)] {
        save(
            &disc(40, 20.0, 20.0, radius),
            &truth.join(format!("{camera}_01.png")),
        );
        save(
            &disc(40, 20.0, 20.0, radius),
            &pred.join(format!("{camera}_1.png")),
        );
    }
    assert_eq!(compare_folders(&pred, &truth, None).unwrap().mean.iou, 1.0);
    fs::rename(pred.join("left_1.png"), pred.join("1.png")).unwrap();
    fs::remove_file(pred.join("right_1.png")).unwrap();
    assert!(
        matches!(
            compare_folders(&pred, &truth, None),
            Err(EvalError::Ambiguous { .. })
        ),
        "one file, two views"
    );
}

/// A run's folder holds pictures of several kinds.
#[test]
fn a_folder_of_mattes_and_plates_is_told_to_name_one() {
    let root = tempfile::tempdir().unwrap();
    let (run, truth) = (root.path().join("run"), root.path().join("truth"));
    for folder in [&truth, &run.join("alpha"), &run.join("background")] {
        save(&disc(40, 20.0, 20.0, 5.0), &folder.join("1.png"));
    }
    let error = compare_folders(&run, &truth, None).unwrap_err().to_string();
    let meant = format!(
        "name the folder that is meant, {}",
        run.join("alpha").display()
    );
    assert!(error.contains(&meant), "{error}");
}

/// Photos of several cameras lie in a folder each, and so do a run's mattes.
#[test]
fn pictures_in_folders_are_found() {
    let root = tempfile::tempdir().unwrap();
    let [pred, truth, out] = ["pred", "truth", "out"].map(|name| root.path().join(name));
    for (name, radius) in [("left/01", 5.0), ("right/01", 12.0)] {
        let matte = disc(40, 20.0, 20.0, radius);
        save(&matte, &pred.join(format!("{name}.png")));
        save(&matte, &truth.join(format!("{name}.png")));
        save(&matte, &root.path().join(format!("photos/{name}.jpg")));
    }
    let report = compare_folders(&pred, &truth, None).unwrap();
    let names: Vec<&str> = report.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!((names, report.mean.iou), (vec!["left/01", "right/01"], 1.0));

    // A name in one folder is what is called so in another, unless two are.
    save(&disc(40, 20.0, 20.0, 5.0), &root.path().join("flat/01.png"));
    let flat = compare_folders(&pred, &root.path().join("flat"), None);
    assert!(matches!(flat, Err(EvalError::Ambiguous { .. })), "{flat:?}");
    fs::remove_dir_all(pred.join("right")).unwrap();
    let flat = compare_folders(&pred, &root.path().join("flat"), None).unwrap();
    assert_eq!(flat.mean.iou, 1.0);

    let photos = root.path().join("photos");
    let written = degrade_folder(&truth, &photos, Fault::Eroded, 0.2, 1, &out).unwrap();
    assert_eq!((written.count, written.notes.len()), (2, 0));
    assert!(out.join("left/01.png").is_file() && out.join("right/01.png").is_file());
}

#[cfg(unix)]
#[test]
fn a_closed_sub_folder_costs_no_view_in_others() {
    let (root, pred, truth, start) = scene();
    let closed = [&pred, &truth, &start].map(|folder| folder.join("lost+found"));
    if !make_closed(&closed) {
        return;
    }
    let says = |error: EvalError, what: &str| {
        let text = error.to_string();
        assert!(
            text.contains(what)
                && text.contains("lost+found cannot be read (")
                && text.contains("check that you may access it"),
            "{text}"
        );
    };
    let score = || compare_folders(&pred, &truth, Some(&start));
    says(score().unwrap_err(), "pred holds no .png");
    let matte = disc(40, 20.0, 20.0, 10.0);
    save(&matte, &pred.join("cat.png"));
    says(score().unwrap_err(), "pred holds no picture with the name");
    fs::remove_file(pred.join("cat.png")).unwrap();
    for i in 0..3 {
        save(&matte, &pred.join(format!("{i:03}.png")));
    }
    save(&matte, &start.join("001.png"));
    let report = score().unwrap();
    assert_eq!((report.views.len(), report.mean.iou), (3, 1.0));
    assert_eq!(report.notes.len(), 3, "{:?}", report.notes);
    let noted = report.table(0);
    let noted = noted.matches("lost+found cannot be read and is left out (");
    assert_eq!(noted.count(), 3);
    // The truth's is named for each contender.
    let contenders = [&pred, &start].map(|dir| Contender::parse(dir.to_str().unwrap()));
    let table = compare_contenders(&contenders, &truth).unwrap().table();
    assert_eq!(table.matches("lost+found").count(), 4, "{table}");

    let out = root.path().join("out");
    let degrade = || degrade_folder(&truth, &start, Fault::Eroded, 0.2, 1, &out);
    says(degrade().unwrap_err(), "start holds no photo of view \"00");
    for i in [0, 2] {
        save(&matte, &start.join(format!("{i:03}.png")));
    }
    let written = degrade().unwrap();
    assert_eq!((written.count, written.notes.len()), (3, 2));

    // What nobody could see is not counted as empty.
    save(&matte, &truth.join("right/000.png"));
    let seen = score().unwrap();
    assert_eq!(seen.missing, ["right/000"]);
    let unseen = pred.join("right");
    assert!(make_closed(std::slice::from_ref(&unseen)));
    let text = score().unwrap_err().to_string();
    assert!(
        text.contains("holds no picture of view \"right/000\"")
            && text.contains("pred/right cannot be read ("),
        "{text}"
    );
    open_again(&closed);
    open_again(&[unseen]);
}

#[test]
fn alpha_is_read_from_any_kind_of_picture() {
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("a.png");
    let levels = |i: u32| (i * 51) as u8;
    let expected: Vec<f32> = (0..6).map(|i| i as f32 / 5.0).collect();
    let near = |plane: Plane| {
        assert_eq!((plane.width, plane.height), (6, 1));
        plane
            .values
            .iter()
            .zip(&expected)
            .for_each(|(a, b)| assert_near(f64::from(*a), f64::from(*b), 1e-6));
    };
    let grey = GrayImage::from_fn(6, 1, |x, _| Luma([levels(x)]));
    grey.save(&path).unwrap();
    near(read_alpha(&path).unwrap());
    DynamicImage::from(grey.clone())
        .into_rgb8()
        .save(&path)
        .unwrap();
    near(read_alpha(&path).unwrap());
    DynamicImage::from(grey).into_rgba8().save(&path).unwrap(); // opaque: luma
    near(read_alpha(&path).unwrap());
    ImageBuffer::<Luma<u16>, _>::from_fn(6, 1, |x, _| Luma([(x * 13107) as u16]))
        .save(&path)
        .unwrap();
    near(read_alpha(&path).unwrap());
    RgbaImage::from_fn(6, 1, |x, _| Rgba([200, 10, 30, levels(x)]))
        .save(&path)
        .unwrap();
    near(read_alpha(&path).unwrap());
    RgbaImage::from_fn(6, 1, |_, _| Rgba([255, 255, 255, 0]))
        .save(&path)
        .unwrap(); // an empty cut-out
    assert_eq!(read_alpha(&path).unwrap(), Plane::empty(6, 1));
    // Grey that JPEG has tinted is grey; a photo is no matte.
    RgbaImage::from_fn(6, 1, |x, _| {
        Rgba([levels(x), levels(x), levels(x).max(12) - 12, 255])
    })
    .save(&path)
    .unwrap();
    assert!(read_alpha(&path).is_ok());
    RgbaImage::from_fn(6, 1, |x, _| Rgba([levels(x), 90, 30, 255]))
        .save(&path)
        .unwrap();
    let error = read_alpha(&path).unwrap_err();
    assert!(matches!(error, EvalError::NoMatte { .. }), "{error}");
}

#[test]
fn labels_are_black_and_white_and_inverted_masks_are_named() {
    let (_root, pred, truth, start) = scene();
    let rewrite = |to: &Path, value: fn(u8) -> u8| {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(&truth).unwrap().flatten() {
            let mut grey = image::open(entry.path()).unwrap().into_luma8();
            grey.iter_mut().for_each(|v| *v = value(*v));
            grey.save(to.join(entry.file_name())).unwrap();
        }
    };
    rewrite(&pred, |v| v / 128);
    rewrite(&start, |v| 255 - v);
    let report = compare_folders(&pred, &truth, Some(&start)).unwrap();
    assert_eq!(report.mean.iou, 1.0);
    assert_eq!(report.start.unwrap().iou, 0.0);
    let [labels, inverted] = &report.notes[..] else {
        panic!("{:?}", report.notes)
    };
    assert!(labels.contains("pred") && labels.contains("labels 0 and 1"));
    // Those who show them read them in the same way.
    let contenders = [&pred, &start].map(|folder| Contender::parse(folder.to_str().unwrap()));
    for (_, files) in mattes_by_view(&contenders, &truth).unwrap() {
        let read: Vec<_> = files
            .iter()
            .flatten()
            .map(|file| file.read().unwrap().mask(0.5))
            .collect();
        assert!(read[0] == read[1] && read[0] != read[2]);
    }
    assert!(inverted.contains("start") && inverted.contains("black is the object"));
    // One that has more in it is dark, all the same.
    GrayImage::from_pixel(40, 40, Luma([2]))
        .save(pred.join("001.png"))
        .unwrap();
    let report = compare_folders(&pred, &truth, None).unwrap();
    assert_eq!(report.mean.iou, 0.0);
    assert_eq!(report.notes, [""; 0]);
}

#[test]
fn masks_of_bytes_in_sixteen_bits_are_black_and_white() {
    let (_root, pred, truth, _) = scene();
    fs::create_dir_all(&pred).unwrap();
    let rewrite = |of: fn(u16) -> u16| {
        for entry in fs::read_dir(&truth).unwrap().flatten() {
            let grey = image::open(entry.path()).unwrap().into_luma8();
            let wide = ImageBuffer::from_fn(grey.width(), grey.height(), |x, y| {
                Luma([of(u16::from(grey.get_pixel(x, y).0[0]))])
            });
            wide.save(pred.join(entry.file_name())).unwrap();
        }
    };
    for (of, says) in [
        (
            (|v| v) as fn(u16) -> u16,
            Some("16 bits but nothing above 255"),
        ),
        (|v| v / 128, Some("labels 0 and 1")),
        (|v| 257 * v, None),
    ] {
        rewrite(of);
        let report = compare_folders(&pred, &truth, None).unwrap();
        assert_eq!(report.mean.iou, 1.0, "{says:?}");
        let notes = report.notes.iter().map(String::as_str);
        assert!(notes.clone().count() == usize::from(says.is_some()));
        assert!(says.is_none_or(|says| notes.clone().any(|note| note.contains(says))));
    }
    // Bright somewhere, and so dark elsewhere.
    ImageBuffer::from_pixel(40, 40, Luma([200u16]))
        .save(pred.join("001.png"))
        .unwrap();
    let report = compare_folders(&pred, &truth, None).unwrap();
    assert!(report.mean.iou < 1.0 && report.notes.is_empty());
}

#[test]
fn bad_input_is_one_sentence_with_the_file() {
    let (root, pred, truth, start) = scene();
    let tell = |pred: &Path, start: Option<&Path>| {
        compare_folders(pred, &truth, start)
            .unwrap_err()
            .to_string()
    };
    let says = |sentence: String, clues: &[&str]| {
        clues
            .iter()
            .for_each(|clue| assert!(sentence.contains(clue), "{sentence:?} lacks {clue:?}"));
        assert!(!sentence.contains('\n'));
    };

    says(
        tell(&root.path().join("nowhere"), None),
        &["nowhere", "cannot be read"],
    );
    fs::create_dir_all(&pred).unwrap();
    fs::write(pred.join("notes.txt"), "x").unwrap();
    says(tell(&pred, None), &["pred", "holds no .png"]);
    fs::write(pred.join("000.png"), b"\x89PNG\r\n\x1a\nbroken").unwrap();
    says(tell(&pred, None), &["000.png", "cannot be read"]);
    save(&disc(30, 15.0, 15.0, 5.0), &pred.join("000.png"));
    says(
        tell(&pred, None),
        &["pred/000.png", "30x30", "truth/000.png", "40x40"],
    );
    save(&disc(41, 15.0, 15.0, 5.0), &start.join("002.png"));
    says(
        tell(&truth, Some(&start)),
        &["start/002.png", "41x41", "truth/002.png"],
    );
    save(&disc(40, 15.0, 15.0, 5.0), &pred.join("000.png"));
    save(&disc(40, 15.0, 15.0, 5.0), &pred.join("000.jpg"));
    says(tell(&pred, None), &["000.png", "000.jpg", "both"]);
    let other = root.path().join("other");
    save(&disc(40, 15.0, 15.0, 5.0), &other.join("cat.png"));
    says(tell(&other, None), &["other", "truth"]);
    save(&disc(40, 15.0, 15.0, 5.0), &other.join("a1.png"));
    save(&disc(40, 15.0, 15.0, 5.0), &other.join("b1.png"));
    says(tell(&other, None), &["a1.png", "b1.png", "\"001\""]);
}

#[test]
fn the_table_is_aligned_and_names_the_worst() {
    let (_root, pred, truth, start) = scene();
    save(&disc(40, 20.0, 20.0, 10.0), &pred.join("000.png"));
    save(&disc(40, 22.0, 20.0, 10.0), &pred.join("002.png"));
    save(&disc(40, 20.0, 20.0, 10.0), &start.join("001.png"));
    let report = compare_folders(&pred, &truth, Some(&start)).unwrap();
    let table = report.table(2);
    let lines: Vec<&str> = table.lines().collect();
    let widths: Vec<usize> = lines.iter().map(|line| line.len()).collect();
    assert!(
        lines[1].starts_with("mean of 3") && lines[2].starts_with("start "),
        "{table}"
    );
    assert!(
        lines[4].starts_with("001") && lines[5].starts_with("002"),
        "{table}"
    );
    assert!(
        [1, 2, 4, 5].iter().all(|&i| widths[i] == widths[0]),
        "{table}"
    );
    assert!(
        table.contains("matte missing, counted as empty: 001\n"),
        "{table}"
    );
    assert_eq!(
        report.to_string().lines().count(),
        lines.len() + 1,
        "Display shows five of the three views"
    );
}

#[test]
fn contenders_are_scored_side_by_side() {
    let (root, pred, truth, start) = scene();
    for i in 0..3 {
        // A run has its mattes in alpha/; any other system's are a folder of pictures.
        let shifted = disc(40, 21.0, 20.0, 10.0);
        save(&shifted, &pred.join(format!("alpha/{i:03}.png")));
    }
    save(&disc(40, 20.0, 20.0, 10.0), &start.join("001.png"));
    let contenders = [
        Contender::parse(pred.to_str().unwrap()),
        Contender::parse(&format!("rough masks={}", start.display())),
    ];
    let comparison = compare_contenders(&contenders, &truth).unwrap();
    let [run, rough] = &comparison.contenders[..] else {
        panic!("two contenders");
    };
    assert_eq!(
        (run.name.as_str(), rough.name.as_str()),
        ("pred", "rough masks")
    );
    assert!(run.report.mean.iou > 0.8 && run.report.mean.iou < 1.0);
    assert_near(rough.report.mean.iou, 1.0 / 3.0, 1e-12);
    let table = comparison.table();
    assert!(
        table.contains("rough masks: 2 of 3 mattes missing"),
        "{table}"
    );
    assert_eq!(table.lines().count(), 4, "{table}");
    let markdown = comparison.markdown();
    let lines: Vec<&str> = markdown.lines().collect();
    assert_eq!(lines.len(), 4, "{markdown}");
    let columns: Vec<usize> = lines.iter().map(|line| line.matches('|').count()).collect();
    assert_eq!(columns, [12; 4], "{markdown}");
    let iou = format!("{:.4}", run.report.mean.iou);
    assert!(
        lines[2].starts_with(&format!("| pred | {iou} |")),
        "{markdown}"
    );

    let rows = mattes_by_view(&contenders, &truth).unwrap();
    let found: Vec<_> = rows.iter().map(|(_, files)| files[2].is_some()).collect();
    assert_eq!(found, [false, true, false]);
    assert!(compare_contenders(&contenders, root.path()).is_err());
}
