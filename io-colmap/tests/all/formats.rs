//! Writing and reading back, and the liberties that real files take.

use crate::sample;
use io_colmap::{Model, SparsePoint, read_observations};
use std::fs;

#[test]
fn both_formats_return_the_model_unchanged() {
    let model = sample::model();
    let dir = tempfile::tempdir().unwrap();
    let (text, binary) = (dir.path().join("t"), dir.path().join("b"));
    model.write_text(&text).unwrap();
    model.write_binary(&binary).unwrap();
    let from_text = Model::read(&text).unwrap();
    assert_eq!(from_text, Model::read(&binary).unwrap());
    assert_eq!(from_text.cameras, model.cameras);
    assert_eq!(from_text.views, model.views);
    assert_eq!(from_text.points.len(), model.points.len());
    for (read, original) in from_text.points.iter().zip(&model.points) {
        let unseen = |point: &SparsePoint| SparsePoint {
            views: Vec::new(),
            ..point.clone()
        };
        assert_eq!(unseen(read), unseen(original));
        // Perspective cameras that look away from a point are left out of its track.
        assert!(read.views.iter().all(|id| original.views.contains(id)));
        assert!(read.views.len() >= original.views.len() / 4, "{read:?}");
    }
    // What was written is stable, and consistent with itself.
    let again = dir.path().join("again");
    from_text.write_binary(&again).unwrap();
    assert_eq!(Model::read(&again).unwrap(), from_text);
    let observations = read_observations(&text).unwrap();
    assert_eq!(observations, read_observations(&binary).unwrap());
    assert_eq!(
        observations.len(),
        from_text
            .points
            .iter()
            .map(|p| p.views.len())
            .sum::<usize>()
    );
}

#[test]
fn numbers_that_could_not_be_read_back_are_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let spoilt = |spoil: &dyn Fn(&mut Model)| {
        let mut model = sample::model();
        spoil(&mut model);
        for error in [model.write_text(dir.path()), model.write_binary(dir.path())] {
            error.unwrap_err();
        }
        assert!(fs::read_dir(dir.path()).unwrap().next().is_none());
    };
    spoilt(&|model| model.views[0].camera_from_world.translation.x = f64::NAN);
    spoilt(&|model| {
        model.views[0].camera_from_world.rotation = glam::DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)
    });
    spoilt(&|model| model.points[0].position.y = f64::INFINITY);
    spoilt(&|model| model.points[1].id = model.points[0].id);
    spoilt(&|model| {
        let camera = model.cameras.values_mut().next().unwrap();
        camera.width = (1 << 20) + 1;
    });
    spoilt(&|model| {
        let camera = model.cameras.values_mut().next().unwrap();
        camera.id += 1000;
    });
    // One in text beside a binary one is not what would be read.
    sample::model().write_binary(dir.path()).unwrap();
    let error = sample::model().write_text(dir.path()).unwrap_err();
    assert!(error.to_string().contains("binary"), "{error}");
}

#[test]
fn binary_is_preferred_and_rigs_and_missing_points_are_fine() {
    let dir = tempfile::tempdir().unwrap();
    sample::small(&["text.png"]).write_text(dir.path()).unwrap();
    sample::small(&["binary.png"])
        .write_binary(dir.path())
        .unwrap();
    for name in ["rigs.bin", "frames.bin"] {
        fs::write(dir.path().join(name), b"not looked at").unwrap();
    }
    fs::remove_file(dir.path().join("points3D.bin")).unwrap();
    let model = Model::read(dir.path()).unwrap();
    assert_eq!(model.views[0].name, "binary.png");
    assert!(model.points.is_empty());
}

#[test]
fn text_may_have_comments_crlf_blanks_in_names_and_unmatched_positions() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write(
        "cameras.txt",
        "\u{feff}# comment\r\n\r\n3 PINHOLE 64 48 60 60.5 32 24\r\n",
    );
    write(
        "images.txt",
        "# c\r\n7 2 0 0 0 0 0 4 3 b c.png\r\n1.5 2.5 -1 3 4 5 6 7 18446744073709551615\r\n\r\n\
         5 1 0 0 0 1e-3 0 4 3 a.png\r\n\r\n",
    );
    write("points3D.txt", "5 0.5 0 1 1 2 3 0.1 9 0 7 1 7 2 5 0\n");
    let model = Model::read(dir.path()).unwrap();
    let names: Vec<_> = model.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["a.png", "b c.png"], "sorted by name");
    assert_eq!(model.cameras[&3].focal(), (60.0, 60.5));
    assert_eq!(model.cameras[&3].principal_point(), (32.0, 24.0));
    assert!(
        (model.views[1].camera_from_world.rotation.w - 1.0).abs() < 1e-15,
        "normalised"
    );
    assert_eq!(
        model.points[0].views,
        [5, 7],
        "sorted, without doubles and unknown photos"
    );
    let observations = read_observations(dir.path()).unwrap();
    assert_eq!(observations.len(), 1);
    assert_eq!((observations[0].view_id, observations[0].point_id), (7, 5));
}

#[test]
fn a_model_that_could_not_be_read_back_is_not_written() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["../up.png", "two\nlines.png", " blank.png"] {
        let error = sample::small(&[name])
            .write_text(dir.path())
            .unwrap_err()
            .to_string();
        assert!(error.contains("photo name"), "{error}");
    }
    let mut model = sample::small(&["a.png"]);
    model.cameras.clear();
    assert!(
        model
            .write_binary(dir.path())
            .unwrap_err()
            .to_string()
            .contains("camera 1")
    );
}
