use crate::folders::save;
use crate::{assert_near, disc};
#[cfg(unix)]
use crate::{make_closed, open_again};
use image::{GrayImage, Luma, Rgb, RgbImage};
use sos_eval::*;
use std::fs;
use std::path::Path;

fn save_rgb(path: &Path, colour: impl Fn(u32, u32) -> [u8; 3]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    RgbImage::from_fn(40, 40, |x, y| Rgb(colour(x, y)))
        .save(path)
        .unwrap();
}

/// A run and a scene of two views: the plate is off by 51 (0.2) in the left half; the background of the
/// right half was seen by four views, of the left by two.
fn run_and_scene(root: &Path) {
    for view in ["000", "001"] {
        let file = format!("{view}.png");
        save(
            &disc(40, 19.5, 19.5, 10.0),
            &root.join("scene/alpha_gt").join(&file),
        );
        save(
            &disc(40, 19.5, 19.5, 10.0),
            &root.join("run/alpha").join(&file),
        );
        save_rgb(&root.join("scene/background_gt").join(&file), |_, _| {
            [100; 3]
        });
        save_rgb(&root.join("run/background").join(&file), |x, _| {
            if x < 20 { [151; 3] } else { [100; 3] }
        });
        let seen = root.join("run/background_seen").join(&file);
        fs::create_dir_all(seen.parent().unwrap()).unwrap();
        GrayImage::from_fn(40, 40, |x, _| Luma([if x < 20 { 2 } else { 4 }]))
            .save(seen)
            .unwrap();
    }
}

#[test]
fn plates_are_scored_inside_the_object_where_seen() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    run_and_scene(root);
    let score = |min_seen| {
        let (run, scene) = (root.join("run"), root.join("scene"));
        let (plates, truth) = (run.join("background"), scene.join("background_gt"));
        compare_plates(
            &plates,
            &truth,
            &scene.join("alpha_gt"),
            Some(&run.join("background_seen")),
            min_seen,
        )
        .unwrap()
    };
    let half_wrong = -10.0 * (0.5 * 0.2_f64 * 0.2).log10();
    let strict = score(3);
    assert_near(strict.seen.unwrap().psnr, 100.0, 1e-9);
    assert_near(strict.seen_share, 0.5, 1e-12);
    for q in [
        strict.object.unwrap(),
        strict.whole.unwrap(),
        score(1).seen.unwrap(),
    ] {
        assert_near(q.psnr, half_wrong, 1e-4);
        assert_near(q.psnr_pooled, half_wrong, 1e-4);
        assert_eq!(q.views, 2);
        assert!(q.ssim < 1.0);
    }
    assert_eq!(score(9).seen, None);
    assert!(strict.missing.is_empty());

    let json = serde_json::to_value(&strict).unwrap();
    assert!(
        json["psnr"].is_number() && json["ssim"].is_number() && json["object"]["psnr"].is_number()
    );
    for score in [strict, score(9)] {
        let text = serde_json::to_string(&score).unwrap();
        assert_eq!(serde_json::from_str::<PlateScore>(&text).unwrap(), score);
    }
}

#[test]
fn psnr_is_averaged_over_views_or_pooled() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    run_and_scene(root);
    save_rgb(&root.join("run/background/001.png"), |_, _| [100; 3]);
    let (plates, truth) = (
        root.join("run/background"),
        root.join("scene/background_gt"),
    );
    let score = compare_plates(&plates, &truth, &root.join("scene/alpha_gt"), None, 3).unwrap();
    let object = score.object.unwrap();
    assert_eq!(
        score.seen, score.object,
        "without a map all pixels count as seen"
    );
    assert_near(object.psnr, 0.5 * (100.0 - 10.0 * (0.02_f64).log10()), 1e-4);
    assert_near(object.psnr_pooled, -10.0 * 0.01_f64.log10(), 1e-4);

    fs::remove_file(root.join("run/background/000.png")).unwrap();
    let score = compare_plates(&plates, &truth, &root.join("scene/alpha_gt"), None, 3).unwrap();
    assert_eq!(score.missing, ["000"]);
    assert_eq!(score.object.unwrap().views, 1);
}

/// What label masks call the object is where plates are scored, too.
#[test]
fn regions_of_labels_are_read_as_black_and_white() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    run_and_scene(root);
    let (run, scene) = (root.join("run"), root.join("scene"));
    let by_mattes = run_eval(&run, &scene, None).unwrap();
    assert_eq!(by_mattes.notes, [""; 0]);
    let alpha = scene.join("alpha_gt");
    for view in ["000.png", "001.png"] {
        let mut grey = image::open(alpha.join(view)).unwrap().into_luma8();
        grey.iter_mut().for_each(|v| *v /= 128);
        grey.save(alpha.join(view)).unwrap();
    }
    let by_labels = run_eval(&run, &scene, None).unwrap();
    assert!(by_labels.plate.is_some());
    assert_eq!(by_labels.plate, by_mattes.plate);
    assert_eq!(by_labels.notes.len(), 1, "{:?}", by_labels.notes);
    let truth = scene.join("background_gt");
    let alone = compare_plates(&run.join("background"), &truth, &alpha, None, 3).unwrap();
    assert!(alone.notes[0].contains("alpha_gt hold the labels 0 and 1"));

    // A dark matte is none of labels where others are bright, with a true plate or not.
    save(&disc(40, 19.5, 19.5, 10.0), &alpha.join("000.png"));
    fs::remove_file(truth.join("000.png")).unwrap();
    let dark = compare_plates(&run.join("background"), &truth, &alpha, None, 3).unwrap();
    assert_eq!((dark.object, dark.whole.unwrap().views), (None, 1));
    assert_eq!(dark.notes, [""; 0]);
}

#[cfg(unix)]
#[test]
fn closed_sub_folders_of_a_run_are_noted_once() {
    let root = tempfile::tempdir().unwrap();
    let (run, scene) = (root.path().join("run"), root.path().join("scene"));
    run_and_scene(root.path());
    let truth = scene.join("alpha_gt");
    let closed = [run.join("background"), truth.clone()].map(|folder| folder.join("lost+found"));
    if !make_closed(&closed) {
        return;
    }
    let report = run_eval(&run, &scene, None).unwrap();
    let plate = report.plate.unwrap();
    assert_eq!((plate.whole.unwrap().views, plate.missing.len()), (2, 0));
    assert_eq!(report.notes.len(), 2, "{:?}", report.notes);
    assert!(report.notes[0].contains("alpha_gt/lost+found cannot be read"));
    assert!(report.notes[1].contains("background/lost+found cannot be read"));
    let (plates, plate_truth) = (run.join("background"), scene.join("background_gt"));
    let alone = compare_plates(&plates, &plate_truth, &truth, None, 3).unwrap();
    assert_eq!(alone.notes.len(), 2, "{:?}", alone.notes);
    open_again(&closed);
}

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn a_run_is_scored_with_all_that_is_there() {
    let root = tempfile::tempdir().unwrap();
    let root = root.path();
    run_and_scene(root);
    let (run, scene) = (root.join("run"), root.join("scene"));
    fs::write(scene.join("mesh_gt.ply"), TRIANGLE).unwrap();
    fs::write(run.join("mesh.ply"), TRIANGLE).unwrap();
    let by_scene = run_eval(&run, &scene, None).unwrap();
    assert_eq!(
        by_scene,
        run_eval(&run, &scene.join("alpha_gt"), None).unwrap()
    );
    assert_eq!(by_scene.mean.iou, 1.0);
    assert_eq!(by_scene.plate.as_ref().unwrap().truth, "background_gt");
    assert_near(by_scene.mesh.unwrap().absolute.chamfer, 0.0, 1e-12);
    let table = by_scene.table(1);
    assert!(
        table.contains("plates against background_gt") && table.contains("chamfer"),
        "{table}"
    );

    assert!(by_scene.clean_plate.is_none());

    // The plate with the shadow kept is what the pictures show: first where it exists, the other beside it.
    save_rgb(&scene.join("background_shadow_gt/001.png"), |_, _| [100; 3]);
    let both = run_eval(&run, &scene, None).unwrap();
    let plate = both.plate.as_ref().unwrap();
    assert_eq!(
        (plate.truth.as_str(), plate.whole.unwrap().views),
        ("background_shadow_gt", 1)
    );
    assert_eq!(both.clean_plate, by_scene.plate);
    let table = both.table(1);
    let place = |what: &str| table.find(&format!("plates against {what}\n")).unwrap();
    assert!(place("background_shadow_gt") < place("background_gt"));

    // A mesh of which nothing is left does not cost the other scores, nor does a broken one or one of no sense.
    fs::write(
        run.join("mesh.ply"),
        TRIANGLE
            .replace("face 1", "face 0")
            .replace("3 0 1 2\n", ""),
    )
    .unwrap();
    let report = run_eval(&run, &scene, None).unwrap();
    assert!(
        report.mesh.is_none() && report.notes[0].contains("mesh.ply"),
        "{:?}",
        report.notes
    );
    let afar = TRIANGLE.replace("1 0 0", "1e37 0 0");
    for (ply, says) in [("nonsense", "cannot be read"), (&afar, "vertex 1 lies")] {
        fs::write(run.join("mesh.ply"), ply).unwrap();
        let report = run_eval(&run, &scene, None).unwrap();
        assert_eq!((report.mesh, report.mean.iou), (None, 1.0));
        assert!(
            report.notes[0].contains("mesh.ply") && report.notes[0].contains(says),
            "{:?}",
            report.notes
        );
    }

    let mattes = run_eval(&run.join("alpha"), &scene, None).unwrap_err();
    assert_eq!(
        mattes,
        EvalError::NoRun {
            path: run.join("alpha")
        }
    );
    let says = mattes.to_string();
    assert!(
        says.contains("run's folder") && says.contains("sos compare"),
        "{says}"
    );

    // Mattes alone are enough.
    fs::remove_file(run.join("mesh.ply")).unwrap();
    fs::remove_dir_all(run.join("background")).unwrap();
    let report = run_eval(&run, &scene, Some(&scene.join("alpha_gt"))).unwrap();
    assert!(report.plate.is_none() && report.mesh.is_none() && report.start.is_some());
}
